//! From radiance to the display: one exposure for the whole picture.

use super::Image;
use crate::color::{luminance, srgb_encode};

/// The exposure of some images at which the 95th percentile of the luminance of what reflects is 0.8 of white:
/// only lamps and what is near them clip. If nothing reflects, what shines counts; 1 for black images.
pub(crate) fn automatic_exposure(images: &[&Image]) -> f32 {
    let reflecting = images.iter().flat_map(|image| &image.reflecting);
    let mut lit: Vec<f32> = reflecting.copied().filter(|l| *l > 0.0).collect();
    if lit.is_empty() {
        let pixels = images.iter().flat_map(|image| &image.pixels);
        lit = pixels.map(|p| luminance(*p)).filter(|l| *l > 0.0).collect();
    }
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

    /// Pixels of which some are lamps.
    fn image(values: &[(f32, bool)]) -> Image {
        Image {
            width: values.len() as u32,
            height: 1,
            pixels: values.iter().map(|(v, _)| Rgb::splat(*v)).collect(),
            reflecting: values.iter().map(|(v, lamp)| if *lamp { 0.0 } else { *v }).collect(),
        }
    }

    #[test]
    fn a_lamp_does_not_darken_the_room() {
        let exposure = |values: &[(f32, bool)]| automatic_exposure(&[&image(values)]);
        let mut values = vec![(2.0, false); 99];
        values.push((1000.0, true));
        assert!((exposure(&values) - 0.4).abs() < 1e-6);
        assert_eq!(exposure(&[(0.0, false); 4]), 1.0);
        // Neither does one that fills half of the picture, nor one dimmer than the room; alone, it is what
        // there is to see.
        values.extend([(1000.0, true); 100]);
        values.extend([(0.01, true); 100]);
        assert!((exposure(&values) - 0.4).abs() < 1e-6);
        assert!((exposure(&[(1000.0, true); 4]) - 0.0008).abs() < 1e-9);
        let [dark, bright] = [1.0, 2.0].map(|value| image(&[(value, false); 9]));
        assert_eq!(automatic_exposure(&[&dark, &bright]), 0.4, "several images have one");
    }

    #[test]
    fn white_is_255_and_nothing_overflows() {
        assert_eq!(
            to_srgb(&image(&[0.0, 2.0, 9.0].map(|v| (v, false))), 0.5),
            [0, 0, 0, 255, 255, 255, 255, 255, 255]
        );
    }
}
