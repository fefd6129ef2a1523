//! Several rays per call: Embree's packets of 4, 8 and 16.
//!
//! A packet holds each member of its rays as an array with one lane per ray, and a mask says
//! which lanes count. The last packet of a batch may be partly empty.

use super::EmbreeScene;
use super::layout::{
    RTCHit4, RTCHit8, RTCHit16, RTCRay, RTCRay4, RTCRay8, RTCRay16, RTCRayHit4, RTCRayHit8,
    RTCRayHit16,
};
use super::query::BLOCKED;
use crate::geometry::{Hit, Ray};
use embree4_sys::{
    RTC_INVALID_GEOMETRY_ID, rtcIntersect4, rtcIntersect8, rtcIntersect16, rtcOccluded4,
    rtcOccluded8, rtcOccluded16,
};
use std::ptr;

/// −1 in the lanes that count. Embree wants 16 bytes' alignment for 4 lanes, 32 for 8, 64 for 16.
#[repr(C, align(64))]
pub(super) struct Mask<const LANES: usize>([i32; LANES]);

/// Rays of one packet, as Embree's structs hold them.
pub(super) trait EmbreePacket<const LANES: usize>: Default {
    fn set(&mut self, lane: usize, ray: &RTCRay);
    fn nearest(self, scene: &EmbreeScene, mask: &Mask<LANES>) -> [Option<Hit>; LANES];
    fn occluded(self, scene: &EmbreeScene, mask: &Mask<LANES>) -> [bool; LANES];
}

/// [`nearest_batch`](crate::geometry::RayCaster::nearest_batch), appended to `hits`.
pub(super) fn nearest_in_packets<P: EmbreePacket<LANES>, const LANES: usize>(
    scene: &EmbreeScene,
    rays: &[Ray],
    hits: &mut Vec<Option<Hit>>,
) {
    for rays in rays.chunks(LANES) {
        let (packet, mask) = fill::<P, LANES>(scene, rays);
        hits.extend(&packet.nearest(scene, &mask)[..rays.len()]);
    }
}

/// [`occluded_batch`](crate::geometry::RayCaster::occluded_batch), appended to `blocked`.
pub(super) fn occluded_in_packets<P: EmbreePacket<LANES>, const LANES: usize>(
    scene: &EmbreeScene,
    rays: &[Ray],
    blocked: &mut Vec<bool>,
) {
    for rays in rays.chunks(LANES) {
        let (packet, mask) = fill::<P, LANES>(scene, rays);
        blocked.extend(&packet.occluded(scene, &mask)[..rays.len()]);
    }
}

fn fill<P: EmbreePacket<LANES>, const LANES: usize>(
    scene: &EmbreeScene,
    rays: &[Ray],
) -> (P, Mask<LANES>) {
    let (mut packet, mut mask) = (P::default(), Mask([0; LANES]));
    for (lane, ray) in rays.iter().enumerate() {
        if let Some(ray) = scene.embree_ray(ray) {
            packet.set(lane, &ray);
            mask.0[lane] = -1;
        }
    }
    (packet, mask)
}

/// Copies the named members of a ray into its lane.
macro_rules! copy {
    ($packet:ident.0[$lane:ident] = $ray:ident: $($member:ident)*) => {
        $($packet.0.$member[$lane] = $ray.$member;)*
    };
}

/// One width's packet: a struct with arrays of `$lanes`, and the two functions that take it.
macro_rules! packet {
    (
        $name:ident, $lanes:literal, $ray:ident, $hit:ident, $both:ident,
        $intersect:ident, $occluded:ident
    ) => {
        #[derive(Default)]
        pub(super) struct $name($ray);

        impl EmbreePacket<$lanes> for $name {
            fn set(&mut self, lane: usize, ray: &RTCRay) {
                copy!(self.0[lane] = ray: org_x org_y org_z tnear dir_x dir_y dir_z time);
                copy!(self.0[lane] = ray: tfar mask id flags);
            }

            fn nearest(self, scene: &EmbreeScene, mask: &Mask<$lanes>) -> [Option<Hit>; $lanes] {
                let hit = $hit { geomID: [RTC_INVALID_GEOMETRY_ID; $lanes], ..$hit::default() };
                let mut both = $both { ray: self.0, hit };
                // SAFETY: a committed scene, an aligned mask of one number per lane, and rays and
                // hits laid out and aligned as the installed Embree has them, which is what the
                // function reads and writes. Null arguments are Embree's defaults.
                unsafe {
                    let (scene, mask) = (scene.handle(), mask.0.as_ptr());
                    $intersect(mask, scene, (&raw mut both).cast(), ptr::null_mut())
                }
                std::array::from_fn(|lane| {
                    let (geometry, primitive) = (both.hit.geomID[lane], both.hit.primID[lane]);
                    (geometry != RTC_INVALID_GEOMETRY_ID).then(|| Hit {
                        triangle: scene.triangle(geometry, primitive),
                        t: both.ray.tfar[lane],
                        u: both.hit.u[lane],
                        v: both.hit.v[lane],
                    })
                })
            }

            fn occluded(mut self, scene: &EmbreeScene, mask: &Mask<$lanes>) -> [bool; $lanes] {
                // SAFETY: as in `nearest`.
                unsafe {
                    let (scene, mask) = (scene.handle(), mask.0.as_ptr());
                    $occluded(mask, scene, (&raw mut self.0).cast(), ptr::null_mut())
                }
                self.0.tfar.map(|tfar| tfar == BLOCKED)
            }
        }
    };
}
packet!(Packet4, 4, RTCRay4, RTCHit4, RTCRayHit4, rtcIntersect4, rtcOccluded4);
packet!(Packet8, 8, RTCRay8, RTCHit8, RTCRayHit8, rtcIntersect8, rtcOccluded8);
packet!(Packet16, 16, RTCRay16, RTCHit16, RTCRayHit16, rtcIntersect16, rtcOccluded16);
