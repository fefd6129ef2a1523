//! Jacobi iteration: B⁽ᵏ⁺¹⁾ = S + ρ F B⁽ᵏ⁾. Each iteration adds one bounce of light.

use super::Problem;
use crate::color::Rgb64;

/// From the last iterate's irradiance.
pub(super) fn sweep(problem: &Problem, irradiance: &[Rgb64], radiosity: &mut [Rgb64]) {
    for i in 0..problem.len() {
        radiosity[i] = problem.source[i] + problem.reflectance[i] * irradiance[i];
    }
}
