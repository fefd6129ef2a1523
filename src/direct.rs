//! Light that arrives straight from the emitters.
//!
//! A small lamp fills little of a patch's hemisphere, so few of its rays would find it. Sampling
//! points of the lamp instead (next-event estimation, as path tracers call it) separates the first
//! bounce from the others: with D_i = Σ_j F_ij E_j known, the reflected part B′ = B − E of the
//! radiosity solves
//!
//! ```text
//! B′_i = ρ_i D_i + ρ_i Σ_j F_ij B′_j,
//! ```
//!
//! the same equation with the lit patches as its emitters.

use crate::color::{Rgb, Rgb64, luminance64};
use crate::error::{Error, Result};
use crate::form_factor::Estimator;
use crate::geometry::{Ray, RayCaster};
use crate::layers::{Along, Layers};
use crate::light::{EmittingTriangles, Facet, Light, UniformSky};
use crate::patches::{Members, PatchId, PatchMesh};
use crate::progress::{Progress, Stage};
use crate::sampling::{EIGHTHS, PointSet, Purpose, Stream, block, numbers};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Light that arrives straight from sources, per patch, in W·m⁻².
#[derive(Default, Serialize, Deserialize)]
pub(crate) struct DirectLight {
    /// From the surfaces that emit; `None` where the form factors carry their light.
    from_emitters: Option<Vec<Rgb64>>,
    from_sky: Option<Vec<Rgb64>>,
    eighths: Option<DirectEighths>,
    pub(crate) rays: u64,
}

/// The luminance of direct light per patch by eighths of its samples, in W·m⁻²; empty of lights that are not sampled.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct DirectEighths {
    pub from_emitters: Vec<[f32; EIGHTHS]>,
    pub from_sky: Vec<[f32; EIGHTHS]>,
}

impl DirectLight {
    pub(crate) fn has_emitters(&self) -> bool {
        self.from_emitters.is_some()
    }

    pub(crate) fn of_sky(&self, i: usize) -> Rgb64 {
        self.from_sky.as_ref().map_or(Rgb64::ZERO, |light| light[i])
    }

    pub(crate) fn irradiance(&self, i: usize) -> Rgb64 {
        self.from_emitters.as_ref().map_or(Rgb64::ZERO, |light| light[i]) + self.of_sky(i)
    }

    /// `None` where a light has too few samples.
    pub(crate) fn eighths(&self) -> Option<&DirectEighths> {
        self.eighths.as_ref()
    }

    /// Whether it may be that of this number of patches.
    pub(crate) fn is_possible(&self, patches: usize) -> bool {
        let is_light = |light: &Rgb64| light.is_finite() && light.min_element() >= 0.0;
        let are_eighths = |eighths: &[[f32; EIGHTHS]], light: &Option<Vec<Rgb64>>| {
            eighths.len() == light.as_ref().map_or(0, Vec::len)
                && eighths.as_flattened().iter().all(|x| x.is_finite() && *x >= 0.0)
        };
        let lights = [&self.from_emitters, &self.from_sky].into_iter().flatten();
        self.rays <= 1 << 60
            && lights.clone().all(|light| light.len() == patches)
            && lights.flatten().all(is_light)
            && self.eighths.as_ref().is_none_or(|eighths| {
                are_eighths(&eighths.from_emitters, &self.from_emitters)
                    && are_eighths(&eighths.from_sky, &self.from_sky)
            })
    }

    /// Samples the lights: the emitters by `samples` points for each patch, or by none.
    ///
    /// # Errors
    /// `progress` asked to stop.
    pub(crate) fn of(
        caster: &dyn RayCaster,
        mesh: &PatchMesh,
        samples: u32,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<DirectLight> {
        let mut rays = 0;
        let mut sample = |light: &dyn Light, samples, purpose| {
            let estimator = Estimator::new(caster, mesh, samples, PointSet::Sobol, seed, progress);
            let found = estimator.direct_by_eighths(light, purpose);
            rays += estimator.rays();
            if progress.is_stopped() { Err(Error::stopped()) } else { Ok(found) }
        };
        let sky_samples = mesh.scene.affordable(mesh.len(), SKY_SAMPLES);
        let from_emitters = match samples {
            0 => None,
            _ => {
                let emitters = EmittingTriangles::of_patches(mesh);
                Some(sample(&emitters, samples, Purpose::DirectLight)?)
            }
        };
        let from_sky = match mesh.scene.sky {
            Rgb::ZERO => None,
            sky => Some(sample(&UniformSky::new(sky), sky_samples, Purpose::Sky)?),
        };
        let (from_emitters, of_emitters) = from_emitters.unzip();
        let (from_sky, of_sky) = from_sky.unzip();
        let suffice = |samples: u32| samples >= EIGHTHS as u32;
        let are_known = (samples == 0 || suffice(samples)) && suffice(sky_samples);
        let eighths = are_known.then(|| DirectEighths {
            from_emitters: of_emitters.unwrap_or_default(),
            from_sky: of_sky.unwrap_or_default(),
        });
        Ok(DirectLight { from_emitters, from_sky, eighths, rays })
    }
}

/// Directions to the sky that are tried from each patch.
pub(crate) const SKY_SAMPLES: u32 = 256;

impl Estimator<'_> {
    /// The irradiance that comes straight from a light, D_i in W·m⁻², of every patch, from `samples` points
    /// each. Lights with different purposes use different random numbers.
    pub fn direct_light(&self, light: &dyn Light, purpose: Purpose) -> Vec<Rgb64> {
        self.direct_by_eighths(light, purpose).0
    }

    /// As [`direct_light`](Self::direct_light), also its luminance by eighths of the samples.
    pub(crate) fn direct_by_eighths(
        &self,
        light: &dyn Light,
        purpose: Purpose,
    ) -> (Vec<Rgb64>, Vec<[f32; EIGHTHS]>) {
        self.progress.begin(Stage::DirectLight, Some(self.mesh.len() as u64));
        let light = (0..self.mesh.len())
            .into_par_iter()
            .map_init(DirectWork::default, |work, i| {
                if i % 64 == 0 {
                    self.progress.advance(64);
                }
                // What is left undone is never read: the solution ends with an error.
                let stopped = self.progress.is_stopped();
                if stopped {
                    (Rgb64::ZERO, [0.0; EIGHTHS])
                } else {
                    work.direct(self, light, purpose, PatchId(i as u32))
                }
            })
            .unzip();
        self.progress.end();
        light
    }

    /// D_i of one patch, as [`direct_light`](Self::direct_light) would give it.
    pub fn direct_light_of(&self, light: &dyn Light, purpose: Purpose, i: PatchId) -> Rgb64 {
        DirectWork::default().direct(self, light, purpose, i).0
    }
}

/// One thread's buffers.
#[derive(Default)]
struct DirectWork {
    segments: Vec<Ray>,
    /// The light that each segment brings if clear, and the sample's number.
    light: Vec<(Rgb64, u32)>,
    /// Of which this share passes.
    shares: Vec<f32>,
    layers: Layers,
}

impl DirectWork {
    /// D_i, and its luminance by eighths of the samples.
    fn direct(
        &mut self,
        of: &Estimator,
        light: &dyn Light,
        purpose: Purpose,
        i: PatchId,
    ) -> (Rgb64, [f32; EIGHTHS]) {
        let members = Members::of(of.mesh, i);
        let only = (!of.mesh.is_cluster(i)).then(|| Facet::patch(of.mesh, i));
        let stream = Stream::new(of.seed, purpose, i.0 as u64, PointSet::Sobol);
        self.segments.clear();
        self.light.clear();
        for k in 0..of.samples {
            let [x0, x1, y0, y1] = stream.point(k);
            let (side, x0) = members.choose(x0);
            let member;
            let patch = match &only {
                Some(patch) => patch,
                None => {
                    member = Facet::new(members.part(side), side);
                    &member
                }
            };
            if let Some(sample) = light.sample(patch, [x0, x1, y0, y1]) {
                self.segments.push(sample.segment);
                self.light.push((sample.irradiance, k));
            }
        }
        let through = (of.caster, of.mesh);
        // A patch has many directions to the sky, among which chance leaves little noise.
        let layers = if matches!(purpose, Purpose::Sky) { Along::Chance } else { Along::Layers };
        of.count_rays(self.layers.passed(layers, through, &self.segments, &mut self.shares));
        let (mut sum, mut eighths) = (Rgb64::ZERO, [0.0; EIGHTHS]);
        for ((light, number), share) in self.light.iter().zip(&self.shares) {
            let light = *light * f64::from(*share);
            sum += light;
            eighths[block(*number, of.samples, EIGHTHS)] += luminance64(light);
        }
        let samples = |k: usize| numbers(k, of.samples as usize, EIGHTHS).len() as f64;
        let mean = |k: usize| (eighths[k] / samples(k).max(1.0)) as f32;
        (sum / of.samples as f64, std::array::from_fn(mean))
    }
}
