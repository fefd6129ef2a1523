//! A point of a lit side, as pictures need it.

use super::{Cell, PatchId, PatchMesh, Side};
use crate::geometry::{Hit, Ray};
use glam::Vec3;

/// Where a ray met a lit side, down to the patch and the place within it.
#[derive(Clone, Copy)]
pub struct SurfacePoint<'m> {
    pub side: &'m Side,
    pub side_number: usize,
    pub cell: Cell,
    pub patch: PatchId,
    /// Barycentrics (λ₁, λ₂) within the patch.
    pub l1: f32,
    pub l2: f32,
    /// The point itself, in the mesh's coordinates, as the triangle's corners give it.
    pub position: Vec3,
    pub sample: SampleId,
}

/// Which sample of a picture a point belongs to: the random numbers of an estimate at the point follow from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleId {
    /// The pixel's column and row, from the top left.
    pub pixel: [u32; 2],
    /// Within the pixel.
    pub number: u32,
}

impl<'m> SurfacePoint<'m> {
    /// `None` on the black back of a one-sided triangle.
    #[inline]
    pub fn hit(mesh: &'m PatchMesh, ray: &Ray, hit: &Hit, sample: SampleId) -> Option<Self> {
        let side_number = mesh.side_number_hit(ray, hit)?;
        let side = &mesh.sides()[side_number];
        let (cell, l1, l2) = Cell::containing(side.level, hit.u, hit.v);
        let patch = PatchId(side.first.0 + cell.number(side.level));
        let position = mesh.scene.triangles[hit.triangle.index()].at(hit.u, hit.v);
        Some(SurfacePoint { side, side_number, cell, patch, l1, l2, position, sample })
    }
}
