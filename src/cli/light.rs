//! From a scene and the options of light to its solution.

use super::arguments::{LightArguments, PointsName, RunArguments};
use super::progress::Bars;
use super::report::Seconds;
use crate::bvh::{Effort, Tracer};
use crate::coverage;
use crate::error::{Error, Result};
use crate::geometry::KernelKind;
use crate::memory;
use crate::patches::{PatchMesh, Subdivision};
use crate::radiosity::{self, Method, Settings, Solver};
use crate::sampling::PointSet;
use crate::scene::description::PatchDefaults;
use crate::scene::{Camera, Description, Scene};
use crate::solution::Solution;
use crate::solver::MatrixMethod;
use std::path::PathBuf;
use std::time::Instant;

/// Patches that the subdivision aims at unless something else is asked for: good and quick for a first
/// picture.
pub(super) const DEFAULT_PATCHES: usize = 40_000;

/// What is to be solved, and how.
pub(super) struct Plan {
    file: PathBuf,
    mesh: PatchMesh,
    settings: Settings,
    kernel: KernelKind,
}

impl Plan {
    /// Flags come before the description, and the description before the defaults.
    pub fn new(
        light: &LightArguments,
        run: &RunArguments,
        description: &Description,
        scene: &Scene,
    ) -> Result<Plan> {
        let mesh = PatchMesh::subdivide(scene, subdivision(light, description))?;
        let settings = settings(light, run.seed, &mesh)?;
        let file = description.file.clone();
        Ok(Plan { file, mesh, settings, kernel: run.kernel.into() })
    }

    /// A hierarchy that is built as thoroughly as the light's rays and `more` of them are worth.
    pub fn caster(&self, more: u64) -> Tracer {
        let rays = self.settings.expected_rays(&self.mesh).saturating_add(more);
        let triangles = self.mesh.scene.triangles.clone();
        let effort = Effort::for_rays(triangles.len(), rays);
        Tracer::build_with(triangles, effort, self.kernel)
    }

    /// The solution, and the rays that it took. `times` gets the seconds of each step.
    pub fn solve(
        &self,
        description: &Description,
        caster: &Tracer,
        times: &mut Seconds,
        start: Instant,
    ) -> Result<(Solution, u64)> {
        let camera = match &description.camera {
            Some(camera) => camera.clone(),
            None => Camera::fitted(&self.mesh.scene.triangles, caster),
        };
        times.build = start.elapsed().as_secs_f64() - times.load;
        let light = radiosity::solve(caster, &self.mesh, &self.settings, &Bars::new())
            .map_err(|error| error.in_file_if_none(&self.file))?;
        times.transport = light.transport_time.as_secs_f64();
        times.solve = light.solve_time.as_secs_f64();
        let covering = Instant::now();
        let (uncovered, cover_rays) = coverage::uncovered(caster, &self.mesh);
        times.render += covering.elapsed().as_secs_f64();
        let rays = light.rays + cover_rays;
        let (title, image) = (description.title.clone(), description.image.clone());
        let light = (light, uncovered);
        Ok((Solution::new(title, &self.mesh, light, camera, image), rays))
    }
}

fn subdivision(light: &LightArguments, description: &Description) -> Subdivision {
    match (light.levels, light.max_edge) {
        (Some(levels), _) => Subdivision::Levels(levels),
        (None, Some(length)) => Subdivision::MaxEdge(length),
        (None, None) => {
            described(&description.patches).unwrap_or(Subdivision::Count(DEFAULT_PATCHES))
        }
    }
}

/// The description's wish, if it has one.
pub(super) fn described(patches: &PatchDefaults) -> Option<Subdivision> {
    let levels = patches.levels.map(Subdivision::Levels);
    levels.or(patches.max_edge.map(|length| Subdivision::MaxEdge(length as f64)))
}

fn settings(light: &LightArguments, seed: u64, mesh: &PatchMesh) -> Result<Settings> {
    let method = light.form_factors.map_or(Method::Hemisphere, Method::from);
    let samples = light.samples.unwrap_or(match method {
        Method::Pairs => 9,
        Method::Hemisphere => 256,
    });
    if light.points == Some(PointsName::Regular) && samples.isqrt().pow(2) != samples {
        return Err(Error::new(format!("{samples} regular points"))
            .remedy("a triangle splits regularly into 1, 4, 9, 16, … parts: give a square"));
    }
    let sampled = method == Method::Hemisphere && radiosity::has_small_emitters(mesh);
    let limit = match light.memory {
        Some(mebibytes) => Some(mebibytes.saturating_mul(1 << 20)),
        None => memory::available().map(|bytes| bytes / 5 * 4),
    };
    Ok(Settings {
        method,
        samples,
        points: light.points.map_or(PointSet::Sobol, PointSet::from),
        direct_samples: light.direct.unwrap_or(if sampled { 64 } else { 0 }),
        solver: light.solver.map_or(Solver::Matrix(MatrixMethod::GaussSeidel), Solver::from),
        stop: light.stop(),
        seed,
        memory_limit: limit,
    })
}
