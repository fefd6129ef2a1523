//! A ray as Embree takes it, alone or in a packet.

use super::EmbreeScene;
use super::layout::RTCRay;
use crate::geometry::Ray;

/// The value that Embree writes into `tfar` of an occluded ray.
pub(super) const BLOCKED: f32 = f32::NEG_INFINITY;

impl EmbreeScene {
    /// The ray as Embree takes it. `None` for a ray that can hit nothing: one whose interval is
    /// empty, or with NaN or infinity in its origin or direction, which Embree leaves undefined.
    pub(super) fn embree_ray(&self, ray: &Ray) -> Option<RTCRay> {
        let traceable = ray.origin.is_finite() && ray.direction.is_finite();
        let start = self.start(ray.t_min);
        if !(traceable && ray.t_min < ray.t_max && start <= ray.t_max) {
            return None;
        }
        let [org_x, org_y, org_z] = ray.origin.to_array();
        let [dir_x, dir_y, dir_z] = ray.direction.to_array();
        let (tnear, tfar, mask) = (start, ray.t_max, u32::MAX);
        let (time, id, flags) = (0.0, 0, 0);
        Some(RTCRay {
            org_x,
            org_y,
            org_z,
            tnear,
            dir_x,
            dir_y,
            dir_z,
            time,
            tfar,
            mask,
            id,
            flags,
        })
    }

    /// The `tnear` with which Embree's interval is ours, (`t_min`, `t_max`].
    ///
    /// That of the default kernel, `absDen * tnear < T`, is open at `tnear`, but the robust one,
    /// `tnear <= t`, is closed, and so begins one number later. Neither looks behind the origin:
    /// Embree wants no negative `tnear`.
    fn start(&self, t_min: f32) -> f32 {
        match self.options().robust {
            _ if t_min < 0.0 => 0.0,
            true => t_min.next_up(),
            false => t_min,
        }
    }
}
