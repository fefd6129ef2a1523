//! The program as a user runs it: what it writes, what it says, and how it refuses.

use assert_cmd::Command;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn isolux() -> Command {
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command
}

/// Arguments that make a small picture of a scene quickly.
const QUICK: [&str; 6] = ["--size", "32x24", "--spp", "4", "--levels", "2"];

/// A folder with a lit room in it: `room.obj`, `room.mtl`, `room.toml`.
struct Room(TempDir);

impl Room {
    fn new() -> Self {
        let room = Room(tempfile::tempdir().expect("a temporary folder"));
        room.write("room.mtl", "newmtl wall\nKd 0.5 0.5 0.5\nnewmtl lamp\nKd 0 0 0\nKe 5 5 5\n");
        room.write(
            "room.obj",
            "mtllib room.mtl\nv 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 1 3 1\nv 3 3 1\nv 3 3 3\nv 1 3 3\n\
             usemtl wall\nf 1 4 3 2\nusemtl lamp\nf 5 6 7 8\n",
        );
        room.write(
            "room.toml",
            "models = ['room.obj']\n[camera]\nposition = [2, 2, 9]\nlook_at = [2, 1, 0]\n",
        );
        room
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).expect("a file");
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(self.0.path())
            .expect("a folder")
            .map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"))
            .collect();
        names.sort();
        names
    }

    fn render(&self, scene: &str, more: &[&str]) -> Command {
        let mut command = isolux();
        command.arg("render").arg(self.path(scene)).arg("-o").arg(self.path("out.png"));
        command.args(QUICK).args(more);
        command
    }
}

/// Runs, expects exit code 2 and no panic, and returns what was said on standard error.
fn refused(command: &mut Command) -> String {
    let output = command.assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(said.lines().any(|line| line.starts_with("error: ")), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("a file")).expect("JSON")
}

#[test]
fn several_shadings_share_one_run_and_get_names_of_their_own() {
    let room = Room::new();
    room.render("room.toml", &["--shading", "flat,smooth"]).assert().success();
    assert_eq!(
        room.names(),
        ["out-flat.png", "out-smooth.png", "room.mtl", "room.obj", "room.toml"]
    );
    for name in ["out-flat.png", "out-smooth.png"] {
        let picture = image::open(room.path(name)).expect("a picture").into_rgb8();
        assert_eq!(picture.dimensions(), (32, 24));
        assert!(picture.pixels().any(|p| p.0 != [0; 3]), "{name} is not black");
    }
}

#[test]
fn a_run_says_little_and_nothing_on_standard_error() {
    let room = Room::new();
    let output = room.render("room.toml", &[]).assert().success().get_output().clone();
    assert_eq!(String::from_utf8(output.stderr).unwrap(), "");
    let said = String::from_utf8(output.stdout).unwrap();
    for word in ["peak memory", "M/s", "row sum", "reciprocity", "emitted", "absorbed", "escaped"] {
        assert!(said.contains(word), "no {word} in: {said}");
    }
    assert!(said.lines().count() <= 16, "{said}");
}

#[test]
fn every_format_is_written() {
    let room = Room::new();
    for ending in ["png", "exr", "hdr", "PNG"] {
        let file = room.path(&format!("picture.{ending}"));
        isolux()
            .arg("render")
            .arg(room.path("room.toml"))
            .arg("-o")
            .arg(&file)
            .args(QUICK)
            .assert()
            .success();
        assert_eq!(image::image_dimensions(&file).expect("a picture"), (32, 24), "{ending}");
    }
}

#[test]
fn statistics_have_what_programs_read() {
    let room = Room::new();
    let stats = room.path("stats.json");
    room.render("room.toml", &["--stats", stats.to_str().unwrap()]).assert().success();
    let stats = json(&stats);
    assert_eq!(stats["triangles"], 4);
    assert_eq!(stats["patches"], 64);
    assert!(stats["rays"].as_u64().unwrap() >= 32 * 24 * 4);
    assert!(stats["peak_memory_bytes"].as_u64().unwrap() > 1 << 20);
    let seconds: f64 = ["load", "build", "transport", "solve", "render"]
        .iter()
        .map(|stage| stats["seconds"][stage].as_f64().unwrap())
        .sum();
    let total = stats["seconds"]["total"].as_f64().unwrap();
    assert!(seconds > 0.0 && seconds <= total, "{seconds} of {total}");
    let residuals = stats["residuals"].as_array().unwrap();
    assert!(residuals.last().unwrap().as_f64().unwrap() <= 1e-4);
    assert!(stats["row_sum_defect"].is_f64() && stats["reciprocity_defect"].is_f64());
    for kind in ["emitted", "absorbed", "escaped"] {
        assert_eq!(stats["energy"][kind].as_array().unwrap().len(), 3);
    }
    // The lamp: 4 square units at exitance 5π.
    let emitted = stats["energy"]["emitted"][0].as_f64().unwrap();
    assert!((emitted - 20.0 * std::f64::consts::PI).abs() < 1e-4, "{emitted}");
}

#[test]
fn threads_do_not_change_a_byte() {
    let room = Room::new();
    for more in [
        &["--form-factors", "pairs"][..],
        &["--form-factors", "hemisphere", "--solver", "jacobi"],
        &["--form-factors", "pairs", "--solver", "southwell", "--tolerance", "1e-2"],
        &["--form-factors", "hemisphere", "--solver", "southwell"],
        &["--solver", "two-level"],
    ] {
        let picture = |threads: &str| {
            room.render("room.toml", more).args(["--threads", threads]).assert().success();
            fs::read(room.path("out.png")).expect("a picture")
        };
        let alone = picture("1");
        assert_eq!(alone, picture("2"), "{more:?}");
        assert_eq!(alone, picture("7"), "{more:?}");
        room.render("room.toml", more).args(["--seed", "2"]).assert().success();
        assert_ne!(alone, fs::read(room.path("out.png")).unwrap(), "the seed matters: {more:?}");
    }
}

#[test]
fn every_choice_of_method_draws_about_the_same_picture() {
    let room = Room::new();
    let mean = |more: &[&str]| {
        let file = room.path("mean.exr");
        let mut command = isolux();
        command.arg("render").arg(room.path("room.toml")).arg("-o").arg(&file).args(QUICK);
        command.args(["--samples", "1024"]).args(more);
        if !more.contains(&"--shading") {
            command.args(["--shading", "smooth"]);
        }
        command.assert().success();
        let picture = image::open(&file).expect("a picture").into_rgb32f();
        picture.pixels().map(|p| p.0[1] as f64).sum::<f64>() / (32.0 * 24.0)
    };
    let expected = mean(&[]);
    for more in [
        &["--kernel", "plane"][..],
        &["--solver", "jacobi"],
        &["--solver", "southwell"],
        &["--solver", "two-level"],
        &["--form-factors", "pairs"],
        &["--form-factors", "pairs", "--solver", "southwell"],
        &["--form-factors", "pairs", "--points", "random"],
        &["--form-factors", "pairs", "--points", "regular"],
        &["--direct", "0"],
        &["--shading", "flat"],
    ] {
        let found = mean(more);
        // 1024 samples of a 64-patch scene: every method is within 1 % of any other.
        assert!((found / expected - 1.0).abs() < 0.01, "{more:?}: {found} and {expected}");
    }
}

#[test]
fn a_bare_model_gets_a_camera_that_sees_it() {
    let room = Room::new();
    room.render("room.obj", &[]).assert().success();
    let picture = image::open(room.path("out.png")).expect("a picture").into_rgb8();
    let lit = picture.pixels().filter(|p| p.0 != [0; 3]).count();
    assert!(lit > 32 * 24 / 20, "{lit} pixels are lit");
}

#[test]
fn info_counts_what_is_there() {
    let output = isolux().args(["info", "scenes/course-room.toml"]).assert().success();
    let said = String::from_utf8(output.get_output().stdout.clone()).unwrap();
    for line in [
        "triangles   24 (0 degenerate left out, 0 duplicates)",
        "emitters    2 triangles",
        "objects     8",
    ] {
        assert!(said.contains(line), "no '{line}' in: {said}");
    }
    let output = isolux().args(["info", "scenes/furnace.obj"]).assert().success();
    let said = String::from_utf8(output.get_output().stdout.clone()).unwrap();
    assert!(said.contains("open edges  0 (closed)") && said.contains("6.000000 square"), "{said}");
}

#[test]
fn help_states_units_and_defaults() {
    let output = isolux().args(["render", "--help"]).assert().success();
    let said = String::from_utf8(output.get_output().stdout.clone()).unwrap();
    // Lines are broken where they fit.
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    for word in ["degrees", "pixels", "scene's units", "MiB", "[default: 1;", "moller-trumbore"] {
        assert!(said.contains(word), "no '{word}' in: {said}");
    }
}

#[test]
fn bad_arguments_are_refused() {
    let room = Room::new();
    for more in [
        &["--size", "0x0"][..],
        &["--size", "12"],
        &["--size", "99999999x99999999"],
        &["--size", "60000x60000"],
        &["--spp", "0"],
        &["--levels", "40"],
        &["--max-edge", "0"],
        &["--max-edge", "nan"],
        &["--max-edge", "1e-30"],
        &["--samples", "0"],
        &["--samples", "10", "--points", "regular"],
        &["--tolerance", "0"],
        &["--tolerance", "nan"],
        &["--tolerance", "1e-4", "--iterations", "5"],
        &["--exposure", "-1"],
        &["--crease", "inf"],
        &["--threads", "0"],
        &["--shading", "shiny"],
        &["--solver", "magic"],
        &["--form-factors", "pairs", "--levels", "9"],
        &["--memory", "0"],
        &["--frobnicate"],
    ] {
        // A flag given twice is its own error, so QUICK's are left out where they clash.
        let quick: Vec<&str> = QUICK
            .chunks(2)
            .filter(|flag| {
                let clashes = flag[0] == "--levels" && more[0] == "--max-edge";
                !clashes && !more.contains(&flag[0])
            })
            .flatten()
            .copied()
            .collect();
        let mut command = isolux();
        command.arg("render").arg(room.path("room.toml")).arg("-o").arg(room.path("out.png"));
        let said = refused(command.args(quick).args(more));
        assert!(!said.contains("cannot be used multiple times"), "{more:?}: {said}");
    }
    assert_eq!(room.names(), ["room.mtl", "room.obj", "room.toml"]);
}

#[test]
fn a_matrix_that_does_not_fit_names_the_remedy() {
    let room = Room::new();
    let said = refused(&mut {
        let mut command = room.render("room.toml", &["--form-factors", "pairs"]);
        command.args(["--memory", "0"]);
        command
    });
    for word in [
        "64 patches",
        "KiB",
        "--solver southwell",
        "--solver two-level",
        "--form-factors hemisphere",
    ] {
        assert!(said.contains(word), "no '{word}' in: {said}");
    }
    room.render("room.toml", &["--solver", "southwell", "--memory", "0"]).assert().success();
}

#[test]
fn bad_files_are_refused_with_their_place() {
    let room = Room::new();
    for (name, text, expected) in [
        ("missing.obj", None, "No such file"),
        ("two.obj", Some("v 0 0 0\nv 1 0 0\nf 1 2\n"), "two.obj: "),
        ("nan.obj", Some("v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n"), "nan.obj:2: "),
        ("inf.obj", Some("v 0 0 inf\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), "inf.obj:1: "),
        ("word.obj", Some("v 0 0 zero\n"), "word.obj:1: "),
        ("index.obj", Some("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n"), "index.obj:4: "),
        ("zero.obj", Some("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"), "zero.obj:4: "),
        ("empty.obj", Some(""), "empty.obj: "),
        ("flat.obj", Some("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "no triangle with an area"),
        ("dark.toml", Some("models = ['white.obj']\nsky = 0\n"), "the picture would be black"),
        ("rubbish.obj", Some("\0\u{1}\u{2}PNG\0\0\0"), "rubbish.obj: "),
        ("typo.toml", Some("models = ['room.obj']\nimages = 3\n"), "typo.toml:2: "),
        ("far.toml", Some("models = ['far/away.obj']\n"), "far/away.obj"),
        ("room.ply", Some("ply"), "room.ply: "),
    ] {
        room.write("white.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
        if let Some(text) = text {
            room.write(name, text);
        }
        let said = refused(&mut room.render(name, &[]));
        assert!(said.contains(expected) && said.contains("help: "), "{name}: {said}");
        let has_picture = room.names().iter().any(|file| file.starts_with("out"));
        assert!(!has_picture, "{name} left a picture behind");
    }
    let said = refused(isolux().arg("info").arg(room.0.path()));
    assert!(said.contains("help: "), "a folder: {said}");
}

#[test]
fn a_missing_material_is_a_warning_and_a_default() {
    let room = Room::new();
    let text = fs::read_to_string(room.path("room.obj")).unwrap();
    room.write("room.obj", &text.replace("usemtl wall", "usemtl wood"));
    let output = room.render("room.toml", &[]).assert().success().get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.starts_with("warning: ") && said.contains("room.obj:10: "), "{said}");
    assert!(said.contains("wood") && said.contains("0.5"), "{said}");
}

#[test]
fn materials_as_exporters_write_them_give_a_picture_with_one_warning_per_kind() {
    let room = Room::new();
    let text = fs::read_to_string(room.path("room.obj")).unwrap();
    let mtl = fs::read_to_string(room.path("room.mtl")).unwrap();
    let walls = [
        ("Kd 1 1 1", ""),
        ("Kd 2 1 0", "Kd above 1"),
        ("Kd 0 0 0\nKs 0.9 0.9 0.9", "mirrors and metals"),
        ("Kd 0 0 0\nmap_Kd none.png", "no such picture"),
        ("Kd 0.5\nd 0.5", "straight through"),
        ("Kd what", "Kd is malformed"),
    ];
    for (wall, warning) in walls {
        room.write("room.mtl", &mtl.replace("Kd 0.5 0.5 0.5", wall));
        let output = room.render("room.toml", &[]).assert().success().get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(said.matches("warning: ").count(), usize::from(!warning.is_empty()), "{said}");
        assert!(said.contains(warning), "{wall}: {said}");
    }
    room.write("room.mtl", &mtl);
    room.write("room.obj", &text.replace("usemtl wall", "usemtl"));
    room.render("room.toml", &[]).assert().success();
}

#[test]
fn a_texture_colours_the_picture_and_stays_in_the_light_file() {
    let room = Room::new();
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0]));
    picture.save(room.path("red.png")).expect("a picture");
    let mtl = fs::read_to_string(room.path("room.mtl")).unwrap();
    room.write("room.mtl", &mtl.replace("Kd 0.5 0.5 0.5", "Kd 0 0 0\nmap_Kd red.png"));
    let said = isolux().arg("info").arg(room.path("room.toml")).assert().success();
    assert_eq!(String::from_utf8(said.get_output().stderr.clone()).unwrap(), "");
    let mut solve = isolux();
    solve.arg("solve").arg(room.path("room.toml")).arg("-o").arg(room.path("room.light"));
    solve.assert().success();
    fs::remove_file(room.path("red.png")).expect("a file");
    let mut render = isolux();
    render.arg("render").arg(room.path("room.light")).arg("-o").arg(room.path("out.png"));
    render.args(["--size", "32x24", "--exposure", "1"]).assert().success();
    let drawn = image::open(room.path("out.png")).expect("a picture").into_rgb8();
    // The wall is red, the lamp white: nothing is green alone.
    assert!(drawn.pixels().any(|p| p.0[0] > 0 && p.0[1] == 0));
    assert!(drawn.pixels().all(|p| p.0[0] >= p.0[1]));
}

#[test]
fn outputs_that_cannot_be_written_are_refused_before_any_work() {
    let room = Room::new();
    for output in ["nowhere/out.png", ".", "out.jpg", "out"] {
        let mut command = isolux();
        command.arg("render").arg(room.path("room.toml")).arg("-o").arg(room.path(output));
        let said = refused(&mut command);
        assert!(said.contains("help: "), "{output}: {said}");
    }
    assert_eq!(room.names(), ["room.mtl", "room.obj", "room.toml"]);
}

#[test]
fn a_failed_run_leaves_the_old_picture() {
    let room = Room::new();
    room.write("out.png", "precious");
    room.write("dark.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    refused(&mut room.render("dark.obj", &["--sky", "0"]));
    assert_eq!(fs::read(room.path("out.png")).unwrap(), b"precious");
    // The last of the outputs meets a full disk: the first is not replaced either.
    if cfg!(target_os = "linux") {
        let said = refused(&mut room.render("room.toml", &["--stats", "/dev/full"]));
        assert!(said.contains("No space left"), "{said}");
        assert_eq!(fs::read(room.path("out.png")).unwrap(), b"precious");
    }
    assert!(room.names().iter().all(|name| !name.contains(".part")), "{:?}", room.names());
}

#[test]
fn a_description_overrides_materials_and_the_flags_override_the_description() {
    let room = Room::new();
    let text = fs::read_to_string(room.path("room.toml")).unwrap();
    room.write(
        "room.toml",
        &format!(
            "{text}[image]\nsize = [10, 8]\nsamples = 2\nexposure = 0.25\n[patches]\nlevels = 1\n\
             [materials.lamp]\nradiance = [1, 2, 3]\ntwo_sided = true\n"
        ),
    );
    let stats = room.path("stats.json");
    let mut command = isolux();
    command.arg("render").arg(room.path("room.toml")).arg("-o").arg(room.path("out.png"));
    command.arg("--stats").arg(&stats).assert().success();
    let read = json(&stats);
    // Two triangles one-sided and two two-sided, 4 patches a side; 4 units of lamp on two sides.
    assert_eq!(read["patches"], 24);
    assert_eq!(read["exposure"], 0.25);
    let emitted = read["energy"]["emitted"][2].as_f64().unwrap();
    assert!((emitted - 24.0 * std::f64::consts::PI).abs() < 1e-4, "{emitted}");
    assert_eq!(image::image_dimensions(room.path("out.png")).unwrap(), (10, 8));

    command.args(["--size", "6x4", "--levels", "2", "--exposure", "2"]).assert().success();
    let read = json(&stats);
    assert_eq!((&read["patches"], &read["exposure"]), (&96.into(), &2.0.into()));
    assert_eq!(image::image_dimensions(room.path("out.png")).unwrap(), (6, 4));
}

#[test]
fn no_output_overwrites_an_input_or_another_output() {
    let room = Room::new();
    for stats in ["room.toml", "room.obj", "out.png"] {
        let file = room.path(stats);
        let before = fs::read(&file).ok();
        let said = refused(&mut room.render("room.toml", &["--stats", file.to_str().unwrap()]));
        assert!(said.contains("would overwrite"), "{said}");
        assert_eq!(fs::read(&file).ok(), before);
    }
    room.render("room.toml", &["--shading", "flat,smooth,flat"]).assert().success();
    assert!(room.path("out-flat.png").exists() && room.path("out-smooth.png").exists());
}

#[cfg(unix)]
#[test]
fn a_name_that_is_no_unicode_is_written_all_the_same() {
    use std::os::unix::ffi::OsStrExt;
    let room = Room::new();
    let name = room.0.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9.png"));
    let mut command = isolux();
    command.arg("render").arg(room.path("room.toml")).arg("-o").arg(&name).args(QUICK);
    command.arg("--stats").arg(room.path("stats.json")).assert().success();
    assert!(name.exists() && room.path("stats.json").exists());
}

#[test]
fn a_room_far_from_the_origin_is_the_same_picture() {
    let room = Room::new();
    let text = fs::read_to_string(room.path("room.obj")).unwrap();
    let moved = text.lines().map(|line| match line.strip_prefix("v ") {
        Some(xyz) => {
            let xyz: Vec<f64> = xyz.split(' ').map(|x| x.parse().unwrap()).collect();
            format!("v {} {} {}\n", xyz[0] + 448_000.0, xyz[1], xyz[2] + 5_412_000.0)
        }
        None => format!("{line}\n"),
    });
    room.write("far.obj", &moved.collect::<String>());
    let far_camera = "[camera]\nposition = [448002, 2, 5412009]\nlook_at = [448002, 1, 5412000]\n";
    room.write("far.toml", &format!("models = ['far.obj']\n{far_camera}"));
    let picture = |scene: &str| {
        room.render(scene, &[]).assert().success();
        fs::read(room.path("out.png")).unwrap()
    };
    assert_eq!(picture("far.obj"), picture("room.obj"), "by a fitted camera");
    assert_eq!(picture("far.toml"), picture("room.toml"), "by one in the file's coordinates");
}

/// What the program says on standard error.
fn warned(command: &mut Command) -> String {
    String::from_utf8(command.assert().success().get_output().stderr.clone()).unwrap()
}

#[test]
fn a_model_that_does_not_shine_gets_a_sky_or_what_it_is_told() {
    let room = Room::new();
    let obj = fs::read_to_string(room.path("room.obj")).unwrap();
    room.write("bare.obj", &obj.replace("mtllib room.mtl\n", ""));
    let said = warned(&mut room.render("bare.obj", &[]));
    assert!(said.contains("sky of radiance 1") && said.contains("--emit 'lamp=10'"), "{said}");
    let silent = ["--sky", "1,2,3"];
    assert!(!warned(&mut room.render("bare.obj", &silent)).contains("sky of radiance"));
    assert!(!warned(&mut room.render("bare.obj", &["--emit", "la*=5"])).contains("sky"));
    let said = refused(&mut room.render("bare.obj", &["--emit", "lump=5"]));
    assert!(said.contains("no material has the name `lump`") && said.contains("lamp"), "{said}");
    let said = refused(&mut room.render("bare.obj", &["--emit", "lamp=-1"]));
    assert!(said.contains("at least 0"), "{said}");
    // The sky is in the solution, and what it is made of cannot be changed afterwards.
    room.solve("bare.obj", "bare.light", &[]).assert().success();
    room.show("bare.light", "out.png", &[]).assert().success();
    refused(&mut room.show("bare.light", "out.png", &["--sky", "2"]));
}

#[test]
fn one_sided_surfaces_have_patches_on_their_fronts_alone() {
    let room = Room::new();
    let said = |more: &[&str]| {
        let output = room.render("room.obj", more).assert().success().get_output().clone();
        String::from_utf8(output.stdout).unwrap()
    };
    // Four triangles with sixteen patches a side.
    assert!(said(&["--sky", "1"]).contains("4 triangles, 128 patches"));
    assert!(said(&["--sky", "1", "--one-sided"]).contains("4 triangles, 64 patches"));
}

#[test]
fn a_huge_or_tiny_room_looks_like_the_room() {
    let room = Room::new();
    let mean = |scale: f64, method: &str| {
        let obj: String = fs::read_to_string(room.path("room.obj"))
            .unwrap()
            .lines()
            .map(|line| match line.strip_prefix("v ") {
                Some(xyz) => {
                    let xyz = xyz.split(' ').map(|x| x.parse::<f64>().unwrap() * scale);
                    let words: Vec<String> = xyz.map(|x| format!("{x:e}")).collect();
                    format!("v {}\n", words.join(" "))
                }
                None => format!("{line}\n"),
            })
            .collect();
        room.write("scaled.obj", &obj);
        room.write(
            "scaled.toml",
            &format!(
                "models = ['scaled.obj']\n[camera]\nposition = [{}, {}, {}]\nlook_at = [{}, {}, 0]\n",
                2.0 * scale, 2.0 * scale, 9.0 * scale, 2.0 * scale, scale
            ),
        );
        let file = room.path("scaled.exr");
        let mut command = isolux();
        command.arg("render").arg(room.path("scaled.toml")).arg("-o").arg(&file).args(QUICK);
        command.args(["--form-factors", method]).assert().success();
        let picture = image::open(&file).expect("a picture").into_rgb32f();
        picture.pixels().map(|p| p.0[1] as f64).sum::<f64>()
    };
    for method in ["hemisphere", "pairs"] {
        let expected = mean(1.0, method);
        for scale in [2f64.powi(-28), 1e-3, 1e6, 2f64.powi(36)] {
            let found = mean(scale, method);
            // A scale by a power of two changes nothing but what exponents say; others round.
            assert!(
                (found / expected - 1.0).abs() < 0.02,
                "{method}, {scale:e}: {found}, {expected}"
            );
        }
    }
}

#[test]
fn a_closed_pipe_is_no_panic() {
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("isolux"))
        .args(["info", "scenes/two-rooms.toml"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the program starts");
    drop(child.stdout.take());
    let output = child.wait_with_output().expect("the program ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains("panicked"), "{said}");
}

impl Room {
    fn solve(&self, scene: &str, output: &str, more: &[&str]) -> Command {
        let mut command = isolux();
        command.arg("solve").arg(self.path(scene)).arg("-o").arg(self.path(output));
        command.args(["--levels", "2"]).args(more);
        command
    }

    /// A picture of solved light, without the options of light.
    fn show(&self, light: &str, output: &str, more: &[&str]) -> Command {
        let mut command = isolux();
        command.arg("render").arg(self.path(light)).arg("-o").arg(self.path(output));
        command.args(["--size", "32x24", "--spp", "4"]).args(more);
        command
    }
}

#[test]
fn solved_light_gives_the_bytes_of_the_whole_run() {
    let room = Room::new();
    room.render("room.toml", &["--shading", "flat,smooth", "--seed", "7"]).assert().success();
    let expected =
        ["out-flat.png", "out-smooth.png"].map(|name| fs::read(room.path(name)).unwrap());
    room.solve("room.toml", "room.light", &["--seed", "7"]).assert().success();
    // The light holds the scene and the seed: nothing else is read.
    for name in ["room.toml", "room.obj", "room.mtl"] {
        fs::remove_file(room.path(name)).unwrap();
    }
    room.show("room.light", "out.png", &["--shading", "flat,smooth"]).assert().success();
    let found = ["out-flat.png", "out-smooth.png"].map(|name| fs::read(room.path(name)).unwrap());
    assert!(found == expected);
}

#[test]
fn solving_twice_gives_the_same_bytes_whatever_the_threads() {
    let room = Room::new();
    room.solve("room.toml", "a.light", &["--threads", "1"]).assert().success();
    room.solve("room.toml", "b.light", &["--threads", "2"]).assert().success();
    let [a, b] = ["a.light", "b.light"].map(|name| fs::read(room.path(name)).unwrap());
    assert!(a == b);
    room.solve("room.toml", "c.light", &["--seed", "2"]).assert().success();
    assert!(a != fs::read(room.path("c.light")).unwrap());
}

#[test]
fn one_light_has_many_views() {
    let room = Room::new();
    room.solve("room.toml", "room.light", &[]).assert().success();
    room.show("room.light", "own.png", &[]).assert().success();
    let described = ["--position", "2,2,9", "--look-at", "2,1,0"];
    room.show("room.light", "described.png", &described).assert().success();
    let other = ["--position", "-5,2,2", "--look-at", "2,1,2", "--up", "0,1,0", "--fov", "60"];
    room.show("room.light", "other.png", &other).assert().success();
    let [own, described, other] =
        ["own.png", "described.png", "other.png"].map(|name| fs::read(room.path(name)).unwrap());
    assert!(own == described && own != other);
}

#[test]
fn light_that_is_damaged_foreign_or_solved_otherwise_is_refused() {
    let room = Room::new();
    room.solve("room.toml", "room.light", &[]).assert().success();
    let refused = |command: &mut Command| {
        let said = command.assert().code(2).get_output().stderr.clone();
        String::from_utf8(said).expect("UTF-8")
    };
    let good = fs::read(room.path("room.light")).unwrap();
    let mut damaged = good.clone();
    damaged[good.len() / 2] ^= 4;
    fs::write(room.path("damaged.light"), damaged).unwrap();
    fs::write(room.path("cut.light"), &good[..good.len() - 1]).unwrap();
    fs::copy(room.path("room.obj"), room.path("foreign.light")).unwrap();
    for (name, why) in
        [("damaged", "damaged"), ("cut", "cut short"), ("foreign", "not a light file")]
    {
        let name = format!("{name}.light");
        let said = refused(&mut room.show(&name, "out.png", &[]));
        assert!(said.contains(&name) && said.contains(why) && said.contains("help:"), "{said}");
    }
    let said = refused(&mut room.show("room.light", "out.png", &["--samples", "9"]));
    assert!(said.contains("solved already"), "{said}");
    let said = refused(&mut room.solve("room.toml", "room.png", &[]));
    assert!(said.contains(".light"), "{said}");
    let said = refused(&mut room.show("room.light", "out.png", &["--position", "0,0"]));
    assert!(said.contains("three numbers"), "{said}");
    assert!(!room.path("out.png").exists());
}

/// The room with two views beside its camera, and wishes for its light.
fn room_with_views() -> Room {
    let room = Room::new();
    let text = fs::read_to_string(room.path("room.toml")).unwrap()
        + "[views.left]\nposition = [-5, 2, 2]\nlook_at = [2, 1, 2]\n"
        + "[views.again]\nposition = [2, 2, 9]\nlook_at = [2, 1, 0]\n"
        + "[light]\nsamples = 64\nsolver = 'jacobi'\niterations = 3\n";
    room.write("room.toml", &text);
    room
}

#[test]
fn each_view_that_is_asked_for_has_a_picture() {
    let room = room_with_views();
    room.render("room.toml", &["--view", "left,again", "--shading", "flat,smooth"])
        .assert()
        .success();
    let read = |name: &str| fs::read(room.path(name)).expect(name);
    let left = ["out-left-flat.png", "out-left-smooth.png"].map(read);
    let again = ["out-again-flat.png", "out-again-smooth.png"].map(read);
    assert!(left[0] != again[0] && left[1] != again[1] && left[0] != left[1]);
    // From a .light as well; one view alone needs no name of its own.
    room.solve("room.toml", "room.light", &[]).assert().success();
    let exposure = ["--exposure", "0.5"];
    room.show("room.light", "one.png", &[&["--view", "left"][..], &exposure].concat())
        .assert()
        .success();
    room.show("room.light", "two.png", &[&["--view", "again"][..], &exposure].concat())
        .assert()
        .success();
    room.show("room.light", "own.png", &exposure).assert().success();
    assert!(read("two.png") == read("own.png") && read("one.png") != read("own.png"));
    let said = room.show("room.light", "no.png", &["--view", "right"]).assert().code(2);
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("right") && said.contains("again, left"), "{said}");
    room.show("room.light", "no.png", &["--view", "../x"]).assert().code(2);
}

#[test]
fn each_view_has_its_exposure_unless_one_is_asked_for() {
    let room = room_with_views();
    room.solve("room.toml", "room.light", &[]).assert().success();
    let stats = room.path("stats.json");
    let exposures = |more: &[&str]| {
        let more = [&["--view", "left,again", "--stats", stats.to_str().unwrap()], more].concat();
        room.show("room.light", "out.png", &more).assert().success();
        json(&stats)["exposures"].as_array().map(Vec::len)
    };
    assert_eq!(exposures(&[]), Some(2));
    assert_eq!(exposures(&["--exposure", "same"]), None);
    assert_eq!(exposures(&["--exposure", "2"]), None);
    assert!(
        refused(&mut room.show("room.light", "no.png", &["--exposure", "x"])).contains("`same`")
    );
}

#[test]
fn the_background_can_be_transparent() {
    let room = Room::new();
    let above = ["--position", "2,20,2", "--look-at", "2,0,2", "--up", "z"];
    let away = [&above[..], &["--background", "transparent"]].concat();
    room.render("room.toml", &away).assert().success();
    let picture = image::open(room.path("out.png")).expect("a picture");
    assert!(picture.color().has_alpha());
    let (picture, last) = (picture.to_rgba8(), |n: u32| n - 1);
    let (width, height) = picture.dimensions();
    assert_eq!(picture.get_pixel(0, 0).0, [0; 4]);
    assert_eq!(picture.get_pixel(last(width), last(height)).0[3], 0);
    assert_eq!(picture.get_pixel(width / 2, height / 2).0[3], 255);
    let mut hdr = isolux();
    hdr.arg("render").arg(room.path("room.toml")).arg("-o").arg(room.path("out.hdr")).args(&away);
    assert!(refused(&mut hdr).contains("transparency"));
}

#[test]
fn the_light_of_a_description_is_obeyed_and_flags_come_before_it() {
    let room = room_with_views();
    let iterations = |more: &[&str]| {
        let stats = room.path("stats.json");
        let more = [&["--stats", stats.to_str().unwrap()], more].concat();
        room.render("room.toml", &more).assert().success();
        let stats = json(&stats);
        (stats["iterations"].as_u64().unwrap(), stats["transport_rays"].as_u64().unwrap())
    };
    let (three, few_rays) = iterations(&[]);
    assert_eq!(three, 3);
    assert_eq!(iterations(&["--iterations", "5"]), (5, few_rays));
    let (until, rays) = iterations(&["--tolerance", "1e-6", "--samples", "256"]);
    assert!(until != 3 && rays > few_rays, "{until} iterations, {rays} rays");
}

#[test]
fn nothing_that_was_read_is_written_and_only_files_are_read() {
    let room = room_with_views();
    let mtl = fs::read(room.path("room.mtl")).unwrap();
    let path = |name: &str| room.path(name).to_str().unwrap().to_string();
    for command in [
        room.solve("room.toml", "room.light", &["--stats", &path("room.mtl")]),
        room.render("room.toml", &["--stats", &path("room.mtl")]),
    ] {
        let mut command = command;
        let said = command.assert().code(2).get_output().stderr.clone();
        assert!(String::from_utf8(said).unwrap().contains("would overwrite"));
    }
    assert!(mtl == fs::read(room.path("room.mtl")).unwrap());
    // A folder in the place of light.
    fs::create_dir(room.path("folder.light")).unwrap();
    room.show("folder.light", "no.png", &[]).assert().code(2);
    // A misspelt view is refused before anything is solved, and none beside a camera of flags.
    let said = room.render("room.toml", &["--view", "lfet"]).assert().code(2);
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("room.toml") && said.contains("again, left"), "{said}");
    room.render("room.toml", &["--view", "left", "--look-at", "1,2,3"]).assert().code(2);
    room.render("room.toml", &["--view", "left", "--fov", "40"]).assert().code(2);
}

#[cfg(target_os = "linux")]
#[test]
fn a_device_in_the_place_of_light_is_refused_at_once() {
    let room = Room::new();
    std::os::unix::fs::symlink("/dev/zero", room.path("zero.light")).unwrap();
    let said = room.show("zero.light", "no.png", &[]).assert().code(2);
    let said = String::from_utf8(said.get_output().stderr.clone()).unwrap();
    assert!(said.contains("not a regular file"), "{said}");
}

#[test]
fn info_says_what_a_light_file_holds() {
    let room = room_with_views();
    let info = |name: &str| {
        let said = isolux().arg("info").arg(room.path(name)).assert().success();
        String::from_utf8(said.get_output().stdout.clone()).unwrap()
    };
    room.solve("room.toml", "a.light", &[]).assert().success();
    let said = info("a.light");
    for part in ["64 patches", "64 rays per patch (sobol)", "jacobi, seed 1", "again, left"] {
        assert!(said.contains(part), "{part} is not in: {said}");
    }
    // The fingerprints tell another seed from another scene.
    let fingerprint = |said: &str| -> Vec<String> {
        let line = said.lines().find(|line| line.contains("fingerprint")).expect("a line");
        line.split_whitespace().filter(|word| word.len() == 8).map(String::from).collect()
    };
    let first = fingerprint(&said);
    room.solve("room.toml", "b.light", &["--seed", "2"]).assert().success();
    let second = fingerprint(&info("b.light"));
    assert!(first[0] == second[0] && first[1] != second[1], "{first:?} {second:?}");
    let text = fs::read_to_string(room.path("room.toml")).unwrap();
    fs::write(room.path("larger.toml"), format!("metres_per_unit = 2.0\n{text}")).unwrap();
    room.solve("larger.toml", "c.light", &[]).assert().success();
    let third = fingerprint(&info("c.light"));
    assert!(first[0] != third[0] && first[1] == third[1], "{first:?} {third:?}");
}
