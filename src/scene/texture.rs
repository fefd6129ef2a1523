//! Pictures on surfaces, and how materials use them.

use glam::Affine2;
use serde::{Deserialize, Serialize};
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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
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
