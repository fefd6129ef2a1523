//! How much of a patch can be seen at all.
//!
//! Models put things on top of each other: a block without a bottom stands on a floor, and the floor
//! goes on under it. A patch across the block's foot is dark on one part of its area, and its mean
//! is a wrong radiance for the part that shows. A point is covered if whatever way a ray leaves it,
//! it meets a black back: the inside of the block, or the top of a lamp that touches the ceiling.

use crate::geometry::{Ray, RayCaster};
use crate::patches::{PatchId, PatchMesh};
use crate::sampling::{orthonormal_basis, regular_triangle};
use glam::Vec3;
use rayon::prelude::*;

/// Points tested on each patch: the centroids of a 4-fold subdivision.
const POINTS: u32 = 4;

/// The uncovered share of each patch's area, in (0, 1]. A patch that is covered everywhere shows
/// nothing, so that its share does not matter and is 1.
pub fn uncovered(caster: &impl RayCaster, mesh: &PatchMesh) -> Vec<f64> {
    let points = regular_triangle(POINTS);
    (0..mesh.len())
        .into_par_iter()
        .with_min_len(64)
        .map(|i| {
            let patch = PatchId(i as u32);
            let side = mesh.side(patch);
            let [p0, p1, p2] = mesh.triangle(patch).p;
            let directions = probes(side.normal);
            let open = points.iter().filter(|[l0, l1, l2]| {
                let origin = side.lifted(p0 * *l0 + p1 * *l1 + p2 * *l2);
                directions.iter().any(|&direction| {
                    let ray = Ray::new(origin, direction);
                    // A miss is open sky, and a lit side is something to see.
                    caster.nearest(&ray).is_none_or(|hit| mesh.side_hit(&ray, &hit).is_some())
                })
            });
            match open.count() {
                0 => 1.0,
                open => open as f64 / points.len() as f64,
            }
        })
        .collect()
}

/// The normal, and three directions at 60° to it.
fn probes(normal: Vec3) -> [Vec3; 4] {
    let (x, y) = orthonormal_basis(normal);
    let (sin, cos) = (0.75f32.sqrt(), 0.5);
    let around = |angle: f32| normal * cos + (x * angle.cos() + y * angle.sin()) * sin;
    let third = std::f32::consts::TAU / 3.0;
    [normal, around(0.0), around(third), around(2.0 * third)]
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
        let shares = uncovered(&caster, &mesh);
        // A quarter of the floor is under the tent: 4 of 16 points.
        assert_eq!(shares, [0.75, 1.0, 1.0, 1.0]);
    }
}
