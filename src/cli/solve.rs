//! `isolux solve`: from a scene to its light, kept for as many pictures as one likes.

use super::arguments::{LightArguments, RunArguments};
use super::light::Plan;
use super::report::{Report, Seconds};
use super::{say, warn};
use crate::error::{Error, Result};
use crate::export::file::{Output, check_distinct, check_writable, write_all};
use crate::scene::{Document, Scene};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Solve a scene's light once and keep it; `isolux render ROOM.light` shows it from anywhere.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A scene description (.toml) or a model (.obj)
    scene: PathBuf,

    /// Light to write: a .light file, which holds the scene too
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

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
    let mut times = Seconds::default();
    let outputs: Vec<&Path> =
        std::iter::once(arguments.output.as_path()).chain(arguments.run.stats.as_deref()).collect();
    check_ending(&arguments.output)?;
    outputs.iter().try_for_each(|path| check_writable(path))?;
    let description = Document::open(&arguments.scene)?;
    check_distinct(&outputs, &description.inputs())?;
    let scene = Scene::load(&description)?;
    warn(&scene.warnings);
    times.load = start.elapsed().as_secs_f64();

    let plan = Plan::new(&arguments.light, &arguments.run, &description, &scene)?;
    let caster = plan.caster(0);
    let (solution, rays) = plan.solve(&description, &caster, &mut times, start)?;

    let mut files = vec![Output { path: arguments.output.clone(), bytes: solution.to_bytes() }];
    times.total = start.elapsed().as_secs_f64();
    let report = Report { rays, ..Report::new(&solution, times, [arguments.output.as_path()]) };
    if let Some(path) = &arguments.run.stats {
        files.push(Output { path: path.clone(), bytes: report.to_json() });
    }
    write_all(files)?;
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
