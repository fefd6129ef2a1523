//! The expected hit of a ray of integers, computed in integers.

use crate::geometry::{Hit, Ray, Triangle, TriangleId};
use glam::Vec3;

type Vector = [i64; 3];

/// The nearest hit; of several at the same f32 t that of the lowest triangle.
pub(super) fn nearest(ray: &Ray, triangles: &[Triangle]) -> Option<Hit> {
    let hits = triangles.iter().enumerate().filter_map(|(index, triangle)| {
        let [t, u, v] = meet(ray, triangle)?;
        Some(Hit { triangle: TriangleId(index as u32), t, u, v })
    });
    hits.reduce(|nearest, hit| if hit.t < nearest.t { hit } else { nearest })
}

/// (t, u, v) correctly rounded, including edges and vertices; `None` also in the triangle's plane.
///
/// u, v and w are, up to one factor, the volumes that the ray spans with the edges opposite to them:
/// another way to them than the kernel's.
pub(super) fn meet(ray: &Ray, triangle: &Triangle) -> Option<[f32; 3]> {
    let (o, d) = (integers(ray.origin), integers(ray.direction));
    let [a, b, c] = triangle.p.map(|p| minus(integers(p), o));
    let [u, v, w] = [(c, a), (a, b), (b, c)].map(|(p, q)| dot(d, cross(p, q)));
    let sum = u + v + w;
    let inside = (u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0);
    if sum == 0 || !inside {
        return None;
    }
    let normal = cross(minus(b, a), minus(c, a));
    let t = quotient(dot(normal, a), dot(normal, d));
    (t > ray.t_min && t <= ray.t_max).then(|| [t, quotient(u, sum), quotient(v, sum)])
}

/// Correctly rounded: f64 has more than the 2·24 + 2 bits that make a second rounding of a quotient
/// harmless (Figueroa, *When is Double Rounding Innocuous?*, SIGNUM Newsletter 30(3), 1995).
fn quotient(numerator: i64, denominator: i64) -> f32 {
    (numerator as f64 / denominator as f64) as f32
}

fn integers(v: Vec3) -> Vector {
    v.to_array().map(|x| x as i64)
}

fn minus(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: Vector, b: Vector) -> i64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_and_vertices_belong_to_a_triangle_and_its_plane_does_not() {
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X * 6.0, Vec3::Y * 6.0);
        let down = |x, y| meet(&Ray::new(Vec3::new(x, y, 3.0), Vec3::NEG_Z * 2.0), &triangle);
        assert_eq!(down(2.0, 0.0), Some([1.5, 1.0 / 3.0, 0.0]));
        assert_eq!(down(6.0, 0.0), Some([1.5, 1.0, 0.0]));
        assert_eq!(down(2.0, 4.0), Some([1.5, 1.0 / 3.0, 2.0 / 3.0]));
        assert_eq!(down(4.0, 4.0), None);
        assert_eq!(meet(&Ray::new(Vec3::NEG_X, Vec3::X), &triangle), None);
    }

    #[test]
    fn the_lowest_of_the_nearest_is_expected() {
        let at = |z: f32| Triangle { p: [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * z) };
        let ray = Ray::new(Vec3::ZERO, Vec3::Z);
        let hit = nearest(&ray, &[at(5.0), at(2.0), at(2.0)]).expect("a hit");
        assert_eq!((hit.triangle, hit.t), (TriangleId(1), 2.0));
        assert_eq!(nearest(&Ray { t_max: 1.0, ..ray }, &[at(2.0)]), None);
        assert!(nearest(&Ray { t_max: 2.0, ..ray }, &[at(2.0)]).is_some());
        assert_eq!(nearest(&Ray { t_min: 2.0, ..ray }, &[at(2.0)]), None);
    }
}
