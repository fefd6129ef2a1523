//! The scene: triangles, materials, and what a description file says about looking at them.

mod assumed_sky;
mod beside;
mod bins;
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
mod main_part;
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
mod sums;
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
use sums::sum;
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
            triangles.into_iter().zip(material_of).filter(|(t, _)| t.has_area()).unzip();
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

    /// The triangles of a model relative to an origin, without those that have no area; those that lie exactly where
    /// others do are one sheet with these. The warnings say so.
    fn of_model(mut model: Model, origin: DVec3) -> (Self, Vec<Warning>) {
        let mut warnings = Vec::new();
        let positions = model.positions_from(origin);
        // Large models come near to filling the memory: nothing is kept longer than it is needed.
        model.positions = Vec::new();
        let triangle = |t: &[u32; 3]| Triangle { p: t.map(|corner| positions[corner as usize]) };
        let has_area: Vec<bool> =
            model.triangles.par_iter().map(|t| triangle(t).has_area()).collect();
        let degenerate = has_area.iter().filter(|has_area| !**has_area).count();
        if degenerate > 0 {
            let before = has_area.len();
            warnings.push(Warning::new(format!(
                "{degenerate} of {before} triangles have no area and are left out"
            )));
            model.retain(&has_area);
        }
        let mut topology = Topology::of_indexed(&model.triangles, &positions);
        let mut back_of = Arc::default();
        if let Some(sheets) = coincident::find(&topology, &model.material_of) {
            warnings.push(sheets.warning());
            topology = topology.without_copies(&sheets.kept);
            model.retain(&sheets.kept);
            back_of = sheets.back_of.into();
        }
        let triangles = model.triangles.iter().map(triangle).collect();
        let scene = Scene {
            degenerate,
            back_of,
            mesh: model.mesh.into(),
            textures: model.textures.into(),
            views: model.views,
            files: model.files,
            origin,
            known_topology: Arc::new(OnceLock::from(topology)),
            ..Scene::plain(triangles, model.material_of.into(), model.materials)
        };
        (scene, warnings)
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
        let (mut scene, of_triangles) = Scene::of_model(model, origin);
        scene.up = stated_up.unwrap_or_else(|| upright::guess(&scene.triangles, origin, usual_up));
        let is_fitted = description.camera.is_none() && scene.views.is_empty();
        let is_usual = scene.up == Camera::USUAL_UP && usual_up.is_none_or(|up| up == scene.up);
        if is_fitted && stated_up.is_none() && !is_usual {
            warnings.push(upright::said(scene.up));
        }
        scene.metres_per_unit = description.metres_per_unit;
        warnings.extend(of_triangles);
        scene.warnings = warnings;
        scene.check_extent(&description.file)?;
        scene.set_sky(description, has_surroundings);
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
        let blocks = self.triangles.par_chunks(sums::BLOCK);
        let around =
            |block: &[Triangle]| block.iter().fold(Bounds::EMPTY, |all, t| all.with(&t.bounds()));
        let bounds: Vec<Bounds> = blocks.map(around).collect();
        bounds.iter().fold(Bounds::EMPTY, Bounds::with)
    }

    /// Sum of the triangles' areas, in square units.
    pub fn area(&self) -> f64 {
        sum(self.triangles.len(), |number| self.triangles[number].area())
    }

    /// Whether any triangle emits light.
    pub fn emits(&self) -> bool {
        self.used_materials().any(Material::emits)
    }

    /// The materials of fronts and backs.
    fn used_materials(&self) -> impl Iterator<Item = &Material> {
        let mut is_used = vec![false; self.materials.len()];
        let sides = self.material_of.iter().chain(self.back_of.iter().flatten());
        sides.for_each(|material| is_used[material.0 as usize] = true);
        self.materials.iter().zip(is_used).filter(|(_, is_used)| *is_used).map(|(m, _)| m)
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
    fn copies_do_not_turn_a_model_and_warnings_keep_their_order() {
        // A cube away from the origin, and a triangle without area; then two of its sides once more.
        let cube = "v 5 5 5\nv 5 5 6\nv 5 6 5\nv 5 6 6\nv 6 5 5\nv 6 5 6\nv 6 6 5\nv 6 6 6\n\
                    f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\nf 1 1 2\n";
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.obj");
        let load = |text: &str| {
            std::fs::write(&file, text).unwrap();
            Scene::load(&Document::open(&file).unwrap()).unwrap()
        };
        let (once, twice) = (load(cube), load(&format!("{cube}f 5 7 3 1\nf 4 8 6 2\n")));
        assert_eq!((once.up, twice.up), (Vec3::Y, Vec3::Y));
        assert_eq!(once.triangles, twice.triangles);
        let kinds = ["default material", "have no area", "exactly where others do", "emits light"];
        let said: Vec<String> = twice.warnings.iter().map(ToString::to_string).collect();
        assert_eq!(said.len(), kinds.len(), "{said:?}");
        assert!(said.iter().zip(kinds).all(|(said, kind)| said.contains(kind)), "{said:?}");
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
}
