//! Where the differences lie: the scene in grey, with what differs in colour.

use super::{Cause, Comparison};
use crate::color::{Rgb, luminance};
use crate::render::Image;

impl Comparison {
    /// The smooth picture's luminance, in W·sr⁻¹·m⁻², with every pixel that differs coloured by the
    /// cause: the slightest, rounding, by a blue tint of the grey, all others as bright as white is at
    /// this `exposure`, so that they show in the darkest corner.
    ///
    /// | colour | cause |
    /// | --- | --- |
    /// | bluish grey | rounding |
    /// | yellow | patch boundary |
    /// | green | tie, touching |
    /// | cyan | precision |
    /// | magenta | the peer is wrong |
    /// | red | ours is wrong, or nothing explains it |
    pub fn difference_image(&self, exposure: f32) -> Image {
        let pixels = self.smooth.pixels.iter().zip(&self.causes);
        let color = |(pixel, cause): (&Rgb, &Option<Cause>)| match cause {
            None => Rgb::splat(luminance(*pixel)),
            Some(Cause::Rounding) => BLUISH * luminance(*pixel),
            Some(cause) => signal(*cause) / exposure,
        };
        Image { pixels: pixels.map(color).collect(), ..self.smooth.clone() }
    }
}

/// A tint of luminance 1: nearly every smooth pixel has it where tracers compute u and v differently.
const BLUISH: Rgb = Rgb::new(0.92, 1.0, 1.23);

fn signal(cause: Cause) -> Rgb {
    match cause {
        Cause::Rounding => BLUISH,
        Cause::PatchBoundary => Rgb::new(1.0, 0.8, 0.0),
        Cause::Tie | Cause::Touching => Rgb::new(0.0, 0.8, 0.0),
        Cause::Precision => Rgb::new(0.0, 0.8, 1.0),
        Cause::PeerWrong => Rgb::new(1.0, 0.0, 1.0),
        Cause::NativeWrong | Cause::Unexplained => Rgb::new(1.0, 0.0, 0.0),
    }
}
