//! The command line: one file per subcommand.

mod allocator;
mod arguments;
mod bench;
mod gathering;
mod info;
mod join;
mod partial;
mod pictures;
mod progress;
mod remarks;
mod render;
mod report;
mod signals;
mod solve;
mod verify;

pub use allocator::Allocator;

use crate::error::{Error, ErrorKind, Result, in_one_line, printable};
use crate::export::file::write_patiently;
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

/// Runs the program: exit 0 for success, 1 for a check that failed, 2 for bad input, 128 and the number of a
/// signal for what that signal interrupted.
pub fn run() -> ExitCode {
    allocator::give_back_large_blocks();
    signals::watch();
    let command = match Cli::try_parse() {
        Ok(cli) => cli.command,
        Err(error) => return answer(&error),
    };
    let result = crate::simd::level()
        .and_then(|_| arguments::check_threads())
        .and_then(|()| dispatch(command));
    match result {
        Ok(code) => code,
        Err(error) => {
            complain(&format!("error: {error}\n{}", flags_for(&error)));
            ExitCode::from(2)
        }
    }
}

/// Says what is wrong with the arguments, or prints the help that they ask for.
fn answer(error: &clap::Error) -> ExitCode {
    let mut text = error.to_string();
    if !error.use_stderr() {
        return ExitCode::from(if say(&text).is_ok() { 0 } else { 2 });
    }
    // An argument must not begin a line of its own.
    for argument in std::env::args_os() {
        let argument = argument.to_string_lossy();
        let value = argument.split_once('=').map_or(&*argument, |(_, value)| value);
        for word in [&*argument, value].into_iter().filter(|word| word.contains('\n')) {
            text = text.replace(word, &in_one_line(word));
        }
    }
    complain(&text);
    ExitCode::from(2)
}

/// The flags with which a remedy can be had. The library knows none.
fn flags_for(error: &Error) -> &'static str {
    match error.kind() {
        ErrorKind::Patches => "  flags: raise --max-edge or lower --levels\n",
        ErrorKind::Memory if error.is_of_a_file() => "",
        ErrorKind::Memory => {
            "  flags: raise --max-edge or lower --levels or --samples, use --form-factors \
             hemisphere, --solver two-level or --solver southwell; each of --threads takes some, too\n"
        }
        ErrorKind::Divergence => "  flags: --tolerance, --samples, --form-factors hemisphere\n",
        _ => "",
    }
}

fn dispatch(command: Command) -> Result<ExitCode> {
    match command {
        Command::Render(arguments) => render::run(&arguments),
        Command::Solve(arguments) => solve::run(&arguments),
        Command::Join(arguments) => join::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Info(arguments) => info::run(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments).map(|()| ExitCode::SUCCESS),
    }
}

/// Prints to standard output, without what would speak to a terminal. A reader that has closed it (`| head`) is no
/// failure of ours.
///
/// # Errors
/// Any other refusal: a full disk.
fn say(text: &str) -> Result<()> {
    match write_patiently(&mut std::io::stdout().lock(), printable(text).as_bytes()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            let error = Error::new(format!("cannot write to standard output: {e}"));
            Err(error.of_kind(ErrorKind::System).remedy("check where it goes to"))
        }
        _ => Ok(()),
    }
}

/// Prints to standard error, without what would speak to a terminal.
fn complain(text: &str) {
    let _ = std::io::stderr().write_all(printable(text).as_bytes());
}

fn warn(warnings: &[crate::error::Warning]) {
    for warning in warnings {
        complain(&format!("warning: {warning}\n"));
    }
}
