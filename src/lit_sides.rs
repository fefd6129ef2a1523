//! Sides that no light can reach, so that nothing is spent on them.
//!
//! Surfaces reflect on both sides, yet of a solid nobody sees the inside, and of a room nobody the outside
//! of its walls. Sides that hang together are looked at as one: random walks start from them, bounce
//! wherever they land, and ask at every point whether a light can be seen. If one of them can, the sides
//! are lit. If none can, they are left without patches: black. A gap so narrow that no walk finds it lets
//! in no light that would be seen either.

use crate::geometry::{Ray, RayCaster, TriangleId};
use crate::light::{EmittingTriangles, Facet, Light, UniformSky};
use crate::patches::{Side, Sides};
use crate::sampling::{PointSet, Purpose, Stream, cosine_hemisphere};
use crate::scene::Scene;
use crate::scene::groups::Groups;
use glam::Vec3;
use rayon::prelude::*;

/// Walks from sides that hang together: this many, and more from large meshes.
const WALKS: usize = 256;
/// If there are many loose parts, all of them share this many walks, but each has some.
const WALKS_OF_ALL: usize = 1 << 18;
const FEWEST_WALKS: usize = 16;
/// Bounces of a walk. In a maze light goes around more corners, and grows dim.
const BOUNCES: u32 = 8;

/// The sides of each triangle that light can reach. What emits is always among them.
pub(crate) fn lit_sides(scene: &Scene, caster: &dyn RayCaster, seed: u64) -> Vec<Sides> {
    let (emitters, sky) = (EmittingTriangles::of(scene), UniformSky::new(scene.sky));
    let mut lights: Vec<&dyn Light> = vec![&emitters];
    if scene.sky != Vec3::ZERO {
        lights.push(&sky);
    }
    let mut sides = Sides::of_all(scene);
    leave_out_hidden(scene, &mut sides);
    let parts = connected(scene, &sides);
    let of_all = scene.affordable(1, WALKS_OF_ALL as u32) as usize;
    if of_all < WALKS_OF_ALL && of_all < 4 * parts.len() {
        // A search would take too long; all sides have patches.
        return sides;
    }
    let walks = (of_all / parts.len().max(1)).clamp(FEWEST_WALKS, WALKS);
    let search = Search { scene, caster, lights: &lights, seed, sides: &sides, walks };
    let dark: Vec<Vec<u32>> = parts.into_par_iter().filter(|part| !search.is_lit(part)).collect();
    for side in dark.into_iter().flatten() {
        let (triangle, is_back) = side_of(side);
        let sides = &mut sides[triangle.index()];
        *if is_back { &mut sides.back } else { &mut sides.front } = false;
    }
    sides
}

/// What lies wholly behind others in its plane is not there at all.
fn leave_out_hidden(scene: &Scene, sides: &mut [Sides]) {
    let is_hidden = |triangle: TriangleId, is_back| {
        let shape = &scene.triangles[triangle.index()];
        // What rounding leaves of an area that is wholly covered.
        scene.shown_share(triangle, is_back, shape) < 1e-6
    };
    let overlapping: Vec<TriangleId> = scene.overlaps().triangles().collect();
    let hidden = overlapping.par_iter().map(|&t| [is_hidden(t, false), is_hidden(t, true)]);
    for (triangle, [front, back]) in overlapping.iter().zip(hidden.collect::<Vec<_>>()) {
        let sides = &mut sides[triangle.index()];
        sides.front &= !front;
        sides.back &= !back;
    }
}

/// The sides that hang together over edges with two triangles, part by part. A side's number is twice its
/// triangle's, plus one if it is the back.
fn connected(scene: &Scene, sides: &[Sides]) -> Vec<Vec<u32>> {
    let topology = scene.topology();
    let mut groups = Groups::new(2 * sides.len());
    for edge in topology.edges() {
        let halves: Vec<_> = edge.take(3).collect();
        let [a, b] = halves[..] else { continue };
        let start = |half: crate::scene::topology::HalfEdge| {
            topology.corners[half.triangle.index()][half.start]
        };
        // Neighbours that are wound alike run along their edge in opposite directions.
        let turned = (start(a) == start(b)) as usize;
        for back in 0..2 {
            groups.join(2 * a.triangle.index() + back, 2 * b.triangle.index() + (back ^ turned));
        }
    }
    groups.of_members(|side| {
        let (triangle, is_back) = side_of(side as u32);
        let sides = sides[triangle.index()];
        if is_back { sides.back } else { sides.front }
    })
}

/// The triangle of the side with this number, and whether it is the back.
fn side_of(number: u32) -> (TriangleId, bool) {
    (TriangleId(number / 2), number & 1 == 1)
}

struct Search<'a> {
    scene: &'a Scene,
    caster: &'a dyn RayCaster,
    lights: &'a [&'a dyn Light],
    seed: u64,
    sides: &'a [Sides],
    /// From a small part.
    walks: usize,
}

impl Search<'_> {
    fn is_lit(&self, part: &[u32]) -> bool {
        let emits = |&side: &u32| {
            let (triangle, is_back) = side_of(side);
            self.scene.radiance_on(triangle, is_back) != Vec3::ZERO
        };
        let walks = self.walks + part.len() / 16;
        part.iter().any(emits)
            || (0..walks).any(|walk| {
                // Spread over the part, however many sides it has.
                let side = part[walk * part.len() / walks];
                let number = (side as u64) << 32 | walk as u64;
                self.finds_light(
                    side,
                    Stream::new(self.seed, Purpose::LitSides, number, PointSet::Random),
                )
            })
    }

    /// Whether a walk from this side comes to a point that sees a light.
    fn finds_light(&self, side: u32, stream: Stream) -> bool {
        let (triangle, is_back) = side_of(side);
        let side = Side::new(self.scene, triangle, is_back);
        let [x0, x1, ..] = stream.point(0);
        let (mut point, mut normal) = Facet::new(side.shape(self.scene), &side).point([x0, x1]);
        for bounce in 1..=BOUNCES {
            let [l0, l1, d0, d1] = stream.point(bounce);
            if self.sees_light(point, normal, [l0, l1]) {
                return true;
            }
            let ray = Ray::new(point, cosine_hemisphere(normal, d0, d1));
            let Some(hit) = self.caster.nearest(&ray) else { return false };
            let triangle = &self.scene.triangles[hit.triangle.index()];
            let is_back = triangle.normal().dot(ray.direction) >= 0.0;
            let sides = self.sides[hit.triangle.index()];
            if !(if is_back { sides.back } else { sides.front }) {
                return false;
            }
            let side = Side::new(self.scene, hit.triangle, is_back);
            (point, normal) = (side.lifted(triangle.at(hit.u, hit.v)), side.normal);
        }
        false
    }

    fn sees_light(&self, point: Vec3, normal: Vec3, xi: [f32; 2]) -> bool {
        let clear = |light: &&dyn Light| {
            let sample = light.sample_at(point, normal, xi);
            sample.is_some_and(|sample| !self.caster.occluded(&sample.segment))
        };
        self.lights.iter().any(clear)
    }
}
