//! One room in every format that is read gives one picture, byte for byte.
//!
//! All coordinates are multiples of 1/8 and all colours are sRGB bytes, so that each format holds them exactly.

use assert_cmd::Command;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use glam::{Vec2, Vec3};
use isolux::color::srgb_decode;
use isolux::geometry::Triangle;
use isolux::geometry::shapes::{cube, inside_out, square};
use serde_json::{Value, json};
use std::fmt::Write;
use std::fs;
use std::path::Path;

/// A room of 4 × 3 × 4 that is open at z = 4, with a block in it.
fn room() -> Vec<Triangle> {
    let (x, y, z) = (Vec3::X * 4.0, Vec3::Y * 3.0, Vec3::Z * 4.0);
    [
        square(Vec3::ZERO, z, x),
        square(y, x, z),
        square(Vec3::ZERO, x, y),
        square(Vec3::ZERO, y, z),
        square(x, z, y),
        cube(Vec3::new(1.0, 0.125, 1.5), 1.25),
    ]
    .concat()
}

/// sRGB.
fn color(corner: Vec3) -> [u8; 3] {
    [corner.x * 60.0, corner.y * 80.0, corner.z * 50.0].map(|x| 10 + x as u8)
}

/// The picture's whole width over x, and its height over y and z.
fn uv(corner: Vec3) -> Vec2 {
    Vec2::new(corner.x / 4.0, (corner.y + corner.z) / 8.0)
}

/// Which of colours and texture coordinates a file has.
#[derive(Clone, Copy, PartialEq)]
enum Look {
    Grey,
    Colored,
    Textured,
}

fn corners() -> Vec<Vec3> {
    room().iter().flat_map(|triangle| triangle.p).collect()
}

const MATERIALS: &str = "newmtl grey\nKd 0.5 0.5 0.5\nnewmtl white\nKd 1 1 1\nnewmtl textured\nKd 1 1 1\nmap_Kd room.png\n";

fn obj(look: Look) -> String {
    let material = match look {
        Look::Grey => "grey",
        Look::Colored => "white",
        Look::Textured => "textured",
    };
    let mut text = format!("mtllib room.mtl\nusemtl {material}\n");
    for corner in corners() {
        let [r, g, b] = color(corner).map(|c| f32::from(c) / 255.0);
        let colors = if look == Look::Colored { format!(" {r} {g} {b}") } else { String::new() };
        let _ = writeln!(text, "v {} {} {}{colors}", corner.x, corner.y, corner.z);
        let _ = writeln!(text, "vt {} {}", uv(corner).x, uv(corner).y);
    }
    for k in (1..=corners().len()).step_by(3) {
        let _ = writeln!(text, "f {0}/{0} {1}/{1} {2}/{2}", k, k + 1, k + 2);
    }
    text
}

fn ply(look: Look, binary: bool) -> Vec<u8> {
    let (count, triangles) = (corners().len(), room().len());
    let format = if binary { "binary_big_endian" } else { "ascii" };
    let more = match look {
        Look::Grey => "",
        Look::Colored => "property uchar red\nproperty uchar green\nproperty uchar blue\n",
        Look::Textured => "property float s\nproperty float t\n",
    };
    let picture = if look == Look::Textured { "comment TextureFile room.png\n" } else { "" };
    let header = format!(
        "ply\nformat {format} 1.0\n{picture}element vertex {count}\nproperty float x\nproperty float y\n\
         property float z\n{more}element face {triangles}\nproperty list uchar int vertex_indices\n\
         end_header\n"
    );
    let mut bytes = header.into_bytes();
    let floats = |corner: Vec3| {
        let uv = if look == Look::Textured { uv(corner).to_array().to_vec() } else { Vec::new() };
        [corner.to_array().to_vec(), uv].concat()
    };
    let colors = |corner| if look == Look::Colored { color(corner).to_vec() } else { Vec::new() };
    for corner in corners() {
        if binary {
            bytes.extend(floats(corner).into_iter().flat_map(f32::to_be_bytes));
            bytes.extend(colors(corner));
        } else {
            let floats = floats(corner).into_iter().map(|x| x.to_string());
            let colors = colors(corner).into_iter().map(|c| c.to_string());
            let words: Vec<String> = floats.chain(colors).collect();
            bytes.extend(format!("{}\n", words.join(" ")).into_bytes());
        }
    }
    for k in (0..count as i32).step_by(3) {
        if binary {
            bytes.push(3);
            bytes.extend([k, k + 1, k + 2].into_iter().flat_map(i32::to_be_bytes));
        } else {
            bytes.extend(format!("3 {} {} {}\n", k, k + 1, k + 2).into_bytes());
        }
    }
    bytes
}

fn text_stl() -> String {
    let mut text = String::from("solid room\n");
    for triangle in room() {
        text += "facet normal 0 0 0\nouter loop\n";
        for p in triangle.p {
            let _ = writeln!(text, "vertex {} {} {}", p.x, p.y, p.z);
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid room\n"
}

fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![b' '; 80];
    bytes.extend((room().len() as u32).to_le_bytes());
    for triangle in room() {
        let numbers = [Vec3::ZERO, triangle.p[0], triangle.p[1], triangle.p[2]];
        bytes.extend(numbers.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes));
        bytes.extend([0; 2]);
    }
    bytes
}

/// The JSON without its buffer's place, and the buffer.
fn gltf(look: Look) -> (Value, Vec<u8>) {
    let list = |values: Vec<[f32; 3]>| values.into_iter().flatten().flat_map(f32::to_le_bytes);
    let count = corners().len();
    let mut bytes: Vec<u8> = list(corners().iter().map(|p| p.to_array()).collect()).collect();
    let linear = |p: &Vec3| color(*p).map(|c| srgb_decode(f32::from(c) / 255.0));
    bytes.extend(list(corners().iter().map(linear).collect()));
    // v runs down in glTF.
    let down = corners().into_iter().flat_map(|p| [uv(p).x, 1.0 - uv(p).y]);
    bytes.extend(down.flat_map(f32::to_le_bytes));
    let accessor = |offset: usize, shape: &str| json!({"bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": count, "type": shape});
    let (mut attributes, mut pbr) = (json!({"POSITION": 0}), json!({"metallicFactor": 0}));
    match look {
        Look::Grey => pbr["baseColorFactor"] = json!([0.5, 0.5, 0.5, 1]),
        Look::Colored => attributes["COLOR_0"] = json!(1),
        Look::Textured => {
            attributes["TEXCOORD_0"] = json!(2);
            pbr["baseColorTexture"] = json!({"index": 0});
        }
    }
    let json = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": pbr}],
        "textures": [{"source": 0}],
        "images": [{"uri": "room.png"}],
        "accessors": [accessor(0, "VEC3"), accessor(12 * count, "VEC3"), accessor(24 * count, "VEC2")],
        "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
        "buffers": [{"byteLength": bytes.len()}],
    });
    (json, bytes)
}

fn embedded_gltf(look: Look) -> String {
    let (mut json, bytes) = gltf(look);
    let data = BASE64_STANDARD.encode(bytes);
    json["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
    json.to_string()
}

fn glb(look: Look) -> Vec<u8> {
    let (json, binary) = gltf(look);
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", text), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

/// The picture of the model `name` in the folder, as the bytes of an EXR file.
fn picture(folder: &Path, name: &str) -> Vec<u8> {
    let description = format!(
        "models = ['{name}']\nsky = [0.8, 0.9, 1]\n[camera]\nposition = [2.5, 1.75, 8]\nlook_at = [2, 1.5, 0]\n"
    );
    fs::write(folder.join("room.toml"), description).expect("a file");
    let mut command = Command::cargo_bin("isolux").expect("the program is built");
    command.current_dir(folder).args(["render", "room.toml", "-o", "room.exr"]);
    command.args(["--levels", "2", "--samples", "64", "--size", "48x36", "--spp", "4"]);
    command.args(["--shading", "flat,smooth"]);
    let output = command.assert().success().get_output().clone();
    assert!(output.stderr.is_empty(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let read = |name| fs::read(folder.join(name)).expect("a picture");
    [read("room-flat.exr"), read("room-smooth.exr")].concat()
}

/// Draws all files, which must give the first one's picture, and returns it.
fn one_picture(files: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let tile = image::RgbImage::from_fn(4, 4, |x, y| image::Rgb([60 * x as u8, 70 * y as u8, 200]));
    tile.save(folder.path().join("room.png")).expect("a picture");
    fs::write(folder.path().join("room.mtl"), MATERIALS).expect("a file");
    let mut first: Option<Vec<u8>> = None;
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).expect("a file");
        let found = picture(folder.path(), name);
        assert!(*first.get_or_insert_with(|| found.clone()) == found, "{name} and {}", files[0].0);
    }
    first.expect("at least one file")
}

#[test]
fn one_room_in_every_format_gives_one_picture_byte_for_byte() {
    let grey = one_picture(&[
        ("room.obj", obj(Look::Grey).into()),
        ("room.gltf", embedded_gltf(Look::Grey).into()),
        ("room.glb", glb(Look::Grey)),
        ("text.ply", ply(Look::Grey, false)),
        ("binary.ply", ply(Look::Grey, true)),
        ("text.stl", text_stl().into()),
        ("binary.stl", binary_stl()),
    ]);
    let [colored, textured] = [Look::Colored, Look::Textured].map(|look| {
        one_picture(&[
            ("room.obj", obj(look).into()),
            ("room.gltf", embedded_gltf(look).into()),
            ("room.glb", glb(look)),
            ("text.ply", ply(look, false)),
            ("binary.ply", ply(look, true)),
        ])
    });
    assert!(grey != colored && grey != textured && colored != textured);
}

/// A closed room of a material, with a lamp in it that reflects as the walls do.
fn closed_room(wall: &Value) -> String {
    let walls = inside_out(cube(Vec3::ZERO, 2.0));
    let lamp = square(Vec3::new(0.75, 1.75, 0.75), Vec3::X * 0.5, Vec3::Z * 0.5);
    let corners = walls.iter().chain(&lamp).flat_map(|triangle| triangle.p);
    let bytes: Vec<u8> = corners.flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let data = BASE64_STANDARD.encode(&bytes);
    let accessor = |first: usize, count: usize| json!({"bufferView": 0, "byteOffset": 12 * first, "componentType": 5126, "count": count, "type": "VEC3"});
    let mut shining = wall.clone();
    shining["emissiveFactor"] = json!([1, 1, 1]);
    shining["doubleSided"] = json!(true);
    shining["extensions"] = json!({"KHR_materials_emissive_strength": {"emissiveStrength": 10}});
    let json = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0}, "material": 0},
            {"attributes": {"POSITION": 1}, "material": 1},
        ]}],
        "materials": [wall, shining],
        "accessors": [accessor(0, 36), accessor(36, 6)],
        "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
        "buffers": [{
            "byteLength": bytes.len(),
            "uri": format!("data:application/octet-stream;base64,{data}"),
        }],
    });
    json.to_string()
}

#[test]
fn a_closed_room_without_colours_is_drawn() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let draw = |wall: Value| {
        fs::write(folder.path().join("room.gltf"), closed_room(&wall)).expect("a file");
        let mut command = Command::cargo_bin("isolux").expect("the program is built");
        command.current_dir(folder.path()).args(["render", "room.gltf", "-o", "room.png"]);
        command.args(["--levels", "2", "--samples", "64", "--size", "16x16", "--spp", "1"]);
        let output = command.output().expect("the program runs");
        (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (drawn, said) = draw(json!({}));
    assert!(drawn && said.contains("are white and reflect 0.9 (2 in all)"), "{said}");
    // No light is lost at walls that reflect all of it.
    let white = json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]}});
    let (drawn, said) = draw(white);
    assert!(!drawn && said.contains("does not converge"), "{said}");
}
