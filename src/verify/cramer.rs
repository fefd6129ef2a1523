//! Cramer's determinants for one ray and one triangle in double precision.
//!
//! With s = o − p₀, e₁ = p₁ − p₀ and e₂ = p₂ − p₀ (see
//! [`moller_trumbore`](crate::geometry::moller_trumbore)),
//!
//! ```text
//! det = (d × e₂)·e₁,   t = (s × e₁)·e₂ / det,   u = (d × e₂)·s / det,   v = (s × e₁)·d / det.
//! ```
//!
//! Each is a sum of six products of three f32 differences. In f64 that neither overflows (each
//! product is below 2³⁹⁰) nor underflows (each is a multiple of 2⁻⁴⁴⁷), so rounding is all that goes
//! wrong, and Higham's γₙ = nε/(1 − nε) bounds it (*Accuracy and Stability of Numerical Algorithms*,
//! 2nd ed., lemma 3.1): 8 roundings meet in a product at most, 3 of differences, 1 of each of two
//! products, 1 of the cross product's difference, 2 of the dot product's sums.

use crate::geometry::{Ray, Triangle};
use glam::DVec3;
use std::cmp::Ordering;

/// How far a [`ProductSum`] may lie from its exact value, per unit of `abs`.
///
/// γ₈ of the six products, 2 more roundings for w = det − u − v, and γ₈ once more for those of
/// `abs` itself would be below 11 ε; ε = 2⁻⁵³.
const ROUNDING: f64 = 12.0 * f64::EPSILON / 2.0;

/// A sum of products: its value, and the sum of the products' absolute values.
#[derive(Debug, Clone, Copy)]
pub struct ProductSum {
    pub value: f64,
    pub abs: f64,
}

impl ProductSum {
    /// The exact value's sign, where rounding leaves no doubt.
    #[inline]
    pub fn sign(self) -> Option<Ordering> {
        if self.value.abs() > ROUNDING * self.abs { self.value.partial_cmp(&0.0) } else { None }
    }
}

/// The determinants and what they are made of.
#[derive(Debug, Clone, Copy)]
pub struct Cramer {
    pub d: DVec3,
    pub s: DVec3,
    pub e1: DVec3,
    pub e2: DVec3,
    pub det: ProductSum,
    /// Numerators over `det`.
    pub t: ProductSum,
    pub u: ProductSum,
    pub v: ProductSum,
}

/// A number and how far the exact one may lie from it.
#[derive(Debug, Clone, Copy)]
pub struct Quotient {
    pub value: f64,
    /// Infinite where the sign of `det` is in doubt.
    pub error: f64,
}

impl Cramer {
    #[inline]
    pub fn new(ray: &Ray, triangle: &Triangle) -> Self {
        let [p0, p1, p2] = triangle.p.map(|p| p.as_dvec3());
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let (e1, e2, s) = (p1 - p0, p2 - p0, o - p0);
        let (d_e2, s_e1) = (d.cross(e2), s.cross(e1));
        let (abs_d_e2, abs_s_e1) = (abs_cross(d, e2), abs_cross(s, e1));
        let sum = |cross: DVec3, abs: DVec3, with: DVec3| ProductSum {
            value: cross.dot(with),
            abs: abs.dot(with.abs()),
        };
        Cramer {
            d,
            s,
            e1,
            e2,
            det: sum(d_e2, abs_d_e2, e1),
            t: sum(s_e1, abs_s_e1, e2),
            u: sum(d_e2, abs_d_e2, s),
            v: sum(s_e1, abs_s_e1, d),
        }
    }

    /// The third barycentric's numerator, det − u − v.
    #[inline]
    pub fn w(&self) -> ProductSum {
        ProductSum {
            value: self.det.value - self.u.value - self.v.value,
            abs: self.det.abs + self.u.abs + self.v.abs,
        }
    }

    /// `numerator` / det: t, u, v or w.
    ///
    /// With both errors δ, |n̂/D̂ − n/D| ≤ (δₙ + |n̂/D̂| δ_D) / (|D̂| − δ_D); the division rounds once.
    #[inline]
    pub fn quotient(&self, numerator: ProductSum) -> Quotient {
        let value = numerator.value / self.det.value;
        let room = self.det.value.abs() - ROUNDING * self.det.abs;
        if room.is_nan() || room <= 0.0 {
            return Quotient { value, error: f64::INFINITY };
        }
        let error = ROUNDING * (numerator.abs + value.abs() * self.det.abs) / room;
        Quotient { value, error: error + f64::EPSILON * (error + value.abs()) }
    }

    /// How t compares with `bound`, where rounding leaves no doubt.
    #[inline]
    pub fn compare_t(&self, bound: f64) -> Option<Ordering> {
        // The sign of t − bound is that of (t's numerator − bound·det) times that of det; the
        // product and the difference round once more each, which ROUNDING still has room for.
        let difference = ProductSum {
            value: self.t.value - bound * self.det.value,
            abs: self.t.abs + bound.abs() * self.det.abs,
        };
        Some(flip(difference.sign()?, self.det.sign()?))
    }
}

/// `ordering`, turned round if `sign` is negative.
#[inline]
fn flip(ordering: Ordering, sign: Ordering) -> Ordering {
    if sign == Ordering::Less { ordering.reverse() } else { ordering }
}

/// The cross product with every product made positive, and added.
#[inline]
pub(crate) fn abs_cross(a: DVec3, b: DVec3) -> DVec3 {
    let (a, b) = (a.abs(), b.abs());
    DVec3::new(a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x)
}
