//! Soft light, averaged over neighbouring pixels.
//!
//! Around each spot a linear model of the irradiance, in position and normal, is fitted to the spots of like
//! surface in a window (Moon, Carr & Yoon, *Adaptive Rendering Based on Weighted Local Regression*, ACM TOG 33(5),
//! 2014). A wide window averages more noise away and follows the light less. How wide it is, Stein's unbiased estimate
//! of the risk decides (*Estimation of the Mean of a Multivariate Normal Distribution*, Annals of Statistics 9(6),
//! 1981; in pictures Li, Wu & Chuang, *SURE-based Optimization for Adaptive Sampling and Reconstruction*, ACM TOG
//! 31(6), 2012): how far the model is from the spot's own light, whose variance is known from blocks of the rays,
//! tells how far it is from the truth. With more rays the best window shrinks, and with it what the filter does wrong.

use super::spot::{Spot, on_one_surface};
use crate::color::{Rgb, luminance};
use crate::sampling::{LEVELS_OF_QUARTERS, QUARTERS};
use crate::simd;
use fearless_simd::{Simd, dispatch, f32x8, prelude::*};
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

type Spread = crate::sampling::Spread<LEVELS_OF_QUARTERS>;

/// The windows' radii in pixels; the first is the spot alone.
const RADII: [i32; 5] = [0, 1, 2, 4, 8];
/// What the spot's own noise in a model costs. Stein's 2 makes the estimate right in the mean. But it is noisy itself,
/// and a window that is too narrow by chance does more harm. With 4 noise falls by as much as blur grows, which no
/// stated error holds.
const COST_OF_NOISE: f32 = 2.5;
/// How fast the variance of the light falls, as if its rays were independent: where it falls faster, one ray among
/// them that meets bright light would seem too sure.
const GAIN: f32 = 2.0;
/// How much larger than the blocks of a spot's rays say its variance may be. The points of one sequence that it has may
/// lie alike in all blocks, and unlike those of the pixels around.
const MOST_BEYOND: f32 = 4.0;
/// Beyond this radius every other pixel is looked at.
const DENSE: i32 = 4;
/// Spots whose normals differ by more are of another surface: 45°.
const LIKE: f32 = 0.7;
/// A constant, three coordinates of the position, three of the normal.
const FEATURES: usize = 7;
/// The radius over which risks are averaged.
const AROUND: i32 = 3;
/// Against features that do not vary, as a share of the constant's weight.
const RIDGE: f32 = 1e-3;

/// The spots of a whole picture, ready to be averaged.
pub(super) struct Filter {
    width: usize,
    spots: Vec<Known>,
    /// Per pixel, and one more: where its spots begin.
    first: Vec<u32>,
}

/// A spot's means.
struct Known {
    position: Vec3,
    normal: Vec3,
    light: Light,
    /// The share of its pixel. Not the number of its rays: where these are many, the light of the pixels around was
    /// bright by chance, and that would count too little.
    weight: f32,
}

/// The soft light of a spot: H in W·m⁻² per channel, then its luminance by each quarter of the rays. Eight numbers,
/// of which the last is unused: loops over them are one instruction.
#[derive(Clone, Copy, Default)]
pub(super) struct Light([f32; CHANNELS]);

const CHANNELS: usize = 3 + QUARTERS + 1;

impl Light {
    fn new(irradiance: Rgb, quarters: [f32; QUARTERS]) -> Light {
        let [r, g, b] = irradiance.to_array();
        let [k, l, m, n] = quarters;
        Light([r, g, b, k, l, m, n, 0.0])
    }

    /// H in W·m⁻².
    pub(super) fn irradiance(&self) -> Rgb {
        Rgb::from_slice(&self.0)
    }

    pub(super) fn quarters(&self) -> [f32; QUARTERS] {
        let [_, _, _, quarters @ .., _] = self.0;
        quarters
    }

    /// Adds another light, times a factor.
    fn add(&mut self, factor: f32, other: &Light) {
        self.0.iter_mut().zip(other.0).for_each(|(sum, x)| *sum += factor * x);
    }

    /// There is no light below zero.
    fn positive(self) -> Light {
        Light(self.0.map(|x| x.max(0.0)))
    }
}

/// A spot's irradiance as the models of the windows give it.
#[derive(Clone, Copy, Default)]
struct Models {
    light: [Light; RADII.len()],
    risks: Risks,
}

/// What Stein's estimates of the squared error are made from, each of which is too large by the same number, the variance.
#[derive(Clone, Copy, Default)]
struct Risks {
    /// How far each model is from the light that was found, squared.
    distance: [f32; RADII.len()],
    /// The part of the light's variance that is in each model, by the blocks of its rays.
    noise: [f32; RADII.len()],
}

impl Risks {
    fn add(&mut self, weight: f32, other: &Risks) {
        let add = |to: &mut [f32], from: &[f32]| {
            to.iter_mut().zip(from).for_each(|(sum, x)| *sum += weight * x)
        };
        add(&mut self.distance, &other.distance);
        add(&mut self.noise, &other.noise);
    }

    /// How many times the variance that the blocks tell is what the narrowest window leaves over.
    fn beyond(&self) -> f32 {
        let beyond = self.distance[1] / (self.noise[0] - self.noise[1]);
        // It is no number where there is neither noise nor distance.
        if beyond > 1.0 { beyond.min(MOST_BEYOND) } else { 1.0 }
    }

    /// The number of the window with the least risk.
    fn least(&self) -> usize {
        let cost = COST_OF_NOISE * self.beyond();
        let risk = |number: usize| self.distance[number] + cost * self.noise[number];
        let least = (0..RADII.len()).min_by(|&a, &b| risk(a).total_cmp(&risk(b)));
        least.expect("there are some")
    }
}

impl Filter {
    /// `pixels`: the spots of each pixel, row by row.
    pub(super) fn new<'s>(width: usize, pixels: impl Iterator<Item = &'s [Spot]>) -> Self {
        let (mut spots, mut first) = (Vec::new(), vec![0]);
        for pixel in pixels {
            spots.extend(pixel.iter().map(|spot| Known {
                position: spot.position(),
                normal: spot.normal(),
                light: Light::new(spot.light(), spot.quarters()),
                weight: spot.samples() / pixel.iter().map(Spot::samples).sum::<f32>(),
            }));
            first.push(spots.len() as u32);
        }
        Filter { width, spots, first }
    }

    fn of_pixel(&self, pixel: usize) -> Range<usize> {
        self.first[pixel] as usize..self.first[pixel + 1] as usize
    }

    fn height(&self) -> usize {
        (self.first.len() - 1) / self.width.max(1)
    }

    /// The soft light of every spot.
    pub(super) fn filtered(&self) -> Vec<Light> {
        let level = simd::chosen();
        let models = self
            .of_all_spots(|pixel, spot| dispatch!(level, simd => self.models(simd, pixel, spot)));
        let chosen = self.of_all_spots(|pixel, spot| {
            let mut risks = Risks::default();
            self.for_each_neighbour(pixel, spot, 0..=AROUND, |_, k| {
                // In the pixel's light. A spot of one ray would say the most otherwise, and knows no variance.
                risks.add(self.spots[k].weight.powi(2), &models[k].risks);
            });
            let best = risks.least();
            (models[spot].light[best], RADII[best])
        });
        self.of_all_spots(|pixel, spot| {
            let (mut light, radius) = chosen[spot];
            light.add(1.0, &self.lost(pixel, spot, radius, |k| chosen[k].0));
            light.positive()
        })
    }

    /// The light that the models of a window leave over in the mean, and which is no noise: added back, it keeps
    /// the sum of the light, and halves what averaging blurs (Tukey's twicing: *Exploratory Data Analysis*, 1977).
    fn lost(
        &self,
        pixel: usize,
        spot: usize,
        radius: i32,
        model: impl Fn(usize) -> Light,
    ) -> Light {
        let (mut sum, mut weight) = (Light::default(), 0.0);
        self.for_each_neighbour(pixel, spot, 0..=radius, |_, k| {
            let other = &self.spots[k];
            sum.add(other.weight, &other.light);
            sum.add(-other.weight, &model(k));
            weight += other.weight;
        });
        Light(sum.0.map(|x| x / weight))
    }

    fn of_all_spots<T: Send>(&self, make: impl Fn(usize, usize) -> T + Sync) -> Vec<T> {
        let of_pixel = |pixel| self.of_pixel(pixel).map(move |spot| (pixel, spot));
        let of_row = |y| {
            let pixels = y * self.width..(y + 1) * self.width;
            pixels.flat_map(of_pixel).map(|(pixel, spot)| make(pixel, spot)).collect()
        };
        let of_rows: Vec<Vec<T>> = (0..self.height()).into_par_iter().map(of_row).collect();
        of_rows.into_iter().flatten().collect()
    }

    /// Visits the spots of like surface in a square ring about a pixel, the spot's own among them.
    #[inline(always)]
    fn for_each_neighbour(
        &self,
        pixel: usize,
        spot: usize,
        ring: std::ops::RangeInclusive<i32>,
        mut visit: impl FnMut(i32, usize),
    ) {
        let (x, y) = ((pixel % self.width) as i32, (pixel / self.width) as i32);
        let (from, to) = (*ring.start(), *ring.end());
        let centre = &self.spots[spot];
        let rows = (y - to).max(0)..(y + to + 1).min(self.height() as i32);
        for row in rows {
            let columns = (x - to).max(0)..(x + to + 1).min(self.width as i32);
            for column in columns {
                let distance = (row - y).abs().max((column - x).abs());
                let skipped = distance > DENSE && (row + column) % 2 != 0;
                if distance < from || skipped {
                    continue;
                }
                let neighbour = row as usize * self.width + column as usize;
                for k in self.of_pixel(neighbour) {
                    let is_own = k == spot;
                    let other = &self.spots[k];
                    let like = centre.normal.dot(other.normal) > LIKE
                        && on_one_surface(
                            other.position - centre.position,
                            centre.normal,
                            other.normal,
                        );
                    if is_own || (like && neighbour != pixel) {
                        visit(distance, k);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn models<S: Simd>(&self, simd: S, pixel: usize, spot: usize) -> Models {
        let centre = &self.spots[spot];
        let own = luminance(centre.light.irradiance());
        let variance = Spread::of(centre.light.quarters()).variance(GAIN);
        let mut models = Models::default();
        let mut sums = Sums::new(simd);
        let scale = self.scale(pixel, spot);
        let mut from = 0;
        for (number, &radius) in RADII.iter().enumerate() {
            self.for_each_neighbour(
                pixel,
                spot,
                from..=radius,
                #[inline(always)]
                |_, k| sums.add(centre, &self.spots[k], scale),
            );
            from = radius + 1;
            let (light, share) =
                if radius == 0 { (centre.light, 1.0) } else { sums.at_centre(centre.weight) };
            models.light[number] = light;
            // Towards a horizon a plane may be too long for the sums.
            let is_possible = (0.0..=1.0).contains(&share);
            models.risks.noise[number] = if is_possible { share } else { 1.0 } * variance;
            models.risks.distance[number] = if is_possible {
                (luminance(light.irradiance()) - own).powi(2)
            } else {
                f32::INFINITY
            };
        }
        models
    }

    /// About one over the largest distance in the widest window.
    #[inline(always)]
    fn scale(&self, pixel: usize, spot: usize) -> f32 {
        let mut farthest = 0.0f32;
        self.for_each_neighbour(pixel, spot, 0..=2, |_, k| {
            let way = self.spots[k].position - self.spots[spot].position;
            farthest = farthest.max(way.length_squared());
        });
        if farthest > 0.0 { 0.5 / farthest.sqrt() } else { 1.0 }
    }
}

type Row = [f32; CHANNELS];

/// The sums of a least-squares fit, row by row.
struct Sums<S: Simd> {
    /// Σ w x xᵀ.
    products: [f32x8<S>; FEATURES],
    /// Σ w x y, for each channel of the light.
    values: [f32x8<S>; FEATURES],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Sums { products: [zero; FEATURES], values: [zero; FEATURES] }
    }

    #[inline(always)]
    fn add(&mut self, centre: &Known, other: &Known, scale: f32) {
        let simd = self.products[0].simd;
        let place = (other.position - centre.position) * scale;
        let turn: Vec3 = (other.normal - centre.normal) * 2.0;
        let features = [1.0, place.x, place.y, place.z, turn.x, turn.y, turn.z, 0.0];
        let (x, y) = (f32x8::from_slice(simd, &features), f32x8::from_slice(simd, &other.light.0));
        let rows = self.products.iter_mut().zip(&mut self.values);
        for ((products, values), of_row) in rows.zip(features) {
            let factor = f32x8::splat(simd, other.weight * of_row);
            *products += factor * x;
            *values += factor * y;
        }
    }

    /// The model's value where all features are 0, and the share that the light there, of a `weight`, has in it.
    #[inline(always)]
    fn at_centre(&self, weight: f32) -> (Light, f32) {
        let (mut products, mut values) = (self.products.map(Row::from), self.values.map(Row::from));
        let ridge = RIDGE * products[0][0];
        for (i, row) in products.iter_mut().enumerate().skip(1) {
            row[i] += ridge;
        }
        // Gauss's elimination from the last feature up: what is left in the first row is the constant's.
        for k in (1..FEATURES).rev() {
            let (above, from_pivot) = products.split_at_mut(k);
            let (values_above, values_from_pivot) = values.split_at_mut(k);
            for (row, values) in above.iter_mut().zip(values_above) {
                let factor = -row[k] / from_pivot[0][k];
                add_scaled(row, factor, &from_pivot[0]);
                add_scaled(values, factor, &values_from_pivot[0]);
            }
        }
        // A slope may lead below zero.
        let light = Light(std::array::from_fn(|channel| values[0][channel] / products[0][0]));
        (light.positive(), weight / products[0][0])
    }
}

#[inline(always)]
fn add_scaled(to: &mut Row, factor: f32, row: &Row) {
    to.iter_mut().zip(row).for_each(|(sum, x)| *sum += factor * x);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::{PointSet, Purpose, Stream};

    const SIZE: usize = 24;

    /// Spots of a square that faces z, one per pixel; `at` gives the normal, and each quarter's grey irradiance.
    fn filter(at: impl Fn(usize, usize) -> (Vec3, [f32; QUARTERS])) -> Filter {
        let pixel = |p: usize| {
            let (x, y) = (p % SIZE, p / SIZE);
            let (normal, quarters) = at(x, y);
            let position = Vec3::new(x as f32, y as f32, 0.0);
            let mean = quarters.iter().sum::<f32>() / QUARTERS as f32;
            let light = Light::new(Rgb::splat(mean), quarters);
            Known { position, normal, light, weight: 1.0 }
        };
        let pixels = SIZE * SIZE;
        Filter {
            width: SIZE,
            spots: (0..pixels).map(pixel).collect(),
            first: (0..=pixels as u32).collect(),
        }
    }

    /// A number in [−1, 1) of each pixel and quarter.
    fn noise(x: usize, y: usize) -> [f32; QUARTERS] {
        let stream = Stream::new(5, Purpose::Bench, (x * SIZE + y) as u64, PointSet::Random);
        stream.point(0).map(|n| 2.0 * n - 1.0)
    }

    #[test]
    fn light_that_is_linear_in_the_place_passes_unchanged() {
        let light = |x: usize, y: usize| 3.0 + 0.1 * x as f32 - 0.05 * y as f32;
        let filter = filter(|x, y| (Vec3::Z, [light(x, y); QUARTERS]));
        for (p, found) in filter.filtered().into_iter().enumerate() {
            let expected = light(p % SIZE, p / SIZE);
            // The ridge pulls the slope at the picture's rim, where windows are one-sided.
            assert!(
                (found.irradiance().x - expected).abs() < 2e-3 * expected,
                "{p}: {} and {expected}",
                found.irradiance()
            );
        }
    }

    #[test]
    fn noise_is_averaged_away() {
        let filter = filter(|x, y| (Vec3::Z, noise(x, y).map(|n| 1.0 + 0.2 * n)));
        let squares = |values: Vec<f32>| {
            values.iter().map(|v| (v - 1.0).powi(2)).sum::<f32>() / values.len() as f32
        };
        let before = squares(filter.spots.iter().map(|s| s.light.irradiance().x).collect());
        let after = squares(filter.filtered().iter().map(|v| v.irradiance().x).collect());
        // The window of 5 x 5 pixels alone divides the variance by 25, and at the rim, where the model reaches out of
        // its window, by less than half of that.
        assert!(after < before / 8.0, "{before} and {after}");
    }

    #[test]
    fn light_that_bends_is_not_blurred_by_more_than_its_noise() {
        let truth = |x: usize| 1.0 + 0.5 * (x as f32 * 0.6).sin();
        for noise_of_light in [1e-2, 1e-3, 1e-4] {
            let noisy = |x: usize, y: usize| noise(x, y).map(|n| truth(x) + noise_of_light * n);
            let filter = filter(|x, y| (Vec3::Z, noisy(x, y)));
            let squares = |values: Vec<f32>| {
                let errors = values.iter().enumerate().map(|(p, v)| (v - truth(p % SIZE)).powi(2));
                errors.sum::<f32>() / values.len() as f32
            };
            let before = squares(filter.spots.iter().map(|s| s.light.irradiance().x).collect());
            let after = squares(filter.filtered().iter().map(|v| v.irradiance().x).collect());
            assert!(after < 1.05 * before, "{noise_of_light}: {before} and {after}");
        }
    }

    #[test]
    fn noise_that_the_blocks_of_a_spot_have_in_common_is_averaged_away() {
        // Its variance is two thirds of the whole, and no block tells of it.
        let shared = |x: usize, y: usize| 0.212 * noise(x + SIZE, y + SIZE)[0];
        let quarters = |x, y| noise(x, y).map(|n| 3.0 + shared(x, y) + 0.3 * n);
        let filter = filter(|x, y| (Vec3::Z, quarters(x, y)));
        let squares = |light: Vec<f32>| light.iter().map(|x| (x - 3.0).powi(2)).sum::<f32>();
        let before = squares(filter.spots.iter().map(|s| s.light.irradiance().x).collect());
        let after = squares(filter.filtered().iter().map(|v| v.irradiance().x).collect());
        assert!(after < 0.1 * before, "{before} and {after}");
    }

    #[test]
    fn an_edge_of_the_surface_and_an_edge_of_light_without_noise_stay_sharp() {
        let half = SIZE / 2;
        let turned =
            filter(
                |x, _| {
                    if x < half { (Vec3::Z, [1.0; QUARTERS]) } else { (Vec3::X, [5.0; QUARTERS]) }
                },
            );
        let lit =
            filter(|x, _| (Vec3::Z, if x < half { [1.0; QUARTERS] } else { [5.0; QUARTERS] }));
        for filter in [turned, lit] {
            for (p, found) in filter.filtered().into_iter().enumerate() {
                let expected = if p % SIZE < half { 1.0 } else { 5.0 };
                assert!(
                    (found.irradiance().x - expected).abs() < 1e-3,
                    "{p}: {} and {expected}",
                    found.irradiance()
                );
            }
        }
    }
}
