//! The interface of every ray tracer: code that needs a ray answered asks a [`RayCaster`], and does not
//! know which.

use super::{Ending, Hit, Ray};

/// Whether a ray ends at a hit. The answer must not depend on the order of the calls.
pub type Stops<'a> = &'a dyn Fn(&Hit) -> bool;

/// Answers rays about one fixed set of triangles, from any thread.
pub trait RayCaster: Send + Sync {
    /// The hit with the smallest t in (`t_min`, `t_max`].
    fn nearest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything is hit in (`t_min`, `t_max`].
    fn occluded(&self, ray: &Ray) -> bool;

    /// The hit with the smallest t of those at which the ray ends. A tracer of many triangles should ask on its
    /// way instead of starting again behind each hit, as here.
    fn nearest_stop(&self, ray: &Ray, stops: Stops) -> Option<Hit> {
        let (mut rest, mut step) = (*ray, f32::EPSILON);
        loop {
            let found = self.nearest(&rest)?;
            if stops(&found) {
                return Some(found);
            }
            // Beyond the interval's start, which is open, nothing is met twice; but a kernel that rounds the
            // interval (Embree's) may give a t before it, for denormal directions far before it.
            if found.t > rest.t_min {
                rest.t_min = found.t;
            } else {
                rest.t_min = rest.t_min.max(f32::MIN_POSITIVE) * (1.0 + step);
                step = (2.0 * step).min(1.0);
            }
        }
    }

    /// [`nearest`](Self::nearest) for each ray; `hits` is overwritten and has the rays' length.
    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        hits.extend(rays.iter().map(|ray| self.nearest(ray)));
    }

    /// As [`nearest_batch`](Self::nearest_batch), and says for each ray how it ends among surfaces that let a share of
    /// the light through. A caster that knows nothing of that answers by rules of its own, as here.
    fn nearest_ending(&self, rays: &[Ray], endings: &[Ending], hits: &mut Vec<Option<Hit>>) {
        debug_assert_eq!(rays.len(), endings.len());
        self.nearest_batch(rays, hits);
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

    fn nearest_stop(&self, ray: &Ray, stops: Stops) -> Option<Hit> {
        (**self).nearest_stop(ray, stops)
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        (**self).nearest_batch(rays, hits);
    }

    fn nearest_ending(&self, rays: &[Ray], endings: &[Ending], hits: &mut Vec<Option<Hit>>) {
        (**self).nearest_ending(rays, endings, hits);
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        (**self).occluded_batch(rays, blocked);
    }
}
