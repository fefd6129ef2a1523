//! Pairs of boxes that touch.
//!
//! The boxes are sorted by size, then along a Morton curve; eight in a row have a box around them, eight of those
//! again, and so on. Each row of eight is compared with those behind it that its box touches. Only the boxes
//! around rows are kept: there are as many boxes as triangles, and they are quickly made.

use crate::geometry::bounds::Bounds;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Boxes, or boxes around boxes, in a row; rows that look for others together.
const FANOUT: usize = 8;

/// Of the boxes with the numbers 0 to `count` − 1, the pairs that touch and are `wanted`, the lower number first,
/// in order. `None` if more than `most` pairs would have to be looked at.
pub(super) fn pairs(
    count: usize,
    bounds_of: impl Fn(u32) -> Bounds + Sync,
    wanted: impl Fn(u32, u32) -> bool + Sync,
    most: u64,
) -> Option<Vec<(u32, u32)>> {
    let tree = Tree::new(count, bounds_of);
    let looked_at = AtomicU64::new(0);
    let of_group = |group: usize| {
        let is_exhausted = looked_at.load(Ordering::Relaxed) > most;
        let mut search = Search { tree: &tree, wanted: &wanted, looked_at: 0, found: Vec::new() };
        if !is_exhausted {
            search.pairs_of(group);
        }
        looked_at.fetch_add(search.looked_at, Ordering::Relaxed);
        search.found
    };
    let groups = tree.levels[0].len().div_ceil(FANOUT);
    let mut pairs: Vec<(u32, u32)> = (0..groups).into_par_iter().flat_map_iter(of_group).collect();
    if looked_at.into_inner() > most {
        return None;
    }
    pairs.sort_unstable();
    Some(pairs)
}

struct Tree<B> {
    bounds_of: B,
    /// The boxes' numbers.
    order: Vec<u32>,
    /// Around rows of boxes, then around rows of the level before.
    levels: Vec<Vec<Bounds>>,
}

impl<B: Fn(u32) -> Bounds + Sync> Tree<B> {
    fn new(count: usize, bounds_of: B) -> Tree<B> {
        let all = around((0..count as u32).map(&bounds_of));
        let key =
            |number: u32| u64::from(place(&bounds_of(number), &all)) << 32 | u64::from(number);
        let mut keys: Vec<u64> = (0..count as u32).into_par_iter().map(key).collect();
        keys.par_sort_unstable();
        let order: Vec<u32> = keys.into_iter().map(|key| key as u32).collect();
        let rows = order.par_chunks(FANOUT);
        let rows = rows.map(|row| around(row.iter().map(|&number| bounds_of(number)))).collect();
        let mut levels: Vec<Vec<Bounds>> = vec![rows];
        while let Some(below) = levels.last().filter(|level| level.len() > FANOUT) {
            let above = below.chunks(FANOUT).map(|row| around(row.iter().copied())).collect();
            levels.push(above);
        }
        Tree { bounds_of, order, levels }
    }

    fn row(&self, row: usize) -> &[u32] {
        &self.order[row * FANOUT..((row + 1) * FANOUT).min(self.order.len())]
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

struct Search<'t, B, F> {
    tree: &'t Tree<B>,
    wanted: &'t F,
    looked_at: u64,
    found: Vec<(u32, u32)>,
}

impl<B: Fn(u32) -> Bounds + Sync, F: Fn(u32, u32) -> bool> Search<'_, B, F> {
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
        let boxed = |number: &u32| ((tree.bounds_of)(*number), *number);
        let own: Vec<(Bounds, u32)> = tree.row(row).iter().map(boxed).collect();
        for (k, (bounds, number)) in own.iter().enumerate() {
            self.compare(bounds, *number, &own[k + 1..]);
        }
        for &other in others.iter().filter(|&&other| other > row) {
            if !tree.levels[0][other].touches(bounds) {
                continue;
            }
            for (other, number) in tree.row(other).iter().map(boxed) {
                if other.touches(bounds) {
                    self.compare(&other, number, &own);
                }
            }
        }
    }

    fn compare(&mut self, bounds: &Bounds, number: u32, others: &[(Bounds, u32)]) {
        self.looked_at += others.len() as u64;
        for (_, other) in others.iter().filter(|(other, _)| other.touches(bounds)) {
            let pair = (number.min(*other), number.max(*other));
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
        let bounds_of = |i: u32| {
            let [x, y, z, size] = stream.point(i);
            let at = (Vec3::new(x, y, z) * 8.0).floor();
            Bounds { min: at, max: at + (size * size * 4.0).floor() }
        };
        let odd = |a: u32, b: u32| !(a + b).is_multiple_of(3);
        for count in [0, 1, 9, 70, 700] {
            let found = pairs(count as usize, bounds_of, odd, u64::MAX).unwrap();
            let all = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
            let touch = |&(a, b): &(u32, u32)| bounds_of(a).touches(&bounds_of(b));
            let expected: Vec<_> = all.filter(touch).filter(|&(a, b)| odd(a, b)).collect();
            assert_eq!(found, expected);
            assert!(count < 700 || found.len() > 1000);
        }
        assert!(pairs(700, bounds_of, odd, 1000).is_none(), "the limit holds");
    }
}
