//! Pictures by final gathering: direct light at every sample, indirect light by rays that read the solution.
//!
//! What a pixel shows falls into two parts. Emission and light straight from sampled lights are sharp: they are
//! estimated at each sample, so that shadows are as sharp as the pixels, whatever the patches. All other light
//! is soft: at each sample rays are sent out that read the radiosity of the patches that they meet. Reflectance is
//! divided out of it, and it is averaged over neighbouring pixels as far as that helps by an estimate of the
//! error (see [`filter`]).

pub(super) mod errors;
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
pub(crate) use rounds::Rounds;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

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

    /// The picture that a camera sees, on its way. `camera` in the coordinates of the scene.
    pub(crate) fn begin<'a>(
        &'a self,
        caster: &'a dyn RayCaster,
        camera: Camera,
        frame: &Frame,
    ) -> Drawing<'a> {
        Drawing { light: self, caster, camera, frame: *frame, rounds: Rounds::new(frame) }
    }
}

/// A gathered picture on its way.
pub(crate) struct Drawing<'a> {
    light: &'a Gathered,
    caster: &'a dyn RayCaster,
    camera: Camera,
    frame: Frame,
    rounds: Rounds,
}

impl Drawing<'_> {
    /// All that is known so far, to be kept.
    pub(crate) fn rounds(&self) -> &Rounds {
        &self.rounds
    }

    /// Goes on from what was kept of a picture of the same light, camera and frame: the bits are those of a picture
    /// that was never left. Returns whether what was kept can be of this frame.
    pub(crate) fn take_up(&mut self, kept: Rounds) -> bool {
        let is_possible = kept.is_of(&self.frame);
        if is_possible {
            self.rounds = kept;
            self.rounds.take_up(&self.frame);
        }
        is_possible
    }

    /// Draws until `until`, or to the end. Returns whether that is reached, or `progress` wants no more.
    pub(crate) fn go_on(&mut self, until: Option<Instant>, progress: &dyn Progress) -> bool {
        let Gathered { mesh, lights, solved } = self.light;
        let (camera, frame, caster) = (&self.camera, &self.frame, self.caster);
        let eye = Eye { caster, mesh, camera, frame };
        let rays = AtomicU64::new(self.rounds.rays);
        let paths = Paths { caster, mesh, lights, known: Some(solved), seed: frame.seed, rays };
        let is_over = self.rounds.go_on(&eye, &paths, until, progress);
        self.rounds.rays = paths.rays.into_inner();
        is_over
    }

    /// The picture as it is; `None` before each pixel has samples.
    pub(crate) fn image(&self) -> Option<Image> {
        self.rounds.image(&self.frame)
    }
}
