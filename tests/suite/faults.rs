//! What the program leaves when it is killed while it writes, when a disk is full or may not be written, and when
//! memory is short.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::time::Instant;
use tempfile::TempDir;

const KILL: i32 = 9;
const TERM: i32 = 15;

/// A folder with `s.obj`, a triangle that shines.
fn folder() -> TempDir {
    with_triangle(tempfile::tempdir().expect("a temporary folder"))
}

/// As [`folder`], on the disk of the build, where a write lasts until it is on the disk.
fn folder_on_disk() -> TempDir {
    with_triangle(tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder"))
}

pub(super) fn with_triangle(folder: TempDir) -> TempDir {
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    write("s.obj", "mtllib s.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
    write("s.mtl", "newmtl m\nKd .5 .5 .5\nKe 1 1 1\n");
    folder
}

pub(super) fn program(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(assert_cmd::cargo::cargo_bin("isolux"));
    command.current_dir(folder).args(arguments).stdout(Stdio::null()).stderr(Stdio::piped());
    command
}

/// The program under limits that the shell sets, such as `ulimit -v 100000`.
fn limited(folder: &Path, limits: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("ulimit -c 0; {limits}; exec \"$0\" \"$@\"")]);
    command.arg(assert_cmd::cargo::cargo_bin("isolux")).args(arguments);
    command.current_dir(folder).stdout(Stdio::null()).stderr(Stdio::piped());
    command
}

/// How it ended, and what it said on standard error.
pub(super) fn end(mut command: Command) -> (ExitStatus, String) {
    let output = command.spawn().expect("it runs").wait_with_output().expect("it ends");
    (output.status, String::from_utf8(output.stderr).expect("UTF-8"))
}

/// The names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder");
    let name = |entry: fs::DirEntry| entry.file_name().into_string().expect("UTF-8");
    let mut names: Vec<String> = entries.map(|entry| name(entry.expect("an entry"))).collect();
    names.sort();
    names
}

/// Files that a process has open at this moment: their paths, and the names by which they can be looked at.
pub(super) fn open_files(child: &Child) -> Vec<(PathBuf, PathBuf)> {
    let entries = fs::read_dir(format!("/proc/{}/fd", child.id())).into_iter().flatten().flatten();
    let paths = entries.map(|entry| Some((fs::read_link(entry.path()).ok()?, entry.path())));
    paths.flatten().collect()
}

/// How much a process has written to a file that is to become an output in `folder`, while it is none yet.
fn staged(child: &Child, folder: &Path) -> Option<u64> {
    let is_staged = |path: &Path| {
        let name = path.file_name().map(|name| name.to_string_lossy());
        path.starts_with(folder)
            && name.is_some_and(|name| name.starts_with('#') || name.starts_with(".isolux-"))
    };
    let files = open_files(child).into_iter().filter(|(path, _)| is_staged(path));
    files.filter_map(|(_, file)| fs::metadata(file).ok()).map(|file| file.len()).max()
}

/// A shell that sends signals sooner than a process that is started for each could.
struct Signals {
    shell: Child,
    orders: Option<ChildStdin>,
}

impl Signals {
    fn new() -> Signals {
        let loops = "while read -r signal process; do kill \"-$signal\" \"$process\"; done";
        let shell = Command::new("sh")
            .args(["-c", loops])
            .stdin(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let mut shell = shell.expect("it runs");
        Signals { orders: shell.stdin.take(), shell }
    }

    fn send(&mut self, signal: i32, child: &Child) {
        let orders = self.orders.as_mut().expect("it is open until the end");
        writeln!(orders, "{signal} {}", child.id()).expect("it listens");
    }
}

impl Drop for Signals {
    fn drop(&mut self) {
        drop(self.orders.take());
        let _ = self.shell.wait();
    }
}

/// Light of a megabyte that takes little time.
const LIGHT: [&str; 10] =
    ["solve", "s.obj", "-o", "o.light", "--levels", "8", "--samples", "1", "--threads", "1"];

/// A picture of some hundred kilobytes.
const PICTURE: [&str; 16] = [
    "render",
    "s.obj",
    "-o",
    "o.exr",
    "--size",
    "700x500",
    "--spp",
    "1",
    "--levels",
    "0",
    "--samples",
    "4",
    "--threads",
    "1",
    "--shading",
    "flat",
];

/// Solves light again and again and sends `signal` while it is written: as soon as some of it is, a half, and all.
/// After each, the file is the old one or the new one, and `check` looks at what else is there. Returns how many
/// of the runs were hit before the new file had its name.
fn hit_writes(signal: i32, count: usize, check: impl Fn(&Path, ExitStatus)) -> usize {
    let folder = folder_on_disk();
    let path = fs::canonicalize(folder.path()).expect("a folder");
    let output = path.join("o.light");
    let (status, said) = end(program(&path, &LIGHT));
    assert!(status.success(), "{said}");
    let new = fs::read(&output).expect("light");
    let mut signals = Signals::new();
    let (mut hits, mut runs) = (0, 0);
    while hits < count && runs < 2 * count {
        fs::write(&output, "old").expect("a file");
        let wanted = [1, new.len() as u64 / 2, new.len() as u64][runs % 3];
        runs += 1;
        let mut child = program(&path, &LIGHT).stderr(Stdio::null()).spawn().expect("it runs");
        let mut status = None;
        while status.is_none() && staged(&child, &path).is_none_or(|length| length < wanted) {
            status = child.try_wait().expect("a state");
        }
        if status.is_none() {
            signals.send(signal, &child);
        }
        let status = child.wait().expect("it ends");
        let there = fs::read(&output).expect("an output is always there");
        assert!(there == b"old" || there == new, "{} bytes after {status}", there.len());
        hits += usize::from(status.signal() == Some(signal) && there == b"old");
        check(&path, status);
    }
    eprintln!("signal {signal}: {hits} of {runs} runs were hit while they wrote");
    hits
}

#[test]
fn kills_while_a_file_is_written_leave_the_old_one_or_the_new() {
    let hits = hit_writes(KILL, 100, |folder, _| {
        let left = names(folder);
        let is_leftover = |name: &&String| name.starts_with(".isolux-");
        // Each run removes what the last one has left.
        assert!(left.iter().filter(is_leftover).count() <= 1 && left.len() <= 4, "{left:?}");
    });
    // Where a disk lies in memory a write is over before many kills come.
    assert!(hits >= 25, "{hits}");
}

#[test]
fn a_run_after_a_killed_one_removes_what_that_has_left() {
    let folder = folder();
    // What a kill leaves between the moment that a file gets a temporary name and that of its own.
    fs::write(folder.path().join(".isolux-abc123abc123.tmp"), "half").expect("a file");
    let (status, said) = end(program(folder.path(), &PICTURE));
    assert!(status.success(), "{said}");
    assert_eq!(names(folder.path()), ["o.exr", "s.mtl", "s.obj"]);
}

#[test]
fn a_terminated_run_leaves_no_temporary_file() {
    let hits = hit_writes(TERM, 50, |folder, status| {
        assert_eq!(names(folder), ["o.light", "s.mtl", "s.obj"]);
        assert!(status.success() || status.signal() == Some(TERM), "{status}");
    });
    assert!(hits >= 12, "{hits}");
}

#[test]
fn light_whose_solve_is_terminated_is_gone_on_with() {
    is_gone_on_with(&["--max-edge", "10", "--samples", "8", "--solver", "two-level"]);
    is_gone_on_with(&["--levels", "3", "--samples", "3000"]);
    is_gone_on_with(&["--levels", "2", "--form-factors", "pairs", "--solver", "southwell"]);
}

/// Sends a solve with these flags a SIGTERM on its way, and goes on with it.
fn is_gone_on_with(flags: &[&str]) {
    let folder = folder();
    let scene = format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR"));
    let solve = |output| [&["solve", &scene, "-o", output][..], flags].concat();
    let began = Instant::now();
    let (status, said) = end(program(folder.path(), &solve("whole.light")));
    assert!(status.success(), "{said}");
    let partial = folder.path().join("a.light.partial");
    let mut signals = Signals::new();
    let mut wait = began.elapsed() / 2;
    // Until the signal comes when there is something to keep.
    for _ in 0..20 {
        let child = program(folder.path(), &solve("a.light")).spawn().expect("it runs");
        std::thread::sleep(wait);
        signals.send(TERM, &child);
        let output = child.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&output.stderr);
        if partial.exists() {
            assert_eq!(output.status.code(), Some(143), "{said}");
            assert!(said.contains("--resume"), "{said}");
            break;
        }
        assert_eq!(folder.path().join("a.light").exists(), output.status.success(), "{said}");
        wait = if output.status.success() { wait.mul_f64(0.6) } else { wait.mul_f64(1.3) };
        let _ = fs::remove_file(folder.path().join("a.light"));
    }
    assert!(partial.exists(), "{flags:?}: no run was hit");
    let (status, said) =
        end(program(folder.path(), &[&solve("a.light")[..], &["--resume"]].concat()));
    assert!(status.success(), "{said}");
    let [resumed, whole] =
        ["a.light", "whole.light"].map(|name| fs::read(folder.path().join(name)).expect("light"));
    assert!(resumed == whole, "{flags:?}");
    assert!(!partial.exists());
}

#[test]
fn a_file_that_may_not_become_so_large_is_an_error() {
    let folder = folder();
    fs::write(folder.path().join("o.exr"), "old").expect("a file");
    let (status, said) = end(limited(folder.path(), "ulimit -f 100", &PICTURE));
    assert_eq!(status.code(), Some(2), "{said}");
    assert!(said.contains("o.exr: cannot write the file") && said.contains("ulimit -f"), "{said}");
    assert_eq!(fs::read(folder.path().join("o.exr")).expect("a file"), b"old");
    assert_eq!(names(folder.path()), ["o.exr", "s.mtl", "s.obj"]);
}

#[test]
fn what_cannot_be_kept_of_a_picture_is_a_warning() {
    let folder = folder();
    let views = "models = ['s.obj']\n[views.a]\nposition = [0.3, 0.3, 2]\nlook_at = [0.3, 0.3, 0]\n\
                 [views.b]\nposition = [0.3, 0.3, 3]\nlook_at = [0.3, 0.3, 0]\n";
    fs::write(folder.path().join("s.toml"), views).expect("a file");
    let render = ["render", "s.toml", "-o", "o.png", "--view", "a,b", "--levels", "1", "--threads"];
    let flags = ["1", "--size", "200x150", "--error", "50%"];
    let (status, said) =
        end(limited(folder.path(), "ulimit -f 300", &[&render[..], &flags].concat()));
    assert!(status.success(), "{said}");
    let warnings = said.matches("o-a.png.partial: cannot write the file").count();
    assert!(warnings == 1 && said.contains("the run goes on"), "{said}");
    assert_eq!(names(folder.path()), ["o-a.png", "o-b.png", "s.mtl", "s.obj", "s.toml"]);
}

#[test]
fn a_full_device_keeps_the_other_outputs_from_appearing() {
    let folder = folder();
    fs::write(folder.path().join("o.exr"), "old").expect("a file");
    let (status, said) =
        end(program(folder.path(), &[&PICTURE[..], &["--stats", "/dev/full"]].concat()));
    assert_eq!(status.code(), Some(2), "{said}");
    assert!(said.contains("/dev/full: cannot write the file: No space left"), "{said}");
    assert_eq!(fs::read(folder.path().join("o.exr")).expect("a file"), b"old");
    assert_eq!(names(folder.path()), ["o.exr", "s.mtl", "s.obj"]);
}

#[test]
fn full_and_read_only_disks_are_errors_that_change_nothing() {
    let folder = folder();
    fs::create_dir(folder.path().join("disk")).expect("a folder");
    // In name spaces of its own, so that the disk is gone with the shell.
    let mount = "mount -t tmpfs -o size=64k none disk && echo old >disk/o.exr";
    let run = "\"$0\" \"$@\"; code=$?; cat disk/o.exr; ls -A disk; exit $code";
    let disk = |then: &str, arguments: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["-rm", "sh", "-c", &format!("{mount} && {then} || exit 77; {run}")]);
        command.arg(assert_cmd::cargo::cargo_bin("isolux")).args(arguments);
        let output = command.current_dir(folder.path()).output().ok()?;
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        let code = output.status.code().filter(|&code| code == 0 || code == 2)?;
        Some((code, text(output.stdout), text(output.stderr)))
    };
    let picture = [&PICTURE[..3], &["disk/o.exr"], &PICTURE[4..]].concat();
    let full = disk("true", &picture);
    let read_only = disk("mount -o remount,ro none disk", &picture);
    let (Some(full), Some(read_only)) = (full, read_only) else {
        eprintln!("skipped: no disk can be mounted here");
        return;
    };
    for ((code, there, said), cause) in [(full, "No space left"), (read_only, "Read-only")] {
        assert_eq!(code, 2, "{said}");
        assert!(said.contains("disk/o.exr: cannot") && said.contains(cause), "{said}");
        assert_eq!(there, "old\no.exr\n", "{said}");
    }
}

#[test]
fn memory_that_is_short_is_one_clear_error() {
    let folder = folder();
    let scene = |name: &str| format!("{}/scenes/{name}", env!("CARGO_MANIFEST_DIR"));
    let [box_, stairs] = ["cornell-box.toml", "spiral-stairs.gltf"].map(scene);
    let render = ["-o", "o.exr", "--levels", "1", "--samples", "4", "--spp", "1", "--size"];
    let solve =
        ["solve", &box_, "-o", "o.light", "--max-edge", "30", "--samples", "4", "--threads"];
    let runs = [
        vec!["info", &stairs],
        [&solve[..], &["2"]].concat(),
        [&["render", &stairs][..], &render, &["160x120", "--threads", "2"]].concat(),
        [&["render", &box_][..], &render, &["1500x1000", "--shading", "flat"]].concat(),
    ];
    let mut refused = 0;
    for arguments in &runs {
        for kibibytes in [70_000, 90_000, 115_000, 150_000, 200_000, 260_000, 340_000] {
            let limit = format!("ulimit -v {kibibytes}");
            // Below this limit not even the program itself can be loaded.
            if !end(limited(folder.path(), &limit, &["--version"])).0.success() {
                continue;
            }
            let (status, said) = end(limited(folder.path(), &limit, arguments));
            assert!(
                matches!(status.code(), Some(0 | 2)),
                "{limit}: {arguments:?}: {status}: {said}"
            );
            if status.success() {
                continue;
            }
            refused += 1;
            let has_figures = said.contains("may be used") || said.contains("memory allocation of");
            let is_clear = has_figures || said.contains("cannot start the threads");
            assert!(is_clear && said.matches("error: ").count() <= 1, "{limit}: {said}");
        }
    }
    assert!(refused > 4, "{refused}");
}
