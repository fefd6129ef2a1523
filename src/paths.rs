//! Paths of light, from points of surfaces to the lights.
//!
//! A path starts with the irradiance that is asked for, and carries a weight: what a unit of irradiance at its end
//! brings to its start. Where it ends, light straight from small emitters is sampled (next-event estimation);
//! then it goes on in a cosine-distributed direction, meets a surface and loses what that absorbs, or leaves the
//! scene and brings the sky's light. Emitters that are not small are found by the paths themselves.

use crate::color::{Rgb, luminance};
use crate::geometry::{Hit, Ray, RayCaster};
use crate::light::{EmittingTriangles, Light, LightSample};
use crate::patches::{Members, PatchId, PatchMesh, Side, SurfacePoint};
use crate::sampling::{Purpose, Shuffled, cosine_hemisphere, uniform_triangle};
use glam::Vec3;
use std::f32::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};

/// How the scene's light is found.
pub(crate) struct Lights {
    /// Sampled at every point. `None` if there are none, or these are large.
    sampled: Option<EmittingTriangles>,
    /// Per side, whether it is among these. Paths find the others: what is seen of them varies over their area in a
    /// way that samples of their area do not know.
    is_sampled: Vec<bool>,
}

/// Up to this share of the scene's area emitters are sampled. Rays find more of them as well, and know which is near.
const SAMPLED: f64 = 0.5;

impl Lights {
    pub(crate) fn of(mesh: &PatchMesh) -> Lights {
        let is_plain = |side: &Side| side.radiates && !mesh.is_patterned_light(side);
        let emitters = EmittingTriangles::of_sides(mesh, is_plain);
        let samples = !emitters.is_empty() && emitters.area() <= SAMPLED * mesh.scene.area();
        let is_sampled = mesh.sides().iter().map(|side| samples && is_plain(side)).collect();
        Lights { sampled: samples.then_some(emitters), is_sampled }
    }

    /// M in W·m⁻² of a patch, without what is sampled.
    pub(crate) fn unsampled(&self, mesh: &PatchMesh, patch: PatchId) -> Rgb {
        let members = mesh.members(patch);
        let first = mesh.side_number(patch);
        let is_sampled = |k: usize| self.is_sampled[first + k];
        let left = (0..members.len()).filter(|&k| !is_sampled(k)).map(|k| members[k].patch_area);
        let whole: f64 = members.iter().map(|side| side.patch_area).sum();
        mesh.exitance(patch) * (left.sum::<f64>() / whole) as f32
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
    /// One path from a point that is lifted off its surface.
    pub(crate) fn new(point: Vec3, normal: Vec3, stream: u64, number: u32) -> Start {
        Start { point, normal, stream, number }
    }

    /// One path for a sample of a picture, with numbers of its pixel's own.
    pub(crate) fn at(point: &SurfacePoint) -> Start {
        let [x, y] = point.sample.pixel;
        Start {
            point: point.side.lifted(point.position),
            normal: point.side.normal,
            stream: (y as u64) << 20 | x as u64,
            number: point.sample.number,
        }
    }

    /// One of `paths` paths for a sample, with numbers that go well with those of the pixels around: in the square
    /// of pixels that contains it, along a curve that stays near (Ahmed & Wonka, *Screen-Space Blue-Noise
    /// Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels*, ACM TOG 39(6), 2020). A power
    /// of two of paths, `first`, is what a pixel has in general; more follow.
    pub(crate) fn of_square(point: &SurfacePoint, path: u32, paths: u32, first: u32) -> Start {
        let [x, y] = point.sample.pixel;
        let number = point.sample.number * paths + path;
        let [more, number] = [number / first, number % first];
        let place = z_order(x % SQUARE, y % SQUARE);
        Start {
            stream: SQUARES | ((y / SQUARE) as u64) << 20 | (x / SQUARE) as u64,
            number: (more * SQUARE * SQUARE + place) * first + number,
            ..Start::at(point)
        }
    }
}

/// The paths of one patch, from points all over it.
pub(crate) struct PatchPaths {
    pub seed: u64,
    /// Sets of paths that are independent of each other.
    pub sets: u32,
    /// Paths of each set, which share a low-discrepancy sequence.
    pub paths: u32,
}

impl PatchPaths {
    /// Adds the starts of a patch's paths, set by set.
    pub(crate) fn add_starts(&self, mesh: &PatchMesh, patch: PatchId, starts: &mut Vec<Start>) {
        let members = Members::of(mesh, patch);
        let only = (!mesh.is_cluster(patch))
            .then(|| mesh.side(patch).sampling_area(&mesh.triangle(patch)));
        for set in 0..self.sets {
            let stream = OF_PATCHES | (patch.0 as u64 * self.sets as u64 + set as u64);
            let places = Shuffled::new(self.seed, Purpose::PatchPoint, stream);
            starts.extend((0..self.paths).map(|number| {
                let [x0, x1, ..] = places.point(number);
                let (side, x0) = members.choose(x0);
                let [p0, p1, p2] =
                    only.unwrap_or_else(|| side.sampling_area(&members.part(side))).p;
                let [l0, l1, l2] = uniform_triangle(x0, x1);
                let point = side.lifted(p0 * l0 + p1 * l1 + p2 * l2);
                Start { point, normal: side.normal, stream, number }
            }));
        }
    }
}

/// Tells the streams of patches from those of pixels.
const OF_PATCHES: u64 = 1 << 51;

/// Pixels along an edge of a square: a power of two.
const SQUARE: u32 = 32;

/// Tells the streams of squares from those of pixels.
const SQUARES: u64 = 1 << 40;

/// The place along a curve of Morton's: the binary digits of both numbers in turn.
fn z_order(x: u32, y: u32) -> u32 {
    let digits = |n: u32| (0..5).map(|k| (n >> k & 1) << (2 * k)).sum::<u32>();
    digits(x) | digits(y) << 1
}

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

/// What a solution knows, for paths that end there.
pub(crate) struct Solved {
    patches: Vec<Known>,
    /// Few and bright patches, such as a ceiling above an uplight: from afar they light like lamps, are found like
    /// lamps, and are black to paths that meet them.
    bright: EmittingTriangles,
    /// Whether these bring so much of the light that it is worth while to choose well among them.
    are_main_light: bool,
}

/// What a solution knows of a patch.
#[derive(Clone, Copy)]
struct Known {
    /// B in W·m⁻², without what the lights sample.
    radiosity: Rgb,
    /// The square of the distance from which B stands for every point of the patch.
    far: f32,
}

/// How many times as bright as the mean a patch must be to be sampled as a lamp is.
const BRIGHT: f64 = 5.0;
/// The share of all reflected light from which bright patches are the main light.
const MAIN_LIGHT: f64 = 0.1;

impl Solved {
    /// What is known from the irradiance in W·m⁻² and the uncovered share of its area, per patch.
    pub(crate) fn of(
        mesh: &PatchMesh,
        lights: &Lights,
        irradiance: &[Rgb],
        uncovered: &[f32],
    ) -> Solved {
        Solved::new(mesh, &radiosity(mesh, lights, irradiance, uncovered))
    }

    /// As [`of`](Self::of), to end every path at the first patch that it meets, from however near.
    pub(crate) fn everywhere(
        mesh: &PatchMesh,
        lights: &Lights,
        irradiance: &[Rgb],
        uncovered: &[f32],
    ) -> Solved {
        let radiosity = radiosity(mesh, lights, irradiance, uncovered);
        let known = |radiosity| Known { radiosity, far: 0.0 };
        let bright = EmittingTriangles::of_bright(mesh, &[]);
        let patches = radiosity.into_iter().map(known).collect();
        Solved { patches, bright, are_main_light: false }
    }

    /// `radiosity`: B in W·m⁻² without what the lights sample, per patch.
    pub(crate) fn new(mesh: &PatchMesh, radiosity: &[Rgb]) -> Solved {
        let patches = || (0..mesh.len() as u32).map(PatchId);
        let area: f64 = patches().map(|patch| mesh.area(patch)).sum();
        let power = |patch: PatchId| luminance(radiosity[patch.index()]) as f64 * mesh.area(patch);
        let mean = patches().map(power).sum::<f64>() / area;
        let is_bright =
            |patch: &PatchId| luminance(radiosity[patch.index()]) as f64 > BRIGHT * mean;
        let far = |patch: PatchId| NEAR * NEAR * mesh.extent_squared(patch);
        let as_lamp = |patch: PatchId| (patch, radiosity[patch.index()], far(patch));
        let bright: Vec<(PatchId, Rgb, f32)> = patches().filter(is_bright).map(as_lamp).collect();
        let of_bright: f64 = bright.iter().map(|(patch, ..)| power(*patch)).sum();
        let known = |patch: PatchId| {
            let is_lamp = is_bright(&patch);
            let radiosity = if is_lamp { Rgb::ZERO } else { radiosity[patch.index()] };
            Known { radiosity, far: far(patch) }
        };
        Solved {
            patches: patches().map(known).collect(),
            bright: EmittingTriangles::of_bright(mesh, &bright),
            are_main_light: of_bright > MAIN_LIGHT * mean * area,
        }
    }
}

/// B in W·m⁻² without what the lights sample, per patch.
fn radiosity(mesh: &PatchMesh, lights: &Lights, irradiance: &[Rgb], uncovered: &[f32]) -> Vec<Rgb> {
    let of_patch = |(i, (irradiance, &share)): (usize, (&Rgb, &f32))| {
        let patch = PatchId(i as u32);
        // What arrives on a patch arrives on its uncovered part, and no ray meets the other.
        let share = if share > 0.0 { share } else { 1.0 };
        let reflected = mesh.reflectance(patch) * (*irradiance / share);
        reflected + lights.unsampled(mesh, patch)
    };
    irradiance.iter().zip(uncovered).enumerate().map(of_patch).collect()
}

/// From nearer than this many times the extent of a patch, its mean radiosity does not stand for the
/// point that was met, and the path goes on.
const NEAR: f32 = 2.0;

/// Bounces after which no path is ended by chance: most of the light comes over these.
const CERTAIN: u32 = 3;

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
            self.sample(&mut step, one, irradiance);
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
            self.sample(step, one, sum);
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
            self.sample(step, sample, sum);
        }
    }

    fn sample(
        &self,
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
        self.caster.occluded_batch(&step.rays, &mut step.blocked);
        self.count_rays(step.rays.len());
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

    /// Russian roulette: ends the path with the probability that keeps its weight near 1, by a number in [0, 1).
    fn survives(&mut self, number: f32) -> bool {
        let survival = self.weight.max_element().min(1.0);
        self.weight /= survival;
        number < survival
    }
}
