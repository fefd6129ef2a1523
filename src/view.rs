//! Light, ready to be drawn from anywhere.

use crate::error::{Error, Result};
use crate::geometry::RayCaster;
use crate::patches::PatchMesh;
use crate::progress::Progress;
use crate::render::shading::{Flat, Shading, Smooth};
use crate::render::smooth::VertexIrradiance;
use crate::render::{Frame, Image, render};
use crate::scene::Camera;
use crate::solution::Solution;

/// The patches of a scene with what they look like.
pub struct View {
    mesh: PatchMesh,
    shading: Box<dyn Shading>,
}

impl View {
    /// The usual crease angle in degrees.
    pub const CREASE: f32 = 30.0;

    /// The picture that a camera sees.
    ///
    /// # Errors
    /// `progress` asked to stop.
    pub fn draw(
        &self,
        caster: &dyn RayCaster,
        camera: &Camera,
        frame: &Frame,
        progress: &dyn Progress,
    ) -> Result<Image> {
        View::draw_all(std::slice::from_ref(self), caster, camera, frame, progress)
            .map(|mut images| images.remove(0))
    }

    /// The pictures of several views of one solution, all from the same rays.
    ///
    /// # Errors
    /// `progress` asked to stop.
    pub fn draw_all(
        views: &[View],
        caster: &dyn RayCaster,
        camera: &Camera,
        frame: &Frame,
        progress: &dyn Progress,
    ) -> Result<Vec<Image>> {
        let Some(first) = views.first() else { return Ok(Vec::new()) };
        let shadings: Vec<&dyn Shading> = views.iter().map(|view| &*view.shading).collect();
        let images = render(caster, &first.mesh, camera, frame, &shadings, progress);
        if progress.is_stopped() { Err(Error::stopped()) } else { Ok(images) }
    }
}

impl Solution {
    /// Patches as they are: constant.
    pub fn flat(&self) -> View {
        let mesh = self.patches();
        let shading = Box::new(Flat::new(&mesh, &self.irradiance, &self.uncovered));
        View { mesh, shading }
    }

    /// Irradiance interpolated over edges up to the crease angle, in degrees.
    pub fn smooth(&self, crease: f32) -> View {
        let mesh = self.patches();
        let vertices = VertexIrradiance::new(&mesh, &self.irradiance, &self.uncovered, crease);
        let shading = Box::new(Smooth::new(&mesh, vertices));
        View { mesh, shading }
    }
}
