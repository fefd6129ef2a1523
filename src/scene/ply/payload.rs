//! The elements behind the header of a PLY file.
//!
//! `ply-rs-bw` reads those of binary files. Lines of text are read here: programs write more kinds of
//! numbers than it knows, such as `.5`, and its errors quote the file unescaped.

use super::elements::{Element, Face, Row, Skipped, Vertex};
use super::header::Header;
use crate::error::{Error, Result};
use crate::scene::text::quote;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, PropertyType};
use std::borrow::Cow;

#[derive(Debug, Default)]
pub(super) struct Payload {
    pub vertices: Vec<Vertex>,
    pub faces: Vec<Face>,
    pub strips: Vec<Face>,
}

pub(super) fn read_payload(header: &Header, body: &[u8]) -> Result<Payload> {
    let mut payload = Payload::default();
    let mut source = match header.ply.encoding {
        Encoding::Ascii => Source::Text(Lines::new(header, body)),
        _ => Source::Binary(header, Reader::new(body)),
    };
    for element in header.ply.elements.values() {
        match element.name.as_str() {
            // Elements without properties take no room, so that there may seem to be any number.
            _ if element.properties.is_empty() => {}
            "vertex" => payload.vertices = source.elements(element)?,
            "face" => payload.faces = source.elements(element)?,
            "tristrips" => payload.strips = source.elements(element)?,
            _ => drop(source.elements::<Skipped>(element)?),
        }
    }
    if !header.has("vertex", &["x", "y", "z"]) {
        return Err(Error::new("the vertices have no x, y and z")
            .remedy("export the model again, with positions"));
    }
    Ok(payload)
}

enum Source<'a> {
    Text(Lines<'a>),
    Binary(&'a Header, Reader<&'a [u8]>),
}

impl Source<'_> {
    fn elements<E: Element>(&mut self, definition: &ElementDef) -> Result<Vec<E>> {
        match self {
            Source::Text(lines) => {
                (0..definition.count).map(|_| lines.element(definition)).collect()
            }
            Source::Binary(header, reader) => {
                let parser = Parser::<Row<E>>::new();
                let rows = parser.read_payload_for_element(reader, definition, &header.ply);
                // Of a binary file there is nothing to show.
                let rows = rows.map_err(|_| cut_off(definition))?;
                Ok(rows.into_iter().map(|row| row.0).collect())
            }
        }
    }
}

fn cut_off(definition: &ElementDef) -> Error {
    Error::new(format!(
        "the file does not have the {} elements {} that its header announces",
        definition.count,
        quote(&definition.name)
    ))
    .remedy("the file was cut off, or its header is wrong: copy or export it again")
}

/// The lines behind a header, each an element.
struct Lines<'a> {
    text: Cow<'a, str>,
    /// Where the next line begins.
    at: usize,
    /// The number of the line before it.
    line: usize,
}

impl<'a> Lines<'a> {
    fn new(header: &Header, body: &'a [u8]) -> Self {
        Lines { text: String::from_utf8_lossy(body), at: 0, line: header.lines }
    }

    /// The next line that is not empty.
    fn next(&mut self) -> Option<(usize, &str)> {
        loop {
            let rest = self.text.get(self.at..).filter(|rest| !rest.is_empty())?;
            let length = rest.find(['\n', '\r']).unwrap_or(rest.len());
            let ending = if rest[length..].starts_with("\r\n") { 2 } else { 1 };
            let start = self.at;
            self.at += length + ending;
            self.line += 1;
            let line = &self.text[start..start + length];
            if !line.trim().is_empty() {
                // Found again, since the loop cannot lend what it returns.
                return Some((self.line, self.text[start..start + length].trim()));
            }
        }
    }

    fn element<E: Element>(&mut self, definition: &ElementDef) -> Result<E> {
        let Some((number, line)) = self.next() else { return Err(cut_off(definition)) };
        parse(line, definition).map_err(|error| error.at_line(number))
    }
}

fn parse<E: Element>(line: &str, definition: &ElementDef) -> Result<E> {
    let mut words = line.split_ascii_whitespace();
    let mut next = || {
        let word = words.next().ok_or_else(|| {
            Error::new(format!("the line ends within an element {}", quote(&definition.name)))
                .remedy("complete the line, or export the model again")
        })?;
        word.parse::<f64>().map_err(|_| {
            Error::new(format!("{} is not a number", quote(word)))
                .remedy("write numbers like 1, -0.5 or 2e-3")
        })
    };
    let mut element = E::default();
    for (name, property) in &definition.properties {
        match &property.data_type {
            PropertyType::Scalar(kind) => element.scalar(name, next()?, kind),
            PropertyType::List(..) => {
                let count = next()?;
                if !(count >= 0.0 && count.fract() == 0.0) {
                    return Err(Error::new(format!("a list cannot have {count} values"))
                        .remedy("correct the line, or export the model again"));
                }
                // The line ends before a count that is too large does harm.
                let values = (0..count as u64).map(|_| next());
                element.list(name, values.collect::<Result<Vec<f64>>>()?);
            }
        }
    }
    Ok(element)
}
