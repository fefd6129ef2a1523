//! From triangles to an eight-wide hierarchy: a library's binary tree, collapsed.

use super::leaf::Leaves;
use super::{Child, Node, WIDTH};
use crate::geometry::Triangle;
use glam::Vec3A;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;
use obvhs::splits::split_aabbs_precise;

/// What a hierarchy is made of.
pub struct Parts {
    /// The root is number 0, and always there.
    pub nodes: Vec<Node>,
    pub leaves: Leaves,
    /// Nodes above the deepest leaf.
    pub depth: usize,
}

pub fn build(triangles: &[Triangle]) -> Parts {
    let mut parts = Parts { nodes: vec![Node::empty()], leaves: Leaves::new(), depth: 1 };
    if !triangles.is_empty() {
        parts.open(&binary_tree(triangles), triangles);
    }
    parts
}

/// Below so many triangles the best tree costs a fraction of a second.
const FEW: usize = 200_000;

fn binary_tree(triangles: &[Triangle]) -> Bvh2 {
    let (boxes, ids) = split_boxes(triangles);
    let params = if triangles.len() < FEW {
        BvhBuildParams::very_slow_build()
    } else {
        BvhBuildParams::medium_build()
    };
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        &boxes,
        ids,
        params.sort_precision,
        params.search_depth_threshold,
    );
    tree.uses_spatial_splits = true;
    let before = params.reinsertion_batch_ratio;
    let after = before * params.post_collapse_reinsertion_batch_ratio_multiplier;
    let mut optimizer = ReinsertionOptimizer::default();
    optimizer.run(&mut tree, before, None);
    collapse(&mut tree, WIDTH as u32, NODE_COST);
    optimizer.run(&mut tree, after, None);
    tree
}

/// A box is split where the halves' surface, times this, is less than its own. A right triangle
/// along the axes comes to 4/3, a long thin one across a cube to 2.
const GAIN: f32 = 1.6;

/// Boxes that hold the triangles, and whose they are: several for a long thin triangle, since one
/// around it would be nearly empty (Ernst & Greiner, *Early Split Clipping for Bounding Volume
/// Hierarchies*, IRT 2007). Only boxes larger than the average are split.
fn split_boxes(triangles: &[Triangle]) -> (Vec<Aabb>, Vec<u32>) {
    let whole = |triangle: &Triangle| {
        let bounds = triangle.bounds();
        Aabb::new(bounds.min.into(), bounds.max.into())
    };
    let mut boxes: Vec<Aabb> = triangles.iter().map(whole).collect();
    let mut ids: Vec<u32> = (0..boxes.len() as u32).collect();
    let sum: f64 = boxes.iter().map(|bounds| bounds.half_area() as f64).sum();
    let average = (sum / boxes.len() as f64) as f32;
    let corners = |t: &Triangle| {
        let [v0, v1, v2] = t.p.map(Into::into);
        obvhs::triangle::Triangle { v0, v1, v2 }
    };
    let shapes: Vec<_> = triangles.iter().map(corners).collect();
    let (places, rounds) = (12, 12);
    split_aabbs_precise(
        &mut boxes, &mut ids, &shapes, average, average, GAIN, GAIN, rounds, places,
    );
    for (bounds, &id) in boxes.iter_mut().zip(&ids) {
        let triangle = &triangles[id as usize];
        let whole = whole(triangle);
        if bounds.min != whole.min || bounds.max != whole.max {
            *bounds = grown(bounds, triangle).intersection(&whole);
        }
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

/// What a node costs, in triangles.
const NODE_COST: f32 = 2.0;

impl Parts {
    /// Opens the tree from its root. An explicit work list, since a tree over hostile input can be
    /// deeper than the call stack.
    fn open(&mut self, tree: &Bvh2, triangles: &[Triangle]) {
        let mut work = vec![(0, 0, 1)];
        while let Some((from, into, depth)) = work.pop() {
            self.depth = self.depth.max(depth);
            for (slot, member) in eight_descendants(tree, from).into_iter().enumerate() {
                let node = &tree.nodes[member];
                let child = if node.is_leaf() {
                    let first = node.first_index as usize;
                    let range = first..first + node.prim_count as usize;
                    // Pieces of one triangle may meet again in a leaf.
                    let mut members = tree.primitive_indices[range].to_vec();
                    members.sort_unstable();
                    members.dedup();
                    Child::leaf(self.leaves.push(triangles, &members), members.len())
                } else {
                    self.nodes.push(Node::empty());
                    work.push((member, self.nodes.len() - 1, depth + 1));
                    Child::node(self.nodes.len() - 1)
                };
                self.nodes[into].set(slot, node.aabb(), child);
            }
        }
    }
}

/// Opens the member with the largest box, which rays meet most often, until there are eight.
fn eight_descendants(tree: &Bvh2, root: usize) -> Vec<usize> {
    let mut members = vec![root];
    while members.len() < WIDTH {
        let largest = members
            .iter()
            .enumerate()
            .filter(|&(_, &m)| !tree.nodes[m].is_leaf())
            .max_by(|a, b| {
                let area = |m: usize| tree.nodes[m].aabb().half_area();
                area(*a.1).total_cmp(&area(*b.1))
            })
            .map(|(slot, _)| slot);
        let Some(slot) = largest else { break };
        let first_child = tree.nodes[members[slot]].first_index as usize;
        members[slot] = first_child;
        members.push(first_child + 1);
    }
    members
}

impl Node {
    fn empty() -> Node {
        Node {
            bounds: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3],
            children: [Child::ROOT; WIDTH],
        }
    }

    /// The box grows by one ulp of its largest coordinate on each side, so that a ray that runs exactly
    /// in one of its faces (a zero in the direction) is strictly inside and no comparison is left to
    /// chance. One ulp of the face itself would not do: next to 0 it is so little that not even the
    /// largest inverse of a direction takes it beyond t.
    fn set(&mut self, slot: usize, bounds: &Aabb, child: Child) {
        let largest = (0..3).map(|axis| bounds.min[axis].abs().max(bounds.max[axis].abs()));
        let ulp = largest.fold(0.0, f32::max) * f32::EPSILON;
        for axis in 0..3 {
            let (min, max) = (bounds.min[axis], bounds.max[axis]);
            self.bounds[axis][0][slot] = (min - ulp).min(min.next_down());
            self.bounds[axis][1][slot] = (max + ulp).max(max.next_up());
        }
        self.children[slot] = child;
    }
}
