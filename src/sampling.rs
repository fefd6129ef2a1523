//! Random and low-discrepancy points, and the maps that carry them onto triangles and hemispheres.
//!
//! Every number is a function of (seed, purpose, index) alone, never of a thread: that is what
//! makes a result the same on 1, 2 or 64 threads.

use glam::Vec3;
use std::f32::consts::TAU;
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
    shift: [u32; 4],
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
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// The uniform map from the unit square to barycentrics (λ₀, λ₁, λ₂) of a triangle; density 1/area.
///
/// Turk, *Generating Random Points in Triangles*, Graphics Gems, 1990: √ξ₀ undoes the triangle's
/// growth with the distance from p₀.
#[inline]
pub fn uniform_triangle(xi0: f32, xi1: f32) -> [f32; 3] {
    let root = xi0.sqrt();
    [1.0 - root, xi1 * root, root * (1.0 - xi1)]
}

/// The centroids of the k² equal triangles into which k lines per side divide a triangle.
pub fn regular_triangle(k: u32) -> Vec<[f32; 3]> {
    let centroid = |i: u32, j: u32, third: f32| {
        let (u, v) = ((i as f32 + third) / k as f32, (j as f32 + third) / k as f32);
        [1.0 - u - v, u, v]
    };
    let mut centroids = Vec::with_capacity((k * k) as usize);
    for i in 0..k {
        for j in 0..k - i {
            centroids.push(centroid(i, j, 1.0 / 3.0));
            if i + j + 1 < k {
                centroids.push(centroid(i, j, 2.0 / 3.0));
            }
        }
    }
    centroids
}

/// A unit direction about the unit `normal`, with density cosθ/π (Malley's method: a uniform point
/// of the disc, lifted to the hemisphere).
#[inline]
pub fn cosine_hemisphere(normal: Vec3, xi0: f32, xi1: f32) -> Vec3 {
    let radius = xi0.sqrt();
    let (sin, cos) = (TAU * xi1).sin_cos();
    let (tangent, bitangent) = orthonormal_basis(normal);
    tangent * (radius * cos) + bitangent * (radius * sin) + normal * (1.0 - xi0).sqrt()
}

/// Two unit vectors that complete the unit `normal` to a right-handed basis. Duff et al.,
/// *Building an Orthonormal Basis, Revisited*, JCGT 6(1), 2017.
#[inline]
pub fn orthonormal_basis(normal: Vec3) -> (Vec3, Vec3) {
    let sign = 1f32.copysign(normal.z);
    let a = -1.0 / (sign + normal.z);
    let b = normal.x * normal.y * a;
    (
        Vec3::new(1.0 + sign * normal.x * normal.x * a, sign * b, -sign * normal.x),
        Vec3::new(b, sign + normal.y * normal.y * a, -normal.y),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::distribution::{ChiSquared, ContinuousCDF};

    /// How rarely a right sampler may be refused, or be as even as a stratified one by chance: as
    /// rarely as a normal variable is 4 standard deviations off.
    const CHANCE: f64 = 6.3e-5;

    /// Σ (count − expected)² / expected, over bins that are equally likely. With some hundred
    /// points per bin it follows the χ² distribution with one degree of freedom less than bins.
    fn chi_square(counts: &[u32]) -> f64 {
        let expected = counts.iter().sum::<u32>() as f64 / counts.len() as f64;
        counts.iter().map(|&n| (n as f64 - expected).powi(2) / expected).sum()
    }

    /// The value that χ² of `bins` bins stays below with probability `p`.
    fn quantile(bins: usize, p: f64) -> f64 {
        ChiSquared::new((bins - 1) as f64).unwrap().inverse_cdf(p)
    }

    fn looks_uniform(counts: &[u32]) -> bool {
        chi_square(counts) < quantile(counts.len(), 1.0 - CHANCE)
    }

    #[track_caller]
    fn assert_uniform(counts: &[u32], what: &str) {
        assert!(
            looks_uniform(counts),
            "{what}: χ² {} of {} bins is above {}; counts {counts:?}",
            chi_square(counts),
            counts.len(),
            quantile(counts.len(), 1.0 - CHANCE)
        );
    }

    /// Rows of the subdivision into equal cells that the triangle tests count in.
    const ROWS: usize = 8;

    /// Counts of ROWS² equal-area cells, or the first point that is not in the triangle.
    fn triangle_counts(points: impl Iterator<Item = [f32; 3]>) -> Result<Vec<u32>, [f32; 3]> {
        let mut counts = vec![0; ROWS * ROWS];
        for l in points {
            // Each λ carries at most 3 roundings of numbers up to 1.
            let sum: f32 = l.iter().sum();
            if l.iter().any(|&x| x < 0.0) || (sum - 1.0).abs() > 4.0 * f32::EPSILON {
                return Err(l);
            }
            // Lines of constant λ₁, λ₂ and λ₀ bound the cells. Row i holds 2(N − i) − 1 of them.
            let scaled = [l[1], l[2]].map(|x| x * ROWS as f32);
            let [i, j] = scaled.map(|x| x as usize);
            let inverted = scaled[0].fract() + scaled[1].fract() >= 1.0;
            let cell = i * (2 * ROWS - i) + 2 * j + inverted as usize;
            counts[cell.min(ROWS * ROWS - 1)] += 1;
        }
        Ok(counts)
    }

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

    fn points(seed: u64, points: PointSet, count: u32) -> impl Iterator<Item = [f32; 4]> {
        let stream = Stream::new(seed, Purpose::Pair, 3, points);
        (0..count).map(move |i| stream.point(i))
    }

    /// 256 points per cell.
    const TRIANGLE_POINTS: u32 = 256 * (ROWS * ROWS) as u32;

    #[test]
    fn random_points_of_a_triangle_are_uniform() {
        for seed in 0..8 {
            let random = || points(seed, PointSet::Random, TRIANGLE_POINTS);
            let first = triangle_counts(random().map(|p| uniform_triangle(p[0], p[1])));
            let second = triangle_counts(random().map(|p| uniform_triangle(p[2], p[3])));
            assert_uniform(&first.unwrap(), &format!("seed {seed}, first point"));
            assert_uniform(&second.unwrap(), &format!("seed {seed}, second point"));
        }
    }

    /// The negative controls: what students write first. The test above must refuse them.
    #[test]
    fn the_classic_mistakes_of_sampling_a_triangle_are_refused() {
        // Half of the points miss the triangle; rescaled to sum to 1 they crowd its middle.
        let three_numbers = |x: f32, y: f32| [x, y, 1.0 - x - y];
        let rescaled = |x: f32, y: f32| {
            let l = [x, y, (1.0 - x - y).abs()];
            l.map(|a| a / l.iter().sum::<f32>())
        };
        // p₀ + ξ₀(p₁ − p₀), then ξ₁ of the way to p₂: short lines get as many points as long ones.
        let towards_far_vertex = |x: f32, y: f32| [(1.0 - x) * (1.0 - y), x * (1.0 - y), y];
        for seed in 0..8 {
            let random = || points(seed, PointSet::Random, TRIANGLE_POINTS);
            let counts = |map: &dyn Fn(f32, f32) -> [f32; 3]| {
                triangle_counts(random().map(|p| map(p[0], p[1])))
            };
            let outside = counts(&three_numbers).expect_err("points outside the triangle");
            assert!(outside[2] < 0.0, "seed {seed}: {outside:?}");
            for (name, map) in [
                ("rescaled", &rescaled as &dyn Fn(f32, f32) -> [f32; 3]),
                ("towards the far vertex", &towards_far_vertex),
            ] {
                assert!(!looks_uniform(&counts(map).unwrap()), "seed {seed}: {name} was accepted");
            }
        }
    }

    #[test]
    fn sobol_points_fill_a_triangle_more_evenly_than_chance() {
        // The uniform map keeps areas, so strata of the square become strata of the triangle.
        for seed in 0..8 {
            let sobol = points(seed, PointSet::Sobol, TRIANGLE_POINTS);
            let counts = triangle_counts(sobol.map(|p| uniform_triangle(p[0], p[1]))).unwrap();
            let (chi, least) = (chi_square(&counts), quantile(counts.len(), CHANCE));
            assert!(chi < least, "seed {seed}: χ² {chi} is not below {least}");
        }
    }

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
    fn regular_points_are_the_centroids_of_equal_cells() {
        for k in [1, 2, 3, 7, ROWS as u32, 32] {
            let centroids = regular_triangle(k);
            assert_eq!(centroids.len(), (k * k) as usize, "k = {k}");
            let mut mean = [0f64; 3];
            for l in &centroids {
                // A cell's centroid is a third of a cell's height away from its sides at least.
                assert!(l.iter().all(|&x| x > 0.3 / k as f32), "k = {k}: {l:?}");
                (0..3).for_each(|axis| mean[axis] += l[axis] as f64 / centroids.len() as f64);
            }
            // Each λ is rounded at most 4 times, by 2⁻²⁴ each.
            assert!(
                mean.iter().all(|m| (m - 1.0 / 3.0).abs() < 4.0 / (1 << 24) as f64),
                "{mean:?}"
            );
            let mut bits: Vec<_> = centroids.iter().map(|l| l.map(f32::to_bits)).collect();
            bits.sort_unstable();
            bits.dedup();
            assert_eq!(bits.len(), centroids.len(), "k = {k}: two centroids are the same");
        }
        let counts = triangle_counts(regular_triangle(ROWS as u32).into_iter()).unwrap();
        assert!(counts.iter().all(|&n| n == 1), "one centroid a cell: {counts:?}");
    }

    /// Axes, both poles and their neighbourhood (where a basis is most likely to break), others.
    fn normals() -> impl Iterator<Item = Vec3> {
        let by_hand = [
            Vec3::X,
            Vec3::Y,
            Vec3::Z,
            Vec3::NEG_X,
            Vec3::NEG_Y,
            Vec3::NEG_Z,
            Vec3::new(1e-4, -1e-4, -1.0),
            Vec3::new(-1e-20, 1e-20, -1.0),
            Vec3::new(3.0, 4.0, -0.0),
            Vec3::new(3.0, -4.0, 1e-30),
            Vec3::new(1e-3, 2e-3, 1.0),
        ];
        let random = points(11, PointSet::Random, 200).map(|p| Vec3::new(p[0], p[1], p[2]) - 0.5);
        by_hand.into_iter().chain(random).map(Vec3::normalize)
    }

    #[test]
    fn a_basis_is_orthonormal_and_right_handed_about_any_normal() {
        // At most 5 roundings of 2⁻²⁴ in a component (below 2 in size), 3 components in a product,
        // and a normal whose own length is off by 2⁻²³: below 16 ε.
        let near = |a: f32, b: f32| (a - b).abs() < 16.0 * f32::EPSILON;
        for n in normals() {
            let (t, b) = orthonormal_basis(n);
            let print =
                || format!("normal {:?} gives {t:?}, {b:?}", n.to_array().map(f32::to_bits));
            for (x, y) in [(t, b), (t, n), (b, n)] {
                assert!(near(x.dot(y), 0.0), "{}", print());
            }
            assert!(near(t.length(), 1.0) && near(b.length(), 1.0), "{}", print());
            assert!((t.cross(b) - n).abs().max_element() < 16.0 * f32::EPSILON, "{}", print());
        }
    }

    #[test]
    fn hemisphere_directions_have_a_cosine_density_about_any_normal() {
        // Of directions with density cosθ/π, sin²θ and the azimuth are uniform and independent:
        // ∫ cosθ sinθ dθ dφ / π = ∫ d(sin²θ) dφ / 2π.
        let (rings, sectors) = (8, 16);
        for (k, n) in normals().take(20).enumerate() {
            // Axes of the test's own.
            let across = n.any_orthonormal_vector();
            let along = n.cross(across);
            let mut counts = vec![0; rings * sectors];
            for [x, y, ..] in points(k as u64, PointSet::Random, 128 * 128) {
                let d = cosine_hemisphere(n, x, y);
                assert!((d.length() - 1.0).abs() < 16.0 * f32::EPSILON, "{n:?}: {d:?}");
                // ξ₀ reaches 1 − 2⁻²⁴, where the cosine, 2⁻¹², is far above the basis's rounding.
                assert!(d.dot(n) > 0.0, "{n:?}: {d:?} at ({x}, {y})");
                let ring = (1.0 - d.dot(n).powi(2)) * rings as f32;
                let turn = d.dot(along).atan2(d.dot(across)) / TAU + 0.5;
                let sector = (turn * sectors as f32) as usize % sectors;
                counts[(ring as usize).min(rings - 1) * sectors + sector] += 1;
            }
            assert_uniform(&counts, &format!("normal {n:?}, seed {k}"));
        }
    }

    #[test]
    fn hemisphere_directions_of_equal_solid_angle_would_be_refused() {
        // The negative control: uniform directions make sin²θ = 1 − cos²θ not uniform.
        let mut counts = [0; 8];
        for [x, ..] in points(1, PointSet::Random, 1 << 14) {
            counts[((1.0 - x * x) * 8.0).min(7.0) as usize] += 1;
        }
        assert!(!looks_uniform(&counts), "{counts:?}");
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

    /// Counts of the 16 × 16 cells of the unit square.
    fn square_counts(pairs: impl Iterator<Item = (f32, f32)>) -> Vec<u32> {
        let mut counts = vec![0; 256];
        for (x, y) in pairs {
            assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y), "({x}, {y})");
            counts[(x * 16.0) as usize * 16 + (y * 16.0) as usize] += 1;
        }
        counts
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
