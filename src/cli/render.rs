//! `isolux render`: from a scene to pictures.

use super::report::{Report, Seconds};
use super::{progress, say, warn};
use crate::bvh::AnyBvh;
use crate::coverage;
use crate::error::{Error, Result};
use crate::export::file::{Output, check_writable, write_all};
use crate::export::picture::Format;
use crate::geometry::KernelKind;
use crate::memory;
use crate::patches::{PatchMesh, Subdivision};
use crate::radiosity::{self, Method, Radiosity, Settings, Solver};
use crate::render::shading::{Flat, Shading, Smooth};
use crate::render::smooth::VertexIrradiance;
use crate::render::{self, Frame, Image, tone};
use crate::sampling::PointSet;
use crate::scene::topology::Topology;
use crate::scene::{Camera, Description, Scene};
use crate::solver::{MatrixMethod, Stop};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Patches that the subdivision aims at when nobody says: good and quick for a first picture.
const DEFAULT_PATCHES: usize = 40_000;

/// Solve a scene's radiosity and draw it.
#[derive(clap::Args)]
pub struct Arguments {
    /// A scene description (.toml) or a model (.obj)
    scene: PathBuf,

    /// Picture to write: .png (sRGB), .exr or .hdr (linear radiance). With several shadings
    /// room.png becomes room-flat.png and room-smooth.png
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Width and height in pixels [default: the scene's, else 640x480]
    #[arg(long, value_name = "WxH", value_parser = parse_size, help_heading = "Picture")]
    size: Option<[u32; 2]>,

    /// Samples a pixel [default: the scene's, else 16]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20),
          help_heading = "Picture")]
    spp: Option<u32>,

    /// How patches look: constant, or interpolated; several share one solve
    #[arg(long, value_delimiter = ',', default_value = "smooth", help_heading = "Picture")]
    shading: Vec<ShadingName>,

    /// Angle in degrees up to which smooth shading carries light over an edge
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, value_parser = parse_crease,
          help_heading = "Picture")]
    crease: f32,

    /// Factor from radiance to display brightness; 1 is white. For PNG [default: the scene's, else
    /// automatic]
    #[arg(long, value_name = "FACTOR", value_parser = parse_positive, help_heading = "Picture")]
    exposure: Option<f32>,

    /// Split every triangle into 4^N patches
    #[arg(long, value_name = "N", conflicts_with = "max_edge", help_heading = "Light")]
    levels: Option<u32>,

    /// Split triangles until no patch edge is longer, in the scene's units [default: the scene's,
    /// else a length that makes about 40000 patches]
    #[arg(long, value_name = "LENGTH", help_heading = "Light")]
    max_edge: Option<f64>,

    /// How form factors are estimated: samples of each pair of patches, or rays from each patch
    #[arg(long, default_value = "hemisphere", help_heading = "Light")]
    form_factors: MethodName,

    /// Samples a pair [default: 9], or rays a patch [default: 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 24),
          help_heading = "Light")]
    samples: Option<u32>,

    /// Where samples lie: low-discrepancy, independent, or the centroids of a regular subdivision
    #[arg(long, default_value = "sobol", help_heading = "Light")]
    points: PointsName,

    /// Points of the emitters sampled for each patch's direct light; 0 leaves it to the form factors
    /// [default: 64 with --form-factors hemisphere if the emitters are small, else 0]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=1 << 24),
          help_heading = "Light")]
    direct: Option<u32>,

    /// How the radiosity equation is solved; southwell stores no matrix
    #[arg(long, default_value = "gauss-seidel", help_heading = "Light")]
    solver: SolverName,

    /// Relative residual at which to stop
    #[arg(long, value_name = "X", default_value_t = 1e-4, value_parser = parse_tolerance,
          help_heading = "Light")]
    tolerance: f64,

    /// Do exactly N iterations (for southwell: shots), whatever the residual
    #[arg(long, value_name = "N", help_heading = "Light")]
    iterations: Option<usize>,

    /// Ray–triangle intersection: the triangle's plane first, or Cramer's rule at once
    #[arg(long, default_value = "moller-trumbore", help_heading = "Run")]
    kernel: KernelName,

    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Run")]
    seed: u64,

    /// Threads [default: all cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024),
          help_heading = "Run")]
    threads: Option<u32>,

    /// The most memory that a matrix may take, in MiB [default: 80 % of what is available]
    #[arg(long, value_name = "MIB", help_heading = "Run")]
    memory: Option<u64>,

    /// Write the run's figures as JSON
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    stats: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShadingName {
    Flat,
    Smooth,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MethodName {
    Pairs,
    Hemisphere,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PointsName {
    Sobol,
    Random,
    Regular,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SolverName {
    Jacobi,
    GaussSeidel,
    Southwell,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum KernelName {
    Plane,
    MollerTrumbore,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = arguments.threads {
        pool = pool.num_threads(threads as usize);
    }
    let pool = pool.build().map_err(|e| Error::new(format!("cannot start the threads: {e}")))?;
    pool.install(|| run_in_pool(arguments))
}

fn run_in_pool(arguments: &Arguments) -> Result<()> {
    let start = Instant::now();
    let pictures = pictures(arguments)?;

    let description = Description::load(&arguments.scene)?;
    let scene = Scene::load(&description)?;
    warn(&scene.warnings);
    let frame = frame(arguments, &description, pictures.len())?;
    let load = start.elapsed();

    let mesh = PatchMesh::subdivide(&scene, subdivision(arguments, &description))?;
    let settings = settings(arguments, &mesh)?;
    let caster = AnyBvh::build(&scene.triangles, arguments.kernel.into());
    let camera = match &description.camera {
        Some(camera) => camera.clone(),
        None => Camera::fitted(&scene.triangles, &caster),
    };
    let build = start.elapsed() - load;

    let light = radiosity::solve(&caster, &mesh, &settings, &|stage| match stage {
        "solve" | "shots" => progress::spinner(stage),
        _ => progress::bar(stage),
    })
    .map_err(|error| error.in_file_if_none(&arguments.scene))?;

    let rendering = Instant::now();
    let images = draw(arguments, &caster, &mesh, &camera, &frame, &pictures, &light);
    let given = arguments.exposure.or(description.image.exposure);
    let exposure = given.unwrap_or_else(|| tone::automatic_exposure(&images[0]));
    let mut outputs = encode(&pictures, &images, exposure)?;
    let render = rendering.elapsed();

    let report = Report {
        scene: description.title,
        triangles: scene.triangles.len(),
        patches: mesh.len(),
        open_edges: Topology::new(&scene.triangles).open_edges(),
        rays: light.rays + frame.rays(),
        transport_rays: light.rays,
        peak_memory_bytes: memory::peak(),
        seconds: Seconds {
            load: load.as_secs_f64(),
            build: build.as_secs_f64(),
            transport: light.transport_time.as_secs_f64(),
            solve: light.solve_time.as_secs_f64(),
            render: render.as_secs_f64(),
            total: start.elapsed().as_secs_f64(),
        },
        residuals: light.residuals,
        row_sum_defect: light.row_sum_defect,
        reciprocity_defect: light.reciprocity_defect,
        energy: light.energy.into(),
        exposure,
        automatic_exposure: given.is_none(),
        files: pictures.iter().map(|picture| picture.path.clone()).collect(),
    };
    if let Some(path) = &arguments.stats {
        outputs.push(Output { path: path.clone(), bytes: report.to_json() });
    }
    write_all(outputs)?;
    say(&report.to_text());
    Ok(())
}

/// One picture to be drawn.
struct Picture {
    shading: ShadingName,
    path: PathBuf,
    format: Format,
}

/// Names the output files and makes sure that they can be written, before anything is computed.
fn pictures(arguments: &Arguments) -> Result<Vec<Picture>> {
    let format = Format::of(&arguments.output)?;
    let mut shadings = arguments.shading.clone();
    shadings.dedup();
    let several = shadings.len() > 1;
    let pictures: Vec<Picture> = shadings
        .into_iter()
        .map(|shading| {
            let path = if several {
                with_suffix(&arguments.output, shading)
            } else {
                arguments.output.clone()
            };
            Picture { shading, path, format }
        })
        .collect();
    for path in pictures.iter().map(|picture| &picture.path).chain(&arguments.stats) {
        check_writable(path)?;
    }
    Ok(pictures)
}

/// room.png becomes room-flat.png.
fn with_suffix(path: &Path, shading: ShadingName) -> PathBuf {
    let name = shading.to_possible_value().expect("no name is hidden");
    let mut file = path.file_stem().unwrap_or_default().to_os_string();
    file.push("-");
    file.push(name.get_name());
    file.push(".");
    file.push(path.extension().unwrap_or_default());
    path.with_file_name(file)
}

fn frame(arguments: &Arguments, description: &Description, images: usize) -> Result<Frame> {
    let [width, height] = arguments.size.or(description.image.size).unwrap_or([640, 480]);
    if width == 0 || height == 0 || width > 1 << 16 || height > 1 << 16 {
        return Err(Error::new(format!("a picture of {width}x{height} pixels"))
            .remedy("give a width and a height from 1 to 65536"));
    }
    // Radiance while drawing, then again per image, then encoded.
    let bytes = width as u64 * height as u64 * images as u64 * 36;
    memory::check(
        &format!("a picture of {width}x{height} pixels"),
        bytes,
        memory::available(),
        "draw it smaller",
    )?;
    let samples = arguments.spp.or(description.image.samples).unwrap_or(16);
    if samples == 0 {
        return Err(Error::new("0 samples a pixel")
            .in_file(&description.file)
            .remedy("give at least one"));
    }
    Ok(Frame { width, height, samples, seed: arguments.seed })
}

/// Flags come before the description, and the description before the default.
fn subdivision(arguments: &Arguments, description: &Description) -> Subdivision {
    let defaults = &description.patches;
    match (arguments.levels, arguments.max_edge) {
        (Some(levels), _) => Subdivision::Levels(levels),
        (None, Some(length)) => Subdivision::MaxEdge(length),
        (None, None) => match (defaults.levels, defaults.max_edge) {
            (Some(levels), _) => Subdivision::Levels(levels),
            (None, Some(length)) => Subdivision::MaxEdge(length as f64),
            (None, None) => Subdivision::Count(DEFAULT_PATCHES),
        },
    }
}

fn settings(arguments: &Arguments, mesh: &PatchMesh) -> Result<Settings> {
    let method = arguments.form_factors.into();
    let samples = arguments.samples.unwrap_or(match method {
        Method::Pairs => 9,
        Method::Hemisphere => 256,
    });
    if arguments.points == PointsName::Regular && samples.isqrt().pow(2) != samples {
        return Err(Error::new(format!("{samples} regular points"))
            .remedy("a triangle splits regularly into 1, 4, 9, 16, … parts: give a square"));
    }
    let sampled = method == Method::Hemisphere && radiosity::has_small_emitters(mesh);
    let limit = match arguments.memory {
        Some(mebibytes) => Some(mebibytes.saturating_mul(1 << 20)),
        None => memory::available().map(|bytes| bytes / 5 * 4),
    };
    Ok(Settings {
        method,
        samples,
        points: arguments.points.into(),
        direct_samples: arguments.direct.unwrap_or(if sampled { 64 } else { 0 }),
        solver: arguments.solver.into(),
        stop: Stop { tolerance: arguments.tolerance, iterations: arguments.iterations },
        seed: arguments.seed,
        memory_limit: limit,
    })
}

fn draw(
    arguments: &Arguments,
    caster: &AnyBvh,
    mesh: &PatchMesh,
    camera: &Camera,
    frame: &Frame,
    pictures: &[Picture],
    light: &Radiosity,
) -> Vec<Image> {
    let uncovered = coverage::uncovered(caster, mesh);
    let shadings: Vec<Box<dyn Shading + '_>> = pictures
        .iter()
        .map(|picture| -> Box<dyn Shading> {
            match picture.shading {
                ShadingName::Flat => Box::new(Flat::new(mesh, &light.irradiance, &uncovered)),
                ShadingName::Smooth => {
                    let (light, crease) = (&light.irradiance, arguments.crease);
                    let vertices = VertexIrradiance::new(mesh, light, &uncovered, crease);
                    Box::new(Smooth::new(mesh, vertices))
                }
            }
        })
        .collect();
    let shadings: Vec<&dyn Shading> = shadings.iter().map(Box::as_ref).collect();
    let bar = progress::bar("render");
    let images = render::render(caster, mesh, camera, frame, &shadings, &bar);
    bar.finish_and_clear();
    images
}

fn encode(pictures: &[Picture], images: &[Image], exposure: f32) -> Result<Vec<Output>> {
    pictures
        .iter()
        .zip(images)
        .map(|(picture, image)| {
            let bytes = picture.format.encode(image, exposure)?;
            Ok(Output { path: picture.path.clone(), bytes })
        })
        .collect()
}

fn parse_size(text: &str) -> std::result::Result<[u32; 2], String> {
    let parsed = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.parse(), h.parse()));
    match parsed {
        Some((Ok(0), _) | (_, Ok(0))) => Err("a picture needs at least one pixel".into()),
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("expected a width and a height such as 640x480".into()),
    }
}

fn parse_positive(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a number above zero".into()),
    }
}

fn parse_crease(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if (0.0..=180.0).contains(&x) => Ok(x),
        _ => Err("expected an angle from 0 to 180 degrees".into()),
    }
}

fn parse_tolerance(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        // Sums of f64 leave a relative residual near 1e-15.
        Ok(x) if (1e-14..1.0).contains(&x) => Ok(x),
        _ => Err("expected a number from 1e-14 to 1; for a fixed number of iterations use \
                  --iterations"
            .into()),
    }
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Pairs => Method::Pairs,
            MethodName::Hemisphere => Method::Hemisphere,
        }
    }
}

impl From<PointsName> for PointSet {
    fn from(name: PointsName) -> Self {
        match name {
            PointsName::Sobol => PointSet::Sobol,
            PointsName::Random => PointSet::Random,
            PointsName::Regular => PointSet::Regular,
        }
    }
}

impl From<SolverName> for Solver {
    fn from(name: SolverName) -> Self {
        match name {
            SolverName::Jacobi => Solver::Matrix(MatrixMethod::Jacobi),
            SolverName::GaussSeidel => Solver::Matrix(MatrixMethod::GaussSeidel),
            SolverName::Southwell => Solver::Southwell,
        }
    }
}

impl From<KernelName> for KernelKind {
    fn from(name: KernelName) -> Self {
        match name {
            KernelName::Plane => KernelKind::Plane,
            KernelName::MollerTrumbore => KernelKind::MollerTrumbore,
        }
    }
}
