//! Size and sampling of a picture, and what is seen behind the scene.

use crate::color::Rgb;
use crate::sampling::QUARTERS;
use crate::settings::Settings;
use std::time::Instant;

/// What is seen behind the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Background {
    Radiance(Rgb),
    /// Nothing: pictures have an alpha channel.
    Transparent,
}

/// Size and sampling of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    pub width: u32,
    pub height: u32,
    /// Samples per pixel.
    pub samples: u32,
    /// Gathered pictures: one round only, unless `error` or `deadline` is given.
    pub in_one_round: bool,
    pub seed: u64,
    /// Gathered pictures: the relative standard error at which a pixel is good enough. `None`: a quick picture.
    pub error: Option<f32>,
    /// Gathered pictures: until when they may become better. The result depends on the machine.
    pub deadline: Option<Instant>,
    /// What a ray shows that leaves the scene. `None`: the scene's radiance.
    pub background: Option<Background>,
}

impl Frame {
    /// Samples per pixel unless another number is asked for.
    pub const SAMPLES: u32 = 16;

    /// Width and height in pixels unless others are asked for.
    pub const SIZE: [u32; 2] = [640, 480];

    /// A picture of this size in pixels.
    pub fn new(width: u32, height: u32) -> Frame {
        Frame {
            width,
            height,
            samples: Frame::SAMPLES,
            in_one_round: false,
            seed: Settings::SEED,
            error: None,
            deadline: None,
            background: None,
        }
    }

    /// The number of the pixel at (x, y), row by row from the top left.
    pub(super) fn pixel_number(&self, (x, y): (usize, usize)) -> u64 {
        y as u64 * self.width as u64 + x as u64
    }

    /// Whether a pixel has a sample in each quarter of them. Without that nothing is known of its error.
    pub(crate) fn tells_errors(&self) -> bool {
        self.samples >= QUARTERS as u32
    }

    pub fn rays(&self) -> u64 {
        self.width as u64 * self.height as u64 * self.samples as u64
    }
}
