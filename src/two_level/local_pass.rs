//! The lower level: each patch gathers its light from the elements.

use super::{Elements, Part};
use crate::color::{Rgb, Rgb64, luminance};
use crate::coverage;
use crate::error::{Error, Result};
use crate::geometry::RayCaster;
use crate::patches::{PatchId, PatchMesh};
use crate::paths::{PatchPaths, Paths, Start};
use crate::progress::{Progress, Stage};
use crate::radiosity::Choices;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Independent sets of paths per patch, from whose means the error is estimated.
const SETS: u32 = 8;

/// Patches whose paths are traced together.
const BATCH: usize = 16;

/// Paths, about, between two chances to keep what is done: a few seconds' work.
const STRETCH: usize = 1 << 22;

/// The light of patches by paths that end at elements.
pub(crate) struct LocalPass<'a> {
    paths: Paths<'a>,
    of_patch: PatchPaths,
    mesh: &'a PatchMesh,
    cover: coverage::Search<'a>,
}

/// One thread's buffers.
#[derive(Default)]
struct Work {
    starts: Vec<Start>,
    irradiance: Vec<Rgb>,
    cover: coverage::Work,
}

impl<'a> LocalPass<'a> {
    /// For the patches of `mesh`, which has the scene of the elements.
    pub(crate) fn new(
        caster: &'a dyn RayCaster,
        mesh: &'a PatchMesh,
        elements: &'a Elements,
        choices: &Choices,
    ) -> Self {
        let paths = Paths {
            caster,
            mesh: &elements.mesh,
            lights: &elements.lights,
            known: Some(&elements.solved),
            seed: choices.seed,
            rays: AtomicU64::new(0),
        };
        let of_patch =
            PatchPaths { seed: choices.seed, sets: SETS, paths: choices.samples.div_ceil(SETS) };
        LocalPass { paths, of_patch, mesh, cover: coverage::Search::new(caster, mesh) }
    }

    /// Does what is left of a part. `keep` may store what is done, now and then, and before `progress` stops it. Returns
    /// the rays that were traced to find what is covered.
    ///
    /// # Errors
    /// What `keep` says; or `progress` asked to stop.
    pub(crate) fn finish(
        &self,
        part: &mut Part,
        keep: &mut dyn FnMut(&Part) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<u64> {
        let patches = part.patches();
        let cover_rays = AtomicU64::new(0);
        progress.begin(Stage::Patches, Some(patches.len() as u64));
        progress.advance(part.light.irradiance.len() as u64);
        part.reserve();
        loop {
            let first = patches.start + part.light.irradiance.len();
            let paths = (self.of_patch.sets * self.of_patch.paths) as usize;
            // In whole blocks, as every part is.
            let stretch = (STRETCH / paths / Part::BLOCK).clamp(1, 64) * Part::BLOCK;
            let count = stretch.min(patches.end - first);
            if count == 0 {
                break;
            }
            self.add(part, first, count, &cover_rays, progress);
            if progress.is_stopped() {
                // What was begun is not done.
                part.truncate(first - patches.start);
                keep(part)?;
                return Err(Error::stopped());
            }
            part.rays += self.paths.rays.swap(0, Ordering::Relaxed);
            keep(part)?;
        }
        progress.end();
        Ok(cover_rays.into_inner())
    }

    /// Adds the light of the next `count` patches, the first of which is `first`.
    fn add(
        &self,
        part: &mut Part,
        first: usize,
        count: usize,
        cover_rays: &AtomicU64,
        progress: &dyn Progress,
    ) {
        let light = &mut part.light;
        let done = light.irradiance.len();
        light.irradiance.resize(done + count, Rgb::ZERO);
        light.error.resize(done + count, 0.0);
        light.uncovered.resize(done + count, 1.0);
        let irradiance = light.irradiance[done..].par_chunks_mut(BATCH);
        let error = light.error[done..].par_chunks_mut(BATCH);
        let uncovered = light.uncovered[done..].par_chunks_mut(BATCH);
        let batches = irradiance.zip(error).zip(uncovered).enumerate();
        batches.for_each_init(Work::default, |work, (batch, ((irradiance, error), uncovered))| {
            // The caller throws away what is left undone.
            if progress.is_stopped() {
                return;
            }
            let first = PatchId((first + batch * BATCH) as u32);
            let rays = self.cover.shares(&mut work.cover, first, uncovered);
            cover_rays.fetch_add(rays, Ordering::Relaxed);
            self.gather(work, first, irradiance, error);
            progress.advance(BATCH as u64);
        });
        let blocks = light.irradiance[done..].par_chunks(Part::BLOCK).enumerate();
        let absorbed = |(block, light): (usize, &[Rgb])| {
            self.absorbed(PatchId((first + block * Part::BLOCK) as u32), light)
        };
        part.absorbed.par_extend(blocks.map(absorbed));
    }

    /// The irradiance of the patches from `first` on, and its error.
    fn gather(&self, work: &mut Work, first: PatchId, irradiance: &mut [Rgb], error: &mut [f32]) {
        work.starts.clear();
        for patch in 0..irradiance.len() as u32 {
            self.of_patch.add_starts(self.mesh, PatchId(first.0 + patch), &mut work.starts);
        }
        work.irradiance.clear();
        work.irradiance.resize(work.starts.len(), Rgb::ZERO);
        self.paths.add_irradiance(&work.starts, &mut work.irradiance);
        let of_patch = work.irradiance.chunks_exact((SETS * self.of_patch.paths) as usize);
        for ((irradiance, error), by_paths) in irradiance.iter_mut().zip(error).zip(of_patch) {
            (*irradiance, *error) = mean_and_error(by_paths, self.of_patch.paths as usize);
        }
    }

    /// The power that the patches of one block absorb, in watts.
    fn absorbed(&self, first: PatchId, irradiance: &[Rgb]) -> Rgb64 {
        let square_metres = self.mesh.scene.metres_per_unit.powi(2);
        let patches = (first.0..).map(PatchId).zip(irradiance);
        patches
            .map(|(patch, irradiance)| {
                let kept = 1.0 - self.mesh.reflectance(patch).as_dvec3();
                kept * irradiance.as_dvec3() * (self.mesh.opaque_area(patch) * square_metres)
            })
            .sum()
    }
}

/// The mean of sets of `of_set` values each, and the standard error of its luminance: s/√n over the means of the sets.
fn mean_and_error(values: &[Rgb], of_set: usize) -> (Rgb, f32) {
    let mut means = [Rgb64::ZERO; SETS as usize];
    for (mean, set) in means.iter_mut().zip(values.chunks_exact(of_set)) {
        *mean = set.iter().map(|value| value.as_dvec3()).sum::<Rgb64>() / of_set as f64;
    }
    let sets = SETS as f64;
    let mean = means.iter().sum::<Rgb64>() / sets;
    let off = |of_set: &Rgb64| (luminance((*of_set - mean).as_vec3()) as f64).powi(2);
    let variance = means.iter().map(off).sum::<f64>() / (sets - 1.0);
    (mean.as_vec3(), (variance / sets).sqrt() as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_a_mean_is_that_of_the_means_of_its_sets() {
        // Sets of two values whose means are 0, 1, …, 7: s² = 6 about the mean 3.5.
        let values: Vec<Rgb> =
            (0..8).flat_map(|set| [set as f32 - 0.25, set as f32 + 0.25].map(Rgb::splat)).collect();
        let (mean, error) = mean_and_error(&values, 2);
        assert_eq!(mean, Rgb::splat(3.5));
        assert!((f64::from(error) - (6.0f64 / 8.0).sqrt()).abs() < 1e-6, "{error}");
    }
}
