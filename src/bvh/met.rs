//! The answer of a kernel on eight lanes.

use super::WIDTH;
use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};

/// The lanes that are hit, and where: u and v are still to be divided by `det`.
pub struct Met<S: Simd> {
    pub lanes: mask32x8<S>,
    pub t: f32x8<S>,
    pub u: f32x8<S>,
    pub v: f32x8<S>,
    pub det: f32x8<S>,
}

impl<S: Simd> Met<S> {
    #[inline(always)]
    pub fn none(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Met { lanes: mask32x8::splat(simd, false), t: zero, u: zero, v: zero, det: zero }
    }

    /// This answer with the hits that `intersect` finds in the lanes of `mask`.
    #[inline(always)]
    pub fn with(
        self,
        simd: S,
        mut mask: u64,
        intersect: impl Fn(usize) -> Option<(f32, f32, f32)>,
    ) -> Self {
        let mut lanes = self.lanes.to_bitmask();
        let mut t: [f32; WIDTH] = self.t.into();
        let mut u: [f32; WIDTH] = self.u.into();
        let mut v: [f32; WIDTH] = self.v.into();
        let mut det: [f32; WIDTH] = self.det.into();
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if let Some(hit) = intersect(lane) {
                (t[lane], u[lane], v[lane]) = hit;
                det[lane] = 1.0;
                lanes |= 1 << lane;
            }
        }
        Met {
            lanes: mask32x8::from_bitmask(simd, lanes),
            t: f32x8::load_array(simd, t),
            u: f32x8::load_array(simd, u),
            v: f32x8::load_array(simd, v),
            det: f32x8::load_array(simd, det),
        }
    }
}
