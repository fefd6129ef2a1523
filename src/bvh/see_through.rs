//! Rays that go on behind what is not opaque.
//!
//! A cut-out lets a ray through exactly where its texture is transparent. Where a share d of the light is
//! stopped, a ray is stopped with probability d, by a number that depends on the ray and the triangle alone:
//! so every caster that meets the same triangles gives the same answer.

use crate::geometry::{Hit, Ray, RayCaster};
use crate::scene::Scene;

/// A caster that sees the scene's openings.
pub struct SeeThrough<C> {
    inner: C,
    scene: Scene,
}

impl<C: RayCaster> SeeThrough<C> {
    /// `inner` must know the scene's triangles.
    pub fn new(inner: C, scene: &Scene) -> Self {
        SeeThrough { inner, scene: scene.clone() }
    }

    fn stops(&self, ray: &Ray, hit: &Hit) -> bool {
        let opacity = self.scene.opacity_at(hit.triangle, hit.u, hit.v);
        opacity >= 1.0 || (opacity > 0.0 && number(ray, hit) < opacity)
    }

    /// The first hit from this one on that stops the ray.
    fn go_on(&self, ray: &Ray, mut hit: Option<Hit>) -> Option<Hit> {
        let mut rest = *ray;
        while let Some(found) = hit {
            if self.stops(ray, &found) {
                return hit;
            }
            // Beyond the interval's start, which is open, nothing is met twice.
            rest.t_min = found.t;
            hit = self.inner.nearest(&rest);
        }
        None
    }
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

impl<C: RayCaster> RayCaster for SeeThrough<C> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.go_on(ray, self.inner.nearest(ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.inner.occluded(ray) && self.nearest(ray).is_some()
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        self.inner.nearest_batch(rays, hits);
        for (ray, hit) in rays.iter().zip(hits) {
            *hit = self.go_on(ray, *hit);
        }
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        self.inner.occluded_batch(rays, blocked);
        for (ray, blocked) in rays.iter().zip(blocked) {
            *blocked = *blocked && self.nearest(ray).is_some();
        }
    }
}
