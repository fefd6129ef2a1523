//! One answer and the truth.

use super::Judge;
use crate::geometry::{Hit, Ray, TriangleId};
use crate::verify::bounds::{Arithmetic, Bounds};
use crate::verify::forms::Forms;
use crate::verify::referee::Met;
use crate::verify::truth::{Miss, Truth};
use std::cmp::Ordering;

/// How one answer compares with the truth, from best to worst.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Standing {
    /// What exact arithmetic gives.
    Right,
    /// Another triangle lies at exactly the same distance.
    Tie,
    /// Right, if touching is taken one way.
    Touching,
    /// Not what exact arithmetic gives, but within the bounds of f32's.
    Precision,
    Wrong,
}

/// An answer's standing; if it is wrong, a triangle that shows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub standing: Standing,
    pub witness: Option<TriangleId>,
}

impl Found {
    pub const RIGHT: Found = Found { standing: Standing::Right, witness: None };

    fn wrong(witness: Option<TriangleId>) -> Self {
        Found { standing: Standing::Wrong, witness }
    }

    fn at_least(&mut self, standing: Standing) {
        self.standing = self.standing.max(standing);
    }
}

/// How far a box is grown, relative to its coordinates, in a first search for a triangle that a
/// kernel may have hit. Only the order of the search depends on it: a second one leaves out nothing.
const FIRST_SEARCH: f64 = 1.0 / 4096.0;

impl Judge<'_> {
    fn bounds(&self, ray: &Ray, arithmetic: Arithmetic, id: TriangleId, forms: &Forms) -> Bounds {
        Bounds::new(arithmetic, ray, self.referee.triangle(id), forms)
    }

    /// `met` holds what the exact ray meets.
    pub(super) fn stand_nearest(
        &self,
        ray: &Ray,
        answer: Option<Hit>,
        arithmetic: Arithmetic,
        met: &[Met],
    ) -> Found {
        match answer {
            None => self.stand_miss(ray, arithmetic, met),
            Some(hit) => self.stand_hit(ray, hit, arithmetic, met),
        }
    }

    /// A miss must have a reason for each triangle that the exact ray meets.
    fn stand_miss(&self, ray: &Ray, arithmetic: Arithmetic, met: &[Met]) -> Found {
        let mut found = Found::RIGHT;
        for met in met {
            if let Truth::Touching(_) = met.truth {
                found.at_least(Standing::Touching);
            } else if self.bounds(ray, arithmetic, met.triangle, &met.forms).may_miss(ray) {
                found.at_least(Standing::Precision);
            } else {
                return Found::wrong(Some(met.triangle));
            }
        }
        found
    }

    /// A hit must be possible, its numbers right, and nothing that cannot be missed nearer.
    fn stand_hit(&self, ray: &Ray, hit: Hit, arithmetic: Arithmetic, met: &[Met]) -> Found {
        if hit.triangle.index() >= self.referee.triangles().len() {
            return Found::wrong(None);
        }
        let own = self.referee.examine(ray, hit.triangle);
        let own = Met { triangle: hit.triangle, truth: own.truth, forms: own.forms };
        let bounds = self.bounds(ray, arithmetic, own.triangle, &own.forms);
        let mut found = Found::RIGHT;
        match own.truth {
            Truth::Hit { .. } => {}
            Truth::Touching(_) => found.at_least(Standing::Touching),
            Truth::Miss(miss) if miss != Miss::NotFinite && bounds.may_hit(ray) => {
                found.at_least(Standing::Precision);
            }
            Truth::Miss(_) => return Found::wrong(Some(hit.triangle)),
        }
        if !bounds.accept(ray, [hit.t, hit.u, hit.v]) {
            return Found::wrong(Some(hit.triangle));
        }
        for nearer in met.iter().filter(|met| met.triangle != hit.triangle) {
            if self.is_surely_before(ray, nearer, hit.t, arithmetic) {
                return Found::wrong(Some(nearer.triangle));
            }
            found.at_least(self.stand_between(ray, nearer, &own));
        }
        found
    }

    /// Whether a kernel cannot but have found `met`, at a smaller t.
    fn is_surely_before(&self, ray: &Ray, met: &Met, t: f32, arithmetic: Arithmetic) -> bool {
        if !matches!(met.truth, Truth::Hit { .. }) {
            return false;
        }
        let bounds = self.bounds(ray, arithmetic, met.triangle, &met.forms);
        !bounds.may_miss(ray) && bounds.t + bounds.lost.t < t as f64
    }

    /// What another triangle, met by the exact ray, makes of a hit of `own`.
    fn stand_between(&self, ray: &Ray, met: &Met, own: &Met) -> Standing {
        match (self.referee.compare(ray, met, own), met.truth) {
            (Some(Ordering::Equal), _) => Standing::Tie,
            (Some(Ordering::Less), Truth::Touching(_)) => Standing::Touching,
            (Some(Ordering::Less), _) => Standing::Precision,
            (Some(Ordering::Greater) | None, _) => Standing::Right,
        }
    }

    /// Whether the exact ray meets both triangles, at exactly one distance.
    pub(super) fn is_tie(&self, ray: &Ray, met: &[Met], a: TriangleId, b: TriangleId) -> bool {
        let find = |id| met.iter().find(|met| met.triangle == id);
        match (find(a), find(b)) {
            (Some(a), Some(b)) => self.referee.compare(ray, a, b) == Some(Ordering::Equal),
            _ => false,
        }
    }

    pub(super) fn stand_occluded(
        &self,
        ray: &Ray,
        answer: bool,
        arithmetic: Arithmetic,
        met: &[Met],
    ) -> Found {
        if !answer {
            return self.stand_miss(ray, arithmetic, met);
        }
        if met.iter().any(|met| matches!(met.truth, Truth::Hit { .. })) {
            return Found::RIGHT;
        }
        let standing = if !met.is_empty() {
            Standing::Touching
        } else if self.may_hit_anything(ray, arithmetic) {
            Standing::Precision
        } else {
            Standing::Wrong
        };
        Found { standing, witness: None }
    }

    /// Whether rounding may have made a hit of a miss: near the ray first, then everywhere.
    fn may_hit_anything(&self, ray: &Ray, arithmetic: Arithmetic) -> bool {
        let may_hit = |id| {
            let finding = self.referee.examine(ray, id);
            finding.truth != Truth::Miss(Miss::NotFinite)
                && self.bounds(ray, arithmetic, id, &finding.forms).may_hit(ray)
        };
        [FIRST_SEARCH, f64::INFINITY]
            .into_iter()
            .any(|slack| self.referee.near(ray, slack).into_iter().any(may_hit))
    }
}
