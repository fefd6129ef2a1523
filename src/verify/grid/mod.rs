//! Integer grids: triangles and rays of integers so small that only quotients are rounded, and so
//! exact agreement is demanded, bit for bit.
//!
//! Vertices lie from 0 to 16, origins from −16 to 32: |e| ≤ 16, |s| ≤ 32 and |d| ≤ 32, components of
//! d × e₂ and s × e₁ are at most 2·32·16 = 2¹⁰, and so Cramer's determinants at most 3·2¹⁰·32 < 2¹⁷ and
//! w at most 3·2¹⁷ < 2²⁴: exact in f32, however they are grouped. The band in which
//! [`MollerTrumbore`](crate::geometry::MollerTrumbore) leaves the decision to f64 is at most
//! (2·32 + 16)·16·32·2⁻¹⁸ < 1, so it holds zeros alone. What is left is one division each for t, u and v,
//! whose correctly rounded quotients `expected` has.
//!
//! [`Plane`](crate::geometry::Plane) rounds t before it goes on, so it is demanded only of grids on
//! which t is an integer: those of [`Grid::dyadic`]. There n has components 0 and ±2ᵏ alone, d has
//! one component, ±2ʲ; n·(p₀ − o) is a multiple of 2ᵏ, so t·d and q are integers, and u and v are
//! integers over 2ᵏ.
//!
//! Embree rounds in its box test, and by an approximate reciprocal; so it is judged by the referee, and
//! how often it has the very bits is counted.

use super::survey::{Answers, Peer};
use super::verdict::{Grade, Judge, Judgement};
use crate::bvh::WIDTH;
use crate::geometry::{Hit, Ray, Triangle};
use crate::verify::Arithmetic;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;
use std::sync::Arc;

mod expected;
mod lattice;

/// Enough for a hierarchy of several levels.
const TRIANGLES: usize = 3 * WIDTH * WIDTH;

/// A scene and rays of small integers, with what each ray hits.
pub(crate) struct Grid {
    pub triangles: Arc<[Triangle]>,
    rays: Vec<Ray>,
    expected: Vec<Option<Hit>>,
    is_dyadic: bool,
}

/// How one caster answered; each ray is asked twice, for the nearest hit and for any hit.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct GridFinding {
    pub caster: &'static str,
    pub queries: u64,
    /// The exact answer, bit for bit; a zero may have either sign.
    pub exact: u64,
    /// Where bits are not demanded: a triangle at that distance, with numbers within the bounds.
    pub alike: u64,
    /// Where bits are not demanded: an edge or an end within the kernel's bounds taken the other way.
    pub forgiven: u64,
    pub wrong: u64,
    /// Whether the caster is our own.
    pub is_native: bool,
    /// The first few wrong answers, as source for a test.
    #[serde(skip)]
    pub failures: Vec<String>,
}

impl GridFinding {
    fn new(peer: &Peer) -> Self {
        GridFinding { caster: peer.name, is_native: peer.is_native, ..GridFinding::default() }
    }

    /// With the findings about the same caster on another grid.
    pub(crate) fn and(mut self, other: GridFinding) -> Self {
        self.queries += other.queries;
        self.exact += other.exact;
        self.alike += other.alike;
        self.forgiven += other.forgiven;
        self.wrong += other.wrong;
        self.failures.extend(other.failures);
        self.failures.truncate(FAILURES_KEPT);
        self
    }
}

impl fmt::Display for GridFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let GridFinding { caster, queries, exact, alike, forgiven, wrong, .. } = self;
        write!(
            f,
            "grid   {caster:<22} {exact} of {queries} bit for bit, {alike} alike, \
             {forgiven} forgiven, {wrong} wrong"
        )
    }
}

/// Failures that are kept in words: more of them say nothing new.
const FAILURES_KEPT: usize = 4;

impl Grid {
    /// Triangles and rays of every kind.
    pub(crate) fn general(rays: u64, seed: u64) -> Self {
        let mut dice = lattice::Dice::new(seed, 1 << 56);
        let mut triangles = Vec::with_capacity(TRIANGLES);
        for index in 0..TRIANGLES {
            triangles.push(lattice::any_triangle(&mut dice, index, &triangles));
        }
        let rays = (0..rays).map(|index| {
            let mut dice = lattice::Dice::new(seed, 1 << 56 | (index + 1));
            lattice::any_ray(&mut dice, index as usize, &triangles)
        });
        let rays = rays.collect();
        Grid::new(triangles, rays, false)
    }

    /// Triangles and rays about which the plane kernel, too, has nothing to round.
    pub(crate) fn dyadic(rays: u64, seed: u64) -> Self {
        let mut dice = lattice::Dice::new(seed, 1 << 57);
        let triangles = (0..TRIANGLES).map(|_| lattice::dyadic_triangle(&mut dice)).collect();
        let rays = (0..rays)
            .map(|index| lattice::dyadic_ray(&mut lattice::Dice::new(seed, 1 << 57 | (index + 1))))
            .collect();
        Grid::new(triangles, rays, true)
    }

    fn new(triangles: Vec<Triangle>, rays: Vec<Ray>, is_dyadic: bool) -> Self {
        let expected = rays.par_iter().map(|ray| expected::nearest(ray, &triangles)).collect();
        Grid { triangles: triangles.into(), rays, expected, is_dyadic }
    }

    /// Asks every caster, which must know this grid's triangles, about every ray.
    pub(crate) fn ask(&self, casters: &[Peer]) -> Vec<GridFinding> {
        casters.iter().map(|caster| self.ask_one(caster)).collect()
    }

    fn ask_one(&self, peer: &Peer) -> GridFinding {
        let answers = Answers::of(&*peer.caster, &self.rays, peer.single);
        let judge = Judge::new(&self.triangles, peer.arithmetic, peer.arithmetic);
        let is_demanded =
            peer.is_native && (self.is_dyadic || peer.arithmetic == Arithmetic::MollerTrumbore);
        let mut finding = GridFinding::new(peer);
        for (i, ray) in self.rays.iter().enumerate() {
            let question = Question { judge: &judge, ray, expected: self.expected[i], is_demanded };
            question.nearest(answers.nearest[i], &mut finding);
            question.occluded(answers.occluded[i], &mut finding);
        }
        finding
    }
}

struct Question<'q, 't> {
    judge: &'q Judge<'t>,
    ray: &'q Ray,
    expected: Option<Hit>,
    is_demanded: bool,
}

impl Question<'_, '_> {
    fn nearest(&self, answer: Option<Hit>, finding: &mut GridFinding) {
        finding.queries += 1;
        if answer == self.expected {
            finding.exact += 1;
            return;
        }
        let judgement = self.judge.nearest_alone(self.ray, answer);
        if self.is_wrong(&judgement) {
            self.note_wrong("nearest", answer, &judgement, finding);
        } else if answer.is_some_and(|hit| self.is_at_expected_distance(&hit)) {
            finding.alike += 1;
        } else {
            finding.forgiven += 1;
        }
    }

    fn occluded(&self, answer: bool, finding: &mut GridFinding) {
        finding.queries += 1;
        if answer == self.expected.is_some() {
            finding.exact += 1;
            return;
        }
        let judgement = self.judge.occluded_alone(self.ray, answer);
        if self.is_wrong(&judgement) {
            self.note_wrong(&format!("any hit: {answer}"), None, &judgement, finding);
        } else {
            finding.forgiven += 1;
        }
    }

    fn is_wrong(&self, judgement: &Judgement) -> bool {
        self.is_demanded || judgement.native == Grade::Wrong
    }

    fn is_at_expected_distance(&self, hit: &Hit) -> bool {
        let triangle = self.judge.referee().triangle(hit.triangle);
        let t = expected::meet(self.ray, triangle).map(|[t, ..]| t);
        t.is_some() && t == self.expected.map(|hit| hit.t)
    }

    fn note_wrong(
        &self,
        what: &str,
        answer: Option<Hit>,
        judgement: &Judgement,
        finding: &mut GridFinding,
    ) {
        finding.wrong += 1;
        if finding.failures.len() < FAILURES_KEPT {
            let source = self.judge.source(self.ray, answer, self.expected, judgement);
            finding.failures.push(format!("// {what}; `other` is exact\n{source}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{Bvh, LeafKernel};
    use crate::geometry::{BruteForce, MollerTrumbore, Plane};
    use glam::Vec3;

    const RAYS: u64 = 20_000;

    fn ours<K: LeafKernel>(triangles: &[Triangle], arithmetic: Arithmetic) -> Vec<Peer<'_>> {
        let peer =
            |name, caster, single| Peer { name, caster, arithmetic, is_native: true, single };
        vec![
            peer("single", Box::new(Bvh::<K>::build(triangles)), true),
            peer("batched", Box::new(Bvh::<K>::build(triangles)), false),
            peer("brute force", Box::new(BruteForce::<K>::new(triangles)), false),
        ]
    }

    fn assert_exact(findings: &[GridFinding]) {
        for finding in findings {
            assert_eq!(finding.exact, 2 * RAYS, "{finding}\n{}", finding.failures.concat());
        }
    }

    #[test]
    fn cramers_kernel_has_the_exact_bits_on_every_grid() {
        for grid in [Grid::general(RAYS, 1), Grid::dyadic(RAYS, 1)] {
            let casters = ours::<MollerTrumbore>(&grid.triangles, Arithmetic::MollerTrumbore);
            assert_exact(&grid.ask(&casters));
        }
    }

    #[test]
    fn the_plane_kernel_has_the_exact_bits_where_it_does_not_round_and_else_is_not_wrong() {
        let grid = Grid::dyadic(RAYS, 1);
        assert_exact(&grid.ask(&ours::<Plane>(&grid.triangles, Arithmetic::Plane)));
        let grid = Grid::general(RAYS, 1);
        for finding in grid.ask(&ours::<Plane>(&grid.triangles, Arithmetic::Plane)) {
            assert_eq!(finding.wrong, 0, "{finding}\n{}", finding.failures.concat());
            assert!(
                finding.alike > 0 && finding.forgiven > 0,
                "the plane kernel rounds: {finding}"
            );
        }
    }

    #[test]
    fn numbers_are_as_small_as_their_exactness_needs() {
        let within = |v: Vec3, low: f32, high: f32| {
            v == v.round() && v.min_element() >= low && v.max_element() <= high
        };
        for grid in [Grid::general(RAYS, 2), Grid::dyadic(RAYS, 2)] {
            assert!(grid.triangles.iter().flat_map(|t| t.p).all(|p| within(p, 0.0, 16.0)));
            for ray in &grid.rays {
                assert!(within(ray.origin, -16.0, 32.0) && within(ray.direction, -32.0, 32.0));
            }
        }
    }

    #[test]
    fn rays_hit_and_miss_edges_and_vertices_among_the_rest() {
        for grid in [Grid::general(RAYS, 3), Grid::dyadic(RAYS, 3)] {
            let hits: Vec<Hit> = grid.expected.iter().flatten().copied().collect();
            let at_edges = hits.iter().filter(|hit| hit.u * hit.v * (1.0 - hit.u - hit.v) == 0.0);
            let (hits, at_edges) = (hits.len() as u64, at_edges.count() as u64);
            assert!(hits > RAYS / 4 && hits < RAYS * 19 / 20, "{hits} hits");
            assert!(at_edges > RAYS / 20, "{at_edges} at edges and vertices");
        }
    }
}
