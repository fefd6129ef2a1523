//! From a scene and the options of light to its solution.

use super::arguments::{LightArguments, RunArguments};
use super::progress::Bars;
use super::report::Seconds;
use crate::bvh::{Effort, Tracer};
use crate::coverage;
use crate::error::Result;
use crate::geometry::KernelKind;
use crate::patches::{PatchMesh, Subdivision};
use crate::radiosity::{self, Choices};
use crate::scene::{Document, Scene};
use crate::solution::Solution;
use std::path::PathBuf;
use std::time::Instant;

/// A scene's patches, and how their light is to be solved.
pub(super) struct Plan {
    file: PathBuf,
    mesh: PatchMesh,
    choices: Choices,
    kernel: KernelKind,
}

impl Plan {
    /// Flags come before the description, and the description before the defaults.
    pub(super) fn new(
        light: &LightArguments,
        run: &RunArguments,
        document: &Document,
        scene: &Scene,
    ) -> Result<Plan> {
        let settings = light.settings(document, run.seed);
        let mesh = PatchMesh::subdivide(scene, Subdivision::of(&settings.patches))?;
        let choices = Choices::new(&settings, &mesh)?;
        Ok(Plan { file: document.file.clone(), mesh, choices, kernel: run.kernel })
    }

    /// A hierarchy that is built as thoroughly as the light's rays and `more` of them are worth.
    pub(super) fn caster(&self, more: u64) -> Tracer {
        let rays = self.choices.expected_rays(&self.mesh).saturating_add(more);
        let scene = &self.mesh.scene;
        let effort = Effort::for_rays(scene.triangles.len(), rays);
        Tracer::build_with(scene, effort, self.kernel)
    }

    /// The solution, and the rays that it took. `times` gets the seconds of each step.
    pub(super) fn solve(
        &self,
        document: &Document,
        caster: &Tracer,
        times: &mut Seconds,
        start: Instant,
    ) -> Result<(Solution, u64)> {
        let camera = document.view(&self.mesh.scene, caster);
        times.build = start.elapsed().as_secs_f64() - times.load;
        let light = radiosity::solve(caster, &self.mesh, &self.choices, &Bars::new())
            .map_err(|error| error.in_file_if_none(&self.file))?;
        times.transport = light.transport_time.as_secs_f64();
        times.solve = light.solve_time.as_secs_f64();
        let covering = Instant::now();
        let (uncovered, cover_rays) = coverage::uncovered(caster, &self.mesh);
        times.render += covering.elapsed().as_secs_f64();
        let rays = light.rays + cover_rays;
        Ok((Solution::new(document, &self.mesh, (light, uncovered), camera), rays))
    }
}
