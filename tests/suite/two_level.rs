//! Light in two levels, whole, in parts and gone on with.

use assert_cmd::Command;
use isolux::color::luminance;
use isolux::patches::{PatchId, Side};
use isolux::plan::Plan;
use isolux::radiosity::Solver;
use isolux::scene::Scene;
use isolux::settings::{LightSettings, PatchSettings, Settings};
use isolux::two_level::{Part, Share, join};
use isolux::{Document, Solution, Tracer};
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn open(file: &str) -> (Document, Scene) {
    let path = format!("{}/scenes/{file}", env!("CARGO_MANIFEST_DIR"));
    let document = Document::open(path).expect("a description");
    let scene = document.scene().expect("a scene");
    (document, scene)
}

fn settings(levels: u32, paths: u32) -> Settings {
    let patches = PatchSettings { levels: Some(levels), max_edge: None };
    let solver = Some(Solver::TwoLevel);
    let light = LightSettings { solver, samples: Some(paths), ..LightSettings::default() };
    Settings { patches, light, ..Settings::default() }
}

fn light(file: &str, settings: &Settings) -> Solution {
    let (document, scene) = open(file);
    Solution::solve(&document, &scene, &Tracer::build(&scene), settings, &()).expect("light")
}

fn luminances(light: &Solution) -> Vec<f64> {
    light.irradiance().iter().map(|h| luminance(*h).into()).collect()
}

fn errors(light: &Solution) -> Vec<f64> {
    light.error().expect("it is known").iter().map(|&error| error.into()).collect()
}

#[test]
fn in_a_furnace_every_patch_receives_what_a_closed_form_says() {
    let light = light("furnace.toml", &settings(4, 64));
    let expected = 2.0 * PI;
    for (patch, irradiance) in light.irradiance().iter().enumerate() {
        // The solver stops at a residual of 1e-4. Paths that end by chance have an error, which is known.
        let error = f64::from(light.error().expect("errors")[patch]);
        let off = (irradiance.as_dvec3() - expected).abs().max_element();
        assert!(off < 1e-3 * expected + 8.0 * error, "patch {patch}: {irradiance} ± {error}");
    }
    // Only where paths go on from near surfaces, in the corners, do they end by chance.
    let squares: f64 = errors(&light).iter().map(|error| error.powi(2)).sum();
    let error = (squares / light.irradiance().len() as f64).sqrt() / expected;
    println!("the furnace's error: {error}");
    assert!(error < 0.01, "{error}");
    assert!(light.figures.energy.imbalance().abs() < 1e-3);
}

/// The mean luminance of irradiance on each side of a triangle, its standard error where it is known, and the area.
fn on_sides(light: &Solution) -> Vec<[f64; 3]> {
    let (mesh, luminances) = (light.patches(), luminances(light));
    let variance = |patch: PatchId| {
        light.error().map_or(0.0, |errors| f64::from(errors[patch.index()]).powi(2))
    };
    let of_side = |side: &Side| {
        let (mut sum, mut variances) = (0.0, 0.0);
        for patch in side.patches() {
            sum += luminances[patch.index()];
            variances += variance(patch);
        }
        let patches = side.patch_count() as f64;
        [sum / patches, variances.sqrt() / patches, side.patch_area * patches]
    };
    mesh.sides().iter().map(of_side).collect()
}

#[test]
fn the_light_is_that_of_a_stored_matrix_with_small_patches() {
    for (file, levels) in [("cornell-box.toml", 3), ("two-rooms.toml", 1), ("greenhouse.toml", 2)] {
        let two_levels = light(file, &settings(levels, 512));
        let mut by_matrix = settings(levels + 1, 256);
        by_matrix.light.solver = Some(Solver::GaussSeidel);
        let (a, b) = (on_sides(&two_levels), on_sides(&light(file, &by_matrix)));
        let (mut area, mut power, mut off, mut squares, mut noise) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for ([a, error, a_area], [b, _, _]) in a.into_iter().zip(b) {
            area += a_area;
            power += b * a_area;
            off += (a - b) * a_area;
            squares += (a - b).powi(2) * a_area;
            noise += error.powi(2) * a_area;
        }
        let (off, mean) = (off / power, power / area);
        let [rms, noise] = [squares, noise].map(|squares| (squares / area).sqrt() / mean);
        let imbalance = two_levels.figures.energy.imbalance();
        println!("{file}: off by {off:.5}, sides by {rms:.5} ± {noise:.5}, balance {imbalance:.5}");
        assert!(off.abs() < 0.005, "{file}: {off}");
        assert!(rms < 0.01 + 2.0 * noise, "{file}: {rms} ± {noise}");
        assert!(imbalance.abs() < 0.005, "{file}: {imbalance}");
    }
}

#[test]
fn the_error_of_the_patches_is_as_large_as_it_is_said_to_be() {
    for (file, levels) in [("cornell-box.toml", 3), ("two-rooms.toml", 1)] {
        let few = light(file, &settings(levels, 64));
        // Paths and elements of another seed are independent of the first.
        let many = light(file, &Settings { seed: 2, ..settings(levels, 2048) });
        let [a, b] = [&few, &many].map(luminances);
        let mean = b.iter().sum::<f64>() / b.len() as f64;
        // Relative to what the patch receives, so that a few bright ones do not decide.
        let relative = |x: f64, patch: usize| (x / b[patch].max(0.01 * mean)).powi(2);
        let off: f64 = (0..b.len()).map(|patch| relative(a[patch] - b[patch], patch)).sum();
        let said = |light: &Solution| -> f64 {
            errors(light).into_iter().enumerate().map(|(patch, e)| relative(e, patch)).sum()
        };
        let ratio = off / (said(&few) + said(&many));
        let error = (said(&few) / b.len() as f64).sqrt();
        println!("{file}: error {error:.4}; squares off over squares of errors: {ratio:.3}");
        assert!((ratio - 1.0).abs() < 0.15, "{file}: {ratio}");
    }
}

#[test]
fn many_patches_are_solved_in_two_levels_unless_something_else_is_asked_for() {
    let (document, scene) = open("cornell-box.toml");
    let plan = |change: fn(&mut Settings)| {
        let mut settings = Settings::default();
        settings.patches.levels = Some(6);
        change(&mut settings);
        Plan::new(&document, &scene, &settings).expect("a plan").is_in_two_levels()
    };
    assert!(plan(|_| ()));
    assert!(!plan(|s| s.patches.levels = Some(5)));
    assert!(!plan(|s| s.light.solver = Some(Solver::GaussSeidel)));
    assert!(!plan(|s| s.light.points = Some(isolux::sampling::PointSet::Random)));
    assert!(plan(|s| {
        s.patches.levels = Some(0);
        s.light.solver = Some(Solver::TwoLevel);
    }));
}

#[test]
fn a_solve_that_was_cut_off_goes_on_to_the_same_bits() {
    // Three stretches of patches.
    let (document, scene) = open("cornell-box.toml");
    let (tracer, settings) = (Tracer::build(&scene), settings(6, 8));
    let plan = Plan::new(&document, &scene, &settings).expect("a plan");
    let mut kept = Vec::new();
    let mut keep = |part: &Part| {
        kept.push(part.to_bytes());
        Ok(())
    };
    let solve = |begun, keep: &mut dyn FnMut(&Part) -> isolux::Result<()>| {
        let (part, _) = plan.solve_part(&tracer, Share::WHOLE, begun, keep, &()).expect("a part");
        join(vec![part]).expect("light").to_bytes()
    };
    let whole = solve(None, &mut keep);
    assert_eq!(kept.len(), 3);
    let begun = Part::from_bytes(&kept[0]).expect("a part");
    assert!(!begun.is_finished());
    let unfinished = join(vec![begun.clone()]).expect_err("most of it is missing").to_string();
    assert!(unfinished.contains("part 1/1 is not finished"), "{unfinished}");
    assert!(solve(Some(begun), &mut |_| Ok(())) == whole);

    // And by the program, which removes what it went on with.
    let folder = Folder::new();
    fs::write(folder.path("a.light.partial"), &kept[1]).expect("a file");
    let flags = ["--levels", "6", "--samples", "8", "--resume"];
    folder.solve("a.light", &flags).assert().success();
    let resumed = fs::read(folder.path("a.light")).expect("a file");
    folder.solve("whole.light", &flags[..4]).assert().success();
    assert!(resumed == fs::read(folder.path("whole.light")).expect("a file"));
    // The program adds the certificate.
    let mut resumed = Solution::from_bytes(&resumed).expect("light");
    assert!(resumed.figures.certificate.take().is_some());
    assert!(resumed.to_bytes() == whole);
    assert!(!folder.path("a.light.partial").exists());
    fs::write(folder.path("a.light.partial"), &kept[1]).expect("a file");
    for other in [["--seed", "2"], ["--kernel", "plane"]] {
        let said = refused(folder.solve("a.light", &[&flags[..], &other].concat()));
        assert!(said.contains("begun with another scene, other flags"), "{said}");
    }
    assert!(folder.path("a.light.partial").exists());
}

/// A folder for light, and what the program makes in it.
struct Folder(TempDir);

impl Folder {
    fn new() -> Folder {
        Folder(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn solve(&self, output: &str, flags: &[&str]) -> Command {
        let mut command = isolux();
        command.args(["solve", "scenes/cornell-box.toml", "--solver", "two-level"]);
        command.arg("-o").arg(self.path(output)).args(flags);
        command
    }

    fn join(&self, parts: &[&str], output: &str) -> Command {
        let mut command = isolux();
        command.arg("join").args(parts.iter().map(|part| self.path(part)));
        command.arg("-o").arg(self.path(output));
        command
    }
}

fn isolux() -> Command {
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

fn refused(mut command: Command) -> String {
    let output = command.assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(said.starts_with("error: ") && !said.contains("panicked"), "{said}");
    said
}

#[test]
fn parts_on_any_number_of_threads_join_to_the_bytes_of_one_run() {
    let folder = Folder::new();
    let flags = ["--levels", "5", "--samples", "8"];
    let with_threads = |threads: &'static str| [&flags[..], &["--threads", threads]].concat();
    folder.solve("one.light", &with_threads("1")).assert().success();
    let whole = fs::read(folder.path("one.light")).expect("a file");
    folder.solve("two.light", &with_threads("2")).assert().success();
    assert!(fs::read(folder.path("two.light")).expect("a file") == whole, "2 threads");
    for of in [1, 3, 7] {
        let mut names: Vec<String> = (1..=of).map(|k| format!("{of}-{k}.part")).collect();
        for (k, name) in (1..=of).zip(&names) {
            let threads = with_threads(if k % 2 == 0 { "2" } else { "1" });
            let part = format!("{k}/{of}");
            folder.solve(name, &[&threads[..], &["--part", &part]].concat()).assert().success();
        }
        names.reverse();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        folder.join(&names, "joined.light").assert().success();
        assert!(fs::read(folder.path("joined.light")).expect("a file") == whole, "{of} parts");
    }
    let picture = folder.path("a.png");
    let mut render = isolux();
    render.arg("render").arg(folder.path("joined.light")).arg("-o").arg(picture);
    render.args(["--size", "32x32"]).assert().success();
}

#[cfg(unix)]
#[test]
fn the_script_for_local_processes_makes_the_bytes_of_one_run() {
    let folder = Folder::new();
    let flags = ["--levels", "4", "--samples", "8"];
    folder.solve("one.light", &flags).assert().success();
    let program = assert_cmd::cargo::cargo_bin("isolux");
    let script = |parts: &str, scene: &str| {
        let mut command = Command::new("examples/solve-in-parts.sh");
        command.current_dir(env!("CARGO_MANIFEST_DIR")).env("ISOLUX", &program);
        command.arg(parts).arg(folder.path("parts.light")).arg(scene).args(flags);
        command
    };
    script("3", "scenes/cornell-box.toml").assert().success();
    let bytes = |name: &str| fs::read(folder.path(name)).expect("a file");
    assert!(bytes("parts.light") == bytes("one.light"));
    let left: Vec<_> = fs::read_dir(folder.0.path()).expect("a folder").collect();
    assert_eq!(left.len(), 2, "the parts are removed: {left:?}");
    script("2", "scenes/missing.toml").assert().code(1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_patch_takes_less_than_a_hundred_bytes() {
    let folder = Folder::new();
    let peak_and_patches = |levels: &str| {
        let stats = folder.path("stats.json");
        let mut command = folder.solve("a.light", &["--levels", levels, "--samples", "8"]);
        command.arg("--stats").arg(&stats).assert().success();
        let stats: serde_json::Value =
            serde_json::from_slice(&fs::read(&stats).expect("a file")).expect("JSON");
        ["peak_memory_bytes", "patches"].map(|key| stats[key].as_f64().expect("a number"))
    };
    let ([few_bytes, few], [many_bytes, many]) = (peak_and_patches("4"), peak_and_patches("7"));
    let bytes = (many_bytes - few_bytes) / (many - few);
    println!("{bytes:.1} bytes per patch");
    assert!(many > 600_000.0 && bytes < 100.0, "{bytes}");
}

#[test]
fn parts_that_do_not_belong_together_are_refused() {
    let folder = Folder::new();
    let make = |name: &str, part: &str, more: &[&str]| {
        let flags = [&["--levels", "3", "--samples", "8", "--part", part], more].concat();
        folder.solve(name, &flags).assert().success();
    };
    make("1.part", "1/3", &[]);
    make("2.part", "2/3", &[]);
    make("3.part", "3/3", &[]);
    make("again.part", "2/3", &[]);
    make("of-four.part", "2/4", &[]);
    make("seed.part", "2/3", &["--seed", "2"]);
    make("emit.part", "2/3", &["--emit", "lamp*=1"]);
    let says = |parts: &[&str], what: &[&str]| {
        let said = refused(folder.join(parts, "out.light"));
        assert!(what.iter().all(|what| said.contains(what)), "{said}");
        assert!(!folder.path("out.light").exists());
    };
    says(&["1.part", "3.part"], &["part 2/3 is missing", "--part 2/3"]);
    says(&["2.part"], &["2 of 3 parts are missing", "1/3"]);
    says(&["1.part", "2.part", "again.part", "3.part"], &["this is part 2/3, and so is", "once"]);
    says(&["1.part", "of-four.part", "3.part"], &["another number of parts", "of-four.part"]);
    says(&["1.part", "seed.part", "3.part"], &["another seed", "seed.part"]);
    says(&["1.part", "emit.part", "3.part"], &["another scene", "emit.part"]);
    says(&["missing.part"], &["missing.part", "read the part file"]);

    let good = fs::read(folder.path("2.part")).expect("a file");
    for at in [0, 5, 14, 18, 40, good.len() / 2, good.len() - 1] {
        let mut bad = good.clone();
        bad[at] ^= 4;
        fs::write(folder.path("bad.part"), bad).expect("a file");
        says(&["1.part", "bad.part", "3.part"], &["bad.part", "part file"]);
        fs::write(folder.path("bad.part"), &good[..at]).expect("a file");
        says(&["1.part", "bad.part", "3.part"], &["bad.part", "part file"]);
    }
    folder.join(&["3.part", "1.part", "2.part"], "out.light").assert().success();
}

#[test]
fn parts_that_cannot_be_made_are_refused() {
    let folder = Folder::new();
    let says = |output: &str, flags: &[&str], what: &str| {
        let said = refused(folder.solve(output, flags));
        assert!(said.contains(what), "{said}");
    };
    for bad in ["0/3", "4/3", "3", "a/b", "1/9999999", "1/0"] {
        says("a.part", &["--part", bad], "expected a part and their number");
    }
    says("a.light", &["--part", "1/2"], "ends in .part");
    says("a.part", &[], "ends in .light");
    says("a.light", &["--form-factors", "pairs"], "two levels");
    says("a.light", &["--points", "random"], "two levels");
    let mut together = isolux();
    together.args(["solve", "scenes/cornell-box.toml", "--levels", "1", "--part", "1/2", "-o"]);
    together.arg(folder.path("a.part"));
    let said = refused(together);
    assert!(said.contains("add --solver two-level"), "{said}");
    // More parts than there are blocks of patches: most are empty, and all are needed.
    let part = |k: u32| format!("{k}.part");
    for k in 1..=3 {
        let share = format!("{k}/3");
        let flags = ["--levels", "1", "--samples", "8", "--part", &share];
        folder.solve(&part(k), &flags).assert().success();
    }
    folder.join(&["1.part", "2.part", "3.part"], "a.light").assert().success();
    assert!(Path::new(&folder.path("a.light")).exists());
}

#[test]
fn a_part_knows_its_patches() {
    let (document, scene) = open("cornell-box.toml");
    let (tracer, settings) = (Tracer::build(&scene), settings(4, 8));
    let plan = Plan::new(&document, &scene, &settings).expect("a plan");
    let patches = |number| {
        let share = Share { number, of: 4 };
        let (part, _) =
            plan.solve_part(&tracer, share, None, &mut |_| Ok(()), &()).expect("a part");
        assert!(part.is_finished());
        part.patches()
    };
    let ranges: Vec<_> = (1..=4).map(patches).collect();
    let mesh = plan.patches(&tracer).expect("patches");
    assert_eq!((ranges[0].start, ranges[3].end), (0, mesh.len()));
    assert!(ranges.windows(2).all(|pair| pair[0].end == pair[1].start), "{ranges:?}");
    assert!(ranges.iter().all(|range| range.len() > 1000), "{ranges:?}");
}
