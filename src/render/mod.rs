//! Pictures: rays through the pixels, and the radiance of what they meet.

mod frame;
pub(crate) mod gather;
mod samples;
pub(crate) mod tone;

use crate::color::{Rgb, luminance};
use crate::field::IrradianceField;
use crate::geometry::RayCaster;
use crate::patches::{Look, PatchMesh};
use crate::progress::{Progress, Stage};
use crate::sampling::{QUARTERS, block};
use crate::scene::Camera;
pub use frame::{Background, Frame};
use rayon::prelude::*;
use samples::{Eye, Samples, Wanted};
use std::f32::consts::PI;
use std::ops::Range;

/// Linear radiance in W·sr⁻¹·m⁻², row by row from the top left.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Image {
    pub width: u32,
    pub height: u32,
    pub pixels: Vec<Rgb>,
    /// Per pixel, the mean luminance of its samples on surfaces that reflect more than they emit, as if none of them
    /// were darker than a fifth; 0 where there are none. An exposure is found from these.
    pub reflecting: Vec<f32>,
    /// Rays that were traced for it; 0 if they were counted with another picture.
    pub rays: u64,
    /// Per pixel, the standard error of its luminance; empty where it was not estimated.
    pub error: Vec<f32>,
    /// Per pixel, the share of its samples that met the scene, in [0, 1]; empty unless the background is
    /// transparent.
    pub coverage: Vec<f32>,
}

/// Of a picture's mean luminance: pixels that are darker than this need not be good relative to their own.
const DARK: f32 = 0.05;

impl Image {
    /// The root mean square over the pixels of the standard error, as a share of the pixel's luminance and 5 % of
    /// the picture's mean. `None` where no error was estimated.
    pub fn relative_error(&self) -> Option<f32> {
        if self.error.is_empty() {
            return None;
        }
        let mean =
            |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / self.error.len() as f64;
        let dark = DARK as f64 * mean(&mut self.pixels.iter().map(|p| luminance(*p) as f64));
        let share = |(error, pixel): (&f32, &Rgb)| {
            *error as f64 / (luminance(*pixel) as f64 + dark).max(f64::MIN_POSITIVE)
        };
        let squares =
            mean(&mut self.error.iter().zip(&self.pixels).map(|pair| share(pair).powi(2)));
        Some(squares.sqrt() as f32)
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
    let shot = Shot { eye: Eye { caster, mesh, camera, frame }, fields };
    let row_length = frame.width as usize * fields.len();
    let tile = samples::pixels_per_tile(frame);
    progress.begin(Stage::Render, Some(frame.height as u64));
    let before: Vec<u64> = fields.iter().map(|field| field.rays()).collect();
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
    let has_errors = |field: &dyn IrradianceField| tells_errors(field, frame) && !rows.is_empty();
    let image = |field: usize| {
        let pixels = || rows.iter().skip(field).step_by(fields.len());
        let coverage = || pixels().map(|p| p.coverage).collect();
        Image {
            width: frame.width,
            height: frame.height,
            pixels: pixels().map(|p| p.radiance).collect(),
            reflecting: pixels().map(|p| p.reflecting).collect(),
            error: if has_errors(fields[field]) {
                let quarters = pixels().map(|p| (luminance(p.radiance), p.quarters));
                gather::errors::of_quarters(frame.width as usize, quarters)
            } else {
                Vec::new()
            },
            rays: if field == 0 { frame.rays() } else { 0 } + fields[field].rays() - before[field],
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
    let shot = Shot { eye: Eye { caster, mesh, camera, frame }, fields: &[field] };
    let mut pixel = [Pixel::default()];
    Work::default().draw(&shot, at, &mut pixel);
    pixel[0].radiance
}

/// Whether the samples of a pixel tell how far off their mean is.
fn tells_errors(field: &dyn IrradianceField, frame: &Frame) -> bool {
    field.is_noisy() && frame.tells_errors()
}

/// Everything that the pixels of a picture have in common.
struct Shot<'a> {
    eye: Eye<'a>,
    fields: &'a [&'a dyn IrradianceField],
}

/// What one field makes of a pixel; see [`Image`].
#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Rgb,
    reflecting: f32,
    coverage: f32,
    /// The mean luminance of each quarter of the samples, where these tell an error.
    quarters: [f32; QUARTERS],
}

/// One thread's buffers, for the samples of a tile.
#[derive(Default)]
struct Work<'m> {
    wanted: Vec<Wanted>,
    samples: Samples<'m>,
    irradiance: Vec<Rgb>,
}

impl<'m> Work<'m> {
    /// Draws the pixels of a row from (x, y) on; `pixels` has one entry per pixel and field.
    fn draw(&mut self, shot: &Shot<'m>, from: (usize, usize), pixels: &mut [Pixel]) {
        let (eye, fields) = (&shot.eye, shot.fields);
        let (x, y, to) = (from.0, from.1, eye.frame.samples);
        let wanted = (x..x + pixels.len() / fields.len()).map(|x| Wanted { x, y, from: 0, to });
        self.wanted.clear();
        self.wanted.extend(wanted);
        self.samples.take(eye, &self.wanted);
        self.irradiance.resize(self.samples.points.len(), Rgb::ZERO);
        for (number, field) in fields.iter().enumerate() {
            field.irradiance(eye.caster, &self.samples.points, &mut self.irradiance);
            let of_field = pixels.iter_mut().skip(number).step_by(fields.len());
            let is_noisy = tells_errors(*field, eye.frame);
            if eye.mesh.varies() {
                self.shade(eye, of_field, is_noisy, |k| self.samples.looks[k]);
            } else {
                self.shade(eye, of_field, is_noisy, |k| self.samples.plain_look(eye, k));
            }
        }
    }

    /// Sets the pixels to the means of their samples in the field that gave the irradiance; `look` gives the look
    /// of each point.
    #[inline(always)]
    fn shade<'p>(
        &self,
        eye: &Eye,
        pixels: impl Iterator<Item = &'p mut Pixel>,
        is_noisy: bool,
        look: impl Fn(usize) -> Look,
    ) {
        let background = eye.background();
        let mut first = 0;
        for (number, (pixel, tally)) in pixels.zip(&self.samples.tallies).enumerate() {
            let mut sum = background * tally.misses as f32;
            let (mut reflecting, mut count) = (0.0, 0);
            let of_pixel = first..first + tally.points;
            for k in of_pixel.clone() {
                let look = look(k);
                let (emitted, reflected) = self.light_of(k, look);
                sum += emitted + reflected;
                if emitted == Rgb::ZERO || luminance(emitted) <= luminance(reflected) {
                    reflecting +=
                        luminance(emitted) + tone::exposed(self.irradiance[k], look.reflectance);
                    count += 1;
                }
            }
            first += tally.points;
            pixel.radiance = sum / eye.frame.samples as f32;
            pixel.reflecting = reflecting / count.max(1) as f32;
            pixel.coverage = 1.0 - tally.misses as f32 / eye.frame.samples as f32;
            if is_noisy {
                pixel.quarters = self.quarters(eye, number, of_pixel, &look);
            }
        }
    }

    /// The radiance that a point emits, and what it reflects.
    #[inline(always)]
    fn light_of(&self, k: usize, look: Look) -> (Rgb, Rgb) {
        let radiates = self.samples.points[k].side.radiates;
        let emitted = if radiates { look.radiance } else { Rgb::ZERO };
        (emitted, look.reflectance * self.irradiance[k] / PI)
    }

    /// The mean luminance of each quarter of a pixel's samples. `number` counts the pixels of the tile, `points` are
    /// those of the pixel.
    fn quarters(
        &self,
        eye: &Eye,
        number: usize,
        points: Range<usize>,
        look: impl Fn(usize) -> Look,
    ) -> [f32; QUARTERS] {
        let samples = eye.frame.samples;
        let (mut sums, mut counts) = ([0.0; QUARTERS], [0.0; QUARTERS]);
        let hits = &self.samples.hits[number * samples as usize..][..samples as usize];
        for (sample, hit) in (0..).zip(hits) {
            let quarter = block(sample, samples, QUARTERS);
            counts[quarter] += 1.0;
            if hit.is_none() {
                sums[quarter] += luminance(eye.background());
            }
        }
        for k in points {
            let (emitted, reflected) = self.light_of(k, look(k));
            let quarter = block(self.samples.points[k].sample.number, samples, QUARTERS);
            sums[quarter] += luminance(emitted + reflected);
        }
        std::array::from_fn(|quarter| sums[quarter] / counts[quarter])
    }
}
