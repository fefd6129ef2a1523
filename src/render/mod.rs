//! Pictures: rays through the pixels, and the radiance of what they meet.

pub(crate) mod tone;

use crate::color::{Rgb, luminance};
use crate::field::IrradianceField;
use crate::geometry::{Hit, Ray, RayCaster};
use crate::patches::{Look, PatchMesh, SampleId, SurfacePoint};
use crate::progress::{Progress, Stage};
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::{Camera, Scene};
use crate::settings::Settings;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Linear radiance in W·sr⁻¹·m⁻², row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    pub width: u32,
    pub height: u32,
    pub pixels: Vec<Rgb>,
    /// Per pixel, the mean luminance of its samples on surfaces that reflect more than they emit; 0 where there
    /// are none. An exposure is found from these.
    pub reflecting: Vec<f32>,
    /// Per pixel, the share of its samples that met the scene, in [0, 1]; empty unless the background is
    /// transparent.
    pub coverage: Vec<f32>,
}

/// What is seen behind the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    Radiance(Rgb),
    /// Nothing: pictures have an alpha channel.
    Transparent,
}

/// Size and sampling of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    pub width: u32,
    pub height: u32,
    /// Samples per pixel.
    pub samples: u32,
    pub seed: u64,
    /// What a ray shows that leaves the scene. `None`: the scene's radiance.
    pub background: Option<Background>,
}

impl Frame {
    /// Samples per pixel unless another number is asked for.
    pub const SAMPLES: u32 = 16;

    /// Width and height in pixels unless others are asked for.
    pub const SIZE: [u32; 2] = [640, 480];

    /// A picture of this size in pixels.
    pub fn new(width: u32, height: u32) -> Frame {
        Frame { width, height, samples: Frame::SAMPLES, seed: Settings::SEED, background: None }
    }

    /// The number of the pixel at (x, y), row by row from the top left.
    fn pixel_number(&self, (x, y): (usize, usize)) -> u64 {
        y as u64 * self.width as u64 + x as u64
    }

    pub fn rays(&self) -> u64 {
        self.width as u64 * self.height as u64 * self.samples as u64
    }
}

/// Samples that are drawn together, if not more belong to one pixel. Each step of drawing is a loop over them,
/// and their rays, hits and points stay in the processor's nearest cache.
const TILE: usize = 128;

/// Draws one image per field, all from the same rays. What a ray meets shows L + ρH/π by its own material.
///
/// The samples of a pixel are stratified over its square and averaged: a box filter. Rays that
/// leave the scene show its background, and those that meet a side without patches are black.
pub fn render(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    camera: &Camera,
    frame: &Frame,
    fields: &[&dyn IrradianceField],
    progress: &dyn Progress,
) -> Vec<Image> {
    let shot = Shot { caster, mesh, camera, frame, fields };
    let row_length = frame.width as usize * fields.len();
    let tile = (TILE / frame.samples.max(1) as usize).max(1);
    progress.begin(Stage::Render, Some(frame.height as u64));
    let mut rows = vec![Pixel::default(); row_length * frame.height as usize];
    rows.par_chunks_mut(row_length.max(1)).enumerate().for_each_init(
        Work::default,
        |work, (y, row)| {
            // The caller throws away what is left undone.
            if progress.is_stopped() {
                return;
            }
            for (number, pixels) in row.chunks_mut(tile * fields.len()).enumerate() {
                work.draw(&shot, (number * tile, y), pixels);
            }
            progress.advance(1);
        },
    );
    progress.end();
    let is_transparent = frame.background == Some(Background::Transparent);
    let image = |field: usize| {
        let pixels = || rows.iter().skip(field).step_by(fields.len());
        let coverage = || pixels().map(|p| p.coverage).collect();
        Image {
            width: frame.width,
            height: frame.height,
            pixels: pixels().map(|p| p.radiance).collect(),
            reflecting: pixels().map(|p| p.reflecting).collect(),
            coverage: if is_transparent { coverage() } else { Vec::new() },
        }
    };
    (0..fields.len()).map(image).collect()
}

/// One pixel, (x, y) from the top left, as [`render`] would draw it.
pub fn pixel(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    camera: &Camera,
    frame: &Frame,
    at: (usize, usize),
    field: &dyn IrradianceField,
) -> Rgb {
    let shot = Shot { caster, mesh, camera, frame, fields: &[field] };
    let mut pixel = [Pixel::default()];
    Work::default().draw(&shot, at, &mut pixel);
    pixel[0].radiance
}

/// Everything that the pixels of a picture have in common.
struct Shot<'a> {
    caster: &'a dyn RayCaster,
    mesh: &'a PatchMesh,
    camera: &'a Camera,
    frame: &'a Frame,
    fields: &'a [&'a dyn IrradianceField],
}

/// What one field makes of a pixel; see [`Image`].
#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Rgb,
    reflecting: f32,
    coverage: f32,
}

/// How many samples of a pixel met a side with patches, and how many nothing.
struct Tally {
    points: usize,
    misses: usize,
}

/// One thread's buffers, for the samples of a tile.
#[derive(Default)]
struct Work<'m> {
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    points: Vec<SurfacePoint<'m>>,
    /// One per point where the scene has textures or vertex colours; else empty.
    looks: Vec<Look>,
    irradiance: Vec<Rgb>,
    /// One per pixel.
    tallies: Vec<Tally>,
}

impl<'m> Work<'m> {
    /// Draws the pixels of a row from (x, y) on; `pixels` has one entry per pixel and field.
    fn draw(&mut self, shot: &Shot<'m>, from: (usize, usize), pixels: &mut [Pixel]) {
        let (mesh, fields) = (shot.mesh, shot.fields);
        self.aim(shot, from, pixels.len() / fields.len());
        shot.caster.nearest_batch(&self.rays, &mut self.hits);
        self.meet(shot, from);
        if mesh.varies() {
            self.look(mesh, sample_width(shot.camera, shot.frame));
        }
        self.irradiance.resize(self.points.len(), Rgb::ZERO);
        for (number, field) in fields.iter().enumerate() {
            field.irradiance(shot.caster, &self.points, &mut self.irradiance);
            let of_field = pixels.iter_mut().skip(number).step_by(fields.len());
            if mesh.varies() {
                self.shade(shot, of_field, |k| self.looks[k]);
            } else {
                self.shade(shot, of_field, |k| plain_look(&mesh.scene, &self.points[k]));
            }
        }
    }

    /// Sets the rays through `count` pixels.
    fn aim(&mut self, shot: &Shot, (x, y): (usize, usize), count: usize) {
        let (camera, frame) = (shot.camera, shot.frame);
        let (width, height) = (frame.width as f32, frame.height as f32);
        let aspect = width / height;
        self.rays.clear();
        for x in x..x + count {
            let number = frame.pixel_number((x, y));
            let stream = Stream::new(frame.seed, Purpose::Pixel, number, PointSet::Sobol);
            self.rays.extend((0..frame.samples).map(|k| {
                let [dx, dy, ..] = stream.point(k);
                camera.ray((x as f32 + dx) / width, (y as f32 + dy) / height, aspect)
            }));
        }
    }

    /// Finds the points that were hit, and counts them per pixel.
    fn meet(&mut self, shot: &Shot<'m>, from: (usize, usize)) {
        self.points.clear();
        self.tallies.clear();
        let samples = shot.frame.samples.max(1) as usize;
        let pixels = shot.frame.pixel_number(from)..;
        let of_pixels = self.rays.chunks(samples).zip(self.hits.chunks(samples));
        for (pixel, (rays, hits)) in pixels.zip(of_pixels) {
            let before = self.points.len();
            let met = (0..).zip(rays.iter().zip(hits));
            self.points.extend(met.filter_map(|(number, (ray, hit))| {
                SurfacePoint::hit(shot.mesh, ray, &(*hit)?, SampleId { pixel, number })
            }));
            let misses = hits.iter().filter(|hit| hit.is_none()).count();
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

    /// Sets the pixels to the means of their samples in the field that gave the irradiance; `look` gives the look
    /// of each point.
    #[inline(always)]
    fn shade<'p>(
        &self,
        shot: &Shot,
        pixels: impl Iterator<Item = &'p mut Pixel>,
        look: impl Fn(usize) -> Look,
    ) {
        let background = match shot.frame.background {
            None => shot.mesh.scene.background,
            Some(Background::Radiance(radiance)) => radiance,
            Some(Background::Transparent) => Rgb::ZERO,
        };
        let mut first = 0;
        for (pixel, tally) in pixels.zip(&self.tallies) {
            let mut sum = background * tally.misses as f32;
            let (mut reflecting, mut count) = (Rgb::ZERO, 0);
            for k in first..first + tally.points {
                let Look { radiance, reflectance } = look(k);
                let emitted = if self.points[k].side.radiates { radiance } else { Rgb::ZERO };
                let reflected = reflectance * self.irradiance[k] / PI;
                sum += emitted + reflected;
                if emitted == Rgb::ZERO || luminance(emitted) <= luminance(reflected) {
                    reflecting += emitted + reflected;
                    count += 1;
                }
            }
            first += tally.points;
            pixel.radiance = sum / shot.frame.samples as f32;
            pixel.reflecting = luminance(reflecting) / count.max(1) as f32;
            pixel.coverage = 1.0 - tally.misses as f32 / shot.frame.samples as f32;
        }
    }
}

/// The look of a point without textures.
#[inline(always)]
fn plain_look(scene: &Scene, point: &SurfacePoint) -> Look {
    let material = &scene.materials[point.side.material.0 as usize];
    Look { radiance: material.radiance, reflectance: material.reflectance }
}

/// How wide the part of a pixel is that a sample stands for, at depth 1. The samples share the pixel's area.
fn sample_width(camera: &Camera, frame: &Frame) -> f32 {
    let aspect = frame.width as f32 / frame.height as f32;
    let at = |y: f32| camera.ray(0.5, y, aspect).direction;
    at(0.5).distance(at(0.5 + 1.0 / frame.height as f32)) / (frame.samples as f32).sqrt()
}
