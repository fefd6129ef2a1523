//! Reads a model of any format that isolux knows.

use super::formats::{EXPORT, ending, endings};
use super::model::Model;
use super::{gltf, obj, ply, sniff, stl};
use crate::error::{Error, Result};
use std::path::Path;

/// Endings of formats that other programs turn into one of [`FORMATS`](super::formats::FORMATS).
const FOREIGN: [&str; 14] = [
    "3dm", "3ds", "abc", "blend", "c4d", "dae", "fbx", "ifc", "max", "skp", "step", "usd", "usdz",
    "x3d",
];

/// Reads the model at `path`, with the files that it names.
///
/// A scene description overrides the reflectance of the materials whose name `overrides`.
///
/// # Errors
/// See the readers; or a file whose name ends like none of [`FORMATS`](super::formats::FORMATS), or whose content is of another
/// format than its name says.
pub(crate) fn load(path: &Path, overrides: impl Fn(&str) -> bool) -> Result<Model> {
    let ending = ending(path).unwrap_or_default();
    if let Some(content) = sniff::content_of(path).filter(|c| !c.endings.contains(&&*ending)) {
        return Err(content.refusal(path, &ending));
    }
    match ending.as_str() {
        "obj" => obj::load(path, overrides),
        "gltf" | "glb" => gltf::load(path),
        "ply" => ply::load(path),
        "stl" => stl::load(path),
        _ => Err(refusal(path)),
    }
}

/// The refusal of a file whose name ends like that of neither a model nor a scene description.
pub(crate) fn refusal(path: &Path) -> Error {
    let ending = ending(path).unwrap_or_default();
    match sniff::content_of(path) {
        Some(content) => content.refusal(path, &ending),
        None if FOREIGN.contains(&ending.as_str()) || ending == "stp" => {
            Error::new(format!("models that end in .{ending} are not read"))
                .in_file(path)
                .remedy(EXPORT)
        }
        None => Error::new("this is neither a scene description nor a model")
            .in_file(path)
            .remedy(format!("name a .toml description or a model: {}", endings())),
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::Document;

    /// What opening and loading a file with this name and content says.
    fn message(name: &str, content: &[u8]) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let opened = Document::open(&path).and_then(|document| document.scene());
        let error = opened.unwrap_err().to_string();
        error.replace(&format!("{}/", folder.path().display()), "")
    }

    #[test]
    fn content_of_another_format_is_named_with_what_to_do() {
        for (name, content, cause, remedy) in [
            ("a.obj", b"glTF\x02\0\0\0".as_slice(), "this is a binary glTF model", "end in .glb"),
            ("a.obj", b"ply\nformat ascii 1.0\n", "this is a PLY model", "end in .ply"),
            ("a.ply", b"solid x\nfacet normal 0 0 1\n", "this is an STL model", "end in .stl"),
            ("a.stl", b"\x89PNG\r\n\x1a\n", "this is a PNG picture", "name a model: .obj"),
            ("a.obj", b"\xff\xd8\xff\xe0", "this is a JPEG picture", "name a model"),
            ("a.obj", b"PK\x03\x04", "this is a ZIP archive", "unpack it"),
            ("a.obj", b"Kaydara FBX Binary  \0", "this is an FBX model", "glTF (.glb)"),
            ("a.obj", b"; FBX 7.3.0 project file", "this is an FBX model", "glTF (.glb)"),
            (
                "a.glb",
                b"version https://git-lfs.github.com/spec/v1\n",
                "this is a pointer",
                "git lfs pull",
            ),
            ("a.ply", b"BLENDER-v300", "this is a Blender file", "glTF (.glb)"),
            ("a.ply", b"<?xml version=\"1.0\"?>\n<COLLADA>", "this is a COLLADA model", "glTF"),
            ("a.fbx", b"Kaydara FBX Binary  \0", "this is an FBX model", "glTF (.glb)"),
            ("a.ply", b"# Blender v3\no x\nv 0 0 0\n", "this is an OBJ model", "end in .obj"),
            ("a.dae", b"", "models that end in .dae are not read", "glTF (.glb)"),
            ("a.STP", b"", "models that end in .stp are not read", "glTF (.glb)"),
            ("a.txt", b"hello", "this is neither a scene description nor a model", ".obj, .gltf"),
        ] {
            let message = message(name, content);
            assert!(message.starts_with(&format!("{name}: {cause}")), "{message}");
            assert!(message.contains("\n  help: ") && message.contains(remedy), "{message}");
        }
    }

    #[test]
    fn an_obj_file_that_begins_with_a_comment_is_one_whatever_the_comment_says() {
        assert!(message("a.obj", b"# ply of glTF\nv 0 0 0\n").contains("no faces"));
    }
}
