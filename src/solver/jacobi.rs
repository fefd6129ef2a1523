//! Jacobi iteration: B⁽ᵏ⁺¹⁾ = S + ρ F B⁽ᵏ⁾. Each iteration adds one bounce of light.

use super::{Problem, Stop};
use crate::color::Rgb64;
use crate::error::{Error, Result};
use crate::form_factor::Transport;
use crate::progress::Progress;

pub(super) fn solve(
    problem: &Problem,
    transport: &dyn Transport,
    stop: Stop,
    progress: &dyn Progress,
) -> Result<(Vec<Rgb64>, Vec<f64>)> {
    let mut radiosity = problem.source.clone();
    let mut irradiance = transport.gather(&radiosity);
    let mut residuals = Vec::new();
    while !stop.reached(residuals.len(), &residuals, super::MOST_ITERATIONS)? {
        for i in 0..problem.len() {
            radiosity[i] = problem.source[i] + problem.reflectance[i] * irradiance[i];
        }
        irradiance = transport.gather(&radiosity);
        residuals.push(problem.residual(&radiosity, &irradiance));
        progress.advance(1);
        if progress.is_stopped() {
            return Err(Error::stopped());
        }
    }
    Ok((radiosity, residuals))
}
