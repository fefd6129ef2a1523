//! Many rays at once: which way to trace them is chosen by what they have in common.

use super::interleaved::{SLOTS, trace_interleaved};
use super::kernel8::LeafKernel;
use super::packet_walk::{Group, trace_packet};
use super::ray_lanes::PreparedRay;
use super::stream::Stream;
use super::traverse::Entry;
use super::{Bvh, WIDTH};
use crate::geometry::{Hit, Ray};
use fearless_simd::Simd;
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
        if are_close(rays, bvh.extent) {
            let mut eight = [rays[0]; WIDTH];
            eight[..rays.len()].copy_from_slice(rays);
            let hits = trace_packet::<S, K, ANY>(simd, bvh, &eight, rays.len(), groups, stack);
            for (k, hit) in hits[..rays.len()].iter().enumerate() {
                finish(first + k, *hit);
            }
        } else {
            for (k, ray) in rays.iter().enumerate() {
                if PreparedRay::can_hit(ray) {
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

/// Whether the rays start near each other and go about the same way, so that they visit the same
/// boxes. It changes nothing but the time that they take.
#[inline(always)]
fn are_close(rays: &[Ray], extent: f32) -> bool {
    let first = &rays[0];
    if rays.len() == 1 || !rays.iter().all(PreparedRay::can_hit) {
        return false;
    }
    let length = CLOSE_COSINE_SQUARED * first.direction.length_squared();
    for ray in &rays[1..] {
        let along = ray.direction.dot(first.direction);
        let apart = (ray.origin - first.origin).abs().max_element();
        let bound = length * ray.direction.length_squared();
        // Where the products overflow, they are not close.
        if !(along > 0.0 && along * along > bound && apart <= extent * (1.0 / 32.0)) {
            return false;
        }
    }
    true
}
