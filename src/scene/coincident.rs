//! Triangles that lie exactly where others do.
//!
//! Modellers write what has two sides as two triangles with opposite windings. They are one sheet here, with
//! a material on either side. Of equal copies the first counts.

use super::material::MaterialId;
use super::topology::{Topology, VertexId};
use crate::error::Warning;

/// What becomes of the copies.
pub(super) struct Sheets {
    /// Per triangle, whether it stays.
    pub kept: Vec<bool>,
    /// Per triangle that stays, the material of its back if that is a triangle of its own.
    pub back_of: Vec<Option<MaterialId>>,
    /// Copies that are left out: those that became backs, and the others.
    pub backs: usize,
    pub equal: usize,
}

impl Sheets {
    pub(super) fn warning(&self) -> Warning {
        Warning::new(format!(
            "{} triangles lie exactly where others do: {} are taken as the backs of these, {} are left out",
            self.backs + self.equal,
            self.backs,
            self.equal
        ))
    }
}

/// `None` if no triangle is there twice.
pub(super) fn find(topology: &Topology, material_of: &[MaterialId]) -> Option<Sheets> {
    let lists = topology.copies();
    if lists.is_empty() {
        return None;
    }
    let mut kept = vec![true; material_of.len()];
    let mut back_of = vec![None; material_of.len()];
    let (mut backs, mut equal) = (0, 0);
    for list in lists {
        let first = list[0].index();
        for copy in list[1..].iter().map(|copy| copy.index()) {
            kept[copy] = false;
            if is_even(&topology.corners[first]) == is_even(&topology.corners[copy]) {
                equal += 1;
            } else if back_of[first].is_none() {
                back_of[first] = Some(material_of[copy]);
                backs += 1;
            } else {
                equal += 1;
            }
        }
    }
    let mut stays = kept.iter();
    back_of.retain(|_| *stays.next().expect("one answer per triangle"));
    Some(Sheets { kept, back_of, backs, equal })
}

/// Whether the corners run in the direction of their numbers.
fn is_even([a, b, c]: &[VertexId; 3]) -> bool {
    (a < b) as u8 + ((b < c) as u8) + ((c < a) as u8) == 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Triangle;
    use glam::Vec3;

    #[test]
    fn an_opposite_copy_becomes_the_back_and_an_equal_one_goes() {
        let (a, b, c, d) = (Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z);
        let triangles = [
            Triangle::new(a, b, c),
            Triangle::new(a, b, d),
            Triangle::new(b, a, c),
            Triangle::new(c, a, b),
            Triangle::new(b, d, a),
            Triangle::new(c, b, a),
        ];
        let materials = [0, 1, 2, 3, 4, 5].map(MaterialId);
        let sheets = find(&Topology::new(&triangles), &materials).unwrap();
        assert_eq!(sheets.kept, [true, true, false, false, false, false]);
        // b, d, a is a, b, d turned: an equal copy.
        assert_eq!(sheets.back_of, [Some(MaterialId(2)), None]);
        assert_eq!((sheets.backs, sheets.equal), (1, 3));
        assert!(find(&Topology::new(&triangles[..2]), &materials[..2]).is_none());
    }
}
