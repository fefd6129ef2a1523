//! Pictures by final gathering: direct light at every sample, indirect light by rays that read the solution.
//!
//! What a pixel shows falls into two parts. Emission and light straight from sampled lights are sharp: they are
//! estimated at each sample, so that shadows are as sharp as the pixels, whatever the patches. All other light
//! is soft: at each sample rays are sent out that read the radiosity of the patches that they meet. Reflectance is
//! divided out of it, and it is averaged over neighbouring pixels as far as two independent halves of the
//! rays agree that this helps (see [`filter`]).

mod errors;
mod filter;
mod picture;
mod rounds;
mod row;
mod spot;
mod work;

use super::samples::Eye;
use super::{Frame, Image};
use crate::color::Rgb;
use crate::geometry::RayCaster;
use crate::patches::PatchMesh;
use crate::paths::{Lights, Paths, Solved};
use crate::progress::Progress;
use crate::scene::Camera;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

/// The light of a solution, as rays that are gathered read it.
pub(crate) struct Gathered {
    mesh: Arc<PatchMesh>,
    lights: Lights,
    solved: Solved,
}

impl Gathered {
    /// `irradiance` in W·m⁻², and the uncovered share of its area, per patch.
    pub(crate) fn new(mesh: &Arc<PatchMesh>, irradiance: &[Rgb], uncovered: &[f32]) -> Self {
        let lights = Lights::of(mesh);
        let solved = Solved::of(mesh, &lights, irradiance, uncovered);
        Gathered { solved, mesh: mesh.clone(), lights }
    }

    /// The picture that a camera sees.
    pub(crate) fn draw(
        &self,
        caster: &dyn RayCaster,
        camera: &Camera,
        frame: &Frame,
        progress: &dyn Progress,
    ) -> Image {
        let mesh = &self.mesh;
        let eye = Eye { caster, mesh, camera, frame };
        let known = Some(&self.solved);
        let paths = Paths {
            caster,
            mesh,
            lights: &self.lights,
            known,
            seed: frame.seed,
            rays: AtomicU64::new(0),
        };
        match rounds::sample(&eye, &paths, progress) {
            Some((picture, soft)) => {
                Image { rays: paths.rays.into_inner(), ..picture.compose(frame, &soft) }
            }
            // The caller throws it away.
            None => Image::default(),
        }
    }
}
