//! A point of a lit side, as pictures need it.

use super::{Cell, PatchId, PatchMesh, Side};
use crate::geometry::{Hit, Ray};

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
        let side_number = mesh.side_number_hit(ray, hit)?;
        let side = &mesh.sides()[side_number];
        let (cell, l1, l2) = Cell::containing(side.level, hit.u, hit.v);
        let patch = PatchId(side.first.0 + cell.number(side.level));
        Some(SurfacePoint { side, side_number, cell, patch, l1, l2 })
    }
}
