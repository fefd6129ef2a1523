//! Turns the entries of MTL files into [`Material`]s. Only here is it known which materials the faces use. A bad
//! value has a default and is noted, or is passed over in silence where no face uses the material.

use std::path::{Path, PathBuf};

use super::mtl_map::MapLine;
use super::mtl_reader::{Color, Entry, Library};
use super::notes::{Kind, Notes};
use super::pictures::Pictures;
use crate::color::Rgb;
use crate::error::{Result, Warning};
use crate::scene::material::Material;
use crate::scene::text::LARGEST;
use crate::scene::texture::{Map, Texture};

/// The use that the model makes of a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Role {
    /// Whether a face has this material.
    pub used: bool,
    /// Whether the reflectance will be replaced, so that Kd does not matter.
    pub replaced: bool,
}

/// The materials of a model and the pictures that they use.
pub(super) struct Materials {
    pub list: Vec<Material>,
    pub textures: Vec<Texture>,
    /// The pictures' files.
    pub files: Vec<PathBuf>,
}

/// The materials of `library`, one for each entry. `role_of` is asked with the index of an entry.
///
/// # Errors
/// Less memory than their pictures take.
pub(super) fn materials(
    library: &Library,
    role_of: impl Fn(usize) -> Role,
    warnings: &mut Vec<Warning>,
) -> Result<Materials> {
    let (mut notes, mut pictures) = (Notes::default(), Pictures::default());
    let entries = library.entries.iter().enumerate();
    pictures.decode_ahead(entries.flat_map(|(index, entry)| shown(entry, role_of(index))));
    let mut material = |(index, entry): (usize, &Entry)| match entry.file.as_deref() {
        Some(file) => {
            let (role, mut unheard) = (role_of(index), Notes::default());
            let notes = if role.used { &mut notes } else { &mut unheard };
            Judge { entry, file, role, notes, pictures: &mut pictures }.material()
        }
        None => Ok(Material { name: entry.name.clone(), ..Material::fallback() }),
    };
    let list = library.entries.iter().enumerate().map(&mut material).collect::<Result<_>>()?;
    warnings.extend(notes.warnings());
    Ok(Materials { list, textures: pictures.textures, files: pictures.files })
}

/// The maps of a material that its [`Judge`] looks at, with the file that names them.
fn shown(entry: &Entry, role: Role) -> impl Iterator<Item = (&Path, &MapLine)> {
    let reflectance = entry.map_kd.as_ref().filter(|_| !role.replaced);
    let maps = [reflectance, entry.map_ke.as_ref(), entry.map_d.as_ref()];
    let file = entry.file.as_deref().filter(|_| role.used);
    file.into_iter().flat_map(move |file| maps.into_iter().flatten().map(move |map| (file, map)))
}

/// Judges the values of one material.
struct Judge<'a> {
    entry: &'a Entry,
    file: &'a Path,
    role: Role,
    notes: &'a mut Notes,
    pictures: &'a mut Pictures,
}

impl Judge<'_> {
    fn material(mut self) -> Result<Material> {
        let (radiance, radiance_map) = self.radiance()?;
        let (reflectance, reflectance_map) = self.reflectance(radiance != Rgb::ZERO)?;
        let (opacity, opacity_map) = self.opacity()?;
        Ok(Material {
            name: self.entry.name.clone(),
            reflectance,
            radiance,
            reflectance_map,
            radiance_map,
            opacity,
            opacity_map,
            ..Material::fallback()
        })
    }

    /// Ke, or else no light; a texture with Ke 0 or none means the texture alone.
    fn radiance(&mut self) -> Result<(Rgb, Option<Map>)> {
        let given = self.entry.ke.as_ref().map_or(Rgb::ZERO, |ke| self.checked_radiance(ke));
        let map = self.picture(self.entry.map_ke.as_ref())?;
        Ok(match map.filter(|map| !self.pictures.is_black(map)) {
            Some(map) if given == Rgb::ZERO => (Rgb::ONE, Some(map)),
            // A black picture takes all light away.
            None if map.is_some() => (Rgb::ZERO, None),
            map => (given, map),
        })
    }

    fn checked_radiance(&mut self, ke: &Color) -> Rgb {
        let value = ke.value.clone().unwrap_or(Rgb::ZERO);
        let possible = value.clamp(Rgb::ZERO, Rgb::splat(LARGEST));
        if possible != value || ke.value.is_err() {
            self.note(Kind::BadKe, ke);
        }
        possible
    }

    /// Kd, or else black for a lamp and mid grey for anything else; a texture with Kd 0 or none means the texture
    /// alone.
    fn reflectance(&mut self, emits: bool) -> Result<(Rgb, Option<Map>)> {
        let default = if emits { Rgb::ZERO } else { Material::fallback().reflectance };
        if self.role.replaced {
            return Ok((default, None));
        }
        let given = self.entry.kd.as_ref().map(|kd| self.checked_reflectance(kd));
        let given = given.flatten().map(|kd| self.or_metal(kd, emits));
        let named = self.entry.map_kd.is_some();
        let map = self.picture(self.entry.map_kd.as_ref())?;
        let is_black = given.is_none_or(|kd| kd == Rgb::ZERO);
        Ok(match (map, given) {
            (Some(map), _) if is_black => (Rgb::ONE, Some(map)),
            (Some(map), Some(kd)) => (kd, Some(map)),
            (None, _) if named && is_black => (Material::fallback().reflectance, None),
            (None, Some(kd)) => (kd, None),
            (_, None) => {
                if self.entry.kd.is_none() {
                    self.notes.add(Kind::NoKd, self.file, self.entry.line, &self.entry.name);
                }
                (default, None)
            }
        })
    }

    /// `None` if it is malformed.
    fn checked_reflectance(&mut self, kd: &Color) -> Option<Rgb> {
        let Ok(value) = kd.value else {
            self.note(Kind::BadKd, kd);
            return None;
        };
        if value.min_element() < 0.0 {
            self.note(Kind::NegativeKd, kd);
        }
        if value.max_element() > 1.0 {
            self.note(Kind::BrightKd, kd);
        }
        Some(at_most_white(value.max(Rgb::ZERO)))
    }

    /// The diffuse stand-in for a material that only mirrors.
    fn or_metal(&mut self, kd: Rgb, emits: bool) -> Rgb {
        let has_map = self.entry.map_kd.is_some();
        match &self.entry.ks {
            Some(Color { value: Ok(ks), line }) if kd == Rgb::ZERO && !has_map && !emits => {
                let shine = at_most_white(ks.max(Rgb::ZERO));
                if shine != Rgb::ZERO {
                    self.notes.add(Kind::Metal, self.file, *line, &self.entry.name);
                }
                shine
            }
            _ => kd,
        }
    }

    /// `d`, or else 1 − `Tr`, or else 1. Some exporters write `Tr 1` (MeshLab) or `d 0` (Blender 2.7) for what is
    /// opaque, and nobody means a material that cannot be seen.
    fn opacity(&mut self) -> Result<(f32, Option<Map>)> {
        let given = self.entry.d.or(self.entry.tr.map(|tr| 1.0 - tr)).unwrap_or(1.0);
        let opacity = if given <= 0.0 { 1.0 } else { given.min(1.0) };
        if given <= 0.0 {
            self.notes.add(Kind::Unseen, self.file, self.entry.line, &self.entry.name);
        } else if opacity < 1.0 {
            self.notes.add(Kind::Clear, self.file, self.entry.line, &self.entry.name);
        }
        let map = self.entry.map_d.as_ref().filter(|_| self.role.used);
        let map = map.map(|map| self.pictures.opacity(self.file, map, self.notes));
        Ok((opacity, map.transpose()?.flatten()))
    }

    /// The picture of a colour map, unless no face would show it.
    fn picture(&mut self, map: Option<&MapLine>) -> Result<Option<Map>> {
        let map = map.filter(|_| self.role.used);
        let map = map.map(|map| self.pictures.color(self.file, map, self.notes));
        Ok(map.transpose()?.flatten())
    }

    fn note(&mut self, kind: Kind, color: &Color) {
        let cause = color.value.as_ref().err().cloned();
        self.notes.add_with(kind, self.file, color.line, &self.entry.name, cause);
    }
}

/// Divided by the largest component where that is above 1.
fn at_most_white(color: Rgb) -> Rgb {
    let largest = color.max_element();
    // Rounding must not leave a component above 1.
    if largest > 1.0 { (color / largest).min(Rgb::ONE) } else { color }
}

#[cfg(test)]
mod tests {
    use super::*;

    const USED: Role = Role { used: true, replaced: false };
    const UNUSED: Role = Role { used: false, replaced: false };
    const REPLACED: Role = Role { used: true, replaced: true };

    /// Reads the one material in `text` and judges it.
    fn judge_in(folder: &Path, text: &str, role: Role) -> (Material, Vec<String>) {
        let (mut library, mut warnings) = (Library::default(), Vec::new());
        library.add(&folder.join("a.mtl"), &format!("newmtl m\n{text}"), &mut warnings);
        let mut materials = materials(&library, |_| role, &mut warnings).unwrap();
        let text = |warning: &Warning| warning.to_string();
        (materials.list.remove(0), warnings.iter().map(text).collect())
    }

    fn judge(text: &str, role: Role) -> (Material, Vec<String>) {
        judge_in(Path::new(""), text, role)
    }

    #[test]
    fn values_in_range_are_taken_as_they_are() {
        let (material, warnings) = judge("Kd 0 0.5 1\nKe 1 2 3\nd 1\nTr 0.9", USED);
        assert_eq!(material.reflectance, Rgb::new(0.0, 0.5, 1.0));
        assert_eq!(material.radiance, Rgb::new(1.0, 2.0, 3.0));
        assert_eq!(material.opacity, 1.0);
        assert!(!material.two_sided && warnings.is_empty(), "{warnings:?}");
    }

    #[test]
    fn values_out_of_range_are_scaled_or_clamped_and_told() {
        let cases = [
            ("Kd 2 1 0.5", Rgb::new(1.0, 0.5, 0.25), "a.mtl:2: Kd above 1 is scaled"),
            ("Kd -1 0.5 0", Rgb::new(0.0, 0.5, 0.0), "a.mtl:2: Kd below 0 is taken as 0"),
            ("Kd 1 2", Rgb::splat(0.5), "a.mtl:2: Kd is malformed"),
            ("Kd nan 0 0", Rgb::splat(0.5), "a.mtl:2: Kd is malformed"),
        ];
        for (text, reflectance, warning) in cases {
            let (material, warnings) = judge(text, USED);
            assert_eq!(material.reflectance, reflectance, "{text}");
            assert!(warnings.len() == 1 && warnings[0].starts_with(warning), "{warnings:?}");
            assert!(judge(text, UNUSED).1.is_empty() && judge(text, REPLACED).1.is_empty());
        }
        let (lamp, warnings) = judge("Kd 0\nKe 1 -1 1e13", USED);
        assert_eq!(lamp.radiance, Rgb::new(1.0, 0.0, LARGEST));
        assert!(warnings[0].starts_with("a.mtl:3: Ke is malformed, negative"), "{warnings:?}");
    }

    #[test]
    fn without_kd_a_lamp_is_black_and_anything_else_grey() {
        let (grey, warnings) = judge("Ke 0 0 0", USED);
        assert_eq!(grey.reflectance, Rgb::splat(0.5));
        assert!(warnings[0].starts_with("a.mtl:1: no Kd"), "{warnings:?}");
        assert_eq!(judge("Ke 0 0 1", USED).0.reflectance, Rgb::ZERO);
        assert!(judge("", UNUSED).1.is_empty());
    }

    #[test]
    fn a_metal_reflects_its_shine_diffusely_and_a_lamp_does_not() {
        let (metal, warnings) = judge("Kd 0 0 0\nKs 0.9 0.5 0\nillum 3", USED);
        assert_eq!(metal.reflectance, Rgb::new(0.9, 0.5, 0.0));
        assert!(warnings[0].starts_with("a.mtl:3: mirrors and metals"), "{warnings:?}");
        for text in ["Kd 0\nKs 0", "Kd 0\nKs 1\nKe 5", "Kd 0"] {
            assert_eq!(judge(text, USED).0.reflectance, Rgb::ZERO, "{text}");
        }
    }

    #[test]
    fn opacity_comes_from_d_or_else_from_tr_and_never_from_illum() {
        for (text, opacity) in
            [("d 0.25\nTr 0", 0.25), ("Tr 0.25", 0.75), ("illum 4", 1.0), ("d -halo 0.5", 0.5)]
        {
            let (material, warnings) = judge(&format!("Kd 1\n{text}"), USED);
            assert_eq!(material.opacity, opacity, "{text}");
            assert_eq!(warnings.len(), usize::from(opacity < 1.0), "{warnings:?}");
        }
    }

    #[test]
    fn what_nobody_could_see_is_solid() {
        for text in ["Tr 1", "d 0.0\nillum 7", "Tr 1\nd 0", "d -1", "Tr 2"] {
            let (material, warnings) = judge(&format!("Kd 1\n{text}"), USED);
            assert_eq!(material.opacity, 1.0, "{text}");
            let [warning] = &warnings[..] else { panic!("{text}: {warnings:?}") };
            assert!(warning.starts_with("a.mtl:1: opacity 0 (d 0, Tr 1) is taken as solid"));
        }
    }

    #[test]
    fn a_black_or_missing_kd_with_a_texture_means_the_texture() {
        let folder = tempfile::tempdir().expect("a folder");
        let save = |name: &str, pixel| {
            image::RgbaImage::from_pixel(1, 1, image::Rgba(pixel)).save(folder.path().join(name))
        };
        save("grey.png", [100, 100, 100, 255]).expect("a picture");
        save("black.png", [0, 0, 0, 255]).expect("a picture");
        let judge = |text| judge_in(folder.path(), text, USED).0;
        let [black, none, half] = [
            judge("Kd 0 0 0\nmap_Kd grey.png"),
            judge("map_Kd grey.png"),
            judge("Kd 0.5\nmap_Kd grey.png\nmap_d grey.png"),
        ];
        assert!(black.reflectance == Rgb::ONE && none.reflectance == Rgb::ONE);
        assert_eq!(half.reflectance, Rgb::splat(0.5));
        assert!([&black, &none, &half].iter().all(|m| m.reflectance_map.is_some()));
        assert!(half.opacity_map.is_some());
        // A picture that cannot be read.
        assert_eq!(judge("Kd 0\nmap_Kd none.png").reflectance, Rgb::splat(0.5));
        assert_eq!(judge("Kd 0.3\nmap_Kd none.png").reflectance, Rgb::splat(0.3));
        assert_eq!(judge("Kd 0\nmap_Ke grey.png").radiance, Rgb::ONE);
        let dark = judge("Kd 0\nKe 1 1 1\nmap_Ke black.png");
        assert!(!dark.emits() && dark.radiance_map.is_none());
    }
}
