//! Irradiance at any point of a surface, from the irradiance of the patches.
//!
//! Everything that shows light asks an [`IrradianceField`]: in a diffuse scene each way to draw is
//! another estimate of H at points. The material is applied at the point itself, so it stays sharp
//! whatever the field does.

mod constant;
mod interpolated;
mod path_traced;

use crate::color::Rgb;
use crate::geometry::RayCaster;
use crate::patches::SurfacePoint;
pub use constant::Constant;
pub use interpolated::Interpolated;
pub use path_traced::PathTraced;

/// H as a function of the point. A new way to look at light implements this.
pub trait IrradianceField: Send + Sync {
    /// Sets `irradiance` to H in W·m⁻², one per point. The slices have one length. `caster` answers rays in the
    /// scene.
    fn irradiance(&self, caster: &dyn RayCaster, at: &[SurfacePoint], irradiance: &mut [Rgb]);

    /// Whether H is estimated anew at every point, so that the samples of a pixel tell how far off their mean is.
    fn is_noisy(&self) -> bool {
        false
    }

    /// Rays that all estimates so far took.
    fn rays(&self) -> u64 {
        0
    }
}
