//! The walk of one ray down the hierarchy.
//!
//! A step leaves the branch predictor as little to guess as it can: which boxes are entered, in which order,
//! and whether a leaf is hit follow from arithmetic rather than from branches.

use super::kernel8::LeafKernel;
use super::leaf::Leaf;
use super::met::Met;
use super::node::Node;
use super::ray_lanes::{PreparedRay, RayLanes, STRETCH};
use super::{Bvh, Child, ChildKind, WIDTH};
use crate::geometry::{Hit, Ray, Stops, TriangleId};
use fearless_simd::{Simd, f32x8, i32x8, i64x2, i64x4, mask32x8, prelude::*, u32x8};
use std::hint::select_unpredictable;

/// A place to visit: the [`order`] of its entry distance above, the child below.
pub(super) type Entry = i64;

/// The entry below all others on a stack: as near as can be, so that it is never left out.
const END: Entry = 0;

/// The next child when a walk is over. The root is nobody's child, so that nothing else says so.
pub(super) const OVER: Child = Child(END as u32);

/// The triangle of no hit.
pub(super) const NOTHING: TriangleId = TriangleId(u32::MAX);

/// How far a ray has come.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Walk {
    prepared: PreparedRay,
    nearest: Nearest,
    /// Where its stack ends: one behind the entry on top.
    end: usize,
}

/// The nearest hit so far, or [`NOTHING`] at the ray's end. Its u and v are still to be divided by `det`: once
/// for a ray, not at every leaf.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
struct Nearest {
    t: f32,
    u: f32,
    v: f32,
    det: f32,
    triangle: TriangleId,
}

impl From<Hit> for Nearest {
    #[inline(always)]
    fn from(Hit { triangle, t, u, v }: Hit) -> Self {
        Nearest { t, u, v, det: 1.0, triangle }
    }
}

impl Walk {
    /// At the root, with nothing found; its own part of `stack` begins at `bottom`.
    #[inline(always)]
    pub(super) fn new(ray: &Ray, stack: &mut [Entry], bottom: usize) -> Self {
        Walk::resume(ray, None, Child::ROOT, stack, bottom)
    }

    /// At some child, with what was found before.
    #[inline(always)]
    pub(super) fn resume(
        ray: &Ray,
        found: Option<Hit>,
        from: Child,
        stack: &mut [Entry],
        bottom: usize,
    ) -> Self {
        stack[bottom] = END;
        stack[bottom + 1] = from.0 as Entry;
        let nothing = Hit { triangle: NOTHING, t: ray.t_max, u: 0.0, v: 0.0 };
        let nearest = Nearest::from(found.unwrap_or(nothing));
        Walk { prepared: PreparedRay::new(ray), nearest, end: bottom + 2 }
    }

    /// The child on top of the stack.
    #[inline(always)]
    fn top(&self, stack: &[Entry]) -> Child {
        Child(stack[self.end - 1] as u32)
    }

    /// The child below it, unless the walk is over.
    #[inline(always)]
    fn second(&self, stack: &[Entry]) -> Child {
        Child(stack[self.end - 2] as u32)
    }

    #[inline(always)]
    pub(super) fn hit(&self) -> Option<Hit> {
        let Nearest { t, u, v, det, triangle } = self.nearest;
        if triangle == NOTHING { None } else { Some(Hit { triangle, t, u: u / det, v: v / det }) }
    }

    /// The next child to visit, or [`OVER`]. Children behind the nearest hit are left out.
    #[inline(always)]
    pub(super) fn next<const ANY: bool>(&mut self, stack: &[Entry]) -> Child {
        if ANY {
            return self.top(stack);
        }
        // Equal distances are visited: a lower triangle may tie.
        let last = order(self.nearest.t * self.prepared.t_scale * STRETCH);
        loop {
            if (stack[self.end - 1] >> 32) as i32 <= last {
                return self.top(stack);
            }
            self.end -= 1;
        }
    }

    /// Takes the node on top of the stack and puts the children there that the ray enters.
    #[inline(always)]
    pub(super) fn visit_node<S: Simd, const ANY: bool>(
        &mut self,
        simd: S,
        nodes: &[Node],
        stack: &mut [Entry],
    ) {
        self.end -= 1;
        let node = &nodes[stack[self.end] as u32 as usize];
        let lanes = RayLanes::new(simd, &self.prepared);
        let (entered, near) = lanes.enter(node, self.nearest.t * self.prepared.t_scale);
        let room = &mut stack[self.end..][..WIDTH];
        if ANY {
            push(simd, entered, node, room);
        } else {
            push_far_to_near(simd, entered, near, node, room);
        }
        self.end += entered.to_bitmask().count_ones() as usize;
    }

    /// Takes the leaf on top of the stack and asks its triangles. Of several hits at the same t, that of
    /// the lowest triangle is kept, whatever the order of the walk; of any hit only that there is one.
    #[inline(always)]
    pub(super) fn visit_leaf<S: Simd, K: LeafKernel, const ANY: bool>(
        &mut self,
        simd: S,
        bvh: &Bvh<K>,
        stack: &mut [Entry],
    ) {
        // Read before the leaf is asked: else the compiler stores what is kept with a mask, which takes processors
        // without AVX-512 a dozen cycles.
        let before = self.nearest;
        let (leaf, met) = self.meet_leaf(simd, bvh, stack);
        if ANY {
            let met = met.lanes.to_bitmask();
            if met != 0 {
                self.nearest.triangle = leaf.id(met.trailing_zeros() as usize);
                stack[self.end] = END;
                self.end += 1;
            }
        } else {
            self.keep_nearest(simd, before, &leaf, &met);
        }
    }

    /// Takes the leaf on top of the stack and asks its triangles.
    #[inline(always)]
    fn meet_leaf<'b, S: Simd, K: LeafKernel>(
        &mut self,
        simd: S,
        bvh: &'b Bvh<K>,
        stack: &[Entry],
    ) -> (Leaf<'b>, Met<S>) {
        self.end -= 1;
        let ChildKind::Leaf(first, count) = Child(stack[self.end] as u32).kind() else {
            unreachable!("a walk at a node visits it")
        };
        let leaf = bvh.leaf(first, count);
        let lanes = RayLanes::new(simd, &self.prepared);
        (leaf, K::intersect_leaf(&lanes, self.nearest.t, leaf))
    }

    /// As [`keep_nearest`](Walk::keep_nearest), of the hits at which the ray ends.
    #[inline(always)]
    fn keep_nearest_stop<S: Simd>(&mut self, leaf: &Leaf, met: &Met<S>, stops: Stops) {
        let mut lanes = met.lanes.to_bitmask();
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            let number = |lanes: &f32x8<S>| lanes.as_array()[lane];
            let (u, v) = (number(&met.u) / number(&met.det), number(&met.v) / number(&met.det));
            let hit = Hit { triangle: leaf.id(lane), t: number(&met.t), u, v };
            let nearest = (self.nearest.t, self.nearest.triangle);
            if (hit.t, hit.triangle) < nearest && stops(&hit) {
                self.nearest = hit.into();
            }
        }
    }

    /// `before` is the nearest hit so far.
    #[inline(always)]
    fn keep_nearest<S: Simd>(&mut self, simd: S, before: Nearest, leaf: &Leaf, met: &Met<S>) {
        let t = met.lanes.select(met.t, f32x8::splat(simd, f32::INFINITY));
        let least = t.reduce_min();
        let mut lanes = (met.lanes & t.simd_eq(f32x8::splat(simd, least))).to_bitmask();
        let is_met = lanes != 0;
        let mut lane = lanes.trailing_zeros() as usize % WIDTH;
        // Hardly ever more than one.
        while lanes & lanes.wrapping_sub(1) != 0 {
            lanes &= lanes - 1;
            let other = lanes.trailing_zeros() as usize;
            if leaf.id(other) < leaf.id(lane) {
                lane = other;
            }
        }
        let triangle = leaf.id(lane);
        let nearest = &mut self.nearest;
        let is_nearer = (least < before.t) | ((least == before.t) & (triangle < before.triangle));
        let take = is_met & is_nearer;
        let number = |lanes: &f32x8<S>| lanes.as_array()[lane];
        nearest.triangle.0 = select_unpredictable(take, triangle.0, before.triangle.0);
        nearest.t = select_unpredictable(take, least, before.t);
        nearest.u = select_unpredictable(take, number(&met.u), before.u);
        nearest.v = select_unpredictable(take, number(&met.v), before.v);
        nearest.det = select_unpredictable(take, number(&met.det), before.det);
    }
}

/// A positive integer that does not fall where `x` grows. All negative numbers have the same.
#[inline(always)]
fn order(x: f32) -> i32 {
    (x.to_bits() as i32).max(1)
}

/// Puts the entered children at the front of `room`.
#[inline(always)]
fn push<S: Simd>(simd: S, entered: mask32x8<S>, node: &Node, room: &mut [Entry]) {
    let (low, high) = node.children(simd).compress(entered).widen();
    low.bitcast::<i64x4<S>>().store_slice(&mut room[..4]);
    high.bitcast::<i64x4<S>>().store_slice(&mut room[4..]);
}

/// Puts the entered children at the front of `room`, farthest first.
#[inline(always)]
fn push_far_to_near<S: Simd>(
    simd: S,
    entered: mask32x8<S>,
    near: f32x8<S>,
    node: &Node,
    room: &mut [Entry],
) {
    // As `order` does.
    let bits: i32x8<S> = near.bitcast();
    let keys = bits.max(i32x8::splat(simd, 1)).bitcast::<u32x8<S>>().compress(entered);
    let children = node.children(simd).compress(entered);
    let pairs = |(low, high): (u32x8<S>, u32x8<S>)| {
        let ((a, b), (c, d)) = (low.split(), high.split());
        [a, b, c, d].map(|pair| pair.bitcast::<i64x2<S>>())
    };
    let [a, b, c, d] = pairs((children.zip_low(keys), children.zip_high(keys)));
    let count = entered.to_bitmask().count_ones() as usize;
    if count <= 4 {
        // The larger of each two, then the largest and the least of all; where there is no entry there
        // is a 0, which comes last.
        let (large, small) = (a.max(b), a.min(b));
        let (turned_large, turned_small) = (large.slide::<1>(large), small.slide::<1>(small));
        let (first, last) = (large.max(turned_large), small.min(turned_small));
        let (one, other) = (large.min(turned_large), small.max(turned_small));
        first.zip_low(one.max(other)).store_slice(&mut room[..2]);
        one.min(other).zip_low(last).store_slice(&mut room[2..4]);
    } else {
        for (pair, room) in [a, b, c, d].into_iter().zip(room.chunks_exact_mut(2)) {
            pair.store_slice(room);
        }
        room[..count].sort_unstable_by(|a, b| b.cmp(a));
    }
}

/// A walk from where it is to its end.
#[inline(always)]
pub(super) fn walk_on<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    mut walk: Walk,
    stack: &mut [Entry],
) -> Option<Hit> {
    let mut child = walk.top(stack);
    loop {
        bvh.prefetch(walk.second(stack));
        if child.is_leaf() {
            walk.visit_leaf::<S, K, ANY>(simd, bvh, stack);
        } else {
            walk.visit_node::<S, ANY>(simd, &bvh.nodes, stack);
        }
        child = walk.next::<ANY>(stack);
        if child == OVER {
            return walk.hit();
        }
    }
}

/// The nearest hit at which the ray ends.
#[inline(always)]
pub(super) fn trace_to_stop<S: Simd, K: LeafKernel>(
    simd: S,
    bvh: &Bvh<K>,
    ray: &Ray,
    stack: &mut [Entry],
    stops: Stops,
) -> Option<Hit> {
    if !PreparedRay::can_hit(ray) {
        return None;
    }
    let mut walk = Walk::new(ray, stack, 0);
    let mut child = walk.top(stack);
    loop {
        if child.is_leaf() {
            let (leaf, met) = walk.meet_leaf(simd, bvh, stack);
            walk.keep_nearest_stop(&leaf, &met, stops);
        } else {
            walk.visit_node::<S, false>(simd, &bvh.nodes, stack);
        }
        child = walk.next::<false>(stack);
        if child == OVER {
            return walk.hit();
        }
    }
}

/// The nearest hit of one ray, or any if `ANY`.
#[inline(always)]
pub(super) fn trace_single<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    ray: &Ray,
    stack: &mut [Entry],
) -> Option<Hit> {
    if !PreparedRay::can_hit(ray) {
        return None;
    }
    let walk = Walk::new(ray, stack, 0);
    walk_on::<S, K, ANY>(simd, bvh, walk, stack)
}
