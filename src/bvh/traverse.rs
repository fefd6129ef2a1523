//! The walk of one ray down the hierarchy, and of several in turns.

use super::lanes::{PreparedRay, RayLanes, STRETCH};
use super::leaf_kernel::LeafKernel;
use super::{Bvh, Child, Kind, WIDTH};
use crate::geometry::{Hit, Ray, TriangleId};
use fearless_simd::Simd;

/// A place to visit: the [`order`] of its entry distance above, the child below.
pub type Entry = u64;

/// How far one ray's walk has come.
#[derive(Debug, Clone, Copy)]
pub struct Walk {
    pub nearest: Hit,
    pub current: Child,
    /// Entries on its stack.
    pub waiting: usize,
}

/// The triangle of no hit.
pub const NOTHING: TriangleId = TriangleId(u32::MAX);

impl Walk {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let nearest = Hit { triangle: NOTHING, t: ray.t_max, u: 0.0, v: 0.0 };
        Walk { nearest, current: Child::ROOT, waiting: 0 }
    }

    #[inline(always)]
    pub fn hit(&self) -> Option<Hit> {
        if self.nearest.triangle == NOTHING { None } else { Some(self.nearest) }
    }

    /// Visits one node or leaf; whether there is another to visit.
    #[inline(always)]
    pub fn step<S: Simd, K: LeafKernel, const ANY: bool>(
        &mut self,
        lanes: &RayLanes<S>,
        bvh: &Bvh<K>,
        stack: &mut [Entry],
    ) -> bool {
        if ANY { self.step_any(lanes, bvh, stack) } else { self.step_nearest(lanes, bvh, stack) }
    }

    /// On the way to the nearest hit. Of several at the same t, that of the lowest triangle is kept,
    /// whatever the order of the walk.
    #[inline(always)]
    fn step_nearest<S: Simd, K: LeafKernel>(
        &mut self,
        lanes: &RayLanes<S>,
        bvh: &Bvh<K>,
        stack: &mut [Entry],
    ) -> bool {
        let t_scale = lanes.prepared.t_scale;
        match self.current.kind() {
            Kind::Node(index) => {
                let node = &bvh.nodes[index];
                let (mask, entry) = lanes.enter(node, self.nearest.t * t_scale);
                let next = push_far_to_near(mask, &entry, &node.children, stack, &mut self.waiting);
                if let Some(nearest) = next {
                    self.current = nearest;
                    return true;
                }
            }
            Kind::Leaf(first, count) => {
                let leaf = bvh.leaf(first, count);
                let nearest = &mut self.nearest;
                K::intersect_leaf(lanes, nearest.t, leaf, |number, t, u, v| {
                    let triangle = leaf.id(number);
                    if t < nearest.t || (t == nearest.t && triangle < nearest.triangle) {
                        *nearest = Hit { triangle, t, u, v };
                    }
                });
            }
        }
        // Equal distances are visited: a lower triangle may tie.
        let last = order(self.nearest.t * t_scale * STRETCH);
        while self.waiting > 0 {
            self.waiting -= 1;
            let entry = stack[self.waiting];
            if (entry >> 32) as u32 <= last {
                self.current = Child(entry as u32);
                return true;
            }
        }
        false
    }

    /// In search of any hit, in whatever order. Where it is does not matter and is not computed.
    #[inline(always)]
    fn step_any<S: Simd, K: LeafKernel>(
        &mut self,
        lanes: &RayLanes<S>,
        bvh: &Bvh<K>,
        stack: &mut [Entry],
    ) -> bool {
        let t_max = lanes.prepared.ray.t_max;
        match self.current.kind() {
            Kind::Node(index) => {
                let node = &bvh.nodes[index];
                let (mut mask, _) = lanes.enter(node, t_max * lanes.prepared.t_scale);
                while mask != 0 {
                    let slot = mask.trailing_zeros() as usize;
                    mask &= mask - 1;
                    stack[self.waiting] = node.children[slot].0 as Entry;
                    self.waiting += 1;
                }
            }
            Kind::Leaf(first, count) => {
                let leaf = bvh.leaf(first, count);
                let nearest = &mut self.nearest;
                K::intersect_leaf(lanes, t_max, leaf, |number, _, _, _| {
                    nearest.triangle = leaf.id(number);
                });
                if self.nearest.triangle != NOTHING {
                    return false;
                }
            }
        }
        if self.waiting == 0 {
            return false;
        }
        self.waiting -= 1;
        self.current = Child(stack[self.waiting] as u32);
        true
    }
}

/// An integer that grows with `x`, from −∞ to ∞.
#[inline(always)]
fn order(x: f32) -> u32 {
    let bits = x.to_bits();
    bits ^ (((bits as i32) >> 31) as u32 | 1 << 31)
}

/// Returns the nearest of the entered children and pushes the others, farthest first.
#[inline(always)]
fn push_far_to_near(
    mut mask: u64,
    entry: &[f32; WIDTH],
    children: &[Child; WIDTH],
    stack: &mut [Entry],
    waiting: &mut usize,
) -> Option<Child> {
    if mask == 0 {
        return None;
    }
    let first = mask.trailing_zeros() as usize;
    mask &= mask - 1;
    if mask == 0 {
        return Some(children[first]);
    }
    let key = |slot: usize| (order(entry[slot]) as Entry) << 32 | children[slot].0 as Entry;
    let mut near = key(first);
    let bottom = *waiting;
    let mut top = bottom;
    while mask != 0 {
        let other = key(mask.trailing_zeros() as usize);
        mask &= mask - 1;
        let far = near.max(other);
        near = near.min(other);
        // Insertion keeps this node's part of the stack sorted; rarely more than three are entered.
        let mut i = top;
        while i > bottom && stack[i - 1] < far {
            stack[i] = stack[i - 1];
            i -= 1;
        }
        stack[i] = far;
        top += 1;
    }
    *waiting = top;
    Some(Child(near as u32))
}

/// The nearest hit of one ray, or any if `ANY`.
#[inline(always)]
pub fn alone<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    ray: &Ray,
    stack: &mut [Entry],
) -> Option<Hit> {
    if !PreparedRay::can_hit(ray) {
        return None;
    }
    let mut walk = Walk::new(ray);
    let prepared = PreparedRay::new(ray);
    let lanes = RayLanes::new(simd, &prepared);
    while walk.step::<S, K, ANY>(&lanes, bvh, stack) {}
    walk.hit()
}

/// Rays that take turns. With 8 the atrium of `isolux bench` was a tenth slower, with 4 a third.
pub const IN_FLIGHT: usize = 16;

/// [`alone`] for each of the rays `which`, in turns; calls `finish` with its number.
///
/// A ray waits for memory at nearly every step, unless the hierarchy fits the caches. So it asks for
/// what it needs next, and the others go on until it is there.
#[inline(always)]
pub fn in_turns<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    rays: &[Ray],
    which: &[u32],
    stack: &mut [Entry],
    finish: &mut impl FnMut(usize, Option<Hit>),
) {
    let share = stack.len() / IN_FLIGHT;
    let Some(&first) = which.first() else { return };
    let take = |index: u32| {
        let ray = &rays[index as usize];
        (PreparedRay::new(ray), Walk::new(ray), index)
    };
    let mut flights = [take(first); IN_FLIGHT];
    let mut alive = IN_FLIGHT.min(which.len());
    let mut next = 0;
    while next < alive {
        flights[next] = take(which[next]);
        next += 1;
    }
    while alive > 0 {
        let mut i = 0;
        while i < alive {
            let (prepared, walk, index) = &mut flights[i];
            let lanes = RayLanes::new(simd, prepared);
            let own = &mut stack[i * share..(i + 1) * share];
            if walk.step::<S, K, ANY>(&lanes, bvh, own) {
                bvh.prefetch(walk.current);
                i += 1;
                continue;
            }
            finish(*index as usize, walk.hit());
            if next < which.len() {
                flights[i] = take(which[next]);
                next += 1;
                i += 1;
            } else {
                // The last one takes the place that is free.
                alive -= 1;
                flights[i] = flights[alive];
                let from = alive * share;
                stack.copy_within(from..from + flights[i].1.waiting, i * share);
            }
        }
    }
}
