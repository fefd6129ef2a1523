//! Spots: what a pixel sees of one surface.

use crate::color::Rgb;
use crate::patches::SurfacePoint;
use glam::Vec3;

/// The samples of a pixel that lie on like surface, and the soft light there, as sums.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spot {
    position: Vec3,
    normal: Vec3,
    /// Σρ over the samples.
    reflectance: Rgb,
    /// H in W·m⁻² by each half of the rays.
    light: [Rgb; 2],
    /// Rays in each half.
    rays: [f32; 2],
    samples: f32,
}

/// Most spots of a pixel.
const MOST: usize = 4;

/// Samples whose normals differ by less belong to one spot: 37°.
const LIKE: f32 = 0.8;

impl Spot {
    /// One sample with the light that its rays gathered.
    pub(super) fn sample(point: &SurfacePoint, reflectance: Rgb, gathered: &[Rgb]) -> Spot {
        let (position, normal) = (point.position, point.side.normal);
        let mut spot = Spot { position, normal, reflectance, samples: 1.0, ..Spot::default() };
        for (ray, light) in gathered.iter().enumerate() {
            let half = (point.sample.number as usize + ray) % 2;
            spot.light[half] += *light;
            spot.rays[half] += 1.0;
        }
        spot
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

    /// H in W·m⁻², by each half of the rays; one ray stands for both.
    pub(super) fn halves(&self) -> [Rgb; 2] {
        let half = |h: usize| match self.rays[h] {
            0.0 => self.light[1 - h] / self.rays[1 - h],
            rays => self.light[h] / rays,
        };
        [half(0), half(1)]
    }

    fn add(&mut self, other: &Spot) {
        self.position += other.position;
        self.normal += other.normal;
        self.reflectance += other.reflectance;
        self.samples += other.samples;
        for half in 0..2 {
            self.light[half] += other.light[half];
            self.rays[half] += other.rays[half];
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
pub(super) fn on_one_surface(way: Vec3, a: Vec3, b: Vec3) -> bool {
    let steepest = (FLAT + TURN * a.distance(b)) * way.length();
    way.dot(a).abs() <= steepest && way.dot(b).abs() <= steepest
}

/// The sine of the steepest way between points with one normal.
const FLAT: f32 = 0.05;
/// How much steeper it may be for each unit between the normals. On a sphere it is a half.
const TURN: f32 = 0.75;
