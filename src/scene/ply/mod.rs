//! Reads PLY models, text and binary of either byte order.
//!
//! A header says which elements follow and which properties each has. Used are the positions, colours,
//! normals and texture coordinates of vertices, and faces or triangle strips with theirs.

mod elements;
mod header;
mod payload;
mod pictures;

use super::beside::Files;
use super::formats::model_bytes;
use super::material::Material;
use super::mesh::{Mesh, Origin, Part, PerCorner};
use super::model::{Model, checked_position};
use super::triangulate::{Crossings, Triangulator};
use crate::color::Rgb;
use crate::error::{Error, Result, Warning};
use elements::{Face, Vertex};
use glam::{DVec3, Vec2, Vec3};
use header::Header;
use payload::{Payload, read_payload};
use pictures::{Pictures, material_of};
use std::path::Path;

/// Reads the PLY model at `path`.
///
/// # Errors
/// A file that cannot be read, has no faces, or says something without meaning.
pub(super) fn load(path: &Path) -> Result<Model> {
    read(path, &model_bytes(path)?).map_err(|error| error.in_file_if_none(path))
}

fn read(path: &Path, bytes: &[u8]) -> Result<Model> {
    let (header, body) = header::read_header(bytes)?;
    let payload = read_payload(&header, body)?;
    model(path, &header, payload)
}

fn model(path: &Path, header: &Header, payload: Payload) -> Result<Model> {
    let Payload { vertices, faces, strips } = payload;
    if faces.is_empty() && strips.is_empty() {
        return Err(without_faces(vertices.len()));
    }
    let mut cutter = Cutter::new(positions(&vertices)?);
    for (number, face) in (1..).zip(&faces) {
        cutter.face(number, face)?;
    }
    for (number, strip) in (1..).zip(&strips) {
        cutter.strip(faces.len() as u32, number, strip)?;
    }
    if cutter.triangles.is_empty() {
        return Err(without_faces(vertices.len()));
    }
    let colors = match header.has_colors("vertex") {
        true => cutter.of_vertices(vertices.iter().map(|v| v.color.into())),
        false if header.has_colors("face") => cutter.of_faces(&faces),
        false => None,
    };
    let texture = match header.has_texture() {
        true => cutter.of_vertices(vertices.iter().map(|v| Vec2::from(v.texture))),
        false => PerCorner::new(
            std::mem::take(&mut cutter.wedges),
            std::mem::take(&mut cutter.wedge_numbers),
        ),
    };
    let with_normals = header.has("vertex", &["nx", "ny", "nz"]);
    let normals = with_normals
        .then(|| cutter.of_vertices(vertices.iter().map(|v| Vec3::from(v.normal))))
        .flatten();
    let mut files = Files::new(path);
    let mut pictures = match texture {
        Some(_) => pictures::read(path, header, &mut files)?,
        None => Pictures::default(),
    };
    if pictures.materials.is_empty() {
        // Colours say what is reflected.
        let reflectance =
            if colors.is_some() { Rgb::ONE } else { Material::fallback().reflectance };
        pictures.materials.push(Material { reflectance, ..Material::fallback() });
    }
    files.warnings.extend(cutter.warnings(path));
    Ok(Model {
        material_of: material_of(&cutter.origins, &faces, pictures.materials.len()),
        materials: pictures.materials,
        textures: pictures.textures,
        warnings: files.take_warnings(),
        files: files.read,
        mesh: Mesh {
            origins: cutter.origins,
            parts: vec![Part::default()],
            texture,
            normals,
            colors,
        },
        positions: cutter.positions,
        triangles: cutter.triangles,
        ..Model::default()
    })
}

fn without_faces(vertices: usize) -> Error {
    Error::new(format!("this is a point cloud: it has {vertices} vertices, but no faces"))
        .remedy("make a surface of it first, for instance in MeshLab, and export that")
}

fn positions(vertices: &[Vertex]) -> Result<Vec<DVec3>> {
    let numbered = (1..).zip(vertices);
    let checked = |(number, vertex): (usize, &Vertex)| {
        checked_position(vertex.position.into(), format_args!("vertex {number}: "))
    };
    numbered.map(checked).collect()
}

/// Cuts faces into triangles.
struct Cutter {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    origins: Vec<Origin>,
    /// Texture coordinates that corners of faces have of their own.
    wedges: Vec<Vec2>,
    wedge_numbers: Vec<[u32; 3]>,
    triangulator: Triangulator,
    crossing: Crossings,
    /// Faces with fewer than 3 corners: how many, and the first.
    flat: (usize, u32),
}

impl Cutter {
    fn new(positions: Vec<DVec3>) -> Self {
        Cutter {
            positions,
            triangles: Vec::new(),
            origins: Vec::new(),
            wedges: Vec::new(),
            wedge_numbers: Vec::new(),
            triangulator: Triangulator::new(),
            crossing: Crossings::default(),
            flat: (0, 0),
        }
    }

    fn face(&mut self, number: u32, face: &Face) -> Result<()> {
        let index = |value: &f64| self.index(*value, "face", number);
        let corners = face.corners.iter().map(index).collect::<Result<Vec<u32>>>()?;
        if corners.len() < 3 {
            let first = if self.flat.0 == 0 { number } else { self.flat.1 };
            self.flat = (self.flat.0 + 1, first);
            return Ok(());
        }
        let polygon: Vec<DVec3> = corners.iter().map(|c| self.positions[*c as usize]).collect();
        let mut cuts = Vec::new();
        if self.triangulator.triangulate(&polygon, &mut cuts) {
            self.crossing.add(number);
        }
        let first = self.wedges.len() as u32 + 1;
        let own = face.texture.len() == 2 * corners.len();
        if own {
            self.wedges.extend(face.texture.chunks_exact(2).map(|uv| Vec2::new(uv[0], uv[1])));
        }
        for cut in cuts {
            let wedges = if own { cut.map(|k| first + k as u32) } else { [0; 3] };
            self.triangle(number, cut.map(|k| corners[k]), wedges);
        }
        Ok(())
    }

    /// Every further vertex makes a triangle with the two before it, every other one turned over; -1 begins
    /// a new strip. `faces` is the number of faces before the strips.
    fn strip(&mut self, faces: u32, number: u32, strip: &Face) -> Result<()> {
        for piece in strip.corners.split(|value| *value < 0.0) {
            let index = |value: &f64| self.index(*value, "strip", number);
            let corners = piece.iter().map(index).collect::<Result<Vec<u32>>>()?;
            for (k, window) in corners.windows(3).enumerate() {
                let [a, b, c] = [window[0], window[1 + k % 2], window[2 - k % 2]];
                let before = self.origins.last().map_or(0, |origin| origin.face);
                self.triangle(before.max(faces) + 1, [a, b, c], [0; 3]);
            }
        }
        Ok(())
    }

    fn triangle(&mut self, face: u32, corners: [u32; 3], wedges: [u32; 3]) {
        self.triangles.push(corners);
        self.origins.push(Origin { face, part: 0 });
        self.wedge_numbers.push(wedges);
    }

    fn index(&self, value: f64, what: &str, number: u32) -> Result<u32> {
        if value.fract() == 0.0 && (0.0..self.positions.len() as f64).contains(&value) {
            return Ok(value as u32);
        }
        Err(Error::new(format!(
            "{what} {number} names vertex {value}, but the vertices are 0 to {}",
            self.positions.len() as i64 - 1
        ))
        .remedy("export the model again"))
    }

    /// Values that there is one of per vertex.
    fn of_vertices<T: Copy>(&self, values: impl Iterator<Item = T>) -> Option<PerCorner<T>> {
        let numbers = self.triangles.iter().map(|corners| corners.map(|c| c + 1)).collect();
        PerCorner::new(values.collect(), numbers)
    }

    /// The colours of faces; strips have none.
    fn of_faces(&self, faces: &[Face]) -> Option<PerCorner<Rgb>> {
        let number = |origin: &Origin| {
            if origin.face as usize <= faces.len() { [origin.face; 3] } else { [0; 3] }
        };
        let colors = faces.iter().map(|face| face.color.into()).collect();
        PerCorner::new(colors, self.origins.iter().map(number).collect())
    }

    fn warnings(&self, path: &Path) -> Vec<Warning> {
        let (count, first) = self.flat;
        let text = format!(
            "faces with fewer than 3 vertices have no area and are ignored ({count} in all, first face \
             {first})"
        );
        let flat = (count > 0).then(|| Warning::in_file(path, None, text));
        flat.into_iter().chain(self.crossing.warning(path)).collect()
    }
}

#[cfg(test)]
mod tests;
