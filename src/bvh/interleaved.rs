//! Many rays in flight, interleaved: each in turn takes one step.
//!
//! A ray waits for memory at nearly every step unless the hierarchy fits the caches. So it asks for what
//! it needs next, and the others go on until it is there. All that are at a node take their step, then
//! all at a leaf, then all that are finished, so that branches are predicted.

use super::kernel8::LeafKernel;
use super::traverse::{Entry, Walk};
use super::{Bvh, Child};
use crate::geometry::{Hit, Ray};
use fearless_simd::Simd;

/// Rays in flight, each in a slot of its own. With 16 or 64 nothing changed beyond the noise.
pub(super) const SLOTS: usize = 32;

/// Numbers of some slots.
#[derive(Clone, Copy)]
struct List {
    members: [u8; SLOTS],
    count: usize,
}

impl List {
    const EMPTY: List = List { members: [0; SLOTS], count: 0 };

    /// Adds a slot if `is_member`, without a branch. Each slot is added once per turn, so there is room.
    #[inline(always)]
    fn add_if(&mut self, is_member: bool, slot: usize) {
        self.members[self.count % SLOTS] = slot as u8;
        self.count += is_member as usize;
    }

    #[inline(always)]
    fn iter(&self) -> impl Iterator<Item = usize> {
        self.members[..self.count].iter().map(|&slot| slot as usize % SLOTS)
    }
}

/// The slots by what their rays do next.
#[derive(Clone, Copy)]
struct Turn {
    at_node: List,
    at_leaf: List,
    finished: List,
}

impl Turn {
    const EMPTY: Turn = Turn { at_node: List::EMPTY, at_leaf: List::EMPTY, finished: List::EMPTY };

    fn is_empty(&self) -> bool {
        self.at_node.count + self.at_leaf.count + self.finished.count == 0
    }

    /// Puts a slot into its list, and asks for the memory that it needs next.
    #[inline(always)]
    fn add<K, const ANY: bool>(
        &mut self,
        slot: usize,
        walk: &mut Walk,
        bvh: &Bvh<K>,
        stack: &[Entry],
    ) {
        let child = walk.next::<ANY>(stack);
        bvh.prefetch(child);
        let (is_over, is_leaf) = (walk.is_over(), child.is_leaf());
        self.at_leaf.add_if(is_leaf, slot);
        self.finished.add_if(is_over, slot);
        self.at_node.add_if(!is_leaf & !is_over, slot);
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
    let start = |index: u32, own: &mut [Entry]| (Walk::new(&rays[index as usize], own), index);
    let mut slots = [start(first, stack); SLOTS];
    let mut ahead = Turn::EMPTY;
    let mut next = 0;
    while next < which.len().min(SLOTS) {
        slots[next] = start(which[next], &mut stack[next * share..]);
        ahead.at_node.add_if(true, next);
        next += 1;
    }
    while !ahead.is_empty() {
        let now = std::mem::replace(&mut ahead, Turn::EMPTY);
        for slot in now.at_node.iter() {
            let walk = &mut slots[slot].0;
            let own = &mut stack[slot * share..][..share];
            walk.visit_node::<S, ANY>(simd, &bvh.nodes, own);
            ahead.add::<K, ANY>(slot, walk, bvh, own);
        }
        for slot in now.at_leaf.iter() {
            let walk = &mut slots[slot].0;
            let own = &mut stack[slot * share..][..share];
            walk.visit_leaf::<S, K, ANY>(simd, bvh, own);
            ahead.add::<K, ANY>(slot, walk, bvh, own);
        }
        for slot in now.finished.iter() {
            let (walk, index) = &slots[slot];
            finish(*index as usize, walk.hit());
            if next < which.len() {
                slots[slot] = start(which[next], &mut stack[slot * share..]);
                next += 1;
                // Every ray begins at the root, which is a node.
                ahead.at_node.add_if(true, slot);
            }
        }
    }
}

const _: () = assert!(Child::ROOT.0 & Child::LEAF == 0, "a ray begins at a node");
