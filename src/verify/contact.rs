//! Whether one ray meets one triangle, decided exactly.

use super::cramer::Cramer;
use super::exact::{Difference, Signs, compare_distances, determinant_sign};
use crate::geometry::{Ray, Triangle};
use glam::Vec3;
use std::cmp::Ordering;

/// How a ray meets a triangle, in exact numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Contact {
    Miss(Miss),
    /// Hit and miss are both defensible.
    Touching(Touch),
    /// Inside the triangle, with t in (`t_min`, `t_max`].
    Hit {
        /// t is exactly `t_max`.
        at_end: bool,
    },
}

/// Why there is no hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Miss {
    /// A coordinate or an end of the interval is NaN, or a coordinate is infinite.
    NotFinite,
    /// The line passes by the triangle; or the direction is zero and there is no line.
    Beside,
    /// t < `t_min`.
    Before,
    /// t is exactly `t_min`, where the interval is open.
    AtStart,
    /// t > `t_max`.
    After,
}

/// How a ray touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Touch {
    /// The line meets exactly one edge, with t in the interval.
    Edge,
    /// The line meets exactly one vertex, with t in the interval.
    Vertex,
    /// The line runs in the triangle's plane and meets the triangle, along a whole stretch of t;
    /// the interval is not checked.
    Coplanar,
    /// The triangle has no area and lies in one plane with the line; the interval is not checked.
    Degenerate,
}

/// The contact, and the determinants that it took.
#[derive(Debug, Clone, Copy)]
pub struct Examined {
    pub contact: Contact,
    pub cramer: Cramer,
}

/// Where the line meets the triangle, whatever the interval.
enum Place {
    Beside,
    Inside,
    Touching(Touch),
}

/// Decides exactly how a ray meets a triangle, for any f32 numbers.
pub(crate) fn examine(ray: &Ray, triangle: &Triangle) -> Examined {
    let cramer = Cramer::new(ray, triangle);
    Examined { contact: decide(ray, triangle, &cramer), cramer }
}

fn decide(ray: &Ray, triangle: &Triangle, cramer: &Cramer) -> Contact {
    if !are_numbers(ray, triangle) {
        return Contact::Miss(Miss::NotFinite);
    }
    let exact = Signs { ray, triangle };
    let touch = match place(&exact, cramer) {
        Place::Beside => return Contact::Miss(Miss::Beside),
        Place::Touching(touch @ (Touch::Coplanar | Touch::Degenerate)) => {
            return Contact::Touching(touch);
        }
        Place::Touching(touch) => Some(touch),
        Place::Inside => None,
    };
    let from_start = compare_t(&exact, cramer, ray.t_min);
    let from_end = compare_t(&exact, cramer, ray.t_max);
    match (from_start, from_end) {
        (Ordering::Less, _) => Contact::Miss(Miss::Before),
        (Ordering::Equal, _) => Contact::Miss(Miss::AtStart),
        (_, Ordering::Greater) => Contact::Miss(Miss::After),
        (_, end) => match touch {
            Some(touch) => Contact::Touching(touch),
            None => Contact::Hit { at_end: end == Ordering::Equal },
        },
    }
}

fn are_numbers(ray: &Ray, triangle: &Triangle) -> bool {
    let [p0, p1, p2] = triangle.p;
    [ray.origin, ray.direction, p0, p1, p2].iter().all(|p| p.is_finite())
        && !ray.t_min.is_nan()
        && !ray.t_max.is_nan()
}

/// The line meets the triangle where no two of u, v and w have opposite signs.
///
/// det = u + v + w, so if they have one sign and are not all zero, then det has it too.
fn place(exact: &Signs, cramer: &Cramer) -> Place {
    let known = [cramer.u.sign(), cramer.v.sign(), cramer.w().sign()];
    // Most triangles are passed by so clearly that no exact sign is needed.
    if is_mixed(known.into_iter().flatten()) {
        return Place::Beside;
    }
    let signs = [
        known[0].unwrap_or_else(|| exact.u()),
        known[1].unwrap_or_else(|| exact.v()),
        known[2].unwrap_or_else(|| exact.w()),
    ];
    if is_mixed(signs.into_iter()) {
        return Place::Beside;
    }
    match signs.iter().filter(|sign| sign.is_eq()).count() {
        0 => Place::Inside,
        1 => Place::Touching(Touch::Edge),
        2 => Place::Touching(Touch::Vertex),
        _ => place_in_plane(exact),
    }
}

fn is_mixed(signs: impl Iterator<Item = Ordering> + Clone) -> bool {
    signs.clone().any(|sign| sign.is_gt()) && signs.clone().any(|sign| sign.is_lt())
}

/// The line and the triangle lie in one plane: project both where the triangle keeps its area.
fn place_in_plane(exact: &Signs) -> Place {
    if exact.ray.direction == Vec3::ZERO {
        return Place::Beside;
    }
    let Some(axis) = Vec3::AXES.into_iter().find(|&axis| exact.normal(axis).is_ne()) else {
        return Place::Touching(Touch::Degenerate);
    };
    let sides = [0, 1, 2].map(|corner| exact.side(axis, corner));
    if sides.iter().all(|side| side.is_gt()) || sides.iter().all(|side| side.is_lt()) {
        Place::Beside
    } else {
        Place::Touching(Touch::Coplanar)
    }
}

/// How t compares with an end of the interval; the line is known to cross the plane.
fn compare_t(exact: &Signs, cramer: &Cramer, bound: f32) -> Ordering {
    if bound.is_infinite() {
        return if bound > 0.0 { Ordering::Less } else { Ordering::Greater };
    }
    cramer
        .compare_t(bound as f64)
        .or_else(|| exact.t(bound))
        .expect("a line that meets a triangle outside its plane crosses the plane")
}

/// Which of two triangles' planes the ray meets first; `None` if it is parallel to one.
///
/// All coordinates must be finite.
pub(crate) fn compare(
    ray: &Ray,
    (first, first_cramer): (&Triangle, &Cramer),
    (second, second_cramer): (&Triangle, &Cramer),
) -> Option<Ordering> {
    let (a, b) = (first_cramer.quotient(first_cramer.t), second_cramer.quotient(second_cramer.t));
    // The difference of the two values rounds once, relative to itself.
    let difference = a.value - b.value;
    if difference.abs() * (1.0 - f64::EPSILON) > a.error + b.error {
        return difference.partial_cmp(&0.0);
    }
    let crosses_both = first_cramer.det.sign().is_some() && second_cramer.det.sign().is_some();
    if crosses_both && meets_shared_corners(ray, first, second) {
        return Some(Ordering::Equal);
    }
    compare_distances(ray, first, second)
}

/// Whether the line meets the corner, or the line through the two corners, that two triangles share, as in
/// most ties. A line that crosses both planes then crosses them there, at one t.
fn meets_shared_corners(ray: &Ray, first: &Triangle, second: &Triangle) -> bool {
    let mut shared = first.p.iter().filter(|p| second.p.contains(p));
    let to = |p: &Vec3| Difference::new(*p, ray.origin);
    let d = Difference::of(ray.direction);
    match (shared.next(), shared.next(), shared.next()) {
        (Some(_), Some(_), Some(_)) => true,
        (Some(p), Some(q), None) => determinant_sign([d, to(p), to(q)]).is_eq(),
        // d × (p − o) = 0.
        (Some(p), None, None) => Vec3::AXES
            .into_iter()
            .all(|axis| determinant_sign([Difference::of(axis), d, to(p)]).is_eq()),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::super::rational;
    use super::*;
    use num_traits::ToPrimitive;
    use proptest::prelude::*;
    use std::collections::HashMap;

    const UNIT: Triangle = Triangle { p: [Vec3::ZERO, Vec3::X, Vec3::Y] };

    fn down(x: f32, y: f32) -> Ray {
        Ray::new(Vec3::new(x, y, 2.0), Vec3::NEG_Z)
    }

    fn contact(ray: &Ray, triangle: &Triangle) -> Contact {
        examine(ray, triangle).contact
    }

    #[test]
    fn inside_edge_vertex_and_beside_are_told_apart() {
        assert_eq!(contact(&down(0.25, 0.25), &UNIT), Contact::Hit { at_end: false });
        assert_eq!(contact(&down(0.5, 0.5), &UNIT), Contact::Touching(Touch::Edge));
        assert_eq!(contact(&down(0.5, 0.0), &UNIT), Contact::Touching(Touch::Edge));
        assert_eq!(contact(&down(0.0, 1.0), &UNIT), Contact::Touching(Touch::Vertex));
        assert_eq!(contact(&down(0.5, 0.5f32.next_up()), &UNIT), Contact::Miss(Miss::Beside));
        assert_eq!(contact(&down(0.5, 0.5f32.next_down()), &UNIT), Contact::Hit { at_end: false });
        assert_eq!(contact(&down(0.5, f32::from_bits(1)), &UNIT), Contact::Hit { at_end: false });
        assert_eq!(contact(&down(0.5, -f32::from_bits(1)), &UNIT), Contact::Miss(Miss::Beside));
    }

    #[test]
    fn the_interval_is_open_below_and_closed_above() {
        let ray = |t_min, t_max| Ray { t_min, t_max, ..down(0.25, 0.25) };
        assert_eq!(contact(&ray(2.0, 9.0), &UNIT), Contact::Miss(Miss::AtStart));
        assert_eq!(contact(&ray(2f32.next_up(), 9.0), &UNIT), Contact::Miss(Miss::Before));
        assert_eq!(contact(&ray(2f32.next_down(), 9.0), &UNIT), Contact::Hit { at_end: false });
        assert_eq!(contact(&ray(0.0, 2.0), &UNIT), Contact::Hit { at_end: true });
        assert_eq!(contact(&ray(0.0, 2f32.next_down()), &UNIT), Contact::Miss(Miss::After));
        assert_eq!(contact(&ray(f32::NEG_INFINITY, 2.0), &UNIT), Contact::Hit { at_end: true });
    }

    #[test]
    fn a_ray_in_the_plane_touches_if_it_meets_the_triangle() {
        let along = |y| Ray::new(Vec3::new(-1.0, y, 0.0), Vec3::X);
        for (y, expected) in [
            (0.5, Contact::Touching(Touch::Coplanar)),
            (0.0, Contact::Touching(Touch::Coplanar)),
            (1.0, Contact::Touching(Touch::Coplanar)),
            (1f32.next_up(), Contact::Miss(Miss::Beside)),
            (-f32::from_bits(1), Contact::Miss(Miss::Beside)),
        ] {
            assert_eq!(contact(&along(y), &UNIT), expected, "y = {y}");
        }
        let above = Ray::new(Vec3::new(-1.0, 0.5, f32::from_bits(1)), Vec3::X);
        assert_eq!(contact(&above, &UNIT), Contact::Miss(Miss::Beside));
    }

    #[test]
    fn a_triangle_without_area_is_its_own_outcome() {
        let line = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::X * 2.0);
        let point = Triangle { p: [Vec3::ZERO; 3] };
        assert_eq!(contact(&down(0.5, 0.0), &line), Contact::Touching(Touch::Degenerate));
        assert_eq!(contact(&down(0.5, 0.1), &line), Contact::Miss(Miss::Beside));
        assert_eq!(contact(&down(0.0, 0.0), &point), Contact::Touching(Touch::Degenerate));
    }

    #[test]
    fn what_is_not_finite_is_missed() {
        for bad in [f32::NAN, f32::INFINITY] {
            for axis in Vec3::AXES {
                let poison = Vec3::select(axis.cmpeq(Vec3::ONE), Vec3::splat(bad), Vec3::ZERO);
                let good = down(0.25, 0.25);
                let origin = Ray { origin: good.origin + poison, ..good };
                let direction = Ray { direction: good.direction + poison, ..good };
                let corner = Triangle { p: [UNIT.p[0], UNIT.p[1] + poison, UNIT.p[2]] };
                for (ray, triangle) in [(origin, UNIT), (direction, UNIT), (good, corner)] {
                    assert_eq!(contact(&ray, &triangle), Contact::Miss(Miss::NotFinite));
                }
            }
        }
        let no_end = Ray { t_max: f32::NAN, ..down(0.25, 0.25) };
        assert_eq!(contact(&no_end, &UNIT), Contact::Miss(Miss::NotFinite));
        let no_direction = Ray::new(Vec3::new(0.25, 0.25, 0.0), Vec3::ZERO);
        assert_eq!(contact(&no_direction, &UNIT), Contact::Miss(Miss::Beside));
    }

    /// Checks the contact against fractions, and that the f64 numbers keep their bounds.
    fn check(ray: &Ray, triangle: &Triangle) -> Contact {
        let Examined { contact, cramer } = examine(ray, triangle);
        assert_eq!(contact, rational::contact(ray, triangle), "{ray:?} {triangle:?}");
        if let Some(exact) = rational::meeting(ray, triangle) {
            let numbers = [(cramer.t, exact.t), (cramer.u, exact.u), (cramer.v, exact.v)];
            for (numerator, exact) in numbers {
                let estimate = cramer.quotient(numerator);
                // Half of a f64's last place comes from printing the fraction as f64.
                let exact = exact.to_f64().unwrap();
                let room = estimate.error + f64::EPSILON * exact.abs();
                let off = (estimate.value - exact).abs();
                assert!(room.is_infinite() || off <= room, "{exact}: {ray:?} {triangle:?}");
            }
        }
        contact
    }

    fn check_order(ray: &Ray, a: &Triangle, b: &Triangle) -> Option<Ordering> {
        let (cramer_a, cramer_b) = (Cramer::new(ray, a), Cramer::new(ray, b));
        let order = compare(ray, (a, &cramer_a), (b, &cramer_b));
        let exact = rational::meeting(ray, a).zip(rational::meeting(ray, b));
        assert_eq!(order, exact.map(|(a, b)| a.t.cmp(&b.t)), "{ray:?} {a:?} {b:?}");
        order
    }

    fn small() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(-2i8..=2).prop_map(|p| Vec3::from_array(p.map(f32::from)))
    }

    fn small_triangle() -> impl Strategy<Value = Triangle> {
        prop::array::uniform3(small()).prop_map(|p| Triangle { p })
    }

    /// A float of any finite bit pattern, or an everyday one, or a special one.
    fn wild() -> impl Strategy<Value = f32> {
        prop_oneof![
            prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO,
            -4f32..4.0,
            prop::sample::select(vec![
                0.0,
                -0.0,
                1.0,
                -1.0,
                f32::MAX,
                -f32::MAX,
                f32::MIN_POSITIVE,
                f32::from_bits(1),
                1f32.next_up(),
                1f32.next_down(),
            ]),
        ]
    }

    fn wild_point() -> impl Strategy<Value = Vec3> {
        prop::array::uniform3(wild()).prop_map(Vec3::from_array)
    }

    #[test]
    fn small_integer_rays_of_every_kind_are_decided_as_fractions_decide_them() {
        let mut state = 1u64;
        // Knuth's linear congruential generator; its upper bits are good.
        let mut integer = |from: i32, to: i32| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (from + ((state >> 33) % (to - from + 1) as u64) as i32) as f32
        };
        let mut seen = HashMap::new();
        for _ in 0..40_000 {
            let mut point = || Vec3::from_array([(); 3].map(|_| integer(-2, 2)));
            let triangle = Triangle { p: [point(), point(), point()] };
            let ray = Ray::new(point(), point());
            let ray = Ray { t_min: integer(-1, 1), t_max: integer(0, 2), ..ray };
            *seen.entry(check(&ray, &triangle)).or_insert(0) += 1;
        }
        for outcome in [
            Contact::Miss(Miss::Beside),
            Contact::Miss(Miss::Before),
            Contact::Miss(Miss::AtStart),
            Contact::Miss(Miss::After),
            Contact::Touching(Touch::Edge),
            Contact::Touching(Touch::Vertex),
            Contact::Touching(Touch::Coplanar),
            Contact::Touching(Touch::Degenerate),
            Contact::Hit { at_end: false },
            Contact::Hit { at_end: true },
        ] {
            assert!(seen.get(&outcome).is_some_and(|&n| n >= 10), "{outcome:?} of {seen:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5_000))]

        #[test]
        fn a_ray_aimed_at_an_edge_or_a_vertex_is_decided_as_fractions_decide_it(
            o in prop::array::uniform3(-4f32..4.0), p in prop::array::uniform9(-4f32..4.0),
            a in 0f32..=1.0, at_corner in any::<bool>(), power in -100i32..100, ulps in -2i32..=2,
        ) {
            let [o, p0, p1, p2] = [&o[..], &p[..3], &p[3..6], &p[6..]]
                .map(|x| Vec3::from_slice(x) * 2f32.powi(power));
            let triangle = Triangle { p: [p0, p1, p2] };
            let target = triangle.at(if at_corner { a.round() } else { a }, 0.0);
            let mut direction = target - o;
            direction.x = f32::from_bits(direction.x.to_bits().wrapping_add_signed(ulps));
            let ray = Ray::new(o, direction);
            check(&ray, &triangle);
            // The hit is at or about t = 1.
            check(&Ray { t_max: 1.0, ..ray }, &triangle);
            check(&Ray { t_min: 1.0, ..ray }, &triangle);
        }

        #[test]
        fn distances_are_ordered_as_fractions_order_them(
            o in small(), d in small(), a in small_triangle(), b in small_triangle(),
        ) {
            check_order(&Ray::new(o, d), &a, &b);
        }
    }

    proptest! {
        // Fractions of numbers from 1e-45 to 1e38 are slow.
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn wild_floats_are_decided_as_fractions_decide_them(
            o in wild_point(), d in wild_point(), p in prop::array::uniform3(wild_point()),
            t_min in wild(), t_max in wild(),
        ) {
            check(&Ray { origin: o, direction: d, t_min, t_max }, &Triangle { p });
        }

        #[test]
        fn wild_distances_are_ordered_as_fractions_order_them(
            o in wild_point(), d in wild_point(), p in prop::array::uniform3(wild_point()),
            q in wild_point(),
        ) {
            // Turned, and hinged at an edge: planes of which f64 may see no difference.
            let [p0, p1, p2] = p;
            let ray = Ray::new(o, d);
            check_order(&ray, &Triangle { p }, &Triangle { p: [p1, p2, p0] });
            check_order(&ray, &Triangle { p }, &Triangle { p: [p1, p2, q] });
        }
    }
}
