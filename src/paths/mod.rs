//! Paths of light, from points of surfaces to the lights.
//!
//! A path starts with the irradiance that is asked for, and carries a weight: what a unit of irradiance at its end
//! brings to its start. Where it ends, light straight from small emitters is sampled (next-event estimation);
//! then it goes on in a cosine-distributed direction, meets a surface and loses what that absorbs, or leaves the
//! scene and brings the sky's light. Emitters that are not small are found by the paths themselves.

mod lights;
mod solved;
mod start;

use crate::color::Rgb;
use crate::geometry::{Hit, Ray, RayCaster};
use crate::layers::{Along, Layers};
use crate::light::{Light, LightSample};
use crate::patches::{PatchMesh, Side};
use crate::sampling::{Purpose, Shuffled, cosine_hemisphere};
use glam::Vec3;
pub(crate) use lights::Lights;
pub(crate) use solved::Solved;
pub(crate) use start::{PatchPaths, Start};
use std::f32::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};

/// All that paths of one scene have in common.
pub(crate) struct Paths<'a> {
    pub caster: &'a dyn RayCaster,
    pub mesh: &'a PatchMesh,
    pub lights: &'a Lights,
    /// Ends the paths that come from afar to what it knows. `None`: paths end by chance alone.
    pub known: Option<&'a Solved>,
    pub seed: u64,
    /// Rays traced so far.
    pub rays: AtomicU64,
}

/// Bounces after which no path is ended by chance: most of the light comes over these.
const CERTAIN: u32 = 3;

/// Where all light is reflected a path would go on for ever.
const MOST_SURVIVAL: f32 = 0.95;

/// A path on its way.
struct Walk {
    /// The number of its start.
    start: usize,
    point: Vec3,
    normal: Vec3,
    weight: Rgb,
}

/// One step's rays, their answers, and what each brings if clear.
#[derive(Default)]
struct Step {
    walks: Vec<Walk>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// The walk of each segment to a light, and what it brings.
    shadows: Vec<(usize, Rgb)>,
    /// Of which this share passes.
    shares: Vec<f32>,
    layers: Layers,
}

impl Paths<'_> {
    /// Adds to each number the irradiance at its start, W·m⁻², by one path.
    pub(crate) fn add_irradiance(&self, starts: &[Start], irradiance: &mut [Rgb]) {
        let mut step = Step::default();
        self.begin(&mut step, starts);
        self.sample_lights(&mut step, starts, 0, irradiance);
        self.sample_bright(&mut step, starts, 0, irradiance);
        self.add_rest(&mut step, starts, irradiance);
    }

    /// Adds to each number the part of the irradiance at its start that [`add_sampled`](Self::add_sampled) leaves.
    pub(crate) fn add_unsampled(&self, starts: &[Start], irradiance: &mut [Rgb]) {
        let mut step = Step::default();
        self.begin(&mut step, starts);
        self.sample_bright(&mut step, starts, 0, irradiance);
        self.add_rest(&mut step, starts, irradiance);
    }

    /// Adds to each number the irradiance straight from sampled lights at its start, by one point of them.
    pub(crate) fn add_sampled(&self, starts: &[Start], irradiance: &mut [Rgb]) {
        let mut step = Step::default();
        self.begin(&mut step, starts);
        if let Some(emitters) = &self.lights.sampled {
            // The first two of the four numbers fill the square best.
            let one = |walk: &Walk| {
                let [y0, y1, ..] = self.numbers(Purpose::Lamp, &starts[walk.start], 0);
                emitters.sample_at(walk.point, walk.normal, [y0, y1])
            };
            // What is straight is not filtered.
            self.sample(Along::Layers, &mut step, one, irradiance);
        }
    }

    fn begin(&self, step: &mut Step, starts: &[Start]) {
        let walk = |(start, at): (usize, &Start)| Walk {
            start,
            point: at.point,
            normal: at.normal,
            weight: Rgb::ONE,
        };
        step.walks.extend(starts.iter().enumerate().map(walk));
    }

    fn add_rest(&self, step: &mut Step, starts: &[Start], irradiance: &mut [Rgb]) {
        for bounce in 0.. {
            self.go_on(step, starts, bounce, irradiance);
            if step.walks.is_empty() {
                break;
            }
            self.sample_lights(step, starts, bounce + 1, irradiance);
            self.sample_bright(step, starts, bounce + 1, irradiance);
        }
    }

    /// Adds what arrives straight from sampled emitters where the paths are.
    fn sample_lights(&self, step: &mut Step, starts: &[Start], bounce: u32, sum: &mut [Rgb]) {
        if let Some(emitters) = &self.lights.sampled {
            let numbers = |start: &Start| {
                let [_, _, y0, y1] = self.numbers(Purpose::Path, start, bounce);
                [y0, y1]
            };
            let one = |walk: &Walk| {
                emitters.sample_at(walk.point, walk.normal, numbers(&starts[walk.start]))
            };
            self.sample(Along::Chance, step, one, sum);
        }
    }

    /// Adds what arrives straight from bright patches where the paths are.
    fn sample_bright(&self, step: &mut Step, starts: &[Start], bounce: u32, sum: &mut [Rgb]) {
        if let Some(solved) = self.known.filter(|solved| !solved.bright.is_empty()) {
            let numbers = |start: &Start| self.numbers(Purpose::Bright, start, bounce);
            let sample = |walk: &Walk| {
                let xi = numbers(&starts[walk.start]);
                if solved.are_main_light {
                    return solved.bright.resampled_at(walk.point, walk.normal, xi);
                }
                solved.bright.sample_at(walk.point, walk.normal, [xi[0], xi[1]])
            };
            self.sample(Along::Chance, step, sample, sum);
        }
    }

    fn sample(
        &self,
        along: Along,
        step: &mut Step,
        sample: impl Fn(&Walk) -> Option<LightSample>,
        sum: &mut [Rgb],
    ) {
        step.rays.clear();
        step.shadows.clear();
        for walk in &step.walks {
            if let Some(sample) = sample(walk) {
                step.rays.push(sample.segment);
                step.shadows.push((walk.start, walk.weight * sample.irradiance.as_vec3()));
            }
        }
        let through = (self.caster, self.mesh);
        self.count_rays(step.layers.passed(along, through, &step.rays, &mut step.shares));
        for (&(start, light), share) in step.shadows.iter().zip(&step.shares) {
            sum[start] += light * *share;
        }
    }

    /// Follows every path to the next surface; those that end are taken out.
    fn go_on(&self, step: &mut Step, starts: &[Start], bounce: u32, sum: &mut [Rgb]) {
        step.rays.clear();
        step.rays.extend(step.walks.iter().map(|walk| {
            let [d0, d1, ..] = self.numbers(Purpose::Path, &starts[walk.start], bounce);
            Ray::new(walk.point, cosine_hemisphere(walk.normal, d0, d1))
        }));
        self.caster.nearest_batch(&step.rays, &mut step.hits);
        self.count_rays(step.rays.len());
        let mut met = step.rays.iter().zip(&step.hits);
        step.walks.retain_mut(|walk| {
            let (ray, hit) = met.next().expect("one ray per path");
            let Some(hit) = hit else {
                sum[walk.start] += walk.weight * self.mesh.scene.sky * PI;
                return false;
            };
            let Some(number) = self.mesh.side_number_hit(ray, hit) else { return false };
            let side = &self.mesh.sides()[number];
            if let Some(known) = self.known_at(ray, side, hit) {
                sum[walk.start] += walk.weight * known;
                return false;
            }
            let look = self.mesh.look(side, hit, 0.0);
            if side.radiates && !self.lights.is_sampled[number] {
                sum[walk.start] += walk.weight * look.radiance * PI;
            }
            walk.meet(self.mesh, side, hit);
            walk.weight *= look.reflectance;
            if bounce < CERTAIN {
                return walk.weight != Rgb::ZERO;
            }
            let [survives, ..] = self.numbers(Purpose::Roulette, &starts[walk.start], bounce);
            walk.survives(survives)
        });
    }

    pub(crate) fn count_rays(&self, rays: usize) {
        self.rays.fetch_add(rays as u64, Ordering::Relaxed);
    }

    /// B of the patch that a ray meets from afar.
    fn known_at(&self, ray: &Ray, side: &Side, hit: &Hit) -> Option<Rgb> {
        let known = &self.known?.patches[self.mesh.patch_at(side, hit).index()];
        let distance = ray.direction * hit.t;
        (distance.length_squared() >= known.far).then_some(known.radiosity)
    }

    fn numbers(&self, purpose: Purpose, start: &Start, bounce: u32) -> [f32; 4] {
        // Bounces beyond share their numbers, and no path is that long.
        let index = start.stream << 12 | bounce.min(4095) as u64;
        Shuffled::new(self.seed, purpose, index).point(start.number)
    }
}

impl Walk {
    fn meet(&mut self, mesh: &PatchMesh, side: &Side, hit: &Hit) {
        self.point = side.lifted(mesh.scene.triangles[hit.triangle.index()].at(hit.u, hit.v));
        self.normal = side.normal;
    }

    /// Russian roulette: ends the path with the probability that keeps its weight near 1, but now and then whatever its
    /// weight is, by a number in [0, 1).
    fn survives(&mut self, number: f32) -> bool {
        let survival = self.weight.max_element().min(MOST_SURVIVAL);
        self.weight /= survival;
        number < survival
    }
}
