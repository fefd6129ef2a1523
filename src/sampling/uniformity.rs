//! Whether points are uniform: tests of the samplers.

use super::streams::{PointSet, Purpose, Stream};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// How rarely a right sampler may be refused, or be as even as a stratified one by chance: as
/// rarely as a normal variable is 4 standard deviations off.
pub(super) const CHANCE: f64 = 6.3e-5;

/// Σ (count − expected)² / expected, over bins that are equally likely. With some hundred
/// points per bin it follows the χ² distribution with one degree of freedom less than bins.
pub(super) fn chi_square(counts: &[u32]) -> f64 {
    let expected = counts.iter().sum::<u32>() as f64 / counts.len() as f64;
    counts.iter().map(|&n| (n as f64 - expected).powi(2) / expected).sum()
}

/// The value that χ² of `bins` bins stays below with probability `p`.
pub(super) fn quantile(bins: usize, p: f64) -> f64 {
    ChiSquared::new((bins - 1) as f64).unwrap().inverse_cdf(p)
}

pub(super) fn looks_uniform(counts: &[u32]) -> bool {
    chi_square(counts) < quantile(counts.len(), 1.0 - CHANCE)
}

#[track_caller]
pub(super) fn assert_uniform(counts: &[u32], what: &str) {
    assert!(
        looks_uniform(counts),
        "{what}: χ² {} of {} bins is above {}; counts {counts:?}",
        chi_square(counts),
        counts.len(),
        quantile(counts.len(), 1.0 - CHANCE)
    );
}

pub(super) fn points(seed: u64, points: PointSet, count: u32) -> impl Iterator<Item = [f32; 4]> {
    let stream = Stream::new(seed, Purpose::Pair, 3, points);
    (0..count).map(move |i| stream.point(i))
}

/// Counts of the 16 × 16 cells of the unit square.
pub(super) fn square_counts(pairs: impl Iterator<Item = (f32, f32)>) -> Vec<u32> {
    let mut counts = vec![0; 256];
    for (x, y) in pairs {
        assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y), "({x}, {y})");
        counts[(x * 16.0) as usize * 16 + (y * 16.0) as usize] += 1;
    }
    counts
}
