//! Sums over many triangles, on all threads.

use rayon::prelude::*;

/// This many numbers are added up one after the other.
pub(super) const BLOCK: usize = 1 << 14;

/// The sum over the numbers below `count`: block by block, so that it has the same bits with any number of threads.
pub(super) fn sum(count: usize, of: impl Fn(usize) -> f64 + Sync) -> f64 {
    let blocks = (0..count.div_ceil(BLOCK)).into_par_iter();
    let of_block = |block: usize| {
        let first = block * BLOCK;
        (first..count.min(first + BLOCK)).map(&of).sum()
    };
    let sums: Vec<f64> = blocks.map(of_block).collect();
    sums.into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sum_has_all_numbers_and_the_same_bits_with_any_number_of_threads() {
        let of = |number: usize| (number as f64).sqrt();
        let sums = [1, 2, 7].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| sum(100_000, of))
        });
        let expected: f64 = (0..100_000).map(of).sum();
        assert!((sums[0] / expected - 1.0).abs() < 1e-12);
        assert_eq!(sums, [sums[0]; 3]);
        assert_eq!((sum(0, of), sum(1, |_| 3.0)), (0.0, 3.0));
    }
}
