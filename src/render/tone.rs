//! From radiance to the display: one exposure for the whole picture.

use super::Image;
use crate::color::{Rgb, luminance, srgb_encode};
use std::f32::consts::PI;

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
    // A denormal luminance would make it infinite.
    (0.8 / *bright).min(f32::MAX)
}

/// The luminance that a surface counts for the exposure, from the irradiance in W·m⁻²: dark surfaces count as if they
/// reflected a fifth. What is black then looks black, and what is behind it does not burn out.
pub(crate) fn exposed(irradiance: Rgb, reflectance: Rgb) -> f32 {
    luminance(irradiance * reflectance).max(DARKEST * luminance(irradiance)) / PI
}

/// The least reflectance that a surface counts with.
const DARKEST: f32 = 0.2;

/// 8-bit sRGB, three bytes per pixel.
pub(crate) fn to_srgb(image: &Image, exposure: f32) -> Vec<u8> {
    image.pixels.iter().flat_map(|p| bytes(*p * exposure)).collect()
}

/// 8-bit sRGB and alpha, four bytes per pixel: the colour of what covers a part of a pixel, and that part.
pub(crate) fn to_srgb_and_alpha(image: &Image, exposure: f32) -> Vec<u8> {
    let pixel = |(radiance, coverage): (&Rgb, &f32)| {
        let whole = if *coverage > 0.0 { *radiance / *coverage } else { Rgb::ZERO };
        let [r, g, b] = bytes(whole * exposure);
        [r, g, b, (coverage * 255.0 + 0.5) as u8]
    };
    image.pixels.iter().zip(&image.coverage).flat_map(pixel).collect()
}

fn bytes(color: Rgb) -> [u8; 3] {
    color.to_array().map(|x| (srgb_encode(x) * 255.0 + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of which some are lamps.
    fn image(values: &[(f32, bool)]) -> Image {
        Image {
            width: values.len() as u32,
            height: 1,
            pixels: values.iter().map(|(v, _)| Rgb::splat(*v)).collect(),
            reflecting: values.iter().map(|(v, lamp)| if *lamp { 0.0 } else { *v }).collect(),
            rays: 0,
            error: vec![],
            coverage: vec![],
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
        assert_eq!(exposure(&[(1e-45, false); 4]), f32::MAX);
        let [dark, bright] = [1.0, 2.0].map(|value| image(&[(value, false); 9]));
        assert_eq!(automatic_exposure(&[&dark, &bright]), 0.4, "several images have one");
    }

    #[test]
    fn a_dark_surface_counts_as_one_that_reflects_a_fifth() {
        let irradiance = Rgb::splat(PI);
        for (reflectance, expected) in [(0.0, 0.2), (0.1, 0.2), (0.2, 0.2), (0.5, 0.5), (1.0, 1.0)]
        {
            let counted = exposed(irradiance, Rgb::splat(reflectance));
            assert!((counted - expected).abs() < 1e-6, "{reflectance}: {counted}");
        }
    }

    #[test]
    fn alpha_is_what_is_covered_and_the_colour_is_that_of_the_cover() {
        let half = Image { coverage: vec![0.5, 0.0], ..image(&[(0.5, false), (0.0, false)]) };
        assert_eq!(to_srgb_and_alpha(&half, 1.0), [255, 255, 255, 128, 0, 0, 0, 0]);
    }

    #[test]
    fn white_is_255_and_nothing_overflows() {
        assert_eq!(
            to_srgb(&image(&[0.0, 2.0, 9.0].map(|v| (v, false))), 0.5),
            [0, 0, 0, 255, 255, 255, 255, 255, 255]
        );
    }
}
