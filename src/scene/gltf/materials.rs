//! Materials of glTF models as diffuse ones, and their textures.

use super::accessor::Data;
use super::glossy::Shine;
use super::images;
use super::json::{self, Root, SpecularGlossiness, TextureInfo, TextureTransform, Transmission};
use crate::color::Rgb;
use crate::error::{Error, Result, Warning};
use crate::scene::beside::Files;
use crate::scene::budget::Budget;
use crate::scene::material::Material;
use crate::scene::text::{LARGEST, quote};
use crate::scene::texture::{Map, Texture, TextureId, Wrap};
use glam::{Affine2, Vec2};
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// A model's materials, in the order of its file, and what they need.
#[derive(Default)]
pub(super) struct Materials {
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    /// Per material: the set of texture coordinates that its maps use.
    pub texture_sets: Vec<u32>,
    pub warnings: Vec<Warning>,
}

/// Extensions of materials that a diffuse one leaves aside, with the words for it.
const LEFT_ASIDE: [(&str, &str); 10] = [
    ("KHR_materials_unlit", "unlit"),
    ("KHR_materials_pbrSpecularGlossiness", "specular and glossy"),
    ("KHR_materials_transmission", "transmissive (at least 0.2 opaque)"),
    ("KHR_materials_diffuse_transmission", "translucent"),
    ("KHR_materials_clearcoat", "clear-coated"),
    ("KHR_materials_sheen", "with sheen"),
    ("KHR_materials_specular", "specular"),
    ("KHR_materials_iridescence", "iridescent"),
    ("KHR_materials_volume", "with volume"),
    ("KHR_materials_subsurface", "with subsurface scattering"),
];

/// The reflectance of white whose file gives no colour: paint. With 1, no light would be lost in a closed room.
const WHITE: f32 = 0.9;
/// The least opacity of what transmits light: clear glass would not be seen, as nothing is mirrored.
const GLASS: f32 = 0.2;

/// Reads the materials; only those that are `used` need their textures.
/// Fails where there is less memory than these take.
pub(super) fn read(at: &Path, data: &Data, files: &mut Files, used: &[bool]) -> Result<Materials> {
    let mut reader = Reader {
        path: at,
        data,
        out: Materials::default(),
        images: images::decode(data, files, &wanted_images(data.root, used))?,
        known: HashMap::new(),
        colored: colored(data.root),
        unusable: Default::default(),
        budget: Budget::default(),
        other_sets: 0,
        white: 0,
    };
    for (number, material) in data.root.materials.iter().enumerate() {
        reader.material(number, material, used[number])?;
    }
    reader.warn();
    Ok(reader.out)
}

/// The images that the used materials show, each once, in the order of their first use.
fn wanted_images(root: &Root, used: &[bool]) -> Vec<usize> {
    let (mut wanted, mut known) = (Vec::new(), HashSet::new());
    for (material, _) in root.materials.iter().zip(used).filter(|(_, used)| **used) {
        let Maps { base, emissive, set } = Maps::of(material);
        let shown = [base.as_ref(), emissive].into_iter().flatten();
        let shown = shown.filter(|info| texture_set(info) == set);
        let transmission = transmission(material).and_then(|t| t.transmission_texture);
        let specular = glossy(material).and_then(|g| g.specular_glossiness_texture);
        for info in shown.chain(transmission.as_ref()).chain(specular.as_ref()) {
            if let Ok(image) = image_of(root, info)
                && known.insert(image)
            {
                wanted.push(image);
            }
        }
    }
    wanted
}

/// Per material, whether vertices with colours of their own have it.
fn colored(root: &Root) -> Vec<bool> {
    let mut colored = vec![false; root.materials.len()];
    for primitive in root.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        let material = primitive.material.and_then(|material| colored.get_mut(material));
        if let Some(material) = material {
            *material |= primitive.attributes.contains_key("COLOR_0");
        }
    }
    colored
}

/// The textures of a material that a diffuse one shows.
struct Maps<'a> {
    base: Option<TextureInfo>,
    emissive: Option<&'a TextureInfo>,
    /// The set of texture coordinates that both should use.
    set: u32,
}

impl<'a> Maps<'a> {
    fn of(json: &'a json::Material) -> Self {
        let base = match glossy(json) {
            Some(glossy) => glossy.diffuse_texture,
            None => json.pbr_metallic_roughness.base_color_texture.clone(),
        };
        let emissive = json.emissive_texture.as_ref();
        let set = base.as_ref().or(emissive).map_or(0, texture_set);
        Maps { base, emissive, set }
    }
}

fn glossy(json: &json::Material) -> Option<SpecularGlossiness> {
    json::extension(&json.extensions, "KHR_materials_pbrSpecularGlossiness")
}

fn transmission(json: &json::Material) -> Option<Transmission> {
    json::extension(&json.extensions, "KHR_materials_transmission")
}

/// The image of a texture.
fn image_of(root: &Root, info: &TextureInfo) -> Result<usize> {
    let json = root.textures.get(info.index).ok_or_else(|| Error::new("it does not exist"))?;
    let webp = json.extensions.get("EXT_texture_webp").and_then(|webp| webp.get("source"));
    let source = json.source.or(webp.and_then(|source| source.as_u64()).map(|s| s as usize));
    source.ok_or_else(|| Error::new("its picture is in a format that is not read"))
}

/// What may be unusable.
const KINDS: [&str; 2] = ["texture", "image"];
const TEXTURE: usize = 0;
const IMAGE: usize = 1;

struct Reader<'a> {
    path: &'a Path,
    data: &'a Data<'a>,
    out: Materials,
    /// Those that the used materials show, by number. What cannot be read is taken out when it has been said.
    images: HashMap<usize, Result<Texture>>,
    known: HashMap<(usize, [Wrap; 2]), TextureId>,
    /// Per material.
    colored: Vec<bool>,
    /// What is said of textures and of images that cannot be used: of the first, and how many there are.
    unusable: [(Option<String>, usize); 2],
    /// Of pictures that are made of others.
    budget: Budget,
    /// How many maps use other texture coordinates than their materials' first.
    other_sets: usize,
    /// How many used materials are white because nothing gives them a colour.
    white: usize,
}

impl Reader<'_> {
    fn material(&mut self, number: usize, json: &json::Material, used: bool) -> Result<()> {
        let factor = match glossy(json) {
            Some(glossy) => glossy.diffuse_factor,
            None => json.pbr_metallic_roughness.base_color_factor,
        };
        let [r, g, b, alpha] = factor.unwrap_or([1.0; 4]).map(|x| x as f32);
        let Maps { base, emissive, set } = Maps::of(json);
        let mut map =
            |info: Option<&TextureInfo>| info.filter(|_| used).and_then(|info| self.map(info, set));
        let (reflectance_map, radiance_map) = (map(base.as_ref()), map(emissive));
        let is_white = factor.is_none() && base.is_none() && !self.colored[number];
        self.white += usize::from(is_white && used);
        let reflectance = if is_white { Rgb::splat(WHITE) } else { Rgb::new(r, g, b) };
        let reflectance = reflectance.clamp(Rgb::ZERO, Rgb::ONE);
        let (reflectance, reflectance_map) = match glossy(json).filter(|_| used) {
            Some(glossy) => self.with_shine(&glossy, reflectance, reflectance_map)?,
            None => (reflectance, reflectance_map),
        };
        let strength =
            json::number(&json.extensions, "KHR_materials_emissive_strength", "emissiveStrength");
        let emitted = json.emissive_factor.unwrap_or_default().map(|x| x * strength.unwrap_or(1.0));
        // Lights on a dark surface, which would all be a lamp without the picture.
        let is_unlit = emissive.is_some() && radiance_map.is_none();
        let emitted = if is_unlit { [0.0; 3] } else { emitted };
        let (share, cutoff) = opacity(json, alpha);
        // What is cut out by a mask is there or not.
        let through = if used && cutoff.is_none() { self.transmitted(json) } else { 0.0 };
        self.out.texture_sets.push(set);
        self.out.materials.push(Material {
            name: json.name.clone().unwrap_or_else(|| format!("material {number}")),
            reflectance,
            radiance: Rgb::from(emitted.map(|x| x.clamp(0.0, LARGEST.into()) as f32)),
            two_sided: json.double_sided,
            emits_on_back: json.double_sided,
            reflectance_map,
            radiance_map: radiance_map.filter(|_| emitted != [0.0; 3]),
            opacity: share * (1.0 - through).max(GLASS),
            opacity_map: reflectance_map.filter(|_| is_cut_out(json)),
            opacity_cutoff: cutoff,
        });
        Ok(())
    }

    /// The diffuse colour of a material with its specular one.
    fn with_shine(
        &mut self,
        glossy: &SpecularGlossiness,
        diffuse: Rgb,
        map: Option<Map>,
    ) -> Result<(Rgb, Option<Map>)> {
        let info = glossy.specular_glossiness_texture.as_ref();
        let picture = info.and_then(|info| self.picture(info));
        let given = glossy.specular_factor.map(|s| Rgb::from(s.map(|x| x.clamp(0.0, 1.0) as f32)));
        let factor = match info {
            // All of it would be a mirror.
            Some(_) if picture.is_none() => Rgb::ZERO,
            Some(_) => given.unwrap_or(Rgb::ONE),
            None => given.unwrap_or(Rgb::splat(WHITE)),
        };
        let shine = Shine { factor, picture: picture.as_ref() };
        let Some(map) = map.filter(|_| shine.is_metallic()) else {
            return Ok((if map.is_none() { shine.added_to(diffuse) } else { diffuse }, map));
        };
        // A picture that lies otherwise on the surface is not seen texel by texel.
        let is_alike = |info: &TextureInfo| {
            let base = glossy.diffuse_texture.as_ref();
            transform(info) == map.transform
                && base.is_some_and(|b| texture_set(b) == texture_set(info))
        };
        let shine = match info.is_none_or(is_alike) {
            true => shine,
            false => Shine { factor: shine.mean(), picture: None },
        };
        let below = &self.out.textures[map.texture.0 as usize];
        self.budget.take(size_of_val(&*below.pixels) as u64)?;
        let joined = shine.painted_over(below, diffuse);
        let texture = TextureId(self.out.textures.len() as u32);
        self.out.textures.push(joined);
        Ok((Rgb::ONE, Some(Map { texture, ..map })))
    }

    /// The share of light that goes straight through what is solid of a material, by the mean of its texture.
    fn transmitted(&mut self, json: &json::Material) -> f32 {
        let Some(Transmission { transmission_factor, transmission_texture }) = transmission(json)
        else {
            return 0.0;
        };
        let mean = match &transmission_texture {
            Some(info) => self.picture(info).map_or(0.0, |picture| mean_red(&picture)),
            None => 1.0,
        };
        (transmission_factor as f32 * mean).clamp(0.0, 1.0)
    }

    /// The picture of a texture.
    fn picture(&mut self, info: &TextureInfo) -> Option<Texture> {
        let image = self.image(info)?;
        self.decoded(image)
    }

    /// The map of a texture that uses the texture coordinates with number `set`.
    fn map(&mut self, info: &TextureInfo, set: u32) -> Option<Map> {
        if texture_set(info) != set {
            self.other_sets += 1;
            return None;
        }
        let image = self.image(info)?;
        let root = self.data.root;
        let json = &root.textures[info.index];
        let sampler = json.sampler.and_then(|sampler| root.samplers.get(sampler));
        let wrap = sampler.map_or([None; 2], |s| [s.wrap_s, s.wrap_t]).map(wrap);
        let texture = self.texture(image, wrap)?;
        Some(Map { texture, transform: transform(info) })
    }

    fn texture(&mut self, image: usize, wrap: [Wrap; 2]) -> Option<TextureId> {
        if let Some(id) = self.known.get(&(image, wrap)) {
            return Some(*id);
        }
        let texture = self.decoded(image)?;
        let id = TextureId(self.out.textures.len() as u32);
        self.out.textures.push(texture.wrapped(wrap));
        self.known.insert((image, wrap), id);
        Some(id)
    }

    /// The number of a texture's image.
    fn image(&mut self, info: &TextureInfo) -> Option<usize> {
        let image = image_of(self.data.root, info);
        image.map_err(|error| self.count(TEXTURE, info.index, &error)).ok()
    }

    fn decoded(&mut self, image: usize) -> Option<Texture> {
        if let Ok(texture) = self.images.get(&image)? {
            return Some(texture.clone());
        }
        if let Some(Err(error)) = self.images.remove(&image) {
            self.count(IMAGE, image, &error);
        }
        None
    }

    /// Counts a texture or an image that cannot be used.
    fn count(&mut self, kind: usize, number: usize, error: &Error) {
        let error = error.to_string();
        let cause = error.lines().next().unwrap_or_default();
        let what = KINDS[kind];
        let (first, count) = &mut self.unusable[kind];
        first.get_or_insert_with(|| {
            format!(
                "{what} {number} cannot be used: {cause}; the factor alone counts, and nothing is emitted or \
                 let through"
            )
        });
        *count += 1;
    }

    /// One warning for all textures, and one for all images.
    fn warn_of_unusable(&mut self) {
        for (what, (first, count)) in KINDS.iter().zip(&mut self.unusable) {
            let Some(mut text) = first.take() else { continue };
            if *count > 1 {
                text += &format!(" ({count} such {what}s in all)");
            }
            self.out.warnings.push(Warning::in_file(self.path, None, text));
        }
    }

    /// Also one warning for all that a diffuse material leaves aside.
    fn warn(&mut self) {
        self.warn_of_unusable();
        let materials = &self.data.root.materials;
        let metallic = |m: &&json::Material| {
            let pbr = &m.pbr_metallic_roughness;
            let glossy = m.extensions.contains_key("KHR_materials_pbrSpecularGlossiness");
            let unlit = m.extensions.contains_key("KHR_materials_unlit");
            !glossy && !unlit && pbr.metallic_factor.unwrap_or(1.0) > 0.0
        };
        let with =
            |name: &str| materials.iter().filter(|m| m.extensions.contains_key(name)).count();
        let kinds = LEFT_ASIDE.map(|(name, words)| (with(name), words));
        let kinds =
            [(materials.iter().filter(metallic).count(), "metallic")].into_iter().chain(kinds);
        let list: Vec<String> =
            kinds.filter(|(n, _)| *n > 0).map(|(n, words)| format!("{n} {words}")).collect();
        if !list.is_empty() {
            let text = format!("materials are taken as diffuse: {}", list.join(", "));
            self.out.warnings.push(Warning::in_file(self.path, None, text));
        }
        if self.white > 0 {
            let text = format!(
                "materials without a base colour are white and reflect {WHITE} ({} in all)",
                self.white
            );
            self.out.warnings.push(Warning::in_file(self.path, None, text));
        }
        if self.other_sets > 0 {
            let text = format!(
                "textures with other texture coordinates than their material's first are ignored ({} in \
                 all)",
                self.other_sets
            );
            self.out.warnings.push(Warning::in_file(self.path, None, text));
        }
    }
}

fn is_cut_out(json: &json::Material) -> bool {
    matches!(json.alpha_mode.as_deref(), Some("MASK" | "BLEND"))
}

/// The opacity without its map, and the cutoff.
fn opacity(json: &json::Material, alpha: f32) -> (f32, Option<f32>) {
    let cutoff = json.alpha_cutoff.unwrap_or(0.5) as f32;
    match json.alpha_mode.as_deref() {
        Some("MASK") => (alpha.clamp(0.0, 1.0), Some(cutoff)),
        Some("BLEND") => (alpha.clamp(0.0, 1.0), None),
        _ => (1.0, None),
    }
}

/// The mean of the red channel, which holds shares and not an sRGB colour.
fn mean_red(texture: &Texture) -> f32 {
    let sum: u64 = texture.pixels.iter().map(|pixel| u64::from(pixel[0])).sum();
    (sum as f64 / (255.0 * texture.pixels.len() as f64)) as f32
}

fn wrap(code: Option<u64>) -> Wrap {
    match code {
        Some(33071) => Wrap::Clamp,
        Some(33648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    }
}

fn texture_transform(info: &TextureInfo) -> TextureTransform {
    json::extension(&info.extensions, "KHR_texture_transform").unwrap_or_default()
}

/// The set of texture coordinates that a texture uses.
fn texture_set(info: &TextureInfo) -> u32 {
    texture_transform(info).tex_coord.unwrap_or(info.tex_coord)
}

/// In glTF v runs down, here it runs up: the file's transform stands between two flips.
fn transform(info: &TextureInfo) -> Affine2 {
    let json = texture_transform(info);
    let [u, v] = json.scale.unwrap_or([1.0; 2]);
    let (sin, cos) = json.rotation.sin_cos();
    let flip = Affine2::from_cols(Vec2::X, Vec2::NEG_Y, Vec2::Y);
    // Counter-clockwise as seen where v runs down.
    let own = Affine2::from_cols(
        u * Vec2::new(cos, -sin),
        v * Vec2::new(sin, cos),
        json.offset.unwrap_or_default().into(),
    );
    let whole = flip * own * flip;
    if whole.is_finite() { whole } else { Affine2::IDENTITY }
}

/// A name of the file for messages.
pub(super) fn quoted(name: &Option<String>, number: usize) -> String {
    name.as_deref().map_or_else(|| number.to_string(), quote)
}
