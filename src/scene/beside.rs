//! The files that a model names, which are looked for beside it.

use crate::error::{Error, Result, Warning};
use crate::scene::text::{quote, read_bytes, unread};
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;
use std::io;
use std::path::{Component, Path, PathBuf};

/// Reads what a model names, relative to it, and keeps a record.
pub(super) struct Files<'a> {
    model: &'a Path,
    pub read: Vec<PathBuf>,
    pub warnings: Vec<Warning>,
    /// Names of files outside the model's folder: the first, and how many.
    outside: Option<(String, usize)>,
}

impl<'a> Files<'a> {
    pub(super) fn new(model: &'a Path) -> Self {
        Files { model, read: Vec::new(), warnings: Vec::new(), outside: None }
    }

    /// The bytes of a URI, which may hold them itself.
    pub(super) fn uri(&mut self, uri: &str) -> Result<Vec<u8>> {
        if let Some(data) = uri.strip_prefix("data:") {
            return data_uri(data);
        }
        if uri.contains("://") && !uri.starts_with("file://") {
            return Err(Error::new(format!("{} is not a file", quote(uri)))
                .remedy("download it, and name it relative to the model"));
        }
        let decoded = percent_decode_str(uri.trim_start_matches("file://")).decode_utf8_lossy();
        self.file(&decoded)
    }

    /// The bytes of a file.
    pub(super) fn file(&mut self, name: &str) -> Result<Vec<u8>> {
        // Windows programs write backslashes.
        let name = name.replace('\\', "/");
        let relative = Path::new(&name);
        let leaves = |part| !matches!(part, Component::Normal(_) | Component::CurDir);
        if relative.components().any(leaves) {
            let (_, count) = self.outside.get_or_insert_with(|| (quote(&name), 0));
            *count += 1;
        }
        let path = self.model.parent().unwrap_or(Path::new("")).join(relative);
        let bytes = read_bytes(&path).map_err(|error| match error.kind() {
            io::ErrorKind::OutOfMemory => unread(&path, "the file", &error),
            _ => Error::new(format!("cannot read {}: {error}", quote(&name)))
                .remedy("put the file where the model looks for it"),
        })?;
        if !self.read.contains(&path) {
            self.read.push(path);
        }
        Ok(bytes)
    }
}

impl Files<'_> {
    /// All warnings about files, when all have been read.
    pub(super) fn take_warnings(&mut self) -> Vec<Warning> {
        let said = self.outside.take().map(|(first, count)| {
            let more = if count > 1 { format!(" ({count} in all)") } else { String::new() };
            let text = format!("the model reads {first}, which is outside its folder{more}");
            Warning::in_file(self.model, None, text)
        });
        let mut warnings: Vec<Warning> = said.into_iter().collect();
        warnings.append(&mut self.warnings);
        warnings
    }
}

/// What follows `data:`.
fn data_uri(data: &str) -> Result<Vec<u8>> {
    let broken = |why: &str| {
        Error::new(format!("a data URI is malformed: {why}")).remedy("export the model again")
    };
    let (kind, data) = data.split_once(',').ok_or_else(|| broken("it has no comma"))?;
    if !kind.ends_with(";base64") {
        return Ok(percent_decode_str(data).collect());
    }
    let config = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    GeneralPurpose::new(&STANDARD, config).decode(data).map_err(|e| broken(&e.to_string()))
}
