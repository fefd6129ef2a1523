//! What textures and vertex colours make of patches and points: the material's value, times the texture, times
//! the interpolated vertex colour.
//!
//! The mean over a patch is taken as the product of the three means. A vertex colour is linear over a triangle,
//! so that its mean over a patch is the value at the centroid.

use super::{Cell, PatchId, PatchMesh, Side};
use crate::color::{Rgb, Rgb64};
use crate::geometry::{Hit, TriangleId};
use crate::sampling::regular_triangle;
use crate::scene::texture::{Map, Texture};
use crate::scene::{Material, Scene};
use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// The emitted radiance and the reflectance at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    pub radiance: Rgb,
    pub reflectance: Rgb,
}

/// The patches' means. Each list is empty where all patches have their material's own value.
#[derive(Debug, Default)]
pub(super) struct Looks {
    is_translucent: bool,
    reflectance: Vec<Rgb>,
    radiance: Vec<Rgb>,
    opacity: Vec<f32>,
}

impl Looks {
    pub(super) fn of(mesh: &PatchMesh) -> Looks {
        let scene = &mesh.scene;
        let reflects = scene.mesh.colors.is_some() || any(scene, |m| m.reflectance_map.is_some());
        let emits = any(scene, |m| m.radiance_map.is_some());
        let all = |wanted: bool, mean: fn(&Place) -> Rgb| -> Vec<Rgb> {
            let patches = if wanted { mesh.len() as u32 } else { 0 };
            let of_patch = |i| {
                mesh.mean_over_members(PatchId(i), |side| mean(&Place::of(mesh, PatchId(i), side)))
            };
            (0..patches).into_par_iter().map(of_patch).collect()
        };
        let see_through = if scene.hides_or_opens() { mesh.len() as u32 } else { 0 };
        let opacity = |i| {
            let of_member = |side: &Side| Rgb::splat(mesh.shown_opacity(PatchId(i), side));
            mesh.mean_over_members(PatchId(i), of_member).x
        };
        Looks {
            is_translucent: scene.is_translucent(),
            reflectance: all(reflects, |place| place.mean_reflectance()),
            radiance: all(emits, |place| place.mean_radiance()),
            opacity: (0..see_through).into_par_iter().map(opacity).collect(),
        }
    }

    pub(super) fn reflectance(&self, patch: PatchId) -> Option<Rgb> {
        self.reflectance.get(patch.index()).copied()
    }

    pub(super) fn opacity(&self, patch: PatchId) -> f32 {
        self.opacity.get(patch.index()).copied().unwrap_or(1.0)
    }

    pub(super) fn radiance(&self, patch: PatchId) -> Option<Rgb> {
        self.radiance.get(patch.index()).copied()
    }
}

fn any(scene: &Scene, has: impl Fn(&Material) -> bool) -> bool {
    scene.materials.iter().any(has)
}

impl PatchMesh {
    /// Whether anything varies over a triangle.
    pub(crate) fn varies(&self) -> bool {
        !(self.looks.reflectance.is_empty() && self.looks.radiance.is_empty())
    }

    /// Whether any surface lets a share of the light through, and not all or nothing at each point.
    pub(crate) fn is_translucent(&self) -> bool {
        self.looks.is_translucent
    }

    /// Whether the radiance varies over a side.
    pub(crate) fn is_patterned_light(&self, side: &Side) -> bool {
        let material = &self.scene.materials[side.material.0 as usize];
        material.radiance_map.is_some() || material.opacity_map.is_some() || {
            let shape = side.shape(&self.scene);
            let shown = self.scene.shown_share(side.triangle, side.is_back, &shape);
            0.0 < shown && shown < 1.0
        }
    }

    /// The mean by area over the sides of a patch.
    fn mean_over_members(&self, patch: PatchId, of_member: impl Fn(&Side) -> Rgb) -> Rgb {
        match self.members(patch) {
            [side] => of_member(side),
            sides => {
                let sum = |side: &Side| of_member(side).as_dvec3() * side.patch_area;
                (sides.iter().map(sum).sum::<Rgb64>() / self.area(patch)).as_vec3()
            }
        }
    }

    /// The mean opacity of what is seen of the patch: above zero, so that no patch loses its area.
    fn shown_opacity(&self, patch: PatchId, side: &Side) -> f32 {
        let opacity = Place::of(self, patch, side).mean_opacity();
        let part = match self.is_cluster(patch) {
            true => side.shape(&self.scene),
            false => self.triangle(patch),
        };
        let shown = self.scene.shown_share(side.triangle, side.is_back, &part);
        (opacity * shown as f32).max(1e-6)
    }

    /// The look of a side at a hit, through a footprint of this diameter in the scene's units.
    pub(crate) fn look(&self, side: &Side, hit: &Hit, footprint: f32) -> Look {
        let material = &self.scene.materials[side.material.0 as usize];
        let uv = uv_of(&self.scene, hit.triangle);
        let seen = |map: &Option<Map>| match map {
            Some(map) => self.texel(map, uv, hit, footprint),
            None => Rgb::ONE,
        };
        Look {
            radiance: material.radiance * seen(&material.radiance_map),
            reflectance: material.reflectance
                * seen(&material.reflectance_map)
                * self.scene.mesh.color_at(hit.triangle, hit.u, hit.v),
        }
    }

    fn texel(&self, map: &Map, uv: Option<[Vec2; 3]>, hit: &Hit, footprint: f32) -> Rgb {
        let texture = &self.scene.textures[map.texture.0 as usize];
        let Some(uv) = uv else { return whole_mean(texture) };
        let [a, b, c] = uv.map(|uv| map.at(uv));
        let size = Vec2::new(texture.width as f32, texture.height as f32);
        // The largest number of texels per unit of length along an edge.
        let p = self.scene.triangles[hit.triangle.index()].p;
        let per_length = [(a, b, p[0], p[1]), (b, c, p[1], p[2]), (c, a, p[2], p[0])]
            .map(|(from, to, p, q)| ((to - from) * size).length() / p.distance(q))
            .into_iter()
            .fold(0.0, f32::max);
        texture.color(a + (b - a) * hit.u + (c - a) * hit.v, footprint * per_length)
    }
}

/// The texture coordinates of a triangle's corners; `None` unless all have some.
fn uv_of(scene: &Scene, triangle: TriangleId) -> Option<[Vec2; 3]> {
    let texture = scene.mesh.texture.as_ref()?;
    let [a, b, c] = [0, 1, 2].map(|corner| texture.at(triangle, corner));
    Some([a?, b?, c?])
}

/// A triangle without texture coordinates shows no place of the picture more than another.
fn whole_mean(texture: &Texture) -> Rgb {
    texture.color(Vec2::ZERO, f32::INFINITY)
}

/// A patch within its triangle.
struct Place<'m> {
    scene: &'m Scene,
    triangle: TriangleId,
    is_back: bool,
    material: &'m Material,
    /// Barycentrics (u, v) of its corners.
    corners: [DVec2; 3],
}

impl<'m> Place<'m> {
    fn of(mesh: &'m PatchMesh, patch: PatchId, side: &Side) -> Self {
        let cell = Cell::from_number(side.level, patch.0 - side.first.0);
        let n = f64::from(1u32 << side.level);
        let corner = |(i, j): (u32, u32)| DVec2::new(f64::from(i), f64::from(j)) / n;
        Place {
            scene: &mesh.scene,
            triangle: side.triangle,
            is_back: side.is_back,
            material: &mesh.scene.materials[side.material.0 as usize],
            corners: cell.corners().map(corner),
        }
    }

    fn mean_reflectance(&self) -> Rgb {
        let center = (self.corners.iter().sum::<DVec2>() / 3.0).as_vec2();
        self.material.reflectance
            * self.mean(&self.material.reflectance_map)
            * self.scene.mesh.color_at(self.triangle, center.x, center.y)
    }

    /// The mean over 64 points.
    fn mean_opacity(&self) -> f32 {
        if !self.material.is_see_through() {
            return 1.0;
        }
        let [a, b, c] = self.corners;
        let points = regular_triangle(8);
        let opacity = |l: &[f32; 3]| {
            let p = a * l[0] as f64 + b * l[1] as f64 + c * l[2] as f64;
            self.scene.opacity_at(self.triangle, self.is_back, p.x as f32, p.y as f32)
        };
        points.iter().map(opacity).sum::<f32>() / points.len() as f32
    }

    fn mean_radiance(&self) -> Rgb {
        self.material.radiance * self.mean(&self.material.radiance_map)
    }

    /// 1 without a map.
    fn mean(&self, map: &Option<Map>) -> Rgb {
        let Some(map) = map else { return Rgb::ONE };
        let texture = &self.scene.textures[map.texture.0 as usize];
        let Some(uv) = uv_of(self.scene, self.triangle) else { return whole_mean(texture) };
        let [a, b, c] = uv.map(|uv| map.at(uv).as_dvec2());
        let corner = |p: DVec2| (a + (b - a) * p.x + (c - a) * p.y).as_vec2();
        texture.mean(self.corners.map(corner)).truncate().as_vec3()
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::geometry::Triangle;
    use crate::patches::Subdivision;
    use crate::scene::MaterialId;
    use crate::scene::mesh::{Mesh, Origin, Part, PerCorner};
    use crate::scene::texture::{TextureId, Wrap};
    use glam::{Affine2, Vec3};

    /// A unit square that shows a picture of 4 × 4 texels, the lower half black and the upper white, and glows
    /// with it. Its vertex colours run from red 0 at the left to 1 at the right.
    pub(crate) fn patterned() -> Scene {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let numbers = vec![[1, 2, 3], [1, 3, 4]];
        let triangles =
            numbers.iter().map(|n: &[u32; 3]| Triangle { p: n.map(|i| corners[i as usize - 1]) });
        let map = Some(Map { texture: TextureId(0), transform: Affine2::IDENTITY });
        let material = Material {
            reflectance: Rgb::splat(0.8),
            radiance: Rgb::splat(2.0),
            reflectance_map: map,
            radiance_map: map,
            ..Material::fallback()
        };
        let mut scene = Scene::new(triangles.collect(), vec![MaterialId(0); 2], vec![material]);
        let uv = corners.map(|c| c.truncate()).to_vec();
        let red = corners.map(|c| Rgb::new(c.x, 1.0, 1.0)).to_vec();
        scene.mesh = Mesh {
            origins: vec![Origin { face: 1, part: 0 }; 2],
            parts: vec![Part::default()],
            texture: PerCorner::new(uv, numbers.clone()),
            colors: PerCorner::new(red, numbers),
            ..Mesh::default()
        }
        .into();
        let pixel = |i: usize| if i < 8 { [255; 4] } else { [0, 0, 0, 255] };
        let pixels: Vec<[u8; 4]> = (0..16).map(pixel).collect();
        scene.textures =
            [Texture::new("halves".into(), [4, 4], pixels.into(), [Wrap::Clamp; 2])].into();
        scene
    }

    #[test]
    fn the_means_of_the_patches_are_those_of_the_picture_and_the_colours() {
        for level in [0, 1, 2, 4] {
            let mesh = PatchMesh::subdivide(&patterned(), Subdivision::Levels(level)).unwrap();
            let patches = || (0..mesh.len() as u32).map(PatchId);
            let green: f64 = patches().map(|p| mesh.reflectance(p).y as f64 * mesh.area(p)).sum();
            assert!((green - 0.8 * 0.5).abs() < 1e-6, "level {level}: {green}");
            let power: f64 = patches().map(|p| mesh.exitance(p).x as f64 * mesh.area(p)).sum();
            assert!((power - std::f64::consts::PI).abs() < 1e-5, "level {level}: {power}");
        }
        let mesh = PatchMesh::subdivide(&patterned(), Subdivision::Levels(4)).unwrap();
        for patch in (0..mesh.len() as u32).map(PatchId) {
            let center = mesh.triangle(patch).centroid();
            let white = if center.y > 0.5 { 0.8 } else { 0.0 };
            let expected = Rgb::new(white * center.x, white, white);
            assert!((mesh.reflectance(patch) - expected).abs().max_element() < 1e-6);
        }
    }

    #[test]
    fn a_point_has_its_texel_and_its_colour() {
        let mesh = PatchMesh::subdivide(&patterned(), Subdivision::Levels(1)).unwrap();
        // (0.75, 0.875) in the upper left half: p = u · (1, 1) + v · (0, 1).
        let hit = Hit { triangle: TriangleId(1), t: 1.0, u: 0.75, v: 0.125 };
        let side = mesh.sides().iter().find(|s| s.triangle == hit.triangle).unwrap();
        let look = mesh.look(side, &hit, 0.0);
        assert_eq!((look.radiance, look.reflectance), (Rgb::splat(2.0), Rgb::new(0.6, 0.8, 0.8)));
        // From very far the whole picture, which is half white.
        assert!((mesh.look(side, &hit, 1e6).radiance - 1.0).abs().max_element() < 1e-6);
    }

    #[test]
    fn without_coordinates_a_texture_shows_its_mean_and_without_textures_nothing_is_stored() {
        let mut scene = patterned();
        scene.mesh = Mesh::default().into();
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).unwrap();
        assert!((mesh.reflectance(PatchId(3)) - 0.4).abs().max_element() < 1e-6);
        scene.materials = [Material::fallback()].into();
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(1)).unwrap();
        assert!(!mesh.varies() && mesh.looks.reflectance.capacity() == 0);
        assert_eq!(mesh.reflectance(PatchId(3)), Rgb::splat(0.5));
    }
}
