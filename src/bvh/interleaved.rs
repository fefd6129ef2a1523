//! Many rays in flight, interleaved: each in turn takes one step.
//!
//! A ray waits for memory at nearly every step unless the hierarchy fits the caches. So it asks for what
//! it needs next, and the others go on until it is there. All that are at a node take their step, then
//! all at a leaf, then all that are finished, so that branches are predicted.

use super::kernel8::LeafKernel;
use super::traverse::{Entry, OVER, Walk};
use super::{Bvh, Child};
use crate::geometry::{Hit, Ray};
use fearless_simd::Simd;

/// Rays in flight, each in a slot of its own. With 16 or 64 nothing changed beyond the noise.
pub(super) const SLOTS: usize = 32;

/// The lists of a [`Turn`]: a ray is at a node, at a leaf or finished.
const AT_NODE: usize = 0;
const AT_LEAF: usize = 1;
const FINISHED: usize = 2;

/// The numbers of slots, by what their rays do next.
///
/// Where the next member of a list goes is known before the ray has come so far, so that no later step waits
/// for it. One store at a place that depends on the ray, although less work, cost a sixth of the rate.
struct Turn {
    members: [[u8; SLOTS]; 3],
    counts: [usize; 3],
}

impl Turn {
    const EMPTY: Turn = Turn { members: [[0; SLOTS]; 3], counts: [0; 3] };

    /// Adds a slot if `is_member`, without a branch. Each slot is added once per turn, so there is room.
    #[inline(always)]
    fn add_if(&mut self, list: usize, is_member: bool, slot: usize) {
        self.members[list][self.counts[list] % SLOTS] = slot as u8;
        self.counts[list] += is_member as usize;
    }

    #[inline(always)]
    fn list(&self, list: usize) -> impl Iterator<Item = usize> {
        let members = &self.members[list][..self.counts[list]];
        members.iter().map(|&slot| slot as usize % SLOTS)
    }

    /// Puts a slot into its list, and asks for the memory that it needs next.
    #[inline(always)]
    fn add_next<K, const ANY: bool>(
        &mut self,
        slot: usize,
        walk: &mut Walk,
        bvh: &Bvh<K>,
        stack: &[Entry],
    ) {
        let child = walk.next::<ANY>(stack);
        bvh.prefetch(child);
        let (is_over, is_leaf) = (child == OVER, child.is_leaf());
        self.add_if(AT_LEAF, is_leaf, slot);
        self.add_if(FINISHED, is_over, slot);
        self.add_if(AT_NODE, !is_leaf & !is_over, slot);
    }
}

/// Calls `finish` with the number of each of the rays `which` and its nearest hit, or any if `ANY`.
#[inline(always)]
pub(super) fn trace_interleaved<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    rays: &[Ray],
    which: &[u32],
    stack: &mut [Entry],
    finish: &mut impl FnMut(usize, Option<Hit>),
) {
    let Some(&first) = which.first() else { return };
    let share = stack.len() / SLOTS;
    let mut walks = [Walk::new(&rays[first as usize], stack, 0); SLOTS];
    let mut numbers = [first; SLOTS];
    let mut ahead = Turn::EMPTY;
    let mut now = Turn::EMPTY;
    let mut next = 0;
    while next < which.len().min(SLOTS) {
        numbers[next] = which[next];
        walks[next] = Walk::new(&rays[which[next] as usize], stack, next * share);
        ahead.add_if(AT_NODE, true, next);
        next += 1;
    }
    while ahead.counts != [0; 3] {
        std::mem::swap(&mut now, &mut ahead);
        ahead.counts = [0; 3];
        for slot in now.list(AT_NODE) {
            let walk = &mut walks[slot];
            walk.visit_node::<S, ANY>(simd, &bvh.nodes, stack);
            ahead.add_next::<K, ANY>(slot, walk, bvh, stack);
        }
        for slot in now.list(AT_LEAF) {
            let walk = &mut walks[slot];
            walk.visit_leaf::<S, K, ANY>(simd, bvh, stack);
            ahead.add_next::<K, ANY>(slot, walk, bvh, stack);
        }
        for slot in now.list(FINISHED) {
            finish(numbers[slot] as usize, walks[slot].hit());
            if next < which.len() {
                numbers[slot] = which[next];
                walks[slot] = Walk::new(&rays[which[next] as usize], stack, slot * share);
                next += 1;
                // Every ray begins at the root, which is a node.
                ahead.add_if(AT_NODE, true, slot);
            }
        }
    }
}

const _: () = assert!(Child::ROOT.0 & Child::LEAF == 0, "a ray begins at a node");
