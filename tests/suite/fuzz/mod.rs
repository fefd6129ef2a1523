//! A fuzzer that needs nothing: mutations of seeds for each reader, in a process of its own, until the time is up.
//!
//! `ISOLUX_FUZZ_SECONDS` says for how long in all, and `ISOLUX_FUZZ_SEED` seeds the mutations. `tests/fuzz` gives
//! the readers what a coverage-guided fuzzer finds; `found.rs` holds what either found.

mod found;
mod mutations;
mod seeds;
mod targets;
mod worker;

use serde::{Deserialize, Serialize};
use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// The work of one process, which an environment variable tells it.
#[derive(Serialize, Deserialize)]
struct Job {
    target: String,
    seed: u64,
    /// How long new inputs are begun.
    time: Duration,
    /// One input may take this long of the processor's time.
    patience: Duration,
    /// For the reader's files; `input` is the input.
    folder: PathBuf,
}

const JOB: &str = "ISOLUX_FUZZ_JOB";

impl Job {
    fn new(target: &str, folder: &Path) -> Job {
        Job {
            target: target.into(),
            seed: 1,
            time: Duration::from_secs(1),
            patience: Duration::from_secs(10),
            folder: folder.into(),
        }
    }

    /// How many inputs came to a good end, or what the process said when one did not.
    fn run(&self) -> Result<usize, String> {
        let output = Command::new(env::current_exe().expect("a name"))
            .args(["fuzz::worker::works", "--exact", "--ignored", "--nocapture"])
            .env(JOB, serde_json::to_string(self).expect("JSON"))
            .env("RAYON_NUM_THREADS", "1")
            .stdin(Stdio::null())
            .output()
            .expect("the suite runs");
        let said = String::from_utf8_lossy(&output.stdout);
        let inputs = said.lines().find_map(|line| line.strip_prefix(worker::INPUTS));
        match inputs.and_then(|inputs| inputs.parse().ok()) {
            Some(inputs) if output.status.success() => Ok(inputs),
            _ => {
                let error = String::from_utf8_lossy(&output.stderr);
                Err(format!("{}\n{said:.1000}\n{error:.3000}", output.status))
            }
        }
    }
}

fn number(variable: &str, otherwise: u64) -> u64 {
    env::var(variable).map_or(otherwise, |text| text.parse().expect("a whole number"))
}

/// The name of every target, with the program as a whole.
fn names() -> impl Iterator<Item = &'static str> {
    targets::TARGETS.iter().map(|target| target.name).chain([worker::PROGRAM])
}

#[test]
fn every_file_comes_to_a_good_end() {
    let seconds = number("ISOLUX_FUZZ_SECONDS", 6);
    let seed = number("ISOLUX_FUZZ_SEED", 1);
    let mut failures = String::new();
    for target in names() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let time = Duration::from_secs(seconds) / names().count() as u32;
        match (Job { seed, time, ..Job::new(target, folder.path()) }).run() {
            Ok(inputs) => println!("{target:8} {inputs:8} inputs"),
            Err(said) => {
                let kept = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("fuzz-{target}"));
                let copied = fs::copy(folder.path().join("input"), &kept);
                failures += &format!("{target}: {said}\nthe input: {kept:?} ({copied:?})\n\n");
            }
        }
    }
    assert!(failures.is_empty(), "{failures}");
}

#[test]
fn what_was_found_stays_fixed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (target, input) in found::FOUND {
        targets::target(target).expect("a target").run(folder.path(), input);
    }
}

#[test]
fn a_panic_an_abort_a_hang_and_a_bomb_are_noticed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (fault, sign) in worker::FAULTS {
        let patience = Duration::from_secs(3);
        let job = Job { patience, ..Job::new(fault, folder.path()) };
        let said = job.run().expect_err(fault);
        assert!(said.contains(sign), "{fault}: {said}");
        let input = fs::read(folder.path().join("input")).expect("what did it is kept");
        assert!(input.starts_with(b"fault"), "{fault}: {input:?}");
    }
}
