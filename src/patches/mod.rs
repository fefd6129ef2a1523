//! Patches: the pieces of the triangles on which radiosity is constant.
//!
//! Joining the midpoints of a triangle's edges makes 4 triangles of it; doing so `level` times gives
//! a lattice of n² equal patches with n = 2^level cells along each edge. So no patch is stored: its
//! corners follow from its number, and the patch under a hit follows from the hit's (u, v): see
//! [`Cell`]. Triangles that are small beside the patches of the others may be put together to one patch, a
//! cluster.

mod cell;
mod cluster;
mod looks;
mod members;
mod random_points;
mod subdivision;
mod surface_point;

use crate::color::Rgb;
use crate::error::{Error, Result};
pub use crate::geometry::triangle::MAX_LEVEL;
use crate::geometry::{Hit, Ray, Triangle, TriangleId};
use crate::scene::{Material, MaterialId, Scene};
use crate::settings::PATCHES;
pub use cell::Cell;
use cluster::Clusters;
use glam::Vec3;
pub(crate) use looks::Look;
use looks::Looks;
pub(crate) use members::Members;
pub(crate) use random_points::RandomPoints;
use serde::{Deserialize, Serialize};
use std::f32::consts::PI;
pub use subdivision::Subdivision;
use subdivision::check_count;
pub use surface_point::{SampleId, SurfacePoint};

/// Number of a patch, counted over the whole scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PatchId(pub u32);

impl PatchId {
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// One side of a triangle that reflects or emits.
#[derive(Debug, Clone, Copy)]
pub struct Side {
    pub triangle: TriangleId,
    pub is_back: bool,
    pub material: MaterialId,
    /// Whether it emits light.
    pub radiates: bool,
    /// Points to where the side radiates.
    pub normal: Vec3,
    pub level: u32,
    /// Its 4^level patches are numbered from here.
    pub first: PatchId,
    /// Area of each patch, in square units; on a side that is part of a cluster, the side's own.
    pub patch_area: f64,
    /// See [`Triangle::ray_offset`].
    ray_offset: f32,
}

impl Side {
    /// A whole side of a triangle, as one patch with the number 0.
    pub fn new(scene: &Scene, triangle: TriangleId, is_back: bool) -> Side {
        let shape = &scene.triangles[triangle.index()];
        let normal = shape.normal();
        Side {
            triangle,
            is_back,
            material: scene.material_on(triangle, is_back),
            radiates: scene.radiance_on(triangle, is_back) != Rgb::ZERO,
            normal: if is_back { -normal } else { normal },
            level: 0,
            first: PatchId(0),
            patch_area: shape.area(),
            ray_offset: shape.ray_offset(),
        }
    }

    /// The triangle, wound so that its normal is the side's.
    pub fn shape(&self, scene: &Scene) -> Triangle {
        let mut shape = scene.triangles[self.triangle.index()];
        if self.is_back {
            shape.p.swap(1, 2);
        }
        shape
    }

    pub fn patch_count(&self) -> usize {
        1 << (2 * self.level)
    }

    pub fn patches(&self) -> impl Iterator<Item = PatchId> + use<> {
        (self.first.0..self.first.0 + self.patch_count() as u32).map(PatchId)
    }

    /// Where points of one of the side's patches are sampled: all of it but a rim as thin as the
    /// lift of a ray's origin. A point on the very edge may be rounded onto the plane of the next
    /// wall or behind it, and its rays would leave through the corner of a closed room.
    pub fn sampling_area(&self, patch: &Triangle) -> Triangle {
        patch.inset(self.ray_offset as f64)
    }

    /// A point of the surface, lifted off it so that rays from it do not meet it again.
    #[inline]
    pub fn lifted(&self, point: Vec3) -> Vec3 {
        point + self.normal * self.ray_offset
    }
}

/// The sides of a triangle that have patches. The others are black.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sides {
    pub front: bool,
    pub back: bool,
}

impl Sides {
    /// The sides that a triangle's material gives it.
    pub fn of(scene: &Scene, triangle: TriangleId) -> Sides {
        let material = scene.material(triangle);
        let back = material.two_sided || material.shines_on_back();
        Sides { front: true, back: back || scene.own_back(triangle).is_some() }
    }

    /// Those of every triangle.
    pub fn of_all(scene: &Scene) -> Vec<Sides> {
        (0..scene.triangles.len() as u32).map(|t| Sides::of(scene, TriangleId(t))).collect()
    }

    pub(crate) fn has(self, is_back: bool) -> bool {
        if is_back { self.back } else { self.front }
    }

    fn count(self) -> u64 {
        self.front as u64 + self.back as u64
    }
}

/// All patches of a scene.
#[derive(Debug)]
pub struct PatchMesh {
    pub scene: Scene,
    sides: Vec<Side>,
    /// Per triangle: the sides of its front and its back, where they have patches.
    side_of_front: Vec<Option<u32>>,
    side_of_back: Vec<Option<u32>>,
    /// Per patch: its side, of a cluster the first.
    side_of_patch: Vec<u32>,
    /// The edge of the cubes in which clusters lie, if there are some.
    cube: Option<f32>,
    /// The areas of the clusters, which have the highest numbers.
    cluster_areas: Vec<f64>,
    /// What textures and vertex colours make of the patches.
    looks: Looks,
}

/// How finely a scene is split.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Split {
    /// Per triangle: how often it is split.
    pub levels: Vec<u32>,
    /// The edge of the cubes in which triangles with shorter edges make one patch if they face alike. `None`: each
    /// triangle has patches of its own.
    pub cube: Option<f32>,
}

impl Split {
    /// The number of patches, about, if every triangle has one side.
    pub fn patches(&self) -> u64 {
        let split: u64 = self.levels.iter().map(|&level| 1u64 << (2 * level)).sum();
        // Where triangles are put together, that is what was aimed at.
        if self.cube.is_some() { split.min(PATCHES as u64) } else { split }
    }
}

impl PatchMesh {
    /// Splits every side that the materials give the triangles.
    ///
    /// # Errors
    /// See [`Subdivision::split`].
    pub fn subdivide(scene: &Scene, subdivision: Subdivision) -> Result<PatchMesh> {
        PatchMesh::new(scene, &subdivision.split(scene)?, &Sides::of_all(scene))
    }

    /// Makes the patches of the given sides.
    ///
    /// # Errors
    /// See [`PatchMesh::most`].
    pub fn new(scene: &Scene, split: &Split, sides: &[Sides]) -> Result<PatchMesh> {
        PatchMesh::most(scene, split, sides)?;
        let triangles = scene.triangles.len();
        let mut mesh = PatchMesh {
            scene: scene.clone(),
            sides: Vec::with_capacity(triangles),
            side_of_front: vec![None; triangles],
            side_of_back: vec![None; triangles],
            side_of_patch: Vec::new(),
            cube: split.cube,
            cluster_areas: Vec::new(),
            looks: Looks::default(),
        };
        let clusters = match split.cube {
            Some(edge) => cluster::clustered(scene, &split.levels, sides, edge),
            None => Clusters::default(),
        };
        let mut left = sides.to_vec();
        for &(triangle, is_back) in clusters.sides() {
            let left = &mut left[triangle.index()];
            *if is_back { &mut left.back } else { &mut left.front } = false;
        }
        for (index, (&level, sides)) in split.levels.iter().zip(&left).enumerate() {
            for (is_there, is_back) in [(sides.front, false), (sides.back, true)] {
                if is_there {
                    mesh.add_side(TriangleId(index as u32), level, is_back);
                }
            }
        }
        for cluster in clusters.iter() {
            mesh.add_cluster(cluster);
        }
        mesh.looks = Looks::of(&mesh);
        Ok(mesh)
    }

    /// The number of patches that [`PatchMesh::new`] would make at most: without clusters.
    ///
    /// # Errors
    /// Lists of another length than that of the triangles, a level above [`MAX_LEVEL`], or more patches
    /// than can be numbered.
    pub fn most(scene: &Scene, split: &Split, sides: &[Sides]) -> Result<usize> {
        let levels = &split.levels;
        for (count, what) in [(levels.len(), "levels of subdivision"), (sides.len(), "sides")] {
            if count != scene.triangles.len() {
                return Err(Error::new(format!(
                    "{count} {what} for {} triangles",
                    scene.triangles.len()
                )));
            }
        }
        let patches = levels
            .iter()
            .zip(sides)
            .map(|(&level, sides)| sides.count().saturating_mul(4u64.saturating_pow(level)));
        check_count(levels, patches.fold(0, u64::saturating_add))
    }

    /// How finely the scene is split; a level is 0 where a triangle has no patches.
    pub fn split(&self) -> Split {
        let any = self.side_of_front.iter().zip(&self.side_of_back).map(|(f, b)| f.or(*b));
        let level = |side: Option<u32>| side.map_or(0, |side| self.sides[side as usize].level);
        Split { levels: any.map(level).collect(), cube: self.cube }
    }

    /// The sides of each triangle that have patches.
    pub fn sides_of_triangles(&self) -> Vec<Sides> {
        let both = self.side_of_front.iter().zip(&self.side_of_back);
        both.map(|(f, b)| Sides { front: f.is_some(), back: b.is_some() }).collect()
    }

    /// How many triangles light reaches on neither side.
    pub(crate) fn in_the_dark(&self) -> usize {
        let both = self.side_of_front.iter().zip(&self.side_of_back);
        both.filter(|sides| matches!(sides, (None, None))).count()
    }

    fn add_side(&mut self, triangle: TriangleId, level: u32, is_back: bool) {
        let whole = Side::new(&self.scene, triangle, is_back);
        let number = self.keep(Side {
            level,
            first: PatchId(self.side_of_patch.len() as u32),
            patch_area: whole.patch_area / (1u64 << (2 * level)) as f64,
            ..whole
        });
        let patches = self.side_of_patch.len() + (1 << (2 * level));
        self.side_of_patch.resize(patches, number);
    }

    fn add_cluster(&mut self, members: &[(TriangleId, bool)]) {
        let (first, side) = (PatchId(self.side_of_patch.len() as u32), self.sides.len() as u32);
        let mut area = 0.0;
        for &(triangle, is_back) in members {
            let whole = Side::new(&self.scene, triangle, is_back);
            area += whole.patch_area;
            self.keep(Side { first, ..whole });
        }
        self.side_of_patch.push(side);
        self.cluster_areas.push(area);
    }

    fn keep(&mut self, side: Side) -> u32 {
        let number = self.sides.len() as u32;
        let of_triangle =
            if side.is_back { &mut self.side_of_back } else { &mut self.side_of_front };
        of_triangle[side.triangle.index()] = Some(number);
        self.sides.push(side);
        number
    }

    /// The patches from this one on are clusters.
    fn first_cluster(&self) -> usize {
        self.side_of_patch.len() - self.cluster_areas.len()
    }

    /// Whether the patch may consist of several sides.
    pub fn is_cluster(&self, patch: PatchId) -> bool {
        patch.index() >= self.first_cluster()
    }

    /// The sides that the patch is part of, or of which it consists.
    pub fn members(&self, patch: PatchId) -> &[Side] {
        let first = self.side_of_patch[patch.index()] as usize;
        if !self.is_cluster(patch) {
            return std::slice::from_ref(&self.sides[first]);
        }
        let end =
            self.side_of_patch.get(patch.index() + 1).map_or(self.sides.len(), |s| *s as usize);
        &self.sides[first..end]
    }

    /// The square of a patch's extent: its area, unless it is long and narrow, or scattered.
    pub(crate) fn extent_squared(&self, patch: PatchId) -> f32 {
        let members = Members::of(self, patch);
        let corners = self.members(patch).iter().flat_map(|side| members.part(side).p);
        let box_of = |(least, most): (Vec3, Vec3), p: Vec3| (least.min(p), most.max(p));
        let (least, most) = corners.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), box_of);
        // Half of half a square is a quarter of its diagonal's square.
        (least.distance_squared(most) / 4.0).max(self.area(patch) as f32)
    }

    /// Number of patches.
    pub fn len(&self) -> usize {
        self.side_of_patch.len()
    }

    pub fn is_empty(&self) -> bool {
        self.side_of_patch.is_empty()
    }

    pub fn sides(&self) -> &[Side] {
        &self.sides
    }

    /// The side of a patch; of a cluster the first.
    #[inline]
    pub fn side(&self, patch: PatchId) -> &Side {
        &self.sides[self.side_of_patch[patch.index()] as usize]
    }

    pub fn side_number(&self, patch: PatchId) -> usize {
        self.side_of_patch[patch.index()] as usize
    }

    /// Area of the patch, in square units.
    #[inline]
    pub fn area(&self, patch: PatchId) -> f64 {
        match patch.index().checked_sub(self.first_cluster()) {
            Some(cluster) => self.cluster_areas[cluster],
            None => self.side(patch).patch_area,
        }
    }

    /// The part of the patch's area that stops light, in square units: where it is not opaque, light goes
    /// straight on as if there were nothing.
    #[inline]
    pub fn opaque_area(&self, patch: PatchId) -> f64 {
        self.area(patch) * self.opacity(patch)
    }

    /// The share of light that the patch stops, in [0, 1].
    pub fn opacity(&self, patch: PatchId) -> f64 {
        self.looks.opacity(patch) as f64
    }

    /// Mean diffuse reflectance ρ of the patch.
    pub fn reflectance(&self, patch: PatchId) -> Rgb {
        let mean = self.looks.reflectance(patch);
        mean.unwrap_or_else(|| self.material_of(patch).reflectance)
    }

    /// Mean exitance E = πL of the patch, in W·m⁻².
    pub fn exitance(&self, patch: PatchId) -> Rgb {
        let (side, material) = (self.side(patch), self.material_of(patch));
        if !side.radiates {
            return Rgb::ZERO;
        }
        self.looks.radiance(patch).unwrap_or(material.radiance) * PI
    }

    fn material_of(&self, patch: PatchId) -> &Material {
        &self.scene.materials[self.side(patch).material.0 as usize]
    }

    /// The side that a ray meets at a hit, or `None` for a black side.
    #[inline]
    pub fn side_hit(&self, ray: &Ray, hit: &Hit) -> Option<&Side> {
        self.side_number_hit(ray, hit).map(|number| &self.sides[number])
    }

    /// The number of the side that a ray meets at a hit.
    #[inline]
    pub(crate) fn side_number_hit(&self, ray: &Ray, hit: &Hit) -> Option<usize> {
        let triangle = hit.triangle.index();
        let (front, back) = (self.side_of_front[triangle], self.side_of_back[triangle]);
        // A ray along the surface is taken to meet the back.
        let meets_front = match (front, back) {
            (Some(front), _) => self.sides[front as usize].normal.dot(ray.direction) < 0.0,
            (None, Some(back)) => -self.sides[back as usize].normal.dot(ray.direction) < 0.0,
            (None, None) => return None,
        };
        if meets_front { front } else { back }.map(|side| side as usize)
    }

    /// The patch that a ray meets at a hit, or `None` for a black side.
    #[inline]
    pub fn patch_hit(&self, ray: &Ray, hit: &Hit) -> Option<PatchId> {
        self.side_hit(ray, hit).map(|side| self.patch_at(side, hit))
    }

    /// The patch of a side at a hit.
    #[inline]
    pub fn patch_at(&self, side: &Side, hit: &Hit) -> PatchId {
        let (cell, ..) = Cell::containing(side.level, hit.u, hit.v);
        PatchId(side.first.0 + cell.number(side.level))
    }

    /// The patch as a triangle, wound so that its normal is its side's. Not for clusters.
    pub fn triangle(&self, patch: PatchId) -> Triangle {
        debug_assert!(!self.is_cluster(patch), "a cluster is no triangle");
        let side = self.side(patch);
        let cell = Cell::from_number(side.level, patch.0 - side.first.0);
        let shape = &self.scene.triangles[side.triangle.index()];
        let n = (1u32 << side.level) as f32;
        let mut p = cell.corners().map(|(i, j)| shape.at(i as f32 / n, j as f32 / n));
        if side.is_back {
            p.swap(1, 2);
        }
        Triangle { p }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    pub(crate) use super::looks::tests::patterned;
    use super::*;

    pub(super) fn scene(triangles: Vec<Triangle>, two_sided: bool) -> Scene {
        let materials = vec![Material { two_sided, ..Material::fallback() }];
        let count = triangles.len();
        Scene::new(triangles, vec![MaterialId(0); count], materials)
    }

    pub(super) fn one_triangle() -> Vec<Triangle> {
        vec![Triangle::new(Vec3::ZERO, Vec3::X * 8.0, Vec3::Y * 4.0)]
    }

    /// The definition: join the edges' midpoints, recursively.
    fn by_midpoints(triangle: Triangle, levels: u32) -> Vec<Triangle> {
        if levels == 0 {
            return vec![triangle];
        }
        let [a, b, c] = triangle.p;
        let (ab, bc, ca) = ((a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0);
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
            .into_iter()
            .flat_map(|p| by_midpoints(Triangle { p }, levels - 1))
            .collect()
    }

    #[test]
    fn the_lattice_is_recursive_midpoint_subdivision() {
        let scene = scene(one_triangle(), false);
        for level in 0..=4 {
            let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(level)).unwrap();
            let key = |t: Triangle| {
                let mut p = t.p.map(|p| [p.x.to_bits(), p.y.to_bits(), p.z.to_bits()]);
                p.sort_unstable();
                p
            };
            let mut ours: Vec<_> =
                (0..mesh.len()).map(|i| key(mesh.triangle(PatchId(i as u32)))).collect();
            let mut theirs: Vec<_> =
                by_midpoints(scene.triangles[0], level).into_iter().map(key).collect();
            ours.sort_unstable();
            theirs.sort_unstable();
            assert_eq!(ours, theirs, "level {level}");
        }
    }

    #[test]
    fn patches_keep_winding_and_share_the_area() {
        for two_sided in [false, true] {
            let scene = scene(one_triangle(), two_sided);
            let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(3)).unwrap();
            assert_eq!(mesh.len(), if two_sided { 128 } else { 64 });
            for i in 0..mesh.len() as u32 {
                let patch = mesh.triangle(PatchId(i));
                assert_eq!(patch.normal(), mesh.side(PatchId(i)).normal);
                assert!((patch.area() - mesh.area(PatchId(i))).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_ray_meets_the_side_that_faces_it() {
        let ray = |z: f32| Ray::new(Vec3::new(1.0, 1.0, z), Vec3::new(0.0, 0.0, -z));
        let hit = Hit { triangle: TriangleId(0), t: 1.0, u: 0.125, v: 0.25 };
        let one = scene(one_triangle(), false);
        let mesh = PatchMesh::subdivide(&one, Subdivision::Levels(1)).unwrap();
        assert_eq!(mesh.patch_hit(&ray(1.0), &hit), Some(PatchId(0)));
        assert_eq!(mesh.patch_hit(&ray(-1.0), &hit), None);
        let two = scene(one_triangle(), true);
        let mesh = PatchMesh::subdivide(&two, Subdivision::Levels(1)).unwrap();
        assert_eq!(mesh.patch_hit(&ray(-1.0), &hit), Some(PatchId(4)));
    }
}
