//! Points that are spread over patches.

use super::{Members, PatchId, PatchMesh, Side};
use crate::sampling::{PointSet, Purpose, Stream, uniform_triangle};
use glam::Vec3;

/// Low-discrepancy points of some patches, uniform over their area.
pub(crate) struct RandomPoints<'m> {
    mesh: &'m PatchMesh,
    patches: Vec<PatchId>,
    /// The area of the patches up to and including each.
    cumulative: Vec<f64>,
    seed: u64,
}

impl<'m> RandomPoints<'m> {
    pub(crate) fn of(
        mesh: &'m PatchMesh,
        patches: impl Iterator<Item = PatchId>,
        seed: u64,
    ) -> Self {
        let patches: Vec<PatchId> = patches.collect();
        let mut sum = 0.0;
        let cumulative = patches.iter().map(|&patch| {
            sum += mesh.area(patch);
            sum
        });
        RandomPoints { mesh, cumulative: cumulative.collect(), patches, seed }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.patches.is_empty()
    }

    /// Point `number`, lifted off its side, with its patch.
    ///
    /// # Panics
    /// If there are no patches.
    pub(crate) fn point(&self, number: u32) -> (PatchId, &'m Side, Vec3) {
        let stream = Stream::new(self.seed, Purpose::SurfacePoint, 0, PointSet::Sobol);
        let [chosen, x0, x1, member] = stream.point(number);
        let wanted = chosen as f64 * self.cumulative.last().expect("there are patches");
        let last = self.patches.len() - 1;
        let k = self.cumulative.partition_point(|&sum| sum <= wanted).min(last);
        let patch = self.patches[k];
        let members = Members::of(self.mesh, patch);
        let (side, _) = members.choose(member);
        let [p0, p1, p2] = side.sampling_area(&members.part(side)).p;
        let [l0, l1, l2] = uniform_triangle(x0, x1);
        (patch, side, side.lifted(p0 * l0 + p1 * l1 + p2 * l2))
    }
}
