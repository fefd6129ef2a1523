//! Clusters: small triangles that lie near each other and face alike, as one patch.
//!
//! Light that is exchanged does not see the triangles of a scan one by one. Where they are smaller than the patches
//! of the walls around, those in one small cube that have one material and face into one of 24 directions
//! are one patch (after Rossignac & Borrel's vertex clustering, *Multi-resolution 3D Approximations for Rendering
//! Complex Scenes*, 1993). So the number of patches follows the area of the scene and not its triangles.

use super::{Side, Sides};
use crate::geometry::TriangleId;
use crate::scene::Scene;
use foldhash::fast::RandomState;
use glam::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;

/// What the sides of a cluster have in common: material and light, direction, cube.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
struct Key {
    material: u32,
    direction: u8,
    cube: u64,
}

/// The sides of the clusters, those of a cluster one after the other.
#[derive(Default)]
pub(super) struct Clusters {
    sides: Vec<(TriangleId, bool)>,
    /// Where the sides of each cluster end.
    ends: Vec<usize>,
}

impl Clusters {
    /// The triangle of each side, and whether it is the back.
    pub(super) fn sides(&self) -> &[(TriangleId, bool)] {
        &self.sides
    }

    /// The sides of each cluster.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[(TriangleId, bool)]> {
        let starts = [0].into_iter().chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.sides[start..end])
    }

    /// Puts sides with one key together, in the order of the keys. These are few, so that counting is quicker than
    /// sorting.
    fn of(found: Vec<(Key, TriangleId, bool)>) -> Clusters {
        let mut places: HashMap<Key, usize, RandomState> = HashMap::default();
        found.iter().for_each(|(key, ..)| *places.entry(*key).or_default() += 1);
        let mut keys: Vec<Key> = places.keys().copied().collect();
        keys.sort_unstable();
        let (mut start, mut ends) = (0, Vec::with_capacity(keys.len()));
        for key in keys {
            let place = places.get_mut(&key).expect("it was counted");
            start += std::mem::replace(place, start);
            ends.push(start);
        }
        let mut sides = vec![(TriangleId(0), false); found.len()];
        for (key, triangle, is_back) in found {
            let place = places.get_mut(&key).expect("it was counted");
            sides[*place] = (triangle, is_back);
            *place += 1;
        }
        Clusters { sides, ends }
    }
}

/// The clusters with cubes of this edge. The other sides have patches of their own.
pub(super) fn clustered(scene: &Scene, levels: &[u32], sides: &[Sides], edge: f32) -> Clusters {
    let low = scene.triangles.iter().flat_map(|t| t.p).fold(Vec3::INFINITY, Vec3::min);
    let of_triangle = |t: usize| {
        let (id, shape) = (TriangleId(t as u32), &scene.triangles[t]);
        let is_small = levels[t] == 0 && shape.longest_edge() <= edge as f64;
        let is_plain = scene.overlaps().with(id).is_empty();
        let present = [(sides[t].front, false), (sides[t].back, true)];
        let cube = cube_of((shape.centroid() - low) / edge);
        present.into_iter().filter_map(move |(is_there, is_back)| {
            let side = (is_there && is_small && is_plain).then(|| Side::new(scene, id, is_back))?;
            let material = &scene.materials[side.material.0 as usize];
            let is_pattern = side.radiates
                && (material.radiance_map.is_some() || material.opacity_map.is_some());
            let key = Key {
                material: side.material.0 << 1 | side.radiates as u32,
                direction: direction_of(side.normal),
                cube,
            };
            (!is_pattern).then_some((key, id, is_back))
        })
    };
    Clusters::of((0..levels.len()).into_par_iter().flat_map_iter(of_triangle).collect())
}

/// The number of a cube, from a place in edges of a cube.
fn cube_of(place: Vec3) -> u64 {
    const MOST: u64 = (1 << 21) - 1;
    place.to_array().iter().fold(0, |number, x| number << 21 | (*x as u64).min(MOST))
}

/// Coordinates of normals nearer to zero have no sign, so that rounding does not take a flat wall apart.
const LEVEL: f32 = 1e-4;

/// One of 24 directions: the axis that is nearest, and the signs of the other two coordinates.
fn direction_of(normal: Vec3) -> u8 {
    let size = normal.abs();
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).expect("three") as u8;
    axis << 3 | normal.cmplt(Vec3::splat(-LEVEL)).bitmask() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;
    use crate::geometry::shapes;
    use crate::geometry::{BruteForce, MollerTrumbore, Ray, RayCaster};
    use crate::patches::{Members, PatchId, PatchMesh, Split};
    use crate::scene::{Material, MaterialId};

    fn ball() -> Scene {
        let triangles = shapes::icosphere(4);
        let materials =
            [0.2, 0.7].map(|r| Material { reflectance: Rgb::splat(r), ..Material::fallback() });
        let halves = triangles.iter().map(|t| MaterialId((t.centroid().x > 0.0) as u32)).collect();
        Scene::new(triangles, halves, materials.to_vec())
    }

    fn mesh(scene: &Scene, cube: Option<f32>) -> PatchMesh {
        let split = Split { levels: vec![0; scene.triangles.len()], cube };
        let sides = vec![Sides { front: true, back: true }; scene.triangles.len()];
        PatchMesh::new(scene, &split, &sides).expect("patches")
    }

    #[test]
    fn clusters_share_out_all_sides_and_hold_what_is_alike() {
        let scene = ball();
        let (mesh, alone) = (mesh(&scene, Some(0.25)), mesh(&scene, None));
        let patches = || (0..mesh.len() as u32).map(PatchId);
        assert!(mesh.len() * 4 < alone.len(), "{} of {}", mesh.len(), alone.len());
        assert_eq!(mesh.sides().len(), alone.sides().len());
        let area: f64 = patches().map(|p| mesh.area(p)).sum();
        let area_alone: f64 = (0..alone.len() as u32).map(|p| alone.area(PatchId(p))).sum();
        assert!((area / area_alone - 1.0).abs() < 1e-12);
        let members: usize = patches().map(|p| mesh.members(p).len()).sum();
        assert_eq!(members, alone.sides().len());
        for patch in patches().filter(|p| mesh.is_cluster(*p)) {
            let sides = mesh.members(patch);
            let centre = |side: &Side| scene.triangles[side.triangle.index()].centroid();
            for side in sides {
                assert_eq!(side.first, patch);
                assert_eq!(side.material, sides[0].material);
                assert!(side.normal.dot(sides[0].normal) > 0.0);
                assert!((centre(side) - centre(&sides[0])).abs().max_element() <= 0.25);
            }
        }
    }

    #[test]
    fn a_ray_meets_the_cluster_of_the_side_that_it_meets() {
        let scene = ball();
        let mesh = mesh(&scene, Some(0.25));
        let caster = BruteForce::<MollerTrumbore>::new(&scene.triangles);
        for direction in [Vec3::X, Vec3::new(1.0, 2.0, 3.0), Vec3::new(-3.0, 0.5, 1.0)] {
            for (origin, is_back) in [(Vec3::ZERO, true), (-3.0 * direction, false)] {
                let ray = Ray::new(origin, direction);
                let hit = caster.nearest(&ray).expect("a hit");
                let patch = mesh.patch_hit(&ray, &hit).expect("a patch");
                let is_it = |s: &Side| s.triangle == hit.triangle && s.is_back == is_back;
                assert!(mesh.members(patch).iter().any(is_it));
            }
        }
    }

    #[test]
    fn members_are_chosen_in_proportion_to_their_area() {
        let scene = ball();
        let mesh = mesh(&scene, Some(0.25));
        let largest = (0..mesh.len() as u32).map(PatchId).max_by_key(|p| mesh.members(*p).len());
        let patch = largest.expect("there are patches");
        let members = Members::of(&mesh, patch);
        let mut found: HashMap<u32, (u32, f32)> = HashMap::new();
        const COUNT: u32 = 1 << 16;
        for k in 0..COUNT {
            let (side, rest) = members.choose((k as f32 + 0.5) / COUNT as f32);
            let entry = found.entry(side.triangle.0).or_default();
            entry.0 += 1;
            entry.1 += rest;
        }
        assert!(mesh.members(patch).len() > 3);
        for side in mesh.members(patch) {
            let (count, sum) = found[&side.triangle.0];
            let share = side.patch_area / mesh.area(patch);
            // Evenly spaced numbers miss a share by at most one at either end.
            assert!((count as f64 - share * COUNT as f64).abs() <= 2.0);
            assert!((sum / count as f32 - 0.5).abs() < 1e-2, "what is left is uniform again");
        }
    }
}
