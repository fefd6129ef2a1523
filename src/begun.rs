//! What is done of a solution whose patches are solved together, and the file that keeps it.

use crate::direct::DirectLight;
use crate::error::{Error, Result};
use crate::export::sealed::Seal;
use crate::form_factor::{Estimator, Matrix};
use crate::memory;
use crate::solver::{Shots, Sweeps};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const SEAL: Seal = Seal {
    magic: b"isolux begun\n",
    version: 1,
    name: "file of an unfinished solve",
    command: "isolux solve SCENE -o ROOM.light",
};

/// What is done of a solution: each step needs those before it.
#[derive(Default, Deserialize)]
pub struct Begun {
    pub(crate) direct: Option<DirectLight>,
    /// Rays that were traced for the form factors.
    pub(crate) rays: u64,
    pub(crate) matrix: Option<Matrix>,
    pub(crate) sweeps: Option<Sweeps>,
    pub(crate) shots: Option<Shots>,
    /// What it was read from.
    #[serde(skip)]
    source: Option<Source>,
}

/// A file that a solve is gone on with from.
struct Source {
    path: PathBuf,
    /// See [`Plan::fingerprints`](crate::plan::Plan::fingerprints).
    plan: [u32; 2],
}

/// What is done of a solution, lent to be kept: field by field what a [`Begun`] is read from.
#[derive(Clone, Copy, Default, Serialize)]
pub struct Unfinished<'a> {
    pub(crate) direct: Option<&'a DirectLight>,
    pub(crate) rays: u64,
    pub(crate) matrix: Option<&'a Matrix>,
    pub(crate) sweeps: Option<&'a Sweeps>,
    pub(crate) shots: Option<&'a Shots>,
}

impl Unfinished<'_> {
    /// The bytes of a file. `plan`: the plan's [fingerprints](crate::plan::Plan::fingerprints).
    ///
    /// # Errors
    /// Too little memory is left for them.
    pub fn to_bytes(&self, plan: [u32; 2]) -> Result<Vec<u8>> {
        // The bytes take as much as the matrix about, and twice that while they are collected.
        let bytes = 2 * self.matrix.map_or(0, Matrix::bytes);
        memory::check("a copy of what is done", bytes, memory::available(), "")?;
        Ok(SEAL.close(&(plan, self)))
    }
}

impl Begun {
    pub(crate) fn unfinished(&self) -> Unfinished<'_> {
        let Begun { direct, rays, matrix, sweeps, shots, source: _ } = self;
        Unfinished {
            direct: direct.as_ref(),
            rays: *rays,
            matrix: matrix.as_ref(),
            sweeps: sweeps.as_ref(),
            shots: shots.as_ref(),
        }
    }

    /// Reads a file of what [`Unfinished::to_bytes`] made.
    ///
    /// # Errors
    /// Something else, of another version, or damaged; or a file that cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<Begun> {
        let path = path.as_ref();
        let opened = SEAL.open(&SEAL.read(path)?);
        let (plan, begun): (_, Begun) = opened.map_err(|error| error.in_file(path))?;
        Ok(Begun { source: Some(Source { path: path.to_path_buf(), plan }), ..begun })
    }

    /// Whether it was read from a file that was kept of this plan.
    ///
    /// # Errors
    /// Another plan, of another scene or with other choices.
    pub(crate) fn check_plan(&self, plan: impl FnOnce() -> [u32; 2]) -> Result<()> {
        match &self.source {
            Some(source) if source.plan != plan() => Err(Error::new(
                "this was begun with another scene or other flags",
            )
            .in_file(&source.path)
            .remedy("use the flags with which it was begun, or leave out --resume to begin anew")),
            _ => Ok(()),
        }
    }

    /// A checksum finds damage, not a forger.
    ///
    /// # Errors
    /// What no run can have kept.
    pub(crate) fn check(&self, of: &Estimator) -> Result<()> {
        let patches = of.mesh.len();
        let is_possible = self.direct.as_ref().is_none_or(|direct| direct.is_possible(patches))
            && self.matrix.as_ref().is_none_or(|matrix| matrix.is_possible(of))
            && self.sweeps.as_ref().is_none_or(|sweeps| sweeps.are_possible(patches))
            && self.shots.as_ref().is_none_or(|shots| shots.are_possible(patches));
        if is_possible { Ok(()) } else { Err(self.contradiction()) }
    }

    /// What was kept leads to nothing.
    pub(crate) fn contradiction(&self) -> Error {
        match &self.source {
            Some(source) => SEAL.contradiction().in_file(&source.path),
            None => SEAL.contradiction(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Tracer;
    use crate::error::ErrorKind;
    use crate::export::sealed::forge;
    use crate::plan::Plan;
    use crate::progress::{Progress, Stage};
    use crate::scene::{Document, Scene};
    use crate::settings::{Method, Settings, Solver};
    use crate::solution::Solution;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

    /// Stops a run that has its direct light when it is asked so many times whether it does.
    #[derive(Default)]
    struct StopAt {
        left: AtomicU32,
        counts: AtomicBool,
    }

    impl Progress for StopAt {
        fn begin(&self, stage: Stage, _: Option<u64>) {
            self.counts.store(stage != Stage::DirectLight, Ordering::Relaxed);
        }

        fn advance(&self, _: u64) {}

        fn end(&self) {}

        fn is_stopped(&self) -> bool {
            let less = |left: u32| Some(left.saturating_sub(1));
            self.counts.load(Ordering::Relaxed)
                && self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less) == Ok(0)
        }
    }

    fn room() -> (Document, Scene) {
        let file = format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR"));
        let document = Document::open(file).expect("a shipped scene");
        let scene = document.scene().expect("a shipped scene");
        (document, scene)
    }

    /// All ways to solve patches together.
    fn ways() -> Vec<Settings> {
        let mut ways = Vec::new();
        for (method, samples) in [(Method::Hemisphere, 64), (Method::Pairs, 4)] {
            for solver in [Solver::GaussSeidel, Solver::Jacobi, Solver::Southwell] {
                for iterations in [None, Some(if solver == Solver::Southwell { 300 } else { 3 })] {
                    let mut settings = Settings::default();
                    settings.patches.levels = Some(1);
                    settings.light.form_factors = Some(method);
                    settings.light.samples = Some(samples);
                    settings.light.solver = Some(solver);
                    settings.light.iterations = iterations;
                    ways.push(settings);
                }
            }
        }
        ways
    }

    /// A run, and what it kept: the last is what it kept before it stopped.
    fn solve(
        plan: &Plan,
        tracer: &Tracer,
        begun: Option<&[u8]>,
        progress: &dyn Progress,
    ) -> (Result<Solution>, Vec<Vec<u8>>) {
        let mut kept = Vec::new();
        let begun = begun.map(|bytes| postcard::from_bytes(bytes).expect("what was kept"));
        let keep = &mut |unfinished: Unfinished| {
            kept.push(postcard::to_stdvec(&unfinished).expect("numbers and lists"));
            Ok(())
        };
        let solved = plan.solve_together(tracer, begun, keep, progress);
        (solved.map(|(solution, _)| solution), kept)
    }

    #[test]
    fn from_wherever_a_solve_is_gone_on_with_it_comes_to_the_same_bits() {
        let (document, scene) = room();
        let tracer = Tracer::build(&scene);
        for settings in ways() {
            let plan = Plan::new(&document, &scene, &settings).expect("a plan");
            let (whole, kept) = solve(&plan, &tracer, None, &());
            let whole = whole.expect("light").to_bytes();
            assert!(kept.len() >= 2, "{settings:?}");
            for kept in kept.iter().step_by(kept.len().div_ceil(5)).chain(kept.last()) {
                let (again, _) = solve(&plan, &tracer, Some(kept), &());
                assert!(again.expect("light").to_bytes() == whole, "{settings:?}");
            }
            let (mut stops, mut at) = (0, 0);
            loop {
                let stop = StopAt { left: at.into(), ..StopAt::default() };
                let (stopped, kept) = solve(&plan, &tracer, None, &stop);
                match stopped {
                    Ok(solution) => {
                        assert!(solution.to_bytes() == whole, "{settings:?}");
                        break;
                    }
                    Err(error) => assert_eq!(error.kind(), ErrorKind::Stopped),
                }
                let (again, _) = solve(&plan, &tracer, kept.last().map(Vec::as_slice), &());
                assert!(again.expect("light").to_bytes() == whole, "{settings:?}, {at}");
                (stops, at) = (stops + 1, at + 1 + at / 3);
            }
            assert!(stops >= 5, "{settings:?}: {stops}");
        }
    }

    #[test]
    fn what_is_done_of_another_plan_is_refused() {
        let (document, scene) = room();
        let tracer = Tracer::build(&scene);
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a.partial");
        let plan = |settings: &Settings| Plan::new(&document, &scene, settings).expect("a plan");
        let settings = &ways()[0];
        let keep = &mut |unfinished: Unfinished| {
            let bytes = unfinished.to_bytes(plan(settings).fingerprints());
            std::fs::write(&file, bytes.expect("memory")).map_err(|e| Error::new(e.to_string()))
        };
        plan(settings).solve_together(&tracer, None, keep, &()).expect("light");
        let go_on = |settings: &Settings| {
            let begun = Some(Begun::load(&file).expect("what was kept"));
            plan(settings).solve_together(&tracer, begun, &mut |_| Ok(()), &())
        };
        assert!(go_on(settings).is_ok());
        for other in [Settings { seed: 2, ..settings.clone() }, ways()[1].clone()] {
            let error = go_on(&other).expect_err("other choices").to_string();
            assert!(error.contains("begun with another scene or other flags"), "{error}");
        }
    }

    #[test]
    fn whatever_was_kept_a_solve_comes_to_its_end() {
        let (document, scene) = room();
        let tracer = Tracer::build(&scene);
        let mut random = fastrand::Rng::with_seed(1);
        let (mut taken, mut refused) = (0, 0);
        for settings in ways() {
            let mut settings = settings;
            settings.patches.levels = Some(0);
            settings.light.samples = Some(16);
            let plan = Plan::new(&document, &scene, &settings).expect("a plan");
            let (_, kept) = solve(&plan, &tracer, None, &());
            for number in 0..100 {
                let mut bytes = kept[number % kept.len()].clone();
                for _ in 0..random.usize(1..4) {
                    forge(&mut bytes, &mut random);
                }
                let Ok(begun) = postcard::from_bytes::<Begun>(&bytes) else { continue };
                match plan.solve_together(&tracer, Some(begun), &mut |_| Ok(()), &()) {
                    Ok((solution, _)) => {
                        taken += 1;
                        Solution::from_bytes(&solution.to_bytes()).expect("light");
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(taken > 50 && refused > 50, "{taken} were gone on with, {refused} refused");
    }
}
