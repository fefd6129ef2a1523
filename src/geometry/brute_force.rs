//! Every ray against every triangle: slow, and plainly right.

use super::{Hit, Kernel, Ray, RayCaster, Stops, Triangle, TriangleId};
use std::marker::PhantomData;

/// Asks kernel `K` about every triangle. Of hits at equal t the lowest triangle wins.
pub struct BruteForce<'t, K> {
    triangles: &'t [Triangle],
    kernel: PhantomData<K>,
}

impl<'t, K: Kernel> BruteForce<'t, K> {
    pub fn new(triangles: &'t [Triangle]) -> Self {
        BruteForce { triangles, kernel: PhantomData }
    }
}

impl<K: Kernel> RayCaster for BruteForce<'_, K> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.nearest_stop(ray, &|_| true)
    }

    fn nearest_stop(&self, ray: &Ray, stops: Stops) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        for (index, triangle) in self.triangles.iter().enumerate() {
            let Some((t, u, v)) = K::intersect(ray, triangle) else { continue };
            let hit = Hit { triangle: TriangleId(index as u32), t, u, v };
            if nearest.is_none_or(|nearest| t < nearest.t) && stops(&hit) {
                nearest = Some(hit);
            }
        }
        nearest
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.triangles.iter().any(|triangle| K::intersect(ray, triangle).is_some())
    }
}
