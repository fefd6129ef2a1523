//! Turns the entries of MTL files into [`Material`]s. Only here is it known which materials
//! the faces use: a bad value is an error in those, and a warning in the others.

use std::path::Path;

use super::mtl_reader::{Color, Entry, Library};
use crate::color::Rgb;
use crate::error::{Error, Result, Warning};
use crate::scene::material::Material;
use crate::scene::text::{LARGEST, quote};

/// The use that the model makes of a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Role {
    /// Whether a face has this material.
    pub used: bool,
    /// Whether the reflectance will be replaced, so that Kd does not matter.
    pub replaced: bool,
}

/// The materials of `library`, one for each entry. `role_of` is asked with the index of an entry.
pub(super) fn materials(
    library: &Library,
    role_of: impl Fn(usize) -> Role,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Material>> {
    let mut materials = Vec::with_capacity(library.entries.len());
    for (index, entry) in library.entries.iter().enumerate() {
        let mut material = Material { name: entry.name.clone(), ..Material::fallback() };
        if let Some(file) = entry.file.as_deref() {
            let mut judge = Judge { entry, file, role: role_of(index), warnings };
            material.radiance = judge.radiance()?;
            material.reflectance = judge.reflectance(material.emits())?;
        }
        materials.push(material);
    }
    Ok(materials)
}

/// Judges the values of one material.
struct Judge<'a> {
    entry: &'a Entry,
    file: &'a Path,
    role: Role,
    warnings: &'a mut Vec<Warning>,
}

impl Judge<'_> {
    /// Ke, or else no light.
    fn radiance(&mut self) -> Result<Rgb> {
        let Some(ke) = self.entry.ke else { return Ok(Rgb::ZERO) };
        if ke.value.to_array().iter().all(|channel| (0.0..=LARGEST).contains(channel)) {
            return Ok(ke.value);
        }
        let cause = self.out_of_range("Ke", ke, &format!("[0, {LARGEST:e}]"));
        let remedy = "give Ke as a radiance in W/(sr·m²), which is not negative";
        self.refuse(cause, ke.line, remedy)?;
        Ok(Rgb::ZERO)
    }

    /// Kd, or else black for a lamp and mid grey for anything else.
    fn reflectance(&mut self, emits: bool) -> Result<Rgb> {
        let default = if emits { Rgb::ZERO } else { Material::fallback().reflectance };
        let Some(kd) = self.entry.kd else {
            if self.role.used && !self.role.replaced {
                let name = quote(&self.entry.name);
                let text = format!("material {name} has no Kd: its reflectance is {}", default.x);
                self.warn(self.entry.line, text);
            }
            return Ok(default);
        };
        if kd.value.to_array().iter().all(|channel| (0.0..1.0).contains(channel)) {
            return Ok(kd.value);
        }
        if !self.role.replaced {
            let remedy = "lower Kd below 1 (real surfaces stay below 0.95), or override the \
                          material's `reflectance` in a scene description";
            let cause = self.out_of_range("Kd", kd, "[0, 1)");
            self.refuse(cause, kd.line, remedy)?;
        }
        Ok(default)
    }

    fn out_of_range(&self, keyword: &str, color: Color, range: &str) -> String {
        let [r, g, b] = color.value.to_array();
        format!("{keyword} {r} {g} {b} of material {} is outside {range}", quote(&self.entry.name))
    }

    /// An error if a face uses the material, else a warning.
    fn refuse(&mut self, cause: String, line: usize, remedy: &str) -> Result<()> {
        if !self.role.used {
            self.warn(line, format!("{cause}; no face uses it, so the value is dropped"));
            return Ok(());
        }
        Err(Error::new(cause).remedy(remedy).in_file(self.file).at_line(line))
    }

    fn warn(&mut self, line: usize, text: String) {
        self.warnings.push(Warning::in_file(self.file, Some(line), text));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads the one material in `text` and judges it.
    fn judge(text: &str, role: Role) -> Result<(Material, Vec<String>)> {
        let (mut library, mut warnings) = (Library::default(), Vec::new());
        library.add(Path::new("a.mtl"), &format!("newmtl m\n{text}"), &mut warnings)?;
        let mut materials = materials(&library, |_| role, &mut warnings)?;
        Ok((materials.remove(0), warnings.iter().map(Warning::to_string).collect()))
    }

    const USED: Role = Role { used: true, replaced: false };
    const UNUSED: Role = Role { used: false, replaced: false };
    const REPLACED: Role = Role { used: true, replaced: true };

    #[test]
    fn values_in_range_are_taken_as_they_are() {
        let (material, warnings) = judge("Kd 0 0.5 0.99\nKe 1 2 3", USED).unwrap();
        assert_eq!(material.reflectance, Rgb::new(0.0, 0.5, 0.99));
        assert_eq!(material.radiance, Rgb::new(1.0, 2.0, 3.0));
        assert!(!material.two_sided && warnings.is_empty());
    }

    #[test]
    fn a_used_reflectance_of_one_or_below_zero_is_an_error_with_its_line() {
        for kd in ["0 1 0", "-0.1 0 0", "0 0 1.5", "0.99999999"] {
            let error = judge(&format!("\nKd {kd}"), USED).expect_err(kd).to_string();
            assert!(error.starts_with("a.mtl:3: Kd "), "{error}");
            assert!(
                error.contains("of material `m` is outside [0, 1)\n  help: lower Kd"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_negative_or_enormous_radiance_is_an_error_with_its_line() {
        for ke in ["0 0 -1", "1e13"] {
            let error = judge(&format!("Kd 0\nKe {ke}"), USED).expect_err(ke).to_string();
            assert!(error.starts_with("a.mtl:3: Ke "), "{error}");
        }
    }

    #[test]
    fn a_bad_value_that_no_face_uses_is_a_warning() {
        let (material, warnings) = judge("Kd 1.5\nKe -1", UNUSED).unwrap();
        assert_eq!(material, Material { name: "m".into(), ..Material::fallback() });
        assert_eq!(
            warnings,
            [
                "a.mtl:3: Ke -1 -1 -1 of material `m` is outside [0, 1e12]; \
                 no face uses it, so the value is dropped",
                "a.mtl:2: Kd 1.5 1.5 1.5 of material `m` is outside [0, 1); \
                 no face uses it, so the value is dropped",
            ]
        );
    }

    #[test]
    fn a_bad_reflectance_that_will_be_replaced_does_not_matter() {
        let (material, warnings) = judge("Kd 1.5\nKe 2", REPLACED).unwrap();
        assert_eq!((material.reflectance, material.radiance), (Rgb::ZERO, Rgb::splat(2.0)));
        assert!(warnings.is_empty());
        assert!(judge("Ke -1", REPLACED).is_err());
    }

    #[test]
    fn without_kd_a_lamp_is_black_and_anything_else_grey() {
        let (grey, warnings) = judge("Ke 0 0 0", USED).unwrap();
        assert_eq!(grey.reflectance, Rgb::splat(0.5));
        assert_eq!(warnings, ["a.mtl:1: material `m` has no Kd: its reflectance is 0.5"]);
        let (lamp, warnings) = judge("Ke 0 0 1", USED).unwrap();
        assert_eq!(lamp.reflectance, Rgb::ZERO);
        assert_eq!(warnings, ["a.mtl:1: material `m` has no Kd: its reflectance is 0"]);
        assert!(judge("", UNUSED).unwrap().1.is_empty());
    }
}
