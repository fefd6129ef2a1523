//! Pairs of triangles that may overlap, where boxes do not tell them apart: the boxes of all triangles of a fan meet
//! at its apex, and those of long diagonal triangles lie across each other.
//!
//! Triangles that do not overlap are told apart by their own edges. So the plane is divided by the line through one
//! of them, each half again, and so on; a triangle on both sides is cut in two. Lines through edges chosen at random
//! cut n segments that do not cross into about n log n pieces (Paterson & Yao, "Efficient binary space partitions
//! for hidden-surface removal and solid modeling", 1990).

use super::cut::{Cut, Piece, RIM, View};
use super::row::Flat;
use crate::geometry::Triangle;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// This many pieces are compared with each other.
const FEW: usize = 12;

/// Two pieces may lose twice their rims at each division: all that they lose is no wider than what counts as an
/// overlap.
const DEEPEST: u32 = (0.25 / RIM) as u32;

/// Pieces by which a division is judged, and those of them whose edges and planes may divide.
const JUDGES: usize = 16;
const CANDIDATES: usize = 3;

/// A division must leave fewer pairs to compare than this share.
const WORTHWHILE: f64 = 0.85;

/// The pairs of triangles that touch, are parallel and are `wanted`, the lower number first, in order. Only triangles
/// that overlap, as seen along the axis of the first one's normal, may be wanted. `None` if along some axis more than
/// `most[0]` pieces and pairs would have to be looked at, or more than `most[1]` are wanted.
pub(super) fn pairs(
    triangles: &[Triangle],
    flat: impl Fn(u32) -> Flat + Sync,
    wanted: impl Fn(u32, u32) -> bool + Sync,
    most: [u64; 2],
) -> Option<Vec<(u32, u32)>> {
    let of_axis = |axis: usize| {
        let [looked_at, found] = [AtomicU64::new(0), AtomicU64::new(0)];
        let view = View { axis, triangles };
        let numbers = (0..triangles.len() as u32).into_par_iter();
        let seen = numbers.filter(|&number| may_be_seen_along(axis, &triangles[number as usize]));
        let pieces: Vec<Piece> = seen.map(Piece::whole).collect();
        let counts = [&looked_at, &found];
        let search = Search { view, flat: &flat, wanted: &wanted, counts, most };
        let pairs = search.pairs(pieces, 0);
        let is_within = looked_at.into_inner() <= most[0] && found.into_inner() <= most[1];
        is_within.then_some(pairs)
    };
    let mut pairs = (0..3).map(of_axis).collect::<Option<Vec<_>>>()?.concat();
    pairs.par_sort_unstable();
    pairs.dedup();
    Some(pairs)
}

/// Whether the axis may be that of a parallel triangle's normal.
fn may_be_seen_along(axis: usize, triangle: &Triangle) -> bool {
    // Where two components are equal, an angle with the cosine `PARALLEL` changes their ratio by 5 %.
    const SLACK: f32 = 1.06;
    let n = triangle.normal().abs();
    n[axis] * SLACK >= n.max_element()
}

/// A search among triangles that are seen along one axis.
struct Search<'t, F, W> {
    view: View<'t>,
    flat: &'t F,
    wanted: &'t W,
    /// What was looked at, and found; and the most of either.
    counts: [&'t AtomicU64; 2],
    most: [u64; 2],
}

impl<F: Fn(u32) -> Flat + Sync, W: Fn(u32, u32) -> bool + Sync> Search<'_, F, W> {
    /// The wanted pairs of some pieces, some of them more than once.
    fn pairs(&self, pieces: Vec<Piece>, depth: u32) -> Vec<(u32, u32)> {
        const MANY: usize = 2000;
        let count = pieces.len();
        if !self.may_look_at(count) {
            return Vec::new();
        }
        let cut = (count > FEW && depth < DEEPEST).then(|| self.best_cut(&pieces)).flatten();
        let Some(cut) = cut else { return self.compared(&pieces) };
        let [left, right] = self.divided(pieces, &cut);
        let below = |pieces| self.pairs(pieces, depth + 1);
        let (mut pairs, more) = if count > MANY {
            rayon::join(|| below(left), || below(right))
        } else {
            (below(left), below(right))
        };
        pairs.extend(more);
        pairs
    }

    /// Counts what is to be looked at; `false` if it is too much, or too much has been found.
    fn may_look_at(&self, more: usize) -> bool {
        self.counts[0].fetch_add(more as u64, Ordering::Relaxed);
        self.counts.iter().zip(self.most).all(|(count, most)| count.load(Ordering::Relaxed) <= most)
    }

    fn compared(&self, pieces: &[Piece]) -> Vec<(u32, u32)> {
        let flats: Vec<Flat> = pieces.iter().map(|piece| (self.flat)(piece.number)).collect();
        let mut pairs = Vec::new();
        for (k, piece) in pieces.iter().enumerate() {
            if !self.may_look_at(pieces.len() - k - 1) {
                break;
            }
            let before = pairs.len();
            for other in k + 1..pieces.len() {
                let [a, b] = [piece.number, pieces[other].number];
                let pair = (a.min(b), a.max(b));
                let is_seen = || self.view.is_axis_of(pair.0);
                if flats[k].fits(&flats[other]) && is_seen() && (self.wanted)(pair.0, pair.1) {
                    pairs.push(pair);
                }
            }
            self.counts[1].fetch_add((pairs.len() - before) as u64, Ordering::Relaxed);
        }
        pairs
    }

    fn divided(&self, pieces: Vec<Piece>, cut: &Cut) -> [Vec<Piece>; 2] {
        let [mut left, mut right] = [(); 2].map(|()| Vec::with_capacity(pieces.len() / 2));
        for piece in pieces {
            match self.view.sides(cut, &piece) {
                [true, true] => {
                    let [on_left, on_right] = self.view.parts(cut, piece);
                    left.push(on_left);
                    right.push(on_right);
                }
                [true, false] => left.push(piece),
                [false, _] => right.push(piece),
            }
        }
        [left, right]
    }

    /// The cut that leaves the fewest pairs to compare, judged by some of the pieces.
    fn best_cut(&self, pieces: &[Piece]) -> Option<Cut> {
        let judges = some_of(pieces);
        let pairs_left = |cut: &Cut| {
            let sides = judges.iter().map(|judge| self.view.sides(cut, judge));
            let [left, right] = sides.fold([0, 0], |[left, right], [is_left, is_right]| {
                [left + usize::from(is_left), right + usize::from(is_right)]
            });
            left * left + right * right
        };
        let own = judges.iter().take(CANDIDATES).flat_map(|judge| self.view.cuts_at(judge));
        let cuts = own.chain(self.view.cuts_amid(&judges)).map(|cut| (pairs_left(&cut), cut));
        let (pairs, cut) = cuts.min_by_key(|(pairs, _)| *pairs)?;
        let all = judges.len() * judges.len();
        ((pairs as f64) < WORTHWHILE * all as f64).then_some(cut)
    }
}

/// Some of many pieces, in an order that has no rhythm and leaves nothing out: that of the golden ratio.
fn some_of(pieces: &[Piece]) -> Vec<&Piece> {
    const GOLDEN: u64 = 0x9e37_79b9;
    let place = |k: u64| ((k * GOLDEN % (1 << 32) * pieces.len() as u64) >> 32) as usize;
    (0..JUDGES as u64).map(|k| &pieces[place(k)]).collect()
}
