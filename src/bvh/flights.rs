//! Many rays in flight, each a step at a time.
//!
//! A ray waits for memory at nearly every step unless the hierarchy fits the caches. So it asks for what
//! it needs next, and the others go on until it is there. All that are at a node take their step, then
//! all at a leaf, then all that are over: so the processor knows what comes next.

use super::leaf_kernel::LeafKernel;
use super::traverse::{Entry, Walk};
use super::{Bvh, Child};
use crate::geometry::{Hit, Ray};
use fearless_simd::Simd;

/// Rays in flight. With 16 or 64 nothing changed beyond the noise.
pub const FLIGHTS: usize = 32;

/// The numbers of some flights.
#[derive(Clone, Copy)]
struct List {
    members: [u8; FLIGHTS],
    count: usize,
}

impl List {
    const EMPTY: List = List { members: [0; FLIGHTS], count: 0 };

    /// Adds a flight if `is_member`, without a branch. Each is sorted in once a turn, so there is room.
    #[inline(always)]
    fn add_if(&mut self, is_member: bool, flight: usize) {
        self.members[self.count % FLIGHTS] = flight as u8;
        self.count += is_member as usize;
    }

    #[inline(always)]
    fn iter(&self) -> impl Iterator<Item = usize> {
        self.members[..self.count].iter().map(|&flight| flight as usize % FLIGHTS)
    }
}

/// The flights by what they have before them.
#[derive(Clone, Copy)]
struct Turn {
    at_node: List,
    at_leaf: List,
    over: List,
}

impl Turn {
    const EMPTY: Turn = Turn { at_node: List::EMPTY, at_leaf: List::EMPTY, over: List::EMPTY };

    fn is_empty(&self) -> bool {
        self.at_node.count + self.at_leaf.count + self.over.count == 0
    }

    /// Sorts a flight in, and asks for the memory that it needs next.
    #[inline(always)]
    fn add<K, const ANY: bool>(
        &mut self,
        flight: usize,
        walk: &mut Walk,
        bvh: &Bvh<K>,
        stack: &[Entry],
    ) {
        let child = walk.next::<ANY>(stack);
        bvh.prefetch(child);
        let (is_over, is_leaf) = (walk.is_over(), child.is_leaf());
        self.at_leaf.add_if(is_leaf, flight);
        self.over.add_if(is_over, flight);
        self.at_node.add_if(!is_leaf & !is_over, flight);
    }
}

/// Calls `finish` with the number of each of the rays `which` and its nearest hit, or any if `ANY`.
#[inline(always)]
pub fn fly<S: Simd, K: LeafKernel, const ANY: bool>(
    simd: S,
    bvh: &Bvh<K>,
    rays: &[Ray],
    which: &[u32],
    stack: &mut [Entry],
    finish: &mut impl FnMut(usize, Option<Hit>),
) {
    let Some(&first) = which.first() else { return };
    let share = stack.len() / FLIGHTS;
    let take_off = |index: u32, own: &mut [Entry]| (Walk::new(&rays[index as usize], own), index);
    let mut flights = [take_off(first, stack); FLIGHTS];
    let mut ahead = Turn::EMPTY;
    let mut next = 0;
    while next < which.len().min(FLIGHTS) {
        flights[next] = take_off(which[next], &mut stack[next * share..]);
        ahead.at_node.add_if(true, next);
        next += 1;
    }
    while !ahead.is_empty() {
        let now = std::mem::replace(&mut ahead, Turn::EMPTY);
        for flight in now.at_node.iter() {
            let walk = &mut flights[flight].0;
            let own = &mut stack[flight * share..][..share];
            walk.visit_node::<S, ANY>(simd, &bvh.nodes, own);
            ahead.add::<K, ANY>(flight, walk, bvh, own);
        }
        for flight in now.at_leaf.iter() {
            let walk = &mut flights[flight].0;
            let own = &mut stack[flight * share..][..share];
            walk.visit_leaf::<S, K, ANY>(simd, bvh, own);
            ahead.add::<K, ANY>(flight, walk, bvh, own);
        }
        for flight in now.over.iter() {
            let (walk, index) = &flights[flight];
            finish(*index as usize, walk.hit());
            if next < which.len() {
                flights[flight] = take_off(which[next], &mut stack[flight * share..]);
                next += 1;
                // Every ray begins at the root, which is a node.
                ahead.at_node.add_if(true, flight);
            }
        }
    }
}

const _: () = assert!(Child::ROOT.0 & Child::LEAF == 0, "a flight begins at a node");
