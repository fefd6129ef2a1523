//! What a file's first bytes say that it is, whatever its name says.

use super::formats::{EXPORT, endings};
use super::text::is_ordinary;
use crate::error::Error;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// What a file is, as its first bytes show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Content {
    /// With its article, for messages.
    name: &'static str,
    /// The endings under which it is read; none if it is not.
    pub endings: &'static [&'static str],
    /// What to do with a format that is not read.
    remedy: &'static str,
}

const fn read(name: &'static str, endings: &'static [&'static str]) -> Content {
    Content { name, endings, remedy: "" }
}

const fn foreign(name: &'static str) -> Content {
    Content { name, endings: &[], remedy: EXPORT }
}

const fn picture(name: &'static str) -> Content {
    Content { name, endings: &[], remedy: "" }
}

const OBJ: Content = read("an OBJ model", &["obj"]);
const GLTF: Content = read("a glTF model", &["gltf", "glb"]);
const STL: Content = read("an STL model", &["stl"]);

/// By the first bytes.
const MAGIC: [(&[u8], Content); 14] = [
    (b"glTF", read("a binary glTF model", &["glb", "gltf"])),
    (b"ply\n", read("a PLY model", &["ply"])),
    (b"ply\r", read("a PLY model", &["ply"])),
    (b"\x89PNG", picture("a PNG picture")),
    (b"\xff\xd8\xff", picture("a JPEG picture")),
    (
        b"PK\x03\x04",
        Content {
            name: "a ZIP archive",
            endings: &[],
            remedy: "unpack it, and name the model in it",
        },
    ),
    (
        b"\x1f\x8b",
        Content {
            name: "a gzip archive",
            endings: &[],
            remedy: "unpack it, and name the model in it",
        },
    ),
    (
        b"version https://git-lfs",
        Content {
            name: "a pointer of Git LFS",
            endings: &[],
            remedy: "fetch the file itself with `git lfs pull`",
        },
    ),
    (b"Kaydara FBX", foreign("an FBX model")),
    (b"; FBX", foreign("an FBX model")),
    (b"BLENDER", foreign("a Blender file")),
    (b"ISO-10303-21", foreign("a STEP model")),
    (b"PXR-USDC", foreign("a USD model")),
    (b"#usda", foreign("a USD model")),
];

/// As many bytes as show it.
const HEAD: usize = 1024;

/// What the file at `path` is; `None` where it cannot be read or says nothing clear.
pub(super) fn content_of(path: &Path) -> Option<Content> {
    // Opening a pipe may wait for ever.
    if !is_ordinary(path) {
        return None;
    }
    let mut head = Vec::new();
    File::open(path).ok()?.take(HEAD as u64).read_to_end(&mut head).ok()?;
    content(&head)
}

fn content(head: &[u8]) -> Option<Content> {
    let magic = MAGIC.iter().find(|(magic, _)| head.starts_with(magic));
    magic.map(|(_, content)| *content).or_else(|| text(&String::from_utf8_lossy(head)))
}

fn text(head: &str) -> Option<Content> {
    let head = head.trim_start_matches('\u{feff}').trim_start();
    if head.starts_with("<") {
        return head.contains("<COLLADA").then(|| foreign("a COLLADA model"));
    }
    if head.starts_with('{') {
        return head.contains("\"asset\"").then_some(GLTF);
    }
    if head.to_ascii_lowercase().starts_with("solid") && head.contains("facet") {
        return Some(STL);
    }
    // An OBJ file has no magic; a vertex or a name of materials is its sign.
    let vertex = |line: &str| {
        let mut words = line.split_ascii_whitespace();
        words.next() == Some("v") && words.next().is_some_and(|x| x.parse::<f64>().is_ok())
    };
    let statement = |line: &str| line.starts_with("mtllib ") || vertex(line);
    head.lines().any(statement).then_some(OBJ)
}

impl Content {
    /// The refusal of a file of this content whose name ends otherwise, in `ending`.
    pub(super) fn refusal(self, path: &Path, ending: &str) -> Error {
        let cause = match ending {
            "" => format!("this is {}", self.name),
            _ => format!("this is {}, though its name ends in .{ending}", self.name),
        };
        let remedy = match (self.endings, self.remedy) {
            ([first, ..], _) => format!("rename it to end in .{first}"),
            ([], "") => format!("name a model: {}", endings()),
            ([], remedy) => remedy.to_owned(),
        };
        Error::new(cause).in_file(path).remedy(remedy)
    }
}
