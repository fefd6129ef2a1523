//! Reads STL models, text and binary.
//!
//! STL says nothing but triangles. Corners at one place become one position, so that the triangles are
//! connected again. The normals are ignored: the order of the corners says which side is the front.
//!
//! The reader is our own because crates for it refuse what programs write: several solids, capital
//! letters, normals that are not a number.

use super::formats::model_bytes;
use super::material::{Material, MaterialId};
use super::mesh::{Origin, Part};
use super::model::{Model, checked_position};
use super::text::{Format, decode, number, numbered_lines, quote};
use crate::error::{Error, Result};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::path::Path;

/// The bytes of a binary file before its triangles, the last four of them the triangles' number.
const HEADER: usize = 84;

/// The bytes of a triangle: its normal and its three corners as f32, then two more.
const RECORD: usize = 50;

/// Reads the STL model at `path`.
///
/// # Errors
/// A file that cannot be read, has no triangles, or says something without meaning.
pub(super) fn load(path: &Path) -> Result<Model> {
    parse(path, model_bytes(path)?).map_err(|error| error.in_file_if_none(path))
}

fn parse(path: &Path, bytes: Vec<u8>) -> Result<Model> {
    let mut builder = Builder::default();
    if is_binary(&bytes) {
        binary(&bytes, &mut builder)?;
    } else {
        text(&decode(bytes, path, Format::Stl)?, &mut builder)?;
    }
    builder.model()
}

/// A binary file may begin with "solid" too, so the number of triangles decides, then the bytes.
fn is_binary(bytes: &[u8]) -> bool {
    let solid = bytes.trim_ascii_start().get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid"));
    let fits = triangle_count(bytes).is_some_and(|count| length_of(count) == bytes.len() as u64);
    fits || !solid || bytes[..bytes.len().min(1024)].contains(&0)
}

fn triangle_count(bytes: &[u8]) -> Option<u32> {
    let count = bytes.get(HEADER - 4..HEADER)?;
    Some(u32::from_le_bytes(count.try_into().expect("four bytes")))
}

fn length_of(count: u32) -> u64 {
    HEADER as u64 + u64::from(count) * RECORD as u64
}

fn binary(bytes: &[u8], builder: &mut Builder) -> Result<()> {
    let Some(count) = triangle_count(bytes) else {
        return Err(Error::new(format!("{} bytes are too few for an STL model", bytes.len()))
            .remedy("check that the file is whole"));
    };
    // Some programs write a few bytes more.
    if (bytes.len() as u64) < length_of(count) {
        let found = (bytes.len() - HEADER) / RECORD;
        return Err(Error::new(format!(
            "the file says that it has {count} triangles, but it ends after {found}"
        ))
        .remedy("the file was cut off, or is no STL model: copy or export it again"));
    }
    builder.solid(None);
    for (number, record) in (1..=count).zip(bytes[HEADER..].chunks_exact(RECORD)) {
        let float = |at: usize| f32::from_le_bytes(record[at..at + 4].try_into().expect("4 bytes"));
        let corner = |k: usize| {
            let at = 12 + 12 * k;
            let position = Vec3::new(float(at), float(at + 4), float(at + 8)).as_dvec3();
            checked_position(position, format_args!("triangle {number}: "))
        };
        builder.triangle([corner(0)?, corner(1)?, corner(2)?]);
    }
    Ok(())
}

/// What counts are the words `solid` and `vertex`; the others say again what is known.
fn text(text: &str, builder: &mut Builder) -> Result<()> {
    let mut corners = Vec::new();
    for (line, statement) in numbered_lines(text) {
        let mut words = statement.split_ascii_whitespace();
        let keyword = words.next().unwrap_or_default().to_ascii_lowercase();
        let here = |error: Error| error.at_line(line);
        match keyword.as_str() {
            "solid" => builder.solid(Some(statement.trim()[5..].trim())),
            "vertex" => corners.push(vertex(words).map_err(here)?),
            "facet" => corners.clear(),
            "endfacet" | "endloop" if corners.is_empty() => {}
            "endloop" => facet(&mut corners, builder).map_err(here)?,
            "" | "outer" | "endfacet" | "endsolid" | "color" => {}
            _ => {
                return Err(here(
                    Error::new(format!("{} is not an STL statement", quote(&keyword)))
                        .remedy("check the line, or export the model again"),
                ));
            }
        }
    }
    match corners.is_empty() {
        true => Ok(()),
        false => Err(Error::new("the file ends within a facet")
            .remedy("the file was cut off: copy or export it again")),
    }
}

fn vertex<'a>(words: impl Iterator<Item = &'a str>) -> Result<DVec3> {
    let numbers = words.map(number::<f64>).collect::<Result<Vec<f64>>>()?;
    let [x, y, z] = numbers[..] else {
        return Err(Error::new(format!(
            "a vertex has 3 coordinates, this one has {}",
            numbers.len()
        ))
        .remedy("write `vertex x y z`"));
    };
    checked_position(DVec3::new(x, y, z), format_args!(""))
}

/// A facet has three corners, but some programs write more.
fn facet(corners: &mut Vec<DVec3>, builder: &mut Builder) -> Result<()> {
    if corners.len() < 3 {
        return Err(Error::new(format!(
            "a facet needs 3 vertices, this one has {}",
            corners.len()
        ))
        .remedy("complete the facet or delete it"));
    }
    (1..corners.len() - 1).for_each(|k| builder.triangle([corners[0], corners[k], corners[k + 1]]));
    corners.clear();
    Ok(())
}

#[derive(Default)]
struct Builder {
    model: Model,
    /// The index of each position, by its bits.
    known: HashMap<[u64; 3], u32>,
}

impl Builder {
    fn solid(&mut self, name: Option<&str>) {
        let object = name.filter(|name| !name.is_empty()).map(str::to_owned);
        self.model.mesh.parts.push(Part { model: 0, object, group: None });
    }

    fn triangle(&mut self, corners: [DVec3; 3]) {
        if self.model.mesh.parts.is_empty() {
            self.solid(None);
        }
        let positions = &mut self.model.positions;
        let index = |corner: DVec3| {
            // Adding zero makes -0 a 0.
            let bits = (corner + DVec3::ZERO).to_array().map(f64::to_bits);
            *self.known.entry(bits).or_insert_with(|| {
                positions.push(corner);
                (positions.len() - 1) as u32
            })
        };
        self.model.triangles.push(corners.map(index));
        let face = self.model.triangles.len() as u32;
        let part = self.model.mesh.parts.len() as u32 - 1;
        self.model.mesh.origins.push(Origin { face, part });
    }

    fn model(self) -> Result<Model> {
        let Model { positions, triangles, mesh, .. } = self.model;
        if triangles.is_empty() {
            return Err(Error::new("the file contains no triangles")
                .remedy("export the model again, with its surfaces"));
        }
        Ok(Model {
            material_of: vec![MaterialId(0); triangles.len()],
            materials: vec![Material::fallback()],
            positions,
            triangles,
            mesh,
            usual_up: Some(Vec3::Z),
            ..Model::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::mutation::{self, Loaded};

    const TEXT: &str = "solid left wall\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   \
        vertex 1 0 0\n   vertex 0 1 0\n  endloop\n endfacet\nendsolid left wall\n\
        SOLID\nFACET NORMAL NaN NaN NaN\nOUTER LOOP\nVERTEX 1 0 0\nVERTEX 1 1 -0\n\
        VERTEX 0 1e0 -0.0\nENDLOOP\nENDFACET\nENDSOLID\n";

    fn load_bytes(bytes: &[u8]) -> Loaded {
        mutation::load("a.stl", bytes, load)
    }

    /// A header, the triangles with normals that mean nothing, and what follows them.
    fn binary_of(header: &str, triangles: &[[[f32; 3]; 3]], count: u32) -> Vec<u8> {
        let mut bytes = format!("{header:80}").into_bytes();
        bytes.extend(count.to_le_bytes());
        for corners in triangles {
            bytes.extend([0xff; 12]);
            bytes.extend(corners.as_flattened().iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([7, 7]);
        }
        bytes
    }

    const TWO: [[[f32; 3]; 3]; 2] = [
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        [[1.0, 0.0, 0.0], [1.0, 1.0, -0.0], [0.0, 1.0, -0.0]],
    ];

    #[test]
    fn text_and_binary_are_the_same_triangles_with_shared_corners() {
        let (text, warnings) = load_bytes(TEXT.as_bytes()).unwrap();
        assert!(warnings.is_empty());
        // Many a binary file begins like a text.
        for header in ["", "solid left wall"] {
            let (binary, _) = load_bytes(&binary_of(header, &TWO, 2)).unwrap();
            assert_eq!(text.positions, binary.positions);
            assert_eq!(text.triangles, binary.triangles);
        }
        assert_eq!(text.positions, [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X + DVec3::Y]);
        assert_eq!(text.triangles, [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(text.usual_up, Some(Vec3::Z));
    }

    #[test]
    fn solids_are_objects() {
        let (Model { mesh, .. }, _) = load_bytes(TEXT.as_bytes()).unwrap();
        let objects: Vec<_> = mesh.parts.iter().map(|part| part.object.as_deref()).collect();
        assert_eq!(objects, [Some("left wall"), None]);
        assert_eq!(
            mesh.origins.iter().map(|o| (o.face, o.part)).collect::<Vec<_>>(),
            [(1, 0), (2, 1)]
        );
    }

    #[test]
    fn a_few_bytes_after_the_last_triangle_do_no_harm() {
        let mut bytes = binary_of("solid", &TWO, 2);
        bytes.extend(b"\0\0\0");
        assert_eq!(load_bytes(&bytes).unwrap().0.triangles.len(), 2);
    }

    #[test]
    fn what_has_no_meaning_is_refused_with_its_place() {
        let mut broken = TWO;
        broken[1][2][0] = f32::NAN;
        for (bytes, cause) in [
            (
                binary_of("", &TWO, u32::MAX),
                "a.stl: the file says that it has 4294967295 triangles, but it ends after 2",
            ),
            (binary_of("", &[], 0), "a.stl: the file contains no triangles"),
            (binary_of("", &broken, 2), "a.stl: triangle 2: coordinate NaN is not a finite number"),
            (b"solid x\nendsolid\n".to_vec(), "a.stl: the file contains no triangles"),
            (b"".to_vec(), "a.stl: 0 bytes are too few for an STL model"),
            (
                b"solid\nfacet\nvertex 1 2\n".to_vec(),
                "a.stl:3: a vertex has 3 coordinates, this one has 2",
            ),
            (b"solid\nfacet\nvertex 1 2 inf\n".to_vec(), "a.stl:3: `inf` is not a finite number"),
            (b"solid\nfacet\nvertex 1 2 1e13\n".to_vec(), "a.stl:3: coordinate 1e13 is larger"),
            (b"solid\nfacet\nvertex 1 2 3\nendloop".to_vec(), "a.stl:4: a facet needs 3 vertices"),
            (b"solid\nfacet\nvertex 1 2 3\n".to_vec(), "a.stl: the file ends within a facet"),
            (b"solid\nfcet\n".to_vec(), "a.stl:2: `fcet` is not an STL statement"),
        ] {
            let message = load_bytes(&bytes).unwrap_err();
            assert!(message.starts_with(cause) && message.contains("\n  help: "), "{message}");
        }
    }

    #[test]
    fn no_mutation_makes_the_reader_panic() {
        let read = |bytes: &[u8]| parse(Path::new("a.stl"), bytes.to_vec());
        mutation::try_many(TEXT.as_bytes(), 3000, read);
        mutation::try_many(&binary_of("solid", &TWO, 2), 3000, read);
    }
}
