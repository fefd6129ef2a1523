//! One answer and the truth.

use super::Judge;
use super::seen::Rule;
use crate::geometry::{Hit, Ray, TriangleId};
use crate::scene::Scene;
use crate::verify::bounds::{Arithmetic, Bounds};
use crate::verify::contact::{Contact, Examined, Miss};
use crate::verify::cramer::Cramer;
use crate::verify::referee::Met;
use std::cmp::Ordering;

/// How one answer compares with the truth, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Grade {
    /// The answer of exact arithmetic.
    Right,
    /// Another triangle lies at exactly the same distance.
    Tie,
    /// Right, if touching is taken one way.
    Touching,
    /// Not what exact arithmetic gives, but within the bounds of f32's.
    Precision,
    Wrong,
}

/// An answer's grade; if it is wrong, a triangle that shows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Graded {
    pub grade: Grade,
    pub counterexample: Option<TriangleId>,
}

impl Graded {
    pub(super) const RIGHT: Graded = Graded { grade: Grade::Right, counterexample: None };

    fn wrong(counterexample: Option<TriangleId>) -> Self {
        Graded { grade: Grade::Wrong, counterexample }
    }

    fn at_least(&mut self, grade: Grade) {
        self.grade = self.grade.max(grade);
    }
}

/// How far a box is grown, relative to its coordinates, in a first search for a triangle that a
/// kernel may have hit. Only the order of the search depends on it: a second one leaves out nothing.
const FIRST_SEARCH: f64 = 1.0 / 4096.0;

impl Judge<'_> {
    pub(super) fn bounds(
        &self,
        ray: &Ray,
        arithmetic: Arithmetic,
        id: TriangleId,
        cramer: &Cramer,
    ) -> Bounds {
        Bounds::new(arithmetic, ray, self.referee.triangle(id), cramer)
    }

    /// `met` holds what the exact ray meets.
    pub(super) fn grade_nearest(
        &self,
        ray: &Ray,
        answer: Option<Hit>,
        arithmetic: Arithmetic,
        met: &[Met],
    ) -> Graded {
        match answer {
            None => self.grade_miss(ray, arithmetic, met),
            Some(hit) => self.grade_hit(ray, hit, arithmetic, met),
        }
    }

    /// A miss must have a reason for each triangle that the exact ray meets.
    fn grade_miss(&self, ray: &Ray, arithmetic: Arithmetic, met: &[Met]) -> Graded {
        let mut graded = Graded::RIGHT;
        for met in met {
            let stops = self.stops(ray, met, arithmetic);
            if stops == Rule::No {
                continue;
            } else if let Contact::Touching(_) = met.contact {
                graded.at_least(Grade::Touching);
            } else if stops == Rule::Unsure
                || self.bounds(ray, arithmetic, met.triangle, &met.cramer).may_miss(ray)
                || self.may_be_passed_over(ray, met, arithmetic)
            {
                graded.at_least(Grade::Precision);
            } else {
                return Graded::wrong(Some(met.triangle));
            }
        }
        graded
    }

    /// A hit must be possible, its numbers right, and nothing that cannot be missed nearer.
    fn grade_hit(&self, ray: &Ray, hit: Hit, arithmetic: Arithmetic, met: &[Met]) -> Graded {
        if hit.triangle.index() >= self.referee.triangles().len() {
            return Graded::wrong(None);
        }
        let own = self.referee.examine(ray, hit.triangle);
        let own = Met { triangle: hit.triangle, contact: own.contact, cramer: own.cramer };
        let bounds = self.bounds(ray, arithmetic, own.triangle, &own.cramer);
        let mut graded = Graded::RIGHT;
        match own.contact {
            Contact::Hit { .. } => {}
            Contact::Touching(_) => graded.at_least(Grade::Touching),
            Contact::Miss(miss) if miss != Miss::NotFinite && bounds.may_hit(ray) => {
                graded.at_least(Grade::Precision);
            }
            Contact::Miss(_) => return Graded::wrong(Some(hit.triangle)),
        }
        let stops = self.stops(ray, &own, arithmetic);
        if stops == Rule::No || !self.accepts_numbers(ray, hit, &own, &bounds) {
            return Graded::wrong(Some(hit.triangle));
        }
        if stops == Rule::Unsure {
            graded.at_least(Grade::Precision);
        }
        let t = self.first_in_plane(&own, hit.t, met);
        for other in met.iter().filter(|met| met.triangle != hit.triangle) {
            let grade = match (self.stops(ray, other, arithmetic), self.comes_first(other, &own)) {
                (Rule::No, _) | (_, Some(Rule::No)) => Grade::Right,
                (Rule::Yes, Some(Rule::Yes)) => self.grade_unseen(ray, other),
                (Rule::Yes, None) if self.is_surely_before(ray, other, t, arithmetic) => {
                    Grade::Wrong
                }
                (Rule::Yes, None) => self.grade_between(ray, other, &own),
                (Rule::Unsure, _) | (_, Some(Rule::Unsure)) => Grade::Precision,
            };
            if grade == Grade::Wrong {
                return Graded::wrong(Some(other.triangle));
            }
            graded.at_least(grade);
        }
        graded
    }

    /// A hit that replaced another in its plane has the numbers of our own kernel, whichever kernel met the other.
    fn accepts_numbers(&self, ray: &Ray, hit: Hit, own: &Met, bounds: &Bounds) -> bool {
        let numbers = [hit.t, hit.u, hit.v];
        let overlaps =
            self.scene.is_some_and(|scene| !scene.overlaps().with(hit.triangle).is_empty());
        let our_own = || self.bounds(ray, Arithmetic::MollerTrumbore, hit.triangle, &own.cramer);
        bounds.accept(ray, numbers) || overlaps && our_own().accept(ray, numbers)
    }

    /// The grade that a triangle leaves which should have been seen, and was not.
    fn grade_unseen(&self, ray: &Ray, met: &Met) -> Grade {
        let bounds = self.bounds(ray, Arithmetic::MollerTrumbore, met.triangle, &met.cramer);
        match met.contact {
            Contact::Touching(_) => Grade::Touching,
            _ if bounds.may_miss(ray) => Grade::Precision,
            _ => Grade::Wrong,
        }
    }

    /// Whether a kernel cannot but have found `met`, at a smaller t.
    fn is_surely_before(&self, ray: &Ray, met: &Met, t: f32, arithmetic: Arithmetic) -> bool {
        if !matches!(met.contact, Contact::Hit { .. }) {
            return false;
        }
        let bounds = self.bounds(ray, arithmetic, met.triangle, &met.cramer);
        !bounds.may_miss(ray)
            && bounds.t + bounds.lost.t < t as f64
            && !self.may_be_passed_over(ray, met, arithmetic)
    }

    /// Whether a ray that goes on behind an opening may leave out `met`, because rounding may put both at one
    /// distance: what comes next must be farther away.
    fn may_be_passed_over(&self, ray: &Ray, met: &Met, arithmetic: Arithmetic) -> bool {
        if !self.scene.is_some_and(Scene::is_see_through) {
            return false;
        }
        let own = self.bounds(ray, arithmetic, met.triangle, &met.cramer);
        let others = self.referee.near(ray, FIRST_SEARCH).into_iter();
        others.filter(|&id| id != met.triangle).any(|id| {
            let Examined { contact, cramer } = self.referee.examine(ray, id);
            let bounds = self.bounds(ray, arithmetic, id, &cramer);
            let is_farther = (bounds.t - own.t).abs() > bounds.kernel.t + own.kernel.t;
            let open = Met { triangle: id, contact, cramer };
            // Those in one plane are looked at together.
            let is_apart = self.comes_first(&open, met).is_none();
            !is_farther
                && is_apart
                && bounds.may_hit(ray)
                && self.stops(ray, &open, arithmetic) != Rule::Yes
        })
    }

    /// The grade that another triangle, met by the exact ray, leaves to a hit of `own`.
    fn grade_between(&self, ray: &Ray, met: &Met, own: &Met) -> Grade {
        match (self.referee.compare(ray, met, own), met.contact) {
            (Some(Ordering::Equal), _) => Grade::Tie,
            (Some(Ordering::Less), Contact::Touching(_)) => Grade::Touching,
            (Some(Ordering::Less), _) => Grade::Precision,
            (Some(Ordering::Greater) | None, _) => Grade::Right,
        }
    }

    /// Whether the exact ray meets both triangles, at exactly one distance, and no rule says which is seen.
    pub(super) fn is_tie(&self, ray: &Ray, met: &[Met], a: TriangleId, b: TriangleId) -> bool {
        let find = |id| met.iter().find(|met| met.triangle == id);
        match (find(a), find(b)) {
            (Some(a), Some(b)) => {
                self.comes_first(a, b).is_none()
                    && self.referee.compare(ray, a, b) == Some(Ordering::Equal)
            }
            _ => false,
        }
    }

    pub(super) fn grade_occluded(
        &self,
        ray: &Ray,
        answer: bool,
        arithmetic: Arithmetic,
        met: &[Met],
    ) -> Graded {
        if !answer {
            return self.grade_miss(ray, arithmetic, met);
        }
        let stops = |met: &Met| self.stops(ray, met, arithmetic);
        let is_hit = |met: &Met| matches!(met.contact, Contact::Hit { .. });
        if met.iter().any(|met| is_hit(met) && stops(met) == Rule::Yes) {
            return Graded::RIGHT;
        }
        let grade = if met.iter().any(|met| !is_hit(met) && stops(met) == Rule::Yes) {
            Grade::Touching
        } else if self.may_hit_anything(ray, arithmetic) {
            Grade::Precision
        } else {
            Grade::Wrong
        };
        Graded { grade, counterexample: None }
    }

    /// Whether rounding may have made a hit of a miss: near the ray first, then everywhere.
    fn may_hit_anything(&self, ray: &Ray, arithmetic: Arithmetic) -> bool {
        let may_hit = |id| {
            let Examined { contact, cramer } = self.referee.examine(ray, id);
            contact != Contact::Miss(Miss::NotFinite)
                && self.bounds(ray, arithmetic, id, &cramer).may_hit(ray)
                && self.stops(ray, &Met { triangle: id, contact, cramer }, arithmetic) != Rule::No
        };
        [FIRST_SEARCH, f64::INFINITY]
            .into_iter()
            .any(|slack| self.referee.near(ray, slack).into_iter().any(may_hit))
    }
}
