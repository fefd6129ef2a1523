//! `isolux solve`: from a scene to its light, kept for as many pictures as one likes.

use super::arguments::{LightArguments, RunArguments, SceneArguments};
use super::partial::Partial;
use super::progress::Bars;
use super::report::{Report, Seconds};
use super::{say, warn};
use crate::bvh::{Effort, Tracer};
use crate::error::{Error, Result};
use crate::export::file::{Output, check_distinct, check_writable, write_all};
use crate::plan::{Plan, Spent};
use crate::scene::Document;
use crate::solution::Solution;
use crate::two_level::{Part, Share, put_together};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Solve a scene's light once and keep it; `isolux render ROOM.light` shows it from anywhere.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// A scene description (.toml) or a model (.obj, .glb, .gltf, .ply, .stl)
    scene: PathBuf,

    /// Light to write: a .light file, which holds the scene too; with --part a .part file
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,

    /// Solve the k-th of N parts of the patches alone; `isolux join` puts all parts together. For light that is
    /// solved in two levels
    #[arg(long, value_name = "k/N", conflicts_with = "stats")]
    part: Option<Share>,

    /// Go on with a solve in two levels that was cut off: what it has done lies in FILE.partial
    #[arg(long)]
    resume: bool,

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
    match arguments.part {
        Some(_) => check_ending(&arguments.output, "part", "a part of solved light")?,
        None => check_light(&arguments.output)?,
    }
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
    if (arguments.part.is_some() || arguments.resume) && !plan.is_in_two_levels() {
        return Err(Error::new(
            "only light that is solved in two levels has parts, or can be gone on with",
        )
        .remedy("add --solver two-level"));
    }
    if !plan.is_in_two_levels() {
        let (solution, spent) = plan.solve(&tracer, &Bars::new())?;
        return finish(arguments, &solution, Seconds::new(load, build, &spent), spent.rays, start);
    }
    let mut partial = Partial::of(&arguments.output);
    check_distinct(&[partial.path()], &files)?;
    if !arguments.resume {
        partial.check_absent()?;
    }
    let begun = if arguments.resume { partial.load()? } else { None };
    let share = arguments.part.unwrap_or(Share::WHOLE);
    let keep = &mut |part: &Part| partial.keep(part);
    let (part, mut spent) = plan.solve_part(&tracer, share, begun, keep, &Bars::new())?;
    if arguments.part.is_some() {
        part.save(&arguments.output)?;
        say(&describe(&part, &spent, &arguments.output))?;
    } else {
        let mut solution = put_together(vec![part]);
        spent.rays += solution.certify(&tracer);
        let seconds = Seconds::new(load, build, &spent);
        finish(arguments, &solution, seconds, spent.rays, start)?;
    }
    partial.remove();
    Ok(())
}

/// Writes the light and what is to be said of it.
fn finish(
    arguments: &Arguments,
    solution: &Solution,
    mut seconds: Seconds,
    rays: u64,
    start: Instant,
) -> Result<()> {
    let mut files = vec![Output { path: arguments.output.clone(), bytes: solution.to_bytes() }];
    seconds.total = start.elapsed().as_secs_f64();
    let report = Report::new(solution, seconds, [arguments.output.as_path()]);
    let report = Report { rays, ..report };
    if let Some(path) = &arguments.run.stats {
        files.push(Output { path: path.clone(), bytes: report.to_json() });
    }
    write_all(files)?;
    warn(report.warning().as_slice());
    say(&report.to_text())
}

fn describe(part: &Part, spent: &Spent, path: &Path) -> String {
    let patches = part.patches();
    format!(
        "part {}: patches {} to {}, {:.1} M rays in {:.2} s\n  wrote         {}\n",
        part.share(),
        patches.start,
        patches.end,
        spent.rays as f64 * 1e-6,
        spent.transport.as_secs_f64(),
        path.display()
    )
}

/// `isolux render` knows light by its ending.
pub(super) fn check_light(path: &Path) -> Result<()> {
    check_ending(path, "light", "solved light")
}

fn check_ending(path: &Path, ending: &str, what: &str) -> Result<()> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending)) {
        return Ok(());
    }
    let remedy = match ending {
        "light" => "write -o ROOM.light; `isolux render` makes pictures",
        _ => "write -o NAME.part; `isolux join` makes light of all parts",
    };
    let cause = format!("{what} is kept in a file that ends in .{ending}");
    Err(Error::new(cause).in_file(path).remedy(remedy))
}
