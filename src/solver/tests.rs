//! The solvers against a direct one, on small problems with random numbers.

use super::*;
use crate::bvh::Bvh;
use crate::form_factor::{Estimator, OnDemand, Row, row_sums};
use crate::geometry::Triangle;
use crate::patches::{PatchId, Subdivision};
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::{Material, MaterialId, Scene};
use glam::Vec3;
use std::sync::Mutex;

const METHODS: [MatrixMethod; 2] = [MatrixMethod::Jacobi, MatrixMethod::GaussSeidel];

fn quiet() {}

fn to(tolerance: f64) -> Stop {
    Stop::Tolerance(tolerance)
}

fn exactly(iterations: usize) -> Stop {
    Stop::Iterations(iterations)
}

/// A stream of numbers in [0, 1).
fn numbers(seed: u64) -> impl FnMut() -> f64 {
    let stream = Stream::new(seed, Purpose::Pixel, 0, PointSet::Random);
    let mut index = 0;
    move || {
        index += 1;
        stream.point(index)[0] as f64
    }
}

/// A closed room from (0, 0, 0) to (1, 1, 1) with some random triangles floating in it.
fn room(floating: usize, seed: u64) -> Scene {
    let mut triangles = Vec::new();
    for (u, v, w) in
        [(Vec3::X, Vec3::Y, Vec3::Z), (Vec3::Y, Vec3::Z, Vec3::X), (Vec3::Z, Vec3::X, Vec3::Y)]
    {
        triangles.push(Triangle::new(Vec3::ZERO, u, u + v));
        triangles.push(Triangle::new(Vec3::ZERO, u + v, v));
        triangles.push(Triangle::new(w, w + u + v, w + u));
        triangles.push(Triangle::new(w, w + v, w + u + v));
    }
    let mut next = numbers(seed);
    let mut point = || Vec3::from_array([(); 3].map(|()| 0.1 + 0.8 * next() as f32));
    triangles.extend((0..floating).map(|_| Triangle::new(point(), point(), point())));
    let material_of = (0..triangles.len()).map(|t| MaterialId((t >= 12) as u32)).collect();
    let two_sided = Material { two_sided: true, ..Material::fallback() };
    Scene::new(triangles, material_of, vec![Material::fallback(), two_sided])
}

/// Random reflectances up to `most` and random sources, in every channel, zeros among them.
fn problem(mesh: &PatchMesh, most: f64, seed: u64) -> Problem {
    let mut next = numbers(seed + 100);
    let mut random = |scale: f64| Rgb64::new(scale * next(), scale * next(), scale * next());
    let mut problem = Problem::new(mesh, vec![Rgb64::ZERO; mesh.len()]);
    for i in 0..mesh.len() {
        problem.reflectance[i] = if i % 7 == 3 { Rgb64::ZERO } else { random(most) };
        problem.source[i] = if i % 3 == 1 { random(10.0) } else { Rgb64::ZERO };
    }
    problem
}

/// F as rows of numbers.
type Dense = Vec<Vec<f64>>;

fn dense(transport: &dyn Transport) -> Dense {
    let (n, rows) = (transport.len(), transport.rows().expect("rows"));
    (0..n)
        .map(|i| {
            let mut row = vec![0.0; n];
            rows.for_each_in_row(PatchId(i as u32), &mut |j, factor| row[j] += factor);
            row
        })
        .collect()
}

impl Rows for Dense {
    fn row(&self, i: PatchId) -> Row {
        let row = self[i.index()].iter().enumerate();
        let entries = row.filter(|(_, f)| **f > 0.0).map(|(j, &f)| (PatchId(j as u32), f));
        Row { entries: entries.collect(), on_backs: None }
    }
}

/// (I − ρF) B = S by Gaussian elimination with pivots, channel by channel.
fn direct_solution(problem: &Problem, f: &Dense) -> Vec<Rgb64> {
    let n = problem.len();
    let mut solution = vec![Rgb64::ZERO; n];
    for channel in 0..3 {
        let mut a: Dense = (0..n)
            .map(|i| {
                let scaled = |j: usize| problem.reflectance[i][channel] * f[i][j];
                (0..n).map(|j| (i == j) as u32 as f64 - scaled(j)).collect()
            })
            .collect();
        let mut b: Vec<f64> = problem.source.iter().map(|s| s[channel]).collect();
        for k in 0..n {
            let pivot = (k..n).max_by(|&p, &q| a[p][k].abs().total_cmp(&a[q][k].abs())).unwrap();
            a.swap(k, pivot);
            b.swap(k, pivot);
            let row = a[k].clone();
            for i in k + 1..n {
                let factor = a[i][k] / row[k];
                a[i][k..].iter_mut().zip(&row[k..]).for_each(|(x, y)| *x -= factor * y);
                b[i] -= factor * b[k];
            }
        }
        for i in (0..n).rev() {
            let known: f64 = (i + 1..n).map(|j| a[i][j] * solution[j][channel]).sum();
            solution[i][channel] = (b[i] - known) / a[i][i];
        }
    }
    solution
}

/// Σ_j F_ij x_j.
fn times(f: &Dense, x: &[Rgb64]) -> Vec<Rgb64> {
    f.iter().map(|row| row.iter().zip(x).map(|(f, x)| *x * *f).sum()).collect()
}

/// G_ji = F_ij A_i / A_j: what shooting reads off row i, whether or not F is reciprocal.
fn transposed(f: &Dense, areas: &[f64]) -> Dense {
    let n = f.len();
    (0..n).map(|j| (0..n).map(|i| f[i][j] * areas[i] / areas[j]).collect()).collect()
}

/// Σ A|S − (I − ρF)B| / Σ A S of the worst channel.
fn residual(problem: &Problem, f: &Dense, radiosity: &[Rgb64]) -> f64 {
    let incoming = times(f, radiosity);
    let (mut left, mut source) = (Rgb64::ZERO, Rgb64::ZERO);
    for i in 0..problem.len() {
        let missing = problem.source[i] + problem.reflectance[i] * incoming[i] - radiosity[i];
        left += missing.abs() * problem.areas[i];
        source += problem.source[i] * problem.areas[i];
    }
    (left / source).max_element()
}

/// B solves (I − ρF)(B − B*) = r for a residual r. In the largest-entry norm ρF shrinks by at least
/// κ = max ρ_i Σ_j F_ij < 1, and Σ A|r| ≤ τ Σ A S bounds each |r_i| by τ Σ A S / A_i. So every
/// |B_i − B*_i| ≤ τ Σ A S / (min A (1 − κ)).
fn largest_error(problem: &Problem, f: &Dense, tolerance: f64) -> f64 {
    let contraction = |i: usize| problem.reflectance[i].max_element() * f[i].iter().sum::<f64>();
    let kappa = (0..problem.len()).map(contraction).fold(0.0, f64::max);
    assert!(kappa < 1.0, "this problem does not contract: {kappa}");
    let least = problem.areas.iter().copied().fold(f64::INFINITY, f64::min);
    let source = problem.power(problem.source.iter().copied()).max_element();
    tolerance * source / (least * (1.0 - kappa))
}

#[track_caller]
fn assert_near(a: &[Rgb64], b: &[Rgb64], most: f64, what: &str) {
    for (i, (x, y)) in a.iter().zip(b).enumerate() {
        assert!(
            (*x - *y).abs().max_element() <= most,
            "{what}: patch {i}: {x} and {y}, ± {most:e}"
        );
    }
}

/// One number serves F_ij and F_ji.
fn is_by_pairs(transport: &dyn Transport) -> bool {
    transport.reciprocity_defect() == Some(0.0)
}

/// Rooms with random triangles, reflectances and sources, and both kinds of matrix.
fn for_each_problem(mut check: impl FnMut(&Problem, &dyn Transport, &Estimator, &str)) {
    for seed in 0..4 {
        let scene = room(6 * seed as usize, seed);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).unwrap();
        let (bvh, quiet) = (<Bvh>::build(scene.triangles.clone()), quiet());
        let estimator = Estimator::new(&bvh, &mesh, 64, PointSet::Sobol, seed, &quiet);
        let problem = problem(&mesh, 0.8, seed);
        let pairs = estimator.exchange_matrix();
        let rays = estimator.hemisphere_rows();
        check(&problem, &pairs, &estimator, &format!("pairs, seed {seed}"));
        check(&problem, &rays, &estimator, &format!("hemisphere, seed {seed}"));
    }
}

#[test]
fn jacobi_and_gauss_seidel_agree_with_elimination() {
    for_each_problem(|problem, form_factors, _, name| {
        let f = dense(form_factors);
        let exact = direct_solution(problem, &f);
        for method in METHODS {
            for tolerance in [1e-3, 1e-6, 1e-12] {
                let found = problem.solve(form_factors, method, to(tolerance), &quiet()).unwrap();
                let bound = largest_error(problem, &f, tolerance);
                let what = format!("{method:?} to {tolerance:e}, {name}");
                assert_near(&found.radiosity, &exact, bound, &what);
                // Sums of at most 200 terms of one sign.
                let irradiance = times(&f, &found.radiosity);
                assert_near(&found.irradiance, &irradiance, 1e-12, &what);
            }
        }
    });
}

#[test]
fn southwell_agrees_with_elimination_whatever_its_rows() {
    let mut checked = Vec::new();
    for_each_problem(|problem, form_factors, _, name| {
        // It gathers with G. Its B misses ρ G u for an unshot u with Σ A u ≤ τ Σ A S; G brings each
        // unit of power shot by i to Σ_j F_ij patches, so with ρ Σ F ≤ 1 that residual's power is
        // at most u's, and the bound is G's own.
        let f = dense(form_factors);
        let g = transposed(&f, &problem.areas);
        let exact = direct_solution(problem, &g);
        let kappa =
            (0..g.len()).map(|i| problem.reflectance[i].max_element() * g[i].iter().sum::<f64>());
        if kappa.fold(0.0, f64::max) > 0.99 {
            return; // Slivers with few rays receive too much: the bound below does not hold.
        }
        checked.push(name.to_string());
        for tolerance in [1e-3, 1e-6, 1e-10] {
            let found = problem.shoot(&f, to(tolerance), &quiet()).unwrap();
            let what = format!("shooting to {tolerance:e}, {name}");
            assert_near(&found.radiosity, &exact, largest_error(problem, &g, tolerance), &what);
        }
    });
    // At least every matrix by pairs and the hemisphere's of the room without slivers.
    assert!(checked.len() >= 5, "{checked:?}");
}

#[test]
fn southwell_with_pairs_on_demand_finds_what_the_matrix_gives() {
    for_each_problem(|problem, form_factors, estimator, name| {
        if !is_by_pairs(form_factors) {
            return;
        }
        let f = dense(form_factors);
        let exact = direct_solution(problem, &f);
        let shot = problem.shoot(&OnDemand::pairs(estimator), to(1e-3), &quiet()).unwrap();
        assert_near(&shot.radiosity, &exact, largest_error(problem, &f, 1e-3), name);
        let sums = row_sums(form_factors.rows().expect("rows"), form_factors.len());
        for (i, sum) in shot.row_sums.iter().enumerate() {
            // The same entries in the same order.
            assert!(sum.is_none_or(|sum| sum == sums[i]), "{name}: row {i}: {sum:?} {}", sums[i]);
        }
        // And the same bits whether rows come from a matrix or from rays.
        let stored = problem.shoot(&f, to(1e-3), &quiet()).unwrap();
        assert_eq!(shot.radiosity, stored.radiosity, "{name}");
        assert_eq!(shot.residuals, stored.residuals, "{name}");
    });
}

#[test]
fn reported_residuals_are_what_an_independent_computation_finds() {
    for_each_problem(|problem, form_factors, _, name| {
        let f = dense(form_factors);
        for method in METHODS {
            for iterations in [1, 2, 5, 11] {
                let stop = exactly(iterations);
                let found = problem.solve(form_factors, method, stop, &quiet()).unwrap();
                let reported = found.residuals[iterations - 1];
                let ours = residual(problem, &f, &found.radiosity);
                // Both round each patch's terms by some hundred times 2⁻⁵³ of its radiosity.
                assert!(
                    (reported - ours).abs() <= 1e-12,
                    "{method:?}, {iterations} iterations, {name}: {reported:e}, not {ours:e}"
                );
            }
        }
    });
}

#[test]
fn southwells_residual_is_the_power_not_sent_yet_and_bounds_what_is_missing() {
    for_each_problem(|problem, form_factors, _, name| {
        let f = dense(form_factors);
        let g = transposed(&f, &problem.areas);
        for iterations in [1, 10, 100, 1000] {
            let found = problem.shoot(&f, exactly(iterations), &quiet()).unwrap();
            // H = G (B − unshot): elimination tells what was shot, from the irradiance alone.
            let shot = Problem {
                areas: problem.areas.clone(),
                reflectance: vec![Rgb64::ONE; problem.len()],
                source: found.irradiance.clone(),
            };
            // (I − (I − G)) shot = H.
            let identity_minus_g = (0..g.len())
                .map(|i| (0..g.len()).map(|j| (i == j) as u32 as f64 - g[i][j]).collect())
                .collect();
            let shot = direct_solution(&shot, &identity_minus_g);
            let unshot: Rgb64 =
                (0..g.len()).map(|i| (found.radiosity[i] - shot[i]) * problem.areas[i]).sum();
            let source = problem.power(problem.source.iter().copied());
            let expected = (unshot / source).max_element();
            let reported = found.residuals[iterations - 1];
            // G is well conditioned enough for 8 digits here.
            assert!(
                (reported - expected).abs() <= 1e-8,
                "{iterations} shots, {name}: {reported:e}, not {expected:e}"
            );
            let missing = residual(problem, &g, &found.radiosity);
            assert!(
                missing <= reported + 1e-12,
                "{iterations} shots, {name}: {missing} {reported}"
            );
        }
    });
}

#[test]
fn residuals_fall_monotonically_to_below_the_tolerance() {
    for_each_problem(|problem, form_factors, _, name| {
        if !is_by_pairs(form_factors) {
            return;
        }
        // With A_i F_ij = A_j F_ji an iteration takes a residual of power Σ A|r| to at most
        // Σ_j A_j |r_j| Σ_i ρ_i F_ji, a share of it below 1; so does each relaxation of one patch.
        for method in METHODS {
            let found = problem.solve(form_factors, method, to(1e-11), &quiet()).unwrap();
            let last = *found.residuals.last().unwrap();
            assert!(last <= 1e-11, "{method:?}, {name}: {last:e}");
            for (k, pair) in found.residuals.windows(2).enumerate() {
                assert!(pair[1] < pair[0], "{method:?}, {name}: {pair:?} at iteration {k}");
                assert!(pair[0] > 1e-11, "{method:?}, {name}: went on after iteration {k}");
            }
        }
        let found = problem.shoot(&dense(form_factors), to(1e-8), &quiet()).unwrap();
        let (last, before) = found.residuals.split_last().unwrap();
        assert!(*last <= 1e-8 && before.iter().all(|r| *r > 1e-8), "shooting, {name}: {last:e}");
    });
}

#[test]
fn gauss_seidel_needs_fewer_sweeps_than_jacobi() {
    for_each_problem(|problem, form_factors, _, name| {
        let sweeps = METHODS
            .map(|m| problem.solve(form_factors, m, to(1e-9), &quiet()).unwrap().residuals.len());
        assert!(sweeps[1] < sweeps[0], "{name}: Jacobi, Gauss-Seidel {sweeps:?}");
    });
}

#[test]
fn a_number_of_iterations_is_kept_exactly() {
    for_each_problem(|problem, form_factors, _, name| {
        for n in [0, 1, 7, 40] {
            for method in METHODS {
                let found = problem.solve(form_factors, method, exactly(n), &quiet()).unwrap();
                assert_eq!(found.residuals.len(), n, "{method:?}, {name}");
            }
            let found = problem.shoot(&dense(form_factors), exactly(n), &quiet()).unwrap();
            assert_eq!(found.residuals.len(), n, "shooting, {name}");
            let needed = found.row_sums.iter().flatten().count();
            assert!(needed <= n, "{name}: {needed} rows for {n} shots");
        }
        // Iteration k of Jacobi's adds bounce k: B = Σ (ρF)^k S.
        let f = dense(form_factors);
        let (mut bounce, mut sum) = (problem.source.clone(), problem.source.clone());
        for _ in 0..7 {
            let gathered = times(&f, &bounce);
            bounce = (0..f.len()).map(|i| problem.reflectance[i] * gathered[i]).collect();
            sum.iter_mut().zip(&bounce).for_each(|(s, b)| *s += *b);
        }
        let found = problem.solve(form_factors, MatrixMethod::Jacobi, exactly(7), &quiet());
        assert_near(&found.unwrap().radiosity, &sum, 1e-12, name);
    });
}

#[test]
fn shooting_starts_with_the_most_power_and_needs_no_row_that_has_none() {
    for_each_problem(|problem, form_factors, _, name| {
        let power = |i: &usize| problem.source[*i].element_sum() * problem.areas[*i];
        let brightest = (0..problem.len()).max_by(|a, b| power(a).total_cmp(&power(b))).unwrap();
        let found = problem.shoot(&dense(form_factors), exactly(1), &quiet()).unwrap();
        let asked: Vec<_> = (0..problem.len()).filter(|&i| found.row_sums[i].is_some()).collect();
        assert_eq!(asked, [brightest], "{name}");
    });
}

#[test]
fn channels_do_not_mix_and_light_is_linear() {
    for_each_problem(|problem, form_factors, _, name| {
        for method in METHODS {
            let solve = |p: &Problem| p.solve(form_factors, method, exactly(12), &quiet()).unwrap();
            let all = solve(problem);
            for channel in 0..3 {
                let only = Problem {
                    areas: problem.areas.clone(),
                    reflectance: problem
                        .reflectance
                        .iter()
                        .map(|r| Rgb64::splat(r[channel]))
                        .collect(),
                    source: problem.source.iter().map(|s| Rgb64::splat(s[channel])).collect(),
                };
                let one = solve(&only);
                for (i, b) in all.radiosity.iter().enumerate() {
                    let grey = Rgb64::splat(b[channel]);
                    assert_eq!(one.radiosity[i], grey, "{method:?}, {name}, patch {i}");
                }
            }
            let doubled = Problem {
                areas: problem.areas.clone(),
                reflectance: problem.reflectance.clone(),
                source: problem.source.iter().map(|s| *s * 2.0).collect(),
            };
            let twice: Vec<Rgb64> = all.radiosity.iter().map(|b| *b * 2.0).collect();
            assert_eq!(solve(&doubled).radiosity, twice, "{method:?}, {name}");
        }
    });
}

#[test]
fn a_black_patch_keeps_its_own_light_and_without_a_source_all_is_dark() {
    for_each_problem(|problem, form_factors, _, name| {
        let dark = Problem {
            areas: problem.areas.clone(),
            reflectance: problem.reflectance.clone(),
            source: vec![Rgb64::ZERO; problem.len()],
        };
        let f = dense(form_factors);
        let solve = |p: &Problem| {
            let by_shooting = p.shoot(&f, to(1e-6), &quiet()).unwrap();
            let by_matrix = METHODS.map(|m| p.solve(form_factors, m, to(1e-6), &quiet()).unwrap());
            by_matrix.into_iter().chain([by_shooting]).collect::<Vec<_>>()
        };
        for found in solve(problem) {
            for i in (0..problem.len()).filter(|&i| problem.reflectance[i] == Rgb64::ZERO) {
                assert_eq!(found.radiosity[i], problem.source[i], "{name}: patch {i}");
            }
        }
        for found in solve(&dark) {
            assert!(found.radiosity.iter().all(|b| *b == Rgb64::ZERO), "{name}");
        }
    });
}

#[test]
fn light_that_never_leaves_a_closed_loop_is_refused() {
    let scene = room(0, 0);
    let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).unwrap();
    let (bvh, quiet) = (<Bvh>::build(scene.triangles.clone()), quiet());
    let estimator = Estimator::new(&bvh, &mesh, 64, PointSet::Sobol, 0, &quiet);
    let rows = estimator.hemisphere_rows();
    let f = dense(&rows);
    let all_white = vec![Rgb64::ONE; mesh.len()];
    let one_channel = vec![Rgb64::new(0.5, 1.0, 0.5); mesh.len()];
    let beyond = vec![Rgb64::splat(1.5); mesh.len()];
    for (name, reflectance) in [("1", all_white), ("1 in green", one_channel), ("1.5", beyond)] {
        let problem = Problem { reflectance, ..Problem::new(&mesh, vec![Rgb64::ONE; mesh.len()]) };
        let mut answers: Vec<Result<Converged>> =
            METHODS.iter().map(|&m| problem.solve(&rows, m, to(1e-3), &quiet)).collect();
        answers.push(problem.shoot(&f, to(1e-3), &quiet));
        for answer in answers {
            let error = answer.expect_err(name).to_string();
            // It is refused for the patch, before iterations show that they lead nowhere.
            assert!(error.contains("does not converge: patch "), "{name}: {error}");
            assert!(error.contains("help: lower reflectances"), "{name}: {error}");
        }
    }
}

/// One patch that absorbs is enough: each row of the others still sums to 1, and the light ends.
#[test]
fn white_walls_converge_in_a_closed_room_where_one_patch_absorbs() {
    let scene = room(0, 0);
    let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).unwrap();
    let (bvh, quiet) = (<Bvh>::build(scene.triangles.clone()), quiet());
    let estimator = Estimator::new(&bvh, &mesh, 64, PointSet::Sobol, 0, &quiet);
    let rows = estimator.hemisphere_rows();
    let f = dense(&rows);
    // What is black has no light to send, but all that see it lose some.
    for (absorbing, own) in [(0.5, 1.0), (0.0, 0.0)] {
        let mut problem = Problem::new(&mesh, vec![Rgb64::ONE; mesh.len()]);
        problem.reflectance = vec![Rgb64::ONE; mesh.len()];
        problem.reflectance[0] = Rgb64::splat(absorbing);
        problem.source[0] = Rgb64::splat(own);
        for method in METHODS {
            problem.solve(&rows, method, to(1e-6), &quiet).unwrap();
        }
        problem.shoot(&f, to(1e-6), &quiet).unwrap();
    }
}

/// Rows that remember which of them were asked for, round by round.
struct Remembered<'f>(&'f Dense, Mutex<Vec<Vec<usize>>>);

impl Rows for Remembered<'_> {
    fn row(&self, i: PatchId) -> Row {
        self.0.row(i)
    }

    fn rows_of(&self, patches: &[PatchId]) -> Vec<Row> {
        self.1.lock().unwrap().push(patches.iter().map(|i| i.index()).collect());
        patches.iter().map(|&i| self.row(i)).collect()
    }
}

#[test]
fn the_first_round_takes_the_brightest_that_hold_three_quarters_of_the_power() {
    for_each_problem(|problem, form_factors, _, name| {
        let f = dense(form_factors);
        let power = |i: usize| problem.source[i].element_sum() * problem.areas[i];
        let mut by_power: Vec<usize> = (0..problem.len()).collect();
        by_power.sort_by(|&i, &j| power(j).total_cmp(&power(i)));
        let all: f64 = by_power.iter().map(|&i| power(i)).sum();
        let held = |count: usize| by_power[..count].iter().map(|&i| power(i)).sum::<f64>();
        let holders = (0..).find(|&count| held(count) >= 0.75 * all).unwrap();
        assert!(holders > 2, "{name}: {holders}");
        for (shots, expected) in [(holders, holders), (10 * problem.len(), holders), (2, 2)] {
            let rows = Remembered(&f, Mutex::default());
            let found = problem.shoot(&rows, exactly(shots), &quiet()).unwrap();
            let asked = rows.1.into_inner().unwrap();
            assert_eq!(asked[0], by_power[..expected], "{name}, {shots} shots");
            // No row is traced that does not shoot.
            assert_eq!(asked.concat().len(), shots, "{name}");
            assert_eq!(found.iterations, shots, "{name}");
        }
    });
}

#[test]
fn a_patch_shoots_what_the_shots_before_it_in_its_round_sent() {
    // Both lamps shoot in round one; the second one sends on what the first one sent it.
    let f: Dense = vec![vec![0.0, 0.5, 0.25], vec![0.25, 0.0, 0.5], vec![0.25, 0.5, 0.0]];
    let problem = Problem {
        areas: vec![1.0; 3],
        reflectance: vec![Rgb64::splat(0.5); 3],
        source: vec![Rgb64::splat(8.0), Rgb64::splat(4.0), Rgb64::ZERO],
    };
    let rows = Remembered(&f, Mutex::default());
    let found = problem.shoot(&rows, exactly(2), &quiet()).unwrap();
    assert_eq!(rows.1.into_inner().unwrap()[0], [0, 1]);
    // Patch 0 sends 4 to 1 and 2 to 2. Patch 1 sends 4 + 4/2 = 6: 1.5 to 0 and 3 to 2.
    assert_eq!(found.irradiance, [1.5, 4.0, 5.0].map(Rgb64::splat));
    assert_eq!(found.radiosity, [8.75, 6.0, 2.5].map(Rgb64::splat));
    // Unshot are 0.75 and 2.5 of 12.
    assert_eq!(found.residuals.last(), Some(&(3.25 / 12.0)));
}

#[test]
fn white_patches_are_welcome_where_light_can_leave() {
    // The same room without its ceiling and floor: no row sums to 1.
    let mut scene = room(0, 0);
    scene.triangles = scene.triangles[4..].into();
    scene.material_of = scene.material_of[4..].into();
    let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).unwrap();
    let (bvh, quiet) = (<Bvh>::build(scene.triangles.clone()), quiet());
    let estimator = Estimator::new(&bvh, &mesh, 256, PointSet::Sobol, 0, &quiet);
    let pairs = estimator.exchange_matrix();
    let f = dense(&pairs);
    let reflectance = vec![Rgb64::ONE; mesh.len()];
    let problem = Problem { reflectance, ..Problem::new(&mesh, vec![Rgb64::ONE; mesh.len()]) };
    let exact = direct_solution(&problem, &f);
    let bound = largest_error(&problem, &f, 1e-9);
    for method in METHODS {
        let found = problem.solve(&pairs, method, to(1e-9), &quiet).unwrap();
        assert_near(&found.radiosity, &exact, bound, &format!("{method:?}"));
    }
    let found = problem.shoot(&f, to(1e-9), &quiet).unwrap();
    assert_near(&found.radiosity, &exact, bound, "shooting");
}

#[test]
fn light_that_grows_is_an_error_and_not_an_endless_loop() {
    // Two patches that send each other twice what they have, as estimates with few samples may.
    let rows: Dense = vec![vec![0.0, 2.0], vec![2.0, 0.0]];
    let problem = Problem {
        areas: vec![1.0; 2],
        reflectance: vec![Rgb64::splat(0.9); 2],
        source: vec![Rgb64::ONE, Rgb64::ZERO],
    };
    let error = problem.shoot(&rows, to(1e-6), &quiet()).unwrap_err().to_string();
    assert!(error.contains("the residual grew"), "{error}");
    // And one that neither grows nor falls: ρ F = 1.
    let rows: Dense = vec![vec![0.0, 1.25], vec![1.25, 0.0]];
    let steady = Problem { reflectance: vec![Rgb64::splat(0.8); 2], ..problem };
    let error = steady.shoot(&rows, to(1e-6), &quiet()).unwrap_err().to_string();
    assert!(error.contains("above the tolerance"), "{error}");
}

impl Transport for Dense {
    fn len(&self) -> usize {
        self.len()
    }

    fn gather(&self, radiosity: &[Rgb64]) -> Vec<Rgb64> {
        times(self, radiosity)
    }

    fn rows(&self) -> Option<&dyn Rows> {
        Some(self)
    }

    fn reciprocity_defect(&self) -> Option<f64> {
        None
    }
}

/// Two cavities of eight patches that lose 0.001 and 0.01 of their light with each bounce, and a patch outside.
fn white_cavities() -> (Problem, Dense) {
    let n = 17;
    let mut next = numbers(5);
    let mut f = vec![vec![0.0; n]; n];
    for (i, row) in f.iter_mut().enumerate().take(16) {
        let mut shares: Vec<f64> = (0..8).map(|_| 0.5 + next()).collect();
        let kept = if i < 8 { 0.999 } else { 0.99 } / shares.iter().sum::<f64>();
        shares.iter_mut().for_each(|share| *share *= kept);
        row[i / 8 * 8..][..8].copy_from_slice(&shares);
    }
    let reflectance = Rgb64::new(1.0, 0.999, 0.3);
    let mut source = vec![Rgb64::ZERO; n];
    for lit in [0, 9, 16] {
        source[lit] = Rgb64::new(1.0, 2.0, 3.0);
    }
    let areas = (0..n).map(|_| 0.5 + next()).collect();
    (Problem { areas, reflectance: vec![reflectance; n], source }, f)
}

#[test]
fn light_in_white_cavities_comes_within_a_few_sweeps_and_is_right() {
    let (problem, f) = white_cavities();
    let exact = direct_solution(&problem, &f);
    for method in METHODS {
        for tolerance in [1e-4, 1e-9] {
            let go_on = |mut sweeps: Sweeps| {
                let mut kept = Vec::new();
                let keep = &mut |sweeps: &Sweeps| {
                    kept.push(sweeps.clone());
                    Ok(())
                };
                let stop = to(tolerance);
                let found = problem.sweep(&f, method, stop, &mut sweeps, keep, &quiet()).unwrap();
                (found, kept)
            };
            let (found, kept) = go_on(Sweeps::none(&problem));
            let what = format!("{method:?} to {tolerance:e}: {} sweeps", found.iterations);
            println!("{what}, {:?}", found.slow_rate);
            assert!(found.iterations < 50, "{what}");
            for sweeps in kept {
                let (again, _) = go_on(sweeps);
                assert_eq!(again.radiosity, found.radiosity, "{what}");
                assert_eq!(again.residuals, found.residuals, "{what}");
            }
            let last = *found.residuals.last().expect("some");
            assert!(last <= tolerance, "{what}");
            let independent = residual(&problem, &f, &found.radiosity);
            assert!((independent / last - 1.0).abs() < 1e-3, "{what}: {independent:e}, {last:e}");
            // What is said to be left is at least what is.
            let power = |x: Vec<Rgb64>| problem.power(x.into_iter()).max_element();
            let off = found.radiosity.iter().zip(&exact).map(|(a, b)| *a - *b).collect();
            let off = power(off) / power(exact.clone());
            let left = problem.left(&found).expect("known");
            assert!(off <= left, "{what}: off by {off:e}, and {left:e} is said");
            // Without extrapolation that many sweeps are far from it.
            let sweeps = found.iterations;
            let pure = problem.solve(&f, method, exactly(sweeps), &quiet()).unwrap();
            assert!(pure.slow_rate.is_none() && *pure.residuals.last().unwrap() > 1e3 * last);
        }
    }
}

/// Some cavities that lose between 0.3 and 0.0003 of their light with each bounce, with random paints, and a reciprocal F.
fn random_cavities(seed: u64) -> (Problem, Dense) {
    let mut next = numbers(seed + 500);
    let cavities = 2 + (next() * 6.0) as usize;
    let n = 8 * cavities;
    let areas: Vec<f64> = (0..n).map(|_| 0.5 + next()).collect();
    let mut f = vec![vec![0.0; n]; n];
    let (mut reflectance, mut source) = (Vec::new(), vec![Rgb64::ZERO; n]);
    for cavity in 0..cavities {
        let patches = 8 * cavity..8 * cavity + 8;
        let kept = 1.0 - 0.3 * 10f64.powf(-3.0 * next());
        let mut exchange = [[0.0f64; 8]; 8];
        for (i, j) in (0..8).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            exchange[i][j] = 0.2 + next();
            exchange[j][i] = exchange[i][j];
        }
        // All rows pass on about as much, and none more than the cavity keeps.
        for _ in 0..50 {
            let sum = |i: usize| exchange[i].iter().sum::<f64>() / areas[8 * cavity + i];
            let sums: [f64; 8] = std::array::from_fn(sum);
            for (row, own) in exchange.iter_mut().zip(sums) {
                row.iter_mut().zip(sums).for_each(|(x, other)| *x /= (own * other).sqrt());
            }
        }
        let sums = patches.clone().map(|i| exchange[i % 8].iter().sum::<f64>() / areas[i]);
        let scale = kept / sums.fold(0.0, f64::max);
        for i in patches.clone() {
            for j in patches.clone() {
                f[i][j] = scale * exchange[i % 8][j % 8] / areas[i];
            }
        }
        let paint = Rgb64::new(1.0, 1.0 - 0.1 * next(), next());
        reflectance.extend(vec![paint; 8]);
        source[patches.start] = Rgb64::splat(10f64.powf(-2.0 * next()));
    }
    (Problem { areas, reflectance, source }, f)
}

#[test]
fn what_is_left_after_an_extrapolation_is_about_what_is_said() {
    let (mut cases, mut off_by_3, mut worst) = (0, 0, 0.0f64);
    for seed in 0..100 {
        let (problem, f) = random_cavities(seed);
        let exact = direct_solution(&problem, &f);
        for method in METHODS {
            for tolerance in [1e-3, 1e-4] {
                let found = problem.solve(&f, method, to(tolerance), &quiet()).unwrap();
                if found.slow_rate.is_none() {
                    continue;
                }
                let off = found.radiosity.iter().zip(&exact).map(|(a, b)| *a - *b);
                let power = problem.power(exact.iter().copied());
                let off = problem.power(off).element_sum() / power.element_sum();
                let ratio = off / problem.left(&found).expect("known");
                cases += 1;
                off_by_3 += (ratio > 3.0) as u32;
                worst = worst.max(ratio);
            }
        }
    }
    println!(
        "{off_by_3} of {cases} are off by more than three times what is said, at most {worst:.1}"
    );
    assert!(cases > 200 && off_by_3 < cases / 50 && worst < 4.0);
}
