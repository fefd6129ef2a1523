//! The rounding of Embree 4's kernels, as in its `kernels/geometry/triangle_intersector_moeller.h`
//! and `triangle_intersector_pluecker.h`.

use super::{ETA, Margins, Rounding, gamma, overflows, positive, underflow};
use crate::geometry::{Ray, Triangle};
use crate::verify::cramer::{Cramer, abs_cross};
use glam::DVec3;

impl Rounding {
    /// Cramer's rule with an approximate reciprocal of |det|.
    ///
    /// `rcpps` is within 1.5·2⁻¹² (`rcp14` within 2⁻¹⁴); one Newton step squares that to 2.25 ε, and
    /// its three roundings without and two with fused multiply-add make less than 6 ε; the product
    /// rounds once more: γ₇ would do, γ₈ is taken. The reciprocals of denormals overflow and those of
    /// numbers above 2¹²⁶ are denormal: there, anything may come out.
    pub(super) fn embree_default(cramer: &Cramer) -> Self {
        let det = cramer.det.value.abs();
        if !(2f64.powi(-125)..2f64.powi(125)).contains(&det) {
            return Rounding { margins: Margins::INFINITE, ..Rounding::cramer(cramer, 8.0) };
        }
        Rounding::cramer(cramer, 8.0)
    }

    /// Plücker coordinates relative to the ray's origin, vᵢ = pᵢ − o (1 rounding):
    ///
    /// ```text
    /// U = ((v₂ − v₀) × (v₂ + v₀))·d, likewise V and W;   u = U / (U + V + W);
    /// t = n·v₀ / n·d with n the cross product of two of the edges vᵢ − vⱼ.
    /// ```
    ///
    /// Let |V| hold, per axis, twice the largest |vᵢ|, and |E| the largest |vᵢ − vⱼ|. An edge is off by
    /// ε|V| (its vertices were rounded) and ε|E|, so U by γ₂ of |V|×|V|·|d| for the first and γ₉ of
    /// |E|×|V|·|d| for everything else (1 for the edge, 2 for the sum, 5 for products and sums, 1 to
    /// spare). U + V + W rounds twice, and is 2 det. n is off by γ₂ of |V|×|E| and γ₄ of |E|×|E|; the
    /// dot products add 3 roundings, and 1 for v₀. A hit is accepted up to 2ε|U + V + W| outside an
    /// edge. Both quotients use Embree's reciprocal (see `embree_default`); where |U + V + W| < 10⁻¹⁸,
    /// u and v are answered as zero.
    pub(super) fn embree_robust(cramer: &Cramer) -> Self {
        let Cramer { d, s, e1, e2, .. } = *cramer;
        let (d, v0) = (d.abs(), s.abs());
        let v = 2.0 * v0.max((e1 - s).abs()).max((e2 - s).abs());
        let e = e1.abs().max(e2.abs()).max((e2 - e1).abs());
        let (v_v, e_v, e_e) = (abs_cross(v, v), abs_cross(e, v), abs_cross(e, e));
        let eta = 4.0 * (underflow(cramer) + ETA * v.element_sum());
        let largest = v_v.max_element() * d.max_element().max(v.max_element());
        if overflows(cramer, v_v.max_element().max(6.0 * largest)) {
            return Rounding::ANYTHING;
        }

        // The edges, and their sum.
        let edge = (v_v * gamma(2.0) + e_v * gamma(9.0)).dot(d) + eta;
        let det = 2.0 * cramer.det.value.abs();
        let values = [cramer.u, cramer.v, cramer.w()].map(|sum| 2.0 * sum.value);
        let abs: f64 = values.iter().map(|value| value.abs()).sum();
        let sum_error = 3.0 * edge + gamma(2.0) * (abs + 3.0 * edge);

        // The plane.
        let den_error = 2.0 * ((e_v * gamma(5.0) + e_e * gamma(7.0)).dot(d) + eta);
        let t_numerator = 2.0 * ((e_v * gamma(6.0) + e_e * gamma(8.0)).dot(v0) + eta);

        // The quotients.
        let rooms = (positive(det - sum_error), positive(det - den_error));
        let (Some(room), Some(den_room)) = rooms else {
            // Edges of surely opposite signs are never a hit.
            let accepted = edge + 2.0 * gamma(1.0) * (det + sum_error);
            let possible =
                !(values.iter().any(|&x| x > accepted) && values.iter().any(|&x| x < -accepted));
            return Rounding { margins: Margins::INFINITE, possible };
        };
        let reciprocal = |before: f64, value: f64| before + gamma(8.0) * (before + value) + ETA;
        let barycentric = |value: f64| {
            let share = value.abs() / det;
            reciprocal((edge + share * sum_error) / room, share) + 2.0 * gamma(1.0)
        };
        let t = (cramer.t.value / cramer.det.value).abs();
        let has_reciprocal =
            (1.0001e-18..2f64.powi(125)).contains(&(det - sum_error.max(den_error)));
        let margins = Margins {
            t: reciprocal((t_numerator + t * den_error) / den_room, t),
            u: barycentric(values[0]),
            v: barycentric(values[1]),
            w: barycentric(values[2]),
        };
        Rounding {
            margins: if has_reciprocal { margins } else { Margins::INFINITE },
            possible: true,
        }
    }
}

impl Margins {
    /// Embree's fast box test takes (plane·d⁻¹ − o·d⁻¹), d⁻¹ within 6 ε: where a ray crosses a plane is
    /// off by γ₈ (|plane| + |o|) / |d|, as if the origin had moved by γ₈ (|plane| + |o|) along that axis.
    ///
    /// So a box is lost only if the ray, moved by h, misses it, and with it the triangle. A plane
    /// beyond 2|p| + |o| is too far from the hit to be crossed by such a move; so h = 2γ₈ (|p| + |o|)
    /// will do, whatever box it was. Moving the origin changes u by (d × e₂)·h / det, and so on.
    pub(super) fn with_box_test(self, ray: &Ray, triangle: &Triangle, cramer: &Cramer) -> Margins {
        let [p0, p1, p2] = triangle.p.map(|p| p.as_dvec3().abs());
        let h = (p0.max(p1).max(p2) + ray.origin.as_dvec3().abs()) * (2.0 * gamma(8.0));
        let Cramer { d, e1, e2, .. } = *cramer;
        let moved = |gradient: DVec3| gradient.abs().dot(h) / cramer.det.value.abs();
        let (u, v) = (moved(d.cross(e2)), moved(d.cross(e1)));
        Margins { t: self.t + moved(e1.cross(e2)), u: self.u + u, v: self.v + v, w: self.w + u + v }
    }
}
