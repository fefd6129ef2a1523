//! Changes to materials by name: the `[materials.NAME]` tables of a description, and `--emit`.

use super::material::Material;
use super::material::is_radiance;
use super::text::quote;
use crate::color::Rgb;
use crate::error::{Error, Result};
use serde::Deserialize;

/// What a `[materials.NAME]` table says.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialOverride {
    reflectance: Option<[f32; 3]>,
    radiance: Option<[f32; 3]>,
    two_sided: Option<bool>,
}

impl MaterialOverride {
    /// # Errors
    /// A value outside its range; `name` is the table's.
    pub(super) fn check(&self, name: &str) -> Result<()> {
        let bad = |what: &str, range: &str| {
            Err(Error::new(format!("[materials.{name}]: {what} is outside {range}"))
                .remedy("real surfaces reflect less than 0.95 and emit nothing negative"))
        };
        if self.reflectance.is_some_and(|r| !r.iter().all(|x| (0.0..=1.0).contains(x))) {
            return bad("reflectance", "[0, 1]");
        }
        if self.radiance.is_some_and(|radiance| !is_radiance(radiance.into())) {
            return bad("radiance", "[0, 1e12]");
        }
        Ok(())
    }

    pub(super) fn apply(&self, material: &mut Material) {
        if let Some(reflectance) = self.reflectance {
            material.reflectance = Rgb::from(reflectance);
            material.reflectance_map = None;
        }
        if let Some(radiance) = self.radiance {
            material.radiance = Rgb::from(radiance);
            material.radiance_map = None;
        }
        if let Some(two_sided) = self.two_sided {
            material.two_sided = two_sided;
            material.emits_on_back = two_sided;
        }
    }

    pub(super) fn replaces_radiance(&self) -> bool {
        self.radiance.is_some()
    }

    pub(super) fn replaces_reflectance(&self) -> bool {
        self.reflectance.is_some()
    }
}

/// Changes every material that a name means, which may end in `*`.
///
/// # Errors
/// A name that no material has.
pub(super) fn change_matching(
    pattern: &str,
    materials: &mut [Material],
    mut change: impl FnMut(&mut Material),
) -> Result<()> {
    let is_meant = |material: &&mut Material| match pattern.strip_suffix('*') {
        Some(start) => material.name.starts_with(start),
        None => material.name == pattern,
    };
    let mut found = false;
    for material in materials.iter_mut().filter(is_meant) {
        found = true;
        change(material);
    }
    if found {
        return Ok(());
    }
    let known: Vec<String> = materials.iter().map(|m| m.name.escape_debug().to_string()).collect();
    Err(Error::new(format!("no material has the name {}", quote(pattern)))
        .remedy(format!("the models have: {}", known.join(", "))))
}
