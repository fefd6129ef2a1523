//! Where a ray ends among surfaces that let a share of the light through.

use super::{Ray, TriangleId};

/// A number in [0, 1] for each triangle that a ray meets: where a share d of the light is stopped, the ray ends if it is
/// below d.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ending {
    bits: u64,
    passed: [TriangleId; MOST_PASSED],
    count: usize,
    is_random: bool,
}

/// Behind as many triangles as these a ray ends by chance.
const MOST_PASSED: usize = 8;

impl Ending {
    /// An ending by chance, with random numbers that are the ray's own: Enderton, Sintorn, Shirley & Luebke,
    /// *Stochastic Transparency*, I3D 2010.
    pub fn by_chance(ray: &Ray) -> Ending {
        let parts = [ray.origin.to_array(), ray.direction.to_array()];
        let bits = parts.as_flattened().iter().fold(0, |bits, x| mix(bits, x.to_bits().into()));
        Ending { bits, passed: [TriangleId(0); MOST_PASSED], count: 0, is_random: true }
    }

    /// An ending at the first triangle that stops any light.
    pub fn at_first(ray: &Ray) -> Ending {
        Ending { is_random: false, ..Ending::by_chance(ray) }
    }

    /// The same, but that it passes this triangle. Where it passes eight it is one by chance.
    pub fn behind(mut self, triangle: TriangleId) -> Ending {
        if let Some(passed) = self.passed.get_mut(self.count) {
            *passed = triangle;
            self.count += 1;
        }
        self.is_random |= self.count == MOST_PASSED;
        self
    }

    pub fn is_random(&self) -> bool {
        self.is_random
    }

    pub(crate) fn passes_any(&self) -> bool {
        self.count > 0
    }

    pub fn passes(&self, triangle: TriangleId) -> bool {
        self.passed[..self.count].contains(&triangle)
    }

    pub(crate) fn at(&self, triangle: TriangleId) -> f32 {
        if self.passes(triangle) {
            1.0
        } else if self.is_random {
            (mix(self.bits, triangle.0.into()) >> 40) as f32 / (1u64 << 24) as f32
        } else {
            0.0
        }
    }
}

/// SplitMix64's finaliser (Steele, Lea & Flood, "Fast Splittable Pseudorandom Number Generators", 2014).
fn mix(bits: u64, part: u64) -> u64 {
    let mut z = (bits ^ part).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
