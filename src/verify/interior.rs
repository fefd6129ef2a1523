//! Points inside closed meshes, convex or not.
//!
//! A ray from inside a closed surface crosses it an odd number of times, whatever its direction, and
//! one from outside an even number of times. So the exact count along one ray proves that all rays from
//! the same point must hit something.

use super::contact::Contact;
use super::referee::Referee;
use crate::geometry::{Ray, Triangle, TriangleId};
use crate::sampling::{PointSet, Purpose, Stream};
use glam::Vec3;

/// Directions to try, should a ray touch an edge or a vertex: by chance one hardly ever does.
const DIRECTIONS: u32 = 8;

/// A point inside a closed part of a mesh, above or below the middle of a triangle of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Inside<'p> {
    pub point: Vec3,
    pub beside: TriangleId,
    pub part: &'p [TriangleId],
}

/// Points inside a closed part that `attempts` attempts find: half as many or fewer.
pub(crate) fn points_inside<'p>(
    triangles: &[Triangle],
    part: &'p [TriangleId],
    attempts: u64,
    seed: u64,
) -> Vec<Inside<'p>> {
    let own: Vec<Triangle> = part.iter().map(|id| triangles[id.index()]).collect();
    let referee = Referee::new(&own);
    let clearance = own.iter().map(Triangle::ray_offset).fold(0.0, f32::max);
    let attempt = |number| {
        let number = 1 << 59 | (part[0].0 as u64) << 20 | number;
        let stream = Stream::new(seed, Purpose::Verify, number, PointSet::Random);
        let [x, side, distance, _] = stream.point(0);
        let beside = *pick(part, x);
        let point = step_off(&triangles[beside.index()], side, distance);
        let is_kept = is_clear(&referee, point, clearance) && is_inside(&referee, point, &stream);
        is_kept.then_some(Inside { point, beside, part })
    };
    (0..attempts).filter_map(attempt).collect()
}

/// The item at a share of a list that is not empty.
pub(crate) fn pick<T>(items: &[T], xi: f32) -> &T {
    &items[((xi as f64 * items.len() as f64) as usize).min(items.len() - 1)]
}

/// From the triangle's middle to either side, by 1/256 of its longest edge to the whole.
fn step_off(triangle: &Triangle, side: f32, distance: f32) -> Vec3 {
    let distance = triangle.longest_edge() as f32 * (-8.0 * distance).exp2();
    triangle.centroid() + triangle.normal() * if side < 0.5 { distance } else { -distance }
}

/// Whether the point is on no triangle, nor so near to one that rounding could put it on either side:
/// it keeps the distance at which rays start. Three lines through the point meet any plane that does
/// not.
fn is_clear(referee: &Referee, point: Vec3, distance: f32) -> bool {
    Vec3::AXES.iter().all(|&axis| {
        let probe = Ray { t_min: -distance, t_max: distance, ..Ray::new(point, axis) };
        referee.met(&probe).is_empty()
    })
}

/// For a closed surface, and a point that is not on it.
fn is_inside(referee: &Referee, point: Vec3, stream: &Stream) -> bool {
    (1..=DIRECTIONS)
        .map(|number| Vec3::from_slice(&stream.point(number)[..3]) - 0.5)
        .find_map(|direction| crossings(referee, &Ray::new(point, direction)))
        .is_some_and(|count| count % 2 == 1)
}

/// How many triangles the ray goes through; `None` if it touches one, which leaves the count open.
fn crossings(referee: &Referee, ray: &Ray) -> Option<usize> {
    let met = referee.met(ray);
    met.iter().all(|met| matches!(met.contact, Contact::Hit { .. })).then_some(met.len())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::scene::topology::Topology;
    use glam::{DQuat, DVec2, DVec3, EulerRot};
    use std::f64::consts::{PI, TAU};

    const AROUND: usize = 24;
    const ACROSS: usize = 12;
    const RADII: [f64; 2] = [2.0, 0.7];
    const CENTER: DVec3 = DVec3::new(0.3, -1.7, 2.9);

    fn turn() -> DQuat {
        DQuat::from_euler(EulerRot::XYZ, 0.7, 0.4, -1.1)
    }

    /// A ring of 24 straight pieces with 12 sides, askew in space.
    pub(crate) fn torus() -> Vec<Triangle> {
        let corner = |i: usize, j: usize| {
            let ring = DQuat::from_rotation_z(TAU * (i % AROUND) as f64 / AROUND as f64);
            let angle = TAU * (j % ACROSS) as f64 / ACROSS as f64;
            let p = DVec3::new(RADII[0] + RADII[1] * angle.cos(), 0.0, RADII[1] * angle.sin());
            (CENTER + turn() * (ring * p)).as_vec3()
        };
        (0..AROUND * ACROSS)
            .flat_map(|square| {
                let (i, j) = (square / ACROSS, square % ACROSS);
                let [a, b] = [corner(i, j), corner(i + 1, j)];
                let [c, d] = [corner(i + 1, j + 1), corner(i, j + 1)];
                [Triangle::new(a, b, c), Triangle::new(a, c, d)]
            })
            .collect()
    }

    /// How deep the point is below the sides of the torus, by elementary geometry; negative outside.
    fn depth(point: Vec3) -> f64 {
        let p = turn().inverse() * (point.as_dvec3() - CENTER);
        // A straight piece is a prism: every section of it along its middle is the same polygon, but
        // for a stretch that brings the corners from the middle of a chord to its circle.
        let sector = TAU / AROUND as f64;
        let from_middle = p.y.atan2(p.x).rem_euclid(sector) - 0.5 * sector;
        let along = DVec2::new(p.x, p.y).length() * from_middle.cos() / (0.5 * sector).cos();
        let section = DVec2::new(along - RADII[0], p.z);
        let outward = (0..ACROSS)
            .map(|side| section.dot(DVec2::from_angle(TAU * (side as f64 + 0.5) / ACROSS as f64)));
        RADII[1] * (PI / ACROSS as f64).cos() - outward.fold(f64::MIN, f64::max)
    }

    #[test]
    fn the_points_found_in_a_torus_are_inside_of_it() {
        let triangles = torus();
        let parts = Topology::new(&triangles).closed_parts();
        assert_eq!(parts.len(), 1);
        let found = points_inside(&triangles, &parts[0], 2000, 1);
        assert!(found.len() > 500, "{} of 2000", found.len());
        for inside in &found {
            assert!(depth(inside.point) > 0.0, "{inside:?}");
        }
    }

    #[test]
    fn a_ray_crosses_a_torus_an_odd_number_of_times_from_inside_and_an_even_one_from_outside() {
        let triangles = torus();
        let referee = Referee::new(&triangles);
        let (mut inside, mut outside) = (0, 0);
        for number in 0..3000 {
            let stream = Stream::new(2, Purpose::Verify, number, PointSet::Random);
            let offset = Vec3::from_slice(&stream.point(0)[..3]) - 0.5;
            let point = CENTER.as_vec3() + offset * 5.0;
            // Rounding of the corners leaves the answer open only where no point is kept.
            if !is_clear(&referee, point, triangles[0].ray_offset()) {
                continue;
            }
            let is_in = depth(point) > 0.0;
            assert_eq!(is_inside(&referee, point, &stream), is_in, "{point}");
            *if is_in { &mut inside } else { &mut outside } += 1;
        }
        assert!(inside > 300 && outside > 300, "{inside} inside, {outside} outside");
    }

    #[test]
    fn a_point_on_a_surface_or_near_it_is_not_clear_of_it() {
        let floor = [Triangle::new(Vec3::NEG_ONE.with_z(0.0), Vec3::X * 9.0, Vec3::Y * 9.0)];
        let is_clear = |z| is_clear(&Referee::new(&floor), Vec3::new(0.5, 0.25, z), 0.125);
        assert!(!is_clear(0.0) && !is_clear(0.124) && !is_clear(-0.124));
        assert!(is_clear(0.126) && is_clear(-0.126));
    }

    #[test]
    fn a_ray_that_touches_an_edge_is_not_counted() {
        let triangles = [Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y)];
        let referee = Referee::new(&triangles);
        let crossings = |x| crossings(&referee, &Ray::new(Vec3::new(x, 0.25, -1.0), Vec3::Z));
        assert_eq!([0.25, 0.0, -0.25].map(crossings), [Some(1), None, Some(0)]);
    }
}
