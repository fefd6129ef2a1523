//! From patches to their radiosity: form factors, direct light, solution, balance.

use crate::balance::{self, Misfit};
use crate::begun::{Begun, Keep, Unfinished};
use crate::color::{Rgb, Rgb64, luminance64};
use crate::direct::{DirectLight, SKY_SAMPLES};
use crate::error::{Error, ErrorKind, Result};
use crate::form_factor::{
    Estimator, ExchangeMatrix, HemisphereRows, Matrix, OnDemand, Row, Rows, row_sum_defect,
};
use crate::geometry::RayCaster;
use crate::light::EmittingTriangles;
use crate::memory;
use crate::patch_errors;
use crate::patches::{PatchId, PatchMesh};
use crate::progress::Progress;
use crate::sampling::PointSet;
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::{
    DIRECT_SAMPLES, HEMISPHERE_RAYS, MEMORY_PERCENT, PAIR_SAMPLES, PATHS, TOLERANCE,
};
pub use crate::settings::{Method, Solver};
use crate::solver::{Converged, MatrixMethod, Problem, Shots, Stop, Sweeps};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Everything that decides a solution, beside the patches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Choices {
    pub method: Method,
    /// Samples per pair, or rays per patch; in two levels paths per patch, which are rounded up to a multiple of 8.
    pub samples: u32,
    pub points: PointSet,
    /// Points of the emitters sampled for each patch's direct light; 0 lets the form factors carry
    /// the emitters' light like all other.
    pub direct_samples: u32,
    pub solver: Solver,
    pub stop: Stop,
    pub seed: u64,
    /// The most bytes a matrix may take. It does not change the light, and is not kept with it.
    #[serde(skip)]
    pub memory_limit: Option<u64>,
}

impl Choices {
    /// Fills in what the settings leave open by the defaults that suit the scene.
    ///
    /// # Errors
    /// A number of regular points that is no square; two levels with pairs, or with other points than
    /// low-discrepancy ones.
    pub fn new(settings: &Settings, scene: &Scene) -> Result<Choices> {
        let light = &settings.light;
        let method = light.form_factors.unwrap_or_default();
        let solver = light.solver.unwrap_or_default();
        let samples = light.samples.unwrap_or(match (method, solver) {
            (_, Solver::TwoLevel) => PATHS,
            (Method::Pairs, _) => PAIR_SAMPLES,
            (Method::Hemisphere, _) => HEMISPHERE_RAYS,
        });
        let points = light.points.unwrap_or_default();
        if solver == Solver::TwoLevel && (method, points) != Default::default() {
            return Err(Error::new("two levels with pairs, or with points that are not `sobol`")
                .remedy("two levels take hemispheres and low-discrepancy points: leave both choices out"));
        }
        if points == PointSet::Regular && samples.isqrt().pow(2) != samples {
            return Err(Error::new(format!("{samples} regular points"))
                .remedy("a triangle splits regularly into 1, 4, 9, 16, … parts: give a square"));
        }
        let sampled = method == Method::Hemisphere && EmittingTriangles::are_small(scene);
        let tolerance = Stop::Tolerance(light.tolerance.unwrap_or(TOLERANCE));
        Ok(Choices {
            method,
            samples,
            points,
            direct_samples: light.direct.unwrap_or(if sampled { DIRECT_SAMPLES } else { 0 }),
            solver,
            stop: light.iterations.map_or(tolerance, Stop::Iterations),
            seed: settings.seed,
            memory_limit: match light.memory {
                Some(mebibytes) => Some(mebibytes.saturating_mul(1 << 20)),
                None => memory::available().map(|bytes| bytes / 100 * MEMORY_PERCENT),
            },
        })
    }

    /// How the elements of a solution in two levels are solved.
    pub(crate) fn of_elements(&self) -> Choices {
        Choices { solver: Solver::default(), samples: HEMISPHERE_RAYS, ..*self }
    }

    /// At most how many rays a solution takes, with n patches: for each `samples` and `direct_samples` by
    /// hemispheres, or `samples` for each of n²/2 pairs. In two levels paths have two rays or more each.
    pub fn expected_rays(&self, patches: u64) -> u64 {
        let of_each = match (self.method, self.solver) {
            (_, Solver::TwoLevel) => 2 * self.samples as u64,
            (Method::Pairs, _) => (patches / 2).saturating_mul(self.samples as u64),
            (Method::Hemisphere, _) => self.samples as u64,
        };
        patches
            .saturating_mul(of_each.saturating_add(self.direct_samples as u64 + SKY_SAMPLES as u64))
    }
}

/// Power per channel in watts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Energy {
    /// By surfaces.
    pub emitted: Rgb64,
    /// By the sky, as far as it meets a surface.
    pub from_sky: Rgb64,
    /// By fronts that the light reached.
    pub absorbed: Rgb64,
    /// By the black backs of one-sided triangles. `None` where the form factors do not tell it from what
    /// escaped, as those between pairs.
    pub on_backs: Option<Rgb64>,
    /// By rays that left the scene; with `on_backs` unknown, also by those that met backs.
    pub escaped: Rgb64,
}

impl Energy {
    /// (absorbed + on backs + escaped) / (emitted + from the sky) − 1, of the channels' means: how far the
    /// estimates of one power lie apart. 0 without light.
    pub fn imbalance(&self) -> f64 {
        let arrives = (self.emitted + self.from_sky).element_sum();
        let goes = self.absorbed + self.on_backs.unwrap_or_default() + self.escaped;
        if arrives > 0.0 { goes.element_sum() / arrives - 1.0 } else { 0.0 }
    }
}

/// The light in the scene.
pub struct Radiosity {
    /// B = E + ρH in W·m⁻², per patch.
    pub radiosity: Vec<Rgb64>,
    /// H in W·m⁻², per patch.
    pub irradiance: Vec<Rgb64>,
    /// The standard error of the luminance of H, in W·m⁻²; empty where it is not known: by shooting, between pairs, with
    /// regular points or fewer than eight samples.
    pub error: Vec<f32>,
    /// See [`Converged::residuals`].
    pub residuals: Vec<f64>,
    /// Sweeps, or shots.
    pub iterations: usize,
    /// Σ_j F_ij: the largest departure from 1 over the rows that were needed, and over the rows that
    /// shooting made of them by reciprocity.
    pub row_sum_defect: f64,
    /// Σ A |Σ_j F_ij − 1| / Σ A over the rows that were needed.
    pub mean_row_sum_defect: f64,
    /// See [`Transport::reciprocity_defect`](crate::form_factor::Transport::reciprocity_defect); `None` where no matrix
    /// was stored.
    pub reciprocity_defect: Option<f64>,
    pub energy: Energy,
    /// How far the power may fail to balance.
    pub misfit: Misfit,
    pub rays: u64,
    pub transport_time: Duration,
    pub solve_time: Duration,
}

/// Memory per patch beside a matrix: numbers, exitance, direct light, source, reflectance,
/// two iterates, irradiance, row sums, vertices, of 4 to 24 bytes each, and their copies; seven times eight numbers
/// for its error; and seven iterates with their residuals where sweeps are slow.
const BYTES_PER_PATCH: u64 = 1000;

/// Estimates the transport of light between the patches and solves for their radiosity.
///
/// # Errors
/// No emitter, a matrix that does not fit, light that does not converge, or two levels, for which there have to be
/// elements beside the patches (see [`Plan::solve`](crate::plan::Plan::solve)); or `progress` asked to stop.
pub fn solve(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    settings: &Choices,
    progress: &dyn Progress,
) -> Result<Radiosity> {
    go_on(caster, mesh, settings, &mut Begun::default(), &mut |_| Ok(()), progress)
}

/// As [`solve`], from what is begun, which holds in the end all that was done. `keep` may store what is done, now and
/// then and before `progress` stops it.
///
/// # Errors
/// See [`solve`]; a beginning that no run can have made; or what `keep` says.
pub(crate) fn go_on(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    settings: &Choices,
    begun: &mut Begun,
    keep: &mut Keep,
    progress: &dyn Progress,
) -> Result<Radiosity> {
    if !mesh.scene.emits() && mesh.scene.sky == Rgb::ZERO {
        return Err(Error::new("nothing in the scene emits light: the picture would be black")
            .of_kind(ErrorKind::Dark)
            .remedy(
                "give a material an emission: Ke in the MTL file, or radiance in the scene \
                     description's [materials.NAME]; or leave the sky as it is",
            ));
    }
    check_memory(mesh, settings)?;
    let start = Instant::now();
    let estimator =
        Estimator::new(caster, mesh, settings.samples, settings.points, settings.seed, progress);
    begun.check(&estimator, settings.method)?;
    estimator.set_rays(begun.rays);
    let exitance: Vec<Rgb64> =
        (0..mesh.len()).map(|i| mesh.exitance(PatchId(i as u32)).as_dvec3()).collect();
    if begun.direct.is_none() {
        let (samples, seed) = (settings.direct_samples, settings.seed);
        begun.direct = Some(DirectLight::of(caster, mesh, samples, seed, progress)?);
        keep(begun.unfinished())?;
    }
    let direct = begun.direct.as_ref().expect("it was found");
    let source = (0..mesh.len())
        .map(|i| {
            let reflected = mesh.reflectance(PatchId(i as u32)).as_dvec3() * direct.irradiance(i);
            if direct.has_emitters() { reflected } else { exitance[i] + reflected }
        })
        .collect();
    let problem = Problem::new(mesh, source);
    let known = Unfinished { direct: Some(direct), ..Unfinished::default() };
    let method = match settings.solver {
        Solver::Jacobi => Some(MatrixMethod::Jacobi),
        Solver::GaussSeidel => Some(MatrixMethod::GaussSeidel),
        Solver::Southwell => None,
        Solver::TwoLevel => return Err(Error::new("two levels for one set of patches")),
    };
    let (transport_time, solution, reciprocity_defect, (error, by_samples)) = match method {
        Some(method) => {
            let matrix = begun.matrix.get_or_insert_with(|| no_matrix(&estimator, settings));
            estimator.in_stretches(matrix, &mut |matrix| {
                keep(Unfinished { matrix: Some(matrix), rays: estimator.rays(), ..known })
            })?;
            begun.rays = estimator.rays();
            let (matrix, transport_time) = (&*matrix, start.elapsed());
            let known = Unfinished { matrix: Some(matrix), rays: begun.rays, ..known };
            let sweeps = begun.sweeps.get_or_insert_with(|| Sweeps::none(&problem));
            let keep = &mut |sweeps: &Sweeps| keep(Unfinished { sweeps: Some(sweeps), ..known });
            let matrix = matrix.transport();
            let solution = problem.sweep(matrix, method, settings.stop, sweeps, keep, progress)?;
            let errors = match (direct.eighths(), matrix.eighths()) {
                (Some(eighths), Some(by_rows)) => {
                    // Else the radiosity holds it.
                    let apart = if direct.has_emitters() { &exitance[..] } else { &[] };
                    let (light, by_samples) =
                        balance::by_eighths(eighths.clone(), by_rows, &problem, &solution, apart);
                    (patch_errors::of(light, by_rows, &problem, &solution), Some(by_samples))
                }
                _ => (Vec::new(), None),
            };
            (transport_time, solution, matrix.reciprocity_defect(), errors)
        }
        None => {
            let before = start.elapsed();
            let clock = Clock::default();
            let shots = begun.shots.get_or_insert_with(|| Shots::none(mesh.len()));
            let keep = &mut |shots: &Shots| {
                keep(Unfinished { shots: Some(shots), rays: estimator.rays(), ..known })
            };
            let rows = Timed(on_demand(&estimator, settings.method), &clock);
            let solution = problem.go_on_shooting(&rows, settings.stop, shots, keep, progress)?;
            begun.rays = estimator.rays();
            let transport_time = before + clock.elapsed();
            // Pairs are reciprocal by construction; of rays on demand no mirror image was seen.
            let reciprocity = (settings.method == Method::Pairs).then_some(0.0);
            (transport_time, solution, reciprocity, (Vec::new(), None))
        }
    };
    let iterations_leave =
        solution.residuals.last().map_or(0.0, |last| last * luminance64(problem.source_power()));
    let light = balance(mesh, &exitance, direct, solution, reciprocity_defect, |i| {
        on_demand(&estimator, settings.method).row(i)
    });
    // Only now: the balance may have traced rows that shooting never needed.
    let rays = estimator.rays() + direct.rays;
    let arrives = luminance64(light.energy.emitted + light.energy.from_sky)
        / mesh.scene.metres_per_unit.powi(2);
    let relative = |power: f64| if arrives > 0.0 { power / arrives } else { 0.0 };
    let misfit =
        Misfit { samples: by_samples.map(relative), iterations: relative(iterations_leave) };
    let light = Radiosity { error, misfit, ..light };
    Ok(light.timed(rays, transport_time, start.elapsed() - transport_time))
}

/// Works out what will be stored, before any of it is.
fn check_memory(mesh: &PatchMesh, settings: &Choices) -> Result<()> {
    let patches = mesh.len();
    let vectors = patches as u64 * BYTES_PER_PATCH;
    let what = format!("the light of {patches} patches");
    memory::check(&what, vectors, memory::available(), "take larger patches")?;
    if settings.solver == Solver::Southwell {
        return Ok(());
    }
    let (bytes, remedy) = match settings.method {
        Method::Pairs => (
            ExchangeMatrix::bytes_needed(patches),
            "take larger patches, use hemispheres, or Southwell's method, which stores no matrix",
        ),
        Method::Hemisphere => (
            HemisphereRows::bytes_needed(patches, settings.samples),
            "take larger patches or fewer samples, or two levels or Southwell's method, which store no matrix",
        ),
    };
    let what = format!("the form-factor matrix of {patches} patches");
    memory::check(&what, bytes, settings.memory_limit, remedy)
}

fn no_matrix(of: &Estimator, settings: &Choices) -> Matrix {
    match settings.method {
        Method::Pairs => Matrix::Pairs(ExchangeMatrix::none(of)),
        Method::Hemisphere => Matrix::Hemisphere(HemisphereRows::none(of)),
    }
}

/// Time spent in a part of the work that comes in pieces.
#[derive(Default)]
struct Clock(AtomicU64);

impl Clock {
    fn elapsed(&self) -> Duration {
        Duration::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// Rows that are timed where many are made at once: each alone, on several threads, would count double.
struct Timed<'c>(Box<dyn Rows + 'c>, &'c Clock);

impl Rows for Timed<'_> {
    fn row(&self, i: PatchId) -> Row {
        self.0.row(i)
    }

    fn rows_of(&self, patches: &[PatchId]) -> Vec<Row> {
        let start = Instant::now();
        let rows = self.0.rows_of(patches);
        self.1.0.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
        rows
    }
}

fn on_demand<'a>(of: &'a Estimator<'a>, method: Method) -> Box<dyn Rows + 'a> {
    match method {
        Method::Pairs => Box::new(OnDemand::pairs(of)),
        Method::Hemisphere => Box::new(OnDemand::hemisphere(of)),
    }
}

/// Adds the direct light to what the solver found, and follows the power.
fn balance(
    mesh: &PatchMesh,
    exitance: &[Rgb64],
    direct: &DirectLight,
    solution: Converged,
    reciprocity_defect: Option<f64>,
    missing_row: impl Fn(PatchId) -> Row,
) -> Radiosity {
    let Converged {
        mut radiosity,
        mut irradiance,
        residuals,
        iterations,
        mut row_sums,
        mut on_backs,
        reception_sums,
        slow_rate: _,
    } = solution;
    for i in 0..mesh.len() {
        if direct.has_emitters() {
            radiosity[i] += exitance[i];
        }
        irradiance[i] += direct.irradiance(i);
    }
    let square_metres = mesh.scene.metres_per_unit.powi(2);
    let (emitted, from_sky) = (Rgb64::ZERO, Rgb64::ZERO);
    let (absorbed, escaped) = (Rgb64::ZERO, Rgb64::ZERO);
    let mut energy = Energy { emitted, from_sky, absorbed, on_backs: None, escaped };
    for i in 0..mesh.len() {
        let patch = PatchId(i as u32);
        let area = mesh.opaque_area(patch) * square_metres;
        // Shooting never needs the row of an emitter whose light was sampled apart.
        if direct.has_emitters() && row_sums[i].is_none() && exitance[i] != Rgb64::ZERO {
            let row = missing_row(patch);
            row_sums[i] = Some(row.sum());
            on_backs[i] = row.on_backs;
        }
        energy.emitted += exitance[i] * area;
        energy.from_sky += direct.of_sky(i) * area;
        energy.absorbed += (1.0 - mesh.reflectance(patch).as_dvec3()) * irradiance[i] * area;
        let lost = radiosity[i] * area * row_sums[i].map_or(0.0, |sum| 1.0 - sum);
        let met_backs = on_backs[i].map(|share| radiosity[i] * area * share);
        energy.escaped += lost - met_backs.unwrap_or_default();
        energy.on_backs = match (energy.on_backs, met_backs) {
            (sum, None) => sum,
            (sum, Some(power)) => Some(sum.unwrap_or_default() + power),
        };
    }
    let mean_row_sum_defect = mean_row_sum_defect(mesh, &row_sums);
    let known: Vec<f64> = row_sums.into_iter().flatten().collect();
    Radiosity {
        radiosity,
        irradiance,
        error: Vec::new(),
        residuals,
        iterations,
        mean_row_sum_defect,
        row_sum_defect: row_sum_defect(&known)
            .max(reception_sums.map_or(0.0, |sums| row_sum_defect(&sums))),
        reciprocity_defect,
        energy,
        misfit: Misfit { samples: None, iterations: 0.0 },
        rays: 0,
        transport_time: Duration::ZERO,
        solve_time: Duration::ZERO,
    }
}

/// Σ A |Σ_j F_ij − 1| / Σ A over the known rows.
fn mean_row_sum_defect(mesh: &PatchMesh, row_sums: &[Option<f64>]) -> f64 {
    let (mut defect, mut area) = (0.0, 0.0);
    for (i, sum) in row_sums.iter().enumerate() {
        if let Some(sum) = sum {
            let a = mesh.area(PatchId(i as u32));
            defect += a * (sum - 1.0).abs();
            area += a;
        }
    }
    if area > 0.0 { defect / area } else { 0.0 }
}

impl Radiosity {
    fn timed(self, rays: u64, transport_time: Duration, solve_time: Duration) -> Self {
        Radiosity { rays, transport_time, solve_time, ..self }
    }
}
