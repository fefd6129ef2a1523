//! What fuzzing begins with: the shipped scenes, and small files that use what a reader knows.

use image::{DynamicImage, ImageFormat, RgbImage};
use isolux::plan::Plan;
use isolux::settings::{LightSettings, PatchSettings, Settings, Solver};
use isolux::solution::Solution;
use isolux::two_level::Share;
use isolux::{Document, Tracer};
use std::fs;
use std::io::Cursor;
use std::path::Path;

/// Longer files are too slow to begin with.
const LONGEST: u64 = 6000;

/// The files that a target begins with; `scenes` is the folder of the shipped ones.
pub(crate) fn seeds(target: &str, scenes: &Path) -> Vec<Vec<u8>> {
    let text = |texts: &[&str]| texts.iter().map(|text| text.as_bytes().to_vec()).collect();
    let mut seeds: Vec<Vec<u8>> = match target {
        "obj" => text(&OBJ),
        "mtl" => text(&MTL),
        "ply" => [text(&PLY), vec![ply(true), ply(false)]].concat(),
        "stl" => vec![STL.into(), stl()],
        "gltf" => text(&GLTF),
        "glb" => GLTF.iter().map(|json| glb(json)).collect(),
        "toml" => text(&TOML),
        "texture" => pictures(),
        "light" => vec![light(scenes, "furnace.toml"), light(scenes, "pierced-screen.toml")],
        "part" => vec![part(scenes, "furnace.toml")],
        "draw" => drawn(),
        _ => Vec::new(),
    };
    if ["obj", "mtl", "ply", "gltf", "toml"].contains(&target) {
        seeds.extend(shipped(scenes, target));
    }
    seeds
}

/// The shipped files whose names have this ending.
fn shipped(scenes: &Path, ending: &str) -> Vec<Vec<u8>> {
    let mut files: Vec<_> = fs::read_dir(scenes)
        .expect("the shipped scenes")
        .map(|entry| entry.expect("a file").path())
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .filter(|path| fs::metadata(path).is_ok_and(|kind| kind.len() <= LONGEST))
        .collect();
    files.sort();
    files.iter().map(|path| fs::read(path).expect("a file")).collect()
}

const OBJ: [&str; 2] = [
    "mtllib s.mtl\no a\nv 0 0 0\nv 1 0 0 1\nv 1 1 0 .5 .5 .5\nv 0 1 0\nvt 0 0\nvt 1 0 0\nvn 0 0 1\n\
     usemtl a\ns 1\nf 1/1/1 2/2/1 3//1\ng b c\nusemtl b\nf -4 -3 -2 \\\n-1\nl 1 2\np 1\n",
    "# Ring\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nv 0 0 1e-3\nf 1 2 3 4 5\nf 1 2 6\nf 1 2 3 4 5\n",
];

const MTL: [&str; 2] = [
    "newmtl a\nKd .5 .4 .3\nKe 0 0 0\nd 0.5\nNs 10\nillum 2\nmap_Kd -s 2 2 1 -o .5 0 0 t.png\n\
     newmtl b\nKe 3 2 1\nTf 1 1 1\nTr .1\nmap_d -imfchan l t.png\n",
    "newmtl a\nKd spectral f.rfl 1\nmap_Ke -clamp on -mm 0 2 t.png\nmap_Bump -bm 1 t.png\nNi 1.5\nPr 1\n\
     newmtl b\nKd xyz .3 .4 .5\nKa 1 1 1\nmap_Kd ..\\t.png\n",
];

const PLY: [&str; 2] = [
    "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\nproperty float x\nproperty float y\n\
     property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\n\
     property float t\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
     0 0 0 255 0 0 0 0\n1 0 0 0 255 0 1 0\n1 1 0 0 0 255 1 1\n0 1 0 9 9 9 0 1\n3 0 1 2\n4 0 1 2 3\n",
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n\
     element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
     0 0 0\n1 0 0\n0 1 0\n1 1 1\n5 0 1 2 -1 3\n",
];

/// A triangle in binary, in either order of bytes.
fn ply(little: bool) -> Vec<u8> {
    let order = if little { "little" } else { "big" };
    let header = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar alpha\nelement face 1\nproperty list uchar uint vertex_indices\n\
         property list uchar float texcoord\nend_header\n"
    );
    let mut bytes = header.into_bytes();
    let word = |word: [u8; 4]| if little { word } else { [word[3], word[2], word[1], word[0]] };
    for corner in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
        bytes.extend(corner.iter().flat_map(|x| word(x.to_le_bytes())));
        bytes.push(255);
    }
    bytes.push(3);
    bytes.extend((0..3u32).flat_map(|index| word(index.to_le_bytes())));
    bytes.push(6);
    bytes.extend([0.5f32; 6].iter().flat_map(|x| word(x.to_le_bytes())));
    bytes
}

const STL: &str = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n\
                   endloop\nendfacet\nendsolid a\n";

/// Two triangles with colours, in binary.
fn stl() -> Vec<u8> {
    let mut bytes = b"COLOR=\x10\x20\x30\xff".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(2u32.to_le_bytes());
    for z in [0.0f32, 1.0] {
        let numbers = [0.0, 0.0, 1.0, 0.0, 0.0, z, 1.0, 0.0, z, 0.0, 1.0, z];
        bytes.extend(numbers.iter().flat_map(|x: &f32| x.to_le_bytes()));
        bytes.extend(0x801fu16.to_le_bytes());
    }
    bytes
}

/// The first uses what scenes are made of; the second the rest.
const GLTF: [&str; 2] = [
    r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],"nodes":[{"mesh":0,"scale":[2,2,2],
"children":[2]},{"camera":0,"translation":[0,0,5]},{"mesh":0,"rotation":[0,0,0.6,0.8],"name":"n"}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}],
"cameras":[{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}],
"materials":[{"name":"m","doubleSided":true,"alphaMode":"MASK","alphaCutoff":0.5,"emissiveFactor":[1,1,1],
"pbrMetallicRoughness":{"metallicFactor":0,"baseColorFactor":[1,0.5,0.5,0.9],
"baseColorTexture":{"index":0,"texCoord":0}},"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":5}}}],
"textures":[{"source":0,"sampler":0}],"samplers":[{"wrapS":33071,"wrapT":33648}],"images":[{"uri":"t.png"}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
{"bufferView":0,"byteOffset":36,"componentType":5121,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":40}],"buffers":[{"byteLength":40,"uri":"a.bin"}]}"#,
    r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],"skin":0,
"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0}}}}],
"skins":[{"joints":[0]}],"meshes":[{"weights":[0.5],"primitives":[{"mode":5,"attributes":{"POSITION":0,"NORMAL":0,
"COLOR_0":0},"targets":[{"POSITION":0}],"material":0},{"attributes":{"POSITION":1},"indices":2}]}],
"materials":[{"extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[1,1,1,1],"specularFactor":[0,0,0]},
"KHR_materials_transmission":{"transmissionFactor":0.5},"KHR_materials_unlit":{}},"emissiveTexture":{"index":0,
"extensions":{"KHR_texture_transform":{"offset":[0,1],"rotation":1,"scale":[2,2]}}}}],
"textures":[{"source":0}],"images":[{"bufferView":0,"mimeType":"image/png"}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},
{"componentType":5122,"normalized":true,"count":3,"type":"VEC3","sparse":{"count":1,"indices":{"bufferView":0,
"byteOffset":37,"componentType":5121},"values":{"bufferView":0}}},
{"bufferView":0,"byteOffset":36,"componentType":5121,"count":3,"type":"SCALAR"}],
"bufferViews":[{"buffer":0,"byteLength":40,"byteStride":12}],"buffers":[{"byteLength":40,
"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAECAA=="}]}"#,
];

/// The JSON with a triangle as its binary chunk.
fn glb(json: &str) -> Vec<u8> {
    let mut json = json.replace(r#","uri":"a.bin""#, "").into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut binary: Vec<u8> = corners.iter().flat_map(|x| x.to_le_bytes()).collect();
    binary.extend([0, 1, 2, 0]);
    let length = |bytes: &[u8]| (bytes.len() as u32).to_le_bytes();
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((12 + 16 + json.len() as u32 + binary.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        bytes.extend([&length(chunk)[..], kind, chunk].concat());
    }
    bytes
}

const TOML: [&str; 2] = [
    "title = \"a\"\nmodels = [\"s.obj\"]\nmetres_per_unit = 0.01\nsky = [0.8, 0.9, 1]\nup = \"z\"\n\
     [camera]\nposition = [0, 0, 5]\nlook_at = [0, 0, 0]\nup = [0, 1, 0]\nvertical_fov = 40\nnear = 0.1\n\
     [views.b]\nposition = [1, 0, 5]\nlook_at = [0, 0, 0]\n[image]\nsize = [64, 48]\nsamples = 4\n\
     exposure = 2\n[patches]\nmax_edge = 0.25\n[materials.a]\nreflectance = [0.5, 0.5, 0.5]\ntwo_sided = true\n\
     [materials.\"b*\"]\nradiance = [1, 2, 3]\n",
    "models = [\"s.obj\", \"s.obj\"]\nsky = 0.5\none_sided = true\n[patches]\nlevels = 2\n[light]\n\
     form_factors = \"pairs\"\nsamples = 9\npoints = \"sobol\"\ndirect = 4\nsolver = \"jacobi\"\n\
     tolerance = 1e-3\nmemory = 100\n",
];

/// One picture in each format, and one with a palette of grey.
fn pictures() -> Vec<Vec<u8>> {
    let colour = |x, y| image::Rgb([x as u8 * 30, y as u8 * 30, 99]);
    let picture = DynamicImage::from(RgbImage::from_fn(6, 5, colour));
    let file = |picture: &DynamicImage, format| {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).expect("it is encoded");
        bytes.into_inner()
    };
    use ImageFormat::{Bmp, Jpeg, Png, Tga, WebP};
    let mut files: Vec<_> = [Png, Jpeg, Tga, Bmp, WebP].map(|f| file(&picture, f)).into();
    files.push(file(&DynamicImage::from(picture.to_luma_alpha8()), Png));
    files.push(file(&DynamicImage::from(picture.to_rgb16()), Png));
    files.push(file(&DynamicImage::from(picture.to_luma8()), Tga));
    files.push(file(&DynamicImage::from(picture.to_rgba8()), Bmp));
    files
}

/// The quickest light of a shipped scene.
fn settings(solver: Option<Solver>) -> Settings {
    let patches = PatchSettings { levels: Some(0), max_edge: None };
    let light = LightSettings { samples: Some(4), solver, ..LightSettings::default() };
    Settings { patches, light, ..Settings::default() }
}

fn light(scenes: &Path, file: &str) -> Vec<u8> {
    let document = Document::open(scenes.join(file)).expect("a description");
    let scene = document.scene().expect("a scene");
    let tracer = Tracer::build(&scene);
    let light = Solution::solve(&document, &scene, &tracer, &settings(None), &());
    light.expect("light").to_bytes()
}

fn part(scenes: &Path, file: &str) -> Vec<u8> {
    let document = Document::open(scenes.join(file)).expect("a description");
    let scene = document.scene().expect("a scene");
    let plan = Plan::new(&document, &scene, &settings(Some(Solver::TwoLevel))).expect("a plan");
    let tracer = Tracer::build(&scene);
    let part = plan.solve_part(&tracer, Share::WHOLE, None, &mut |_| Ok(()), &());
    part.expect("light").0.to_bytes()
}

/// Small models of all formats behind the endings of their names.
fn drawn() -> Vec<Vec<u8>> {
    let named = |ending: &str, model: &[u8]| [ending.as_bytes(), b"\n", model].concat();
    let mut models: Vec<Vec<u8>> = OBJ.map(|text| named("obj", text.as_bytes())).into();
    models.extend(PLY.map(|text| named("ply", text.as_bytes())));
    models.extend(GLTF.map(|text| named("gltf", text.as_bytes())));
    models.extend([named("ply", &ply(true)), named("stl", STL.as_bytes()), named("stl", &stl())]);
    models.extend(GLTF.map(|text| named("glb", &glb(text))));
    models
}
