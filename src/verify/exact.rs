//! Signs of determinants of f32 differences, and comparisons of distances, without any rounding.
//!
//! The line of a ray is o + t·d with the f32 numbers o and d, not the line through o and a rounded
//! o + d. So rows of determinants are d itself, or differences of points.
//!
//! Two ways, the second only when the first does not apply:
//!
//! 1. The differences are exact in f64 (nearly always: f64 has 29 bits more than f32). Then
//!    [`robust::orient3d`] gives the sign: Shewchuk's adaptive expansions, *Adaptive Precision
//!    Floating-Point Arithmetic and Fast Robust Geometric Predicates*, 1997. They are exact where
//!    nothing underflows, and nothing does: all products are multiples of 2⁻⁴⁴⁷.
//! 2. Every f32 is an integer times a power of two. Scaled to the smallest such power, everything
//!    is an integer.

use crate::geometry::{Ray, Triangle};
use dashu_int::{IBig, Sign};
use glam::{DVec3, Vec3};
use robust::{Coord3D, orient3d};
use std::cmp::Ordering;

/// The row `p − q` of a determinant, not rounded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Difference {
    pub p: Vec3,
    pub q: Vec3,
}

impl Difference {
    pub(crate) fn new(p: Vec3, q: Vec3) -> Self {
        Difference { p, q }
    }

    /// The vector itself.
    pub(crate) fn of(p: Vec3) -> Self {
        Difference { p, q: Vec3::ZERO }
    }

    /// The difference in f64, if it is exact there.
    ///
    /// Knuth's two-sum finds the rounding error exactly (Shewchuk, theorem 7).
    fn in_f64(self) -> Option<DVec3> {
        let (p, q) = (self.p.as_dvec3(), self.q.as_dvec3());
        let x = p - q;
        let q_virtual = p - x;
        let p_virtual = x + q_virtual;
        let tail = (p - p_virtual) + (q_virtual - q);
        (tail == DVec3::ZERO).then_some(x)
    }
}

/// The sign of the determinant whose rows are a, b and c, that is of a·(b × c): `Less` is negative.
///
/// All coordinates must be finite.
pub(crate) fn determinant_sign(rows: [Difference; 3]) -> Ordering {
    match rows.map(Difference::in_f64) {
        [Some(a), Some(b), Some(c)] => {
            let coord = |v: DVec3| Coord3D { x: v.x, y: v.y, z: v.z };
            let sign = orient3d(coord(a), coord(b), coord(c), coord(DVec3::ZERO));
            sign.partial_cmp(&0.0).expect("a determinant of finite numbers is a number")
        }
        _ => determinant_sign_in_integers(rows),
    }
}

fn determinant_sign_in_integers(rows: [Difference; 3]) -> Ordering {
    let grid = BinaryGrid::of(rows.iter().flat_map(|row| [row.p, row.q]));
    sign(&determinant(&rows.map(|row| grid.difference(row))))
}

/// How the distance t to the first triangle's plane compares with that to the second's.
///
/// `None` if the line is parallel to one of the planes. All coordinates must be finite.
pub(crate) fn compare_distances(
    ray: &Ray,
    first: &Triangle,
    second: &Triangle,
) -> Option<Ordering> {
    let points = [ray.origin, ray.direction].into_iter();
    let grid = BinaryGrid::of(points.chain(first.p).chain(second.p));
    let (n1, d1) = distance(grid, ray, first)?;
    let (n2, d2) = distance(grid, ray, second)?;
    Some((n1 * d2).cmp(&(n2 * d1)))
}

/// How the distance t to the triangle's plane compares with `bound`.
///
/// `None` if the line is parallel to the plane. All coordinates must be finite, and `bound` may be
/// infinite, but not NaN.
pub(crate) fn compare_distance_with(
    ray: &Ray,
    triangle: &Triangle,
    bound: f32,
) -> Option<Ordering> {
    let grid = BinaryGrid::of([ray.origin, ray.direction].into_iter().chain(triangle.p));
    let (n, d) = distance(grid, ray, triangle)?;
    if bound.is_infinite() {
        return Some(if bound > 0.0 { Ordering::Less } else { Ordering::Greater });
    }
    let (mantissa, exponent) = decode(bound);
    let shift = exponent.unsigned_abs() as usize;
    Some(if exponent < 0 {
        (n << shift).cmp(&(d * mantissa))
    } else {
        n.cmp(&((d * mantissa) << shift))
    })
}

/// t as a fraction with a positive denominator.
fn distance(grid: BinaryGrid, ray: &Ray, triangle: &Triangle) -> Option<(IBig, IBig)> {
    let [p0, p1, p2] = triangle.p;
    let [e1, e2] = [p1, p2].map(|p| grid.difference(Difference::new(p, p0)));
    let s = grid.difference(Difference::new(ray.origin, p0));
    let d = grid.difference(Difference::of(ray.direction));
    // (d × e₂)·e₁ = det[d, e₂, e₁] and (s × e₁)·e₂ = det[s, e₁, e₂].
    let denominator = determinant(&[d, e2.clone(), e1.clone()]);
    let numerator = determinant(&[s, e1, e2]);
    match sign(&denominator) {
        Ordering::Equal => None,
        Ordering::Greater => Some((numerator, denominator)),
        Ordering::Less => Some((-numerator, -denominator)),
    }
}

/// All multiples of 2^`exponent`.
#[derive(Debug, Clone, Copy)]
struct BinaryGrid {
    exponent: i32,
}

impl BinaryGrid {
    /// The coarsest grid on which all the coordinates lie.
    fn of(points: impl Iterator<Item = Vec3>) -> Self {
        let coordinates = points.flat_map(|p| p.to_array()).filter(|&x| x != 0.0);
        BinaryGrid { exponent: coordinates.map(|x| decode(x).1).min().unwrap_or(0) }
    }

    /// The difference in units of the grid.
    fn difference(self, row: Difference) -> [IBig; 3] {
        [0, 1, 2].map(|axis| self.integer(row.p[axis]) - self.integer(row.q[axis]))
    }

    fn integer(self, x: f32) -> IBig {
        if x == 0.0 {
            return IBig::ZERO;
        }
        let (mantissa, exponent) = decode(x);
        IBig::from(mantissa) << (exponent - self.exponent) as usize
    }
}

/// `x` as m·2ᵏ, with m odd unless x is zero.
fn decode(x: f32) -> (i64, i32) {
    let bits = x.to_bits();
    let (field, fraction) = (((bits >> 23) & 0xff) as i32, (bits & 0x7f_ffff) as i64);
    let (mantissa, exponent) =
        if field == 0 { (fraction, -149) } else { (fraction | (1 << 23), field - 150) };
    let zeros = if mantissa == 0 { 0 } else { mantissa.trailing_zeros() };
    let mantissa = (mantissa >> zeros) * if x.is_sign_negative() { -1 } else { 1 };
    (mantissa, exponent + zeros as i32)
}

fn determinant([a, b, c]: &[[IBig; 3]; 3]) -> IBig {
    let minor = |i: usize, j: usize| &b[i] * &c[j] - &b[j] * &c[i];
    &a[0] * minor(1, 2) + &a[1] * minor(2, 0) + &a[2] * minor(0, 1)
}

fn sign(x: &IBig) -> Ordering {
    match x.sign() {
        _ if *x == IBig::ZERO => Ordering::Equal,
        Sign::Positive => Ordering::Greater,
        Sign::Negative => Ordering::Less,
    }
}

/// The numerators' and the denominator's signs for a ray and a triangle.
///
/// The rows follow from [`cramer`](super::cramer): (a × b)·c = det[a, b, c].
pub(crate) struct Signs<'a> {
    pub ray: &'a Ray,
    pub triangle: &'a Triangle,
}

impl Signs<'_> {
    pub(crate) fn u(&self) -> Ordering {
        let [p0, _, p2] = self.triangle.p;
        let (d, o) = (Difference::of(self.ray.direction), self.ray.origin);
        determinant_sign([d, Difference::new(p2, p0), Difference::new(o, p0)])
    }

    pub(crate) fn v(&self) -> Ordering {
        let [p0, p1, _] = self.triangle.p;
        let (d, o) = (Difference::of(self.ray.direction), self.ray.origin);
        determinant_sign([Difference::new(o, p0), Difference::new(p1, p0), d])
    }

    /// w = det − u − v = det[d, e₂ − s, e₁ − s], and e − s = p − o.
    pub(crate) fn w(&self) -> Ordering {
        let [_, p1, p2] = self.triangle.p;
        let (d, o) = (Difference::of(self.ray.direction), self.ray.origin);
        determinant_sign([d, Difference::new(p2, o), Difference::new(p1, o)])
    }

    /// The sign of the normal e₁ × e₂ along `axis`.
    pub(crate) fn normal(&self, axis: Vec3) -> Ordering {
        let [p0, p1, p2] = self.triangle.p;
        let (e1, e2) = (Difference::new(p1, p0), Difference::new(p2, p0));
        determinant_sign([Difference::of(axis), e1, e2])
    }

    /// On which side of the line vertex `corner` lies, in the projection along `axis`.
    pub(crate) fn side(&self, axis: Vec3, corner: usize) -> Ordering {
        let to_corner = Difference::new(self.triangle.p[corner], self.ray.origin);
        determinant_sign([Difference::of(axis), Difference::of(self.ray.direction), to_corner])
    }

    /// See [`compare_distance_with`].
    pub(crate) fn t(&self, bound: f32) -> Option<Ordering> {
        compare_distance_with(self.ray, self.triangle, bound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(rows: [[f32; 3]; 3]) -> [Difference; 3] {
        rows.map(|row| Difference::of(Vec3::from_array(row)))
    }

    #[test]
    fn a_float_is_an_odd_number_times_a_power_of_two() {
        assert_eq!(decode(0.0), (0, -149));
        assert_eq!(decode(-6.0), (-3, 1));
        assert_eq!(decode(f32::from_bits(1)), (1, -149));
        assert_eq!(decode(f32::from_bits(12)), (3, -147));
        assert_eq!(decode(f32::MAX), ((1 << 24) - 1, 104));
        for x in [1.5f32, -0.1, 3e38, 1e-40, f32::MIN_POSITIVE] {
            let (m, k) = decode(x);
            assert_eq!(m as f64 * 2f64.powi(k), x as f64);
        }
    }

    #[test]
    fn the_unit_axes_make_a_positive_determinant_and_a_swap_a_negative_one() {
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for sign in [determinant_sign, determinant_sign_in_integers] {
            assert_eq!(sign(rows([x, y, z])), Ordering::Greater);
            assert_eq!(sign(rows([y, x, z])), Ordering::Less);
            assert_eq!(sign(rows([x, y, x])), Ordering::Equal);
        }
    }

    #[test]
    fn a_difference_that_f64_rounds_is_decided_in_integers() {
        // 1 + 2⁻¹²⁰ against 1: f64 sees no difference.
        let tiny = 2f32.powi(-120);
        let row = Difference::new(Vec3::ONE, Vec3::new(-tiny, 0.0, 0.0));
        assert!(row.in_f64().is_none());
        let ones = Difference::of(Vec3::ONE);
        let z = Difference::of(Vec3::Z);
        // det[row, ones, z] = (1 + 2⁻¹²⁰)·1 − 1·1.
        assert_eq!(determinant_sign([row, ones, z]), Ordering::Greater);
        assert_eq!(determinant_sign([ones, row, z]), Ordering::Less);
    }

    #[test]
    fn expansions_and_integers_give_the_same_signs_at_every_magnitude() {
        // Two parallel rows, but for the last bit of one coordinate.
        for power in [-149 + 24, -60, 0, 60, 100] {
            let s = 2f32.powi(power);
            let a = [1.0 * s, 3.0 * s, 7.0 * s];
            let b = [3.0 * s, 9.0 * s, 21.0 * s];
            for last in [b[2].next_down(), b[2], b[2].next_up()] {
                let rows = rows([a, [b[0], b[1], last], [0.0, 1.0, 0.0]]);
                let expected = last.partial_cmp(&b[2]).unwrap().reverse();
                // det[a, b, y] = a_z·b_x − a_x·b_z.
                assert_eq!(determinant_sign(rows), expected);
                assert_eq!(determinant_sign_in_integers(rows), expected);
            }
        }
    }

    #[test]
    fn distances_compare_exactly_whatever_the_winding() {
        let at = |z: f32| Triangle::new(Vec3::Z * z, Vec3::X + Vec3::Z * z, Vec3::Y + Vec3::Z * z);
        let turned = |t: Triangle| Triangle { p: [t.p[0], t.p[2], t.p[1]] };
        let ray = Ray::new(Vec3::ZERO, Vec3::Z * 3.0);
        let (near, far) = (at(1.0), at(1.0f32.next_up()));
        assert_eq!(compare_distances(&ray, &near, &turned(far)), Some(Ordering::Less));
        assert_eq!(compare_distances(&ray, &turned(far), &near), Some(Ordering::Greater));
        assert_eq!(compare_distances(&ray, &near, &turned(near)), Some(Ordering::Equal));
        // t is 1/3: no f32 is equal to it.
        let third = 1.0f32 / 3.0;
        assert_eq!(compare_distance_with(&ray, &near, third), Some(Ordering::Less));
        assert_eq!(compare_distance_with(&ray, &near, third.next_down()), Some(Ordering::Greater));
        assert_eq!(compare_distance_with(&ray, &at(6.0), 2.0), Some(Ordering::Equal));
        assert_eq!(compare_distance_with(&ray, &near, f32::INFINITY), Some(Ordering::Less));
        let parallel = Ray::new(Vec3::ZERO, Vec3::X);
        assert_eq!(compare_distances(&parallel, &near, &far), None);
    }
}
