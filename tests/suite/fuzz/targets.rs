//! What is fuzzed: one target per reader of files from outside, and one that draws what was read.
//!
//! The test suite gives the targets mutations of seeds, and `tests/fuzz` gives them what a coverage-guided fuzzer
//! finds. Both need this file alone and `seeds.rs`.

use isolux::patches::{PatchId, PatchMesh, Subdivision};
use isolux::plan::Plan;
use isolux::settings::{LightSettings, PatchSettings, Settings};
use isolux::two_level::{Part, join};
use isolux::{Document, Frame, Scene, Solution, Tracer};
use std::fs;
use std::path::Path;

/// A reader and how it is given a file's bytes.
pub(crate) struct Target {
    pub name: &'static str,
    /// Words that mean something to the reader, in the form that AFL++ reads.
    pub dictionary: &'static str,
    run: fn(&Path, &[u8]) -> isolux::Result<()>,
}

macro_rules! dictionary {
    ($name:literal) => {
        include_str!(concat!("../../fuzz/dictionaries/", $name, ".dict"))
    };
}

/// All of them.
pub(crate) const TARGETS: [Target; 11] = [
    Target { name: "obj", dictionary: dictionary!("obj"), run: obj },
    Target { name: "mtl", dictionary: dictionary!("mtl"), run: mtl },
    Target { name: "ply", dictionary: dictionary!("ply"), run: ply },
    Target { name: "stl", dictionary: dictionary!("stl"), run: stl },
    Target { name: "gltf", dictionary: dictionary!("gltf"), run: gltf },
    Target { name: "glb", dictionary: dictionary!("gltf"), run: glb },
    Target { name: "toml", dictionary: dictionary!("toml"), run: description },
    Target { name: "texture", dictionary: dictionary!("texture"), run: texture },
    Target { name: "light", dictionary: dictionary!("light"), run: light },
    Target { name: "part", dictionary: dictionary!("light"), run: part },
    Target { name: "draw", dictionary: dictionary!("obj"), run: draw },
];

pub(crate) fn target(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}

impl Target {
    /// Gives the reader a file with these bytes; `folder` is for it alone. An error is as good an end as any.
    ///
    /// # Panics
    /// If the reader does, if what it says is too long, or if it takes too much memory.
    pub(crate) fn run(&self, folder: &Path, bytes: &[u8]) {
        within_memory(bytes.len(), || {
            if let Err(error) = (self.run)(folder, bytes) {
                assert_short(&error.to_string(), 4096);
            }
        });
    }
}

/// Does what needs memory for a file of some bytes.
///
/// # Panics
/// If that was more than it should be.
pub(crate) fn within_memory(file: usize, read: impl FnOnce()) {
    let before = memory_now();
    read();
    if let (Some(before), Some(peak)) = (before, memory_peak()) {
        let took = peak.saturating_sub(before);
        let allowed = BASE + 100 * file as u64;
        assert!(took <= allowed, "{took} bytes were taken for a file of {file}");
    }
}

/// Bytes that may be taken for any file: the largest picture that is read has 2²⁶ pixels, and is held three times
/// over while it is decoded, four bytes per pixel.
const BASE: u64 = 3 << 28;

/// The memory that is held, in bytes, and from here on the peak; `None` except on Linux.
fn memory_now() -> Option<u64> {
    // The kernel takes "5" for: forget the peak.
    fs::write("/proc/self/clear_refs", "5").ok()?;
    memory_peak()
}

fn memory_peak() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
    Some(kibibytes * 1024)
}

/// What is said to people is bounded, whatever is in the file.
fn assert_short(text: &str, most: usize) {
    assert!(text.len() <= most, "{} bytes of messages: {:.2000}", text.len(), text);
}

/// Writes files, and reads the scene that the first of them names or is.
fn scene(folder: &Path, files: &[(&str, &[u8])]) -> isolux::Result<(Document, Scene)> {
    for (name, bytes) in files {
        fs::write(folder.join(name), bytes).expect("the folder can be written");
    }
    let document = Document::open(folder.join(files[0].0))?;
    let scene = document.scene()?;
    let warnings: String = scene.warnings.iter().map(|w| format!("{w}\n")).collect();
    assert_short(&warnings, 1 << 15);
    Ok((document, scene))
}

fn obj(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    let materials = b"newmtl a\nKd .5 .5 .5\nnewmtl b\nKe 1 1 1\nmap_Kd t.png\n";
    scene(folder, &[("s.obj", bytes), ("s.mtl", materials)]).map(drop)
}

const SQUARE: &[u8] = b"mtllib s.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 2\n\
    vt 0 1\nusemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 3/3 4/4\n";

fn mtl(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    scene(folder, &[("s.obj", SQUARE), ("s.mtl", bytes), ("t.png", DOT)]).map(drop)
}

/// A picture of one pixel.
const DOT: &[u8] =
    b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x01\0\0\0\x01\x08\x06\0\0\0\x1f\x15\xc4\x89\
    \0\0\0\rIDATx\x9cc\xf8\x7f\xe0\xff\x7f\0\t>\x03\xbe\x91\xf9\x84\xc3\0\0\0\0IEND\xaeB`\x82";

fn ply(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    scene(folder, &[("s.ply", bytes), ("t.png", DOT)]).map(drop)
}

fn stl(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    scene(folder, &[("s.stl", bytes)]).map(drop)
}

/// What a glTF file may name: three positions and three indices, and a picture.
const BUFFER: &[u8] =
    b"\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x80\x3f\0\0\0\0\0\x01\x02\0";

fn gltf(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    scene(folder, &[("s.gltf", bytes), ("a.bin", BUFFER), ("t.png", DOT)]).map(drop)
}

fn glb(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    scene(folder, &[("s.glb", bytes), ("a.bin", BUFFER), ("t.png", DOT)]).map(drop)
}

/// The description, and what its settings are understood as.
fn description(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    let materials = b"newmtl a\nKd .5 .5 .5\nnewmtl b\nKe 1 1 1\n";
    let files = [("s.toml", bytes), ("s.obj", SQUARE), ("s.mtl", materials)];
    let (document, scene) = scene(folder, &files)?;
    Plan::new(&document, &scene, &Settings::default()).map(drop)
}

/// A picture on a square, as its colour, its light and its holes. TGA is what no other format's first bytes are.
fn texture(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    let materials = b"newmtl a\nmap_Kd t.tga\nmap_d t.tga\nnewmtl b\nmap_Ke t.tga\n";
    let files = [("s.obj", SQUARE), ("s.mtl", materials), ("t.tga", bytes)];
    let (_, scene) = scene(folder, &files)?;
    let patches = PatchMesh::subdivide(&scene, Subdivision::Levels(0))?;
    let reflectances = (0..patches.len() as u32).map(|patch| patches.reflectance(PatchId(patch)));
    assert!(reflectances.into_iter().all(|rgb| rgb.max_element() <= 1.0));
    Ok(())
}

fn light(_: &Path, bytes: &[u8]) -> isolux::Result<()> {
    let solution = Solution::from_bytes(&sealed(bytes, b"isolux light\n"))?;
    let again = Solution::from_bytes(&solution.to_bytes())?;
    assert_eq!(again.fingerprints(), solution.fingerprints());
    draw_light(&solution)
}

fn part(_: &Path, bytes: &[u8]) -> isolux::Result<()> {
    let part = Part::from_bytes(&sealed(bytes, b"isolux part\n"))?;
    draw_light(&join(vec![part])?)
}

/// The file with the checksum that its content has, so that mutations come past it.
fn sealed(bytes: &[u8], magic: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let checksum = magic.len() + 4..magic.len() + 8;
    if bytes.len() >= checksum.end {
        let sum = crc32fast::hash(&bytes[checksum.end..]);
        bytes[checksum].copy_from_slice(&sum.to_le_bytes());
    }
    bytes
}

/// A model of any format, from the file to the picture.
fn draw(folder: &Path, bytes: &[u8]) -> isolux::Result<()> {
    let Some((name, model)) = named(bytes) else { return Ok(()) };
    let files: Vec<_> = std::iter::once((&*name, model)).chain(BESIDE).collect();
    let (document, scene) = scene(folder, &files)?;
    draw_scene(&document, &scene)
}

/// A model's name and its bytes, where the first line is the ending of the name.
pub(crate) fn named(bytes: &[u8]) -> Option<(String, &[u8])> {
    let end = bytes.iter().position(|&byte| byte == b'\n')?;
    let ending = std::str::from_utf8(&bytes[..end]).ok()?;
    let is_known = ["obj", "ply", "stl", "gltf", "glb"].contains(&ending);
    is_known.then(|| (format!("s.{ending}"), &bytes[end + 1..]))
}

/// The files that such a model may name.
pub(crate) const BESIDE: [(&str, &[u8]); 3] = [
    ("s.mtl", b"newmtl a\nKd .5 .5 .5\nd .5\nnewmtl b\nKe 1 1 1\nmap_Kd t.png\n"),
    ("a.bin", BUFFER),
    ("t.png", DOT),
];

/// The least light and the smallest picture.
fn draw_scene(document: &Document, scene: &Scene) -> isolux::Result<()> {
    let patches = PatchSettings { levels: Some(0), max_edge: None };
    let light = LightSettings { samples: Some(2), direct: Some(1), ..LightSettings::default() };
    let settings = Settings { patches, light, ..Settings::default() };
    let light = Solution::solve(document, scene, &Tracer::build(scene), &settings, &())?;
    draw_light(&light)
}

fn draw_light(light: &Solution) -> isolux::Result<()> {
    let tracer = Tracer::build(light.scene());
    let frame = Frame { samples: 1, ..Frame::new(3, 2) };
    let picture = light.gathered().draw(&tracer, &light.camera, &frame, &())?;
    let exposure = light.exposure(&picture);
    assert!(exposure > 0.0 && exposure.is_finite(), "exposure {exposure}");
    assert!(picture.pixels.iter().all(|pixel| pixel.is_finite()), "{:?}", picture.pixels);
    Ok(())
}
