//! The TOML description of a scene: its models, its camera, and defaults for the picture.

use super::camera::is_view_name;
use super::formats::is_model;
use super::material::is_radiance;
use super::overrides::{MaterialOverride, change_matching};
use super::read::refusal;
use super::text::{Format, decode, read_text_bytes, unread};
use super::{Camera, Material, Scene};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::settings::{LightSettings, MAX_SAMPLES, PatchSettings};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

/// The most pixels along a side of a picture.
pub const MAX_SIZE: u32 = 1 << 16;

/// The content of a description file. A bare model is a description that says only its name.
#[derive(Debug, Clone)]
pub struct Document {
    /// The description file, or the bare model.
    pub file: PathBuf,
    pub title: String,
    /// At least one model, with the description's folder put before relative names.
    pub models: Vec<PathBuf>,
    pub metres_per_unit: f64,
    /// `None`: to be fitted to the scene.
    pub camera: Option<Camera>,
    /// Further views by name; a name may stand in a file's name.
    pub views: BTreeMap<String, Camera>,
    pub image: ImageDefaults,
    pub patches: PatchSettings,
    pub light: LightSettings,
    /// Radiance of the sky in W·sr⁻¹·m⁻². `None`: 1 if nothing else shines, else no sky.
    pub sky: Option<Rgb>,
    /// The direction that is up for a fitted camera. `None`: as the model's format says, or a guess.
    pub up: Option<Vec3>,
    /// Whether surfaces reflect on their fronts alone.
    pub one_sided: bool,
    /// Radiances that replace those of materials, in this order; a name may end in `*`.
    pub emissions: Vec<(String, Rgb)>,
    materials: BTreeMap<String, MaterialOverride>,
}

/// Defaults that command-line flags override.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageDefaults {
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
    /// Samples per pixel.
    pub samples: Option<u32>,
    /// Factor from radiance to display-linear values; 1 is white.
    pub exposure: Option<f32>,
}

impl ImageDefaults {
    pub(crate) fn check(&self) -> Result<()> {
        if self.size.is_some_and(|size| size.iter().any(|n| !(1..=MAX_SIZE).contains(n))) {
            return Err(Error::new("[image]: size is outside 1 to 65536 pixels")
                .remedy("640 x 480 is usual: size = [640, 480]"));
        }
        if self.samples.is_some_and(|n| !(1..=MAX_SAMPLES).contains(&n)) {
            return Err(
                Error::new("[image]: samples is outside 1 to 1048576").remedy("16 is usual")
            );
        }
        if self.exposure.is_some_and(|x| !(x > 0.0 && x.is_finite())) {
            return Err(Error::new("[image]: exposure is not a number above zero")
                .remedy("leave it out for an automatic one"));
        }
        Ok(())
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    title: Option<String>,
    models: Vec<PathBuf>,
    metres_per_unit: Option<f64>,
    camera: Option<CameraTable>,
    #[serde(default)]
    views: BTreeMap<String, CameraTable>,
    #[serde(default)]
    image: ImageDefaults,
    #[serde(default)]
    patches: PatchSettings,
    #[serde(default)]
    light: LightSettings,
    sky: Option<GreyOrRgb>,
    up: Option<Up>,
    #[serde(default)]
    one_sided: bool,
    #[serde(default)]
    materials: BTreeMap<String, MaterialOverride>,
}

/// A colour, or one number for all channels.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum GreyOrRgb {
    Grey(f32),
    Rgb([f32; 3]),
}

impl GreyOrRgb {
    fn rgb(self) -> Rgb {
        match self {
            GreyOrRgb::Grey(x) => Rgb::splat(x),
            GreyOrRgb::Rgb(rgb) => Rgb::from(rgb),
        }
    }
}

/// The axis that points up.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Up {
    X,
    Y,
    Z,
}

impl Up {
    fn direction(self) -> Vec3 {
        match self {
            Up::X => Vec3::X,
            Up::Y => Vec3::Y,
            Up::Z => Vec3::Z,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraTable {
    position: [f64; 3],
    look_at: [f64; 3],
    #[serde(default = "up")]
    up: Vec3Array,
    #[serde(default = "vertical_fov")]
    vertical_fov: f32,
    #[serde(default)]
    near: f32,
}

type Vec3Array = [f32; 3];

fn up() -> Vec3Array {
    Camera::USUAL_UP.to_array()
}

fn vertical_fov() -> f32 {
    Camera::USUAL_FOV
}

impl CameraTable {
    fn camera(self) -> Result<Camera> {
        let [position, look_at] = [self.position, self.look_at].map(DVec3::from);
        Camera::new(position, look_at, Vec3::from(self.up), self.vertical_fov, self.near)
    }
}

fn view((name, table): (String, CameraTable)) -> Result<(String, Camera)> {
    if !is_view_name(&name) {
        return Err(Error::new(format!("[views]: {name:?} cannot be part of a file's name"))
            .remedy("use letters, digits, - and _"));
    }
    Ok((name, table.camera()?))
}

impl Document {
    /// The files that were named: an output must be none of them.
    pub fn inputs(&self) -> Vec<&Path> {
        // Those that the models name in turn are in `Scene::files`, once it is loaded.
        let models = self.models.iter().map(PathBuf::as_path);
        std::iter::once(self.file.as_path()).chain(models).collect()
    }

    /// Reads the models: see [`Scene::load`].
    ///
    /// # Errors
    /// See [`Scene::load`].
    pub fn scene(&self) -> Result<Scene> {
        Scene::load(self)
    }

    /// Reads a `.toml` description, or makes one for a bare model.
    ///
    /// # Errors
    /// A file that cannot be read, a name with another ending, TOML that is malformed or says
    /// something unknown (with its line), values out of their ranges.
    pub fn open(path: impl AsRef<Path>) -> Result<Document> {
        let path = path.as_ref();
        let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match extension.as_deref() {
            Some("toml") => Document::read(path),
            _ if is_model(path) => Ok(Document::bare(path)),
            _ => Err(refusal(path)),
        }
    }

    fn bare(model: &Path) -> Document {
        Document {
            file: model.to_path_buf(),
            title: title_from(model),
            models: vec![model.to_path_buf()],
            metres_per_unit: 1.0,
            camera: None,
            views: BTreeMap::new(),
            image: ImageDefaults::default(),
            patches: PatchSettings::default(),
            light: LightSettings::default(),
            sky: None,
            up: None,
            one_sided: false,
            emissions: Vec::new(),
            materials: BTreeMap::new(),
        }
    }

    fn read(path: &Path) -> Result<Document> {
        let bytes =
            read_text_bytes(path).map_err(|error| unread(path, "the description", &error))?;
        let text = decode(bytes, path, Format::Toml)?;
        let file: File = toml::from_str(&text).map_err(|e| toml_error(path, &text, &e))?;
        Document::check(path, file).map_err(|e| e.in_file(path))
    }

    fn check(path: &Path, file: File) -> Result<Document> {
        if file.models.is_empty() {
            return Err(Error::new("the description names no model")
                .remedy("list one or more OBJ files: models = [\"room.obj\"]"));
        }
        let metres_per_unit = file.metres_per_unit.unwrap_or(1.0);
        if !(1e-30..=1e30).contains(&metres_per_unit) {
            return Err(Error::new(format!("metres_per_unit is {metres_per_unit}"))
                .remedy("give a positive number: 0.001 for millimetres"));
        }
        for (name, material) in &file.materials {
            material.check(name)?;
        }
        file.image.check()?;
        file.patches.check()?;
        file.light.check()?;
        let sky = file.sky.map(GreyOrRgb::rgb);
        if sky.is_some_and(|sky| !is_radiance(sky)) {
            return Err(Error::new("sky is not a radiance from 0 to 1e12")
                .remedy("write sky = 1 or sky = [r, g, b] in W/(sr·m²); 0 is no sky"));
        }
        let camera = file.camera.map(CameraTable::camera).transpose()?;
        let views = file.views.into_iter().map(view).collect::<Result<_>>()?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Ok(Document {
            file: path.to_path_buf(),
            title: file.title.unwrap_or_else(|| title_from(path)),
            models: file.models.iter().map(|model| folder.join(model)).collect(),
            metres_per_unit,
            camera,
            views,
            image: file.image,
            patches: file.patches,
            light: file.light,
            sky,
            up: file.up.map(Up::direction),
            one_sided: file.one_sided,
            emissions: Vec::new(),
            materials: file.materials,
        })
    }

    /// Names of the materials whose reflectance the description replaces, so that the model's own
    /// value need not be a possible one.
    pub fn overridden_reflectances(&self) -> HashSet<String> {
        let replaced = self.materials.iter().filter(|(_, m)| m.replaces_reflectance());
        replaced.map(|(name, _)| name.clone()).collect()
    }

    /// Whether it says what shines.
    pub(super) fn names_lamps(&self) -> bool {
        !self.emissions.is_empty()
            || self.materials.values().any(MaterialOverride::replaces_radiance)
    }

    /// Replaces what `[materials.NAME]` tables say.
    ///
    /// # Errors
    /// A name that no model's material has.
    pub fn override_materials(&self, materials: &mut [Material]) -> Result<()> {
        for (pattern, change) in &self.materials {
            change_matching(pattern, materials, |material| change.apply(material))
                .map_err(|error| error.in_file(&self.file))?;
        }
        for (pattern, radiance) in &self.emissions {
            change_matching(pattern, materials, |material| material.radiance = *radiance)?;
        }
        Ok(())
    }
}

fn title_from(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

fn toml_error(path: &Path, text: &str, error: &toml::de::Error) -> Error {
    let here = Error::new(error.message().trim()).in_file(path);
    let here = match error.span() {
        Some(span) => here.at_line(1 + text[..span.start].matches('\n').count()),
        None => here,
    };
    here.remedy("the README's section on scene descriptions lists every key")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Document> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text).expect("a file");
        Document::open(&path)
    }

    const GOOD: &str = "models = ['a.obj']\n[camera]\nposition = [0, 0, 1]\nlook_at = [0, 0, 0]\n";

    #[test]
    fn integers_serve_as_numbers_and_paths_are_relative_to_the_file() {
        let description = parse(GOOD).expect("a good description");
        assert!(description.camera.is_some());
        assert_eq!(description.models[0].file_name().unwrap(), "a.obj");
        assert!(description.models[0].parent().unwrap().is_absolute());
    }

    #[test]
    fn an_unknown_key_names_its_line() {
        let error = parse(&format!("{GOOD}colour = 3\n")).unwrap_err().to_string();
        assert!(error.contains("scene.toml:5:") && error.contains("colour"), "{error}");
    }

    #[test]
    fn impossible_values_are_refused() {
        for bad in [
            "models = []",
            "models = ['a.obj']\nmetres_per_unit = 0",
            "models = ['a.obj']\nmetres_per_unit = nan",
            "models = ['a.obj']\n[camera]\nposition = [0,0,0]\nlook_at = [0,0,0]",
            "models = ['a.obj']\n[camera]\nposition = [nan,0,0]\nlook_at = [0,0,1]",
            "models = ['a.obj']\n[materials.x]\nreflectance = [1.5, 0, 0]",
            "models = ['a.obj']\n[materials.x]\nradiance = [-1, 0, 0]",
            "models = ['a.obj']\n[materials.x]\nradiance = [3e38, 0, 0]",
            "models = ['a.obj']\nsky = 3e38",
            "models = ['a.obj']\n[camera]\nposition = [1e30,0,0]\nlook_at = [0,0,0]",
            "models = ['a.obj']\n[image]\nexposure = 0",
            "models = ['a.obj']\n[image]\nexposure = nan",
            "models = ['a.obj']\n[image]\nsize = [0, 4]",
            "models = ['a.obj']\n[image]\nsamples = 4294967295",
            "models = ['a.obj']\n[patches]\nlevels = 40",
            "models = ['a.obj']\n[patches]\nmax_edge = -1",
            "models = ['a.obj']\n[patches]\nlevels = 2\nmax_edge = 1",
            "models = ['a.obj']\n[views.'../x']\nposition = [0,0,0]\nlook_at = [0,0,1]",
            "models = ['a.obj']\n[views.x]\nposition = [0,0,0]\nlook_at = [0,0,0]",
            "models = ['a.obj']\n[light]\nsamples = 0",
            "models = ['a.obj']\n[light]\nsolver = 'magic'",
            "models = ['a.obj']\n[light]\ntolerance = 0",
            "models = ['a.obj']\n[light]\ntolerance = 0.1\niterations = 2",
            "models = ['a.obj']\n[light]\nlevels = 2",
            "models = 3",
            "models = ['a.obj'",
        ] {
            let error = parse(bad).expect_err(bad).to_string();
            assert!(error.contains("scene.toml") && error.contains("help:"), "{bad}: {error}");
        }
    }

    #[test]
    fn an_override_must_find_its_material() {
        let description = parse("models = ['a.obj']\n[materials.lamp]\nradiance = [1, 2, 3]\n")
            .expect("a good description");
        let mut materials = vec![Material { name: "lamp".into(), ..Material::fallback() }];
        description.override_materials(&mut materials).expect("the material is there");
        assert_eq!(materials[0].radiance, Rgb::new(1.0, 2.0, 3.0));
        assert_eq!(materials[0].reflectance, Material::fallback().reflectance);
        assert!(description.override_materials(&mut [Material::fallback()]).is_err());
    }

    #[test]
    fn other_endings_are_refused() {
        for name in ["scene.fbx", "scene", ""] {
            assert!(Document::open(Path::new(name)).is_err(), "{name}");
        }
    }
}
