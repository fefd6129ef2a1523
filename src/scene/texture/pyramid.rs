//! The mip pyramid of a picture: each level half as wide and high as the one before.

use super::Texture;
use crate::color::srgb_decode;
use glam::{DVec4, Vec4};
use std::ops::Range;
use std::sync::{Arc, LazyLock, OnceLock};

/// Linear red, green, blue, and opacity of the levels above 0, which is the picture itself. Each level has the
/// picture's mean.
#[derive(Debug, Default)]
pub(super) struct Pyramid {
    /// The size of each level, from the picture's down to 1 × 1.
    sizes: Vec<[u32; 2]>,
    /// Row by row from the top left; the first belongs to level 1.
    levels: Vec<Vec<Vec4>>,
}

impl Pyramid {
    pub(super) fn of(texture: &Texture) -> Pyramid {
        let mut size = [texture.width, texture.height];
        let mut pyramid = Pyramid { sizes: vec![size], levels: Vec::new() };
        while size != [1, 1] {
            let next = size.map(|side| (side / 2).max(1));
            let level = pyramid.last_level();
            let row = |y| -> Vec<Vec4> {
                let texels = (0..size[0]).map(|x| pyramid.texel(texture, level, x, y));
                narrowed(&texels.collect::<Vec<Vec4>>(), next[0])
            };
            let halved = lowered(size[1], next, row);
            pyramid.sizes.push(next);
            pyramid.levels.push(halved);
            size = next;
        }
        pyramid
    }

    pub(super) fn last_level(&self) -> usize {
        self.sizes.len() - 1
    }

    pub(super) fn size(&self, level: usize) -> [u32; 2] {
        self.sizes[level]
    }

    /// `texture` is the picture of this pyramid.
    pub(super) fn texel(&self, texture: &Texture, level: usize, x: u32, y: u32) -> Vec4 {
        let index = (y * self.sizes[level][0] + x) as usize;
        match level {
            0 => decoded(texture.pixels[index]),
            _ => self.levels[level - 1][index],
        }
    }

    /// The sum of some texels of a row.
    pub(super) fn sum(&self, texture: &Texture, level: usize, y: u32, run: Range<u32>) -> DVec4 {
        let first = (y * self.sizes[level][0]) as usize;
        let run = first + run.start as usize..first + run.end as usize;
        match level {
            0 => sum_decoded(&texture.pixels[run]),
            _ => self.levels[level - 1][run].iter().map(|texel| texel.as_dvec4()).sum(),
        }
    }
}

/// Which texels a wider texel covers, and the share of it that each has. Sides that are odd share a texel
/// between two.
fn covered(from: u32, to: u32, index: u32) -> impl Iterator<Item = (usize, f32)> {
    let (from, to) = (u64::from(from), u64::from(to));
    // In units of 1 / (from · to) of the side, whole numbers throughout.
    let (start, end) = (u64::from(index) * from, (u64::from(index) + 1) * from);
    (start / to..end.div_ceil(to)).map(move |i| {
        let overlap = end.min((i + 1) * to) - start.max(i * to);
        (i as usize, (overlap as f64 / from as f64) as f32)
    })
}

fn narrowed(row: &[Vec4], width: u32) -> Vec<Vec4> {
    let from = row.len() as u32;
    let mean = |x| covered(from, width, x).map(|(i, share)| row[i] * share).sum();
    (0..width).map(mean).collect()
}

/// Averages narrowed rows. Each is asked for once or twice, one after the other.
fn lowered(height: u32, [_, to]: [u32; 2], row: impl Fn(u32) -> Vec<Vec4>) -> Vec<Vec4> {
    let mean_row = |y| {
        let weighted = covered(height, to, y).map(|(i, share)| (row(i as u32), share));
        weighted.fold(Vec::new(), |mut sum: Vec<Vec4>, (row, share)| {
            sum.resize(row.len(), Vec4::ZERO);
            sum.iter_mut().zip(row).for_each(|(sum, texel)| *sum += texel * share);
            sum
        })
    };
    (0..to).flat_map(mean_row).collect()
}

static LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|k| srgb_decode(k as f32 / 255.0)));

fn decoded([r, g, b, opacity]: [u8; 4]) -> Vec4 {
    let [r, g, b] = [r, g, b].map(|channel| LINEAR[channel as usize]);
    Vec4::new(r, g, b, f32::from(opacity) / 255.0)
}

fn sum_decoded(pixels: &[[u8; 4]]) -> DVec4 {
    let linear = &*LINEAR;
    // Two sums, so that an addition need not wait for the one before.
    let (mut sums, mut opacity) = ([[0f64; 3]; 2], 0u64);
    for pair in pixels.chunks(2) {
        for (sum, [r, g, b, a]) in sums.iter_mut().zip(pair) {
            for (sum, channel) in sum.iter_mut().zip([r, g, b]) {
                *sum += f64::from(linear[usize::from(*channel)]);
            }
            opacity += u64::from(*a);
        }
    }
    let [r, g, b] = [0, 1, 2].map(|channel| sums[0][channel] + sums[1][channel]);
    DVec4::new(r, g, b, opacity as f64 / 255.0)
}

/// A pyramid that is built when it is first needed and shared by clones. It follows from the picture, so that
/// it takes no part in comparisons.
#[derive(Debug, Clone, Default)]
pub(super) struct KnownPyramid(Arc<OnceLock<Pyramid>>);

impl KnownPyramid {
    pub(super) fn get(&self, texture: &Texture) -> &Pyramid {
        self.0.get_or_init(|| Pyramid::of(texture))
    }
}

impl PartialEq for KnownPyramid {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::Wrap;
    use super::*;

    fn noise(width: u32, height: u32) -> Texture {
        let pixel = |i: u32| i.wrapping_mul(2_654_435_761).to_le_bytes();
        let pixels: Vec<[u8; 4]> = (0..width * height).map(pixel).collect();
        Texture::new("noise".into(), [width, height], pixels.into(), [Wrap::Repeat; 2])
    }

    #[test]
    fn each_level_has_the_mean_of_the_picture() {
        for (width, height) in [(1, 1), (8, 8), (7, 5), (13, 1), (1, 6), (33, 64)] {
            let texture = noise(width, height);
            let pyramid = Pyramid::of(&texture);
            let mean = |level: usize| {
                let [w, h] = pyramid.size(level);
                let texels = (0..w * h).map(|i| pyramid.texel(&texture, level, i % w, i / w));
                texels.map(Vec4::as_dvec4).sum::<glam::DVec4>() / f64::from(w * h)
            };
            for level in 0..=pyramid.last_level() {
                let off = (mean(level) - mean(0)).abs().max_element();
                assert!(off < 1e-6, "{width} × {height}, level {level}: {off}");
            }
            assert_eq!(pyramid.size(pyramid.last_level()), [1, 1]);
        }
    }

    #[test]
    fn an_odd_side_shares_its_middle_texel() {
        let shares: Vec<_> = (0..2).map(|x| covered(3, 2, x).collect::<Vec<_>>()).collect();
        let third = (1.0f64 / 3.0) as f32;
        let two_thirds = (2.0f64 / 3.0) as f32;
        assert_eq!(shares, [[(0, two_thirds), (1, third)], [(1, third), (2, two_thirds)]]);
    }
}
