//! Files that shrink while the program reads them.
#![cfg(target_os = "linux")]

use super::faults::{end, open_files, program, with_triangle};
use std::fs;
use std::path::Path;
use std::process::ExitStatus;
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A folder with a triangle that shines, in memory where there is such a disk: files are cut there without waiting for
/// a journal.
fn folder_in_memory() -> TempDir {
    with_triangle(
        tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a folder"),
    )
}

/// Cuts a file in the moment that the program has it open. Returns whether that moment was caught, and how the
/// run ended.
fn cut_while_read(
    folder: &Path,
    arguments: &[&str],
    (file, bytes): (&str, &[u8]),
    left: u64,
) -> (bool, ExitStatus, String) {
    let path = folder.join(file);
    fs::write(&path, bytes).expect("a file");
    let handle = fs::File::options().write(true).open(&path).expect("it is there");
    let mut child = program(folder, arguments).spawn().expect("it runs");
    let began = Instant::now();
    let is_caught = loop {
        if open_files(&child).iter().any(|(open, _)| *open == path) {
            handle.set_len(left).expect("it can be cut");
            break true;
        }
        if child.try_wait().expect("a state").is_some() {
            break false;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{arguments:?} takes too long");
    };
    let output = child.wait_with_output().expect("it ends");
    (is_caught, output.status, String::from_utf8(output.stderr).expect("UTF-8"))
}

#[test]
fn a_file_that_shrinks_while_it_is_read_is_an_error() {
    let folder = folder_in_memory();
    let path = fs::canonicalize(folder.path()).expect("a folder");
    // Comments take time to read, and hardly any to understand.
    let model =
        "# a comment as long as a line\n".repeat(200_000) + "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let noise: Vec<u8> =
        (0..3_000_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let picture = image::RgbImage::from_raw(1000, 1000, noise).expect("three bytes per pixel");
    picture.save(path.join("t.png")).expect("a picture");
    let texture = fs::read(path.join("t.png")).expect("a picture");
    let uv = "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    fs::write(path.join("t.obj"), uv).expect("a file");
    fs::write(path.join("t.mtl"), "newmtl m\nmap_Kd t.png\nKe 1 1 1\n").expect("a file");
    let flags = ["--levels", "9", "--samples", "1"];
    let solve = [&["solve", "s.obj", "-o", "l.light"][..], &flags].concat();
    let (status, said) = end(program(&path, &solve));
    assert!(status.success(), "{said}");
    let light = fs::read(path.join("l.light")).expect("light");
    let render = ["render", "l.light", "-o", "o.png", "--size", "8x8", "--spp", "1"];
    let files: [(&str, &[u8], &[&str]); 3] = [
        ("m.obj", model.as_bytes(), &["info", "m.obj"]),
        ("t.png", &texture, &["info", "t.obj"]),
        ("l.light", &light, &render),
    ];
    for (file, bytes, arguments) in files {
        let (mut caught, mut complained, began) = (0, 0, Instant::now());
        for tenths in [0, 3, 5, 9].into_iter().cycle() {
            if caught >= 8 && complained > 0 {
                break;
            }
            // A run may have read it before it is cut, but not each run.
            assert!(began.elapsed() < Duration::from_secs(120), "{file}: no cut was noticed");
            let left = bytes.len() as u64 * tenths / 10;
            let (is_caught, status, said) = cut_while_read(&path, arguments, (file, bytes), left);
            assert!(matches!(status.code(), Some(0 | 2)), "{file}: {status}: {said}");
            // A picture that cannot be read is a warning.
            let complains = !status.success() || said.contains("t.png");
            assert!(!complains || said.contains(file), "{file}: {said}");
            caught += u32::from(is_caught);
            complained += u32::from(complains);
        }
        eprintln!("{file}: {caught} cuts while open, {complained} noticed");
    }
}
