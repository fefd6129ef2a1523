//! Whole solutions: furnace, integrating sphere, energy, direct light, and what is refused.

use crate::scenes::{
    Measured, Piece, World, all, askew, cube, grey, icosphere, inside_out, patches_of, scene,
    square,
};
use glam::{DVec3, Vec3};
use isolux::color::{Rgb, Rgb64};
use isolux::error::ErrorKind;
use isolux::form_factor::{ExchangeMatrix, HemisphereRows, Transport};
use isolux::geometry::Triangle;
use isolux::patches::PatchId;
use isolux::progress::{Progress, Stage};
use isolux::radiosity::{Choices, Energy, Method, Radiosity, Solver, solve};
use isolux::sampling::{PointSet, regular_triangle};
use isolux::scene::Scene;
use isolux::settings::PatchSettings;
use isolux::solver::Stop;
use isolux::{Document, Frame, Solution, Tracer};
use std::f64::consts::PI;
use std::sync::atomic::{AtomicU64, Ordering};

const METHODS: [Method; 2] = [Method::Pairs, Method::Hemisphere];
const SOLVERS: [Solver; 3] = [Solver::Jacobi, Solver::GaussSeidel, Solver::Southwell];

/// The relative residual to reach. Shooting estimates each row anew, so it stops earlier.
fn tolerance(solver: Solver) -> f64 {
    if solver == Solver::Southwell { 1e-5 } else { 1e-9 }
}

/// Everything through the form factors, from seed 1.
fn settings(method: Method, solver: Solver) -> Choices {
    Choices {
        method,
        samples: if method == Method::Pairs { 64 } else { 256 },
        points: PointSet::Sobol,
        direct_samples: 0,
        solver,
        stop: Stop::Tolerance(tolerance(solver)),
        seed: 1,
        memory_limit: None,
    }
}

fn light(world: &World, settings: &Choices) -> Radiosity {
    solve(&world.bvh, &world.mesh, settings, &()).expect("it converges")
}

fn refusal(world: &World, settings: &Choices) -> String {
    let answer = solve(&world.bvh, &world.mesh, settings, &());
    answer.err().expect("an error").to_string()
}

/// A unit cube that looks inwards.
fn room() -> Vec<Triangle> {
    inside_out(cube(Vec3::ZERO, 1.0))
}

/// The matrix that [`solve`] uses with these settings, as rows of numbers. Shooting reads F_ij A_i / A_j
/// off row i for what j receives.
fn received(world: &World, settings: &Choices) -> Vec<Vec<f64>> {
    let estimator = world.estimator(settings.samples, settings.points, settings.seed);
    let matrix: Box<dyn Transport> = match settings.method {
        Method::Pairs => Box::new(estimator.exchange_matrix()),
        Method::Hemisphere => Box::new(estimator.hemisphere_rows()),
    };
    let (n, rows) = (matrix.len(), matrix.rows().expect("rows"));
    let mut f = vec![vec![0.0; n]; n];
    for i in all(&world.mesh) {
        rows.for_each_in_row(i, &mut |j, factor| match settings.solver {
            Solver::Jacobi | Solver::GaussSeidel => f[i.index()][j] += factor,
            Solver::TwoLevel => unreachable!("it has no matrix"),
            Solver::Southwell => {
                f[j][i.index()] += factor * world.mesh.area(i) / world.mesh.area(PatchId(j as u32));
            }
        });
    }
    f
}

fn emitted(world: &World) -> f64 {
    all(&world.mesh).map(|i| world.mesh.area(i) * world.mesh.exitance(i).x as f64).sum()
}

fn smallest_area(world: &World) -> f64 {
    all(&world.mesh).map(|i| world.mesh.area(i)).fold(f64::INFINITY, f64::min)
}

#[test]
fn in_a_furnace_every_patch_shines_with_e_over_one_minus_rho() {
    let rho = 0.5;
    for (name, triangles, level) in [
        ("cube", room(), 0),
        ("cube", room(), 1),
        ("tilted cube", askew(room()), 1),
        ("icosphere", inside_out(icosphere(1)), 0),
    ] {
        let scene = scene([Piece::new(triangles).reflecting(grey(0.5)).emitting(grey(1.0))]);
        let world = World::new(&scene, level);
        for (method, solver) in METHODS.iter().flat_map(|m| SOLVERS.map(|s| (*m, s))) {
            let settings = settings(method, solver);
            let found = light(&world, &settings);
            // With b = E/(1 − ρ) and row sums s_i, (I − ρF)(B − b) is the residual r_i plus
            // ρ b (s_i − 1). Where ρ s_i < 1 the largest |B_i − b| is at most the largest of that
            // over 1 − ρ max s, and Σ A|r| ≤ τ Σ A E bounds |r_i|. Of shooting, s are the sums of what
            // each patch receives, and its unshot power bounds its residual's (ρ s ≤ 1).
            let sums = received(&world, &settings)
                .iter()
                .map(|row| row.iter().sum::<f64>())
                .collect::<Vec<_>>();
            let defect = sums.iter().map(|s| (s - 1.0).abs()).fold(0.0, f64::max);
            let e = PI as f32 as f64;
            let b = e / (1.0 - rho);
            let left = tolerance(solver) * emitted(&world) / smallest_area(&world);
            let bound = (rho * b * defect + left) / (1.0 - rho * (1.0 + defect));
            let worst =
                found.radiosity.iter().map(|x| (*x - b).abs().max_element()).fold(0.0, f64::max);
            println!(
                "{name}, level {level}, {method:?}, {solver:?}: B is off by {worst:.2e} of {b:.4}, \
                 bound {bound:.2e}, defect {defect:.2e}"
            );
            for (i, radiosity) in found.radiosity.iter().enumerate() {
                let error = (*radiosity - b).abs().max_element();
                assert!(
                    error <= bound,
                    "{name}, level {level}, {method:?}, {solver:?}, seed 1: patch {i} has \
                     {radiosity}, {error:e} from {b}, where {bound:e} is allowed"
                );
            }
            let close = (found.row_sum_defect - defect).abs() <= 1e-12;
            assert!(close, "{name}: {} is reported, {defect} found", found.row_sum_defect);
            if method == Method::Hemisphere && solver != Solver::Southwell {
                // All rays hit: 256/256.
                assert_eq!(found.row_sum_defect, 0.0, "{name}, level {level}, {solver:?}");
            }
            assert!(*found.residuals.last().unwrap() <= tolerance(solver));
        }
    }
}

/// The form factor from a point to a triangle that it sees in full (Lambert; Baum, Rushmeier &
/// Winget, SIGGRAPH 1989, eq. 7): Σ θ n·g / 2π over the edges, with θ the angle that an edge spans
/// and g the unit normal of the plane through it and the point.
fn from_point(at: DVec3, normal: DVec3, polygon: &Triangle) -> f64 {
    let r = polygon.p.map(|p| p.as_dvec3() - at);
    let edge = |a: DVec3, b: DVec3| {
        let cross = a.cross(b);
        cross.length().atan2(a.dot(b)) * normal.dot(cross.normalize_or_zero())
    };
    (0..3).map(|k| edge(r[k], r[(k + 1) % 3])).sum::<f64>().abs() / (2.0 * PI)
}

/// The form factor between facets of a convex room: the mean of the closed form over k² centroids.
fn between_facets(from: &Triangle, to: &Triangle, k: u32) -> f64 {
    let (normal, p) = (from.double_area_normal().normalize(), from.p.map(|p| p.as_dvec3()));
    let centroids = regular_triangle(k);
    let at = |l: &[f32; 3]| (0..3).map(|a| p[a] * l[a] as f64).sum();
    centroids.iter().map(|l| from_point(at(l), normal, to)).sum::<f64>() / centroids.len() as f64
}

/// How far F_ij may be from A_j/A because the sphere has facets, as a share of A_j/A.
///
/// Let the corners lie on the unit sphere, all facets at least h from its centre, w² = 1 − h², and
/// x, y be points of two facets with inward normal n at x, whose plane is h_x from the centre. Then
/// x = −h_x n + t with |t| ≤ w and t ⟂ n, and with r = |y − x|
///
///   h_x n·(y − x) = r²/2 + (|x|² − |y|²)/2 + t·(y − x),
///
/// where |x|² and |y|² are in [h², 1]: it is r²/2 · (1 ± q) with q = w²/r² + 2w/r, and so from y.
/// The kernel cosθ cosθ' / πr² is therefore 1/4π · (1 ± q)² / (h_x h_y), and
/// F_ij A/A_j lies in A/4π · [max(0, 1 − q)², (1 + q)²/h²]. With no facets q = 0 and h = 1.
fn faceting(a: &Triangle, b: &Triangle, h: f64, area: f64) -> f64 {
    let reach =
        |t: &Triangle| t.p.iter().map(|p| p.distance(t.centroid())).fold(0.0, f32::max) as f64;
    let r = a.centroid().distance(b.centroid()) as f64 - reach(a) - reach(b);
    if r <= 0.0 {
        return f64::INFINITY;
    }
    let w = (1.0 - h * h).sqrt();
    let q = w * w / (r * r) + 2.0 * w / r;
    let sphere = area / (4.0 * PI);
    let (least, most) = ((1.0 - q).max(0.0).powi(2), (1.0 + q).powi(2) / (h * h));
    (sphere * most - 1.0).max(1.0 - sphere * least)
}

fn distance_from_centre(t: &Triangle) -> f64 {
    t.double_area_normal().normalize().dot(t.p[0].as_dvec3()).abs()
}

#[test]
fn form_factors_in_an_integrating_sphere_are_shares_of_its_area_up_to_the_faceting() {
    // Seen from one facet of finer and finer spheres.
    let mut average = Vec::new();
    for levels in 1..=4 {
        let facets = inside_out(icosphere(levels));
        let area: f64 = facets.iter().map(Triangle::area).sum();
        let h = facets.iter().map(distance_from_centre).fold(1.0, f64::min);
        let (mut worst, mut bounds, mut sum) = (0f64, 0f64, 0.0);
        for to in &facets[1..] {
            let f = between_facets(&facets[0], to, 4);
            let relative = (f * area / to.area() - 1.0).abs();
            let bound = faceting(&facets[0], to, h, area);
            assert!(relative <= bound, "{levels} levels: {to:?}: {relative} above {bound}");
            if facets[0].centroid().distance(to.centroid()) > 1.0 {
                (worst, bounds) = (worst.max(relative), bounds.max(bound));
            }
            sum += relative * to.area() / area;
        }
        println!(
            "{} facets: off by {sum:.1e} on average, beyond distance 1 by {worst:.1e} at most \
             (bound {bounds:.1e})",
            facets.len()
        );
        average.push(sum);
    }
    // To first order in the facets' size, as derived: a level halves it.
    assert!(average.windows(2).all(|w| (0.4..0.65).contains(&(w[1] / w[0]))), "{average:?}");
}

/// Mean and standard error of every patch's irradiance over seeds of their own.
fn irradiances(world: &World, settings: &Choices, seeds: std::ops::Range<u64>) -> Vec<Measured> {
    let runs: Vec<Radiosity> =
        seeds.map(|seed| light(world, &Choices { seed, ..*settings })).collect();
    (0..world.mesh.len())
        .map(|i| {
            let values: Vec<f64> = runs.iter().map(|run| run.irradiance[i].x).collect();
            Measured::from_repetitions(&values)
        })
        .collect()
}

#[test]
fn one_lit_face_of_an_integrating_sphere_lights_all_others_alike() {
    let rho = 0.5;
    let mut facets = inside_out(icosphere(1));
    let lamp = vec![facets.remove(17)];
    let scene = scene([
        Piece::new(lamp).reflecting(grey(0.5)).emitting(grey(1.0)),
        Piece::new(facets).reflecting(grey(0.5)),
    ]);
    let world = World::new(&scene, 0);
    let facets = &scene.triangles;
    let area: f64 = scene.area();
    let h = facets.iter().map(distance_from_centre).fold(1.0, f64::min);
    let share: Vec<f64> = facets.iter().map(|t| t.area() / area).collect();
    let e = PI as f32 as f64;

    // The facets' own light: their closed form factors, and 60 bounces (2⁻⁶⁰ is left).
    let n = facets.len();
    let f: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let to = |j: usize| between_facets(&facets[i], &facets[j], 12);
            (0..n).map(|j| if i == j { 0.0 } else { to(j) }).collect()
        })
        .collect();
    let gather = |b: &[f64]| -> Vec<f64> {
        f.iter().map(|row| row.iter().zip(b).map(|(f, b)| f * b).sum()).collect()
    };
    let source: Vec<f64> = (0..n).map(|i| if i == 0 { e } else { 0.0 }).collect();
    let mut radiosity = source.clone();
    for _ in 0..60 {
        let incoming = gather(&radiosity);
        radiosity = (0..n).map(|i| source[i] + rho * incoming[i]).collect();
    }
    let of_facets = gather(&radiosity);

    // On a sphere F_ij = A_j/A, and every point receives H₀ = E A_lamp / A / (1 − ρ). With
    // Δ_ij = F_ij − A_j/A, whose columns sum to 0 by area (reciprocity and closure), solving both
    // gives H − H₀ = ΔB exactly. Its first part is E |Δ_i0|; the rest is ρ Δ (H − H₀), as the rows of Δ
    // sum to 0 as well: so |H_i − H₀| ≤ E |Δ_i0| + ρ Σ_j |Δ_ij| max|H − H₀|.
    let sphere = e * share[0] / (1.0 - rho);
    let off = |i: usize| (of_facets[i] - sphere).abs();
    let largest = (0..n).map(off).fold(0.0, f64::max);
    let allowed: Vec<f64> = (0..n)
        .map(|i| {
            let delta = |j: usize| (f[i][j] - share[j]).abs();
            let first = match i {
                0 => e * share[0], // A facet does not see itself.
                _ => e * share[0] * faceting(&facets[i], &facets[0], h, area),
            };
            first + rho * (0..n).map(delta).sum::<f64>() * largest
        })
        .collect();
    // What 12² points a facet leave of the mean, δF, is seen in how far it is from reciprocal. It
    // moves H by δF B, and reflected light by at most ρ/(1 − ρ) of the most that this is anywhere.
    let defect = |i: usize, j: usize| (f[j][i] * share[j] / share[i] - f[i][j]).abs();
    let first: Vec<f64> =
        (0..n).map(|i| (0..n).map(|j| defect(i, j) * radiosity[j]).sum()).collect();
    let most = first.iter().copied().fold(0.0, f64::max);
    println!("quadrature {most:.1e}, H on a sphere {sphere:.5}, of facets off by {largest:.1e}");

    for method in METHODS {
        let random = Choices { points: PointSet::Random, ..settings(method, Solver::GaussSeidel) };
        let measured = irradiances(&world, &random, 0..32);
        let mut squares = 0.0;
        for (i, h) in measured.iter().enumerate() {
            let slack = first[i] + rho / (1.0 - rho) * most;
            let z = ((h.mean - of_facets[i]).abs() - slack).max(0.0) / h.standard_error;
            squares += z * z / n as f64;
            assert!(z <= 4.0, "{method:?}: patch {i}: {h:?}, not {} ({z} SE)", of_facets[i]);
            let z = ((h.mean - sphere).abs() - allowed[i]) / h.standard_error;
            assert!(
                z <= 4.0,
                "{method:?}: patch {i}: {h:?}, not {sphere} ± {} ({z} SE)",
                allowed[i]
            );
        }
        println!("{method:?}: mean square {squares:.2} of the errors in SE");
    }
}

/// A room with a lamp under its ceiling and a box on its floor, in three different colours.
fn furnished_room(lamp: f32) -> Scene {
    let corner = Vec3::new(0.5 - lamp / 2.0, 0.5 - lamp / 2.0, 0.95);
    scene([
        Piece::new(room()).reflecting(Rgb::new(0.7, 0.5, 0.3)),
        Piece::new(square(corner, Vec3::Y * lamp, Vec3::X * lamp))
            .reflecting(grey(0.25))
            .emitting(Rgb::new(1.0, 2.0, 4.0)),
        Piece::new(cube(Vec3::new(0.125, 0.25, 0.125), 0.25)).reflecting(Rgb::new(0.0, 0.5, 0.9)),
    ])
}

/// The furnished room without a wall and the ceiling, so that light gets out and meets the lamp's back.
fn open_room() -> Scene {
    let mut scene = furnished_room(0.5);
    for first in [10, 2] {
        let kept = |t: &usize| !(first..first + 2).contains(t);
        let numbers: Vec<usize> = (0..scene.triangles.len()).filter(kept).collect();
        scene.triangles = numbers.iter().map(|&t| scene.triangles[t]).collect();
        scene.material_of = numbers.iter().map(|&t| scene.material_of[t]).collect();
    }
    scene
}

/// The power that no front receives.
fn lost(energy: &Energy) -> Rgb64 {
    energy.escaped + energy.on_backs.unwrap_or_default()
}

#[test]
fn light_that_leaves_is_kept_apart_from_light_that_meets_backs() {
    // A lit square that looks at the back of another one as large, at a distance of 1, in the open: the
    // back gets the form factor of two such squares (Howell, C-11), 0.19982.
    let lit = square(Vec3::ZERO, Vec3::X, Vec3::Y);
    let back = square(Vec3::Z, Vec3::X, Vec3::Y);
    let scene = scene([
        Piece::new(lit).reflecting(grey(0.5)).emitting(grey(1.0)),
        Piece::new(back).reflecting(grey(0.5)),
    ]);
    let world = World::new(&scene, 2);
    for solver in SOLVERS {
        let energy = light(&world, &settings(Method::Hemisphere, solver)).energy;
        let on_backs = energy.on_backs.expect("hemispheres tell") / energy.emitted;
        // 32 patches of 256 rays each: 8192 rays, of which a standard error of √(0.2·0.8/8192) = 0.0044 if
        // they were independent, and less as they are.
        assert!((on_backs - 0.19982).abs().max_element() < 4.0 * 0.0044, "{solver:?}: {on_backs}");
        let escaped = energy.escaped / energy.emitted;
        assert!((on_backs + escaped - 1.0).abs().max_element() < 1e-12, "{solver:?}: {escaped}");
        assert_eq!(energy.absorbed, Rgb64::ZERO);
        // Pairs see no backs: the light is gone, no matter where.
        let energy = light(&world, &settings(Method::Pairs, solver)).energy;
        assert_eq!((energy.on_backs, energy.escaped), (None, energy.emitted), "{solver:?}");
    }
}

/// Asks to stop after this much of everything.
struct StopAfter(AtomicU64);

impl Progress for StopAfter {
    fn begin(&self, _: Stage, _: Option<u64>) {}

    fn advance(&self, amount: u64) {
        let left = self.0.load(Ordering::Relaxed);
        self.0.store(left.saturating_sub(amount), Ordering::Relaxed);
    }

    fn end(&self) {}

    fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

#[test]
fn a_solution_that_is_asked_to_stop_ends_with_an_error_of_that_kind_wherever_it_is() {
    let scene = furnished_room(0.5);
    let world = World::new(&scene, 2);
    for (method, solver) in METHODS.iter().flat_map(|m| SOLVERS.map(|s| (*m, s))) {
        let settings = settings(method, solver);
        for amount in [0, 1, 100, 300] {
            let stop = StopAfter(AtomicU64::new(amount));
            match solve(&world.bvh, &world.mesh, &settings, &stop) {
                Ok(_) => assert!(!stop.is_stopped(), "{method:?}, {solver:?}, {amount}"),
                Err(error) => assert_eq!(error.kind(), ErrorKind::Stopped, "{error}"),
            }
        }
        let stopped = |amount| {
            let stop = StopAfter(AtomicU64::new(amount));
            solve(&world.bvh, &world.mesh, &settings, &stop).is_err()
        };
        assert!(stopped(0) && stopped(1), "{method:?}, {solver:?}");
        assert!(!stopped(u64::MAX), "{method:?}, {solver:?}");
    }
}

#[test]
fn drawing_can_be_stopped() {
    let document = Document::open("scenes/furnace.toml").expect("a description");
    let scene = document.scene().expect("triangles");
    let tracer = Tracer::build(&scene);
    let patches = PatchSettings { levels: Some(1), max_edge: None };
    let settings = isolux::Settings { patches, ..isolux::Settings::default() };
    let light = Solution::solve(&document, &scene, &tracer, &settings, &()).expect("light");
    let (view, frame) = (light.flat(), Frame::new(8, 8));
    let draw = |progress: &dyn Progress| view.draw(&tracer, &light.camera, &frame, progress);
    for rows in [0, 1, 7] {
        let error = draw(&StopAfter(AtomicU64::new(rows))).expect_err("stopped");
        assert_eq!(error.kind(), ErrorKind::Stopped);
    }
    assert_eq!(draw(&()).expect("a picture").pixels.len(), 64);
}

#[test]
fn what_is_emitted_is_absorbed_or_escapes() {
    for (name, scene, metres) in
        [("furnished", furnished_room(0.5), 1.0), ("open", open_room(), 0.01)]
    {
        let scene = Scene { metres_per_unit: metres, ..scene };
        let world = World::new(&scene, 1);
        for (method, solver) in METHODS.iter().flat_map(|m| SOLVERS.map(|s| (*m, s))) {
            let settings = settings(method, solver);
            let found = light(&world, &settings);
            let energy = found.energy;
            let square_metres = metres * metres;
            let lamp = 0.25 * PI * square_metres * DVec3::new(1.0, 2.0, 4.0);
            // π and the lamp's area in f32.
            assert!((energy.emitted / lamp - 1.0).abs().max_element() < 4.0 * f32::EPSILON as f64);
            // With B = E + ρH up to a residual r of Σ A|r| ≤ τ Σ A E, the imbalance
            // Σ A (E − (1 − ρ)H − (1 − s)B) is Σ_i B_i Σ_j (A_i F_ij − A_j F_ji) up to that:
            // nothing for pairs and for shooting, whose F is reciprocal as it is used.
            let mut reciprocity = Rgb64::ZERO;
            if method == Method::Hemisphere && solver != Solver::Southwell {
                let f = received(&world, &settings);
                for i in all(&world.mesh) {
                    let out: f64 = f[i.index()].iter().sum::<f64>() * world.mesh.area(i);
                    let back = |j: PatchId| f[j.index()][i.index()] * world.mesh.area(j);
                    let back: f64 = all(&world.mesh).map(back).sum();
                    reciprocity += found.radiosity[i.index()] * (out - back) * square_metres;
                }
            }
            let missing = energy.emitted - energy.absorbed - lost(&energy);
            println!(
                "{name}, {method:?}, {solver:?}: misses {:.1e} of what is emitted, {:.1e} beside \
                 the reciprocity defect",
                (missing / energy.emitted).abs().max_element(),
                ((missing - reciprocity) / energy.emitted).abs().max_element()
            );
            // Sums of 200 terms: below 400 roundings of the whole.
            let allowed = energy.emitted * (tolerance(solver) + 400.0 * f64::EPSILON);
            assert!(
                (missing - reciprocity).abs().cmple(allowed).all(),
                "{name}, {method:?}, {solver:?}, seed 1: {energy:?} misses {missing}, {reciprocity} \
                 of it by the reciprocity defect"
            );
            // The lamp's black back is open to the light in both rooms, the room's open side in one.
            let share = (lost(&energy) / energy.emitted).min_element();
            let least = if name == "open" { 0.2 } else { 0.0 };
            assert!(share > least, "{name}, {method:?}, {solver:?}: {share} escapes");
        }
    }
}

#[test]
fn sampling_the_lamp_loses_no_light_on_average() {
    // The lamp's light arrives as D and leaves through the lamp's row sum: two estimates of one
    // power, so the balance is met in the mean over seeds. (Rays in a matrix are left out: their
    // defect of reciprocity comes on top, see above.)
    let scene = open_room();
    let world = World::new(&scene, 1);
    for (method, solver) in [
        (Method::Pairs, Solver::GaussSeidel),
        (Method::Pairs, Solver::Southwell),
        (Method::Hemisphere, Solver::Southwell),
    ] {
        let base = settings(method, solver);
        let settings = Choices { samples: base.samples / 4, direct_samples: 16, ..base };
        let missing = |seed| {
            let energy = light(&world, &Choices { seed, ..settings }).energy;
            ((energy.emitted - energy.absorbed - lost(&energy)) / energy.emitted).y
        };
        let missing = Measured::from_repetitions(&(0..32).map(missing).collect::<Vec<_>>());
        println!("{method:?}, {solver:?}: share of the light missing: {missing:?}");
        let allowed = 4.0 * missing.standard_error + tolerance(solver);
        assert!(missing.mean.abs() <= allowed, "{method:?}, {solver:?}: {missing:?}");
    }
}

#[test]
fn rays_of_rows_that_only_the_balance_needs_are_counted() {
    let scene = open_room();
    let world = World::new(&scene, 1);
    // Without an iteration, a matrix takes the rays of every row. Shooting takes no row for the light,
    // and those of the emitters for the balance. Both take the same rays for the direct light.
    let rays = |solver| {
        let settings = Choices {
            direct_samples: 16,
            stop: Stop::Iterations(0),
            ..settings(Method::Hemisphere, solver)
        };
        (light(&world, &settings).rays, settings.samples as u64)
    };
    let (by_matrix, samples) = rays(Solver::Jacobi);
    let (by_shooting, _) = rays(Solver::Southwell);
    let dark = all(&world.mesh).filter(|&i| world.mesh.exitance(i) == Rgb::ZERO).count() as u64;
    assert!(dark > 0 && (dark as usize) < world.mesh.len());
    assert_eq!(by_shooting, by_matrix - dark * samples);
}

#[test]
fn nothing_escapes_from_a_closed_room() {
    let mut walls = room();
    let lamp = walls.split_off(10);
    let scene = scene([
        Piece::new(walls).reflecting(Rgb::new(0.75, 0.5, 0.0)),
        Piece::new(lamp).reflecting(grey(0.5)).emitting(grey(1.0)),
    ]);
    let world = World::new(&scene, 1);
    for solver in SOLVERS {
        let found = light(&world, &settings(Method::Hemisphere, solver));
        assert_eq!(found.energy.escaped, Rgb64::ZERO, "{solver:?}");
        // By pairs, Σ A B |1 − s| is all that the row-sum defect can make of it.
        let found = light(&world, &settings(Method::Pairs, solver));
        let power: Rgb64 =
            all(&world.mesh).map(|i| found.radiosity[i.index()] * world.mesh.area(i)).sum();
        let allowed = power * found.row_sum_defect;
        assert!(found.energy.escaped.abs().cmple(allowed).all(), "{solver:?}: {:?}", found.energy);
    }
}

/// F between opposite squares of side a at distance c: Howell's C-11 with X = Y = a/c.
fn between_squares(x: f64) -> f64 {
    let y = 1.0 + x * x;
    2.0 / (PI * x * x)
        * ((y * y / (y + x * x)).sqrt().ln() + 2.0 * x * y.sqrt() * (x / y.sqrt()).atan()
            - 2.0 * x * x.atan())
}

#[test]
fn a_two_sided_sheet_receives_on_each_side_what_that_side_sees() {
    assert!((between_squares(1.0) - 0.199824895698387).abs() < 1e-14);
    assert!((between_squares(10.0) - 0.826994522397257).abs() < 1e-14);
    // A lamp above and one of three times its light below; all else is black.
    let scene = scene([
        Piece::new(square(Vec3::Z * 0.5, Vec3::X, Vec3::Y)).reflecting(grey(0.5)).two_sided(),
        Piece::new(square(Vec3::Z, Vec3::Y, Vec3::X)).reflecting(grey(0.0)).emitting(grey(1.0)),
        Piece::new(square(Vec3::ZERO, Vec3::X, Vec3::Y)).reflecting(grey(0.0)).emitting(grey(3.0)),
    ]);
    let world = World::new(&scene, 1);
    let f = between_squares(2.0);
    let sheet = patches_of(&world.mesh, 0);
    for method in METHODS {
        for direct_samples in [0, 16] {
            for solver in SOLVERS {
                let settings = Choices { direct_samples, samples: 64, ..settings(method, solver) };
                let runs: Vec<Radiosity> =
                    (0..32).map(|seed| light(&world, &Choices { seed, ..settings })).collect();
                for (is_back, expected) in [(false, f * PI), (true, 3.0 * f * PI)] {
                    let side: Vec<PatchId> = sheet
                        .iter()
                        .copied()
                        .filter(|&p| world.mesh.side(p).is_back == is_back)
                        .collect();
                    let mean = |run: &Radiosity| {
                        side.iter().map(|i| run.irradiance[i.index()].x).sum::<f64>()
                            / side.len() as f64
                    };
                    let h = Measured::from_repetitions(&runs.iter().map(mean).collect::<Vec<_>>());
                    let z = h.errors_from(expected);
                    assert!(
                        z.abs() <= 4.0,
                        "{method:?}, {solver:?}, {direct_samples} direct samples, back {is_back}: \
                         {h:?}, not {expected} ({z} SE)"
                    );
                    for run in &runs {
                        for i in side.iter().map(|i| i.index()) {
                            let expected = 0.5 * run.irradiance[i].x;
                            assert!((run.radiosity[i].x - expected).abs() <= 1e-6 * expected);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn sampling_the_lamp_gives_the_same_light_as_form_factors_alone() {
    let scene = furnished_room(0.25);
    let world = World::new(&scene, 1);
    let solver = Solver::GaussSeidel;
    // Each patch, not a sum: 32 seeds of either, the difference in its own standard error.
    let by_pairs = Choices { samples: 16, ..settings(Method::Pairs, solver) };
    let through_matrix = irradiances(&world, &by_pairs, 100..132);
    for method in METHODS {
        for solver in [solver, Solver::Southwell] {
            let samples = if method == Method::Pairs { 16 } else { 64 };
            let direct = Choices { samples, direct_samples: 16, ..settings(method, solver) };
            let apart = irradiances(&world, &direct, 0..32);
            let mut squares = 0.0;
            for (i, (a, b)) in through_matrix.iter().zip(&apart).enumerate() {
                let error = a.standard_error.hypot(b.standard_error);
                // The lamp's own plane sees none of its light; nothing varies there.
                let z = if a.mean == b.mean { 0.0 } else { (a.mean - b.mean) / error };
                squares += z * z / world.mesh.len() as f64;
                assert!(z.abs() <= 4.0, "{method:?}, {solver:?}: patch {i}: {a:?} {b:?}: {z} SE");
            }
            println!("{method:?}, {solver:?}: mean square {squares:.2} of the differences in SE");
        }
    }
}

#[test]
fn solvers_agree_and_threads_do_not_matter() {
    let scene = furnished_room(0.25);
    let world = World::new(&scene, 1);
    let threads = |n: usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
    for method in METHODS {
        for direct_samples in [0, 16] {
            let mut solutions = Vec::new();
            for solver in SOLVERS {
                let settings = Choices { direct_samples, ..settings(method, solver) };
                let on = |n: usize| threads(n).install(|| light(&world, &settings));
                let (one, many) = (on(1), on(3));
                assert_eq!(one.radiosity, many.radiosity, "{method:?}, {solver:?}");
                assert_eq!(one.irradiance, many.irradiance, "{method:?}, {solver:?}");
                assert_eq!(one.residuals, many.residuals, "{method:?}, {solver:?}");
                assert_eq!(one.energy, many.energy, "{method:?}, {solver:?}");
                assert_eq!(one.rays, many.rays, "{method:?}, {solver:?}");
                assert_eq!(one.reciprocity_defect, many.reciprocity_defect);
                // B = E + ρH up to the residual: Σ A|r| is at most τ times the source's power, and the
                // source is E or the first bounce of its light, which is less.
                for i in all(&world.mesh) {
                    let (b, h) = (one.radiosity[i.index()], one.irradiance[i.index()]);
                    let reflected = world.mesh.reflectance(i).as_dvec3() * h;
                    let left =
                        (world.mesh.exitance(i).as_dvec3() + reflected - b) * world.mesh.area(i);
                    let allowed = tolerance(solver) * 0.0625 * 4.0 * PI + 1e-12;
                    assert!(
                        left.abs().max_element() <= allowed,
                        "{method:?}, {solver:?}: {i:?}: {left}"
                    );
                }
                solutions.push((settings, one));
            }
            for (settings, found) in &solutions[1..] {
                // Shooting reads rays' rows backwards: another matrix where F is not reciprocal.
                if (method, settings.solver) == (Method::Hemisphere, Solver::Southwell) {
                    continue;
                }
                // Each is within τ Σ A S / (min A (1 − max ρ s)) of the matrix's one solution.
                let sums =
                    received(&world, settings).into_iter().map(|row| row.iter().sum::<f64>());
                let kappa = 0.9 * sums.fold(0.0, f64::max);
                let source: f64 = 0.0625 * 4.0 * PI;
                let reached = tolerance(SOLVERS[0]) + tolerance(settings.solver);
                let bound = reached * source / (smallest_area(&world) * (1.0 - kappa));
                assert!(kappa < 1.0);
                for (i, (a, b)) in solutions[0].1.radiosity.iter().zip(&found.radiosity).enumerate()
                {
                    let error = (*a - *b).abs().max_element();
                    assert!(
                        error <= bound,
                        "{:?}: patch {i}: {error:e} {bound:e}",
                        settings.solver
                    );
                }
            }
        }
    }
}

#[test]
fn metres_change_the_watts_and_scale_changes_nothing() {
    let small = furnished_room(0.25);
    let large = crate::scenes::scaled(&small, 64.0);
    let world = |scene| World::new(scene, 1);
    for (method, direct_samples) in [(Method::Pairs, 0), (Method::Hemisphere, 16)] {
        let settings = Choices { direct_samples, ..settings(method, Solver::GaussSeidel) };
        let (a, b) = (light(&world(&small), &settings), light(&world(&large), &settings));
        assert_eq!(a.radiosity, b.radiosity, "{method:?}");
        assert_eq!(a.energy.absorbed * 4096.0, b.energy.absorbed, "{method:?}");
    }
}

#[test]
fn a_matrix_that_does_not_fit_is_refused_with_both_sizes_and_a_way_out() {
    let scene = furnished_room(0.25);
    let world = World::new(&scene, 3);
    let patches = world.mesh.len();
    for (method, bytes, way_out) in [
        (Method::Pairs, ExchangeMatrix::bytes_needed(patches), "hemispheres"),
        (Method::Hemisphere, HemisphereRows::bytes_needed(patches, 256), "fewer samples"),
    ] {
        let with = |limit| Choices {
            memory_limit: Some(limit),
            stop: Stop::Tolerance(1e-3),
            ..settings(method, Solver::GaussSeidel)
        };
        let message = refusal(&world, &with(4096));
        for part in [
            &format!("{patches} patches"),
            &indicatif::BinaryBytes(bytes).to_string(),
            "4.00 KiB",
            way_out,
            "larger patches",
            "Southwell",
        ] {
            assert!(message.contains(part), "{method:?}: {part} is not in: {message}");
        }
        // The size is the limit: one byte less is refused, and shooting needs no matrix at all.
        refusal(&world, &with(bytes - 1));
        if method == Method::Hemisphere {
            light(&world, &with(bytes));
            light(&world, &Choices { solver: Solver::Southwell, ..with(4096) });
        }
    }
}

#[test]
fn a_scene_without_light_is_refused() {
    let scene = scene([Piece::new(room())]);
    let world = World::new(&scene, 0);
    let message = refusal(&world, &settings(Method::Hemisphere, Solver::Southwell));
    assert!(message.contains("nothing in the scene emits light"), "{message}");
    assert!(message.contains("help: give a material an emission"), "{message}");
}

#[test]
fn a_closed_room_of_perfect_mirrors_to_light_is_refused() {
    let scene = scene([Piece::new(room()).reflecting(grey(1.0)).emitting(grey(1.0))]);
    let world = World::new(&scene, 1);
    for solver in SOLVERS {
        let message = refusal(&world, &settings(Method::Hemisphere, solver));
        assert!(message.contains("does not converge"), "{solver:?}: {message}");
    }
}
