//! Which way is up in a model that does not say.

use crate::error::Warning;
use crate::geometry::Triangle;
use crate::geometry::bounds::Bounds;
use glam::{DVec3, Vec3};

/// Much more horizontal area than the other way speaks for z.
const CLEARLY: f64 = 1.3;
/// Less of the whole area than this says nothing: animals and people have no floors.
const SHARE: f64 = 0.3;

/// y, unless more area lies flat, and more of it at the bottom, if z is up. Floors, roofs, table tops and
/// feet lie flat; walls do not.
pub(super) fn guess(triangles: &[Triangle]) -> Vec3 {
    let flat = flat_area(triangles);
    let all: f64 = triangles.iter().map(Triangle::area).sum();
    if flat.z > CLEARLY * flat.y && flat.z > SHARE * all { Vec3::Z } else { Vec3::Y }
}

pub(super) fn said(up: Vec3) -> Warning {
    let axis = if up == Vec3::Z { "z" } else { "x" };
    Warning::new(format!("the picture is drawn with {axis} up (another: --up x, y or z)"))
}

/// Per axis, the area that lies across it, within some 15 degrees; what lies at the lower end counts twice.
fn flat_area(triangles: &[Triangle]) -> DVec3 {
    let bounds: Bounds = triangles.iter().flat_map(|t| t.p).collect();
    let bottom = (bounds.min + 0.02 * bounds.diagonal()).as_dvec3();
    let across = |triangle: &Triangle| {
        let normal = triangle.double_area_normal();
        let area = 0.5 * normal.length();
        let is_flat = normal.abs().cmpge(DVec3::splat(0.966 * 2.0 * area));
        let low = triangle.centroid().as_dvec3().cmple(bottom);
        DVec3::from_array(std::array::from_fn(|axis| match (is_flat.test(axis), low.test(axis)) {
            (false, _) => 0.0,
            (true, false) => area,
            (true, true) => 2.0 * area,
        }))
    };
    triangles.iter().map(across).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::shapes::square;

    /// A table: a top with four feet, of which only the top and the soles lie flat.
    fn table(place: impl Fn(Vec3) -> Vec3) -> Vec<Triangle> {
        let top = square(Vec3::Y, Vec3::X * 2.0, Vec3::Z);
        let leg = square(Vec3::ZERO, Vec3::X * 0.1, Vec3::Y);
        let side = square(Vec3::ZERO, Vec3::Z * 0.1, Vec3::Y);
        let all = [top, leg, side].concat();
        all.into_iter().map(|t| Triangle { p: t.p.map(&place) }).collect()
    }

    #[test]
    fn a_table_stands_on_its_feet() {
        assert_eq!(guess(&table(|p| p)), Vec3::Y);
        assert_eq!(guess(&table(|p| Vec3::new(p.x, -p.z, p.y))), Vec3::Z);
    }
}
