//! What the two intersection kernels have in common.

use super::{Ray, Triangle};

/// Decides whether one ray meets one triangle.
pub trait Kernel: Copy + Default + Send + Sync + 'static {
    /// (t, u, v) with t in the ray's interval, u ≥ 0, v ≥ 0, u + v ≤ 1; or `None`.
    ///
    /// Both sides are hit. A triangle without area is never hit, and a NaN anywhere is a miss.
    fn intersect(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)>;
}

/// The kernels by name, for a choice at run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum KernelKind {
    /// Option 1, [`Plane`](super::Plane).
    Plane,
    /// Option 2, [`MollerTrumbore`](super::MollerTrumbore).
    #[default]
    MollerTrumbore,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{MollerTrumbore, Plane};
    use glam::{DVec3, Vec3};
    use proptest::prelude::*;

    /// Unit roundoff of f32, and Higham's γₙ (*Accuracy and Stability*, lemma 3.1).
    const EPS: f64 = f32::EPSILON as f64 / 2.0;
    fn gamma(n: f64) -> f64 {
        n * EPS / (1.0 - n * EPS)
    }

    fn abs_cross(a: DVec3, b: DVec3) -> DVec3 {
        let (a, b) = (a.abs(), b.abs());
        DVec3::new(a.y * b.z + a.z * b.y, a.z * b.x + a.x * b.z, a.x * b.y + a.y * b.x)
    }

    /// The same question in double precision, and how far an f32 kernel may stray from it.
    struct Truth {
        t: f64,
        u: f64,
        v: f64,
        /// Bound on a kernel's error in u, v and 1 − u − v.
        edge_error: f64,
        /// Bound on a kernel's error in t.
        t_error: f64,
    }

    /// `None` where the ray is so nearly parallel that even det's sign is undecided.
    fn truth(ray: &Ray, triangle: &Triangle) -> Option<Truth> {
        let [p0, p1, p2] = triangle.p.map(|p| p.as_dvec3());
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let (e1, e2, s) = (p1 - p0, p2 - p0, o - p0);
        let det = d.cross(e2).dot(e1);
        let (t, u, v) =
            (s.cross(e1).dot(e2) / det, d.cross(e2).dot(s) / det, s.cross(e1).dot(d) / det);
        // Each numerator is a sum of six products of three differences: 1 rounding for each of two
        // subtractions, 2 for the products, 3 for the sums: γ₇ of the sum of absolute values.
        let det_error = gamma(7.0) * abs_cross(d, e2).dot(e1.abs());
        let room = det.abs() - det_error;
        if room.is_nan() || room <= 0.0 {
            return None;
        }
        let numerator = |sum: f64| gamma(7.0) * sum;
        let mt_u = (numerator(abs_cross(d, e2).dot(s.abs())) + u.abs() * det_error) / room;
        let mt_v = (numerator(abs_cross(s, e1).dot(d.abs())) + v.abs() * det_error) / room;
        let mt_t = (numerator(abs_cross(s, e1).dot(e2.abs())) + t.abs() * det_error) / room;

        // Plane: n has γ₃ of |e₁|×|e₂|; t = n·s / n·d; the hit point carries t's error along d and
        // its own rounding; u and v divide a 2×2 determinant by the largest component of n.
        let n_abs = abs_cross(e1, e2);
        let n = e1.cross(e2);
        let nd_error = gamma(7.0) * n_abs.dot(d.abs());
        let nd_room = n.dot(d).abs() - nd_error;
        if nd_room.is_nan() || nd_room <= 0.0 {
            return None;
        }
        let plane_t =
            (gamma(7.0) * n_abs.dot(s.abs()) + t.abs() * nd_error) / nd_room + EPS * t.abs();
        let hit_abs = s.abs() + d.abs() * t.abs();
        let hit_error = d.abs() * plane_t * (1.0 + gamma(3.0)) + (hit_abs + o.abs()) * gamma(4.0);
        let n_max = n.abs().max_element();
        let n_room = n_max - gamma(4.0) * n_abs.max_element();
        if n_room <= 0.0 {
            return None;
        }
        let e_max = e1.abs().max_element().max(e2.abs().max_element());
        let product_error = 2.0 * e_max * hit_error.max_element()
            + gamma(6.0) * 2.0 * e_max * hit_abs.max_element();
        let plane_uv =
            (product_error + u.abs().max(v.abs()) * gamma(4.0) * n_abs.max_element()) / n_room;

        let uv = mt_u.max(mt_v).max(plane_uv) + gamma(2.0) * (u.abs() + v.abs());
        Some(Truth {
            t,
            u,
            v,
            edge_error: 2.0 * uv + gamma(2.0),
            t_error: mt_t.max(plane_t) + gamma(2.0) * t.abs(),
        })
    }

    /// Panics unless the kernel's answer is the truth's, or the truth is within its error of an
    /// edge or of the interval's ends.
    fn check<K: Kernel>(name: &str, ray: &Ray, triangle: &Triangle) {
        let answer = K::intersect(ray, triangle);
        let Some(truth) = truth(ray, triangle) else { return };
        let inside = truth.u.min(truth.v).min(1.0 - truth.u - truth.v);
        let in_time = (truth.t - ray.t_min as f64).min(ray.t_max as f64 - truth.t);
        let bits = || {
            format!("{name}: {ray:?} {triangle:?}, truth t {} u {} v {}", truth.t, truth.u, truth.v)
        };
        match answer {
            Some((t, u, v)) => {
                assert!(inside >= -truth.edge_error, "false hit outside: {}", bits());
                assert!(in_time >= -truth.t_error, "false hit out of the interval: {}", bits());
                assert!((t as f64 - truth.t).abs() <= truth.t_error, "t {t}: {}", bits());
                assert!((u as f64 - truth.u).abs() <= truth.edge_error, "u {u}: {}", bits());
                assert!((v as f64 - truth.v).abs() <= truth.edge_error, "v {v}: {}", bits());
            }
            None => assert!(
                inside <= truth.edge_error || in_time <= truth.t_error,
                "missed: {}",
                bits()
            ),
        }
    }

    fn point() -> impl Strategy<Value = Vec3> {
        (-4f32..4.0, -4f32..4.0, -4f32..4.0).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn both_kernels_agree_with_double_precision_but_near_an_edge(
            p in [point(), point(), point()], origin in point(), u in -0.2f32..1.2, v in -0.2f32..1.2,
        ) {
            let triangle = Triangle { p };
            // Aimed at the triangle's plane in and around the triangle, so that hits are common.
            let ray = Ray::new(origin, triangle.at(u, v) - origin);
            check::<MollerTrumbore>("moller-trumbore", &ray, &triangle);
            check::<Plane>("plane", &ray, &triangle);
        }

        #[test]
        fn a_scale_by_a_power_of_two_changes_no_bit(
            p in [point(), point(), point()], origin in point(), u in 0f32..1.0, v in 0f32..1.0,
            power in -8i32..8,
        ) {
            let triangle = Triangle { p };
            let ray = Ray::new(origin, triangle.at(u, v) - origin);
            let s = 2f32.powi(power);
            let scaled = Triangle { p: p.map(|q| q * s) };
            let scaled_ray = Ray::new(origin * s, ray.direction * s);
            prop_assert_eq!(
                MollerTrumbore::intersect(&ray, &triangle),
                MollerTrumbore::intersect(&scaled_ray, &scaled)
            );
            prop_assert_eq!(Plane::intersect(&ray, &triangle), Plane::intersect(&scaled_ray, &scaled));
        }
    }

    fn for_both(check: impl Fn(fn(&Ray, &Triangle) -> Option<(f32, f32, f32)>)) {
        check(MollerTrumbore::intersect);
        check(Plane::intersect);
    }

    const UNIT: Triangle = Triangle { p: [Vec3::ZERO, Vec3::X, Vec3::Y] };

    #[test]
    fn a_known_hit_has_known_coordinates() {
        for_both(|intersect| {
            let ray = Ray::new(Vec3::new(0.25, 0.5, 2.0), Vec3::NEG_Z);
            assert_eq!(intersect(&ray, &UNIT), Some((2.0, 0.25, 0.5)));
            // From behind as well.
            let ray = Ray::new(Vec3::new(0.25, 0.5, -2.0), Vec3::Z);
            assert_eq!(intersect(&ray, &UNIT), Some((2.0, 0.25, 0.5)));
        });
    }

    #[test]
    fn the_interval_is_open_below_and_closed_above() {
        for_both(|intersect| {
            let ray = |t_min, t_max| Ray {
                t_min,
                t_max,
                ..Ray::new(Vec3::new(0.25, 0.5, 2.0), Vec3::NEG_Z)
            };
            assert!(intersect(&ray(2.0, 9.0), &UNIT).is_none());
            assert!(intersect(&ray(0.0, 2.0), &UNIT).is_some());
            assert!(intersect(&ray(0.0, 2.0f32.next_down()), &UNIT).is_none());
        });
    }

    #[test]
    fn a_degenerate_triangle_is_never_hit() {
        let line = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::X * 2.0);
        let point = Triangle { p: [Vec3::ONE; 3] };
        for_both(|intersect| {
            for direction in [Vec3::NEG_Z, Vec3::X, Vec3::new(0.3, -0.2, -1.0)] {
                for target in [Vec3::ZERO, Vec3::X * 0.5, Vec3::ONE] {
                    let ray = Ray::new(target - direction, direction);
                    assert_eq!(intersect(&ray, &line), None);
                    assert_eq!(intersect(&ray, &point), None);
                }
            }
        });
    }

    #[test]
    fn nan_and_infinity_are_misses() {
        for_both(|intersect| {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                    let poison = Vec3::select(axis.cmpeq(Vec3::ONE), Vec3::splat(bad), Vec3::ZERO);
                    let good = Ray::new(Vec3::new(0.25, 0.25, 1.0), Vec3::NEG_Z);
                    assert!(intersect(&good, &UNIT).is_some());
                    let origin = Ray { origin: good.origin + poison, ..good };
                    assert_eq!(intersect(&origin, &UNIT), None, "{origin:?}");
                    let direction = Ray { direction: good.direction + poison, ..good };
                    assert_eq!(intersect(&direction, &UNIT), None, "{direction:?}");
                    let mut broken = UNIT;
                    broken.p[1] += poison;
                    assert_eq!(intersect(&good, &broken), None, "{broken:?}");
                }
            }
        });
    }

    #[test]
    fn a_distance_that_overflows_is_a_miss() {
        // det is about 1e18, but the numerator of t overflows.
        let triangle = Triangle { p: UNIT.p.map(|p| p * 1e18 - Vec3::new(1e17, 1e17, 0.0)) };
        let ray = Ray::new(Vec3::Z * 1e18, Vec3::NEG_Z * 1e-18);
        for_both(|intersect| assert_eq!(intersect(&ray, &triangle), None));
    }

    #[test]
    fn an_integer_grid_is_hit_exactly_and_alike() {
        // Every quantity is a small integer or a ratio of powers of two, so no rounding happens
        // and edges and vertices belong to the triangle.
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0);
        for x in -1..=5 {
            for y in -1..=5 {
                let ray = Ray::new(Vec3::new(x as f32, y as f32, 8.0), Vec3::NEG_Z);
                let expected = (x >= 0 && y >= 0 && x + y <= 4).then_some((
                    8.0,
                    x as f32 / 4.0,
                    y as f32 / 4.0,
                ));
                for_both(|intersect| assert_eq!(intersect(&ray, &triangle), expected));
            }
        }
    }
}
