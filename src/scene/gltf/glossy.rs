//! The colours of specular and glossy materials as diffuse ones.
//!
//! A metal has a black diffuse colour there and a specular one; both together are what it reflects. The diffuse part
//! gets only the light that is not mirrored, as `KHR_materials_pbrSpecularGlossiness` says.

use crate::color::{Rgb, srgb_decode, srgb_encode};
use crate::scene::texture::Texture;
use glam::Vec2;
use rayon::prelude::*;

/// What plastics mirror, and everything else that is no metal. It is left aside in all formats.
const PLASTIC: f32 = 0.05;

/// The specular colour of a material: a factor, and the picture that it multiplies.
pub(super) struct Shine<'t> {
    pub factor: Rgb,
    pub picture: Option<&'t Texture>,
}

impl Shine<'_> {
    /// Whether a metal may have it.
    pub(super) fn is_metallic(&self) -> bool {
        self.factor.max_element() > PLASTIC
    }

    /// With the mean of the picture in its place.
    pub(super) fn mean(&self) -> Rgb {
        let mean = |picture: &Texture| picture.color(Vec2::ZERO, f32::INFINITY);
        self.factor * self.picture.map_or(Rgb::ONE, mean)
    }

    /// The reflectance of a surface with a diffuse colour. Never above 1.
    pub(super) fn added_to(&self, diffuse: Rgb) -> Rgb {
        together(diffuse, self.mean())
    }

    /// The reflectance of a surface with a diffuse picture, multiplied by a factor.
    pub(super) fn painted_over(&self, diffuse: &Texture, factor: Rgb) -> Texture {
        let decoded: [f32; 256] = std::array::from_fn(|byte| srgb_decode(byte as f32 / 255.0));
        let linear =
            |[r, g, b, _]: [u8; 4]| Rgb::from([r, g, b].map(|byte| decoded[byte as usize]));
        let shine = |x, y| match self.picture {
            Some(picture) => self.factor * linear(texel_at(picture, x, y)),
            None => self.factor,
        };
        let width = diffuse.width as usize;
        let pixel = |(i, texel): (usize, &[u8; 4])| {
            let x = ((i % width) as f32 + 0.5) / diffuse.width as f32;
            let y = ((i / width) as f32 + 0.5) / diffuse.height as f32;
            let color = together(linear(*texel) * factor, shine(x, y));
            let [r, g, b] = color.to_array().map(|x| (255.0 * srgb_encode(x)).round() as u8);
            [r, g, b, texel[3]]
        };
        let pixels: Vec<[u8; 4]> = diffuse.pixels.par_iter().enumerate().map(pixel).collect();
        let size = [diffuse.width, diffuse.height];
        Texture::new(diffuse.name.clone(), size, pixels.into(), diffuse.wrap)
    }
}

fn together(diffuse: Rgb, specular: Rgb) -> Rgb {
    (diffuse * (1.0 - specular.max_element()) + specular).clamp(Rgb::ZERO, Rgb::ONE)
}

/// The texel at a place from the upper left, in shares of the picture.
fn texel_at(picture: &Texture, x: f32, y: f32) -> [u8; 4] {
    let [column, row] = [(x, picture.width), (y, picture.height)]
        .map(|(at, size)| ((at * size as f32) as u32).min(size - 1));
    picture.pixels[row as usize * picture.width as usize + column as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::texture::Wrap;

    fn picture(pixels: &[[u8; 4]]) -> Texture {
        let size = [pixels.len() as u32, 1];
        Texture::new("a".into(), size, pixels.into(), [Wrap::Repeat; 2])
    }

    #[test]
    fn a_metal_reflects_its_specular_colour_and_paint_its_diffuse_one() {
        let gold = Rgb::new(1.0, 0.75, 0.25);
        let metal = Shine { factor: gold, picture: None };
        assert_eq!(metal.added_to(Rgb::ZERO), gold);
        assert_eq!(metal.added_to(Rgb::ONE), gold, "nothing is left for what is below");
        let half = Shine { factor: Rgb::splat(0.5), picture: None };
        assert_eq!(half.added_to(Rgb::splat(0.5)), Rgb::splat(0.75));
        assert!(!Shine { factor: Rgb::splat(0.04), picture: None }.is_metallic());
    }

    #[test]
    fn pictures_are_joined_texel_by_texel() {
        // Gold beside red paint.
        let diffuse = picture(&[[0, 0, 0, 255], [255, 0, 0, 7]]);
        let specular = picture(&[[255, 200, 50, 0], [0, 0, 0, 0]]);
        let shine = Shine { factor: Rgb::ONE, picture: Some(&specular) };
        let joined = shine.painted_over(&diffuse, Rgb::ONE);
        assert_eq!(*joined.pixels, [[255, 200, 50, 255], [255, 0, 0, 7]]);
        // A finer picture keeps its details.
        let fine = picture(&[[0, 0, 0, 1], [0, 0, 0, 2], [255, 0, 0, 3], [0, 255, 0, 4]]);
        let joined = shine.painted_over(&fine, Rgb::ONE);
        let gold = [255, 200, 50];
        assert_eq!(
            joined.pixels[..2].iter().map(|p| [p[0], p[1], p[2]]).collect::<Vec<_>>(),
            [gold; 2]
        );
        assert_eq!(joined.pixels[2..], [[255, 0, 0, 3], [0, 255, 0, 4]]);
    }
}
