//! The methods on a stored matrix: sweep after sweep over all patches, extrapolated where they converge slowly.

use super::extrapolation::{Iterate, extrapolated};
use super::{
    Converged, MOST_ITERATIONS, MatrixMethod, Problem, SETTLED, Stop, gauss_seidel, jacobi,
};
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::form_factor::{Rows, Transport, row_sums};
use crate::patches::PatchId;
use crate::progress::{Progress, Stage};
use serde::{Deserialize, Serialize};

/// How far the sweeps of a method on a stored matrix have come.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Sweeps {
    /// B in W·m⁻², per patch.
    radiosity: Vec<Rgb64>,
    /// One for each sweep; see [`Converged::residuals`].
    residuals: Vec<f64>,
    extrapolation: Option<Extrapolation>,
}

/// The last time that sweeps were so slow that their light was extrapolated.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Extrapolation {
    /// The number of sweeps before it.
    after: usize,
    /// The factor by which light that converges as slowly falls with a bounce; of all extrapolations the one nearest to 1.
    rate: f64,
}

impl Sweeps {
    pub(crate) fn none(problem: &Problem) -> Sweeps {
        let radiosity = problem.source.clone();
        Sweeps { radiosity, residuals: Vec::new(), extrapolation: None }
    }

    /// Whether they may belong to this number of patches.
    pub(crate) fn are_possible(&self, patches: usize) -> bool {
        self.radiosity.len() == patches
            && self.radiosity.iter().all(|b| b.is_finite() && b.min_element() >= 0.0)
            && self.residuals.iter().all(|residual| residual.is_finite())
            && self.extrapolation.is_none_or(|last| {
                last.after <= self.residuals.len() && (0.0..=1.0).contains(&last.rate)
            })
    }

    fn are_enough(&self, stop: Stop) -> Result<bool> {
        let is_reached = stop.reached(self.residuals.len(), &self.residuals, MOST_ITERATIONS)?;
        Ok(is_reached && self.are_settled())
    }

    /// Whether there were some sweeps since the last extrapolation: how fast the residual falls is known then.
    fn are_settled(&self) -> bool {
        self.extrapolation.is_none_or(|last| self.residuals.len() >= last.after + SETTLED)
    }

    /// Whether the residual falls by a factor near 1 with each sweep, and more sweeps are needed.
    fn are_slow(&self, stop: Stop) -> bool {
        let [.., before, last] = self.residuals[..] else { return false };
        let is_needed = matches!(stop, Stop::Tolerance(tolerance) if last > tolerance);
        is_needed && self.residuals.len() >= SETTLED && (SLOW..1.0).contains(&(last / before))
    }
}

/// A residual that falls by no more than this factor with a sweep is worth an extrapolation.
const SLOW: f64 = 0.8;

/// Sweeps before each.
const SWEEPS: usize = 6;

/// What sweeps need.
struct Sweeping<'a> {
    problem: &'a Problem,
    transport: &'a dyn Transport,
    /// The rows from which each patch takes the newest values: of Gauss–Seidel's method.
    newest: Option<&'a dyn Rows>,
    stop: Stop,
    progress: &'a dyn Progress,
}

impl Problem {
    /// As [`solve`](Problem::solve), from where the sweeps have come to. `keep` may store them, after each and before
    /// `progress` stops them.
    ///
    /// # Errors
    /// See [`solve`](Problem::solve); or what `keep` says.
    pub(crate) fn sweep(
        &self,
        transport: &dyn Transport,
        method: MatrixMethod,
        stop: Stop,
        sweeps: &mut Sweeps,
        keep: &mut dyn FnMut(&Sweeps) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<Converged> {
        let rows = transport.rows();
        let newest = match (method, rows) {
            (MatrixMethod::Jacobi, _) => None,
            (MatrixMethod::GaussSeidel, Some(rows)) => Some(rows),
            (MatrixMethod::GaussSeidel, None) => {
                return Err(Error::new(
                    "Gauss–Seidel goes row by row, and this transport has no rows",
                )
                .remedy("use Jacobi's method"));
            }
        };
        let row_sums = rows.map(|rows| row_sums(rows, self.len()));
        rows.map_or(Ok(()), |rows| self.check_loops(rows))?;
        progress.begin(Stage::Solve, None);
        progress.advance(sweeps.residuals.len() as u64);
        let irradiance =
            Sweeping { problem: self, transport, newest, stop, progress }.finish(sweeps, keep);
        progress.end();
        let patches = (0..self.len() as u32).map(PatchId);
        Ok(Converged {
            irradiance: irradiance?,
            radiosity: sweeps.radiosity.clone(),
            iterations: sweeps.residuals.len(),
            residuals: sweeps.residuals.clone(),
            row_sums: match row_sums {
                Some(sums) => sums.into_iter().map(Some).collect(),
                None => vec![None; self.len()],
            },
            on_backs: patches.map(|i| rows.and_then(|rows| rows.on_backs(i))).collect(),
            reception_sums: None,
            slow_rate: sweeps.extrapolation.map(|last| last.rate),
        })
    }
}

impl Sweeping<'_> {
    /// Sweeps until they are enough. Returns the irradiance.
    fn finish(
        &self,
        sweeps: &mut Sweeps,
        keep: &mut dyn FnMut(&Sweeps) -> Result<()>,
    ) -> Result<Vec<Rgb64>> {
        let mut irradiance = self.transport.gather(&sweeps.radiosity);
        while !sweeps.are_enough(self.stop)? {
            let was_done = if sweeps.are_slow(self.stop) {
                self.extrapolate(sweeps, &mut irradiance)
            } else {
                self.sweep(sweeps, &mut irradiance);
                true
            };
            let is_stopped = !was_done || self.progress.is_stopped();
            keep(sweeps)?;
            if is_stopped {
                return Err(Error::stopped());
            }
        }
        Ok(irradiance)
    }

    fn sweep(&self, sweeps: &mut Sweeps, irradiance: &mut Vec<Rgb64>) {
        match self.newest {
            Some(rows) => gauss_seidel::sweep(self.problem, rows, &mut sweeps.radiosity),
            None => jacobi::sweep(self.problem, irradiance, &mut sweeps.radiosity),
        }
        *irradiance = self.transport.gather(&sweeps.radiosity);
        sweeps.residuals.push(self.problem.residual(&sweeps.radiosity, irradiance));
        self.progress.advance(1);
    }

    /// Some sweeps, and what they lead to if its residual is less than the last one's. False if the run was to stop on
    /// the way: then none is done, as none could be gone on with.
    fn extrapolate(&self, sweeps: &mut Sweeps, irradiance: &mut Vec<Rgb64>) -> bool {
        let problem = self.problem;
        let begun = sweeps.clone();
        let mut iterates = vec![iterate(problem, &sweeps.radiosity, irradiance)];
        for _ in 0..SWEEPS {
            if self.progress.is_stopped() {
                *sweeps = begun;
                return false;
            }
            self.sweep(sweeps, irradiance);
            iterates.push(iterate(problem, &sweeps.radiosity, irradiance));
        }
        let radiosity = extrapolated(iterates, &problem.areas);
        let further = self.transport.gather(&radiosity);
        let residual = problem.residual(&radiosity, &further);
        let mut rate = sweeps.extrapolation.map_or(SLOW, |last| last.rate);
        let last = sweeps.residuals.last_mut().expect("a sweep was done");
        if residual < *last {
            *last = residual;
            // How much light the residual stood for that is gone: what is left of it may stand for as much.
            let added = |i: usize| radiosity[i] - sweeps.radiosity[i];
            let gone = |i: usize| added(i) - problem.reflectance[i] * (further[i] - irradiance[i]);
            let patches = 0..problem.len();
            let added = problem.power(patches.clone().map(added));
            let gone = problem.power(patches.map(gone));
            let rates = Rgb64::ONE - gone / added;
            rate = (0..3).filter(|&c| added[c] > 0.0).map(|c| rates[c]).fold(rate, f64::max);
            (sweeps.radiosity, *irradiance) = (radiosity, further);
        }
        sweeps.extrapolation = Some(Extrapolation { after: sweeps.residuals.len(), rate });
        true
    }
}

fn iterate(of: &Problem, radiosity: &[Rgb64], irradiance: &[Rgb64]) -> Iterate {
    let residual = (0..of.len()).map(|i| of.missing(i, radiosity, irradiance)).collect();
    Iterate { radiosity: radiosity.to_vec(), residual }
}
