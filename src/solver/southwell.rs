//! Southwell relaxation, known as progressive refinement or shooting.
//!
//! Cohen, Chen, Wallace & Greenberg, *A Progressive Refinement Approach to Fast Radiosity Image
//! Generation*, SIGGRAPH 1988: the patch with the most unshot power sends it into the scene. Only
//! that patch's row is needed, so no matrix is stored, and the radiosity so far is a picture at any
//! moment. The unshot power is the residual.

use super::{Converged, Problem, Stop, cannot_converge};
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::form_factor::Rows;
use crate::patches::PatchId;
use crate::progress::Progress;

pub(super) fn solve(
    problem: &Problem,
    rows: &dyn Rows,
    stop: Stop,
    progress: &dyn Progress,
) -> Result<Converged> {
    let n = problem.len();
    let most = super::MOST_ITERATIONS.max(1000 * n);
    let mut unshot = Unshot::new(problem);
    let mut solution = Converged {
        radiosity: problem.source.clone(),
        irradiance: vec![Rgb64::ZERO; n],
        residuals: Vec::new(),
        iterations: 0,
        row_sums: vec![None; n],
        on_backs: vec![None; n],
        reception_sums: None,
    };
    let mut reception = vec![0.0; n];
    let mut residual = Vec::new();
    let mut keeps_all = true;
    while !stop.reached(solution.iterations, &residual, most)? {
        let shooter = unshot.brightest();
        let row = rows.row(PatchId(shooter as u32));
        let sum = row.sum();
        solution.on_backs[shooter] = row.on_backs;
        let reflectance = problem.reflectance[shooter].max_element();
        keeps_all &= reflectance >= 1.0 && reflectance * sum >= 1.0;
        // The first n shots come from nearly all patches.
        if keeps_all && solution.iterations >= n {
            return Err(cannot_converge(format!(
                "patch {shooter} gives back all its light, as all \
                 patches before it"
            )));
        }
        let first_shot = solution.row_sums[shooter].replace(sum).is_none();
        let sent = unshot.take(shooter) * problem.areas[shooter];
        for (PatchId(j), factor) in row.entries {
            let j = j as usize;
            // By reciprocity F_ji = F_ij A_i / A_j.
            let received = sent * (factor / problem.areas[j]);
            if first_shot {
                reception[j] += factor * problem.areas[shooter] / problem.areas[j];
            }
            let reflected = problem.reflectance[j] * received;
            solution.irradiance[j] += received;
            solution.radiosity[j] += reflected;
            unshot.add(j, reflected);
        }
        residual.truncate(1);
        residual.push(problem.relative(unshot.total));
        if solution.iterations.is_multiple_of(n.div_ceil(1000)) {
            solution.residuals.extend(residual.last());
        }
        solution.iterations += 1;
        progress.advance(1);
        if progress.is_stopped() {
            return Err(Error::stopped());
        }
    }
    if solution.residuals.last() != residual.last() {
        solution.residuals.extend(residual.last());
    }
    let all_have_shot = solution.row_sums.iter().all(Option::is_some);
    solution.reception_sums = all_have_shot.then_some(reception);
    Ok(solution)
}

/// Keys in a block: about the root of the number of patches in a usual scene.
const BLOCK: usize = 256;

fn largest(keys: &[f32]) -> f32 {
    keys.iter().copied().fold(0.0, f32::max)
}

/// Radiosity that has not been sent yet.
struct Unshot<'p> {
    problem: &'p Problem,
    radiosity: Vec<Rgb64>,
    /// Σ over the channels of the power, as the key of the choice.
    keys: Vec<f32>,
    /// The largest key of each block, so that the choice need not look at all of them.
    block_keys: Vec<f32>,
    /// Σ A·unshot per channel, kept by differences.
    total: Rgb64,
}

impl<'p> Unshot<'p> {
    fn new(problem: &'p Problem) -> Self {
        let radiosity = problem.source.clone();
        let total = problem.power(radiosity.iter().copied());
        let key = |(b, area): (&Rgb64, &f64)| (b.element_sum() * area) as f32;
        let keys: Vec<f32> = radiosity.iter().zip(&problem.areas).map(key).collect();
        let block_keys = keys.chunks(BLOCK).map(largest).collect();
        Unshot { problem, radiosity, keys, block_keys, total }
    }

    /// The patch with the most unshot power; the lowest of equals.
    fn brightest(&self) -> usize {
        let most = largest(&self.block_keys);
        let block = self.block_keys.iter().position(|&key| key == most).unwrap_or(0);
        let keys = self.keys[block * BLOCK..].iter();
        block * BLOCK + keys.clone().position(|&key| key == most).unwrap_or(0)
    }

    fn take(&mut self, i: usize) -> Rgb64 {
        let taken = std::mem::take(&mut self.radiosity[i]);
        self.keys[i] = 0.0;
        let block = i / BLOCK;
        let end = ((block + 1) * BLOCK).min(self.keys.len());
        self.block_keys[block] = largest(&self.keys[block * BLOCK..end]);
        // Differences leave rounding behind; it must not read as negative power.
        self.total = (self.total - taken * self.problem.areas[i]).max(Rgb64::ZERO);
        taken
    }

    fn add(&mut self, i: usize, radiosity: Rgb64) {
        self.radiosity[i] += radiosity;
        self.keys[i] = (self.radiosity[i].element_sum() * self.problem.areas[i]) as f32;
        let block = &mut self.block_keys[i / BLOCK];
        *block = block.max(self.keys[i]);
        self.total += radiosity * self.problem.areas[i];
    }
}
