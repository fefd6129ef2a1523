//! Axis-aligned bounding boxes.

use glam::Vec3;

/// A closed axis-aligned box; empty when `min` exceeds `max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    pub min: Vec3,
    pub max: Vec3,
}

impl Bounds {
    pub const EMPTY: Bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    #[inline]
    pub fn including(self, point: Vec3) -> Bounds {
        Bounds { min: self.min.min(point), max: self.max.max(point) }
    }

    #[inline]
    pub fn with(self, other: &Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether the boxes have a point in common.
    #[inline]
    pub fn touches(&self, other: &Bounds) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    #[inline]
    pub fn center(&self) -> Vec3 {
        0.5 * self.min + 0.5 * self.max
    }

    #[inline]
    pub fn diagonal(&self) -> Vec3 {
        self.max - self.min
    }
}

impl FromIterator<Vec3> for Bounds {
    #[inline]
    fn from_iter<I: IntoIterator<Item = Vec3>>(points: I) -> Self {
        points.into_iter().fold(Bounds::EMPTY, Bounds::including)
    }
}
