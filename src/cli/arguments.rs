//! The arguments of `isolux render` and `isolux solve`.

use crate::color::Rgb;
use crate::error::{Error, ErrorKind, Result};
use crate::geometry::KernelKind;
use crate::render::{Background, Frame};
use crate::scene::Camera;
use crate::scene::Document;
use crate::scene::camera::is_view_name;
use crate::scene::is_radiance;
use crate::settings::{LightSettings, MAX_SAMPLES, PatchSettings, Settings};
use crate::view::View;
use clap::ValueEnum;
use glam::{DVec3, Vec3};
use std::path::PathBuf;
use std::time::Duration;

/// Solve a scene's radiosity and draw it.
#[derive(clap::Args)]
pub(super) struct RenderArguments {
    /// A scene description (.toml), a model (.obj, .glb, .gltf, .ply, .stl), or solved light (.light)
    pub scene: PathBuf,

    /// Picture to write: .png (sRGB), .exr or .hdr (linear radiance). With several shadings
    /// room.png becomes room-flat.png and room-smooth.png
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,

    #[arg(long, value_name = "WxH", value_parser = parse_size, help_heading = "Picture", help = format!(
        "Width and height in pixels [default: the scene's, else {}x{}]", Frame::SIZE[0], Frame::SIZE[1]))]
    pub size: Option<[u32; 2]>,

    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_SAMPLES as i64),
          help_heading = "Picture", help = format!(
              "Samples per pixel [default: the scene's, else {}, or fewer where very many triangles share a place]", Frame::SAMPLES))]
    pub spp: Option<u32>,

    /// Gathered pictures: go on until the error of most pixels is at most this share of their light, such as 1%
    #[arg(long, value_name = "SHARE", value_parser = parse_share, help_heading = "Picture")]
    pub error: Option<f32>,

    /// Gathered pictures: use this long for the whole run, such as 30s or 5m. The result depends on the machine
    #[arg(long, value_name = "TIME", value_parser = parse_time, help_heading = "Picture")]
    pub time: Option<Duration>,

    /// Gathered pictures: renew the picture's file about this often while it is drawn, such as 5s
    #[arg(long, value_name = "TIME", value_parser = parse_time, help_heading = "Picture")]
    pub preview: Option<Duration>,

    /// Gathered pictures: go on with a picture that was interrupted or cut off; what was done lies in FILE.partial
    #[arg(long, help_heading = "Picture")]
    pub resume: bool,

    /// Gathered and path-traced pictures: write the standard error of each pixel's luminance, as .exr or .hdr; each
    /// file is named as its picture is. A picture in .exr has it as well, as its layer `error`; one by paths from 4
    /// samples per pixel on
    #[arg(long, value_name = "FILE", help_heading = "Picture")]
    pub error_image: Option<PathBuf>,

    /// How light is shown; several shadings share one solve
    #[arg(long, value_delimiter = ',', default_value = "gather", help_heading = "Picture")]
    pub shading: Vec<ShadingName>,

    /// Angle in degrees up to which smooth shading carries light over an edge
    #[arg(long, value_name = "DEGREES", default_value_t = View::CREASE, value_parser = parse_crease,
          help_heading = "Picture")]
    pub crease: f32,

    /// Factor from radiance to display brightness; 1 is white. Or `same`: automatic, but one for all
    /// views. For PNG [default: the scene's, else automatic for each view]
    #[arg(long, value_name = "FACTOR|same", value_parser = parse_exposure, help_heading = "Picture")]
    pub exposure: Option<Exposure>,

    /// Radiance behind the scene: one number, R,G,B, or `transparent` (.png, .exr) [default: the sky]
    #[arg(long, value_name = "RADIANCE|transparent", value_parser = parse_background,
          help_heading = "Picture")]
    pub background: Option<Background>,

    #[command(flatten)]
    pub look: ViewArguments,

    #[command(flatten)]
    pub scenery: SceneArguments,

    #[command(flatten)]
    pub light: LightArguments,

    #[command(flatten)]
    pub run: RunArguments,
}

/// The value of `--exposure`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Exposure {
    Factor(f32),
    Same,
}

/// A camera from the command line.
#[derive(clap::Args)]
pub(super) struct ViewArguments {
    /// A view that the scene describes as [views.NAME]; several draw a picture each: room.png becomes
    /// room-NAME.png
    #[arg(long, value_name = "NAME", value_delimiter = ',', value_parser = parse_view,
          conflicts_with_all = ["position", "look_at", "up", "fov"], help_heading = "Picture")]
    pub view: Vec<String>,

    /// Look from here, in the scene's coordinates [default: the scene's camera, else one that is fitted]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true,
          requires = "look_at", help_heading = "Picture")]
    position: Option<DVec3>,

    /// Look at this point
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true,
          requires = "position", help_heading = "Picture")]
    look_at: Option<DVec3>,

    /// What is up in the picture: x, y, z, or a direction [default: as the model's format says, else guessed]
    #[arg(long, value_name = "x|y|z|X,Y,Z", value_parser = parse_up, allow_hyphen_values = true,
          help_heading = "Picture")]
    pub up: Option<Vec3>,

    /// Vertical field of view in degrees
    #[arg(
        long,
        value_name = "DEGREES",
        requires = "position",
        allow_negative_numbers = true,
        help_heading = "Picture"
    )]
    fov: Option<f32>,
}

impl ViewArguments {
    /// # Errors
    /// See [`Camera::new`].
    pub(super) fn camera(&self) -> Result<Option<Camera>> {
        let (Some(position), Some(look_at)) = (self.position, self.look_at) else {
            return Ok(None);
        };
        let up = self.up.unwrap_or(Camera::USUAL_UP);
        Camera::new(position, look_at, up, self.fov.unwrap_or(Camera::USUAL_FOV), 0.0).map(Some)
    }
}

/// What is assumed about a scene, whatever its files say.
#[derive(Clone, Default, PartialEq, clap::Args)]
pub(super) struct SceneArguments {
    /// Let a material shine with this radiance in W/(sr·m²): one number or R,G,B; a name may end in *
    #[arg(long, value_name = "MATERIAL=RADIANCE", value_parser = parse_emission,
          allow_hyphen_values = true, help_heading = "Scene")]
    emit: Vec<(String, Rgb)>,

    /// Radiance of the sky in W/(sr·m²): one number or R,G,B; 0 is none [default: the scene's, else 1 if
    /// nothing else shines]
    #[arg(long, value_name = "RADIANCE", value_parser = parse_radiance, help_heading = "Scene")]
    sky: Option<Rgb>,

    /// Surfaces reflect on the side from which they are counter-clockwise; the other is black
    #[arg(long, help_heading = "Scene")]
    one_sided: bool,
}

impl SceneArguments {
    /// Writes what was asked for into the document.
    pub(super) fn apply(&self, document: &mut Document) {
        document.emissions.extend(self.emit.iter().cloned());
        document.sky = self.sky.or(document.sky);
        document.one_sided |= self.one_sided;
    }
}

fn parse_emission(text: &str) -> std::result::Result<(String, Rgb), String> {
    let parts = text.rsplit_once('=').filter(|(name, _)| !name.is_empty());
    let (name, radiance) = parts.ok_or("expected a material and its radiance such as lamp=10")?;
    Ok((name.into(), parse_radiance(radiance)?))
}

/// One number for all channels, or three.
fn parse_radiance(text: &str) -> std::result::Result<Rgb, String> {
    let expected =
        "expected one number of at least 0 and at most 1e12, or three with commas between";
    let numbers: Vec<f32> = text
        .split(',')
        .map(|x| x.trim().parse().map_err(|_| expected))
        .collect::<std::result::Result<_, _>>()?;
    let rgb = match numbers[..] {
        [grey] => Rgb::splat(grey),
        [r, g, b] => Rgb::new(r, g, b),
        _ => return Err(expected.into()),
    };
    if is_radiance(rgb) { Ok(rgb) } else { Err(expected.into()) }
}

/// An axis by its letter, or a direction.
fn parse_up(text: &str) -> std::result::Result<Vec3, String> {
    match text {
        "x" => Ok(Vec3::X),
        "y" => Ok(Vec3::Y),
        "z" => Ok(Vec3::Z),
        _ => parse_point(text).map(|up| up.as_vec3()),
    }
}

/// How the light is solved.
#[derive(Clone, Default, PartialEq, clap::Args)]
pub(super) struct LightArguments {
    #[command(flatten)]
    patches: PatchSettings,

    #[command(flatten)]
    light: LightSettings,
}

impl LightArguments {
    pub(super) fn settings(&self, seed: Option<u64>) -> Settings {
        let seed = seed.unwrap_or(Settings::SEED);
        Settings { patches: self.patches.clone(), light: self.light.clone(), seed }
    }
}

/// Options that every run has.
#[derive(clap::Args)]
pub(super) struct RunArguments {
    /// Ray–triangle intersection: the triangle's plane first, or Cramer's rule at once
    #[arg(long, default_value = "moller-trumbore", help_heading = "Run")]
    pub kernel: KernelKind,

    #[arg(long, value_name = "N", help_heading = "Run", help = format!(
        "Seed of all random numbers [default: {}; of a .light file, that of its solution]",
        Settings::SEED))]
    pub seed: Option<u64>,

    /// Threads [default: all cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=MAX_THREADS),
          help_heading = "Run")]
    pub threads: Option<u32>,

    /// Write the run's figures as JSON
    #[arg(long, value_name = "FILE", help_heading = "Run")]
    pub stats: Option<PathBuf>,
}

/// The most threads.
const MAX_THREADS: i64 = 1024;

/// Refuses a number of threads in the environment that `--threads` refuses; other words count for nothing.
///
/// # Errors
/// With the variable's name and the range.
pub(super) fn check_threads() -> Result<()> {
    const VARIABLE: &str = "RAYON_NUM_THREADS";
    let given = std::env::var(VARIABLE).ok().and_then(|text| text.trim().parse::<u128>().ok());
    match given.filter(|number| *number > MAX_THREADS as u128) {
        Some(number) => Err(Error::new(format!("{VARIABLE} is {number}, more than {MAX_THREADS}"))
            .remedy("set it to at most the number of cores, or unset it")),
        None => Ok(()),
    }
}

impl RunArguments {
    /// Does `work` with the number of threads that was asked for.
    pub(super) fn in_pool<T: Send>(&self, work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
        let mut pool = rayon::ThreadPoolBuilder::new();
        if let Some(threads) = self.threads {
            pool = pool.num_threads(threads as usize);
        }
        let failed = |e| {
            let error = Error::new(format!("cannot start the threads: {e}"));
            error
                .of_kind(ErrorKind::System)
                .remedy("start fewer, such as --threads 1, or allow more memory")
        };
        pool.build().map_err(failed)?.install(work)
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ShadingName {
    /// Each patch has one irradiance
    Flat,
    /// Irradiance is interpolated over patches
    Smooth,
    /// Direct light at every sample, indirect light gathered from the patches
    Gather,
    /// Paths of light, without the solution: unbiased and noisy
    Path,
}

fn parse_size(text: &str) -> std::result::Result<[u32; 2], String> {
    let parsed = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.parse(), h.parse()));
    match parsed {
        Some((Ok(0), _) | (_, Ok(0))) => Err("a picture needs at least one pixel".into()),
        Some((Ok(width), Ok(height))) => Ok([width, height]),
        _ => Err("expected a width and a height such as 640x480".into()),
    }
}

fn parse_view(text: &str) -> std::result::Result<String, String> {
    if is_view_name(text) {
        Ok(text.into())
    } else {
        Err("expected letters, digits, - and _".into())
    }
}

fn parse_point(text: &str) -> std::result::Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three numbers such as 1,2.5,-3".into()),
    }
}

fn parse_positive(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a number above zero".into()),
    }
}

/// A share above zero, as a number or in per cent.
fn parse_share(text: &str) -> std::result::Result<f32, String> {
    let (number, unit) = match text.strip_suffix('%') {
        Some(number) => (number, 0.01),
        None => (text, 1.0),
    };
    match number.trim().parse::<f32>().map(|x| x * unit) {
        Ok(share) if (1e-5..1.0).contains(&share) => Ok(share),
        _ => Err("expected a share of at least 0.00001 and below 1, such as 0.01 or 1%".into()),
    }
}

/// Seconds, or a number with s, m or h.
fn parse_time(text: &str) -> std::result::Result<Duration, String> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, 's')) => (&text[..at], 1.0),
        Some((at, 'm')) => (&text[..at], 60.0),
        Some((at, 'h')) => (&text[..at], 3600.0),
        _ => (text, 1.0),
    };
    match number.trim().parse::<f64>().map(|x| x * unit) {
        Ok(seconds) if seconds > 0.0 && seconds <= 1e7 => Ok(Duration::from_secs_f64(seconds)),
        _ => Err("expected a time such as 30s, 5m or 1h".into()),
    }
}

fn parse_background(text: &str) -> std::result::Result<Background, String> {
    match text {
        "transparent" => Ok(Background::Transparent),
        _ => parse_radiance(text).map(Background::Radiance),
    }
}

fn parse_exposure(text: &str) -> std::result::Result<Exposure, String> {
    match text {
        "same" => Ok(Exposure::Same),
        _ => parse_positive(text).map(Exposure::Factor).map_err(|e| format!("{e}, or `same`")),
    }
}

fn parse_crease(text: &str) -> std::result::Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if (0.0..=180.0).contains(&x) => Ok(x),
        _ => Err("expected an angle from 0 to 180 degrees".into()),
    }
}
