//! `isolux join`: from the parts that `isolux solve --part` made to the whole light.

use super::progress::Bars;
use super::report::{Report, Seconds};
use super::say;
use super::solve::check_light;
use crate::bvh::Tracer;
use crate::error::Result;
use crate::export::file::{Inputs, Output, check_writable, write_all};
use crate::plan::Spent;
use crate::two_level::{self, Part};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Put the parts of a scene's light together: the result has the bits of one run
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// All parts that `isolux solve --part` made, in any order
    #[arg(required = true, value_name = "PART")]
    parts: Vec<PathBuf>,

    /// Light to write: a .light file, which holds the scene too
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let start = Instant::now();
    check_light(&arguments.output)?;
    check_writable(&arguments.output)?;
    let mut inputs = Inputs::default();
    inputs.extend(&arguments.parts);
    inputs.check_distinct(&[&arguments.output])?;
    let parts = arguments.parts.iter().map(Part::load).collect::<Result<_>>()?;
    let mut solution = two_level::join(parts)?;
    let rays = solution.certify(&Tracer::build(solution.scene()), &Bars::new());
    let seconds = Seconds::new(start.elapsed(), Duration::ZERO, &Spent::default());
    let output = Output { path: arguments.output.clone(), bytes: solution.to_bytes() };
    write_all(vec![output], &inputs)?;
    let mut report = Report::new(&solution, seconds, [arguments.output.as_path()]);
    report.rays = solution.figures.rays + rays;
    report.seconds.total = start.elapsed().as_secs_f64();
    super::warn(report.warning().as_slice());
    say(&report.to_text())
}
