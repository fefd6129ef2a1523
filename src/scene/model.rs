//! A model as one of the readers gives it, whatever its format.

use super::camera::Camera;
use super::material::{Material, MaterialId};
use super::mesh::{self, Mesh};
use super::text::LARGEST;
use super::texture::Texture;
use crate::error::{Error, Result, Warning};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::fmt;
use std::path::PathBuf;

/// A model in the coordinates and the unit of length of its file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Model {
    /// Finite and at most 1e12.
    pub positions: Vec<DVec3>,
    /// The triangles in file order, as indices into `positions`, counter-clockwise as seen from the front.
    /// Never empty. Triangles without area are still among them.
    pub triangles: Vec<[u32; 3]>,
    /// Per triangle, the index of its material.
    pub material_of: Vec<MaterialId>,
    pub materials: Vec<Material>,
    /// The pictures that the materials' maps name.
    pub textures: Vec<Texture>,
    /// The faces that the triangles come from.
    pub mesh: Mesh,
    /// The files that were read beside the model's own.
    pub files: Vec<PathBuf>,
    pub warnings: Vec<Warning>,
    /// The file's own cameras by name, in its order.
    pub views: Vec<(String, Camera)>,
    /// Whether the format's viewers light every model from all around, so that what glows in it need not.
    pub has_surroundings: bool,
    /// The direction that the format says is up, or `None` where it leaves that open.
    pub up: Option<Vec3>,
    /// The direction that is up in most files of its kind, if one is.
    pub usual_up: Option<Vec3>,
}

impl Model {
    /// Adds another model behind this one, as model number `number`.
    pub(super) fn append(&mut self, number: u32, mut more: Model) {
        let positions = self.positions.len() as u32;
        self.positions.append(&mut more.positions);
        self.triangles.extend(more.triangles.iter().map(|t| t.map(|corner| corner + positions)));
        let materials = self.materials.len() as u32;
        self.material_of.extend(more.material_of.iter().map(|m| MaterialId(m.0 + materials)));
        let textures = self.textures.len() as u32;
        let maps = more.materials.iter_mut().flat_map(Material::maps_mut);
        maps.for_each(|map| map.texture.0 += textures);
        self.materials.append(&mut more.materials);
        self.textures.append(&mut more.textures);
        self.mesh.append(number, more.mesh);
        self.files.append(&mut more.files);
        self.warnings.append(&mut more.warnings);
        self.views.append(&mut more.views);
        self.has_surroundings &= more.has_surroundings;
        self.up = self.up.or(more.up);
        self.usual_up = self.usual_up.or(more.usual_up);
    }

    /// Leaves out the triangles that are not `kept`.
    pub(super) fn retain(&mut self, kept: &[bool]) {
        mesh::retain(&mut self.triangles, kept);
        mesh::retain(&mut self.material_of, kept);
        self.mesh.retain(kept);
    }

    /// The positions as f32 relative to a place.
    pub(super) fn positions_from(&self, origin: DVec3) -> Vec<Vec3> {
        self.positions.par_iter().map(|position| (position - origin).as_vec3()).collect()
    }
}

/// The position, if it is one that a model may have; `place` begins the message: "vertex 3: ".
pub(super) fn checked_position(position: DVec3, place: fmt::Arguments) -> Result<DVec3> {
    match position.to_array().into_iter().find(|x| x.is_nan() || x.abs() > f64::from(LARGEST)) {
        None => Ok(position),
        Some(x) if x.is_finite() => {
            Err(Error::new(format!("{place}coordinate {x:e} is larger than {LARGEST:e}"))
                .remedy("scale the model down, for instance from millimetres to metres"))
        }
        Some(x) => Err(Error::new(format!("{place}coordinate {x} is not a finite number"))
            .remedy("correct the number, or export the model again")),
    }
}
