//! The stress mesh, made of what breaks ray tracers: slivers, needles, the tiny beside the huge, duplicates, coplanar
//! overlaps, intersections, triangles without area.

use crate::framing::fitted;
use crate::geometry::{BruteForce, MollerTrumbore, Triangle};
use crate::patches::Sides;
use crate::sampling::{PointSet, Purpose, Stream};
use crate::scene::{Camera, Material, MaterialId, Scene};
use glam::Vec3;

/// Number of triangles: few enough for brute force, enough for a hierarchy of three levels.
const TRIANGLES: u32 = 320;

/// The mesh of a seed, with a camera that looks at it.
pub(crate) fn stress_scene(seed: u64) -> (Scene, Camera) {
    let mut triangles: Vec<Triangle> = Vec::new();
    for index in 0..TRIANGLES {
        triangles.push(stress_triangle(seed, index, &triangles));
    }
    let material_of = vec![MaterialId(0); triangles.len()];
    // A scene that is made in the usual way leaves out what has no area.
    let empty = Scene::new(Vec::new(), Vec::new(), vec![Material::fallback()]);
    let scene = Scene { triangles: triangles.into(), material_of: material_of.into(), ..empty };
    let caster = BruteForce::<MollerTrumbore>::new(&scene.triangles);
    let camera = fitted(&scene, &Sides::of_all(&scene), &caster);
    (scene, camera)
}

/// Around the origin, within ±1 but for the huge ones.
fn stress_triangle(seed: u64, index: u32, before: &[Triangle]) -> Triangle {
    let number = 1 << 58 | index as u64;
    let stream = Stream::new(seed, Purpose::Verify, number, PointSet::Random);
    let vector = |i| Vec3::from_slice(&stream.point(i)[..3]) * 2.0 - 1.0;
    let [a, b, c] = [0, 1, 2].map(vector);
    let xi = stream.point(3);
    let earlier = |xi: f32| before.get((xi * before.len() as f32) as usize);
    let ordinary = Triangle::new(a, b, c);
    match index % 10 {
        // Ordinary ones intersect each other all over the cube.
        0 => ordinary,
        // From 1 to 10⁻⁶ as wide as long.
        1 => Triangle::new(a, b, a.lerp(b, xi[0]) + c * 10f32.powf(-6.0 * xi[1])),
        2 => Triangle { p: [b, c, Vec3::ZERO].map(|e| a + e * 1e-6) },
        3 => Triangle { p: [a, b, c].map(|p| p * 1e4) },
        4 => earlier(xi[0]).copied().unwrap_or(ordinary),
        5 => earlier(xi[0]).map_or(ordinary, |t| Triangle::new(t.p[2], t.p[1], t.p[0])),
        // Many in one plane, some of them in other planes that are parallel to an axis.
        6 => Triangle { p: [a, b, c].map(|p| p.with_y(0.25)) },
        // A point, a line with a doubled end, a line whose middle is rounded.
        7 => Triangle::new(a, b, [a, b, a.midpoint(b)][(xi[0] * 3.0) as usize % 3]),
        // A fan of needles around one vertex.
        8 => {
            let hub = Vec3::splat(0.5);
            let rim =
                |k: u32| hub + Vec3::new((k as f32 * 1e-3).cos(), (k as f32 * 1e-3).sin(), 0.1);
            Triangle::new(hub, rim(index / 10), rim(index / 10 + 1))
        }
        // Over an edge of an earlier one, and so a neighbour of it.
        _ => earlier(xi[0]).map_or(ordinary, |t| Triangle::new(t.p[1], t.p[0], c)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::topology::Topology;

    #[test]
    fn the_mesh_has_everything_that_it_is_for() {
        let (scene, _) = stress_scene(1);
        let (triangles, topology) = (&scene.triangles, Topology::new(&scene.triangles));
        let count =
            |is_so: &dyn Fn(&Triangle) -> bool| triangles.iter().filter(|t| is_so(t)).count();
        let width = |t: &Triangle| 2.0 * t.area() / t.longest_edge().powi(2);
        // One in ten triangles is of each sort, and some are copied.
        let voids = count(&|t| t.area() == 0.0);
        let slivers = count(&|t| width(t) < 2e-3 && t.area() > 0.0);
        let huge = count(&|t| t.longest_edge() > 1e3);
        let tiny = count(&|t| t.longest_edge() < 1e-5);
        let coplanar = count(&|t| t.p.iter().all(|p| p.y == 0.25));
        for (sort, count) in [
            ("void", voids),
            ("sliver", slivers),
            ("huge", huge),
            ("tiny", tiny),
            ("flat", coplanar),
        ] {
            assert!(count >= 16, "{count} of sort {sort}");
        }
        let copies = topology.duplicates();
        assert!(copies >= 32, "{copies} copies");
    }

    #[test]
    fn a_seed_gives_one_mesh() {
        let bits = |seed| format!("{:?}", stress_scene(seed).0.triangles);
        assert_eq!(bits(1), bits(1));
        assert_ne!(bits(1), bits(2));
    }
}
