//! Constant irradiance over each patch.

use super::IrradianceField;
use crate::color::Rgb;
use crate::geometry::RayCaster;
use crate::patches::SurfacePoint;

/// The irradiance of each patch's uncovered part, all over the patch.
pub struct Constant(Vec<Rgb>);

impl Constant {
    /// `irradiance` in W·m⁻² and the uncovered share of its area, per patch.
    pub fn new(irradiance: &[Rgb], uncovered: &[f32]) -> Self {
        let of_uncovered = |(irradiance, &uncovered): (&Rgb, &f32)| {
            let share = if uncovered > 0.0 { uncovered } else { 1.0 };
            *irradiance / share
        };
        Constant(irradiance.iter().zip(uncovered).map(of_uncovered).collect())
    }
}

impl IrradianceField for Constant {
    fn irradiance(&self, _: &dyn RayCaster, at: &[SurfacePoint], irradiance: &mut [Rgb]) {
        for (point, irradiance) in at.iter().zip(irradiance) {
            *irradiance = self.0[point.patch.index()];
        }
    }
}
