//! Uniform directions towards a triangle.
//!
//! Arvo, *Stratified Sampling of Spherical Triangles*, SIGGRAPH 1995. Two patches that nearly touch
//! exchange light over distances near zero, where 1/r² has no finite variance under sampling by
//! area; sampled by solid angle, the integrand is a cosine.

use glam::DVec3;
use std::f64::consts::PI;

/// A triangle as seen from a point: its projection onto the unit sphere about that point.
pub(super) struct SphericalTriangle {
    a: DVec3,
    b: DVec3,
    c: DVec3,
    /// Interior angle at `a`.
    alpha: f64,
    /// In steradian.
    pub solid_angle: f64,
}

impl SphericalTriangle {
    /// `None` if the point lies in the triangle's plane, so that it is seen edge-on.
    pub(super) fn new(corners: [DVec3; 3], from: DVec3) -> Option<Self> {
        let [a, b, c] = corners.map(|p| (p - from).normalize_or_zero());
        // Van Oosterom & Strackee, IEEE Trans. Biomed. Eng. 30(2), 1983: well conditioned where
        // the sum of angles minus π cancels.
        let volume = a.dot(b.cross(c)).abs();
        let solid_angle = 2.0 * volume.atan2(1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        let (ab, ac) = (a.cross(b), a.cross(c));
        let alpha = ab.cross(ac).length().atan2(ab.dot(ac));
        (solid_angle > 0.0 && alpha > 0.0 && alpha < PI).then_some(SphericalTriangle {
            a,
            b,
            c,
            alpha,
            solid_angle,
        })
    }

    /// The unit direction for (ξ₀, ξ₁) in [0, 1)²; density 1 / `solid_angle`.
    pub(super) fn direction(&self, xi0: f64, xi1: f64) -> DVec3 {
        // The arc from b to a point c' of side ac cuts off the area ξ₀Ω (Arvo, §2, eq. for q̂).
        let (sin_alpha, cos_alpha) = self.alpha.sin_cos();
        let (sin_phi, cos_phi) = (xi0 * self.solid_angle - self.alpha).sin_cos();
        let u = cos_phi - cos_alpha;
        let v = sin_phi + sin_alpha * self.a.dot(self.b);
        let q = ((v * cos_phi - u * sin_phi) * cos_alpha - v)
            / ((v * sin_phi + u * cos_phi) * sin_alpha);
        let c = along_arc(self.a, self.c, q.clamp(-1.0, 1.0));
        // Then a point of that arc, uniform in the area it sweeps.
        along_arc(self.b, c, 1.0 - xi1 * (1.0 - c.dot(self.b)))
    }
}

/// The unit vector in the plane of `from` and `towards` whose cosine to `from` is `cos`.
fn along_arc(from: DVec3, towards: DVec3, cos: f64) -> DVec3 {
    let across = (towards - from * towards.dot(from)).normalize_or_zero();
    from * cos + across * (1.0 - cos * cos).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The octant x, y, z > 0: solid angle π/2.
    fn octant() -> SphericalTriangle {
        SphericalTriangle::new([DVec3::X * 3.0, DVec3::Y, DVec3::Z * 0.2], DVec3::ZERO).unwrap()
    }

    #[test]
    fn an_octant_is_an_eighth_of_the_sphere() {
        assert!((octant().solid_angle - PI / 2.0).abs() < 1e-15);
    }

    #[test]
    fn directions_are_uniform_in_the_octant() {
        // In the octant each of x, y, z is uniform in [0, 1] (Archimedes' hat-box theorem), with
        // mean 1/2 and mean square 1/3. A 200 × 200 grid of midpoints leaves an error of O(1/200²).
        let n = 200;
        let (mut mean, mut square) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..n * n {
            let xi = [i % n, i / n].map(|k| (k as f64 + 0.5) / n as f64);
            let d = octant().direction(xi[0], xi[1]);
            assert!(d.min_element() > -1e-12 && (d.length() - 1.0).abs() < 1e-12);
            mean += d / (n * n) as f64;
            square += d * d / (n * n) as f64;
        }
        assert!((mean - 0.5).abs().max_element() < 1e-4, "{mean}");
        assert!((square - 1.0 / 3.0).abs().max_element() < 1e-4, "{square}");
    }

    #[test]
    fn a_triangle_seen_edge_on_has_no_directions() {
        let corners = [DVec3::X, DVec3::Y, DVec3::X + DVec3::Y];
        assert!(SphericalTriangle::new(corners, DVec3::new(5.0, 3.0, 0.0)).is_none());
        assert!(SphericalTriangle::new(corners, DVec3::X).is_none());
    }

    #[test]
    fn a_tiny_triangle_has_its_area_over_distance_squared() {
        let s = 1e-7;
        let corners = [DVec3::Z, DVec3::Z + DVec3::X * s, DVec3::Z + DVec3::Y * s];
        let seen = SphericalTriangle::new(corners, DVec3::ZERO).unwrap();
        assert!((seen.solid_angle / (0.5 * s * s) - 1.0).abs() < 1e-6);
        let d = seen.direction(0.3, 0.6);
        assert!(d.x > 0.0 && d.y > 0.0 && d.x + d.y < s * (1.0 + 1e-6));
    }
}
