//! The interface that the intersection kernels share.

use super::{Ray, Triangle};

/// Decides whether one ray meets one triangle.
pub trait Kernel: Copy + Default + Send + Sync + 'static {
    /// (t, u, v) with t in the ray's interval, u ≥ 0, v ≥ 0, u + v ≤ 1; or `None`.
    ///
    /// Both sides are hit. A triangle without area is never hit, and a NaN anywhere is a miss.
    fn intersect(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)>;
}

/// The kernels by name, for a choice at run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum, serde::Serialize)]
pub enum KernelKind {
    /// The triangle's plane first
    Plane,
    /// Cramer's rule at once
    #[default]
    MollerTrumbore,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{MollerTrumbore, Plane};
    use crate::verify::{Arithmetic, bounds::Bounds, cramer::Cramer, source};
    use glam::Vec3;
    use proptest::prelude::*;

    /// Panics unless the kernel's answer is the exact one within the bounds derived for it.
    fn check<K: Kernel>(arithmetic: Arithmetic, ray: &Ray, triangle: &Triangle) {
        let bounds = Bounds::new(arithmetic, ray, triangle, &Cramer::new(ray, triangle));
        let answer = K::intersect(ray, triangle).map(|(t, u, v)| [t, u, v]);
        let case = || format!("{}, {}", source::ray(ray), source::triangle(triangle));
        assert!(bounds.allow(ray, answer), "{answer:?} is not {bounds:?}: {}", case());
    }

    fn point() -> impl Strategy<Value = Vec3> {
        (-4f32..4.0, -4f32..4.0, -4f32..4.0).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn both_kernels_agree_with_double_precision_within_derived_bounds(
            p in [point(), point(), point()], origin in point(), u in -0.2f32..1.2, v in -0.2f32..1.2,
        ) {
            let triangle = Triangle { p };
            // Aimed at the triangle's plane in and around the triangle, so that hits are common.
            let ray = Ray::new(origin, triangle.at(u, v) - origin);
            check::<MollerTrumbore>(Arithmetic::MollerTrumbore, &ray, &triangle);
            check::<Plane>(Arithmetic::Plane, &ray, &triangle);
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
