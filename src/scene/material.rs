//! Diffuse materials.

use crate::color::Rgb;
use serde::{Deserialize, Serialize};

/// Index into [`Scene::materials`](super::Scene::materials).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct MaterialId(pub u32);

/// A Lambertian surface: it reflects and emits equally into every direction of its front.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Material {
    pub name: String,
    /// Diffuse reflectance ρ per channel, in [0, 1). `Kd` in an MTL file.
    pub reflectance: Rgb,
    /// Emitted radiance in W·sr⁻¹·m⁻², not negative. `Ke` in an MTL file. Exitance is π times it.
    pub radiance: Rgb,
    /// Whether the back reflects and emits as the front does. Else the back is black.
    pub two_sided: bool,
}

impl Material {
    /// The material of a face whose own is missing: mid grey, no light of its own.
    pub fn fallback() -> Self {
        Material {
            name: "default".into(),
            reflectance: Rgb::splat(0.5),
            radiance: Rgb::ZERO,
            two_sided: false,
        }
    }

    /// Whether a reflectance of each channel lies in [0, 1) and a radiance in [0, ∞).
    pub(crate) fn is_possible(&self) -> bool {
        let reflects = self.reflectance.to_array().iter().all(|x| (0.0..1.0).contains(x));
        reflects && self.radiance.is_finite() && self.radiance.cmpge(Rgb::ZERO).all()
    }

    pub fn emits(&self) -> bool {
        self.radiance != Rgb::ZERO
    }
}
