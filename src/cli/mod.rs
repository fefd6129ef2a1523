//! The command line: one file per subcommand.

mod arguments;
mod bench;
mod info;
mod join;
mod partial;
mod progress;
mod render;
mod report;
mod solve;
mod verify;

use crate::error::{ErrorKind, Result};
use clap::{Parser, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// Radiosity on triangle meshes: pictures of diffuse scenes whose light is solved, not guessed.
#[derive(Parser)]
#[command(name = "isolux", version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(Box<arguments::RenderArguments>),
    Solve(Box<solve::Arguments>),
    Join(join::Arguments),
    Info(info::Arguments),
    Verify(verify::Arguments),
    Bench(bench::Arguments),
}

/// Runs the program: exit 0 for success, 1 for a check that failed, 2 for bad input.
pub fn run() -> ExitCode {
    let command = Cli::parse().command;
    let result = crate::bvh::simd::level().and_then(|_| dispatch(command));
    match result {
        Ok(code) => code,
        Err(error) => {
            complain(&format!("error: {error}\n{}", flags_for(error.kind())));
            ExitCode::from(2)
        }
    }
}

/// The flags with which a remedy can be had. The library knows none.
fn flags_for(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::Patches => "  flags: raise --max-edge or lower --levels\n",
        ErrorKind::Memory => {
            "  flags: raise --max-edge or lower --levels or --samples, use --form-factors \
             hemisphere, --solver two-level or --solver southwell\n"
        }
        ErrorKind::Divergence => "  flags: --tolerance, --samples, --form-factors hemisphere\n",
        _ => "",
    }
}

fn dispatch(command: Command) -> Result<ExitCode> {
    match command {
        Command::Render(arguments) => render::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Solve(arguments) => solve::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Join(arguments) => join::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Info(arguments) => info::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments).map(|()| ExitCode::SUCCESS),
    }
}

/// Prints to standard output. A reader that has closed it (`| head`) is no failure of ours.
fn say(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

/// Prints to standard error.
fn complain(text: &str) {
    let _ = std::io::stderr().write_all(text.as_bytes());
}

fn warn(warnings: &[crate::error::Warning]) {
    for warning in warnings {
        complain(&format!("warning: {warning}\n"));
    }
}
