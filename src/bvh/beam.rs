//! A volume that contains all rays of a packet, to test at once which of eight boxes any ray may enter
//! (the interval arithmetic of Boulos, Wald & Shirley, *Geometric and Arithmetic Culling Methods for Entire
//! Ray Packets*, Utah UUCS-06-010, 2006).
//!
//! Rounding is monotone, so what the ranges give, computed as for one ray, bounds what each ray gets.

use super::WIDTH;
use super::node::Node;
use super::packet::Packet;
use super::ray_lanes::stretched;
use fearless_simd::{Simd, f32x8, prelude::*};

/// The ranges of a packet's origins and inverse directions.
pub(super) struct Beam<S: Simd> {
    /// `None` where the rays go both ways, which gives no bound.
    axes: [Option<BeamAxis<S>>; 3],
    t_min: f32x8<S>,
}

/// One axis of a beam whose rays all go the same way along it.
struct BeamAxis<S: Simd> {
    /// Which of (min, max) the rays meet first.
    near: usize,
    /// The origins nearest to what lies ahead, and farthest from it.
    origin: [f32x8<S>; 2],
    /// The least and the greatest.
    inverse: [f32x8<S>; 2],
}

impl<S: Simd> Beam<S> {
    #[inline(always)]
    pub(super) fn new(packet: &Packet<S>) -> Self {
        let simd = packet.simd;
        let axis = |axis: usize| {
            let range = |lanes: f32x8<S>| [lanes.reduce_min(), lanes.reduce_max()];
            let ([low, high], [least, greatest]) =
                (range(packet.origin[axis]), range(packet.inverse[axis]));
            let back = greatest < 0.0;
            if least <= 0.0 && !back {
                return None;
            }
            let origin = if back { [low, high] } else { [high, low] };
            Some(BeamAxis {
                near: back as usize,
                origin: origin.map(|x| f32x8::splat(simd, x)),
                inverse: [f32x8::splat(simd, least), f32x8::splat(simd, greatest)],
            })
        };
        let t_min = (packet.t_min * packet.t_scale).reduce_min();
        Beam { axes: [axis(0), axis(1), axis(2)], t_min: f32x8::splat(simd, t_min) }
    }

    /// The boxes that a ray of the packet may enter, as a mask, and before which distance none does.
    #[inline(always)]
    pub(super) fn enter(&self, packet: &Packet<S>, node: &Node) -> (u64, [f32; WIDTH]) {
        let simd = packet.simd;
        let t_max = (packet.found.t_max * packet.t_scale).reduce_max();
        let (mut near, mut far) = (self.t_min, f32x8::splat(simd, t_max));
        let mut number = 0;
        while number < 3 {
            if let Some(axis) = &self.axes[number] {
                let planes = &node.bounds[number];
                let first = f32x8::load_array_ref(simd, &planes[axis.near & 1]) - axis.origin[0];
                let last =
                    f32x8::load_array_ref(simd, &planes[1 - (axis.near & 1)]) - axis.origin[1];
                let [least, greatest] = axis.inverse;
                near = near.max((first * least).min(first * greatest));
                far = far.min((last * least).max(last * greatest));
            }
            number += 1;
        }
        let entered = near.simd_le(stretched(far)).to_bitmask();
        (entered & node.slots(simd), near.into())
    }
}
