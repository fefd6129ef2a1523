//! Points on the triangles, uniform in area.

use super::{Ray, Triangle};
use crate::sampling::{cosine_hemisphere, uniform_triangle};
use glam::Vec3;

/// Picks points of some triangles with density 1/(total area).
pub(crate) struct Surface<'t> {
    triangles: &'t [Triangle],
    /// Sums of the triangles' areas, relative to the whole.
    cumulative_area: Vec<f64>,
}

/// A point of a triangle, by its barycentrics.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point<'t> {
    pub triangle: &'t Triangle,
    pub u: f32,
    pub v: f32,
}

impl<'t> Surface<'t> {
    /// # Panics
    /// If no triangle has an area.
    pub(crate) fn new(triangles: &'t [Triangle]) -> Self {
        let total: f64 = triangles.iter().map(Triangle::area).sum();
        assert!(total > 0.0, "points need a surface to lie on");
        let mut sum = 0.0;
        let add = |triangle: &Triangle| {
            sum += triangle.area() / total;
            sum
        };
        Surface { triangles, cumulative_area: triangles.iter().map(add).collect() }
    }

    /// The point for a uniform `xi`: its first two numbers place it in the triangle that the third
    /// chooses.
    pub(crate) fn point(&self, xi: [f32; 4]) -> Point<'t> {
        let last = self.cumulative_area.len() - 1;
        let index = self.cumulative_area.partition_point(|&sum| sum <= xi[2] as f64).min(last);
        let [_, u, v] = uniform_triangle(xi[0], xi[1]);
        Point { triangle: &self.triangles[index], u, v }
    }
}

impl Point<'_> {
    pub(crate) fn position(&self) -> Vec3 {
        self.triangle.at(self.u, self.v)
    }

    /// The position, lifted off the front by what rounding can do to it.
    pub(crate) fn lifted(&self) -> Vec3 {
        self.position() + self.triangle.normal() * self.triangle.ray_offset()
    }

    /// A ray off the front whose direction has density cosθ/π, for uniform `xi0` and `xi1`.
    pub(crate) fn leaving(&self, xi0: f32, xi1: f32) -> Ray {
        let normal = self.triangle.normal();
        Ray::new(
            self.position() + normal * self.triangle.ray_offset(),
            cosine_hemisphere(normal, xi0, xi1),
        )
    }
}
