//! Counts the statements of an OBJ file that are left aside, for one warning of each kind.

use std::path::Path;

use crate::error::Warning;
use crate::scene::material::Material;
use crate::scene::text::quote;

/// Counts what is left aside.
#[derive(Debug, Default)]
pub(super) struct LeftAside {
    faces_before_usemtl: Tally,
    blank_usemtl: Tally,
    short_faces: Tally,
    bad_vertices: Tally,
    bad_coordinates: Tally,
    points_and_lines: Tally,
    free_form: Tally,
    unknown: Tally,
    /// The first unknown keyword.
    unknown_word: String,
}

/// Statements about curved surfaces, which would have to be tessellated.
const FREE_FORM: [&str; 21] = [
    "vp", "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv",
    "sp", "end", "con", "bsp", "bzp", "cdc", "cdp", "ctech", "stech",
];

/// Statements without any bearing on the geometry or its materials.
const WITHOUT_EFFECT: [&str; 11] = [
    "",
    "s",
    "mg",
    "bevel",
    "lod",
    "c_interp",
    "d_interp",
    "shadow_obj",
    "trace_obj",
    "maplib",
    "usemap",
];

impl LeftAside {
    pub(super) fn face_before_usemtl(&mut self, line: usize) {
        self.faces_before_usemtl.add(line);
    }

    pub(super) fn blank_usemtl(&mut self, line: usize) {
        self.blank_usemtl.add(line);
    }

    /// A face with fewer than three vertices.
    pub(super) fn short_face(&mut self, line: usize) {
        self.short_faces.add(line);
    }

    /// A vertex without a position that no face uses.
    pub(super) fn bad_vertex(&mut self, line: usize) {
        self.bad_vertices.add(line);
    }

    /// A texture coordinate, normal or vertex colour that is not made of numbers.
    pub(super) fn bad_coordinate(&mut self, line: usize) {
        self.bad_coordinates.add(line);
    }

    /// A statement that is no vertex, no face and names no material.
    pub(super) fn statement(&mut self, line: usize, keyword: &str) {
        match keyword {
            "p" | "l" => self.points_and_lines.add(line),
            _ if WITHOUT_EFFECT.contains(&keyword) => {}
            _ if FREE_FORM.contains(&keyword) => self.free_form.add(line),
            _ => {
                if self.unknown.count == 0 {
                    self.unknown_word = quote(keyword);
                }
                self.unknown.add(line);
            }
        }
    }

    /// One warning for each kind that occurred; `file` is the OBJ file.
    pub(super) fn warnings(&self, file: &Path, has_colors: bool) -> Vec<Warning> {
        let default = if has_colors {
            "the default material, white times the vertex colours".into()
        } else {
            default_stated()
        };
        let word = &self.unknown_word;
        [
            (self.faces_before_usemtl, format!("a face before any `usemtl` gets {default}")),
            (self.blank_usemtl, format!("`usemtl` without a name stands for {default}")),
            (
                self.short_faces,
                "a face with fewer than 3 vertices has no area and is ignored".into(),
            ),
            (self.bad_vertices, "a vertex that no face uses is malformed".into()),
            (
                self.bad_coordinates,
                "a malformed texture coordinate or normal is 0, a malformed colour white".into(),
            ),
            (self.points_and_lines, "points and lines have no area and are ignored".into()),
            (self.free_form, "curves and free-form surfaces are ignored".into()),
            (self.unknown, format!("{word} is not an OBJ statement; such lines are ignored")),
        ]
        .into_iter()
        .filter(|(tally, _)| tally.count > 0)
        .map(|(tally, note)| {
            let text = format!("{note} ({} in all)", tally.count);
            Warning::in_file(file, Some(tally.first), text)
        })
        .collect()
    }
}

/// For warnings: what a face gets whose own material is missing.
pub(super) fn default_stated() -> String {
    format!("the default material, reflectance {}", Material::fallback().reflectance.x)
}

/// How often something was seen, and the line of the first time.
#[derive(Debug, Default, Clone, Copy)]
struct Tally {
    count: usize,
    first: usize,
}

impl Tally {
    fn add(&mut self, line: usize) {
        if self.count == 0 {
            self.first = line;
        }
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_told_once_with_its_count_and_first_line() {
        let mut left = LeftAside::default();
        left.face_before_usemtl(4);
        let statements = ["p", "l", "l", "vp", "surf", "foo", "bar", "s", "lod", ""];
        statements.iter().zip(5..).for_each(|(keyword, line)| left.statement(line, keyword));
        let warnings: Vec<String> =
            left.warnings(Path::new("a.obj"), false).iter().map(Warning::to_string).collect();
        assert_eq!(
            warnings,
            [
                "a.obj:4: a face before any `usemtl` gets the default material, reflectance 0.5 \
                 (1 in all)",
                "a.obj:5: points and lines have no area and are ignored (3 in all)",
                "a.obj:8: curves and free-form surfaces are ignored (2 in all)",
                "a.obj:10: `foo` is not an OBJ statement; such lines are ignored (2 in all)",
            ]
        );
    }
}
