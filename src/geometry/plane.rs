//! Option 1: meet the triangle's plane, then ask where in the triangle the meeting point lies.
//!
//! The classic two steps (Badouel, *An Efficient Ray–Polygon Intersection*, Graphics Gems, 1990):
//! the point's barycentrics follow from two of its three coordinates; the axis in which the normal
//! is largest is dropped, so that the triangle's projection does not collapse.

use super::{Kernel, Ray, Triangle};

/// The kernel of the textbooks, for comparison with [`MollerTrumbore`](super::MollerTrumbore).
#[derive(Debug, Clone, Copy, Default)]
pub struct Plane;

impl Kernel for Plane {
    fn intersect(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)> {
        let p0 = triangle.p[0];
        let (e1, e2) = triangle.edges();
        let normal = e1.cross(e2);

        // The plane: normal · (o + t·d − p₀) = 0. A NaN or infinite t fails here.
        let t = normal.dot(p0 - ray.origin) / normal.dot(ray.direction);
        if !(t > ray.t_min && t <= ray.t_max && t.is_finite()) {
            return None;
        }

        // The triangle: q = u·e₁ + v·e₂ in the two coordinates (a, b) that are kept.
        let q = ray.at(t) - p0;
        let dropped = largest_axis(normal);
        let (a, b) = ((dropped + 1) % 3, (dropped + 2) % 3);
        let u = (q[a] * e2[b] - q[b] * e2[a]) / normal[dropped];
        let v = (e1[a] * q[b] - e1[b] * q[a]) / normal[dropped];
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then_some((t, u, v))
    }
}

fn largest_axis(v: glam::Vec3) -> usize {
    let v = v.abs();
    if v.x >= v.y && v.x >= v.z {
        0
    } else if v.y >= v.z {
        1
    } else {
        2
    }
}
