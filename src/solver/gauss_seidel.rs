//! Gauss–Seidel iteration: each patch gathers from the newest values of all others.
//!
//! (Cohen & Wallace, *Radiosity and Realistic Image Synthesis*, §5.3.2.) The order of the patches
//! is part of the method, so a sweep is sequential.

use super::{Problem, Stop};
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::form_factor::{Rows, Transport};
use crate::patches::PatchId;
use crate::progress::Progress;

pub(super) fn solve(
    problem: &Problem,
    transport: &dyn Transport,
    rows: &dyn Rows,
    stop: Stop,
    progress: &dyn Progress,
) -> Result<(Vec<Rgb64>, Vec<f64>)> {
    let mut radiosity = problem.source.clone();
    let mut residuals = Vec::new();
    while !stop.reached(residuals.len(), &residuals, super::MOST_ITERATIONS)? {
        for i in 0..problem.len() {
            let irradiance = rows.gather_row(PatchId(i as u32), &radiosity);
            radiosity[i] = problem.source[i] + problem.reflectance[i] * irradiance;
        }
        residuals.push(problem.residual(&radiosity, &transport.gather(&radiosity)));
        progress.advance(1);
        if progress.is_stopped() {
            return Err(Error::stopped());
        }
    }
    Ok((radiosity, residuals))
}
