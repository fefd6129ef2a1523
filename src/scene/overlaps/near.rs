//! Pairs of boxes that touch and whose contents are parallel.
//!
//! The boxes are sorted by size, then along a Morton curve; eight in a row have a box around them, eight of those
//! again, and so on. Each row of eight is compared with those behind it that its box touches.

use super::row::{BoxLanes, Boxes, Flat, PARALLEL, Row, WIDTH, lanes};
use crate::geometry::bounds::Bounds;
use crate::simd;
use fearless_simd::{Simd, dispatch};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Of `count` things, numbered from 0, the pairs that touch, are parallel and are `wanted`, the lower number first,
/// in order. `None` if the boxes of more than `most[0]` pairs would have to be looked at, or `wanted` would be asked
/// more than `most[1]` times. `bounds`: those of `thing` alone, which are asked for more often.
pub(super) fn pairs(
    count: usize,
    bounds: impl Fn(u32) -> Bounds + Sync,
    thing: impl Fn(u32) -> Flat + Sync,
    wanted: impl Fn(u32, u32) -> bool + Sync,
    most: [u64; 2],
) -> Option<Vec<(u32, u32)>> {
    let tree = Tree::new(count, bounds, thing);
    let groups = 0..tree.levels[0].len();
    // Some of the groups tell at little cost that boxes are of no use.
    let some = groups.clone().into_par_iter().skip(SAMPLE / 2).step_by(SAMPLE);
    pairs_of(&tree, some, &wanted, most.map(|most| most / SAMPLE as u64))?;
    let mut pairs = pairs_of(&tree, groups.into_par_iter(), &wanted, most)?;
    pairs.par_sort_unstable();
    Some(pairs)
}

/// One group of this many is looked at before all others are.
const SAMPLE: usize = 32;

/// The wanted pairs of some groups, in any order; `None` if there are too many.
fn pairs_of(
    tree: &Tree,
    groups: impl ParallelIterator<Item = usize>,
    wanted: &(impl Fn(u32, u32) -> bool + Sync),
    most: [u64; 2],
) -> Option<Vec<(u32, u32)>> {
    let level = simd::chosen();
    let counts = [AtomicU64::new(0), AtomicU64::new(0)];
    let is_exceeded =
        || counts.iter().zip(most).any(|(count, most)| count.load(Ordering::Relaxed) > most);
    let of_group = |group: usize| {
        let mut search = Search { tree, wanted, counts: [0; 2], most, found: Vec::new() };
        if !is_exceeded() {
            dispatch!(level, simd => search.pairs_of(simd, group));
        }
        for (all, count) in counts.iter().zip(search.counts) {
            all.fetch_add(count, Ordering::Relaxed);
        }
        search.found
    };
    let pairs = groups.flat_map_iter(of_group).collect();
    (!is_exceeded()).then_some(pairs)
}

struct Tree {
    /// In their order along the curve.
    rows: Vec<Row>,
    /// Around rows, then around what is on the level before; the last level has one item at most.
    levels: Vec<Vec<Boxes>>,
}

impl Tree {
    fn new(
        count: usize,
        bounds: impl Fn(u32) -> Bounds + Sync,
        thing: impl Fn(u32) -> Flat + Sync,
    ) -> Tree {
        let numbers = 0..count as u32;
        let boxes = numbers.clone().into_par_iter().map(&bounds);
        let all = boxes.reduce(|| Bounds::EMPTY, |a, b| a.with(&b));
        let placed = |number| (place(&bounds(number), &all), number);
        let mut placed: Vec<(u64, u32)> = numbers.into_par_iter().map(placed).collect();
        placed.par_sort_unstable();
        let order: Vec<u32> = placed.into_iter().map(|(_, number)| number).collect();
        let rows: Vec<Row> =
            order.par_chunks(WIDTH).map(|row| Row::new(row.iter().copied(), &thing)).collect();
        let groups = rows.par_chunks(WIDTH);
        let around = |rows: &[Row]| Boxes::new(rows.iter().map(|row| row.boxes.around()));
        let mut levels: Vec<Vec<Boxes>> = vec![groups.map(around).collect()];
        while let Some(below) = levels.last().filter(|level| level.len() > 1) {
            let above = below.chunks(WIDTH).map(|row| Boxes::new(row.iter().map(Boxes::around)));
            levels.push(above.collect());
        }
        Tree { rows, levels }
    }

    /// The groups of rows from `first` on that touch a box.
    #[inline(always)]
    fn touching<S: Simd>(&self, simd: S, other: &BoxLanes<S>, first: usize) -> Vec<usize> {
        let mut nodes = vec![0];
        for (level, boxes) in self.levels.iter().enumerate().skip(1).rev() {
            let mut children = Vec::with_capacity(32);
            for node in nodes {
                for lane in lanes(boxes[node].touching(simd, other)) {
                    let child = node * WIDTH + lane;
                    let end = (child + 1) * WIDTH.pow(level as u32 - 1);
                    if end > first {
                        children.push(child);
                    }
                }
            }
            nodes = children;
        }
        nodes
    }
}

struct Search<'t, F> {
    tree: &'t Tree,
    wanted: &'t F,
    /// Boxes that were looked at, and pairs of which it was asked whether they are wanted; and the most of them.
    counts: [u64; 2],
    most: [u64; 2],
    found: Vec<(u32, u32)>,
}

impl<F: Fn(u32, u32) -> bool> Search<'_, F> {
    /// The pairs of a group of rows with each other and with what is behind them.
    #[inline(always)]
    fn pairs_of<S: Simd>(&mut self, simd: S, group: usize) {
        let Tree { rows, levels } = self.tree;
        let own = &levels[0][group];
        let others = self.tree.touching(simd, &BoxLanes::of(simd, &own.around()), group);
        for (lane, row) in rows.iter().skip(group * WIDTH).take(WIDTH).enumerate() {
            let bounds = own.broadcast(simd, lane);
            self.pairs_within(simd, row);
            for &other in &others {
                if self.counts[0] > self.most[0] || self.counts[1] > self.most[1] {
                    return;
                }
                let touching = levels[0][other].touching(simd, &bounds);
                let before = if other == group { (2 << lane) - 1 } else { 0 };
                for lane in lanes(touching & !before) {
                    self.pairs_between(simd, (row, &bounds), &rows[other * WIDTH + lane]);
                }
            }
        }
    }

    #[inline(always)]
    fn pairs_within<S: Simd>(&mut self, simd: S, row: &Row) {
        for lane in 0..WIDTH {
            let before = (2 << lane) - 1;
            self.look(row, lane, (row, row.fitting(simd, (row, lane), PARALLEL) & !before));
        }
    }

    #[inline(always)]
    fn pairs_between<S: Simd>(
        &mut self,
        simd: S,
        (row, bounds): (&Row, &BoxLanes<S>),
        other: &Row,
    ) {
        for lane in lanes(other.boxes.touching(simd, bounds)) {
            self.counts[0] += WIDTH as u64;
            self.look(other, lane, (row, row.fitting(simd, (other, lane), PARALLEL)));
        }
    }

    /// Keeps the pairs of one thing with some of a row, as far as they are wanted.
    #[inline(always)]
    fn look(&mut self, one: &Row, lane: usize, (row, fitting): (&Row, u64)) {
        self.counts[1] += u64::from(fitting.count_ones());
        for other in lanes(fitting) {
            let (a, b) = (one.numbers[lane], row.numbers[other]);
            let pair = (a.min(b), a.max(b));
            if (self.wanted)(pair.0, pair.1) {
                self.found.push(pair);
            }
        }
    }
}

/// The bits of a coordinate within the whole: as many as tell the triangles of large scans apart.
const COORDINATE_BITS: u32 = 13;
const LARGEST: u64 = (1 << COORDINATE_BITS) - 1;

/// Boxes with near numbers have near sizes and near places: how often the whole would be divided by eight down to
/// the size; then the bits of the centre's coordinates within the whole, interleaved (Morton, 1966).
fn place(bounds: &Bounds, whole: &Bounds) -> u64 {
    // What is no number casts to 0.
    let share = bounds.diagonal().max_element() / whole.diagonal().max_element();
    // The exponent of f32 is 127 at 1.
    let divisions = (127u32.saturating_sub(share.to_bits() >> 23) / 3).min(31);
    let center: Vec3 = (bounds.center() - whole.min) / whole.diagonal();
    let [x, y, z] = center.to_array().map(|x| interleave((x * LARGEST as f32) as u64 & LARGEST));
    u64::from(divisions) << (3 * COORDINATE_BITS) | x | y << 1 | z << 2
}

/// Thirteen bits with two free ones behind each.
fn interleave(bits: u64) -> u64 {
    let apart = |bits: u64, by: u32, mask: u64| (bits | bits << by) & mask;
    let halves = apart(apart(bits, 16, 0xff_0000_ff00_00ff), 8, 0x100f_00f0_0f00_f00f);
    apart(apart(halves, 4, 0x10c3_0c30_c30c_30c3), 2, 0x1249_2492_4924_9249)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{PointSet, Purpose, Stream};

    #[test]
    fn two_bits_are_left_free_behind_each() {
        for bits in 0..8192u64 {
            let each = (0..13).fold(0, |all, bit| all | (bits >> bit & 1) << (3 * bit));
            assert_eq!(interleave(bits), each);
        }
    }

    #[test]
    fn all_pairs_are_found_that_comparing_each_with_each_finds() {
        let stream = Stream::new(5, Purpose::Pair, 0, PointSet::Random);
        let thing = |i: u32| {
            let [x, y, z, size] = stream.point(i);
            let at = (Vec3::new(x, y, z) * 8.0).floor();
            let bounds = Bounds { min: at, max: at + (size * size * 4.0).floor() };
            Flat { bounds, normal: if i.is_multiple_of(4) { Vec3::X } else { Vec3::NEG_Y } }
        };
        let bounds = |i: u32| thing(i).bounds;
        let odd = |a: u32, b: u32| !(a + b).is_multiple_of(3);
        for count in [0, 1, 9, 70, 700] {
            let found = pairs(count as usize, bounds, thing, odd, [u64::MAX; 2]).unwrap();
            let all = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
            let fits = |&(a, b): &(u32, u32)| {
                let is_parallel = a.is_multiple_of(4) == b.is_multiple_of(4);
                is_parallel && thing(a).bounds.touches(&thing(b).bounds) && odd(a, b)
            };
            assert_eq!(found, all.filter(fits).collect::<Vec<_>>());
            assert!(count < 700 || found.len() > 1000);
        }
        for most in [[1000, u64::MAX], [u64::MAX, 1000]] {
            assert!(pairs(700, bounds, thing, odd, most).is_none(), "the limits hold");
        }
    }
}
