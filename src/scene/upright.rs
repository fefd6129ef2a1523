//! Which way is up in a model that does not say.

use crate::error::Warning;
use crate::geometry::Triangle;
use crate::geometry::bounds::Bounds;
use glam::{DVec3, Vec3};

/// Much more horizontal area than the other way speaks for z.
const CLEARLY: f64 = 1.3;
/// Less of the whole area than this says nothing: animals and people have no floors.
const SHARE: f64 = 0.3;

/// A base covers at least this share of the side that the model stands on, of the box around it.
const BASE: f64 = 0.1;
/// As `BASE`, where nothing else speaks for it.
const FOOT: f64 = 0.2;

/// Thinner than this, beside its largest extent, a model is a drawing.
const DRAWING: f32 = 1e-3;
/// Thinner than this, beside its largest extent, a model is a plate.
const PLATE: f32 = 0.1;

/// The direction in which the model stands on the file's origin, else the usual one of its kind, else what its
/// surfaces tell. `origin` is the scene's origin in the file's coordinates.
pub(super) fn guess(triangles: &[Triangle], origin: DVec3, usual: Option<Vec3>) -> Vec3 {
    let bounds: Bounds = triangles.iter().flat_map(|t| t.p).collect();
    let stands = if origin == DVec3::ZERO { stands_around_zero(triangles, &bounds) } else { None };
    stands.or(usual).unwrap_or_else(|| by_surfaces(triangles, &bounds))
}

/// Across which plane the model was put onto the origin, so that this lies below it and not at its side.
fn stands_around_zero(triangles: &[Triangle], bounds: &Bounds) -> Option<Vec3> {
    let size = bounds.diagonal();
    // A plate may begin or be centred anywhere.
    if size.min_element() < PLATE * size.max_element() {
        return None;
    }
    let rests = |axis: usize| bounds.min[axis].abs() <= 0.04 * size[axis];
    let is_around =
        |axis: usize| bounds.min[axis] < -0.2 * size[axis] && bounds.max[axis] > 0.2 * size[axis];
    let [y, z] = [1, 2].map(|axis| base(triangles, bounds, axis));
    match (rests(1), rests(2)) {
        (true, false) if is_around(0) && is_around(2) => Some(Vec3::Y),
        (false, true) if is_around(0) && is_around(1) && y <= z => Some(Vec3::Z),
        _ => None,
    }
}

/// y, unless more area lies flat, and more of it at the bottom, if z is up, and the model does not stand with y
/// up. Floors, roofs, table tops and feet lie flat; walls do not, but thin ones have large faces too.
fn by_surfaces(triangles: &[Triangle], bounds: &Bounds) -> Vec3 {
    let size = bounds.diagonal();
    if size.z < DRAWING * size.max_element() {
        return Vec3::Y;
    }
    let flat = flat_area(triangles);
    let all: f64 = triangles.iter().map(Triangle::area).sum();
    let is_flatter = flat.z > CLEARLY * flat.y;
    let lies = flat.z > SHARE * all && !stands_on_y(triangles, bounds);
    if is_flatter && (lies || has_foot(triangles, bounds)) { Vec3::Z } else { Vec3::Y }
}

/// Whether the model, which is no plate, has a foot below z alone: a bust has one and else nothing that lies flat.
fn has_foot(triangles: &[Triangle], bounds: &Bounds) -> bool {
    let size = bounds.diagonal();
    let [y, z] = [1, 2].map(|axis| base(triangles, bounds, axis));
    size.z > 0.5 * size.max_element() && z > FOOT && z > 5.0 * y && !rests_on_zero(bounds, 1)
}

/// Whether the model was put onto the plane y = 0 and not onto z = 0. Where that does not tell: whether it has a
/// base below y, and none below z that is clearly larger.
fn stands_on_y(triangles: &[Triangle], bounds: &Bounds) -> bool {
    match (rests_on_zero(bounds, 1), rests_on_zero(bounds, 2)) {
        (true, false) => true,
        (false, true) => false,
        _ => {
            let [y, z] = [1, 2].map(|axis| base(triangles, bounds, axis));
            y > BASE && CLEARLY * y > z
        }
    }
}

fn rests_on_zero(bounds: &Bounds, axis: usize) -> bool {
    bounds.min[axis].abs() <= 0.02 * bounds.diagonal()[axis]
}

/// The area that lies across an axis at its lower end, as a share of the box's face there.
fn base(triangles: &[Triangle], bounds: &Bounds, axis: usize) -> f64 {
    let size = bounds.diagonal();
    let bottom = bounds.min[axis] + 0.02 * size[axis];
    let lies_low = |triangle: &&Triangle| {
        let normal = triangle.double_area_normal();
        normal[axis].abs() >= 0.966 * normal.length() && triangle.centroid()[axis] <= bottom
    };
    let area: f64 = triangles.iter().filter(lies_low).map(Triangle::area).sum();
    let face = f64::from(size[(axis + 1) % 3]) * f64::from(size[(axis + 2) % 3]);
    if face > 0.0 { area / face } else { 0.0 }
}

pub(super) fn said(up: Vec3) -> Warning {
    let axis = match up {
        Vec3::X => "x",
        Vec3::Y => "y",
        _ => "z",
    };
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
    use crate::geometry::shapes::{self, square};

    fn guessed(triangles: &[Triangle]) -> Vec3 {
        guess(triangles, DVec3::ZERO, None)
    }

    #[test]
    fn what_stands_around_the_origin_overrides_a_habit() {
        let (z_up, y_up) = (Some(Vec3::Z), Some(Vec3::Y));
        let shelf = block([-0.4, 0.0, -0.4], [0.4, 2.4, 0.4]);
        assert_eq!(guess(&shelf, DVec3::ZERO, z_up), Vec3::Y);
        assert_eq!(guess(&shelf, DVec3::X, z_up), Vec3::Z, "moved: its zero says nothing");
        let tray = block([-0.6, -0.6, 0.0], [0.6, 0.6, 0.27]);
        assert_eq!(guess(&tray, DVec3::ZERO, y_up), Vec3::Z);
        let lid = block([-1.0, 0.0, -0.02], [1.0, 1.6, 0.02]);
        assert_eq!(guess(&lid, DVec3::ZERO, z_up), Vec3::Z, "extruded from its middle");
        let ball = block([-1.0; 3], [1.0; 3]);
        assert!(said(Vec3::Y).to_string().contains("with y up"));
        assert_eq!(guess(&ball, DVec3::ZERO, z_up), Vec3::Z);
        assert_eq!(guess(&ball, DVec3::ZERO, y_up), Vec3::Y);
    }

    #[test]
    fn a_drawing_is_not_laid_down_and_a_bust_stands_on_its_foot() {
        let drawing = square(Vec3::ZERO, Vec3::X, Vec3::Y * 2.0);
        assert_eq!(guessed(&drawing), Vec3::Y);
        let bust: Vec<Triangle> = shapes::icosphere(3)
            .into_iter()
            .map(|t| Triangle { p: t.p.map(|p| p.with_z(p.z.max(-0.8))) })
            .collect();
        let foot = block([-0.6, -0.6, -1.0], [0.6, 0.6, -0.9]);
        assert_eq!(guessed(&[bust, foot].concat()), Vec3::Z);
    }

    /// A table: a top with four feet, of which only the top and the soles lie flat.
    fn table(place: impl Fn(Vec3) -> Vec3) -> Vec<Triangle> {
        let top = square(Vec3::Y, Vec3::X * 2.0, Vec3::Z);
        let leg = square(Vec3::ZERO, Vec3::X * 0.1, Vec3::Y);
        let side = square(Vec3::ZERO, Vec3::Z * 0.1, Vec3::Y);
        let all = [top, leg, side].concat();
        all.into_iter().map(|t| Triangle { p: t.p.map(&place) }).collect()
    }

    /// A box with these corners.
    fn block(min: [f32; 3], max: [f32; 3]) -> Vec<Triangle> {
        let (min, max) = (Vec3::from(min), Vec3::from(max));
        let unit = shapes::cube(Vec3::ZERO, 1.0);
        unit.into_iter().map(|t| Triangle { p: t.p.map(|p| min + p * (max - min)) }).collect()
    }

    #[test]
    fn a_thin_wall_stands_on_the_plane_that_its_file_calls_zero() {
        assert_eq!(guessed(&block([-2.0, 0.0, -0.5], [2.0, 4.0, 0.5])), Vec3::Y);
        assert_eq!(guessed(&block([-0.38, 0.0, -0.07], [0.33, 0.55, 0.07])), Vec3::Y);
        assert_eq!(guessed(&block([-50.0, -25.0, 0.0], [50.0, 25.0, 30.0])), Vec3::Z);
    }

    #[test]
    fn a_court_within_high_walls_stands_on_its_ground() {
        let ground = block([-18.0, -0.2, -16.0], [18.0, 0.0, 16.0]);
        let walls = [-16.0, -8.0, 8.0, 15.0].map(|z| block([-18.0, 0.0, z], [18.0, 12.0, z + 1.0]));
        assert_eq!(guessed(&[ground, walls.concat()].concat()), Vec3::Y);
    }

    #[test]
    fn a_table_stands_on_its_feet() {
        assert_eq!(guessed(&table(|p| p)), Vec3::Y);
        assert_eq!(guessed(&table(|p| Vec3::new(p.x, -p.z, p.y))), Vec3::Z);
    }
}
