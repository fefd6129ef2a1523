//! Two answers to one query, and who is right.
//!
//! Each answer is judged by itself first, which gives its [`Grade`]; two grades make a
//! [`Verdict`]. An answer is wrong when no f32 kernel of its kind could have given it within its
//! derived bounds: it names a triangle that it cannot have met, gives numbers that are too far off,
//! or leaves out a triangle that it cannot have missed and that lies nearer.

use super::bounds::{Arithmetic, Bounds};
use super::cramer::Cramer;
use super::referee::Referee;
use super::source;
use crate::geometry::{Ending, Hit, Ray, Triangle, TriangleId};
use crate::scene::Scene;
pub use grade::Grade;
use grade::Graded;
use std::sync::Arc;

mod grade;
mod seen;
#[cfg(test)]
mod tests;

/// How a query ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Verdict {
    /// Same triangle, and t, u and v within the derived bounds of the truth; or both a miss.
    Agree,
    /// Two triangles at exactly one distance: a shared edge or vertex, or coplanar faces.
    Tie,
    /// An edge or a vertex exactly on the ray, a ray in a triangle's plane, a triangle without area.
    Touching,
    /// A hit within the derived bounds of an edge or of the interval's end, or two hits whose
    /// distances differ by less than their bounds.
    Precision,
    NativeWrong,
    PeerWrong,
    BothWrong,
}

/// A verdict and what led to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Judgement {
    pub verdict: Verdict,
    pub native: Grade,
    /// The peer's grade; `Right` if there is no peer.
    pub other: Grade,
    /// A triangle that refutes a wrong answer.
    pub counterexample: Option<TriangleId>,
}

impl Judgement {
    const AGREE: Judgement = Judgement {
        verdict: Verdict::Agree,
        native: Grade::Right,
        other: Grade::Right,
        counterexample: None,
    };

    /// `tie`: both answers are hits, met by the exact ray at exactly one distance.
    fn new(native: Graded, other: Graded, same: bool, tie: bool) -> Self {
        let verdict = match (native.grade, other.grade) {
            (Grade::Wrong, Grade::Wrong) => Verdict::BothWrong,
            (Grade::Wrong, _) => Verdict::NativeWrong,
            (_, Grade::Wrong) => Verdict::PeerWrong,
            _ if same => Verdict::Agree,
            _ if tie => Verdict::Tie,
            (native, other) => match native.max(other) {
                Grade::Right => unreachable!("two different answers are not both the truth"),
                Grade::Tie => Verdict::Tie,
                Grade::Touching => Verdict::Touching,
                Grade::Precision | Grade::Wrong => Verdict::Precision,
            },
        };
        let counterexample = native.counterexample.or(other.counterexample);
        Judgement { verdict, native: native.grade, other: other.grade, counterexample }
    }

    /// Without a peer, every departure from the truth is named.
    fn alone(native: Graded) -> Self {
        let verdict = match native.grade {
            Grade::Right => Verdict::Agree,
            Grade::Tie => Verdict::Tie,
            Grade::Touching => Verdict::Touching,
            Grade::Precision => Verdict::Precision,
            Grade::Wrong => Verdict::NativeWrong,
        };
        let counterexample = native.counterexample;
        Judgement { verdict, native: native.grade, other: Grade::Right, counterexample }
    }
}

/// An endless ray ends where f32 does: a hit at a t that has no f32 cannot be answered.
fn within_reach(ray: &Ray) -> Ray {
    Ray { t_max: if ray.t_max == f32::INFINITY { f32::MAX } else { ray.t_max }, ..*ray }
}

/// Judges answers about one scene.
#[derive(Clone)]
pub struct Judge<'t> {
    referee: Arc<Referee<'t>>,
    /// Whose rules say what is seen of what is met; without it, that which is nearest.
    scene: Option<&'t Scene>,
    /// By which rays end; without it, each by its own.
    ending: Option<Ending>,
    native: Arithmetic,
    other: Arithmetic,
}

impl<'t> Judge<'t> {
    /// `native` and `other` say how the two sides compute; alone, `other` does not matter.
    pub fn new(triangles: &'t [Triangle], native: Arithmetic, other: Arithmetic) -> Self {
        let referee = Arc::new(Referee::new(triangles));
        Judge { referee, scene: None, ending: None, native, other }
    }

    /// A judge of answers through [`Surfaces`](crate::bvh::Surfaces).
    pub fn of_scene(scene: &'t Scene, native: Arithmetic, other: Arithmetic) -> Self {
        Judge { scene: Some(scene), ..Judge::new(&scene.triangles, native, other) }
    }

    /// A judge of answers to a ray that was asked with this ending.
    pub fn by(&self, ending: Ending) -> Self {
        Judge { ending: Some(ending), ..self.clone() }
    }

    pub fn referee(&self) -> &Referee<'t> {
        &self.referee
    }

    /// Judges two nearest hits, asking the exact referee only if they differ.
    ///
    /// Two misses agree, and so do two hits of one triangle whose numbers are within the bounds.
    /// Both may still be wrong alike, which [`settle_nearest`](Self::settle_nearest) on a sample
    /// finds.
    #[inline]
    pub fn nearest(&self, ray: &Ray, native: Option<Hit>, other: Option<Hit>) -> Judgement {
        match (native, other) {
            (None, None) => Judgement::AGREE,
            (Some(a), Some(b)) if a.triangle == b.triangle && self.accept(ray, &a, &b) => {
                Judgement::AGREE
            }
            _ => self.settle_nearest(ray, native, other),
        }
    }

    /// Whether both hits of one triangle are possible, with numbers within the bounds.
    #[inline]
    fn accept(&self, ray: &Ray, a: &Hit, b: &Hit) -> bool {
        let Some(triangle) = self.referee.triangles().get(a.triangle.index()) else { return false };
        let cramer = Cramer::new(ray, triangle);
        if !(cramer.det.abs + cramer.u.abs).is_finite() {
            return false;
        }
        let bounds = |arithmetic| Bounds::new(arithmetic, ray, triangle, &cramer);
        let allow = |bounds: &Bounds, hit: &Hit| bounds.allow(ray, Some([hit.t, hit.u, hit.v]));
        // Nearly always both keep even the narrowest bounds, and those are quickest to get.
        let narrow = bounds(Arithmetic::MollerTrumbore);
        (narrow.kernel.t.is_finite() && allow(&narrow, a) && allow(&narrow, b))
            || (allow(&bounds(self.native), a) && allow(&bounds(self.other), b))
    }

    /// Judges two nearest hits by the exact truth about all triangles.
    pub fn settle_nearest(&self, ray: &Ray, native: Option<Hit>, other: Option<Hit>) -> Judgement {
        let ray = &within_reach(ray);
        let met = self.referee.met(ray);
        let same = native.map(|hit| hit.triangle) == other.map(|hit| hit.triangle);
        let tie = match (native, other) {
            (Some(a), Some(b)) => self.is_tie(ray, &met, a.triangle, b.triangle),
            _ => false,
        };
        Judgement::new(
            self.grade_nearest(ray, native, self.native, &met),
            self.grade_nearest(ray, other, self.other, &met),
            same,
            tie,
        )
    }

    /// Judges two answers to "is anything hit?", asking the exact referee only if they differ.
    #[inline]
    pub fn occluded(&self, ray: &Ray, native: bool, other: bool) -> Judgement {
        if native == other { Judgement::AGREE } else { self.settle_occluded(ray, native, other) }
    }

    /// Judges two answers to "is anything hit?" by the exact truth about all triangles.
    pub fn settle_occluded(&self, ray: &Ray, native: bool, other: bool) -> Judgement {
        let ray = &within_reach(ray);
        let met = self.referee.met(ray);
        Judgement::new(
            self.grade_occluded(ray, native, self.native, &met),
            self.grade_occluded(ray, other, self.other, &met),
            native == other,
            false,
        )
    }

    /// Judges one nearest hit by the exact truth about all triangles.
    pub fn nearest_alone(&self, ray: &Ray, native: Option<Hit>) -> Judgement {
        let ray = &within_reach(ray);
        Judgement::alone(self.grade_nearest(ray, native, self.native, &self.referee.met(ray)))
    }

    /// Judges one answer to "is anything hit?" by the exact truth about all triangles.
    pub fn occluded_alone(&self, ray: &Ray, native: bool) -> Judgement {
        let ray = &within_reach(ray);
        Judgement::alone(self.grade_occluded(ray, native, self.native, &self.referee.met(ray)))
    }

    /// The query as the body of a test: ray, triangles and answers, bit for bit.
    pub fn source(
        &self,
        ray: &Ray,
        native: Option<Hit>,
        other: Option<Hit>,
        judgement: &Judgement,
    ) -> String {
        let named = [native.map(|hit| hit.triangle), other.map(|hit| hit.triangle)];
        let mut ids: Vec<TriangleId> = named.into_iter().flatten().collect();
        ids.extend(judgement.counterexample);
        ids.extend(self.referee.nearest(ray).map(|met| met.triangle));
        ids.sort();
        ids.dedup();
        ids.retain(|id| id.index() < self.referee.triangles().len());
        let mut text = format!("// {:?}; triangles {:?}\n", judgement.verdict, ids);
        text += &format!("let ray = {};\nlet triangles = [\n", source::ray(ray));
        for id in &ids {
            text += &format!("    {},\n", source::triangle(self.referee.triangle(*id)));
        }
        let answer = |hit: Option<Hit>| {
            source::hit(hit, hit.map_or(0, |hit| ids.partition_point(|id| *id < hit.triangle)))
        };
        text + &format!("];\nlet native = {};\nlet other = {};\n", answer(native), answer(other))
    }
}
