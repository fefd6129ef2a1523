//! A node: eight boxes, and what is in them.

use super::{Child, WIDTH};
use crate::geometry::bounds::Bounds;
use fearless_simd::{Simd, f32x8, prelude::*, u32x8};
use glam::Vec3;

/// Up to eight children: boxes as `bounds[axis][0 = min, 1 = max][child]`, then what is in them.
#[repr(align(64))]
#[derive(Debug, Clone)]
pub(super) struct Node {
    pub bounds: [[[f32; WIDTH]; 2]; 3],
    pub children: [Child; WIDTH],
}

impl Node {
    pub(super) const EMPTY: Node = Node {
        bounds: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
        children: [Child::ROOT; WIDTH],
    };

    /// Whether there is a child number `slot`; if not, there is none behind it. Its empty box is never
    /// hit by one ray, but a packet tests the boxes in another way.
    #[inline(always)]
    pub(super) fn has(&self, slot: usize) -> bool {
        self.bounds[0][0][slot] <= self.bounds[0][1][slot]
    }

    /// The slots that have a child, as a mask.
    #[inline(always)]
    pub(super) fn slots<S: Simd>(&self, simd: S) -> u64 {
        let [min, max] = &self.bounds[0];
        f32x8::load_array_ref(simd, min).simd_le(f32x8::load_array_ref(simd, max)).to_bitmask()
    }

    #[inline(always)]
    pub(super) fn children<S: Simd>(&self, simd: S) -> u32x8<S> {
        let mut numbers = [0; WIDTH];
        let mut slot = 0;
        while slot < WIDTH {
            numbers[slot] = self.children[slot].0;
            slot += 1;
        }
        u32x8::load_array(simd, numbers)
    }

    /// The box grows by one ulp of its largest coordinate on each side, so that a ray that runs exactly
    /// in one of its faces (a zero in the direction) is strictly inside and no comparison is left to
    /// chance. One ulp of the face itself would not do: next to 0 it is so little that not even the
    /// largest inverse of a direction takes it beyond t.
    pub(super) fn set(&mut self, slot: usize, bounds: Bounds, child: Child) {
        let Bounds { min, max } = bounds;
        let ulp = min.abs().max(max.abs()).max_element() * f32::EPSILON;
        let next = |v: Vec3, next: fn(f32) -> f32| Vec3::new(next(v.x), next(v.y), next(v.z));
        let min = (min - ulp).min(next(min, f32::next_down));
        let max = (max + ulp).max(next(max, f32::next_up));
        for axis in 0..3 {
            self.bounds[axis][0][slot] = min[axis];
            self.bounds[axis][1][slot] = max[axis];
        }
        self.children[slot] = child;
    }
}
