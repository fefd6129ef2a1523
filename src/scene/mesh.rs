//! Where the triangles of a scene come from: the faces of the model files, their names, and the
//! texture coordinates and normals at their corners.
//!
//! Light needs none of it. It is kept so that results can go back to the faces that a user knows.

use crate::color::Rgb;
use crate::geometry::TriangleId;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// The faces that the triangles of a scene come from, as the model files give them. It is empty for triangles that come
/// from no file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// One per triangle, or none at all.
    pub origins: Vec<Origin>,
    pub parts: Vec<Part>,
    /// Texture coordinates (`vt`); None if no face has any.
    pub texture: Option<PerCorner<Vec2>>,
    /// Shading normals (`vn`) as the file gives them, of any length; None if no face has any.
    pub normals: Option<PerCorner<Vec3>>,
    /// Linear colours that multiply the reflectance; None if no face has any.
    pub colors: Option<PerCorner<Rgb>>,
}

/// The face that a triangle was cut from. A polygon becomes several triangles with one origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Number of the face (`f`) in its model file, from 1. Faces without area count too.
    pub face: u32,
    /// Index into [`Mesh::parts`].
    pub part: u32,
}

/// The faces of a model that have their object and their group in common.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Part {
    /// Index into [`Document::models`](super::Document::models).
    pub model: u32,
    /// The name after `o`, or of the node, mesh or solid.
    pub object: Option<String>,
    /// The names after `g`.
    pub group: Option<String>,
}

/// A list of values, and which of them the corners of the triangles have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PerCorner<T> {
    pub values: Vec<T>,
    /// Per triangle and corner: the number of the value, counted from 1; 0 if there is none.
    pub numbers: Vec<[u32; 3]>,
}

impl<T: Copy> PerCorner<T> {
    /// None if no corner has a value.
    pub fn new(values: Vec<T>, numbers: Vec<[u32; 3]>) -> Option<Self> {
        let some = numbers.iter().any(|corners| *corners != [0; 3]);
        some.then_some(PerCorner { values, numbers })
    }

    /// The value at a corner, 0 to 2, of a triangle.
    pub fn at(&self, triangle: TriangleId, corner: usize) -> Option<T> {
        let number = self.numbers[triangle.index()][corner] as usize;
        number.checked_sub(1).map(|index| self.values[index])
    }

    /// `before` is the number of triangles so far, `count` that of the triangles of `more`.
    fn append(all: &mut Option<Self>, before: usize, more: Option<Self>, count: usize) {
        if all.is_none() && more.is_none() {
            return;
        }
        let all =
            all.get_or_insert_with(|| PerCorner { values: vec![], numbers: vec![[0; 3]; before] });
        let offset = all.values.len() as u32;
        let shifted = |number: u32| if number == 0 { 0 } else { number + offset };
        if let Some(more) = more {
            all.values.extend(more.values);
            all.numbers.extend(more.numbers.into_iter().map(|corners| corners.map(shifted)));
        }
        all.numbers.resize(before + count, [0; 3]);
    }

    fn fits(&self, triangles: usize) -> bool {
        let valid = |number: &u32| *number as usize <= self.values.len();
        self.numbers.len() == triangles && self.numbers.as_flattened().iter().all(valid)
    }
}

impl Mesh {
    /// The object and group of a triangle; None if it comes from no file.
    pub fn part_of(&self, triangle: TriangleId) -> Option<&Part> {
        self.origins.get(triangle.index()).map(|origin| &self.parts[origin.part as usize])
    }

    /// The vertex colour at barycentrics (u, v) of a triangle; a corner without one is white.
    pub fn color_at(&self, triangle: TriangleId, u: f32, v: f32) -> Rgb {
        let Some(colors) = &self.colors else { return Rgb::ONE };
        let [a, b, c] = [0, 1, 2].map(|corner| colors.at(triangle, corner).unwrap_or(Rgb::ONE));
        a + (b - a) * u + (c - a) * v
    }

    /// How many objects the files name; those without a face do not count.
    pub fn object_count(&self) -> usize {
        let named = |part: &Part| part.object.clone().map(|name| (part.model, name));
        self.parts.iter().filter_map(named).collect::<HashSet<_>>().len()
    }

    /// Adds the triangles of another model behind those here.
    pub fn append(&mut self, model: u32, more: Mesh) {
        let (before, count) = (self.origins.len(), more.origins.len());
        let offset = self.parts.len() as u32;
        self.parts.extend(more.parts.into_iter().map(|part| Part { model, ..part }));
        let shifted = |origin: Origin| Origin { part: origin.part + offset, ..origin };
        self.origins.extend(more.origins.into_iter().map(shifted));
        PerCorner::append(&mut self.texture, before, more.texture, count);
        PerCorner::append(&mut self.normals, before, more.normals, count);
        PerCorner::append(&mut self.colors, before, more.colors, count);
    }

    /// Leaves out the triangles that are not `kept`. The others keep their face numbers.
    pub fn retain(&mut self, kept: &[bool]) {
        retain(&mut self.origins, kept);
        if let Some(texture) = &mut self.texture {
            retain(&mut texture.numbers, kept);
        }
        if let Some(normals) = &mut self.normals {
            retain(&mut normals.numbers, kept);
        }
        if let Some(colors) = &mut self.colors {
            retain(&mut colors.numbers, kept);
        }
    }

    /// Whether this can belong to a scene with that number of triangles, and no index points outside
    /// its list.
    pub fn fits(&self, triangles: usize) -> bool {
        (*self == Mesh::default() || self.origins.len() == triangles)
            && self.origins.iter().all(|origin| (origin.part as usize) < self.parts.len())
            && self.texture.as_ref().is_none_or(|texture| texture.fits(triangles))
            && self.normals.as_ref().is_none_or(|normals| normals.fits(triangles))
            && self.colors.as_ref().is_none_or(|colors| colors.fits(triangles))
    }
}

/// Leaves out the items that are not `kept`.
pub(super) fn retain<T: Copy>(list: &mut Vec<T>, kept: &[bool]) {
    assert_eq!(list.len(), kept.len(), "one answer per triangle");
    let (mut start, mut filled) = (0, 0);
    // Few are left out, so that the others move in long runs.
    for run in kept.chunk_by(|a, b| a == b) {
        let end = start + run.len();
        if run[0] {
            list.copy_within(start..end, filled);
            filled += run.len();
        }
        start = end;
    }
    list.truncate(filled);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn model(object: &str, faces: u32) -> Mesh {
        Mesh {
            origins: (1..=faces).map(|face| Origin { face, part: 0 }).collect(),
            parts: vec![Part { model: 0, object: Some(object.into()), group: None }],
            ..Mesh::default()
        }
    }

    #[test]
    fn each_model_counts_its_own_faces() {
        let mut mesh = Mesh::default();
        mesh.append(0, model("a", 2));
        mesh.append(1, model("a", 1));
        assert_eq!(mesh.origins.iter().map(|o| o.face).collect::<Vec<_>>(), [1, 2, 1]);
        assert_eq!(mesh.part_of(TriangleId(2)).unwrap().model, 1);
        assert_eq!(mesh.object_count(), 2);
        assert!(mesh.fits(3) && !mesh.fits(2));
    }

    #[test]
    fn a_model_without_normals_has_none_beside_one_with_normals() {
        let mut with = model("b", 1);
        with.normals = PerCorner::new(vec![Vec3::Z], vec![[1, 0, 1]]);
        let mut mesh = Mesh::default();
        mesh.append(0, with.clone());
        mesh.append(1, model("a", 1));
        mesh.append(2, with);
        let normals = mesh.normals.as_ref().unwrap();
        assert_eq!(normals.numbers, [[1, 0, 1], [0; 3], [2, 0, 2]]);
        assert_eq!(normals.at(TriangleId(2), 2), Some(Vec3::Z));
        assert_eq!(normals.at(TriangleId(1), 2), None);
        assert!(mesh.fits(3));
    }

    #[test]
    fn triangles_that_are_left_out_leave_a_gap_in_the_face_numbers() {
        let mut mesh = model("a", 3);
        mesh.retain(&[true, false, true]);
        assert_eq!(mesh.origins.iter().map(|o| o.face).collect::<Vec<_>>(), [1, 3]);
    }
}
