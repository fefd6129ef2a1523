//! Our own tracer is never wrong, whoever is asked about it.

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

#[test]
fn no_answer_of_ours_is_wrong_on_any_shipped_scene() {
    for scene in ["cornell-box", "course-room", "furnace", "two-rooms"] {
        let verdicts = verify(&format!("scenes/{scene}.toml"), &["--rays", "100000"]);
        let count = |what: &str| verdicts[what].as_u64().expect(what);
        assert_eq!(count("native_wrong") + count("both_wrong"), 0, "{scene}: {verdicts:#}");
        let named = ["agree", "tie", "touching", "precision", "embree_wrong"].map(count);
        assert_eq!(named.iter().sum::<u64>(), count("queries"), "{scene}: none is dropped");
        assert!(count("queries") >= 4 * 200_000, "{scene}");
        // Agreement of everyone about everything would mean that no nasty ray was asked.
        assert!(count("tie") > 0 && count("touching") > 0 && count("precision") > 0, "{scene}");
        if cfg!(feature = "embree") {
            assert!(
                verdicts["by_caster"]["Embree robust packets"]["agree"].as_u64() > Some(100_000)
            );
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
fn no_answer_of_ours_is_wrong_on_the_unruly_mesh() {
    for seed in ["1", "2", "3"] {
        let verdicts = verify("scenes/furnace.toml", &["--rays", "1000", "--seed", seed]);
        for name in ["native single", "native plane", "brute force", "brute force plane"] {
            let tally = &verdicts["unruly"][name];
            assert!(tally["queries"].as_u64() >= Some(20_000), "{name}: {tally}");
            assert_eq!((&tally["native_wrong"], &tally["both_wrong"]), (&0.into(), &0.into()));
        }
        let total = |what: &str| verdicts["unruly"]["brute force plane"][what].as_u64();
        assert!(
            total("tie") > Some(0) && total("touching") > Some(0) && total("precision") > Some(0)
        );
    }
}
