//! The scene: triangles, materials, and what a description file says about looking at them.

mod beside;
mod budget;
pub mod camera;
mod coincident;
mod crossing;
mod crowding;
pub mod document;
mod formats;
mod gltf;
pub(crate) mod groups;
pub(crate) mod inspect;
pub mod material;
pub mod mesh;
mod model;
#[cfg(test)]
mod mutation;
pub(crate) mod obj;
mod opacity;
mod overlap_warnings;
pub mod overlaps;
mod overrides;
mod ply;
mod read;
mod shown;
mod sniff;
mod stl;
pub(crate) mod text;
pub mod texture;
pub mod topology;
mod triangulate;
mod upright;

use crate::color::Rgb;
use crate::error::{Error, Result, Warning};
use crate::geometry::bounds::Bounds;
use crate::geometry::{Triangle, TriangleId};
pub use camera::Camera;
pub use document::Document;
use glam::{DVec3, Vec3};
pub(crate) use material::is_radiance;
pub use material::{Material, MaterialId};
pub use mesh::Mesh;
use model::Model;
use overlaps::Overlaps;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
pub use texture::{Map, Texture, TextureId};
use topology::Topology;

/// Triangles with their materials, all of them with an area above zero.
///
/// A clone shares them and costs nothing.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Scene {
    pub triangles: Arc<[Triangle]>,
    /// One per triangle.
    pub material_of: Arc<[MaterialId]>,
    /// Per triangle, the material of its back where that is another; empty if all have one.
    pub back_of: Arc<[Option<MaterialId>]>,
    pub materials: Arc<[Material]>,
    /// The pictures that the materials' maps name.
    pub textures: Arc<[Texture]>,
    /// The faces of the model files that the triangles come from.
    pub mesh: Arc<Mesh>,
    /// Triangles without area, left out of everything.
    pub degenerate: usize,
    /// Radiance of the sky in W·sr⁻¹·m⁻², the same from all directions; zero: there is none.
    pub sky: Rgb,
    /// Radiance where a picture shows none of the scene.
    pub background: Rgb,
    /// The direction that is up.
    pub up: Vec3,
    /// The place in the model files' coordinates that is the origin here: zero, except where the models lie
    /// so far away that f32 would lose digits.
    pub origin: DVec3,
    /// Length of a unit of the coordinates.
    pub metres_per_unit: f64,
    /// The cameras of the model files by name, in the files' order.
    #[serde(skip)]
    pub views: Vec<(String, Camera)>,
    #[serde(skip)]
    pub warnings: Vec<Warning>,
    /// Files that were read beside those that the document names.
    #[serde(skip)]
    pub files: Vec<PathBuf>,
    /// Filled by the first call of [`topology`](Self::topology).
    #[serde(skip)]
    pub known_topology: Arc<OnceLock<Topology>>,
    /// Filled by the first call of `crowding`.
    #[serde(skip)]
    pub known_crowding: Arc<OnceLock<f64>>,
    /// Filled by the first call of [`overlaps`](Self::overlaps).
    #[serde(skip)]
    pub known_overlaps: Arc<OnceLock<Overlaps>>,
}

impl Scene {
    /// A scene from triangles in memory; those without area are counted and left out.
    ///
    /// # Panics
    /// If the lists differ in length or a material does not exist.
    pub fn new(
        triangles: Vec<Triangle>,
        material_of: Vec<MaterialId>,
        materials: Vec<Material>,
    ) -> Self {
        assert_eq!(triangles.len(), material_of.len(), "one material per triangle");
        let before = triangles.len();
        let (triangles, material_of): (Vec<_>, Vec<_>) =
            triangles.into_iter().zip(material_of).filter(|(t, _)| t.area() > 0.0).unzip();
        let degenerate = before - triangles.len();
        Scene { degenerate, ..Scene::plain(triangles.into(), material_of.into(), materials) }
    }

    fn plain(
        triangles: Arc<[Triangle]>,
        material_of: Arc<[MaterialId]>,
        materials: Vec<Material>,
    ) -> Self {
        assert!(material_of.iter().all(|m| (m.0 as usize) < materials.len()), "unknown material");
        Scene {
            degenerate: 0,
            triangles,
            material_of,
            back_of: Arc::default(),
            materials: materials.into(),
            textures: Arc::default(),
            mesh: Arc::default(),
            sky: Rgb::ZERO,
            background: Rgb::ZERO,
            up: Camera::USUAL_UP,
            origin: DVec3::ZERO,
            metres_per_unit: 1.0,
            views: Vec::new(),
            warnings: Vec::new(),
            files: Vec::new(),
            known_topology: Arc::default(),
            known_crowding: Arc::default(),
            known_overlaps: Arc::default(),
        }
    }

    /// The triangles of a model relative to an origin, without those that have no area.
    fn of_model(mut model: Model, origin: DVec3) -> Self {
        let positions = model.positions_from(origin);
        // Large models come near to filling the memory: nothing is kept longer than it is needed.
        model.positions = Vec::new();
        let triangle = |t: &[u32; 3]| Triangle { p: t.map(|corner| positions[corner as usize]) };
        let kept: Vec<bool> = model.triangles.iter().map(|t| triangle(t).area() > 0.0).collect();
        let degenerate = kept.iter().filter(|kept| !**kept).count();
        if degenerate > 0 {
            mesh::retain(&mut model.triangles, &kept);
            mesh::retain(&mut model.material_of, &kept);
            model.mesh.retain(&kept);
        }
        let triangles = model.triangles.iter().map(triangle).collect();
        Scene {
            degenerate,
            mesh: model.mesh.into(),
            textures: model.textures.into(),
            views: model.views,
            files: model.files,
            origin,
            known_topology: known(Topology::of_indexed(model.triangles, &positions)),
            ..Scene::plain(triangles, model.material_of.into(), model.materials)
        }
    }

    /// Reads the models that a description names, applies its material overrides, and checks that
    /// the result can be lit.
    ///
    /// # Errors
    /// Whatever is wrong with a file, or no triangle with an area, or coordinates so large or so
    /// small that f32 products would leave their range.
    pub fn load(description: &Document) -> Result<Scene> {
        let replaced = description.overridden_reflectances();
        let load = |path: &PathBuf| read::load(path, |name| replaced.contains(name));
        let models = description.models.iter().map(load).collect::<Result<Vec<Model>>>()?;
        let mut models = models.into_iter();
        let mut model = models.next().unwrap_or_default();
        (1..).zip(models).for_each(|(number, more)| model.append(number, more));
        let mut warnings = std::mem::take(&mut model.warnings);
        let origin = origin_of(&model.positions);
        if origin != DVec3::ZERO {
            warnings.push(Warning::new(format!(
                "the coordinates are large beside the scene's size: computed relative to {}, {}, {}, and given back as \
                 they are",
                origin.x, origin.y, origin.z
            )));
        }
        for material in &mut model.materials {
            // A format that knows sides says with them what emits, not what reflects.
            material.emits_on_back = material.two_sided;
            material.two_sided = !description.one_sided;
        }
        description.override_materials(&mut model.materials)?;

        let has_surroundings = model.has_surroundings;
        let (stated_up, usual_up) = (description.up.or(model.up), model.usual_up);
        let mut scene = Scene::of_model(model, origin);
        scene.up = stated_up.unwrap_or_else(|| upright::guess(&scene.triangles, origin, usual_up));
        let is_fitted = description.camera.is_none() && scene.views.is_empty();
        if is_fitted && stated_up.is_none() && scene.up != usual_up.unwrap_or(Camera::USUAL_UP) {
            warnings.push(upright::said(scene.up));
        }
        scene.metres_per_unit = description.metres_per_unit;
        if scene.degenerate > 0 {
            warnings.push(Warning::new(format!(
                "{} of {} triangles have no area and are left out",
                scene.degenerate,
                scene.degenerate + scene.triangles.len()
            )));
        }
        scene.warnings = warnings;
        scene.check_extent(&description.file)?;
        let mut scene = scene.merge_copies();
        let is_lit = match (description.names_lamps(), has_surroundings) {
            (true, _) => scene.emits(),
            // A model's visor or headlight glows, and lights nothing else.
            (false, true) => scene.emits_more_than(1.0) && scene.mean_emission() > SOME,
            (false, false) => scene.emits_more_than(FAINT),
        };
        scene.sky = description.sky.unwrap_or(if is_lit { Rgb::ZERO } else { Rgb::ONE });
        scene.background = scene.sky;
        if description.sky.is_none() && scene.sky != Rgb::ZERO {
            scene.background *= BEHIND_ASSUMED_SKY;
            scene.warnings.push(nothing_emits(&scene));
        }
        scene.warnings.extend(scene.overlap_warnings());
        scene.warnings.extend(scene.crowding_warning());
        Ok(scene)
    }

    /// The material of a triangle's front or back.
    pub fn material_on(&self, triangle: TriangleId, is_back: bool) -> MaterialId {
        self.own_back(triangle).filter(|_| is_back).unwrap_or(self.material_of[triangle.index()])
    }

    /// The material of a back that is not that of the front.
    pub fn own_back(&self, triangle: TriangleId) -> Option<MaterialId> {
        self.back_of.get(triangle.index()).copied().flatten()
    }

    /// The radiance that a triangle's front or back emits, where no texture makes it vary.
    pub fn radiance_on(&self, triangle: TriangleId, is_back: bool) -> Rgb {
        let material = &self.materials[self.material_on(triangle, is_back).0 as usize];
        material.radiance_of(is_back && self.own_back(triangle).is_none())
    }

    pub fn material(&self, triangle: TriangleId) -> &Material {
        &self.materials[self.material_of[triangle.index()].0 as usize]
    }

    /// Which triangles share vertices and edges. It is computed once, then shared by all clones, so
    /// change the triangles only before the first call.
    pub fn topology(&self) -> &Topology {
        self.known_topology.get_or_init(|| Topology::new(&self.triangles))
    }

    pub fn bounds(&self) -> Bounds {
        self.triangles.iter().flat_map(|t| t.p).collect()
    }

    /// Sum of the triangles' areas, in square units.
    pub fn area(&self) -> f64 {
        self.triangles.iter().map(Triangle::area).sum()
    }

    /// Whether any triangle emits light.
    pub fn emits(&self) -> bool {
        self.used_materials().any(Material::emits)
    }

    /// Whether any triangle emits more than this radiance.
    fn emits_more_than(&self, radiance: f32) -> bool {
        self.used_materials().any(|material| material.radiance.max_element() > radiance)
    }

    /// The mean over the area of what the triangles emit, by the largest channel.
    fn mean_emission(&self) -> f64 {
        let emitted = |triangle: u32| {
            let id = TriangleId(triangle);
            let sides = [false, true].map(|is_back| self.radiance_on(id, is_back).max_element());
            f64::from(sides[0].max(sides[1])) * self.triangles[id.index()].area()
        };
        (0..self.triangles.len() as u32).map(emitted).sum::<f64>() / self.area()
    }

    /// The materials of fronts and backs, triangle by triangle.
    fn used_materials(&self) -> impl Iterator<Item = &Material> {
        let used = self.material_of.iter().chain(self.back_of.iter().flatten());
        used.map(|material| &self.materials[material.0 as usize])
    }

    /// Makes one sheet of triangles that lie exactly where others do.
    fn merge_copies(mut self) -> Scene {
        let Some(sheets) = coincident::find(self.topology(), &self.material_of) else {
            return self;
        };
        self.warnings.push(Warning::new(format!(
            "{} triangles lie exactly where others do: {} are taken as the backs of these, {} are left out",
            sheets.backs + sheets.equal,
            sheets.backs,
            sheets.equal
        )));
        self.known_topology = known(self.topology().without_copies(&sheets.kept));
        self.known_overlaps = Arc::default();
        self.triangles = of_kept(&self.triangles, &sheets.kept);
        self.material_of = of_kept(&self.material_of, &sheets.kept);
        self.back_of = sheets.back_of.into();
        Arc::make_mut(&mut self.mesh).retain(&sheets.kept);
        self
    }

    /// A kernel multiplies three lengths, so their cubes must be normal f32 numbers.
    pub(crate) fn check_extent(&self, file: &Path) -> Result<()> {
        if self.triangles.is_empty() {
            return Err(Error::new("the scene has no triangle with an area above zero")
                .in_file(file)
                .remedy("check the model's faces; `isolux info` counts what was found"));
        }
        let edges = self.triangles.par_iter().map(Triangle::longest_edge);
        let largest = edges.reduce(|| 0.0, f64::max);
        if !(1e-9..=1e12).contains(&largest) {
            return Err(Error::new(format!(
                "the longest edge is {largest:e} units, outside 1e-9 to 1e12"
            ))
            .in_file(file)
            .remedy("rescale the model; single precision cannot trace it"));
        }
        self.check_distance(file)
    }

    /// Far from the origin f32 has no digits left for the scene: rays are lifted off surfaces by 2⁻¹⁸
    /// of the largest coordinate, which must stay small beside the scene itself.
    fn check_distance(&self, file: &Path) -> Result<()> {
        let bounds = self.bounds();
        let away = bounds.min.abs().max(bounds.max.abs()).max_element();
        let ratio = away / bounds.diagonal().max_element();
        if ratio > 1000.0 {
            return Err(Error::new(format!(
                "the scene lies {ratio:.0} times its own size away from the origin"
            ))
            .in_file(file)
            .remedy("move the model towards the origin: single precision cannot trace it there"));
        }
        Ok(())
    }
}

/// What emits no more than this was not made to light other things: modellers let a surface glow a little so that
/// it stands out.
const FAINT: f32 = 0.2;

/// Lamps that emit less, on average over all surfaces, light a model by a tenth of what the sky would, at most.
const SOME: f64 = 0.1;

/// Before a sky that nobody asked for, what is white would not be seen: it is drawn this dark.
const BEHIND_ASSUMED_SKY: f32 = 0.1;

/// Says where the light comes from, and how to have another.
fn nothing_emits(scene: &Scene) -> Warning {
    let used = |material: usize| scene.material_of.iter().any(|m| m.0 as usize == material);
    let mut lamps =
        scene.materials.iter().enumerate().filter(|(i, m)| looks_like_lamp(m) && used(*i));
    let example = match lamps.next() {
        Some((_, lamp)) => {
            let name = text::quote(&lamp.name);
            format!(
                "; the material {name} looks like a lamp: --emit '{}=10'",
                lamp.name.escape_debug()
            )
        }
        None => "; or let a material shine: --emit MATERIAL=RADIANCE".to_string(),
    };
    let why = match scene.emits() {
        true => "what glows in the scene is too faint to be a lamp",
        false => "nothing in the scene emits light",
    };
    Warning::new(format!("{why}, so a sky of radiance 1 lights it (another: --sky){example}"))
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

/// A topology that need not be found again.
fn known(topology: Topology) -> Arc<OnceLock<Topology>> {
    Arc::new(OnceLock::from(topology))
}

/// The items that are `kept`, copied once: the length of the list is known before.
fn of_kept<T: Copy>(items: &[T], kept: &[bool]) -> Arc<[T]> {
    let numbers: Vec<usize> = (0..items.len()).filter(|number| kept[*number]).collect();
    numbers.iter().map(|number| items[*number]).collect()
}

/// A round place near models that lie far from the origin, compared with their own size; else zero.
fn origin_of(positions: &[DVec3]) -> DVec3 {
    let extremes = (DVec3::MAX, DVec3::MIN);
    let (min, max) = positions.iter().fold(extremes, |(a, b), p| (a.min(*p), b.max(*p)));
    let (size, away) = ((max - min).max_element(), min.abs().max(max.abs()).max_element());
    if !(size > 0.0 && away > FAR * size) {
        return DVec3::ZERO;
    }
    // Ten to thirty times the size: with a round number the file's decimals stay what they are.
    let step = 10f64.powf((10.0 * size).log10().ceil());
    // Adding zero makes −0 equal to 0.
    (0.5 * (min + max) / step).round() * step + DVec3::ZERO
}

/// Times its own size: farther away from the origin a scene is moved.
const FAR: f64 = 64.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_without_area_are_counted_and_left_out() {
        let good = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
        let line = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::X * 3.0);
        let scene =
            Scene::new(vec![line, good, line], vec![MaterialId(0); 3], vec![Material::fallback()]);
        assert_eq!(*scene.triangles, [good]);
        assert_eq!(scene.degenerate, 2);
    }

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
    fn clones_share_one_topology() {
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
        let scene = Scene::new(vec![triangle], vec![MaterialId(0)], vec![Material::fallback()]);
        let clone = scene.clone();
        assert_eq!(scene.topology().open_edges(), 3);
        assert!(std::ptr::eq(scene.topology(), clone.topology()));
    }

    #[test]
    fn a_loaded_scene_knows_its_faces_also_after_it_was_saved() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.obj");
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 1 0\no lid\nf 1 2 2\nf 1/1 2/1 3\n";
        std::fs::write(&file, text).unwrap();
        let scene = Scene::load(&Document::open(&file).unwrap()).unwrap();
        let bytes = postcard::to_stdvec(&scene).unwrap();
        let read: Scene = postcard::from_bytes(&bytes).unwrap();
        assert_eq!((read.mesh.origins[0].face, read.degenerate), (2, 1));
        assert_eq!(read.mesh.part_of(TriangleId(0)).unwrap().object.as_deref(), Some("lid"));
        assert_eq!(read.mesh.texture.as_ref().unwrap().numbers, [[1, 1, 0]]);
        assert_eq!(*read.mesh, *scene.mesh);
    }

    #[test]
    fn the_mean_emission_is_that_of_the_area_and_of_the_brighter_side() {
        let at = |size: f32| Triangle::new(Vec3::ZERO, Vec3::X * size, Vec3::Y);
        let material = |radiance| Material { radiance, ..Material::fallback() };
        let materials = [Rgb::ZERO, Rgb::new(1.0, 8.0, 2.0)].map(material);
        let scene =
            Scene::new(vec![at(3.0), at(1.0)], [0, 1].map(MaterialId).to_vec(), materials.to_vec());
        assert!((scene.mean_emission() - 2.0).abs() < 1e-6);
        assert!(scene.emits_more_than(7.0) && !scene.emits_more_than(8.0));
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
