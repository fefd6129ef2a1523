//! Where surfaces let light through.

use super::{Map, Material, Scene};
use crate::geometry::{Hit, Ray, TriangleId};
use glam::Vec2;

impl Material {
    /// Whether light may go straight through somewhere.
    pub(crate) fn is_see_through(&self) -> bool {
        self.opacity < 1.0 || self.opacity_map.is_some()
    }
}

impl Scene {
    /// Whether light may go straight through any triangle.
    pub(crate) fn is_see_through(&self) -> bool {
        self.used_materials().any(Material::is_see_through)
    }

    /// Whether a share of the light may go straight through any triangle, and not all or nothing at each point.
    pub(crate) fn is_translucent(&self) -> bool {
        self.used_materials().any(|m| m.is_see_through() && m.opacity_cutoff.is_none())
    }

    /// Whether something else than the first triangle that a ray meets may be seen.
    pub(crate) fn hides_or_opens(&self) -> bool {
        self.is_see_through() || !self.overlaps().is_empty()
    }

    /// Whether the opacity varies over a triangle's front or back.
    pub(crate) fn has_cut_outs(&self, triangle: TriangleId) -> bool {
        let has_map = |is_back| {
            let material = self.material_on(triangle, is_back);
            self.materials[material.0 as usize].opacity_map.is_some()
        };
        has_map(false) || has_map(true)
    }

    /// The share of light that does not go straight through a triangle's front or back at barycentrics (u, v),
    /// in [0, 1].
    pub fn opacity_at(&self, triangle: TriangleId, is_back: bool, u: f32, v: f32) -> f32 {
        let material = &self.materials[self.material_on(triangle, is_back).0 as usize];
        let opacity = match &material.opacity_map {
            Some(map) => material.opacity * self.texture_opacity(map, triangle, u, v),
            None => material.opacity,
        };
        match material.opacity_cutoff {
            Some(cutoff) => (opacity >= cutoff) as u32 as f32,
            None => opacity.clamp(0.0, 1.0),
        }
    }

    /// The opacity where a ray meets a triangle.
    pub(crate) fn opacity_towards(&self, ray: &Ray, hit: &Hit) -> f32 {
        let faces = || self.triangles[hit.triangle.index()].normal().dot(ray.direction) < 0.0;
        let is_back = self.own_back(hit.triangle).is_some() && !faces();
        self.opacity_at(hit.triangle, is_back, hit.u, hit.v)
    }

    fn texture_opacity(&self, map: &Map, triangle: TriangleId, u: f32, v: f32) -> f32 {
        let uv = |corner| self.mesh.texture.as_ref().and_then(|t| t.at(triangle, corner));
        let (Some(a), Some(b), Some(c)) = (uv(0), uv(1), uv(2)) else { return 1.0 };
        let at: Vec2 = a + (b - a) * u + (c - a) * v;
        self.textures[map.texture.0 as usize].opacity(map.at(at))
    }
}
