//! A ray and what it hits.

use super::TriangleId;
use glam::Vec3;

/// The points `origin + t · direction` with t in (`t_min`, `t_max`].
///
/// The direction need not have unit length; t is measured in multiples of it.
/// With a negative `t_min` it reaches behind the origin.
// Its eight numbers are one load.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Ray {
    pub origin: Vec3,
    pub direction: Vec3,
    pub t_min: f32,
    pub t_max: f32,
}

impl Ray {
    /// Everything in front of `origin`.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The segment from `start` to `end`, with t = 1 at the end.
    pub fn segment(start: Vec3, end: Vec3) -> Self {
        Ray { origin: start, direction: end - start, t_min: 0.0, t_max: 1.0 }
    }

    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }
}

/// Where a ray meets a triangle: at (1 − u − v)·p₀ + u·p₁ + v·p₂ and at `ray.at(t)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    pub triangle: TriangleId,
    pub t: f32,
    pub u: f32,
    pub v: f32,
}
