//! What a solution knows, for paths that end there.

use super::lights::Lights;
use crate::color::{Rgb, luminance};
use crate::light::EmittingTriangles;
use crate::patches::{PatchId, PatchMesh};

/// The radiosity of a solution.
pub(crate) struct Solved {
    pub(super) patches: Vec<Known>,
    /// Few and bright patches, such as a ceiling above an uplight: from afar they light like lamps, are found like
    /// lamps, and are black to paths that meet them.
    pub(super) bright: EmittingTriangles,
    /// Whether these bring so much of the light that it is worth while to choose well among them.
    pub(super) are_main_light: bool,
}

/// What a solution knows of a patch.
#[derive(Clone, Copy)]
pub(super) struct Known {
    /// B in W·m⁻², without what the lights sample.
    pub(super) radiosity: Rgb,
    /// The square of the distance from which B stands for every point of the patch.
    pub(super) far: f32,
}

/// How many times as bright as the mean a patch must be to be sampled as a lamp is.
const BRIGHT: f64 = 5.0;
/// The share of all reflected light from which bright patches are the main light.
const MAIN_LIGHT: f64 = 0.1;

impl Solved {
    /// What is known from the irradiance in W·m⁻² and the uncovered share of its area, per patch.
    pub(crate) fn of(
        mesh: &PatchMesh,
        lights: &Lights,
        irradiance: &[Rgb],
        uncovered: &[f32],
    ) -> Solved {
        let radiosity: Vec<Rgb> = radiosity(mesh, lights, irradiance, uncovered).collect();
        Solved::new(mesh, &radiosity)
    }

    /// As [`of`](Self::of), to end every path at the first patch that it meets, from however near.
    pub(crate) fn everywhere(
        mesh: &PatchMesh,
        lights: &Lights,
        irradiance: &[Rgb],
        uncovered: &[f32],
    ) -> Solved {
        let known = |radiosity| Known { radiosity, far: 0.0 };
        let bright = EmittingTriangles::of_bright(mesh, &[]);
        let patches = radiosity(mesh, lights, irradiance, uncovered).map(known).collect();
        Solved { patches, bright, are_main_light: false }
    }

    /// `radiosity`: B in W·m⁻² without what the lights sample, per patch.
    pub(crate) fn new(mesh: &PatchMesh, radiosity: &[Rgb]) -> Solved {
        let patches = || (0..mesh.len() as u32).map(PatchId);
        let area: f64 = patches().map(|patch| mesh.area(patch)).sum();
        let power = |patch: PatchId| luminance(radiosity[patch.index()]) as f64 * mesh.area(patch);
        let mean = patches().map(power).sum::<f64>() / area;
        let is_bright =
            |patch: &PatchId| luminance(radiosity[patch.index()]) as f64 > BRIGHT * mean;
        let far = |patch: PatchId| NEAR * NEAR * mesh.extent_squared(patch);
        let as_lamp = |patch: PatchId| (patch, radiosity[patch.index()], far(patch));
        let bright: Vec<(PatchId, Rgb, f32)> = patches().filter(is_bright).map(as_lamp).collect();
        let of_bright: f64 = bright.iter().map(|(patch, ..)| power(*patch)).sum();
        let known = |patch: PatchId| {
            let is_lamp = is_bright(&patch);
            let radiosity = if is_lamp { Rgb::ZERO } else { radiosity[patch.index()] };
            Known { radiosity, far: far(patch) }
        };
        Solved {
            patches: patches().map(known).collect(),
            bright: EmittingTriangles::of_bright(mesh, &bright),
            are_main_light: of_bright > MAIN_LIGHT * mean * area,
        }
    }
}

/// B in W·m⁻² without what the lights sample, per patch.
fn radiosity(
    mesh: &PatchMesh,
    lights: &Lights,
    irradiance: &[Rgb],
    uncovered: &[f32],
) -> impl Iterator<Item = Rgb> {
    let of_patch = move |(i, (irradiance, &share)): (usize, (&Rgb, &f32))| {
        let patch = PatchId(i as u32);
        // What arrives on a patch arrives on its uncovered part, and no ray meets the other.
        let share = if share > 0.0 { share } else { 1.0 };
        let reflected = mesh.reflectance(patch) * (*irradiance / share);
        reflected + lights.unsampled(mesh, patch)
    };
    irradiance.iter().zip(uncovered).enumerate().map(of_patch)
}

/// From nearer than this many times the extent of a patch, its mean radiosity does not stand for the
/// point that was met, and the path goes on.
const NEAR: f32 = 2.0;
