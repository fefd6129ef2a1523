//! Files and arguments that someone made to do harm, through the program.

use assert_cmd::Command;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A folder with `s.obj`, a triangle, and its lamp in `s.mtl`.
pub(super) fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    write("s.obj", "mtllib s.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
    write("s.mtl", "newmtl m\nKd .5 .5 .5\nKe 1 1 1\n");
    folder
}

fn isolux(folder: &TempDir, arguments: &[&str]) -> Command {
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(folder.path()).args(arguments);
    command
}

/// The exit code, and all that was said.
fn said(folder: &TempDir, arguments: &[&str]) -> (Option<i32>, String) {
    let output = isolux(folder, arguments).output().expect("it runs");
    let text = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(text).expect("UTF-8"))
}

#[test]
fn nothing_that_is_said_speaks_to_the_terminal() {
    const EVIL: &str = "\u{1b}]0;P\u{7}\u{202e}";
    let folder = folder();
    let write = |name: &str, text: &str| {
        fs::write(folder.path().join(name), text).expect("a file");
        name.to_string()
    };
    let model = "models=['s.obj']\n";
    let escape = r"\u001b]0;P\u0007";
    let files = [
        write("title.toml", &format!("title=\"a{escape}\\nerror: b\"\n{model}")),
        write("path.toml", &format!("models=[\"{escape}.obj\"]\n")),
        write("override.toml", &format!("{model}[materials.\"{escape}\"]\nradiance=[1,1,1]\n")),
        write("key.toml", &format!("{model}\"{escape}\"=1\n")),
        write("name.obj", &format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl {EVIL}\nf 1 2 3\n")),
        format!("{EVIL}.obj"),
        format!("{EVIL}\nerror: x.stl"),
    ];
    let out = format!("{EVIL}\nerror: x.png");
    let quick = ["--size", "4x4", "--spp", "1", "--levels", "0"];
    let mut runs: Vec<Vec<&str>> = files.iter().map(|file| vec!["info", file]).collect();
    runs.push([&["render", "s.obj", "-o", &out][..], &quick].concat());
    let size = format!("--size={EVIL}\nerror: x");
    runs.push(vec!["render", "s.obj", "-o", "a.png", &size]);
    runs.push(vec![&out]);
    for run in runs {
        let (_, text) = said(&folder, &run);
        let speaks = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
        assert!(!text.contains(speaks), "{run:?}: {text:?}");
        let forged = text.lines().filter(|line| line.starts_with("error: ")).count();
        assert!(forged <= 1 && !text.contains("\nerror: x"), "{run:?}: {text}");
        assert!(text.len() > 10, "{run:?}: {text}");
    }
    assert!(folder.path().join(&out).exists());
}

#[test]
fn long_names_and_many_materials_do_not_fill_the_screen() {
    let folder = folder();
    let many: String = (0..20_000).map(|i| format!("newmtl a{i}\n")).collect();
    let long = format!("newmtl {}\n", "n".repeat(70_000));
    fs::write(folder.path().join("s.mtl"), format!("newmtl m\nKe 1 1 1\n{long}{many}")).unwrap();
    let (code, text) = said(&folder, &["info", "s.obj"]);
    assert_eq!(code, Some(0));
    assert!(text.len() < 200_000 && text.contains("and 19002 more"), "{} bytes", text.len());

    let missing: String = (0..20_000).map(|i| format!("usemtl a{i}\nf 1 2 3\n")).collect();
    let model = format!("mtllib no.mtl\nmtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{missing}");
    fs::write(folder.path().join("missing.obj"), model).unwrap();
    let (_, text) = said(&folder, &["info", "missing.obj"]);
    let warnings: Vec<&str> = text.lines().filter(|line| line.starts_with("warning")).collect();
    assert!(warnings.len() < 8 && warnings.iter().all(|line| line.len() < 600), "{warnings:?}");
    assert!(warnings.iter().any(|line| line.contains("2 such files in all")), "{warnings:?}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_behind_standard_output_is_a_failure() {
    let folder = folder();
    let full = fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let program = assert_cmd::cargo::cargo_bin("isolux");
    let run = std::process::Command::new(program)
        .args(["info", "s.obj"])
        .current_dir(folder.path())
        .stdout(full)
        .output()
        .expect("it runs");
    assert_eq!(run.status.code(), Some(2));
    let text = String::from_utf8_lossy(&run.stderr);
    assert!(text.contains("error: cannot write to standard output"), "{text}");
}

#[test]
fn what_has_a_doubtful_meaning_is_said() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("bow.obj", "v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n");
    let (_, text) = said(&folder, &["info", "bow.obj"]);
    assert!(text.contains("bow.obj: the outlines of faces cross themselves"), "{text}");
    write("s.mtl", "Dear reader,\nthis is no material.\n");
    let (_, text) = said(&folder, &["info", "s.obj"]);
    assert!(text.contains("s.mtl:1: no `newmtl` in the file"), "{text}");
    write("bright.toml", "models=['s.obj']\n[materials.m]\nradiance=[3e38,1,1]\n");
    let (code, text) = said(&folder, &["info", "bright.toml"]);
    assert!(code == Some(2) && text.contains("radiance is outside [0, 1e12]"), "{text}");
    let output = isolux(&folder, &["info", "s.obj"]).env("RAYON_NUM_THREADS", "99999").output();
    let output = output.expect("it runs");
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && text.contains("RAYON_NUM_THREADS is"), "{text}");
}

#[cfg(unix)]
#[test]
fn no_name_of_an_input_is_taken_for_an_output() {
    let folder = folder();
    fs::hard_link(folder.path().join("s.mtl"), folder.path().join("out.png")).unwrap();
    let (code, text) = said(&folder, &["render", "s.obj", "-o", "out.png", "--size", "4x4"]);
    assert!(code == Some(2) && text.contains("would overwrite"), "{text}");
    assert!(fs::read_to_string(folder.path().join("s.mtl")).unwrap().starts_with("newmtl"));
    // Nor that of one that could not be understood.
    let texture = folder.path().join("t.png");
    fs::write(&texture, "no picture").unwrap();
    fs::write(folder.path().join("s.mtl"), "newmtl m\nKe 1 1 1\nmap_Kd t.png\n").unwrap();
    let (code, text) = said(&folder, &["render", "s.obj", "-o", "t.png", "--size", "4x4"]);
    assert!(code == Some(2) && text.contains("would overwrite"), "{text}");
    assert_eq!(fs::read(&texture).unwrap(), b"no picture");
}

#[cfg(target_os = "linux")]
#[test]
fn what_the_kernel_makes_up_is_no_model() {
    let folder = folder();
    let link = folder.path().join("k.obj");
    std::os::unix::fs::symlink("/proc/kmsg", &link).unwrap();
    let mtl = "mtllib /proc/kmsg\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::write(folder.path().join("m.obj"), mtl).unwrap();
    let run = |file: &str| {
        let mut command = isolux(&folder, &["info", file]);
        let output = command.timeout(std::time::Duration::from_secs(20)).output().expect("it ends");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    for file in ["k.obj", "m.obj"] {
        let text = run(file);
        assert!(text.contains("it is not a regular file"), "{file}: {text}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_limit_of_the_address_space_is_memory_that_there_is() {
    let folder = folder();
    let program = assert_cmd::cargo::cargo_bin("isolux");
    let command = format!(
        "ulimit -c 0; ulimit -v 600000; {} render s.obj -o o.png --size 8000x8000 --threads 1",
        program.display()
    );
    let shell = std::process::Command::new("sh")
        .args(["-c", &command])
        .current_dir(folder.path())
        .output()
        .expect("it runs");
    let text = String::from_utf8_lossy(&shell.stderr);
    assert!(shell.status.code() == Some(2) && text.contains("8000x8000 pixels needs"), "{text}");
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<PathBuf> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into()).collect();
    names.sort();
    names
}

#[cfg(target_os = "linux")]
#[test]
fn a_run_that_is_killed_leaves_nothing() {
    let folder = folder();
    let before = names(folder.path());
    let program = assert_cmd::cargo::cargo_bin("isolux");
    for wait in [30, 100, 300] {
        let arguments = ["render", "s.obj", "-o", "o.exr", "--size", "900x900", "--spp", "256"];
        let mut run = std::process::Command::new(&program)
            .args(arguments)
            .current_dir(folder.path())
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("it runs");
        std::thread::sleep(std::time::Duration::from_millis(wait));
        run.kill().expect("it runs still");
        run.wait().expect("it ends");
        assert_eq!(names(folder.path()), before, "after {wait} ms");
    }
}

#[test]
fn an_interrupted_picture_shows_what_there_is() {
    let folder = folder();
    let scene = format!("{}/scenes/cornell-box.toml", env!("CARGO_MANIFEST_DIR"));
    // An hour's work, if nobody interrupts it.
    let picture = ["--levels", "0", "--size", "320x240", "--time", "3600s", "--preview", "0.1s"];
    let arguments = [&["render", &scene, "-o", "a.png"][..], &picture].concat();
    let program = assert_cmd::cargo::cargo_bin("isolux");
    let mut command = std::process::Command::new(program);
    let pipe = std::process::Stdio::piped;
    let command = command.current_dir(folder.path()).args(arguments).stdout(pipe()).stderr(pipe());
    let mut child = command.spawn().expect("it runs");
    // A preview shows that each pixel has samples.
    let [shown, kept] = ["a.png", "a.png.partial"].map(|name| folder.path().join(name));
    let began = std::time::Instant::now();
    while !shown.exists() {
        if began.elapsed().as_secs() >= 120 {
            let _ = child.kill();
            panic!("no preview");
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    // A script that goes on beside the tests lets them ignore Ctrl-C, and the program then does so too.
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    let is_ignored = ignored.is_some_and(|mask| mask >> 1 & 1 == 1);
    let (signal, code) = if is_ignored { ("-TERM", 143) } else { ("-INT", 130) };
    let kill = [signal, &child.id().to_string()].map(str::to_string);
    assert!(std::process::Command::new("kill").args(kill).status().expect("it runs").success());
    let output = child.wait_with_output().expect("it ends");
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(said.contains("interrupted"), "{said}");
    let written =
        |path: &Path| fs::metadata(path).and_then(|file| file.modified()).expect("a file");
    assert!(written(&shown) >= written(&kept), "the picture is written after what is kept");
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(said.contains("a.png"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn what_is_no_text_is_not_read_whole() {
    let folder = folder();
    for name in ["big.obj", "big.toml", "big.light"] {
        let file = fs::File::create(folder.path().join(name)).expect("a file");
        // It takes no place on the disk, and does not fit into memory.
        file.set_len(1 << 40).expect("a hole");
        let command = ["render", name, "-o", "a.png"];
        let output = isolux(&folder, &command).timeout(std::time::Duration::from_secs(20)).output();
        let output = output.expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {said}");
        assert!(
            said.contains("this does not look like") || said.contains("this is not a"),
            "{said}"
        );
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_beside_the_model_that_memory_is_short_for_is_an_error_and_no_warning() {
    let folder = folder();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n";
    write("library.obj", &format!("mtllib big.mtl\n{triangle}"));
    for map in ["map_Kd", "map_Ke", "map_d"] {
        write(&format!("{map}.obj"), &format!("mtllib {map}.mtl\n{triangle}"));
        write(&format!("{map}.mtl"), &format!("newmtl m\n{map} big.png\n"));
    }
    let ply = "ply\nformat ascii 1.0\ncomment TextureFile big.png\nelement vertex 3\nproperty float x\n\
               property float y\nproperty float z\nproperty float u\nproperty float v\nelement face 1\n\
               property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
    write("a.ply", ply);
    // Three corners, and no coordinates of a texture.
    let corners = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    let gltf = |buffer: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"material":0}}]}}],
            "materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
            "textures":[{{"source":0}}],"images":[{{"uri":"big.png"}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}}],
            "bufferViews":[{{"buffer":0,"byteLength":36}}],"buffers":[{{"byteLength":36,"uri":"{buffer}"}}]}}"#
        )
    };
    write("image.gltf", &gltf(&format!("data:application/octet-stream;base64,{corners}")));
    write("buffer.gltf", &gltf("big.bin"));
    write("big.mtl", &"# a comment\n".repeat(1000));
    write("big.png", "");
    write("big.bin", "");
    let models = [
        "library.obj",
        "map_Kd.obj",
        "map_Ke.obj",
        "map_d.obj",
        "a.ply",
        "image.gltf",
        "buffer.gltf",
    ];
    for model in models {
        let files = ["big.mtl", "big.png", "big.bin"].map(|name| folder.path().join(name));
        for file in &files {
            let file = fs::File::options().write(true).open(file).expect("it is there");
            // Most of it is a hole, which takes no place on the disk.
            file.set_len(1 << 40).expect("a hole");
        }
        let (code, text) = said(&folder, &["info", model]);
        assert_eq!(code, Some(2), "{model}: {text}");
        assert!(text.contains("big.") && text.contains("needs 1.00 TiB, and "), "{model}: {text}");
        assert!(text.contains("help: use a smaller file, or a machine with"), "{model}: {text}");
        assert!(!text.contains("flags:") && !text.contains("warning"), "{model}: {text}");
    }
    // What is not there is as it was.
    fs::remove_file(folder.path().join("big.mtl")).expect("it is there");
    let (code, text) = said(&folder, &["info", "library.obj"]);
    assert!(code == Some(0) && text.contains("warning"), "{text}");
}

/// A white room, into which the sky shines by a small hole. Without it nothing lights the walls, and they have no light
/// to gather.
const WHITE_ROOM: &str = "mtllib w.mtl\nusemtl w\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    v 0.475 0.475 1\nv 0.525 0.475 1\nv 0.525 0.525 1\nv 0.475 0.525 1\nf 1 2 3 4\nf 5 1 4 8\nf 2 6 7 3\nf 1 5 6 2\n\
    f 4 3 7 8\nf 5 6 10 9\nf 6 7 11 10\nf 7 8 12 11\nf 8 5 9 12\n";

#[test]
fn paths_end_where_all_light_is_reflected() {
    let folder = folder();
    fs::write(folder.path().join("w.mtl"), "newmtl w\nKd 1 1 1\n").expect("a file");
    fs::write(folder.path().join("w.obj"), WHITE_ROOM).expect("a file");
    let inside = ["--position", "0.4,0.3,0.6", "--look-at", "1,0.3,0.2", "--size", "8x8"];
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    let run = command
        .current_dir(folder.path())
        .args(["render", "w.obj", "-o", "w.png", "--shading", "path,gather", "--levels", "0"])
        .args(inside)
        .timeout(std::time::Duration::from_secs(20));
    run.assert().success();
}
