//! Gauss–Seidel iteration: each patch gathers from the newest values of all others.
//!
//! (Cohen & Wallace, *Radiosity and Realistic Image Synthesis*, §5.3.2.) The order of the patches
//! is part of the method, so a sweep is sequential.

use super::{Problem, Stop, Sweeps};
use crate::error::Result;
use crate::form_factor::{Rows, Transport};
use crate::patches::PatchId;

pub(super) fn solve(
    problem: &Problem,
    transport: &dyn Transport,
    rows: &dyn Rows,
    stop: Stop,
    sweeps: &mut Sweeps,
    go_on: &mut dyn FnMut(&Sweeps) -> Result<()>,
) -> Result<()> {
    while !sweeps.are_enough(stop)? {
        let Sweeps { radiosity, residuals } = sweeps;
        for i in 0..problem.len() {
            let irradiance = rows.gather_row(PatchId(i as u32), radiosity);
            radiosity[i] = problem.source[i] + problem.reflectance[i] * irradiance;
        }
        residuals.push(problem.residual(radiosity, &transport.gather(radiosity)));
        go_on(sweeps)?;
    }
    Ok(())
}
