//! Pictures on surfaces, and how materials use them.

use crate::error::{Error, Result};
use glam::Affine2;
use image::{ImageReader, Limits};
use serde::{Deserialize, Serialize};
use std::io::Cursor;
use std::sync::Arc;

/// Index into [`Scene::textures`](super::Scene::textures).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TextureId(pub u32);

/// A decoded picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Texture {
    /// The file, or the name in the model that holds the picture.
    pub name: String,
    pub width: u32,
    pub height: u32,
    /// Row by row from the top left: sRGB-encoded red, green and blue, and linear opacity.
    pub pixels: Arc<[[u8; 4]]>,
    /// What lies outside [0, 1) along u and along v.
    pub wrap: [Wrap; 2],
}

/// What a texture shows outside its square.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Wrap {
    #[default]
    Repeat,
    Mirror,
    Clamp,
}

/// The use of a texture by a material.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Map {
    pub texture: TextureId,
    /// From the mesh's (u, v), which run right and up as in OBJ files, to the texture's, of which (0, 0) is
    /// the lower left corner of the picture.
    pub transform: Affine2,
}

/// The picture in `bytes`, whatever its format.
///
/// # Errors
/// A format that is not read, a malformed picture, or one that is too large to be held.
pub(crate) fn decode_texture(name: String, bytes: &[u8], wrap: [Wrap; 2]) -> Result<Texture> {
    let broken = |why: String| Error::new(format!("the picture cannot be decoded: {why}"));
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|error| broken(error.to_string()))?;
    let mut limits = Limits::default();
    limits.max_image_width = Some(1 << 14);
    limits.max_image_height = Some(1 << 14);
    limits.max_alloc = Some(1 << 28);
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| broken(error.to_string()))?.into_rgba8();
    let (width, height) = picture.dimensions();
    let pixels = picture.pixels().map(|pixel| pixel.0).collect();
    Ok(Texture { name, width, height, pixels, wrap })
}
