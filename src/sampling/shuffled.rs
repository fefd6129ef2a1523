//! Streams whose points are used together.

use super::streams::{PointSet, Purpose, Stream, mix};

/// Points in [0, 1)⁴ for one of several streams whose points are used together.
///
/// Equal numbers of two [`Stream`]s are the same Sobol point twice, moved apart: together they fill a plane and not
/// the space. So each such stream takes its points in an order of its own, which keeps every power of two of them
/// together: Burley, *Practical Hash-based Owen Scrambling*, JCGT 9(4), 2020, §4 and §5.
#[derive(Debug, Clone, Copy)]
pub struct Shuffled {
    stream: Stream,
    order: u32,
}

impl Shuffled {
    #[inline]
    pub fn new(seed: u64, purpose: Purpose, index: u64) -> Self {
        let stream = Stream::new(seed, purpose, index, PointSet::Sobol);
        let [a, _, _, d] = stream.shift;
        Shuffled { stream, order: mix((a as u64) << 32 | d as u64) as u32 }
    }

    /// The point number `index`, uniform in [0, 1)⁴.
    #[inline]
    pub fn point(&self, index: u32) -> [f32; 4] {
        let rest = index & !(SHUFFLED - 1);
        // The order is a permutation of the leading bits, each flipped as those before it say.
        let reversed = (index & (SHUFFLED - 1)).reverse_bits() >> (32 - SHUFFLED_BITS);
        // Vegdahl, *Building a Better LK Hash*, 2021: each bit depends on those below it alone.
        let mut x = reversed ^ reversed.wrapping_mul(0x3d20_adea);
        x = x.wrapping_add(self.order);
        x = x.wrapping_mul((self.order >> 16) | 1);
        x ^= x.wrapping_mul(0x0552_6c56);
        x ^= x.wrapping_mul(0x53a2_2864);
        let order = (x & (SHUFFLED - 1)).reverse_bits() >> (32 - SHUFFLED_BITS);
        self.stream.point(rest | order)
    }
}

/// Blocks of this many points are shuffled.
const SHUFFLED: u32 = 1 << SHUFFLED_BITS;
const SHUFFLED_BITS: u32 = 12;

#[cfg(test)]
mod tests {
    use super::super::uniformity::{assert_uniform, looks_uniform};
    use super::*;

    #[test]
    fn a_shuffled_stream_has_the_points_of_a_stream_in_an_order_that_keeps_powers_of_two_together()
    {
        for index in 0..20 {
            let shuffled = Shuffled::new(7, Purpose::Path, index);
            let plain = |block: std::ops::Range<u32>| {
                let mut points: Vec<_> =
                    block.map(|k| shuffled.stream.point(k).map(f32::to_bits)).collect();
                points.sort_unstable();
                points
            };
            for size in [1u32, 16, 64, 4096] {
                for start in [0, 4096 * 3 + size] {
                    let start = start / size * size;
                    let mut found: Vec<_> = (start..start + size)
                        .map(|k| shuffled.point(k).map(f32::to_bits))
                        .collect();
                    found.sort_unstable();
                    let blocks =
                        (start / 4096 * 4096..(start / 4096 + 1) * 4096).step_by(size as usize);
                    let same = blocks.filter(|&first| plain(first..first + size) == found).count();
                    assert_eq!(same, 1, "stream {index}, {size} points from {start}");
                }
            }
        }
    }

    #[test]
    fn two_shuffled_streams_fill_the_plane_and_two_streams_do_not() {
        // The first coordinates of 4096 points of either, in 16 x 16 cells.
        let counts = |pair: &dyn Fn(u32) -> [f32; 2]| {
            let mut counts = vec![0; 256];
            for k in 0..4096 {
                let [x, y] = pair(k).map(|x| (x * 16.0) as usize);
                counts[16 * x + y] += 1;
            }
            counts
        };
        for seed in 0..8 {
            let shuffled = [0, 1].map(|index| Shuffled::new(seed, Purpose::Path, index));
            let counted = counts(&|k| shuffled.map(|stream| stream.point(k)[0]));
            assert_uniform(&counted, &format!("seed {seed}"));
            let plain =
                [0, 1].map(|index| Stream::new(seed, Purpose::Path, index, PointSet::Sobol));
            assert!(!looks_uniform(&counts(&|k| plain.map(|stream| stream.point(k)[0]))));
        }
    }
}
