//! Southwell relaxation, known as progressive refinement or shooting.
//!
//! Cohen, Chen, Wallace & Greenberg, *A Progressive Refinement Approach to Fast Radiosity Image
//! Generation*, SIGGRAPH 1988: the patch with the most unshot power sends it into the scene. Only
//! that patch's row is needed, so no matrix is stored, and the radiosity so far is a picture at any
//! moment. The unshot power is the residual.

use super::{Problem, Solution, Stop, cannot_converge};
use crate::color::Rgb64;
use crate::error::Result;
use crate::form_factor::RowSource;
use crate::patches::PatchId;
use indicatif::ProgressBar;

pub fn solve(
    problem: &Problem,
    rows: &impl RowSource,
    stop: Stop,
    progress: &ProgressBar,
) -> Result<Solution> {
    let n = problem.len();
    let most = super::MOST_ITERATIONS.max(1000 * n);
    let mut unshot = Unshot::new(problem);
    let mut solution = Solution {
        radiosity: problem.source.clone(),
        irradiance: vec![Rgb64::ZERO; n],
        residuals: Vec::new(),
        row_sums: vec![None; n],
        reception_sums: None,
    };
    let mut reception = vec![0.0; n];
    while !stop.reached(&solution.residuals, most)? {
        let shooter = unshot.brightest();
        let row = rows.row(PatchId(shooter as u32));
        let sum: f64 = row.iter().map(|(_, factor)| factor).sum();
        if problem.reflectance[shooter].max_element() * sum >= 1.0
            && problem.reflectance[shooter].max_element() >= 1.0
        {
            return Err(cannot_converge(format!("patch {shooter} gives back all its light")));
        }
        let first_shot = solution.row_sums[shooter].replace(sum).is_none();
        let sent = unshot.take(shooter) * problem.areas[shooter];
        for (PatchId(j), factor) in row {
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
        solution.residuals.push(problem.relative(unshot.total));
        progress.inc(1);
    }
    let all_have_shot = solution.row_sums.iter().all(Option::is_some);
    solution.reception_sums = all_have_shot.then_some(reception);
    Ok(solution)
}

/// Radiosity that has not been sent yet.
struct Unshot<'p> {
    problem: &'p Problem,
    radiosity: Vec<Rgb64>,
    /// Σ over the channels of the power, as the key of the choice.
    keys: Vec<f32>,
    /// Σ A·unshot per channel, kept by differences.
    total: Rgb64,
}

impl<'p> Unshot<'p> {
    fn new(problem: &'p Problem) -> Self {
        let radiosity = problem.source.clone();
        let total = problem.power(radiosity.iter().copied());
        let key = |(b, area): (&Rgb64, &f64)| (b.element_sum() * area) as f32;
        let keys = radiosity.iter().zip(&problem.areas).map(key).collect();
        Unshot { problem, radiosity, keys, total }
    }

    /// The patch with the most unshot power; the lowest of equals.
    fn brightest(&self) -> usize {
        let most = self.keys.iter().copied().fold(0f32, f32::max);
        self.keys.iter().position(|&key| key == most).unwrap_or(0)
    }

    fn take(&mut self, i: usize) -> Rgb64 {
        let taken = std::mem::take(&mut self.radiosity[i]);
        self.keys[i] = 0.0;
        // Differences leave rounding behind; it must not read as negative power.
        self.total = (self.total - taken * self.problem.areas[i]).max(Rgb64::ZERO);
        taken
    }

    fn add(&mut self, i: usize, radiosity: Rgb64) {
        self.radiosity[i] += radiosity;
        self.keys[i] = (self.radiosity[i].element_sum() * self.problem.areas[i]) as f32;
        self.total += radiosity * self.problem.areas[i];
    }
}
