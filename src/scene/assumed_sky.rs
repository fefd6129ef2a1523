//! A sky for scenes whose own light is not there to light them.

use super::material::{Material, MaterialId};
use super::sums::sum;
use super::{Document, Scene, text};
use crate::color::{Rgb, luminance};
use crate::error::Warning;
use crate::geometry::TriangleId;
use glam::Vec2;

/// What emits no more than this was not made to light other things: modellers let a surface glow a little so that
/// it stands out.
const FAINT: f32 = 0.2;

/// A mean emission, over all surfaces, of a model that viewers light from all around: with less, its own lamps give
/// at most a tenth of the light of the sky.
const LEAST_MEAN_EMISSION: f64 = 0.1;

/// Before a sky that nobody asked for, what is white would not be seen: it is drawn this dark, or this dark if most
/// of the scene is as dark as that.
const BEHIND_ASSUMED_SKY: f32 = 0.1;
const BEHIND_DARK: f32 = 0.2;

/// What reflects shares of the light between these can hardly be told from a tenth.
const LIKE_A_TENTH: std::ops::Range<f32> = 0.06..0.14;

impl Scene {
    /// Sets the sky that the document asks for, or the one that the scene needs, and what is seen behind the scene.
    /// `has_surroundings`: the format's viewers light every model from all around.
    pub(super) fn set_sky(&mut self, document: &Document, has_surroundings: bool) {
        let is_lit = match (document.names_lamps(), has_surroundings) {
            (true, _) => self.emits(),
            // A model's visor or headlight glows, and lights nothing else.
            (false, true) => {
                self.emits_more_than(1.0) && self.mean_emission() > LEAST_MEAN_EMISSION
            }
            (false, false) => self.emits_more_than(FAINT),
        };
        self.sky = document.sky.unwrap_or(if is_lit { Rgb::ZERO } else { Rgb::ONE });
        self.background = self.sky;
        if document.sky.is_none() && self.sky != Rgb::ZERO {
            self.background *=
                if self.is_like_a_tenth() { BEHIND_DARK } else { BEHIND_ASSUMED_SKY };
            self.warnings.push(said(self));
        }
    }

    /// Whether most of the area is of one dark grey.
    fn is_like_a_tenth(&self) -> bool {
        let is_like = |triangle: TriangleId| {
            let (material, middle) = (self.material(triangle), 1.0 / 3.0);
            let reflectance = material.reflectance * self.mesh.color_at(triangle, middle, middle);
            material.reflectance_map.is_none() && LIKE_A_TENTH.contains(&luminance(reflectance))
        };
        let area = sum(self.triangles.len(), |number| {
            let is_like = is_like(TriangleId(number as u32));
            if is_like { self.triangles[number].area() } else { 0.0 }
        });
        area > 0.5 * self.area()
    }

    /// Whether any triangle emits more than this radiance where its texture, if it has one, is white.
    fn emits_more_than(&self, radiance: f32) -> bool {
        self.used_materials().any(|material| material.radiance.max_element() > radiance)
    }

    /// The mean over the area of the radiance that the triangles emit on their brighter sides, by the largest
    /// channel. A texture counts with the mean of all of it.
    fn mean_emission(&self) -> f64 {
        let emissions: Vec<f64> = self.materials.iter().map(|m| self.emission(m)).collect();
        let of = |material: MaterialId| emissions[material.0 as usize];
        let emitted = |number: usize| {
            let back = self.own_back(TriangleId(number as u32)).map_or(0.0, of);
            let emission = of(self.material_of[number]).max(back);
            if emission > 0.0 { emission * self.triangles[number].area() } else { 0.0 }
        };
        sum(self.triangles.len(), emitted) / self.area()
    }

    fn emission(&self, material: &Material) -> f64 {
        let map = material.radiance_map.as_ref();
        let shown = map.map_or(Rgb::ONE, |map| {
            self.textures[map.texture.0 as usize].color(Vec2::ZERO, f32::INFINITY)
        });
        f64::from((material.radiance * shown).max_element())
    }
}

/// Says where the light comes from, and how to have another.
fn said(scene: &Scene) -> Warning {
    if scene.emits() {
        return Warning::new(
            "what glows in the scene gives little light, so a sky of radiance 1 lights it too (another: --sky; \
             none: --sky 0)",
        );
    }
    let is_used = |material: usize| scene.material_of.iter().any(|m| m.0 as usize == material);
    let mut lamps =
        scene.materials.iter().enumerate().filter(|(i, m)| looks_like_lamp(m) && is_used(*i));
    let example = match lamps.next() {
        Some((_, lamp)) => {
            let name = text::quote(&lamp.name);
            format!(
                "the material {name} looks like a lamp: --emit '{}=10'",
                lamp.name.escape_debug()
            )
        }
        None => "or let a material shine: --emit MATERIAL=RADIANCE".to_string(),
    };
    Warning::new(format!(
        "nothing in the scene emits light, so a sky of radiance 1 lights it (another: --sky); {example}"
    ))
}

/// Whether a word of the name is one for lamps: `ceiling_lamp2` and `LampGlass` have one, `Clamp` has none.
fn looks_like_lamp(material: &Material) -> bool {
    const LAMPS: [&str; 12] = [
        "light",
        "lights",
        "lighting",
        "lightbulb",
        "lamp",
        "lamps",
        "bulb",
        "bulbs",
        "emit",
        "emitter",
        "emission",
        "emissive",
    ];
    words_of_name(&material.name).iter().any(|word| LAMPS.contains(&word.as_str()))
}

/// The words of a name in lower case. Whatever is no letter separates them, and so does a capital beside a small
/// letter: `LEDLight` has two words.
fn words_of_name(name: &str) -> Vec<String> {
    let letters: Vec<char> = name.chars().collect();
    let is_small = |i: usize| letters.get(i).is_some_and(|letter| letter.is_lowercase());
    let mut words = vec![String::new()];
    for (i, letter) in letters.iter().enumerate() {
        let begins = letter.is_uppercase() && (is_small(i.wrapping_sub(1)) || is_small(i + 1));
        if begins || !letter.is_alphabetic() {
            words.push(String::new());
        }
        if letter.is_alphabetic() {
            words.last_mut().expect("never empty").extend(letter.to_lowercase());
        }
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Triangle;
    use crate::scene::mesh::{Mesh, PerCorner};
    use glam::Vec3;

    #[test]
    fn a_lamp_is_known_by_a_word_of_its_name() {
        let is_lamp =
            |name: &str| looks_like_lamp(&Material { name: name.into(), ..Material::fallback() });
        for name in
            ["light", "Lamp.001", "ceilingLamp", "LED_LIGHT2", "LEDLight", "3bulbs", "mat:Emissive"]
        {
            assert!(is_lamp(name), "{name}");
        }
        for name in ["Clamp", "tableClamps", "delight", "slightly_rough", "remit", ""] {
            assert!(!is_lamp(name), "{name}");
        }
    }

    #[test]
    fn the_mean_emission_is_that_of_the_area_and_of_the_brighter_side() {
        let at = |size: f32| Triangle::new(Vec3::ZERO, Vec3::X * size, Vec3::Y);
        let material = |radiance| Material { radiance, ..Material::fallback() };
        let materials = [Rgb::ZERO, Rgb::new(1.0, 8.0, 2.0)].map(material).to_vec();
        let scene = Scene::new(vec![at(3.0), at(1.0)], [0, 1].map(MaterialId).to_vec(), materials);
        assert!((scene.mean_emission() - 2.0).abs() < 1e-6);
        let back_of = vec![Some(MaterialId(1)), None].into();
        assert!((Scene { back_of, ..scene.clone() }.mean_emission() - 8.0).abs() < 1e-6);
        assert!(scene.emits_more_than(7.0) && !scene.emits_more_than(8.0));
    }

    #[test]
    fn a_scene_is_like_the_background_where_most_of_its_area_is() {
        let is_like_a_tenth = |grey: f32, area: f32| {
            let at = |size: f32| Triangle::new(Vec3::ZERO, Vec3::X * size, Vec3::Y);
            let material =
                |grey| Material { reflectance: Rgb::splat(grey), ..Material::fallback() };
            let materials = [0.8, grey].map(material).to_vec();
            let triangles = vec![at(1.0), at(area)];
            Scene::new(triangles, [0, 1].map(MaterialId).to_vec(), materials).is_like_a_tenth()
        };
        assert_eq!([0.02, 0.1, 0.2].map(|grey| is_like_a_tenth(grey, 2.0)), [false, true, false]);
        assert!(!is_like_a_tenth(0.1, 0.5));
    }

    #[test]
    fn vertex_colors_count_for_the_background() {
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
        let material = Material { reflectance: Rgb::splat(0.5), ..Material::fallback() };
        let mut scene = Scene::new(vec![triangle], vec![MaterialId(0)], vec![material]);
        assert!(!scene.is_like_a_tenth());
        let greys = [0.1, 0.2, 0.3].map(Rgb::splat).to_vec();
        let colors = PerCorner::new(greys, vec![[1, 2, 3]]);
        scene.mesh = Mesh { colors, ..Mesh::default() }.into();
        assert!(scene.is_like_a_tenth());
    }

    #[test]
    fn a_faint_glow_of_an_obj_leaves_the_sky_and_a_glowing_copy_that_is_left_out_too() {
        let folder = tempfile::tempdir().unwrap();
        let sky = |faces: &str, glow: f32| {
            let text = format!("newmtl a\nKd .5 .5 .5\nnewmtl b\nKe 0 0 {glow}\n");
            std::fs::write(folder.path().join("a.mtl"), text).unwrap();
            let file = folder.path().join("a.obj");
            let text = format!("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n{faces}");
            std::fs::write(&file, text).unwrap();
            let document = Document::open(&file).unwrap();
            Scene::load(&document).unwrap().sky
        };
        let beside = "usemtl a\nf 1 2 3\nusemtl b\nf 1 2 4\n";
        assert_eq!([sky(beside, 0.1), sky(beside, 0.3)], [Rgb::ONE, Rgb::ZERO]);
        assert_eq!(sky("usemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n", 9.0), Rgb::ONE);
    }
}
