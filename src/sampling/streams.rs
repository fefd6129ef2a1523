//! Seeded streams of points, random or low-discrepancy.

use std::sync::LazyLock;

/// How the points of one estimate are placed.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    clap::ValueEnum,
    serde::Serialize,
    serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum PointSet {
    /// Owen-scrambled Sobol points: their error falls faster than N^(−1/2) on smooth integrands.
    #[default]
    Sobol,
    /// Independent uniform points: their error falls as N^(−1/2), as the textbook says.
    Random,
    /// The centroids of a regular subdivision: cheap, deterministic, and biased by its grid.
    Regular,
}

/// The use of a stream of numbers, so that no two uses share their numbers.
#[derive(Debug, Clone, Copy)]
pub enum Purpose {
    Pair = 1,
    Hemisphere,
    DirectLight,
    Pixel,
    Verify,
    Bench,
    LitSides,
    Sky,
    Path,
    Roulette,
    Bright,
    Lamp,
    SurfacePoint,
    PatchPoint,
}

/// A seeded sequence of points in [0, 1)⁴.
///
/// The low-discrepancy points are one Owen-scrambled Sobol sequence, the same for all streams, moved
/// by a random digital shift of each stream's own (an exclusive or of the digits). The shift keeps
/// every stratum filled, makes each point uniform, and costs a fraction of a scramble.
#[derive(Debug, Clone, Copy)]
pub struct Stream {
    pub(super) shift: [u32; 4],
    points: PointSet,
}

impl Stream {
    /// The stream number `index` (a patch, a pixel, a pair) of `purpose`.
    #[inline]
    pub fn new(seed: u64, purpose: Purpose, index: u64, points: PointSet) -> Self {
        let a = mix(mix(mix(seed) ^ purpose as u64).wrapping_add(index));
        let b = mix(a);
        Stream { shift: [a as u32, (a >> 32) as u32, b as u32, (b >> 32) as u32], points }
    }

    /// The point number `index`, uniform in [0, 1)⁴.
    #[inline(always)]
    pub fn point(&self, index: u32) -> [f32; 4] {
        if self.points == PointSet::Random {
            let seed = mix((self.shift[0] as u64) << 32 | (self.shift[1] ^ index) as u64);
            return sobol_burley::sample_4d(0, 0, (seed >> 32) as u32);
        }
        let [a, b, c, d] = match SOBOL.get(index as usize) {
            Some(digits) => *digits,
            None => sobol_digits(index),
        };
        let [s0, s1, s2, s3] = self.shift;
        // Written out, because `map` is not always inlined.
        [from_digits(a ^ s0), from_digits(b ^ s1), from_digits(c ^ s2), from_digits(d ^ s3)]
    }
}

/// The points that nearly every estimate uses.
static SOBOL: LazyLock<Vec<[u32; 4]>> = LazyLock::new(|| (0..1 << 16).map(sobol_digits).collect());

/// The 24 leading binary digits of a Sobol point's coordinates, which are all that an f32 below 1
/// holds, from the top bit down.
fn sobol_digits(index: u32) -> [u32; 4] {
    // The sequence is defined up to 2¹⁶; beyond, other scrambles of it follow.
    let point = sobol_burley::sample_4d(index & 0xffff, 0, index >> 16);
    point.map(|x| (x * (1 << 24) as f32) as u32 * 256)
}

#[inline]
fn from_digits(digits: u32) -> f32 {
    (digits >> 8) as f32 / (1 << 24) as f32
}

/// Steele, Lea & Flood's SplitMix64 finaliser (OOPSLA 2014): a bijection that avalanches.
pub(super) fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::super::uniformity::{assert_uniform, points, square_counts};
    use super::*;

    #[test]
    fn sobol_points_keep_one_in_every_stratum_under_any_shift() {
        // The first two coordinates of Sobol's sequence are a (0, 2)-sequence in base 2: of its
        // first 2^m points each box of 2^−a × 2^−(m−a) holds one (Niederreiter 1987). A single
        // coordinate is the case a = m. Scrambling and digital shifts keep it.
        let m = 10;
        for seed in 0..4 {
            let points: Vec<_> = points(seed, PointSet::Sobol, 1 << m).collect();
            let strata = |x: f32, bits: u32| (x * (1u32 << bits) as f32) as usize;
            for a in 0..=m {
                let mut filled = vec![false; 1 << m];
                points.iter().for_each(|p| {
                    filled[strata(p[0], a) << (m - a) | strata(p[1], m - a)] = true;
                });
                assert!(filled.iter().all(|&f| f), "seed {seed}: 2^-{a} x 2^-{}", m - a);
            }
            for axis in 2..4 {
                let mut filled = vec![false; 1 << m];
                points.iter().for_each(|p| filled[strata(p[axis], m)] = true);
                assert!(filled.iter().all(|&f| f), "seed {seed}: axis {axis}");
            }
        }
    }

    #[test]
    fn streams_differ_by_seed_purpose_and_index_and_by_nothing_else() {
        let purposes = [Purpose::Pair, Purpose::Hemisphere, Purpose::DirectLight, Purpose::Pixel];
        for set in [PointSet::Sobol, PointSet::Random] {
            let mut starts = Vec::new();
            for seed in [0, 1, 2, 1 << 56, 2 << 56, u64::MAX] {
                for purpose in purposes {
                    for index in [0, 1, 2, 1 << 32, 1 << 56] {
                        let stream = Stream::new(seed, purpose, index, set);
                        let start: Vec<_> =
                            (0..4).map(|k| stream.point(k).map(f32::to_bits)).collect();
                        let again = Stream::new(seed, purpose, index, set);
                        assert_eq!(start[3], again.point(3).map(f32::to_bits));
                        starts.push((start, (seed, purpose, index)));
                    }
                }
            }
            // Two of the 120 streams of 4 × 96 random bits never have equal starts by chance.
            for (i, (a, name)) in starts.iter().enumerate() {
                for (b, other) in &starts[..i] {
                    assert_ne!(a, b, "{set:?}: {name:?} and {other:?} are the same stream");
                }
            }
        }
    }

    #[test]
    fn random_points_are_uniform_and_their_coordinates_and_successors_independent() {
        // The second start lies beyond the 2¹⁶ points for which the Sobol sequence is defined.
        for (seed, start) in [(0, 0), (1, 0), (2, 1 << 16), (3, u32::MAX - (1 << 16))] {
            let stream = Stream::new(seed, Purpose::Pixel, 5, PointSet::Random);
            let points: Vec<_> = (start..start + 65_000).map(|k| stream.point(k)).collect();
            for a in 0..4 {
                for b in 0..4 {
                    let what = format!("seed {seed} from {start}: axis {a} and axis {b} of");
                    if a < b {
                        let same = square_counts(points.iter().map(|p| (p[a], p[b])));
                        assert_uniform(&same, &format!("{what} the same point"));
                    }
                    let next = points.windows(2).map(|p| (p[0][a], p[1][b]));
                    assert_uniform(&square_counts(next), &format!("{what} the next point"));
                }
            }
        }
    }

    #[test]
    fn a_point_of_neighbouring_streams_is_uniform_and_its_coordinates_independent() {
        for set in [PointSet::Random, PointSet::Sobol] {
            for k in [0, 1, 77, 5000, 70_000] {
                let at = |index: u64| Stream::new(9, Purpose::Pair, index, set).point(k);
                let points: Vec<_> = (0..50_000).map(at).collect();
                for a in 0..4 {
                    let what = format!("{set:?} point {k}: axis {a}");
                    let pairs = points.windows(2).map(|p| (p[0][a], p[1][a]));
                    assert_uniform(&square_counts(pairs), &format!("{what} of streams i, i + 1"));
                    for b in 0..a {
                        let pairs = points.iter().map(|p| (p[a], p[b]));
                        assert_uniform(&square_counts(pairs), &format!("{what} and axis {b}"));
                    }
                }
            }
        }
    }

    #[test]
    fn sobol_points_beyond_two_to_the_sixteen_are_new_and_still_stratified() {
        let stream = Stream::new(4, Purpose::Hemisphere, 8, PointSet::Sobol);
        let block =
            |b: u32| -> Vec<_> { (0..1 << 16).map(|k| stream.point(b << 16 | k)).collect() };
        let first = block(0);
        for b in [1, 2, 65_535] {
            let later = block(b);
            for axis in 0..4 {
                let mut filled = vec![false; 1 << 16];
                later.iter().for_each(|p| filled[(p[axis] * 65_536.0) as usize] = true);
                assert!(filled.iter().all(|&f| f), "block {b}, axis {axis}");
            }
            // Two uniform 24-bit coordinates repeat by chance in 65,536 · 2⁻⁴⁸ of cases.
            let same = first.iter().zip(&later).filter(|(a, b)| a[..2] == b[..2]).count();
            assert_eq!(same, 0, "block {b} repeats the first");
            // Set against the first block's, a repetition in another order would line up.
            let pairs = first.iter().zip(&later).map(|(a, b)| (a[0], b[0]));
            assert_uniform(&square_counts(pairs), &format!("block {b} against block 0"));
        }
    }
}
