//! A sky.

use super::{Light, LightSample};
use crate::color::{Rgb, Rgb64};
use crate::form_factor::pairs::Facet;
use crate::geometry::Ray;
use crate::sampling::cosine_hemisphere;
use glam::Vec3;
use std::f64::consts::PI;

/// Equal radiance from every direction that leaves the scene.
pub struct UniformSky {
    irradiance: Rgb64,
}

impl UniformSky {
    /// `radiance` in W·sr⁻¹·m⁻².
    pub fn new(radiance: Rgb) -> Self {
        UniformSky { irradiance: radiance.as_dvec3() * PI }
    }
}

impl Light for UniformSky {
    fn sample(&self, receiver: &Facet, [x0, x1, y0, y1]: [f32; 4]) -> Option<LightSample> {
        let (point, normal) = receiver.point([x0, x1]);
        self.sample_at(point, normal, [y0, y1])
    }

    /// Cosine-distributed directions all bring πL: where nothing is in the way, nothing varies.
    fn sample_at(&self, point: Vec3, normal: Vec3, xi: [f32; 2]) -> Option<LightSample> {
        let segment = Ray::new(point, cosine_hemisphere(normal, xi[0], xi[1]));
        Some(LightSample { segment, irradiance: self.irradiance })
    }
}
