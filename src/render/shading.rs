//! The look of a surface's point: constant per patch, or interpolated.

use super::smooth::VertexIrradiance;
use crate::color::{Rgb, Rgb64};
use crate::patches::{PatchId, PatchMesh, SurfacePoint};
use crate::scene::Material;
use std::f32::consts::PI;
use std::sync::Arc;

/// Radiance at a point of a lit side, equal in all directions.
pub trait Shading: Send + Sync {
    /// In W·sr⁻¹·m⁻².
    fn radiance(&self, point: &SurfacePoint) -> Rgb;

    /// The sum over some points, in their order: one call through the trait for a pixel's samples.
    fn sum(&self, points: &[SurfacePoint]) -> Rgb {
        points.iter().fold(Rgb::ZERO, |sum, point| sum + self.radiance(point))
    }
}

/// Constant radiance over each patch: that of its uncovered part.
pub struct Flat {
    radiance: Vec<Rgb>,
}

impl Flat {
    /// `irradiance` in W·m⁻² and the uncovered share of its area, per patch.
    pub fn new(mesh: &PatchMesh, irradiance: &[Rgb64], uncovered: &[f64]) -> Self {
        let radiance = |(i, (irradiance, uncovered)): (usize, (&Rgb64, &f64))| {
            let patch = PatchId(i as u32);
            let share = if *uncovered > 0.0 { *uncovered } else { 1.0 };
            let reflected = mesh.reflectance(patch) * (irradiance / share).as_vec3();
            (mesh.exitance(patch) + reflected) / PI
        };
        Flat { radiance: irradiance.iter().zip(uncovered).enumerate().map(radiance).collect() }
    }
}

impl Shading for Flat {
    #[inline]
    fn radiance(&self, point: &SurfacePoint) -> Rgb {
        self.radiance[point.patch.index()]
    }
}

/// Irradiance interpolated between the patches' vertices, seen through each point's own material.
pub struct Smooth {
    materials: Arc<[Material]>,
    irradiance: VertexIrradiance,
}

impl Smooth {
    pub fn new(mesh: &PatchMesh, irradiance: VertexIrradiance) -> Self {
        Smooth { materials: mesh.scene.materials.clone(), irradiance }
    }
}

impl Shading for Smooth {
    #[inline]
    fn radiance(&self, point: &SurfacePoint) -> Rgb {
        let material = &self.materials[point.side.material.0 as usize];
        material.radiance + material.reflectance * self.irradiance.at(point) / PI
    }
}
