//! How far power may fail to balance: Σ A H against what is sent and not lost.
//!
//! What a solution B with the residual r absorbs and loses misses what is emitted by
//!
//! ```text
//! Σ_i A_i r_i + Σ_j B_j (A_j Σ_k F_jk − Σ_i A_i F_ij).
//! ```
//!
//! The rule that stops iterations bounds the first sum. The second would be zero with F that is reciprocal. Rows by
//! hemispheres are not: each is sampled by itself, so the light that a small patch receives from all others is not what
//! they count as sent to it. Where light is reflected n times before it is absorbed, B is n times what is emitted, and
//! so is the second sum. The level of the light is off by the same share.
//!
//! The sum is over all rays of A_i / N (B_hit − B_i), where those that are lost count nothing. Patches are sampled
//! independently of each other, so the variance is the sum of theirs, which the eighths of their samples tell.

use crate::color::{Rgb64, luminance64};
use crate::direct::DirectEighths;
use crate::form_factor::Eighths;
use crate::sampling::{EIGHTHS, LEVELS_OF_EIGHTHS, MOST_GAIN, Spread};
use crate::solver::{Converged, Problem};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How far the power may fail to balance, relative to what is emitted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Misfit {
    /// The standard error that the samples leave, of the luminance; `None` where it is not known: by shooting and
    /// between pairs, whose form factors are reciprocal as they are used, so that power balances whether the light is
    /// right or not; with regular points, or fewer than eight samples; in two levels.
    pub samples: Option<f64>,
    /// The power that iterations left, at most.
    pub iterations: f64,
}

/// The luminance of each patch's irradiance in W·m⁻² by eighths of its samples, and the standard error of the power
/// balance in W·m⁻² times square units. `exitance` is that of emitters whose light was sampled apart, or empty.
pub(crate) fn by_eighths(
    direct: DirectEighths,
    rows: &dyn Eighths,
    problem: &Problem,
    solution: &Converged,
    exitance: &[Rgb64],
) -> (Vec<[f32; EIGHTHS]>, f64) {
    let luminances: Vec<f32> = solution.radiosity.iter().map(|b| luminance64(*b) as f32).collect();
    let reflected = rows.apart(&luminances);
    let mut sent = luminances;
    sent.iter_mut().zip(exitance).for_each(|(sum, e)| *sum += luminance64(*e) as f32);
    let lost = (0..sent.len()).any(|i| solution.row_sums[i] != Some(1.0));
    // The share of each patch's light that is not lost.
    let kept = if lost { rows.apart(&vec![1.0; sent.len()]) } else { Vec::new() };
    let of = |eighths: &[[f32; EIGHTHS]], i: usize| eighths.get(i).copied().unwrap_or_default();
    let unit = sent.iter().fold(0.0, |most: f32, b| most.max(*b));
    let largest = problem.areas.iter().copied().fold(0.0, f64::max);
    let spread = |i: usize| {
        let weight = (problem.areas[i] / largest) as f32 / unit;
        let (emitted, kept) = (of(&direct.from_emitters, i), of(&kept, i));
        let missed = |k: usize| (reflected[i][k] + emitted[k] - sent[i] * kept[k]) * weight;
        Spread::of::<EIGHTHS>(std::array::from_fn(missed))
    };
    let spreads: Vec<Spread<LEVELS_OF_EIGHTHS>> =
        (0..sent.len()).into_par_iter().map(spread).collect();
    let mut sum = Spread::default();
    spreads.iter().for_each(|spread| sum.add(spread));
    let error = f64::from(sum.variance(sum.gain(MOST_GAIN)).sqrt()) * largest * f64::from(unit);

    let mut light = direct.from_emitters;
    let mut add = |more: &[[f32; EIGHTHS]]| {
        if light.is_empty() {
            light = more.to_vec();
            return;
        }
        let sums = light.as_flattened_mut().iter_mut();
        sums.zip(more.as_flattened()).for_each(|(sum, more)| *sum += more);
    };
    add(&direct.from_sky);
    add(&reflected);
    (light, if error.is_finite() { error } else { 0.0 })
}
