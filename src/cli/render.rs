//! `isolux render`: from a scene to pictures.

use super::arguments::{LightArguments, RenderArguments, ShadingName};
use super::light::Plan;
use super::progress::Bars;
use super::report::{Report, Seconds};
use super::{say, warn};
use crate::bvh::{Effort, Tracer};
use crate::error::{Error, Result};
use crate::export::file::{Output, check_distinct, check_writable, write_all};
use crate::export::picture::Format;
use crate::memory;
use crate::render::shading::{Flat, Shading, Smooth};
use crate::render::smooth::VertexIrradiance;
use crate::render::{self, Frame, Image, tone};
use crate::scene::description::ImageDefaults;
use crate::scene::{Camera, Description, Scene};
use crate::solution::Solution;
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub fn run(arguments: &RenderArguments) -> Result<()> {
    arguments.run.in_pool(|| run_in_pool(arguments))
}

fn run_in_pool(arguments: &RenderArguments) -> Result<()> {
    let start = Instant::now();
    let pictures = pictures(arguments)?;
    let view = arguments.view.camera()?;
    let mut times = Seconds::default();
    if is_light(&arguments.scene) {
        if arguments.light != LightArguments::default() {
            return Err(Error::new("the light of a .light file is solved already")
                .in_file(&arguments.scene)
                .remedy("leave the options of light out, or render the scene itself"));
        }
        check_overwriting(arguments, &pictures, &[&arguments.scene])?;
        let solution = Solution::load(&arguments.scene)?;
        let frame = frame_of(arguments, &solution.image, pictures.len())?;
        times.load = start.elapsed().as_secs_f64();
        let triangles = &solution.scene.triangles;
        let effort = Effort::for_rays(triangles.len(), frame.rays());
        let caster = Tracer::build_with(triangles.clone(), effort, arguments.run.kernel.into());
        times.build = start.elapsed().as_secs_f64() - times.load;
        return show(arguments, &pictures, &caster, &frame, view, &solution, 0, times, start);
    }

    let description = Description::load(&arguments.scene)?;
    check_overwriting(arguments, &pictures, &description.inputs())?;
    let scene = Scene::load(&description)?;
    warn(&scene.warnings);
    let frame = frame_of(arguments, &description.image, pictures.len())?;
    times.load = start.elapsed().as_secs_f64();
    let plan = Plan::new(&arguments.light, &arguments.run, &description, &scene)?;
    let caster = plan.caster(frame.rays());
    let (solution, rays) = plan.solve(&description, &caster, &mut times, start)?;
    show(arguments, &pictures, &caster, &frame, view, &solution, rays, times, start)
}

/// Whether a file's name says that it holds solved light.
fn is_light(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("light"))
}

/// Draws the pictures, writes them and reports.
#[allow(clippy::too_many_arguments, reason = "both ways to come by a solution end here")]
fn show(
    arguments: &RenderArguments,
    pictures: &[Picture],
    caster: &Tracer,
    frame: &Frame,
    view: Option<Camera>,
    solution: &Solution,
    light_rays: u64,
    mut times: Seconds,
    start: Instant,
) -> Result<()> {
    let rendering = Instant::now();
    let camera = view.as_ref().unwrap_or(&solution.camera);
    let images = draw(arguments, caster, camera, frame, pictures, solution);
    let given = arguments.exposure.or(solution.image.exposure);
    let exposure = given
        .unwrap_or_else(|| tone::automatic_exposure(&images[0], solution.scene.dimmest_emitter()));
    let mut outputs = encode(pictures, &images, exposure)?;
    times.render += rendering.elapsed().as_secs_f64();
    times.total = start.elapsed().as_secs_f64();

    let files = pictures.iter().map(|picture| picture.path.as_path());
    let report = Report {
        exposure: Some(exposure),
        automatic_exposure: given.is_none(),
        rays: light_rays + frame.rays(),
        ..Report::new(solution, times, files)
    };
    if let Some(path) = &arguments.run.stats {
        outputs.push(Output { path: path.clone(), bytes: report.to_json() });
    }
    write_all(outputs)?;
    say(&report.to_text());
    Ok(())
}

fn frame_of(arguments: &RenderArguments, image: &ImageDefaults, images: usize) -> Result<Frame> {
    frame(arguments.size, arguments.spp, arguments.run.seed, image, images)
        .map_err(|error| error.in_file_if_none(&arguments.scene))
}

/// One picture to be drawn.
struct Picture {
    shading: ShadingName,
    path: PathBuf,
    format: Format,
}

/// Names the output files and makes sure that they can be written, before anything is computed.
fn pictures(arguments: &RenderArguments) -> Result<Vec<Picture>> {
    let format = Format::of(&arguments.output)?;
    let mut shadings = arguments.shading.clone();
    let mut seen = Vec::new();
    shadings.retain(|shading| {
        !seen.contains(shading) && {
            seen.push(*shading);
            true
        }
    });
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
    for path in pictures.iter().map(|picture| &picture.path).chain(&arguments.run.stats) {
        check_writable(path)?;
    }
    Ok(pictures)
}

/// Refuses a run that would destroy its own input or write two outputs to one file.
fn check_overwriting(
    arguments: &RenderArguments,
    pictures: &[Picture],
    inputs: &[&Path],
) -> Result<()> {
    let mut outputs: Vec<&Path> = pictures.iter().map(|picture| picture.path.as_path()).collect();
    outputs.extend(arguments.run.stats.as_deref());
    check_distinct(&outputs, inputs)
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

/// What to draw, if so many images of it fit into memory. What is not given the scene says.
pub(super) fn frame(
    size: Option<[u32; 2]>,
    samples: Option<u32>,
    seed: u64,
    image: &ImageDefaults,
    images: usize,
) -> Result<Frame> {
    let [width, height] = size.or(image.size).unwrap_or([640, 480]);
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
    let samples = samples.or(image.samples).unwrap_or(16);
    if samples == 0 {
        return Err(Error::new("0 samples a pixel").remedy("give at least one"));
    }
    Ok(Frame { width, height, samples, seed })
}

fn draw(
    arguments: &RenderArguments,
    caster: &Tracer,
    camera: &Camera,
    frame: &Frame,
    pictures: &[Picture],
    solution: &Solution,
) -> Vec<Image> {
    let mesh = solution.patches();
    let (irradiance, uncovered) = (&solution.irradiance, &solution.uncovered);
    let shadings: Vec<Box<dyn Shading + '_>> = pictures
        .iter()
        .map(|picture| -> Box<dyn Shading> {
            match picture.shading {
                ShadingName::Flat => Box::new(Flat::new(&mesh, irradiance, uncovered)),
                ShadingName::Smooth => {
                    let crease = arguments.crease;
                    let vertices = VertexIrradiance::new(&mesh, irradiance, uncovered, crease);
                    Box::new(Smooth::new(&mesh, vertices))
                }
            }
        })
        .collect();
    let shadings: Vec<&dyn Shading> = shadings.iter().map(Box::as_ref).collect();
    render::render(caster, &mesh, camera, frame, &shadings, &Bars::new())
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
