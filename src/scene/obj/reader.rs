//! Reads the lines of an OBJ file, each once.
//!
//! `tobj` would read OBJ files too, but its errors carry no line, it reads some malformed
//! lines as something else, and it does not tell which face of the file a triangle comes from.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::ignored::LeftAside;
use super::words::{corner, number_or_none, out_of_range, position, resolve_negative, zero_index};
use crate::color::{Rgb, srgb_decode};
use crate::error::{Error, Result, Warning};
use crate::scene::mesh::Part;
use crate::scene::text::{keyword_and_rest, number, numbered_lines, words};
use glam::{DVec3, Vec2, Vec3};

/// An OBJ file as it was read. Every index is within its list.
#[derive(Debug, Default)]
pub(super) struct ObjFile {
    pub positions: Vec<DVec3>,
    pub texture: Vec<Vec2>,
    pub normals: Vec<Vec3>,
    /// Linear, one per position; empty if all are white.
    pub colors: Vec<Rgb>,
    /// One per `f` line, at least one of them with three corners.
    pub faces: Vec<Face>,
    pub runs: Vec<Run>,
    /// The corners of all faces, one face after the other.
    pub corners: Corners,
    pub parts: Vec<Part>,
    /// The `mtllib` lines, in file order.
    pub libraries: Vec<Named>,
    /// The materials that faces use, in the order of their first `usemtl`.
    pub materials: Vec<Named>,
    pub warnings: Vec<Warning>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// How many corners it has.
    pub arity: u32,
    /// Index into [`ObjFile::runs`].
    pub run: u32,
}

/// What faces that follow each other have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Run {
    /// Index into [`ObjFile::materials`].
    pub material: Option<usize>,
    /// Index into [`ObjFile::parts`].
    pub part: u32,
}

/// The corners of faces. Their numbers count from 1, as in the file.
#[derive(Debug, Default)]
pub(super) struct Corners {
    pub positions: Vec<u32>,
    /// Numbers of texture coordinates, 0 for none; empty if no corner has any.
    pub texture: Vec<u32>,
    /// Numbers of normals, 0 for none; empty if no corner has any.
    pub normals: Vec<u32>,
}

impl Corners {
    fn push(&mut self, position: u32, texture: u32, normal: u32) {
        let before = self.positions.len();
        self.positions.push(position);
        for (list, number) in [(&mut self.texture, texture), (&mut self.normals, normal)] {
            if number != 0 || !list.is_empty() {
                list.resize(before, 0);
                list.push(number);
            }
        }
    }
}

/// The words after a keyword, and the line where they stood first.
#[derive(Debug, PartialEq)]
pub(super) struct Named {
    pub name: String,
    pub line: usize,
}

/// Reads the `text` of the OBJ file at `path`. Fails if lines have no meaning, all of which the error names,
/// or if no line is a face.
pub(super) fn read_obj(path: &Path, text: &str) -> Result<ObjFile> {
    let mut reader = Reader::default();
    for (number, line) in numbered_lines(text) {
        if let Err(error) = reader.statement(number, &line) {
            reader.errors.push(error.at_line(number));
        }
    }
    reader.finish(path)
}

#[derive(Default)]
struct Reader {
    file: ObjFile,
    /// Positive indices beyond the vertices so far, each higher than the one before, with their
    /// lines: the first index out of range must be among them.
    forward: Vec<(usize, usize)>,
    /// Index into `file.materials` by name.
    material_numbers: HashMap<String, usize>,
    /// The latest `usemtl`, if no face has used it yet.
    new_material: Option<Named>,
    /// The material of the face before.
    material: Option<usize>,
    has_usemtl: bool,
    /// Index into `file.parts`.
    part_numbers: HashMap<Part, u32>,
    /// The latest `o` and `g`.
    part: Part,
    /// The index of `part`, once a face has needed it.
    part_number: Option<u32>,
    ignored: LeftAside,
    /// Those with their lines.
    errors: Vec<Error>,
    /// Per position that has none, in order: its number from 1, and why. It is an error if a face uses it.
    bad_vertices: Vec<(u32, Error)>,
    /// The largest component of a vertex colour.
    brightest: f32,
}

impl Reader {
    fn statement(&mut self, line: usize, text: &str) -> Result<()> {
        let (keyword, rest) = keyword_and_rest(text);
        match keyword {
            "v" => self.vertex(line, rest),
            "vt" => {
                let uv = self.numbers_or_zero(line, rest);
                self.file.texture.push(uv.into());
            }
            "vn" => {
                let normal = self.numbers_or_zero(line, rest);
                self.file.normals.push(normal.into());
            }
            "f" | "fo" => self.face(line, rest)?,
            "usemtl" => self.usemtl(line, rest),
            "mtllib" => self.file.libraries.push(Named { name: rest.to_owned(), line }),
            "o" => self.name_part(|part| &mut part.object, rest),
            "g" => self.name_part(|part| &mut part.group, rest),
            _ => self.ignored.statement(line, keyword),
        }
        Ok(())
    }

    /// `f` with one word per corner: `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn face(&mut self, line: usize, rest: &str) -> Result<()> {
        let run = self.run(line);
        let mut arity = 0;
        for word in words(rest) {
            let (index, texture, normal) = corner(word)?;
            let position = self.vertex_number(line, index)?;
            let texture = number_or_none(texture, self.file.texture.len());
            let normal = number_or_none(normal, self.file.normals.len());
            self.file.corners.push(position, texture, normal);
            arity += 1;
        }
        if arity < 3 {
            self.ignored.short_face(line);
        }
        self.file.faces.push(Face { arity, run });
        Ok(())
    }

    /// A vertex may come after the face, so positive indices are judged at the end of the file.
    fn vertex_number(&mut self, line: usize, index: i64) -> Result<u32> {
        let count = self.file.positions.len();
        if index < 0 {
            return resolve_negative(index, count);
        }
        if index == 0 {
            return Err(zero_index());
        }
        let highest = self.forward.last().map_or(count, |&(_, highest)| highest.max(count));
        if index as usize > highest {
            self.forward.push((line, index as usize));
        }
        Ok(index as u32)
    }

    /// Without a name: the default material from here on.
    fn usemtl(&mut self, line: usize, name: &str) {
        self.new_material = None;
        self.has_usemtl = true;
        if name.is_empty() {
            self.ignored.blank_usemtl(line);
            self.material = None;
        } else {
            self.new_material = Some(Named { name: name.to_owned(), line });
        }
    }

    /// `v x y z`, `v x y z w`, or `v x y z r g b` with perhaps an opacity.
    fn vertex(&mut self, line: usize, rest: &str) {
        let (position, color) = position(rest);
        let number = self.file.positions.len() as u32 + 1;
        match position {
            Ok(position) => self.file.positions.push(position),
            Err(error) => {
                self.bad_vertices.push((number, error.at_line(line)));
                // Somewhere among the others, so that it changes nothing about their extent.
                self.file.positions.push(self.file.positions.last().copied().unwrap_or_default());
            }
        }
        if let Some(color) = color {
            if !color.is_finite() {
                self.ignored.bad_coordinate(line);
            }
            let color = if color.is_finite() { color.max(Rgb::ZERO) } else { Rgb::ONE };
            self.brightest = self.brightest.max(color.max_element());
            self.file.colors.resize(number as usize - 1, Rgb::ONE);
            self.file.colors.push(color);
        }
    }

    /// For `vt` and `vn`: a number that is missing or malformed is 0.
    fn numbers_or_zero<const N: usize>(&mut self, line: usize, rest: &str) -> [f32; N] {
        let mut malformed = false;
        let mut numbers = words(rest).map(|word| {
            number(word).unwrap_or_else(|_| {
                malformed = true;
                0.0
            })
        });
        let numbers = std::array::from_fn(|_| numbers.next().unwrap_or(0.0));
        if malformed {
            self.ignored.bad_coordinate(line);
        }
        numbers
    }

    /// The run of the next face.
    fn run(&mut self, line: usize) -> u32 {
        let run = Run { material: self.material(line), part: self.part() };
        if self.file.runs.last() != Some(&run) {
            self.file.runs.push(run);
        }
        self.file.runs.len() as u32 - 1
    }

    /// The material of the next face. Only here is it listed, so that a material that no face uses
    /// is never mentioned.
    fn material(&mut self, line: usize) -> Option<usize> {
        if let Some(named) = self.new_material.take() {
            let next = self.file.materials.len();
            let number = *self.material_numbers.entry(named.name.clone()).or_insert(next);
            if number == next {
                self.file.materials.push(named);
            }
            self.material = Some(number);
        } else if !self.has_usemtl {
            self.ignored.face_before_usemtl(line);
        }
        self.material
    }

    fn name_part(&mut self, field: fn(&mut Part) -> &mut Option<String>, name: &str) {
        *field(&mut self.part) = (!name.is_empty()).then(|| name.to_owned());
        self.part_number = None;
    }

    /// The part of the next face.
    fn part(&mut self) -> u32 {
        *self.part_number.get_or_insert_with(|| {
            let next = self.file.parts.len() as u32;
            let number = *self.part_numbers.entry(self.part.clone()).or_insert(next);
            if number == next {
                self.file.parts.push(self.part.clone());
            }
            number
        })
    }

    fn finish(mut self, path: &Path) -> Result<ObjFile> {
        self.judge_forward();
        self.judge_bad_vertices();
        self.errors.sort_by_key(Error::line);
        let errors = std::mem::take(&mut self.errors).into_iter();
        if let Some(error) = Error::all(errors.map(|error| error.in_file(path)).collect()) {
            return Err(error);
        }
        if self.file.faces.iter().all(|face| face.arity < 3) {
            return Err(Error::new("the file contains no faces, so there is nothing to render")
                .in_file(path)
                .remedy("export the model as triangles or polygons (`f` lines)"));
        }
        self.drop_dangling();
        self.finish_colors();
        self.file.warnings = self.ignored.warnings(path, !self.file.colors.is_empty());
        Ok(self.file)
    }

    /// Only now it is known how many vertices there are.
    fn judge_forward(&mut self) {
        let count = self.file.positions.len();
        let missing = self.forward.iter().filter(|(_, index)| *index > count);
        self.errors.extend(missing.map(|(line, index)| {
            out_of_range(*index as i64, &format!("the file has {count} vertices")).at_line(*line)
        }));
    }

    fn judge_bad_vertices(&mut self) {
        if self.bad_vertices.is_empty() {
            return;
        }
        let used: HashSet<u32> = self.file.corners.positions.iter().copied().collect();
        for (number, error) in std::mem::take(&mut self.bad_vertices) {
            // Without any faces it may be the reason why there are none.
            if used.contains(&number) || self.file.faces.is_empty() {
                self.errors.push(error);
            } else {
                self.ignored.bad_vertex(error.line().unwrap_or_default());
            }
        }
    }

    /// Vertex colours are stored as they are displayed: MeshLab writes its bytes / 255, and Blender encodes its
    /// linear colours as sRGB. So they are decoded. Above 1, all are bytes.
    fn finish_colors(&mut self) {
        let white = if self.brightest > 1.0 { 255.0 } else { 1.0 };
        let colors = &mut self.file.colors;
        for color in colors.iter_mut().filter(|color| **color != Rgb::ONE || white != 1.0) {
            *color = (*color / white).map(srgb_decode);
        }
        if colors.iter().all(|color| *color == Rgb::ONE) {
            colors.clear();
        } else {
            colors.resize(self.file.positions.len(), Rgb::ONE);
        }
    }

    /// Light needs neither texture coordinates nor normals, so an index that points to nothing is
    /// no error.
    fn drop_dangling(&mut self) {
        let ObjFile { corners, texture, normals, .. } = &mut self.file;
        for (list, count) in
            [(&mut corners.texture, texture.len()), (&mut corners.normals, normals.len())]
        {
            list.iter_mut()
                .filter(|number| **number as usize > count)
                .for_each(|number| *number = 0);
        }
    }
}

#[cfg(test)]
mod tests;
