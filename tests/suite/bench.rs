//! The bench measures what it says, and a forced instruction set changes nothing but the time.

use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

fn isolux(arguments: &[&str]) -> Command {
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(arguments);
    command
}

fn read(file: &Path) -> Vec<u8> {
    std::fs::read(file).expect("a file")
}

#[test]
fn the_bench_reports_every_kind_of_rays_and_all_native_engines_agree() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("rates.json");
    let json = file.to_str().expect("UTF-8");
    let few = ["--rays", "20000", "--rounds", "1", "--json", json];
    isolux(&[&["bench", "cornell", "room", "scenes/two-rooms.toml"][..], &few].concat())
        .assert()
        .success();
    let report: Value = serde_json::from_slice(&read(&file)).expect("JSON");
    let results = report["results"].as_array().expect("a list");
    assert_eq!(results.len(), 3 * 3 * 2, "scenes, kinds of rays, numbers of threads");
    for result in results {
        assert!(result["native"].as_f64() > Some(0.0), "{result:#}");
        assert_eq!(result["ratio"].is_number(), cfg!(feature = "embree"));
        let engines = result["engines"].as_array().expect("a list");
        assert_eq!(engines.len(), if cfg!(feature = "embree") { 8 } else { 2 });
        let hits = |engine: &Value| engine["hits"].as_f64().expect("a count");
        assert_eq!(hits(&engines[0]), hits(&engines[1]), "single and batched: {result:#}");
        for engine in engines {
            // Embree's default kernel loses a few at seams.
            assert!((hits(engine) - hits(&engines[0])).abs() < 1e-3 * 20_000.0, "{result:#}");
        }
    }
}

#[test]
fn every_instruction_set_draws_the_same_picture_and_an_unknown_one_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let draw = |name: Option<&str>| {
        let file = folder.path().join(format!("{}.exr", name.unwrap_or("best")));
        let path = file.to_str().expect("UTF-8");
        let mut command =
            isolux(&["render", "scenes/cornell-box.toml", "-o", path, "--size", "64x64"]);
        if let Some(name) = name {
            command.env("ISOLUX_SIMD", name);
        }
        let output = command.output().expect("the program runs");
        match output.status.code() {
            Some(0) => Ok(read(&file)),
            code => Err((code, String::from_utf8(output.stderr).expect("UTF-8"))),
        }
    };
    let best = draw(None).expect("a picture");
    assert_eq!(Ok(&best), draw(Some("portable")).as_ref());
    for name in ["avx2", "avx512"] {
        match draw(Some(name)) {
            Ok(picture) => assert_eq!(best, picture, "{name}"),
            Err((code, said)) => {
                assert_eq!(code, Some(2));
                assert!(said.contains("does not have"), "{said}");
            }
        }
    }
    let (code, said) = draw(Some("mmx")).expect_err("no such instruction set");
    assert_eq!(code, Some(2));
    assert!(said.contains("portable") && said.contains("mmx"), "{said}");
}

#[test]
fn no_answer_is_wrong_with_any_instruction_set() {
    for name in ["portable", "avx2", "avx512"] {
        let mut command = isolux(&["verify", "scenes/furnace.toml", "--rays", "20000"]);
        let output = command.env("ISOLUX_SIMD", name).output().expect("the program runs");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        let lacking = output.status.code() == Some(2) && said.contains("does not have");
        assert!(output.status.success() || lacking, "{name}: {said}");
    }
}

#[cfg(feature = "embree")]
#[test]
fn both_sides_race_with_the_instruction_set_that_is_asked_for_and_say_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("rates.json");
    let json = file.to_str().expect("UTF-8");
    let few = ["--rays", "1000", "--rounds", "1", "--threads", "1", "--json", json];
    isolux(&[&["bench", "cornell", "--embree-isa", "sse2"][..], &few].concat())
        .env("ISOLUX_SIMD", "portable")
        .assert()
        .success();
    let report: Value = serde_json::from_slice(&read(&file)).expect("JSON");
    assert_eq!(report["native"], "portable");
    assert!(report["oracle"].as_str().expect("a name").contains("(SSE2)"), "{report:#}");
}
