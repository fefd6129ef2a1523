//! Maps that carry uniform points onto triangles and hemispheres.

use glam::Vec3;
use std::f32::consts::TAU;

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
    use super::super::streams::PointSet;
    use super::super::uniformity::{
        CHANCE, assert_uniform, chi_square, looks_uniform, points, quantile,
    };
    use super::*;

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
}
