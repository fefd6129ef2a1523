//! A picture on its way: the sums of the samples of each pixel.

use super::filter::{Filter, Soft};
use super::row::{Row, Sharp};
use super::spot::Spot;
use super::work::Work;
use crate::color::luminance;
use crate::paths::Paths;
use crate::progress::Progress;
use crate::render::samples::Eye;
use crate::render::{Background, DARK, Frame, Image};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::ops::Range;

/// The rows of a picture.
pub(super) struct Picture {
    width: usize,
    rows: Vec<Row>,
}

impl Picture {
    pub(super) fn new(frame: &Frame) -> Self {
        Picture { width: frame.width as usize, rows: vec![Row::default(); frame.height as usize] }
    }

    /// Adds samples to the pixels; `numbers` says which.
    pub(super) fn sample(
        &mut self,
        eye: &Eye,
        paths: &Paths,
        numbers: impl Fn(usize) -> Range<u32> + Sync,
        progress: &dyn Progress,
    ) {
        let width = self.width;
        let rows = self.rows.par_iter_mut().enumerate();
        rows.for_each_init(Work::default, |work, (y, row)| {
            // The caller throws away what is left undone.
            if !progress.is_stopped() {
                work.add(eye, paths, (y, row), |x| numbers(y * width + x));
                progress.advance(1);
            }
        });
    }

    fn pixels(&self) -> impl Iterator<Item = (Sharp, &[Spot])> {
        self.rows.iter().flat_map(|row| (0..row.sharp.len()).map(|x| row.pixel(x)))
    }

    /// The soft light of all spots, in their order.
    pub(super) fn soft(&self) -> Vec<Soft> {
        Filter::new(self.width, self.pixels().map(|(_, spots)| spots)).filtered()
    }

    /// How many samples each pixel should have, at least `least`, for a relative error of `goal`. The neighbours decide, so that no
    /// pixel's own samples say how many there are, which would bias their mean. Without `soft` light, that
    /// counts as known.
    pub(super) fn wanted(&self, goal: f32, least: u32, soft: Option<&[Soft]>) -> Vec<u32> {
        let mut soft = soft.into_iter().flatten();
        let spread: Vec<Spread> = self
            .pixels()
            .map(|(sharp, spots)| {
                let variances = spots.iter().map(|_| soft.next().map_or(0.0, |soft| soft.variance));
                Spread::new(&sharp, spots, variances)
            })
            .collect();
        let mean = spread.iter().map(|s| s.mean as f64).sum::<f64>() / spread.len() as f64;
        let dark = DARK * mean as f32;
        let wanted = |(pixel, own): (usize, &Spread)| {
            let around = self.mean_around(pixel, &spread);
            let error = around.error() / (around.mean + dark).max(f32::MIN_POSITIVE);
            // The error of low-discrepancy points falls about as N^(−3/4).
            let more = (error / goal).powf(4.0 / 3.0).clamp(1.0, MOST_MORE);
            ((own.samples * more) as u32).max(least).min(MOST_SAMPLES)
        };
        spread.par_iter().enumerate().map(wanted).collect()
    }

    /// The mean of the eight pixels around one, or of those that there are.
    fn mean_around(&self, pixel: usize, spread: &[Spread]) -> Spread {
        let (width, height) = (self.width as i32, self.rows.len() as i32);
        let (x, y) = (pixel as i32 % width, pixel as i32 / width);
        let (mut sum, mut count) = (Spread::default(), 0.0f32);
        for row in (y - 1).max(0)..(y + 2).min(height) {
            for column in (x - 1).max(0)..(x + 2).min(width) {
                if (row, column) != (y, x) {
                    sum.add(&spread[(row * width + column) as usize]);
                    count += 1.0;
                }
            }
        }
        sum.scaled(1.0 / count.max(1.0))
    }

    /// Adds the soft light to the sharp.
    pub(super) fn compose(&self, frame: &Frame, soft: &[Soft]) -> Image {
        let mut soft = soft.iter();
        let mut image = Image { width: frame.width, height: frame.height, ..Image::default() };
        for (sharp, spots) in self.pixels() {
            let own = &soft.as_slice()[..spots.len()];
            let spread = Spread::new(&sharp, spots, own.iter().map(|soft| soft.variance));
            let (mut sum, mut reflecting) = (sharp.radiance, sharp.reflecting);
            for (spot, soft) in spots.iter().zip(&mut soft) {
                let reflected = spot.reflectance() * soft.irradiance / PI;
                sum += reflected;
                reflecting += luminance(reflected);
            }
            image.pixels.push(sum / sharp.samples);
            image.error.push(spread.error());
            let is_lamp = sharp.reflecting_samples == 0.0;
            image.reflecting.push(if is_lamp {
                0.0
            } else {
                reflecting / sharp.reflecting_samples
            });
            if frame.background == Some(Background::Transparent) {
                image.coverage.push(1.0 - sharp.misses / sharp.samples);
            }
        }
        image
    }
}

/// A round of samples makes at most this many times as many.
const MOST_MORE: f32 = 4.0;
/// Per pixel.
pub(super) const MOST_SAMPLES: u32 = 1 << 14;

/// How far the samples of a pixel lie apart.
#[derive(Debug, Clone, Copy, Default)]
struct Spread {
    /// Of the luminance.
    mean: f32,
    /// Of the samples' sharp light, and of soft light between the spots.
    variance: f32,
    /// Of the mean soft light.
    soft_variance: f32,
    samples: f32,
}

impl Spread {
    /// `soft`: the variance of each spot's soft light.
    fn new(sharp: &Sharp, spots: &[Spot], soft: impl Iterator<Item = f32>) -> Spread {
        let n = sharp.samples;
        let sharp_mean = luminance(sharp.radiance) / n;
        let sharp_variance = (sharp.squares / n - sharp_mean * sharp_mean).max(0.0);
        let (mut mean, mut squares, mut soft_variance) = (0.0, 0.0, 0.0);
        for (spot, variance) in spots.iter().zip(soft) {
            let [a, b] = spot.halves();
            let (share, reflectance) = (spot.samples() / n, spot.reflectance() / spot.samples());
            let light = luminance(reflectance * (a + b) / (2.0 * PI));
            mean += share * light;
            squares += share * light * light;
            soft_variance += variance * (share * luminance(reflectance) / PI).powi(2);
        }
        Spread {
            mean: sharp_mean + mean,
            variance: sharp_variance + (squares - mean * mean).max(0.0),
            soft_variance,
            samples: n,
        }
    }

    fn add(&mut self, other: &Spread) {
        self.mean += other.mean;
        self.variance += other.variance;
        self.soft_variance += other.soft_variance;
        self.samples += other.samples;
    }

    fn scaled(self, factor: f32) -> Spread {
        Spread {
            mean: self.mean * factor,
            variance: self.variance * factor,
            soft_variance: self.soft_variance * factor,
            samples: self.samples * factor,
        }
    }

    /// Of the pixel's luminance, as low-discrepancy points make it.
    fn error(&self) -> f32 {
        (self.variance * self.samples.powf(-1.5) + self.soft_variance).sqrt()
    }
}
