//! Which triangles share vertices and edges.

use super::bins::binned;
use super::groups::Groups;
use super::mesh;
use crate::geometry::{Triangle, TriangleId};
use crate::known::known;
use foldhash::fast::RandomState;
use glam::Vec3;
use hashbrown::HashTable;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::hash::BuildHasher;
use std::sync::OnceLock;

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
    /// Sorted by edge; see [`Topology::edges`]. Found when first asked for.
    known_half_edges: OnceLock<Vec<HalfNumber>>,
    /// See [`Topology::copies`]. Found when first asked for.
    known_copies: OnceLock<Vec<Vec<TriangleId>>>,
}

/// A half-edge as a number, 3 · triangle + start: there are three per triangle, so their size counts.
type HalfNumber = u32;

impl Topology {
    /// # Panics
    /// If there are more than 2³² / 3 triangles.
    pub fn new(triangles: &[Triangle]) -> Topology {
        // A closed mesh has half as many vertices as triangles.
        let mut vertices = Vertices::for_about(triangles.len() / 2);
        let mut corners = Vec::with_capacity(triangles.len());
        for Triangle { p: [a, b, c] } in triangles {
            corners.push([vertices.at(*a), vertices.at(*b), vertices.at(*c)]);
        }
        Topology::of(corners, vertices.count())
    }

    /// The topology of triangles that are given as indices into a list of positions. It is that of
    /// [`Topology::new`], found sooner: each position is looked up once, not at each corner.
    ///
    /// # Panics
    /// If an index is out of range, or there are more than 2³² / 3 triangles.
    pub(super) fn of_indexed(triangles: &[[u32; 3]], positions: &[Vec3]) -> Topology {
        let places = welded(positions);
        // Vertices are numbered by their first corner, not their first position.
        const UNNUMBERED: u32 = u32::MAX;
        let mut numbers = vec![UNNUMBERED; positions.len()];
        let mut count = 0;
        let mut number = |position: u32| {
            let number = &mut numbers[places[position as usize] as usize];
            if *number == UNNUMBERED {
                *number = count;
                count += 1;
            }
            VertexId(*number)
        };
        let corners = triangles.iter().map(|t| t.map(&mut number)).collect();
        Topology::of(corners, count as usize)
    }

    fn of(corners: Vec<[VertexId; 3]>, vertex_count: usize) -> Topology {
        assert!(corners.len() <= (HalfNumber::MAX / 3) as usize, "half-edges have 32-bit numbers");
        let (known_half_edges, known_copies) = (OnceLock::new(), OnceLock::new());
        Topology { corners, vertex_count, known_half_edges, known_copies }
    }

    /// The topology without the triangles that are not `kept`, each of which has the vertices of a kept one
    /// before it: so the vertices stay as they are.
    pub(super) fn without_copies(mut self, kept: &[bool]) -> Topology {
        mesh::retain(&mut self.corners, kept);
        Topology::of(self.corners, self.vertex_count)
    }

    fn half_edges(&self) -> &[HalfNumber] {
        known::<Vec<_>>(&self.known_half_edges, || {
            sorted_half_edges(&self.corners, self.vertex_count)
        })
    }

    /// Every edge once, with all triangles that have it, in either direction.
    pub fn edges(&self) -> impl Iterator<Item = impl Iterator<Item = HalfEdge> + '_> + '_ {
        self.chunks().map(|edge| edge.iter().map(|half| half_edge(*half)))
    }

    /// Edges that only one triangle has. A closed mesh has none.
    pub fn open_edges(&self) -> usize {
        let edges = self.half_edges().par_chunk_by(|a, b| self.have_same_ends(*a, *b));
        edges.filter(|edge| edge.len() == 1).count()
    }

    fn chunks(&self) -> impl Iterator<Item = &[HalfNumber]> {
        self.half_edges().chunk_by(|a, b| self.have_same_ends(*a, *b))
    }

    fn have_same_ends(&self, a: HalfNumber, b: HalfNumber) -> bool {
        ends(&self.corners, a) == ends(&self.corners, b)
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
        for edge in self.chunks().filter(|edge| edge.len() % 2 == 1) {
            parts.remove(&groups.root(half_edge(edge[0]).triangle.index()));
        }
        parts.into_values().collect()
    }

    /// Triangles whose three vertices another triangle before them has too.
    pub fn duplicates(&self) -> usize {
        self.copies().iter().map(|copies| copies.len() - 1).sum()
    }

    /// Lists of two or more triangles with the same three vertices, in the triangles' order.
    pub(super) fn copies(&self) -> &[Vec<TriangleId>] {
        known::<Vec<_>>(&self.known_copies, || self.find_copies())
    }

    fn find_copies(&self) -> Vec<Vec<TriangleId>> {
        const FEW: usize = 8;
        let sorted = |triangle: u32| {
            let [a, b, c] = self.corners[triangle as usize];
            let [low, high] = [a.min(b), a.max(b)];
            [low.min(c), low.max(c.min(high)), high.max(c)]
        };
        let lowest = |triangle| sorted(triangle)[0].0 as usize;
        let triangles = binned(self.corners.len() as u32, self.vertex_count, lowest);
        let bins = triangles.par_chunk_by(|a, b| lowest(*a) == lowest(*b));
        let repeats = |bin: &&[u32]| {
            let same = |a: &u32, b: &u32| sorted(*a) == sorted(*b);
            // Most bins hold two or three triangles, and no copies: a list for each would take longer than all else.
            bin.len() > FEW || (1..bin.len()).any(|k| bin[..k].iter().any(|t| same(t, &bin[k])))
        };
        let copies = bins.filter(repeats).flat_map_iter(|bin| {
            let mut keyed: Vec<_> = bin.iter().map(|t| (sorted(*t), TriangleId(*t))).collect();
            keyed.sort_unstable();
            let lists = keyed.chunk_by(|a, b| a.0 == b.0).filter(|list| list.len() > 1);
            lists.map(|list| list.iter().map(|keyed| keyed.1).collect()).collect::<Vec<_>>()
        });
        copies.collect()
    }
}

/// Per position, the number of the first one at exactly the same place.
fn welded(positions: &[Vec3]) -> Vec<u32> {
    // Each bin's table fits a cache.
    const BINS: usize = 1 << 10;
    let hasher = RandomState::default();
    let bits_at = |number: u32| bits_of(positions[number as usize]);
    let hashes: Vec<u64> =
        positions.par_iter().map(|position| hasher.hash_one(bits_of(*position))).collect();
    let hash = |number: u32| hashes[number as usize];
    // The highest and the lowest bits are those that a table looks at.
    let bin = |number: u32| (hash(number) >> 40) as usize % BINS;
    let bins = binned(positions.len() as u32, BINS, bin);
    let repeated_in = |bin: &[u32]| {
        let mut firsts = HashTable::with_capacity(bin.len());
        let mut repeated = Vec::new();
        for &number in bin {
            let is_same = |known: &u32| bits_at(*known) == bits_at(number);
            match firsts.find(hash(number), is_same) {
                Some(&first) => repeated.push((number, first)),
                None => {
                    firsts.insert_unique(hash(number), number, |known| hash(*known));
                }
            }
        }
        repeated
    };
    let repeated: Vec<(u32, u32)> =
        bins.par_chunk_by(|a, b| bin(*a) == bin(*b)).flat_map_iter(repeated_in).collect();
    let mut places: Vec<u32> = (0..positions.len() as u32).collect();
    repeated.into_iter().for_each(|(number, first)| places[number as usize] = first);
    places
}

/// The bits of the coordinates. Adding zero makes −0 equal to 0.
fn bits_of(position: Vec3) -> [u32; 3] {
    (position + Vec3::ZERO).to_array().map(f32::to_bits)
}

/// Vertices by their positions, numbered as they first appear.
struct Vertices {
    /// The bits of their coordinates.
    positions: Vec<[u32; 3]>,
    /// The positions' numbers. A table of numbers alone is small, so that it stays in a cache.
    numbers: HashTable<u32>,
    hasher: RandomState,
}

impl Vertices {
    fn for_about(count: usize) -> Vertices {
        Vertices {
            positions: Vec::with_capacity(count),
            numbers: HashTable::with_capacity(count),
            hasher: RandomState::default(),
        }
    }

    fn at(&mut self, position: Vec3) -> VertexId {
        let Vertices { positions, numbers, hasher } = self;
        let bits = bits_of(position);
        let at = |number: &u32| positions[*number as usize];
        let same = |number: &u32| at(number) == bits;
        let known = numbers.entry(hasher.hash_one(bits), same, |n| hasher.hash_one(at(n)));
        let number = *known.or_insert(positions.len() as u32).get();
        if number as usize == positions.len() {
            positions.push(bits);
        }
        VertexId(number)
    }

    fn count(&self) -> usize {
        self.positions.len()
    }
}

fn half_edge(number: HalfNumber) -> HalfEdge {
    HalfEdge { triangle: TriangleId(number / 3), start: (number % 3) as usize }
}

/// The ends of a half-edge, the lower vertex first.
#[inline]
fn ends(corners: &[[VertexId; 3]], half: HalfNumber) -> (VertexId, VertexId) {
    let HalfEdge { triangle, start } = half_edge(half);
    let corners = &corners[triangle.index()];
    let (a, b) = (corners[start], corners[(start + 1) % 3]);
    (a.min(b), a.max(b))
}

/// All half-edges, sorted by their lower vertex, then by their higher one, then by number.
///
/// They are counted into one bin per lower vertex. A bin holds few, so it is quickly sorted, and no list
/// of keys is needed.
fn sorted_half_edges(corners: &[[VertexId; 3]], vertex_count: usize) -> Vec<HalfNumber> {
    let lower = |half| ends(corners, half).0.0 as usize;
    let mut sorted = binned(3 * corners.len() as HalfNumber, vertex_count, lower);
    let bins = sorted.par_chunk_by_mut(|a, b| lower(*a) == lower(*b));
    bins.for_each(|bin| bin.sort_unstable_by_key(|half| (ends(corners, *half).1, *half)));
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn indexed_triangles_have_the_topology_of_their_corners() {
        // Two names for one place, one in another order than the corners, one that no triangle has.
        let p = [Vec3::ONE, Vec3::Z, Vec3::ZERO, Vec3::X, -Vec3::ZERO, Vec3::Y];
        let indices = vec![[2, 5, 3], [4, 3, 1], [3, 5, 1], [5, 2, 1]];
        let triangles: Vec<Triangle> =
            indices.iter().map(|t| Triangle { p: t.map(|k: u32| p[k as usize]) }).collect();
        let (direct, indexed) = (Topology::new(&triangles), Topology::of_indexed(&indices, &p));
        assert_eq!((&indexed.corners, indexed.vertex_count), (&direct.corners, 4));
        assert_eq!(indexed.open_edges(), 0);
    }

    #[test]
    fn places_that_many_positions_name_are_one_vertex_with_any_number_of_threads() {
        let mut random = fastrand::Rng::with_seed(1);
        let coordinate = |n: u32| [-0.0, 0.0, 1.0, 1.5][n as usize % 4] + (n / 4) as f32;
        let positions: Vec<Vec3> = (0..50_000)
            .map(|number| match number % 5 {
                0 => Vec3::ZERO,
                _ => Vec3::from_array([0; 3].map(|_| coordinate(random.u32(0..60)))),
            })
            .collect();
        let indices: Vec<[u32; 3]> =
            (0..30_000).map(|_| [0; 3].map(|_| random.u32(0..50_000))).collect();
        let at = |t: &[u32; 3]| Triangle { p: t.map(|k| positions[k as usize]) };
        let direct = Topology::new(&indices.iter().map(at).collect::<Vec<_>>());
        for threads in [1, 2, 12] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let indexed = pool.install(|| Topology::of_indexed(&indices, &positions));
            assert_eq!(indexed.vertex_count, direct.vertex_count);
            assert!(indexed.corners == direct.corners, "{threads} threads");
        }
        assert!(direct.vertex_count < 25_000, "places are named often");
    }

    #[test]
    fn without_copies_the_topology_is_that_of_the_others() {
        let mut triangles = tetrahedron();
        let [a, b, c] = triangles[1].p;
        triangles.insert(2, Triangle::new(c, b, a));
        let kept = [true, true, false, true, true];
        let left = Topology::new(&triangles).without_copies(&kept);
        let direct = Topology::new(&tetrahedron());
        assert_eq!((left.corners, left.vertex_count), (direct.corners, direct.vertex_count));
    }

    #[test]
    fn edges_come_in_the_order_of_their_vertices_each_with_its_triangles() {
        let topology = Topology::new(&tetrahedron());
        let half = |h: HalfEdge| (h.triangle.0, h.start);
        let edges: Vec<Vec<_>> = topology.edges().map(|edge| edge.map(half).collect()).collect();
        // The faces are 0 2 1, 0 1 3, 1 2 3, 2 0 3, of which the first names the vertices 0 1 2.
        let expected = [
            [(0, 0), (3, 0)], // 0 1
            [(0, 2), (1, 0)], // 0 2
            [(1, 2), (3, 1)], // 0 3
            [(0, 1), (2, 0)], // 1 2
            [(2, 1), (3, 2)], // 1 3
            [(1, 1), (2, 2)], // 2 3
        ];
        assert_eq!(edges, expected);
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
