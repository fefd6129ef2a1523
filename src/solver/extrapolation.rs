//! Slowly converging light: what many more sweeps would add.
//!
//! In a white cavity with a small opening each sweep leaves a factor near 1 of the error. After a few sweeps the error
//! consists of a few shapes, one for each such cavity, and so do the changes that the sweeps make. So a sum of these
//! changes is added to the last iterate, the one that leaves the least residual in the mean square, channel by channel
//! (*reduced rank extrapolation*: Sidi, *Vector Extrapolation Methods with Applications*, SIAM 2017, ch. 2). All
//! residuals are known, so this takes no look at the matrix.

use crate::color::Rgb64;

/// A radiosity and its residual S + ρFB − B, per patch; or the differences of two.
#[derive(Clone)]
pub(super) struct Iterate {
    pub radiosity: Vec<Rgb64>,
    pub residual: Vec<Rgb64>,
}

impl Iterate {
    /// Adds a multiple of another, for each channel its own.
    fn add(&mut self, multiple: Rgb64, other: &Iterate) {
        let add = |to: &mut [Rgb64], of: &[Rgb64]| {
            to.iter_mut().zip(of).for_each(|(to, of)| *to += multiple * *of);
        };
        add(&mut self.radiosity, &other.radiosity);
        add(&mut self.residual, &other.residual);
    }

    fn scale(&mut self, factor: Rgb64) {
        self.radiosity.iter_mut().chain(&mut self.residual).for_each(|x| *x *= factor);
    }

    /// Σ A r r′ per channel, of the residuals.
    fn product(&self, other: &Iterate, areas: &[f64]) -> Rgb64 {
        let residuals = self.residual.iter().zip(&other.residual);
        residuals.zip(areas).map(|((r, s), area)| *r * *s * *area).sum()
    }
}

/// What is left of a change that others have nearly made may be rounding.
const ROUNDING: f64 = 1e-20;

/// Where iterates that came one after the other lead to. What is below zero is no light, and becomes zero.
pub(super) fn extrapolated(mut iterates: Vec<Iterate>, areas: &[f64]) -> Vec<Rgb64> {
    let mut end = iterates.last().expect("an iterate").clone();
    // Each becomes the change that led to it, and the first is not needed.
    for i in (1..iterates.len()).rev() {
        let [before, change] = &mut iterates[i - 1..=i] else { unreachable!("two") };
        change.add(Rgb64::NEG_ONE, before);
    }
    for i in 1..iterates.len() {
        // Changes whose residuals are orthogonal to the others' can be added each by itself.
        let (others, rest) = iterates.split_at_mut(i);
        let change = &mut rest[0];
        let before = change.product(change, areas);
        for other in &others[1..] {
            change.add(-change.product(other, areas), other);
        }
        let left = change.product(change, areas);
        let is_new = left.cmpgt(before * ROUNDING);
        change.scale(Rgb64::select(is_new, left.powf(-0.5), Rgb64::ZERO));
        end.add(-end.product(change, areas), change);
    }
    end.radiosity.iter_mut().for_each(|b| *b = b.max(Rgb64::ZERO));
    end.radiosity
}
