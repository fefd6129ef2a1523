//! The whole pipeline on two tracers, and every difference traced back to the rays that made it.
//!
//! With one seed both tracers are asked about the same rays. What comes of their answers (form
//! factors, direct light, coverage, pixels) is compared number by number; whatever differs is made
//! once more, with a comparing caster in the tracer's place, which asks both tracers and lets the exact
//! referee settle each answer that differs. Both pictures are drawn with the native solution, so that a
//! pixel differs by its own rays alone; what the other solution would have changed is kept apart.

mod comparing_caster;
mod picture;
#[cfg(test)]
mod tests;

use crate::color::{Rgb, Rgb64, rounded};
use crate::coverage::{uncovered, uncovered_share};
use crate::direct::SKY_SAMPLES;
use crate::error::Result;
use crate::field::{Constant, Interpolated, IrradianceField};
use crate::form_factor::{Estimator, OnDemand, Rows};
use crate::geometry::RayCaster;
use crate::light::{EmittingTriangles, Light, UniformSky};
use crate::patches::{PatchId, PatchMesh};
use crate::progress::Progress;
use crate::radiosity::{self, Choices};
use crate::render::{Frame, Image, pixel, render};
use crate::sampling::{PointSet, Purpose};
use crate::scene::Camera;
pub use comparing_caster::{Cause, Pair};
use comparing_caster::{Detail, Difference};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;

/// The pipeline that is run on both tracers.
pub struct Pipeline<'a> {
    pub mesh: &'a PatchMesh,
    /// Settings of the light. `method` must be hemisphere, the only one whose rays can hit something else.
    pub settings: Choices,
    pub camera: &'a Camera,
    pub frame: Frame,
    /// See [`Interpolated::new`].
    pub crease: f32,
}

/// One kind of number, compared.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Compared {
    pub total: u64,
    pub differing: u64,
    /// How many of those that differ have which cause; of several causes the gravest.
    pub causes: BTreeMap<Cause, u64>,
    #[serde(skip)]
    sources: Vec<String>,
}

impl Compared {
    fn add(&mut self, differing: u64, difference: Difference) {
        self.differing += differing;
        *self.causes.entry(difference.cause).or_default() += differing;
        self.sources.extend(difference.source);
    }
}

/// The patches' radiosity, compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Solutions {
    pub total: u64,
    pub differing: u64,
    /// The largest difference of a patch's radiosity, in its worst channel, relative to its brightest
    /// one.
    pub largest_relative_difference: f64,
    /// Those that differ although the equations do not.
    pub unexplained: u64,
}

/// Everything that was compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Entries F_ij that either matrix has.
    pub form_factors: Compared,
    /// Patches; none if direct light was not estimated apart.
    pub direct_light: Compared,
    /// Patches' uncovered shares.
    pub coverage: Compared,
    pub radiosity: Solutions,
    /// Pixels.
    pub flat: Compared,
    /// Pixels.
    pub smooth: Compared,
}

impl Summary {
    pub fn stages(&self) -> [&Compared; 5] {
        [&self.form_factors, &self.direct_light, &self.coverage, &self.flat, &self.smooth]
    }

    /// Numbers that differ because we were wrong, or for no known reason.
    pub fn failures(&self) -> u64 {
        let causes = self.stages().into_iter().flat_map(|stage| &stage.causes);
        let failed = causes.filter(|(cause, _)| cause.is_failure()).map(|(_, count)| count);
        failed.sum::<u64>() + self.radiosity.unexplained
    }

    /// The queries that were answered wrongly, as source for a test.
    pub fn sources(&self) -> impl Iterator<Item = &String> {
        self.stages().into_iter().flat_map(|stage| &stage.sources)
    }
}

/// A summary, and what is needed to show where the differences lie.
pub struct Comparison {
    pub summary: Summary,
    /// Drawn with the native tracer.
    pub smooth: Image,
    /// Per pixel, the gravest cause of a difference in either picture.
    pub causes: Vec<Option<Cause>>,
}

impl Pipeline<'_> {
    /// Runs everything on both tracers, and explains what differs.
    ///
    /// # Errors
    /// See [`radiosity::solve`].
    pub fn compare(&self, pair: &Pair, progress: &dyn Progress) -> Result<Comparison> {
        let native = radiosity::solve(pair.native, self.mesh, &self.settings, progress)?;
        let peer = radiosity::solve(pair.peer, self.mesh, &self.settings, progress)?;
        let (shares, _) = uncovered(pair.native, self.mesh, progress);
        let irradiance = rounded(&native.irradiance);
        let constant = Constant::new(&irradiance, &shares);
        let interpolated = Interpolated::new(self.mesh, &irradiance, &shares, self.crease);

        let form_factors = self.form_factors(pair);
        let direct_light = self.direct_light(pair);
        let radiosity =
            solutions(&native.radiosity, &peer.radiosity, [&form_factors, &direct_light]);
        let flat = self.picture(pair, &constant, Detail::Patch, progress);
        let smooth = self.picture(pair, &interpolated, Detail::Point, progress);
        let causes = flat.causes.iter().zip(&smooth.causes).map(|(a, b)| *a.max(b)).collect();
        let coverage = self.coverage(pair);
        let (flat, smooth, image) = (flat.stage, smooth.stage, smooth.native);
        let summary = Summary { form_factors, direct_light, coverage, radiosity, flat, smooth };
        Ok(Comparison { summary, smooth: image, causes })
    }

    fn form_factors(&self, pair: &Pair) -> Compared {
        let settings = &self.settings;
        let row = |caster: &dyn RayCaster, i| {
            let (samples, points) = (settings.samples, settings.points);
            let of = Estimator::new(caster, self.mesh, samples, points, settings.seed, &());
            OnDemand::hemisphere(&of).row(i).entries
        };
        self.per_patch(pair, row, |a, b| count_entries(a, b))
    }

    fn direct_light(&self, pair: &Pair) -> Compared {
        let settings = &self.settings;
        let emitters = EmittingTriangles::of_patches(self.mesh);
        let sky = UniformSky::new(self.mesh.scene.sky);
        let mut lights: Vec<(&dyn Light, u32, Purpose)> = Vec::new();
        if settings.direct_samples > 0 {
            lights.push((&emitters, settings.direct_samples, Purpose::DirectLight));
        }
        if self.mesh.scene.sky != Rgb::ZERO {
            lights.push((&sky, SKY_SAMPLES, Purpose::Sky));
        }
        if lights.is_empty() {
            return Compared::default();
        }
        let light = |caster: &dyn RayCaster, i| {
            let from = |&(light, samples, purpose): &(&dyn Light, u32, Purpose)| {
                let points = PointSet::Sobol;
                let of = Estimator::new(caster, self.mesh, samples, points, settings.seed, &());
                of.direct_light_of(light, purpose, i)
            };
            lights.iter().map(from).collect::<Vec<Rgb64>>()
        };
        self.per_patch(pair, light, |a, b| (1, (a != b) as u64))
    }

    fn coverage(&self, pair: &Pair) -> Compared {
        let share = |caster: &dyn RayCaster, i| uncovered_share(caster, self.mesh, i);
        self.per_patch(pair, share, |a, b| (1, (a != b) as u64))
    }

    /// Compares what both casters make of each patch; `count` says how many numbers there are in
    /// two results, and how many of them differ.
    fn per_patch<T: PartialEq>(
        &self,
        pair: &Pair,
        make: impl Fn(&dyn RayCaster, PatchId) -> T + Sync,
        count: impl Fn(&T, &T) -> (u64, u64) + Sync,
    ) -> Compared {
        let compared: Vec<((u64, u64), Option<Difference>)> = (0..self.mesh.len() as u32)
            .into_par_iter()
            .map(|i| {
                let make = |caster: &dyn RayCaster| make(caster, PatchId(i));
                let (ours, theirs) = (make(pair.native), make(pair.peer));
                let results = (&ours, &theirs);
                let difference = pair.difference(self.mesh, Detail::Patch, results, make);
                (count(&ours, &theirs), difference)
            })
            .collect();
        let mut stage = Compared::default();
        for ((total, differing), difference) in compared {
            stage.total += total;
            difference.into_iter().for_each(|difference| stage.add(differing, difference));
        }
        stage
    }

    fn picture(
        &self,
        pair: &Pair,
        field: &dyn IrradianceField,
        detail: Detail,
        progress: &dyn Progress,
    ) -> Picture {
        let (mesh, camera, frame) = (self.mesh, self.camera, &self.frame);
        let [native, peer] = [pair.native, pair.peer]
            .map(|caster| render(caster, mesh, camera, frame, &[field], progress).remove(0));
        let differences: Vec<Option<Difference>> = (0..native.pixels.len())
            .into_par_iter()
            .map(|i| {
                let at = (i % frame.width as usize, i / frame.width as usize);
                let results = (&native.pixels[i], &peer.pixels[i]);
                let again = |c: &dyn RayCaster| pixel(c, mesh, camera, frame, at, field);
                pair.difference(mesh, detail, results, again)
            })
            .collect();
        let causes = differences.iter().map(|d| d.as_ref().map(|d| d.cause)).collect();
        let mut stage = Compared { total: native.pixels.len() as u64, ..Compared::default() };
        differences.into_iter().flatten().for_each(|difference| stage.add(1, difference));
        Picture { native, stage, causes }
    }
}

/// A picture drawn twice.
struct Picture {
    native: Image,
    stage: Compared,
    causes: Vec<Option<Cause>>,
}

/// How many entries two rows have, and how many of them differ.
fn count_entries(a: &[(PatchId, f64)], b: &[(PatchId, f64)]) -> (u64, u64) {
    let (a, b): (BTreeMap<_, _>, BTreeMap<_, _>) =
        (a.iter().copied().collect(), b.iter().copied().collect());
    let only_theirs = b.keys().filter(|j| !a.contains_key(j)).count();
    let differing = a.iter().filter(|(j, factor)| b.get(j) != Some(factor)).count();
    ((a.len() + only_theirs) as u64, (differing + only_theirs) as u64)
}

/// `equations`: what the solutions were made from.
fn solutions(native: &[Rgb64], peer: &[Rgb64], equations: [&Compared; 2]) -> Solutions {
    let pairs = || native.iter().zip(peer);
    let relative = pairs()
        .filter(|(a, b)| a != b)
        .map(|(a, b)| (*a - *b).abs().max_element() / a.abs().max(b.abs()).max_element());
    let differing = pairs().filter(|(a, b)| a != b).count() as u64;
    let is_explained = equations.iter().any(|stage| stage.differing > 0);
    Solutions {
        total: native.len() as u64,
        differing,
        largest_relative_difference: relative.fold(0.0, f64::max),
        unexplained: if is_explained { 0 } else { differing },
    }
}
