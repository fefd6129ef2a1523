//! Pictures that are interrupted, previewed and gone on with.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A picture that takes seconds.
const PICTURE: [&str; 7] = ["--levels", "1", "--size", "96x72", "--error", "0.8%", "-o"];

fn start(folder: &Path, arguments: &[&str]) -> Child {
    let scene = format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR"));
    Command::new(assert_cmd::cargo::cargo_bin("isolux"))
        .current_dir(folder)
        .args(["render", &scene])
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("it runs")
}

fn end(child: Child) -> (Output, String) {
    let output = child.wait_with_output().expect("it ends");
    let said = String::from_utf8(output.stderr.clone()).expect("UTF-8");
    (output, said)
}

fn send(signal: &str, child: &Child) {
    let kill = [signal, &child.id().to_string()].map(str::to_string);
    assert!(Command::new("kill").args(kill).status().expect("it runs").success());
}

fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Waits until a file is there that `child` writes.
fn wait_for(file: &Path, child: &mut Child) {
    let since = Instant::now();
    while !file.exists() {
        assert!(child.try_wait().expect("a state").is_none(), "it ended early");
        assert!(since.elapsed() < Duration::from_secs(120), "nothing came");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_resumed_picture_has_the_bits_of_one_that_was_never_interrupted() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let arguments = |output| [&PICTURE[..], &[output]].concat();
    let (whole, said) = end(start(folder.path(), &arguments("whole.exr")));
    assert!(whole.status.success(), "{said}");
    assert!(!at("whole.exr.partial").exists());

    let interrupted = [&arguments("a.exr")[..], &["--preview", "0.2s", "--threads", "1"]].concat();
    let mut child = start(folder.path(), &interrupted);
    wait_for(&at("a.exr"), &mut child);
    image::open(at("a.exr")).expect("a preview is a whole picture");
    send("-TERM", &child);
    let (output, said) = end(child);
    assert_eq!(output.status.code(), Some(143), "{said}");
    assert!(said.contains("--resume"), "{said}");
    assert!(at("a.exr.partial").is_file());
    image::open(at("a.exr")).expect("an interrupted picture is whole");
    assert_ne!(fs::read(at("a.exr")).unwrap(), fs::read(at("whole.exr")).unwrap());

    // What is kept is neither overwritten nor gone on with as another picture.
    let (output, said) = end(start(folder.path(), &arguments("a.exr")));
    assert_eq!(output.status.code(), Some(2));
    assert!(said.contains("--resume"), "{said}");
    let other = [&arguments("a.exr")[..], &["--resume", "--seed", "7"]].concat();
    let (output, said) = end(start(folder.path(), &other));
    assert_eq!(output.status.code(), Some(2));
    assert!(said.contains("a.exr.partial"), "{said}");

    let (output, said) =
        end(start(folder.path(), &[&arguments("a.exr")[..], &["--resume"]].concat()));
    assert!(output.status.success(), "{said}");
    assert!(fs::read(at("a.exr")).unwrap() == fs::read(at("whole.exr")).unwrap());
    assert!(!at("a.exr.partial").exists());
}

#[test]
fn a_preview_is_whole_whenever_the_run_is_killed() {
    for wait in [0, 150, 400] {
        let folder = folder();
        let picture = folder.path().join("a.png");
        let arguments = [&PICTURE[..], &["a.png", "--preview", "0.05s"]].concat();
        let mut child = start(folder.path(), &arguments);
        wait_for(&picture, &mut child);
        std::thread::sleep(Duration::from_millis(wait));
        send("-KILL", &child);
        end(child);
        let size = image::open(&picture).expect("a whole picture").into_rgb8().dimensions();
        assert_eq!(size, (96, 72), "after {wait} ms");
    }
}

#[test]
fn each_view_has_its_own_picture_of_errors() {
    let folder = folder();
    let scene = fs::read_to_string("scenes/cornell-box.toml").expect("a scene");
    let models = format!("{}/scenes/cornell-box.obj", env!("CARGO_MANIFEST_DIR"));
    let views = "\n[views.a]\nposition = [278, 273, -700]\nlook_at = [278, 273, 0]\n\
                 [views.b]\nposition = [278, 273, -400]\nlook_at = [100, 273, 0]\n";
    let scene = scene.replace("cornell-box.obj", &models) + views;
    fs::write(folder.path().join("s.toml"), scene).expect("it is written");
    let run = Command::new(assert_cmd::cargo::cargo_bin("isolux"))
        .current_dir(folder.path())
        .args(["render", "s.toml", "--levels", "0", "--size", "32x24", "--view", "a,b"])
        .args(["-o", "p.png", "--error-image", "e.exr"])
        .output()
        .expect("it runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let [a, b] = ["e-a.exr", "e-b.exr"].map(|name| fs::read(folder.path().join(name)).unwrap());
    assert!(a != b);
    assert!(!folder.path().join("e.exr").exists());
}

#[test]
fn each_shading_that_knows_its_errors_has_a_picture_of_them() {
    let folder = folder();
    let run = |more: &[&str]| {
        let quick = ["--levels", "0", "--size", "32x24", "-o", "p.png", "--error-image", "e.exr"];
        let (output, said) = end(start(folder.path(), &[&quick[..], more].concat()));
        let wrote = String::from_utf8(output.stdout).expect("UTF-8");
        (output.status.code(), wrote.matches("wrote         e").count(), said)
    };
    let exists = |name: &str| folder.path().join(name).exists();
    assert_eq!(run(&["--shading", "flat,path"]).0, Some(0));
    assert!(exists("e-path.exr") && exists("p-flat.png") && exists("p-path.png"));
    let (code, wrote, said) = run(&["--shading", "flat,path,gather"]);
    assert_eq!((code, wrote), (Some(0), 2), "{said}");
    assert!(exists("e-gather.exr") && !exists("e-flat.exr"));
    let [path, gather] =
        ["e-path.exr", "e-gather.exr"].map(|name| fs::read(folder.path().join(name)).unwrap());
    assert!(path != gather);
    for (more, cause) in [
        (&["--shading", "flat"][..], "for gathered and path-traced pictures"),
        (&["--shading", "path", "--spp", "3"], "not known with fewer than 4 samples per pixel"),
    ] {
        let (code, _, said) = run(more);
        assert_eq!(code, Some(2));
        assert!(said.contains(cause), "{said}");
    }
}
