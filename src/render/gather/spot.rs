//! Spots: what a pixel sees of one surface.

use crate::color::{Rgb, luminance};
use crate::patches::SurfacePoint;
use crate::render::tone;
use crate::sampling::{QUARTERS, paired};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The samples of a pixel that lie on like surface, and the soft light there, as sums.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Spot {
    position: Vec3,
    normal: Vec3,
    /// Σρ over the samples.
    reflectance: Rgb,
    /// The luminance of these, by quarters of the samples.
    reflecting: [f32; QUARTERS],
    /// H in W·m⁻², and its luminance by quarters of the rays.
    light: Rgb,
    quarters: [f32; QUARTERS],
    /// Rays in each quarter.
    rays: [f32; QUARTERS],
    samples: f32,
}

/// Most spots of a pixel.
const MOST: usize = 4;

/// Samples whose normals differ by less belong to one spot: 37°.
const LIKE: f32 = 0.8;

impl Spot {
    /// One sample with the light that its rays gathered; `quarter` says of which quarter each ray is.
    pub(super) fn sample(
        point: &SurfacePoint,
        reflectance: Rgb,
        gathered: &[Rgb],
        quarter: impl Fn(usize) -> usize,
    ) -> Spot {
        let (position, normal) = (point.position, point.side.normal);
        let mut spot = Spot { position, normal, reflectance, samples: 1.0, ..Spot::default() };
        spot.reflecting[quarter(0)] = luminance(reflectance);
        for (ray, light) in gathered.iter().enumerate() {
            spot.light += *light;
            spot.quarters[quarter(ray)] += luminance(*light);
            spot.rays[quarter(ray)] += 1.0;
        }
        spot
    }

    /// Whether these can be sums over one sample or more, each of which has rays.
    pub(super) fn is_possible(&self) -> bool {
        let [reflectance, light] = [self.reflectance, self.light].map(|rgb| rgb.to_array());
        let sums = [&reflectance[..], &self.reflecting, &light, &self.quarters, &self.rays];
        self.position.is_finite()
            && self.normal.is_finite()
            && sums.into_iter().flatten().all(|x| (0.0..=f32::MAX).contains(x))
            && (1.0..=f32::MAX).contains(&self.samples)
            && self.rays.iter().any(|&rays| rays >= 1.0)
    }

    /// The mean place.
    pub(super) fn position(&self) -> Vec3 {
        self.position / self.samples
    }

    /// The mean normal, of length 1.
    pub(super) fn normal(&self) -> Vec3 {
        self.normal.normalize_or_zero()
    }

    /// Σρ over the samples.
    pub(super) fn reflectance(&self) -> Rgb {
        self.reflectance
    }

    pub(super) fn samples(&self) -> f32 {
        self.samples
    }

    /// What its samples count for the exposure, with this irradiance in W·m⁻².
    pub(super) fn exposed(&self, irradiance: Rgb) -> f32 {
        self.samples * tone::exposed(irradiance, self.reflectance / self.samples)
    }

    /// The luminance of Σρ by quarters of the samples.
    pub(super) fn reflecting(&self) -> [f32; QUARTERS] {
        self.reflecting
    }

    /// H in W·m⁻² in the mean.
    pub(super) fn light(&self) -> Rgb {
        self.light / self.rays.iter().sum::<f32>()
    }

    /// The luminance of H by quarters of the rays; where a quarter has none, its half or all rays stand for it.
    pub(super) fn quarters(&self) -> [f32; QUARTERS] {
        let mean = |quarters: Range<usize>| {
            let rays: f32 = self.rays[quarters.clone()].iter().sum();
            (rays > 0.0).then(|| self.quarters[quarters].iter().sum::<f32>() / rays)
        };
        let half = |q: usize| if q < 2 { 0..2 } else { 2..4 };
        std::array::from_fn(|q| {
            let known = mean(q..q + 1).or_else(|| mean(half(q))).or_else(|| mean(0..QUARTERS));
            known.expect("each sample has rays")
        })
    }

    /// Takes the quarters as the first half of twice as many samples.
    pub(super) fn lengthen(&mut self) {
        for quarters in [&mut self.reflecting, &mut self.quarters, &mut self.rays] {
            *quarters = paired(*quarters);
        }
    }

    fn add(&mut self, other: &Spot) {
        self.position += other.position;
        self.normal += other.normal;
        self.reflectance += other.reflectance;
        self.samples += other.samples;
        self.light += other.light;
        for quarter in 0..QUARTERS {
            self.reflecting[quarter] += other.reflecting[quarter];
            self.quarters[quarter] += other.quarters[quarter];
            self.rays[quarter] += other.rays[quarter];
        }
    }
}

/// Adds what was seen to the spots of a pixel, which are those from `first` on.
pub(super) fn add(spots: &mut Vec<Spot>, first: usize, new: &Spot) {
    let normal = new.normal();
    let of_pixel = &mut spots[first..];
    let like = |spot: &&mut Spot| {
        let mean = spot.normal();
        mean.dot(normal) > LIKE && on_one_surface(new.position() - spot.position(), mean, normal)
    };
    if let Some(spot) = of_pixel.iter_mut().find(like) {
        spot.add(new);
    } else if of_pixel.len() < MOST {
        spots.push(*new);
    } else {
        let towards = |spot: &Spot| spot.normal().dot(normal);
        let nearest = of_pixel.iter_mut().max_by(|a, b| towards(a).total_cmp(&towards(b)));
        nearest.expect("there are some").add(new);
    }
}

/// Whether two points may lie on one smooth surface, by the way from one to the other and the normals at both: where
/// these are alike, the way leads along the surface; where the surface turns, the way leaves its planes.
#[inline(always)]
pub(super) fn on_one_surface(way: Vec3, a: Vec3, b: Vec3) -> bool {
    let steepest = (FLAT + TURN * a.distance(b)) * way.length();
    way.dot(a).abs() <= steepest && way.dot(b).abs() <= steepest
}

/// The sine of the steepest way between points with one normal.
const FLAT: f32 = 0.05;
/// How much steeper it may be for each unit between the normals. On a sphere it is a half.
const TURN: f32 = 0.75;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarters_become_those_of_twice_as_many_samples() {
        let quarters = [1.0, 2.0, 3.0, 4.0];
        let mut spot =
            Spot { rays: [2.0; QUARTERS], quarters, reflecting: quarters, ..Spot::default() };
        spot.lengthen();
        assert_eq!(spot.rays, [4.0, 4.0, 0.0, 0.0]);
        assert_eq!([spot.quarters, spot.reflecting], [[3.0, 7.0, 0.0, 0.0]; 2]);
    }
}
