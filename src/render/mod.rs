//! Pictures: rays through the pixels, and the radiance of what they meet.

pub(crate) mod tone;

use crate::color::{Rgb, luminance};
use crate::field::IrradianceField;
use crate::geometry::{Hit, Ray, RayCaster};
use crate::patches::{Look, PatchMesh, SurfacePoint};
use crate::progress::{Progress, Stage};
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::Camera;
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
}

/// Size and sampling of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    pub width: u32,
    pub height: u32,
    /// Samples per pixel.
    pub samples: u32,
    pub seed: u64,
    /// Radiance where a ray leaves the scene. `None`: the scene's.
    pub background: Option<Rgb>,
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

    pub fn rays(&self) -> u64 {
        self.width as u64 * self.height as u64 * self.samples as u64
    }
}

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
    let row_length = frame.width as usize * fields.len();
    progress.begin(Stage::Render, Some(frame.height as u64));
    let mut rows = vec![Pixel::default(); row_length * frame.height as usize];
    rows.par_chunks_mut(row_length.max(1)).enumerate().for_each_init(
        Work::default,
        |work, (y, row)| {
            // The caller throws away what is left undone.
            if progress.is_stopped() {
                return;
            }
            for (x, pixel) in row.chunks_mut(fields.len()).enumerate() {
                work.draw(caster, mesh, camera, frame, (x, y), fields, pixel);
            }
            progress.advance(1);
        },
    );
    progress.end();
    (0..fields.len())
        .map(|s| Image {
            width: frame.width,
            height: frame.height,
            pixels: rows.iter().skip(s).step_by(fields.len()).map(|p| p.radiance).collect(),
            reflecting: rows.iter().skip(s).step_by(fields.len()).map(|p| p.reflecting).collect(),
        })
        .collect()
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
    let mut pixel = [Pixel::default()];
    Work::default().draw(caster, mesh, camera, frame, at, &[field], &mut pixel);
    pixel[0].radiance
}

/// What one field makes of a pixel; see [`Image`].
#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Rgb,
    reflecting: f32,
}

/// One thread's buffers.
#[derive(Default)]
struct Work<'m> {
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    points: Vec<SurfacePoint<'m>>,
    /// One per point where the scene has textures or vertex colours; else empty.
    looks: Vec<Look>,
    irradiance: Vec<Rgb>,
}

impl<'m> Work<'m> {
    /// Sets `pixel` to the mean radiance of its samples, one entry per field.
    #[allow(clippy::too_many_arguments, reason = "the loop's whole context, passed once per pixel")]
    fn draw(
        &mut self,
        caster: &dyn RayCaster,
        mesh: &'m PatchMesh,
        camera: &Camera,
        frame: &Frame,
        (x, y): (usize, usize),
        fields: &[&dyn IrradianceField],
        pixel: &mut [Pixel],
    ) {
        let (width, height) = (frame.width as f32, frame.height as f32);
        let number = y as u64 * frame.width as u64 + x as u64;
        let stream = Stream::new(frame.seed, Purpose::Pixel, number, PointSet::Sobol);
        self.rays.clear();
        self.rays.extend((0..frame.samples).map(|k| {
            let [dx, dy, ..] = stream.point(k);
            camera.ray((x as f32 + dx) / width, (y as f32 + dy) / height, width / height)
        }));
        caster.nearest_batch(&self.rays, &mut self.hits);
        let samples = self.rays.iter().zip(&self.hits);
        let met = samples.filter_map(|(ray, hit)| SurfacePoint::hit(mesh, ray, &(*hit)?));
        self.points.clear();
        self.points.extend(met);
        self.looks.clear();
        if mesh.varies() {
            self.look(mesh, sample_width(camera, frame));
        }
        self.irradiance.resize(self.points.len(), Rgb::ZERO);
        let misses = self.hits.iter().filter(|hit| hit.is_none()).count();
        let background = frame.background.unwrap_or(mesh.scene.background) * misses as f32;
        for (pixel, field) in pixel.iter_mut().zip(fields) {
            field.irradiance(&self.points, &mut self.irradiance);
            let (mut sum, mut reflecting, mut count) = (background, Rgb::ZERO, 0);
            for (k, (point, &irradiance)) in self.points.iter().zip(&self.irradiance).enumerate() {
                let material = &mesh.scene.materials[point.side.material.0 as usize];
                let look = self.looks.get(k).copied();
                let Look { radiance, reflectance } = look.unwrap_or(Look {
                    radiance: material.radiance,
                    reflectance: material.reflectance,
                });
                let emitted = if point.side.radiates { radiance } else { Rgb::ZERO };
                let reflected = reflectance * irradiance / PI;
                sum += emitted + reflected;
                if emitted == Rgb::ZERO || luminance(emitted) <= luminance(reflected) {
                    reflecting += emitted + reflected;
                    count += 1;
                }
            }
            pixel.radiance = sum / frame.samples as f32;
            pixel.reflecting = luminance(reflecting) / count.max(1) as f32;
        }
    }

    /// Looks at the textures where the rays met sides; `width` is the footprint of a sample at depth 1.
    fn look(&mut self, mesh: &PatchMesh, width: f32) {
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
