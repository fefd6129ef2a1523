//! A pinhole camera.

use super::text::LARGEST;
use crate::error::{Error, Result};
use crate::geometry::Ray;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// A pinhole at `position`. Image coordinates run right and down over [0, 1]².
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// In the coordinates of the model files.
    position: DVec3,
    /// `position` in the coordinates of the scene; see [`Camera::placed`].
    eye: Vec3,
    /// Unit vectors: along the axis, to the image's right, to its top.
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// Half the image plane's height at unit distance, in images that are at least `full_aspect` times as wide as
    /// high. Narrower ones show more above and below, so that nothing is cut off at their sides.
    half_height: f32,
    full_aspect: f32,
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
        position: impl Into<DVec3>,
        look_at: impl Into<DVec3>,
        up: Vec3,
        vertical_fov: f32,
        near: f32,
    ) -> Result<Camera> {
        let (position, look_at) = (position.into(), look_at.into());
        let all = [position, look_at, up.as_dvec3(), DVec3::splat(near as f64)];
        if !all.iter().all(|v| v.is_finite()) {
            return Err(Error::new("the camera has a number that is not finite")
                .remedy("give it ordinary numbers"));
        }
        if position.abs().max(look_at.abs()).max_element() > f64::from(LARGEST) {
            return Err(Error::new(format!(
                "the camera's position or look_at has a coordinate larger than {LARGEST:e}"
            ))
            .remedy("move the camera to the scene: no model reaches so far"));
        }
        let Some(forward) = (look_at - position).as_vec3().try_normalize() else {
            return Err(Error::new("the camera's position and look_at are the same point")
                .remedy("move one of them"));
        };
        // Its square must neither overflow nor vanish.
        let length = up.abs().max_element();
        let up = if (1e-12..1e12).contains(&length) { up } else { up / length };
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
            eye: position.as_vec3(),
            forward,
            right,
            up: right.cross(forward),
            half_height: (0.5 * vertical_fov.to_radians()).tan(),
            full_aspect: 0.0,
            near,
        })
    }

    /// As this camera, for images of which each must show all that one shows that is `aspect` times as wide as high.
    /// An aspect that no image has counts as none.
    pub(crate) fn composed_for(&self, aspect: f32) -> Camera {
        let full_aspect = if (0.0..=WIDEST).contains(&aspect) { aspect } else { 0.0 };
        Camera { full_aspect, ..self.clone() }
    }

    /// The same camera for a scene whose origin is this place in the model files' coordinates.
    pub fn placed(&self, origin: DVec3) -> Camera {
        Camera { eye: (self.position - origin).as_vec3(), ..self.clone() }
    }

    /// From a camera in the scene's own coordinates, one that is in those of the model files.
    pub(crate) fn in_file_frame(&self, origin: DVec3) -> Camera {
        Camera { position: self.position + origin, ..self.clone() }
    }

    /// Whether this is what [`Camera::new`] makes: one that was read from a file need not be.
    pub(crate) fn is_possible(&self) -> bool {
        let directions = [self.forward, self.right, self.up];
        self.position.is_finite()
            && self.eye.is_finite()
            && directions.iter().all(|d| d.is_normalized())
            && self.half_height > 0.0
            && self.half_height.is_finite()
            && (0.0..=WIDEST).contains(&self.full_aspect)
            && self.near >= 0.0
            && self.near.is_finite()
    }

    /// The ray through the image point (x, y), for an image `aspect` times as wide as high. Its t
    /// is the depth along the axis.
    #[inline(always)]
    pub fn ray(&self, x: f32, y: f32, aspect: f32) -> Ray {
        let half_height = self.half_height * (self.full_aspect / aspect).max(1.0);
        let across = (2.0 * x - 1.0) * half_height * aspect;
        let upward = (1.0 - 2.0 * y) * half_height;
        let direction = self.forward + self.right * across + self.up * upward;
        Ray { t_min: self.near, ..Ray::new(self.eye, direction) }
    }
}

/// The greatest ratio of an image's width to its height that a camera may be composed for.
const WIDEST: f32 = 100.0;

/// A view's name is part of its picture's name, so that it may hold letters, digits, `-` and `_` alone.
pub fn is_view_name(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_alphanumeric() || c == '-' || c == '_')
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn an_image_narrower_than_the_camera_was_composed_for_keeps_its_sides() {
        let camera = Camera::new(Vec3::ZERO, Vec3::Z, Vec3::Y, 90.0, 2.0).expect("a good camera");
        let wide = camera.composed_for(2.0);
        assert_eq!(wide.ray(0.0, 0.0, 2.0), camera.ray(0.0, 0.0, 2.0));
        assert_eq!(wide.ray(0.0, 0.0, 4.0), camera.ray(0.0, 0.0, 4.0));
        assert!((wide.ray(0.0, 0.0, 1.0).direction - Vec3::new(2.0, 2.0, 1.0)).length() < 1e-6);
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
        let [far, long] =
            [make(Vec3::Z * 1e30, Vec3::Y, 40.0), make(Vec3::Z, Vec3::Y * 1e30, 40.0)];
        assert!(far.unwrap_err().to_string().contains("larger than 1e12"));
        assert_eq!(long, make(Vec3::Z, Vec3::Y, 40.0));
    }
}
