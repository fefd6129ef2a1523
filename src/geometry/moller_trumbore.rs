//! Option 2: Möller and Trumbore, *Fast, Minimum Storage Ray/Triangle Intersection*, JGT 2(1), 1997.
//!
//! Putting the ray into the parametric triangle gives three linear equations in t, u and v,
//!
//! ```text
//! o + t·d = p₀ + u·e₁ + v·e₂,      s = o − p₀,
//! ```
//!
//! which Cramer's rule solves with four triple products that share two cross products.

use super::{Kernel, Ray, Triangle};
use std::ops::{Add, Mul, Sub};

/// The default kernel.
#[derive(Debug, Clone, Copy, Default)]
pub struct MollerTrumbore;

/// Cramer's determinants: t, u and v are `t / det`, `u / det` and `v / det`.
#[derive(Debug, Clone, Copy)]
pub struct Determinants<T> {
    pub det: T,
    pub t: T,
    pub u: T,
    pub v: T,
}

/// The arithmetic of the paper's §2.3, once for one triangle (`f32`) and for eight (SIMD lanes).
///
/// Only sums, differences and products, none of them fused: the same bits on every processor.
#[inline(always)]
pub fn determinants<T>(
    origin: [T; 3],
    direction: [T; 3],
    p0: [T; 3],
    e1: [T; 3],
    e2: [T; 3],
) -> Determinants<T>
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    let s = [origin[0] - p0[0], origin[1] - p0[1], origin[2] - p0[2]];
    let d_cross_e2 = cross(direction, e2);
    let s_cross_e1 = cross(s, e1);
    Determinants {
        det: dot(d_cross_e2, e1),
        t: dot(s_cross_e1, e2),
        u: dot(d_cross_e2, s),
        v: dot(s_cross_e1, direction),
    }
}

#[inline(always)]
fn cross<T: Copy + Sub<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot<T: Copy + Add<Output = T> + Mul<Output = T>>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl Kernel for MollerTrumbore {
    #[inline]
    fn intersect(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)> {
        let (e1, e2) = triangle.edges();
        let d = determinants(
            ray.origin.to_array(),
            ray.direction.to_array(),
            triangle.p[0].to_array(),
            e1.to_array(),
            e2.to_array(),
        );
        // Divided only at the end: det's sign moves to the numerators, which is exact. A NaN fails,
        // since each test asks for what must hold.
        let sign = 1f32.copysign(d.det);
        let (det, u, v) = (d.det * sign, d.u * sign, d.v * sign);
        if !(det > 0.0 && u >= 0.0 && v >= 0.0 && u + v <= det) {
            return None;
        }
        let t = d.t * sign / det;
        // Where products overflow, an infinite t is no hit.
        (t > ray.t_min && t <= ray.t_max.min(f32::MAX)).then_some((t, u / det, v / det))
    }
}
