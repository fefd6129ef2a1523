//! The upper level: a solution on few and large patches.

use crate::color::rounded;
use crate::coverage;
use crate::error::{Error, Result};
use crate::geometry::RayCaster;
use crate::patches::PatchMesh;
use crate::paths::{Lights, Solved};
use crate::progress::Progress;
use crate::radiosity::{self, Choices, Radiosity};

/// The elements with their light, as the rays of patches read it.
pub(crate) struct Elements {
    pub(super) mesh: PatchMesh,
    pub(super) lights: Lights,
    pub(super) solved: Solved,
    pub(crate) light: Radiosity,
    /// Rays for the search for covered elements.
    pub(crate) cover_rays: u64,
}

impl Elements {
    /// Solves for their light. `choices` are those of the patches.
    ///
    /// # Errors
    /// See [`radiosity::solve`].
    pub(crate) fn solve(
        caster: &dyn RayCaster,
        mesh: PatchMesh,
        choices: &Choices,
        progress: &dyn Progress,
    ) -> Result<Elements> {
        let light = radiosity::solve(caster, &mesh, &choices.of_elements(), progress)?;
        let (uncovered, cover_rays) = coverage::uncovered(caster, &mesh, progress);
        if progress.is_stopped() {
            return Err(Error::stopped());
        }
        let lights = Lights::of(&mesh);
        let solved = Solved::of(&mesh, &lights, &rounded(&light.irradiance), &uncovered);
        Ok(Elements { mesh, lights, solved, light, cover_rays })
    }
}
