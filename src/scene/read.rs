//! Reads a model of any format that isolux knows.

use super::model::Model;
use super::obj;
use crate::error::{Error, Result};
use std::path::Path;

/// The formats, by the endings of their files' names.
pub(crate) const FORMATS: [&str; 1] = ["obj"];

/// Whether a file's name ends like that of a model.
pub(crate) fn is_model(path: &Path) -> bool {
    ending(path).is_some_and(|ending| FORMATS.contains(&ending.as_str()))
}

/// Reads the model at `path`, with the files that it names.
///
/// A scene description overrides the reflectance of the materials whose name `overrides`.
///
/// # Errors
/// See the readers; or a file whose name ends like none of [`FORMATS`].
pub(crate) fn load(path: &Path, overrides: impl Fn(&str) -> bool) -> Result<Model> {
    match ending(path).as_deref() {
        Some("obj") => obj::load(path, overrides),
        _ => Err(Error::new("this is not a model")
            .in_file(path)
            .remedy(format!("the formats that are read: {}", FORMATS.join(", ")))),
    }
}

fn ending(path: &Path) -> Option<String> {
    path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase)
}
