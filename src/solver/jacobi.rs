//! Jacobi iteration: B⁽ᵏ⁺¹⁾ = S + ρ F B⁽ᵏ⁾. Each iteration adds one bounce of light.

use super::{Problem, Stop, Sweeps};
use crate::error::Result;
use crate::form_factor::Transport;

pub(super) fn solve(
    problem: &Problem,
    transport: &dyn Transport,
    stop: Stop,
    sweeps: &mut Sweeps,
    go_on: &mut dyn FnMut(&Sweeps) -> Result<()>,
) -> Result<()> {
    let mut irradiance = transport.gather(&sweeps.radiosity);
    while !sweeps.are_enough(stop)? {
        let Sweeps { radiosity, residuals } = sweeps;
        for i in 0..problem.len() {
            radiosity[i] = problem.source[i] + problem.reflectance[i] * irradiance[i];
        }
        irradiance = transport.gather(radiosity);
        residuals.push(problem.residual(radiosity, &irradiance));
        go_on(sweeps)?;
    }
    Ok(())
}
