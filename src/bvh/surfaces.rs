//! Which of the triangles that a ray meets is seen.
//!
//! Of triangles that overlap in one plane one is seen, whichever rounding puts in front ([`Overlaps`]). A cut-out
//! lets a ray through exactly where its texture is transparent. Where a share d of the light is stopped, a ray
//! is stopped with probability d, by a number that depends on the ray and the triangle alone. So every caster
//! that meets the same triangles gives the same answer.

use crate::geometry::{Hit, Kernel, MollerTrumbore, Ray, RayCaster, TriangleId};
use crate::scene::Scene;
use crate::scene::overlaps::Overlaps;

/// A caster that gives what is seen of what another one meets.
pub struct Surfaces<C> {
    inner: C,
    scene: Scene,
    /// Whether a ray can go on behind a hit.
    has_openings: bool,
}

impl<C: RayCaster> Surfaces<C> {
    /// `inner` must know the scene's triangles.
    pub fn new(inner: C, scene: &Scene) -> Self {
        Surfaces { inner, scene: scene.clone(), has_openings: scene.is_see_through() }
    }

    /// The first hit from this one on that is seen.
    #[inline]
    fn seen(&self, ray: &Ray, hit: Option<Hit>) -> Option<Hit> {
        let found = hit?;
        let overlaps = self.scene.overlaps();
        if !self.has_openings && overlaps.with(found.triangle).is_empty() {
            return hit;
        }
        self.go_on(ray, found, overlaps)
    }

    fn go_on(&self, ray: &Ray, mut found: Hit, overlaps: &Overlaps) -> Option<Hit> {
        let (mut rest, mut step) = (*ray, f32::EPSILON);
        loop {
            let seen = self.seen_here(ray, &rest, found, overlaps);
            if seen.is_some() {
                return seen;
            }
            // Beyond the interval's start, which is open, nothing is met twice; but a kernel that rounds the
            // interval (Embree's) may give a t before it, for denormal directions far before it.
            if found.t > rest.t_min {
                rest.t_min = found.t;
            } else {
                rest.t_min = rest.t_min.max(f32::MIN_POSITIVE) * (1.0 + step);
                step = (2.0 * step).min(1.0);
            }
            found = self.inner.nearest(&rest)?;
        }
    }

    fn is_grazing(&self, ray: &Ray, triangle: TriangleId) -> bool {
        let normal = self.scene.triangles[triangle.index()].normal();
        normal.dot(ray.direction).abs() <= GRAZING * ray.direction.length()
    }

    /// The seen one of the triangles that the ray meets here in one plane, if any stops it.
    fn seen_here(&self, ray: &Ray, rest: &Ray, found: Hit, overlaps: &Overlaps) -> Option<Hit> {
        let faces =
            |t: TriangleId| self.scene.triangles[t.index()].normal().dot(ray.direction) < 0.0;
        let others = match self.is_grazing(ray, found.triangle) {
            true => &[],
            false => overlaps.with(found.triangle),
        };
        let others = others.iter().filter_map(|&triangle| {
            let (t, u, v) =
                MollerTrumbore::intersect(rest, &self.scene.triangles[triangle.index()])?;
            Some(Hit { triangle, t, u, v })
        });
        let mut seen: Option<Hit> = None;
        for hit in std::iter::once(found).chain(others) {
            let place = |hit: Hit| (hit.triangle, faces(hit.triangle));
            let comes_first = |other| overlaps.comes_first(place(hit), place(other));
            let is_back = !faces(hit.triangle);
            let stops = || !self.has_openings || stops(&self.scene, ray, hit, is_back);
            if seen.is_none_or(comes_first) && stops() {
                seen = Some(hit);
            }
        }
        seen
    }
}

/// Below this cosine to the normal a ray meets triangles in one plane at distances that have little to do with
/// each other, and the nearest is seen.
pub(crate) const GRAZING: f32 = 1e-3;

/// Whether a ray ends at a hit, by the opacity of the side that it meets.
pub(crate) fn stops(scene: &Scene, ray: &Ray, hit: Hit, is_back: bool) -> bool {
    let opacity = scene.opacity_at(hit.triangle, is_back, hit.u, hit.v);
    opacity >= 1.0 || (opacity > 0.0 && number(ray, &hit) < opacity)
}

/// A number in [0, 1) for a ray at a triangle.
fn number(ray: &Ray, hit: &Hit) -> f32 {
    let parts = [ray.origin.to_array(), ray.direction.to_array()];
    let bits = parts.as_flattened().iter().map(|x| x.to_bits() as u64);
    // SplitMix64's finaliser over all parts (Steele, Lea & Flood, "Fast Splittable Pseudorandom Number
    // Generators", 2014).
    let mixed = bits.chain([hit.triangle.0 as u64]).fold(0u64, |state, part| {
        let mut z = (state ^ part).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    });
    (mixed >> 40) as f32 / (1u64 << 24) as f32
}

impl<C: RayCaster> RayCaster for Surfaces<C> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.seen(ray, self.inner.nearest(ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.inner.occluded(ray) && (!self.has_openings || self.nearest(ray).is_some())
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        self.inner.nearest_batch(rays, hits);
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.seen(ray, *hit);
        }
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        self.inner.occluded_batch(rays, blocked);
        if self.has_openings {
            for (ray, blocked) in rays.iter().zip(blocked) {
                *blocked = *blocked && self.nearest(ray).is_some();
            }
        }
    }
}
