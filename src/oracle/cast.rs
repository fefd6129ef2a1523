//! Rays through Embree: [`RayCaster`] for a committed scene.
//!
//! A negative `t_min` counts as 0, since Embree's rays do not reach behind their origin. Embree
//! promises nothing for hits exactly at an interval's ends. Its kernels are in fact as exact as
//! ours there, but its packet traversal drops a box that is entered just where the interval ends.

use super::layout::{RTCHit, RTCRayHit};
use super::packet::{Packet4, Packet8, Packet16, nearest_in_packets, occluded_in_packets};
use super::query::BLOCKED;
use super::{EmbreeScene, Packets};
use crate::geometry::{Hit, Ray, RayCaster};
use embree4_sys::{RTC_INVALID_GEOMETRY_ID, rtcIntersect1, rtcOccluded1};
use std::ptr;

impl RayCaster for EmbreeScene {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        let hit = RTCHit { geomID: RTC_INVALID_GEOMETRY_ID, ..RTCHit::default() };
        let mut query = RTCRayHit { ray: self.embree_ray(ray)?, hit };
        // SAFETY: a committed scene, and a ray and hit laid out and aligned as the installed
        // Embree has them, which is what the function reads and writes. Null arguments are
        // Embree's defaults.
        unsafe { rtcIntersect1(self.handle(), (&raw mut query).cast(), ptr::null_mut()) }
        let RTCHit { geomID, primID, u, v, .. } = query.hit;
        (geomID != RTC_INVALID_GEOMETRY_ID).then(|| {
            let triangle = self.triangle(geomID, primID);
            Hit { triangle, t: query.ray.tfar, u, v }
        })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let Some(mut query) = self.embree_ray(ray) else { return false };
        // SAFETY: as in `nearest`.
        unsafe { rtcOccluded1(self.handle(), (&raw mut query).cast(), ptr::null_mut()) }
        query.tfar == BLOCKED
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        match self.options().packets {
            Packets::Single => hits.extend(rays.iter().map(|ray| self.nearest(ray))),
            Packets::Packet4 => nearest_in_packets::<Packet4, 4>(self, rays, hits),
            Packets::Packet8 => nearest_in_packets::<Packet8, 8>(self, rays, hits),
            Packets::Packet16 => nearest_in_packets::<Packet16, 16>(self, rays, hits),
        }
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        blocked.clear();
        match self.options().packets {
            Packets::Single => blocked.extend(rays.iter().map(|ray| self.occluded(ray))),
            Packets::Packet4 => occluded_in_packets::<Packet4, 4>(self, rays, blocked),
            Packets::Packet8 => occluded_in_packets::<Packet8, 8>(self, rays, blocked),
            Packets::Packet16 => occluded_in_packets::<Packet16, 16>(self, rays, blocked),
        }
    }
}
