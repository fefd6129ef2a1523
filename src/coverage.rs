//! How much of a patch can be seen at all.
//!
//! Models put things on top of each other: a block without a bottom stands on a floor, and the floor
//! goes on under it. A patch across the block's foot is dark on one part of its area, and its mean
//! is a wrong radiance for the part that shows. A point is covered if whatever way a ray leaves it,
//! even almost along the surface, it meets a black back: the inside of the block, or the top of a
//! lamp that touches the ceiling. Under a canopy light comes in from the side, and nothing is covered.

use crate::geometry::{Hit, Ray, RayCaster};
use crate::patches::{PatchId, PatchMesh};
use crate::progress::{Progress, Stage};
use crate::sampling::{orthonormal_basis, regular_triangle};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering};

/// The points tested on each patch are the centroids of its edges' 4-fold subdivision: 16.
const FINENESS: u32 = 4;

/// Rays from a point that is covered, and from a patch.
const PROBES: u32 = 65;
const MOST_RAYS: u32 = FINENESS.pow(2) * PROBES;

/// Below this part of the scene's area a patch is tested at its centroid alone: no picture shows more.
const SMALL: f64 = 1e-5;

/// Patches whose first rays are traced together.
const BATCH: usize = 64;

/// The uncovered share of each patch's area, in [0, 1], and the number of rays that it took.
pub(crate) fn uncovered(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    progress: &dyn Progress,
) -> (Vec<f32>, u64) {
    progress.begin(Stage::Coverage, Some(mesh.len() as u64));
    let rays = AtomicU64::new(0);
    let search = Search::new(caster, mesh);
    let mut shares = vec![1.0; mesh.len()];
    let batches = shares.par_chunks_mut(BATCH).enumerate();
    batches.for_each_init(Work::default, |work, (batch, shares)| {
        progress.advance(shares.len() as u64);
        // The caller throws away what is left undone.
        if !progress.is_stopped() {
            let first = PatchId((batch * BATCH) as u32);
            rays.fetch_add(search.shares(work, first, shares), Ordering::Relaxed);
        }
    });
    progress.end();
    (shares, rays.into_inner())
}

/// The uncovered share of one patch's area, in [0, 1].
pub(crate) fn uncovered_share(caster: &dyn RayCaster, mesh: &PatchMesh, patch: PatchId) -> f32 {
    let mut share = [1.0];
    Search::new(caster, mesh).shares(&mut Work::default(), patch, &mut share);
    share[0]
}

/// Finds what is covered.
pub(crate) struct Search<'a> {
    caster: &'a dyn RayCaster,
    mesh: &'a PatchMesh,
    small: f64,
    finest: u32,
    /// Whether anything can be covered, and it can be afforded to look.
    is_needed: bool,
}

/// One thread's buffers.
#[derive(Default)]
pub(crate) struct Work {
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
}

impl<'a> Search<'a> {
    pub(crate) fn new(caster: &'a dyn RayCaster, mesh: &'a PatchMesh) -> Self {
        let has_black_sides = mesh.sides().len() < 2 * mesh.scene.triangles.len();
        let affordable = mesh.scene.affordable(mesh.len(), MOST_RAYS);
        Search {
            caster,
            mesh,
            small: SMALL * mesh.scene.area(),
            finest: if affordable < MOST_RAYS { 1 } else { FINENESS },
            is_needed: has_black_sides && affordable >= PROBES,
        }
    }

    /// Sets the shares of the patches from `first` on. Returns the number of rays that it took.
    pub(crate) fn shares(&self, work: &mut Work, first: PatchId, shares: &mut [f32]) -> u64 {
        // Where no side is black, nothing is covered.
        if !self.is_needed {
            shares.fill(1.0);
            return 0;
        }
        let patches = || (first.0..).take(shares.len()).map(PatchId);
        work.rays.clear();
        for patch in patches().filter(|patch| !self.mesh.is_cluster(*patch)) {
            let side = self.mesh.side(patch);
            let [p0, p1, p2] = self.mesh.triangle(patch).p;
            let points = regular_triangle(self.fineness(patch));
            let origins =
                points.iter().map(|[l0, l1, l2]| side.lifted(p0 * *l0 + p1 * *l1 + p2 * *l2));
            work.rays.extend(origins.map(|origin| Ray::new(origin, side.normal)));
        }
        self.caster.nearest_batch(&work.rays, &mut work.hits);
        let mut traced = work.rays.len() as u64;
        let mut next = 0;
        for (patch, share) in patches().collect::<Vec<_>>().into_iter().zip(shares) {
            if self.mesh.is_cluster(patch) {
                continue;
            }
            let count = self.fineness(patch).pow(2) as usize;
            let open = (next..next + count).filter(|&k| {
                let ray = &work.rays[k];
                self.shows(ray, work.hits[k]) || self.is_open(ray, &mut traced)
            });
            *share = open.count() as f32 / count as f32;
            next += count;
        }
        traced
    }

    fn fineness(&self, patch: PatchId) -> u32 {
        if self.mesh.area(patch) < self.small { 1 } else { self.finest }
    }

    /// Whether any but the first of the directions shows something.
    fn is_open(&self, along_normal: &Ray, traced: &mut u64) -> bool {
        probes(along_normal.direction).into_iter().any(|direction| {
            *traced += 1;
            let ray = Ray::new(along_normal.origin, direction);
            self.shows(&ray, self.caster.nearest(&ray))
        })
    }

    /// A miss is open sky, and a lit side is something to see.
    fn shows(&self, ray: &Ray, hit: Option<Hit>) -> bool {
        hit.is_none_or(|hit| self.mesh.side_hit(ray, &hit).is_some())
    }
}

/// Rings of directions that come down to 2° above the surface. Most points need the normal alone; only
/// covered ones need all.
fn probes(normal: Vec3) -> Vec<Vec3> {
    const RING: u32 = 16;
    const ELEVATIONS: [f32; 4] = [30.0, 60.0, 10.0, 2.0];
    let (x, y) = orthonormal_basis(normal);
    let rings = ELEVATIONS.into_iter().flat_map(|elevation: f32| {
        let (sin, cos) = elevation.to_radians().sin_cos();
        (0..RING).map(move |k| {
            let (s, c) = (TAU * k as f32 / RING as f32).sin_cos();
            normal * sin + (x * c + y * s) * cos
        })
    });
    rings.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{BruteForce, MollerTrumbore, Triangle};
    use crate::patches::Subdivision;
    use crate::scene::{Material, MaterialId, Scene};

    /// A floor triangle with legs 4, and a tent without a bottom over its corner with legs 2.
    fn floor_with_tent() -> Scene {
        let (o, x, z) = (Vec3::ZERO, Vec3::X, Vec3::Z);
        let top = Vec3::new(0.5, 1.0, 0.5);
        let floor = Triangle::new(o, z * 4.0, x * 4.0);
        let tent = [
            Triangle::new(x * 2.0, z * 2.0, top),
            Triangle::new(z * 2.0, o, top),
            Triangle::new(o, x * 2.0, top),
        ];
        let mut triangles = vec![floor];
        for t in tent {
            // Wind each wall so that its front is outside.
            let outward = t.normal().dot(t.centroid() - Vec3::new(0.6, 0.2, 0.6)) > 0.0;
            triangles.push(if outward { t } else { Triangle::new(t.p[0], t.p[2], t.p[1]) });
        }
        Scene::new(triangles, vec![MaterialId(0); 4], vec![Material::fallback()])
    }

    #[test]
    fn the_floor_under_a_block_is_covered_and_the_rest_is_not() {
        let scene = floor_with_tent();
        let caster = BruteForce::<MollerTrumbore>::new(&scene.triangles);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(0)).unwrap();
        let (shares, rays) = uncovered(&caster, &mesh, &());
        // A quarter of the floor is under the tent: 4 of 16 points.
        assert_eq!(shares, [0.75, 1.0, 1.0, 1.0]);
        assert_eq!(rays, 60 + 4 * 65, "covered points ask all probes, the others one");
    }

    #[test]
    fn under_a_canopy_nothing_is_covered() {
        // A one-sided roof over the whole floor, as low as a tenth of its width.
        let floor = Triangle::new(Vec3::ZERO, Vec3::Z * 4.0, Vec3::X * 4.0);
        let roof = Triangle { p: floor.p.map(|p| p + Vec3::Y * 0.2) };
        let scene =
            Scene::new(vec![floor, roof], vec![MaterialId(0); 2], vec![Material::fallback()]);
        let caster = BruteForce::<MollerTrumbore>::new(&scene.triangles);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(3)).unwrap();
        assert!(uncovered(&caster, &mesh, &()).0.iter().all(|&share| share == 1.0));
    }
}
