//! Diffuse materials.

use super::text::LARGEST;
use super::texture::Map;
use crate::color::Rgb;
use serde::{Deserialize, Serialize};

/// Whether a colour can be a radiance: more than 1e12 is none, as of `Ke`.
pub(crate) fn is_radiance(rgb: Rgb) -> bool {
    rgb.to_array().iter().all(|x| (0.0..=LARGEST).contains(x))
}

/// Index into [`Scene::materials`](super::Scene::materials).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct MaterialId(pub u32);

/// A Lambertian surface: it reflects and emits equally into every direction before it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Material {
    pub name: String,
    /// Diffuse reflectance ρ per channel, in [0, 1]. `Kd` in an MTL file.
    pub reflectance: Rgb,
    /// Emitted radiance in W·sr⁻¹·m⁻², not negative. `Ke` in an MTL file. Exitance is π times it.
    pub radiance: Rgb,
    /// Whether the back reflects as the front does. Else the back is black.
    pub two_sided: bool,
    /// Whether the back emits as the front does.
    pub emits_on_back: bool,
    /// Multiplies the reflectance.
    pub reflectance_map: Option<Map>,
    /// Multiplies the radiance.
    pub radiance_map: Option<Map>,
    /// The share of light that does not go straight through, in [0, 1].
    pub opacity: f32,
    /// Multiplies the opacity, by the opacity of the texture's pixels.
    pub opacity_map: Option<Map>,
    /// Opacities below this count as 0 and the others as 1; `None`: they are shares.
    pub opacity_cutoff: Option<f32>,
}

impl Material {
    /// The material of a face whose own is missing: mid grey, no light of its own.
    pub fn fallback() -> Self {
        Material {
            name: "default".into(),
            reflectance: Rgb::splat(0.5),
            radiance: Rgb::ZERO,
            two_sided: false,
            emits_on_back: false,
            reflectance_map: None,
            radiance_map: None,
            opacity: 1.0,
            opacity_map: None,
            opacity_cutoff: None,
        }
    }

    /// Whether reflectance and opacities lie in [0, 1], the radiance in [0, 1e12], and the maps name some of that
    /// many textures.
    pub(crate) fn is_possible(&self, textures: usize) -> bool {
        let is_share = |x: &f32| (0.0..=1.0).contains(x);
        let maps = [&self.reflectance_map, &self.radiance_map, &self.opacity_map];
        let fits = |map: &Map| (map.texture.0 as usize) < textures && map.transform.is_finite();
        self.reflectance.to_array().iter().all(is_share)
            && is_radiance(self.radiance)
            && is_share(&self.opacity)
            && self.opacity_cutoff.as_ref().is_none_or(is_share)
            && maps.into_iter().flatten().all(fits)
    }

    /// The uses of textures.
    pub(crate) fn maps_mut(&mut self) -> impl Iterator<Item = &mut Map> {
        let maps = [&mut self.reflectance_map, &mut self.radiance_map, &mut self.opacity_map];
        maps.into_iter().flatten()
    }

    /// Emitted radiance of the front or the back.
    pub fn radiance_of(&self, is_back: bool) -> Rgb {
        if self.radiates(is_back) { self.radiance } else { Rgb::ZERO }
    }

    /// Whether the front or the back may emit.
    pub(crate) fn radiates(&self, is_back: bool) -> bool {
        !is_back || self.emits_on_back
    }

    /// Whether the back emits light.
    pub fn shines_on_back(&self) -> bool {
        self.emits_on_back && self.emits()
    }

    pub fn emits(&self) -> bool {
        self.radiance != Rgb::ZERO
    }
}
