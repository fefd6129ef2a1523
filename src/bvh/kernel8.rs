//! The intersection kernels on eight lanes: a ray and eight triangles, or eight rays and a triangle.

use super::leaf::Leaf;
use super::met::Met;
use super::packet::Packet;
use super::ray_lanes::RayLanes;
use crate::geometry::moller_trumbore::{determinants, intersect_seam};
use crate::geometry::{Kernel, MollerTrumbore, Plane, Ray};
use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};

/// A kernel that can answer for eight pairs of a ray and a triangle at once: exactly the answers of
/// [`Kernel::intersect`], which the bodies here give one after the other.
pub trait LeafKernel: Kernel {
    /// Which of a leaf's triangles the ray hits in (`t_min`, `t_max`], and where.
    #[inline(always)]
    fn intersect_leaf<S: Simd>(ray: &RayLanes<S>, t_max: f32, leaf: Leaf) -> Met<S> {
        let all = (1 << leaf.count) - 1;
        let ray_to_end = Ray { t_max, ..ray.prepared.ray };
        Met::none(ray.simd)
            .with(ray.simd, all, |lane| Self::intersect(&ray_to_end, leaf.triangle(lane)))
    }

    /// Which of the `active` rays hit a triangle of the leaf in (`t_min`, `t_max`], and where.
    #[inline(always)]
    fn intersect_packet<S: Simd>(
        rays: &Packet<S>,
        t_max: f32x8<S>,
        active: u64,
        leaf: Leaf,
        number: usize,
    ) -> Met<S> {
        let triangle = leaf.triangle(number);
        Met::none(rays.simd)
            .with(rays.simd, active, |lane| Self::intersect(&rays.ray(lane, t_max), triangle))
    }

    /// Asks the `active` rays of a packet about each triangle of a leaf, and returns whether one found something.
    #[inline(always)]
    fn meet_leaf<S: Simd, const ANY: bool>(rays: &mut Packet<S>, active: u64, leaf: Leaf) -> bool {
        // Chosen in a copy: the compiler would store what it chooses lane by lane with a mask, which takes processors
        // without AVX-512 a dozen cycles.
        let mut found = rays.found;
        let mut has_met = false;
        let mut number = 0;
        while number < leaf.count {
            let met = Self::intersect_packet(rays, found.t_max, active, leaf, number);
            if met.lanes.any_true() {
                found.keep::<ANY>(leaf.rank(number), &met);
                has_met = true;
            }
            number += 1;
        }
        rays.found = found;
        has_met
    }
}

impl LeafKernel for Plane {}

impl LeafKernel for MollerTrumbore {
    #[inline(always)]
    fn intersect_leaf<S: Simd>(ray: &RayLanes<S>, t_max: f32, leaf: Leaf) -> Met<S> {
        let simd = ray.simd;
        let pairs = Pairs {
            origin: ray.origin,
            direction: ray.direction,
            p0: leaf.vectors(simd, 0),
            e1: leaf.vectors(simd, 1),
            e2: leaf.vectors(simd, 2),
            reach: leaf.reaches(simd),
            band_scale: ray.band_scale,
            t_min: f32x8::splat(simd, ray.prepared.ray.t_min),
            t_max: f32x8::splat(simd, t_max),
        };
        let (met, seams) = pairs.intersect::<false>(simd, (1 << leaf.count) - 1);
        if seams == 0 {
            return met;
        }
        let ray = Ray { t_max, ..ray.prepared.ray };
        met.with(simd, seams, |lane| intersect_seam(&ray, leaf.triangle(lane)))
    }

    #[inline(always)]
    fn intersect_packet<S: Simd>(
        rays: &Packet<S>,
        t_max: f32x8<S>,
        active: u64,
        leaf: Leaf,
        number: usize,
    ) -> Met<S> {
        let simd = rays.simd;
        let pairs = Pairs {
            origin: rays.origin,
            direction: rays.direction,
            p0: leaf.vector(simd, 0, number),
            e1: leaf.vector(simd, 1, number),
            e2: leaf.vector(simd, 2, number),
            reach: f32x8::splat(simd, leaf.reach(number)),
            band_scale: rays.band_scale,
            t_min: rays.t_min,
            t_max,
        };
        let (met, seams) = pairs.intersect::<true>(simd, active);
        if seams == 0 {
            return met;
        }
        met.with(simd, seams, |lane| intersect_seam(&rays.ray(lane, t_max), leaf.triangle(number)))
    }
}

/// Eight pairs of a ray and a triangle, as [`MollerTrumbore`] takes them.
struct Pairs<S: Simd> {
    origin: [f32x8<S>; 3],
    direction: [f32x8<S>; 3],
    p0: [f32x8<S>; 3],
    e1: [f32x8<S>; 3],
    e2: [f32x8<S>; 3],
    reach: f32x8<S>,
    band_scale: f32x8<S>,
    t_min: f32x8<S>,
    t_max: f32x8<S>,
}

impl<S: Simd> Pairs<S> {
    /// Which of the pairs in `lanes` meet, and which f32 cannot decide: operation for operation
    /// what [`MollerTrumbore::intersect`](Kernel::intersect) does.
    #[inline(always)]
    fn intersect<const STOP: bool>(&self, simd: S, lanes: u64) -> (Met<S>, u64) {
        let d = determinants(self.origin, self.direction, self.p0, self.e1, self.e2);
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let sign = one.copysign(d.det);
        let (det, u, v) = (d.det * sign, d.u * sign, d.v * sign);
        let w = det - u - v;
        let far = (self.origin[0] - self.p0[0])
            .abs()
            .max((self.origin[1] - self.p0[1]).abs())
            .max((self.origin[2] - self.p0[2]).abs());
        let band = (far * f32x8::splat(simd, 2.0) + self.reach) * self.reach * self.band_scale;
        let below = zero - band;

        // If u or v is NaN so is w, and w is compared by itself.
        let least = u.min(v);
        let decided = det.simd_gt(band);
        let possible = least.simd_ge(below) & w.simd_ge(below);
        let candidates = (possible | !decided).to_bitmask() & lanes;
        if STOP && candidates == 0 {
            return (Met::none(simd), 0);
        }
        let inside = decided & least.simd_gt(band) & w.simd_gt(band);
        let t = d.t * sign / det;
        // Where products overflow, an infinite t is no hit.
        let early = t.simd_le(self.t_max.min(f32x8::splat(simd, f32::MAX)));
        let hit = inside & t.simd_gt(self.t_min) & early & mask32x8::from_bitmask(simd, lanes);
        let seams = candidates & !inside.to_bitmask();
        (Met { lanes: hit, t, u, v, det }, seams)
    }
}
