//! The light of a scene: solved once, kept whole, and looked at as often as one likes.
//!
//! Radiosity does not depend on the view. So a [`Solution`] owns everything that a picture needs: the
//! scene, the subdivision, the irradiance of each patch. Saved, it is a `.light` file, which gives the same bits
//! on every machine.

use crate::balance::Misfit;
use crate::certificate::Certificate;
use crate::color::{Rgb, luminance};
use crate::error::{Error, Result};
use crate::export::file::{Inputs, Output, write_all};
use crate::export::sealed::{Seal, fingerprint};
use crate::geometry::RayCaster;
use crate::known::known;
use crate::patches::{PatchId, PatchMesh, Sides, Split};
use crate::progress::Progress;
use crate::radiosity::{Choices, Energy, Radiosity};
use crate::render::{Image, tone};
use crate::scene::camera::is_view_name;
use crate::scene::document::ImageDefaults;
use crate::scene::{Camera, Document, Scene, Texture, is_radiance};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The light of a scene, with the scene.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Solution {
    pub title: String,
    scene: Scene,
    split: Split,
    /// The sides of each triangle that have patches.
    sides: Vec<Sides>,
    pub(crate) light: PatchLight,
    pub figures: Figures,
    /// How the light was solved.
    pub choices: Choices,
    /// The view that is drawn unless another is asked for.
    pub camera: Camera,
    /// The document's further views by name.
    pub views: BTreeMap<String, Camera>,
    /// The document's defaults for a picture.
    pub image: ImageDefaults,
    /// Filled by the first call of [`patches`](Self::patches), and shared by all clones.
    #[serde(skip)]
    known_patches: Arc<OnceLock<Arc<PatchMesh>>>,
}

/// The light of each patch, in the order of the patches.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct PatchLight {
    /// H in W·m⁻².
    pub irradiance: Vec<Rgb>,
    /// The standard error of the luminance of H, in W·m⁻²; empty where it is not known.
    pub error: Vec<f32>,
    /// The uncovered share of the area, in [0, 1]; see `coverage`.
    pub uncovered: Vec<f32>,
}

/// How well the light was solved, and where its power went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// The relative residual after each iteration; see [`Radiosity::residuals`].
    pub residuals: Vec<f64>,
    /// Sweeps, or shots.
    pub iterations: u64,
    /// The largest |Σ_j F_ij − 1|.
    pub row_sum_defect: f64,
    /// Σ A |Σ_j F_ij − 1| / Σ A.
    pub mean_row_sum_defect: f64,
    /// See [`Radiosity::reciprocity_defect`].
    pub reciprocity_defect: Option<f64>,
    pub energy: Energy,
    /// How far the power may fail to balance.
    pub misfit: Misfit,
    /// Rays traced for the light.
    pub rays: u64,
    /// `None` where nothing is reflected, or where parts were joined by the library and not by `isolux join`.
    pub certificate: Option<Certificate>,
}

/// The certificate's numbers are not those of the solution.
const CERTIFICATE: u64 = 0x6365_7274;

const SEAL: Seal = Seal {
    magic: b"isolux light\n",
    version: 6,
    name: "light file",
    command: "isolux solve SCENE -o ROOM.light",
};

impl Solution {
    /// Keeps the light that was found for a scene.
    ///
    /// # Panics
    /// If a list has another length than the mesh.
    pub fn new(
        document: &Document,
        mesh: &Arc<PatchMesh>,
        choices: &Choices,
        (light, figures): (PatchLight, Figures),
        camera: Camera,
    ) -> Solution {
        assert!(light.is_of(mesh.len()), "light of other patches");
        let unlit = Solution::unlit(document, mesh, choices, figures, camera);
        Solution { light, ..unlit }
    }

    /// A solution whose light is still to come.
    pub(crate) fn unlit(
        document: &Document,
        mesh: &Arc<PatchMesh>,
        choices: &Choices,
        figures: Figures,
        camera: Camera,
    ) -> Solution {
        Solution {
            title: document.title.clone(),
            scene: mesh.scene.clone(),
            split: mesh.split(),
            sides: mesh.sides_of_triangles(),
            light: PatchLight::default(),
            figures,
            choices: *choices,
            camera,
            views: views_of(document, &mesh.scene),
            image: document.image.clone(),
            known_patches: Arc::new(mesh.clone().into()),
        }
    }

    /// Two numbers to tell solutions apart: one of the scene and its patches, one of the choices of
    /// method. Equal scenes have equal numbers on every machine; others have them once in 2³² cases.
    pub fn fingerprints(&self) -> [u32; 2] {
        [fingerprint(&(&self.scene, &self.split, &self.sides)), fingerprint(&self.choices)]
    }

    /// Works out how far the light is from the truth, at most: see [`Figures::certificate`]. Returns the rays that it
    /// took. `caster` must know the scene's triangles.
    pub(crate) fn certify(&mut self, caster: &dyn RayCaster, progress: &dyn Progress) -> u64 {
        let seed = self.choices.seed ^ CERTIFICATE;
        let mesh = self.patches();
        let (certificate, rays) =
            Certificate::of(caster, &mesh, self.irradiance(), self.uncovered(), seed, progress);
        self.figures.certificate = certificate;
        rays
    }

    /// The view of this name.
    ///
    /// # Errors
    /// A name that no view has.
    pub fn view(&self, name: &str) -> Result<&Camera> {
        view_of(&self.views, name)
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The scene's patches, numbered as the irradiance is.
    pub fn patches(&self) -> Arc<PatchMesh> {
        let make =
            || PatchMesh::new(&self.scene, &self.split, &self.sides).expect("they were checked");
        known(&self.known_patches, || make().into()).clone()
    }

    /// H in W·m⁻², per patch.
    pub fn irradiance(&self) -> &[Rgb] {
        &self.light.irradiance
    }

    /// The standard error of the luminance of H, in W·m⁻², per patch, where it is known.
    pub fn error(&self) -> Option<&[f32]> {
        Some(&*self.light.error).filter(|errors| errors.len() == self.light.irradiance.len())
    }

    /// The root mean square of the patches' standard errors over their area, relative to that of their irradiance;
    /// `None` where they are not known, or all is dark.
    pub fn relative_error(&self) -> Option<f32> {
        let (errors, mesh) = (self.error()?, self.patches());
        let (mut error, mut light) = (0.0, 0.0);
        for (i, (irradiance, of_patch)) in self.irradiance().iter().zip(errors).enumerate() {
            let area = mesh.area(PatchId(i as u32));
            error += area * f64::from(*of_patch).powi(2);
            light += area * f64::from(luminance(*irradiance)).powi(2);
        }
        (light > 0.0).then(|| (error / light).sqrt() as f32)
    }

    /// The share of each patch's area, in [0, 1], that no other surface covers.
    pub fn uncovered(&self) -> &[f32] {
        &self.light.uncovered
    }

    /// The factor from radiance to display with which a picture is neither dark nor burnt out.
    pub fn exposure(&self, image: &Image) -> f32 {
        self.common_exposure(&[image])
    }

    /// One factor for several pictures.
    pub fn common_exposure(&self, images: &[&Image]) -> f32 {
        self.image.exposure.unwrap_or_else(|| tone::automatic_exposure(images))
    }

    /// Writes a `.light` file, whole or not at all.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let output = Output { path: path.as_ref().to_path_buf(), bytes: self.to_bytes() };
        write_all(vec![output], &Inputs::default())
    }

    /// The bytes of a `.light` file.
    pub fn to_bytes(&self) -> Vec<u8> {
        SEAL.close(self)
    }

    /// Reads what [`Solution::to_bytes`] made.
    ///
    /// # Errors
    /// Bytes of something else, of another version, or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Solution> {
        let solution: Solution = SEAL.open(bytes)?;
        solution.check().map(|()| solution)
    }

    /// # Errors
    /// See [`Solution::from_bytes`]; or a file that cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<Solution> {
        let path = path.as_ref();
        Solution::from_bytes(&SEAL.read(path)?).map_err(|error| error.in_file(path))
    }

    /// A checksum finds damage, not a forger: what no scene and no light can be is refused.
    pub(crate) fn check(&self) -> Result<()> {
        let scene = &self.scene;
        let lists_fit = scene.material_of.len() == scene.triangles.len()
            && scene.material_of.iter().all(|m| (m.0 as usize) < scene.materials.len())
            && (scene.back_of.is_empty() || scene.back_of.len() == scene.triangles.len())
            && scene.back_of.iter().flatten().all(|m| (m.0 as usize) < scene.materials.len())
            && scene.mesh.fits(scene.triangles.len())
            && scene.triangles.iter().all(|t| t.area() > 0.0 && t.area().is_finite());
        if !lists_fit {
            return Err(SEAL.contradiction());
        }
        if self.split.cube.is_some_and(|edge| !(edge > 0.0 && edge.is_finite())) {
            return Err(SEAL.contradiction());
        }
        let is_share = |c: &Rgb| c.cmpge(Rgb::ZERO).all() && c.cmple(Rgb::ONE).all();
        let means_something = self.light.is_possible()
            && scene.textures.iter().all(Texture::is_possible)
            && scene.materials.iter().all(|m| m.is_possible(scene.textures.len()))
            && [scene.sky, scene.background].into_iter().all(is_radiance)
            && scene.mesh.colors.iter().flat_map(|c| &c.values).all(is_share)
            && (1e-30..=1e30).contains(&scene.metres_per_unit)
            && std::iter::once(&self.camera).chain(self.views.values()).all(Camera::is_possible)
            && self.views.keys().all(|name| is_view_name(name));
        if !means_something {
            return Err(SEAL.contradiction());
        }
        // Counted before any patch is made; clusters have to be made to be counted, of a scene that is known to be
        // possible.
        let mut patches = PatchMesh::most(scene, &self.split, &self.sides)?;
        if self.split.cube.is_some() {
            patches = self.patches().len();
        }
        if !self.light.is_of(patches) {
            return Err(SEAL.contradiction());
        }
        self.image.check()?;
        scene.check_extent(Path::new(&self.title))
    }
}

impl PatchLight {
    pub(crate) fn is_of(&self, patches: usize) -> bool {
        let lengths = [self.irradiance.len(), self.uncovered.len()];
        lengths == [patches; 2] && [0, patches].contains(&self.error.len())
    }

    pub(crate) fn is_possible(&self) -> bool {
        let is_light = |h: &Rgb| h.is_finite() && h.cmpge(Rgb::ZERO).all();
        self.irradiance.iter().all(is_light)
            && self.error.iter().all(|error| (0.0..=f32::MAX).contains(error))
            && self.uncovered.iter().all(|share| (0.0..=1.0).contains(share))
    }
}

impl Figures {
    /// What the solver says of its light.
    pub fn of(light: &Radiosity) -> Figures {
        Figures {
            residuals: light.residuals.clone(),
            iterations: light.iterations as u64,
            row_sum_defect: light.row_sum_defect,
            mean_row_sum_defect: light.mean_row_sum_defect,
            reciprocity_defect: light.reciprocity_defect,
            energy: light.energy,
            misfit: light.misfit,
            rays: light.rays,
            certificate: None,
        }
    }
}

/// Those of the model files, and those of the document, which replace files' with their name.
pub(crate) fn views_of(document: &Document, scene: &Scene) -> BTreeMap<String, Camera> {
    scene.views.iter().cloned().chain(document.views.clone()).collect()
}

pub(crate) fn view_of<'v>(views: &'v BTreeMap<String, Camera>, name: &str) -> Result<&'v Camera> {
    views.get(name).ok_or_else(|| {
        let known: Vec<&str> = views.keys().map(String::as_str).collect();
        let error = Error::new(format!("no view has the name {name}"));
        if known.is_empty() {
            error.remedy("describe it as [views.NAME] in the scene's description")
        } else {
            error.remedy(format!("there are: {}", known.join(", ")))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{Rgb64, rounded};
    use crate::geometry::Triangle;
    use crate::patches::Subdivision;
    use crate::scene::{Map, Material, MaterialId, TextureId};
    use crate::settings::Settings;
    use glam::Vec3;
    use std::time::Duration;

    fn solution() -> Solution {
        let triangle = Triangle::new(Vec3::ZERO, Vec3::X, Vec3::Y);
        let scene = Scene::new(vec![triangle], vec![MaterialId(0)], vec![Material::fallback()]);
        let mesh = PatchMesh::subdivide(&scene, Subdivision::Levels(2)).expect("patches");
        let mesh = Arc::new(mesh);
        let light = Radiosity {
            radiosity: vec![Rgb64::ONE; 16],
            irradiance: (0..16).map(|i| Rgb64::splat(1.0 / (1.0 + i as f64))).collect(),
            error: vec![0.1; 16],
            residuals: vec![0.5, 1e-5],
            iterations: 2,
            row_sum_defect: 1.0,
            mean_row_sum_defect: 0.5,
            reciprocity_defect: None,
            energy: Energy {
                emitted: Rgb64::ONE,
                from_sky: Rgb64::ZERO,
                absorbed: Rgb64::ZERO,
                on_backs: None,
                escaped: Rgb64::ONE,
            },
            misfit: Misfit { samples: Some(0.01), iterations: 1e-4 },
            rays: 7,
            transport_time: Duration::ZERO,
            solve_time: Duration::ZERO,
        };
        let camera = Camera::new(Vec3::Z, Vec3::ZERO, Vec3::Y, 40.0, 0.0).expect("a camera");
        let figures = Figures::of(&light);
        let light = PatchLight {
            irradiance: rounded(&light.irradiance),
            error: vec![0.1; 16],
            uncovered: vec![1.0; 16],
        };
        let document = Document::open("one.obj").expect("a name is enough");
        let choices = Choices::new(&Settings::default(), &scene).expect("the defaults");
        Solution {
            choices: Choices { memory_limit: None, ..choices },
            ..Solution::new(&document, &mesh, &choices, (light, figures), camera)
        }
    }

    #[test]
    fn a_solution_comes_back_to_the_bit() {
        let solution = solution();
        let back = Solution::from_bytes(&solution.to_bytes()).expect("a solution");
        assert_eq!(back.to_bytes(), solution.to_bytes());
        assert_eq!(back.light, solution.light);
        assert_eq!(back.figures, solution.figures);
        assert_eq!(back.choices, solution.choices);
        assert_eq!(back.fingerprints(), solution.fingerprints());
        assert_eq!(back.patches().len(), 16);
    }

    #[test]
    fn every_changed_bit_and_every_cut_is_refused() {
        let bytes = solution().to_bytes();
        for i in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[i] ^= 1 << (i % 8);
            assert!(Solution::from_bytes(&changed).is_err(), "byte {i}");
            assert!(Solution::from_bytes(&bytes[..i]).is_err(), "cut at {i}");
        }
        assert!(Solution::from_bytes(&[&bytes[..], b"x"].concat()).is_err());
    }

    #[test]
    fn a_well_formed_contradiction_is_refused() {
        let good = solution();
        let refused = |solution: Solution, why: &str| {
            let error = Solution::from_bytes(&solution.to_bytes()).expect_err(why).to_string();
            assert!(error.contains(why), "{error}");
        };
        let itself = "contradicts itself";
        let split = |levels| Split { levels, cube: None };
        refused(Solution { split: split(vec![]), ..good.clone() }, "0 levels of subdivision");
        refused(Solution { split: split(vec![3]), ..good.clone() }, itself);
        refused(Solution { split: split(vec![u32::MAX]), ..good.clone() }, "4294967295 levels");
        let light = |change: fn(&mut PatchLight)| {
            let mut light = good.light.clone();
            change(&mut light);
            Solution { light, ..good.clone() }
        };
        refused(light(|l| l.uncovered = vec![]), itself);
        refused(light(|l| l.uncovered = vec![f32::NAN; 16]), itself);
        refused(light(|l| l.irradiance = vec![-Rgb::ONE; 16]), itself);
        refused(light(|l| l.error = vec![0.0; 15]), itself);
        refused(light(|l| l.error = vec![-1.0; 16]), itself);
        refused(light(|l| l.error = vec![f32::INFINITY; 16]), itself);
        let unknown = light(|l| l.error = vec![]);
        let back = Solution::from_bytes(&unknown.to_bytes()).expect("an error need not be known");
        assert_eq!((good.error().map(<[f32]>::len), back.error()), (Some(16), None));
        let views = [("../x".to_string(), good.camera.clone())].into();
        refused(Solution { views, ..good.clone() }, itself);
        let scene = |change: fn(&mut Scene)| {
            let mut scene = good.scene.clone();
            change(&mut scene);
            Solution { scene, ..good.clone() }
        };
        refused(scene(|s| s.material_of = [MaterialId(9)].into()), itself);
        refused(scene(|s| s.metres_per_unit = f64::NAN), itself);
        refused(scene(|s| s.sky = Rgb::new(1.0, 1.0, f32::NAN)), itself);
        refused(scene(|s| s.background = -Rgb::ONE), itself);
        refused(
            scene(|s| s.triangles = [Triangle::new(Vec3::ZERO, Vec3::X, Vec3::X)].into()),
            itself,
        );
        let too_bright = Material { reflectance: Vec3::splat(f32::NAN), ..Material::fallback() };
        let materials = [too_bright].into();
        refused(
            Solution { scene: Scene { materials, ..good.scene.clone() }, ..good.clone() },
            itself,
        );
        let too_bright = Material { radiance: Vec3::splat(3e38), ..Material::fallback() };
        let materials = [too_bright].into();
        refused(
            Solution { scene: Scene { materials, ..good.scene.clone() }, ..good.clone() },
            itself,
        );
        let map = Map { texture: TextureId(0), transform: glam::Affine2::IDENTITY };
        let mapped = Material { reflectance_map: Some(map), ..Material::fallback() };
        for cube in [None, Some(0.5)] {
            let materials = [mapped.clone()].into();
            let (scene, known_patches) =
                (Scene { materials, ..good.scene.clone() }, Arc::default());
            let split = Split { levels: vec![2], cube };
            refused(Solution { scene, split, known_patches, ..good.clone() }, itself);
        }
        let mut texture = Texture::new("x".into(), [1, 1], [[0; 4]].into(), Default::default());
        texture.width = 2;
        let textures = [texture].into();
        refused(
            Solution { scene: Scene { textures, ..good.scene.clone() }, ..good.clone() },
            itself,
        );
        refused(
            scene(|s| s.triangles = s.triangles.iter().map(|t| far(*t)).collect()),
            "away from the origin",
        );
    }

    fn far(triangle: Triangle) -> Triangle {
        Triangle { p: triangle.p.map(|p| p + 1e5) }
    }
}
