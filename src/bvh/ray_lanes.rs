//! One ray in all lanes, and its test against eight boxes.

use super::WIDTH;
use super::node::Node;
use crate::geometry::Ray;
use crate::geometry::moller_trumbore::band_scale;
use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};
use glam::Vec3;

/// 1 + 2γ₃: how far rounding can put a box's entry behind its exit, or behind a hit inside it (Ize,
/// *Robust BVH Ray Traversal*, JCGT 2(2), 2013).
pub(super) const STRETCH: f32 = 1.0 + 6.0 * f32::EPSILON / 2.0;

/// A distance moved outwards by as much, wherever it lies.
#[inline(always)]
pub(super) fn stretched<S: Simd>(far: f32x8<S>) -> f32x8<S> {
    far + far.abs() * f32x8::splat(far.simd, STRETCH - 1.0)
}

/// 2⁻⁶⁴: below it directions are lengthened for the box test, to at least 2⁻⁸⁵ for any denormal.
pub(super) const SHORT: f32 = 1.0 / (1u128 << 64) as f32;

/// From a node's eight minima along an axis to its eight maxima.
const MAXIMA: u32 = WIDTH as u32;

/// A ray with what is computed once for all boxes and triangles.
#[derive(Debug, Clone, Copy)]
pub struct PreparedRay {
    pub ray: Ray,
    inverse: Vec3,
    /// Distances to boxes are in units of t times this, 1 but for directions of almost no length.
    pub t_scale: f32,
    /// `t_min` times `t_scale`.
    entry: f32,
    /// Per axis: where the planes that the ray meets first begin among minima and maxima.
    near: [u32; 3],
    /// See [`band_scale`].
    band_scale: f32,
}

impl PreparedRay {
    /// A ray with NaN or infinity in its origin or direction hits nothing, nor does one without an
    /// interval, which a NaN in it makes too; and neither is let near boxes.
    #[inline(always)]
    pub fn can_hit(ray: &Ray) -> bool {
        ray.origin.is_finite() && ray.direction.is_finite() && ray.t_min < ray.t_max
    }

    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        // A direction whose reciprocal would overflow is lengthened; a power of two is exact.
        let is_short = ray.direction.abs().max_element() < SHORT;
        let (t_scale, lengthen) = if is_short { (SHORT, 1.0 / SHORT) } else { (1.0, 1.0) };
        // 1/0 becomes the largest finite number of that sign: products with it may overflow to ±∞,
        // but 0·∞, the only source of NaN in a slab test of finite boxes, cannot occur.
        let lengthened = ray.direction * lengthen;
        let inverse = lengthened.recip().clamp(Vec3::MIN, Vec3::MAX);
        let first = |inverse: f32| inverse.is_sign_negative() as u32 * MAXIMA;
        PreparedRay {
            ray: *ray,
            inverse,
            t_scale,
            entry: ray.t_min * t_scale,
            near: [first(inverse.x), first(inverse.y), first(inverse.z)],
            band_scale: band_scale(ray.direction),
        }
    }
}

/// A ray copied into all lanes.
pub struct RayLanes<'r, S: Simd> {
    pub simd: S,
    pub prepared: &'r PreparedRay,
    pub origin: [f32x8<S>; 3],
    pub direction: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    t_min: f32x8<S>,
    pub band_scale: f32x8<S>,
}

impl<'r, S: Simd> RayLanes<'r, S> {
    #[inline(always)]
    pub fn new(simd: S, prepared: &'r PreparedRay) -> Self {
        RayLanes {
            simd,
            prepared,
            origin: splat(simd, prepared.ray.origin),
            direction: splat(simd, prepared.ray.direction),
            inverse: splat(simd, prepared.inverse),
            t_min: f32x8::splat(simd, prepared.entry),
            band_scale: f32x8::splat(simd, prepared.band_scale),
        }
    }

    /// Which of a node's boxes the ray enters at or before `t_max` (as a bit mask), and where, both
    /// scaled by `t_scale`.
    ///
    /// Stretching the far distance keeps rounding from losing a box that the ray meets.
    #[inline(always)]
    pub(super) fn enter(&self, node: &Node, t_max: f32) -> (mask32x8<S>, f32x8<S>) {
        let [x, y, z] = self.prepared.near;
        let near = self
            .slab(node, 0, x)
            .max(self.slab(node, 1, y))
            .max(self.slab(node, 2, z).max(self.t_min));
        let far = self
            .slab(node, 0, x ^ MAXIMA)
            .min(self.slab(node, 1, y ^ MAXIMA))
            .min(self.slab(node, 2, z ^ MAXIMA).min(f32x8::splat(self.simd, t_max)));
        (near.simd_le(stretched(far)), near)
    }

    /// Where the ray crosses eight boxes' planes.
    #[inline(always)]
    fn slab(&self, node: &Node, axis: usize, first: u32) -> f32x8<S> {
        // It is one of the two; the mask shows that to the compiler, which then checks no bounds.
        let first = (first & MAXIMA) as usize;
        let planes = &node.bounds[axis].as_flattened()[first..first + WIDTH];
        let plane = f32x8::from_slice(self.simd, planes);
        (plane - self.origin[axis]) * self.inverse[axis]
    }
}

// A plain function rather than a closure and `map`: it is inlined whatever the optimiser thinks,
// and code that is not inlined is not compiled for the instruction set.
#[inline(always)]
fn splat<S: Simd>(simd: S, v: Vec3) -> [f32x8<S>; 3] {
    [f32x8::splat(simd, v.x), f32x8::splat(simd, v.y), f32x8::splat(simd, v.z)]
}
