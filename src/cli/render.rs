//! `isolux render`: from a scene to pictures.

use super::arguments::{PointsName, RenderArguments, ShadingName};
use super::report::{Report, Seconds};
use super::{progress, say, warn};
use crate::bvh::{AnyBvh, Effort};
use crate::coverage;
use crate::error::{Error, Result};
use crate::export::file::{Output, check_distinct, check_writable, write_all};
use crate::export::picture::Format;
use crate::memory;
use crate::patches::{PatchMesh, Subdivision};
use crate::radiosity::{self, Method, Radiosity, Settings};
use crate::render::shading::{Flat, Shading, Smooth};
use crate::render::smooth::VertexIrradiance;
use crate::render::{self, Frame, Image, tone};
use crate::scene::description::PatchDefaults;
use crate::scene::topology::Topology;
use crate::scene::{Camera, Description, Scene};
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Patches that the subdivision aims at when nobody says: good and quick for a first picture.
pub(super) const DEFAULT_PATCHES: usize = 40_000;

pub fn run(arguments: &RenderArguments) -> Result<()> {
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = arguments.threads {
        pool = pool.num_threads(threads as usize);
    }
    let pool = pool.build().map_err(|e| Error::new(format!("cannot start the threads: {e}")))?;
    pool.install(|| run_in_pool(arguments))
}

fn run_in_pool(arguments: &RenderArguments) -> Result<()> {
    let start = Instant::now();
    let pictures = pictures(arguments)?;

    let description = Description::load(&arguments.scene)?;
    check_overwriting(arguments, &pictures, &description)?;
    let scene = Scene::load(&description)?;
    warn(&scene.warnings);
    let images = pictures.len();
    let frame = frame(arguments.size, arguments.spp, arguments.seed, &description, images)?;
    let load = start.elapsed();

    let mesh = PatchMesh::subdivide(&scene, subdivision(arguments, &description))?;
    let settings = settings(arguments, &mesh)?;
    let rays = settings.expected_rays(&mesh).saturating_add(frame.rays());
    let effort = Effort::for_rays(scene.triangles.len(), rays);
    let caster = AnyBvh::build(&scene.triangles, effort, arguments.kernel.into());
    let camera = match &description.camera {
        Some(camera) => camera.clone(),
        None => Camera::fitted(&scene.triangles, &caster),
    };
    let build = start.elapsed() - load;

    let light = radiosity::solve(&caster, &mesh, &settings, &progress::stage)
        .map_err(|error| error.in_file_if_none(&arguments.scene))?;

    let rendering = Instant::now();
    let (images, cover_rays) = draw(arguments, &caster, &mesh, &camera, &frame, &pictures, &light);
    let given = arguments.exposure.or(description.image.exposure);
    let exposure =
        given.unwrap_or_else(|| tone::automatic_exposure(&images[0], scene.dimmest_emitter()));
    let mut outputs = encode(&pictures, &images, exposure)?;
    let render = rendering.elapsed();

    let report = Report {
        scene: description.title,
        triangles: scene.triangles.len(),
        patches: mesh.len(),
        open_edges: Topology::new(&scene.triangles).open_edges(),
        rays: light.rays + cover_rays + frame.rays(),
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
        iterations: light.iterations,
        row_sum_defect: light.row_sum_defect,
        mean_row_sum_defect: light.mean_row_sum_defect,
        reciprocity_defect: light.reciprocity_defect,
        energy: light.energy.into(),
        exposure,
        automatic_exposure: given.is_none(),
        files: pictures.iter().map(|picture| picture.path.to_string_lossy().into()).collect(),
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
    for path in pictures.iter().map(|picture| &picture.path).chain(&arguments.stats) {
        check_writable(path)?;
    }
    Ok(pictures)
}

/// Refuses a run that would destroy its own input or write two outputs to one file.
fn check_overwriting(
    arguments: &RenderArguments,
    pictures: &[Picture],
    description: &Description,
) -> Result<()> {
    let mut outputs: Vec<&Path> = pictures.iter().map(|picture| picture.path.as_path()).collect();
    outputs.extend(arguments.stats.as_deref());
    check_distinct(&outputs, &description.inputs())
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

/// What to draw, if so many images of it fit into memory. What is not given the description says.
pub(super) fn frame(
    size: Option<[u32; 2]>,
    samples: Option<u32>,
    seed: u64,
    description: &Description,
    images: usize,
) -> Result<Frame> {
    let [width, height] = size.or(description.image.size).unwrap_or([640, 480]);
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
    let samples = samples.or(description.image.samples).unwrap_or(16);
    if samples == 0 {
        return Err(Error::new("0 samples a pixel")
            .in_file(&description.file)
            .remedy("give at least one"));
    }
    Ok(Frame { width, height, samples, seed })
}

/// Flags come before the description, and the description before the default.
fn subdivision(arguments: &RenderArguments, description: &Description) -> Subdivision {
    match (arguments.levels, arguments.max_edge) {
        (Some(levels), _) => Subdivision::Levels(levels),
        (None, Some(length)) => Subdivision::MaxEdge(length),
        (None, None) => {
            described(&description.patches).unwrap_or(Subdivision::Count(DEFAULT_PATCHES))
        }
    }
}

/// The description's wish, if it has one.
pub(super) fn described(patches: &PatchDefaults) -> Option<Subdivision> {
    let levels = patches.levels.map(Subdivision::Levels);
    levels.or(patches.max_edge.map(|length| Subdivision::MaxEdge(length as f64)))
}

fn settings(arguments: &RenderArguments, mesh: &PatchMesh) -> Result<Settings> {
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
        stop: arguments.stop(),
        seed: arguments.seed,
        memory_limit: limit,
    })
}

fn draw(
    arguments: &RenderArguments,
    caster: &AnyBvh,
    mesh: &PatchMesh,
    camera: &Camera,
    frame: &Frame,
    pictures: &[Picture],
    light: &Radiosity,
) -> (Vec<Image>, u64) {
    let (uncovered, rays) = coverage::uncovered(caster, mesh);
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
    (images, rays)
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
