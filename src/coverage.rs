//! How much of a patch can be seen at all.
//!
//! Models put things on top of each other: a block without a bottom stands on a floor, and the floor
//! goes on under it. A patch across the block's foot is dark on one part of its area, and its mean
//! is a wrong radiance for the part that shows. A point is covered if whatever way a ray leaves it,
//! even almost along the surface, it meets a black back: the inside of the block, or the top of a
//! lamp that touches the ceiling. Under a canopy light comes in from the side, and nothing is covered.

use crate::geometry::{Ray, RayCaster};
use crate::patches::{PatchId, PatchMesh};
use crate::progress::{Progress, Stage};
use crate::sampling::{orthonormal_basis, regular_triangle};
use glam::Vec3;
use rayon::prelude::*;
use std::f32::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering};

/// Points tested on each patch: the centroids of a 4-fold subdivision.
const POINTS: u32 = 4;

/// The uncovered share of each patch's area, in [0, 1], and the number of rays that it took.
pub(crate) fn uncovered(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    progress: &dyn Progress,
) -> (Vec<f64>, u64) {
    progress.begin(Stage::Coverage, Some(mesh.len() as u64));
    let rays = AtomicU64::new(0);
    let shares = (0..mesh.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|i| {
            if i % 64 == 0 {
                progress.advance(64);
            }
            // The caller throws away what is left undone.
            if progress.is_stopped() {
                return 1.0;
            }
            let (share, traced) = uncovered_share(caster, mesh, PatchId(i as u32));
            rays.fetch_add(traced, Ordering::Relaxed);
            share
        })
        .collect();
    progress.end();
    (shares, rays.into_inner())
}

/// The uncovered share of one patch's area, in [0, 1], and the number of rays that it took.
pub(crate) fn uncovered_share(
    caster: &dyn RayCaster,
    mesh: &PatchMesh,
    patch: PatchId,
) -> (f64, u64) {
    let side = mesh.side(patch);
    let [p0, p1, p2] = mesh.triangle(patch).p;
    let directions = probes(side.normal);
    let points = regular_triangle(POINTS);
    let mut traced = 0;
    let open = points.iter().filter(|[l0, l1, l2]| {
        let origin = side.lifted(p0 * *l0 + p1 * *l1 + p2 * *l2);
        directions.iter().any(|&direction| {
            traced += 1;
            let ray = Ray::new(origin, direction);
            // A miss is open sky, and a lit side is something to see.
            caster.nearest(&ray).is_none_or(|hit| mesh.side_hit(&ray, &hit).is_some())
        })
    });
    (open.count() as f64 / points.len() as f64, traced)
}

/// The normal, then rings of directions that come down to 2° above the surface. Most points need
/// the first alone; only covered ones need all.
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
    std::iter::once(normal).chain(rings).collect()
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
