//! Our own tracer is never wrong, whichever peer it is held against.

use assert_cmd::Command;
use serde_json::Value;

fn verify(scene: &str, arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("verdicts.json");
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(env!("CARGO_MANIFEST_DIR"));
    command.args(["verify", scene, "--json"]).arg(&file).args(arguments).assert().success();
    serde_json::from_slice(&std::fs::read(file).expect("a file")).expect("JSON")
}

/// Every shipped scene: descriptions, and the model that is one by itself.
fn shipped_scenes() -> Vec<String> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes");
    let files = std::fs::read_dir(folder).expect("the scenes");
    let names = files.map(|file| file.expect("a file").file_name().into_string().expect("UTF-8"));
    let is_scene = |name: &String| name.ends_with(".toml") || name.ends_with(".gltf");
    let mut scenes: Vec<_> = names.filter(is_scene).map(|name| format!("scenes/{name}")).collect();
    scenes.sort();
    scenes
}

#[test]
fn no_answer_of_ours_is_wrong_on_any_shipped_scene() {
    let mut told_apart = [0; 3];
    for scene in shipped_scenes() {
        let rays = if scene.contains("cornell") { 100_000 } else { 20_000 };
        let verdicts = verify(&scene, &["--rays", &rays.to_string()]);
        let count = |what: &str| verdicts[what].as_u64().expect(what);
        assert_eq!(count("native_wrong") + count("both_wrong"), 0, "{scene}: {verdicts:#}");
        let named = ["agree", "tie", "touching", "precision", "peer_wrong"].map(count);
        assert_eq!(named.iter().sum::<u64>(), count("queries"), "{scene}: none is dropped");
        // Two native peers are asked about every scene, and Embree in four ways.
        let peers = if cfg!(feature = "embree") { 6 } else { 2 };
        assert!(count("queries") >= peers * 2 * rays, "{scene}");
        for (sum, what) in told_apart.iter_mut().zip(["tie", "touching", "precision"]) {
            *sum += count(what);
        }
        if cfg!(feature = "embree") {
            assert!(verdicts["by_caster"]["Embree robust packets"]["agree"].as_u64() > Some(rays));
        }
    }
    // Agreement about everything would mean that no adversarial ray was asked. Without Embree the native
    // kernels may agree about one scene, but not about all.
    assert!(told_apart.iter().all(|&sum| sum > 0), "ties, touching, precision: {told_apart:?}");
}

/// One machine stands for many: Embree is forced to each instruction set that the processor has.
#[cfg(feature = "embree")]
#[test]
fn no_answer_of_ours_is_wrong_whichever_instruction_set_embree_traces_with() {
    for isa in isolux::oracle::Device::available_isas() {
        let name = isa.config().trim_start_matches("isa=");
        for scene in ["cornell-box", "furnace"] {
            let path = format!("scenes/{scene}.toml");
            let verdicts = verify(&path, &["--rays", "50000", "--embree-isa", name]);
            let oracle = verdicts["oracle"].as_str().expect("a name");
            assert!(oracle.starts_with("Embree 4.") && oracle.contains(&format!("({isa})")));
            let count = |what: &str| verdicts[what].as_u64().expect(what);
            assert_eq!(count("native_wrong") + count("both_wrong"), 0, "{oracle}: {verdicts:#}");
            let asked = &verdicts["by_caster"]["Embree robust packets"];
            assert!(asked["agree"].as_u64() > Some(50_000), "{oracle}: {asked}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_verdicts() {
    let ask = |seed: &str| verify("scenes/furnace.toml", &["--rays", "5000", "--seed", seed]);
    assert_eq!(ask("7"), ask("7"));
    assert_ne!(ask("7"), ask("8"));
}

#[test]
fn a_bare_model_can_be_verified() {
    let verdicts = verify("scenes/cornell-box.obj", &["--rays", "2000"]);
    assert_eq!(verdicts["native_wrong"], 0);
}

#[test]
fn no_ray_leaves_a_closed_mesh_through_its_seams() {
    let verdicts = verify("scenes/furnace.toml", &["--rays", "400000"]);
    let leaks = verdicts["leaks"].as_array().expect("a list");
    let ours: Vec<&Value> = leaks
        .iter()
        .filter(|leak| !leak["caster"].as_str().expect("a name").starts_with("Embree"))
        .collect();
    assert_eq!(
        ours.len(),
        5,
        "two hierarchies, one of them asked in two ways, and brute force twice"
    );
    for leak in ours {
        assert_eq!((&leak["rays"], &leak["escaped"]), (&100_000.into(), &0.into()), "{leak}");
    }
}

#[test]
fn the_whole_pipeline_is_compared_and_its_differences_are_drawn() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let picture = folder.path().join("differences.png");
    let path = picture.to_str().expect("UTF-8");
    let verdicts = verify("scenes/furnace.toml", &["--rays", "2000", "--diff-image", path]);
    let pipeline = &verdicts["pipeline"];
    let peer = if cfg!(feature = "embree") { "Embree robust packets" } else { "native plane" };
    assert_eq!(pipeline["peer"], peer);
    for stage in ["form_factors", "direct_light", "coverage", "flat", "smooth"] {
        let causes = pipeline[stage]["causes"].as_object().expect("an object");
        assert!(!causes.contains_key("unexplained") && !causes.contains_key("native_wrong"));
        let sum: u64 = causes.values().map(|count| count.as_u64().expect("a count")).sum();
        assert_eq!(Some(sum), pipeline[stage]["differing"].as_u64(), "{stage}: {pipeline:#}");
    }
    assert_eq!(pipeline["radiosity"]["unexplained"], 0);
    assert_eq!(pipeline["smooth"]["total"], 128 * 128);
    let size = image::image_dimensions(&picture).expect("a picture");
    assert_eq!(size, (128, 128));
}

#[test]
fn a_picture_of_differences_overwrites_nothing_and_has_a_format() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let refuse = |arguments: &[&str]| {
        let mut command = Command::cargo_bin("isolux").expect("the program is built");
        command.current_dir(folder.path()).arg("verify").args(arguments);
        let said = command.assert().code(2).get_output().stderr.clone();
        String::from_utf8(said).expect("UTF-8")
    };
    std::fs::write(folder.path().join("a.obj"), "v 0 0 0").expect("a file");
    assert!(refuse(&["a.obj", "--diff-image", "a.jpg"]).contains("no picture format"));
    assert!(refuse(&["a.obj", "--diff-image", "missing/b.png"]).contains("does not exist"));
    for outputs in
        [["--json", "a.obj", "--diff-image", "b.png"], ["--json", "b.png", "--diff-image", "b.png"]]
    {
        let said = refuse(&[&["a.obj"][..], &outputs].concat());
        assert!(said.contains("would overwrite"), "{said}");
    }
    assert_eq!(std::fs::read(folder.path().join("a.obj")).expect("a file"), b"v 0 0 0");
    assert!(!folder.path().join("b.png").exists());
}

#[test]
fn our_answers_on_the_integer_grid_are_exact_to_the_bit() {
    let verdicts = verify("scenes/furnace.toml", &["--rays", "1000"]);
    let grid = verdicts["grid"].as_array().expect("a list");
    let find = |name: &str| {
        let is_it = |finding: &&Value| finding["caster"] == name;
        grid.iter().find(is_it).unwrap_or_else(|| panic!("{name} was not asked"))
    };
    for name in ["native", "native single", "brute force"] {
        // 10,000 rays, asked for the nearest and for any hit.
        assert_eq!(
            (&find(name)["queries"], &find(name)["exact"]),
            (&20_000.into(), &20_000.into())
        );
    }
    for name in ["native plane", "brute force plane"] {
        assert_eq!(find(name)["wrong"], 0, "{name}");
        assert!(find(name)["exact"].as_u64() >= Some(10_000), "half of the rays are exact for it");
    }
}

#[test]
fn no_answer_of_ours_is_wrong_on_the_stress_mesh() {
    for seed in ["1", "2", "3"] {
        let verdicts = verify("scenes/furnace.toml", &["--rays", "1000", "--seed", seed]);
        for name in ["native single", "native plane", "brute force", "brute force plane"] {
            let tally = &verdicts["stress_mesh"][name];
            assert!(tally["queries"].as_u64() >= Some(20_000), "{name}: {tally}");
            assert_eq!((&tally["native_wrong"], &tally["both_wrong"]), (&0.into(), &0.into()));
        }
        let total = |what: &str| verdicts["stress_mesh"]["brute force plane"][what].as_u64();
        assert!(
            total("tie") > Some(0) && total("touching") > Some(0) && total("precision") > Some(0)
        );
    }
}
