//! Standard errors of the patches' irradiance.
//!
//! A patch's samples fall into eighths, and these say how far it is off by its own samples (see [`Spread`]); but where
//! few of them find light, eight numbers say it badly. Patches with neighbouring numbers are neighbours, or parts of one
//! surface, and off by like shares: so their spreads are averaged.
//!
//! A patch also receives what other patches are off by: of the own deviations d of all patches in one eighth comes
//! δ = d + Fρδ, the equation of light once more. Where a small bright patch lights all others, as the ceiling above an
//! uplight does, nearly all of their error is its own.

use crate::color::luminance64;
use crate::form_factor::Eighths;
use crate::sampling::{EIGHTHS, LEVELS_OF_EIGHTHS, MOST_GAIN, MOST_GAIN_OF_JUMPS, Spread};
use crate::solver::{Converged, Problem};
use rayon::prelude::*;

/// Over how many patches before and after it a patch's spread is averaged; and over how many is found how fast the
/// variance falls with the number of samples.
const AROUND: usize = 4;
const FAR_AROUND: usize = 8;

/// Light below this share of the mean is as good as dark: errors relative to it would outweigh all others.
const DARK: f32 = 0.01;

/// How exactly deviations are followed, and over how many bounces, beyond which they are extrapolated.
const SMALL: f64 = 0.01;
const MOST_BOUNCES: usize = 64;

/// The standard error of the luminance of each patch's irradiance, in W·m⁻²; empty where it has no bound. `light`: the
/// luminance of the irradiance of each patch by eighths of its samples; `rows` carry the light of the solution.
pub(crate) fn of(
    mut light: Vec<[f32; EIGHTHS]>,
    rows: &dyn Eighths,
    problem: &Problem,
    solution: &Converged,
) -> Vec<f32> {
    let Some(left) = problem.left(solution) else { return Vec::new() };
    let mean = |of: &mut [f32; EIGHTHS]| {
        let mean = of.iter().sum::<f32>() / EIGHTHS as f32;
        of.iter_mut().for_each(|light| *light -= mean);
        mean
    };
    let means: Vec<f32> = light.iter_mut().map(mean).collect();
    let own = light;
    let grey: Vec<f32> = problem.reflectance.iter().map(|rho| luminance64(*rho) as f32).collect();
    let slowest = problem.slowest(solution);
    let Some(received) = received(&own, rows, &grey, slowest) else { return Vec::new() };
    let mut errors = errors(&own, &received, &problem.areas, &means);
    for (error, irradiance) in errors.iter_mut().zip(&solution.irradiance) {
        let unsolved = (left * luminance64(*irradiance)) as f32;
        *error = error.hypot(unsolved).min(f32::MAX);
    }
    errors
}

/// What comes of the patches' own deviations at all patches; `None` where it does not die away. Their sum, over all, dies
/// away last, by the factor `slowest` per bounce or faster, and is small at first beside each.
fn received(
    own: &[[f32; EIGHTHS]],
    rows: &dyn Eighths,
    reflectance: &[f32],
    slowest: f64,
) -> Option<Vec<[f32; EIGHTHS]>> {
    let size = |of: &[[f32; EIGHTHS]]| -> f64 {
        of.as_flattened().iter().map(|x| f64::from(*x).powi(2)).sum::<f64>().sqrt()
    };
    let bounce = |of: &[[f32; EIGHTHS]]| {
        let leaves = of.iter().zip(reflectance).map(|(of, rho)| of.map(|x| rho * x));
        rows.together(&leaves.collect::<Vec<_>>())
    };
    let add = |sum: &mut [[f32; EIGHTHS]], factor: f32, more: &[[f32; EIGHTHS]]| {
        let more = more.as_flattened();
        sum.as_flattened_mut().iter_mut().zip(more).for_each(|(sum, more)| *sum += factor * more);
    };
    let mut arrives = bounce(own);
    let mut sum = arrives.clone();
    let (of_own, mut now, mut rate) = (size(own), size(&arrives), 0.0);
    for _ in 1..MOST_BOUNCES {
        if now == 0.0 {
            return Some(sum);
        }
        arrives = bounce(&arrives);
        add(&mut sum, 1.0, &arrives);
        let before = std::mem::replace(&mut now, size(&arrives));
        rate = now / before;
        let factor = slowest.max(rate);
        if factor < 1.0 && now * factor / (1.0 - factor) <= SMALL * (of_own + size(&sum)) {
            break;
        }
    }
    // They fall by one factor by then.
    add(&mut sum, (rate / (1.0 - rate)) as f32, &arrives);
    (rate < 1.0).then_some(sum)
}

fn errors(
    own: &[[f32; EIGHTHS]],
    received: &[[f32; EIGHTHS]],
    areas: &[f64],
    light: &[f32],
) -> Vec<f32> {
    let total: f64 = light.iter().map(|light| f64::from(*light)).sum();
    let dark = DARK * (total / light.len() as f64) as f32;
    if dark <= 0.0 {
        return vec![0.0; light.len()];
    }
    let around = |i: usize, by: usize| i.saturating_sub(by)..(i + by + 1).min(light.len());
    let mean = |i: usize| {
        let near = &light[around(i, AROUND)];
        near.iter().sum::<f32>() / near.len() as f32
    };
    // Patches differ less in their relative errors. Relative to its own light a patch that few of its samples found lit
    // would seem to be off by little.
    let units: Vec<f32> = (0..light.len()).into_par_iter().map(|i| mean(i) + dark).collect();
    let spreads = |of: &[[f32; EIGHTHS]]| -> Vec<Spread<LEVELS_OF_EIGHTHS>> {
        let relative = |(of, unit): (&[f32; EIGHTHS], &f32)| Spread::of(of.map(|x| x / unit));
        of.par_iter().zip(&units).map(relative).collect()
    };
    let sum = |of: &[Spread<LEVELS_OF_EIGHTHS>]| {
        let mut sum = Spread::default();
        of.iter().for_each(|spread| sum.add(spread));
        sum
    };
    // What neighbours receive is nearly one number, which cannot say how fast its variance falls: the deviations of which
    // it is made can, by the power that they stand for.
    let largest = areas.iter().copied().fold(0.0, f64::max);
    let by_power: Vec<Spread<LEVELS_OF_EIGHTHS>> = own
        .par_iter()
        .zip(areas)
        .map(|(of, area)| Spread::of(of.map(|x| x / dark * (area / largest) as f32)))
        .collect();
    let gain_of_received = sum(&by_power).gain(MOST_GAIN_OF_JUMPS);
    let (own, received) = (spreads(own), spreads(received));
    let error = |(i, unit): (usize, &f32)| {
        let gain = sum(&own[around(i, FAR_AROUND)]).gain(MOST_GAIN);
        let near = around(i, AROUND);
        let count = near.len() as f32;
        let variance = sum(&own[near.clone()]).variance(gain)
            + sum(&received[near]).variance(gain_of_received);
        (variance / count).sqrt() * unit
    };
    units.par_iter().enumerate().map(error).collect()
}
