//! Light, ready to be drawn from anywhere.

use crate::error::{Error, Result};
use crate::field::{Constant, Interpolated, IrradianceField, PathTraced};
use crate::geometry::RayCaster;
use crate::patches::PatchMesh;
use crate::progress::Progress;
use crate::render::gather::{Drawing, Gathered};
use crate::render::{Frame, Image, render};
use crate::scene::Camera;
use crate::solution::Solution;
use std::sync::Arc;

/// The patches of a scene with the irradiance at each of their points.
pub struct View {
    mesh: Arc<PatchMesh>,
    look: Look,
}

/// How the light is estimated at the points that a camera sees.
enum Look {
    Field(Box<dyn IrradianceField>),
    Gathered(Gathered),
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
    pub fn draw_all<'v>(
        views: &'v [View],
        caster: &dyn RayCaster,
        camera: &Camera,
        frame: &Frame,
        progress: &dyn Progress,
    ) -> Result<Vec<Image>> {
        let Some(first) = views.first() else { return Ok(Vec::new()) };
        let camera = camera.placed(first.mesh.scene.origin);
        let field = |view: &'v View| match &view.look {
            Look::Field(field) => Some(&**field),
            Look::Gathered(_) => None,
        };
        let fields: Vec<&dyn IrradianceField> = views.iter().filter_map(field).collect();
        let mut of_fields = match fields.is_empty() {
            true => Vec::new(),
            false => render(caster, &first.mesh, &camera, frame, &fields, progress),
        }
        .into_iter();
        let image = |view: &View| match &view.look {
            Look::Field(_) => of_fields.next().expect("one per field"),
            Look::Gathered(light) => {
                let mut drawing = light.begin(caster, camera.clone(), frame);
                drawing.go_on(None, progress);
                // What was stopped is thrown away.
                drawing.image().unwrap_or_default()
            }
        };
        let images = views.iter().map(image).collect();
        if progress.is_stopped() { Err(Error::stopped()) } else { Ok(images) }
    }
}

impl View {
    /// The picture that a camera sees, on its way; `None` where it is not gathered.
    pub(crate) fn begin<'a>(
        &'a self,
        caster: &'a dyn RayCaster,
        camera: &Camera,
        frame: &Frame,
    ) -> Option<Drawing<'a>> {
        let camera = camera.placed(self.mesh.scene.origin);
        match &self.look {
            Look::Field(_) => None,
            Look::Gathered(light) => Some(light.begin(caster, camera, frame)),
        }
    }
}

impl Solution {
    /// Patches as they are: constant.
    pub fn flat(&self) -> View {
        self.seen_by(Constant::new(self.irradiance(), self.uncovered()))
    }

    /// Irradiance interpolated over edges up to the crease angle, in degrees.
    pub fn smooth(&self, crease: f32) -> View {
        let mesh = self.patches();
        self.seen_by(Interpolated::new(&mesh, self.irradiance(), self.uncovered(), crease))
    }

    /// Direct light at every sample, and indirect light gathered from the patches.
    pub fn gathered(&self) -> View {
        let mesh = self.patches();
        let light = Gathered::new(&mesh, self.irradiance(), self.uncovered());
        View { mesh, look: Look::Gathered(light) }
    }

    /// The scene's light without its solution, by paths with numbers of this seed: unbiased and noisy.
    pub fn path_traced(&self, seed: u64) -> View {
        self.seen_by(PathTraced::new(&self.patches(), seed))
    }

    /// The light as a field of the caller's shows it.
    pub fn seen_by(&self, field: impl IrradianceField + 'static) -> View {
        View { mesh: self.patches(), look: Look::Field(Box::new(field)) }
    }
}
