//! A bounding volume hierarchy, eight wide, over the scene's triangles.
//!
//! | file | holds |
//! | --- | --- |
//! | `build` | a library's binary tree, made wide; long thin triangles in several boxes |
//! | `collapse` | which descendants a node adopts, at the least cost |
//! | `node` | eight boxes |
//! | `leaf`, `kernel8` | triangles as leaves hold them; the kernels on eight lanes |
//! | `pages` | memory in large pages |
//! | `met` | the answer of a kernel |
//! | `ray_lanes`, `traverse` | one ray against eight boxes; its walk |
//! | `interleaved` | many rays, each a step at a time |
//! | `packet`, `beam` | eight rays, one per lane; the volume that contains them |
//! | `packet_walk` | the walk of a packet, as long as its rays stay together |
//! | `stream` | a batch through a small hierarchy, node by node |
//! | `batch` | which of these ways a batch takes |
//! | `surfaces` | which of the triangles that a ray meets is seen: openings, overlaps in one plane |
//! | `tracer` | a hierarchy whose kernel is chosen at run time |
//!
//! One generic source is compiled for every instruction set and one is chosen at run time. No
//! operation is fused or approximate, so every instruction set gives the same bits, and so does every
//! way to trace. They are those of [`BruteForce`](crate::geometry::BruteForce) but where rounding puts
//! a grazing hit before its own box, or a tie between two triangles.

mod batch;
mod beam;
mod build;
mod collapse;
mod interleaved;
mod kernel8;
mod leaf;
mod met;
#[cfg(test)]
pub(crate) mod mutants;
mod node;
mod packet;
mod packet_walk;
mod pages;
mod ray_lanes;
mod stream;
pub(crate) mod surfaces;
#[cfg(test)]
mod tests;
mod tracer;
mod traverse;

use crate::geometry::bounds::Bounds;
use crate::geometry::{Hit, Kernel, MollerTrumbore, Ray, RayCaster, Stops, Triangle};
use crate::simd;
use batch::with_scratch;
use build::Parts;
use fearless_simd::{Level, dispatch};
use leaf::{Leaf, Leaves};
use node::Node;
use std::hint::select_unpredictable;
use std::marker::PhantomData;
use std::sync::Arc;

pub use build::Effort;
pub use kernel8::LeafKernel;
pub use surfaces::Surfaces;
pub use tracer::Tracer;

/// Children of a node, triangles of a leaf, rays of a packet.
pub(crate) const WIDTH: usize = 8;

/// A node's number, or a leaf: its first triangle, and their number less one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Child(u32);

/// A child, taken apart.
#[derive(Debug, Clone, Copy)]
enum ChildKind {
    Node(usize),
    /// Its first triangle and their number.
    Leaf(usize, usize),
}

impl Child {
    const ROOT: Child = Child(0);
    const LEAF: u32 = 1 << 31;
    const COUNT_SHIFT: u32 = 28;
    const FIRST: usize = (1 << Child::COUNT_SHIFT) - 1;

    fn node(index: usize) -> Child {
        assert!(index < Child::LEAF as usize, "too many nodes");
        Child(index as u32)
    }

    fn leaf(first: usize, count: usize) -> Child {
        assert!(first < 1 << Child::COUNT_SHIFT, "too many triangles");
        assert!((1..=WIDTH).contains(&count), "a leaf holds one to eight triangles");
        Child(first as u32 | (count as u32 - 1) << Child::COUNT_SHIFT | Child::LEAF)
    }

    #[inline(always)]
    fn is_leaf(self) -> bool {
        self.0 & Child::LEAF != 0
    }

    #[inline(always)]
    fn kind(self) -> ChildKind {
        if !self.is_leaf() {
            return ChildKind::Node(self.0 as usize);
        }
        let count = (self.0 >> Child::COUNT_SHIFT & 7) + 1;
        ChildKind::Leaf(self.0 as usize & Child::FIRST, count as usize)
    }
}

/// The scene's triangles, ready to be traced with kernel `K`.
pub struct Bvh<K = MollerTrumbore> {
    nodes: Vec<Node>,
    leaves: Leaves,
    /// Entries that one ray's stack may hold.
    stack: usize,
    /// The longest side of the whole.
    extent: f32,
    triangles: Arc<[Triangle]>,
    level: Level,
    kernel: PhantomData<K>,
}

impl<K: Kernel> Bvh<K> {
    /// Builds over `triangles`, quickly; hits refer to them by index. Any number of them, including
    /// none, up to 2²⁸ pieces.
    ///
    /// # Panics
    /// If `ISOLUX_SIMD` asks for an instruction set that there is not: see `simd`.
    pub fn build(triangles: impl Into<Arc<[Triangle]>>) -> Self {
        Self::build_with(triangles, Effort::Quick)
    }

    /// As [`build`](Bvh::build), with a chosen effort, which changes the time that answers take and no
    /// answer.
    ///
    /// # Panics
    /// As [`build`](Bvh::build).
    pub fn build_with(triangles: impl Into<Arc<[Triangle]>>, effort: Effort) -> Self {
        let level = simd::chosen();
        Self::build_for(triangles.into(), effort, level)
    }

    fn build_for(triangles: Arc<[Triangle]>, effort: Effort, level: Level) -> Self {
        let Parts { nodes, leaves, depth } = build::build(&triangles, effort);
        let bounds: Bounds = triangles.iter().flat_map(|triangle| triangle.p).collect();
        Bvh {
            nodes,
            leaves,
            stack: depth * (WIDTH - 1) + 2 * WIDTH,
            extent: bounds.diagonal().max_element(),
            triangles,
            level,
            kernel: PhantomData,
        }
    }

    /// Memory that the hierarchy takes beside the triangles, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + self.leaves.bytes()
    }
}

impl<K> Bvh<K> {
    #[inline(always)]
    fn leaf(&self, first: usize, count: usize) -> Leaf<'_> {
        Leaf { words: self.leaves.words_of(first, count), count, triangles: &self.triangles }
    }

    /// Asks for the memory of a node or a leaf before it is needed, without a branch: a node's four cache
    /// lines, or the first four of a leaf, which rarely has more.
    #[inline(always)]
    fn prefetch(&self, child: Child) {
        let (node, first) = (child.0 as usize, child.0 as usize & Child::FIRST);
        let node = self.nodes.as_ptr().wrapping_add(node).cast::<i8>();
        let leaf = self.leaves.words.as_ptr().wrapping_add(first * leaf::WORDS).cast::<i8>();
        let start = select_unpredictable(child.is_leaf(), leaf, node);
        for line in 0..4 {
            prefetch_line(start.wrapping_add(64 * line));
        }
    }
}

/// Asks for a cache line, on processors that have an instruction for it.
#[inline(always)]
fn prefetch_line(address: *const i8) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: every x86-64 has SSE, and a prefetch changes nothing, whatever the address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}

/// The dispatch is innermost, so that all that it calls is inlined into code for its instruction set.
impl<K: LeafKernel> RayCaster for Bvh<K> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        with_scratch(self.stack, |scratch| {
            let stack = &mut scratch.stack[..];
            dispatch!(self.level, simd => traverse::trace_single::<_, _, false>(simd, self, ray, stack))
        })
    }

    fn occluded(&self, ray: &Ray) -> bool {
        with_scratch(self.stack, |scratch| {
            let stack = &mut scratch.stack[..];
            dispatch!(self.level, simd => traverse::trace_single::<_, _, true>(simd, self, ray, stack))
                .is_some()
        })
    }

    fn nearest_stop(&self, ray: &Ray, stops: Stops) -> Option<Hit> {
        with_scratch(self.stack, |scratch| {
            let stack = &mut scratch.stack[..];
            dispatch!(self.level, simd => traverse::trace_to_stop(simd, self, ray, stack, stops))
        })
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        hits.resize(rays.len(), None);
        let finish = &mut |index: usize, hit| hits[index] = hit;
        with_scratch(
            self.stack,
            |scratch| dispatch!(self.level, simd => batch::trace::<_, _, false>(simd, self, rays, scratch, finish)),
        )
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        blocked.clear();
        blocked.resize(rays.len(), false);
        let finish = &mut |index: usize, hit: Option<Hit>| blocked[index] = hit.is_some();
        with_scratch(
            self.stack,
            |scratch| dispatch!(self.level, simd => batch::trace::<_, _, true>(simd, self, rays, scratch, finish)),
        )
    }
}
