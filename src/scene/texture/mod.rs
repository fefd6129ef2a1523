//! Pictures on surfaces, and how materials use them.
//!
//! A texel is a square of constant colour for [`Texture::mean`], which patches reflect and emit with. A
//! picture interpolates between the texels' centres ([`Texture::color`]), on a level of the mip pyramid
//! that is as coarse as the pixel (Williams, "Pyramidal Parametrics", 1983). Both see one mean.

mod decode;
mod mean;
mod pyramid;

use crate::color::Rgb;
pub(crate) use decode::decode_texture;
use glam::{Affine2, DVec2, Vec2, Vec4};
use pyramid::{KnownPyramid, Pyramid};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Index into [`Scene::textures`](super::Scene::textures).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TextureId(pub u32);

/// The most texels along a side.
pub(crate) const MAX_SIDE: u32 = 16384;

/// The most bytes of a decoded picture.
pub(crate) const MAX_BYTES: u64 = 1 << 28;

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
    /// Filled by the first look at the picture.
    #[serde(skip)]
    known_pyramid: KnownPyramid,
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

impl Texture {
    /// The same picture, continued in another way outside its square.
    pub(crate) fn wrapped(self, wrap: [Wrap; 2]) -> Texture {
        Texture { wrap, ..self }
    }
}

impl Map {
    /// The texture's coordinates where the mesh has (u, v).
    pub fn at(&self, uv: Vec2) -> Vec2 {
        self.transform.transform_point2(uv)
    }
}

impl Wrap {
    /// The texel, 0 to `size` − 1, that is shown in the place of texel `index`.
    fn texel(self, index: i64, size: u32) -> u32 {
        let size = i64::from(size);
        let inside = match self {
            Wrap::Repeat => index.rem_euclid(size),
            Wrap::Clamp => index.clamp(0, size - 1),
            Wrap::Mirror => {
                let there_and_back = index.rem_euclid(2 * size);
                there_and_back.min(2 * size - 1 - there_and_back)
            }
        };
        inside as u32
    }

    /// A coordinate moved by whole periods to where its size is small, so that no digits are lost.
    fn near(self, x: f64) -> f64 {
        match self {
            _ if !x.is_finite() => 0.0,
            Wrap::Repeat => x.rem_euclid(1.0),
            Wrap::Mirror => x.rem_euclid(2.0),
            Wrap::Clamp => x.clamp(-1.0, 2.0),
        }
    }
}

impl Texture {
    /// A picture from its pixels: see [`Texture::pixels`].
    ///
    /// # Panics
    /// If there are none, or another number than width times height.
    pub fn new(
        name: String,
        [width, height]: [u32; 2],
        pixels: Arc<[[u8; 4]]>,
        wrap: [Wrap; 2],
    ) -> Texture {
        let texture =
            Texture { name, width, height, pixels, wrap, known_pyramid: KnownPyramid::default() };
        assert!(texture.is_possible(), "one pixel for each texel");
        texture
    }

    /// Whether the lists fit the sizes.
    pub(crate) fn is_possible(&self) -> bool {
        let sides = 1..=MAX_SIDE;
        sides.contains(&self.width)
            && sides.contains(&self.height)
            && self.pixels.len() as u64 == u64::from(self.width) * u64::from(self.height)
    }

    /// The linear colour at (u, v), where (0, 0) is the lower left corner of the picture. `footprint` is the
    /// diameter in texels of what is looked at: texels that are smaller are averaged. A coordinate that is not
    /// finite counts as 0.
    pub fn color(&self, uv: Vec2, footprint: f32) -> Rgb {
        let pyramid = self.pyramid();
        // NaN and infinity end on the first and the last level.
        let level = footprint.max(1.0).log2().min(pyramid.last_level() as f32);
        let (fine, rest) = (level as usize, level.fract());
        let near = self.bilinear(pyramid, fine, uv);
        if rest == 0.0 {
            return near.truncate();
        }
        near.lerp(self.bilinear(pyramid, fine + 1, uv), rest).truncate()
    }

    /// The opacity at (u, v), in [0, 1], interpolated between the texels' centres.
    pub fn opacity(&self, uv: Vec2) -> f32 {
        self.bilinear(self.pyramid(), 0, uv).w
    }

    fn pyramid(&self) -> &Pyramid {
        self.known_pyramid.get(self)
    }

    /// Linear red, green, blue, and opacity.
    fn bilinear(&self, pyramid: &Pyramid, level: usize, uv: Vec2) -> Vec4 {
        let size = pyramid.size(level);
        let [u, v] = [0, 1].map(|axis| self.wrap[axis].near(uv[axis] as f64));
        let x = DVec2::new(u, 1.0 - v) * DVec2::from(size.map(f64::from)) - 0.5;
        let corner = x.floor();
        let (i, j) = (corner.x as i64, corner.y as i64);
        let across = [i, i + 1].map(|i| self.wrap[0].texel(i, size[0]));
        let down = [j, j + 1].map(|j| self.wrap[1].texel(j, size[1]));
        let part = (x - corner).as_vec2();
        let [upper, lower] = down.map(|j| {
            let [left, right] = across.map(|i| pyramid.texel(self, level, i, j));
            left.lerp(right, part.x)
        });
        upper.lerp(lower, part.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::srgb_decode;

    /// Two texels by two: black, white / white, black, with opacities 0, 85, 170, 255.
    pub(super) fn checker(wrap: Wrap) -> Texture {
        let pixels = [[0, 0, 0, 0], [255, 255, 255, 85], [255, 255, 255, 170], [0, 0, 0, 255]];
        Texture::new("checker".into(), [2, 2], pixels.into(), [wrap; 2])
    }

    #[test]
    fn the_first_pixel_is_at_the_upper_left() {
        let texture = checker(Wrap::Repeat);
        let at = |u, v| texture.color(Vec2::new(u, v), 0.0).x;
        assert_eq!(
            [at(0.25, 0.75), at(0.75, 0.75), at(0.25, 0.25), at(0.75, 0.25)],
            [0., 1., 1., 0.]
        );
        let opacity = |u, v| texture.opacity(Vec2::new(u, v));
        assert_eq!(opacity(0.75, 0.25), 1.0);
        assert!((opacity(0.25, 0.25) - 2.0 / 3.0).abs() < 1e-6);
        assert!((opacity(0.5, 0.5) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn each_wrap_mode_goes_on_in_its_way() {
        let at = |wrap, u: f32| checker(wrap).color(Vec2::new(u, 0.75), 1.0).x;
        assert_eq!([at(Wrap::Repeat, 1.25), at(Wrap::Repeat, -0.25)], [0.0, 1.0]);
        assert_eq!([at(Wrap::Mirror, 1.25), at(Wrap::Mirror, -0.25)], [1.0, 0.0]);
        assert_eq!([at(Wrap::Clamp, 1.25), at(Wrap::Clamp, -0.25)], [1.0, 0.0]);
        // Between the last and the first texel.
        assert_eq!(
            [at(Wrap::Repeat, 0.0), at(Wrap::Mirror, 0.0), at(Wrap::Clamp, 0.0)],
            [0.5, 0., 0.]
        );
    }

    #[test]
    fn any_coordinate_has_an_answer() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            let texture = checker(wrap);
            for x in [f32::NAN, f32::INFINITY, f32::MAX, f32::MIN, 1e20, -0.0] {
                for footprint in [0.0, 1.5, f32::INFINITY, f32::NAN, -1.0] {
                    let color = texture.color(Vec2::new(x, 0.3), footprint);
                    assert!(color.min_element() >= 0.0 && color.max_element() <= 1.0);
                }
                assert!((0.0..=1.0).contains(&texture.opacity(Vec2::splat(x))));
            }
        }
    }

    #[test]
    fn a_wide_footprint_sees_the_mean_of_the_linear_values() {
        let texture = checker(Wrap::Repeat);
        for uv in [Vec2::ZERO, Vec2::new(0.3, 0.9), Vec2::new(-7.1, 3.0)] {
            assert!((texture.color(uv, 2.0) - 0.5).abs().max_element() < 1e-6);
            assert!((texture.color(uv, 1e9) - 0.5).abs().max_element() < 1e-6);
        }
        let grey = Texture::new("grey".into(), [1, 1], [[188; 4]].into(), [Wrap::Repeat; 2]);
        assert_eq!(grey.color(Vec2::ONE, 0.0), Rgb::splat(srgb_decode(188.0 / 255.0)));
    }
}
