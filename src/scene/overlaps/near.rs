//! Pairs of boxes that touch.
//!
//! The boxes are sorted by size, then along a Morton curve; eight in a row have a box around them, eight of those
//! again, and so on. Each row of eight is compared with those behind it that its box touches.

use crate::geometry::bounds::Bounds;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Boxes, or boxes around boxes, in a row.
const FANOUT: usize = 8;

/// A numbered box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Boxed {
    pub bounds: Bounds,
    pub number: u32,
}

/// The pairs of touching boxes that are `wanted`, the lower number first, in order. `None` if more than `most`
/// pairs would have to be looked at.
pub(super) fn pairs(
    boxes: impl ExactSizeIterator<Item = Boxed>,
    wanted: impl Fn(u32, u32) -> bool + Sync,
    most: u64,
) -> Option<Vec<(u32, u32)>> {
    let tree = Tree::new(boxes.collect());
    let looked_at = AtomicU64::new(0);
    let of_row = |row: usize| {
        let is_exhausted = looked_at.load(Ordering::Relaxed) > most;
        let mut search = Search { tree: &tree, wanted: &wanted, looked_at: 0, found: Vec::new() };
        if !is_exhausted {
            search.pairs_of(row);
        }
        looked_at.fetch_add(search.looked_at, Ordering::Relaxed);
        search.found
    };
    let rows = tree.levels[0].len();
    let mut pairs: Vec<(u32, u32)> = (0..rows).into_par_iter().flat_map_iter(of_row).collect();
    if looked_at.into_inner() > most {
        return None;
    }
    pairs.sort_unstable();
    Some(pairs)
}

struct Tree {
    boxes: Vec<Boxed>,
    /// Around rows of `boxes`, then around rows of the level before.
    levels: Vec<Vec<Bounds>>,
}

impl Tree {
    fn new(boxes: Vec<Boxed>) -> Tree {
        let around = |bounds: Vec<&Bounds>| bounds.into_iter().fold(Bounds::EMPTY, Bounds::with);
        let all = around(boxes.iter().map(|boxed| &boxed.bounds).collect());
        let key =
            |(k, boxed): (usize, &Boxed)| u64::from(place(&boxed.bounds, &all)) << 32 | k as u64;
        let mut order: Vec<u64> = boxes.iter().enumerate().map(key).collect();
        order.par_sort_unstable();
        let boxes: Vec<Boxed> = order.iter().map(|key| boxes[*key as u32 as usize]).collect();
        let rows = boxes.chunks(FANOUT);
        let first =
            rows.map(|row| around(row.iter().map(|boxed| &boxed.bounds).collect())).collect();
        let mut levels: Vec<Vec<Bounds>> = vec![first];
        while let Some(below) = levels.last().filter(|level| level.len() > FANOUT) {
            let above = below.chunks(FANOUT).map(|row| around(row.iter().collect())).collect();
            levels.push(above);
        }
        Tree { boxes, levels }
    }

    fn row(&self, row: usize) -> &[Boxed] {
        &self.boxes[row * FANOUT..((row + 1) * FANOUT).min(self.boxes.len())]
    }
}

struct Search<'t, F> {
    tree: &'t Tree,
    wanted: &'t F,
    looked_at: u64,
    found: Vec<(u32, u32)>,
}

impl<F: Fn(u32, u32) -> bool> Search<'_, F> {
    /// The pairs of a row with itself and with those behind it.
    fn pairs_of(&mut self, row: usize) {
        let boxes = self.tree.row(row);
        for (k, a) in boxes.iter().enumerate() {
            self.compare(a, &boxes[k + 1..]);
        }
        let top = self.tree.levels.len() - 1;
        self.descend(row, top, 0..self.tree.levels[top].len());
    }

    fn descend(&mut self, row: usize, level: usize, nodes: Range<usize>) {
        let tree = self.tree;
        for node in nodes {
            let last_row = (node + 1) * FANOUT.pow(level as u32) - 1;
            let is_behind = last_row > row;
            if !is_behind || !tree.levels[level][node].touches(&tree.levels[0][row]) {
                continue;
            }
            if level == 0 {
                self.compare_rows(row, node);
            } else {
                let below = tree.levels[level - 1].len();
                self.descend(row, level - 1, node * FANOUT..((node + 1) * FANOUT).min(below));
            }
        }
    }

    fn compare_rows(&mut self, row: usize, other: usize) {
        let tree = self.tree;
        for a in tree.row(row) {
            if a.bounds.touches(&tree.levels[0][other]) {
                self.compare(a, tree.row(other));
            }
        }
    }

    fn compare(&mut self, a: &Boxed, others: &[Boxed]) {
        self.looked_at += others.len() as u64;
        for b in others.iter().filter(|b| b.bounds.touches(&a.bounds)) {
            let pair = (a.number.min(b.number), a.number.max(b.number));
            if (self.wanted)(pair.0, pair.1) {
                self.found.push(pair);
            }
        }
    }
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
        let number = |i: u32| {
            let [x, y, z, size] = stream.point(i);
            let at = (Vec3::new(x, y, z) * 8.0).floor();
            Bounds { min: at, max: at + (size * size * 4.0).floor() }
        };
        let boxes: Vec<Bounds> = (0..700).map(number).collect();
        let numbered =
            || boxes.iter().enumerate().map(|(k, &bounds)| Boxed { bounds, number: k as u32 });
        let odd = |a: u32, b: u32| !(a + b).is_multiple_of(3);
        let found = pairs(numbered(), odd, u64::MAX).unwrap();
        let all = (0..700).flat_map(|a| (a + 1..700).map(move |b| (a, b)));
        let touch = |&(a, b): &(u32, u32)| boxes[a as usize].touches(&boxes[b as usize]);
        let expected: Vec<_> = all.filter(touch).filter(|&(a, b)| odd(a, b)).collect();
        assert_eq!(found, expected);
        assert!(found.len() > 1000);
        assert!(pairs(numbered(), odd, 1000).is_none(), "the limit holds");
    }
}
