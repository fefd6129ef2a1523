//! Hierarchies with one deliberate fault each, on which the checks of [`verify`](crate::verify) prove
//! themselves.
//!
//! Faults of data are put into real SIMD hierarchies. Faults of a comparison or a sign are in a kernel
//! that is a copy of [`MollerTrumbore`] but for the one line.

use super::leaf::{RANK, REACH, WORDS};
use super::node::Node;
use super::{Bvh, Child, ChildKind, LeafKernel};
use crate::geometry::moller_trumbore::{band_scale, determinants, volume};
use crate::geometry::{Kernel, MollerTrumbore, Ray, RayCaster, Triangle};
use glam::DVec3;

/// A named fault, to be built over any triangles.
pub(crate) struct Mutant {
    pub name: &'static str,
    pub build: for<'t> fn(&'t [Triangle]) -> Box<dyn RayCaster + 't>,
}

/// The caster without a fault, as the mutants' copy of the kernel has it.
pub(crate) const CONTROL: Mutant = Mutant { name: "no fault", build: kernel::<NO_FAULT> };

pub(crate) const MUTANTS: [Mutant; 22] = [
    Mutant { name: "a box one ulp too small", build: |t| data(t, shrink_a_box) },
    Mutant { name: "a child dropped", build: |t| data(t, drop_a_child) },
    Mutant {
        name: "two children's boxes exchanged",
        build: |t| data(t, |bvh| bvh.nodes[0].children.swap(0, 1)),
    },
    Mutant {
        name: "e2 of one triangle negated",
        build: |t| data(t, |bvh| (6..9).for_each(|kind| a_word(bvh, kind, |e2| *e2 = -*e2))),
    },
    Mutant { name: "a corner moved by one ulp", build: |t| data(t, |bvh| a_word(bvh, 0, nudge)) },
    Mutant { name: "an edge longer by one ulp", build: |t| data(t, |bvh| a_word(bvh, 3, nudge)) },
    Mutant {
        name: "the numbers of two triangles exchanged",
        build: |t| data(t, |bvh| a_leaf(bvh, RANK).swap(0, 1)),
    },
    Mutant { name: "a leaf one triangle short", build: |t| data(t, shorten_a_leaf) },
    Mutant { name: "little reach, so that f32 decides seams", build: |t| data(t, forget_reach) },
    Mutant { name: "u > 0 for u >= 0", build: kernel::<U_OPEN> },
    Mutant { name: "v > 0 for v >= 0", build: kernel::<V_OPEN> },
    Mutant { name: "w > 0 for w >= 0", build: kernel::<W_OPEN> },
    Mutant { name: "w not asked", build: kernel::<W_IGNORED> },
    Mutant { name: "w with a wrong sign", build: kernel::<W_NEGATED> },
    Mutant { name: "t >= t_min for t > t_min", build: kernel::<START_CLOSED> },
    Mutant { name: "t < t_max for t <= t_max", build: kernel::<END_OPEN> },
    Mutant { name: "t_max not asked", build: kernel::<END_IGNORED> },
    Mutant { name: "t of back faces not corrected", build: kernel::<BACK_FACES_BEHIND> },
    Mutant { name: "u of back faces not corrected", build: kernel::<BACK_FACES_ASKEW> },
    Mutant { name: "u and v exchanged", build: kernel::<UV_EXCHANGED> },
    Mutant { name: "a ray in a triangle's plane hits it", build: kernel::<PLANE_HIT> },
    Mutant { name: "seams decided by f64 alone", build: kernel::<F64_SEAMS> },
];

fn data(triangles: &[Triangle], fault: impl Fn(&mut Bvh)) -> Box<dyn RayCaster + '_> {
    let mut bvh = Bvh::build(triangles);
    fault(&mut bvh);
    Box::new(bvh)
}

fn kernel<const FAULT: u8>(triangles: &[Triangle]) -> Box<dyn RayCaster + '_> {
    Box::new(Bvh::<Faulty<FAULT>>::build(triangles))
}

/// Where a leaf with at least two triangles hangs: its node and its slot.
fn a_place(bvh: &Bvh) -> (usize, usize) {
    let is_large = |child: &Child| matches!(child.kind(), ChildKind::Leaf(_, count) if count > 1);
    let find = |node: &Node| (0..8).find(|&slot| node.has(slot) && is_large(&node.children[slot]));
    let places = bvh.nodes.iter().enumerate();
    let mut places = places.filter_map(|(index, node)| find(node).map(|slot| (index, slot)));
    places.next().expect("a leaf with two triangles")
}

/// The numbers of one kind of such a leaf.
fn a_leaf(bvh: &mut Bvh, kind: usize) -> &mut [f32] {
    let (node, slot) = a_place(bvh);
    let ChildKind::Leaf(first, count) = bvh.nodes[node].children[slot].kind() else {
        unreachable!()
    };
    &mut bvh.leaves.words[first * WORDS + kind * count..][..count]
}

fn a_word(bvh: &mut Bvh, kind: usize, change: impl Fn(&mut f32)) {
    a_leaf(bvh, kind).iter_mut().for_each(change);
}

fn nudge(x: &mut f32) {
    *x = x.next_up();
}

/// The first child's box is emptied, so that it is not there.
fn drop_a_child(bvh: &mut Bvh) {
    let node = &mut bvh.nodes[0];
    for [min, max] in &mut node.bounds {
        // Still a child, for those that follow it, but nowhere.
        (min[0], max[0]) = (f32::MAX, f32::MAX);
    }
}

/// The last triangle is forgotten; its numbers remain where they are.
fn shorten_a_leaf(bvh: &mut Bvh) {
    let (node, slot) = a_place(bvh);
    let ChildKind::Leaf(first, count) = bvh.nodes[node].children[slot].kind() else {
        unreachable!()
    };
    let words = bvh.leaf(first, count).words.to_vec();
    let short = &mut bvh.leaves.words[first * WORDS..];
    for kind in 0..WORDS {
        short[kind * (count - 1)..][..count - 1]
            .copy_from_slice(&words[kind * count..][..count - 1]);
    }
    bvh.nodes[node].children[slot] = Child::leaf(first, count - 1);
}

/// With next to no reach f32 decides what it cannot.
fn forget_reach(bvh: &mut Bvh) {
    for node in 0..bvh.nodes.len() {
        for slot in 0..8 {
            let child = bvh.nodes[node].children[slot];
            if let ChildKind::Leaf(first, count) = child.kind() {
                let start = first * WORDS + REACH * count;
                bvh.leaves.words[start..start + count].fill(1e-30);
            }
        }
    }
}

/// The box of one leaf, shrunk on every side to one ulp inside what it holds.
fn shrink_a_box(bvh: &mut Bvh) {
    let (node, slot) = a_place(bvh);
    let ChildKind::Leaf(first, count) = bvh.nodes[node].children[slot].kind() else {
        unreachable!()
    };
    let leaf = bvh.leaf(first, count);
    let corners = (0..count).flat_map(|number| leaf.triangle(number).p);
    let exact: crate::geometry::bounds::Bounds = corners.collect();
    for (axis, [min, max]) in bvh.nodes[node].bounds.iter_mut().enumerate() {
        min[slot] = exact.min[axis].next_up();
        max[slot] = exact.max[axis].next_down();
    }
}

const NO_FAULT: u8 = 0;
const U_OPEN: u8 = 1;
const V_OPEN: u8 = 2;
const W_OPEN: u8 = 3;
const W_IGNORED: u8 = 4;
const W_NEGATED: u8 = 5;
const START_CLOSED: u8 = 6;
const END_OPEN: u8 = 7;
const END_IGNORED: u8 = 8;
const BACK_FACES_BEHIND: u8 = 9;
const BACK_FACES_ASKEW: u8 = 10;
const UV_EXCHANGED: u8 = 11;
const PLANE_HIT: u8 = 12;
const F64_SEAMS: u8 = 13;

/// [`MollerTrumbore`] with the fault of that number.
#[derive(Debug, Clone, Copy, Default)]
struct Faulty<const FAULT: u8>;

impl<const FAULT: u8> Faulty<FAULT> {
    fn in_interval(t: f32, ray: &Ray) -> bool {
        let late = if FAULT == START_CLOSED { t >= ray.t_min } else { t > ray.t_min };
        let early = match FAULT {
            END_OPEN => t < ray.t_max,
            END_IGNORED => t.is_finite(),
            _ => t <= ray.t_max.min(f32::MAX),
        };
        late && early
    }

    fn seam(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)> {
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let [a, b, c] = triangle.p.map(|p| p.as_dvec3() - o);
        let edge = |p: DVec3, q: DVec3| match FAULT {
            F64_SEAMS => d.dot(p.cross(q)),
            _ => volume(d, p, q),
        };
        let (u, v, w) = (edge(c, a), edge(a, b), edge(b, c));
        let sum = u + v + w;
        let is_inside = |u: f64, v: f64, w: f64| {
            (if FAULT == U_OPEN { u > 0.0 } else { u >= 0.0 })
                && (if FAULT == V_OPEN { v > 0.0 } else { v >= 0.0 })
                && (if FAULT == W_OPEN { w > 0.0 } else { w >= 0.0 || FAULT == W_IGNORED })
        };
        let inside = is_inside(u, v, w) || is_inside(-u, -v, -w);
        if FAULT == PLANE_HIT && sum == 0.0 && inside {
            return Self::in_interval(1.0, ray).then_some((1.0, 0.0, 0.0));
        }
        let normal = (b - a).cross(c - a);
        let t = (normal.dot(a) / normal.dot(d)) as f32;
        let hit = inside && sum != 0.0 && Self::in_interval(t, ray);
        hit.then_some((t, (u / sum) as f32, (v / sum) as f32))
    }
}

impl<const FAULT: u8> Kernel for Faulty<FAULT> {
    fn intersect(ray: &Ray, triangle: &Triangle) -> Option<(f32, f32, f32)> {
        let (e1, e2) = triangle.edges();
        let d = determinants(
            ray.origin.to_array(),
            ray.direction.to_array(),
            triangle.p[0].to_array(),
            e1.to_array(),
            e2.to_array(),
        );
        let sign = 1f32.copysign(d.det);
        let (det, v) = (d.det * sign, d.v * sign);
        let u = if FAULT == BACK_FACES_ASKEW { d.u } else { d.u * sign };
        let w = if FAULT == W_NEGATED { u + v - det } else { det - u - v };
        let far = (ray.origin - triangle.p[0]).abs().max_element();
        let reach = triangle.reach();
        let band = (far * 2.0 + reach) * reach * band_scale(ray.direction);
        if det > band {
            if !(u >= -band && v >= -band && (w >= -band || FAULT == W_IGNORED)) {
                return None;
            }
            if u > band && v > band && (w > band || FAULT == W_IGNORED) {
                let sign = if FAULT == BACK_FACES_BEHIND { 1.0 } else { sign };
                let (t, u, v) = (d.t * sign / det, u / det, v / det);
                let (u, v) = if FAULT == UV_EXCHANGED { (v, u) } else { (u, v) };
                return Self::in_interval(t, ray).then_some((t, u, v));
            }
        }
        if reach > 0.0 { Self::seam(ray, triangle) } else { None }
    }
}

impl<const FAULT: u8> LeafKernel for Faulty<FAULT> {}

mod tests {
    use super::*;

    #[test]
    fn the_copy_without_a_fault_is_the_kernel() {
        let triangles = crate::verify::grid::Grid::general(0, 1).triangles;
        for (i, triangle) in triangles.iter().enumerate() {
            let other = triangles[i / 2];
            for target in other.p.into_iter().chain([other.centroid(), triangle.centroid()]) {
                let origin = triangles[i / 3].centroid() * 3.1 - 7.3;
                let ray = Ray::new(origin, target - origin);
                let copy = Faulty::<NO_FAULT>::intersect(&ray, triangle);
                assert_eq!(copy, MollerTrumbore::intersect(&ray, triangle));
            }
        }
    }
}
