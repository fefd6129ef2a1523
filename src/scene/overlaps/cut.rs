//! Pieces of triangles seen along an axis, and what cuts them apart.

use super::flat::{Polygon, axis_of, flatten, left_of};
use crate::geometry::Triangle;
use glam::{DVec2, DVec3};

/// What a piece may lose at a cut, so that rounding does not cut neighbours: the share of what lifts rays off its
/// triangle.
pub(super) const RIM: f64 = 1.0 / 256.0;

/// How far two triangles that overlap may be apart along the axis, as a multiple of what lifts rays off them: their
/// planes are at 55° to it at most, and a little more if they are not quite parallel.
const APART: f64 = 2.0;

/// A triangle, or what cuts have left of it.
pub(super) struct Piece {
    pub number: u32,
    part: Option<Box<Polygon>>,
}

impl Piece {
    pub(super) fn whole(number: u32) -> Piece {
        Piece { number, part: None }
    }
}

/// Divides pieces into those on its left, or above, and those on the other side.
pub(super) enum Cut {
    /// A line with a direction of length 1.
    Line { from: DVec2, along: DVec2 },
    /// A plane with a normal of length 1, for what lies in layers. A piece that it meets goes whole to both sides.
    Plane { from: DVec3, normal: DVec3 },
}

/// The triangles to which pieces belong, and the axis along which they are seen.
#[derive(Clone, Copy)]
pub(super) struct View<'t> {
    pub axis: usize,
    pub triangles: &'t [Triangle],
}

impl View<'_> {
    pub(super) fn triangle(&self, piece: &Piece) -> &Triangle {
        &self.triangles[piece.number as usize]
    }

    /// Whether it is along this axis that others are compared with a triangle.
    pub(super) fn is_axis_of(&self, number: u32) -> bool {
        axis_of(self.triangles[number as usize].double_area_normal()) == self.axis
    }

    /// On which sides a piece lies: on one at least. What lies on different sides of a cut does not overlap.
    pub(super) fn sides(&self, cut: &Cut, piece: &Piece) -> [bool; 2] {
        let triangle = self.triangle(piece);
        let range = |least: (f64, f64), d: f64| (least.0.min(d), least.1.max(d));
        let nothing = (f64::MAX, f64::MIN);
        let offset = triangle.ray_offset() as f64;
        let (least, most) = match *cut {
            Cut::Line { from, along } => {
                let distance = |p: &DVec2| along.perp_dot(p - from);
                let (least, most) = match &piece.part {
                    Some(part) => part.iter().map(distance).fold(nothing, range),
                    None => self.corners(triangle).iter().map(distance).fold(nothing, range),
                };
                (least + RIM * offset, most - RIM * offset)
            }
            Cut::Plane { from, normal } => {
                let distances = triangle.p.map(|p| normal.dot(p.as_dvec3() - from));
                let (least, most) = distances.into_iter().fold(nothing, range);
                (least - APART * offset, most + APART * offset)
            }
        };
        [most > 0.0 || least >= 0.0, least < 0.0]
    }

    /// The parts of a piece that is on both sides.
    pub(super) fn parts(&self, cut: &Cut, piece: Piece) -> [Piece; 2] {
        let number = piece.number;
        let parts = match *cut {
            Cut::Plane { .. } => [piece.part.clone(), piece.part],
            Cut::Line { from, along } => {
                let corners = self.corners(self.triangle(&piece));
                let polygon = piece.part.as_ref().map_or(&corners[..], |part| part);
                [along, -along].map(|along| Some(Box::new(left_of(polygon, from, along))))
            }
        };
        parts.map(|part| Piece { number, part })
    }

    fn corners(&self, triangle: &Triangle) -> [DVec2; 3] {
        triangle.p.map(|p| flatten(self.axis, p.as_dvec3()))
    }

    /// The lines through a triangle's edges, and the plane that it lies just below.
    pub(super) fn cuts_at(&self, piece: &Piece) -> impl Iterator<Item = Cut> {
        let triangle = self.triangle(piece);
        let corners = self.corners(triangle);
        let lines = (0..3).map(move |k| Cut::Line {
            from: corners[k],
            along: (corners[(k + 1) % 3] - corners[k]).normalize_or_zero(),
        });
        let normal = triangle.double_area_normal().normalize();
        let above = 2.0 * APART * triangle.ray_offset() as f64;
        let plane = Cut::Plane { from: triangle.p[0].as_dvec3() + normal * above, normal };
        lines.chain([plane])
    }

    /// Cuts across the axes in the middle of some pieces.
    pub(super) fn cuts_amid(&self, pieces: &[&Piece]) -> [Cut; 3] {
        let centers = pieces.iter().map(|piece| match &piece.part {
            None => self.triangle(piece).centroid().as_dvec3(),
            Some(part) => {
                let center = part.iter().sum::<DVec2>() / part.len() as f64;
                let height = self.triangle(piece).centroid()[self.axis] as f64;
                match self.axis {
                    0 => DVec3::new(height, center.x, center.y),
                    1 => DVec3::new(center.y, height, center.x),
                    _ => center.extend(height),
                }
            }
        });
        let centers: Vec<DVec3> = centers.collect();
        let middle = |axis: usize| {
            let mut places: Vec<f64> = centers.iter().map(|center| center[axis]).collect();
            let half = places.len() / 2;
            *places.select_nth_unstable_by(half, f64::total_cmp).1
        };
        let middle = DVec3::new(middle(0), middle(1), middle(2));
        let from = flatten(self.axis, middle);
        let normal = DVec3::AXES[self.axis];
        [
            Cut::Line { from, along: DVec2::X },
            Cut::Line { from, along: DVec2::Y },
            Cut::Plane { from: middle, normal },
        ]
    }
}
