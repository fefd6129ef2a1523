//! Triangles that overlap in one plane: a carpet exactly on a floor, a lamp in a ceiling, a decal on a wall.
//!
//! No ray can tell which of them is in front, so rounding would decide, point by point. Here one of them is seen
//! over the whole overlap: one whose front faces the viewer before one whose back does, then that of the smaller
//! surface, then the later one. The others are there as little as what is behind them.

pub(super) mod flat;
mod near;

use super::groups::Groups;
use super::material::MaterialId;
use super::topology::Topology;
use crate::geometry::bounds::Bounds;
use crate::geometry::{Triangle, TriangleId};
use flat::Polygon;
use glam::Vec3;
use near::Boxed;
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Normals with a smaller cosine between them are not those of one plane. Within the tolerance of rays two
/// planes at a degree stay together for a few thousandths of a percent of the scene only.
const PARALLEL: f32 = 0.9998;

/// Pairs that are looked at: per triangle, and beyond.
const MOST_PAIRS: (u64, u64) = (1024, 100_000_000);

/// Which triangles overlap others in their plane, and which of them are seen.
#[derive(Debug, Default)]
pub struct Overlaps {
    /// Per triangle and one beyond, where its list in `others` begins; empty if nothing overlaps.
    first: Vec<u32>,
    others: Vec<TriangleId>,
    /// Per triangle: of two that overlap the lower is seen.
    rank: Vec<u32>,
    /// Whether the search was given up: nearly all triangles are in one place.
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

    /// `material_of` has one entry per triangle; `topology` gives that of the triangles and is asked only if
    /// some overlap.
    pub(super) fn find<'t>(
        triangles: &[Triangle],
        material_of: &[MaterialId],
        topology: impl FnOnce() -> &'t Topology,
    ) -> Overlaps {
        let boxed = |(number, triangle): (usize, &Triangle)| Boxed {
            bounds: padded(triangle),
            number: number as u32,
        };
        let boxes = triangles.iter().enumerate().map(boxed);
        let overlap = |a: u32, b: u32| overlap(&triangles[a as usize], &triangles[b as usize]);
        let most = MOST_PAIRS.0 * triangles.len() as u64 + MOST_PAIRS.1;
        match near::pairs(boxes, overlap, most) {
            None => Overlaps { is_given_up: true, ..Overlaps::default() },
            Some(pairs) if pairs.is_empty() => Overlaps::default(),
            Some(pairs) => {
                let normals = triangles.iter().map(Triangle::normal).collect();
                let surfaces = Surfaces { triangles, material_of, topology: topology(), normals };
                Overlaps::new(&surfaces, &pairs)
            }
        }
    }

    fn new(of: &Surfaces, pairs: &[(u32, u32)]) -> Overlaps {
        let mut both: Vec<(u32, u32)> = pairs.iter().flat_map(|&(a, b)| [(a, b), (b, a)]).collect();
        both.sort_unstable();
        let count = of.triangles.len() as u32;
        Overlaps {
            first: (0..=count).map(|t| both.partition_point(|pair| pair.0 < t) as u32).collect(),
            others: both.iter().map(|pair| TriangleId(pair.1)).collect(),
            rank: of.ranks(pairs),
            is_given_up: false,
        }
    }
}

/// What decides which triangles make one surface.
struct Surfaces<'a> {
    triangles: &'a [Triangle],
    material_of: &'a [MaterialId],
    topology: &'a Topology,
    normals: Vec<Vec3>,
}

/// Grown by what lifts rays off the triangle.
fn padded(triangle: &Triangle) -> Bounds {
    let (bounds, pad) = (triangle.bounds(), triangle.ray_offset());
    Bounds { min: bounds.min - pad, max: bounds.max + pad }
}

/// Whether two triangles lie so near to each other over a common area that rays lifted off one of them start
/// beyond the other. A common rim, no wider than that, does not count.
fn overlap(a: &Triangle, b: &Triangle) -> bool {
    let (n, m) = (a.double_area_normal(), b.double_area_normal());
    let squares = n.length_squared() * m.length_squared();
    if n.dot(m).powi(2) <= f64::from(PARALLEL).powi(2) * squares {
        return false;
    }
    let tolerance = a.ray_offset().max(b.ray_offset()) as f64;
    let n = n.normalize();
    let away = b.p.map(|p| n.dot((p - a.p[0]).as_dvec3()));
    if away.iter().all(|&d| d > tolerance) || away.iter().all(|&d| d < -tolerance) {
        return false;
    }
    let axis = flat::axis_of(n.as_vec3());
    let flat = [a, b].map(|triangle| flat::seen_along(axis, triangle));
    if flat::are_apart(&flat[0], &flat[1], tolerance) {
        return false;
    }
    let common: Polygon = flat::common(&flat[0], &flat[1]);
    let steepness = n[axis].abs();
    let apart = |&p| (flat::height_at(axis, a, p) - flat::height_at(axis, b, p)).abs() * steepness;
    flat::area(&common) > tolerance * flat::perimeter(&common)
        && common.iter().all(|p| apart(p) <= tolerance)
}

impl Surfaces<'_> {
    /// Orders the triangles so that those of smaller surfaces come first.
    ///
    /// A carpet may lie on many tiles, each smaller than it: so first all triangles of a material that hang
    /// together, be it by edges or by what overlaps them, are one surface; only then those that hang together by
    /// edges.
    fn ranks(&self, pairs: &[(u32, u32)]) -> Vec<u32> {
        let count = self.triangles.len();
        let (mut surfaces, mut places) = (Groups::new(count), Groups::new(count));
        for edge in self.topology.edges() {
            let halves: Vec<usize> = edge.map(|half| half.triangle.index()).collect();
            for pair in halves.windows(2).filter(|pair| self.continue_each_other(pair[0], pair[1]))
            {
                surfaces.join(pair[0], pair[1]);
                places.join(pair[0], pair[1]);
            }
        }
        pairs.iter().for_each(|&(a, b)| places.join(a as usize, b as usize));
        let (mut of_material, mut of_surface) = (BTreeMap::new(), vec![0.0; count]);
        for (t, triangle) in self.triangles.iter().enumerate() {
            let place = (places.root(t), self.material_of[t].0);
            *of_material.entry(place).or_insert(0.0) += triangle.area();
            of_surface[surfaces.root(t)] += triangle.area();
        }
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_cached_key(|&t| {
            let surface = surfaces.root(t);
            let material: f64 = of_material[&(places.root(t), self.material_of[t].0)];
            // Areas are not negative, and the bits of such numbers are in their order.
            (material.to_bits(), of_surface[surface].to_bits(), Reverse((surface, t)))
        });
        let mut rank = vec![0; count];
        order.into_iter().enumerate().for_each(|(place, t)| rank[t] = place as u32);
        rank
    }

    /// Whether two triangles with a common edge are parts of one flat surface.
    fn continue_each_other(&self, a: usize, b: usize) -> bool {
        self.material_of[a] == self.material_of[b]
            && self.normals[a].dot(self.normals[b]) > PARALLEL
    }
}

#[cfg(test)]
mod tests;
