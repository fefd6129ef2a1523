//! Random and low-discrepancy points, and the maps that carry them onto triangles and hemispheres.
//!
//! Every number is a function of (seed, purpose, index) alone, never of a thread: that is what
//! makes a result the same on 1, 2 or 64 threads.

use glam::Vec3;
use std::f32::consts::TAU;
use std::sync::LazyLock;

/// How the points of one estimate are placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PointSet {
    /// Owen-scrambled Sobol points: their error falls faster than N^(−1/2) on smooth integrands.
    #[default]
    Sobol,
    /// Independent uniform points: their error falls as N^(−1/2), as the textbook says.
    Random,
    /// The centroids of a regular subdivision: cheap, deterministic, and biased by its grid.
    Regular,
}

/// What a stream of numbers is used for, so that no two uses share their numbers.
#[derive(Debug, Clone, Copy)]
pub enum Purpose {
    Pair = 1,
    Hemisphere,
    DirectLight,
    Pixel,
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
    #[inline]
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
        [a ^ s0, b ^ s1, c ^ s2, d ^ s3].map(from_digits)
    }
}

/// The points that nearly every estimate uses.
static SOBOL: LazyLock<Vec<[u32; 4]>> = LazyLock::new(|| (0..4096).map(sobol_digits).collect());

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

/// The centroids of the k² equal triangles into which k lines a side divide a triangle.
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
