//! The formats of models by the endings of their files' names.

use super::text::{read_bytes, unread};
use crate::error::Result;
use std::path::Path;

/// The formats, by the endings of their files' names.
pub(crate) const FORMATS: [&str; 5] = ["obj", "gltf", "glb", "ply", "stl"];

/// Whether a file's name ends like that of a model.
pub(crate) fn is_model(path: &Path) -> bool {
    ending(path).is_some_and(|ending| FORMATS.contains(&ending.as_str()))
}

/// The remedy for a model of a format that is not read.
pub(super) const EXPORT: &str =
    "open it in the program it comes from, or in Blender, and export it as glTF (.glb)";

/// The endings that are read, for messages.
pub(super) fn endings() -> String {
    FORMATS.map(|ending| format!(".{ending}")).join(", ")
}

/// The bytes of the model at `path`.
pub(super) fn model_bytes(path: &Path) -> Result<Vec<u8>> {
    read_bytes(path).map_err(|error| unread(path, "the model", &error))
}

/// The ending of a file's name, in lower case.
pub(super) fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase)
}
