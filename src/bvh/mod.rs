//! A bounding volume hierarchy, eight wide, over the scene's triangles.
//!
//! `build` makes it (a library's binary tree, collapsed); `traverse` walks it with SIMD. Eight
//! boxes or eight triangles are tested at once; the same generic source is compiled for every
//! instruction set and one is chosen at run time. No operation is fused or approximate, so every
//! instruction set gives the same bits. They are those of [`BruteForce`](crate::geometry::BruteForce)
//! but where rounding puts a grazing hit before its own box, or a tie between two triangles.

mod build;
#[cfg(test)]
pub(crate) mod mutants;
mod traverse;

use crate::geometry::{
    Hit, Kernel, MollerTrumbore, Ray, RayCaster, Triangle, TriangleId, kernel::KernelKind,
};
use fearless_simd::{Level, dispatch};
use std::marker::PhantomData;

pub use traverse::BlockKernel;

/// Children of a node, and triangles of a block.
pub(crate) const WIDTH: usize = 8;

/// Eight children: boxes as `bounds[axis][0 = min, 1 = max][child]`, then what is in them.
#[repr(align(64))]
#[derive(Debug, Clone)]
struct Node {
    bounds: [[[f32; WIDTH]; 2]; 3],
    children: [Child; WIDTH],
}

/// An inner node, a block of triangles, or nothing (its box is empty and never hit).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Child(u32);

impl Child {
    const BLOCK: u32 = 1 << 31;
    /// Block 0 has no triangles in it.
    const NONE: Child = Child(Child::BLOCK);

    fn node(index: usize) -> Child {
        debug_assert!(index < Child::BLOCK as usize);
        Child(index as u32)
    }

    fn block(index: usize) -> Child {
        debug_assert!(index < Child::BLOCK as usize);
        Child(index as u32 | Child::BLOCK)
    }
}

/// Up to eight triangles as (p₀, e₁, e₂) per axis and lane. Unused lanes have no area.
#[repr(align(64))]
#[derive(Debug, Clone)]
pub struct TriangleBlock {
    p0: [[f32; WIDTH]; 3],
    e1: [[f32; WIDTH]; 3],
    e2: [[f32; WIDTH]; 3],
    /// See [`Triangle::reach`].
    reach: [f32; WIDTH],
    ids: [TriangleId; WIDTH],
}

/// The scene's triangles, ready to be traced with kernel `K`.
pub struct Bvh<'t, K = MollerTrumbore> {
    nodes: Vec<Node>,
    blocks: Vec<TriangleBlock>,
    triangles: &'t [Triangle],
    level: Level,
    kernel: PhantomData<K>,
}

impl<'t, K: Kernel> Bvh<'t, K> {
    /// Builds over `triangles`; hits refer to them by index. Any number of them, none included.
    pub fn build(triangles: &'t [Triangle]) -> Self {
        let (nodes, blocks) = build::build(triangles);
        Bvh { nodes, blocks, triangles, level: Level::new(), kernel: PhantomData }
    }

    /// Memory that the hierarchy takes beside the triangles, in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.nodes[..]) + size_of_val(&self.blocks[..])
    }
}

/// The dispatch is innermost, so that all that it calls is inlined into code for its instruction set.
impl<K: BlockKernel> RayCaster for Bvh<'_, K> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        traverse::with_stack(
            |stack| dispatch!(self.level, simd => traverse::nearest(simd, self, ray, stack)),
        )
    }

    fn occluded(&self, ray: &Ray) -> bool {
        traverse::with_stack(
            |stack| dispatch!(self.level, simd => traverse::occluded(simd, self, ray, stack)),
        )
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        hits.clear();
        traverse::with_stack(
            |stack| dispatch!(self.level, simd => traverse::nearest_batch(simd, self, rays, hits, stack)),
        )
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        blocked.clear();
        traverse::with_stack(
            |stack| dispatch!(self.level, simd => traverse::occluded_batch(simd, self, rays, blocked, stack)),
        )
    }
}

/// A [`Bvh`] whose kernel was chosen at run time.
pub enum AnyBvh<'t> {
    Plane(Bvh<'t, crate::geometry::Plane>),
    MollerTrumbore(Bvh<'t, MollerTrumbore>),
}

impl<'t> AnyBvh<'t> {
    pub fn build(triangles: &'t [Triangle], kernel: KernelKind) -> Self {
        match kernel {
            KernelKind::Plane => AnyBvh::Plane(Bvh::build(triangles)),
            KernelKind::MollerTrumbore => AnyBvh::MollerTrumbore(Bvh::build(triangles)),
        }
    }
}

/// Passes each question on to the chosen kernel's hierarchy.
impl RayCaster for AnyBvh<'_> {
    fn nearest(&self, ray: &Ray) -> Option<Hit> {
        match self {
            AnyBvh::Plane(bvh) => bvh.nearest(ray),
            AnyBvh::MollerTrumbore(bvh) => bvh.nearest(ray),
        }
    }

    fn occluded(&self, ray: &Ray) -> bool {
        match self {
            AnyBvh::Plane(bvh) => bvh.occluded(ray),
            AnyBvh::MollerTrumbore(bvh) => bvh.occluded(ray),
        }
    }

    fn nearest_batch(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        match self {
            AnyBvh::Plane(bvh) => bvh.nearest_batch(rays, hits),
            AnyBvh::MollerTrumbore(bvh) => bvh.nearest_batch(rays, hits),
        }
    }

    fn occluded_batch(&self, rays: &[Ray], blocked: &mut Vec<bool>) {
        match self {
            AnyBvh::Plane(bvh) => bvh.occluded_batch(rays, blocked),
            AnyBvh::MollerTrumbore(bvh) => bvh.occluded_batch(rays, blocked),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BruteForce, Plane};
    use crate::sampling::{PointSet, Purpose, Stream};
    use glam::Vec3;

    /// Triangles of all sizes, slivers and exact duplicates among them.
    fn soup(count: u32, seed: u64) -> Vec<Triangle> {
        let stream = Stream::new(seed, Purpose::Pair, 0, PointSet::Random);
        let vector = |i: u32| {
            let [x, y, z, _] = stream.point(i);
            Vec3::new(x, y, z) * 2.0 - 1.0
        };
        let mut triangles: Vec<Triangle> = (0..count)
            .map(|i| {
                let size = 10f32.powf(-3.0 * stream.point(4 * i)[3]);
                let p = vector(4 * i);
                let sliver = if i % 5 == 0 { 1e-4 } else { 1.0 };
                let (e1, e2) = (vector(4 * i + 1) * size, vector(4 * i + 2) * size * sliver);
                Triangle::new(p, p + e1, p + e2)
            })
            .collect();
        let copies: Vec<Triangle> = triangles.iter().step_by(7).copied().collect();
        triangles.extend(copies);
        triangles
    }

    fn rays(count: u32, seed: u64, triangles: &[Triangle]) -> Vec<Ray> {
        let stream = Stream::new(seed, Purpose::Pixel, 1, PointSet::Random);
        (0..count)
            .map(|i| {
                let [x, y, z, w] = stream.point(2 * i);
                let [a, b, c, _] = stream.point(2 * i + 1);
                let origin = Vec3::new(x, y, z) * 4.0 - 2.0;
                let direction = match i % 4 {
                    // Along an axis: zero components and boxes met face-on.
                    0 => [Vec3::X, Vec3::NEG_Y, Vec3::Z][i as usize / 4 % 3],
                    // Through a vertex and through an edge.
                    1 => triangles[i as usize % triangles.len()].p[i as usize / 4 % 3] - origin,
                    2 => triangles[i as usize % triangles.len()].at(a, 0.0) - origin,
                    _ => Vec3::new(a, b, c) - 0.5,
                };
                let t_max = if w < 0.5 { f32::INFINITY } else { 4.0 * w };
                Ray { t_max, ..Ray::new(origin, direction) }
            })
            .collect()
    }

    fn assert_same_as_brute_force<K: BlockKernel>(triangles: &[Triangle], rays: &[Ray]) {
        let brute = BruteForce::<K>::new(triangles);
        let bvh = Bvh::<K>::build(triangles);
        let (mut hits, mut blocked) = (Vec::new(), Vec::new());
        bvh.nearest_batch(rays, &mut hits);
        bvh.occluded_batch(rays, &mut blocked);
        for (i, ray) in rays.iter().enumerate() {
            let expected = brute.nearest(ray);
            assert_same_hit(bvh.nearest(ray), expected, triangles, || format!("ray {i}: {ray:?}"));
            assert_eq!(hits[i], bvh.nearest(ray), "batched ray {i}: {ray:?}");
            assert_eq!(bvh.occluded(ray), expected.is_some(), "ray {i}: {ray:?}");
            assert_eq!(blocked[i], expected.is_some(), "batched ray {i}: {ray:?}");
        }
    }

    /// The same bits; of exact copies of a triangle any may be named, since a kernel's t of a
    /// grazing hit can lie so far before the triangle's box that the copy is not visited any more.
    fn assert_same_hit(
        answer: Option<Hit>,
        expected: Option<Hit>,
        triangles: &[Triangle],
        ray: impl Fn() -> String,
    ) {
        let shape = |hit: Hit| (triangles[hit.triangle.index()], hit.t, hit.u, hit.v);
        assert_eq!(answer.map(shape), expected.map(shape), "{}", ray());
    }

    #[test]
    fn every_answer_is_brute_forces_bit_for_bit() {
        for (count, seed) in [(1, 1), (3, 2), (40, 3), (2000, 4)] {
            let triangles = soup(count, seed);
            let rays = rays(3000, seed, &triangles);
            assert_same_as_brute_force::<MollerTrumbore>(&triangles, &rays);
            assert_same_as_brute_force::<Plane>(&triangles, &rays);
        }
    }

    #[test]
    fn every_instruction_set_gives_the_same_bits() {
        let triangles = soup(500, 9);
        let rays = rays(4000, 9, &triangles);
        let answers = |level| {
            let mut bvh = Bvh::<MollerTrumbore>::build(&triangles);
            bvh.level = level;
            let mut hits = Vec::new();
            bvh.nearest_batch(&rays, &mut hits);
            hits
        };
        let best = answers(Level::new());
        assert!(best.iter().flatten().count() > 1000, "the rays must hit something");
        assert_eq!(best, answers(Level::baseline()));
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = Level::new().as_avx2() {
            assert_eq!(best, answers(Level::Avx2(avx2)));
        }
    }

    #[test]
    fn a_ray_in_a_face_of_a_box_still_finds_what_touches_it() {
        // The triangle's box ends exactly where the ray runs, with zeros in the direction.
        let triangles = [Triangle::new(Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, 1.0))];
        for (origin, direction) in
            [(Vec3::new(0.5, 0.0, 1.0), Vec3::NEG_Z), (Vec3::new(0.0, 0.5, 2.0), Vec3::NEG_Z)]
        {
            let ray = Ray::new(origin, direction);
            let expected = BruteForce::<MollerTrumbore>::new(&triangles).nearest(&ray);
            assert!(expected.is_some());
            assert_eq!(Bvh::<MollerTrumbore>::build(&triangles).nearest(&ray), expected);
        }
    }

    #[test]
    fn a_ray_in_a_face_at_zero_of_a_box_finds_what_touches_it_far_away() {
        let triangles =
            [Triangle::new(Vec3::ZERO, Vec3::new(4.0, 2.0, 0.0), Vec3::new(0.0, 0.0, 2.0))];
        for scale in [1.0, 1e-20, 1e15] {
            for zero in [0.0, -0.0] {
                let triangles = triangles.map(|t| Triangle { p: t.p.map(|p| p * scale) });
                let origin = Vec3::new(0.0, -8.0, 1.0) * scale;
                let ray = Ray::new(origin, Vec3::new(zero, 1.0, zero));
                let expected = BruteForce::<MollerTrumbore>::new(&triangles).nearest(&ray);
                assert!(expected.is_some());
                assert_eq!(Bvh::<MollerTrumbore>::build(&triangles).nearest(&ray), expected);
            }
        }
    }

    #[test]
    fn an_empty_scene_and_broken_rays_hit_nothing() {
        let ray = Ray::new(Vec3::ZERO, Vec3::X);
        assert_eq!(Bvh::<MollerTrumbore>::build(&[]).nearest(&ray), None);
        let triangles = soup(100, 5);
        let bvh = Bvh::<MollerTrumbore>::build(&triangles);
        for bad in [f32::NAN, f32::INFINITY] {
            assert_eq!(bvh.nearest(&Ray::new(Vec3::splat(bad), Vec3::X)), None);
            assert_eq!(bvh.nearest(&Ray::new(Vec3::ZERO, Vec3::splat(bad))), None);
        }
        assert_eq!(bvh.nearest(&Ray::new(Vec3::ZERO, Vec3::ZERO)), None);
    }
}
