//! From radiance to the display: one exposure for the whole picture.

use super::Image;
use crate::color::{luminance, srgb_encode};

/// The exposure at which the 95th percentile of the lit surfaces' luminance is 0.8 of white: only
/// lamps and what is near them clip. 1 for a black image.
///
/// `lamp` is the luminance of the dimmest emitter. What only reflects is darker than the brightest,
/// so that pixels of half that and more are taken for lamps, unless there is nothing else.
pub(crate) fn automatic_exposure(image: &Image, lamp: f32) -> f32 {
    let lit: Vec<f32> = image.pixels.iter().map(|p| luminance(*p)).filter(|l| *l > 0.0).collect();
    let reflecting: Vec<f32> = lit.iter().copied().filter(|l| *l < 0.5 * lamp).collect();
    let mut lit = if reflecting.is_empty() { lit } else { reflecting };
    if lit.is_empty() {
        return 1.0;
    }
    let index = (lit.len() * 95 / 100).min(lit.len() - 1);
    let (_, bright, _) = lit.select_nth_unstable_by(index, f32::total_cmp);
    0.8 / *bright
}

/// 8-bit sRGB, three bytes per pixel.
pub(crate) fn to_srgb(image: &Image, exposure: f32) -> Vec<u8> {
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
        assert!((automatic_exposure(&image(&values), 1000.0) - 0.4).abs() < 1e-6);
        assert_eq!(automatic_exposure(&image(&[0.0; 4]), 1000.0), 1.0);
        // Neither does one that fills half of the picture; alone, it is what there is to see.
        values.extend([1000.0; 100]);
        assert!((automatic_exposure(&image(&values), 1000.0) - 0.4).abs() < 1e-6);
        assert!((automatic_exposure(&image(&[1000.0; 4]), 1000.0) - 0.0008).abs() < 1e-9);
    }

    #[test]
    fn white_is_255_and_nothing_overflows() {
        assert_eq!(to_srgb(&image(&[0.0, 2.0, 9.0]), 0.5), [0, 0, 0, 255, 255, 255, 255, 255, 255]);
    }
}
