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

use super::Estimator;
use super::pairs::{Facet, PairPoint, sample};
use crate::color::{Rgb64, luminance};
use crate::geometry::{Ray, Triangle};
use crate::patches::{PatchId, PatchMesh, Side};
use crate::progress::Stage;
use crate::sampling::{PointSet, Purpose, Stream};
use rayon::prelude::*;

/// The sides that emit, each chosen with a probability in proportion to its power.
pub struct Emitters<'m> {
    emitters: Vec<Emitter<'m>>,
    /// Sum of the probabilities up to and including each emitter; the last is 1.
    cumulative: Vec<f64>,
}

struct Emitter<'m> {
    facet: Facet<'m>,
    exitance: Rgb64,
    probability: f64,
}

impl<'m> Emitters<'m> {
    pub fn of(mesh: &'m PatchMesh) -> Self {
        let mut emitters: Vec<Emitter> = mesh
            .sides()
            .iter()
            .filter(|side| mesh.exitance(side.first) != glam::Vec3::ZERO)
            .map(|side| Emitter {
                facet: Facet::new(whole(mesh, side), side),
                exitance: mesh.exitance(side.first).as_dvec3(),
                probability: 0.0,
            })
            .collect();
        let power = |e: &Emitter| luminance(e.exitance.as_vec3()) as f64 * e.facet.area();
        let total: f64 = emitters.iter().map(power).sum();
        let mut sum = 0.0;
        let mut cumulative = Vec::with_capacity(emitters.len());
        for emitter in &mut emitters {
            let probability = power(emitter) / total;
            emitter.probability = probability;
            sum += probability;
            cumulative.push(sum);
        }
        if let Some(last) = cumulative.last_mut() {
            *last = 1.0;
        }
        Emitters { emitters, cumulative }
    }

    /// In square units.
    pub fn area(&self) -> f64 {
        self.emitters.iter().map(|e| e.facet.area()).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// The emitter for ξ, and ξ stretched over its share so that it can be used again.
    fn choose(&self, xi: f32) -> (&Emitter<'m>, f32) {
        let last = self.emitters.len() - 1;
        let xi = xi as f64;
        let index = self.cumulative.partition_point(|&sum| sum <= xi).min(last);
        let below = if index == 0 { 0.0 } else { self.cumulative[index - 1] };
        let share = self.cumulative[index] - below;
        let stretched = ((xi - below) / share) as f32;
        (&self.emitters[index], stretched.clamp(0.0, 1f32.next_down()))
    }
}

fn whole(mesh: &PatchMesh, side: &Side) -> Triangle {
    let mut shape = mesh.scene.triangles[side.triangle.index()];
    if side.is_back {
        shape.p.swap(1, 2);
    }
    shape
}

impl Estimator<'_> {
    /// D_i = Σ_j F_ij E_j in W·m⁻² for every patch, from `samples` points each.
    pub fn direct_light(&self, emitters: &Emitters) -> Vec<Rgb64> {
        self.progress.begin(Stage::DirectLight, Some(self.mesh.len() as u64));
        let light = (0..self.mesh.len())
            .into_par_iter()
            .map_init(DirectWork::default, |work, i| {
                if i % 64 == 0 {
                    self.progress.advance(64);
                }
                // What is left undone is never read: the solution ends with an error.
                let stopped = self.progress.is_stopped();
                if stopped { Rgb64::ZERO } else { work.direct(self, emitters, PatchId(i as u32)) }
            })
            .collect();
        self.progress.end();
        light
    }

    /// D_i of one patch, as [`direct_light`](Self::direct_light) would give it.
    pub fn direct_light_of(&self, emitters: &Emitters, i: PatchId) -> Rgb64 {
        DirectWork::default().direct(self, emitters, i)
    }
}

/// One thread's buffers.
#[derive(Default)]
struct DirectWork {
    segments: Vec<Ray>,
    /// The light that each segment brings if clear.
    light: Vec<Rgb64>,
    blocked: Vec<bool>,
}

impl DirectWork {
    fn direct(&mut self, of: &Estimator, emitters: &Emitters, i: PatchId) -> Rgb64 {
        let patch = Facet::patch(of.mesh, i);
        let stream = Stream::new(of.seed, Purpose::DirectLight, i.0 as u64, PointSet::Sobol);
        self.segments.clear();
        self.light.clear();
        for k in 0..of.samples {
            let [x0, x1, y0, y1] = stream.point(k);
            let (emitter, y0) = emitters.choose(y0);
            let point = PairPoint::uniform([x0, x1, y0, y1]);
            if let Some(sample) = sample(&patch, &emitter.facet, &point) {
                let factor = sample.exchange as f64 / patch.area();
                self.segments.push(sample.segment);
                self.light.push(emitter.exitance * (factor / emitter.probability));
            }
        }
        of.caster.occluded_batch(&self.segments, &mut self.blocked);
        of.count_rays(self.segments.len());
        let clear = self.light.iter().zip(&self.blocked).filter(|(_, blocked)| !**blocked);
        clear.map(|(light, _)| *light).sum::<Rgb64>() / of.samples as f64
    }
}
