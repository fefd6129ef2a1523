//! Eight rays, one per lane: what is known of them, and which of them enter a box.

use super::WIDTH;
use super::leaf::{NO_RANK, id_of};
use super::met::Met;
use super::node::Node;
use super::ray_lanes::{SHORT, stretched};
use crate::geometry::{Hit, Ray};
use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};
use glam::Vec3;

/// Eight rays, one per lane, and what they have found.
pub struct Packet<S: Simd> {
    pub simd: S,
    pub origin: [f32x8<S>; 3],
    pub direction: [f32x8<S>; 3],
    /// See [`PreparedRay`](super::ray_lanes::PreparedRay).
    pub inverse: [f32x8<S>; 3],
    /// Per axis, which of (min, max) all rays meet first; nothing unless they agree along every axis.
    pub near: Option<[usize; 3]>,
    pub t_scale: f32x8<S>,
    pub band_scale: f32x8<S>,
    pub t_min: f32x8<S>,
    pub found: Found<S>,
}

/// The nearest hits of eight rays so far.
#[derive(Clone, Copy)]
pub struct Found<S: Simd> {
    /// The ray's end, or its nearest hit so far.
    pub t_max: f32x8<S>,
    pub u: f32x8<S>,
    pub v: f32x8<S>,
    /// The rank of the triangle that was hit.
    pub rank: f32x8<S>,
}

/// Origin, direction, t_min and t_max of eight rays. Each of three perfect shuffles moves every number's
/// place by one bit, from the row's three to the column's.
#[inline(always)]
pub(super) fn columns<S: Simd>(simd: S, rays: [Ray; WIDTH]) -> [f32x8<S>; 8] {
    let mut rows = rays.map(|Ray { origin: o, direction: d, t_min, t_max }| {
        f32x8::load_array(simd, [o.x, o.y, o.z, d.x, d.y, d.z, t_min, t_max])
    });
    let mut round = 0;
    while round < 3 {
        let [a, b, c, d, e, f, g, h] = rows;
        let low = [a.zip_low(e), b.zip_low(f), c.zip_low(g), d.zip_low(h)];
        let high = [a.zip_high(e), b.zip_high(f), c.zip_high(g), d.zip_high(h)];
        rows = [low[0], high[0], low[1], high[1], low[2], high[2], low[3], high[3]];
        round += 1;
    }
    rows
}

/// The largest component of eight directions.
#[inline(always)]
pub(super) fn longest<S: Simd>(direction: [f32x8<S>; 3]) -> f32x8<S> {
    direction[0].abs().max(direction[1].abs()).max(direction[2].abs())
}

/// Per axis, which of (min, max) rays with these inverse directions meet first, if they agree.
#[inline(always)]
fn near_sides<S: Simd>(inverse: [f32x8<S>; 3]) -> Option<[usize; 3]> {
    let mut sides = [0; 3];
    let mut axis = 0;
    while axis < 3 {
        let lanes = inverse[axis];
        let back = lanes.simd_lt(f32x8::splat(lanes.simd, 0.0));
        if back.any_true() != back.all_true() {
            return None;
        }
        sides[axis] = back.any_true() as usize;
        axis += 1;
    }
    Some(sides)
}

/// See [`moller_trumbore::band_scale`](crate::geometry::moller_trumbore::band_scale).
#[inline(always)]
pub(super) fn band_scale<S: Simd>(longest: f32x8<S>) -> f32x8<S> {
    longest * f32x8::splat(longest.simd, 64.0 * f32::EPSILON / 2.0)
}

impl<S: Simd> Packet<S> {
    /// From the [`columns`] of eight rays.
    #[inline(always)]
    pub fn new(simd: S, columns: [f32x8<S>; 8]) -> Self {
        let [ox, oy, oz, dx, dy, dz, t_min, t_max] = columns;
        let direction = [dx, dy, dz];
        let longest = longest(direction);
        // As for one ray: see `PreparedRay::new`.
        let (one, short) = (f32x8::splat(simd, 1.0), f32x8::splat(simd, SHORT));
        let is_short = longest.simd_lt(short);
        let t_scale = is_short.select(short, one);
        let lengthen = is_short.select(f32x8::splat(simd, 1.0 / SHORT), one);
        let (low, high) = (f32x8::splat(simd, f32::MIN), f32x8::splat(simd, f32::MAX));
        let inverse = |d: f32x8<S>| (one / (d * lengthen)).max(low).min(high);
        let inverse = [inverse(dx), inverse(dy), inverse(dz)];
        let zero = f32x8::splat(simd, 0.0);
        Packet {
            simd,
            origin: [ox, oy, oz],
            direction,
            inverse,
            near: near_sides(inverse),
            t_scale,
            band_scale: band_scale(longest),
            t_min,
            found: Found { t_max, u: zero, v: zero, rank: f32x8::splat(simd, NO_RANK) },
        }
    }

    /// The ray in a lane, up to its `t_max`.
    #[cold]
    pub fn ray(&self, lane: usize, t_max: f32x8<S>) -> Ray {
        let number = |lanes: f32x8<S>| <[f32; WIDTH]>::from(lanes)[lane];
        let vector = |v: [f32x8<S>; 3]| Vec3::new(number(v[0]), number(v[1]), number(v[2]));
        Ray {
            origin: vector(self.origin),
            direction: vector(self.direction),
            t_min: number(self.t_min),
            t_max: number(t_max),
        }
    }

    /// The nearest hit so far of the ray in a lane.
    #[inline(always)]
    pub fn hit(&self, lane: usize) -> Option<Hit> {
        let number = |lanes: &f32x8<S>| lanes.as_array()[lane];
        let rank = number(&self.found.rank);
        (rank < NO_RANK).then(|| Hit {
            triangle: id_of(rank),
            t: number(&self.found.t_max),
            u: number(&self.found.u),
            v: number(&self.found.v),
        })
    }

    #[inline(always)]
    pub fn hits(&self) -> [Option<Hit>; WIDTH] {
        let rank: [f32; WIDTH] = self.found.rank.into();
        let t: [f32; WIDTH] = self.found.t_max.into();
        let u: [f32; WIDTH] = self.found.u.into();
        let v: [f32; WIDTH] = self.found.v.into();
        let mut hits = [None; WIDTH];
        let mut lane = 0;
        while lane < WIDTH {
            if rank[lane] < NO_RANK {
                let triangle = id_of(rank[lane]);
                hits[lane] = Some(Hit { triangle, t: t[lane], u: u[lane], v: v[lane] });
            }
            lane += 1;
        }
        hits
    }

    /// The rays that have found nothing, as a mask.
    #[inline(always)]
    pub(super) fn searching(&self) -> u64 {
        self.found.rank.simd_ge(f32x8::splat(self.simd, NO_RANK)).to_bitmask()
    }

    /// The rays' intervals in the units of distances to boxes.
    #[inline(always)]
    pub(super) fn interval(&self) -> [f32x8<S>; 2] {
        [self.t_min * self.t_scale, self.found.t_max * self.t_scale]
    }

    /// Which of the rays enter a node's box number `slot` in their `interval`.
    #[inline(always)]
    pub(super) fn enter(
        &self,
        node: &Node,
        slot: usize,
        interval: [f32x8<S>; 2],
    ) -> (mask32x8<S>, f32x8<S>) {
        let simd = self.simd;
        let [mut near, mut far] = interval;
        let plane = |axis: usize, side: usize| {
            let plane = f32x8::splat(simd, node.bounds[axis][side & 1][slot]);
            (plane - self.origin[axis]) * self.inverse[axis]
        };
        let mut axis = 0;
        if let Some(near_sides) = self.near {
            while axis < 3 {
                near = near.max(plane(axis, near_sides[axis]));
                far = far.min(plane(axis, 1 - (near_sides[axis] & 1)));
                axis += 1;
            }
        } else {
            while axis < 3 {
                let (a, b) = (plane(axis, 0), plane(axis, 1));
                near = near.max(a.min(b));
                far = far.min(a.max(b));
                axis += 1;
            }
        }
        (near.simd_le(stretched(far)), near)
    }

    /// The rays that can still find something at `entry` or beyond, as a mask.
    #[inline(always)]
    pub(super) fn reaching(&self, entry: f32) -> u64 {
        let last = stretched(self.found.t_max * self.t_scale);
        last.simd_ge(f32x8::splat(self.simd, entry)).to_bitmask()
    }
}

impl<S: Simd> Found<S> {
    /// Keeps hits that are nearer, or as near and of a lower triangle. If `ANY`, keeps only that there is
    /// a hit.
    #[inline(always)]
    pub fn keep<const ANY: bool>(&mut self, rank: f32, met: &Met<S>) {
        let rank = f32x8::splat(self.rank.simd, rank);
        if ANY {
            self.rank = met.lanes.select(rank, self.rank);
            return;
        }
        let as_near = met.t.simd_le(self.t_max) & rank.simd_lt(self.rank);
        let take = met.lanes & (met.t.simd_lt(self.t_max) | as_near);
        self.t_max = take.select(met.t, self.t_max);
        self.u = take.select(met.u / met.det, self.u);
        self.v = take.select(met.v / met.det, self.v);
        self.rank = take.select(rank, self.rank);
    }
}
