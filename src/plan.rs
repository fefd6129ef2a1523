//! From a scene and its settings to its solution.

use crate::begun::{Begun, Keep, Unfinished};
use crate::color::rounded;
use crate::coverage;
use crate::error::{Error, Result};
use crate::export::sealed::fingerprint;
use crate::geometry::{KernelKind, RayCaster};
use crate::lit_sides::lit_sides;
use crate::patches::{PatchMesh, Split, Subdivision};
use crate::progress::Progress;
use crate::radiosity::{self, Choices, Method, Solver};
use crate::sampling::PointSet;
use crate::scene::{Document, Scene};
use crate::settings::{PATCHES, Settings};
use crate::solution::{Figures, PatchLight, Solution};
use crate::two_level::{Elements, LocalPass, Part, Share, put_together};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How finely a scene is split and every choice of method, made before the first ray is cast.
pub struct Plan<'d> {
    document: &'d Document,
    scene: Scene,
    split: Split,
    choices: Choices,
    kernel: KernelKind,
}

/// The rays and the time that a solution took.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spent {
    /// Rays for the light and for the search for covered patches.
    pub rays: u64,
    /// Estimating form factors and direct light.
    pub transport: Duration,
    /// Solving the equation.
    pub solve: Duration,
    /// Finding what is covered, and a camera.
    pub coverage: Duration,
}

impl<'d> Plan<'d> {
    /// The document fills in what the settings leave open, and the defaults what both leave open.
    ///
    /// # Errors
    /// Settings out of their ranges, or more patches than can be numbered.
    pub fn new(document: &'d Document, scene: &Scene, settings: &Settings) -> Result<Plan<'d>> {
        let mut settings = Settings {
            patches: settings.patches.or(&document.patches),
            light: settings.light.or(&document.light),
            seed: settings.seed,
        };
        let of_document = |error: Error| error.in_file_if_none(&document.file);
        let subdivision = match Subdivision::of(&settings.patches) {
            Subdivision::Count(most) => Subdivision::Count(affordable_patches(scene, most)),
            asked => asked,
        };
        let mut split = subdivision.split(scene).map_err(of_document)?;
        if settings.light.suit_two_levels(split.patches()) {
            settings.light.solver = Some(Solver::TwoLevel);
        }
        let mut choices = Choices::new(&settings, scene).map_err(of_document)?;
        let affordable = |usual| scene.affordable(split.patches() as usize, usual);
        if settings.light.samples.is_none()
            && choices.method == Method::Hemisphere
            && choices.points != PointSet::Regular
        {
            choices.samples = affordable(choices.samples);
        }
        if settings.light.direct.is_none() {
            choices.direct_samples = choices.direct_samples.min(affordable(choices.direct_samples));
        }
        if choices.method == Method::Pairs {
            // A pair of clusters has no solid angle.
            split.cube = None;
        }
        let kernel = KernelKind::default();
        Ok(Plan { document, scene: scene.clone(), split, choices, kernel })
    }

    /// The same, to be solved by casters with another kernel than the usual one. They are not built here: what is kept
    /// of a solve says so, and is not gone on with by another kernel or joined with its parts.
    pub fn with_kernel(self, kernel: KernelKind) -> Plan<'d> {
        Plan { kernel, ..self }
    }

    /// Rays that the light takes, about: how thoroughly a hierarchy should be built.
    pub fn rays(&self) -> u64 {
        self.choices.expected_rays(self.split.patches())
    }

    /// The patches of the sides that light can reach.
    ///
    /// # Errors
    /// More patches than can be numbered.
    pub fn patches(&self, caster: &dyn RayCaster) -> Result<PatchMesh> {
        let sides = lit_sides(&self.scene, caster, self.choices.seed);
        PatchMesh::new(&self.scene, &self.split, &sides)
            .map_err(|error| error.in_file_if_none(&self.document.file))
    }

    /// A number to tell plans apart, of all that the light's bits depend on.
    pub fn fingerprint(&self) -> u32 {
        let version = env!("CARGO_PKG_VERSION");
        fingerprint(&(version, &self.scene, &self.split, &self.choices, self.kernel))
    }

    /// Whether the light is solved in two levels, and so can be solved in parts.
    pub fn is_in_two_levels(&self) -> bool {
        self.choices.solver == Solver::TwoLevel
    }

    /// Solves the light. `caster` must know the scene's triangles.
    ///
    /// # Errors
    /// See [`radiosity::solve`].
    pub fn solve(
        &self,
        caster: &dyn RayCaster,
        progress: &dyn Progress,
    ) -> Result<(Solution, Spent)> {
        if !self.is_in_two_levels() {
            return self.solve_together(caster, None, None, progress);
        }
        let keep = &mut |_: &Part| Ok(());
        let (part, mut spent) = self.solve_part(caster, Share::WHOLE, None, keep, progress)?;
        let mut solution = put_together(vec![part]);
        spent.rays += solution.certify(caster, progress);
        Ok((solution, spent))
    }

    /// Solves the light of all patches together. `begun` is what was done of it before. `keep` may store what is done, now
    /// and then, and before `progress` stops it.
    ///
    /// # Errors
    /// Light that is solved in two levels; a contradictory `begun`; what `keep` says; and see [`radiosity::solve`].
    pub fn solve_together(
        &self,
        caster: &dyn RayCaster,
        begun: Option<Begun>,
        mut keep: Option<&mut Keep>,
        progress: &dyn Progress,
    ) -> Result<(Solution, Spent)> {
        let mut keep_if = |unfinished: Unfinished| match &mut keep {
            Some(keep) => keep(unfinished),
            None => Ok(()),
        };
        let mesh = Arc::new(self.patches(caster)?);
        let contradiction = begun.as_ref().map(Begun::contradiction);
        let mut begun = begun.unwrap_or_default();
        let light =
            radiosity::go_on(caster, &mesh, &self.choices, &mut begun, &mut keep_if, progress)
                .map_err(|error| error.in_file_if_none(&self.document.file))?;
        // What nobody keeps need not stay.
        let begun = keep.is_some().then_some(begun);
        let start = Instant::now();
        let (uncovered, cover_rays) = coverage::uncovered(caster, &mesh, progress);
        let irradiance = rounded(&light.irradiance);
        let camera = self.document.view(&self.scene, &mesh.sides_of_triangles(), caster);
        let figures = Figures::of(&light);
        let mut spent = Spent {
            rays: light.rays + cover_rays,
            transport: light.transport_time,
            solve: light.solve_time,
            ..Spent::default()
        };
        let light = PatchLight { irradiance, error: light.error, uncovered };
        let mut solution =
            Solution::new(self.document, &mesh, &self.choices, (light, figures), camera);
        if let Some(contradiction) = contradiction
            && solution.check().is_err()
        {
            return Err(contradiction);
        }
        if !progress.is_stopped() {
            spent.rays += solution.certify(caster, progress);
        }
        spent.coverage = start.elapsed();
        if progress.is_stopped() {
            if let (Some(keep), Some(begun)) = (keep, begun) {
                keep(begun.unfinished())?;
            }
            return Err(Error::stopped());
        }
        Ok((solution, spent))
    }

    /// Solves the light of a share of the patches, in two levels; [`join`](crate::two_level::join) puts all parts
    /// together. `begun` is what was done of it before. `keep` may store what is done, now and then.
    ///
    /// # Errors
    /// Light that is not solved in two levels; `begun` of something else; and see [`radiosity::solve`].
    pub fn solve_part(
        &self,
        caster: &dyn RayCaster,
        share: Share,
        begun: Option<Part>,
        keep: &mut dyn FnMut(&Part) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<(Part, Spent)> {
        if !self.is_in_two_levels() {
            return Err(Error::new("only light that is solved in two levels has parts"));
        }
        let mesh = Arc::new(self.patches(caster)?);
        let sides = mesh.sides_of_triangles();
        let split = Subdivision::Count(PATCHES).split(&self.scene)?;
        let elements = PatchMesh::new(&self.scene, &split, &sides)?;
        let elements = Elements::solve(caster, elements, &self.choices, progress)
            .map_err(|error| error.in_file_if_none(&self.document.file))?;
        let start = Instant::now();
        let camera = self.document.view(&self.scene, &sides, caster);
        let mut figures = Figures::of(&elements.light);
        // That of the elements: the patches are sampled as well.
        figures.misfit.samples = None;
        let unlit = Solution::unlit(self.document, &mesh, &self.choices, figures, camera);
        let mut part = Part::new(share, mesh.len(), unlit, self.kernel);
        begun.map_or(Ok(()), |begun| part.take_up(begun))?;
        part.check_memory()?;
        let pass = LocalPass::new(caster, &mesh, &elements, &self.choices);
        let cover_rays = pass.finish(&mut part, keep, progress)?;
        let spent = Spent {
            rays: elements.light.rays + elements.cover_rays + part.rays() + cover_rays,
            transport: elements.light.transport_time + start.elapsed(),
            solve: elements.light.solve_time,
            coverage: Duration::ZERO,
        };
        Ok((part, spent))
    }
}

/// Fewer patches than usual in a crowded scene, so that each of them has some rays.
fn affordable_patches(scene: &Scene, usual: usize) -> usize {
    const RAYS: u32 = 64;
    const FEWEST: usize = 200;
    let rays = scene.affordable(1, RAYS * usual as u32);
    ((rays / RAYS) as usize).clamp(FEWEST, usual)
}

impl Solution {
    /// Plans and solves at once.
    ///
    /// # Errors
    /// See [`Plan::new`] and [`Plan::solve`].
    pub fn solve(
        document: &Document,
        scene: &Scene,
        caster: &dyn RayCaster,
        settings: &Settings,
        progress: &dyn Progress,
    ) -> Result<Solution> {
        let (solution, _) = Plan::new(document, scene, settings)?.solve(caster, progress)?;
        Ok(solution)
    }
}
