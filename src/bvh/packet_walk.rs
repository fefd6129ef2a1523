//! The walk of a packet: eight rays down the hierarchy, as long as they stay together.
//!
//! A box or a triangle is fetched once for eight rays, and a branch that a processor cannot predict (is this
//! box entered?) is taken once for all of them. A ray that is left over goes on as a single ray (Benthin
//! et al., *Combining Single and Packet-Ray Tracing for Arbitrary Ray Distributions on the Intel MIC
//! Architecture*, TVCG 18(9), 2012).

use super::beam::Beam;
use super::kernel8::LeafKernel;
use super::leaf::rank_of;
use super::packet::Packet;
use super::traverse::{Entry, Walk, walk_on};
use super::{Bvh, Child, ChildKind, WIDTH};
use crate::geometry::{Hit, Ray};
use fearless_simd::{Simd, f32x8, prelude::*};

/// From this node on, counted per packet, the packet's [`Beam`] is tested too. From the first node on it
/// cost the Cornell box a third of its rate.
const BEAM_FROM_NODE: u32 = 4;

/// A child, the rays that have to visit it (as a mask), and where the first of them enters.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    child: Child,
    rays: u32,
    entry: f32,
}

impl Group {
    pub(super) const NONE: Group = Group { child: Child::ROOT, rays: 0, entry: 0.0 };
}

/// The nearest hits of the first `count` of eight rays, or any hits if `ANY`.
#[inline(always)]
pub(super) fn trace_packet<S: Simd, K: LeafKernel, const ANY: bool>(
    mut packet: Packet<S>,
    bvh: &Bvh<K>,
    rays: &[Ray; WIDTH],
    count: usize,
    groups: &mut [Group],
    stack: &mut [Entry],
) -> [Option<Hit>; WIDTH] {
    let mut beam = None;
    let mut nodes = 0;
    let all = (1 << count) - 1;
    let mut current = Group { child: Child::ROOT, rays: all as u32, entry: f32::NEG_INFINITY };
    let mut waiting = 0;
    loop {
        let mut active = packet.reaching(current.entry) & current.rays as u64;
        if ANY {
            active &= packet.searching();
        }
        match active.count_ones() {
            0 => {}
            1 => {
                let lane = active.trailing_zeros() as usize;
                continue_single::<S, K, ANY>(
                    &mut packet,
                    &rays[lane],
                    bvh,
                    lane,
                    current.child,
                    stack,
                );
            }
            _ => match current.child.kind() {
                ChildKind::Node(index) => {
                    nodes += 1;
                    if nodes == BEAM_FROM_NODE {
                        beam = Some(Beam::new(&packet));
                    }
                    waiting = push_entered(&packet, &beam, bvh, index, active, groups, waiting);
                }
                ChildKind::Leaf(first, count) => {
                    let leaf = bvh.leaf(first, count);
                    K::meet_leaf::<S, ANY>(&mut packet, active, leaf);
                }
            },
        }
        if waiting == 0 || (ANY && packet.searching() & all == 0) {
            return packet.hits();
        }
        waiting -= 1;
        current = groups[waiting];
    }
}

/// Pushes the children that some ray enters, farthest first, and returns the stack's new height.
#[inline(always)]
fn push_entered<S: Simd, K>(
    packet: &Packet<S>,
    beam: &Option<Beam<S>>,
    bvh: &Bvh<K>,
    index: usize,
    active: u64,
    groups: &mut [Group],
    bottom: usize,
) -> usize {
    let node = &bvh.nodes[index];
    let mut top = bottom;
    let (mut candidates, entries) = match beam {
        Some(beam) => beam.enter(packet, node),
        None => (node.slots(packet.simd), [0.0; WIDTH]),
    };
    let interval = packet.interval();
    while candidates != 0 {
        let slot = candidates.trailing_zeros() as usize;
        candidates &= candidates - 1;
        let (entered, near) = packet.enter(node, slot, interval);
        let rays = entered.to_bitmask() & active;
        if rays != 0 {
            let child = node.children[slot];
            bvh.prefetch(child);
            let entry = match beam {
                Some(_) => entries[slot],
                None => entered.select(near, f32x8::splat(packet.simd, f32::INFINITY)).reduce_min(),
            };
            let mut i = top;
            while i > bottom && groups[i - 1].entry < entry {
                groups[i] = groups[i - 1];
                i -= 1;
            }
            groups[i] = Group { child, rays: rays as u32, entry };
            top += 1;
        }
    }
    top
}

/// One ray of the packet through everything below `child`.
#[inline(always)]
fn continue_single<S: Simd, K: LeafKernel, const ANY: bool>(
    packet: &mut Packet<S>,
    ray: &Ray,
    bvh: &Bvh<K>,
    lane: usize,
    child: Child,
    stack: &mut [Entry],
) {
    let before = packet.hit(lane);
    let walk = Walk::resume(ray, before, child, stack, 0);
    let hit = walk_on::<S, K, ANY>(packet.simd, bvh, walk, stack);
    if hit != before
        && let Some(hit) = hit
    {
        let set = |lanes: &mut f32x8<S>, value: f32| {
            let mut values: [f32; WIDTH] = (*lanes).into();
            values[lane] = value;
            *lanes = f32x8::load_array(packet.simd, values);
        };
        set(&mut packet.found.rank, rank_of(hit.triangle));
        set(&mut packet.found.t_max, hit.t);
        set(&mut packet.found.u, hit.u);
        set(&mut packet.found.v, hit.v);
    }
}
