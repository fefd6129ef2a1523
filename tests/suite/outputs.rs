//! Outputs that are no plain files: descriptors that the program was given, pipes, links; and outputs that are one file.
#![cfg(target_os = "linux")]

use super::hostile::folder;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs `script` by the shell, where `$render` draws `s.obj` and needs an output.
fn shell(folder: &Path, script: &str) -> Output {
    let program = assert_cmd::cargo::cargo_bin("isolux");
    let render = format!("{} render s.obj --size 4x4 --spp 1 --levels 0", program.display());
    let mut command = Command::new("sh");
    command.args(["-c", script]).current_dir(folder).env("render", render);
    command.env("isolux", program).output().expect("it runs")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Whether the figures of a run are in a text, once and whole.
fn has_figures(text: &str) -> bool {
    let Some(begin) = text.find('{') else { return false };
    let mut values = serde_json::Deserializer::from_str(&text[begin..]).into_iter();
    let first: Option<Result<serde_json::Value, _>> = values.next();
    first.is_some_and(|value| value.is_ok()) && text.matches("\"triangles\"").count() == 1
}

#[test]
fn a_log_that_standard_output_is_appended_to_keeps_what_it_held() {
    for path in ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "/proc/thread-self/fd/1", "link"] {
        let folder = folder();
        fs::write(folder.path().join("log"), "before\n").expect("a file");
        std::os::unix::fs::symlink("/dev/stdout", folder.path().join("link")).expect("a link");
        let script = format!("$render -o a.png --stats {path} >>log && echo after >>log");
        let run = shell(folder.path(), &script);
        assert!(run.status.success(), "{path}: {}", text(&run.stderr));
        let log = fs::read_to_string(folder.path().join("log")).expect("a file");
        assert!(log.starts_with("before\n{") && log.ends_with("after\n"), "{path}: {log}");
        assert!(has_figures(&log) && log.contains("wrote"), "{path}: {log}");
        assert!(folder.path().join("link").is_symlink());
    }
}

#[test]
fn a_descriptor_is_written_to_where_it_stands() {
    let folder = folder();
    let script = "exec 7>log; echo first >&7; $render -o a.png --stats /dev/fd/7; echo last >&7";
    let run = shell(folder.path(), script);
    let log = fs::read_to_string(folder.path().join("log")).expect("a file");
    assert!(
        log.starts_with("first\n{") && log.ends_with("}\nlast\n"),
        "{}{log}",
        text(&run.stderr)
    );
    assert!(has_figures(&log), "{log}");
}

#[test]
fn a_pipe_and_a_named_pipe_get_the_bytes_and_stay() {
    let folder = folder();
    let run = shell(folder.path(), "$render -o a.png --stats /dev/stdout | cat");
    assert!(has_figures(&text(&run.stdout)), "{}", text(&run.stderr));
    let script = "mkfifo b.png && { timeout 60 cat b.png >copy &
                  timeout 60 $render -o b.png; code=$?; wait; exit $code; }";
    let run = shell(folder.path(), script);
    assert!(run.status.success(), "{}", text(&run.stderr));
    let picture = fs::read(folder.path().join("copy")).expect("a file");
    assert_eq!(picture, fs::read(folder.path().join("a.png")).expect("a file"));
    let kind = fs::metadata(folder.path().join("b.png")).expect("it is there").file_type();
    assert!(std::os::unix::fs::FileTypeExt::is_fifo(&kind));
    let run = shell(folder.path(), "timeout 60 $render -o b.png --preview 1s");
    assert!(text(&run.stderr).contains("--preview renews a file"), "{}", text(&run.stderr));
}

#[test]
fn descriptors_that_cannot_be_written_to_are_refused_before_anything_is_computed() {
    let folder = folder();
    for redirection in ["7<s.obj", "7>&-"] {
        let script = format!("$render -o a.png --stats /dev/fd/7 {redirection}");
        let run = shell(folder.path(), &script);
        let said = text(&run.stderr);
        assert_eq!(run.status.code(), Some(2), "{said}");
        assert!(said.contains("/dev/fd/7: the descriptor 7 cannot be written to"), "{said}");
        assert!(!folder.path().join("a.png").exists());
    }
    // The shell's own: its number means nothing here.
    let run = shell(folder.path(), "exec 7>log; $render -o a.png --stats /proc/$$/fd/7; true");
    assert!(text(&run.stderr).contains("that another process has open"), "{}", text(&run.stderr));
}

#[test]
fn a_link_to_nothing_is_created_through_and_so_is_what_is_kept() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    // What is done of the first view is kept while the second one is drawn.
    let views = "models = ['s.obj']\n[views.a]\nposition = [0.3, 0.3, 2]\nlook_at = [0.3, 0.3, 0]\n\
                 [views.b]\nposition = [0.3, 0.3, 3]\nlook_at = [0.3, 0.3, 0]\n";
    fs::write(at("s.toml"), views).expect("a file");
    for (link, target) in [("o-a.png", "real.png"), ("o-a.png.partial", "real.partial")] {
        std::os::unix::fs::symlink(target, at(link)).expect("a link");
    }
    let quick = "--size 4x4 --levels 0 --error 50%";
    let run = shell(folder.path(), &format!("$isolux render s.toml -o o.png --view a,b {quick}"));
    assert!(run.status.success(), "{}", text(&run.stderr));
    assert!(at("o-a.png").is_symlink() && at("real.png").is_file());
    assert!(at("o-a.png.partial").is_symlink() && !at("real.partial").exists());
}

#[test]
fn outputs_that_are_one_file_are_refused_before_anything_is_read() {
    let folder = folder();
    let run = |script: &str| {
        let run = shell(folder.path(), script);
        assert_eq!(run.status.code(), Some(2), "{script}");
        text(&run.stderr)
    };
    fs::write(folder.path().join("s.obj"), "no model").expect("a file");
    for script in [
        "$render -o a.png --stats a.png",
        "$render -o a.png --stats ./a.png",
        "$isolux solve s.obj -o a.light --stats a.light",
    ] {
        let said = run(script);
        assert!(said.contains("this output would overwrite another one, a."), "{script}: {said}");
        assert!(!said.contains("s.obj"), "{said}");
    }
}

#[test]
fn a_bench_that_would_overwrite_a_scene_is_refused_before_any_is_measured() {
    let folder = folder();
    fs::copy(folder.path().join("s.obj"), folder.path().join("t.obj")).expect("a file");
    // Some minutes of measuring.
    let measured = "--rays 100000000 --rounds 1000 --threads 1";
    let script = format!("timeout 20 \"$isolux\" bench s.obj t.obj --json t.obj {measured}");
    let run = shell(folder.path(), &script);
    let said = text(&run.stderr);
    assert!(run.status.code() == Some(2) && said.contains("would overwrite t.obj"), "{said}");
}

#[test]
fn two_outputs_into_one_pipe_are_refused_and_a_reader_that_has_gone_costs_no_picture() {
    let folder = folder();
    let run = shell(
        folder.path(),
        "ln -s /dev/stdout x.png; { $render -o x.png --stats /dev/stdout; echo $? >code; } | cat",
    );
    assert!(text(&run.stderr).contains("would overwrite another one"), "{}", text(&run.stderr));
    assert_eq!(fs::read_to_string(folder.path().join("code")).expect("a file"), "2\n");
    // The pipe's reader is gone before the program begins.
    let script = "mkfifo p; exec 3<>p 4>p 3<&-; rm p; $render -o a.png --stats /dev/fd/4";
    let run = shell(folder.path(), script);
    assert!(run.status.success(), "{}", text(&run.stderr));
    assert!(folder.path().join("a.png").is_file());
}

#[test]
fn what_a_solve_keeps_is_no_other_output_and_a_link_to_it_costs_nobody_a_file() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let quick = "--solver two-level --levels 1 --samples 8 2>&1";
    for (script, output) in [
        ("$isolux solve s.obj -o a.light --stats a.light.partial", "a.light"),
        ("ln -s b.light b.light.partial; $isolux solve s.obj -o b.light", "b.light"),
    ] {
        let run = shell(folder.path(), &format!("{script} {quick}"));
        assert_eq!(run.status.code(), Some(2), "{}", text(&run.stdout));
        assert!(text(&run.stdout).contains("would overwrite another one"), "{}", text(&run.stdout));
        assert!(!at(output).exists());
    }
    let script = "$isolux solve s.obj --part 1/1 -o kept.part QUICK && ln -s kept.part c.light.partial && \
                  $isolux solve s.obj --resume -o c.light QUICK";
    let run = shell(folder.path(), &script.replace("QUICK", quick));
    assert_eq!(run.status.code(), Some(2), "{}", text(&run.stdout));
    assert!(text(&run.stdout).contains("c.light.partial: this is a link"), "{}", text(&run.stdout));
    assert!(!at("c.light").exists() && at("kept.part").is_file());
}

/// Who shares a pipe may have told it not to wait for room.
#[test]
fn a_pipe_that_does_not_wait_gets_the_whole_picture() {
    use std::io::{Read, Write};
    let folder = folder();
    std::os::unix::fs::symlink("/dev/stdout", folder.path().join("x.hdr")).expect("a link");
    let (mut reader, mut writer) = std::io::pipe().expect("a pipe");
    rustix::io::ioctl_fionbio(&writer, true).expect("no waiting");
    // There is no room for another byte.
    let full = loop {
        if let Err(error) = writer.write_all(&[0]) {
            break error;
        }
    };
    assert_eq!(full.kind(), std::io::ErrorKind::WouldBlock);
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("isolux"))
        .args("render s.obj -o x.hdr --size 30x30 --spp 1 --levels 0".split(' '))
        .current_dir(folder.path())
        .stdout(writer)
        .spawn()
        .expect("it runs");
    std::thread::sleep(std::time::Duration::from_millis(1000));
    let mut got = Vec::new();
    reader.read_to_end(&mut got).expect("bytes");
    assert!(child.wait().expect("it ends").success());
    let got = String::from_utf8_lossy(&got);
    assert!(got.trim_start_matches('\0').starts_with("#?RADIANCE"), "a picture");
    assert!(got.trim_end().ends_with("x.hdr"), "and all that is said");
}
