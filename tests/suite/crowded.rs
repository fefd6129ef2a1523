//! Files whose triangles lie in one place: they take seconds, not the square of their number.

#![cfg(target_os = "linux")]

use assert_cmd::cargo::cargo_bin;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

type Corner = [f64; 3];

/// `s.obj` with these triangles, which emit and let through the share 1 − d.
fn model(triangles: impl Iterator<Item = [Corner; 3]>, opacity: f64) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (mut vertices, mut faces) = (String::new(), String::new());
    for (k, triangle) in triangles.enumerate() {
        for [x, y, z] in triangle {
            vertices += &format!("v {x} {y} {z}\n");
        }
        faces += &format!("f {} {} {}\n", 3 * k + 1, 3 * k + 2, 3 * k + 3);
    }
    let write = |name: &str, text: String| {
        fs::write(folder.path().join(name), text).expect("a file");
    };
    write("s.obj", format!("mtllib s.mtl\n{vertices}usemtl m\n{faces}"));
    write("s.mtl", format!("newmtl m\nKd .5 .5 .5\nKe 1 1 1\nd {opacity}\n"));
    folder
}

/// Draws a picture of this size and returns the messages. The system kills a run that takes more than `seconds` of
/// processor time.
fn drawn(folder: &Path, size: &str, seconds: u32) -> String {
    let command = format!(
        "ulimit -c 0; ulimit -t {seconds}; exec {} render s.obj -o o.png --size {size}",
        cargo_bin("isolux").display()
    );
    let mut shell = std::process::Command::new("sh");
    let run = shell.args(["-c", &command]).current_dir(folder).output().expect("it runs");
    let text = String::from_utf8_lossy(&run.stderr).into_owned();
    assert_eq!(run.status.code(), Some(0), "{:?}: {text}", run.status);
    text
}

/// Numbers in [-1, 1).
fn numbers() -> impl FnMut() -> f64 {
    let mut bits = 1u64;
    move || {
        bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

#[test]
fn nearly_equal_triangles_take_seconds() {
    let mut x = numbers();
    let mut corner = |[a, b]: [f64; 2]| [a + 1e-6 * x(), b + 1e-6 * x(), 1e-6 * x()];
    let triangles = (0..30_000).map(|_| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(&mut corner));
    let text = drawn(model(triangles, 1.0).path(), "8x8", 60);
    assert!(text.contains("a thousand triangles or more on average"), "{text}");
}

#[test]
fn triangles_that_pass_through_each_other_take_seconds() {
    let mut x = numbers();
    let triangles =
        (0..30_000).map(|_| [[0.0, 0.0, 1e-3 * x().abs()], [x(), x(), 0.0], [x(), x(), 1e-3]]);
    let folder = model(triangles, 1.0);
    drawn(folder.path(), "8x8", 60);
    // At 16 samples per pixel and more this takes a minute.
    let text = drawn(folder.path(), "128x128 --stats s.json", 40);
    assert!(text.contains("pixels have few samples"), "{text}");
    let rays = |size: &str| {
        let statistics = fs::read_to_string(folder.path().join("s.json")).expect("statistics");
        let known: serde_json::Value = serde_json::from_str(&statistics).expect("JSON");
        let of = |name: &str| known[name].as_u64().unwrap_or_else(|| panic!("{size}: {name}"));
        of("rays") - of("transport_rays")
    };
    // Four samples per pixel, each with some four rays.
    let few = rays("128x128");
    assert!(few < 20 * 128 * 128, "{few}");
    drawn(folder.path(), "8x8 --spp 64 --stats s.json", 40);
    let asked_for = rays("8x8");
    assert!(asked_for >= 64 * 8 * 8, "{asked_for}");
}

#[test]
fn a_stack_that_lets_nearly_all_light_through_takes_seconds() {
    let triangles = (0..17_000).map(|k| {
        let z = 1e-4 * k as f64;
        [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]
    });
    drawn(model(triangles, 1e-6).path(), "8x8", 60);
}
