//! Small questions about numbers of glTF files.

use glam::{DAffine3, Vec2, Vec3};

/// What only matters to the look is zero where it has no meaning.
pub(super) trait Finite: Default {
    fn is_finite(&self) -> bool;
}

impl Finite for Vec2 {
    fn is_finite(&self) -> bool {
        Vec2::is_finite(*self)
    }
}

impl Finite for Vec3 {
    fn is_finite(&self) -> bool {
        Vec3::is_finite(*self)
    }
}

/// The value, or zero.
pub(super) fn finite<T: Finite>(value: T) -> T {
    if value.is_finite() { value } else { T::default() }
}

/// Whether the transform turns the front to the back.
pub(super) fn is_mirror(transform: &DAffine3) -> bool {
    transform.matrix3.determinant() < 0.0
}
