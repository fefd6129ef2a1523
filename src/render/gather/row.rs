//! What is known of a row of pixels, as sums over their samples.

use super::spot::Spot;
use crate::color::{Rgb, luminance};
use crate::patches::Look;
use crate::render::tone;
use crate::sampling::{QUARTERS, paired};
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;

/// What is known of a pixel before its soft light is, as sums over its samples.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Sharp {
    /// Emission and light straight from sampled lights, and what is behind the scene.
    pub radiance: Rgb,
    pub samples: f32,
    /// Of the luminance of these.
    pub squares: f32,
    /// The luminance of these, and the number of samples, by quarters of the samples.
    pub quarters: [f32; QUARTERS],
    pub of_quarters: [f32; QUARTERS],
    /// The samples that fill the quarters once.
    pub in_quarters: u32,
    /// The luminance of these on surfaces that reflect more than they emit, and the number of samples there.
    pub reflecting: f32,
    pub reflecting_samples: f32,
    pub misses: f32,
}

impl Sharp {
    /// Makes the quarters longer for samples `from..to`, out of `fewest` or more, and returns how often they were doubled.
    /// That is possible only while they are filled exactly once; what there was then fills the first half.
    pub(super) fn lengthen(&mut self, from: u32, to: u32, fewest: u32) -> u32 {
        if from == 0 {
            self.in_quarters = fewest;
        } else if from != self.in_quarters {
            return 0;
        }
        let mut times = 0;
        while to / 2 >= self.in_quarters {
            self.in_quarters *= 2;
            self.quarters = paired(self.quarters);
            self.of_quarters = paired(self.of_quarters);
            times += 1;
        }
        times
    }

    /// Counts a sample; one that misses the scene shows `background`.
    pub(super) fn count(&mut self, quarter: usize, is_miss: bool, background: Rgb) {
        self.samples += 1.0;
        self.of_quarters[quarter] += 1.0;
        if is_miss {
            self.misses += 1.0;
            self.radiance += background;
            self.quarters[quarter] += luminance(background);
        }
    }

    /// Adds a sample that met the scene: its look, the light that arrives straight, and what its rays gathered.
    pub(super) fn add(
        &mut self,
        quarter: usize,
        look: &Look,
        radiates: bool,
        direct: Rgb,
        soft: &[Rgb],
    ) {
        let emitted = if radiates { look.radiance } else { Rgb::ZERO };
        let exposed = tone::exposed(direct, look.reflectance);
        let direct = look.reflectance * direct / PI;
        self.radiance += emitted + direct;
        self.quarters[quarter] += luminance(emitted + direct);
        self.squares += luminance(emitted + direct).powi(2);
        let soft = soft.iter().copied().sum::<Rgb>() / soft.len() as f32;
        let reflected = direct + look.reflectance * soft / PI;
        if emitted == Rgb::ZERO || luminance(emitted) <= luminance(reflected) {
            self.reflecting += luminance(emitted) + exposed;
            self.reflecting_samples += 1.0;
        }
    }
}

impl Sharp {
    /// Whether these can be sums over one sample or more.
    fn is_possible(&self) -> bool {
        let Sharp { radiance, samples, squares, reflecting, reflecting_samples, misses, .. } =
            *self;
        let (radiance, others) =
            (radiance.to_array(), [squares, reflecting, reflecting_samples, misses]);
        let sums = [&radiance[..], &others, &self.quarters, &self.of_quarters];
        (1.0..=f32::MAX).contains(&samples)
            && (QUARTERS as u32..=samples as u32).contains(&self.in_quarters)
            && sums.into_iter().flatten().all(|x| (0.0..=f32::MAX).contains(x))
    }
}

/// A row of pixels.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Row {
    /// Per pixel.
    pub sharp: Vec<Sharp>,
    pub spots: Vec<Spot>,
    /// Per pixel: where its spots end.
    pub ends: Vec<u32>,
}

impl Row {
    /// What is known of a pixel; nothing at first.
    pub(super) fn pixel(&self, x: usize) -> (Sharp, &[Spot]) {
        let sharp = self.sharp.get(x).copied().unwrap_or_default();
        let start = if x == 0 { 0 } else { self.ends.get(x - 1).copied().unwrap_or(0) };
        let end = self.ends.get(x).copied().unwrap_or(start);
        (sharp, &self.spots[start as usize..end as usize])
    }

    /// The samples of each pixel; none at first.
    pub(super) fn counts(&self, width: usize) -> impl Iterator<Item = u32> {
        (0..width).map(|x| self.sharp.get(x).map_or(0, |sharp| sharp.samples as u32))
    }

    /// Whether the parts belong together, in a row of `width` pixels.
    pub(super) fn is_possible(&self, width: usize) -> bool {
        let is_empty = self.sharp.is_empty() && self.ends.is_empty() && self.spots.is_empty();
        let is_full = self.sharp.len() == width
            && self.ends.len() == width
            && self.sharp.iter().all(Sharp::is_possible)
            && self.spots.iter().all(Spot::is_possible)
            && self.ends.is_sorted()
            && self.ends.last().is_none_or(|&end| end as usize == self.spots.len());
        is_empty || is_full
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::block;

    /// Quarters of samples whose luminance is 2 to the power of their number.
    fn quarters(steps: &[u32]) -> (u32, [f32; QUARTERS]) {
        let mut pixel = Sharp::default();
        let mut from = 0;
        for &to in steps {
            pixel.lengthen(from, to, 5);
            for number in from..to {
                let quarter = block(number, pixel.in_quarters, QUARTERS);
                pixel.count(quarter, true, Rgb::splat(2f32.powi(number as i32)));
            }
            from = to;
        }
        (pixel.in_quarters, pixel.quarters)
    }

    #[test]
    fn quarters_are_the_same_in_steps_and_at_once_and_longer_only_while_they_are_filled_once() {
        let of = |numbers: [std::ops::Range<i32>; QUARTERS]| {
            numbers.map(|numbers| numbers.map(|k| 2f32.powi(k)).sum::<f32>())
        };
        let twenty = (20, of([0..5, 5..10, 10..15, 15..20]));
        for steps in [&[20][..], &[5, 20], &[10, 20], &[5, 10, 20]] {
            assert_eq!(quarters(steps), twenty, "{steps:?}");
        }
        // Of five samples the first quarter has two. Three more go round again, and stay where they are.
        let (length, [a, b, c, d]) = quarters(&[5, 8, 20]);
        assert_eq!((length, a + b + c + d), (5, 2f32.powi(20) - 1.0));
        let (length, [a, ..]) = quarters(&[5, 8]);
        assert_eq!((length, a), (5, 1.0 + 2.0 + 32.0 + 64.0));
    }
}
