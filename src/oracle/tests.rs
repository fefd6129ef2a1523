//! Known hits first, then Embree against brute force, ray by ray.
//!
//! The folder's tests are clean under valgrind's memcheck (3.19, Embree 4.3.3), run on the binary
//! of `cargo test --features embree --lib --no-run` as
//! `valgrind --leak-check=full --error-exitcode=9 BINARY --test-threads=1 oracle::`. Its virtual
//! processor has no AVX-512, so Embree traces with AVX2 there. Only where memory is refused,
//! Embree itself loses a reference to its device: its buffer's constructor counts it before it
//! asks for memory. So `--skip running_out --skip denormals` belongs to a check for leaks.

use super::layout::{RTCHit, RTCRayHit};
use super::*;
use crate::geometry::{BruteForce, Hit, MollerTrumbore, Ray, RayCaster, Triangle, TriangleId};
use crate::sampling::{PointSet, Purpose, Stream, uniform_triangle};
use glam::Vec3;

const PACKETS: [Packets; 4] =
    [Packets::Single, Packets::Packet4, Packets::Packet8, Packets::Packet16];

/// Both kernels with every packet width, over one scene.
fn every_way(triangles: &[Triangle]) -> Vec<EmbreeScene> {
    let device = Device::new("").unwrap();
    let scene = |robust| {
        let options = Options { robust, packets: Packets::Single };
        EmbreeScene::build(&device, triangles, options).unwrap()
    };
    let scenes = [scene(false), scene(true)];
    scenes.iter().flat_map(|scene| PACKETS.map(|packets| scene.with_packets(packets))).collect()
}

fn nearest(scene: &EmbreeScene, rays: &[Ray]) -> Vec<Option<Hit>> {
    let mut hits = vec![None; 3];
    scene.nearest_batch(rays, &mut hits);
    assert_eq!(hits.len(), rays.len());
    hits
}

/// The corners (0, 0), (1, 0) and (0, 1) at height `z`, seen from below.
fn corner(z: f32) -> Triangle {
    Triangle::new(Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z))
}

/// Upwards from below the point (1/4, 1/2): where u = 1/4 and v = 1/2.
fn upwards() -> Ray {
    Ray::new(Vec3::new(0.25, 0.5, 0.0), Vec3::Z)
}

/// Embree multiplies by an approximate reciprocal, which differs between processors: an estimate
/// of 12 bits and one Newton step, within 2 ulp, and the product's rounding. So even where t, u
/// and v are small powers of two, Embree's may be off by 3 ulp, which is at most 6 ε of them.
const ROUNDING: f32 = 3.0 * f32::EPSILON;

fn assert_hit(hit: Option<Hit>, triangle: u32, [t, u, v]: [f32; 3], scene: &EmbreeScene) {
    let hit = hit.unwrap_or_else(|| panic!("a miss with {:?}", scene.options()));
    assert_eq!(hit.triangle, TriangleId(triangle), "{hit:?}, {:?}", scene.options());
    for (value, expected) in [(hit.t, t), (hit.u, u), (hit.v, v)] {
        let off = (value - expected).abs();
        assert!(off <= expected * ROUNDING, "{hit:?}, {:?}", scene.options());
    }
}

/// The nearest hit, on whose presence single and batched, nearest and occluded must agree.
fn both_forms(scene: &EmbreeScene, ray: Ray) -> Option<Hit> {
    let mut blocked = Vec::new();
    scene.occluded_batch(&[ray], &mut blocked);
    let hit = nearest(scene, &[ray])[0];
    for answer in [scene.nearest(&ray).is_some(), scene.occluded(&ray), blocked[0]] {
        assert_eq!(answer, hit.is_some(), "{:?}, {ray:?}", scene.options());
    }
    hit
}

#[test]
fn the_nearest_of_two_triangles_is_hit_where_it_is() {
    for scene in every_way(&[corner(4.0), corner(2.0)]) {
        assert_hit(both_forms(&scene, upwards()), 1, [2.0, 0.25, 0.5], &scene);
        // t counts multiples of the direction, and a back face is hit as well as a front.
        let down = Ray::new(Vec3::new(0.25, 0.5, 8.0), Vec3::NEG_Z * 2.0);
        assert_hit(both_forms(&scene, down), 0, [2.0, 0.25, 0.5], &scene);
        assert_eq!(both_forms(&scene, Ray { origin: Vec3::X * 2.0, ..down }), None);
    }
}

#[test]
fn the_interval_excludes_its_start_and_includes_its_end() {
    for scene in every_way(&[corner(2.0)]) {
        let hits = |t_min: f32, t_max: f32| {
            both_forms(&scene, Ray { t_min, t_max, ..upwards() }).is_some()
        };
        // The default kernel compares without dividing, and so exactly; the robust one does not.
        let robust = scene.options().robust;
        let (before, after) = match robust {
            true => (2.0 - 2.0 * ROUNDING, 2.0 + 2.0 * ROUNDING),
            false => (2.0f32.next_down(), 2.0),
        };
        assert!(hits(0.0, after) && hits(before, after), "{:?}", scene.options());
        assert!(!hits(0.0, before) && !hits(after, 3.0), "{:?}", scene.options());
        assert!(!hits(2.0, 2.0) && !hits(3.0, 1.0), "{:?}", scene.options());
        assert!(hits(-1.0, after) && !hits(-2.0, -1.0), "{:?}", scene.options());
        assert!(hits(f32::NEG_INFINITY, f32::INFINITY), "{:?}", scene.options());
        // Starting on the triangle, where t is exactly 0.
        let leaving = Ray { origin: Vec3::new(0.25, 0.5, 2.0), ..upwards() };
        assert_eq!(both_forms(&scene, leaving), None, "{:?}", scene.options());
    }
}

#[test]
fn triangles_are_numbered_in_the_order_in_which_they_were_added() {
    let device = Device::new("").unwrap();
    let scene = SceneBuilder::new(&device, Options::default())
        .and_then(|scene| scene.add_triangles(&[corner(4.0), corner(3.0)]))
        .and_then(|scene| scene.add_triangles(&[]))
        .and_then(|scene| scene.add_triangles(&[corner(5.0), corner(2.0)]))
        .and_then(|scene| scene.commit())
        .unwrap();
    for packets in PACKETS {
        let hit = both_forms(&scene.with_packets(packets), upwards()).unwrap();
        assert_eq!(hit.triangle, TriangleId(3));
    }
}

#[test]
fn nan_and_infinite_rays_hit_nothing_and_leave_their_neighbours_alone() {
    for scene in every_way(&[corner(2.0)]) {
        let mut rays = Vec::new();
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                let spoil = |v: Vec3| Vec3::select(axis.cmpgt(Vec3::ZERO), Vec3::splat(bad), v);
                rays.push(Ray { origin: spoil(upwards().origin), ..upwards() });
                rays.push(Ray { direction: spoil(upwards().direction), ..upwards() });
            }
        }
        rays.push(Ray { t_min: f32::NAN, ..upwards() });
        rays.push(Ray { t_max: f32::NAN, ..upwards() });
        rays.push(Ray { direction: Vec3::ZERO, ..upwards() });
        for &ray in &rays {
            assert_eq!(both_forms(&scene, ray), None, "{:?}", scene.options());
        }
        let mixed: Vec<Ray> = rays.iter().flat_map(|&ray| [ray, upwards()]).collect();
        for pair in nearest(&scene, &mixed).chunks(2) {
            assert!(pair[0].is_none() && pair[1].is_some(), "{:?}", scene.options());
        }
    }
}

#[test]
fn rays_at_the_ends_of_the_number_range_are_answered() {
    for scene in every_way(&[corner(2.0), corner(1e18)]) {
        for scale in [1e-45, 1e-38, 1e-20, 1e20, f32::MAX] {
            for direction in [Vec3::Z, Vec3::ONE, Vec3::NEG_Z, Vec3::new(-0.0, 1.0, 1e-7)] {
                for origin in [upwards().origin, upwards().origin * scale, Vec3::splat(scale)] {
                    nearest(&scene, &[Ray::new(origin, direction * scale)]);
                }
            }
        }
    }
}

#[test]
fn batches_of_every_length_are_answered_in_order() {
    for scene in every_way(&[corner(2.0)]) {
        for length in 0..=33 {
            let miss = Ray { origin: Vec3::X * 2.0, ..upwards() };
            let hit = |i: usize| i.is_multiple_of(3) || i.is_multiple_of(7);
            let rays: Vec<Ray> =
                (0..length).map(|i| if hit(i) { upwards() } else { miss }).collect();
            let mut blocked = vec![true; 5];
            scene.occluded_batch(&rays, &mut blocked);
            let expected: Vec<bool> = (0..length).map(hit).collect();
            assert_eq!(blocked, expected, "{:?}", scene.options());
            let hits = nearest(&scene, &rays);
            assert!(hits.iter().map(Option::is_some).eq(expected), "{:?}", scene.options());
        }
    }
}

#[test]
fn one_scene_answers_many_threads_alike() {
    let triangles = soup(200, 3);
    let rays = rays(500, 3, &triangles);
    for scene in every_way(&triangles) {
        let expected = nearest(&scene, &rays);
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(|| nearest(&scene, &rays))).collect();
            for thread in threads {
                assert_eq!(thread.join().unwrap(), expected);
            }
        });
    }
}

/// With the 80 bytes of `embree4_sys::RTCRayHit`, what follows them is overwritten.
#[test]
fn a_query_writes_nothing_beyond_its_end() {
    #[repr(C)]
    struct Guarded {
        query: RTCRayHit,
        canary: [u32; 16],
    }
    let scene = &every_way(&[corner(2.0)])[0];
    let hit = RTCHit { geomID: u32::MAX, ..RTCHit::default() };
    let query = RTCRayHit { ray: scene.embree_ray(&upwards()).unwrap(), hit };
    let mut guarded = Guarded { query, canary: [0x5EED_CAFE; 16] };
    // SAFETY: as in `EmbreeScene::nearest`; the pointer may reach the canary too, so even a write
    // that this test is to catch stays within memory of ours.
    unsafe {
        let query = (&raw mut guarded).cast();
        embree4_sys::rtcIntersect1(scene.handle(), query, std::ptr::null_mut());
    }
    assert_eq!((guarded.query.hit.primID, guarded.query.hit.geomID), (0, 0), "it must hit");
    assert_eq!(guarded.canary, [0x5EED_CAFE; 16]);
}

#[test]
fn embree_and_brute_force_agree_up_to_rounding() {
    for (count, seed) in [(1, 1), (20, 2), (1000, 3)] {
        let triangles = soup(count, seed);
        let rays = rays(4000, seed, &triangles);
        let brute = BruteForce::<MollerTrumbore>::new(&triangles);
        let expected: Vec<_> = rays.iter().map(|ray| brute.nearest(ray)).collect();
        assert!(expected.iter().flatten().count() > 1000, "the rays must hit something");
        for scene in every_way(&triangles) {
            let mut blocked = Vec::new();
            scene.occluded_batch(&rays, &mut blocked);
            let mut close = 0;
            for (i, (ray, answer)) in rays.iter().zip(nearest(&scene, &rays)).enumerate() {
                let what = || format!("seed {seed}, ray {i}, {:?}: {ray:?}", scene.options());
                close += usize::from(compare(&triangles, ray, answer, expected[i], &what));
                for any in [scene.occluded(ray), blocked[i]] {
                    let any = any.then(|| answer.or(expected[i])).flatten();
                    compare_presence(&triangles, ray, any, expected[i], &what);
                }
            }
            assert!(close < rays.len() / 100, "{close} close calls, {:?}", scene.options());
        }
    }
}

/// Triangles of moderate shape and size in the cube from −2 to 2.
fn soup(count: u32, seed: u64) -> Vec<Triangle> {
    let stream = Stream::new(seed, Purpose::Pair, 0, PointSet::Random);
    let vector = |i: u32| {
        let [x, y, z, _] = stream.point(i);
        Vec3::new(x, y, z) * 2.0 - 1.0
    };
    (0..)
        .map(|i| vector(4 * i))
        .zip((0..).map(|i| (vector(4 * i + 1), vector(4 * i + 2))))
        .map(|(p, (e1, e2))| Triangle::new(p, p + e1, p + e2))
        .filter(|triangle| least_height(triangle) > 0.05)
        .take(count as usize)
        .collect()
}

/// From anywhere in the cube towards a point of some triangle; one in three ends on the way.
fn rays(count: u32, seed: u64, triangles: &[Triangle]) -> Vec<Ray> {
    let stream = Stream::new(seed, Purpose::Pixel, 1, PointSet::Random);
    (0..count)
        .map(|i| {
            let [x, y, z, w] = stream.point(2 * i);
            let [xi0, xi1, pick, _] = stream.point(2 * i + 1);
            let triangle = &triangles[(pick * triangles.len() as f32) as usize];
            let [_, u, v] = uniform_triangle(xi0, xi1);
            let origin = Vec3::new(x, y, z) * 4.0 - 2.0;
            let t_max = if i % 3 == 0 { 2.0 * w } else { f32::INFINITY };
            Ray { t_max, ..Ray::new(origin, triangle.at(u, v) - origin) }
        })
        .collect()
}

fn least_height(triangle: &Triangle) -> f64 {
    triangle.double_area_normal().length() / triangle.longest_edge()
}

/// Where a ray meets a triangle's plane in f64, and how far f32 may be off.
struct Reference {
    t: f64,
    t_error: f64,
    /// The smallest of u, v and 1 − u − v: negative outside.
    inside: f64,
    uv: [f64; 2],
    uv_error: f64,
}

/// Coordinates are at most 4 in size, and each step of a kernel rounds distances of at most 8 by
/// ε = 2⁻²⁴ of them. Some 16 such steps lie between the input and the distance to the plane, so
/// the point found is off by at most 128 ε, divided by the cosine at which the ray meets the
/// plane; along the ray that makes t, and across the triangle, divided by its least height, u
/// and v. Twice that, since Embree's reciprocal is approximate.
fn reference(triangle: &Triangle, ray: &Ray) -> Reference {
    let [p0, p1, p2] = triangle.p.map(|p| p.as_dvec3());
    let (e1, e2) = (p1 - p0, p2 - p0);
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let normal = e1.cross(e2);
    let along = direction.dot(normal);
    let t = (p0 - origin).dot(normal) / along;
    let q = origin + direction * t - p0;
    let square = normal.length_squared();
    let (u, v) = (q.cross(e2).dot(normal) / square, e1.cross(q).dot(normal) / square);
    let cosine = along.abs() / (direction.length() * normal.length());
    let off = 2.0 * 128.0 * 2f64.powi(-24) / cosine;
    let (t_error, uv_error) = (off / direction.length(), off / least_height(triangle));
    Reference { t, t_error, inside: u.min(v).min(1.0 - u - v), uv: [u, v], uv_error }
}

/// Whether `answer` and `expected` differ, as they may only by rounding; panics if they may not.
fn compare(
    triangles: &[Triangle],
    ray: &Ray,
    answer: Option<Hit>,
    expected: Option<Hit>,
    what: &dyn Fn() -> String,
) -> bool {
    for hit in answer.iter().chain(&expected) {
        let exact = reference(&triangles[hit.triangle.index()], ray);
        assert!((hit.t as f64 - exact.t).abs() <= exact.t_error, "{hit:?}, {}", what());
        for (value, exact_value) in [hit.u, hit.v].into_iter().zip(exact.uv) {
            assert!((value as f64 - exact_value).abs() <= exact.uv_error, "{hit:?}, {}", what());
        }
    }
    if answer.map(|hit| hit.triangle) == expected.map(|hit| hit.triangle) {
        return false;
    }
    let tie = answer.zip(expected).is_some_and(|(a, b)| {
        let error = |hit: Hit| reference(&triangles[hit.triangle.index()], ray).t_error;
        ((a.t - b.t) as f64).abs() <= error(a) + error(b)
    });
    let close = [answer, expected].into_iter().flatten().any(|hit| is_close(triangles, ray, hit));
    assert!(tie || close, "{answer:?} for {expected:?}, {}", what());
    true
}

/// Whether rounding may turn the hit into a miss: near an edge, or near an end of the interval.
fn is_close(triangles: &[Triangle], ray: &Ray, hit: Hit) -> bool {
    let exact = reference(&triangles[hit.triangle.index()], ray);
    let to_end = (exact.t - ray.t_max as f64).abs().min((exact.t - ray.t_min as f64).abs());
    exact.inside.abs() <= exact.uv_error || to_end <= exact.t_error
}

/// Whether something is hit may differ only where rounding may turn a hit into a miss.
fn compare_presence(
    triangles: &[Triangle],
    ray: &Ray,
    answer: Option<Hit>,
    expected: Option<Hit>,
    what: &dyn Fn() -> String,
) {
    if answer.is_some() != expected.is_some() {
        let close =
            [answer, expected].into_iter().flatten().any(|hit| is_close(triangles, ray, hit));
        assert!(close, "{answer:?} for {expected:?}, {}", what());
    }
}
