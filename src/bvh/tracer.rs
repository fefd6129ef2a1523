//! The native ray tracer, its kernel chosen at run time.

use super::{Bvh, Effort, Surfaces};
use crate::geometry::{Ending, Hit, KernelKind, MollerTrumbore, Plane, Ray, RayCaster};
use crate::scene::Scene;

/// The triangles of a scene, ready to be traced. It owns what it needs.
pub struct Tracer(Box<dyn RayCaster>);

impl Tracer {
    /// Builds quickly, for the Möller–Trumbore kernel.
    ///
    /// # Panics
    /// As [`Bvh::build`].
    pub fn build(scene: &Scene) -> Tracer {
        Tracer::build_with(scene, Effort::Quick, KernelKind::MollerTrumbore)
    }

    /// As [`build`](Tracer::build), with a chosen effort and kernel.
    ///
    /// # Panics
    /// As [`Bvh::build`].
    pub fn build_with(scene: &Scene, effort: Effort, kernel: KernelKind) -> Tracer {
        let triangles = scene.triangles.clone();
        match kernel {
            KernelKind::Plane => Tracer::of(Bvh::<Plane>::build_with(triangles, effort), scene),
            KernelKind::MollerTrumbore => {
                Tracer::of(Bvh::<MollerTrumbore>::build_with(triangles, effort), scene)
            }
        }
    }

    fn of(bvh: impl RayCaster + 'static, scene: &Scene) -> Tracer {
        let needed = scene.hides_or_opens();
        Tracer(if needed { Box::new(Surfaces::new(bvh, scene)) } else { Box::new(bvh) })
    }
}

impl RayCaster for Tracer {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        self.0.nearest(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.0.occluded(ray)
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        self.0.nearest_batch(rays, hits);
    }

    fn nearest_ending(&self, rays: &[Ray], endings: &[Ending], hits: &mut Vec<Option<Hit>>) {
        self.0.nearest_ending(rays, endings, hits);
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        self.0.occluded_batch(rays, blocked);
    }
}
