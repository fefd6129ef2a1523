//! The arguments of `isolux render` and `isolux solve`.

use crate::error::{Error, Result};
use crate::geometry::KernelKind;
use crate::radiosity::{Method, Solver};
use crate::sampling::PointSet;
use crate::scene::Camera;
use crate::solver::{MatrixMethod, Stop};
use clap::ValueEnum;
use glam::Vec3;
use std::path::PathBuf;

/// Solve a scene's radiosity and draw it.
#[derive(clap::Args)]
pub struct RenderArguments {
    /// A scene description (.toml), a model (.obj), or solved light (.light)
    pub scene: PathBuf,

    /// Picture to write: .png (sRGB), .exr or .hdr (linear radiance). With several shadings
    /// room.png becomes room-flat.png and room-smooth.png
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,

    /// Width and height in pixels [default: the scene's, else 640x480]
    #[arg(long, value_name = "WxH", value_parser = parse_size, help_heading = "Picture")]
    pub size: Option<[u32; 2]>,

    /// Samples a pixel [default: the scene's, else 16]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20),
          help_heading = "Picture")]
    pub spp: Option<u32>,

    /// How patches look: constant, or interpolated; several share one solve
    #[arg(long, value_delimiter = ',', default_value = "smooth", help_heading = "Picture")]
    pub shading: Vec<ShadingName>,

    /// Angle in degrees up to which smooth shading carries light over an edge
    #[arg(long, value_name = "DEGREES", default_value_t = 30.0, value_parser = parse_crease,
          help_heading = "Picture")]
    pub crease: f32,

    /// Factor from radiance to display brightness; 1 is white. For PNG [default: the scene's, else
    /// automatic]
    #[arg(long, value_name = "FACTOR", value_parser = parse_positive, help_heading = "Picture")]
    pub exposure: Option<f32>,

    #[command(flatten)]
    pub view: ViewArguments,

    #[command(flatten)]
    pub light: LightArguments,

    #[command(flatten)]
    pub run: RunArguments,
}

/// A camera from the command line.
#[derive(clap::Args)]
pub struct ViewArguments {
    /// Look from here, in the scene's coordinates [default: the scene's camera, else one that is fitted]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true,
          requires = "look_at", help_heading = "Picture")]
    position: Option<Vec3>,

    /// Look at this point
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true,
          requires = "position", help_heading = "Picture")]
    look_at: Option<Vec3>,

    /// The direction that is up in the picture
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true,
          requires = "position", help_heading = "Picture")]
    up: Option<Vec3>,

    /// Vertical field of view in degrees
    #[arg(long, value_name = "DEGREES", requires = "position", help_heading = "Picture")]
    fov: Option<f32>,
}

impl ViewArguments {
    /// # Errors
    /// See [`Camera::new`].
    pub fn camera(&self) -> Result<Option<Camera>> {
        let (Some(position), Some(look_at)) = (self.position, self.look_at) else {
            return Ok(None);
        };
        let up = self.up.unwrap_or(Camera::USUAL_UP);
        Camera::new(position, look_at, up, self.fov.unwrap_or(Camera::USUAL_FOV), 0.0).map(Some)
    }
}

/// How the light is solved. Nothing is filled in here, so that what was typed can be told from defaults.
#[derive(Clone, Default, PartialEq, clap::Args)]
pub struct LightArguments {
    /// Split every triangle into 4^N patches
    #[arg(long, value_name = "N", conflicts_with = "max_edge", help_heading = "Light")]
    pub levels: Option<u32>,

    /// Split triangles until no patch edge is longer, in the scene's units [default: the scene's,
    /// else a length that makes about 40000 patches]
    #[arg(long, value_name = "LENGTH", help_heading = "Light")]
    pub max_edge: Option<f64>,

    /// How form factors are estimated: samples of each pair of patches, or rays from each patch
    /// [default: hemisphere]
    #[arg(long, help_heading = "Light")]
    pub form_factors: Option<MethodName>,

    /// Samples a pair [default: 9], or rays a patch [default: 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20),
          help_heading = "Light")]
    pub samples: Option<u32>,

    /// Where samples lie: low-discrepancy, independent, or the centroids of a regular subdivision
    /// [default: sobol]
    #[arg(long, help_heading = "Light")]
    pub points: Option<PointsName>,

    /// Points of the emitters sampled for each patch's direct light; 0 leaves it to the form factors
    /// [default: 64 with --form-factors hemisphere if the emitters are small, else 0]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(..=1 << 20),
          help_heading = "Light")]
    pub direct: Option<u32>,

    /// How the radiosity equation is solved; southwell stores no matrix [default: gauss-seidel]
    #[arg(long, help_heading = "Light")]
    pub solver: Option<SolverName>,

    /// Relative residual at which to stop [default: 0.0001]
    #[arg(long, value_name = "X", value_parser = parse_tolerance, help_heading = "Light")]
    pub tolerance: Option<f64>,

    /// Do exactly N iterations (for southwell: shots), whatever the residual; not with --tolerance
    #[arg(long, value_name = "N", conflicts_with = "tolerance", help_heading = "Light")]
    pub iterations: Option<usize>,

    /// The most memory that a matrix may take, in MiB [default: 80 % of what is available]
    #[arg(long, value_name = "MIB", help_heading = "Light")]
    pub memory: Option<u64>,
}

impl LightArguments {
    /// A tolerance beside a number of iterations is refused; its default gives way.
    pub fn stop(&self) -> Stop {
        let tolerance = Stop::Tolerance(self.tolerance.unwrap_or(1e-4));
        self.iterations.map_or(tolerance, Stop::Iterations)
    }
}

/// What every run can be told.
#[derive(clap::Args)]
pub struct RunArguments {
    /// Ray–triangle intersection: the triangle's plane first, or Cramer's rule at once
    #[arg(long, default_value = "moller-trumbore", help_heading = "Run")]
    pub kernel: KernelName,

    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Run")]
    pub seed: u64,

    /// Threads [default: all cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024),
          help_heading = "Run")]
    pub threads: Option<u32>,

    /// Write the run's figures as JSON
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    pub stats: Option<PathBuf>,
}

impl RunArguments {
    /// Does `work` with the number of threads that was asked for.
    pub fn in_pool(&self, work: impl FnOnce() -> Result<()> + Send) -> Result<()> {
        let mut pool = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = self.threads {
            pool = pool.num_threads(threads as usize);
        }
        let pool =
            pool.build().map_err(|e| Error::new(format!("cannot start the threads: {e}")))?;
        pool.install(work)
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ShadingName {
    Flat,
    Smooth,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    Pairs,
    Hemisphere,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PointsName {
    Sobol,
    Random,
    Regular,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SolverName {
    Jacobi,
    GaussSeidel,
    Southwell,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum KernelName {
    Plane,
    MollerTrumbore,
}

fn parse_size(text: &str) -> std::result::Result<[u32; 2], String> {
    let parsed = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.parse(), h.parse()));
    match parsed {
        Some((Ok(0), _) | (_, Ok(0))) => Err("a picture needs at least one pixel".into()),
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("expected a width and a height such as 640x480".into()),
    }
}

fn parse_point(text: &str) -> std::result::Result<Vec3, String> {
    let numbers: Vec<f32> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 => Ok(Vec3::new(x, y, z)),
        _ => Err("expected three numbers such as 1,2.5,-3".into()),
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
