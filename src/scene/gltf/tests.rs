use super::*;
use crate::color::Rgb;
use crate::geometry::TriangleId;
use crate::scene::mutation::{self, Loaded};
use crate::scene::texture::Wrap;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use glam::{DVec3, Vec2};
use serde_json::{Value, json};
use std::io::Cursor;

/// A triangle of f32: positions, texture coordinates, then three u16 indices and two bytes of nothing.
fn triangle_bytes() -> Vec<u8> {
    let numbers = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.25, 1.0];
    let mut bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0, 0, 1, 0, 2, 0, 0, 0]);
    bytes
}

fn uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", BASE64_STANDARD.encode(bytes))
}

/// A red pixel, and a green one that lets half of the light through.
fn png() -> Vec<u8> {
    let pixels = vec![255, 0, 0, 255, 0, 255, 0, 128];
    let picture = image::RgbaImage::from_raw(2, 1, pixels).unwrap();
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A scene of one triangle.
fn triangle() -> Value {
    let bytes = triangle_bytes();
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "wall", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC2"},
            {"bufferView": 0, "byteOffset": 60, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 68}],
        "buffers": [{"byteLength": 68, "uri": uri(&bytes)}],
    })
}

/// The triangle with every kind of material property.
fn textured() -> Value {
    let mut json = triangle();
    json["meshes"][0]["primitives"][0]["material"] = json!(0);
    json["materials"] = json!([{
        "name": "lamp",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1.0, 0.75],
            "metallicFactor": 0,
            "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform":
                {"offset": [0.5, 0.25], "rotation": 0.0, "scale": [2.0, 0.5]}}},
        },
        "emissiveFactor": [1, 0, 0.5],
        "emissiveTexture": {"index": 0},
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 4},
            "KHR_materials_transmission": {"transmissionFactor": 0.5},
        },
        "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
    }]);
    json["textures"] = json!([{"source": 0, "sampler": 0}]);
    json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648}]);
    json["images"] = json!([{"name": "two", "uri": uri(&png())}]);
    json
}

fn load_json(json: &Value) -> Loaded {
    mutation::load("a.gltf", json.to_string().as_bytes(), load)
}

/// A binary model; `binary` becomes its second chunk.
fn glb(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", text.as_slice()), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

fn corners(model: &Model, triangle: usize) -> [DVec3; 3] {
    model.triangles[triangle].map(|corner| model.positions[corner as usize])
}

#[test]
fn a_textured_triangle_has_its_material_and_pictures() {
    let (model, warnings) = load_json(&textured()).unwrap();
    assert_eq!(corners(&model, 0), [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert_eq!(model.up, Some(Vec3::Y));
    let material = &model.materials[model.material_of[0].0 as usize];
    assert_eq!((material.name.as_str(), material.two_sided), ("lamp", true));
    assert_eq!(material.reflectance, Rgb::new(0.5, 0.25, 1.0));
    assert_eq!(material.radiance, Rgb::new(4.0, 0.0, 2.0));
    // What is cut out by a mask is there or not.
    assert_eq!((material.opacity, material.opacity_cutoff), (0.75, Some(0.25)));
    assert_eq!(material.opacity_map, material.reflectance_map);
    let texture = &model.textures[0];
    assert_eq!((texture.name.as_str(), texture.width, texture.height), ("two", 2, 1));
    assert_eq!(*texture.pixels, [[255, 0, 0, 255], [0, 255, 0, 128]]);
    assert_eq!(texture.wrap, [Wrap::Clamp, Wrap::Mirror]);
    assert_eq!(model.textures.len(), 1);
    assert_eq!(
        warnings,
        ["a.gltf: materials are taken as diffuse: 1 transmissive (at least 0.2 opaque)"]
    );
}

#[test]
fn no_lamp_is_brighter_than_what_a_light_file_may_hold() {
    let mut json = textured();
    json["materials"][0]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] =
        json!(1e30);
    let (model, _) = load_json(&json).unwrap();
    let material = &model.materials[model.material_of[0].0 as usize];
    assert_eq!(material.radiance, Rgb::new(1e12, 0.0, 1e12));
    assert!(material.is_possible(1));
}

#[test]
fn v_runs_up_also_through_texture_transforms() {
    let (model, _) = load_json(&textured()).unwrap();
    let uv = model.mesh.texture.as_ref().unwrap().at(TriangleId(0), 2).unwrap();
    // (0.25, 1) in the file.
    assert_eq!(uv, Vec2::new(0.25, 0.0));
    let map = model.materials[0].reflectance_map.unwrap();
    // The file's transform makes it (0.25 · 2 + 0.5, 1 · 0.5 + 0.25), where v runs down.
    assert_eq!(map.transform.transform_point2(uv), Vec2::new(1.0, 0.25));
    let mut turned = textured();
    turned["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"] =
        json!({"rotation": std::f32::consts::FRAC_PI_2});
    let (model, _) = load_json(&turned).unwrap();
    let map = model.materials[0].reflectance_map.unwrap();
    // (u, v) becomes (v, -u) where v runs down: (1, -0.25).
    let found = map.transform.transform_point2(uv);
    assert!((found - Vec2::new(1.0, 1.25)).length() < 1e-6, "{found}");
}

#[test]
fn nodes_place_meshes_and_a_mirror_turns_the_winding_back() {
    let mut json = triangle();
    json["nodes"] = json!([
        {"translation": [1, 0, 0], "children": [1, 2]},
        {"name": "mirrored", "scale": [-1, 1, 1], "mesh": 0},
        {"matrix": [0,1,0,0, -1,0,0,0, 0,0,1,0, 0,0,5,1], "mesh": 0},
    ]);
    json["meshes"][0]["name"] = json!("sheet");
    let (model, warnings) = load_json(&json).unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    assert_eq!(corners(&model, 0), [DVec3::X, DVec3::X + DVec3::Y, DVec3::ZERO]);
    // A quarter turn about z, then up.
    let at = |x, y| DVec3::new(x, y, 5.0);
    assert_eq!(corners(&model, 1), [at(1.0, 0.0), at(1.0, 1.0), at(0.0, 0.0)]);
    let names: Vec<_> = model.mesh.parts.iter().map(|part| part.object.as_deref()).collect();
    assert_eq!(names, [Some("mirrored"), Some("sheet")]);
    assert_eq!(model.mesh.origins.iter().map(|o| o.face).collect::<Vec<_>>(), [1, 2]);
    assert_eq!(model.materials, [Material::fallback()]);
    // The texture coordinates go with their corners.
    let texture = model.mesh.texture.unwrap();
    assert_eq!(texture.at(TriangleId(0), 1), Some(Vec2::new(0.25, 0.0)));
}

#[test]
fn without_a_scene_all_root_nodes_are_one() {
    let mut json = triangle();
    json["nodes"] = json!([{"mesh": 0}, {"children": [0]}, {"mesh": 0}]);
    json.as_object_mut().unwrap().remove("scene");
    assert_eq!(load_json(&json).unwrap().0.triangles.len(), 1);
    json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(load_json(&json).unwrap().0.triangles.len(), 2);
}

#[test]
fn binary_and_external_buffers_are_the_same_model() {
    let (expected, _) = load_json(&triangle()).unwrap();
    let mut json = triangle();
    json["buffers"][0] = json!({"byteLength": 68});
    let (binary, _) = mutation::load("a.glb", &glb(&json, &triangle_bytes()), load).unwrap();
    json["buffers"][0]["uri"] = json!("my%20data.bin");
    let text = json.to_string();
    let files: [(&str, &[u8]); 2] =
        [("a.gltf", text.as_bytes()), ("my data.bin", &triangle_bytes())];
    let (external, _) = mutation::load_files(&files, load).unwrap();
    assert_eq!(external.files.len(), 1);
    assert!(external.files[0].ends_with("my data.bin"));
    for model in [binary, external] {
        assert_eq!(model.positions, expected.positions);
        assert_eq!(model.triangles, expected.triangles);
        assert_eq!(model.mesh, expected.mesh);
    }
}

#[test]
fn sparse_values_replace_others_or_zeros() {
    let mut bytes = triangle_bytes();
    bytes.extend([2, 0, 0, 0]);
    bytes.extend([3.0f32, 4.0, 5.0].iter().flat_map(|x| x.to_le_bytes()));
    let mut json = triangle();
    json["buffers"][0] = json!({"byteLength": bytes.len(), "uri": uri(&bytes)});
    json["bufferViews"][0]["byteLength"] = json!(bytes.len());
    json["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": {"bufferView": 0, "byteOffset": 68, "componentType": 5121},
        "values": {"bufferView": 0, "byteOffset": 72},
    });
    let changed = DVec3::new(3.0, 4.0, 5.0);
    assert_eq!(corners(&load_json(&json).unwrap().0, 0), [DVec3::ZERO, DVec3::X, changed]);
    json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(corners(&load_json(&json).unwrap().0, 0), [DVec3::ZERO, DVec3::ZERO, changed]);
}

#[test]
fn quantized_numbers_with_strides_are_read() {
    // Positions as i16 with a stride of 8, colours as u8 with a stride of 4.
    let mut bytes: Vec<u8> = [0i16, 0, 0, 9, 32767, 0, -32768, 9, 0, 32767, 0, 9]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    bytes.extend([255, 0, 0, 9, 0, 255, 0, 9, 0, 51, 255, 9]);
    let mut json = triangle();
    json["buffers"][0] = json!({"byteLength": 36, "uri": uri(&bytes)});
    json["bufferViews"] = json!([
        {"buffer": 0, "byteLength": 24, "byteStride": 8},
        {"buffer": 0, "byteOffset": 24, "byteLength": 12, "byteStride": 4},
    ]);
    json["accessors"] = json!([
        {"bufferView": 0, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC3"},
    ]);
    json["meshes"][0]["primitives"] = json!([{"attributes": {"POSITION": 0, "COLOR_0": 1}}]);
    json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let (model, _) = load_json(&json).unwrap();
    assert_eq!(corners(&model, 0), [DVec3::ZERO, DVec3::X - DVec3::Z, DVec3::Y]);
    let colors = model.mesh.colors.unwrap();
    assert_eq!(colors.at(TriangleId(0), 2), Some(Rgb::new(0.0, 0.2, 1.0)));
    json["accessors"][0]["normalized"] = json!(false);
    let (model, _) = load_json(&json).unwrap();
    assert_eq!(corners(&model, 0)[1], DVec3::new(32767.0, 0.0, -32768.0));
}

#[test]
fn strips_and_fans_become_triangles_and_lines_are_ignored() {
    let mut json = triangle();
    json["accessors"][2] = json!({"bufferView": 0, "byteOffset": 68, "componentType": 5121, "count": 5, "type": "SCALAR"});
    let mut bytes = triangle_bytes();
    bytes.extend([0, 1, 2, 0, 1]);
    json["buffers"][0] = json!({"byteLength": 73, "uri": uri(&bytes)});
    json["bufferViews"][0]["byteLength"] = json!(73);
    json["meshes"][0]["primitives"][0]["mode"] = json!(5);
    assert_eq!(load_json(&json).unwrap().0.triangles, [[0, 1, 2], [1, 0, 2], [2, 0, 1]]);
    json["meshes"][0]["primitives"][0]["mode"] = json!(6);
    assert_eq!(load_json(&json).unwrap().0.triangles, [[0, 1, 2], [0, 2, 0], [0, 0, 1]]);
    let lines = json!({"attributes": {"POSITION": 0}, "mode": 1});
    json["meshes"][0]["primitives"].as_array_mut().unwrap().push(lines);
    let (_, warnings) = load_json(&json).unwrap();
    assert_eq!(warnings, ["a.gltf: points and lines have no area and are ignored (1 in all)"]);
}

#[test]
fn instances_skins_and_morph_targets_are_placed() {
    let mut json = triangle();
    // The positions serve as translations too: (0, 0, 0), (1, 0, 0), (0, 1, 0).
    json["nodes"][0]["extensions"] =
        json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}});
    let (model, _) = load_json(&json).unwrap();
    assert_eq!(corners(&model, 1), [DVec3::X, DVec3::X * 2.0, DVec3::X + DVec3::Y]);
    assert_eq!(model.triangles.len(), 3);

    let mut json = triangle();
    json["meshes"][0]["weights"] = json!([2]);
    json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
    let (model, _) = load_json(&json).unwrap();
    assert_eq!(corners(&model, 0), [DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0]);

    let mut json = triangle();
    let mut bytes = triangle_bytes();
    bytes.extend([0u8; 12].iter().chain(&[1, 0, 0, 0].repeat(3)).copied());
    json["buffers"][0] = json!({"byteLength": 92, "uri": uri(&bytes)});
    json["bufferViews"][0]["byteLength"] = json!(92);
    for at in [68, 80] {
        json["accessors"].as_array_mut().unwrap().push(json!(
            {"bufferView": 0, "byteOffset": at, "componentType": 5121, "count": 3, "type": "VEC4"}
        ));
    }
    let attributes = &mut json["meshes"][0]["primitives"][0]["attributes"];
    (attributes["JOINTS_0"], attributes["WEIGHTS_0"]) = (json!(3), json!(4));
    // The joint moves the mesh, its own node does not.
    json["nodes"] =
        json!([{"mesh": 0, "skin": 0, "translation": [9, 9, 9]}, {"translation": [0, 0, 1]}]);
    json["scenes"][0]["nodes"] = json!([0, 1]);
    json["skins"] = json!([{"joints": [1]}]);
    let (model, _) = load_json(&json).unwrap();
    assert_eq!(corners(&model, 0), [DVec3::Z, DVec3::X + DVec3::Z, DVec3::Y + DVec3::Z]);
}

#[test]
fn primitives_that_share_their_accessors_share_what_is_read() {
    let mut json = triangle();
    let mut primitive = json["meshes"][0]["primitives"][0].clone();
    primitive["attributes"]["NORMAL"] = json!(0);
    primitive["attributes"]["COLOR_0"] = json!(0);
    json["meshes"][0]["primitives"] = json!([primitive, primitive, primitive]);
    // A second, mirrored instance has positions and normals of its own.
    json["nodes"].as_array_mut().unwrap().push(json!({"mesh": 0, "scale": [-1, 1, 1]}));
    json["scenes"][0]["nodes"] = json!([0, 1]);
    let (model, _) = load_json(&json).unwrap();
    assert_eq!((model.triangles.len(), model.positions.len()), (6, 6));
    assert_eq!(corners(&model, 2), [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert_eq!(corners(&model, 5), [DVec3::ZERO, DVec3::Y, DVec3::NEG_X]);
    let normals = model.mesh.normals.unwrap();
    assert_eq!(normals.at(TriangleId(2), 1), normals.at(TriangleId(0), 1));
    assert_eq!(normals.at(TriangleId(5), 1), Some(Vec3::Y));
}

#[test]
fn cameras_become_views_with_names_of_their_own() {
    let mut json = triangle();
    json["nodes"].as_array_mut().unwrap().extend([
        json!({"name": "Front door/1", "camera": 0, "translation": [0, 0, 5]}),
        json!({"name": "Front door 1", "camera": 0}),
        json!({"camera": 1}),
    ]);
    json["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    json["cameras"] = json!([
        {"type": "perspective", "perspective": {"yfov": std::f64::consts::FRAC_PI_2, "znear": 0.5, "aspectRatio": 2}},
        {"type": "orthographic", "orthographic": {"xmag": 1}},
    ]);
    let (model, warnings) = load_json(&json).unwrap();
    let names: Vec<&str> = model.views.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["Front-door-1", "Front-door-1-2"]);
    let ray = model.views[0].1.ray(0.5, 0.0, 1.0);
    assert_eq!((ray.origin, ray.t_min), (Vec3::Z * 5.0, 0.5));
    // A square image is as wide as the camera's, and so twice as high.
    assert!((ray.direction - Vec3::new(0.0, 2.0, -1.0)).length() < 1e-6);
    assert_eq!(warnings, ["a.gltf: cameras without a perspective are ignored (1 in all)"]);
}

#[test]
fn pictures_that_cannot_be_read_leave_the_factor() {
    let mut json = textured();
    json["images"][0]["uri"] = json!("none.png");
    let (model, warnings) = load_json(&json).unwrap();
    assert_eq!(model.materials[0].reflectance_map, None);
    assert_eq!(model.materials[0].reflectance, Rgb::new(0.5, 0.25, 1.0));
    assert_eq!(model.materials[0].radiance, Rgb::ZERO, "the lights are not all of it");
    assert!(warnings[0].contains("image 0 cannot be used: cannot read `none.png`"), "{warnings:?}");
    assert_eq!(warnings.len(), 2, "one warning per picture: {warnings:?}");
    json["images"][0]["uri"] = json!("data:image/png;base64,AAAA");
    assert!(load_json(&json).unwrap().1[0].contains("image 0 cannot be used"));
}

#[test]
fn what_transmits_light_is_still_seen() {
    let mut json = textured();
    let mut opacity = |transmission: Value| {
        json["materials"][0]["alphaMode"] = json!("OPAQUE");
        json["materials"][0]["extensions"] = json!({"KHR_materials_transmission": transmission});
        load_json(&json).unwrap().0.materials[0].opacity
    };
    assert_eq!(opacity(json!({"transmissionFactor": 0.5})), 0.5);
    assert_eq!(opacity(json!({"transmissionFactor": 1})), 0.2);
    assert_eq!(opacity(json!({})), 1.0);
    // The picture's red is 255 and 0.
    let textured = json!({"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}});
    assert_eq!(opacity(textured), 0.75);
    let unreadable = json!({"transmissionFactor": 1, "transmissionTexture": {"index": 9}});
    assert_eq!(opacity(unreadable), 1.0);
}

#[test]
fn white_that_no_file_asks_for_loses_some_light() {
    let mut json = triangle();
    json["meshes"][0]["primitives"][0]["material"] = json!(0);
    json["materials"] = json!([{"pbrMetallicRoughness": {"metallicFactor": 0}}]);
    let reflectance = |json: &Value| {
        let (model, warnings) = load_json(json).unwrap();
        (model.materials[0].reflectance, warnings)
    };
    let said = "a.gltf: materials without a base colour are white and reflect 0.9 (1 in all)";
    assert_eq!(reflectance(&json), (Rgb::splat(0.9), vec![said.to_string()]));
    let mut given = json.clone();
    given["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 1, 1, 1]);
    assert_eq!(reflectance(&given), (Rgb::ONE, vec![]));
    let mut colored = json.clone();
    colored["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(0);
    assert_eq!(reflectance(&colored), (Rgb::ONE, vec![]));
    let mut painted = textured();
    painted["materials"][0]["pbrMetallicRoughness"] =
        json!({"metallicFactor": 0, "baseColorTexture": {"index": 0}});
    assert_eq!(reflectance(&painted).0, Rgb::ONE);
}

#[test]
fn specular_colours_are_reflected_diffusely() {
    let mut json = textured();
    let mut material = |glossy: Value| {
        json["materials"][0]["extensions"] = json!({"KHR_materials_pbrSpecularGlossiness": glossy});
        let (mut model, _) = load_json(&json).unwrap();
        let material = model.materials.remove(0);
        let pixels = material
            .reflectance_map
            .map(|map| model.textures[map.texture.0 as usize].pixels.to_vec());
        (material.reflectance, pixels)
    };
    let black = [0, 0, 0, 1];
    let gold = json!([1, 0.75, 0.25]);
    let metal = material(json!({"diffuseFactor": black, "specularFactor": gold}));
    assert_eq!(metal, (Rgb::new(1.0, 0.75, 0.25), None));
    // The picture's mean is half red and half green.
    let textured = json!({"diffuseFactor": black, "specularGlossinessTexture": {"index": 0}});
    let (reflectance, _) = material(textured);
    assert!((reflectance - Rgb::new(0.5, 0.5, 0.0)).length() < 1e-6, "{reflectance}");
    let painted = json!({"diffuseFactor": black, "specularFactor": [1, 1, 1],
        "diffuseTexture": {"index": 0}, "specularGlossinessTexture": {"index": 0}});
    let expected = vec![[255, 0, 0, 255], [0, 255, 0, 128]];
    assert_eq!(material(painted), (Rgb::ONE, Some(expected)));
    let plastic = json!({"specularFactor": [0.04, 0.04, 0.04], "diffuseTexture": {"index": 0},
        "diffuseFactor": [0.5, 0.5, 0.5, 1]});
    assert_eq!(material(plastic).0, Rgb::splat(0.5));
    let unreadable = json!({"diffuseFactor": [0.5, 0.5, 0.5, 1],
        "specularGlossinessTexture": {"index": 9}});
    assert_eq!(material(unreadable).0, Rgb::splat(0.5));
}

#[test]
fn files_outside_the_folder_are_named_in_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("model")).unwrap();
    std::fs::write(folder.path().join("a.bin"), triangle_bytes()).unwrap();
    let mut json = triangle();
    json["buffers"][0]["uri"] = json!("../a.bin");
    let path = folder.path().join("model/a.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    let warning = load(&path).unwrap().warnings[0].to_string();
    assert!(warning.ends_with("the model reads `../a.bin`, which is outside its folder"));
}

#[test]
fn what_has_no_meaning_is_refused_with_its_place() {
    let edits: [(&str, Value, &str); 23] = [
        ("/asset/version", json!("1.0"), "glTF `1.0` is not read, only glTF 2"),
        ("/asset/version", json!(1), "glTF `1` is not read, only glTF 2"),
        ("/asset/version", json!(""), "the JSON does not say that it is glTF"),
        ("/scene", json!(1), "scene 1 does not exist"),
        ("/scenes/0/nodes", json!([7]), "node 7 does not exist"),
        ("/scenes/0/nodes", json!([]), "the scene contains no triangles"),
        ("/nodes/0/children", json!([0]), "node 0 has two parents, or is its own"),
        ("/nodes/0/mesh", json!(4294967296u64), "mesh 4294967296, which node 0 has"),
        (
            "/nodes/0/translation",
            json!([1e13, 0, 0]),
            "mesh 0, primitive 0, vertex 0: coordinate 1e13",
        ),
        (
            "/nodes/0/scale",
            json!([1e300, 1e300, 1]),
            "mesh 0, primitive 0, vertex 1: coordinate 1e300",
        ),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(9), "accessor 9 reaches beyond"),
        (
            "/meshes/0/primitives/0/attributes/POSITION",
            json!(2),
            "accessor 2 does not have 3 numbers",
        ),
        ("/meshes/0/primitives/0/indices", json!(1), "accessor 1 has indices that are not whole"),
        ("/accessors/0/count", json!(u64::MAX), "accessor 0 reaches beyond"),
        ("/accessors/0/count", json!(2), "mesh 0 names vertex 2, but it has 2 vertices"),
        ("/accessors/0/byteOffset", json!(33), "accessor 0 reaches beyond"),
        ("/accessors/0/componentType", json!(5124), "accessor 0 has no known kind of number: 5124"),
        ("/bufferViews/0/byteLength", json!(u64::MAX), "buffer view 0 reaches beyond"),
        ("/bufferViews/0/byteStride", json!(1), "accessor 0 reaches beyond"),
        ("/bufferViews/0/buffer", json!(1), "buffer view 0 reaches beyond"),
        ("/buffers/0/byteLength", json!(69), "buffer 0 has 68 bytes, but should have 69"),
        ("/buffers/0/uri", json!("data:x;base64,!"), "a data URI is malformed"),
        ("/buffers/0/uri", json!("https://example.org/a"), "`https://example.org/a` is not a file"),
    ];
    for (place, value, cause) in edits {
        let mut json = triangle();
        let (parent, key) = place.rsplit_once('/').unwrap();
        let parent = json.pointer_mut(parent).unwrap();
        match key.parse::<usize>() {
            Ok(index) => parent[index] = value,
            Err(_) => parent[key] = value,
        }
        let message = load_json(&json).unwrap_err();
        assert!(message.starts_with(&format!("a.gltf: {cause}")), "{place}: {message}");
        assert!(message.contains("\n  help: "), "{message}");
    }
}

#[test]
fn compressed_and_unknown_extensions_are_refused_with_what_undoes_them() {
    for (name, cause, remedy) in [
        ("KHR_draco_mesh_compression", "compressed with KHR_draco", "Blender"),
        ("EXT_meshopt_compression", "compressed with EXT_meshopt", "gltfpack -noq"),
        ("KHR_texture_basisu", "compressed with KHR_texture_basisu", "ktxdecompress"),
        ("ACME_\u{1b}", "the model demands the extension `ACME_\\u{1b}`", "without it"),
    ] {
        let mut json = triangle();
        json["extensionsRequired"] = json!([name]);
        let message = load_json(&json).unwrap_err();
        assert!(message.contains(cause) && message.contains(remedy), "{message}");
    }
    let mut json = triangle();
    json["extensionsRequired"] = json!(["KHR_materials_unlit", "KHR_texture_transform"]);
    assert!(load_json(&json).is_ok());
    json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_draco_mesh_compression": {}});
    assert!(load_json(&json).unwrap_err().contains("compressed with KHR_draco"));
}

#[test]
fn malformed_json_and_containers_are_refused() {
    let message = |name: &str, bytes: &[u8]| mutation::load(name, bytes, load).unwrap_err();
    assert!(message("a.gltf", b"{\n\"asset\": x}").starts_with("a.gltf:2: the JSON is malformed"));
    assert!(
        message("a.gltf", b"{\"asset\": {\"version\": \"2.0\"},\n\"nodes\": 3}")
            .contains("invalid type: integer")
    );
    let whole = glb(&triangle(), &[0; 4]);
    for end in 4..whole.len() {
        let message = message("a.glb", &whole[..end]);
        assert!(message.starts_with("a.glb: the binary glTF file"), "{end}: {message}");
    }
    let old = b"{\"asset\": {\"version\": \"1.1\"}, \"nodes\": {}}";
    assert!(message("a.gltf", old).contains("glTF `1.1` is not read"));
    assert!(message("a.glb", b"glTF\x01\0\0\0\0\0\0\0").contains("glTF `1` is not read"));
}

#[test]
fn no_mutation_makes_the_reader_panic() {
    let mut json = textured();
    json["nodes"][0]["children"] = json!([1]);
    json["nodes"]
        .as_array_mut()
        .unwrap()
        .push(json!({"scale": [1, -1, 1], "mesh": 0, "camera": 0}));
    json["cameras"] = json!([{"perspective": {"yfov": 1, "znear": 1}}]);
    let read = |bytes: &[u8]| read(Path::new("a.gltf"), bytes);
    mutation::try_many(json.to_string().as_bytes(), 4000, read);
    let mut json = triangle();
    json["buffers"][0] = json!({"byteLength": 68});
    mutation::try_many(&glb(&json, &triangle_bytes()), 4000, read);
}

#[test]
fn a_model_that_only_glows_is_lit_by_the_sky() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.gltf");
    let sky = |json: &Value, emissions: Vec<(String, Rgb)>| {
        std::fs::write(&file, json.to_string()).unwrap();
        let mut document = crate::scene::Document::open(&file).unwrap();
        document.emissions = emissions;
        crate::scene::Scene::load(&document).unwrap().sky
    };
    let mut json = textured();
    assert_eq!(sky(&json, vec![]), Rgb::ZERO, "four times as bright as white under a sky");
    json["materials"][0]["extensions"] = json!({});
    assert_eq!(sky(&json, vec![]), Rgb::ONE);
    assert_eq!(sky(&json, vec![("lamp".into(), Rgb::ONE)]), Rgb::ZERO, "a lamp by the user's word");
    // One texel in 1024 shines, and makes a mean of some 0.02.
    let mut json = textured();
    let mut led = image::RgbImage::new(32, 32);
    led.put_pixel(5, 5, image::Rgb([255; 3]));
    let mut file = std::io::Cursor::new(Vec::new());
    led.write_to(&mut file, image::ImageFormat::Png).unwrap();
    json["images"][0]["uri"] = json!(uri(file.get_ref()));
    json["materials"][0]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] =
        json!(20);
    assert_eq!(sky(&json, vec![]), Rgb::ONE, "a display");
}
