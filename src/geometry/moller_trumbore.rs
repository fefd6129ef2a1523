//! Option 2: Möller and Trumbore, *Fast, Minimum Storage Ray/Triangle Intersection*, JGT 2(1), 1997.
//!
//! Putting the ray into the parametric triangle gives three linear equations in t, u and v,
//!
//! ```text
//! o + t·d = p₀ + u·e₁ + v·e₂,      s = o − p₀,
//! ```
//!
//! which Cramer's rule solves with four triple products that share two cross products. Where f32
//! cannot tell on which side of an edge the ray passes, that is decided exactly.

use super::{Kernel, Ray, Triangle};
use glam::DVec3;
use robust::{Coord3D, orient3d};
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
        let w = det - u - v;
        let far = (ray.origin - triangle.p[0]).abs();
        let reach = triangle.reach();
        let band = (far.x.max(far.y).max(far.z) * 2.0 + reach) * reach * band_scale(ray.direction);
        if det > band {
            if !(u >= -band && v >= -band && w >= -band) {
                return None;
            }
            if u > band && v > band && w > band {
                let t = d.t * sign / det;
                // Where products overflow, an infinite t is no hit.
                return (t > ray.t_min && t <= ray.t_max && t <= f32::MAX).then_some((
                    t,
                    u / det,
                    v / det,
                ));
            }
        }
        if reach > 0.0 { intersect_seam(ray, triangle) } else { None }
    }
}

/// Within this factor of (2|s| + |e|)·|e|, all largest components, f32 cannot tell the sign of a
/// determinant: γ₉ ≈ 9·2⁻²⁴ bounds the rounding in each of its 6 products and in w = det − u − v, and
/// 6·9 < 64.
#[inline(always)]
pub fn band_scale(direction: glam::Vec3) -> f32 {
    direction.abs().max_element() * (64.0 * f32::EPSILON / 2.0)
}

/// Intersects where f32 cannot decide: a ray near an edge, or near the triangle's plane.
///
/// The vertices relative to the origin are taken in f64, alike in all triangles that share them; on
/// which side of an edge the ray passes is then decided exactly. So no ray passes between triangles,
/// and one exactly on an edge hits both (the idea of Woop, Benthin & Wald, *Watertight Ray/Triangle
/// Intersection*, JCGT 2(1), 2013). Signs of f64 would not do: rounded alike for both triangles of an
/// edge, they still may contradict each other around a vertex, and let 26 of 100,000 rays aimed at seams
/// out of a closed cube askew in space.
#[cold]
pub fn intersect_seam(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)> {
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let [a, b, c] = triangle.p.map(|p| p.as_dvec3() - o);
    let (u, v, w) = (volume(d, c, a), volume(d, a, b), volume(d, b, c));
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    let sum = u + v + w;
    // From the edges: n·d = u + v + w cancels if the triangle is far away.
    let normal = (b - a).cross(c - a);
    let t = (normal.dot(a) / normal.dot(d)) as f32;
    let in_interval = t > ray.t_min && t <= ray.t_max && t <= f32::MAX;
    let hit = inside && sum != 0.0 && in_interval;
    hit.then_some((t, (u / sum) as f32, (v / sum) as f32))
}

/// a·(b × c), with the exact sign (Shewchuk, *Adaptive Precision Floating-Point Arithmetic and Fast
/// Robust Geometric Predicates*, 1997).
pub fn volume(a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let [a, b, c, zero] = [a, b, c, DVec3::ZERO].map(|DVec3 { x, y, z }| Coord3D { x, y, z });
    orient3d(a, b, c, zero)
}
