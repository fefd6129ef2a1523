//! Finds and reads the MTL files that an OBJ file asks for.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};

use super::ignored::default_stated;
use super::mtl_reader::Library;
use super::reader::ObjFile;
use crate::error::{Result, Warning};
use crate::scene::text::{Format, decode, quote, read_text_bytes, unread, words};

/// Reads the materials of the OBJ file at `path`; warnings are added to those of `obj`.
///
/// A file that cannot be read, or that is no text, is a warning. A material that faces use and no file
/// defines is added without values, and is a warning.
///
/// # Errors
/// A file that does not fit into memory.
pub(super) fn read_library(path: &Path, obj: &mut ObjFile) -> Result<Library> {
    let mut library = Library::default();
    let folder = path.parent().unwrap_or(Path::new(""));
    let (mut seen, mut unreadable) = (HashSet::new(), Vec::new());
    for asked in &obj.libraries {
        for file in files_of(folder, &asked.name) {
            if !seen.insert(file.clone()) {
                continue;
            }
            // Also one that cannot be read is the user's.
            if file.exists() {
                library.files.push(file.clone());
            }
            match read_text_bytes(&file) {
                Ok(bytes) => match decode(bytes, &file, Format::Mtl) {
                    Ok(text) => library.add(&file, &text, &mut obj.warnings),
                    Err(error) => unreadable.push((asked.line, file, error.cause().to_owned())),
                },
                Err(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                    return Err(unread(&file, "the material file", &error));
                }
                Err(error) => unreadable.push((asked.line, file, error.to_string())),
            }
        }
    }
    if let Some((line, file, cause)) = unreadable.first() {
        let file = quote(&file.to_string_lossy());
        let (more, default) = (counted(unreadable.len()), default_stated());
        let text = format!(
            "cannot read the material file {file}: {cause}; faces with its materials get {default}{more}"
        );
        obj.warnings.push(Warning::in_file(path, Some(*line), text));
    }
    let (mut names, mut line) = (Vec::new(), None);
    for material in &obj.materials {
        if library.find(&material.name).is_none() {
            library.add_undefined(&material.name);
            names.push(quote(&material.name));
            line.get_or_insert(material.line);
        }
    }
    if !names.is_empty() {
        obj.warnings.push(Warning::in_file(path, line, undefined(&names)));
    }
    Ok(library)
}

/// The files that `names` means. OBJ separates file names by blanks, yet many exporters write one
/// name that has blanks in it: if there is such a file, it is the one meant. A blank after a backslash is part of
/// a name too.
fn files_of(folder: &Path, names: &str) -> Vec<PathBuf> {
    let whole = locate(folder, names);
    if whole.is_file() {
        return vec![whole];
    }
    // No name holds a control character, so that one can stand for such a blank.
    let joined = names.replace("\\ ", "\0");
    let named = words(&joined).map(|name| locate(folder, &name.replace('\0', " ")));
    let parts: Vec<PathBuf> = named.collect();
    if parts.iter().any(|part| part.is_file()) { parts } else { vec![whole] }
}

/// Where `name` is, relative to the OBJ file's folder. Exporters on Windows separate folders by
/// backslashes.
fn locate(folder: &Path, name: &str) -> PathBuf {
    let plain = folder.join(name);
    let slashed = folder.join(name.replace('\\', "/"));
    if !plain.is_file() && slashed.is_file() { slashed } else { plain }
}

/// That a warning is the first of several.
fn counted(count: usize) -> String {
    if count > 1 { format!(" ({count} such files in all)") } else { String::new() }
}

fn undefined(names: &[String]) -> String {
    const LISTED: usize = 8;
    let default = default_stated();
    if let [name] = names {
        return format!("no MTL file defines the material {name}: its faces get {default}");
    }
    let more = if names.len() > LISTED { ", …" } else { "" };
    let listed = names[..names.len().min(LISTED)].join(", ");
    format!(
        "no MTL file defines {} of the materials: {listed}{more}; their faces get {default}",
        names.len()
    )
}
