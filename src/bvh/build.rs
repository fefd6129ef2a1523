//! From triangles to an eight-wide hierarchy: a library's binary tree, collapsed.

use super::{Child, Node, TriangleBlock, WIDTH};
use crate::geometry::{Triangle, TriangleId};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use std::time::Duration;

/// Builds the nodes (the root is number 0, and always there) and the blocks of triangles.
pub fn build(triangles: &[Triangle]) -> (Vec<Node>, Vec<TriangleBlock>) {
    let mut collapse = Collapse { triangles, nodes: vec![Node::empty()], blocks: Vec::new() };
    collapse.blocks.push(collapse.block(&[]));
    if !triangles.is_empty() {
        let tree = binary_tree(triangles);
        collapse.open(&tree, 0, 0);
    }
    (collapse.nodes, collapse.blocks)
}

fn binary_tree(triangles: &[Triangle]) -> Bvh2 {
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|triangle| {
            let bounds = triangle.bounds();
            Aabb::new(bounds.min.into(), bounds.max.into())
        })
        .collect();
    let params = BvhBuildParams {
        // A leaf fills at most one block, and a block costs about as much as a node.
        max_prims_per_leaf: WIDTH as u32,
        collapse_traversal_cost: 3.0,
        pre_split: false,
        ..if boxes.len() < 200_000 {
            BvhBuildParams::very_slow_build()
        } else {
            BvhBuildParams::medium_build()
        }
    };
    build_bvh2(&boxes, params, &mut Duration::default())
}

struct Collapse<'t> {
    triangles: &'t [Triangle],
    nodes: Vec<Node>,
    blocks: Vec<TriangleBlock>,
}

impl Collapse<'_> {
    /// Fills node `into` with the descendants of the tree's node `from`. An explicit work list,
    /// since a tree over hostile input can be deeper than the call stack.
    fn open(&mut self, tree: &Bvh2, from: usize, into: usize) {
        let mut work = vec![(from, into)];
        while let Some((from, into)) = work.pop() {
            for (slot, member) in eight_descendants(tree, from).into_iter().enumerate() {
                let node = &tree.nodes[member];
                let child = if node.is_leaf() {
                    let first = node.first_index as usize;
                    let members = first..first + node.prim_count as usize;
                    self.blocks.push(self.block(&tree.primitive_indices[members]));
                    Child::block(self.blocks.len() - 1)
                } else {
                    self.nodes.push(Node::empty());
                    work.push((member, self.nodes.len() - 1));
                    Child::node(self.nodes.len() - 1)
                };
                self.nodes[into].set(slot, node.aabb(), child);
            }
        }
    }

    fn block(&self, members: &[u32]) -> TriangleBlock {
        assert!(members.len() <= WIDTH, "a leaf holds at most one block of triangles");
        let mut block = TriangleBlock {
            p0: [[0.0; WIDTH]; 3],
            e1: [[0.0; WIDTH]; 3],
            e2: [[0.0; WIDTH]; 3],
            reach: [0.0; WIDTH],
            ids: [TriangleId(u32::MAX); WIDTH],
        };
        for (lane, &id) in members.iter().enumerate() {
            let triangle = &self.triangles[id as usize];
            let (e1, e2) = triangle.edges();
            for axis in 0..3 {
                block.p0[axis][lane] = triangle.p[0][axis];
                block.e1[axis][lane] = e1[axis];
                block.e2[axis][lane] = e2[axis];
            }
            block.reach[lane] = triangle.reach();
            block.ids[lane] = TriangleId(id);
        }
        block
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
            children: [Child::NONE; WIDTH],
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
