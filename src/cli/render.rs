//! `isolux render`: from a scene to pictures.

use super::arguments::{Exposure, LightArguments, RenderArguments, SceneArguments, ShadingName};
use super::gathering::{Gathering, fingerprint};
use super::partial::Partial;
use super::pictures::{Picture, check_overwriting, partials, pictures};
use super::progress::{Bars, OnSignal};
use super::remarks;
use super::report::{Report, Seconds};
use super::{say, signals, warn};
use crate::bvh::{Effort, Tracer};
use crate::color::Rgb;
use crate::error::{Error, Result, Warning};
use crate::export::file::{Inputs, Output, write_all};
use crate::export::picture::Format;
use crate::memory;
use crate::plan::Plan;
use crate::render::{Frame, Image};
use crate::scene::document::{ImageDefaults, MAX_SIZE};
use crate::scene::{Camera, Document, Scene};
use crate::settings::Settings;
use crate::solution::{Solution, view_of, views_of};
use crate::view::View;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

pub(super) fn run(arguments: &RenderArguments) -> Result<ExitCode> {
    arguments.run.in_pool(|| run_in_pool(arguments))
}

fn run_in_pool(arguments: &RenderArguments) -> Result<ExitCode> {
    let run = Run {
        arguments,
        pictures: pictures(arguments)?,
        camera: arguments.look.camera()?,
        start: Instant::now(),
    };
    if is_light(&arguments.scene) { run.show_light() } else { run.solve_and_show() }
}

/// Whether a file's name says that it holds solved light.
pub(super) fn is_light(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("light"))
}

/// One run of the command.
struct Run<'a> {
    arguments: &'a RenderArguments,
    pictures: Vec<Picture>,
    /// Given by flags.
    camera: Option<Camera>,
    start: Instant,
}

impl Run<'_> {
    fn show_light(&self) -> Result<ExitCode> {
        let arguments = self.arguments;
        let changed = arguments.light != LightArguments::default()
            || arguments.scenery != SceneArguments::default();
        if changed {
            return Err(Error::new("the light of a .light file is solved already")
                .in_file(&arguments.scene)
                .remedy(
                    "leave the options of the scene and its light out, or render the scene itself",
                ));
        }
        let inputs = Inputs::new(&[&arguments.scene]);
        check_overwriting(arguments, &self.pictures, &inputs)?;
        let solution = Solution::load(&arguments.scene)?;
        let frame = self.frame(&solution.image, solution.scene(), solution.choices.seed)?;
        if frame.in_one_round {
            warn(solution.scene().crowding_warning().as_slice());
        }
        let load = self.start.elapsed();
        let tracer = self.tracer(solution.scene(), frame.rays());
        let mut seconds = Seconds { load: load.as_secs_f64(), ..Seconds::default() };
        seconds.build = (self.start.elapsed() - load).as_secs_f64();
        self.show(&tracer, &frame, &solution, 0, seconds, &inputs)
    }

    fn solve_and_show(&self) -> Result<ExitCode> {
        let arguments = self.arguments;
        let mut document = Document::open(&arguments.scene)?;
        arguments.scenery.apply(&mut document);
        document.up = arguments.look.up.or(document.up);
        let mut inputs = Inputs::new(&document.inputs());
        check_overwriting(arguments, &self.pictures, &inputs)?;
        let scene = document.scene()?;
        let known = views_of(&document, &scene);
        for name in self.pictures.iter().filter_map(|picture| picture.view.as_deref()) {
            view_of(&known, name).map_err(|error| error.in_file(&document.file))?;
        }
        inputs.extend(&scene.files);
        check_overwriting(arguments, &self.pictures, &inputs)?;
        warn(&scene.warnings);
        let frame = self.frame(&document.image, &scene, Settings::SEED)?;
        let load = self.start.elapsed();
        let settings = arguments.light.settings(arguments.run.seed);
        let plan = Plan::new(&document, &scene, &settings)?;
        let tracer = self.tracer(&scene, plan.rays().saturating_add(frame.rays()));
        let build = self.start.elapsed() - load;
        let (solution, spent) = plan.solve(&tracer, &Bars::new())?;
        let is_chosen =
            self.camera.is_some() || document.camera.is_some() || !arguments.look.view.is_empty();
        if !is_chosen {
            warn(&remarks::on_the_camera(&scene, &solution.camera));
        }
        warn(remarks::on_the_dark(&solution).as_slice());
        let seconds = Seconds::new(load, build, &spent);
        self.show(&tracer, &frame, &solution, spent.rays, seconds, &inputs)
    }

    /// `seed` counts unless another is given. In a crowded scene pixels have fewer samples, and no more where they
    /// differ, unless some or an error are asked for.
    fn frame(&self, image: &ImageDefaults, scene: &Scene, seed: u64) -> Result<Frame> {
        let RenderArguments { size, spp, run, background, .. } = self.arguments;
        let is_gathered = self.arguments.shading.contains(&ShadingName::Gather);
        let is_path_traced = self.arguments.shading.contains(&ShadingName::Path);
        let bytes = DRAWN * self.pictures.len() as u64
            + if is_gathered { GATHERED } else { 0 }
            + if is_path_traced { PATH_TRACED } else { 0 };
        let mut frame = frame(*size, *spp, run.seed.unwrap_or(seed), image, bytes)
            .map_err(|error| error.in_file_if_none(&self.arguments.scene))?;
        if spp.or(image.samples).is_none() && self.arguments.error.is_none() {
            let pixels = frame.width as usize * frame.height as usize;
            frame.samples = scene.affordable(pixels, frame.samples);
            frame.in_one_round = scene.is_crowded();
        }
        if is_path_traced && self.arguments.error_image.is_some() && !frame.tells_errors() {
            return Err(Error::new(
                "the errors of path-traced pictures are not known with fewer than 4 samples per pixel",
            )
            .remedy("take more with --spp, or leave out --error-image or path"));
        }
        Ok(Frame {
            background: *background,
            error: self.arguments.error,
            deadline: self.arguments.time.map(|time| self.start + time),
            ..frame
        })
    }

    /// A hierarchy that is built as thoroughly as this many rays are worth.
    fn tracer(&self, scene: &Scene, rays: u64) -> Tracer {
        let effort = Effort::for_rays(scene.triangles.len(), rays);
        Tracer::build_with(scene, effort, self.arguments.run.kernel)
    }

    /// Draws the pictures, writes them and reports.
    fn show(
        &self,
        tracer: &Tracer,
        frame: &Frame,
        solution: &Solution,
        light_rays: u64,
        mut seconds: Seconds,
        inputs: &Inputs,
    ) -> Result<ExitCode> {
        let (arguments, pictures) = (self.arguments, &self.pictures);
        let rendering = Instant::now();
        // Other pictures do not end before they are done.
        let are_gathered = arguments.shading.iter().all(|&it| it == ShadingName::Gather);
        let on_signal = if are_gathered { OnSignal::Finish } else { OnSignal::Die };
        let bars = Bars::towards(frame.error, frame.deadline).on_signal(on_signal);
        let camera = self.camera.as_ref();
        let (images, interrupted) =
            draw(arguments, tracer, camera, frame, pictures, (solution, inputs), &bars)
                .map_err(|error| error.in_file_if_none(&arguments.scene))?;
        // From here on a signal ends the program.
        drop(bars);
        let views = pictures.chunk_by(|a, b| a.view == b.view).count();
        let exposures = exposures(arguments, solution, &images, views);
        let mut outputs = encode(pictures, &images, &exposures)?;
        seconds.render += rendering.elapsed().as_secs_f64();
        seconds.total = self.start.elapsed().as_secs_f64();

        let errors = pictures.iter().filter_map(|picture| picture.errors.as_deref());
        let files = pictures.iter().map(|picture| picture.path.as_path()).chain(errors);
        let is_given = matches!(arguments.exposure, Some(Exposure::Factor(_)))
            || solution.image.exposure.is_some();
        // Paths are noisy, and what is asked for is asked of gathered pictures.
        let largest = |shading| {
            let drawn =
                pictures.iter().zip(&images).filter(|(picture, _)| picture.shading == shading);
            drawn.filter_map(|(_, image)| image.relative_error()).reduce(f32::max)
        };
        let picture_error = largest(ShadingName::Gather).or_else(|| largest(ShadingName::Path));
        let report = Report {
            picture_error,
            exposure: Some(exposures[0]),
            automatic_exposure: !is_given,
            rays: light_rays + images.iter().map(|image| image.rays).sum::<u64>(),
            exposures: if exposures.iter().any(|e| *e != exposures[0]) {
                exposures
            } else {
                vec![]
            },
            ..Report::new(solution, seconds, files)
        };
        for (picture, image) in pictures.iter().zip(&images) {
            if let Some(path) = &picture.errors {
                outputs.push(Output { bytes: error_image(path, image)?, path: path.clone() });
            }
        }
        if let Some(path) = &arguments.run.stats {
            outputs.push(Output { path: path.clone(), bytes: report.to_json() });
        }
        write_all(outputs, inputs)?;
        warn(report.warning().as_slice());
        if !interrupted.is_empty() {
            let next = match interrupted.iter().any(Partial::has_failed) {
                true => "what is done could not be kept",
                false => "with --resume the same command goes on from them",
            };
            let text = "interrupted: the picture has the samples that there was time for";
            warn(&[Warning::new(format!("{text}; {next}"))]);
            say(&report.to_text())?;
            return Ok(ExitCode::from(signals::exit_code()));
        }
        partials(pictures).iter().for_each(Partial::remove);
        warn(missed(arguments.error, picture_error).as_slice());
        say(&report.to_text())?;
        Ok(ExitCode::SUCCESS)
    }
}

/// Bytes per pixel that a picture takes: an image, its values in the order of the file, and the file, whose bytes
/// are a list that grows by doubling.
const DRAWN: u64 = 64;

/// Bytes per pixel that the errors of path-traced pictures take, beyond the pictures.
const PATH_TRACED: u64 = 96;

/// Bytes per pixel that gathering takes, with the two spots that some pixels have.
const GATHERED: u64 = 750;

/// The frame, if this many bytes per pixel fit into memory. The scene fills in what is not given.
pub(super) fn frame(
    size: Option<[u32; 2]>,
    samples: Option<u32>,
    seed: u64,
    image: &ImageDefaults,
    bytes_per_pixel: u64,
) -> Result<Frame> {
    let [width, height] = size.or(image.size).unwrap_or(Frame::SIZE);
    if width == 0 || height == 0 || width > MAX_SIZE || height > MAX_SIZE {
        return Err(Error::new(format!("a picture of {width}x{height} pixels"))
            .remedy("give a width and a height from 1 to 65536"));
    }
    let bytes = width as u64 * height as u64 * bytes_per_pixel;
    memory::check(
        &format!("a picture of {width}x{height} pixels"),
        bytes,
        memory::available(),
        "draw it smaller",
    )?;
    let samples = samples.or(image.samples).unwrap_or(Frame::SAMPLES);
    if samples == 0 {
        return Err(Error::new("0 samples per pixel").remedy("give at least one"));
    }
    Ok(Frame { samples, seed, ..Frame::new(width, height) })
}

/// The images of the pictures, in their order, and the partial files of those that a signal has cut short. `camera`
/// comes before the solution's own.
fn draw(
    arguments: &RenderArguments,
    caster: &Tracer,
    camera: Option<&Camera>,
    frame: &Frame,
    pictures: &[Picture],
    (solution, inputs): (&Solution, &Inputs),
    bars: &Bars,
) -> Result<(Vec<Image>, Vec<Partial>)> {
    // Every name is looked up before the first picture is drawn.
    let of_views: Vec<&[Picture]> = pictures.chunk_by(|a, b| a.view == b.view).collect();
    let cameras = of_views.iter().map(|of_view| match &of_view[0].view {
        Some(name) => solution.view(name),
        None => Ok(camera.unwrap_or(&solution.camera)),
    });
    let cameras = cameras.collect::<Result<Vec<_>>>()?;
    let look = |shading| match shading {
        ShadingName::Flat => solution.flat(),
        ShadingName::Smooth => solution.smooth(arguments.crease),
        ShadingName::Gather => solution.gathered(),
        ShadingName::Path => solution.path_traced(frame.seed),
    };
    let is_gathered = |picture: &&Picture| picture.shading == ShadingName::Gather;
    let fields = of_views[0].iter().filter(|picture| !is_gathered(picture));
    let fields: Vec<View> = fields.map(|picture| look(picture.shading)).collect();
    let gathered = of_views[0].iter().any(|p| is_gathered(&p)).then(|| look(ShadingName::Gather));
    let factor = match arguments.exposure {
        Some(Exposure::Factor(factor)) => Some(factor),
        _ => None,
    };
    let (mut images, mut interrupted) = (Vec::new(), Vec::new());
    for (k, camera) in cameras.iter().enumerate() {
        let now = Instant::now();
        let share = |until: Instant| {
            now + until.saturating_duration_since(now) / (cameras.len() - k) as u32
        };
        let frame = Frame { deadline: frame.deadline.map(share), ..*frame };
        let mut of_fields = View::draw_all(&fields, caster, camera, &frame, bars)?.into_iter();
        for picture in of_views[k] {
            let view = gathered.as_ref().filter(|_| is_gathered(&picture));
            let Some(drawing) = view.and_then(|view| view.begin(caster, camera, &frame)) else {
                images.extend(of_fields.next());
                continue;
            };
            let gathering = Gathering {
                output: &picture.path,
                inputs,
                fingerprint: &|| fingerprint(solution, camera, &frame, arguments.run.kernel),
                resume: arguments.resume,
                keep: cameras.len() > 1 && (frame.error.is_some() || frame.deadline.is_some()),
                preview: arguments.preview,
                exposure: &|image| factor.unwrap_or_else(|| solution.exposure(image)),
            };
            let (image, partial) = gathering.draw(drawing, bars)?;
            images.push(image);
            interrupted.extend(partial);
        }
    }
    Ok((images, interrupted))
}

/// The picture of a picture's errors.
fn error_image(path: &Path, image: &Image) -> Result<Vec<u8>> {
    let Image { width, height, ref error, .. } = *image;
    let pixels = error.iter().map(|&error| Rgb::splat(error)).collect();
    Format::of(path)?.encode(&Image { width, height, pixels, ..Image::default() }, 1.0)
}

/// Says so if the pictures are not as good as was asked for.
fn missed(goal: Option<f32>, error: Option<f32>) -> Option<Warning> {
    let (goal, error) = goal.zip(error).filter(|(goal, error)| error > goal)?;
    Some(Warning::new(format!(
        "the error is {:.2} %, and not the {:.2} % that were asked for: give more time, or draw smaller details \
         larger",
        100.0 * error,
        100.0 * goal
    )))
}

/// One exposure per view, for all of its shadings.
fn exposures(
    arguments: &RenderArguments,
    solution: &Solution,
    images: &[Image],
    views: usize,
) -> Vec<f32> {
    let all: Vec<&Image> = images.iter().collect();
    match arguments.exposure {
        Some(Exposure::Factor(factor)) => vec![factor; views],
        Some(Exposure::Same) => vec![solution.common_exposure(&all); views],
        None => {
            let of_view = |images: &[Image]| solution.exposure(&images[0]);
            images.chunks(images.len() / views).map(of_view).collect()
        }
    }
}

/// `exposures` has one per view.
fn encode(pictures: &[Picture], images: &[Image], exposures: &[f32]) -> Result<Vec<Output>> {
    let shadings = pictures.len() / exposures.len();
    let encode = |(k, (picture, image)): (usize, (&Picture, &Image))| {
        let bytes = picture.format.encode(image, exposures[k / shadings])?;
        Ok(Output { path: picture.path.clone(), bytes })
    };
    pictures.iter().zip(images).enumerate().map(encode).collect()
}
