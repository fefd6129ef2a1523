//! Signals that come when nothing is computed any more, and aborts.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Begins a run whose light or picture goes to a file and whose figures go to a pipe that nobody reads: it comes to its
/// end and no further.
fn at_its_end(folder: &TempDir, arguments: &[&str]) -> Child {
    let made = Command::new("mkfifo").arg(folder.path().join("pipe")).status();
    assert!(made.expect("it runs").success());
    let scene = format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR"));
    let mut child = Command::new("sh")
        .args(["-c", "ulimit -c 0; exec \"$0\" \"$@\" --stats pipe"])
        .arg(assert_cmd::cargo::cargo_bin("isolux"))
        .args([&[arguments[0], &scene][..], &arguments[1..]].concat())
        .current_dir(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("it runs");
    let folder = fs::canonicalize(folder.path()).expect("a folder");
    let began = Instant::now();
    while !has_staged(&child, &folder) {
        if began.elapsed() > Duration::from_secs(120) {
            let _ = child.kill();
            panic!("{arguments:?} takes too long");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

/// Whether a process has written to a file that is to become an output in `folder`. The file of the
/// check beforehand is empty.
fn has_staged(child: &Child, folder: &Path) -> bool {
    let entries = fs::read_dir(format!("/proc/{}/fd", child.id())).into_iter().flatten().flatten();
    let is_staged = |file: &Path| {
        let path = fs::read_link(file).unwrap_or_default();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        let is_new = name.is_some_and(|name| name.starts_with('#') || name.starts_with(".isolux-"));
        is_new && path.starts_with(folder) && fs::metadata(file).is_ok_and(|file| file.len() > 0)
    };
    entries.map(|entry| entry.path()).any(|file| is_staged(&file))
}

/// How a run ends that is sent one signal.
fn end(mut child: Child, signal: &str) -> ExitStatus {
    let kill = Command::new("kill").args([signal, &child.id().to_string()]).status();
    assert!(kill.expect("it runs").success());
    let sent = Instant::now();
    while sent.elapsed() < Duration::from_secs(20) {
        if let Some(status) = child.try_wait().expect("a state") {
            return status;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().expect("it runs still");
    child.wait().expect("it ends")
}

const PICTURE: [&str; 9] =
    ["render", "-o", "a.png", "--levels", "0", "--size", "64x48", "--spp", "1"];

const LIGHT: [&str; 9] =
    ["solve", "-o", "a.light", "--max-edge", "60", "--samples", "8", "--solver", "two-level"];

#[test]
fn the_first_signal_ends_a_run_whose_computation_is_over() {
    for arguments in [&PICTURE[..], &LIGHT] {
        let folder = tempfile::tempdir().expect("a folder");
        let status = end(at_its_end(&folder, arguments), "-TERM");
        assert_eq!(status.signal(), Some(15), "{arguments:?}: {status}");
        let left = fs::read_dir(folder.path()).expect("a folder").count();
        assert_eq!(left, 1, "only the pipe is there");
    }
}

#[test]
fn an_abort_that_is_not_for_want_of_memory_is_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let status = end(at_its_end(&folder, &PICTURE), "-ABRT");
    assert_eq!(status.signal(), Some(6), "{status}");
}

#[test]
fn a_part_that_was_kept_when_it_was_done_is_gone_on_with() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR"));
    let solve = |output: &str, more: &[&str]| {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin("isolux"));
        command.current_dir(folder.path()).args(["solve", &scene, "-o", output]);
        let status = command.args(&LIGHT[3..]).args(more).stdout(Stdio::null()).status();
        assert!(status.expect("it runs").success());
        fs::read(folder.path().join(output)).expect("a file")
    };
    let whole = solve("whole.light", &[]);
    let part = solve("a.part", &["--part", "1/1"]);
    fs::write(folder.path().join("b.light.partial"), &part).expect("a file");
    assert!(solve("b.light", &["--resume"]) == whole);
    fs::write(folder.path().join("b.part.partial"), &part).expect("a file");
    assert!(solve("b.part", &["--part", "1/1", "--resume"]) == part);
}
