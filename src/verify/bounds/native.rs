//! The rounding of our own kernels.

use super::{ETA, Margins, Rounding, gamma, overflows, positive, underflow};
use crate::geometry::Ray;
use crate::verify::cramer::{Cramer, abs_cross};

impl Rounding {
    /// Cramer's rule; the final quotients take `divisions` roundings.
    ///
    /// A hit that f32 decides has û, v̂ and |det̂| − û − v̂ above their rounding; near the third edge the
    /// numerators' errors and det's add up. Near an edge f64 decides, which is well within these
    /// bounds: they were derived for f32 alone, and stay what the kernel may be forgiven.
    pub(super) fn cramer(cramer: &Cramer, divisions: f64) -> Self {
        if overflows(cramer, 0.0) {
            return Rounding::ANYTHING;
        }
        let eta = underflow(cramer);
        let [det, u, v] = [cramer.det, cramer.u, cramer.v].map(|sum| gamma(7.0) * sum.abs + eta);
        let t = gamma(8.0) * cramer.t.abs + eta;
        let exact_det = cramer.det.value.abs();
        let sum = gamma(1.0) * (cramer.u.value.abs() + cramer.v.value.abs());
        let Some(room) = positive(exact_det - det) else {
            // |û| and |v̂| cannot exceed |det̂|.
            let possible = cramer.u.value.abs() <= exact_det + det + u
                && cramer.v.value.abs() <= exact_det + det + v;
            return Rounding { margins: Margins::INFINITE, possible };
        };
        let quotient = |numerator: f64, error: f64| {
            let value = (numerator / exact_det).abs();
            let before = (error + value * det) / room;
            before + gamma(divisions) * (before + value) + ETA
        };
        Rounding {
            margins: Margins {
                t: quotient(cramer.t.value, t),
                u: quotient(cramer.u.value, u),
                v: quotient(cramer.v.value, v),
                w: (u + v + det + sum) / room,
            },
            possible: true,
        }
    }

    /// Meets the plane first: n = e₁ × e₂, t = n·s / n·d, q = o + t·d − p₀, and u and v from two
    /// coordinates of q.
    ///
    /// n̂ has γ₄ of |e₁|×|e₂|. q̂ carries t's error along d, 3 roundings of t·d, and at most 3 of o and
    /// p₀, |p₀| ≤ |o| + |s|. The numerators of u and v are 2×2 determinants of q and an edge, with 3
    /// roundings beside q's; they are divided by the largest component of n̂.
    pub(super) fn plane(ray: &Ray, cramer: &Cramer) -> Self {
        let Cramer { d, s, e1, e2, .. } = *cramer;
        let o = ray.origin.as_dvec3().abs();
        let det = cramer.det.value.abs();
        let [t, u, v] = [cramer.t, cramer.u, cramer.v].map(|sum| (sum.value / det).abs());
        let reach = d.abs() * t;
        if overflows(cramer, (o + s.abs() + reach).max_element()) {
            return Rounding::ANYTHING;
        }
        let eta = underflow(cramer);
        let det_error = gamma(7.0) * cramer.det.abs + eta;
        let n_abs = abs_cross(e1, e2).max_element();
        let n_error = gamma(4.0) * n_abs + ETA;
        let n = e1.cross(e2).abs().max_element();
        let (Some(room), Some(n_room)) = (positive(det - det_error), positive(n - n_error)) else {
            return Rounding::ANYTHING;
        };
        let t_before = (gamma(8.0) * cramer.t.abs + eta + t * det_error) / room;
        let t_error = t_before + gamma(1.0) * (t_before + t) + ETA;

        let q = e1.abs() * u + e2.abs() * v;
        let q_error = d.abs() * t_error * (1.0 + gamma(3.0)) + (o + s.abs() + reach) * gamma(3.0);
        let (q, q_error) = (q.max_element(), q_error.max_element() + ETA);
        let e = e1.abs().max_element().max(e2.abs().max_element());
        let product = 2.0 * e * (q_error * (1.0 + gamma(3.0)) + gamma(3.0) * q) + ETA;
        let quotient = |value: f64| {
            let before = (product + value * n_error) / n_room;
            before + gamma(1.0) * (before + value) + ETA
        };
        let (u_error, v_error) = (quotient(u), quotient(v));
        let w = u_error + v_error + gamma(1.0) * (u + v + u_error + v_error);
        Rounding { margins: Margins { t: t_error, u: u_error, v: v_error, w }, possible: true }
    }
}
