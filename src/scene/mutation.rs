//! For tests of the readers: loads bytes as a file, and tries what mutations of it do.

use super::model::Model;
use crate::error::Result;
use std::fs;
use std::path::Path;

/// A model with its warnings, or an error. Messages name the files without their folder.
pub(super) type Loaded = std::result::Result<(Model, Vec<String>), String>;

/// Loads `bytes` from a file called `name`, alone in its folder.
pub(super) fn load(name: &str, bytes: &[u8], load: impl Fn(&Path) -> Result<Model>) -> Loaded {
    load_files(&[(name, bytes)], load)
}

/// Loads the first of the files, which are alone in their folder.
pub(super) fn load_files(files: &[(&str, &[u8])], load: impl Fn(&Path) -> Result<Model>) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    let prefix = format!("{}/", folder.path().display());
    let without_folder = |message: String| message.replace(&prefix, "");
    let model = load(&folder.path().join(files[0].0)).map_err(|e| without_folder(e.to_string()))?;
    let warnings = model.warnings.iter().map(|w| without_folder(w.to_string())).collect();
    Ok((model, warnings))
}

/// Reads mutations of a file: none may make the reader panic, and what it reads must be whole.
pub(super) fn try_many(bytes: &[u8], rounds: usize, read: impl Fn(&[u8]) -> Result<Model>) {
    let (mut state, mut loaded) = (0x9e37_79b9_7f4a_7c15, 0);
    for _ in 0..rounds {
        let mut bytes = bytes.to_vec();
        mutate(&mut bytes, &mut state);
        let Ok(model) = read(&bytes) else { continue };
        loaded += 1;
        assert_whole(&model);
    }
    assert!((rounds / 50..rounds * 49 / 50).contains(&loaded), "{loaded} of {rounds} loaded");
}

/// Whether a model keeps the promises of its fields.
pub(super) fn assert_whole(model: &Model) {
    let exists = |corner: &u32| (*corner as usize) < model.positions.len();
    assert!(model.positions.iter().all(|position| position.abs().max_element() <= 1e12));
    assert!(!model.triangles.is_empty() && model.triangles.as_flattened().iter().all(exists));
    assert_eq!(model.triangles.len(), model.material_of.len());
    assert_eq!(model.triangles.len(), model.mesh.origins.len());
    assert!(model.mesh.fits(model.triangles.len()));
    assert!(model.material_of.iter().all(|id| (id.0 as usize) < model.materials.len()));
    for material in &mut model.materials.clone() {
        let (reflectance, opacity) = (material.reflectance, material.opacity);
        assert!(
            reflectance.to_array().into_iter().chain([opacity]).all(|x| (0.0..=1.0).contains(&x))
        );
        assert!(material.radiance.is_finite() && material.radiance.min_element() >= 0.0);
        for map in material.maps_mut() {
            assert!((map.texture.0 as usize) < model.textures.len() && map.transform.is_finite());
        }
    }
    let mesh = &model.mesh;
    assert!(mesh.texture.iter().flat_map(|t| &t.values).all(|uv| uv.is_finite()));
    assert!(mesh.colors.iter().flat_map(|c| &c.values).all(|color| color.is_finite()));
    assert!(mesh.normals.iter().flat_map(|n| &n.values).all(|normal| normal.is_finite()));
}

/// Marsaglia's xorshift64: enough disorder for a test, the same in every run.
fn random(state: &mut u64, below: usize) -> usize {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    (*state % below as u64) as usize
}

/// Overwrites, doubles or deletes a few stretches, with bytes that mean something to a reader.
fn mutate(bytes: &mut Vec<u8>, state: &mut u64) {
    const TELLING: &[u8] = b"\0\x01\n\r\t \\/#-+.0129eE{}[]\",:\xff\x7f\x80\xe9nanifv";
    for _ in 0..=random(state, 4) {
        let start = random(state, bytes.len());
        let end = (start + random(state, 12)).min(bytes.len());
        match random(state, 4) {
            0 | 1 => bytes[start] = TELLING[random(state, TELLING.len())],
            2 => drop(bytes.splice(start..start, bytes[start..end].to_vec())),
            _ if end - start < bytes.len() => drop(bytes.drain(start..end)),
            _ => {}
        }
    }
}
