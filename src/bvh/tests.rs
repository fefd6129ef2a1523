//! Every way to trace against brute force.

use super::*;
use crate::geometry::{BruteForce, Plane};
use crate::sampling::{PointSet, Purpose, Stream};
use glam::Vec3;

/// Triangles of all sizes, slivers and exact duplicates among them.
fn soup(count: u32, seed: u64) -> Vec<Triangle> {
    let stream = Stream::new(seed, Purpose::Pair, 0, PointSet::Random);
    let vector = |i: u32| {
        let [x, y, z, _] = stream.point(i);
        Vec3::new(x, y, z) * 2.0 - 1.0
    };
    let mut triangles: Vec<Triangle> = (0..count)
        .map(|i| {
            let size = 10f32.powf(-3.0 * stream.point(4 * i)[3]);
            let p = vector(4 * i);
            let sliver = if i % 5 == 0 { 1e-4 } else { 1.0 };
            let (e1, e2) = (vector(4 * i + 1) * size, vector(4 * i + 2) * size * sliver);
            Triangle::new(p, p + e1, p + e2)
        })
        .collect();
    let copies: Vec<Triangle> = triangles.iter().step_by(7).copied().collect();
    triangles.extend(copies);
    triangles
}

fn rays(count: u32, seed: u64, triangles: &[Triangle]) -> Vec<Ray> {
    let stream = Stream::new(seed, Purpose::Pixel, 1, PointSet::Random);
    (0..count)
        .map(|i| {
            let [x, y, z, w] = stream.point(2 * i);
            let [a, b, c, _] = stream.point(2 * i + 1);
            let origin = Vec3::new(x, y, z) * 4.0 - 2.0;
            let direction = match i % 4 {
                // Along an axis: zero components and boxes met face-on.
                0 => [Vec3::X, Vec3::NEG_Y, Vec3::Z][i as usize / 4 % 3],
                // Through a vertex and through an edge.
                1 => triangles[i as usize % triangles.len()].p[i as usize / 4 % 3] - origin,
                2 => triangles[i as usize % triangles.len()].at(a, 0.0) - origin,
                _ => Vec3::new(a, b, c) - 0.5,
            };
            let t_max = if w < 0.5 { f32::INFINITY } else { 4.0 * w };
            Ray { t_max, ..Ray::new(origin, direction) }
        })
        .collect()
}

fn assert_same_as_brute_force<K: LeafKernel>(triangles: &[Triangle], rays: &[Ray]) {
    let brute = BruteForce::<K>::new(triangles);
    let bvh = Bvh::<K>::build(triangles);
    let (mut hits, mut blocked) = (Vec::new(), Vec::new());
    bvh.nearest_batch(rays, &mut hits);
    bvh.occluded_batch(rays, &mut blocked);
    for (i, ray) in rays.iter().enumerate() {
        let expected = brute.nearest(ray);
        assert_same_hit(bvh.nearest(ray), expected, triangles, || format!("ray {i}: {ray:?}"));
        assert_eq!(hits[i], bvh.nearest(ray), "batched ray {i}: {ray:?}");
        assert_eq!(bvh.occluded(ray), expected.is_some(), "ray {i}: {ray:?}");
        assert_eq!(blocked[i], expected.is_some(), "batched ray {i}: {ray:?}");
    }
}

/// Compares bit for bit; of exact copies of a triangle any may be named, since a kernel's t of a
/// grazing hit can lie so far before the triangle's box that the copy is not visited any more.
fn assert_same_hit(
    answer: Option<Hit>,
    expected: Option<Hit>,
    triangles: &[Triangle],
    ray: impl Fn() -> String,
) {
    let shape = |hit: Hit| (triangles[hit.triangle.index()], hit.t, hit.u, hit.v);
    assert_eq!(answer.map(shape), expected.map(shape), "{}", ray());
}

#[test]
fn every_answer_is_brute_forces_bit_for_bit() {
    for (count, seed) in [(1, 1), (3, 2), (40, 3), (2000, 4)] {
        let triangles = soup(count, seed);
        let rays = rays(3000, seed, &triangles);
        assert_same_as_brute_force::<MollerTrumbore>(&triangles, &rays);
        assert_same_as_brute_force::<Plane>(&triangles, &rays);
    }
}

#[test]
fn what_lies_behind_the_origin_is_found_as_what_lies_ahead() {
    for (count, seed) in [(40, 5), (2000, 6)] {
        let triangles = soup(count, seed);
        let ahead = BruteForce::<MollerTrumbore>::new(&triangles);
        let mut rays = rays(2000, seed, &triangles);
        // Close together, so that they go as packets.
        let across = |i: u32| Vec3::new(1.0, (i % 8) as f32 * 0.01, (i / 8) as f32 * 0.002 - 0.3);
        rays.extend((0..1024).map(|i| Ray::new(Vec3::new(-3.0, 0.1, 0.2), across(i))));
        // Two rays back to each hit: one whose interval ends there, one that reaches to both sides of the origin.
        let behind: Vec<Ray> = rays
            .iter()
            .filter_map(|ray| Some((ray, -ahead.nearest(ray)?.t)))
            .flat_map(|(ray, t)| {
                [(t.next_down(), t), (2.0 * t - 1.0, 1.0)].map(|(t_min, t_max)| Ray {
                    direction: -ray.direction,
                    t_min,
                    t_max,
                    ..*ray
                })
            })
            .collect();
        assert!(behind.len() > 1000, "the rays must hit something");
        assert_same_as_brute_force::<MollerTrumbore>(&triangles, &behind);
        let [one_point, both_sides] =
            [0, 1].map(|k| behind.iter().copied().skip(k).step_by(2).collect::<Vec<_>>());
        assert_same_as_brute_force::<MollerTrumbore>(&triangles, &one_point);
        assert_same_as_brute_force::<MollerTrumbore>(&triangles, &both_sides);
    }
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    for (count, seed) in [(40, 8), (500, 9), (5000, 9)] {
        let triangles = soup(count, seed);
        let mut rays = rays(4000, 9, &triangles);
        // Close together, so that they go as packets.
        let across = |i: u32| Vec3::new(1.0, (i % 8) as f32 * 0.01, (i / 8) as f32 * 0.002 - 0.3);
        rays.extend((0..1024).map(|i| Ray::new(Vec3::new(-3.0, 0.1, 0.2), across(i))));
        let answers = |level| {
            let bvh =
                Bvh::<MollerTrumbore>::build_for(triangles.clone().into(), Effort::Quick, level);
            let (mut hits, mut blocked) = (Vec::new(), Vec::new());
            bvh.nearest_batch(&rays, &mut hits);
            bvh.occluded_batch(&rays, &mut blocked);
            (hits, blocked)
        };
        let best = answers(Level::new());
        assert!(best.0.iter().flatten().count() > 1000, "the rays must hit something");
        for name in ["portable", "avx2", "avx512"] {
            if let Ok(level) = simd::level_of(name) {
                assert_eq!(best, answers(level), "{name}");
            }
        }
    }
}

#[test]
fn every_effort_gives_the_same_answers() {
    let triangles = soup(3000, 10);
    let rays = rays(3000, 10, &triangles);
    let answers = |effort| {
        let bvh = Bvh::<MollerTrumbore>::build_with(&triangles[..], effort);
        let (mut hits, mut blocked) = (Vec::new(), Vec::new());
        bvh.nearest_batch(&rays, &mut hits);
        bvh.occluded_batch(&rays, &mut blocked);
        (hits, blocked)
    };
    let (quick, thorough) = (answers(Effort::Quick), answers(Effort::Thorough));
    for (i, ray) in rays.iter().enumerate() {
        assert_same_hit(quick.0[i], thorough.0[i], &triangles, || format!("ray {i}: {ray:?}"));
    }
    assert_eq!(quick.1, thorough.1);
}

#[test]
fn more_rays_pay_for_more_effort() {
    assert_eq!(Effort::for_rays(1_000_000, 1_000_000), Effort::Quick);
    assert_eq!(Effort::for_rays(1_000_000, 1_000_000_000), Effort::Thorough);
    assert_eq!(Effort::for_rays(36, 1_000_000), Effort::Thorough);
    assert_eq!(Effort::for_rays(36, 0), Effort::Quick);
}

#[test]
fn the_hierarchy_is_the_same_whatever_the_number_of_threads() {
    // Enough for whatever the builder does differently with many triangles.
    let triangles = soup(520_000, 11);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| build::build(&triangles, Effort::Quick))
    };
    let bits = |words: &[f32]| words.iter().map(|word| word.to_bits()).collect::<Vec<_>>();
    let one = build(1);
    for threads in [2, 5] {
        let other = build(threads);
        assert!(bits(&one.leaves.words) == bits(&other.leaves.words), "{threads} threads");
        assert_eq!(one.nodes.len(), other.nodes.len(), "{threads} threads");
        for (a, b) in one.nodes.iter().zip(&other.nodes) {
            assert_eq!((a.children, a.bounds), (b.children, b.bounds), "{threads} threads");
        }
    }
}

#[test]
fn every_triangle_is_in_a_leaf_and_every_box_holds_what_is_below_it() {
    for count in [1, 2, 9, 3000] {
        let triangles = soup(count, 12);
        let bvh = Bvh::<MollerTrumbore>::build(&triangles[..]);
        let mut found = vec![false; triangles.len()];
        let mut work = vec![(0, Bounds { min: Vec3::MIN, max: Vec3::MAX })];
        while let Some((index, whole)) = work.pop() {
            let node = &bvh.nodes[index];
            for slot in (0..WIDTH).filter(|&slot| node.has(slot)) {
                let side =
                    |side: usize| Vec3::from_array([0, 1, 2].map(|a| node.bounds[a][side][slot]));
                let (min, max) = (side(0), side(1));
                assert!(min.cmpge(whole.min).all() && max.cmple(whole.max).all(), "node {index}");
                match node.children[slot].kind() {
                    ChildKind::Node(child) => work.push((child, Bounds { min, max })),
                    ChildKind::Leaf(first, count) => {
                        let leaf = bvh.leaf(first, count);
                        (0..count).for_each(|i| found[leaf.id(i).index()] = true);
                    }
                }
            }
        }
        assert!(found.iter().all(|&found| found), "{count}");
    }
}

#[test]
fn rays_that_stay_together_are_answered_as_if_they_were_alone() {
    for (count, seed) in [(500, 6), (5000, 7)] {
        let triangles = soup(count, seed);
        let bvh = Bvh::<MollerTrumbore>::build(&triangles[..]);
        let brute = BruteForce::<MollerTrumbore>::new(&triangles);
        let beam = |i: u32| {
            let eye = Vec3::new(-3.0, 0.1 * (i / 64 % 8) as f32, 0.2);
            let across = Vec3::new(0.0, (i % 8) as f32 * 0.02, (i / 8) as f32 * 0.005 - 0.4);
            Ray::new(eye, Vec3::X + across)
        };
        // Not a multiple of eight, with a broken ray among them in every lane, and broken in every way.
        let mut rays: Vec<Ray> = (0..1021).map(beam).collect();
        for (i, ray) in rays.iter_mut().enumerate().filter(|(i, _)| i % 25 == 4) {
            let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][i / 25 % 3];
            match i / 75 % 8 {
                axis @ 0..3 => ray.origin[axis] = bad,
                axis @ 3..6 => ray.direction[axis - 3] = bad,
                6 => ray.t_min = bad,
                _ => ray.t_max = bad,
            }
        }
        let (mut hits, mut blocked) = (Vec::new(), Vec::new());
        bvh.nearest_batch(&rays, &mut hits);
        bvh.occluded_batch(&rays, &mut blocked);
        assert!(hits.iter().flatten().count() > 50, "the rays must hit something");
        for (i, ray) in rays.iter().enumerate() {
            assert_eq!(hits[i], bvh.nearest(ray), "ray {i}: {ray:?}");
            assert_eq!(blocked[i], bvh.occluded(ray), "ray {i}: {ray:?}");
            if i % 25 == 4 && ray.t_min != f32::NEG_INFINITY {
                let expected = brute.nearest(ray);
                assert_same_hit(hits[i], expected, &triangles, || format!("ray {i}: {ray:?}"));
                assert_eq!(blocked[i], expected.is_some(), "ray {i}: {ray:?}");
            }
        }
    }
}

#[test]
fn a_ray_in_a_face_of_a_box_still_finds_what_touches_it() {
    // The triangle's box ends exactly where the ray runs, with zeros in the direction.
    let triangles = [Triangle::new(Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, 1.0))];
    for (origin, direction) in
        [(Vec3::new(0.5, 0.0, 1.0), Vec3::NEG_Z), (Vec3::new(0.0, 0.5, 2.0), Vec3::NEG_Z)]
    {
        let ray = Ray::new(origin, direction);
        let expected = BruteForce::<MollerTrumbore>::new(&triangles).nearest(&ray);
        assert!(expected.is_some());
        assert_eq!(Bvh::<MollerTrumbore>::build(&triangles[..]).nearest(&ray), expected);
    }
}

#[test]
fn a_ray_in_a_face_at_zero_of_a_box_finds_what_touches_it_far_away() {
    let triangles = [Triangle::new(Vec3::ZERO, Vec3::new(4.0, 2.0, 0.0), Vec3::new(0.0, 0.0, 2.0))];
    for scale in [1.0, 1e-20, 1e15] {
        for zero in [0.0, -0.0] {
            let triangles = triangles.map(|t| Triangle { p: t.p.map(|p| p * scale) });
            let origin = Vec3::new(0.0, -8.0, 1.0) * scale;
            let ray = Ray::new(origin, Vec3::new(zero, 1.0, zero));
            let expected = BruteForce::<MollerTrumbore>::new(&triangles).nearest(&ray);
            assert!(expected.is_some());
            assert_eq!(Bvh::<MollerTrumbore>::build(&triangles[..]).nearest(&ray), expected);
        }
    }
}

#[test]
fn the_nearest_triangle_that_stops_a_ray_is_that_of_brute_force() {
    let triangles = soup(900, 6);
    let brute = BruteForce::<MollerTrumbore>::new(&triangles);
    let bvh = Bvh::<MollerTrumbore>::build(&triangles[..]);
    for every in [1, 3, 40] {
        let stops = |hit: &Hit| hit.triangle.0.is_multiple_of(every);
        for ray in rays(2000, 7, &triangles) {
            let expected = brute.nearest_stop(&ray, &stops);
            let answer = bvh.nearest_stop(&ray, &stops);
            assert_same_hit(answer, expected, &triangles, || format!("{every}: {ray:?}"));
            assert!(answer.is_none_or(|hit| stops(&hit)));
        }
    }
}

#[test]
fn an_empty_scene_and_broken_rays_hit_nothing() {
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    assert_eq!(Bvh::<MollerTrumbore>::build([]).nearest(&ray), None);
    let triangles = soup(100, 5);
    let bvh = Bvh::<MollerTrumbore>::build(&triangles[..]);
    for bad in [f32::NAN, f32::INFINITY] {
        assert_eq!(bvh.nearest(&Ray::new(Vec3::splat(bad), Vec3::X)), None);
        assert_eq!(bvh.nearest(&Ray::new(Vec3::ZERO, Vec3::splat(bad))), None);
    }
    assert_eq!(bvh.nearest(&Ray::new(Vec3::ZERO, Vec3::ZERO)), None);
}
