//! How far the answer of an f32 kernel may lie from the truth: forward error bounds, derived.
//!
//! ε = 2⁻²⁴ is the unit roundoff, γₙ = nε/(1 − nε) bounds n roundings in a row (Higham, *Accuracy
//! and Stability of Numerical Algorithms*, 2nd ed., lemma 3.1), η = 2⁻¹⁴⁹ is the smallest denormal.
//! |a|×|b| stands for the cross product whose products are made positive and added. Fused
//! multiply-adds only leave roundings out, so every bound here holds with them. Denormals must not be
//! flushed to zero (Embree leaves that to the program that calls it).
//!
//! A sum of products in which at most n roundings meet in any product is off by at most γₙ times the
//! sum of the products' absolute values: the `abs` of a `ProductSum`. All
//! kernels but [`Arithmetic::EmbreeRobust`] sum the same six products for each determinant, grouped one way or
//! another: 1 rounding for each difference (o − p₀, e₁, e₂), 1 for each of two products, 1 for the
//! cross product's sum and 2 for the dot product's. So γ₇ for det, u and v, with two differences,
//! and γ₈ for t, with three.
//!
//! For a quotient with δₙ and δ_D as bounds on numerator and denominator,
//! |n̂/D̂ − n/D| ≤ (δₙ + |n/D| δ_D) / (|D| − δ_D). Where δ_D ≥ |D| even the sign of the determinant is
//! undecided in f32 and anything may come out: the bounds are infinite.

use super::cramer::Cramer;
use crate::geometry::{Ray, Triangle};

mod embree;
mod native;
#[cfg(test)]
mod tests;

/// Unit roundoff of f32.
const EPS: f64 = f32::EPSILON as f64 / 2.0;

/// η: the smallest positive f32. A product that underflows is off by half of it.
const ETA: f64 = f32::from_bits(1) as f64;

/// γₙ, and 2⁻²⁰ of it more for the roundings of the bounds themselves, which are taken in f64 at
/// values that are in f64 too: both are off by less than 2⁻²⁵ of the f32 error.
fn gamma(n: f64) -> f64 {
    n * EPS / (1.0 - n * EPS) * (1.0 + 1.0 / (1 << 20) as f64)
}

/// By which f32 arithmetic a triangle was tested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arithmetic {
    /// [`MollerTrumbore`](crate::geometry::MollerTrumbore), scalar or SIMD: the same bits.
    MollerTrumbore,
    /// [`Plane`](crate::geometry::Plane).
    Plane,
    /// Embree's `MoellerTrumboreIntersector` below its fast box test.
    EmbreeDefault,
    /// Embree's `PlueckerIntersector` below its robust box test (`RTC_SCENE_FLAG_ROBUST`).
    EmbreeRobust,
}

impl Arithmetic {
    /// Whether an answered t is always in (`t_min`, `t_max`], as f32 numbers.
    ///
    /// Embree's default kernel compares t·|det| with the ends times |det|, and the robust one takes
    /// t = `t_min` too.
    fn keeps_interval(self) -> bool {
        matches!(self, Arithmetic::MollerTrumbore | Arithmetic::Plane)
    }
}

/// Absolute bounds on the errors of t, u, v and w = 1 − u − v.
#[derive(Debug, Clone, Copy)]
pub struct Margins {
    pub t: f64,
    pub u: f64,
    pub v: f64,
    pub w: f64,
}

impl Margins {
    const INFINITE: Margins =
        Margins { t: f64::INFINITY, u: f64::INFINITY, v: f64::INFINITY, w: f64::INFINITY };
}

/// The answers that one kernel may give about one ray and one triangle.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    arithmetic: Arithmetic,
    /// The exact t, u, v and w, but for f64's rounding. NaN or infinite if the ray is parallel.
    pub t: f64,
    pub u: f64,
    pub v: f64,
    pub w: f64,
    /// Margins of the kernel's numbers.
    pub kernel: Margins,
    /// How near to an edge or an end a hit may be lost: the kernel's margins, and the box test's.
    pub lost: Margins,
    /// Where `kernel` is infinite: whether a hit can be answered at all.
    possible: bool,
}

impl Bounds {
    #[inline]
    pub fn new(arithmetic: Arithmetic, ray: &Ray, triangle: &Triangle, cramer: &Cramer) -> Self {
        let rounding = match arithmetic {
            Arithmetic::MollerTrumbore => Rounding::cramer(cramer, 1.0),
            Arithmetic::Plane => Rounding::plane(ray, cramer),
            Arithmetic::EmbreeDefault => Rounding::embree_default(cramer),
            Arithmetic::EmbreeRobust => Rounding::embree_robust(cramer),
        };
        let lost = match arithmetic {
            Arithmetic::EmbreeDefault => rounding.margins.with_box_test(ray, triangle, cramer),
            _ => rounding.margins,
        };
        let det = cramer.det.value;
        let [t, u, v, w] = [cramer.t, cramer.u, cramer.v, cramer.w()].map(|sum| sum.value / det);
        Bounds {
            arithmetic,
            t,
            u,
            v,
            w,
            kernel: rounding.margins,
            lost,
            possible: rounding.possible,
        }
    }

    /// Whether the kernel may fail to report this triangle: an edge or an end of the interval is
    /// within the bounds, or the triangle is beyond them.
    pub fn may_miss(&self, ray: &Ray) -> bool {
        let m = &self.lost;
        let surely_hit = self.u > m.u
            && self.v > m.v
            && self.w > m.w
            && self.t - ray.t_min as f64 > m.t
            && ray.t_max as f64 - self.t > m.t;
        !surely_hit
    }

    /// Whether the kernel may report this triangle.
    pub fn may_hit(&self, ray: &Ray) -> bool {
        let m = &self.kernel;
        let surely_missed = self.u < -m.u
            || self.v < -m.v
            || self.w < -m.w
            || self.t - (ray.t_min as f64) < -m.t
            || ray.t_max as f64 - self.t < -m.t;
        self.possible && !surely_missed
    }

    /// Whether the numbers of a hit are the exact ones within the bounds.
    #[inline]
    pub fn accept(&self, ray: &Ray, [t, u, v]: [f32; 3]) -> bool {
        let m = &self.kernel;
        let near = |answer: f32, exact: f64, margin: f64| {
            answer.is_finite() && (margin.is_infinite() || (answer as f64 - exact).abs() <= margin)
        };
        near(t, self.t, m.t)
            && near(u, self.u, m.u)
            && near(v, self.v, m.v)
            && (!self.arithmetic.keeps_interval() || (t > ray.t_min && t <= ray.t_max))
    }

    /// Whether this may be the kernel's answer.
    #[inline]
    pub fn allow(&self, ray: &Ray, answer: Option<[f32; 3]>) -> bool {
        match answer {
            Some(numbers) => self.may_hit(ray) && self.accept(ray, numbers),
            None => self.may_miss(ray),
        }
    }
}

/// The kernels' margins; one function for each kernel, in [`native`] and [`embree`].
struct Rounding {
    margins: Margins,
    possible: bool,
}

impl Rounding {
    const ANYTHING: Rounding = Rounding { margins: Margins::INFINITE, possible: true };
}

/// The error that underflow adds to a determinant: η for each component of a cross product, times the
/// vector that it is multiplied with (any of the four, to cover every grouping), and η/2 for each of
/// three products of the dot product.
fn underflow(cramer: &Cramer) -> f64 {
    let sum = cramer.d.abs() + cramer.s.abs() + cramer.e1.abs() + cramer.e2.abs();
    ETA * (sum.element_sum() + 2.0) * (1.0 + gamma(8.0))
}

/// Whether an intermediate result, or one `further` number, may leave f32's range.
fn overflows(cramer: &Cramer, further: f64) -> bool {
    let [d, s, e1, e2] = [cramer.d, cramer.s, cramer.e1, cramer.e2].map(|x| x.abs().max_element());
    let e = 2.0 * e1.max(e2);
    // A cross product's component has two products, a dot product three of those.
    let pairs = 2.0 * d.max(e).max(s) * e.max(s);
    let triples = 6.0 * (d.max(s) * e * e.max(s));
    let largest = pairs.max(triples).max(d).max(further);
    largest.is_nan() || largest >= f32::MAX as f64 / 2.0
}

fn positive(room: f64) -> Option<f64> {
    (room > 0.0).then_some(room)
}
