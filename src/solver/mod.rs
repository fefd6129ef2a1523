//! Solving B_i = S_i + ρ_i Σ_j F_ij B_j for the radiosity B.
//!
//! S is the exitance E where the matrix carries all light, or the reflected direct light ρD where
//! that was estimated apart (see [`direct`](crate::direct)). Three methods, one file
//! each; all stop at the same measure of what is left. Those on a stored matrix go over all patches again and again
//! (`sweeps`).

mod extrapolation;
mod gauss_seidel;
mod jacobi;
mod southwell;
mod sweeps;

use crate::color::Rgb64;
use crate::error::{Error, ErrorKind, Result};
use crate::form_factor::{Rows, Transport};
use crate::patches::{PatchId, PatchMesh};
use crate::progress::{Progress, Stage};
use serde::{Deserialize, Serialize};
pub(crate) use southwell::Shots;
pub(crate) use sweeps::Sweeps;

/// The known parts of the equation, one entry per patch.
pub struct Problem {
    /// In square units.
    pub areas: Vec<f64>,
    /// ρ, in [0, 1].
    pub reflectance: Vec<Rgb64>,
    /// S in W·m⁻².
    pub source: Vec<Rgb64>,
}

/// How to solve on a stored matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MatrixMethod {
    /// Every patch from the last iterate.
    Jacobi,
    /// Every patch from the newest values.
    GaussSeidel,
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Stop {
    /// At this relative residual: Σ A|S − (I − ρF)B| / Σ A·S, the worst channel.
    Tolerance(f64),
    /// After exactly this many iterations, whatever the residual.
    Iterations(usize),
}

/// Residuals after which they are taken to fall by one factor.
const SETTLED: usize = 4;

/// The solution that a method found.
#[derive(Debug, Clone)]
pub struct Converged {
    /// B in W·m⁻², per patch.
    pub radiosity: Vec<Rgb64>,
    /// H = Σ_j F_ij B_j in W·m⁻², per patch.
    pub irradiance: Vec<Rgb64>,
    /// The relative residual after each iteration; of shooting, after each thousandth of a round.
    pub residuals: Vec<f64>,
    pub iterations: usize,
    /// Σ_j F_ij of each row; `None` for rows that were never needed.
    pub row_sums: Vec<Option<f64>>,
    /// The share of each row that ends on black backs; `None` where it is not known.
    pub on_backs: Vec<Option<f64>>,
    /// Shooting uses F_ij A_i / A_j for F_ji: the sums of those rows, once every patch has shot.
    pub reception_sums: Option<Vec<f64>>,
    /// Where light was extrapolated: the factor by which the slowest of it falls with a bounce.
    pub slow_rate: Option<f64>,
}

impl Problem {
    pub fn new(mesh: &PatchMesh, source: Vec<Rgb64>) -> Self {
        let patches = || (0..mesh.len() as u32).map(crate::patches::PatchId);
        Problem {
            areas: patches().map(|p| mesh.opaque_area(p)).collect(),
            reflectance: patches().map(|p| mesh.reflectance(p).as_dvec3()).collect(),
            source,
        }
    }

    /// Solves with a stored matrix.
    ///
    /// # Errors
    /// A problem that cannot converge: ρ ≥ 1 on all patches that some light is kept between, a residual that grows, or one
    /// that is still above the tolerance after 10,000 iterations. Or `progress` asked to stop.
    pub fn solve(
        &self,
        transport: &dyn Transport,
        method: MatrixMethod,
        stop: Stop,
        progress: &dyn Progress,
    ) -> Result<Converged> {
        let sweeps = &mut Sweeps::none(self);
        self.sweep(transport, method, stop, sweeps, &mut |_| Ok(()), progress)
    }

    /// Solves by shooting, with rows on demand.
    ///
    /// # Errors
    /// A problem that cannot converge, or `progress` asked to stop.
    pub fn shoot(&self, rows: &dyn Rows, stop: Stop, progress: &dyn Progress) -> Result<Converged> {
        self.go_on_shooting(rows, stop, &mut Shots::none(self.len()), &mut |_| Ok(()), progress)
    }

    /// As [`shoot`](Problem::shoot), from where the shots have come to. `keep` may store them, now and then and before
    /// `progress` stops them: then all rows that were asked for have shot.
    ///
    /// # Errors
    /// See [`shoot`](Problem::shoot); or what `keep` says.
    pub(crate) fn go_on_shooting(
        &self,
        rows: &dyn Rows,
        stop: Stop,
        shots: &mut Shots,
        keep: &mut dyn FnMut(&Shots) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<Converged> {
        progress.begin(Stage::Shots, None);
        progress.advance(shots.count() as u64);
        let found = southwell::solve(self, rows, stop, shots, keep, progress);
        progress.end();
        found
    }

    /// The share of the light that the iterations have not found yet, about. A residual r leaves (I − ρF)⁻¹ r, at most
    /// 1 / (1 − ρ_max) times as much; or, once residuals fall by one factor, the sum of a geometric series. `None`
    /// where neither is known.
    pub(crate) fn left(&self, solution: &Converged) -> Option<f64> {
        let last = solution.residuals.last().copied().filter(|last| *last > 0.0).unwrap_or(0.0);
        let found = self.power(solution.radiosity.iter().copied()).element_sum();
        let source = self.source_power().element_sum();
        if found <= 0.0 || last == 0.0 {
            return Some(0.0);
        }
        let amplification = 1.0 / (1.0 - self.most_reflectance().min(rate(solution)));
        amplification.is_finite().then(|| last * amplification * source / found)
    }

    /// At most the factor, in [0, 1], by which one bounce leaves light, in the long run. An iteration that takes the
    /// newest values does the work of two bounces, or less.
    pub(crate) fn slowest(&self, solution: &Converged) -> f64 {
        self.most_reflectance().min(rate(solution).sqrt())
    }

    fn most_reflectance(&self) -> f64 {
        self.reflectance.iter().fold(0.0, |most: f64, rho| most.max(rho.max_element()))
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.source.len()
    }

    pub fn is_empty(&self) -> bool {
        self.source.is_empty()
    }

    /// Σ A·S per channel, in W·m⁻² times square units.
    pub(crate) fn source_power(&self) -> Rgb64 {
        self.power(self.source.iter().copied())
    }

    /// Σ A·|x| per channel.
    fn power(&self, per_patch: impl Iterator<Item = Rgb64>) -> Rgb64 {
        self.areas.iter().zip(per_patch).map(|(area, x)| x.abs() * *area).sum()
    }

    /// The relative residual of a radiosity whose irradiance is known.
    fn residual(&self, radiosity: &[Rgb64], irradiance: &[Rgb64]) -> f64 {
        let left = (0..self.len()).map(|i| self.missing(i, radiosity, irradiance));
        relative(self.power(left), self.source_power())
    }

    /// S + ρH − B of a patch.
    fn missing(&self, i: usize, radiosity: &[Rgb64], irradiance: &[Rgb64]) -> Rgb64 {
        self.source[i] + self.reflectance[i] * irradiance[i] - radiosity[i]
    }

    /// Refuses light that provably grows or stays: ρ ≥ 1 on patches that send each other all they have.
    ///
    /// Where Σ_j ρ_i F_ij ≥ 1 over the j of a set holds for each i of it, the spectral radius of ρF is at least 1
    /// (Collatz and Wielandt). Patches that fail are taken out until none fails, so that one black corner in a
    /// white room empties the set. What is left matters only if light reaches it.
    fn check_loops(&self, rows: &dyn Rows) -> Result<()> {
        for channel in 0..3 {
            let kept = self.closed_loop(rows, channel);
            let Some(first) = kept.iter().position(|kept| *kept) else { continue };
            let lit = |i: usize| {
                self.source[i][channel] > 0.0
                    || rows.gather_row(PatchId(i as u32), &self.source)[channel] > 0.0
            };
            if (0..self.len()).any(|i| kept[i] && lit(i)) {
                let reflectance = self.reflectance[first][channel];
                return Err(cannot_converge(format!(
                    "patch {first} reflects {reflectance} of its light, and so do all patches that it \
                     lights"
                )));
            }
        }
        Ok(())
    }

    /// The largest set of patches of which each gives back to the set at least what it has.
    fn closed_loop(&self, rows: &dyn Rows, channel: usize) -> Vec<bool> {
        let reflectance = |i: usize| self.reflectance[i][channel];
        let mut kept: Vec<bool> = (0..self.len()).map(|i| reflectance(i) >= 1.0).collect();
        loop {
            let gives_back = |i: usize| {
                let mut sum = 0.0;
                rows.for_each_in_row(PatchId(i as u32), &mut |j, factor| {
                    sum += if kept[j] { factor } else { 0.0 };
                });
                reflectance(i) * sum >= 1.0
            };
            let failed: Vec<usize> =
                (0..self.len()).filter(|&i| kept[i] && !gives_back(i)).collect();
            if failed.is_empty() {
                return kept;
            }
            failed.into_iter().for_each(|i| kept[i] = false);
        }
    }
}

/// The factor by which the residual falls with each iteration; 1 where that is not known.
fn rate(solution: &Converged) -> f64 {
    match solution.residuals[..] {
        [.., before, last] if solution.residuals.len() >= SETTLED && last < before => {
            (last / before).max(solution.slow_rate.unwrap_or(0.0))
        }
        _ => 1.0,
    }
}

/// Power left, relative to the source's, in the worst channel; 0 without a source. NaN if anything is not
/// finite, so that nobody takes it for converged.
fn relative(left: Rgb64, source: Rgb64) -> f64 {
    if !(source.is_finite() && left.is_finite()) {
        return f64::NAN;
    }
    (0..3).filter(|&c| source[c] > 0.0).map(|c| left[c] / source[c]).fold(0.0, f64::max)
}

/// Iterations after which a method that has not reached its tolerance never will.
const MOST_ITERATIONS: usize = 10_000;

impl Stop {
    /// Whether to stop after an iteration that left the last of `residuals`.
    ///
    /// # Errors
    /// Light that grows (the residual is a thousand times the first one, or the source) or is not
    /// finite, and light that is still above the tolerance after `most` iterations.
    fn reached(&self, done: usize, residuals: &[f64], most: usize) -> Result<bool> {
        let (Some(&first), Some(&last)) = (residuals.first(), residuals.last()) else {
            return Ok(matches!(self, Stop::Iterations(0)));
        };
        if last.is_nan() || last > 1e3 * first.max(1.0) {
            return Err(cannot_converge(format!("the residual grew to {last:e}")));
        }
        match *self {
            Stop::Iterations(iterations) => Ok(done >= iterations),
            Stop::Tolerance(tolerance) if last <= tolerance => Ok(true),
            Stop::Tolerance(tolerance) if done >= most => Err(cannot_converge(format!(
                "after {most} iterations the residual is {last:e}, above the tolerance \
                 {tolerance:e}"
            ))),
            Stop::Tolerance(_) => Ok(false),
        }
    }
}

fn cannot_converge(why: String) -> Error {
    Error::new(format!("the light does not converge: {why}")).of_kind(ErrorKind::Divergence).remedy(
        "lower reflectances that are near 1, or raise the tolerance; between pairs of patches take \
         more samples (a form factor that is too large multiplies light), or use hemispheres",
    )
}

#[cfg(test)]
mod tests;
