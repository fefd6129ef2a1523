use super::*;
use crate::geometry::moller_trumbore::determinants;
use crate::geometry::{BruteForce, Kernel, MollerTrumbore, Plane, RayCaster};
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::{Material, MaterialId, Scene};
use crate::verify::contact::{Contact, Miss};
use glam::Vec3;

/// A unit square of two triangles at z = 0, and one large triangle behind it at z = −1.
fn scene() -> Vec<Triangle> {
    let (x, y) = (Vec3::X, Vec3::Y);
    let behind = Vec3::new(-9.0, -9.0, -1.0);
    vec![
        Triangle::new(Vec3::ZERO, x, x + y),
        Triangle::new(Vec3::ZERO, x + y, y),
        Triangle::new(behind, behind + x * 40.0, behind + y * 40.0),
    ]
}

fn down(x: f32, y: f32) -> Ray {
    Ray::new(Vec3::new(x, y, 2.0), Vec3::NEG_Z)
}

fn judge(triangles: &[Triangle]) -> Judge<'_> {
    Judge::new(triangles, Arithmetic::MollerTrumbore, Arithmetic::EmbreeDefault)
}

/// Our kernel's answer if there were only this triangle.
fn hit(triangles: &[Triangle], ray: &Ray, index: usize) -> Option<Hit> {
    let hit = BruteForce::<MollerTrumbore>::new(&triangles[index..=index]).nearest(ray);
    hit.map(|hit| Hit { triangle: TriangleId(index as u32), ..hit })
}

/// The verdict by the cheap path, which must be that of the full one.
fn verdict(triangles: &[Triangle], ray: &Ray, native: Option<Hit>, other: Option<Hit>) -> Verdict {
    let judge = judge(triangles);
    let full = judge.settle_nearest(ray, native, other);
    assert_eq!(judge.nearest(ray, native, other).verdict, full.verdict);
    full.verdict
}

#[test]
fn right_answers_agree() {
    let scene = scene();
    let ray = down(0.5, 0.25);
    let right = hit(&scene, &ray, 0);
    assert_eq!(verdict(&scene, &ray, right, right), Verdict::Agree);
    let beside = down(100.0, 100.0);
    assert_eq!(verdict(&scene, &beside, None, None), Verdict::Agree);
    assert_eq!(judge(&scene).nearest_alone(&ray, right).verdict, Verdict::Agree);
    assert_eq!(judge(&scene).nearest_alone(&beside, None).verdict, Verdict::Agree);
}

#[test]
fn a_hit_that_is_dropped_is_wrong() {
    let scene = scene();
    let ray = down(0.5, 0.25);
    let right = hit(&scene, &ray, 0);
    assert_eq!(verdict(&scene, &ray, None, right), Verdict::NativeWrong);
    assert_eq!(verdict(&scene, &ray, right, None), Verdict::PeerWrong);
    let judgement = judge(&scene).nearest_alone(&ray, None);
    assert_eq!(judgement.verdict, Verdict::NativeWrong);
    assert_eq!(judgement.counterexample, Some(TriangleId(0)));
}

#[test]
fn agreeing_on_what_is_wrong_is_found_by_settling() {
    let scene = scene();
    let ray = down(0.5, 0.25);
    let judge = judge(&scene);
    assert_eq!(judge.nearest(&ray, None, None).verdict, Verdict::Agree);
    assert_eq!(judge.settle_nearest(&ray, None, None).verdict, Verdict::BothWrong);
    let far = hit(&scene, &ray, 2);
    assert_eq!(judge.settle_nearest(&ray, far, far).verdict, Verdict::BothWrong);
    assert_eq!(judge.settle_occluded(&ray, false, false).verdict, Verdict::BothWrong);
}

#[test]
fn a_farther_triangle_is_wrong_and_the_nearer_one_is_the_counterexample() {
    let scene = scene();
    let ray = down(0.5, 0.25);
    let (near, far) = (hit(&scene, &ray, 0), hit(&scene, &ray, 2));
    assert_eq!(verdict(&scene, &ray, far, near), Verdict::NativeWrong);
    assert_eq!(verdict(&scene, &ray, near, far), Verdict::PeerWrong);
    let judgement = judge(&scene).nearest_alone(&ray, far);
    assert_eq!(judgement.verdict, Verdict::NativeWrong);
    assert_eq!(judgement.counterexample, Some(TriangleId(0)));
}

#[test]
fn numbers_beyond_their_bounds_are_wrong() {
    let scene = scene();
    let ray = down(0.5, 0.125);
    let right = hit(&scene, &ray, 0).unwrap();
    for wrong in [
        Hit { t: 2.0001, ..right },
        Hit { t: -2.0, ..right },
        Hit { u: 0.251, ..right },
        Hit { v: 0.251, ..right },
        Hit { u: right.v, v: right.u, ..right },
        Hit { t: f32::NAN, ..right },
        Hit { triangle: TriangleId(1), ..right },
        Hit { triangle: TriangleId(77), ..right },
    ] {
        assert_eq!(
            verdict(&scene, &ray, Some(wrong), Some(right)),
            Verdict::NativeWrong,
            "{wrong:?}"
        );
        assert_eq!(
            verdict(&scene, &ray, Some(right), Some(wrong)),
            Verdict::PeerWrong,
            "{wrong:?}"
        );
    }
    let rounded = Hit { t: right.t.next_up(), ..right };
    assert_eq!(verdict(&scene, &ray, Some(rounded), Some(right)), Verdict::Agree);
}

#[test]
fn a_shared_edge_is_a_tie() {
    let scene = scene();
    let ray = down(0.5, 0.5);
    let (a, b) = (hit(&scene, &ray, 0), hit(&scene, &ray, 1));
    assert!(a.is_some() && b.is_some());
    assert_eq!(verdict(&scene, &ray, a, b), Verdict::Tie);
    assert_eq!(verdict(&scene, &ray, a, a), Verdict::Agree);
    // A copy is at the same distance everywhere.
    let twice = [scene[0], scene[0]];
    let ray = down(0.5, 0.25);
    assert_eq!(verdict(&twice, &ray, hit(&twice, &ray, 0), hit(&twice, &ray, 1)), Verdict::Tie);
}

#[test]
fn slipping_through_an_edge_or_a_vertex_is_touching() {
    let scene = scene();
    // The square's rim, its corner, and its diagonal: what lies behind is right as well.
    for ray in [down(0.5, 0.0), down(0.0, 0.0), down(0.25, 0.25)] {
        let (near, far) = (hit(&scene, &ray, 0), hit(&scene, &ray, 2));
        assert!(near.is_some() && far.is_some());
        assert_eq!(verdict(&scene, &ray, near, far), Verdict::Touching);
        assert_eq!(verdict(&scene[..2], &ray, near, None), Verdict::Touching);
        assert_eq!(judge(&scene).nearest_alone(&ray, far).verdict, Verdict::Touching);
        assert_eq!(judge(&scene[..2]).occluded(&ray, true, false).verdict, Verdict::Touching);
    }
}

#[test]
fn a_ray_in_a_triangles_plane_touches_it() {
    let scene = &scene()[..1];
    let ray = Ray::new(Vec3::new(-1.0, 0.25, 0.0), Vec3::X);
    let along = Some(Hit { triangle: TriangleId(0), t: 1.5, u: 0.25, v: 0.25 });
    assert_eq!(verdict(scene, &ray, None, along), Verdict::Touching);
}

#[test]
fn within_the_bounds_of_an_edge_is_precision() {
    // The exact ray passes by the edge at a distance of an eighth of an ulp of the coordinates.
    let triangles = [Triangle::new(Vec3::new(1.0, 1.0, 0.0), Vec3::X * 3.0, Vec3::Y * 3.0)];
    let ray = Ray {
        direction: Vec3::new(-1.0, -1.0, -2.0),
        ..Ray::new(Vec3::new(2.5, 2.5f32.next_up(), 2.0), Vec3::ONE)
    };
    let beyond = Contact::Miss(Miss::Beside);
    let judge = judge(&triangles);
    assert_eq!(judge.referee().examine(&ray, TriangleId(0)).contact, beyond);
    let claimed = Some(Hit { triangle: TriangleId(0), t: 1.0, u: 0.5, v: 0.5 });
    assert_eq!(verdict(&triangles, &ray, claimed, None), Verdict::Precision);
    assert_eq!(verdict(&triangles, &ray, None, claimed), Verdict::Precision);
    assert_eq!(judge.nearest_alone(&ray, claimed).verdict, Verdict::Precision);
    assert_eq!(judge.nearest_alone(&ray, None).verdict, Verdict::Agree);
    assert_eq!(judge.occluded(&ray, true, false).verdict, Verdict::Precision);
}

#[test]
fn within_the_bounds_of_the_intervals_end_is_precision_and_on_the_start_is_wrong() {
    let scene = &scene()[..1];
    let ray = |t_min, t_max| Ray { t_min, t_max, ..down(0.5, 0.25) };
    let at = |t| Some(Hit { triangle: TriangleId(0), t, u: 0.25, v: 0.25 });
    let end = ray(0.0, 2.0);
    assert_eq!(verdict(scene, &end, at(2.0), None), Verdict::Precision);
    assert_eq!(verdict(scene, &end, at(2.0), at(2.0)), Verdict::Agree);
    let before = ray(0.0, 2f32.next_down());
    assert_eq!(verdict(scene, &before, None, at(2.0)), Verdict::Precision);
    // Our kernels compare t itself with the interval's ends, so that it may not lie outside.
    assert_eq!(verdict(scene, &before, at(2.0), None), Verdict::NativeWrong);
    let start = ray(2.0, 9.0);
    assert_eq!(verdict(scene, &start, at(2.0), None), Verdict::NativeWrong);
    assert_eq!(verdict(scene, &start, None, at(2.0)), Verdict::Precision);
    assert_eq!(verdict(scene, &ray(0.0, 1.99), None, at(2.0)), Verdict::PeerWrong);
}

#[test]
fn two_distances_that_f32_cannot_tell_apart_are_precision() {
    // The second lies behind the first by an ulp of its coordinates, seen from a thousand times
    // farther.
    let near = Triangle::new(
        Vec3::new(-4.0, -4.0, 1.0),
        Vec3::new(4.0, -4.0, 1.0),
        Vec3::new(0.0, 4.0, 1.0),
    );
    let far = Triangle { p: near.p.map(|p| Vec3::new(p.x, p.y, 1f32.next_down())) };
    let ray = Ray::new(Vec3::new(0.1, 0.1, 1000.0), Vec3::NEG_Z);
    let scene = [near, far];
    let (a, b) = (hit(&scene, &ray, 0), hit(&scene, &ray, 1));
    assert_eq!(verdict(&scene, &ray, a, b), Verdict::Precision);
    assert_eq!(verdict(&scene, &ray, b, a), Verdict::Precision);
}

#[test]
fn answers_about_what_is_not_finite_are_wrong() {
    let scene = scene();
    let ray = Ray { direction: Vec3::new(f32::NAN, 0.0, -1.0), ..down(0.5, 0.25) };
    let claimed = hit(&scene, &down(0.5, 0.25), 0);
    assert_eq!(verdict(&scene, &ray, claimed, None), Verdict::NativeWrong);
    assert_eq!(verdict(&scene, &ray, claimed, claimed), Verdict::BothWrong);
    assert_eq!(verdict(&scene, &ray, None, None), Verdict::Agree);
    assert_eq!(judge(&scene).occluded(&ray, true, false).verdict, Verdict::NativeWrong);
}

#[test]
fn occlusion_is_judged_by_what_is_met() {
    let scene = scene();
    let judge = judge(&scene[..2]);
    let verdict = |ray: &Ray, native, other| judge.occluded(ray, native, other).verdict;
    let (inside, beside) = (down(0.5, 0.25), down(1.5, 0.5));
    assert_eq!(verdict(&inside, true, true), Verdict::Agree);
    assert_eq!(verdict(&inside, false, true), Verdict::NativeWrong);
    assert_eq!(verdict(&inside, true, false), Verdict::PeerWrong);
    assert_eq!(verdict(&beside, true, false), Verdict::NativeWrong);
    assert_eq!(verdict(&beside, false, true), Verdict::PeerWrong);
    assert_eq!(judge.occluded_alone(&beside, false).verdict, Verdict::Agree);
    assert_eq!(judge.occluded_alone(&beside, true).verdict, Verdict::NativeWrong);
    assert_eq!(judge.occluded_alone(&inside, false).verdict, Verdict::NativeWrong);
}

#[test]
fn the_case_is_printed_as_source_with_its_triangles_renumbered() {
    let scene = scene();
    let ray = down(0.5, 0.25);
    let judge = judge(&scene);
    let (native, other) = (hit(&scene, &ray, 2), hit(&scene, &ray, 0));
    let text = judge.source(&ray, native, other, &judge.nearest(&ray, native, other));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "// NativeWrong; triangles [TriangleId(0), TriangleId(2)]");
    assert_eq!(lines[1], format!("let ray = {};", source::ray(&ray)));
    assert_eq!(lines[3], format!("    {},", source::triangle(&scene[0])));
    assert_eq!(lines[4], format!("    {},", source::triangle(&scene[2])));
    assert_eq!(lines[6], format!("let native = {};", source::hit(native, 1)));
    assert_eq!(lines[7], format!("let other = {};", source::hit(other, 0)));
}

/// Triangles of many sizes and shapes, and one in seven of them twice.
fn soup(count: u32) -> Vec<Triangle> {
    let stream = Stream::new(1, Purpose::Pair, 0, PointSet::Random);
    let vector = |i| Vec3::from_slice(&stream.point(i)[..3]) * 2.0 - 1.0;
    let triangle = |i| {
        let size = 10f32.powf(-3.0 * stream.point(4 * i)[3]);
        let (e1, e2) = (vector(4 * i + 1) * size, vector(4 * i + 2) * size);
        Triangle::new(vector(4 * i), vector(4 * i) + e1, vector(4 * i) + e2)
    };
    let triangles: Vec<Triangle> = (0..count).map(triangle).collect();
    triangles.iter().chain(triangles.iter().step_by(7)).copied().collect()
}

/// Through vertices, edges and insides, along axes, and with ends at the hit.
fn rays(count: u32, triangles: &[Triangle]) -> Vec<Ray> {
    let stream = Stream::new(2, Purpose::Pair, 0, PointSet::Random);
    let ray = |i: u32| {
        let ([x, y, z, w], [a, b, ..]) = (stream.point(2 * i), stream.point(2 * i + 1));
        let triangle = &triangles[(w * triangles.len() as f32) as usize];
        let target = match i % 6 {
            0 => triangle.p[i as usize / 6 % 3],
            1 => triangle.at(a, 0.0),
            2 => triangle.at(a, 1.0 - a),
            _ => triangle.at(a, b * (1.0 - a)),
        };
        let origin = Vec3::new(x, y, z) * 4.0 - 2.0;
        let origin = if i % 6 == 3 { target.with_z(origin.z) } else { origin };
        let ray = Ray::new(origin, target - origin);
        if i % 6 == 4 { Ray { t_max: 1.0, ..ray } } else { ray }
    };
    (0..count).map(ray).collect()
}

type Intersect<'a> = &'a dyn Fn(&Ray, &Triangle) -> Option<(f32, f32, f32)>;

/// Judges brute force over `intersect`, by the bounds of `arithmetic`, and counts its wrong answers.
fn count_wrong(arithmetic: Arithmetic, intersect: Intersect, nearest: bool) -> usize {
    let triangles = soup(200);
    let judge = Judge::new(&triangles, arithmetic, arithmetic);
    let answer = |ray: &Ray| {
        let mut best: Option<Hit> = None;
        for (index, triangle) in triangles.iter().enumerate() {
            if let Some((t, u, v)) = intersect(ray, triangle)
                && best.is_none_or(|hit| (t < hit.t) == nearest)
            {
                best = Some(Hit { triangle: TriangleId(index as u32), t, u, v });
            }
        }
        best
    };
    let is_wrong =
        |ray: &&Ray| judge.nearest_alone(ray, answer(ray)).verdict == Verdict::NativeWrong;
    rays(6000, &triangles).iter().filter(is_wrong).count()
}

#[test]
fn the_kernels_are_never_wrong() {
    assert_eq!(count_wrong(Arithmetic::MollerTrumbore, &MollerTrumbore::intersect, true), 0);
    assert_eq!(count_wrong(Arithmetic::Plane, &Plane::intersect, true), 0);
}

/// A kernel's test of t, u, v and w = 1 − u − v, against the ray's interval.
type Accept = fn([f32; 4], &Ray) -> bool;

/// Our kernel with a fault in its tests.
fn mutant(accept: Accept, ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)> {
    let (e1, e2) = triangle.edges();
    let [o, d, p0, e1, e2] =
        [ray.origin, ray.direction, triangle.p[0], e1, e2].map(|x| x.to_array());
    let c = determinants(o, d, p0, e1, e2);
    let (t, u, v) = (c.t / c.det, c.u / c.det, c.v / c.det);
    (c.det != 0.0 && accept([t, u, v, 1.0 - u - v], ray)).then_some((t, u, v))
}

#[test]
fn every_mutant_is_wrong() {
    fn inside(u: f32, v: f32, w: f32) -> bool {
        u >= 0.0 && v >= 0.0 && w >= 0.0
    }
    fn in_time(t: f32, ray: &Ray) -> bool {
        t > ray.t_min && t <= ray.t_max
    }
    let faults: [(&str, Accept); 7] = [
        ("a wrong sign", |[t, u, v, w], ray| inside(-u, v, w) && in_time(t, ray)),
        ("no third edge", |[t, u, v, _], ray| inside(u, v, 1.0) && in_time(t, ray)),
        ("a triangle too small", |[t, u, v, w], ray| inside(u - 1e-3, v, w) && in_time(t, ray)),
        ("a triangle too large", |[t, u, v, w], ray| inside(u + 1e-3, v, w) && in_time(t, ray)),
        ("no start", |[t, u, v, w], ray| inside(u, v, w) && t <= ray.t_max),
        ("no end", |[t, u, v, w], ray| inside(u, v, w) && t > ray.t_min),
        ("no hit", |_, _| false),
    ];
    for (name, fault) in faults {
        let wrong = count_wrong(Arithmetic::MollerTrumbore, &|r, t| mutant(fault, r, t), true);
        assert!(wrong > 0, "{name} goes unnoticed");
    }
    let farthest = count_wrong(Arithmetic::MollerTrumbore, &MollerTrumbore::intersect, false);
    assert!(farthest > 0, "the farthest hit goes unnoticed");
}

/// A floor and a smaller sheet in its plane, each of its own material, over a third plane; everything reflects on
/// both sides.
fn overlapping(materials: [Material; 3]) -> Scene {
    let sheet = |x: f32, z: f32, size: f32| Triangle {
        p: [Vec3::new(x, x, z), Vec3::new(x + size, x, z), Vec3::new(x, x + size, z)],
    };
    let triangles = vec![sheet(0.0, 0.0, 4.0), sheet(0.25, 0.0, 1.0), sheet(-1.0, -1.0, 9.0)];
    Scene::new(triangles, (0..3).map(MaterialId).collect(), materials.into())
}

fn of_scene(scene: &Scene) -> Judge<'_> {
    Judge::of_scene(scene, Arithmetic::MollerTrumbore, Arithmetic::EmbreeDefault)
}

#[test]
fn of_two_sheets_in_one_plane_that_which_is_seen_is_right_and_the_other_wrong() {
    let scene = overlapping([(); 3].map(|_| Material::fallback()));
    let (judge, triangles) = (of_scene(&scene), &scene.triangles);
    for ray in [down(0.5, 0.5), Ray::new(Vec3::new(0.5, 0.5, -0.5), Vec3::Z)] {
        let [floor, sheet] = [0, 1].map(|index| hit(triangles, &ray, index));
        assert_eq!(judge.nearest(&ray, sheet, floor).verdict, Verdict::PeerWrong);
        assert_eq!(judge.nearest(&ray, floor, sheet).verdict, Verdict::NativeWrong);
        assert_eq!(judge.settle_nearest(&ray, floor, floor).verdict, Verdict::BothWrong);
        assert_eq!(judge.settle_nearest(&ray, sheet, sheet).verdict, Verdict::Agree);
        assert_eq!(judge.settle_nearest(&ray, None, sheet).verdict, Verdict::NativeWrong);
    }
    // Beside the sheet there is the floor alone, and the sheet's rim may be met or not.
    let beside = down(3.0, 0.5);
    let floor = hit(triangles, &beside, 0);
    assert_eq!(judge.settle_nearest(&beside, floor, floor).verdict, Verdict::Agree);
    let rim = down(0.25, 0.5);
    let [floor, sheet] = [0, 1].map(|index| hit(triangles, &rim, index));
    assert_eq!(judge.nearest(&rim, sheet, floor).verdict, Verdict::Touching);
}

#[test]
fn where_a_surface_is_open_a_hit_is_wrong_and_what_lies_behind_is_right() {
    let opacity = |opacity| Material { opacity, ..Material::fallback() };
    let scene = overlapping([opacity(1.0), opacity(0.0), opacity(1.0)]);
    let (judge, triangles, ray) = (of_scene(&scene), &scene.triangles, down(0.5, 0.5));
    let [floor, sheet, behind] = [0, 1, 2].map(|index| hit(triangles, &ray, index));
    assert_eq!(judge.nearest(&ray, floor, sheet).verdict, Verdict::PeerWrong);
    assert_eq!(judge.settle_nearest(&ray, floor, floor).verdict, Verdict::Agree);
    assert_eq!(judge.nearest(&ray, behind, floor).verdict, Verdict::NativeWrong);

    let scene = overlapping([opacity(0.0), opacity(0.0), opacity(0.0)]);
    let judge = of_scene(&scene);
    assert_eq!(judge.settle_nearest(&ray, None, None).verdict, Verdict::Agree);
    assert_eq!(judge.nearest(&ray, None, behind).verdict, Verdict::PeerWrong);
    assert_eq!(judge.occluded(&ray, false, true).verdict, Verdict::PeerWrong);
    assert_eq!(judge.settle_occluded(&ray, false, false).verdict, Verdict::Agree);
}
