//! `isolux solve`: from a scene to its light, kept for as many pictures as one likes.

use super::arguments::{LightArguments, RunArguments, SceneArguments};
use super::progress::Bars;
use super::report::{Report, Seconds};
use super::{say, warn};
use crate::bvh::{Effort, Tracer};
use crate::error::{Error, Result};
use crate::export::file::{Output, check_distinct, check_writable, write_all};
use crate::plan::Plan;
use crate::scene::Document;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Solve a scene's light once and keep it; `isolux render ROOM.light` shows it from anywhere.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A scene description (.toml) or a model (.obj, .glb, .gltf, .ply, .stl)
    scene: PathBuf,

    /// Light to write: a .light file, which holds the scene too
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    #[command(flatten)]
    scenery: SceneArguments,

    #[command(flatten)]
    light: LightArguments,

    #[command(flatten)]
    run: RunArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    arguments.run.in_pool(|| run_in_pool(arguments))
}

fn run_in_pool(arguments: &Arguments) -> Result<()> {
    let start = Instant::now();
    let outputs: Vec<&Path> =
        std::iter::once(arguments.output.as_path()).chain(arguments.run.stats.as_deref()).collect();
    check_ending(&arguments.output)?;
    outputs.iter().try_for_each(|path| check_writable(path))?;
    let mut document = Document::open(&arguments.scene)?;
    arguments.scenery.apply(&mut document);
    check_distinct(&outputs, &document.inputs())?;
    let scene = document.scene()?;
    let files: Vec<&Path> = scene.files.iter().map(PathBuf::as_path).collect();
    check_distinct(&outputs, &files)?;
    warn(&scene.warnings);
    let load = start.elapsed();

    let settings = arguments.light.settings(arguments.run.seed);
    let plan = Plan::new(&document, &scene, &settings)?;
    let effort = Effort::for_rays(scene.triangles.len(), plan.rays());
    let tracer = Tracer::build_with(&scene, effort, arguments.run.kernel);
    let build = start.elapsed() - load;
    let (solution, spent) = plan.solve(&tracer, &Bars::new())?;

    let mut files = vec![Output { path: arguments.output.clone(), bytes: solution.to_bytes() }];
    let mut seconds = Seconds::new(load, build, &spent);
    seconds.total = start.elapsed().as_secs_f64();
    let report = Report::new(&solution, seconds, [arguments.output.as_path()]);
    let report = Report { rays: spent.rays, ..report };
    if let Some(path) = &arguments.run.stats {
        files.push(Output { path: path.clone(), bytes: report.to_json() });
    }
    write_all(files)?;
    warn(report.warning().as_slice());
    say(&report.to_text());
    Ok(())
}

/// `isolux render` knows light by its ending.
fn check_ending(path: &Path) -> Result<()> {
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("light")) {
        return Ok(());
    }
    Err(Error::new("solved light is kept in a file that ends in .light")
        .in_file(path)
        .remedy("write -o ROOM.light; `isolux render` makes pictures"))
}
