//! Two answers to one query, and who is right.
//!
//! Each answer is judged by itself first, which gives its [`Standing`]; two standings make a
//! [`Verdict`]. An answer is wrong when no f32 kernel of its kind could have given it within its
//! derived bounds: it names a triangle that it cannot have met, gives numbers that are too far off,
//! or leaves out a triangle that it cannot have missed and that lies nearer.

use super::bounds::{Arithmetic, Bounds};
use super::forms::Forms;
use super::referee::Referee;
use super::source;
use crate::geometry::{Hit, Ray, Triangle, TriangleId};
use standing::Found;
pub use standing::Standing;

mod standing;
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
    EmbreeWrong,
    BothWrong,
}

/// A verdict and what led to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Judgement {
    pub verdict: Verdict,
    pub native: Standing,
    /// The peer's; what exact arithmetic gives, if there is no peer.
    pub other: Standing,
    /// A triangle that refutes a wrong answer.
    pub witness: Option<TriangleId>,
}

impl Judgement {
    const AGREE: Judgement = Judgement {
        verdict: Verdict::Agree,
        native: Standing::Right,
        other: Standing::Right,
        witness: None,
    };

    /// `tie`: both answers are hits, met by the exact ray at exactly one distance.
    fn new(native: Found, other: Found, same: bool, tie: bool) -> Self {
        let verdict = match (native.standing, other.standing) {
            (Standing::Wrong, Standing::Wrong) => Verdict::BothWrong,
            (Standing::Wrong, _) => Verdict::NativeWrong,
            (_, Standing::Wrong) => Verdict::EmbreeWrong,
            _ if same => Verdict::Agree,
            _ if tie => Verdict::Tie,
            (native, other) => match native.max(other) {
                Standing::Right => unreachable!("two different answers are not both the truth"),
                Standing::Tie => Verdict::Tie,
                Standing::Touching => Verdict::Touching,
                Standing::Precision | Standing::Wrong => Verdict::Precision,
            },
        };
        let witness = native.witness.or(other.witness);
        Judgement { verdict, native: native.standing, other: other.standing, witness }
    }

    /// Without a peer, every departure from the truth is named.
    fn alone(native: Found) -> Self {
        let verdict = match native.standing {
            Standing::Right => Verdict::Agree,
            Standing::Tie => Verdict::Tie,
            Standing::Touching => Verdict::Touching,
            Standing::Precision => Verdict::Precision,
            Standing::Wrong => Verdict::NativeWrong,
        };
        let witness = native.witness;
        Judgement { verdict, native: native.standing, other: Standing::Right, witness }
    }
}

/// An endless ray ends where f32 does: a hit at a t that has no f32 cannot be answered.
fn within_reach(ray: &Ray) -> Ray {
    Ray { t_max: if ray.t_max == f32::INFINITY { f32::MAX } else { ray.t_max }, ..*ray }
}

/// Judges answers about one scene.
pub struct Judge<'t> {
    referee: Referee<'t>,
    native: Arithmetic,
    other: Arithmetic,
}

impl<'t> Judge<'t> {
    /// `native` and `other` say how the two sides compute; alone, `other` does not matter.
    pub fn new(triangles: &'t [Triangle], native: Arithmetic, other: Arithmetic) -> Self {
        Judge { referee: Referee::new(triangles), native, other }
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
        let forms = Forms::new(ray, triangle);
        if !(forms.det.abs + forms.u.abs).is_finite() {
            return false;
        }
        let bounds = |arithmetic| Bounds::new(arithmetic, ray, triangle, &forms);
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
            self.stand_nearest(ray, native, self.native, &met),
            self.stand_nearest(ray, other, self.other, &met),
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
            self.stand_occluded(ray, native, self.native, &met),
            self.stand_occluded(ray, other, self.other, &met),
            native == other,
            false,
        )
    }

    /// Judges one nearest hit by the exact truth about all triangles.
    pub fn nearest_alone(&self, ray: &Ray, native: Option<Hit>) -> Judgement {
        let ray = &within_reach(ray);
        Judgement::alone(self.stand_nearest(ray, native, self.native, &self.referee.met(ray)))
    }

    /// Judges one answer to "is anything hit?" by the exact truth about all triangles.
    pub fn occluded_alone(&self, ray: &Ray, native: bool) -> Judgement {
        let ray = &within_reach(ray);
        Judgement::alone(self.stand_occluded(ray, native, self.native, &self.referee.met(ray)))
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
        ids.extend(judgement.witness);
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
