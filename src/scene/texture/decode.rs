//! Decodes pictures from memory.

use super::{MAX_BYTES, MAX_SIDE, Texture, Wrap};
use crate::error::{Error, Result};
use crate::scene::budget;
use crate::scene::text::quote;
use image::{DynamicImage, ImageError, ImageFormat, ImageReader, Limits};
use std::io::Cursor;
use std::path::Path;

/// The formats, for messages.
const FORMATS: &str = "PNG, JPEG, TGA, BMP, WebP";

/// Decodes the `bytes` of a picture file. The ending of the `name` says the format where the content does not: a
/// TGA file begins with nothing in particular.
///
/// # Errors
/// Another format, a picture that is damaged or was cut short, one with more than 16,384 pixels along a side, or
/// one that takes more than 2²⁸ bytes. An error of kind [`Memory`](crate::error::ErrorKind::Memory) where these are
/// not there.
pub(crate) fn decode_texture(name: String, bytes: &[u8], wrap: [Wrap; 2]) -> Result<Texture> {
    let format = format_of(&name, bytes).ok_or_else(|| {
        Error::new("this is no picture in a format that is read")
            .remedy(format!("the formats are: {FORMATS}"))
    })?;
    let picture = decoded(&name, bytes, format)?.into_rgba8();
    let (width, height) = picture.dimensions();
    let pixels = picture.as_raw().as_chunks::<4>().0;
    if pixels.is_empty() {
        return Err(Error::new("the picture has no pixels").remedy("save it again"));
    }
    Ok(Texture::new(name, [width, height], pixels.into(), wrap))
}

fn format_of(name: &str, bytes: &[u8]) -> Option<ImageFormat> {
    use ImageFormat::{Bmp, Jpeg, Png, Tga, WebP};
    let guessed =
        image::guess_format(bytes).ok().or_else(|| ImageFormat::from_path(Path::new(name)).ok());
    guessed.filter(|format| [Png, Jpeg, Tga, Bmp, WebP].contains(format))
}

fn decoded(name: &str, bytes: &[u8], format: ImageFormat) -> Result<DynamicImage> {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_BYTES);
    let reader = || {
        let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
        reader.limits(limits.clone());
        reader
    };
    // Before anything is decoded, since what comes out is four bytes per pixel whatever went in.
    let (width, height) = reader().into_dimensions().map_err(|error| unreadable(&error))?;
    if width.max(height) > MAX_SIDE || 4 * u64::from(width) * u64::from(height) > MAX_BYTES {
        return Err(Error::new(format!("the picture has {width} × {height} pixels"))
            .remedy("scale it down: 8192 × 8192 pixels are the most"));
    }
    // Twice: as it is stored, with two bytes per number at most, and as it is used.
    let needed = (8 + 4) * u64::from(width) * u64::from(height);
    budget::check(&format!("the picture {}", quote(name)), needed, "scale it down")?;
    if format == ImageFormat::Jpeg && is_cut_short(bytes) {
        return Err(Error::new("the picture was cut short").remedy("copy it again"));
    }
    reader().decode().map_err(|error| unreadable(&error))
}

/// Whether a JPEG file has no end-of-image marker behind its last scan. Decoders make up the rest in grey. No
/// entropy-coded data holds either marker.
fn is_cut_short(bytes: &[u8]) -> bool {
    let last = |marker: [u8; 2]| bytes.windows(2).rposition(|pair| pair == marker);
    last([0xff, 0xd9]) < last([0xff, 0xda])
}

fn unreadable(error: &ImageError) -> Error {
    if matches!(error, ImageError::Limits(_)) {
        return Error::new("the picture is too large: 8192 × 8192 pixels are the most")
            .remedy("scale it down");
    }
    Error::new(format!("the picture is damaged or was cut short: {error}"))
        .remedy("open it in an image viewer and save it again")
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageBuffer, Luma, Rgb, Rgba};

    fn encode(picture: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format).expect("a picture");
        bytes.into_inner()
    }

    fn decode(name: &str, bytes: &[u8]) -> Result<Texture> {
        decode_texture(name.into(), bytes, [Wrap::Repeat; 2])
    }

    fn colors() -> DynamicImage {
        ImageBuffer::from_fn(3, 2, |x, y| Rgb([40 * x as u8, 100 * y as u8, 7])).into()
    }

    #[test]
    fn each_lossless_format_gives_the_pixels_from_the_top_left() {
        use ImageFormat::{Bmp, Png, Tga, WebP};
        for (format, name) in [(Png, "a"), (Bmp, "a"), (WebP, "a"), (Tga, "a.TGA")] {
            let texture = decode(name, &encode(&colors(), format)).expect("a picture");
            assert_eq!((texture.width, texture.height), (3, 2));
            assert_eq!(texture.pixels[0], [0, 0, 7, 255], "{format:?}");
            assert_eq!(texture.pixels[5], [80, 100, 7, 255], "{format:?}");
        }
    }

    #[test]
    fn grey_sixteen_bits_opacity_and_jpeg_are_converted() {
        let grey: DynamicImage = ImageBuffer::from_pixel(1, 1, Luma([0x8080u16])).into();
        let texture = decode("a.png", &encode(&grey, ImageFormat::Png)).expect("a picture");
        assert_eq!(*texture.pixels, [[0x80, 0x80, 0x80, 255]]);
        let clear: DynamicImage = ImageBuffer::from_pixel(1, 1, Rgba([1u8, 2, 3, 4])).into();
        let texture = decode("a.png", &encode(&clear, ImageFormat::Png)).expect("a picture");
        assert_eq!(*texture.pixels, [[1, 2, 3, 4]]);
        let even: DynamicImage = ImageBuffer::from_pixel(8, 8, Rgb([200u8, 200, 200])).into();
        // The content counts, not a wrong ending.
        let texture = decode("a.png", &jpeg(&even)).expect("a picture");
        assert!(texture.pixels.iter().all(|p| p[..3].iter().all(|c| c.abs_diff(200) < 3)));
    }

    fn jpeg(picture: &DynamicImage) -> Vec<u8> {
        encode(picture, ImageFormat::Jpeg)
    }

    #[test]
    fn what_is_cut_short_or_foreign_is_an_error() {
        let noise =
            ImageBuffer::from_fn(64, 64, |x, y| Rgb([(x * y) as u8, (x ^ y) as u8, x as u8]));
        let noise = DynamicImage::from(noise);
        for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Bmp, ImageFormat::WebP] {
            let bytes = encode(&noise, format);
            let error = decode("a", &bytes[..bytes.len() / 2]).expect_err("half").to_string();
            assert!(error.contains("cut short"), "{format:?}: {error}");
        }
        for (name, bytes) in [("a.png", &b""[..]), ("a.tga", b""), ("a", b"v 1 2 3\nf 1 1 1\n")] {
            assert!(decode(name, bytes).is_err(), "{name}");
        }
        let gif = decode("a.gif", b"GIF89a\x01\0\x01\0").expect_err("GIF").to_string();
        assert!(gif.contains("PNG"), "{gif}");
    }

    #[test]
    fn a_picture_that_is_too_large_is_refused_before_it_is_decoded() {
        // The head of a TGA file without its pixels: 16,000 × 16,000 in 24 bits.
        let mut head = [0u8; 18];
        (head[2], head[16]) = (2, 24);
        head[12..14].copy_from_slice(&16_000u16.to_le_bytes());
        head[14..16].copy_from_slice(&16_000u16.to_le_bytes());
        let error = decode("a.tga", &head).expect_err("large").to_string();
        assert!(error.contains("16000"), "{error}");
    }
}
