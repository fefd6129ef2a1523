//! From a binary tree to an eight-wide one, at the least expected cost.
//!
//! A visit's cost times the surface of what is visited, to which the chance that a ray comes there is
//! proportional, summed over the tree: which descendants a node adopts, and what becomes a leaf, is chosen
//! by dynamic programming from the leaves up (Ylitie, Karras & Laine, *Efficient Incoherent Ray Traversal
//! on GPUs Through Compressed Wide BVHs*, HPG 2017, §3.1). Here a leaf's triangles are met at once.

use super::WIDTH;
use obvhs::bvh2::Bvh2;

/// Costs of a visit, relative to that of a node. From 1 to 2.5 for a leaf nothing changed beyond the
/// noise but the memory, by 6 %.
const LEAF: f32 = 1.0;
/// Cost of each triangle in a leaf: its memory.
const TRIANGLE: f32 = 0.1;

/// A child of a wide node: a node of the binary tree that becomes a node, or whose triangles become one
/// leaf.
#[derive(Debug, Clone, Copy)]
pub(super) enum Member {
    Node(usize),
    Leaf(usize),
}

/// The least costs of a binary tree's nodes.
pub(super) struct Collapse<'t> {
    tree: &'t Bvh2,
    /// For each binary node that is no leaf, its least cost as a forest of at most 1, 2, … 7 trees.
    costs: Vec<Costs>,
    /// Per binary node, where its costs are.
    place: Vec<u32>,
    /// For each binary node, the number of triangles below it, or one more than a leaf may have.
    triangles: Vec<u8>,
}

type Costs = [f32; WIDTH - 1];

impl<'t> Collapse<'t> {
    /// Computes the costs of a tree with one triangle, or a piece of one, in each leaf.
    ///
    /// # Panics
    /// Unless the tree's nodes lie before their children.
    pub(super) fn new(tree: &'t Bvh2) -> Self {
        assert!(tree.children_are_ordered_after_parents, "costs are known from the leaves up");
        let count = tree.nodes.len();
        let mut collapse = Collapse {
            tree,
            // Every inner node joins two.
            costs: Vec::with_capacity(count / 2),
            place: vec![0; count],
            triangles: vec![0; count],
        };
        for node in (0..count).rev() {
            collapse.judge(node);
        }
        collapse
    }

    /// The costs of a node whose children's are known.
    fn judge(&mut self, node: usize) {
        if self.tree.nodes[node].is_leaf() {
            self.triangles[node] = 1;
            return;
        }
        let [left, right] = self.children(node);
        self.triangles[node] = (self.triangles[left] + self.triangles[right]).min(WIDTH as u8 + 1);
        let as_node = self.tree.nodes[node].aabb().half_area() + self.shared(node, WIDTH).0;
        let mut least = as_node.min(self.leaf_cost(node));
        let mut costs = [least; WIDTH - 1];
        for trees in 2..WIDTH {
            least = least.min(self.shared(node, trees).0);
            costs[trees - 1] = least;
        }
        self.place[node] = self.costs.len() as u32;
        self.costs.push(costs);
    }

    #[inline(always)]
    fn costs(&self, node: usize) -> Costs {
        if self.tree.nodes[node].is_leaf() {
            [self.leaf_cost(node); WIDTH - 1]
        } else {
            self.costs[self.place[node] as usize]
        }
    }

    /// The least cost of a node's two children as a forest of at most `trees`, and how many of these
    /// are the left one's.
    #[inline(always)]
    fn shared(&self, node: usize, trees: usize) -> (f32, usize) {
        let [left, right] = self.children(node).map(|child| self.costs(child));
        let mut least = (f32::INFINITY, 1);
        for of_left in 1..trees {
            let cost = left[of_left - 1] + right[trees - of_left - 1];
            if cost < least.0 {
                least = (cost, of_left);
            }
        }
        least
    }

    fn leaf_cost(&self, node: usize) -> f32 {
        if !self.fits_leaf(node) {
            return f32::INFINITY;
        }
        let visit = LEAF + TRIANGLE * f32::from(self.triangles[node]);
        self.tree.nodes[node].aabb().half_area() * visit
    }

    fn fits_leaf(&self, node: usize) -> bool {
        self.triangles[node] as usize <= WIDTH
    }

    fn children(&self, node: usize) -> [usize; 2] {
        let first = self.tree.nodes[node].first_index as usize;
        [first, first + 1]
    }

    /// The one to eight members of a binary node that becomes a node; `members` is overwritten.
    pub(super) fn members(&self, node: usize, members: &mut Vec<Member>) {
        members.clear();
        if self.tree.nodes[node].is_leaf() {
            members.push(Member::Leaf(node));
        } else {
            self.split(node, WIDTH, members);
        }
    }

    fn split(&self, node: usize, trees: usize, members: &mut Vec<Member>) {
        let of_left = self.shared(node, trees).1;
        let [left, right] = self.children(node);
        self.adopt(left, of_left, members);
        self.adopt(right, trees - of_left, members);
    }

    fn adopt(&self, node: usize, mut trees: usize, members: &mut Vec<Member>) {
        if self.tree.nodes[node].is_leaf() {
            members.push(Member::Leaf(node));
            return;
        }
        let costs = self.costs(node);
        while trees > 1 && costs[trees - 1] == costs[trees - 2] {
            trees -= 1;
        }
        if trees > 1 {
            self.split(node, trees, members);
        } else if self.fits_leaf(node) && costs[0] == self.leaf_cost(node) {
            members.push(Member::Leaf(node));
        } else {
            members.push(Member::Node(node));
        }
    }

    /// Appends the triangles below a binary node, in ascending order, each once.
    pub(super) fn triangles(&self, node: usize, triangles: &mut Vec<u32>) {
        let first = triangles.len();
        self.append(node, triangles);
        triangles[first..].sort_unstable();
        // Pieces of one triangle may meet again in a leaf.
        let mut kept = first;
        for i in first..triangles.len() {
            if i == first || triangles[i] != triangles[kept - 1] {
                triangles[kept] = triangles[i];
                kept += 1;
            }
        }
        triangles.truncate(kept);
    }

    /// PLOC writes a triangle's number into its leaf. A leaf's tree is as small as the leaf.
    fn append(&self, node: usize, triangles: &mut Vec<u32>) {
        if self.tree.nodes[node].is_leaf() {
            triangles.push(self.tree.nodes[node].first_index);
        } else {
            self.children(node).into_iter().for_each(|child| self.append(child, triangles));
        }
    }
}
