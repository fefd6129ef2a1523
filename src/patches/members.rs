//! The sides that a patch consists of.

use super::{PatchId, PatchMesh, Side};
use crate::geometry::Triangle;

/// Chooses among the sides of a patch in proportion to their area. Most patches are part of one side; a cluster
/// has several.
pub(crate) struct Members<'m> {
    mesh: &'m PatchMesh,
    patch: PatchId,
    sides: &'m [Side],
    /// Of a cluster: the area of the sides up to and including each.
    cumulative: Vec<f64>,
}

impl<'m> Members<'m> {
    pub(crate) fn of(mesh: &'m PatchMesh, patch: PatchId) -> Self {
        let sides = mesh.members(patch);
        let mut cumulative = Vec::new();
        if sides.len() > 1 {
            let mut sum = 0.0;
            cumulative.extend(sides.iter().map(|side| {
                sum += side.patch_area;
                sum
            }));
        }
        Members { mesh, patch, sides, cumulative }
    }

    /// The side for ξ in [0, 1), and ξ stretched over its share so that it can be used again.
    pub(crate) fn choose(&self, xi: f32) -> (&'m Side, f32) {
        let Some(&whole) = self.cumulative.last() else { return (&self.sides[0], xi) };
        let wanted = xi as f64 * whole;
        let last = self.sides.len() - 1;
        let k = self.cumulative.partition_point(|&sum| sum <= wanted).min(last);
        let below = if k == 0 { 0.0 } else { self.cumulative[k - 1] };
        let stretched = (wanted - below) / (self.cumulative[k] - below);
        (&self.sides[k], (stretched as f32).clamp(0.0, 1f32.next_down()))
    }

    /// The part of the patch on one of its sides, wound so that its normal is the side's.
    pub(crate) fn part(&self, side: &Side) -> Triangle {
        if self.cumulative.is_empty() {
            self.mesh.triangle(self.patch)
        } else {
            side.shape(&self.mesh.scene)
        }
    }
}
