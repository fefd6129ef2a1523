//! The interface of every ray tracer: code that needs a ray answered asks a [`RayCaster`], and does not
//! know which.

use super::{Hit, Ray};

/// Answers rays about one fixed set of triangles, from any thread.
pub trait RayCaster: Send + Sync {
    /// The hit with the smallest t in (`t_min`, `t_max`].
    fn nearest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything is hit in (`t_min`, `t_max`].
    fn occluded(&self, ray: &Ray) -> bool;

    /// [`nearest`](Self::nearest) for each ray; `hits` is overwritten and has the rays' length.
    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        hits.extend(rays.iter().map(|ray| self.nearest(ray)));
    }

    /// [`occluded`](Self::occluded) for each ray; `blocked` is overwritten and has the rays' length.
    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        blocked.clear();
        blocked.extend(rays.iter().map(|ray| self.occluded(ray)));
    }
}

/// Lets a caster chosen at run time be passed where any caster is taken.
impl<C: RayCaster + ?Sized> RayCaster for &C {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        (**self).nearest(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        (**self).occluded(ray)
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        (**self).nearest_batch(rays, hits);
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        (**self).occluded_batch(rays, blocked);
    }
}
