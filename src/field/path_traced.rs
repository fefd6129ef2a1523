//! Irradiance by path tracing: the reference that owes nothing to the patches.

use super::IrradianceField;
use crate::color::Rgb;
use crate::geometry::RayCaster;
use crate::patches::{PatchMesh, SurfacePoint};
use crate::paths::{Lights, Paths, Start};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// One path per point: an unbiased estimate of H, and a noisy one. The mean over many samples of a pixel is the
/// truth that every other field is compared with.
///
/// Kajiya, *The Rendering Equation*, SIGGRAPH 1986; next-event estimation and Russian roulette as in Pharr, Jakob &
/// Humphreys, *Physically Based Rendering*, 4th edition, §13.
pub struct PathTraced {
    mesh: Arc<PatchMesh>,
    lights: Lights,
    seed: u64,
    rays: AtomicU64,
}

impl PathTraced {
    /// Of `mesh` only the triangles, their materials and their lit sides count.
    pub fn new(mesh: &Arc<PatchMesh>, seed: u64) -> Self {
        let (mesh, lights) = (mesh.clone(), Lights::of(mesh));
        PathTraced { mesh, lights, seed, rays: AtomicU64::new(0) }
    }
}

impl IrradianceField for PathTraced {
    fn irradiance(&self, caster: &dyn RayCaster, at: &[SurfacePoint], irradiance: &mut [Rgb]) {
        let paths = Paths {
            caster,
            mesh: &self.mesh,
            lights: &self.lights,
            known: None,
            seed: self.seed,
            rays: AtomicU64::new(0),
        };
        let starts: Vec<Start> = at.iter().map(Start::at).collect();
        irradiance.fill(Rgb::ZERO);
        paths.add_irradiance(&starts, irradiance);
        self.rays.fetch_add(paths.rays.into_inner(), Ordering::Relaxed);
    }

    fn is_noisy(&self) -> bool {
        true
    }

    fn rays(&self) -> u64 {
        self.rays.load(Ordering::Relaxed)
    }
}
