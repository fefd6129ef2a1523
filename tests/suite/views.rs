//! Where pictures of other people's models are seen from, and what is said of it.

use assert_cmd::Command;
use serde_json::json;
use std::path::Path;

/// Renders a model of a folder, and returns what is said, and the picture.
fn render(folder: &Path, model: &str, more: &[&str]) -> (String, image::RgbImage) {
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(folder).args(["render", model, "-o", "a.png", "--size", "32x32"]);
    let output = command.args(more).assert().success().get_output().clone();
    let said = String::from_utf8(output.stderr).expect("text");
    let picture = image::open(folder.join("a.png")).expect("a picture").into_rgb8();
    (said, picture)
}

/// The corners of a box.
fn corners(least: [f32; 3], most: [f32; 3]) -> impl Iterator<Item = [f32; 3]> {
    (0..8).map(move |k| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { least } else { most }[axis]))
}

/// Two triangles for each side of a box.
const SIDES: [[u16; 3]; 12] = [
    [0, 2, 3],
    [0, 3, 1],
    [4, 5, 7],
    [4, 7, 6],
    [0, 1, 5],
    [0, 5, 4],
    [2, 6, 7],
    [2, 7, 3],
    [0, 4, 6],
    [0, 6, 2],
    [1, 3, 7],
    [1, 7, 5],
];

#[test]
fn a_camera_in_a_closed_box_gives_way_unless_it_is_asked_for() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let positions = corners([-1.0; 3], [1.0; 3]).flatten().flat_map(f32::to_le_bytes);
    let indices = SIDES.into_iter().flatten().flat_map(u16::to_le_bytes);
    let bytes: Vec<u8> = positions.chain(indices).collect();
    std::fs::write(folder.path().join("a.bin"), bytes).expect("a file");
    let mut model = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"camera": 0, "name": "within"}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 72},
        ],
        "buffers": [{"uri": "a.bin", "byteLength": 168}],
    });
    std::fs::write(folder.path().join("a.gltf"), model.to_string()).expect("a file");
    let middle = |picture: &image::RgbImage| picture.get_pixel(16, 16).0[0];
    let (said, picture) = render(folder.path(), "a.gltf", &[]);
    assert!(said.contains("`within` is in the dark, so another is taken"), "{said}");
    assert!(middle(&picture) > 150);
    let mut solve = Command::cargo_bin("isolux").expect("the program is built");
    solve.current_dir(folder.path()).args(["solve", "a.gltf", "-o", "a.light"]);
    let said = solve.assert().success().get_output().stderr.clone();
    assert!(String::from_utf8(said).expect("text").contains("`within` is in the dark"));
    let (said, picture) = render(folder.path(), "a.gltf", &["--view", "within"]);
    assert!(!said.contains("camera"), "{said}");
    assert_eq!(middle(&picture), 0);
    // The camera that is taken instead leaves out what lies far away.
    let mut add = |list: &str, item: serde_json::Value| {
        model[list].as_array_mut().expect("a list").push(item);
    };
    add("accessors", json!({"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}));
    add("meshes", json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 2}]}));
    add("nodes", json!({"mesh": 1, "translation": [90, 0, 0], "scale": [0.01, 0.01, 0.01]}));
    model["scenes"] = json!([{"nodes": [0, 1, 2]}]);
    std::fs::write(folder.path().join("b.gltf"), model.to_string()).expect("a file");
    let (said, picture) = render(folder.path(), "b.gltf", &[]);
    assert!(said.contains("is in the dark") && said.contains("far from the rest"), "{said}");
    assert!(middle(&picture) > 150);
}

#[test]
fn what_stands_on_a_wide_ground_fills_the_picture_and_a_speck_far_away_does_not_count() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let model = |more: &str| {
        let corners = corners([-1.0, 0.0, -1.0], [1.0, 2.0, 1.0]);
        let corners: String = corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        let face = |t: &[u16; 3]| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
        let faces: String = SIDES.iter().map(face).collect();
        let text = format!("mtllib a.mtl\n{corners}usemtl red\n{faces}usemtl other\n{more}");
        std::fs::write(folder.path().join("a.obj"), text).expect("a file");
    };
    std::fs::write(
        folder.path().join("a.mtl"),
        "newmtl red\nKd .8 0 0\nnewmtl other\nKd .5 .5 .5\n",
    )
    .expect("a file");
    let red = |picture: &image::RgbImage| {
        picture.pixels().filter(|pixel| pixel.0[0] > 2 * pixel.0[1].max(1)).count()
    };
    let least = 32 * 32 / 8;
    model("v -90 0 -90\nv -90 0 90\nv 90 0 90\nv 90 0 -90\nf 9 10 11 12\n");
    let (said, picture) = render(folder.path(), "a.obj", &[]);
    assert!(said.contains("the ground is wide"), "{said}");
    assert!(red(&picture) > least, "{}", red(&picture));
    model("v 90 0 0\nv 90.1 0 0\nv 90 0.1 0\nf 9 10 11\n");
    let (said, picture) = render(folder.path(), "a.obj", &[]);
    assert!(said.contains("1 of 13 triangles lie far from the rest"), "{said}");
    assert!(red(&picture) > least, "{}", red(&picture));
    // A ground that is not so wide is a part of the whole.
    model("v -3 0 -3\nv -3 0 3\nv 3 0 3\nv 3 0 -3\nf 9 10 11 12\n");
    let (said, _) = render(folder.path(), "a.obj", &[]);
    assert!(!said.contains("else: --position"), "{said}");
}

#[test]
fn things_in_a_closed_room_are_said_to_be_dark_until_one_of_them_shines() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut model = "mtllib a.mtl\n".to_string();
    // A room, and two things in it.
    for (number, size) in [(0, 9.0), (1, 1.0), (2, 2.0)] {
        let corners = corners([-size; 3], [size; 3]);
        model.extend(corners.map(|[x, y, z]| format!("v {x} {y} {z}\n")));
        model += ["usemtl wall\n", "usemtl thing\n", "usemtl other\n"][number];
        let face = |t: &[u16; 3]| {
            t.iter().fold("f".to_string(), |face, k| {
                face + &format!(" {}", usize::from(*k) + 8 * number + 1)
            })
        };
        model.extend(SIDES.iter().map(|t| face(t) + "\n"));
    }
    std::fs::write(folder.path().join("a.obj"), model).expect("a file");
    let materials = "newmtl wall\nKd .5 .5 .5\nnewmtl thing\nKd .8 0 0\nnewmtl other\nKd 0 .8 0\n";
    std::fs::write(folder.path().join("a.mtl"), materials).expect("a file");
    let (said, _) = render(folder.path(), "a.obj", &[]);
    assert!(said.contains("24 of 36 triangles lie where no light comes"), "{said}");
    let (said, _) = render(folder.path(), "a.obj", &["--emit", "other=5"]);
    assert!(!said.contains("no light comes"), "{said}");
}
