//! Paths of light, from points of surfaces to the lights.
//!
//! A path starts with the irradiance that is asked for, and carries a weight: what a unit of irradiance at its end
//! brings to its start. Where it ends, light straight from small emitters is sampled (next-event estimation);
//! then it goes on in a cosine-distributed direction, meets a surface and loses what that absorbs, or leaves the
//! scene and brings the sky's light. Emitters that are not small are found by the paths themselves.

use crate::color::Rgb;
use crate::geometry::{Hit, Ray, RayCaster};
use crate::light::{EmittingTriangles, Light};
use crate::patches::{PatchMesh, Side, SurfacePoint};
use crate::sampling::{PointSet, Purpose, Stream, cosine_hemisphere};
use glam::Vec3;
use std::f32::consts::PI;

/// How the scene's light is found.
pub(crate) struct Lights {
    /// Sampled at every point. `None` where paths find the emitters: these are large, there are none, or what
    /// is seen of them varies over their area in a way that samples of their area do not know.
    sampled: Option<EmittingTriangles>,
}

impl Lights {
    pub(crate) fn of(mesh: &PatchMesh) -> Lights {
        let mut emitting = mesh.sides().iter().filter(|side| side.radiates);
        let samples = EmittingTriangles::are_small(&mesh.scene)
            && !emitting.any(|side| mesh.is_patterned_light(side));
        Lights { sampled: samples.then(|| EmittingTriangles::of_patches(mesh)) }
    }
}

/// Where a path starts.
#[derive(Clone, Copy)]
pub(crate) struct Start {
    /// Lifted off its surface.
    point: Vec3,
    normal: Vec3,
    /// The path's random numbers.
    stream: u64,
    number: u32,
}

impl Start {
    pub(crate) fn at(point: &SurfacePoint) -> Start {
        Start {
            point: point.side.lifted(point.position),
            normal: point.side.normal,
            stream: point.sample.pixel,
            number: point.sample.number,
        }
    }
}

/// All that paths of one scene have in common.
pub(crate) struct Paths<'a> {
    pub caster: &'a dyn RayCaster,
    pub mesh: &'a PatchMesh,
    pub lights: &'a Lights,
    pub seed: u64,
}

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
    blocked: Vec<bool>,
}

impl Paths<'_> {
    /// Adds to each number the irradiance at its start, W·m⁻², by one path.
    pub(crate) fn add_irradiance(&self, starts: &[Start], irradiance: &mut [Rgb]) {
        let walk = |(start, at): (usize, &Start)| Walk {
            start,
            point: at.point,
            normal: at.normal,
            weight: Rgb::ONE,
        };
        let mut step = Step::default();
        step.walks = starts.iter().enumerate().map(walk).collect();
        for bounce in 0.. {
            if step.walks.is_empty() {
                break;
            }
            self.sample_lights(&mut step, starts, bounce, irradiance);
            self.go_on(&mut step, starts, bounce, irradiance);
        }
    }

    /// Adds what arrives straight from sampled emitters where the paths are.
    fn sample_lights(&self, step: &mut Step, starts: &[Start], bounce: u32, sum: &mut [Rgb]) {
        let Some(emitters) = &self.lights.sampled else { return };
        step.rays.clear();
        step.shadows.clear();
        for walk in &step.walks {
            let [_, _, y0, y1] = self.numbers(Purpose::Path, &starts[walk.start], bounce);
            if let Some(sample) = emitters.sample_at(walk.point, walk.normal, [y0, y1]) {
                step.rays.push(sample.segment);
                step.shadows.push((walk.start, walk.weight * sample.irradiance.as_vec3()));
            }
        }
        self.caster.occluded_batch(&step.rays, &mut step.blocked);
        for (&(start, light), blocked) in step.shadows.iter().zip(&step.blocked) {
            sum[start] += if *blocked { Rgb::ZERO } else { light };
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
        let mut met = step.rays.iter().zip(&step.hits);
        step.walks.retain_mut(|walk| {
            let (ray, hit) = met.next().expect("one ray per path");
            let Some(hit) = hit else {
                sum[walk.start] += walk.weight * self.mesh.scene.sky * PI;
                return false;
            };
            let Some(side) = self.mesh.side_hit(ray, hit) else { return false };
            let look = self.mesh.look(side, hit, 0.0);
            if side.radiates && self.lights.sampled.is_none() {
                sum[walk.start] += walk.weight * look.radiance * PI;
            }
            walk.meet(self.mesh, side, hit);
            walk.weight *= look.reflectance;
            let [survives, ..] = self.numbers(Purpose::Roulette, &starts[walk.start], bounce);
            walk.survives(survives)
        });
    }

    fn numbers(&self, purpose: Purpose, start: &Start, bounce: u32) -> [f32; 4] {
        // Bounces beyond share their numbers, and no path is that long.
        let index = start.stream << 12 | bounce.min(4095) as u64;
        Stream::new(self.seed, purpose, index, PointSet::Sobol).point(start.number)
    }
}

impl Walk {
    fn meet(&mut self, mesh: &PatchMesh, side: &Side, hit: &Hit) {
        self.point = side.lifted(mesh.scene.triangles[hit.triangle.index()].at(hit.u, hit.v));
        self.normal = side.normal;
    }

    /// Russian roulette: ends the path with the probability that keeps its weight near 1, by a number in [0, 1).
    fn survives(&mut self, number: f32) -> bool {
        let survival = self.weight.max_element().min(1.0);
        self.weight /= survival;
        number < survival
    }
}
