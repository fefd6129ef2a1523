//! The pictures that a PLY model names, and the materials that show them.

use super::elements::Face;
use super::header::Header;
use crate::color::Rgb;
use crate::error::{Result, Warning};
use crate::scene::beside::Files;
use crate::scene::budget::{Budget, but_memory};
use crate::scene::material::{Material, MaterialId};
use crate::scene::mesh::Origin;
use crate::scene::text::quote;
use crate::scene::texture::{Map, Texture, TextureId, Wrap, decode_texture};
use glam::Affine2;
use std::path::Path;

/// A material per picture, and the pictures.
#[derive(Default)]
pub(super) struct Pictures {
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
}

/// Reads the pictures; one that cannot be read is a warning.
///
/// # Errors
/// Less memory than they take.
pub(super) fn read(path: &Path, header: &Header, files: &mut Files) -> Result<Pictures> {
    let (mut pictures, mut budget) = (Pictures::default(), Budget::default());
    for name in header.pictures() {
        let texture = files.file(name).and_then(|bytes| {
            let texture = decode_texture(name.to_owned(), &bytes, [Wrap::Repeat; 2])?;
            budget.take(size_of_val(&*texture.pixels) as u64)?;
            Ok(texture)
        });
        let mut material = Material { name: name.to_owned(), ..Material::fallback() };
        match but_memory(texture)? {
            Ok(texture) => {
                let texture_id = TextureId(pictures.textures.len() as u32);
                material.reflectance = Rgb::ONE;
                material.reflectance_map =
                    Some(Map { texture: texture_id, transform: Affine2::IDENTITY });
                pictures.textures.push(texture);
            }
            Err(error) => {
                let error = error.to_string();
                let cause = error.lines().next().unwrap_or_default();
                let text = format!("the picture {} cannot be used: {cause}", quote(name));
                files.warnings.push(Warning::in_file(path, None, text));
            }
        }
        pictures.materials.push(material);
    }
    Ok(pictures)
}

/// The materials of triangles by the pictures of their faces; strips have the first.
pub(super) fn material_of(origins: &[Origin], faces: &[Face], materials: usize) -> Vec<MaterialId> {
    let picture = |origin: &Origin| {
        let face = faces.get(origin.face as usize - 1);
        face.map_or(0, |face| if face.picture < materials { face.picture } else { 0 })
    };
    origins.iter().map(|origin| MaterialId(picture(origin) as u32)).collect()
}
