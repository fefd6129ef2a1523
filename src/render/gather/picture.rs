//! A picture on its way: the sums of the samples of each pixel.

use super::errors::{Errors, Pixel};
use super::filter::{Filter, Light};
use super::row::{Row, Sharp};
use super::spot::Spot;
use super::work::Work;
use crate::paths::Paths;
use crate::progress::Progress;
use crate::render::samples::Eye;
use crate::render::{Background, Frame, Image};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// The rows of a picture.
#[derive(Serialize, Deserialize)]
pub(super) struct Picture {
    width: usize,
    rows: Vec<Row>,
}

impl Picture {
    pub(super) fn new(frame: &Frame) -> Self {
        Picture { width: frame.width as usize, rows: vec![Row::default(); frame.height as usize] }
    }

    /// Whether this can be a picture of a frame on its way to what is wanted.
    pub(super) fn is_of(&self, frame: &Frame, wanted: &[u32]) -> bool {
        let (width, height) = (frame.width as usize, frame.height as usize);
        let is_possible = |(row, wanted): (&Row, &[u32])| {
            row.is_possible(width) && row.counts(width).zip(wanted).all(|(n, wanted)| n <= *wanted)
        };
        (self.width, self.rows.len(), wanted.len()) == (width, height, width * height)
            && self.rows.iter().zip(wanted.chunks(width.max(1))).all(is_possible)
    }

    /// Adds samples to the pixels of the rows that have not as many as are wanted, and returns how many. Rows are
    /// left as they are once there is enough.
    pub(super) fn sample(
        &mut self,
        eye: &Eye,
        paths: &Paths,
        wanted: &[u32],
        progress: &dyn Progress,
        is_enough: &(dyn Fn() -> bool + Sync),
    ) -> f64 {
        let width = self.width;
        let rows = self.rows.par_iter_mut().zip(wanted.par_chunks(width.max(1))).enumerate();
        let taken = rows.map_init(Work::default, |work, (y, (row, wanted))| {
            let counts: Vec<u32> = row.counts(width).collect();
            // The caller throws away what is left undone.
            if counts == wanted || progress.is_stopped() || is_enough() {
                return 0;
            }
            work.add(eye, paths, (y, row), |x| counts[x]..wanted[x]);
            progress.advance(1);
            wanted.iter().zip(counts).map(|(wanted, n)| u64::from(wanted - n)).sum()
        });
        taken.sum::<u64>() as f64
    }

    /// How many rows have as many samples as are wanted.
    pub(super) fn rows_with(&self, wanted: &[u32]) -> u64 {
        let has =
            |(row, wanted): &(&Row, &[u32])| row.counts(self.width).eq(wanted.iter().copied());
        self.rows.iter().zip(wanted.chunks(self.width.max(1))).filter(has).count() as u64
    }

    /// The samples of each pixel.
    pub(super) fn counts(&self) -> Vec<u32> {
        self.rows.iter().flat_map(|row| row.counts(self.width)).collect()
    }

    /// Whether each pixel has samples.
    pub(super) fn is_whole(&self) -> bool {
        self.rows.iter().all(|row| row.sharp.len() == self.width)
    }

    fn pixels(&self) -> impl Iterator<Item = (Sharp, &[Spot])> {
        self.rows.iter().flat_map(|row| (0..row.sharp.len()).map(|x| row.pixel(x)))
    }

    /// The soft light of all spots, in their order.
    pub(super) fn soft(&self) -> Vec<Light> {
        Filter::new(self.width, self.pixels().map(|(_, spots)| spots)).filtered()
    }

    /// How many samples each pixel should have, at least `least`, for a relative error of `goal`. The neighbours
    /// decide, so that no pixel's own samples say how many there are, which would bias their mean. Without `soft`
    /// light, that counts as known.
    pub(super) fn wanted(&self, goal: f32, least: u32, soft: Option<&[Light]>) -> Vec<u32> {
        let errors = self.errors(soft).forecast(soft.is_some());
        let wanted = |((sharp, _), error): ((Sharp, &[Spot]), f32)| {
            // The error of low-discrepancy points falls about as N^(−3/4).
            let more = (error / goal).powf(4.0 / 3.0).clamp(1.0, MOST_MORE);
            let wanted = ((sharp.samples * more) as u32).min(MOST_SAMPLES);
            // No fewer than there are, even if the light is so bright that its error is no number.
            wanted.max(least).max(sharp.samples as u32)
        };
        self.pixels().zip(errors).map(wanted).collect()
    }

    fn errors(&self, soft: Option<&[Light]>) -> Errors {
        let mut left = soft;
        let of_pixel = |(sharp, spots): (Sharp, &'_ [Spot])| {
            let own = left.map(|soft| soft.split_at(spots.len()));
            left = own.map(|(_, rest)| rest);
            Pixel::new(&sharp, spots, own.map(|(own, _)| own))
        };
        Errors::new(self.width, self.pixels().map(of_pixel).collect())
    }

    /// Adds the soft light to the sharp.
    pub(super) fn compose(&self, frame: &Frame, soft: &[Light]) -> Image {
        let (width, height) = (frame.width, frame.height);
        let error = self.errors(Some(soft)).absolute();
        let mut soft = soft.iter();
        let mut image = Image { width, height, error, ..Image::default() };
        for (sharp, spots) in self.pixels() {
            let (mut sum, mut reflecting) = (sharp.radiance, sharp.reflecting);
            for (spot, soft) in spots.iter().zip(&mut soft) {
                let reflected = spot.reflectance() * soft.irradiance() / PI;
                sum += reflected;
                reflecting += spot.exposed(soft.irradiance());
            }
            image.pixels.push(sum / sharp.samples);
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
