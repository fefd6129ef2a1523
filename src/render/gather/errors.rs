//! Standard errors of a picture's pixels.

use super::filter::Light;
use super::row::Sharp;
use super::spot::Spot;
use crate::color::luminance;
use crate::render::DARK;
use crate::sampling::{LEVELS_OF_QUARTERS, MOST_GAIN, MOST_GAIN_OF_JUMPS, QUARTERS};
use rayon::prelude::*;
use std::f32::consts::PI;

type Spread = crate::sampling::Spread<LEVELS_OF_QUARTERS>;

/// The standard error of each pixel's luminance, from its mean and the means of each quarter of its samples, row by
/// row.
pub(in crate::render) fn of_quarters(
    width: usize,
    pixels: impl Iterator<Item = (f32, [f32; QUARTERS])> + Clone,
) -> Vec<f32> {
    let (mut sum, mut count) = (0.0, 0);
    pixels.clone().for_each(|(mean, _)| (sum, count) = (sum + mean as f64, count + 1));
    // Squares of very dim light would be 0.
    let unit = if sum > 0.0 { (sum / count as f64) as f32 } else { 1.0 };
    let pixel = |(mean, quarters): (f32, [f32; QUARTERS])| Pixel {
        mean: mean / unit,
        sharp: Spread::of(quarters.map(|quarter| quarter / unit)),
        ..Pixel::default()
    };
    let errors = Errors::new(width, pixels.map(pixel).collect());
    errors.absolute().into_iter().map(|error| error * unit).collect()
}

/// The errors of a picture's pixels. Where they are relative, it is to a pixel's luminance and [`DARK`] of the
/// picture's mean.
pub(super) struct Errors {
    width: usize,
    /// In units of the picture's mean luminance, so that dim pictures do not leave the range of f32.
    pixels: Vec<Pixel>,
    unit: f32,
    /// How fast the variance of soft light falls: averaging over neighbours makes that alike everywhere.
    soft_gain: f32,
}

/// How far the samples of a pixel lie apart, in luminance.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pixel {
    mean: f32,
    samples: f32,
    /// Of a sample: its sharp light, and the soft light of its spot.
    variance: f32,
    /// Of sharp light, and of what of the pixel each spot fills.
    sharp: Spread,
    /// Of the mean soft light.
    soft: Spread,
}

/// The radius in pixels over which spreads are averaged, as that of one pixel has few degrees of freedom; and the
/// radius over which is found how fast the variance of sharp light falls.
const AROUND: i32 = 2;
const FAR_AROUND: i32 = 4;

impl Errors {
    /// `pixels`: row by row.
    pub(super) fn new(width: usize, pixels: Vec<Pixel>) -> Errors {
        let sum: f64 = pixels.iter().map(|pixel| pixel.mean as f64).sum();
        let mean = (sum / pixels.len() as f64) as f32;
        // A black picture has no errors.
        let unit = if mean > 0.0 { mean } else { 1.0 };
        let pixels: Vec<Pixel> = pixels.into_iter().map(|pixel| pixel.in_units_of(unit)).collect();
        let mut soft = Spread::default();
        pixels.iter().for_each(|pixel| soft.add(&pixel.soft.scaled(pixel.relative())));
        Errors { width, pixels, unit, soft_gain: soft.gain(MOST_GAIN_OF_JUMPS) }
    }

    /// The standard error of each pixel's luminance.
    pub(super) fn absolute(&self) -> Vec<f32> {
        // Pixels differ less in their relative errors.
        let spread = |pixel: &Pixel| {
            let scale = pixel.relative();
            Spreads { sharp: pixel.sharp.scaled(scale), soft: pixel.soft.scaled(scale), count: 1.0 }
        };
        let near: Vec<Spreads> = self.around(AROUND, spread);
        let far: Vec<Spreads> = self.around(FAR_AROUND, spread);
        let error = |((near, far), pixel): ((Spreads, Spreads), &Pixel)| {
            let variance =
                near.sharp.variance(far.sharp.gain(MOST_GAIN)) + near.soft.variance(self.soft_gain);
            (variance / near.count / pixel.relative()).sqrt() * self.unit
        };
        near.into_iter().zip(far).zip(&self.pixels).map(error).collect()
    }

    /// A forecast of each pixel's relative error by the eight pixels around it alone: less true than the spreads of
    /// quarters, and less noisy. `is_calibrated`: as large as these in the mean.
    pub(super) fn forecast(&self, is_calibrated: bool) -> Vec<f32> {
        let factor = if is_calibrated { self.calibration() } else { 1.0 };
        let mean = |pixel: &Pixel| Mean::of(pixel, self.soft_gain);
        let with_own: Vec<Mean> = self.around(1, mean);
        let forecast = |(sum, pixel): (Mean, &Pixel)| {
            let around = if sum.count > 1.0 { sum.without(&mean(pixel)) } else { sum };
            around.error(factor) / (around.mean / around.count + DARK)
        };
        with_own.into_iter().zip(&self.pixels).map(forecast).collect()
    }

    /// How many times the variance by quarters is the forecast one.
    fn calibration(&self) -> f32 {
        let (mut total, mut forecast) = (Spread::default(), 0.0);
        for pixel in &self.pixels {
            let relative = pixel.relative();
            total.add(&pixel.sharp.scaled(relative));
            forecast += relative * pixel.variance * law(pixel.samples);
        }
        if forecast > 0.0 { total.variance(total.gain(MOST_GAIN)) / forecast } else { 1.0 }
    }

    /// The sums over the square around each pixel: along the rows, then along the columns.
    fn around<T: Add>(&self, radius: i32, of: impl Fn(&Pixel) -> T + Sync) -> Vec<T> {
        let (width, height) = (self.width as i32, (self.pixels.len() / self.width) as i32);
        let range = |x: i32, end: i32| (x - radius).max(0)..(x + radius + 1).min(end);
        let number = |x: i32, y: i32| (y * width + x) as usize;
        let place = |pixel: usize| (pixel as i32 % width, pixel as i32 / width);
        let along_row = |pixel: usize| {
            let (x, y) = place(pixel);
            let mut sum = T::default();
            range(x, width).for_each(|x| sum.add(&of(&self.pixels[number(x, y)])));
            sum
        };
        let rows: Vec<T> = (0..self.pixels.len()).into_par_iter().map(along_row).collect();
        let along_column = |pixel: usize| {
            let (x, y) = place(pixel);
            let mut sum = T::default();
            range(y, height).for_each(|y| sum.add(&rows[number(x, y)]));
            sum
        };
        (0..self.pixels.len()).into_par_iter().map(along_column).collect()
    }
}

/// The part of a sample's variance that the mean of low-discrepancy samples has, where shadows have edges.
fn law(samples: f32) -> f32 {
    samples.powf(-1.5)
}

/// What can be summed over pixels.
trait Add: Default + Send + Sync {
    fn add(&mut self, other: &Self);
}

#[derive(Default)]
struct Spreads {
    sharp: Spread,
    soft: Spread,
    count: f32,
}

impl Add for Spreads {
    fn add(&mut self, other: &Self) {
        self.sharp.add(&other.sharp);
        self.soft.add(&other.soft);
        self.count += other.count;
    }
}

/// What a forecast is made from.
#[derive(Default)]
struct Mean {
    mean: f32,
    samples: f32,
    variance: f32,
    soft: f32,
    count: f32,
}

impl Mean {
    fn of(pixel: &Pixel, soft_gain: f32) -> Mean {
        let Pixel { mean, samples, variance, .. } = *pixel;
        Mean { mean, samples, variance, soft: pixel.soft.variance(soft_gain), count: 1.0 }
    }

    fn without(&self, other: &Mean) -> Mean {
        let left = |sum: f32, part: f32| (sum - part).max(0.0);
        Mean {
            mean: left(self.mean, other.mean),
            samples: left(self.samples, other.samples),
            variance: left(self.variance, other.variance),
            soft: left(self.soft, other.soft),
            count: left(self.count, other.count),
        }
    }

    fn error(&self, factor: f32) -> f32 {
        let sharp = factor * self.variance * law(self.samples / self.count);
        ((sharp + self.soft) / self.count).sqrt()
    }
}

impl Add for Mean {
    fn add(&mut self, other: &Self) {
        self.mean += other.mean;
        self.samples += other.samples;
        self.variance += other.variance;
        self.soft += other.soft;
        self.count += other.count;
    }
}

impl Pixel {
    /// `soft`: the soft light of the spots, if that is known.
    pub(super) fn new(sharp: &Sharp, spots: &[Spot], soft: Option<&[Light]>) -> Pixel {
        let n = sharp.samples;
        let of_sharp_mean = luminance(sharp.radiance) / n;
        let mut variance = (sharp.squares / n - of_sharp_mean.powi(2)).max(0.0);
        let (mut of_soft_mean, mut squares) = (0.0, 0.0);
        let mut of_sharp = sharp.quarters;
        let mut of_soft = [0.0; QUARTERS];
        for (k, spot) in spots.iter().enumerate() {
            let light = soft.map(|soft| soft[k]);
            let irradiance = light.map_or_else(|| spot.light(), |light| light.irradiance());
            let reflected = luminance(spot.reflectance() * irradiance / PI);
            of_soft_mean += reflected / n;
            squares += (reflected / spot.samples()).powi(2) * spot.samples() / n;
            // Radiance per unit of reflectance, and per unit of irradiance, in luminance.
            let per = |unit: f32| if unit > 0.0 { reflected / unit } else { 0.0 };
            let per_reflectance = per(luminance(spot.reflectance()));
            let per_irradiance = per(luminance(irradiance));
            for quarter in 0..QUARTERS {
                of_sharp[quarter] += spot.reflecting()[quarter] * per_reflectance;
                let deviation = light.map_or(0.0, |light| light.quarters()[quarter]);
                of_soft[quarter] += deviation * per_irradiance / n;
            }
        }
        variance += (squares - of_soft_mean.powi(2)).max(0.0);
        let mean = of_sharp_mean + of_soft_mean;
        for (sum, count) in of_sharp.iter_mut().zip(sharp.of_quarters) {
            // A quarter without samples stands for none that differs.
            *sum = if count > 0.0 { *sum / count } else { mean };
        }
        let (sharp, soft) = (Spread::of(of_sharp), Spread::of(of_soft));
        Pixel { mean, samples: n, variance, sharp, soft }
    }

    /// The factor from a variance to that relative to the luminance.
    fn relative(&self) -> f32 {
        (self.mean + DARK).powi(-2)
    }

    fn in_units_of(self, unit: f32) -> Pixel {
        let squared = |spread: Spread| spread.scaled(1.0 / unit).scaled(1.0 / unit);
        Pixel {
            mean: self.mean / unit,
            samples: self.samples,
            variance: self.variance / unit / unit,
            sharp: squared(self.sharp),
            soft: squared(self.soft),
        }
    }
}
