//! A pinhole camera, and one that finds its own place.

use crate::error::{Error, Result};
use crate::geometry::bounds::Bounds;
use crate::geometry::{Ray, RayCaster, Triangle};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A pinhole at `position`. Image coordinates run right and down over [0, 1]².
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    position: Vec3,
    /// Unit vectors: along the axis, to the image's right, to its top.
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// Half the image plane's height at unit distance.
    half_height: f32,
    /// Rays start at this depth along the axis.
    near: f32,
}

impl Camera {
    /// The direction that is up unless something else is asked for.
    pub const USUAL_UP: Vec3 = Vec3::Y;

    /// The vertical field of view, in degrees, unless something else is asked for.
    pub const USUAL_FOV: f32 = 40.0;

    /// `vertical_fov` in degrees; `near` in the scene's units, measured along the axis.
    ///
    /// # Errors
    /// A direction that is none, a field of view outside (0, 180), a negative near distance.
    pub fn new(
        position: Vec3,
        look_at: Vec3,
        up: Vec3,
        vertical_fov: f32,
        near: f32,
    ) -> Result<Camera> {
        let all = [position, look_at, up, Vec3::splat(near)];
        if !all.iter().all(|v| v.is_finite()) {
            return Err(Error::new("the camera has a number that is not finite")
                .remedy("give it ordinary numbers"));
        }
        let Some(forward) = (look_at - position).try_normalize() else {
            return Err(Error::new("the camera's position and look_at are the same point")
                .remedy("move one of them"));
        };
        let Some(right) = forward.cross(up).try_normalize() else {
            return Err(Error::new("the camera's up points along its view, or is zero")
                .remedy("choose an up that is not parallel to look_at - position"));
        };
        if !(vertical_fov > 0.0 && vertical_fov < 180.0) {
            return Err(Error::new(format!(
                "the camera's vertical_fov is {vertical_fov}, outside 0 to 180 degrees"
            ))
            .remedy("40 is a usual value"));
        }
        if near < 0.0 {
            return Err(Error::new(format!("the camera's near distance {near} is negative"))
                .remedy("leave it out, or give a distance in the scene's units"));
        }
        Ok(Camera {
            position,
            forward,
            right,
            up: right.cross(forward),
            half_height: (0.5 * vertical_fov.to_radians()).tan(),
            near,
        })
    }

    /// Whether this is what [`Camera::new`] makes: one that was read from a file need not be.
    pub(crate) fn is_possible(&self) -> bool {
        let directions = [self.forward, self.right, self.up];
        self.position.is_finite()
            && directions.iter().all(|d| d.is_normalized())
            && self.half_height > 0.0
            && self.half_height.is_finite()
            && self.near >= 0.0
            && self.near.is_finite()
    }

    /// The ray through the image point (x, y), for an image `aspect` times as wide as high. Its t
    /// is the depth along the axis.
    #[inline]
    pub fn ray(&self, x: f32, y: f32, aspect: f32) -> Ray {
        let across = (2.0 * x - 1.0) * self.half_height * aspect;
        let upward = (1.0 - 2.0 * y) * self.half_height;
        let direction = self.forward + self.right * across + self.up * upward;
        Ray { t_min: self.near, ..Ray::new(self.position, direction) }
    }

    /// A camera for a model that came without one: of some views from around the model and from
    /// inside it, the one that sees the most of lit sides, since a back is black.
    pub fn fitted(triangles: &[Triangle], caster: &dyn RayCaster) -> Camera {
        let bounds: Bounds = triangles.iter().flat_map(|t| t.p).collect();
        candidates(&bounds)
            .into_iter()
            .map(|camera| (fronts_seen(&camera, triangles, caster), camera))
            // Of equal views the first, so that `max_by` must look from the end.
            .rev()
            .max_by(|a, b| a.0.cmp(&b.0))
            .map(|(_, camera)| camera)
            .expect("there are always candidates")
    }
}

/// Three-quarter views from outside first, then the four axes from outside and from inside.
fn candidates(bounds: &Bounds) -> Vec<Camera> {
    const FOV_OUTSIDE: f32 = 40.0;
    const FOV_INSIDE: f32 = 80.0;
    let center = bounds.center();
    let radius = (0.5 * bounds.diagonal().length()).max(f32::MIN_POSITIVE);
    let distance = radius / (0.5 * FOV_OUTSIDE).to_radians().sin();
    let corners = [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
        .map(|(x, z)| Vec3::new(0.6 * x, 0.45, z).normalize());
    let axes = [Vec3::Z, Vec3::X, Vec3::NEG_Z, Vec3::NEG_X];

    let outside =
        corners.into_iter().chain(axes).map(|from| (center + from * distance, FOV_OUTSIDE));
    let inside =
        axes.into_iter().map(|from| (center + from * bounds.diagonal() * 0.48, FOV_INSIDE));
    outside
        .chain(inside)
        .filter_map(|(position, fov)| Camera::new(position, center, Vec3::Y, fov, 0.0).ok())
        .collect()
}

fn fronts_seen(camera: &Camera, triangles: &[Triangle], caster: &dyn RayCaster) -> usize {
    const GRID: usize = 32;
    (0..GRID * GRID)
        .filter(|i| {
            let [x, y] = [i % GRID, i / GRID].map(|k| (k as f32 + 0.5) / GRID as f32);
            let ray = camera.ray(x, y, 1.0);
            caster.nearest(&ray).is_some_and(|hit| {
                triangles[hit.triangle.index()].normal().dot(ray.direction) < 0.0
            })
        })
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BruteForce, MollerTrumbore};

    #[test]
    fn the_corners_of_the_image_are_the_field_of_view() {
        let camera = Camera::new(Vec3::ZERO, Vec3::Z, Vec3::Y, 90.0, 2.0).expect("a good camera");
        // Looking along +z with y up, +x is on the left.
        let ray = camera.ray(0.0, 0.0, 2.0);
        assert!((ray.direction - Vec3::new(2.0, 1.0, 1.0)).length() < 1e-6);
        assert_eq!(ray.t_min, 2.0);
        assert_eq!(camera.ray(0.5, 0.5, 2.0).direction, Vec3::Z);
    }

    #[test]
    fn a_camera_without_a_direction_is_refused() {
        let make = |look_at, up, fov| Camera::new(Vec3::ZERO, look_at, up, fov, 0.0);
        assert!(make(Vec3::Z, Vec3::Y, 40.0).is_ok());
        assert!(make(Vec3::ZERO, Vec3::Y, 40.0).is_err());
        assert!(make(Vec3::Z, Vec3::Z, 40.0).is_err());
        assert!(make(Vec3::Z, Vec3::Y, 0.0).is_err());
        assert!(make(Vec3::Z, Vec3::Y, f32::NAN).is_err());
        assert!(make(Vec3::splat(f32::NAN), Vec3::Y, 40.0).is_err());
    }

    #[test]
    fn a_fitted_camera_sees_a_front() {
        let seen_from = |triangle: Triangle| {
            let triangles = [triangle];
            let caster = BruteForce::<MollerTrumbore>::new(&triangles);
            let camera = Camera::fitted(&triangles, &caster);
            assert!(fronts_seen(&camera, &triangles, &caster) > 0);
            camera.position
        };
        let (a, b, c) = (Vec3::ZERO, Vec3::X, Vec3::Y);
        assert!(seen_from(Triangle::new(a, b, c)).z > 0.0);
        assert!(seen_from(Triangle::new(a, c, b)).z < 0.0);
    }
}
