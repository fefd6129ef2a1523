//! `tobj`'s errors carry no line, and some malformed lines it reads as something else. So each
//! line of an OBJ file is checked first, and `tobj` gets a plain text with nothing left to doubt:
//! `v` lines, then `f` lines with positive vertex indices, with `usemtl` where the material changes.

use std::collections::HashSet;
use std::path::Path;

use super::left_aside::LeftAside;
use super::text::{LARGEST, keyword_and_rest, number, numbered_lines, quote, words};
use crate::error::{Error, Result, Warning};

/// What of an OBJ file matters here, known to be sound.
#[derive(Debug, Default)]
pub(super) struct CheckedObj {
    /// `v` lines for `tobj`: 3 coordinates, and the weight w where there is one.
    pub vertices: String,
    /// `f` and `usemtl` lines for `tobj`. Indices are positive and within the range.
    pub faces: String,
    /// The `mtllib` lines, in file order.
    pub libraries: Vec<Named>,
    /// The materials that faces use, in the order of their first `usemtl`.
    pub materials: Vec<Named>,
    pub warnings: Vec<Warning>,
}

/// What follows a keyword, and the line where it stood first.
#[derive(Debug, PartialEq)]
pub(super) struct Named {
    pub name: String,
    pub line: usize,
}

/// Checks the `text` of the OBJ file at `path`. Fails at the first line that has no meaning, or if
/// no line is a face.
pub(super) fn check_obj(path: &Path, text: &str) -> Result<CheckedObj> {
    let mut checker = Checker::default();
    for (number, line) in numbered_lines(text) {
        checker.statement(number, &line).map_err(|e| e.in_file(path).at_line(number))?;
    }
    checker.finish(path)
}

#[derive(Default)]
struct Checker {
    checked: CheckedObj,
    vertices: usize,
    faces: usize,
    /// Positive indices beyond the vertices so far, each higher than the one before, with their
    /// lines: the first index out of range must be among them.
    forward: Vec<(usize, usize)>,
    /// The names in `checked.materials`.
    material_names: HashSet<String>,
    /// The latest `usemtl`, not yet written to `checked.faces`.
    new_material: Option<Named>,
    left_aside: LeftAside,
}

impl Checker {
    fn statement(&mut self, line: usize, text: &str) -> Result<()> {
        let (keyword, rest) = keyword_and_rest(text);
        match keyword {
            "v" => self.vertex(rest)?,
            "f" | "fo" => self.face(line, rest)?,
            "usemtl" => self.usemtl(line, rest)?,
            "mtllib" => self.checked.libraries.push(Named { name: rest.to_owned(), line }),
            _ => self.left_aside.statement(line, keyword),
        }
        Ok(())
    }

    /// `v x y z`, `v x y z w`, or `v x y z r g b` with perhaps an opacity. Colours are dropped.
    fn vertex(&mut self, rest: &str) -> Result<()> {
        let mut values = [0.0; 7];
        let mut count = 0;
        for word in words(rest) {
            let value = number(word)?;
            if let Some(slot) = values.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
        let (kept, w) = match count {
            3 | 6 | 7 => (3, 1.0),
            4 => (4, values[3]),
            _ => return Err(wrong_vertex(count)),
        };
        check_position([values[0], values[1], values[2]], w)?;
        self.vertices += 1;
        write_line(&mut self.checked.vertices, "v", words(rest).take(kept));
        Ok(())
    }

    /// `f` with one word per corner: `v`, `v/vt`, `v//vn` or `v/vt/vn`.
    fn face(&mut self, line: usize, rest: &str) -> Result<()> {
        self.write_material(line);
        self.checked.faces.push('f');
        let mut corners = 0;
        for word in words(rest) {
            self.corner(line, word)?;
            corners += 1;
        }
        self.checked.faces.push('\n');
        self.faces += 1;
        if corners < 3 {
            return Err(Error::new(format!("a face needs 3 vertices, this one has {corners}"))
                .remedy("complete the face or delete the line"));
        }
        Ok(())
    }

    /// Normals and texture coordinates are of no use here, so their indices need only be numerals.
    fn corner(&mut self, line: usize, word: &str) -> Result<()> {
        let (vertex, others) = word.split_once('/').unwrap_or((word, ""));
        let numerals = others.bytes().all(|byte| b"0123456789+-/".contains(&byte));
        let Some(index) = vertex.parse::<i64>().ok().filter(|_| numerals) else {
            return Err(Error::new(format!("{} is not a vertex index", quote(word)))
                .remedy("write each corner of a face as v, v/vt, v//vn or v/vt/vn"));
        };
        if index < 0 {
            let position = resolve_negative(index, self.vertices)?;
            self.checked.faces.push_str(&format!(" {position}"));
            return Ok(());
        }
        let index = index as usize;
        if index == 0 {
            return Err(Error::new("vertex index 0 does not exist").remedy(
                "count vertices from 1, or backwards from -1, the vertex before the face",
            ));
        }
        let highest = self.forward.last().map_or(0, |&(_, highest)| highest);
        if index > highest.max(self.vertices) {
            self.forward.push((line, index));
        }
        self.checked.faces.push(' ');
        self.checked.faces.push_str(vertex);
        Ok(())
    }

    fn usemtl(&mut self, line: usize, name: &str) -> Result<()> {
        if name.is_empty() {
            return Err(Error::new("`usemtl` without the name of a material")
                .remedy("add the name or delete the line"));
        }
        self.new_material = Some(Named { name: name.to_owned(), line });
        Ok(())
    }

    /// Called before each face, so that a material that no face uses is never mentioned.
    fn write_material(&mut self, line: usize) {
        if let Some(material) = self.new_material.take() {
            write_line(&mut self.checked.faces, "usemtl", [material.name.as_str()]);
            if self.material_names.insert(material.name.clone()) {
                self.checked.materials.push(material);
            }
        } else if self.checked.materials.is_empty() {
            self.left_aside.face_before_usemtl(line);
        }
    }

    fn finish(mut self, path: &Path) -> Result<CheckedObj> {
        let count = self.vertices;
        if let Some((line, index)) = self.forward.iter().find(|(_, index)| *index > count) {
            return Err(out_of_range(*index as i64, &format!("the file has {count} vertices"))
                .in_file(path)
                .at_line(*line));
        }
        if self.faces == 0 {
            return Err(Error::new("the file contains no faces, so there is nothing to render")
                .in_file(path)
                .remedy("export the model as triangles or polygons (`f` lines)"));
        }
        self.checked.warnings = self.left_aside.warnings(path);
        Ok(self.checked)
    }
}

fn wrong_vertex(count: usize) -> Error {
    Error::new(format!("a vertex has 3 coordinates, this line has {count} numbers"))
        .remedy("write `v x y z`, `v x y z w` or `v x y z r g b`")
}

/// `tobj` divides the coordinates by `w`, so that is done here too.
fn check_position(coordinates: [f32; 3], w: f32) -> Result<()> {
    if w == 0.0 {
        return Err(Error::new("the weight w is 0, so the vertex is infinitely far away")
            .remedy("delete w, or set it to 1"));
    }
    match coordinates.into_iter().map(|x| x / w).find(|x| x.abs() > LARGEST) {
        Some(x) => Err(Error::new(format!("coordinate {x:e} is larger than {LARGEST:e}"))
            .remedy("scale the model down, for instance from millimetres to metres")),
        None => Ok(()),
    }
}

/// -1 is the latest of the `vertices` so far.
fn resolve_negative(index: i64, vertices: usize) -> Result<usize> {
    usize::try_from(index.unsigned_abs())
        .ok()
        .and_then(|back| (vertices + 1).checked_sub(back))
        .filter(|position| *position > 0)
        .ok_or_else(|| out_of_range(index, &format!("{vertices} vertices precede this line")))
}

fn out_of_range(index: i64, range: &str) -> Error {
    Error::new(format!("vertex index {index} is out of range: {range}"))
        .remedy("correct the index, or restore the missing `v` lines")
}

fn write_line<'a>(to: &mut String, keyword: &str, words: impl IntoIterator<Item = &'a str>) {
    to.push_str(keyword);
    for word in words {
        to.push(' ');
        to.push_str(word);
    }
    to.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

    fn check(text: &str) -> Result<CheckedObj> {
        check_obj(Path::new("a.obj"), text)
    }

    /// The first line of the message, for `line` after the three vertices.
    fn error_of(line: &str) -> String {
        let error = check(&format!("{TRIANGLE}{line}\n")).expect_err(line).to_string();
        error.lines().next().unwrap_or_default().to_owned()
    }

    #[test]
    fn a_face_with_two_vertices_names_its_line() {
        assert_eq!(error_of("f 1 2"), "a.obj:4: a face needs 3 vertices, this one has 2");
        assert_eq!(error_of("f"), "a.obj:4: a face needs 3 vertices, this one has 0");
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
    fn what_tobj_gets_is_plain() {
        let text = "f 1/1/1 2//2 \\\n -1 # corner\nv 1 1 1 1 0 0\nf 5 -1 1\nv 2 2 2 2\n";
        let checked = check(&format!("{TRIANGLE}{text}")).unwrap();
        assert_eq!(checked.vertices, format!("{TRIANGLE}v 1 1 1\nv 2 2 2 2\n"));
        assert_eq!(checked.faces, "f 1 2 3\nf 5 4 1\n");
    }

    #[test]
    fn only_materials_of_faces_are_kept_and_each_once() {
        let text =
            "usemtl a\nusemtl b c\nf 1 2 3\nusemtl d\nf 1 2 3\nusemtl b c\nf 1 2 3\nusemtl e";
        let checked = check(&format!("{TRIANGLE}{text}")).unwrap();
        let named = |name: &str, line| Named { name: name.into(), line };
        assert_eq!(checked.materials, [named("b c", 5), named("d", 7)]);
        assert_eq!(checked.faces.matches("usemtl b c\n").count(), 2);
        assert_eq!(checked.warnings, []);
        assert!(error_of("usemtl  ").contains("without the name"));
    }

    #[test]
    fn a_file_without_faces_is_refused_without_a_line() {
        assert!(error_of("l 1 2").starts_with("a.obj: the file contains no faces"));
    }
}
