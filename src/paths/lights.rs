//! Which emitters are sampled, and which paths find.

use crate::color::Rgb;
use crate::light::EmittingTriangles;
use crate::patches::{PatchId, PatchMesh, Side};

/// How the scene's light is found.
pub(crate) struct Lights {
    /// Sampled at every point. `None` if there are none, or these are large.
    pub(super) sampled: Option<EmittingTriangles>,
    /// Per side, whether it is among these. Paths find the others: what is seen of them varies over their area in a
    /// way that samples of their area do not know.
    pub(super) is_sampled: Vec<bool>,
}

/// Up to this share of the scene's area emitters are sampled. Rays find more of them as well, and know which is near.
const SAMPLED: f64 = 0.5;

impl Lights {
    pub(crate) fn of(mesh: &PatchMesh) -> Lights {
        let is_plain = |side: &Side| side.radiates && !mesh.is_patterned_light(side);
        let emitters = EmittingTriangles::of_sides(mesh, is_plain);
        let samples = !emitters.is_empty() && emitters.area() <= SAMPLED * mesh.scene.area();
        let is_sampled = mesh.sides().iter().map(|side| samples && is_plain(side)).collect();
        Lights { sampled: samples.then_some(emitters), is_sampled }
    }

    /// M in W·m⁻² of a patch, without what is sampled.
    pub(crate) fn unsampled(&self, mesh: &PatchMesh, patch: PatchId) -> Rgb {
        let members = mesh.members(patch);
        let first = mesh.side_number(patch);
        let is_sampled = |k: usize| self.is_sampled[first + k];
        let left = (0..members.len()).filter(|&k| !is_sampled(k)).map(|k| members[k].patch_area);
        let whole: f64 = members.iter().map(|side| side.patch_area).sum();
        mesh.exitance(patch) * (left.sum::<f64>() / whole) as f32
    }
}
