//! Convex polygons in a plane, in double precision, seen along the axis that is nearest to the plane's normal.

use crate::geometry::Triangle;
use glam::{DVec2, DVec3, Vec3};

/// Corners in counter-clockwise order.
pub(in crate::scene) type Polygon = Vec<DVec2>;

/// The axis of the largest component of a normal, of any length.
pub(in crate::scene) fn axis_of(normal: DVec3) -> usize {
    let n = normal.abs();
    if n.x >= n.y && n.x >= n.z {
        0
    } else if n.y >= n.z {
        1
    } else {
        2
    }
}

/// A triangle seen along an axis.
pub(in crate::scene) fn seen_along(axis: usize, triangle: &Triangle) -> [DVec2; 3] {
    let corner = |k: usize| flatten(axis, triangle.p[k].as_dvec3());
    let mut corners = [corner(0), corner(1), corner(2)];
    if signed_area(&corners) < 0.0 {
        corners.swap(1, 2);
    }
    corners
}

pub(in crate::scene) fn flatten(axis: usize, p: DVec3) -> DVec2 {
    match axis {
        0 => DVec2::new(p.y, p.z),
        1 => DVec2::new(p.z, p.x),
        _ => DVec2::new(p.x, p.y),
    }
}

/// The coordinate along the axis of a triangle's plane at a point.
pub(in crate::scene) fn height_at(axis: usize, triangle: &Triangle, point: DVec2) -> f64 {
    let p0 = triangle.p[0].as_dvec3();
    let n = triangle.double_area_normal();
    let away = point - flatten(axis, p0);
    p0[axis] - flatten(axis, n).dot(away) / n[axis]
}

/// Whether some edge of one of two triangles has the other one outside, or inside by no more than `rim`.
pub(in crate::scene) fn are_apart(a: &[DVec2; 3], b: &[DVec2; 3], rim: f64) -> bool {
    let separates = |(a, b): (&[DVec2; 3], &[DVec2; 3])| {
        (0..3).any(|k| {
            let (from, along) = (a[k], a[(k + 1) % 3] - a[k]);
            let inside = b.iter().map(|&p| along.perp_dot(p - from)).fold(f64::MIN, f64::max);
            // Neighbours have nothing inside, and no root is needed for them.
            inside <= 0.0 || inside <= rim * along.length()
        })
    };
    [(a, b), (b, a)].into_iter().any(separates)
}

/// (u, v) of the point of a triangle's plane that is seen at `point`; `None` beside the triangle.
pub(in crate::scene) fn barycentrics(
    axis: usize,
    triangle: &Triangle,
    point: Vec3,
) -> Option<[f32; 2]> {
    let [a, b, c] = triangle.p.map(|p| flatten(axis, p.as_dvec3()));
    let p = flatten(axis, point.as_dvec3()) - a;
    let whole = (b - a).perp_dot(c - a);
    let (u, v) = (p.perp_dot(c - a) / whole, (b - a).perp_dot(p) / whole);
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some([u as f32, v as f32])
}

/// The part of a polygon that lies in a convex one.
pub(in crate::scene) fn common(polygon: &[DVec2], with: &[DVec2]) -> Polygon {
    edges(with).fold(polygon.to_vec(), |rest, (a, b)| left_of(&rest, a, b - a))
}

/// The parts of a polygon that do not lie in a convex one, but for those that rounding makes.
pub(in crate::scene) fn without(polygon: Polygon, convex: &[DVec2]) -> Vec<Polygon> {
    let tiny = 1e-12 * area(&polygon);
    if area(&common(&polygon, convex)) <= tiny {
        return vec![polygon];
    }
    let (mut rest, mut outside) = (polygon, Vec::new());
    for (a, b) in edges(convex) {
        let part = left_of(&rest, b, a - b);
        rest = left_of(&rest, a, b - a);
        if area(&part) > tiny {
            outside.push(part);
        }
    }
    outside
}

/// The least and the largest coordinates.
pub(in crate::scene) fn bounds(polygon: &[DVec2]) -> (DVec2, DVec2) {
    polygon.iter().fold((DVec2::MAX, DVec2::MIN), |(low, high), p| (low.min(*p), high.max(*p)))
}

pub(in crate::scene) fn area(polygon: &[DVec2]) -> f64 {
    signed_area(polygon).max(0.0)
}

pub(in crate::scene) fn perimeter(polygon: &[DVec2]) -> f64 {
    edges(polygon).map(|(a, b)| a.distance(b)).sum()
}

fn signed_area(polygon: &[DVec2]) -> f64 {
    let Some(&origin) = polygon.first() else { return 0.0 };
    0.5 * edges(polygon).map(|(a, b)| (a - origin).perp_dot(b - origin)).sum::<f64>()
}

fn edges(polygon: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
    let next = polygon.iter().skip(1).chain(polygon.first());
    polygon.iter().copied().zip(next.copied())
}

/// The part of a convex polygon to the left of a line that runs through `from` along `along` (Sutherland & Hodgman,
/// "Reentrant Polygon Clipping", 1974).
pub(super) fn left_of(polygon: &[DVec2], from: DVec2, along: DVec2) -> Polygon {
    let side = |p: DVec2| along.perp_dot(p - from);
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (p, q) in edges(polygon) {
        let (from, to) = (side(p), side(q));
        if from >= 0.0 {
            kept.push(p);
        }
        if (from > 0.0 && to < 0.0) || (from < 0.0 && to > 0.0) {
            kept.push(p.lerp(q, from / (from - to)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Polygon {
        let at = |u, v| DVec2::new(x + u * side, y + v * side);
        vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]
    }

    #[test]
    fn what_is_common_and_what_is_not_make_up_the_whole() {
        for (other, shared) in [
            (square(1.0, 1.0, 2.0), 1.0),
            (square(0.5, 0.5, 1.0), 1.0),
            (square(-1.0, -1.0, 9.0), 4.0),
            (square(2.0, 0.0, 1.0), 0.0),
            (square(5.0, 0.0, 1.0), 0.0),
        ] {
            let whole = square(0.0, 0.0, 2.0);
            assert_eq!(area(&common(&whole, &other)), shared);
            let rest: f64 = without(whole, &other).iter().map(|part| area(part)).sum();
            assert_eq!(rest, 4.0 - shared, "{other:?}");
        }
    }

    #[test]
    fn a_plane_has_its_height() {
        let triangle =
            Triangle::new(Vec3::ZERO, Vec3::new(1.0, 0.0, 2.0), Vec3::new(0.0, 1.0, 4.0));
        assert_eq!(axis_of(triangle.double_area_normal()), 1);
        for axis in [0, 1, 2] {
            let p = triangle.at(0.25, 0.5).as_dvec3();
            assert!((height_at(axis, &triangle, flatten(axis, p)) - p[axis]).abs() < 1e-12);
            assert!(
                (area(&seen_along(axis, &triangle))
                    - 0.5 * triangle.double_area_normal()[axis].abs())
                    < 1e-12
            );
        }
    }
}
