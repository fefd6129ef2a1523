//! The walk: one ray against eight boxes or eight triangles at a time.

use super::{Bvh, Child, TriangleBlock, WIDTH};
use crate::geometry::moller_trumbore::determinants;
use crate::geometry::{Hit, Kernel, MollerTrumbore, Plane, Ray, Triangle};
use fearless_simd::{Simd, f32x8, prelude::*};
use std::cell::RefCell;

/// What still has to be visited: a child and the t at which the ray enters its box.
pub type Stack = Vec<(Child, f32)>;

thread_local! {
    static STACK: RefCell<Stack> = RefCell::new(Vec::with_capacity(256));
}

/// Lends this thread's stack, so that no ray pays for an allocation.
#[inline(always)]
pub fn with_stack<R>(trace: impl FnOnce(&mut Stack) -> R) -> R {
    STACK.with_borrow_mut(trace)
}

/// A kernel that can also answer for a whole block of triangles.
pub trait BlockKernel: Kernel {
    /// Calls `found` with (lane, t, u, v) for each triangle of the block that is hit in
    /// (`t_min`, `t_max`]: exactly the answers of [`Kernel::intersect`].
    fn intersect_block<S: Simd>(
        ray: &RayLanes<S>,
        t_max: f32,
        block: &TriangleBlock,
        triangles: &[Triangle],
        found: impl FnMut(usize, f32, f32, f32),
    );
}

/// 1 + 2γ₃: how far rounding can put a box's entry behind its exit, or behind a hit inside it (Ize,
/// *Robust BVH Ray Traversal*, JCGT 2(2), 2013).
const STRETCH: f32 = 1.0 + 6.0 * f32::EPSILON / 2.0;

/// A ray copied into all lanes, with what the box test needs.
pub struct RayLanes<'r, S: Simd> {
    simd: S,
    ray: &'r Ray,
    origin: [f32x8<S>; 3],
    direction: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    /// Per axis: which of (min, max) the ray meets first.
    near: [usize; 3],
}

impl<'r, S: Simd> RayLanes<'r, S> {
    #[inline(always)]
    fn new(simd: S, ray: &'r Ray) -> Self {
        // 1/0 becomes the largest finite number of that sign: products with it may overflow to ±∞,
        // but 0·∞, the only source of NaN in a slab test of finite boxes, cannot occur.
        let inverse = ray.direction.recip().clamp(glam::Vec3::MIN, glam::Vec3::MAX);
        let lanes = |v: glam::Vec3| v.to_array().map(|x| f32x8::splat(simd, x));
        RayLanes {
            simd,
            ray,
            origin: lanes(ray.origin),
            direction: lanes(ray.direction),
            inverse: lanes(inverse),
            near: inverse.to_array().map(|x| x.is_sign_negative() as usize),
        }
    }

    /// Which of a node's boxes the ray enters at or before `t_max` (as a bit mask), and where.
    ///
    /// Stretching the far distance keeps rounding from losing a box that the ray meets.
    #[inline(always)]
    fn enter(&self, node: &super::Node, t_max: f32) -> (u64, [f32; WIDTH]) {
        let slab = |axis: usize, side: usize| {
            let plane = f32x8::load_array_ref(self.simd, &node.bounds[axis][side]);
            (plane - self.origin[axis]) * self.inverse[axis]
        };
        let near = slab(0, self.near[0])
            .max(slab(1, self.near[1]))
            .max(slab(2, self.near[2]))
            .max(f32x8::splat(self.simd, self.ray.t_min));
        let far = slab(0, 1 - self.near[0])
            .min(slab(1, 1 - self.near[1]))
            .min(slab(2, 1 - self.near[2]))
            .min(f32x8::splat(self.simd, t_max))
            * f32x8::splat(self.simd, STRETCH);
        (near.simd_le(far).to_bitmask(), near.into())
    }
}

impl BlockKernel for MollerTrumbore {
    #[inline(always)]
    fn intersect_block<S: Simd>(
        ray: &RayLanes<S>,
        t_max: f32,
        block: &TriangleBlock,
        _: &[Triangle],
        mut found: impl FnMut(usize, f32, f32, f32),
    ) {
        let lanes = |values: &[[f32; WIDTH]; 3]| {
            [0, 1, 2].map(|axis| f32x8::load_array_ref(ray.simd, &values[axis]))
        };
        let d = determinants(
            ray.origin,
            ray.direction,
            lanes(&block.p0),
            lanes(&block.e1),
            lanes(&block.e2),
        );
        let splat = |x: f32| f32x8::splat(ray.simd, x);
        let (zero, one) = (splat(0.0), splat(1.0));
        let sign = one.copysign(d.det);
        let (det, u, v) = (d.det * sign, d.u * sign, d.v * sign);
        let inside =
            det.simd_gt(zero) & u.simd_ge(zero) & v.simd_ge(zero) & (u + v).simd_le(det);
        if inside.to_bitmask() == 0 {
            return;
        }
        let t = d.t * sign / det;
        let hit = inside & t.simd_gt(splat(ray.ray.t_min)) & t.simd_le(splat(t_max));
        let mut mask = hit.to_bitmask();
        if mask == 0 {
            return;
        }
        let (t, u, v): ([f32; WIDTH], [f32; WIDTH], [f32; WIDTH]) =
            (t.into(), (u / det).into(), (v / det).into());
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            found(lane, t[lane], u[lane], v[lane]);
        }
    }
}

impl BlockKernel for Plane {
    #[inline(always)]
    fn intersect_block<S: Simd>(
        ray: &RayLanes<S>,
        t_max: f32,
        block: &TriangleBlock,
        triangles: &[Triangle],
        mut found: impl FnMut(usize, f32, f32, f32),
    ) {
        let ray = Ray { t_max, ..*ray.ray };
        for (lane, id) in block.ids.iter().enumerate() {
            let Some(triangle) = triangles.get(id.index()) else { break };
            if let Some((t, u, v)) = Plane::intersect(&ray, triangle) {
                found(lane, t, u, v);
            }
        }
    }
}

/// The nearest hit; of several at the same t, that of the lowest triangle, whatever the order of
/// the walk.
#[inline(always)]
pub fn nearest<S: Simd, K: BlockKernel>(
    simd: S,
    bvh: &Bvh<K>,
    ray: &Ray,
    stack: &mut Stack,
) -> Option<Hit> {
    let lanes = RayLanes::new(simd, ray);
    let mut nearest: Option<Hit> = None;
    let mut t_max = ray.t_max;
    stack.clear();
    let mut current = Child::node(0);
    loop {
        if current.0 & Child::BLOCK == 0 {
            let node = &bvh.nodes[current.0 as usize];
            let (mask, entry) = lanes.enter(node, t_max);
            if let Some(next) = push_far_to_near(mask, &entry, &node.children, stack) {
                current = next;
                continue;
            }
        } else {
            let block = &bvh.blocks[(current.0 & !Child::BLOCK) as usize];
            K::intersect_block(&lanes, t_max, block, bvh.triangles, |lane, t, u, v| {
                let triangle = block.ids[lane];
                if nearest.is_none_or(|hit| t < hit.t || (t == hit.t && triangle < hit.triangle)) {
                    nearest = Some(Hit { triangle, t, u, v });
                    t_max = t;
                }
            });
        }
        loop {
            match stack.pop() {
                None => return nearest,
                // Equal distances are visited: a lower triangle may tie.
                Some((child, entry)) if entry <= t_max * STRETCH => {
                    current = child;
                    break;
                }
                Some(_) => {}
            }
        }
    }
}

/// Returns the nearest of the entered children and pushes the others, farthest first.
#[inline(always)]
fn push_far_to_near(
    mut mask: u64,
    entry: &[f32; WIDTH],
    children: &[Child; WIDTH],
    stack: &mut Stack,
) -> Option<Child> {
    if mask == 0 {
        return None;
    }
    let first = mask.trailing_zeros() as usize;
    mask &= mask - 1;
    let mut nearest = (children[first], entry[first]);
    let bottom = stack.len();
    while mask != 0 {
        let slot = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        let mut other = (children[slot], entry[slot]);
        if other.1 < nearest.1 {
            std::mem::swap(&mut other, &mut nearest);
        }
        // Insertion keeps this node's part of the stack sorted; rarely more than three are entered.
        stack.push(other);
        let mut i = stack.len() - 1;
        while i > bottom && stack[i - 1].1 < stack[i].1 {
            stack.swap(i - 1, i);
            i -= 1;
        }
    }
    Some(nearest.0)
}

/// Whether anything is hit, in whatever order it is found.
#[inline(always)]
pub fn occluded<S: Simd, K: BlockKernel>(
    simd: S,
    bvh: &Bvh<K>,
    ray: &Ray,
    stack: &mut Stack,
) -> bool {
    let lanes = RayLanes::new(simd, ray);
    stack.clear();
    stack.push((Child::node(0), 0.0));
    while let Some((current, _)) = stack.pop() {
        if current.0 & Child::BLOCK == 0 {
            let node = &bvh.nodes[current.0 as usize];
            let (mut mask, _) = lanes.enter(node, ray.t_max);
            while mask != 0 {
                let slot = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                stack.push((node.children[slot], 0.0));
            }
        } else {
            let block = &bvh.blocks[(current.0 & !Child::BLOCK) as usize];
            let mut hit = false;
            K::intersect_block(&lanes, ray.t_max, block, bvh.triangles, |_, _, _, _| hit = true);
            if hit {
                return true;
            }
        }
    }
    false
}
