//! From radiance to the display: one exposure for the whole picture.

use super::Image;
use crate::color::{luminance, srgb_encode};

/// The exposure at which the 95th percentile of the lit pixels' luminance is 0.8 of white: bright
/// surfaces stay below it and only lamps and their neighbourhood clip. 1 for a black image.
pub fn automatic_exposure(image: &Image) -> f32 {
    let mut lit: Vec<f32> =
        image.pixels.iter().map(|p| luminance(*p)).filter(|l| *l > 0.0).collect();
    if lit.is_empty() {
        return 1.0;
    }
    let index = (lit.len() * 95 / 100).min(lit.len() - 1);
    let (_, bright, _) = lit.select_nth_unstable_by(index, f32::total_cmp);
    0.8 / *bright
}

/// 8-bit sRGB, three bytes a pixel.
pub fn to_srgb(image: &Image, exposure: f32) -> Vec<u8> {
    let encode = |x: f32| (srgb_encode(x * exposure) * 255.0 + 0.5) as u8;
    image.pixels.iter().flat_map(|p| p.to_array().map(encode)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;

    fn image(values: &[f32]) -> Image {
        Image {
            width: values.len() as u32,
            height: 1,
            pixels: values.iter().map(|v| Rgb::splat(*v)).collect(),
        }
    }

    #[test]
    fn a_lamp_does_not_darken_the_room() {
        let mut values = vec![2.0; 99];
        values.push(1000.0);
        assert!((automatic_exposure(&image(&values)) - 0.4).abs() < 1e-6);
        assert_eq!(automatic_exposure(&image(&[0.0; 4])), 1.0);
    }

    #[test]
    fn white_is_255_and_nothing_overflows() {
        assert_eq!(to_srgb(&image(&[0.0, 2.0, 9.0]), 0.5), [0, 0, 0, 255, 255, 255, 255, 255, 255]);
    }
}
