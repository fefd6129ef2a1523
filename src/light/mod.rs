//! Sources of light: what would arrive at a patch if nothing were in the way.

mod sky;
mod triangles;

use crate::color::Rgb64;
pub use crate::form_factor::pairs::Facet;
use crate::geometry::Ray;
use glam::Vec3;
pub use sky::UniformSky;
pub use triangles::EmittingTriangles;

/// A source that can be sampled. A new kind of light implements this.
pub trait Light: Send + Sync {
    /// One sample of the mean irradiance on a patch. Of the numbers in [0, 1), the first two place a point
    /// on the receiver, and the last two choose where its light comes from. `None`: this sample brings
    /// nothing.
    fn sample(&self, receiver: &Facet, xi: [f32; 4]) -> Option<LightSample>;

    /// One sample of the irradiance at a point, lifted off its surface, with the surface's normal. `None`:
    /// this sample brings nothing.
    fn sample_at(&self, point: Vec3, normal: Vec3, xi: [f32; 2]) -> Option<LightSample>;
}

/// What one sample brings, if its way is clear. The mean over many samples is the irradiance.
pub struct LightSample {
    /// Whatever it meets takes the light away.
    pub segment: Ray,
    /// In W·m⁻².
    pub irradiance: Rgb64,
}
