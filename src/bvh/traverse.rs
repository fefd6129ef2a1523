//! The walk: one ray against eight boxes or eight triangles at a time.

use super::{Bvh, Child, TriangleBlock, WIDTH};
use crate::geometry::moller_trumbore::{band_scale, determinants, intersect_seam};
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

/// 2⁻⁶⁴: below it directions are lengthened for the box test, to at least 2⁻⁸⁵ for any denormal.
const SHORT: f32 = 1.0 / (1u128 << 64) as f32;

/// A ray copied into all lanes, with what the box test needs.
pub struct RayLanes<'r, S: Simd> {
    simd: S,
    ray: &'r Ray,
    origin: [f32x8<S>; 3],
    direction: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    /// Distances to boxes are in units of t times this, 1 but for directions of almost no length.
    t_scale: f32,
    t_min: f32,
    /// Per axis: which of (min, max) the ray meets first.
    near: [usize; 3],
    /// See [`band_scale`].
    band_scale: f32x8<S>,
}

impl<'r, S: Simd> RayLanes<'r, S> {
    #[inline(always)]
    fn new(simd: S, ray: &'r Ray) -> Self {
        // A direction whose reciprocal would overflow is lengthened; a power of two is exact.
        let t_scale = if ray.direction.abs().max_element() < SHORT { SHORT } else { 1.0 };
        // 1/0 becomes the largest finite number of that sign: products with it may overflow to ±∞,
        // but 0·∞, the only source of NaN in a slab test of finite boxes, cannot occur.
        let lengthened = ray.direction / t_scale;
        let inverse = lengthened.recip().clamp(glam::Vec3::MIN, glam::Vec3::MAX);
        RayLanes {
            simd,
            ray,
            origin: splat(simd, ray.origin),
            direction: splat(simd, ray.direction),
            inverse: splat(simd, inverse),
            band_scale: f32x8::splat(simd, band_scale(ray.direction)),
            t_scale,
            t_min: ray.t_min * t_scale,
            near: [
                inverse.x.is_sign_negative() as usize,
                inverse.y.is_sign_negative() as usize,
                inverse.z.is_sign_negative() as usize,
            ],
        }
    }

    /// The ray itself, ending at `t_max`.
    #[inline(always)]
    pub(super) fn until(&self, t_max: f32) -> Ray {
        Ray { t_max, ..*self.ray }
    }

    /// Which of a node's boxes the ray enters at or before `t_max` (as a bit mask), and where, both
    /// scaled by `t_scale`.
    ///
    /// Stretching the far distance keeps rounding from losing a box that the ray meets.
    #[inline(always)]
    fn enter(&self, node: &super::Node, t_max: f32) -> (u64, [f32; WIDTH]) {
        let [x, y, z] = self.near;
        let near = self
            .slab(node, 0, x)
            .max(self.slab(node, 1, y))
            .max(self.slab(node, 2, z))
            .max(f32x8::splat(self.simd, self.t_min));
        let far = self
            .slab(node, 0, 1 - x)
            .min(self.slab(node, 1, 1 - y))
            .min(self.slab(node, 2, 1 - z))
            .min(f32x8::splat(self.simd, t_max))
            * f32x8::splat(self.simd, STRETCH);
        (near.simd_le(far).to_bitmask(), near.into())
    }

    /// Where the ray crosses eight boxes' planes.
    #[inline(always)]
    fn slab(&self, node: &super::Node, axis: usize, side: usize) -> f32x8<S> {
        let plane = f32x8::load_array_ref(self.simd, &node.bounds[axis][side & 1]);
        (plane - self.origin[axis]) * self.inverse[axis]
    }
}

// Plain functions rather than closures and `map`: they are inlined whatever the optimiser thinks,
// and code that is not inlined is not compiled for the instruction set.

#[inline(always)]
fn splat<S: Simd>(simd: S, v: glam::Vec3) -> [f32x8<S>; 3] {
    [f32x8::splat(simd, v.x), f32x8::splat(simd, v.y), f32x8::splat(simd, v.z)]
}

#[inline(always)]
fn load<S: Simd>(simd: S, values: &[[f32; WIDTH]; 3]) -> [f32x8<S>; 3] {
    [
        f32x8::load_array_ref(simd, &values[0]),
        f32x8::load_array_ref(simd, &values[1]),
        f32x8::load_array_ref(simd, &values[2]),
    ]
}

impl BlockKernel for MollerTrumbore {
    #[inline(always)]
    fn intersect_block<S: Simd>(
        ray: &RayLanes<S>,
        t_max: f32,
        block: &TriangleBlock,
        triangles: &[Triangle],
        mut found: impl FnMut(usize, f32, f32, f32),
    ) {
        let simd = ray.simd;
        let p0 = load(simd, &block.p0);
        let e1 = load(simd, &block.e1);
        let e2 = load(simd, &block.e2);
        let d = determinants(ray.origin, ray.direction, p0, e1, e2);
        let (zero, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let sign = one.copysign(d.det);
        let (det, u, v) = (d.det * sign, d.u * sign, d.v * sign);
        let w = det - u - v;
        let far = (ray.origin[0] - p0[0])
            .abs()
            .max((ray.origin[1] - p0[1]).abs())
            .max((ray.origin[2] - p0[2]).abs());
        let reach = f32x8::load_array_ref(simd, &block.reach);
        let band = (far * f32x8::splat(simd, 2.0) + reach) * reach * ray.band_scale;
        let below = zero - band;

        let decided = det.simd_gt(band);
        let possible = u.simd_ge(below) & v.simd_ge(below) & w.simd_ge(below);
        let candidates = (possible | !decided) & reach.simd_gt(zero);
        if candidates.to_bitmask() == 0 {
            return;
        }
        let inside = decided & u.simd_gt(band) & v.simd_gt(band) & w.simd_gt(band);
        let t = d.t * sign / det;
        let late = t.simd_gt(f32x8::splat(simd, ray.ray.t_min));
        // Where products overflow, an infinite t is no hit.
        let early = t.simd_le(f32x8::splat(simd, t_max.min(f32::MAX)));
        let mut mask = (inside & late & early).to_bitmask();
        if mask != 0 {
            let (t, u, v): ([f32; WIDTH], [f32; WIDTH], [f32; WIDTH]) =
                (t.into(), (u / det).into(), (v / det).into());
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                found(lane, t[lane], u[lane], v[lane]);
            }
        }
        let mut seams = candidates.to_bitmask() & !inside.to_bitmask();
        while seams != 0 {
            let lane = seams.trailing_zeros() as usize;
            seams &= seams - 1;
            if let Some((t, u, v)) =
                intersect_seam(&ray.until(t_max), &triangles[block.ids[lane].index()])
            {
                found(lane, t, u, v);
            }
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
        let ray = ray.until(t_max);
        for (lane, id) in block.ids.iter().enumerate() {
            let Some(triangle) = triangles.get(id.index()) else { break };
            if let Some((t, u, v)) = Plane::intersect(&ray, triangle) {
                found(lane, t, u, v);
            }
        }
    }
}

/// [`nearest`] for each ray.
#[inline(always)]
pub fn nearest_batch<S: Simd, K: BlockKernel>(
    simd: S,
    bvh: &Bvh<K>,
    rays: &[Ray],
    hits: &mut Vec<Option<Hit>>,
    stack: &mut Stack,
) {
    for ray in rays {
        hits.push(nearest(simd, bvh, ray, stack));
    }
}

/// [`occluded`] for each ray.
#[inline(always)]
pub fn occluded_batch<S: Simd, K: BlockKernel>(
    simd: S,
    bvh: &Bvh<K>,
    rays: &[Ray],
    blocked: &mut Vec<bool>,
    stack: &mut Stack,
) {
    for ray in rays {
        blocked.push(occluded(simd, bvh, ray, stack));
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
            let (mask, entry) = lanes.enter(node, t_max * lanes.t_scale);
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
                Some((child, entry)) if entry <= t_max * lanes.t_scale * STRETCH => {
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
            let (mut mask, _) = lanes.enter(node, ray.t_max * lanes.t_scale);
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
