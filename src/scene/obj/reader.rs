//! Reads the lines of an OBJ file, each once.
//!
//! `tobj` would read OBJ files too, but its errors carry no line, it reads some malformed
//! lines as something else, and it does not tell which face of the file a triangle comes from.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::ignored::LeftAside;
use crate::color::{Rgb, srgb_decode};
use crate::error::{Error, Result, Warning};
use crate::scene::mesh::Part;
use crate::scene::text::{LARGEST, keyword_and_rest, number, numbered_lines, quote, words};
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
    /// The corners of all faces, one face after the other.
    pub corners: Vec<Corner>,
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
    pub arity: usize,
    /// Index into [`ObjFile::materials`].
    pub material: Option<usize>,
    /// Index into [`ObjFile::parts`].
    pub part: u32,
}

/// A corner of a face. Its numbers count from 1, as in the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corner {
    pub position: u32,
    /// 0 if there is none.
    pub texture: u32,
    /// 0 if there is none.
    pub normal: u32,
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
        let (material, part) = (self.material(line), self.part());
        let before = self.file.corners.len();
        for word in words(rest) {
            let corner = self.corner(line, word)?;
            self.file.corners.push(corner);
        }
        let arity = self.file.corners.len() - before;
        if arity < 3 {
            self.ignored.short_face(line);
        }
        self.file.faces.push(Face { arity, material, part });
        Ok(())
    }

    fn corner(&mut self, line: usize, word: &str) -> Result<Corner> {
        let (vertex, others) = word.split_once('/').unwrap_or((word, ""));
        let numerals = others.bytes().all(|byte| b"0123456789+-/".contains(&byte));
        let Some(index) = vertex.parse::<i64>().ok().filter(|_| numerals) else {
            return Err(Error::new(format!("{} is not a vertex index", quote(word)))
                .remedy("write each corner of a face as v, v/vt, v//vn or v/vt/vn"));
        };
        let (texture, normal) = others.split_once('/').unwrap_or((others, ""));
        Ok(Corner {
            position: self.vertex_number(line, index)?,
            texture: number_or_none(texture, self.file.texture.len()),
            normal: number_or_none(normal, self.file.normals.len()),
        })
    }

    /// A vertex may come after the face, so positive indices are judged at the end of the file.
    fn vertex_number(&mut self, line: usize, index: i64) -> Result<u32> {
        let count = self.file.positions.len();
        if index < 0 {
            return resolve_negative(index, count);
        }
        if index == 0 {
            return Err(Error::new("vertex index 0 does not exist").remedy(
                "count vertices from 1, or backwards from -1, the vertex before the face",
            ));
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
        let corners = self.file.corners.iter();
        let used: HashSet<u32> = corners.map(|corner| corner.position).collect();
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
        let (texture, normals) = (self.file.texture.len(), self.file.normals.len());
        for corner in &mut self.file.corners {
            if corner.texture as usize > texture {
                corner.texture = 0;
            }
            if corner.normal as usize > normals {
                corner.normal = 0;
            }
        }
    }
}

/// The position of a `v` line, and its colour as it is written, if it has one; NaN if that is malformed.
fn position(rest: &str) -> (Result<DVec3>, Option<Rgb>) {
    let mut values = [0.0; 7];
    let (mut count, mut malformed) = (0, None);
    for word in words(rest) {
        let value = number(word).unwrap_or_else(|error| {
            // A malformed colour is no malformed position.
            if count < 3 {
                malformed.get_or_insert(error);
            }
            f64::NAN
        });
        if let Some(slot) = values.get_mut(count) {
            *slot = value;
        }
        count += 1;
    }
    let color = || Rgb::new(values[3] as f32, values[4] as f32, values[5] as f32);
    let (w, color) = match count {
        3 => (1.0, None),
        6 | 7 => (1.0, Some(color())),
        4 => (values[3], None),
        _ => return (Err(malformed.unwrap_or_else(|| wrong_vertex(count))), None),
    };
    let position = malformed.map_or_else(|| weighted(DVec3::from_slice(&values), w), Err);
    (position, color)
}

fn wrong_vertex(count: usize) -> Error {
    Error::new(format!("a vertex has 3 coordinates, this line has {count} numbers"))
        .remedy("write `v x y z`, `v x y z w` or `v x y z r g b`")
}

fn weighted(coordinates: DVec3, w: f64) -> Result<DVec3> {
    if w.is_nan() {
        return Err(Error::new("the weight w is not a number").remedy("delete w, or set it to 1"));
    }
    if w == 0.0 {
        return Err(Error::new("the weight w is 0, so the vertex is infinitely far away")
            .remedy("delete w, or set it to 1"));
    }
    let position = coordinates / w;
    match position.to_array().into_iter().find(|x| x.abs() > LARGEST as f64) {
        Some(x) => Err(Error::new(format!("coordinate {x:e} is larger than {LARGEST:e}"))
            .remedy("scale the model down, for instance from millimetres to metres")),
        None => Ok(position),
    }
}

/// The number of a texture coordinate or normal, of which there are `count` so far; 0 if the face
/// gives none.
fn number_or_none(word: &str, count: usize) -> u32 {
    let index: i64 = word.parse().unwrap_or(0);
    let number = if index < 0 { count as i64 + 1 + index } else { index };
    u32::try_from(number).unwrap_or(0)
}

/// -1 is the latest of the `vertices` so far.
fn resolve_negative(index: i64, vertices: usize) -> Result<u32> {
    usize::try_from(index.unsigned_abs())
        .ok()
        .and_then(|back| (vertices + 1).checked_sub(back))
        .filter(|number| *number > 0)
        .map(|number| number as u32)
        .ok_or_else(|| out_of_range(index, &format!("{vertices} vertices precede this line")))
}

fn out_of_range(index: i64, range: &str) -> Error {
    Error::new(format!("vertex index {index} is out of range: {range}"))
        .remedy("correct the index, or restore the missing `v` lines")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

    fn read(text: &str) -> Result<ObjFile> {
        read_obj(Path::new("a.obj"), text)
    }

    /// The first line of the message, for `line` after the three vertices.
    fn error_of(line: &str) -> String {
        let faces = format!("{line}\nf 1 2 -1\n");
        let error = read(&format!("{TRIANGLE}{faces}")).expect_err(line).to_string();
        error.lines().next().unwrap_or_default().to_owned()
    }

    #[test]
    fn a_face_with_two_vertices_is_left_out_and_keeps_its_number() {
        let file = read(&format!("{TRIANGLE}f 1 2\nf\nf 1 2 3\n")).unwrap();
        assert_eq!(file.faces.iter().map(|face| face.arity).collect::<Vec<_>>(), [2, 0, 3]);
        assert_eq!(
            file.warnings[1].to_string(),
            "a.obj:4: a face with fewer than 3 vertices has no area and is ignored (2 in all)"
        );
        assert!(read(&format!("{TRIANGLE}f 1 2\n")).unwrap_err().cause().contains("no faces"));
    }

    #[test]
    fn each_bad_index_is_told_with_its_range() {
        assert_eq!(error_of("f 1 2 0"), "a.obj:4: vertex index 0 does not exist");
        let range = "a.obj:4: vertex index 4 is out of range: the file has 3 vertices";
        assert_eq!(error_of("f 1 2 4\nf 1 2 9"), range);
        let range = "a.obj:4: vertex index -4 is out of range: 3 vertices precede this line";
        assert_eq!(error_of("f 1 2 -4\nv 1 1 1"), range);
        assert!(error_of(&format!("f 1 2 {}", i64::MAX)).contains("out of range"));
        assert!(error_of(&format!("f 1 2 {}", i64::MIN)).contains("out of range"));
        for word in ["99999999999999999999", "1.0", "/1", "1/x/1", "a\u{7}"] {
            assert!(error_of(&format!("f 1 2 {word}")).contains("is not a vertex index"), "{word}");
        }
    }

    #[test]
    fn each_bad_vertex_names_its_line_and_word() {
        assert_eq!(
            error_of("v 1 2"),
            "a.obj:4: a vertex has 3 coordinates, this line has 2 numbers"
        );
        assert!(error_of("v 1 2 3 4 5").contains("has 5 numbers"));
        assert!(error_of("v 1 2 3 4 5 6 7 8 9").contains("has 9 numbers"));
        assert_eq!(error_of("v 1 x 3"), "a.obj:4: `x` is not a number");
        assert_eq!(error_of("v 1 nan 3"), "a.obj:4: `nan` is not a finite number");
        assert_eq!(error_of("v 1 2 1.#QNAN"), "a.obj:4: `1.#QNAN` is not a number");
        assert!(error_of("v 1 2 3 0").contains("weight w is 0"));
        assert_eq!(error_of("v 1 -2e12 3"), "a.obj:4: coordinate -2e12 is larger than 1e12");
        assert!(error_of("v 1 1 1 1e-20").contains("larger than 1e12"));
    }

    #[test]
    fn indices_count_from_the_beginning_or_backwards() {
        let text = "f 1/1/1 2//2 \\\n -1 # corner\nv 1 1 1 1 0 0\nf 5 -1 1\nv 2 2 2 2\n";
        let file = read(&format!("{TRIANGLE}{text}")).unwrap();
        assert_eq!(file.positions[3..], [DVec3::ONE; 2]);
        let numbers: Vec<u32> = file.corners.iter().map(|corner| corner.position).collect();
        assert_eq!(numbers, [1, 2, 3, 5, 4, 1]);
    }

    #[test]
    fn texture_coordinates_and_normals_are_kept_where_they_exist() {
        let text = "vt .5\nvt 1 x\nvn 0 0 1\nf 1/-1/1 2/1 3/9/-2\n";
        let file = read(&format!("{TRIANGLE}{text}")).unwrap();
        assert_eq!(file.texture, [Vec2::new(0.5, 0.0), Vec2::new(1.0, 0.0)]);
        assert_eq!(file.normals, [Vec3::Z]);
        let numbers = |corner: &Corner| (corner.texture, corner.normal);
        assert_eq!(file.corners.iter().map(numbers).collect::<Vec<_>>(), [(2, 1), (1, 0), (0, 0)]);
    }

    #[test]
    fn each_pair_of_object_and_group_is_one_part() {
        let face = "f 1 2 3\n";
        let text = format!("{face}o a b\n{face}g x\n{face}g\n{face}o c\ng x\ng\no a b\n{face}");
        let file = read(&format!("{TRIANGLE}{text}")).unwrap();
        assert_eq!(file.faces.iter().map(|face| face.part).collect::<Vec<_>>(), [0, 1, 2, 1, 1]);
        let named = |object: &str, group: &str| {
            let name = |text: &str| (!text.is_empty()).then(|| text.to_owned());
            Part { model: 0, object: name(object), group: name(group) }
        };
        assert_eq!(file.parts, [named("", ""), named("a b", ""), named("a b", "x")]);
    }

    #[test]
    fn only_materials_of_faces_are_kept_and_each_once() {
        let text =
            "usemtl a\nusemtl b c\nf 1 2 3\nusemtl d\nf 1 2 3\nusemtl b c\nf 1 2 3\nusemtl e";
        let file = read(&format!("{TRIANGLE}{text}")).unwrap();
        let named = |name: &str, line| Named { name: name.into(), line };
        assert_eq!(file.materials, [named("b c", 5), named("d", 7)]);
        let used: Vec<_> = file.faces.iter().map(|face| face.material).collect();
        assert_eq!(used, [Some(0), Some(1), Some(0)]);
        assert_eq!(file.warnings, []);
    }

    #[test]
    fn a_file_without_faces_is_refused_without_a_line() {
        let error = read(&format!("{TRIANGLE}l 1 2")).unwrap_err().to_string();
        assert!(error.starts_with("a.obj: the file contains no faces"));
    }

    #[test]
    fn all_malformed_lines_are_told_at_once_in_order() {
        let text = "f 1 2 y\nv 1 x 3\nf 1 2 9\nf 1 2 4\nf 1 0 2\n";
        let error = read(&format!("{TRIANGLE}{text}")).unwrap_err().to_string();
        let lines: Vec<&str> = error.lines().collect();
        assert_eq!(lines.len(), 5, "{error}");
        assert!(lines[0].starts_with("a.obj:4:") && lines[1].starts_with("  help:"), "{error}");
        assert_eq!(lines[2], "a.obj:5: `x` is not a number");
        assert!(lines[3].starts_with("a.obj:6:") && lines[4].starts_with("a.obj:8:"), "{error}");
    }

    #[test]
    fn numbers_that_nobody_uses_may_be_malformed() {
        let text = "v nan 0 0\nvt inf 0\nvn nan nan nan\nf 1/1/1 2 3\nv 1 2\n";
        let file = read(&format!("{TRIANGLE}{text}")).unwrap();
        assert_eq!((file.texture[0], file.normals[0]), (Vec2::ZERO, Vec3::ZERO));
        assert!(file.positions.len() == 5 && file.positions.iter().all(|p| p.is_finite()));
        let said: Vec<String> = file.warnings.iter().map(Warning::to_string).collect();
        assert_eq!(said.len(), 3, "{said:?}");
        assert!(said[1].starts_with("a.obj:4: a vertex that no face uses"), "{said:?}");
        assert!(said[1].ends_with("(2 in all)") && said[2].ends_with("(2 in all)"), "{said:?}");
    }

    #[test]
    fn a_blank_usemtl_stands_for_the_default_material() {
        let text = "usemtl a\nf 1 2 3\nusemtl\nf 1 2 3\nf 3 2 1\nusemtl a\nf 1 2 3\n";
        let file = read(&format!("{TRIANGLE}{text}")).unwrap();
        let used: Vec<_> = file.faces.iter().map(|face| face.material).collect();
        assert_eq!(used, [Some(0), None, None, Some(0)]);
        assert_eq!(file.warnings.len(), 1);
        assert!(file.warnings[0].to_string().starts_with("a.obj:6: `usemtl` without a name"));
    }

    #[test]
    fn vertex_colours_are_decoded_from_srgb_and_white_ones_are_dropped() {
        let colors = |text: &str| read(&format!("{text}f 1 2 3\n")).unwrap().colors;
        let text = "v 0 0 0\nv 1 0 0 1 0 0.5\nv 0 1 0 1 x 1\n";
        let grey = srgb_decode(0.5);
        assert_eq!(colors(text), [Rgb::ONE, Rgb::new(1.0, 0.0, grey), Rgb::ONE]);
        let text = "v 0 0 0 255 0 51 255\nv 1 0 0\nv 0 1 0\n";
        assert_eq!(colors(text)[0], Rgb::new(1.0, 0.0, srgb_decode(0.2)));
        assert!(colors("v 0 0 0 1 1 1\nv 1 0 0\nv 0 1 0 1 1 1 1\n").is_empty());
    }
}
