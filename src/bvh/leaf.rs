//! Triangles as leaves hold them: packed without a gap, and loaded eight at a time.

use super::WIDTH;
use super::pages::with_room;
use crate::geometry::{Triangle, TriangleId};
use fearless_simd::{Simd, f32x8, prelude::*};
use rayon::prelude::*;

/// Numbers per triangle: p₀, e₁, e₂ (three each), its reach and the rank of its id.
pub(super) const WORDS: usize = 11;
pub(super) const REACH: usize = 9;
pub(super) const RANK: usize = 10;

/// Leaf after leaf; within a leaf of n triangles the numbers of one kind, n of them, lie together.
///
/// So nothing is padded, and eight lanes can be loaded from any leaf: lanes beyond its triangles
/// hold something else and are masked.
#[derive(Debug)]
pub(super) struct Leaves {
    pub words: Vec<f32>,
}

impl Leaves {
    /// Leaves that hold `counts` of the triangles with these `numbers`, one after the other.
    pub(super) fn new(triangles: &[Triangle], numbers: &[u32], counts: &[u8]) -> Self {
        let count = numbers.len() * WORDS + WIDTH;
        let mut words = with_room(count);
        words.resize(count, 0.0);
        let (mut rest_of_words, mut rest) = (&mut words[..], numbers);
        let mut parts = Vec::new();
        for counts in counts.chunks(1024) {
            let length = counts.iter().map(|&count| count as usize).sum();
            let (numbers, words);
            (numbers, rest) = rest.split_at(length);
            (words, rest_of_words) = rest_of_words.split_at_mut(length * WORDS);
            parts.push((words, numbers, counts));
        }
        parts.into_par_iter().for_each(|(mut words, mut numbers, counts)| {
            for &count in counts {
                let (own_words, own_numbers);
                (own_words, words) = words.split_at_mut(count as usize * WORDS);
                (own_numbers, numbers) = numbers.split_at(count as usize);
                fill(own_words, own_numbers, triangles);
            }
        });
        Leaves { words }
    }

    /// The words of a leaf, and the lanes behind them.
    #[inline(always)]
    pub(super) fn words_of(&self, first: usize, count: usize) -> &[f32] {
        &self.words[first * WORDS..(first + count) * WORDS + WIDTH]
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.words[..])
    }
}

fn fill(words: &mut [f32], numbers: &[u32], triangles: &[Triangle]) {
    let count = numbers.len();
    for (i, &number) in numbers.iter().enumerate() {
        let triangle = &triangles[number as usize];
        let (e1, e2) = triangle.edges();
        let vectors = [triangle.p[0], e1, e2].map(|vector| vector.to_array());
        for (kind, &word) in vectors.as_flattened().iter().enumerate() {
            words[kind * count + i] = word;
        }
        words[REACH * count + i] = triangle.reach();
        words[RANK * count + i] = rank_of(TriangleId(number));
    }
}

/// Up to eight triangles.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    pub words: &'a [f32],
    pub count: usize,
    /// Those of the whole scene.
    pub triangles: &'a [Triangle],
}

impl Leaf<'_> {
    /// p₀, e₁ or e₂ of each triangle.
    #[inline(always)]
    pub fn vectors<S: Simd>(&self, simd: S, vector: usize) -> [f32x8<S>; 3] {
        let kind = 3 * vector;
        [self.lanes(simd, kind), self.lanes(simd, kind + 1), self.lanes(simd, kind + 2)]
    }

    #[inline(always)]
    pub fn reaches<S: Simd>(&self, simd: S) -> f32x8<S> {
        self.lanes(simd, REACH)
    }

    /// p₀, e₁ or e₂ of one triangle, in all lanes.
    #[inline(always)]
    pub fn vector<S: Simd>(&self, simd: S, vector: usize, number: usize) -> [f32x8<S>; 3] {
        let kind = 3 * vector;
        [
            f32x8::splat(simd, self.word(kind, number)),
            f32x8::splat(simd, self.word(kind + 1, number)),
            f32x8::splat(simd, self.word(kind + 2, number)),
        ]
    }

    #[inline(always)]
    pub fn reach(&self, number: usize) -> f32 {
        self.word(REACH, number)
    }

    #[inline(always)]
    pub fn rank(&self, number: usize) -> f32 {
        self.word(RANK, number)
    }

    #[inline(always)]
    pub fn id(&self, number: usize) -> TriangleId {
        id_of(self.rank(number))
    }

    pub fn triangle(&self, number: usize) -> &Triangle {
        &self.triangles[self.id(number).index()]
    }

    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S, kind: usize) -> f32x8<S> {
        f32x8::from_slice(simd, &self.words[kind * self.count..][..WIDTH])
    }

    #[inline(always)]
    fn word(&self, kind: usize, number: usize) -> f32 {
        self.words[kind * self.count + number]
    }
}

/// Added to an id's bits it makes them a normal number. By themselves they would be a denormal, with
/// which some processors compute slowly, and unused lanes do hold them.
const NORMAL_BIT: u32 = 1 << 30;

/// Above the rank of every triangle.
pub(super) const NO_RANK: f32 = f32::INFINITY;

/// A positive number that grows with the id, so that lanes can compare ids as they compare t.
#[inline(always)]
pub(super) fn rank_of(id: TriangleId) -> f32 {
    f32::from_bits(id.0 | NORMAL_BIT)
}

/// The id of that rank.
#[inline(always)]
pub(super) fn id_of(rank: f32) -> TriangleId {
    TriangleId(rank.to_bits() & !NORMAL_BIT)
}
