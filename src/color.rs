//! Linear RGB: the three channels in which light is transported.

/// Linear RGB with Rec. 709 primaries. Radiance, exitance, irradiance or reflectance; the name of
/// the variable says which.
pub type Rgb = glam::Vec3;

/// [`Rgb`] in double precision, for sums.
pub type Rgb64 = glam::DVec3;

/// Sums, rounded to what is kept of them.
pub fn rounded(sums: &[Rgb64]) -> Vec<Rgb> {
    sums.iter().map(|sum| sum.as_vec3()).collect()
}

/// Relative luminance of Rec. 709 primaries (ITU-R BT.709).
pub fn luminance(color: Rgb) -> f32 {
    color.dot(Rgb::new(0.2126, 0.7152, 0.0722))
}

/// Luminance in double precision, as [`luminance`].
pub(crate) fn luminance64(color: Rgb64) -> f64 {
    color.dot(Rgb64::new(0.2126, 0.7152, 0.0722))
}

/// The sRGB transfer function (IEC 61966-2-1): linear [0, 1] to encoded [0, 1]. Clamps; NaN is 0.
pub fn srgb_encode(linear: f32) -> f32 {
    let x = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0) };
    if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_encode`]: encoded [0, 1] to linear [0, 1]. Clamps; NaN is 0.
pub fn srgb_decode(encoded: f32) -> f32 {
    let x = if encoded.is_nan() { 0.0 } else { encoded.clamp(0.0, 1.0) };
    if x <= 0.040_45 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_meets_its_published_values() {
        assert_eq!(srgb_encode(0.0), 0.0);
        assert!((srgb_encode(1.0) - 1.0).abs() < 1e-6);
        // Middle grey: linear 0.2140 is encoded as 0.5.
        assert!((srgb_encode(0.214_041_14) - 0.5).abs() < 1e-4);
        assert_eq!(srgb_encode(7.0), srgb_encode(1.0));
        assert_eq!(srgb_encode(f32::NAN), 0.0);
    }

    #[test]
    fn decoding_undoes_encoding() {
        for k in 0..=255 {
            let encoded = k as f32 / 255.0;
            assert!((srgb_encode(srgb_decode(encoded)) - encoded).abs() < 1e-5, "{k}");
        }
        assert_eq!((srgb_decode(f32::NAN), srgb_decode(-1.0), srgb_decode(2.0)), (0.0, 0.0, 1.0));
    }

    #[test]
    fn white_has_luminance_one() {
        assert!((luminance(Rgb::ONE) - 1.0).abs() < 1e-6);
    }
}
