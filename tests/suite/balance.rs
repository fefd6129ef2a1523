//! The power balance carries its error, and a wrong balance is a warning.

use assert_cmd::Command;
use isolux::settings::PatchSettings;
use isolux::{Document, Settings, Solution, Tracer};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A closed white box of edge 2 that reflects all but one millionth, with a black lamp in it of half edge `half`: the
/// light is reflected a hundred times or more before the lamp absorbs it.
fn white_box(half: f32) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut model = "mtllib box.mtl\n".to_string();
    let edge = [0.0, 2.0];
    let corners = edge.into_iter().flat_map(|x| edge.map(|y| edge.map(|z| [x, y, z])));
    let (a, b) = (1.0 - half, 1.0 + half);
    let lamp = [[a, 1.9, a], [b, 1.9, a], [b, 1.9, b], [a, 1.9, b]];
    for [x, y, z] in corners.flatten().chain(lamp) {
        model += &format!("v {x} {y} {z}\n");
    }
    model += "usemtl white\nf 1 5 7 3\nf 2 4 8 6\nf 1 2 6 5\nf 3 7 8 4\nf 1 3 4 2\nf 5 6 8 7\n";
    model += "usemtl lamp\nf 9 10 11 12\n";
    let white = "newmtl white\nKd .999999 .999999 .999999\n";
    let lamp = "newmtl lamp\nKd 0 0 0\nKe 10 10 10\n";
    fs::write(folder.path().join("box.obj"), model).expect("a file");
    fs::write(folder.path().join("box.mtl"), format!("{white}{lamp}")).expect("a file");
    folder
}

/// The light of a scene at this level of subdivision, with this many rays per patch.
fn solve(file: &Path, levels: u32, samples: Option<u32>, seed: u64) -> Solution {
    let document = Document::open(file).expect("a scene");
    let scene = document.scene().expect("triangles");
    let patches = PatchSettings { levels: Some(levels), max_edge: None };
    let mut settings = Settings { patches, seed, ..Settings::default() };
    settings.light.samples = samples;
    Solution::solve(&document, &scene, &Tracer::build(&scene), &settings, &()).expect("light")
}

/// Imbalance over its standard error, for these seeds.
fn ratios(file: &Path, levels: u32, samples: Option<u32>, seeds: u64) -> Vec<f64> {
    let of_seed = |seed| {
        let figures = solve(file, levels, samples, seed).figures;
        figures.energy.imbalance() / figures.misfit.samples.expect("hemispheres have eighths")
    };
    (1..=seeds).map(of_seed).collect()
}

/// Student's t with seven degrees of freedom, as of eighths, has 95 % within 2.36; in n seeds that is all but a few.
fn assert_covered(ratios: &[f64]) {
    let covered = ratios.iter().filter(|ratio| ratio.abs() <= 2.36).count() as f64;
    let rms = (ratios.iter().map(|x| x * x).sum::<f64>() / ratios.len() as f64).sqrt();
    println!("{covered} of {} covered, rms {rms:.2}", ratios.len());
    assert!(covered >= 0.85 * ratios.len() as f64, "{ratios:?}");
    // Neither too small nor far too large.
    assert!((0.5..1.6).contains(&rms), "{rms}: {ratios:?}");
}

#[test]
fn the_balance_lies_within_its_error_in_a_box_that_reflects_nearly_all() {
    let folder = white_box(0.25);
    assert_covered(&ratios(&folder.path().join("box.obj"), 2, Some(32), 40));
}

#[test]
fn the_balance_lies_within_its_error_in_an_open_room() {
    assert_covered(&ratios(Path::new("scenes/cornell-box.toml"), 2, None, 40));
}

#[test]
fn what_is_wrong_by_as_much_as_its_error_is_a_warning() {
    let folder = white_box(0.05);
    let said = |scene: &Path, more: &[&str]| {
        let out = folder.path().join("a.light");
        let run = Command::cargo_bin("isolux")
            .expect("the program is built")
            .arg("solve")
            .arg(scene)
            .args(more)
            .arg("-o")
            .arg(out)
            .output()
            .expect("it runs");
        assert!(run.status.success());
        String::from_utf8_lossy(&run.stderr).into_owned()
    };
    let of_box = |more: &[&str]| said(&folder.path().join("box.obj"), more);
    let levels = ["--levels", "1"];
    for seed in ["1", "2", "3"] {
        let text = of_box(&[&levels[..], &["--seed", seed]].concat());
        assert!(text.contains("warning: the power ") && text.contains("standard error"), "{text}");
    }
    let text = of_box(&["--levels", "1", "--iterations", "2"]);
    assert!(text.contains("--iterations"), "{text}");
    for scene in ["furnace", "cornell-box", "two-rooms", "course-room"] {
        let text = said(&Path::new("scenes").join(scene).with_extension("toml"), &[]);
        assert!(!text.contains("the power "), "{scene}: {text}");
    }
    // The patches of two levels are sampled, too, and few samples are no overlap.
    let few = ["--solver", "two-level", "--levels", "1", "--samples", "16"];
    let text = said(Path::new("scenes/course-room.toml"), &few);
    assert!(!text.contains("counted twice"), "{text}");
}
