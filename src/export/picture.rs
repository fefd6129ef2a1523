//! Pictures in the formats that people open: PNG for the eye, EXR and HDR for numbers.

use super::file::{Inputs, Output, write_all};
use crate::error::{Error, Result};
use crate::render::{Image, tone};
use exr::image::write::WritableImage;
use exr::image::{AnyChannel, AnyChannels, FlatSamples};
use image::codecs::hdr::HdrEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageFormat, Rgb32FImage, Rgba32FImage};
use std::io::Cursor;
use std::path::Path;

impl Image {
    /// Writes a picture in the format of the name's ending: `.png` (sRGB, after the exposure), `.exr` or
    /// `.hdr` (linear radiance). Whole or not at all. Over a transparent background PNG and EXR have an alpha
    /// channel, by which the colours are multiplied in EXR, as its readers expect. Where its errors are known, EXR
    /// has them too: the standard error of each pixel's luminance is the channel `Y` of the layer `error`.
    ///
    /// # Errors
    /// An ending that nobody writes, and whatever the system says.
    pub fn save(&self, path: impl AsRef<Path>, exposure: f32) -> Result<()> {
        let path = path.as_ref();
        let bytes = Format::of(path)?.encode(self, exposure)?;
        write_all(vec![Output { path: path.to_path_buf(), bytes }], &Inputs::default())
    }

    fn is_transparent(&self) -> bool {
        !self.coverage.is_empty()
    }
}

/// A file format, known by the file's ending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// 8-bit sRGB after an exposure.
    Png,
    /// Linear radiance, 32-bit float.
    Exr,
    /// Linear radiance, Radiance's shared exponent (about 1 % steps).
    Hdr,
}

impl Format {
    /// # Errors
    /// An ending that nobody writes.
    pub(crate) fn of(path: &Path) -> Result<Format> {
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        match ending.as_deref() {
            Some("png") => Ok(Format::Png),
            Some("exr") => Ok(Format::Exr),
            Some("hdr") => Ok(Format::Hdr),
            _ => Err(Error::new("no picture format has this ending")
                .in_file(path)
                .remedy("use .png (sRGB), .exr or .hdr (linear radiance)")),
        }
    }

    /// The file's bytes. `exposure` concerns PNG alone.
    ///
    /// # Errors
    /// Whatever the encoder refuses.
    pub(crate) fn encode(self, image: &Image, exposure: f32) -> Result<Vec<u8>> {
        let (width, height) = (image.width, image.height);
        let mut bytes = Cursor::new(Vec::new());
        let encoded = match self {
            Format::Png => {
                let quality = (CompressionType::Fast, FilterType::Adaptive);
                let (pixels, color) = match image.is_transparent() {
                    true => (tone::to_srgb_and_alpha(image, exposure), ExtendedColorType::Rgba8),
                    false => (tone::to_srgb(image, exposure), ExtendedColorType::Rgb8),
                };
                PngEncoder::new_with_quality(&mut bytes, quality.0, quality.1)
                    .write_image(&pixels, width, height, color)
            }
            Format::Exr if !image.error.is_empty() => return exr_with_errors(image),
            Format::Exr if image.is_transparent() => {
                let pixels = image.pixels.iter().zip(&image.coverage);
                let values = pixels.flat_map(|(p, alpha)| p.extend(*alpha).to_array()).collect();
                Rgba32FImage::from_raw(width, height, values)
                    .expect("four values per pixel")
                    .write_to(&mut bytes, ImageFormat::OpenExr)
            }
            Format::Exr => {
                let values = image.pixels.iter().flat_map(|p| p.to_array()).collect();
                Rgb32FImage::from_raw(width, height, values)
                    .expect("three values per pixel")
                    .write_to(&mut bytes, ImageFormat::OpenExr)
            }
            Format::Hdr => {
                let values: Vec<_> =
                    image.pixels.iter().map(|p| image::Rgb(p.to_array())).collect();
                HdrEncoder::new(&mut bytes).encode(&values, width as usize, height as usize)
            }
        };
        encoded.map_err(refused)?;
        Ok(bytes.into_inner())
    }
}

fn refused(error: impl std::fmt::Display) -> Error {
    Error::new(format!("cannot encode the picture: {error}"))
}

/// One part whose channels `R`, `G` and `B` are the picture: programs that know no layers read these, and pass the
/// channel `error.Y` over.
fn exr_with_errors(image: &Image) -> Result<Vec<u8>> {
    let channel = |name: &str, values| AnyChannel::new(name, FlatSamples::F32(values));
    let colour = |i: usize| image.pixels.iter().map(|pixel| pixel[i]).collect();
    let mut channels = vec![
        channel("R", colour(0)),
        channel("G", colour(1)),
        channel("B", colour(2)),
        channel("error.Y", image.error.clone()),
    ];
    if image.is_transparent() {
        channels.push(channel("A", image.coverage.clone()));
    }
    let channels = AnyChannels::sort(channels.into_iter().collect());
    let mut bytes = Cursor::new(Vec::new());
    let size = (image.width as usize, image.height as usize);
    let picture = exr::image::Image::from_channels(size, channels);
    picture.write().to_buffered(&mut bytes).map_err(refused)?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Rgb;

    fn image() -> Image {
        let pixels = (0..6).map(|i| Rgb::new(i as f32, 0.5, 4.0 - 0.5 * i as f32)).collect();
        Image {
            width: 3,
            height: 2,
            pixels,
            reflecting: vec![0.0; 6],
            rays: 0,
            error: vec![],
            coverage: vec![],
        }
    }

    #[test]
    fn exr_keeps_every_bit() {
        let bytes = Format::Exr.encode(&image(), 9.0).unwrap();
        let read = image::load_from_memory_with_format(&bytes, ImageFormat::OpenExr).unwrap();
        let values: Vec<f32> = image().pixels.iter().flat_map(|p| p.to_array()).collect();
        assert_eq!(read.into_rgb32f().into_raw(), values);
    }

    #[test]
    fn exr_has_the_errors_in_a_layer_that_plain_readers_pass_over() {
        for coverage in [vec![], vec![0.25; 6]] {
            let error: Vec<f32> = (0..6).map(|i| 0.1 + i as f32).collect();
            let plain = Image { coverage, ..image() };
            let [with, without] = [&Image { error: error.clone(), ..plain.clone() }, &plain]
                .map(|image| Format::Exr.encode(image, 1.0).unwrap());
            let read = |bytes| image::load_from_memory_with_format(bytes, ImageFormat::OpenExr);
            assert_eq!(read(&with).unwrap(), read(&without).unwrap());
            use exr::prelude::{ReadChannels, ReadLayers};
            let layers = exr::prelude::read()
                .no_deep_data()
                .largest_resolution_level()
                .all_channels()
                .all_layers()
                .all_attributes()
                .from_buffered(Cursor::new(&with))
                .unwrap();
            let [layer] = &layers.layer_data[..] else { panic!("one part") };
            let channels = &layer.channel_data.list;
            let of_errors = channels.iter().find(|channel| channel.name.eq("error.Y")).unwrap();
            assert_eq!(of_errors.sample_data.values_as_f32().collect::<Vec<_>>(), error);
            assert_eq!(channels.len(), 4 + plain.is_transparent() as usize);
        }
    }

    #[test]
    fn a_transparent_background_gives_png_and_exr_an_alpha_channel() {
        let image = Image { coverage: vec![0.25; 6], ..image() };
        for (format, encoded) in
            [(Format::Png, ImageFormat::Png), (Format::Exr, ImageFormat::OpenExr)]
        {
            let bytes = format.encode(&image, 1.0).unwrap();
            let read = image::load_from_memory_with_format(&bytes, encoded).unwrap();
            assert!(read.color().has_alpha());
            assert!(read.into_rgba32f().pixels().all(|p| (p.0[3] - 0.25).abs() < 0.002));
        }
    }

    #[test]
    fn hdr_keeps_one_percent_of_the_largest_channel() {
        let bytes = Format::Hdr.encode(&image(), 9.0).unwrap();
        let read = image::load_from_memory_with_format(&bytes, ImageFormat::Hdr).unwrap();
        for (read, pixel) in read.into_rgb32f().pixels().zip(&image().pixels) {
            let off = (Rgb::from(read.0) - *pixel).abs().max_element();
            assert!(off <= pixel.max_element() / 128.0, "{read:?} {pixel}");
        }
    }

    #[test]
    fn png_is_exposed_and_encoded() {
        let bytes = Format::Png.encode(&image(), 0.25).unwrap();
        let read = image::load_from_memory_with_format(&bytes, ImageFormat::Png).unwrap();
        // 4 × 0.25 is white; 0 is black; 0.125 is 99 in sRGB.
        assert_eq!(read.into_rgb8().get_pixel(0, 0).0, [0, 99, 255]);
    }

    #[test]
    fn endings_decide_whatever_their_case() {
        assert_eq!(Format::of(Path::new("a/b.PNG")), Ok(Format::Png));
        for bad in ["a.jpg", "a", "", ".png"] {
            assert!(Format::of(Path::new(bad)).is_err(), "{bad}");
        }
    }
}
