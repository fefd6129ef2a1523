//! How far a solution is from the truth, at most.
//!
//! Let B_h be a solution, a function on the surfaces, and B = E + ρKB the truth. The residual
//! r = E + ρK B_h − B_h is all that B_h fails to satisfy: by its patches, its iteration and its samples. Where no
//! reflectance is above ρ_max < 1, ρK shrinks every function to ρ_max of it, in the mean square too, as K is
//! symmetric; so B_h − B, which is r + ρKr + …, obeys
//!
//! ```text
//! ‖B_h − B‖ ≤ ‖r‖ / (1 − ρ_max).
//! ```
//!
//! ‖r‖ is estimated at random points. At each, two gathers g that are independent of each other and of the
//! solution give (g₁ − H_h)(g₂ − H_h), whose mean over all gathers is (KB_h − H_h)² without the gathers' own noise.

use crate::color::{Rgb, Rgb64};
use crate::geometry::RayCaster;
use crate::patches::{PatchId, PatchMesh, RandomPoints};
use crate::paths::{Lights, Paths, Solved, Start};
use crate::progress::{Progress, Stage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::atomic::AtomicU64;

/// What is known of a solution's error, in the channel in which it is worst, relative to the root mean square of the
/// reflected radiosity. Materials count as the patches' means, and patches that are partly covered are left out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// ‖r‖, up to which it lies in 95 % of cases.
    pub residual: f64,
    /// ‖B_h − B‖ is at most this in these cases; `None` where a reflectance is 1.
    pub bound: Option<f64>,
}

/// Points, in batches, and the paths of each of two gathers at a point.
const BATCHES: u32 = 256;
const BATCH: u32 = 64;
const PATHS: u32 = 8;

/// Standard normal: 95 % are below.
const ONE_SIDED: f64 = 1.645;

impl Certificate {
    /// Certifies light by its irradiance in W·m⁻² and the uncovered share of the area, per patch. Returns also the
    /// rays that it took. `None` without reflected light. `seed` should not be that of the solution.
    pub(crate) fn of(
        caster: &dyn RayCaster,
        mesh: &PatchMesh,
        irradiance: &[Rgb],
        uncovered: &[f32],
        seed: u64,
        progress: &dyn Progress,
    ) -> (Option<Certificate>, u64) {
        let whole = |patch: PatchId| uncovered[patch.index()] >= 1.0;
        let patches = || (0..mesh.len() as u32).map(PatchId).filter(|patch| whole(*patch));
        let points = RandomPoints::of(mesh, patches(), seed);
        let area: f64 = patches().map(|patch| mesh.area(patch)).sum();
        let reflectance = (0..mesh.len() as u32)
            .map(|patch| mesh.reflectance(PatchId(patch)).as_dvec3())
            .fold(Rgb64::ZERO, Rgb64::max);
        let reflected = patches()
            .map(|patch| {
                let light = mesh.reflectance(patch) * irradiance[patch.index()];
                light.as_dvec3().powf(2.0) * mesh.area(patch)
            })
            .sum::<Rgb64>()
            / area;
        if points.is_empty() || reflected.max_element() <= 0.0 {
            return (None, 0);
        }
        let lights = Lights::of(mesh);
        let known = Solved::everywhere(mesh, &lights, irradiance, uncovered);
        let known = Some(&known);
        let rays = AtomicU64::new(0);
        let paths = Paths { caster, mesh, lights: &lights, known, seed, rays };
        let of_batch = |batch: u32| {
            progress.advance(1);
            let numbers = batch * BATCH..(batch + 1) * BATCH;
            residuals(&paths, &points, numbers, irradiance)
        };
        // Paths have four rays or less, for the most part.
        let most = 4 * 2 * PATHS * BATCH;
        let batches = (mesh.scene.affordable(1, BATCHES * most) / most).max(2);
        progress.begin(Stage::Certificate, Some(batches.into()));
        let squares: Vec<Rgb64> = (0..batches).into_par_iter().flat_map_iter(of_batch).collect();
        progress.end();
        let count = squares.len() as f64;
        let mean = squares.iter().sum::<Rgb64>() / count;
        let variance = squares.iter().map(|x| (x - mean).powf(2.0)).sum::<Rgb64>() / (count - 1.0);
        let most = (mean + (variance / count).powf(0.5) * ONE_SIDED).max(Rgb64::ZERO);
        let channels = || (0..3).filter(|&c| reflected[c] > 0.0);
        let residual = |c: usize| (most[c] / reflected[c]).sqrt();
        let bound = |c: usize| residual(c) / (1.0 - reflectance[c]);
        let certificate = Certificate {
            residual: channels().map(residual).fold(0.0, f64::max),
            bound: (reflectance.max_element() < 1.0)
                .then(|| channels().map(bound).fold(0.0, f64::max)),
        };
        (Some(certificate), paths.rays.into_inner())
    }
}

/// ρ² (g₁ − H_h)(g₂ − H_h) at each of the points with these numbers.
fn residuals(
    paths: &Paths,
    points: &RandomPoints,
    numbers: std::ops::Range<u32>,
    irradiance: &[Rgb],
) -> Vec<Rgb64> {
    let points: Vec<_> = numbers.clone().map(|number| points.point(number)).collect();
    let mut starts = Vec::new();
    for (number, (_, side, point)) in numbers.zip(&points) {
        for gather in 0..2 {
            let stream = 2 * number as u64 + gather;
            starts.extend((0..PATHS).map(|path| Start::new(*point, side.normal, stream, path)));
        }
    }
    let mut light = vec![Rgb::ZERO; starts.len()];
    paths.add_irradiance(&starts, &mut light);
    let gather = |of: &[Rgb]| of.iter().map(|h| h.as_dvec3()).sum::<Rgb64>() / PATHS as f64;
    let of_point = |((patch, ..), light): (&(PatchId, _, _), &[Rgb])| {
        let (first, second) = light.split_at(PATHS as usize);
        let held = irradiance[patch.index()].as_dvec3();
        let reflectance = paths.mesh.reflectance(*patch).as_dvec3();
        reflectance * reflectance * (gather(first) - held) * (gather(second) - held)
    };
    points.iter().zip(light.chunks(2 * PATHS as usize)).map(of_point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Tracer;
    use crate::patches::Subdivision;
    use crate::radiosity::{self, Choices};
    use crate::scene::{Document, Scene};
    use crate::settings::Settings;

    fn scene(name: &str) -> Scene {
        let file = format!("{}/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let mut document = Document::open(file).expect("a shipped scene");
        // The outside of a closed room is dark.
        document.one_sided = true;
        document.scene().expect("a shipped scene")
    }

    /// The true ‖B_h − B‖ in the worst channel, relative to ‖ρH_h‖, by paths that owe nothing to the solution.
    fn true_error(caster: &Tracer, mesh: &PatchMesh, irradiance: &[Rgb]) -> f64 {
        let lights = Lights::of(mesh);
        let rays = AtomicU64::new(0);
        let paths = Paths { caster, mesh, lights: &lights, known: None, seed: 99, rays };
        let all = || (0..mesh.len() as u32).map(PatchId);
        let points = RandomPoints::of(mesh, all(), 99);
        let squares = (0..1024u32).into_par_iter().flat_map_iter(|batch| {
            residuals(&paths, &points, batch * BATCH..(batch + 1) * BATCH, irradiance)
        });
        let squares: Vec<Rgb64> = squares.collect();
        let reflected = all().map(|patch| {
            let light = mesh.reflectance(patch) * irradiance[patch.index()];
            light.as_dvec3().powf(2.0) * mesh.area(patch)
        });
        let area: f64 = all().map(|patch| mesh.area(patch)).sum();
        let share = squares.iter().sum::<Rgb64>()
            / squares.len() as f64
            / (reflected.sum::<Rgb64>() / area);
        share.max_element().max(0.0).sqrt()
    }

    #[test]
    fn of_light_that_is_too_bright_by_a_tenth_the_residual_and_the_bound_are_closed_forms() {
        let scene = scene("furnace");
        let tracer = Tracer::build(&scene);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(2)).expect("patches");
        // E = π and ρ = 1/2 everywhere: H = 2π. With H_h = 1.1 H, KB_h − H_h = H (1.05 − 1.1).
        let held = vec![Rgb::splat(1.1 * 2.0 * std::f32::consts::PI); mesh.len()];
        let whole = vec![1.0; mesh.len()];
        let (certificate, _) = Certificate::of(&tracer, &mesh, &held, &whole, 5, &());
        let Certificate { residual, bound } = certificate.expect("there is light");
        assert!((residual - 0.05 / 1.1).abs() < 1e-4, "{residual}");
        assert!((bound.expect("ρ is below 1") - 0.1 / 1.1).abs() < 2e-4, "{bound:?}");
    }

    #[test]
    fn a_bound_is_above_the_true_error_and_below_ten_times_it() {
        for (name, levels) in [("cornell-box", 3), ("course-room", 2)] {
            let scene = scene(name);
            let tracer = Tracer::build(&scene);
            let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(levels)).expect("patches");
            let (mut above, mut ratios) = (0, Vec::new());
            for seed in 1..=20 {
                let settings = Settings { seed, ..Settings::default() };
                let choices = Choices::new(&settings, &scene).expect("the defaults");
                let light = radiosity::solve(&tracer, &mesh, &choices, &()).expect("light");
                let irradiance = crate::color::rounded(&light.irradiance);
                let whole = vec![1.0; mesh.len()];
                let of = Certificate::of(&tracer, &mesh, &irradiance, &whole, seed + 1000, &());
                let bound = of.0.and_then(|of| of.bound).expect("a bound");
                let error = true_error(&tracer, &mesh, &irradiance);
                above += (bound >= error) as u32;
                ratios.push(bound / error);
            }
            ratios.sort_by(f64::total_cmp);
            println!("{name}: bound / error {:.2} to {:.2}", ratios[0], ratios[19]);
            assert!(above >= 19, "{name}: {ratios:?}");
            assert!(ratios[10] < 10.0, "{name}: {ratios:?}");
        }
    }
}
