//! A solve of all patches together that is not finished: its steps so far, and the file that keeps them.

use crate::direct::DirectLight;
use crate::error::{Error, Result};
use crate::export::sealed::Seal;
use crate::form_factor::{Estimator, Matrix};
use crate::memory;
use crate::settings::Method;
use crate::solver::{Shots, Sweeps};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

const SEAL: Seal = Seal {
    magic: b"isolux begun\n",
    version: 1,
    name: "file of an unfinished solve",
    command: "isolux solve SCENE -o ROOM.light",
};

/// The remedy for a FILE.partial that a run cannot use.
pub(crate) const ANEW: &str =
    "repeat the flags with which it was begun; or delete it, and leave out --resume, to begin anew";

/// More than any run traces.
const MOST_RAYS: u64 = 1 << 60;

/// The steps of a solve that are done. Each needs those before it.
#[derive(Default, Deserialize)]
pub struct Begun {
    pub(crate) direct: Option<DirectLight>,
    /// Rays that were traced for the form factors.
    pub(crate) rays: u64,
    pub(crate) matrix: Option<Matrix>,
    pub(crate) sweeps: Option<Sweeps>,
    pub(crate) shots: Option<Shots>,
    /// Where it was read from.
    #[serde(skip)]
    file: PathBuf,
}

/// The steps of a solve that are done, borrowed to be written. The fields are those of [`Begun`], in the same order, so
/// that the one is read from the bytes of the other.
#[derive(Clone, Copy, Default, Serialize)]
pub struct Unfinished<'a> {
    pub(crate) direct: Option<&'a DirectLight>,
    pub(crate) rays: u64,
    pub(crate) matrix: Option<&'a Matrix>,
    pub(crate) sweeps: Option<&'a Sweeps>,
    pub(crate) shots: Option<&'a Shots>,
}

/// Called with the steps that are done, which it may store.
pub type Keep<'k> = dyn FnMut(Unfinished) -> Result<()> + 'k;

impl Unfinished<'_> {
    /// The bytes of a file. `run`: a number of all that the light's bits depend on.
    ///
    /// # Errors
    /// Too little memory is left for them.
    pub fn to_bytes(&self, run: u32) -> Result<Vec<u8>> {
        // The bytes take as much as the matrix about, and twice that while they are collected.
        let bytes = 2 * self.matrix.map_or(0, Matrix::bytes);
        memory::check("a copy of what is done", bytes, memory::available(), "")?;
        Ok(SEAL.close(&(run, self)))
    }
}

impl Begun {
    pub(crate) fn unfinished(&self) -> Unfinished<'_> {
        let Begun { direct, rays, matrix, sweeps, shots, file: _ } = self;
        Unfinished {
            direct: direct.as_ref(),
            rays: *rays,
            matrix: matrix.as_ref(),
            sweeps: sweeps.as_ref(),
            shots: shots.as_ref(),
        }
    }

    /// Reads a file of what [`Unfinished::to_bytes`] made for the same `run`.
    ///
    /// # Errors
    /// A file of another run, of another kind or damaged, or one that cannot be read.
    pub fn load(path: impl AsRef<Path>, run: u32) -> Result<Begun> {
        let path = path.as_ref();
        let opened = SEAL.open(&SEAL.read(path)?);
        let (of, begun): (u32, Begun) = opened.map_err(|error| error.in_file(path))?;
        if of == run {
            return Ok(Begun { file: path.to_path_buf(), ..begun });
        }
        Err(Error::new("this was begun with another scene or other flags").in_file(path))
    }

    /// Checks what a forged file with a right checksum could hold.
    ///
    /// # Errors
    /// Numbers or lists that no run writes.
    pub(crate) fn check(&self, of: &Estimator, method: Method) -> Result<()> {
        let patches = of.mesh.len();
        let is_possible = self.rays <= MOST_RAYS
            && self.direct.as_ref().is_none_or(|direct| direct.is_possible(patches))
            && self.matrix.as_ref().is_none_or(|matrix| matrix.is_possible(of, method))
            && self.sweeps.as_ref().is_none_or(|sweeps| sweeps.are_possible(patches))
            && self.shots.as_ref().is_none_or(|shots| shots.are_possible(patches));
        if is_possible { Ok(()) } else { Err(self.contradiction()) }
    }

    /// The error for a file whose numbers no run writes.
    pub(crate) fn contradiction(&self) -> Error {
        SEAL.contradiction().in_file(&self.file).remedy(ANEW)
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

    /// Stops a run once it has its direct light, after it has asked `left` times whether to stop.
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
        // It ends within a round of many patches.
        let mut settings = Settings::default();
        settings.patches.levels = Some(3);
        settings.light.samples = Some(16);
        settings.light.solver = Some(Solver::Southwell);
        settings.light.tolerance = Some(0.6);
        settings.light.direct = Some(8);
        ways.push(settings);
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
        let solved = plan.solve_together(tracer, begun, Some(keep), progress);
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
            assert!(kept.len() >= if settings.light.tolerance.is_some() { 1 } else { 2 });
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
    fn what_is_done_of_another_run_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("a.partial");
        let bytes = Begun { rays: 7, ..Begun::default() }.unfinished().to_bytes(5);
        std::fs::write(&file, bytes.expect("memory")).expect("a file");
        assert_eq!(Begun::load(&file, 5).expect("what was kept").rays, 7);
        let error = Begun::load(&file, 6).err().expect("another run").to_string();
        assert!(error.contains("begun with another scene or other flags"), "{error}");
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
            for number in 0..25 {
                let mut bytes = kept[number % kept.len()].clone();
                for _ in 0..random.usize(1..4) {
                    forge(&mut bytes, &mut random);
                }
                let Ok(begun) = postcard::from_bytes::<Begun>(&bytes) else { continue };
                match plan.solve_together(&tracer, Some(begun), None, &()) {
                    Ok((solution, _)) => {
                        taken += 1;
                        Solution::from_bytes(&solution.to_bytes()).expect("light");
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(taken > 20 && refused > 20, "{taken} were gone on with, {refused} refused");
    }
}
