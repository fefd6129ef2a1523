//! A whole batch down a small hierarchy, node by node (after Barringer & Akenine-Möller, *Dynamic Ray
//! Stream Traversal*, TOG 33(4), 2014).
//!
//! One ray's way through a few boxes is over before the branch predictor has learnt it: nearly every
//! branch is mispredicted. Here each node sends the numbers of the rays that enter its
//! children to their lists, without a branch, and a leaf takes its list eight rays at a time.

use super::kernel8::LeafKernel;
use super::leaf::{Leaf, NO_RANK, id_of};
use super::node::Node;
use super::packet::{Found, Packet, band_scale, columns, longest};
use super::ray_lanes::stretched;
use super::{Bvh, Child, ChildKind, WIDTH};
use crate::geometry::{Hit, Ray};
use fearless_simd::{Simd, f32x8, mask8x32, prelude::*, u8x32};
use glam::Vec3;

/// Rays per stream: their data fits the first-level cache, and a ray's number fits a byte.
const RAYS: usize = 256;

/// Numbers of rays in a register. Behind each list there is room for one.
const LANES: usize = 32;

/// Some rays, and the numbers of a [`Packet`] that are more than those of the rays, one row per kind.
#[derive(Debug)]
struct Rows {
    rays: [Ray; RAYS],
    inverse: [[f32; RAYS]; 3],
    t_scale: [f32; RAYS],
    t_max: [f32; RAYS],
    u: [f32; RAYS],
    v: [f32; RAYS],
    rank: [f32; RAYS],
}

/// A child and the rays that enter it: `lists[first..first + count]`.
#[derive(Debug, Clone, Copy)]
struct Visit {
    child: Child,
    first: usize,
    count: usize,
}

/// A thread's memory for tracing streams.
#[derive(Debug)]
pub(super) struct Stream {
    rows: Box<Rows>,
    lists: Vec<u8>,
    /// For each ray of a list, the boxes that it enters.
    entered: [u8; RAYS],
    visits: Vec<Visit>,
}

impl Stream {
    pub(super) fn new() -> Self {
        let zeros = [0.0; RAYS];
        let rows = Rows {
            rays: [Ray::new(Vec3::ZERO, Vec3::ZERO); RAYS],
            inverse: [zeros; 3],
            t_scale: zeros,
            t_max: zeros,
            u: zeros,
            v: zeros,
            rank: zeros,
        };
        Stream {
            rows: Box::new(rows),
            lists: vec![0; RAYS + LANES],
            entered: [0; RAYS],
            visits: Vec::new(),
        }
    }

    /// Calls `finish` with the number of each of the rays `which` and its nearest hit, or any if `ANY`.
    #[inline(always)]
    pub(super) fn trace<S: Simd, K: LeafKernel, const ANY: bool>(
        &mut self,
        simd: S,
        bvh: &Bvh<K>,
        rays: &[Ray],
        which: &[u32],
        finish: &mut impl FnMut(usize, Option<Hit>),
    ) {
        for which in which.chunks(RAYS) {
            self.rows.fill(simd, rays, which);
            for (ray, entry) in self.lists[..which.len()].iter_mut().enumerate() {
                *entry = ray as u8;
            }
            self.visits.push(Visit { child: Child::ROOT, first: 0, count: which.len() });
            while let Some(visit) = self.visits.pop() {
                self.visit::<S, K, ANY>(simd, bvh, visit);
            }
            for (ray, &index) in which.iter().enumerate() {
                finish(index as usize, self.rows.hit(ray));
            }
        }
    }

    #[inline(always)]
    fn visit<S: Simd, K: LeafKernel, const ANY: bool>(
        &mut self,
        simd: S,
        bvh: &Bvh<K>,
        visit: Visit,
    ) {
        let Visit { child, first, mut count } = visit;
        match child.kind() {
            ChildKind::Node(index) => self.divide(simd, &bvh.nodes[index], first, count),
            ChildKind::Leaf(start, length) => {
                let leaf = bvh.leaf(start, length);
                if ANY {
                    count = self.rows.still_searching(&mut self.lists[first..first + count]);
                }
                self.rows.intersect::<S, K, ANY>(simd, leaf, &self.lists[first..first + count]);
            }
        }
    }

    /// Sends each ray of a list on to the children that it enters.
    ///
    /// Their lists follow behind. The last of them is visited first, so that lists which it leaves
    /// behind itself are not needed any more.
    #[inline(always)]
    fn divide<S: Simd>(&mut self, simd: S, node: &Node, first: usize, count: usize) {
        let base = first + count + LANES;
        let room = count + LANES;
        if self.lists.len() < base + WIDTH * room {
            self.lists.resize(base + WIDTH * room, 0);
        }
        let (own, others) = self.lists.split_at_mut(base);
        let own = &own[first..];
        for (entered, &ray) in self.entered.iter_mut().zip(&own[..count]) {
            *entered = self.rows.enter(simd, node, ray as usize) as u8;
        }
        for slot in 0..WIDTH {
            if !node.has(slot) {
                break;
            }
            let list = &mut others[slot * room..(slot + 1) * room];
            let bit = u8x32::splat(simd, 1 << slot);
            let mut length = 0;
            for at in (0..count).step_by(LANES) {
                let entered = u8x32::from_slice(simd, &self.entered[at..at + LANES]) & bit;
                let valid = u64::MAX >> (64 - (count - at).min(LANES));
                let mask = entered.simd_eq(bit).to_bitmask() & valid;
                let rays = u8x32::from_slice(simd, &own[at..at + LANES]);
                rays.compress(mask8x32::from_bitmask(simd, mask))
                    .store_slice(&mut list[length..length + LANES]);
                length += mask.count_ones() as usize;
            }
            if length > 0 {
                let (child, first) = (node.children[slot], base + slot * room);
                self.visits.push(Visit { child, first, count: length });
            }
        }
    }
}

impl Rows {
    #[inline(always)]
    fn fill<S: Simd>(&mut self, simd: S, rays: &[Ray], which: &[u32]) {
        for (part, which) in which.chunks(WIDTH).enumerate() {
            let mut eight = [rays[which[0] as usize]; WIDTH];
            for (ray, &index) in eight.iter_mut().zip(which) {
                *ray = rays[index as usize];
            }
            let packet = Packet::new(simd, columns(simd, eight));
            let at = part * WIDTH..(part + 1) * WIDTH;
            self.rays[at.clone()].copy_from_slice(&eight);
            let mut axis = 0;
            while axis < 3 {
                packet.inverse[axis].store_slice(&mut self.inverse[axis][at.clone()]);
                axis += 1;
            }
            packet.t_scale.store_slice(&mut self.t_scale[at.clone()]);
            packet.found.t_max.store_slice(&mut self.t_max[at.clone()]);
            self.rank[at].fill(NO_RANK);
        }
    }

    /// Which of a node's boxes a ray enters.
    #[inline(always)]
    fn enter<S: Simd>(&self, simd: S, node: &Node, ray: usize) -> u64 {
        let t_scale = self.t_scale[ray];
        let origin = self.rays[ray].origin.to_array();
        let mut near = f32x8::splat(simd, self.rays[ray].t_min * t_scale);
        let mut far = f32x8::splat(simd, self.t_max[ray] * t_scale);
        let mut axis = 0;
        while axis < 3 {
            let origin = f32x8::splat(simd, origin[axis]);
            let inverse = f32x8::splat(simd, self.inverse[axis][ray]);
            let [min, max] = &node.bounds[axis];
            let a = (f32x8::load_array_ref(simd, min) - origin) * inverse;
            let b = (f32x8::load_array_ref(simd, max) - origin) * inverse;
            near = near.max(a.min(b));
            far = far.min(a.max(b));
            axis += 1;
        }
        near.simd_le(stretched(far)).to_bitmask()
    }

    /// Asks the rays of a list about each triangle of a leaf.
    #[inline(always)]
    fn intersect<S: Simd, K: LeafKernel, const ANY: bool>(
        &mut self,
        simd: S,
        leaf: Leaf,
        list: &[u8],
    ) {
        for part in list.chunks(WIDTH) {
            let mut eight = [part[0]; WIDTH];
            eight[..part.len()].copy_from_slice(part);
            let mut packet = self.gather(simd, &eight);
            let active = (1 << part.len()) - 1;
            if K::meet_leaf::<S, ANY>(&mut packet, active, leaf) {
                self.scatter::<S, ANY>(&packet, part);
            }
        }
    }

    #[inline(always)]
    fn gather<S: Simd>(&self, simd: S, list: &[u8; WIDTH]) -> Packet<S> {
        let row = |row: &[f32; RAYS]| f32x8::load_array(simd, pick(row, list));
        let unused = f32x8::splat(simd, 0.0);
        let rays = list.map(|ray| self.rays[ray as usize]);
        let [ox, oy, oz, dx, dy, dz, t_min, _] = columns(simd, rays);
        let direction = [dx, dy, dz];
        Packet {
            simd,
            origin: [ox, oy, oz],
            direction,
            inverse: [unused; 3],
            near: None,
            t_scale: unused,
            band_scale: band_scale(longest(direction)),
            t_min,
            found: Found {
                t_max: row(&self.t_max),
                u: row(&self.u),
                v: row(&self.v),
                rank: row(&self.rank),
            },
        }
    }

    #[inline(always)]
    fn scatter<S: Simd, const ANY: bool>(&mut self, packet: &Packet<S>, list: &[u8]) {
        let t: [f32; WIDTH] = packet.found.t_max.into();
        let u: [f32; WIDTH] = packet.found.u.into();
        let v: [f32; WIDTH] = packet.found.v.into();
        let rank: [f32; WIDTH] = packet.found.rank.into();
        for (lane, &ray) in list.iter().enumerate() {
            let ray = ray as usize;
            self.rank[ray] = rank[lane];
            if ANY {
                // It enters no box and meets no triangle any more.
                if rank[lane] != NO_RANK {
                    self.t_max[ray] = f32::NEG_INFINITY;
                }
            } else {
                self.t_max[ray] = t[lane];
                self.u[ray] = u[lane];
                self.v[ray] = v[lane];
            }
        }
    }

    /// Moves the rays that have found nothing to a list's front, and counts them.
    #[inline(always)]
    fn still_searching(&self, list: &mut [u8]) -> usize {
        let mut kept = 0;
        for i in 0..list.len() {
            let ray = list[i];
            list[kept] = ray;
            kept += (self.rank[ray as usize] == NO_RANK) as usize;
        }
        kept
    }

    #[inline(always)]
    fn hit(&self, ray: usize) -> Option<Hit> {
        if self.rank[ray] == NO_RANK {
            return None;
        }
        let triangle = id_of(self.rank[ray]);
        Some(Hit { triangle, t: self.t_max[ray], u: self.u[ray], v: self.v[ray] })
    }
}

#[inline(always)]
fn pick(row: &[f32; RAYS], list: &[u8; WIDTH]) -> [f32; WIDTH] {
    let mut picked = [0.0; WIDTH];
    let mut lane = 0;
    while lane < WIDTH {
        picked[lane] = row[list[lane] as usize];
        lane += 1;
    }
    picked
}
