//! What a point of a surface looks like: constant per patch, or interpolated.

use super::smooth::VertexIrradiance;
use crate::color::{Rgb, Rgb64};
use crate::geometry::{Hit, Ray};
use crate::patches::{Cell, PatchId, PatchMesh, Side};
use std::f32::consts::PI;

/// Where a ray met a lit side, down to the patch and the place within it.
pub struct SurfacePoint<'m> {
    pub side: &'m Side,
    pub side_number: usize,
    pub cell: Cell,
    pub patch: PatchId,
    /// Barycentrics (λ₁, λ₂) within the patch.
    pub l1: f32,
    pub l2: f32,
}

impl<'m> SurfacePoint<'m> {
    /// `None` on the black back of a one-sided triangle.
    #[inline]
    pub fn hit(mesh: &'m PatchMesh, ray: &Ray, hit: &Hit) -> Option<Self> {
        let side = mesh.side_hit(ray, hit)?;
        let (cell, l1, l2) = Cell::containing(side.level, hit.u, hit.v);
        let patch = PatchId(side.first.0 + cell.number(side.level));
        Some(SurfacePoint { side, side_number: mesh.side_number(patch), cell, patch, l1, l2 })
    }
}

/// Radiance at a point of a lit side, equal in all directions.
pub trait Shading: Sync {
    /// In W·sr⁻¹·m⁻².
    fn radiance(&self, point: &SurfacePoint) -> Rgb;
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
pub struct Smooth<'m> {
    mesh: &'m PatchMesh<'m>,
    irradiance: VertexIrradiance,
}

impl<'m> Smooth<'m> {
    pub fn new(mesh: &'m PatchMesh<'m>, irradiance: VertexIrradiance) -> Self {
        Smooth { mesh, irradiance }
    }
}

impl Shading for Smooth<'_> {
    #[inline]
    fn radiance(&self, point: &SurfacePoint) -> Rgb {
        let material = &self.mesh.scene.materials[point.side.material.0 as usize];
        material.radiance + material.reflectance * self.irradiance.at(point) / PI
    }
}
