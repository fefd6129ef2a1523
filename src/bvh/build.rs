//! From triangles to an eight-wide hierarchy: a library's binary tree, collapsed.

use super::collapse::{Collapse, Member};
use super::leaf::Leaves;
use super::node::Node;
use super::pages::with_room;
use super::{Child, WIDTH};
use crate::geometry::Triangle;
use crate::geometry::bounds::Bounds;
use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, SortPrecision};
use obvhs::splits::split_aabbs_precise;
use rayon::prelude::*;
use std::collections::HashMap;

/// The parts of a hierarchy.
pub(super) struct Parts {
    /// The root is number 0, and always there.
    pub nodes: Vec<Node>,
    pub leaves: Leaves,
    /// Nodes above the deepest leaf.
    pub depth: usize,
}

/// How much time a build may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Less than Embree's best build takes, but for a few dozen triangles.
    Quick,
    /// Two to three times as much, and more on a few dozen triangles.
    Thorough,
}

impl Effort {
    /// The effort that pays off for this many rays. On 1.6 million triangles and 2 threads the thorough
    /// build took 0.9 µs more per triangle, and saved 20 ns per ray.
    pub fn for_rays(triangles: usize, rays: u64) -> Effort {
        if rays / 64 > triangles as u64 { Effort::Thorough } else { Effort::Quick }
    }

    /// Candidates for reinsertion in the first round, as a share of all nodes.
    fn reinsertion(self) -> f32 {
        match self {
            Effort::Quick => 0.05,
            Effort::Thorough => 1.0,
        }
    }
}

pub(super) fn build(triangles: &[Triangle], effort: Effort) -> Parts {
    if triangles.is_empty() {
        return Parts { nodes: vec![Node::EMPTY], leaves: Leaves::new(&[], &[], &[]), depth: 1 };
    }
    let mut opened = open(&binary_tree(triangles, effort));
    // How many nodes there are is not known before, and the binary tree is gone by now.
    let mut nodes = with_room(opened.nodes.len());
    nodes.append(&mut opened.nodes);
    let leaves = Leaves::new(triangles, &opened.numbers, &opened.counts);
    Parts { nodes, leaves, depth: opened.depth }
}

fn binary_tree(triangles: &[Triangle], effort: Effort) -> Bvh2 {
    // The builder's own list, so that there is no other beside it: nothing takes more memory than building.
    let mut builder = PlocBuilder::new();
    builder.current_nodes = leaves(triangles);
    let copies = Copies::taken_from(&mut builder.current_nodes);
    let whole = builder.current_nodes.iter().fold(Aabb::empty(), |sum, of| sum.union(of.aabb()));
    let half_areas = builder.current_nodes.iter().map(|leaf| f64::from(leaf.aabb().half_area()));
    let overlap = half_areas.sum::<f64>() / f64::from(whole.half_area());
    let ids = builder.current_nodes.iter().map(|leaf| leaf.first_index).collect();
    let mut tree = Bvh2 { primitive_indices: ids, ..Bvh2::default() };
    builder.build_ploc_from_leaves::<SEARCH, false>(&mut tree, whole, SortPrecision::U64, 1);
    drop(builder);
    tree.uses_spatial_splits = true;
    if overlap <= MOST_OVERLAP {
        ReinsertionOptimizer::default().run(&mut tree, effort.reinsertion(), None);
    }
    // Else the next step would keep them up to date.
    tree.parents = Vec::new();
    tree.reorder_in_stack_traversal_order();
    copies.put_into(&mut tree);
    tree
}

/// Boxes that a line through all of them meets on average, up to which a tree is improved. Where more lie in one place,
/// any tree is as good as another, and a search for a better place looks at all of them.
const MOST_OVERLAP: f64 = 1000.0;

/// Leaves with equal boxes. The builder joins boxes that find each other nearest, and of equal ones only few do, so that
/// it would take a time that grows with the square of their number.
#[derive(Default)]
struct Copies {
    /// By their box, the triangles of such leaves.
    of: HashMap<Corners, Vec<u32>>,
}

/// The bits of a box.
type Corners = [[u32; 3]; 2];

fn corners_of(leaf: &Bvh2Node) -> Corners {
    let Aabb { min, max } = *leaf.aabb();
    [min.to_array(), max.to_array()].map(|corner| corner.map(f32::to_bits))
}

/// Buckets of boxes; and how many boxes may share one beyond twice the mean, before it is looked at whether they are
/// equal.
const BUCKETS: usize = 1 << 16;
const FEW: usize = 64;

impl Copies {
    /// Takes all leaves but one of those with one box out of a list, where there are many.
    fn taken_from(leaves: &mut Vec<Bvh2Node>) -> Copies {
        let bucket = |leaf: &Bvh2Node| {
            let mix = |mixed: u64, bits: &u32| {
                (mixed.rotate_left(5) ^ u64::from(*bits)).wrapping_mul(0x517c_c1b7_2722_0a95)
            };
            (corners_of(leaf).as_flattened().iter().fold(0, mix) >> 48) as usize
        };
        let most = 2 * (leaves.len() / BUCKETS) + FEW;
        if leaves.len() <= most {
            return Copies::default();
        }
        let mut counts = vec![0u32; BUCKETS];
        leaves.iter().for_each(|leaf| counts[bucket(leaf)] += 1);
        if counts.iter().all(|count| *count as usize <= most) {
            return Copies::default();
        }
        let mut of = HashMap::<Corners, Vec<u32>>::new();
        leaves.retain(|leaf| {
            if counts[bucket(leaf)] as usize <= most {
                return true;
            }
            let all = of.entry(corners_of(leaf)).or_default();
            all.push(leaf.first_index);
            all.len() == 1
        });
        of.retain(|_, all| all.len() > 1);
        Copies { of }
    }

    /// Makes of each leaf that stayed a balanced tree of all with its box. Its nodes come behind all others.
    fn put_into(&self, tree: &mut Bvh2) {
        if self.of.is_empty() {
            return;
        }
        for number in 0..tree.nodes.len() {
            let leaf = tree.nodes[number];
            if let Some(all) = self.of.get(&corners_of(&leaf)).filter(|_| leaf.is_leaf()) {
                grow(tree, number, *leaf.aabb(), all);
            }
        }
    }
}

/// Makes of a leaf the root of a balanced tree over these triangles.
fn grow(tree: &mut Bvh2, number: usize, bounds: Aabb, all: &[u32]) {
    let mut work = vec![(number, all)];
    while let Some((number, all)) = work.pop() {
        if let [one] = all {
            tree.nodes[number] = Bvh2Node::new(bounds, 1, *one);
            continue;
        }
        let first = tree.nodes.len();
        tree.nodes[number] = Bvh2Node::new(bounds, 0, first as u32);
        tree.nodes.extend([Bvh2Node::new(bounds, 1, 0); 2]);
        let (left, right) = all.split_at(all.len() / 2);
        work.extend([(first, left), (first + 1, right)]);
    }
}

/// How many boxes along a curve through space are tried as a box's partner, before and after it.
const SEARCH: usize = 14;

/// A box is split where the halves' surface, times this, is less than its own. A right triangle
/// along the axes comes to 4/3, a long thin one across a cube to 2.
const SPLIT_GAIN: f32 = 1.6;

/// Triangles that are split at a time. Whatever it is, the pieces are the same, but for their order.
const CHUNK: usize = 1 << 13;

/// Chunks that are split before their boxes are put to the others.
const BATCH: usize = 32;

/// Boxes that hold the triangles, as leaves that say whose they are: several for a long thin triangle, since one
/// around it would be nearly empty (Ernst & Greiner, *Early Split Clipping for Bounding Volume
/// Hierarchies*, IRT 2007). Only boxes larger than the average are split.
fn leaves(triangles: &[Triangle]) -> Vec<Bvh2Node> {
    let sum: f64 = triangles.iter().map(|triangle| whole(triangle).half_area() as f64).sum();
    let average = (sum / triangles.len() as f64) as f32;
    let mut leaves = Vec::with_capacity(triangles.len());
    for (batch, triangles) in triangles.chunks(BATCH * CHUNK).enumerate() {
        let split = |(chunk, triangles): (usize, &[Triangle])| {
            split_chunk(triangles, (batch * BATCH + chunk) * CHUNK, average)
        };
        let chunks: Vec<_> = triangles.par_chunks(CHUNK).enumerate().map(split).collect();
        let boxes = chunks.into_iter().flat_map(|(boxes, ids)| boxes.into_iter().zip(ids));
        leaves.extend(boxes.map(|(bounds, id)| Bvh2Node::new(bounds, 1, id)));
    }
    leaves
}

fn whole(triangle: &Triangle) -> Aabb {
    let bounds = triangle.bounds();
    Aabb::new(bounds.min.into(), bounds.max.into())
}

/// Splits a chunk of the triangles; `first` is the number of its first triangle.
fn split_chunk(triangles: &[Triangle], first: usize, average: f32) -> (Vec<Aabb>, Vec<u32>) {
    let mut boxes: Vec<Aabb> = triangles.iter().map(whole).collect();
    let mut ids: Vec<u32> = (0..boxes.len() as u32).collect();
    let corners = |t: &Triangle| {
        let [v0, v1, v2] = t.p.map(Into::into);
        obvhs::triangle::Triangle { v0, v1, v2 }
    };
    let shapes: Vec<_> = triangles.iter().map(corners).collect();
    // As the library's presets have it.
    let (places, rounds) = (12, 12);
    split_aabbs_precise(
        &mut boxes, &mut ids, &shapes, average, average, SPLIT_GAIN, SPLIT_GAIN, rounds, places,
    );
    for (bounds, id) in boxes.iter_mut().zip(&mut ids) {
        let triangle = &triangles[*id as usize];
        let whole = whole(triangle);
        if bounds.min != whole.min || bounds.max != whole.max {
            *bounds = grown(bounds, triangle).intersection(&whole);
        }
        *id += first as u32;
    }
    (boxes, ids)
}

/// The box of a piece, grown by what rounding can have taken from it.
///
/// With ε = 2⁻²⁴ and M the largest coordinate, a cut's place along an edge is rounded four times, by
/// 4ε of a length of at most 2M, the edge by 2εM and their sum by εM: 11εM, less than 16εM.
fn grown(piece: &Aabb, triangle: &Triangle) -> Aabb {
    let largest = triangle.p.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
    let growth = Vec3A::splat(largest * (16.0 * f32::EPSILON / 2.0));
    Aabb::new(piece.min - growth, piece.max + growth)
}

/// A binary tree that was opened.
struct Opened {
    nodes: Vec<Node>,
    /// Leaf after leaf, the numbers of its triangles; and how many these are.
    numbers: Vec<u32>,
    counts: Vec<u8>,
    depth: usize,
}

/// Opens the tree from its root. An explicit work list, since a tree over hostile input can be deeper
/// than the call stack.
fn open(tree: &Bvh2) -> Opened {
    let collapse = Collapse::new(tree);
    let (mut nodes, mut deepest) = (vec![Node::EMPTY], 1);
    let (mut numbers, mut counts) = (Vec::with_capacity(tree.primitive_indices.len()), Vec::new());
    let mut members = Vec::with_capacity(WIDTH);
    let mut work = vec![(0, 0, 1)];
    while let Some((from, into, depth)) = work.pop() {
        deepest = deepest.max(depth);
        collapse.members(from, &mut members);
        for (slot, member) in members.iter().enumerate() {
            let (of, child) = match *member {
                Member::Leaf(of) => {
                    let first = numbers.len();
                    collapse.triangles(of, &mut numbers);
                    counts.push((numbers.len() - first) as u8);
                    (of, Child::leaf(first, numbers.len() - first))
                }
                Member::Node(of) => {
                    nodes.push(Node::EMPTY);
                    work.push((of, nodes.len() - 1, depth + 1));
                    (of, Child::node(nodes.len() - 1))
                }
            };
            let bounds = tree.nodes[of].aabb();
            let bounds = Bounds { min: bounds.min.into(), max: bounds.max.into() };
            nodes[into].set(slot, bounds, child);
        }
    }
    Opened { nodes, numbers, counts, depth: deepest }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn equal_boxes_are_taken_out_and_come_back_as_a_balanced_tree() {
        let one = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
        // Another triangle with the same box, and one apart.
        let other = Triangle::new(Vec3::X + Vec3::Y, Vec3::Y, Vec3::X);
        let apart = Triangle::new(Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + Vec3::Y);
        let mut triangles = vec![one; 1000];
        triangles.extend(vec![other; 1000]);
        triangles.push(apart);
        let parts = build(&triangles, Effort::Thorough);
        // log₂ 2000 binary levels and one above; a wide node holds one or more of them.
        assert!(parts.depth <= 12, "{}", parts.depth);
        let mut leaves = leaves(&triangles);
        let copies = Copies::taken_from(&mut leaves);
        let all = leaves.iter().map(|leaf| copies.of.get(&corners_of(leaf)).map_or(1, Vec::len));
        assert_eq!(all.collect::<Vec<_>>(), [2000, 1]);
    }
}
