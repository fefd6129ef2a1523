//! The nodes of a glTF scene, and where each stands.

use super::accessor::Data;
use super::json::{self, Node, Root};
use crate::error::{Error, Result};
use crate::scene::camera::Camera;
use crate::scene::camera::is_view_name;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use std::collections::HashSet;

/// A node of the scene, by its number.
pub(super) struct Placed {
    pub node: usize,
    /// From the node's coordinates to the scene's.
    pub world: DAffine3,
}

/// The nodes of the scene, each before its children.
pub(super) fn place(root: &Root) -> Result<Vec<Placed>> {
    let mut placed = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    let mut waiting: Vec<(usize, DAffine3)> =
        roots(root)?.into_iter().rev().map(|node| (node, DAffine3::IDENTITY)).collect();
    while let Some((number, parent)) = waiting.pop() {
        let Some(node) = root.nodes.get(number) else {
            return Err(Error::new(format!("node {number} does not exist")).remedy(AGAIN));
        };
        // Each once: that excludes circles, and trees that grow without end.
        if std::mem::replace(&mut seen[number], true) {
            return Err(
                Error::new(format!("node {number} has two parents, or is its own")).remedy(AGAIN)
            );
        }
        let world = parent * local(node);
        waiting.extend(node.children.iter().rev().map(|child| (*child, world)));
        placed.push(Placed { node: number, world });
    }
    Ok(placed)
}

pub(super) const AGAIN: &str = "export the model again";

/// The nodes that the scene begins with: those of the default scene, else of the first, else those that are
/// nobody's children.
fn roots(root: &Root) -> Result<Vec<usize>> {
    let number = root.scene.unwrap_or(0);
    match root.scenes.get(number) {
        Some(scene) => Ok(scene.nodes.clone()),
        None if root.scene.is_some() => {
            Err(Error::new(format!("scene {number} does not exist")).remedy(AGAIN))
        }
        None => {
            let children: HashSet<usize> =
                root.nodes.iter().flat_map(|node| node.children.iter().copied()).collect();
            Ok((0..root.nodes.len()).filter(|node| !children.contains(node)).collect())
        }
    }
}

/// From a node's coordinates to its parent's.
fn local(node: &Node) -> DAffine3 {
    if let Some(m) = node.matrix {
        let column = |k: usize| DVec3::new(m[k], m[k + 1], m[k + 2]);
        let linear = DMat3::from_cols(column(0), column(4), column(8));
        return DAffine3::from_mat3_translation(linear, column(12));
    }
    affine(node.translation, node.rotation, node.scale)
}

fn affine(
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
) -> DAffine3 {
    let rotation = DQuat::from_array(rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    let rotation = if length > 0.0 { rotation / length } else { DQuat::IDENTITY };
    DAffine3::from_scale_rotation_translation(
        scale.unwrap_or([1.0; 3]).into(),
        rotation,
        translation.unwrap_or_default().into(),
    )
}

/// Where the copies of a node's mesh stand in the node's coordinates (`EXT_mesh_gpu_instancing`).
pub(super) fn instances(data: &Data, node: &Node) -> Result<Vec<DAffine3>> {
    let Some(extension) = node.extensions.get("EXT_mesh_gpu_instancing") else {
        return Ok(vec![DAffine3::IDENTITY]);
    };
    let Some(attributes) = extension.get("attributes").and_then(|a| a.as_object()) else {
        return Ok(vec![DAffine3::IDENTITY]);
    };
    let translations = read_if(data, json::index(attributes, "TRANSLATION"))?;
    let rotations = read_if(data, json::index(attributes, "ROTATION"))?;
    let scales = read_if(data, json::index(attributes, "SCALE"))?;
    let count = translations.len().max(rotations.len()).max(scales.len());
    let at = |k: usize| {
        affine(translations.get(k).copied(), rotations.get(k).copied(), scales.get(k).copied())
    };
    Ok((0..count).map(at).collect())
}

fn read_if<const N: usize>(data: &Data, accessor: Option<usize>) -> Result<Vec<[f64; N]>> {
    accessor.map_or(Ok(Vec::new()), |accessor| data.read(accessor))
}

/// The perspective cameras, under names that can be parts of a file's name; `left_out` counts the others.
pub(super) fn views(root: &Root, placed: &[Placed], left_out: &mut usize) -> Vec<(String, Camera)> {
    let mut views: Vec<(String, Camera)> = Vec::new();
    for Placed { node, world } in placed {
        let node = &root.nodes[*node];
        let Some(number) = node.camera else { continue };
        let json = root.cameras.get(number);
        let Some(camera) = json.and_then(|json| camera(json, world)) else {
            *left_out += 1;
            continue;
        };
        let own = json.and_then(|json| json.name.as_deref());
        let name = view_name(node.name.as_deref().or(own).unwrap_or_default());
        let taken = |name: &str| views.iter().any(|(other, _)| other == name);
        let mut names = (2..).map(|k| format!("{name}-{k}"));
        let name = if taken(&name) { names.find(|n| !taken(n)).unwrap_or(name) } else { name };
        views.push((name, camera));
    }
    views
}

/// A camera looks along its -z axis; its y axis is up.
fn camera(json: &json::Camera, world: &DAffine3) -> Option<Camera> {
    let perspective = json.perspective.as_ref()?;
    let forward = world.transform_vector3(DVec3::NEG_Z).try_normalize()?;
    let up = world.transform_vector3(DVec3::Y).try_normalize()?;
    let position = world.translation.as_vec3();
    // Far from the origin a unit step may be lost in f32.
    let step = world.translation.abs().max_element().max(1.0);
    let target = (world.translation + forward * step).as_vec3();
    let near = perspective.znear.max(0.0) as f32;
    let fov = perspective.yfov.to_degrees() as f32;
    let camera = Camera::new(position, target, up.as_vec3(), fov, near).ok()?;
    Some(camera.composed_for(perspective.aspect_ratio as f32))
}

fn view_name(name: &str) -> String {
    let valid = |c: char| if is_view_name(c.encode_utf8(&mut [0; 4])) { c } else { '-' };
    let name: String = name.chars().map(valid).collect();
    let name = name.trim_matches('-');
    if name.is_empty() { "camera".to_owned() } else { name.to_owned() }
}
