//! The samples of a picture's pixels: rays, and what they meet.

use super::frame::{Background, Frame};
use crate::color::Rgb;
use crate::geometry::{Hit, Ray, RayCaster};
use crate::layers::Layers;
use crate::patches::{Look, PatchMesh, SampleId, SurfacePoint};
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::Camera;

/// What is looked at, from where, and how.
#[derive(Clone, Copy)]
pub(super) struct Eye<'a> {
    pub caster: &'a dyn RayCaster,
    pub mesh: &'a PatchMesh,
    pub camera: &'a Camera,
    pub frame: &'a Frame,
}

impl Eye<'_> {
    /// The radiance behind the scene.
    pub(super) fn background(&self) -> Rgb {
        match self.frame.background {
            None => self.mesh.scene.background,
            Some(Background::Radiance(radiance)) => radiance,
            Some(Background::Transparent) => Rgb::ZERO,
        }
    }
}

/// Samples that are drawn together, if not more belong to one pixel. Each step of drawing is a loop over them,
/// and their rays, hits and points stay in the processor's nearest cache.
pub(super) const TILE: usize = 128;

/// How many pixels are drawn together.
pub(super) fn pixels_per_tile(frame: &Frame) -> usize {
    (TILE / frame.samples.max(1) as usize).max(1)
}

/// Some samples of a pixel: the numbers from `from` to before `to`.
#[derive(Clone, Copy)]
pub(super) struct Wanted {
    pub x: usize,
    pub y: usize,
    pub from: u32,
    pub to: u32,
}

/// How many samples of a pixel met a side with patches, and how many nothing.
pub(super) struct Tally {
    pub points: usize,
    pub misses: usize,
}

/// The samples of a tile, and one thread's buffers for them.
#[derive(Default)]
pub(super) struct Samples<'m> {
    rays: Vec<Ray>,
    /// One per ray: what decides behind what it ends. Uniform in [0, 1).
    numbers: Vec<f32>,
    layers: Layers,
    traced: usize,
    /// One per sample.
    pub hits: Vec<Option<Hit>>,
    pub points: Vec<SurfacePoint<'m>>,
    /// One per point where the scene has textures or vertex colours; else empty.
    pub looks: Vec<Look>,
    /// One per pixel.
    pub tallies: Vec<Tally>,
}

impl<'m> Samples<'m> {
    /// Takes samples of some pixels.
    pub(super) fn take(&mut self, eye: &Eye<'m>, wanted: &[Wanted]) {
        self.aim(eye, wanted);
        let through = (eye.caster, eye.mesh);
        self.traced = self.layers.ends(through, &self.rays, &self.numbers, &mut self.hits);
        self.meet(eye, wanted);
        if eye.mesh.varies() {
            self.look(eye.mesh, sample_width(eye.camera, eye.frame));
        }
    }

    /// Rays that were traced for the samples.
    pub(super) fn traced(&self) -> usize {
        self.traced
    }

    /// The look of a point in a scene without textures.
    #[inline(always)]
    pub(super) fn plain_look(&self, eye: &Eye, k: usize) -> Look {
        let material = &eye.mesh.scene.materials[self.points[k].side.material.0 as usize];
        Look { radiance: material.radiance, reflectance: material.reflectance }
    }

    fn aim(&mut self, eye: &Eye, wanted: &[Wanted]) {
        let (camera, frame) = (eye.camera, eye.frame);
        let (width, height) = (frame.width as f32, frame.height as f32);
        let aspect = width / height;
        self.rays.clear();
        self.numbers.clear();
        for Wanted { x, y, from, to } in wanted {
            let number = frame.pixel_number((*x, *y));
            let stream = Stream::new(frame.seed, Purpose::Pixel, number, PointSet::Sobol);
            for k in *from..*to {
                let [dx, dy, number, _] = stream.point(k);
                let (x, y) = ((*x as f32 + dx) / width, (*y as f32 + dy) / height);
                self.rays.push(camera.ray(x, y, aspect));
                self.numbers.push(number);
            }
        }
    }

    /// Finds the points that were hit, and counts them per pixel.
    fn meet(&mut self, eye: &Eye<'m>, wanted: &[Wanted]) {
        self.points.clear();
        self.tallies.clear();
        self.points.reserve(self.rays.len());
        let mut first = 0;
        for Wanted { x, y, from, to } in wanted {
            let pixel = [*x as u32, *y as u32];
            let of_pixel = first..first + (to - from) as usize;
            first = of_pixel.end;
            let (before, mut misses) = (self.points.len(), 0);
            let met = self.rays[of_pixel.clone()].iter().zip(&self.hits[of_pixel]);
            for (number, (ray, hit)) in (*from..).zip(met) {
                let Some(hit) = hit else {
                    misses += 1;
                    continue;
                };
                let sample = SampleId { pixel, number };
                if let Some(point) = SurfacePoint::hit(eye.mesh, ray, hit, sample) {
                    self.points.push(point);
                }
            }
            self.tallies.push(Tally { points: self.points.len() - before, misses });
        }
    }

    /// Looks at the textures where the rays met sides; `width` is the footprint of a sample at depth 1.
    fn look(&mut self, mesh: &PatchMesh, width: f32) {
        self.looks.clear();
        let samples = self.rays.iter().zip(&self.hits);
        let met = samples.filter_map(|(ray, hit)| {
            let hit = (*hit)?;
            let side = mesh.side_hit(ray, &hit)?;
            // The projection of a disc on the surface is longer by 1 / cosθ.
            let cos = side.normal.dot(ray.direction).abs() / ray.direction.length();
            Some(mesh.look(side, &hit, width * hit.t / cos))
        });
        self.looks.extend(met);
    }
}

/// How wide the part of a pixel is that a sample stands for, at depth 1. The samples share the pixel's area.
fn sample_width(camera: &Camera, frame: &Frame) -> f32 {
    let aspect = frame.width as f32 / frame.height as f32;
    let at = |y: f32| camera.ray(0.5, y, aspect).direction;
    at(0.5).distance(at(0.5 + 1.0 / frame.height as f32)) / (frame.samples as f32).sqrt()
}
