//! Triangles that overlap in one plane: a carpet exactly on a floor, a lamp in a ceiling, a decal on a wall.
//!
//! No ray can tell which of them is in front, so rounding would decide, point by point. Here one of them is seen
//! over the whole overlap: one whose front faces the viewer before one whose back does, then that of the smaller
//! surface, then the later one. The others are there as little as what is behind them.

mod cut;
mod divided;
pub(super) mod flat;
mod near;
mod row;

use super::groups::Groups;
use super::material::MaterialId;
use super::topology::Topology;
use crate::geometry::bounds::Bounds;
use crate::geometry::{Triangle, TriangleId};
use flat::Polygon;
use glam::Vec3;
use row::{Flat, PARALLEL};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Pairs whose boxes are looked at, and those of them that are compared, before the plane is divided; then pieces and
/// pairs that are looked at, and overlaps: each per triangle, and beyond.
const MOST_BOXES: (u64, u64) = (256, 1_000_000);
const MOST_COMPARED: (u64, u64) = (32, 100_000);
const MOST_LOOKED_AT: (u64, u64) = (256, 4_000_000);
const MOST_FOUND: (u64, u64) = (32, 1_000_000);

/// Which triangles overlap others in their plane, and which of them are seen.
#[derive(Debug, Default)]
pub struct Overlaps {
    /// Per triangle and one beyond, where its list in `others` begins; empty if nothing overlaps.
    first: Vec<u32>,
    others: Vec<TriangleId>,
    /// Per triangle: of two that overlap the lower is seen.
    rank: Vec<u32>,
    /// Whether the search was given up: too many parallel triangles are in one place.
    pub(crate) is_given_up: bool,
}

impl Overlaps {
    pub fn is_empty(&self) -> bool {
        self.others.is_empty()
    }

    /// The triangles that overlap this one in its plane.
    #[inline]
    pub fn with(&self, triangle: TriangleId) -> &[TriangleId] {
        match self.first.get(triangle.index()..triangle.index() + 2) {
            Some(&[start, end]) => &self.others[start as usize..end as usize],
            _ => &[],
        }
    }

    /// Whether the first of two triangles that overlap is seen. Each comes with whether its front faces the
    /// viewer.
    pub fn comes_first(&self, a: (TriangleId, bool), b: (TriangleId, bool)) -> bool {
        let place = |(triangle, faces): (TriangleId, bool)| (!faces, self.rank[triangle.index()]);
        place(a) < place(b)
    }

    /// The triangles that overlap others.
    pub(crate) fn triangles(&self) -> impl Iterator<Item = TriangleId> + '_ {
        let numbers = (0..).map(TriangleId);
        self.first.windows(2).zip(numbers).filter(|(list, _)| list[0] < list[1]).map(|(_, t)| t)
    }

    /// `material_of` has one entry per triangle.
    pub(super) fn find(triangles: &[Triangle], material_of: &[MaterialId]) -> Overlaps {
        let bounds = |number: u32| padded(&triangles[number as usize]);
        let flat = |number: u32| flat_of(&triangles[number as usize]);
        let overlap = |a: u32, b: u32| overlap(&triangles[a as usize], &triangles[b as usize]);
        let limit = |most: (u64, u64)| most.0 * triangles.len() as u64 + most.1;
        let few = [MOST_BOXES, MOST_COMPARED].map(limit);
        let divided =
            || divided::pairs(triangles, flat, overlap, [MOST_LOOKED_AT, MOST_FOUND].map(limit));
        let near = near::pairs(triangles.len(), bounds, flat, overlap, few);
        let pairs = near.or_else(divided);
        match pairs {
            None => Overlaps { is_given_up: true, ..Overlaps::default() },
            Some(pairs) if pairs.is_empty() => Overlaps::default(),
            Some(pairs) => Overlaps::new(triangles, material_of, &pairs),
        }
    }

    fn new(triangles: &[Triangle], material_of: &[MaterialId], pairs: &[(u32, u32)]) -> Overlaps {
        let mut both: Vec<(u32, u32)> = pairs.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
        both.sort_unstable();
        let mut first = vec![0; triangles.len() + 1];
        both.iter().for_each(|pair| first[pair.0 as usize + 1] += 1);
        (1..first.len()).for_each(|t| first[t] += first[t - 1]);
        let mut overlaps = Overlaps {
            first,
            others: both.iter().map(|pair| TriangleId(pair.1)).collect(),
            rank: vec![0; triangles.len()],
            is_given_up: false,
        };
        let numbers: Vec<TriangleId> = overlaps.triangles().collect();
        let surfaces = Surfaces {
            triangles: numbers.iter().map(|t| triangles[t.index()]).collect(),
            material_of: numbers.iter().map(|t| material_of[t.index()]).collect(),
        };
        let within = |t: u32| numbers.partition_point(|number| number.0 < t);
        let pairs: Vec<_> = pairs.iter().map(|&(a, b)| (within(a), within(b))).collect();
        for (rank, k) in (0..).zip(surfaces.in_order(&pairs)) {
            overlaps.rank[numbers[k].index()] = rank;
        }
        overlaps
    }
}

/// The triangles that overlap others.
struct Surfaces {
    triangles: Vec<Triangle>,
    material_of: Vec<MaterialId>,
}

fn flat_of(triangle: &Triangle) -> Flat {
    Flat { bounds: padded(triangle), normal: triangle.normal() }
}

/// Grown by what lifts rays off the triangle.
#[inline]
fn padded(triangle: &Triangle) -> Bounds {
    let (bounds, pad) = (triangle.bounds(), triangle.ray_offset());
    Bounds { min: bounds.min - pad, max: bounds.max + pad }
}

/// Whether two triangles lie so near to each other over a common area that rays lifted off one of them start
/// beyond the other. A common rim, no wider than that, does not count.
fn overlap(a: &Triangle, b: &Triangle) -> bool {
    let tolerance = a.ray_offset().max(b.ray_offset()) as f64;
    let n = a.double_area_normal();
    let axis = flat::axis_of(n);
    let flat = [a, b].map(|triangle| flat::seen_along(axis, triangle));
    // First, as it needs no root for neighbours, which most pairs are.
    if flat::are_apart(&flat[0], &flat[1], tolerance) {
        return false;
    }
    let n = n.normalize();
    let away = b.p.map(|p| n.dot((p - a.p[0]).as_dvec3()));
    if away.iter().all(|&d| d > tolerance) || away.iter().all(|&d| d < -tolerance) {
        return false;
    }
    let common: Polygon = flat::common(&flat[0], &flat[1]);
    let steepness = n[axis].abs();
    let apart = |&p| (flat::height_at(axis, a, p) - flat::height_at(axis, b, p)).abs() * steepness;
    flat::area(&common) > tolerance * flat::perimeter(&common)
        && common.iter().all(|p| apart(p) <= tolerance)
}

impl Surfaces {
    /// The triangles, those of smaller surfaces first.
    ///
    /// A carpet may lie on many tiles, each smaller than it: so first all triangles of a material that hang
    /// together, be it by edges or by what overlaps them, are one surface; only then those that hang together by
    /// edges.
    fn in_order(&self, pairs: &[(usize, usize)]) -> Vec<usize> {
        let count = self.triangles.len();
        let normals: Vec<Vec3> = self.triangles.iter().map(Triangle::normal).collect();
        let (mut surfaces, mut places) = (Groups::new(count), Groups::new(count));
        for edge in Topology::new(&self.triangles).edges() {
            let at_edge: Vec<usize> = edge.map(|half| half.triangle.index()).collect();
            for pair in at_edge.windows(2) {
                let &[a, b] = pair else { continue };
                if self.material_of[a] == self.material_of[b]
                    && normals[a].dot(normals[b]) > PARALLEL
                {
                    surfaces.join(a, b);
                    places.join(a, b);
                }
            }
        }
        pairs.iter().for_each(|&(a, b)| places.join(a, b));
        let (mut of_material, mut of_surface) = (BTreeMap::new(), vec![0.0; count]);
        for (t, triangle) in self.triangles.iter().enumerate() {
            *of_material.entry((places.root(t), self.material_of[t].0)).or_insert(0.0) +=
                triangle.area();
            of_surface[surfaces.root(t)] += triangle.area();
        }
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_cached_key(|&t| {
            let surface = surfaces.root(t);
            let material: f64 = of_material[&(places.root(t), self.material_of[t].0)];
            // Areas are not negative, and the bits of such numbers are in their order.
            (material.to_bits(), of_surface[surface].to_bits(), Reverse((surface, t)))
        });
        order
    }
}

#[cfg(test)]
mod tests;
