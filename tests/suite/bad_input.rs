//! Files that are damaged or hostile, in the formats that are not OBJ: each is refused with its place, the cause
//! and what to do, or gives a picture with one warning. Nothing is allocated because a file says so.

use assert_cmd::Command;
use insta::assert_snapshot;
use serde_json::{Value, json};
use std::fs;

/// A file, or a model with the files beside it.
struct Bad {
    name: String,
    files: Vec<(String, Vec<u8>)>,
}

impl Bad {
    /// What is wrong, the ending of the model's name, and its bytes.
    fn new(wrong: &str, ending: &str, bytes: impl Into<Vec<u8>>) -> Bad {
        let name = format!("{}.{ending}", wrong.replace(' ', "-"));
        Bad { files: vec![(name.clone(), bytes.into())], name }
    }

    fn beside(mut self, name: &str, bytes: impl Into<Vec<u8>>) -> Bad {
        self.files.push((name.into(), bytes.into()));
        self
    }

    /// Draws it in a folder of its own: whether that succeeds, and what is said on standard error.
    fn draw(&self) -> (bool, String) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let inner = folder.path().join("folder");
        fs::create_dir(&inner).expect("a folder");
        for (name, bytes) in &self.files {
            fs::write(inner.join(name), bytes).expect("a file");
        }
        let mut command = limited();
        command.current_dir(&inner).args(["render", &self.name, "-o", "a.png"]);
        command.args(["--size", "8x6", "--levels", "0", "--samples", "4", "--threads", "1"]);
        let output = command.output().expect("the program runs");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        let code = output.status.code();
        assert!(matches!(code, Some(0 | 2)), "{}: {code:?}: {said}", self.name);
        assert!(said.chars().all(|c| c == '\n' || !c.is_control()), "{}: {said:?}", self.name);
        assert_eq!(inner.join("a.png").exists(), code == Some(0), "{}: {said}", self.name);
        (code == Some(0), said)
    }
}

/// The program, with 2 GB of address space where that can be limited: more than it needs, less than the files
/// announce.
fn limited() -> Command {
    let program = assert_cmd::cargo::cargo_bin("isolux");
    if cfg!(not(target_os = "linux")) {
        return Command::new(program);
    }
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -v 2000000; exec \"$0\" \"$@\""]).arg(program);
    command
}

/// What is said about each of the files, all of which are refused.
fn refusals(all: Vec<Bad>) -> String {
    let mut text = String::new();
    for bad in all {
        let (drawn, said) = bad.draw();
        let stem = bad.name.split('.').next().expect("a name");
        assert!(
            !drawn && said.starts_with("error: ") && said.contains("\n  help: "),
            "{}: {said}",
            bad.name
        );
        assert!(said.contains(stem), "no place: {said}");
        text += &said;
    }
    text
}

/// What is said about each of the files, all of which are drawn: at most one warning.
fn warnings(all: Vec<Bad>) -> String {
    let mut text = String::new();
    for bad in all {
        let (drawn, said) = bad.draw();
        assert!(drawn && !said.contains("error: "), "{}: {said}", bad.name);
        // A triangle alone does not shine, and may lie flat.
        let is_about_it =
            |line: &&str| !line.contains("sky of radiance 1") && !line.contains("drawn with z up");
        let about: Vec<&str> = said.lines().filter(is_about_it).collect();
        assert!(about.len() <= 1, "{}: {said}", bad.name);
        let about = about.first().copied().unwrap_or("(nothing)");
        text += &format!("{}: {about}\n", bad.name);
    }
    text
}

/// A triangle of f32, and its indices as bytes.
fn triangle_bytes() -> Vec<u8> {
    let numbers = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut bytes: Vec<u8> = numbers.into_iter().flat_map(f32::to_le_bytes).collect();
    bytes.extend([0, 1, 2, 0]);
    bytes
}

fn triangle_gltf() -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0, "baseColorFactor": [1, 1, 1, 1]}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 36, "componentType": 5121, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 40}],
        "buffers": [{"byteLength": 40, "uri": "a.bin"}],
    })
}

/// The triangle with one value changed or added.
fn edited(wrong: &str, place: &str, value: Value) -> Bad {
    let mut json = triangle_gltf();
    let (parent, key) = place.rsplit_once('/').expect("a pointer");
    let parent = json.pointer_mut(parent).expect("a place");
    match key.parse::<usize>() {
        Ok(index) => parent[index] = value,
        Err(_) => parent[key] = value,
    }
    Bad::new(wrong, "gltf", json.to_string()).beside("a.bin", triangle_bytes())
}

fn glb(json: &Value, lengths: [u32; 3]) -> Vec<u8> {
    let text = json.to_string().into_bytes();
    let [whole, first, second] = lengths;
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((28 + text.len() as u32 + 40 + whole).to_le_bytes());
    for (kind, chunk, more) in [(b"JSON", text, first), (b"BIN\0", triangle_bytes(), second)] {
        bytes.extend((chunk.len() as u32).wrapping_add(more).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

fn glbs() -> Vec<Bad> {
    let mut json = triangle_gltf();
    json["buffers"][0] = json!({"byteLength": 40});
    let whole = glb(&json, [0; 3]);
    vec![
        Bad::new("empty", "glb", ""),
        Bad::new("cut in the header", "glb", &whole[..9]),
        Bad::new("cut in the JSON", "glb", &whole[..100]),
        Bad::new("cut in the data", "glb", &whole[..whole.len() - 4]),
        Bad::new("longer than its file", "glb", glb(&json, [1, 0, 0])),
        Bad::new("JSON of 4 GB", "glb", glb(&json, [0, u32::MAX - 1000, 0])),
        Bad::new("data of 4 GB", "glb", glb(&json, [0, 0, u32::MAX - 1000])),
        Bad::new(
            "not text",
            "glb",
            whole.iter().map(|b| if *b == b'{' { 0xff } else { *b }).collect::<Vec<u8>>(),
        ),
    ]
}

#[test]
fn damaged_gltf_is_refused_with_its_place() {
    let deep =
        format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"extras\": {}", "[".repeat(100_000));
    let nan: Vec<u8> = triangle_bytes()
        .into_iter()
        .enumerate()
        .map(|(k, b)| if k / 4 == 4 { 0xff } else { b })
        .collect();
    let wrong_corner = [&triangle_bytes()[..36], &[0, 1, 9, 0]].concat();
    let sparse = json!({"count": 4294967296u64, "indices": {"bufferView": 0, "componentType": 5121}, "values": {"bufferView": 0}});
    let huge = json!({"componentType": 5126, "count": 4294967296u64, "type": "VEC3"});
    let instances = json!({"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 7}}});
    let files = vec![
        Bad::new("no JSON", "gltf", ""),
        Bad::new("cut JSON", "gltf", &triangle_gltf().to_string()[..200]),
        Bad::new("nested too deep", "gltf", deep),
        edited("its own child", "/nodes/0/children", json!([0])),
        edited("no such mesh", "/nodes/0/mesh", json!(4294967296u64)),
        edited("no such scene", "/scene", json!(5)),
        edited("too many corners", "/accessors/0/count", json!(4294967296u64)),
        edited("count below zero", "/accessors/0/count", json!(-3)),
        edited("count of 1e300", "/accessors/0/count", json!(1e300)),
        edited("corners without a buffer", "/accessors/0", huge),
        edited("sparse without end", "/accessors/0/sparse", sparse),
        edited("offset past the end", "/accessors/0/byteOffset", json!(8)),
        edited("offset without end", "/accessors/0/byteOffset", json!(u64::MAX)),
        edited("stride without end", "/bufferViews/0/byteStride", json!(u64::MAX)),
        edited("view too long", "/bufferViews/0/byteLength", json!(41)),
        edited("buffer of an exabyte", "/buffers/0/byteLength", json!(1u64 << 60)),
        edited("missing buffer", "/buffers/0/uri", json!("none.bin")),
        edited(
            "data that is not base64",
            "/buffers/0/uri",
            json!("data:application/octet-stream;base64,%%%%"),
        ),
        edited("data without a comma", "/buffers/0/uri", json!("data:AAAA")),
        edited("buffer that is a folder", "/buffers/0/uri", json!(".")),
        edited(
            "buffer in the network",
            "/buffers/0/uri",
            json!("https://example.org/\u{1b}[31m.bin"),
        ),
        edited("name with escapes", "/meshes/0/name", json!("\u{1b}]0;x\u{7}"))
            .beside("a.bin", wrong_corner.clone()),
        edited("corner of NaN", "/asset", json!({"version": "2.0"})).beside("a.bin", nan),
        edited("corner that is not there", "/asset", json!({"version": "2.0"}))
            .beside("a.bin", wrong_corner),
        edited("instances of nothing", "/nodes/0/extensions", instances),
        edited("extension with escapes", "/extensionsRequired", json!(["\u{1b}[31m"])),
    ];
    assert_snapshot!("bad-gltf", refusals(files.into_iter().chain(glbs()).collect()));
}

const POSITIONS: &str = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
const FACE: &str = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";

/// A text PLY file; the header after the format, and the rest.
fn ply(wrong: &str, header: &str, body: &str) -> Bad {
    Bad::new(wrong, "ply", format!("ply\nformat ascii 1.0\n{header}{body}"))
}

fn binary_ply(wrong: &str, header: &str, body: &[u8]) -> Bad {
    let header = format!("ply\nformat binary_little_endian 1.0\n{header}");
    Bad::new(wrong, "ply", [header.as_bytes(), body].concat())
}

#[test]
fn damaged_ply_is_refused_with_its_place() {
    let triangle = format!("{POSITIONS}{FACE}");
    let corners = &triangle_bytes()[..36];
    let many = POSITIONS.replace("vertex 3", "vertex 4294967296");
    let lists = POSITIONS.replace("float z", "list uint float z");
    let files = vec![
        Bad::new("only a word", "ply", "ply"),
        Bad::new("header cut", "ply", "ply\nformat ascii 1.0\nelement vertex 3\n"),
        ply("unknown type", "element vertex 3\nproperty \u{1b}[31m x\nend_header\n", ""),
        ply("too many corners", &format!("{many}{FACE}"), "0 0 0\n"),
        ply(
            "too many faces",
            &triangle.replace("face 1", "face 18446744073709551615"),
            "0 0 0\n1 0 0\n0 1 0\n",
        ),
        ply(
            "more than any number",
            &triangle.replace("face 1", "face 99999999999999999999999"),
            "0 0 0\n",
        ),
        ply("corner of NaN", &triangle, "0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n"),
        ply("corner of infinity", &triangle, "0 0 0\n1 inf 0\n0 1 0\n3 0 1 2\n"),
        ply("corner that is not there", &triangle, "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n"),
        ply("corner below zero", &triangle, "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n"),
        ply("face without end", &triangle, "0 0 0\n1 0 0\n0 1 0\n4294967296 0 1 2\n"),
        ply("word with escapes", &triangle, "0 0 0\n1 \u{1b}[31m 0\n0 1 0\n3 0 1 2\n"),
        ply("no faces", &format!("{POSITIONS}end_header\n"), "0 0 0\n1 0 0\n0 1 0\n"),
        binary_ply("cut in a corner", &triangle, &corners[..30]),
        binary_ply("cut in a face", &triangle, &[corners, &[3, 0, 0, 0, 0, 1, 0, 0]].concat()),
        binary_ply("list of 4 GB", &format!("{lists}{FACE}"), &[0xff; 64]),
        binary_ply(
            "binary corner that is not there",
            &triangle,
            &[corners, &[3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0x80]].concat(),
        ),
    ];
    assert_snapshot!("bad-ply", refusals(files));
}

#[test]
fn damaged_stl_is_refused_with_its_place() {
    let record = |x: f32| {
        let mut record: Vec<u8> = [[0.0; 3], [0.0, 0.0, 0.0], [x, 0.0, 0.0], [0.0, 1.0, 0.0]]
            .concat()
            .into_iter()
            .flat_map(f32::to_le_bytes)
            .collect();
        record.extend([0; 2]);
        record
    };
    let binary =
        |count: u32, records: &[u8]| [&[b' '; 80][..], &count.to_le_bytes(), records].concat();
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
    let files = vec![
        Bad::new("empty", "stl", ""),
        Bad::new("no triangles", "stl", binary(0, &[])),
        Bad::new("4 billion triangles", "stl", binary(u32::MAX, &record(1.0))),
        Bad::new("cut in a triangle", "stl", binary(1, &record(1.0)[..30])),
        Bad::new("corner of NaN", "stl", binary(1, &record(f32::NAN))),
        Bad::new("corner of infinity", "stl", binary(1, &record(f32::INFINITY))),
        Bad::new("cut in a facet", "stl", &text[..60]),
        Bad::new("two numbers", "stl", text.replace("vertex 1 0 0", "vertex 1 0")),
        Bad::new("word with escapes", "stl", text.replace("vertex 1 0 0", "vertex 1 \u{1b}[31m 0")),
        Bad::new("statement with escapes", "stl", text.replace("outer loop", "\u{1b}[31m")),
    ];
    assert_snapshot!("bad-stl", refusals(files));
}

#[test]
fn what_does_not_matter_to_the_shape_is_a_warning() {
    let triangle = format!("{POSITIONS}{FACE}");
    let body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let textured = |picture: Value| {
        let mut json = triangle_gltf();
        json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(0);
        json["accessors"][0]["type"] = json!("VEC3");
        json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
        json["textures"] = json!([{"source": 0}]);
        json["images"] = json!([picture]);
        json["accessors"]
            .as_array_mut()
            .expect("a list")
            .push(json!({"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC2"}));
        json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(2);
        json.to_string()
    };
    let gltf = |wrong: &str, picture: Value| {
        Bad::new(wrong, "gltf", textured(picture)).beside("a.bin", triangle_bytes())
    };
    let unknown = triangle
        .replace(
            "element face",
            "property uchar confidence\nelement edge 1\nproperty list uchar \
                  double weights\nelement face",
        )
        .replace("end_header", "property short material\nend_header");
    let files = vec![
        gltf("no such picture", json!({"uri": "none.png"})),
        gltf("picture of no bytes", json!({})),
        gltf("picture past the end", json!({"bufferView": 9})),
        gltf("picture of other bytes", json!({"bufferView": 0})),
        gltf("picture with escapes", json!({"uri": "\u{1b}[31m.png"})),
        gltf("picture of 10 gigapixels", json!({"uri": "huge.png"})).beside("huge.png", huge_png()),
        edited("buffer outside", "/buffers/0/uri", json!("../folder/a.bin")),
        edited("material with escapes", "/materials/0/name", json!("\u{1b}]0;x\u{7}")),
        edited("no such material", "/meshes/0/primitives/0/material", json!(4294967296u64)),
        ply("unknown properties", &unknown, "0 0 0 9\n1 0 0 9\n0 1 0 9\n2 0.5 0.5\n3 0 1 2 -7\n"),
        Bad::new(
            "more than it says",
            "stl",
            [&[b' '; 80][..], &1u32.to_le_bytes(), &triangle_record(), b"rest"].concat(),
        ),
        ply("other text behind it", &triangle, &format!("{body}and more\n")),
    ];
    assert_snapshot!("odd-models", warnings(files));
}

/// A triangle of a binary STL file.
fn triangle_record() -> Vec<u8> {
    [&[0; 12][..], &triangle_bytes()[..36], &[0; 2]].concat()
}

/// The head of a PNG picture of 100,000 × 100,000 pixels.
fn huge_png() -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec();
    bytes.extend(100_000u32.to_be_bytes());
    bytes.extend(100_000u32.to_be_bytes());
    bytes.extend([8, 6, 0, 0, 0]);
    let checksum = crc32fast::hash(&bytes[12..]);
    bytes.extend(checksum.to_be_bytes());
    bytes.extend(b"\0\0\0\0IDAT\x35\xaf\x06\x1e\0\0\0\0IEND\xae\x42\x60\x82");
    bytes
}

/// The head of a picture without its pixels.
fn head(bytes: &[u8], length: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes.resize(length, 0);
    bytes
}

#[test]
fn pictures_that_are_damaged_or_too_large_are_left_out_with_a_warning() {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    let picture = |wrong: &str, name: &str, bytes: Vec<u8>| {
        let mtl = format!("newmtl a\nKd 0.5 0.5 0.5\nmap_Kd {name}\n");
        Bad::new(wrong, "obj", obj).beside("a.mtl", mtl).beside(name, bytes)
    };
    let mut png = std::io::Cursor::new(Vec::new());
    let pixels =
        image::RgbImage::from_fn(16, 16, |x, y| image::Rgb([(x * y) as u8, (x ^ y) as u8, 7]));
    pixels.write_to(&mut png, image::ImageFormat::Png).expect("a picture");
    let png = png.into_inner();
    let jpeg =
        b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\x03\x01\x11\0\x02\x11\x01\x03\x11\x01\xff\xd9";
    let bmp = [
        &b"BM"[..],
        &[0; 8],
        &54u32.to_le_bytes(),
        &40u32.to_le_bytes(),
        &100_000u32.to_le_bytes(),
        &100_000u32.to_le_bytes(),
        &[1, 0, 24, 0],
    ]
    .concat();
    let files = vec![
        picture("huge png", "huge.png", huge_png()),
        picture(
            "huge tga",
            "huge.tga",
            head(b"\0\0\x02\0\0\0\0\0\0\0\0\0\xff\xff\xff\xff\x18\0", 18),
        ),
        picture("huge bmp", "huge.bmp", head(&bmp, 54)),
        picture("huge jpeg", "huge.jpg", jpeg.to_vec()),
        picture("cut png", "cut.png", png[..png.len() / 2].to_vec()),
        picture("empty png", "empty.png", vec![]),
        picture("text as png", "text.png", b"hello".to_vec()),
        picture("gif", "a.gif", b"GIF89a\x01\0\x01\0\0\0\0;".to_vec()),
        picture("name with escapes", "\u{1b}[31m.png", b"hello".to_vec()),
    ];
    assert_snapshot!("bad-pictures", warnings(files));
}
