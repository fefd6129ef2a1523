//! Many rays at once: which way to trace them is chosen by what they have in common.

use super::interleaved::{SLOTS, trace_interleaved};
use super::kernel8::LeafKernel;
use super::packet::{Packet, columns};
use super::packet_walk::{Group, trace_packet};
use super::stream::Stream;
use super::traverse::Entry;
use super::{Bvh, WIDTH};
use crate::geometry::{Hit, Ray};
use fearless_simd::{Simd, f32x8, prelude::*};
use std::cell::RefCell;

/// A thread's memory for tracing, so that no ray pays for an allocation.
pub(super) struct Scratch {
    pub stack: Vec<Entry>,
    groups: Vec<Group>,
    /// Rays that have nothing in common with their neighbours.
    incoherent: Vec<u32>,
    stream: Stream,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::new(Scratch {
        stack: Vec::new(),
        groups: Vec::new(),
        incoherent: Vec::new(),
        stream: Stream::new(),
    });
}

/// Lends this thread's memory, with room for `entries` on each ray's stack.
#[inline(always)]
pub(super) fn with_scratch<R>(entries: usize, trace: impl FnOnce(&mut Scratch) -> R) -> R {
    SCRATCH.with_borrow_mut(|scratch| {
        // Every stack of the rays in flight is the same share of all.
        if scratch.stack.len() < entries * SLOTS {
            scratch.stack.resize(entries * SLOTS, 0);
            scratch.groups.resize(entries, Group::NONE);
        }
        trace(scratch)
    })
}

/// Up to this many triangles a batch goes node by node. At 36 that is 1.7 times as fast as interleaved
/// rays, at 252 a sixth faster, at 684 slower.
const SMALL: usize = 256;

/// Calls `finish` with each ray's number and its nearest hit, or any hit if `ANY`.
#[inline(always)]
pub(super) fn trace<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    rays: &[Ray],
    scratch: &mut Scratch,
    finish: &mut impl FnMut(usize, Option<Hit>),
) {
    let Scratch { stack, groups, incoherent, stream } = scratch;
    incoherent.clear();
    for (part, rays) in rays.chunks(WIDTH).enumerate() {
        let first = part * WIDTH;
        let mut eight = [rays[0]; WIDTH];
        eight[..rays.len()].copy_from_slice(rays);
        let columns = columns(simd, eight);
        let all = (1 << rays.len()) - 1;
        let can_hit = can_hit(&columns) & all;
        if rays.len() > 1 && can_hit == all && are_close(&columns, bvh.extent) {
            let packet = Packet::new(simd, columns);
            let hits = trace_packet::<S, K, ANY>(packet, bvh, &eight, rays.len(), groups, stack);
            for (k, hit) in hits[..rays.len()].iter().enumerate() {
                finish(first + k, *hit);
            }
        } else {
            for k in 0..rays.len() {
                if can_hit >> k & 1 != 0 {
                    incoherent.push((first + k) as u32);
                } else {
                    finish(first + k, None);
                }
            }
        }
    }
    if bvh.triangles.len() <= SMALL {
        stream.trace::<S, K, ANY>(simd, bvh, rays, incoherent, finish);
    } else {
        trace_interleaved::<S, K, ANY>(simd, bvh, rays, incoherent, stack, finish);
    }
}

/// Cosine of the widest angle at which rays count as going the same way, squared.
const CLOSE_COSINE_SQUARED: f32 = 0.98 * 0.98;

/// As [`PreparedRay::can_hit`](super::ray_lanes::PreparedRay::can_hit), of eight rays, as a mask.
#[inline(always)]
fn can_hit<S: Simd>(columns: &[f32x8<S>; 8]) -> u64 {
    let [ox, oy, oz, dx, dy, dz, t_min, t_max] = *columns;
    let largest = f32x8::splat(t_min.simd, f32::MAX);
    // A NaN fails.
    let finite = |x: f32x8<S>| x.abs().simd_le(largest);
    let origin = finite(ox) & finite(oy) & finite(oz);
    let direction = finite(dx) & finite(dy) & finite(dz);
    (origin & direction & t_min.simd_lt(t_max)).to_bitmask()
}

/// Whether eight rays start near the first and go about its way, so that they visit the same boxes. It changes nothing but the time that they take.
#[inline(always)]
fn are_close<S: Simd>(columns: &[f32x8<S>; 8], extent: f32) -> bool {
    let [ox, oy, oz, dx, dy, dz, ..] = *columns;
    let simd = ox.simd;
    let first = |x: f32x8<S>| f32x8::splat(simd, x.as_array()[0]);
    let (fx, fy, fz) = (first(dx), first(dy), first(dz));
    let along = dx * fx + dy * fy + dz * fz;
    let squared = fx * fx + fy * fy + fz * fz;
    let bound = squared * f32x8::splat(simd, CLOSE_COSINE_SQUARED) * (dx * dx + dy * dy + dz * dz);
    let apart = |x: f32x8<S>| (x - first(x)).abs();
    let apart = apart(ox).max(apart(oy)).max(apart(oz));
    // Where the products overflow, they are not close.
    let same_way = along.simd_gt(f32x8::splat(simd, 0.0)) & (along * along).simd_gt(bound);
    (same_way & apart.simd_le(f32x8::splat(simd, extent * (1.0 / 32.0)))).all_true()
}
