//! Which triangles share vertices and edges.

use super::groups::Groups;
use crate::geometry::{Triangle, TriangleId};
use std::collections::{BTreeMap, HashMap};

/// A vertex after welding: corners at exactly the same position are one vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct VertexId(pub u32);

/// A triangle's edge: from corner `start` to corner `(start + 1) % 3`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HalfEdge {
    pub triangle: TriangleId,
    pub start: usize,
}

/// The welded vertices of each triangle, and the triangles at each edge.
#[derive(Debug)]
pub struct Topology {
    pub corners: Vec<[VertexId; 3]>,
    pub vertex_count: usize,
    /// Sorted by edge; see [`Topology::edges`].
    half_edges: Vec<((VertexId, VertexId), HalfEdge)>,
}

impl Topology {
    pub fn new(triangles: &[Triangle]) -> Topology {
        let mut ids: HashMap<[u32; 3], VertexId> = HashMap::with_capacity(triangles.len());
        let corners: Vec<[VertexId; 3]> = triangles
            .iter()
            .map(|triangle| {
                triangle.p.map(|p| {
                    let next = VertexId(ids.len() as u32);
                    // Adding zero makes −0 equal to 0.
                    *ids.entry(p.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
                })
            })
            .collect();
        Topology { half_edges: sorted_half_edges(&corners), vertex_count: ids.len(), corners }
    }

    /// Every edge once, with all triangles that have it, in either direction.
    pub fn edges(&self) -> impl Iterator<Item = impl Iterator<Item = HalfEdge> + '_> + '_ {
        self.half_edges.chunk_by(|a, b| a.0 == b.0).map(|edge| edge.iter().map(|(_, half)| *half))
    }

    /// Edges that only one triangle has. A closed mesh has none.
    pub fn open_edges(&self) -> usize {
        self.half_edges.chunk_by(|a, b| a.0 == b.0).filter(|edge| edge.len() == 1).count()
    }

    /// Triangles that hang together by edges, part by part, of the parts that are closed: each edge
    /// belongs to an even number of triangles, so that all lines but those through seams cross the
    /// part an even number of times.
    pub fn closed_parts(&self) -> Vec<Vec<TriangleId>> {
        let mut groups = Groups::new(self.corners.len());
        for mut edge in self.edges() {
            let first = edge.next().expect("an edge has a triangle");
            edge.for_each(|half| groups.join(first.triangle.index(), half.triangle.index()));
        }
        let mut parts: BTreeMap<usize, Vec<TriangleId>> = BTreeMap::new();
        for id in (0..self.corners.len() as u32).map(TriangleId) {
            parts.entry(groups.root(id.index())).or_default().push(id);
        }
        for edge in self.half_edges.chunk_by(|a, b| a.0 == b.0) {
            if edge.len() % 2 == 1 {
                parts.remove(&groups.root(edge[0].1.triangle.index()));
            }
        }
        parts.into_values().collect()
    }

    /// Triangles whose three vertices another triangle before them has too.
    pub fn duplicates(&self) -> usize {
        let mut sorted: Vec<[VertexId; 3]> = self.corners.clone();
        sorted.iter_mut().for_each(|corners| corners.sort_unstable());
        sorted.sort_unstable();
        sorted.windows(2).filter(|pair| pair[0] == pair[1]).count()
    }
}

fn sorted_half_edges(corners: &[[VertexId; 3]]) -> Vec<((VertexId, VertexId), HalfEdge)> {
    let mut half_edges = Vec::with_capacity(3 * corners.len());
    for (index, corner) in corners.iter().enumerate() {
        for start in 0..3 {
            let (a, b) = (corner[start], corner[(start + 1) % 3]);
            let half = HalfEdge { triangle: TriangleId(index as u32), start };
            half_edges.push(((a.min(b), a.max(b)), half));
        }
    }
    half_edges.sort_unstable_by_key(|(edge, half)| (*edge, half.triangle, half.start));
    half_edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn tetrahedron() -> Vec<Triangle> {
        let p = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
            .map(|corners| Triangle { p: corners.map(|i: usize| p[i]) })
            .to_vec()
    }

    #[test]
    fn a_tetrahedron_is_closed_and_open_without_a_face() {
        let mut triangles = tetrahedron();
        let topology = Topology::new(&triangles);
        assert_eq!((topology.vertex_count, topology.edges().count()), (4, 6));
        assert_eq!((topology.open_edges(), topology.duplicates()), (0, 0));
        triangles.pop();
        assert_eq!(Topology::new(&triangles).open_edges(), 3);
    }

    #[test]
    fn a_part_is_closed_whatever_stands_beside_it_or_touches_it_at_a_vertex() {
        let mut triangles = tetrahedron();
        let elsewhere = |by: Vec3| tetrahedron().into_iter().map(move |t| t.p.map(|p| p + by));
        // Open; then closed, with a vertex of the first.
        triangles.extend(elsewhere(Vec3::ONE).take(3).map(|p| Triangle { p }));
        triangles.extend(elsewhere(Vec3::X).map(|p| Triangle { p }));
        let parts = Topology::new(&triangles).closed_parts();
        let numbers = |range: std::ops::Range<u32>| range.map(TriangleId).collect::<Vec<_>>();
        assert_eq!(parts, [numbers(0..4), numbers(7..11)]);
    }

    #[test]
    fn an_edge_of_four_triangles_closes_and_one_of_three_does_not() {
        let mut triangles = tetrahedron();
        // The same after half a turn around the edge along x, which they share.
        triangles
            .extend(tetrahedron().iter().map(|t| Triangle { p: t.p.map(|p| -p.with_x(-p.x)) }));
        assert_eq!(Topology::new(&triangles).closed_parts().iter().map(Vec::len).sum::<usize>(), 8);
        assert_eq!(Topology::new(&triangles).closed_parts().len(), 1);
        triangles.push(Triangle::new(Vec3::ZERO, Vec3::X, Vec3::splat(5.0)));
        assert!(Topology::new(&triangles).closed_parts().is_empty());
    }

    #[test]
    fn minus_zero_is_welded_to_zero() {
        let mut triangles = tetrahedron();
        triangles[0].p[0] = Vec3::new(-0.0, 0.0, -0.0);
        assert_eq!(Topology::new(&triangles).open_edges(), 0);
    }

    #[test]
    fn duplicates_are_found_whatever_their_first_corner_or_winding() {
        let mut triangles = tetrahedron();
        let [a, b, c] = triangles[0].p;
        triangles.extend([Triangle::new(b, c, a), Triangle::new(c, b, a)]);
        assert_eq!(Topology::new(&triangles).duplicates(), 2);
    }
}
