//! Gauss–Seidel iteration: each patch gathers from the newest values of all others.
//!
//! (Cohen & Wallace, *Radiosity and Realistic Image Synthesis*, §5.3.2.) The order of the patches
//! is part of the method, so a sweep is sequential.

use super::Problem;
use crate::color::Rgb64;
use crate::form_factor::Rows;
use crate::patches::PatchId;

pub(super) fn sweep(problem: &Problem, rows: &dyn Rows, radiosity: &mut [Rgb64]) {
    for i in 0..problem.len() {
        let irradiance = rows.gather_row(PatchId(i as u32), radiosity);
        radiosity[i] = problem.source[i] + problem.reflectance[i] * irradiance;
    }
}
