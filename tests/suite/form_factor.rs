//! Form factors against closed forms, against identities, and against each other.

use crate::scenes::{
    Measured, Piece, World, all, askew, cube, icosphere, inside_out, patches_of, scaled, scene,
    square,
};
use glam::{DVec3, Vec3};
use isolux::form_factor::pairs::Estimate;
use isolux::form_factor::{OnDemand, Rows, Transport, row_sum_defect, row_sums};
use isolux::geometry::Triangle;
use isolux::patches::{PatchId, PatchMesh, Subdivision};
use isolux::sampling::{PointSet, regular_triangle};
use isolux::scene::Scene;

/// A scene in which the form factor from its first piece to its second is known.
struct Case {
    name: &'static str,
    scene: Scene,
    expected: f64,
}

fn unit_square() -> Piece {
    Piece::new(square(Vec3::ZERO, Vec3::X, Vec3::Y))
}

/// A unit square at `height` that looks down on the first one.
fn ceiling(height: f32) -> Piece {
    Piece::new(square(Vec3::Z * height, Vec3::Y, Vec3::X))
}

/// A cube of edge 1 that looks inwards, with one of half its edge in its middle that looks outwards.
fn concentric_cubes() -> Scene {
    let outer = inside_out(cube(Vec3::ZERO, 1.0));
    scene([Piece::new(outer), Piece::new(cube(Vec3::splat(0.25), 0.5))])
}

/// Closed forms as the issue states them, to 15 digits: parallel and perpendicular rectangles are
/// Howell's C-11 and C-14, the screen cuts what the fourfold integral of the rest gives.
fn cases() -> Vec<Case> {
    let case = |name, pieces: Vec<Piece>, expected| Case { name, scene: scene(pieces), expected };
    let wall = Piece::new(square(Vec3::ZERO, Vec3::Y, Vec3::Z));
    let screen = square(Vec3::Z * 0.5, Vec3::X * 0.5, Vec3::Y * 0.5);
    let screen = Piece::new(screen).reflecting(Vec3::ZERO).two_sided();
    vec![
        case("opposite, distance 1", vec![unit_square(), ceiling(1.0)], 0.199824895698387),
        case("opposite, distance 0.1", vec![unit_square(), ceiling(0.1)], 0.826994522397257),
        case("opposite, distance 10", vec![unit_square(), ceiling(10.0)], 0.00316205683875760),
        case("perpendicular, shared edge", vec![unit_square(), wall], 0.200043776075403),
        case("screened", vec![unit_square(), ceiling(1.0), screen], 0.149868671773791),
        Case { name: "cube to inner cube", scene: concentric_cubes(), expected: 0.25 },
    ]
}

/// F from piece 0 to piece 1 by samples of each pair of patches. Pairs have streams of their own,
/// so their variances add up.
fn by_pairs(world: &World, samples: u32, points: PointSet, seed: u64) -> Measured {
    let estimator = world.estimator(samples, points, seed);
    let (from, to) = (patches_of(&world.mesh, 0), patches_of(&world.mesh, 1));
    let area: f64 = from.iter().map(|&i| world.mesh.area(i)).sum();
    let (mut exchange, mut variance) = (0.0, 0.0);
    for (&i, &j) in from.iter().flat_map(|i| to.iter().map(move |j| (i, j))) {
        let estimate = estimator.pair(i, j);
        exchange += estimate.mean;
        variance += estimate.standard_error.powi(2);
    }
    Measured { mean: exchange / area, standard_error: variance.sqrt() / area }
}

/// F from piece 0 to piece 1 by rays of each patch. A random ray hits with probability F_i, so a
/// row's share of N rays has the variance F_i(1 − F_i) / N, which F_i's estimate serves to estimate.
fn by_hemisphere(world: &World, samples: u32, points: PointSet, seed: u64) -> Measured {
    let rows = world.estimator(samples, points, seed).hemisphere_rows();
    let (from, to) = (patches_of(&world.mesh, 0), patches_of(&world.mesh, 1));
    let area: f64 = from.iter().map(|&i| world.mesh.area(i)).sum();
    let (mut exchange, mut variance) = (0.0, 0.0);
    for &i in &from {
        let mut share = 0.0;
        rows.for_each_in_row(i, &mut |j, factor| {
            if to.binary_search(&PatchId(j as u32)).is_ok() {
                share += factor;
            }
        });
        exchange += world.mesh.area(i) * share;
        variance += world.mesh.area(i).powi(2) * share * (1.0 - share) / samples as f64;
    }
    Measured { mean: exchange / area, standard_error: variance.sqrt() / area }
}

type Method = fn(&World, u32, PointSet, u64) -> Measured;

/// Each method with the samples that it takes for about this many in all from piece 0 to piece 1.
fn methods(mesh: &PatchMesh, total: usize) -> [(&'static str, Method, u32); 2] {
    let (from, to) = (patches_of(mesh, 0).len(), patches_of(mesh, 1).len());
    let per = |count: usize| (total / count).max(16) as u32;
    [("pairs", by_pairs, per(from * to)), ("hemisphere", by_hemisphere, per(from))]
}

#[test]
fn every_closed_form_is_met_within_four_standard_errors() {
    for Case { name, scene, expected } in cases() {
        for level in 0..=2 {
            let world = World::new(&scene, level);
            for (method, estimate, samples) in methods(&world.mesh, 1 << 17) {
                let seed = 1;
                let f = estimate(&world, samples, PointSet::Random, seed);
                let z = f.errors_from(expected);
                println!("{name}, {method}, level {level}, {samples} samples: {f:?}, {z:+.2} SE");
                assert!(
                    z.abs() <= 4.0,
                    "{name} by {method}, level {level}, {samples} samples, seed {seed}: \
                     {f:?} is {z} standard errors from {expected}"
                );
            }
        }
    }
}

#[test]
fn sobol_points_meet_every_closed_form_with_smaller_errors_than_random_points() {
    // The points of one estimate are not independent; repetitions with other seeds are.
    let seeds = 1..=32;
    for Case { name, scene, expected } in cases() {
        for level in 0..=1 {
            let world = World::new(&scene, level);
            for (method, estimate, samples) in methods(&world.mesh, 1 << 11) {
                let measure = |points| {
                    let means: Vec<f64> =
                        seeds.clone().map(|s| estimate(&world, samples, points, s).mean).collect();
                    Measured::from_repetitions(&means)
                };
                let (sobol, random) = (measure(PointSet::Sobol), measure(PointSet::Random));
                let z = sobol.errors_from(expected);
                let gain = random.standard_error / sobol.standard_error;
                println!(
                    "{name}, {method}, level {level}, {samples} samples: {sobol:?}, {z:+.2} SE, \
                     {gain:.1} times better than random"
                );
                assert!(z.abs() <= 4.0, "{name} by {method}, level {level}: {sobol:?}, {z} SE");
                assert!(gain >= 1.0, "{name} by {method}, level {level}: {sobol:?} {random:?}");
            }
        }
    }
}

#[test]
fn standard_errors_fall_as_one_over_root_n_and_are_what_they_claim() {
    // For R repetitions of nearly normal means the logarithm of their scatter has the standard
    // deviation 1/√(2R), so the slope fitted to N = 16, 64, 256, 1024 has that over √Σ(ln N − mean)².
    let repetitions = 200;
    for Case { name, scene, expected } in cases().into_iter().take(5) {
        let world = World::new(&scene, 0);
        for (method, estimate, _) in methods(&world.mesh, 1) {
            if method == "hemisphere" && expected < 0.01 {
                continue; // 1024 rays that hit 0.3 % of the time are far from normal.
            }
            let (mut ln_n, mut ln_scatter) = (Vec::new(), Vec::new());
            for samples in [16, 64, 256, 1024u32] {
                let runs: Vec<Measured> = (1000..1000 + repetitions)
                    .map(|seed| estimate(&world, samples, PointSet::Random, seed))
                    .collect();
                let means: Vec<f64> = runs.iter().map(|run| run.mean).collect();
                let spread = Measured::from_repetitions(&means);
                let scatter = spread.standard_error * (repetitions as f64).sqrt();
                ln_n.push((samples as f64).ln());
                ln_scatter.push(scatter.ln());
                let z = spread.errors_from(expected);
                assert!(z.abs() <= 4.0, "{name}, {method}, {samples} samples: {spread:?}, {z} SE");

                // The mean square of the claimed errors estimates the scatter's square, which is
                // itself known to a share of √(2/R); few samples know their variance no better.
                let claimed =
                    runs.iter().map(|r| r.standard_error.powi(2)).sum::<f64>() / repetitions as f64;
                let ratio = claimed / scatter.powi(2);
                let tolerance = 4.0 * (2.0 / repetitions as f64).sqrt();
                assert!(
                    (ratio.ln()).abs() <= tolerance,
                    "{name}, {method}, {samples} samples: claimed variance is {ratio} times the true"
                );
            }
            let mean_x = ln_n.iter().sum::<f64>() / 4.0;
            let mean_y = ln_scatter.iter().sum::<f64>() / 4.0;
            let spread_x: f64 = ln_n.iter().map(|x| (x - mean_x).powi(2)).sum();
            let product = |(x, y): (&f64, &f64)| (x - mean_x) * (y - mean_y);
            let slope = ln_n.iter().zip(&ln_scatter).map(product).sum::<f64>() / spread_x;
            let error = 1.0 / (2.0 * repetitions as f64 * spread_x).sqrt();
            println!("{name}, {method}: error ~ N^{slope:.3} ± {error:.3}");
            assert!((slope + 0.5).abs() <= 4.0 * error, "{name}, {method}: N^{slope} ± {error}");
        }
    }
}

#[test]
fn regular_points_come_nearer_as_their_grid_gets_finer() {
    // Their bias is the grid's own and no repetition shows it, so what is asked is that it shrinks.
    // Midpoints of cells of width 1/k leave O(1/k²) of a smooth integrand, and O(1/k) at a shadow's
    // edge or where patches touch; k grows by 8. Rays take only their origins from the grid: their
    // 8 · 32² directions leave no more noise than random ones would, √((1 − F) / (8192 F)).
    for Case { name, scene, expected } in cases() {
        let world = World::new(&scene, 1);
        for (method, estimate, _) in methods(&world.mesh, 1) {
            let error = |k: u32| {
                let f = estimate(&world, k * k, PointSet::Regular, 0).mean;
                (f - expected).abs() / expected
            };
            let (coarse, fine) = (error(4), error(32));
            println!(
                "{name}, {method}: relative error {coarse:.1e} at k = 4, {fine:.1e} at k = 32"
            );
            let most = match method {
                "pairs" => coarse / 4.0,
                _ => ((1.0 - expected) / (8192.0 * expected)).sqrt(),
            };
            assert!(fine <= most, "{name} by {method}: {fine} at k = 32, {coarse} at k = 4");
        }
    }
}

/// Scenes of all kinds: closed, open, with blockers, unequal patches, two-sided, not on any axis.
fn many_scenes() -> Vec<(&'static str, Scene)> {
    let mut scenes: Vec<_> = cases().into_iter().map(|c| (c.name, c.scene)).collect();
    let tilted = vec![
        Piece::new(askew(inside_out(cube(Vec3::ZERO, 1.0)))),
        Piece::new(askew(square(Vec3::splat(0.3), Vec3::X * 0.4, Vec3::Y * 0.3))).two_sided(),
    ];
    scenes.push(("tilted cube with a two-sided sheet", scene(tilted)));
    scenes.push(("icosphere", scene([Piece::new(inside_out(icosphere(1)))])));
    scenes
}

/// Patches of about the same size, so that each triangle has a level of its own.
fn evenly_split(scene: &Scene) -> World {
    split_to(scene, 0.75)
}

fn split_to(scene: &Scene, edge: f64) -> World {
    World::of(PatchMesh::subdivide(scene, Subdivision::MaxEdge(edge)).unwrap())
}

fn row(form_factors: &dyn Transport, i: PatchId) -> Vec<f64> {
    let mut row = vec![0.0; form_factors.len()];
    let rows = form_factors.rows().expect("rows");
    rows.for_each_in_row(i, &mut |j, factor| row[j] += factor);
    row
}

fn sums_of(transport: &dyn Transport) -> Vec<f64> {
    row_sums(transport.rows().expect("rows"), transport.len())
}

fn rows(form_factors: &dyn Transport) -> Vec<Vec<f64>> {
    (0..form_factors.len() as u32).map(|i| row(form_factors, PatchId(i))).collect()
}

/// Both matrices, from 64 samples a pair and a row (a power of two, so that counts / 64 are exact).
fn matrices(world: &World, points: PointSet, seed: u64) -> [Box<dyn Transport>; 2] {
    let estimator = world.estimator(64, points, seed);
    [Box::new(estimator.exchange_matrix()), Box::new(estimator.hemisphere_rows())]
}

#[test]
fn exchanges_by_pairs_are_reciprocal_to_rounding() {
    for (name, scene) in many_scenes() {
        let world = evenly_split(&scene);
        let [pairs, _] = matrices(&world, PointSet::Sobol, 3);
        let f = rows(&*pairs);
        let exchange = |i: usize, j: usize| world.mesh.area(PatchId(i as u32)) * f[i][j];
        for i in 0..f.len() {
            for j in 0..i {
                // One stored exchange, divided by an area and multiplied by it again: 2 roundings
                // on either side.
                let (there, back) = (exchange(i, j), exchange(j, i));
                let tolerance = 2.0 * f64::EPSILON * there;
                assert!((there - back).abs() <= tolerance, "{name}: A F {i} {j}: {there} {back}");
            }
        }
        assert_eq!(pairs.reciprocity_defect(), Some(0.0));
    }
}

#[test]
fn a_pair_is_the_same_both_ways_and_the_same_as_in_the_matrix() {
    for (name, scene) in many_scenes() {
        let world = evenly_split(&scene);
        for points in [PointSet::Sobol, PointSet::Random, PointSet::Regular] {
            let estimator = world.estimator(64, points, 5);
            let matrix = estimator.exchange_matrix();
            for i in all(&world.mesh).step_by(5) {
                let row = row(&matrix, i);
                for j in all(&world.mesh).filter(|&j| j != i) {
                    let pair = estimator.pair(i, j);
                    assert_eq!(pair, estimator.pair(j, i), "{name}, {points:?}: {i:?} {j:?}");
                    // The matrix sums 64 numbers of one sign in f32: a relative error below 65 ε/2.
                    let stored = row[j.index()] * world.mesh.area(i);
                    let tolerance = 33.0 * f32::EPSILON as f64 * pair.mean;
                    assert!(
                        (stored - pair.mean).abs() <= tolerance,
                        "{name}, {points:?}: {i:?} {j:?}: {stored} in the matrix, {pair:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn rows_on_demand_are_the_rows_of_the_matrix() {
    for (name, scene) in many_scenes() {
        let world = evenly_split(&scene);
        for points in [PointSet::Sobol, PointSet::Random, PointSet::Regular] {
            let [pairs, hemisphere] = matrices(&world, points, 6);
            let estimator = world.estimator(64, points, 6);
            let (by_pairs, by_rays) =
                (OnDemand::pairs(&estimator), OnDemand::hemisphere(&estimator));
            let dense = |entries: Vec<(PatchId, f64)>| {
                let mut row = vec![0.0; world.mesh.len()];
                entries.iter().for_each(|(j, factor)| row[j.index()] += factor);
                row
            };
            for i in all(&world.mesh).step_by(3) {
                assert_eq!(
                    dense(by_pairs.row(i).entries),
                    row(&*pairs, i),
                    "{name}, {points:?}, {i:?}"
                );
                assert_eq!(
                    dense(by_rays.row(i).entries),
                    row(&*hemisphere, i),
                    "{name}, {points:?}, {i:?}"
                );
            }
        }
    }
}

#[test]
fn hemisphere_rows_of_closed_rooms_sum_to_one_exactly() {
    let room = || inside_out(cube(Vec3::ZERO, 1.0));
    let far_away = |t: Vec<Triangle>| -> Vec<Triangle> {
        t.iter().map(|t| Triangle { p: t.p.map(|p| p + Vec3::new(100.0, -3.0, 17.0)) }).collect()
    };
    let closed = [
        ("cube", vec![Piece::new(room())]),
        ("cube far from the origin", vec![Piece::new(far_away(room()))]),
        ("tilted cube", vec![Piece::new(askew(room()))]),
        ("icosahedron", vec![Piece::new(inside_out(icosphere(0)))]),
        ("icosphere", vec![Piece::new(inside_out(icosphere(1)))]),
        ("cube in a cube", vec![Piece::new(room()), Piece::new(cube(Vec3::splat(0.25), 0.5))]),
    ];
    for (name, pieces) in closed {
        let scene = scene(pieces);
        for (level, points) in [
            (0, PointSet::Random),
            (2, PointSet::Sobol),
            (3, PointSet::Random),
            (1, PointSet::Regular),
        ] {
            // Every ray that is lost makes a sum miss at least 1/256, so 1 is meant to the bit.
            let world = World::new(&scene, level);
            let rays = world.estimator(256, points, 2).hemisphere_rows();
            let sums = sums_of(&rays);
            for (i, sum) in sums.iter().enumerate() {
                assert_eq!(*sum, 1.0, "{name}, level {level}, {points:?}, seed 2: row {i}");
            }
            assert_eq!(row_sum_defect(&sums), 0.0);
        }
    }
}

#[test]
fn a_sphere_of_many_facets_loses_no_ray_either() {
    // Where every facet's (u, v) rounded for itself, 1 to 4 of these 5 million rays slipped through a
    // seam. Now both facets of an edge decide it by the same bits.
    let scene = scene([Piece::new(inside_out(icosphere(3)))]);
    let world = World::new(&scene, 1);
    for seed in [2, 3] {
        let rays = world.random(1024, seed).hemisphere_rows();
        for (i, sum) in sums_of(&rays).iter().enumerate() {
            assert_eq!(*sum, 1.0, "seed {seed}: row {i}");
        }
    }
}

#[test]
fn the_inner_of_two_cubes_sends_all_its_light_to_the_outer_at_any_tessellation() {
    // It is convex and looks outwards, so each ray ends on the outer cube: Σ A_i F_ij is the inner
    // area, and reciprocity gives outer to inner as A_inner / A_outer = 1/4, with no error at all.
    let scene = concentric_cubes();
    let meshes = [
        Subdivision::Levels(0),
        Subdivision::Levels(1),
        Subdivision::Levels(2),
        Subdivision::Levels(3),
        Subdivision::MaxEdge(0.3),
        Subdivision::MaxEdge(0.11),
    ];
    for subdivision in meshes {
        for points in [PointSet::Sobol, PointSet::Random, PointSet::Regular] {
            let world = World::of(PatchMesh::subdivide(&scene, subdivision).unwrap());
            let rows = world.estimator(64, points, 7).hemisphere_rows();
            let (outer, inner) = (patches_of(&world.mesh, 0), patches_of(&world.mesh, 1));
            let area = |p: &[PatchId]| p.iter().map(|&p| world.mesh.area(p)).sum::<f64>();
            let mut exchange = 0.0;
            for &i in &inner {
                rows.for_each_in_row(i, &mut |j, factor| {
                    assert!(outer.contains(&PatchId(j as u32)), "{subdivision:?}: {i:?} sees {j}");
                    exchange += world.mesh.area(i) * factor;
                });
            }
            // Areas and factors are powers of two here: every sum is exact.
            assert_eq!(exchange, area(&inner), "{subdivision:?}, {points:?}");
            assert_eq!(exchange / area(&outer), 0.25, "{subdivision:?}, {points:?}");
        }
    }
}

#[test]
fn rows_by_pairs_of_closed_rooms_sum_to_one_within_four_standard_errors() {
    for (name, pieces, level) in [
        ("cube", vec![Piece::new(inside_out(cube(Vec3::ZERO, 1.0)))], 1),
        ("tilted cube", vec![Piece::new(askew(inside_out(cube(Vec3::ZERO, 1.0))))], 1),
        ("icosphere", vec![Piece::new(inside_out(icosphere(1)))], 0),
    ] {
        let scene = scene(pieces);
        let world = World::new(&scene, level);
        let estimator = world.random(256, 1);
        let mut squares = 0.0;
        for i in all(&world.mesh) {
            let others = all(&world.mesh).filter(|&j| j != i).map(|j| estimator.pair(i, j));
            let (mut sum, mut variance) = (0.0, 0.0);
            others.for_each(|Estimate { mean, standard_error }| {
                sum += mean / world.mesh.area(i);
                variance += (standard_error / world.mesh.area(i)).powi(2);
            });
            let z = (sum - 1.0) / variance.sqrt();
            squares += z * z;
            assert!(z.abs() <= 4.0, "{name}, seed 1: row {i:?} sums to {sum}, {z} SE from 1");
        }
        println!(
            "{name}: mean square of the errors in SE {:.2}",
            squares / world.mesh.len() as f64
        );
    }
}

#[test]
fn reported_defects_are_the_largest_over_all_entries() {
    for (name, scene) in many_scenes() {
        let world = evenly_split(&scene);
        for matrix in matrices(&world, PointSet::Random, 8) {
            let f = rows(&*matrix);
            let area = |i: usize| world.mesh.area(PatchId(i as u32));
            let exchange = |i: usize, j: usize| area(i) * f[i][j];
            let mut reciprocity = 0f64;
            for i in 0..f.len() {
                for j in 0..f.len() {
                    let defect = (exchange(i, j) - exchange(j, i)).abs();
                    reciprocity = reciprocity.max(defect / area(i).min(area(j)));
                }
            }
            let sums = sums_of(&*matrix);
            let found = matrix.reciprocity_defect().expect("a stored matrix");
            // Sums of up to 64 terms in another order, and products with areas: 100 roundings.
            let near = |a: f64, b: f64| (a - b).abs() <= 100.0 * f64::EPSILON;
            assert!(near(found, reciprocity), "{name}: {found}, {reciprocity}");
            let row_sum = f.iter().map(|row| (row.iter().sum::<f64>() - 1.0).abs());
            let row_sum = row_sum.fold(0.0, f64::max);
            let found = row_sum_defect(&sums);
            assert!(near(found, row_sum), "{name}: {found}, {row_sum}");
        }
    }
}

#[test]
fn patches_that_cannot_see_each_other_exchange_exactly_nothing() {
    let nothing = Estimate { mean: 0.0, standard_error: 0.0 };
    let check = |name: &str,
                 scene: &Scene,
                 level: u32,
                 hidden: &dyn Fn(PatchId, PatchId, &PatchMesh) -> bool| {
        let world = World::new(scene, level);
        let mut count = 0;
        for points in [PointSet::Sobol, PointSet::Random] {
            let estimator = world.estimator(16, points, 9);
            let matrices = matrices(&world, points, 9);
            for i in all(&world.mesh) {
                let [by_pairs, by_rays] = [row(&*matrices[0], i), row(&*matrices[1], i)];
                for j in all(&world.mesh).filter(|&j| hidden(i, j, &world.mesh)) {
                    assert_eq!(estimator.pair(i, j), nothing, "{name}, {points:?}: {i:?} {j:?}");
                    assert_eq!(by_pairs[j.index()], 0.0, "{name}, {points:?}: {i:?} {j:?}");
                    assert_eq!(by_rays[j.index()], 0.0, "{name}, {points:?}: {i:?} {j:?}");
                    count += 1;
                }
            }
        }
        assert!(count > 1000, "{name}: only {count} pairs were looked at");
    };
    let same_normal =
        |i: PatchId, j: PatchId, mesh: &PatchMesh| mesh.side(i).normal == mesh.side(j).normal;
    let same_triangle =
        |i: PatchId, j: PatchId, mesh: &PatchMesh| mesh.side(i).triangle == mesh.side(j).triangle;
    let anyone = |_: PatchId, _: PatchId, _: &PatchMesh| true;

    let room = || inside_out(cube(Vec3::ZERO, 1.0));
    check("walls of a cube", &scene([Piece::new(room())]), 2, &same_normal);
    check("tilted triangles", &scene([Piece::new(askew(room()))]), 2, &same_triangle);
    check("sphere", &scene([Piece::new(askew(inside_out(icosphere(1))))]), 1, &same_triangle);
    check("cube from outside", &scene([Piece::new(cube(Vec3::ZERO, 1.0))]), 2, &anyone);
    let back_to_back = [
        Piece::new(square(Vec3::ZERO, Vec3::Y, Vec3::X)),
        Piece::new(square(Vec3::Z, Vec3::X, Vec3::Y)),
    ];
    check("back to back", &scene(back_to_back), 2, &anyone);
    let sheet = Piece::new(askew(square(Vec3::ZERO, Vec3::X, Vec3::Y))).two_sided();
    check("both sides of a sheet", &scene([sheet]), 2, &same_triangle);
    // A wall between two squares, wide enough that no segment between them passes by.
    let wall = square(Vec3::new(-1.0, -1.0, 0.5), Vec3::X * 3.0, Vec3::Y * 3.0);
    let parted = [unit_square(), ceiling(1.0), Piece::new(wall)];
    let across = |i: PatchId, j: PatchId, mesh: &PatchMesh| {
        [i, j].iter().all(|&p| mesh.side(p).material.0 < 2)
    };
    check("parted by a wall", &scene(parted), 2, &across);
}

#[test]
fn a_one_sided_back_is_black_and_a_two_sided_one_is_not() {
    // A lid near a square, with its front above. It fills more of the view than a disc of radius 4
    // at 1/8 does, 16 / (16 + 1/64) = 99.9 %: whether it is seen needs no closer look.
    let lid = || Piece::new(square(Vec3::new(-4.0, -4.0, 0.125), Vec3::X * 9.0, Vec3::Y * 9.0));
    for (lid, seen) in [(lid(), false), (lid().two_sided(), true)] {
        let scene = scene([unit_square(), lid]);
        let world = World::new(&scene, 1);
        for (k, matrix) in matrices(&world, PointSet::Sobol, 12).iter().enumerate() {
            let sums = sums_of(&**matrix);
            for i in patches_of(&world.mesh, 0).iter().map(|i| i.index()) {
                let right = if seen { sums[i] > 0.5 } else { sums[i] == 0.0 };
                assert!(right, "matrix {k}: row {i} sums to {}, lid seen: {seen}", sums[i]);
            }
        }
    }
}

#[test]
fn scaling_by_a_power_of_two_changes_no_bit() {
    for (name, original) in many_scenes() {
        for (factor, points) in [(1.0 / 1024.0, PointSet::Random), (8.0, PointSet::Sobol)] {
            let other = scaled(&original, factor);
            let a = matrices(&evenly_split(&original), points, 10);
            let b = matrices(&split_to(&other, 0.75 * factor as f64), points, 10);
            for (a, b) in a.iter().zip(&b) {
                assert_eq!(rows(&**a), rows(&**b), "{name} times {factor}, {points:?}");
            }
        }
    }
}

#[test]
fn one_thread_and_many_give_the_same_bits() {
    let threads = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    for (name, scene) in many_scenes() {
        let world = evenly_split(&scene);
        let on = |n: usize| threads(n).install(|| matrices(&world, PointSet::Sobol, 11));
        let (one, many) = (on(1), on(3));
        for (a, b) in one.iter().zip(&many) {
            assert_eq!(rows(&**a), rows(&**b), "{name}");
            let same = vec![glam::DVec3::new(0.1, 0.2, 0.3); a.len()];
            let gather = |n: usize| threads(n).install(|| a.gather(&same));
            assert_eq!(gather(1), gather(3), "{name}");
        }
    }
}

/// Between two points of a closed convex polyhedron whose corners lie on the unit sphere nothing
/// blocks the view, so the form factor from a point is its closed form for a polygon (Lambert;
/// Baum, Rushmeier & Winget, SIGGRAPH 1989, eq. 7): Σ θ n·g / 2π over the polygon's edges, with θ
/// the angle that the edge spans and g the unit normal of the plane through it and the point.
fn from_point(at: DVec3, normal: DVec3, polygon: &Triangle) -> f64 {
    let r = polygon.p.map(|p| p.as_dvec3() - at);
    let edge = |a: DVec3, b: DVec3| {
        let cross = a.cross(b);
        let angle = cross.length().atan2(a.dot(b));
        angle * normal.dot(cross.normalize_or_zero())
    };
    (0..3).map(|k| edge(r[k], r[(k + 1) % 3])).sum::<f64>().abs() / std::f64::consts::TAU
}

#[test]
fn facets_of_an_integrating_sphere_exchange_what_their_closed_form_says() {
    let scene = scene([Piece::new(inside_out(icosphere(1)))]);
    let world = World::new(&scene, 0);
    let facets = &scene.triangles;
    let n = facets.len();
    // The mean of the closed form over k² centroids of the facet, in f64.
    let mean = |i: usize, j: usize, k: u32| {
        let normal = facets[i].double_area_normal().normalize();
        let p = facets[i].p.map(|p| p.as_dvec3());
        let centroids = regular_triangle(k);
        let at = |l: &[f32; 3]| (0..3).map(|a| p[a] * l[a] as f64).sum();
        let sum: f64 = centroids.iter().map(|l| from_point(at(l), normal, &facets[j])).sum();
        sum / centroids.len() as f64
    };
    let exact: Vec<Vec<f64>> = (0..n)
        .map(|i| (0..n).map(|j| if i == j { 0.0 } else { mean(i, j, 8) }).collect())
        .collect();
    for row in &exact {
        // The facets close the sphere, whatever the point; f32 corners leave them 1e-7 off it.
        assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-6, "the closed form is not closed");
    }

    let estimator = world.random(1024, 1);
    let rays = world.random(1 << 14, 1).hemisphere_rows();
    let mut all_z = Vec::new();
    for (i, line) in exact.iter().enumerate() {
        let patch = PatchId(i as u32);
        let by_rays = row(&rays, patch);
        for j in (0..n).filter(|&j| j != i) {
            // What the centroids leave of the mean: they err alike in neither direction.
            let exchange = [i, j].map(|k| world.mesh.area(PatchId(k as u32)));
            let quadrature = (exact[j][i] * exchange[1] / exchange[0] - line[j]).abs();
            let hit = by_rays[j];
            let ray_error = (line[j] * (1.0 - line[j]) / 16_384.0).sqrt();
            let z = ((hit - line[j]).abs() - quadrature).max(0.0) / ray_error;
            all_z.push(z);
            assert!(z <= 5.5, "rays: F({i}, {j}) = {hit}, not {} ({z} SE)", line[j]);
            if j > i {
                let pair = estimator.pair(patch, PatchId(j as u32));
                let (f, error) = (pair.mean / exchange[0], pair.standard_error / exchange[0]);
                let z = ((f - line[j]).abs() - quadrature).max(0.0) / error;
                assert!(z <= 5.5, "pairs: F({i}, {j}) = {f} ± {error}, not {} ({z} SE)", line[j]);
                all_z.push(z);
            }
        }
    }
    // Of 9480 normal numbers 0.6 are beyond 4 on average, more than 4 in one of 2500 cases, and one
    // beyond 5.5 in one of 2800. Their mean square is 1 ± √(2/9480).
    let beyond = all_z.iter().filter(|&&z| z > 4.0).count();
    let square = all_z.iter().map(|z| z * z).sum::<f64>() / all_z.len() as f64;
    println!("{} estimates: {beyond} beyond 4 SE, mean square {square:.3}", all_z.len());
    assert!(beyond <= 4, "{beyond} of {} estimates are beyond 4 SE", all_z.len());
    let tolerance = 4.0 * (2.0 / all_z.len() as f64).sqrt();
    assert!((square - 1.0).abs() <= tolerance, "errors are √{square} of what they claim");
}
