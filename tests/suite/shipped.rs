//! The shipped scenes whose answers are known: a texture, colours of vertices, a cut-out, glass, instances.

use crate::scenes::{Measured, all};
use assert_cmd::Command;
use glam::{DVec3, Vec3};
use isolux::color::{Rgb, srgb_decode};
use isolux::patches::{PatchId, PatchMesh, Subdivision};
use isolux::scene::{Material, Scene};
use isolux::settings::{PatchSettings, Settings};
use isolux::{Document, Solution, Tracer};
use std::collections::BTreeSet;
use std::f64::consts::PI;

fn open(file: &str) -> (Document, Scene) {
    let path = format!("{}/scenes/{file}", env!("CARGO_MANIFEST_DIR"));
    let document = Document::open(path).expect("a description");
    let scene = document.scene().expect("a scene");
    (document, scene)
}

fn material_of(mesh: &PatchMesh, patch: PatchId) -> &str {
    &mesh.scene.materials[mesh.side(patch).material.0 as usize].name
}

/// The mean reflectance of some of a mesh's patches, each with the weight of its area.
fn mean_reflectance(mesh: &PatchMesh, chosen: impl Fn(PatchId) -> bool) -> DVec3 {
    let (mut sum, mut area) = (DVec3::ZERO, 0.0);
    for patch in all(mesh).filter(|&patch| chosen(patch)) {
        sum += mesh.area(patch) * mesh.reflectance(patch).as_dvec3();
        area += mesh.area(patch);
    }
    sum / area
}

/// The scene without reflection, its materials changed by `change`: only light straight from the lamp or the
/// sky arrives.
fn black(scene: &Scene, change: impl Fn(&mut Material)) -> Scene {
    let mut materials = scene.materials.to_vec();
    materials.iter_mut().for_each(|material| material.reflectance = Rgb::ZERO);
    materials.iter_mut().for_each(change);
    Scene { materials: materials.into(), ..scene.clone() }
}

/// The patches and their irradiance.
fn light(document: &Document, scene: &Scene, levels: u32, seed: u64) -> Solution {
    let patches = PatchSettings { levels: Some(levels), max_edge: None };
    let settings = Settings { patches, seed, ..Settings::default() };
    Solution::solve(document, scene, &Tracer::build(scene), &settings, &()).expect("light")
}

#[test]
fn the_floor_reflects_the_mean_of_the_checkerboard() {
    let (_, scene) = open("checkerboard.toml");
    let linear = |rgb: [u8; 3]| DVec3::from(rgb.map(|c| srgb_decode(f32::from(c) / 255.0).into()));
    // Seven by seven tiles, light ones in the corners.
    let expected = (25.0 * linear([238, 228, 206]) + 24.0 * linear([52, 78, 84])) / 49.0;
    for levels in [0, 3, 5] {
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(levels)).expect("patches");
        let found = mean_reflectance(&mesh, |patch| material_of(&mesh, patch) == "tiles");
        // The reflectances are f32; their weights are exact.
        let error = (found / expected - 1.0).abs().max_element();
        assert!(error < f32::EPSILON.into(), "{levels} levels: {found} and {expected}");
    }
}

#[test]
fn the_faces_of_the_colour_cube_reflect_the_means_of_their_corners() {
    let (_, scene) = open("colour-cube.toml");
    let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(3)).expect("patches");
    // The cube is the first model, the studio the second.
    let face_of = |patch: PatchId| {
        let triangle = mesh.side(patch).triangle;
        let model = scene.mesh.part_of(triangle).expect("a part").model;
        (model == 0).then_some(scene.mesh.origins[triangle.index()].face)
    };
    // Red 1 and 0, green 1 and 0, blue 1 and 0; the other channels run from 0 to 1.
    for (face, channel, value) in
        [(1, 0, 1.0), (2, 0, 0.0), (3, 1, 1.0), (4, 1, 0.0), (5, 2, 1.0), (6, 2, 0.0)]
    {
        let mut expected = DVec3::splat(0.5);
        expected[channel] = value;
        let found = mean_reflectance(&mesh, |patch| face_of(patch) == Some(face));
        // The file has the corners to 6 digits, so that the triangles of a face differ in area by less than
        // 4e-6 of it.
        assert!((found - expected).abs().max_element() < 4e-6, "face {face}: {found}");
    }
    let cube = mean_reflectance(&mesh, |patch| face_of(patch).is_some());
    assert!((cube - 0.5).abs().max_element() < 4e-6, "{cube}");
}

#[test]
fn half_of_the_light_that_reaches_the_screen_passes_it() {
    let (document, scene) = open("pierced-screen.toml");
    let pierced = black(&scene, |_| ());
    let taken_away = black(&scene, |material| {
        if material.name == "screen" {
            (material.opacity, material.opacity_map) = (0.0, None);
        }
    });
    let below = |scene: &Scene, seed| {
        let light = light(&document, scene, 3, seed);
        let mesh = light.patches();
        let power = |patch: PatchId| mesh.area(patch) * light.irradiance()[patch.index()].y as f64;
        let room = |patch: &PatchId| !["screen", "lamp"].contains(&material_of(&mesh, *patch));
        all(&mesh).filter(room).map(power).sum::<f64>()
    };
    let shares: Vec<f64> =
        (1..=8).map(|seed| below(&pierced, seed) / below(&taken_away, seed)).collect();
    let share = Measured::from_repetitions(&shares);
    println!("through the screen: {share:?}");
    assert!(share.standard_error < 2e-3, "{shares:?}");
    // Once in some fifty thousand sets of seeds it is farther away, by Student's t with 7 degrees of freedom.
    assert!(share.errors_from(0.5).abs() < 10.0, "{share:?} {shares:?}");
}

#[test]
fn three_quarters_of_the_light_pass_the_panes_of_the_greenhouse() {
    let (document, scene) = open("greenhouse.toml");
    let glass = scene.materials.iter().find(|material| material.name == "glass").expect("glass");
    let share = f64::from(1.0 - glass.opacity);
    assert_eq!(share, 0.75);
    let bare = black(&scene, |material| {
        if ["clay", "leaves"].contains(&&*material.name) {
            material.opacity = 0.0;
        }
    });
    let light = light(&document, &bare, 4, 1);
    let mesh = light.patches();
    let soil: Vec<DVec3> = all(&mesh)
        .filter(|&patch| material_of(&mesh, patch) == "soil" && !mesh.side(patch).is_back)
        .map(|patch| light.irradiance()[patch.index()].as_dvec3() / (PI * scene.sky.as_dvec3()))
        .collect();
    let mean = soil.iter().sum::<DVec3>() / soil.len() as f64;
    // Each way to the sky crosses one pane, and is stopped there independently of all others.
    let rays = 256.0 * soil.len() as f64;
    let deviation = (share * (1.0 - share) / rays).sqrt();
    assert_eq!(soil.len(), 2 * 256);
    assert!((mean - share).abs().max_element() < 5.0 * deviation, "{mean}, {deviation}");
}

/// The stairs, by the same numbers as the file: 14 steps, 30° and 0.2 m from one to the next.
mod stairs {
    pub(super) const COUNT: usize = 14;
    /// Of a step: where it begins and ends, from the axis of the column, and its thickness.
    pub(super) const RADII: [f64; 2] = [0.14, 1.15];
    pub(super) const THICKNESS: f64 = 0.07;

    pub(super) fn angle(step: usize) -> f64 {
        (30.0 * step as f64 - 100.0).to_radians()
    }

    pub(super) fn height(step: usize) -> f64 {
        0.2 * (step + 1) as f64
    }
}

#[test]
fn each_step_of_the_stairs_stands_in_its_place() {
    let (_, scene) = open("spiral-stairs.gltf");
    // Boxes of 12 triangles, a column with 12 sides, the floor, two walls and three lamps.
    assert_eq!(scene.triangles.len(), stairs::COUNT * 12 + 12 * 2 + 6 * 2);
    // Half of a step's angle is 15°; it is symmetric about its middle.
    let radius = (stairs::RADII[0] + stairs::RADII[1]) / 2.0 * 15f64.to_radians().cos();
    for step in 0..stairs::COUNT {
        let corners = scene.triangles[12 * step..][..12].iter().flat_map(|triangle| triangle.p);
        let bits: BTreeSet<[u32; 3]> = corners.map(|p| p.to_array().map(f32::to_bits)).collect();
        let sum = |sum: DVec3, p: &[u32; 3]| sum + Vec3::from(p.map(f32::from_bits)).as_dvec3();
        let middle = bits.iter().fold(DVec3::ZERO, sum) / 8.0;
        let angle = stairs::angle(step);
        let height = stairs::height(step) + stairs::THICKNESS / 2.0;
        let expected = DVec3::new(radius * angle.cos(), height, -radius * angle.sin());
        assert_eq!(bits.len(), 8, "step {step}");
        // The file has rotations to 7 digits and the mesh's corners in f32.
        assert!((middle - expected).length() < 1e-6, "step {step}: {middle} and {expected}");
        let part = &scene.mesh.parts[scene.mesh.origins[12 * step].part as usize];
        assert_eq!(part.object, Some(format!("step {}", step + 1)));
    }
}

#[test]
fn all_instances_have_the_area_and_the_power_of_their_scales() {
    let (_, scene) = open("spiral-stairs.gltf");
    let [inner, outer] = stairs::RADII;
    let (sine, cosine) = 15f64.to_radians().sin_cos();
    // Above and below, two trapezoids; two sides; two ends.
    let step = 2.0 * (inner + outer) * sine * (outer - inner) * cosine
        + 2.0 * (outer - inner) * stairs::THICKNESS
        + 2.0 * (inner + outer) * sine * stairs::THICKNESS;
    let column = 12.0 * 2.0 * 0.12 * sine * 3.6;
    let walls = 4.4 * 4.4 + 2.0 * 4.4 * 4.0;
    // The unit square by 0.6, 0.3 and 0.3 along each of its sides.
    let lamps = 0.36 + 0.09 + 0.09;
    let expected = stairs::COUNT as f64 * step + column + walls + lamps;
    let found: f64 = scene.triangles.iter().map(|triangle| triangle.area()).sum();
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} and {expected}");

    let folder = tempfile::tempdir().expect("a temporary folder");
    let stats = folder.path().join("stats.json");
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["render", "scenes/spiral-stairs.gltf"]);
    command.arg("-o").arg(folder.path().join("a.png")).arg("--stats").arg(&stats);
    command.args(["--size", "16x12", "--levels", "0", "--samples", "16"]);
    let said = command.assert().success().get_output().stderr.clone();
    let said = String::from_utf8(said).expect("text");
    assert!(said.contains("seen by the model's camera `view`") && !said.contains("sky"), "{said}");
    let stats = std::fs::read(stats).expect("a file");
    let stats: serde_json::Value = serde_json::from_slice(&stats).expect("JSON");
    // Exitance is pi times the radiance: the factor times the strength of 20.
    for (channel, factor) in [1.0, 0.85, 0.6].into_iter().enumerate() {
        let emitted = stats["energy"]["emitted"][channel].as_f64().expect("a number");
        let expected = PI * 20.0 * factor * lamps;
        assert!((emitted / expected - 1.0).abs() < 1e-6, "{emitted} and {expected}");
    }
}
