//! Pairs of boxes that touch and whose contents are parallel.
//!
//! The boxes are sorted by size, then along a Morton curve; eight in a row have a box around them, eight of those
//! again, and so on. Each row of eight is compared with those behind it that its box touches.

use crate::geometry::bounds::Bounds;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Boxes, or boxes around boxes, in a row; rows that look for others together.
const FANOUT: usize = 8;

/// Normals with a smaller cosine between them are not those of one plane. Within the tolerance of rays two
/// planes at a degree stay together for a few thousandths of a percent of the scene only.
pub(super) const PARALLEL: f32 = 0.9998;

/// Something flat in a box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Flat {
    pub bounds: Bounds,
    /// Of length 1, or 0 for what is parallel to nothing.
    pub normal: Vec3,
}

impl Flat {
    fn may_overlap(&self, other: &Flat) -> bool {
        self.bounds.touches(&other.bounds) && self.normal.dot(other.normal).abs() > PARALLEL
    }
}

/// Of `count` things, numbered from 0, the pairs that touch, are parallel and are `wanted`, the lower number first,
/// in order. `None` if more than `most[0]` pairs would have to be looked at, or more than `most[1]` are wanted.
pub(super) fn pairs(
    count: usize,
    thing: impl Fn(u32) -> Flat + Sync,
    wanted: impl Fn(u32, u32) -> bool + Sync,
    most: [u64; 2],
) -> Option<Vec<(u32, u32)>> {
    let tree = Tree::new(count, thing);
    let [looked_at, found] = [AtomicU64::new(0), AtomicU64::new(0)];
    let is_exceeded =
        || looked_at.load(Ordering::Relaxed) > most[0] || found.load(Ordering::Relaxed) > most[1];
    let of_group = |group: usize| {
        let mut search = Search { tree: &tree, wanted: &wanted, looked_at: 0, found: Vec::new() };
        if !is_exceeded() {
            search.pairs_of(group);
        }
        looked_at.fetch_add(search.looked_at, Ordering::Relaxed);
        found.fetch_add(search.found.len() as u64, Ordering::Relaxed);
        search.found
    };
    let groups = tree.levels[0].len().div_ceil(FANOUT);
    let mut pairs: Vec<(u32, u32)> = (0..groups).into_par_iter().flat_map_iter(of_group).collect();
    if is_exceeded() {
        return None;
    }
    pairs.sort_unstable();
    Some(pairs)
}

struct Tree {
    /// In their order along the curve, with their numbers.
    things: Vec<(Flat, u32)>,
    /// Around rows of boxes, then around rows of the level before.
    levels: Vec<Vec<Bounds>>,
}

impl Tree {
    fn new(count: usize, thing: impl Fn(u32) -> Flat + Sync) -> Tree {
        let all = around((0..count as u32).map(|number| thing(number).bounds));
        let key =
            |number: u32| u64::from(place(&thing(number).bounds, &all)) << 32 | u64::from(number);
        let mut keys: Vec<u64> = (0..count as u32).into_par_iter().map(key).collect();
        keys.par_sort_unstable();
        let numbered = |key: u64| (thing(key as u32), key as u32);
        let things: Vec<(Flat, u32)> = keys.into_par_iter().map(numbered).collect();
        let rows = things.par_chunks(FANOUT);
        let rows = rows.map(|row| around(row.iter().map(|(thing, _)| thing.bounds))).collect();
        let mut levels: Vec<Vec<Bounds>> = vec![rows];
        while let Some(below) = levels.last().filter(|level| level.len() > FANOUT) {
            let above = below.chunks(FANOUT).map(|row| around(row.iter().copied())).collect();
            levels.push(above);
        }
        Tree { things, levels }
    }

    fn row(&self, row: usize) -> &[(Flat, u32)] {
        &self.things[row * FANOUT..((row + 1) * FANOUT).min(self.things.len())]
    }

    /// Adds the rows from `first` on that touch a box.
    fn touching(&self, bounds: &Bounds, first: usize, rows: &mut Vec<usize>) {
        let top = self.levels.len() - 1;
        self.descend(bounds, first, (top, 0..self.levels[top].len()), rows);
    }

    fn descend(
        &self,
        bounds: &Bounds,
        first: usize,
        (level, nodes): (usize, Range<usize>),
        rows: &mut Vec<usize>,
    ) {
        for node in nodes {
            let end = (node + 1) * FANOUT.pow(level as u32);
            if end <= first || !self.levels[level][node].touches(bounds) {
                continue;
            }
            if level == 0 {
                rows.push(node);
            } else {
                let below = self.levels[level - 1].len();
                let children = node * FANOUT..((node + 1) * FANOUT).min(below);
                self.descend(bounds, first, (level - 1, children), rows);
            }
        }
    }
}

struct Search<'t, F> {
    tree: &'t Tree,
    wanted: &'t F,
    looked_at: u64,
    found: Vec<(u32, u32)>,
}

impl<F: Fn(u32, u32) -> bool> Search<'_, F> {
    /// The pairs of a group of rows with each other and with what is behind them.
    fn pairs_of(&mut self, group: usize) {
        let rows = group * FANOUT..((group + 1) * FANOUT).min(self.tree.levels[0].len());
        let bounds = around(self.tree.levels[0][rows.clone()].iter().copied());
        let mut others = Vec::new();
        self.tree.touching(&bounds, rows.start, &mut others);
        for row in rows {
            self.pairs_of_row(row, &others);
        }
    }

    fn pairs_of_row(&mut self, row: usize, others: &[usize]) {
        let tree = self.tree;
        let bounds = &tree.levels[0][row];
        let own = tree.row(row);
        for (k, thing) in own.iter().enumerate() {
            self.compare(thing, &own[k + 1..]);
        }
        for &other in others.iter().filter(|&&other| other > row) {
            if !tree.levels[0][other].touches(bounds) {
                continue;
            }
            for other in tree.row(other).iter().filter(|(other, _)| other.bounds.touches(bounds)) {
                self.compare(other, own);
            }
        }
    }

    fn compare(&mut self, (thing, number): &(Flat, u32), others: &[(Flat, u32)]) {
        self.looked_at += others.len() as u64;
        for (_, other) in others.iter().filter(|(other, _)| other.may_overlap(thing)) {
            let pair = (*number.min(other), *number.max(other));
            if (self.wanted)(pair.0, pair.1) {
                self.found.push(pair);
            }
        }
    }
}

fn around(boxes: impl Iterator<Item = Bounds>) -> Bounds {
    boxes.fold(Bounds::EMPTY, |all, bounds| all.with(&bounds))
}

/// Boxes with near numbers have near sizes and near places: how often the whole would be halved down to the size;
/// then the bits of the centre's coordinates within the whole, 9 of each, interleaved (Morton, 1966).
fn place(bounds: &Bounds, whole: &Bounds) -> u32 {
    // What is no number casts to 0.
    let share = bounds.diagonal().max_element() / whole.diagonal().max_element();
    // The exponent of f32 is 127 at 1.
    let halvings = 127u32.saturating_sub(share.to_bits() >> 23).min(31);
    let spread = |x: f32| {
        let x = (x * 511.0) as u32 & 511;
        (0..9).fold(0, |bits, bit| bits | (x >> bit & 1) << (3 * bit))
    };
    let center: Vec3 = (bounds.center() - whole.min) / whole.diagonal();
    let [x, y, z] = center.to_array().map(spread);
    halvings << 27 | x | y << 1 | z << 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{PointSet, Purpose, Stream};

    #[test]
    fn all_pairs_are_found_that_comparing_each_with_each_finds() {
        let stream = Stream::new(5, Purpose::Pair, 0, PointSet::Random);
        let thing = |i: u32| {
            let [x, y, z, size] = stream.point(i);
            let at = (Vec3::new(x, y, z) * 8.0).floor();
            let bounds = Bounds { min: at, max: at + (size * size * 4.0).floor() };
            Flat { bounds, normal: if i.is_multiple_of(4) { Vec3::X } else { Vec3::NEG_Y } }
        };
        let odd = |a: u32, b: u32| !(a + b).is_multiple_of(3);
        for count in [0, 1, 9, 70, 700] {
            let found = pairs(count as usize, thing, odd, [u64::MAX; 2]).unwrap();
            let all = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
            let fits = |&(a, b): &(u32, u32)| {
                let is_parallel = a.is_multiple_of(4) == b.is_multiple_of(4);
                is_parallel && thing(a).bounds.touches(&thing(b).bounds) && odd(a, b)
            };
            assert_eq!(found, all.filter(fits).collect::<Vec<_>>());
            assert!(count < 700 || found.len() > 1000);
        }
        for most in [[1000, u64::MAX], [u64::MAX, 1000]] {
            assert!(pairs(700, thing, odd, most).is_none(), "the limits hold");
        }
    }
}
