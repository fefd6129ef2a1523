//! Blocks of the samples, and what they say of the error of the whole.
//!
//! The samples of an estimate, in their order, fall into halves, quarters, eighths. Each such block is a low-discrepancy
//! set moved at random, and right in the mean; but the blocks of one set are not independent, as they fill each
//! other's gaps. Let V(N) be the variance of the mean of N samples. The mean of two neighbours has the variance
//! (V(N/2) + covariance)/2 = V(N), so that
//!
//! ```text
//! E (half − half)² / 4 = V(N/2) − V(N),   E (quarter − quarter)² / 4 = V(N/4) − V(N/2) within a half, …
//! ```
//!
//! If V falls as N^−a, each is 2^a times the one before: so together they give a and V(N), as Aitken extrapolates a
//! geometric sequence (*Proc. Roy. Soc. Edinburgh* 46, 1926). Independent samples have a = 1. Eight independent sets
//! would need no law, and cost the evenness of one: at equal work relMSE of pictures was 3.6 to 5.5 times as large,
//! and the standard error of patches about twice.

use std::ops::Range;

/// Blocks of a pixel's samples, of which there may be few, and their levels.
pub(crate) const QUARTERS: usize = 4;
pub(crate) const LEVELS_OF_QUARTERS: usize = 2;
/// Blocks of a patch's samples, and their levels.
pub const EIGHTHS: usize = 8;
pub(crate) const LEVELS_OF_EIGHTHS: usize = 3;

/// The fastest that the variance of digitally shifted nets falls, a = 2 (Dick & Pillichshammer, *Digital Nets and
/// Sequences*, 2010, ch. 16), and that of integrands which jump, a = 1.5 (He & Wang, *On the Convergence Rate of
/// Randomized Quasi–Monte Carlo for Discontinuous Functions*, SIAM J. Numer. Anal. 53(5), 2015), as soft light does.
pub(crate) const MOST_GAIN: f32 = 4.0;
pub(crate) const MOST_GAIN_OF_JUMPS: f32 = 2.828_427;

/// The block, out of `blocks`, of sample `number` where there are `samples` in general, at least one in each; more go
/// round again.
pub(crate) fn block(number: u32, samples: u32, blocks: usize) -> usize {
    (number as u64 * blocks as u64 / samples as u64) as usize % blocks
}

/// The numbers of the samples in a block, out of `blocks`.
pub(crate) fn numbers(block: usize, samples: usize, blocks: usize) -> Range<usize> {
    let first = |block: usize| (block * samples).div_ceil(blocks);
    first(block)..first(block + 1)
}

/// Quarters as the first half of twice as many samples.
pub(crate) fn paired([a, b, c, d]: [f32; QUARTERS]) -> [f32; QUARTERS] {
    [a + b, c + d, 0.0, 0.0]
}

/// The squared differences of a value's blocks, in the mean of each level: of its halves, V(N/2) − V(N); of the
/// quarters, V(N/4) − V(N/2); and so on.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spread<const LEVELS: usize>([f32; LEVELS]);

impl<const LEVELS: usize> Default for Spread<LEVELS> {
    fn default() -> Self {
        Spread([0.0; LEVELS])
    }
}

impl<const LEVELS: usize> Spread<LEVELS> {
    /// # Panics
    /// If there are not 2^`LEVELS` blocks.
    pub(crate) fn of<const BLOCKS: usize>(mut blocks: [f32; BLOCKS]) -> Self {
        assert_eq!(BLOCKS, 1 << LEVELS, "there must be 2^LEVELS blocks");
        let mut levels = [0.0; LEVELS];
        for (level, squares) in levels.iter_mut().enumerate().rev() {
            let pairs = 1 << level;
            for pair in 0..pairs {
                let (a, b) = (blocks[2 * pair], blocks[2 * pair + 1]);
                *squares += (a - b).powi(2) / (4 * pairs) as f32;
                blocks[pair] = (a + b) / 2.0;
            }
        }
        Spread(levels)
    }

    pub(crate) fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, squares)| *sum += squares);
    }

    pub(crate) fn scaled(self, factor: f32) -> Self {
        Spread(self.0.map(|squares| squares * factor))
    }

    /// 2^a, from that of independent samples, a = 1, up to `most`: the sum of all levels but the first over that of all but
    /// the last, in which single levels of few samples weigh little.
    pub(crate) fn gain(&self, most: f32) -> f32 {
        let gain = self.0[1..].iter().sum::<f32>() / self.0[..LEVELS - 1].iter().sum::<f32>();
        // Where there is nothing to tell it by, samples count as independent.
        if gain.is_finite() { gain.clamp(2.0, most) } else { 2.0 }
    }

    /// V(N).
    pub(crate) fn variance(&self, gain: f32) -> f32 {
        self.0.iter().sum::<f32>() / (gain.powi(LEVELS as i32) - 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_the_numbers_that_belong_to_them() {
        for samples in [4, 8, 10, 13, 64] {
            for blocks in [4, 8] {
                let all: Vec<usize> =
                    (0..blocks).flat_map(|b| numbers(b, samples, blocks).map(move |_| b)).collect();
                let by_number: Vec<usize> =
                    (0..samples as u32).map(|k| block(k, samples as u32, blocks)).collect();
                assert_eq!(all, by_number, "{samples} samples in {blocks}");
            }
        }
    }

    #[test]
    fn levels_that_grow_by_a_factor_have_it_as_gain_and_extrapolate_to_the_whole() {
        // V(N) = 3, and each half as many samples have 2.5 times as much.
        let levels = [0, 1, 2].map(|level| 3.0 * 2.5f32.powi(level) * (2.5 - 1.0));
        let spread = Spread(levels);
        assert!((spread.gain(4.0) - 2.5).abs() < 1e-6);
        assert!((spread.variance(2.5) - 3.0).abs() < 1e-5);
    }

    #[test]
    fn a_spread_holds_the_squared_differences_of_each_level() {
        let Spread(levels) = Spread::<2>::of([1.0, 3.0, 10.0, 4.0]);
        // (2 − 7)²/4; (2² + 6²)/2/4.
        assert_eq!(levels, [6.25, 5.0]);
    }
}
