//! `isolux solve`: from a scene to its light, kept for as many pictures as one likes.

use super::arguments::{LightArguments, RunArguments, SceneArguments};
use super::partial::Partial;
use super::progress::{Bars, OnSignal};
use super::remarks;
use super::report::{Report, Seconds};
use super::{say, signals, warn};
use crate::begun::{Begun, Unfinished};
use crate::bvh::{Effort, Tracer};
use crate::error::{Error, ErrorKind, Result, Warning};
use crate::export::file::{Inputs, Output, check_writable, write_all};
use crate::plan::{Plan, Spent};
use crate::scene::Document;
use crate::solution::Solution;
use crate::two_level::{Part, Share, put_together};
use std::cell::OnceCell;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
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

    /// Go on with a solve that was cut off: what it has done lies in FILE.partial
    #[arg(long)]
    resume: bool,

    #[command(flatten)]
    scenery: SceneArguments,

    #[command(flatten)]
    light: LightArguments,

    #[command(flatten)]
    run: RunArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    arguments.run.in_pool(|| run_in_pool(arguments))
}

fn run_in_pool(arguments: &Arguments) -> Result<ExitCode> {
    let start = Instant::now();
    let outputs: Vec<&Path> =
        std::iter::once(arguments.output.as_path()).chain(arguments.run.stats.as_deref()).collect();
    let mut partial = Partial::of(&arguments.output);
    let kept = partial.path().to_path_buf();
    let all_outputs = [&outputs[..], &[&kept]].concat();
    match arguments.part {
        Some(_) => check_ending(&arguments.output, "part", "a part of solved light")?,
        None => check_light(&arguments.output)?,
    }
    Inputs::default().check_distinct(&all_outputs)?;
    outputs.iter().try_for_each(|path| check_writable(path))?;
    let mut document = Document::open(&arguments.scene)?;
    arguments.scenery.apply(&mut document);
    let mut inputs = Inputs::new(&document.inputs());
    inputs.check_distinct(&all_outputs)?;
    let scene = document.scene()?;
    inputs.extend(&scene.files);
    inputs.check_distinct(&all_outputs)?;
    warn(&scene.warnings);
    let load = start.elapsed();

    let settings = arguments.light.settings(arguments.run.seed);
    let plan = Plan::new(&document, &scene, &settings)?.with_kernel(arguments.run.kernel);
    let effort = Effort::for_rays(scene.triangles.len(), plan.rays());
    let tracer = Tracer::build_with(&scene, effort, arguments.run.kernel);
    let build = start.elapsed() - load;
    if arguments.part.is_some() && !plan.is_in_two_levels() {
        return Err(Error::new("only light that is solved in two levels has parts")
            .remedy("add --solver two-level"));
    }
    if !arguments.resume {
        partial.check_absent()?;
    }
    let run = Run { arguments, plan: &plan, tracer: &tracer, inputs: &inputs };
    let solved = match plan.is_in_two_levels() {
        true => run.in_two_levels(&mut partial),
        false => run.together(&mut partial),
    };
    let (solution, spent) = match solved {
        Err(error) if error.kind() == ErrorKind::Stopped => return Ok(interrupted(&partial)),
        solved => match solved? {
            Some(solved) => solved,
            None => {
                partial.remove();
                return Ok(ExitCode::SUCCESS);
            }
        },
    };
    let seconds = Seconds::new(load, build, &spent);
    finish(arguments, (&document, &solution), seconds, spent.rays, (start, &inputs))?;
    partial.remove();
    Ok(ExitCode::SUCCESS)
}

/// A run, once the scene is there.
struct Run<'r> {
    arguments: &'r Arguments,
    plan: &'r Plan<'r>,
    tracer: &'r Tracer,
    inputs: &'r Inputs,
}

impl Run<'_> {
    /// # Errors
    /// See [`Plan::solve_together`].
    fn together(&self, partial: &mut Partial) -> Result<Option<(Solution, Spent)>> {
        let known_fingerprint = OnceCell::new();
        let run = || *known_fingerprint.get_or_init(|| self.plan.fingerprint());
        let load = |path: &Path| Begun::load(path, run());
        let begun = if self.arguments.resume { partial.load(load)? } else { None };
        let bars = Bars::new().on_signal(OnSignal::Stop);
        let keep = &mut |unfinished: Unfinished| {
            if bars.was_interrupted() || partial.is_due() {
                partial.keep_if(unfinished.to_bytes(run()), self.inputs);
            }
            Ok(())
        };
        self.plan.solve_together(self.tracer, begun, Some(keep), &bars).map(Some)
    }

    /// The solution, or `None` if a part of it was asked for and written.
    ///
    /// # Errors
    /// See [`Plan::solve_part`]; or the part cannot be written.
    fn in_two_levels(&self, partial: &mut Partial) -> Result<Option<(Solution, Spent)>> {
        let begun =
            if self.arguments.resume { partial.load(|path| Part::load(path))? } else { None };
        let share = self.arguments.part.unwrap_or(Share::WHOLE);
        let bars = Bars::new().on_signal(OnSignal::Stop);
        let keep = &mut |part: &Part| {
            let is_time = bars.was_interrupted() || partial.is_due();
            if is_time && !part.is_finished() && !part.is_empty() {
                partial.keep(part.to_bytes(), self.inputs);
            }
            Ok(())
        };
        let (part, spent) = self.plan.solve_part(self.tracer, share, begun, keep, &bars)?;
        // From here on a signal ends the program.
        drop(bars);
        if signals::was_asked() {
            // At the last moment: what remains to be done may still take long.
            partial.keep(part.to_bytes(), self.inputs);
            return Err(Error::stopped());
        }
        if self.arguments.part.is_none() {
            let (mut solution, mut spent) = (put_together(vec![part]), spent);
            spent.rays += solution.certify(self.tracer, &Bars::new());
            return Ok(Some((solution, spent)));
        }
        let path = &self.arguments.output;
        write_all(vec![Output { path: path.clone(), bytes: part.to_bytes() }], self.inputs)?;
        say(&describe(&part, &spent, path))?;
        Ok(None)
    }
}

/// What a signal has stopped.
fn interrupted(partial: &Partial) -> ExitCode {
    let text = match (partial.path().exists(), partial.has_failed()) {
        (true, false) => "with --resume the same command goes on from what is done",
        (_, true) => "what was done last could not be kept",
        (false, false) => "nothing was done that could be kept",
    };
    warn(&[Warning::new(format!("interrupted: {text}"))]);
    ExitCode::from(signals::exit_code())
}

/// Writes the light and what is to be said of it.
fn finish(
    arguments: &Arguments,
    (document, solution): (&Document, &Solution),
    mut seconds: Seconds,
    rays: u64,
    (start, inputs): (Instant, &Inputs),
) -> Result<()> {
    let mut files = vec![Output { path: arguments.output.clone(), bytes: solution.to_bytes() }];
    seconds.total = start.elapsed().as_secs_f64();
    let report = Report::new(solution, seconds, [arguments.output.as_path()]);
    let report = Report { rays, ..report };
    if let Some(path) = &arguments.run.stats {
        files.push(Output { path: path.clone(), bytes: report.to_json() });
    }
    write_all(files, inputs)?;
    if document.camera.is_none() {
        warn(&remarks::on_the_camera(solution.scene(), &solution.camera));
    }
    warn(remarks::on_the_dark(solution).as_slice());
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
