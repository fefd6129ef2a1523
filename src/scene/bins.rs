//! Numbers put into bins.

use rayon::prelude::*;

/// More threads would do little but look at numbers of other threads' bins.
const MOST_PARTS: usize = 8;

/// The numbers below `count`, bin by bin, in ascending order in each; `bin` is below `bins`.
///
/// Each thread has some of the bins, and looks at all numbers for those that belong there.
pub(super) fn binned(count: u32, bins: usize, bin: impl Fn(u32) -> usize + Sync) -> Vec<u32> {
    let width = bins.div_ceil(rayon::current_num_threads().min(MOST_PARTS)).max(1);
    let counted = |first: usize| {
        let mut counts = vec![0u32; width.min(bins - first)];
        for number in 0..count {
            if let Some(count) = counts.get_mut(bin(number).wrapping_sub(first)) {
                *count += 1;
            }
        }
        counts
    };
    let firsts: Vec<usize> = (0..bins).step_by(width).collect();
    let counts: Vec<Vec<u32>> = firsts.par_iter().map(|first| counted(*first)).collect();
    let mut sorted = vec![0; count as usize];
    let (mut rest, mut parts) = (&mut sorted[..], Vec::new());
    for (first, counts) in firsts.into_iter().zip(counts) {
        let own;
        let length = counts.iter().sum::<u32>() as usize;
        (own, rest) = rest.split_at_mut(length);
        parts.push((own, first, counts));
    }
    assert!(rest.is_empty(), "every number has a bin");
    parts.into_par_iter().for_each(|(own, first, mut next)| {
        let mut filled = 0;
        for start in &mut next {
            filled += std::mem::replace(start, filled);
        }
        for number in 0..count {
            if let Some(place) = next.get_mut(bin(number).wrapping_sub(first)) {
                own[*place as usize] = number;
                *place += 1;
            }
        }
    });
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bin_has_its_numbers_in_ascending_order_with_any_number_of_threads() {
        let bin = |number: u32| (number as usize * 7919) % 101 / 3;
        let mut expected: Vec<u32> = (0..5000).collect();
        expected.sort_by_key(|number| bin(*number));
        for threads in [1, 2, 5, 12] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert_eq!(pool.install(|| binned(5000, 34, bin)), expected);
            assert!(pool.install(|| binned(0, 0, bin)).is_empty());
        }
    }
}
