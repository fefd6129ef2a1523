//! Watertightness: how often a closed mesh lets a ray out through a seam.

use super::rays::through_seams;
use super::survey::Peer;
use crate::geometry::{Ray, RayCaster, Triangle};
use crate::scene::topology::Topology;
use rayon::prelude::*;
use serde::Serialize;
use std::fmt;

/// Rays from inside a closed mesh through its edges and vertices that hit nothing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Leaks {
    pub caster: &'static str,
    pub rays: u64,
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

/// Counts for the native caster and for every peer; nothing for a mesh that is not closed.
pub fn leaks(
    triangles: &[Triangle],
    native: &(impl RayCaster + ?Sized),
    peers: &[Peer],
    rays: u64,
    seed: u64,
) -> Vec<Leaks> {
    let Some(inside) = inside_of(triangles) else { return Vec::new() };
    let rays = through_seams(triangles, inside, rays.max(1), seed);
    let ours = Leaks { caster: "native", rays: rays.len() as u64, escaped: escaped(native, &rays) };
    let theirs = peers.iter().map(|peer| Leaks {
        caster: peer.name,
        rays: rays.len() as u64,
        escaped: escaped(&*peer.caster, &rays),
    });
    std::iter::once(ours).chain(theirs).collect()
}

fn escaped(caster: &(impl RayCaster + ?Sized), rays: &[Ray]) -> u64 {
    rays.par_chunks(4096)
        .map(|rays| {
            let mut hits = Vec::new();
            caster.nearest_batch(rays, &mut hits);
            hits.iter().filter(|hit| hit.is_none()).count() as u64
        })
        .sum()
}

/// A point inside a closed convex mesh: the mean of its corners. `None` if the mesh is open, or the
/// point does not lie on one side of all its triangles.
fn inside_of(triangles: &[Triangle]) -> Option<glam::Vec3> {
    if Topology::new(triangles).open_edges() > 0 {
        return None;
    }
    let count = (3 * triangles.len()) as f64;
    let mean =
        triangles.iter().flat_map(|t| t.p).map(|p| p.as_dvec3() / count).sum::<glam::DVec3>();
    let side = |t: &Triangle| t.double_area_normal().dot(mean - t.p[0].as_dvec3());
    let one_sided =
        triangles.iter().all(|t| side(t) > 0.0) || triangles.iter().all(|t| side(t) < 0.0);
    one_sided.then_some(mean.as_vec3())
}
