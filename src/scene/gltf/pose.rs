//! Where the vertices of a mesh stand: moved by its node, or by the joints of its skin, at rest.

use super::accessor::Data;
use super::checks::{finite, is_mirror};
use super::json::{self, Mesh, Node, Primitive};
use crate::error::Result;
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};

/// From a mesh's coordinates to the scene's.
pub(super) struct Pose<'a> {
    pub world: DAffine3,
    /// From the mesh's coordinates to the scene's by the joints of the skin, if there is one.
    pub joints: Option<&'a [DAffine3]>,
}

impl Pose<'_> {
    /// The vertices in the scene's coordinates, and whether they are mirrored.
    pub(super) fn apply(
        &self,
        data: &Data,
        primitive: &Primitive,
        vertices: Vec<[f64; 3]>,
    ) -> Result<(Vec<DVec3>, bool)> {
        let vertices = vertices.into_iter().map(DVec3::from);
        let index = |name: &str| json::index(&primitive.attributes, name);
        let influences = (self.joints, index("JOINTS_0"), index("WEIGHTS_0"));
        let (Some(matrices), Some(joints), Some(weights)) = influences else {
            let moved = vertices.map(|vertex| self.world.transform_point3(vertex)).collect();
            return Ok((moved, is_mirror(&self.world)));
        };
        let (joints, weights) = (data.read::<f64, 4>(joints)?, data.read::<f64, 4>(weights)?);
        let moved = |(k, vertex): (usize, DVec3)| match (joints.get(k), weights.get(k)) {
            (Some(joints), Some(weights)) => blend(matrices, joints, weights, vertex),
            _ => self.world.transform_point3(vertex),
        };
        let mirrored = matrices.first().is_some_and(is_mirror);
        Ok((vertices.enumerate().map(moved).collect(), mirrored))
    }

    /// Normals in the scene's coordinates; those of a skinned mesh are not turned with its joints.
    pub(super) fn normals(&self, normals: Vec<[f64; 3]>) -> Vec<Vec3> {
        let matrix: DMat3 = self.world.matrix3.inverse().transpose();
        let turned = |normal: [f64; 3]| (matrix * DVec3::from(normal)).normalize_or_zero();
        normals.into_iter().map(|normal| finite(turned(normal).as_vec3())).collect()
    }
}

fn blend(matrices: &[DAffine3], joints: &[f64; 4], weights: &[f64; 4], vertex: DVec3) -> DVec3 {
    let total: f64 = weights.iter().sum();
    let place = |(joint, weight): (&f64, &f64)| {
        let matrix = matrices.get(*joint as usize).copied().unwrap_or(DAffine3::IDENTITY);
        matrix.transform_point3(vertex) * *weight
    };
    let sum: DVec3 = joints.iter().zip(weights).filter(|(_, w)| **w != 0.0).map(place).sum();
    if total > 0.0 { sum / total } else { vertex }
}

/// The matrices of a skin's joints; `worlds` are those of the nodes of the scene.
pub(super) fn joints(
    data: &Data,
    skin: usize,
    worlds: &[Option<DAffine3>],
) -> Result<Option<Vec<DAffine3>>> {
    let Some(skin) = data.root.skins.get(skin) else { return Ok(None) };
    let inverse = match skin.inverse_bind_matrices {
        Some(accessor) => data.read::<f64, 16>(accessor)?,
        None => Vec::new(),
    };
    let matrix = |(k, joint): (usize, &usize)| {
        let world = worlds.get(*joint).copied().flatten()?;
        let inverse = inverse
            .get(k)
            .map_or(DAffine3::IDENTITY, |m| DAffine3::from_mat4(affine(DMat4::from_cols_array(m))));
        Some(world * inverse)
    };
    // Joints outside the scene cannot place anything.
    Ok(skin.joints.iter().enumerate().map(matrix).collect())
}

/// Rounding may have spoiled the last row.
fn affine(mut matrix: DMat4) -> DMat4 {
    [matrix.x_axis.w, matrix.y_axis.w, matrix.z_axis.w, matrix.w_axis.w] = [0.0, 0.0, 0.0, 1.0];
    matrix
}

/// Adds the morph targets with the weights that the file gives.
pub(super) fn morph(
    data: &Data,
    node: &Node,
    mesh: &Mesh,
    primitive: &Primitive,
    vertices: &mut [[f64; 3]],
) -> Result<()> {
    let Some(weights) = node.weights.as_ref().or(mesh.weights.as_ref()) else { return Ok(()) };
    for (target, weight) in primitive.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
        let Some(accessor) = json::index(target, "POSITION") else { continue };
        for (vertex, moved) in vertices.iter_mut().zip(data.read::<f64, 3>(accessor)?) {
            *vertex = (DVec3::from(*vertex) + *weight * DVec3::from(moved)).into();
        }
    }
    Ok(())
}
