//! Which of the triangles that a ray meets is seen.
//!
//! Of triangles that overlap in one plane one is seen, whichever rounding puts in front ([`Overlaps`]). A cut-out
//! lets a ray through exactly where its texture is transparent. Where a share d of the light is stopped, a ray
//! is stopped with probability d, by a number that depends on the ray and the triangle alone, unless the
//! caller says how it ends ([`Ending`]). So every caster that meets the same triangles gives the same answer.

use crate::geometry::{Ending, Hit, Kernel, MollerTrumbore, Ray, RayCaster, TriangleId};
use crate::scene::Scene;

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
    fn seen(&self, ray: &Ray, hit: Option<Hit>, ending: impl FnOnce() -> Ending) -> Option<Hit> {
        let found = hit?;
        if !self.has_openings {
            return self.seen_in_plane(ray, found, |_| true);
        }
        let ending = ending();
        let stops = |hit: &Hit| self.stops(ray, ending, hit);
        self.seen_in_plane(ray, found, stops).or_else(|| self.stop(ray, ending))
    }

    /// The hit that a viewer sees where a ray ends.
    fn stop(&self, ray: &Ray, ending: Ending) -> Option<Hit> {
        let stops = |hit: &Hit| self.stops(ray, ending, hit);
        if self.scene.overlaps().is_empty() {
            return self.inner.nearest_stop(ray, &stops);
        }
        let seen = |hit: &Hit| self.seen_in_plane(ray, *hit, stops);
        seen(&self.inner.nearest_stop(ray, &|hit| seen(hit).is_some())?)
    }

    fn faces(&self, ray: &Ray, triangle: TriangleId) -> bool {
        self.scene.triangles[triangle.index()].normal().dot(ray.direction) < 0.0
    }

    fn stops(&self, ray: &Ray, ending: Ending, hit: &Hit) -> bool {
        stops(&ending, hit.triangle, self.scene.opacity_towards(ray, hit))
    }

    /// Whether a ray that meets something goes through all of it.
    fn passes(&self, ray: &Ray) -> bool {
        self.has_openings && self.stop(ray, Ending::by_chance(ray)).is_none()
    }

    fn is_grazing(&self, ray: &Ray, triangle: TriangleId) -> bool {
        let normal = self.scene.triangles[triangle.index()].normal();
        normal.dot(ray.direction).abs() <= GRAZING * ray.direction.length()
    }

    /// The seen one of the triangles in one plane that stop the ray, if any does. One that the ray meets is given: a
    /// caster that goes on behind it may miss others at the same distance.
    fn seen_in_plane(&self, ray: &Ray, met: Hit, stops: impl Fn(&Hit) -> bool) -> Option<Hit> {
        let overlaps = self.scene.overlaps();
        let others = overlaps.with(met.triangle);
        let mut seen = stops(&met).then_some(met);
        if others.is_empty() || self.is_grazing(ray, met.triangle) {
            return seen;
        }
        let place = |hit: &Hit| (hit.triangle, self.faces(ray, hit.triangle));
        for &triangle in others {
            let other = MollerTrumbore::intersect(ray, &self.scene.triangles[triangle.index()])
                .map(|(t, u, v)| Hit { triangle, t, u, v });
            let comes_first = |other: &Hit| {
                seen.is_none_or(|seen| overlaps.comes_first(place(other), place(&seen)))
            };
            if let Some(other) = other.filter(comes_first)
                && stops(&other)
            {
                seen = Some(other);
            }
        }
        seen
    }
}

/// Below this cosine to the normal a ray meets triangles in one plane at distances that have little to do with
/// each other, and the nearest is seen.
pub(crate) const GRAZING: f32 = 1e-3;

/// Whether a ray ends at a triangle, by the opacity of the side that it meets.
pub(crate) fn stops(ending: &Ending, triangle: TriangleId, opacity: f32) -> bool {
    opacity > 0.0 && ending.at(triangle) < opacity
}

impl<C: RayCaster> RayCaster for Surfaces<C> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.seen(ray, self.inner.nearest(ray), || Ending::by_chance(ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.inner.occluded(ray) && !self.passes(ray)
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        self.inner.nearest_batch(rays, hits);
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.seen(ray, *hit, || Ending::by_chance(ray));
        }
    }

    fn nearest_ending(&self, rays: &[Ray], endings: &[Ending], hits: &mut Vec<Option<Hit>>) {
        if endings.iter().all(|ending| !ending.passes_any()) {
            self.inner.nearest_batch(rays, hits);
            for ((ray, ending), hit) in rays.iter().zip(endings).zip(hits) {
                *hit = self.seen(ray, *hit, || *ending);
            }
        } else {
            hits.clear();
            hits.extend(rays.iter().zip(endings).map(|(ray, ending)| self.stop(ray, *ending)));
        }
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        self.inner.occluded_batch(rays, blocked);
        if self.has_openings {
            for (ray, blocked) in rays.iter().zip(blocked) {
                *blocked = *blocked && !self.passes(ray);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Bvh;
    use crate::geometry::{Stops, Triangle};
    use crate::scene::{Material, MaterialId};
    use glam::Vec3;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Counts how often a ray starts at the root.
    struct Counting(Bvh, AtomicUsize);

    impl RayCaster for Counting {
        fn nearest(&self, ray: &Ray) -> Option<Hit> {
            self.1.fetch_add(1, Ordering::Relaxed);
            self.0.nearest(ray)
        }

        fn occluded(&self, ray: &Ray) -> bool {
            self.nearest(ray).is_some()
        }

        fn nearest_stop(&self, ray: &Ray, stops: Stops) -> Option<Hit> {
            self.1.fetch_add(1, Ordering::Relaxed);
            self.0.nearest_stop(ray, stops)
        }
    }

    #[test]
    fn a_ray_through_many_panes_does_not_start_again_behind_each() {
        const PANES: usize = 3000;
        let pane = |k: usize| Triangle {
            p: [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z * k as f32),
        };
        let panes: Vec<Triangle> = (0..PANES).map(pane).collect();
        let glass = Material { opacity: 1e-3, ..Material::fallback() };
        let scene = Scene::new(panes.clone(), vec![MaterialId(0); PANES], vec![glass]);
        let caster = Surfaces::new(Counting(Bvh::build(panes), AtomicUsize::new(0)), &scene);
        const RAYS: usize = 4000;
        let ray = |k: usize| {
            let away = Vec3::new(0.1 + k as f32 * 1e-4, 0.1, -1.0);
            Ray::new(away, Vec3::Z)
        };
        let hits: Vec<_> = (0..RAYS).map(|k| caster.nearest(&ray(k))).collect();
        assert!(caster.inner.1.load(Ordering::Relaxed) <= 2 * RAYS);
        // Independent draws: each passes all panes with probability 0.999^3000.
        let passed = hits.iter().filter(|hit| hit.is_none()).count() as f64 / RAYS as f64;
        let expected = 0.999f64.powi(PANES as i32);
        let deviation = (expected * (1.0 - expected) / RAYS as f64).sqrt();
        assert!((passed - expected).abs() < 5.0 * deviation, "{passed} {expected}");
        let blocked = (0..RAYS).map(|k| caster.occluded(&ray(k)));
        assert!(blocked.zip(&hits).all(|(blocked, hit)| blocked == hit.is_some()));
    }
}
