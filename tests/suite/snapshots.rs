//! The program's words, one by one. After a change that is meant, `INSTA_UPDATE=always` writes the
//! snapshots anew.

use assert_cmd::Command;
use insta::assert_snapshot;

/// Standard output of a run that succeeds, in the repository's folder.
fn said(arguments: &[&str]) -> String {
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(env!("CARGO_MANIFEST_DIR")).env_remove("COLUMNS").args(arguments);
    let run = command.assert().success();
    String::from_utf8(run.get_output().stdout.clone()).expect("UTF-8")
}

/// The lines without those that hold times or memory.
fn without_measurements(text: &str) -> String {
    let measured = |line: &&str| {
        let first = line.split_whitespace().next();
        ["rays", "seconds", "peak", "wrote"].iter().all(|word| first != Some(word))
    };
    text.lines().filter(measured).map(|line| format!("{line}\n")).collect()
}

#[test]
fn help() {
    assert_snapshot!("help", said(&["--help"]));
    for command in ["render", "solve", "join", "info"] {
        assert_snapshot!(format!("help-{command}"), said(&[command, "--help"]));
    }
    // With Embree it has one option more.
    if cfg!(not(feature = "embree")) {
        assert_snapshot!("help-bench", said(&["bench", "--help"]));
    }
}

#[test]
fn info() {
    for scene in ["cornell-box", "course-room", "furnace", "two-rooms"] {
        assert_snapshot!(format!("info-{scene}"), said(&["info", &format!("scenes/{scene}.toml")]));
    }
}

#[test]
fn reports() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| folder.path().join(name).to_str().expect("UTF-8").to_string();
    let (light, picture) = (file("a.light"), file("a.png"));
    let quick = ["--levels", "2", "--samples", "64"];
    let solve = [&["solve", "scenes/cornell-box.toml", "-o", &light][..], &quick].concat();
    assert_snapshot!("report-solve", without_measurements(&said(&solve)));
    let small = ["--size", "32x32", "--spp", "4"];
    let render = [&["render", &light, "-o", &picture][..], &small].concat();
    assert_snapshot!("report-render-light", without_measurements(&said(&render)));
    let pairs = ["--form-factors", "pairs", "--levels", "2", "--iterations", "5"];
    let render =
        [&["render", "scenes/course-room.toml", "-o", &picture][..], &small, &pairs].concat();
    assert_snapshot!("report-render-pairs", without_measurements(&said(&render)));
}
