//! Watertightness: how often closed meshes let a ray out through a seam.

use super::interior::{Inside, pick, points_inside};
use super::survey::{Answers, Peer};
use crate::geometry::{Ray, RayCaster, Triangle, TriangleId};
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::topology::{Topology, VertexId};
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;

/// Attempts to find points inside, divided among all closed parts.
const ATTEMPTS: u64 = 4096;

/// The least number of attempts per closed part, however many parts there are.
const ATTEMPTS_PER_PART: u64 = 8;

/// Rays that are asked and forgotten together.
const CHUNK: u64 = 4096;

/// Rays from inside closed meshes through edges and vertices, and how many of them hit nothing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Leaks {
    pub caster: &'static str,
    pub rays: u64,
    /// By the nearest-hit query or by the any-hit query.
    pub escaped: u64,
}

impl fmt::Display for Leaks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let per_million = self.escaped as f64 * 1e6 / self.rays as f64;
        write!(
            f,
            "leaks  {:<22} {} of {} rays through seams, {per_million:.2} a million",
            self.caster, self.escaped, self.rays
        )
    }
}

/// Counts for the native caster and for every peer; nothing if no part of the mesh is closed.
pub(crate) fn leaks(
    triangles: &[Triangle],
    native: &dyn RayCaster,
    peers: &[Peer],
    rays: u64,
    seed: u64,
) -> Vec<Leaks> {
    let topology = Topology::new(triangles);
    let parts = topology.closed_parts();
    let seams = Seams::new(triangles, &topology, &parts, seed);
    if seams.starts.is_empty() {
        return Vec::new();
    }
    let rays = rays.max(1);
    let ours = Leaks { caster: "native", rays, escaped: seams.escaped(native, false, rays) };
    let theirs = peers.iter().map(|peer| Leaks {
        caster: peer.name,
        rays,
        escaped: seams.escaped(&*peer.caster, peer.single, rays),
    });
    std::iter::once(ours).chain(theirs).collect()
}

/// Points to start from, and what to aim at.
struct Seams<'t> {
    triangles: &'t [Triangle],
    topology: &'t Topology,
    starts: Vec<Inside<'t>>,
    /// The triangles at each vertex, sorted.
    fans: Vec<(VertexId, TriangleId)>,
    seed: u64,
}

impl<'t> Seams<'t> {
    fn new(
        triangles: &'t [Triangle],
        topology: &'t Topology,
        parts: &'t [Vec<TriangleId>],
        seed: u64,
    ) -> Self {
        let attempts = (ATTEMPTS / parts.len().max(1) as u64).max(ATTEMPTS_PER_PART);
        let inside = |part: &'t Vec<TriangleId>| points_inside(triangles, part, attempts, seed);
        let starts = parts.par_iter().flat_map_iter(inside).collect();
        let ids = (0..triangles.len() as u32).map(TriangleId);
        let mut fans: Vec<(VertexId, TriangleId)> =
            ids.flat_map(|id| topology.corners[id.index()].map(|vertex| (vertex, id))).collect();
        fans.sort_unstable();
        Seams { triangles, topology, starts, fans, seed }
    }

    /// The number of the first `rays` rays that hit nothing.
    fn escaped(&self, caster: &dyn RayCaster, single: bool, rays: u64) -> u64 {
        (0..rays.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let numbers = chunk * CHUNK..rays.min((chunk + 1) * CHUNK);
                let rays: Vec<Ray> = numbers.map(|number| self.ray(number)).collect();
                let answers = Answers::of(caster, &rays, single);
                let each = answers.nearest.iter().zip(&answers.occluded);
                each.filter(|(hit, occluded)| hit.is_none() || !**occluded).count() as u64
            })
            .sum()
    }

    /// From the points in turn: half of the rays at seams near by, half anywhere in the same part.
    fn ray(&self, number: u64) -> Ray {
        let stream = Stream::new(self.seed, Purpose::Verify, u64::MAX - number, PointSet::Random);
        let [x, y, z, w] = stream.point(0);
        let [a, b, ..] = stream.point(1);
        let start = &self.starts[(number % self.starts.len() as u64) as usize];
        let near = self.fan(*pick(&self.topology.corners[start.beside.index()], x));
        let aim = if w < 0.5 { pick(near, y).1 } else { *pick(start.part, y) };
        let corners = self.triangles[aim.index()].p;
        let first = *pick(&[0, 1, 2], z);
        let (p, q) = (corners[first], corners[(first + 1) % 3]);
        // One in four at the vertex itself, the others along the edge.
        let target = if a < 0.25 { p } else { p.lerp(q, b) };
        Ray::new(start.point, target - start.point)
    }

    fn fan(&self, vertex: VertexId) -> &[(VertexId, TriangleId)] {
        let start = self.fans.partition_point(|(other, _)| *other < vertex);
        let end = self.fans.partition_point(|(other, _)| *other <= vertex);
        &self.fans[start..end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Bvh;
    use crate::geometry::{BruteForce, MollerTrumbore};
    use crate::verify::Arithmetic;
    use crate::verify::interior::tests::torus;
    use glam::Vec3;

    fn peer<'t>(name: &'static str, single: bool, caster: impl RayCaster + 't) -> Peer<'t> {
        let arithmetic = Arithmetic::MollerTrumbore;
        Peer { name, caster: Box::new(caster), arithmetic, is_native: true, single }
    }

    #[test]
    fn a_torus_askew_in_space_loses_no_ray() {
        let triangles = torus();
        let bvh = || Bvh::<MollerTrumbore>::build(&triangles[..]);
        let brute_force = BruteForce::<MollerTrumbore>::new(&triangles);
        let peers = [peer("native single", true, bvh()), peer("brute force", false, brute_force)];
        let leaks = leaks(&triangles, &bvh(), &peers, 300_000, 1);
        assert_eq!(leaks.len(), 3);
        for leak in leaks {
            assert_eq!((leak.rays, leak.escaped), (300_000, 0), "{leak}");
        }
    }

    #[test]
    fn nothing_is_counted_of_a_mesh_with_a_hole() {
        let mut triangles = torus();
        triangles.pop();
        let bvh = Bvh::<MollerTrumbore>::build(&triangles[..]);
        assert_eq!(leaks(&triangles, &bvh, &[], 1000, 1), []);
    }

    /// A block from a corner to the opposite one.
    fn block(min: Vec3, max: Vec3) -> Vec<Triangle> {
        let corner =
            |i: usize| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min);
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
            .map(|side| side.map(corner))
            .iter()
            .flat_map(|&[a, b, c, d]| [Triangle::new(a, b, c), Triangle::new(a, c, d)])
            .collect()
    }

    #[test]
    fn two_closed_blocks_in_an_open_room_are_both_counted() {
        let mut room = block(Vec3::ZERO, Vec3::splat(5.0));
        room.drain(..2);
        let blocks = [1.0, 3.0].map(|x| block(Vec3::splat(x), Vec3::splat(x + 1.0)));
        let scene = [&room[..], &blocks[0], &blocks[1]].concat();
        let without = |left: &[Triangle]| {
            let triangles = [&room[..], left].concat();
            let caster = BruteForce::<MollerTrumbore>::new(&triangles);
            leaks(&scene, &caster, &[], 10_000, 1)[0].escaped
        };
        assert_eq!(without(&blocks.concat()), 0);
        assert!(without(&blocks[0]) > 0 && without(&blocks[1]) > 0);
    }
}
