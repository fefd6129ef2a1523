//! The header of a PLY file: which elements follow it, and their properties.

use crate::error::{Error, Result};
use crate::scene::text::quote;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{self, DefaultElement, ElementDef, Encoding, PropertyType, ScalarType};

/// A header whose counts of elements fit into its file.
#[derive(Debug)]
pub(super) struct Header {
    pub ply: ply::Header,
    /// How many lines it has.
    pub lines: usize,
}

const COLORS: [&str; 3] = ["red", "green", "blue"];

const KEYWORDS: [&str; 7] =
    ["ply", "format", "comment", "obj_info", "element", "property", "end_header"];

/// The names of texture coordinates.
pub(super) const TEXTURE: [[&str; 2]; 3] = [["u", "v"], ["s", "t"], ["texture_u", "texture_v"]];

/// Reads the header at the beginning of `bytes`; what follows it is the second result.
pub(super) fn read_header(bytes: &[u8]) -> Result<(Header, &[u8])> {
    if !bytes.starts_with(b"ply") {
        return Err(Error::new("this does not look like a PLY file")
            .remedy("give the path of a PLY model, which begins with the line `ply`"));
    }
    let (lines, body) = split(bytes)?;
    let text = lines.join("\n");
    let parser = Parser::<DefaultElement>::new();
    let ply = parser.read_header(&mut Reader::new(text.as_bytes())).map_err(|error| {
        let line = error.line().and_then(|line| Some((line, lines.get(line.checked_sub(1)?)?)));
        match line {
            Some((line, text)) => {
                Error::new(format!("{} has no meaning in a PLY header", quote(text))).at_line(line)
            }
            None => Error::new(format!("the PLY header is incomplete: {error}")),
        }
        .remedy("correct the header, or export the model again")
    })?;
    check_counts(&ply, body)?;
    Ok((Header { ply, lines: lines.len() }, body))
}

/// The header's lines, with nothing that is legal but unknown to the parser, and what follows them.
fn split(bytes: &[u8]) -> Result<(Vec<String>, &[u8])> {
    let mut lines = Vec::new();
    let mut rest = bytes;
    while let Some(end) = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')) {
        let line = String::from_utf8_lossy(&rest[..end]).trim().to_owned();
        let ending = if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
        rest = &rest[end + ending..];
        let last = line == "end_header";
        // Some programs write comments without the word.
        let keyword = line.split_whitespace().next().unwrap_or_default();
        lines.push(if KEYWORDS.contains(&keyword) { line } else { "comment".to_owned() });
        if last {
            return Ok((lines, rest));
        }
    }
    if rest.trim_ascii_end() == b"end_header" {
        lines.push("end_header".to_owned());
        return Ok((lines, &[]));
    }
    Err(Error::new("the PLY header has no end").remedy("end it with the line `end_header`"))
}

/// Nothing may be allocated for elements that the file has no room for.
fn check_counts(header: &ply::Header, body: &[u8]) -> Result<()> {
    let mut room = body.len() as u128 + 1;
    for element in header.elements.values() {
        let needed = element.count as u128 * least_size(header.encoding, element) as u128;
        if needed > room {
            return Err(Error::new(format!(
                "the header says that there are {} elements {}, but the file has no room for them",
                element.count,
                quote(&element.name)
            ))
            .remedy("the file was cut off, or its header is wrong: copy or export it again"));
        }
        room -= needed;
    }
    Ok(())
}

/// The bytes that an element has at least.
fn least_size(encoding: Encoding, element: &ElementDef) -> usize {
    let size = |kind: &PropertyType| match (encoding, kind) {
        // A digit and what parts it from the next.
        (Encoding::Ascii, _) => 2,
        (_, PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) => size_of_scalar(scalar),
    };
    element.properties.values().map(|property| size(&property.data_type)).sum()
}

fn size_of_scalar(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

impl Header {
    /// Whether an element has all of these properties.
    pub(super) fn has(&self, element: &str, properties: &[&str]) -> bool {
        let element = self.ply.elements.get(element);
        element.is_some_and(|e| properties.iter().all(|name| e.properties.contains_key(*name)))
    }

    pub(super) fn has_colors(&self, element: &str) -> bool {
        self.has(element, &COLORS)
    }

    /// The names of the pictures that comments give, as MeshLab writes them.
    pub(super) fn pictures(&self) -> Vec<&str> {
        let comments = self.ply.comments.iter();
        comments.filter_map(|c| c.trim().strip_prefix("TextureFile ")).map(str::trim).collect()
    }

    /// Whether the vertices have texture coordinates.
    pub(super) fn has_texture(&self) -> bool {
        TEXTURE.iter().any(|names| self.has("vertex", names))
    }
}
