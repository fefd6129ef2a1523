//! What is said of triangles that overlap in one plane.

use super::Scene;
use crate::error::Warning;
use crate::geometry::TriangleId;

/// Two triangles that overlap in one plane.
struct Overlap {
    seen: TriangleId,
    hidden: TriangleId,
}

impl Scene {
    pub(super) fn overlap_warnings(&self) -> Vec<Warning> {
        if self.overlaps().is_given_up {
            return vec![Warning::new(
                "too many parallel triangles lie in one place for all of them to be compared: where some overlap in one \
                 plane, rounding decides which of them is seen",
            )];
        }
        [self.doubtful_overlaps(), self.hidden_backs()].into_iter().flatten().collect()
    }

    /// Says what is assumed, where two fronts or two backs are in one place.
    fn doubtful_overlaps(&self) -> Option<Warning> {
        let overlaps = self.overlaps();
        let doubt = |t: TriangleId| {
            let other = *overlaps.with(t).iter().find(|&&other| self.face_alike(t, other))?;
            let is_seen = overlaps.comes_first((t, true), (other, true));
            let [seen, hidden] = if is_seen { [t, other] } else { [other, t] };
            Some(Overlap { seen, hidden })
        };
        let mut doubtful = overlaps.triangles().filter_map(doubt);
        let first = doubtful.next()?;
        let example = self.example(&first, |seen, hidden| {
            format!(" (first: face {seen} is seen, not face {hidden})")
        });
        Some(Warning::new(format!(
            "{} triangles overlap others in the same plane{example}: where they do, the smaller surface is seen",
            1 + doubtful.count()
        )))
    }

    /// Says where a smaller surface is not seen, because it is wound the other way round than a larger one. What
    /// belongs to a closed part, as the bottom of a block does, has a back that nobody looks for.
    fn hidden_backs(&self) -> Option<Warning> {
        let overlaps = self.overlaps();
        let hidden_back = |hidden: TriangleId| {
            let hides = |&seen: &TriangleId| {
                !self.face_alike(seen, hidden)
                    && self.material_on(seen, false) != self.material_on(hidden, true)
                    && overlaps.comes_first((hidden, true), (seen, true))
            };
            let seen = overlaps.with(hidden).iter().copied().find(hides)?;
            Some(Overlap { seen, hidden })
        };
        let mut hidden: Vec<Overlap> = overlaps.triangles().filter_map(hidden_back).collect();
        if hidden.is_empty() {
            return None;
        }
        let mut is_closed = vec![false; self.triangles.len()];
        for triangle in self.topology().closed_parts().into_iter().flatten() {
            is_closed[triangle.index()] = true;
        }
        hidden.retain(|overlap| !is_closed[overlap.hidden.index()]);
        let example = self.example(hidden.first()?, |seen, hidden| {
            format!(" (first: face {hidden} behind face {seen})")
        });
        Some(Warning::new(format!(
            "{} triangles have their backs where a larger surface in the same plane has its front, which is seen \
             instead{example}: to see them there, reverse their winding",
            hidden.len()
        )))
    }

    fn face_alike(&self, a: TriangleId, b: TriangleId) -> bool {
        self.normal_of(a).dot(self.normal_of(b)) > 0.0
    }

    /// The faces of an overlap in words, if they are known.
    fn example(&self, overlap: &Overlap, words: impl Fn(u32, u32) -> String) -> String {
        let face = |t: TriangleId| Some(self.mesh.origins.get(t.index())?.face);
        match (face(overlap.seen), face(overlap.hidden)) {
            (Some(seen), Some(hidden)) => words(seen, hidden),
            _ => String::new(),
        }
    }
}
