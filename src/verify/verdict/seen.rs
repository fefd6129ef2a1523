//! Which of the triangles on a ray is seen: the rule of [`Surfaces`](crate::bvh::Surfaces), and where rounding
//! leaves open what it says.

use super::Judge;
use crate::bvh::surfaces;
use crate::geometry::{Ending, Ray};
use crate::verify::bounds::{Arithmetic, Bounds};
use crate::verify::referee::Met;

/// Two kernels may answer alike, or rounding decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    Yes,
    No,
    Unsure,
}

impl Rule {
    fn of(known: Option<bool>) -> Rule {
        match known {
            Some(true) => Rule::Yes,
            Some(false) => Rule::No,
            None => Rule::Unsure,
        }
    }
}

/// Rays as steep as this or less may count as grazing: the tracer's limit, with room for its rounding.
const GRAZING: f64 = 2.0 * surfaces::GRAZING as f64;

/// Where (u, v) is less certain than this, the corners of what it may be do not speak for a texture in between.
const FINE: f64 = 1e-4;

impl Judge<'_> {
    /// Whether the ray ends at a triangle that it meets, with (u, v) anywhere within the kernel's bounds.
    pub(super) fn stops(&self, ray: &Ray, met: &Met, arithmetic: Arithmetic) -> Rule {
        let Some(scene) = self.scene.filter(|scene| scene.is_see_through()) else {
            return Rule::Yes;
        };
        let bounds = self.bounds(ray, arithmetic, met.triangle, &met.cramer);
        if bounds.kernel.u.max(bounds.kernel.v) > FINE && scene.has_cut_outs(met.triangle) {
            return Rule::Unsure;
        }
        let ending = self.ending.unwrap_or_else(|| Ending::by_chance(ray));
        let backs = faces(met).map_or(vec![false, true], |faces| vec![!faces]);
        let stops = |[u, v]: [f64; 2], is_back| {
            let is_back = is_back && scene.own_back(met.triangle).is_some();
            let opacity = scene.opacity_at(met.triangle, is_back, u as f32, v as f32);
            surfaces::stops(&ending, met.triangle, opacity)
        };
        let at = |place| backs.iter().map(move |&is_back| stops(place, is_back));
        let around: Vec<bool> = corners(&bounds).into_iter().flat_map(at).collect();
        Rule::of(around.iter().all(|&stops| stops == around[0]).then_some(around[0]))
    }

    /// Whether the first is seen of two triangles that overlap in one plane; `None` if they do not.
    pub(super) fn comes_first(&self, a: &Met, b: &Met) -> Option<Rule> {
        let overlaps = self.scene?.overlaps();
        overlaps.with(a.triangle).contains(&b.triangle).then(|| {
            let both = faces(a).zip(faces(b));
            Rule::of(both.map(|(fa, fb)| overlaps.comes_first((a.triangle, fa), (b.triangle, fb))))
        })
    }

    /// The least t at which a ray may have met a triangle, or others that it overlaps in one plane.
    pub(super) fn first_in_plane(&self, own: &Met, t: f32, met: &[Met]) -> f32 {
        let in_plane = met.iter().filter(|met| self.comes_first(met, own).is_some());
        // A number below the exact one does not matter: what lies between is in the same plane.
        in_plane.fold(t, |least, met| {
            least.min((met.cramer.t.value / met.cramer.det.value).next_down() as f32)
        })
    }
}

/// Whether the ray meets the front; `None` if it grazes it.
fn faces(met: &Met) -> Option<bool> {
    let cramer = &met.cramer;
    let full = cramer.d.length() * cramer.e1.cross(cramer.e2).length();
    let cosine = cramer.det.value / full;
    (cosine.abs() > GRAZING).then_some(cosine > 0.0)
}

/// Of the box of (u, v) that the kernel may answer, and its middle.
fn corners(bounds: &Bounds) -> [[f64; 2]; 5] {
    let (u, v, du, dv) = (bounds.u, bounds.v, bounds.kernel.u, bounds.kernel.v);
    [[u, v], [u - du, v - dv], [u + du, v - dv], [u - du, v + dv], [u + du, v + dv]]
}
