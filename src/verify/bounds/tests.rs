//! Every kernel keeps within its bounds; Embree's are rewritten here, from its source.

use super::*;
use crate::geometry::{Kernel, MollerTrumbore, Plane};
use crate::verify::source;
use glam::Vec3;
use proptest::prelude::*;

/// How a processor computes: with or without fused multiply-add, and how far its estimate of a
/// reciprocal is off.
#[derive(Debug, Clone, Copy)]
struct Machine {
    fused: bool,
    estimate: f32,
}

impl Machine {
    /// a·b + c
    fn madd(self, a: f32, b: f32, c: f32) -> f32 {
        if self.fused { a.mul_add(b, c) } else { a * b + c }
    }

    fn cross(self, a: Vec3, b: Vec3) -> Vec3 {
        Vec3::new(
            self.madd(a.y, b.z, -(a.z * b.y)),
            self.madd(a.z, b.x, -(a.x * b.z)),
            self.madd(a.x, b.y, -(a.y * b.x)),
        )
    }

    fn dot(self, a: Vec3, b: Vec3) -> f32 {
        self.madd(a.x, b.x, self.madd(a.y, b.y, a.z * b.z))
    }

    /// An estimate and one step of Newton's: r·(2 − r·x).
    fn rcp(self, x: f32) -> f32 {
        let r = (1.0 / x) * (1.0 + self.estimate);
        r * self.madd(-r, x, 2.0)
    }

    fn embree_default(self, ray: &Ray, triangle: &Triangle) -> Option<[f32; 3]> {
        let [p0, p1, p2] = triangle.p;
        let (e1, e2) = (p0 - p1, p2 - p0);
        let normal = self.cross(e2, e1);
        let c = p0 - ray.origin;
        let r = self.cross(c, ray.direction);
        let den = self.dot(normal, ray.direction);
        let (abs, sign) = (den.abs(), 1f32.copysign(den));
        let (u, v) = (self.dot(r, e2) * sign, self.dot(r, e1) * sign);
        let t = self.dot(normal, c) * sign;
        let hit = den != 0.0 && u >= 0.0 && v >= 0.0 && u + v <= abs;
        let in_time = abs * ray.t_min < t && t <= abs * ray.t_max;
        let reciprocal = self.rcp(abs);
        (hit && in_time).then_some([t, u, v].map(|x| x * reciprocal))
    }

    fn embree_robust(self, ray: &Ray, triangle: &Triangle) -> Option<[f32; 3]> {
        let [v0, v1, v2] = triangle.p.map(|p| p - ray.origin);
        let (e0, e1, e2) = (v2 - v0, v0 - v1, v1 - v2);
        let u = self.dot(self.cross(e0, v2 + v0), ray.direction);
        let v = self.dot(self.cross(e1, v0 + v1), ray.direction);
        let w = self.dot(self.cross(e2, v1 + v2), ray.direction);
        let uvw = u + v + w;
        let eps = f32::EPSILON * uvw.abs();
        if !(u.min(v).min(w) >= -eps || u.max(v).max(w) <= eps) {
            return None;
        }
        let normal = self.stable_normal(e0, e1, e2);
        let den = 2.0 * self.dot(normal, ray.direction);
        let t = self.rcp(den) * (2.0 * self.dot(v0, normal));
        let reciprocal = if uvw.abs() < 1e-18 { 0.0 } else { self.rcp(uvw) };
        (den != 0.0 && ray.t_min <= t && t <= ray.t_max).then_some([
            t,
            u * reciprocal,
            v * reciprocal,
        ])
    }

    /// Takes each component from that of two cross products whose products are smaller.
    fn stable_normal(self, a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
        let (ab, bc) = (self.cross(a, b), self.cross(b, c));
        let products = |a: Vec3, b: Vec3| Vec3::new(a.z * b.y, a.x * b.z, a.y * b.x).abs();
        Vec3::select(products(a, b).cmplt(products(b, c)), ab, bc)
    }
}

const MACHINES: [Machine; 4] = [
    Machine { fused: true, estimate: 3.6e-4 },
    Machine { fused: true, estimate: -3.6e-4 },
    Machine { fused: false, estimate: 3.6e-4 },
    Machine { fused: false, estimate: 0.0 },
];

fn check(ray: &Ray, triangle: &Triangle) {
    let cramer = Cramer::new(ray, triangle);
    let check = |arithmetic, answer: Option<[f32; 3]>| {
        let bounds = Bounds::new(arithmetic, ray, triangle, &cramer);
        let case = || format!("{}, {}", source::ray(ray), source::triangle(triangle));
        assert!(bounds.allow(ray, answer), "{answer:?} is not {bounds:?}: {}", case());
    };
    let array = |(t, u, v)| [t, u, v];
    check(Arithmetic::MollerTrumbore, MollerTrumbore::intersect(ray, triangle).map(array));
    check(Arithmetic::Plane, Plane::intersect(ray, triangle).map(array));
    // Of a denormal Embree's reciprocal makes NaN or infinity. No bound excuses such a hit.
    let is_number = |answer: &Option<[f32; 3]>| answer.iter().flatten().all(|x| x.is_finite());
    for machine in MACHINES {
        let moeller = Some(machine.embree_default(ray, triangle)).filter(is_number);
        let pluecker = Some(machine.embree_robust(ray, triangle)).filter(is_number);
        moeller.into_iter().for_each(|answer| check(Arithmetic::EmbreeDefault, answer));
        pluecker.into_iter().for_each(|answer| check(Arithmetic::EmbreeRobust, answer));
    }
}

fn point() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(-1f32..1.0).prop_map(Vec3::from_array)
}

/// Somewhere about a triangle, and often exactly on an edge or a vertex.
fn barycentric() -> impl Strategy<Value = f32> {
    prop_oneof![-0.1f32..1.1, Just(0.0), Just(1.0), Just(0.5)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(50_000))]

    #[test]
    fn every_kernel_keeps_within_its_bounds_at_every_size_and_distance(
        shape in prop::array::uniform3(point()), origin in point(), center in point(),
        u in barycentric(), v in barycentric(), flat in 0i32..30,
        sizes in prop::array::uniform3(-12i32..12), scale in prop_oneof![Just(0i32), -45i32..45],
        end in prop_oneof![Just(f32::INFINITY), Just(1.0), 0.5f32..1.5], start in prop_oneof![Just(0.0), Just(1.0f32)],
    ) {
        let [triangle_size, distance, offset] = sizes.map(|power| 2f32.powi(power));
        let scale = 2f32.powi(scale);
        // Flattened towards a plane, so that slivers and grazing rays are among them.
        let flatten = Vec3::new(1.0, 1.0, 2f32.powi(-flat));
        let p = shape.map(|p| (p * flatten * triangle_size + center * offset) * scale);
        let triangle = Triangle { p };
        let origin = (origin * flatten * distance + center * offset) * scale;
        let ray = Ray::new(origin, triangle.at(u, v) - origin);
        check(&Ray { t_min: start, t_max: end, ..ray }, &triangle);
    }
}

#[test]
fn an_ordinary_hit_has_narrow_bounds() {
    // Of the order of the roundings: a few dozen ε.
    let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
    let ray = Ray::new(Vec3::new(0.3, 0.3, 2.0), Vec3::new(0.01, -0.02, -1.0));
    let cramer = Cramer::new(&ray, &triangle);
    for (arithmetic, limit) in [
        (Arithmetic::MollerTrumbore, 40.0),
        (Arithmetic::Plane, 250.0),
        (Arithmetic::EmbreeDefault, 60.0),
        (Arithmetic::EmbreeRobust, 400.0),
    ] {
        let m = Bounds::new(arithmetic, &ray, &triangle, &cramer).kernel;
        for margin in [m.t, m.u, m.v, m.w] {
            assert!(margin > EPS && margin < limit * EPS, "{arithmetic:?}: {m:?}");
        }
    }
}

#[test]
fn beyond_its_bounds_nothing_is_allowed() {
    let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
    let ray = |x: f32, y: f32| Ray::new(Vec3::new(x, y, 2.0), Vec3::NEG_Z);
    for arithmetic in [
        Arithmetic::MollerTrumbore,
        Arithmetic::Plane,
        Arithmetic::EmbreeDefault,
        Arithmetic::EmbreeRobust,
    ] {
        let allow = |ray: Ray, answer| {
            Bounds::new(arithmetic, &ray, &triangle, &Cramer::new(&ray, &triangle))
                .allow(&ray, answer)
        };
        let inside = ray(0.25, 0.25);
        assert!(allow(inside, Some([2.0, 0.25, 0.25])));
        assert!(!allow(inside, None), "a hit inside is not lost");
        assert!(!allow(inside, Some([-2.0, 0.25, 0.25])), "a sign is not rounding");
        assert!(!allow(inside, Some([2.0, 0.25, 0.2501])));
        assert!(!allow(inside, Some([2.0, 0.2501, 0.25])));
        assert!(!allow(inside, Some([2.0001, 0.25, 0.25])));
        assert!(!allow(inside, Some([f32::NAN, 0.25, 0.25])));
        assert!(!allow(ray(0.25, -1e-3), Some([2.0, 0.25, -1e-3])), "beside an edge");
        assert!(!allow(ray(0.75, 0.2501), Some([2.0, 0.75, 0.2501])), "beside the third edge");
        let short = Ray { t_max: 1.999, ..inside };
        assert!(allow(short, None));
        assert!(!allow(short, Some([2.0, 0.25, 0.25])), "behind the end");
        let late = Ray { t_min: 2.001, ..inside };
        assert!(!allow(late, Some([2.0, 0.25, 0.25])), "before the start");
        // Parallel, but clear of the plane: det is zero, and still no kernel may report a hit.
        let parallel = Ray::new(Vec3::new(-1.0, 0.25, 1.0), Vec3::X);
        assert!(allow(parallel, None));
        let excused = arithmetic == Arithmetic::Plane;
        assert_eq!(allow(parallel, Some([1.0, 0.0, 0.25])), excused);
    }
}

#[test]
fn where_f32_overflows_anything_may_come_out() {
    let huge = Triangle::new(Vec3::ZERO, Vec3::X * 1e30, Vec3::Y * 1e30);
    let ray = Ray::new(Vec3::new(1e29, 1e29, 1.0), Vec3::NEG_Z);
    let bounds = Bounds::new(Arithmetic::MollerTrumbore, &ray, &huge, &Cramer::new(&ray, &huge));
    assert!(bounds.allow(&ray, None) && bounds.allow(&ray, Some([7.0, 0.0, 0.0])));
}
