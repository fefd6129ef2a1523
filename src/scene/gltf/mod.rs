//! Reads glTF 2 models: `.gltf` with its files, and `.glb`.
//!
//! The scene is read at rest: no animation runs. Its materials become diffuse ones.
//!
//! The JSON is read by our own structs. The `gltf` crate refuses scenes for faults in what is not used here,
//! and panics on some indices that are out of range.

mod accessor;
mod checks;
mod container;
mod geometry;
mod glossy;
mod images;
mod json;
mod materials;
mod nodes;
mod pose;

use super::beside::Files;
use super::formats::model_bytes;
use super::material::{Material, MaterialId};
use super::model::Model;
use crate::error::{Error, Result, Warning};
use accessor::Data;
use container::{COMPRESSIONS, compressed, read_root};
use geometry::{Geometry, Placement};
use glam::{DAffine3, Vec3};
use json::Root;
use nodes::Placed;
use pose::Pose;
use std::path::Path;

/// Reads the glTF model at `path`, with the files that it names.
///
/// # Errors
/// A file that cannot be read, has no triangles, is compressed, or says something without meaning.
pub(super) fn load(path: &Path) -> Result<Model> {
    let bytes = model_bytes(path)?;
    read(path, &bytes).map_err(|error| error.in_file_if_none(path))
}

fn read(path: &Path, bytes: &[u8]) -> Result<Model> {
    let (root, binary) = read_root(bytes)?;
    let mut files = Files::new(path);
    let data = Data::new(&root, binary, &mut files)?;
    let placed = nodes::place(&root)?;
    let used = used_materials(&root, &placed);
    let mut materials = materials::read(path, &data, &mut files, &used)?;
    let default = root.materials.len();
    let mut geometry = add_all(&data, &placed, &materials.texture_sets)?;
    if geometry.triangles.is_empty() {
        return Err(Error::new("the scene contains no triangles")
            .remedy("export the model again, with its meshes"));
    }
    if used[default] {
        materials.materials.push(Material::fallback());
    }
    let mut cameras = 0;
    let views = nodes::views(&root, &placed, &mut cameras);
    let mut warnings = files.take_warnings();
    warnings.append(&mut materials.warnings);
    warnings.extend(ignored(path, &root, geometry.not_triangles, cameras));
    Ok(Model {
        mesh: geometry.mesh(),
        positions: geometry.positions,
        triangles: geometry.triangles,
        material_of: geometry.material_of,
        materials: materials.materials,
        textures: materials.textures,
        files: files.read,
        warnings,
        views,
        has_surroundings: true,
        up: Some(Vec3::Y),
        usual_up: None,
    })
}

/// Which materials the scene's primitives have; the last stands for the default.
fn used_materials(root: &Root, placed: &[Placed]) -> Vec<bool> {
    let mut used = vec![false; root.materials.len() + 1];
    let meshes = placed.iter().filter_map(|placed| root.meshes.get(root.nodes[placed.node].mesh?));
    for primitive in meshes.flat_map(|mesh| &mesh.primitives) {
        used[material_number(root, primitive.material)] = true;
    }
    used
}

fn material_number(root: &Root, material: Option<usize>) -> usize {
    material.map_or(root.materials.len(), |number| number.min(root.materials.len()))
}

fn add_all(data: &Data, placed: &[Placed], texture_sets: &[u32]) -> Result<Geometry> {
    let root = data.root;
    let mut geometry = Geometry::default();
    let mut worlds: Vec<Option<DAffine3>> = vec![None; root.nodes.len()];
    placed.iter().for_each(|placed| worlds[placed.node] = Some(placed.world));
    for Placed { node: number, world } in placed {
        let node = &root.nodes[*number];
        let Some(mesh_number) = node.mesh else { continue };
        let Some(mesh) = root.meshes.get(mesh_number) else {
            let cause = format!("mesh {mesh_number}, which node {number} has, does not exist");
            return Err(Error::new(cause).remedy(nodes::AGAIN));
        };
        let joints = match node.skin {
            Some(skin) => pose::joints(data, skin, &worlds)?,
            None => None,
        };
        for instance in nodes::instances(data, node)? {
            geometry.object(node.name.as_ref().or(mesh.name.as_ref()));
            for (number, primitive) in mesh.primitives.iter().enumerate() {
                check_compression(data, primitive)?;
                let material = material_number(root, primitive.material);
                let placement = Placement {
                    node,
                    mesh: mesh_number,
                    primitive: number,
                    pose: Pose { world: *world * instance, joints: joints.as_deref() },
                    material: MaterialId(material as u32),
                    texture_set: texture_sets.get(material).copied().unwrap_or(0),
                };
                geometry.add(data, &placement)?;
            }
        }
    }
    Ok(geometry)
}

/// A primitive whose compression is not required has positions without it too.
fn check_compression(data: &Data, primitive: &json::Primitive) -> Result<()> {
    let (name, undo) = COMPRESSIONS[0];
    let position = json::index(&primitive.attributes, "POSITION");
    let accessor = position.and_then(|position| data.root.accessors.get(position));
    let empty = accessor.is_some_and(|a| a.buffer_view.is_none() && a.sparse.is_none());
    match empty && primitive.extensions.contains_key(name) {
        true => Err(compressed(name, undo)),
        false => Ok(()),
    }
}

/// One warning for each kind of thing that is ignored.
fn ignored(path: &Path, root: &Root, not_triangles: usize, cameras: usize) -> Vec<Warning> {
    let lights = root.extensions.get("KHR_lights_punctual").and_then(|l| l.get("lights"));
    let lights = lights.and_then(|lights| lights.as_array()).map_or(0, Vec::len);
    [
        (not_triangles, "points and lines have no area and are ignored"),
        (lights, "point, spot and directional lights are ignored"),
        (root.animations.len(), "animations are ignored: the model is shown at rest"),
        (cameras, "cameras without a perspective are ignored"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, note)| Warning::in_file(path, None, format!("{note} ({count} in all)")))
    .collect()
}

#[cfg(test)]
mod tests;
