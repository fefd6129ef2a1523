//! The JSON and the binary chunk of a glTF model.

use super::json::{Head, Root};
use crate::error::{Error, Result};
use crate::scene::text::quote;
use serde_json::Value;

/// Extensions that must be undone before a model can be read, each with how.
pub(super) const COMPRESSIONS: [(&str, &str); 4] = [
    (
        "KHR_draco_mesh_compression",
        "import it in Blender and export it without compression, or undo it with gltf-transform",
    ),
    ("EXT_meshopt_compression", "undo it with gltfpack -noq, or with gltf-transform"),
    ("KHR_meshopt_compression", "undo it with gltfpack -noq, or with gltf-transform"),
    ("KHR_texture_basisu", "undo it with gltf-transform ktxdecompress in.glb out.glb"),
];

/// Extensions that are read, or that a diffuse scene may leave aside.
const KNOWN: [&str; 8] = [
    "EXT_mesh_gpu_instancing",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",
    "MSFT_lod",
];

/// The JSON of the model, and its binary chunk if it has one.
pub(super) fn read_root(bytes: &[u8]) -> Result<(Root, Option<&[u8]>)> {
    let is_binary = bytes.starts_with(b"glTF");
    let (json, binary) = match is_binary {
        true => split(bytes)?,
        false => (bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None),
    };
    let malformed = |error: serde_json::Error| {
        let text = error.to_string();
        // Its own place is at the end, where a long text would be cut off.
        let cause = text.split(" at line ").next().unwrap_or_default();
        let column = error.column();
        let here =
            Error::new(format!("the JSON is malformed at column {column}: {}", quote(cause)));
        let here = if is_binary { here } else { here.at_line(error.line()) };
        here.remedy("export the model again")
    };
    // Other versions have other JSON.
    let Head { asset } = serde_json::from_slice(json).map_err(malformed)?;
    check_version(&match asset.version {
        Value::String(text) => text,
        Value::Null => String::new(),
        other => other.to_string(),
    })?;
    let root: Root = serde_json::from_slice(json).map_err(malformed)?;
    root.extensions_required.iter().try_for_each(|name| check_extension(name))?;
    Ok((root, binary))
}

/// A header of 12 bytes, then chunks: each has its length, its kind, and its bytes.
fn split(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>)> {
    let word = |at: usize| {
        let four = bytes.get(at..at.checked_add(4)?)?;
        Some(u32::from_le_bytes(four.try_into().expect("four bytes")))
    };
    let cut_off = || {
        Error::new("the binary glTF file ends too early")
            .remedy("the file was cut off: copy or export it again")
    };
    check_version(&word(4).ok_or_else(cut_off)?.to_string())?;
    word(8).filter(|length| *length as usize <= bytes.len()).ok_or_else(cut_off)?;
    let chunk = |at: usize| {
        let (length, kind) = (word(at)? as usize, bytes.get(at + 4..at + 8)?);
        Some((kind, bytes.get(at + 8..(at + 8).checked_add(length)?)?))
    };
    let (kind, json) = chunk(12).ok_or_else(cut_off)?;
    if kind != b"JSON" {
        return Err(Error::new("the binary glTF file does not begin with its JSON")
            .remedy("export the model again"));
    }
    let second = 20 + json.len();
    if second >= bytes.len() {
        return Ok((json, None));
    }
    let (kind, binary) = chunk(second).ok_or_else(cut_off)?;
    Ok((json, (kind == b"BIN\0").then_some(binary)))
}

fn check_version(version: &str) -> Result<()> {
    if version.starts_with('2') {
        return Ok(());
    }
    let cause = match version {
        "" => "the JSON does not say that it is glTF: it has no asset.version".to_owned(),
        _ => format!("glTF {} is not read, only glTF 2", quote(version)),
    };
    Err(Error::new(cause).remedy("convert the model to glTF 2, for instance with Blender"))
}

fn check_extension(name: &str) -> Result<()> {
    if let Some((name, undo)) = COMPRESSIONS.iter().find(|(known, _)| *known == name) {
        return Err(compressed(name, undo));
    }
    if KNOWN.contains(&name) || name.starts_with("KHR_materials_") {
        return Ok(());
    }
    Err(Error::new(format!("the model demands the extension {}, which is not read", quote(name)))
        .remedy("export the model without it"))
}

/// The refusal of a model with one of the [`COMPRESSIONS`].
pub(super) fn compressed(name: &str, undo: &str) -> Error {
    Error::new(format!("the model is compressed with {name}, which is not read")).remedy(undo)
}
