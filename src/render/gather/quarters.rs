//! Quarters of the samples, and what they say of the error of the whole.
//!
//! A pixel's samples, in their order, fall into quarters. Each is a low-discrepancy set moved at random, and right
//! in the mean; but the quarters of one set are not independent, as they fill each other's gaps. Let V(N) be the
//! variance of the mean of N samples. From the mean's own variance, (V(N/2) + covariance of the halves)/2 = V(N), follows
//!
//! ```text
//! E (half − half)² / 4 = V(N/2) − V(N),   E (quarter − quarter)² / 4 = V(N/4) − V(N/2) within a half.
//! ```
//!
//! If V falls as N^−a, the second is 2^a times the first: so both together give a and V(N), as Aitken extrapolates a
//! geometric sequence (*Proc. Roy. Soc. Edinburgh* 46, 1926). Independent samples have a = 1. Eight independent sets
//! would need no law, and cost the evenness of one: at equal work relMSE was 3.6 to 5.5 times as large.

pub(super) const QUARTERS: usize = 4;

/// The quarter of sample `number` where there are `samples` in general, at least one in each; more go round again.
pub(super) fn quarter(number: u32, samples: u32) -> usize {
    (number as u64 * QUARTERS as u64 / samples as u64) as usize % QUARTERS
}

/// The squared differences of a value's quarters, in the mean.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Spread {
    /// V(N/2) − V(N).
    halves: f32,
    /// V(N/4) − V(N/2).
    quarters: f32,
}

impl Spread {
    pub(super) fn of([a, b, c, d]: [f32; QUARTERS]) -> Spread {
        let half = (a + b - c - d) / 2.0;
        Spread { halves: half * half / 4.0, quarters: ((a - b).powi(2) + (c - d).powi(2)) / 8.0 }
    }

    pub(super) fn add(&mut self, other: &Spread) {
        self.halves += other.halves;
        self.quarters += other.quarters;
    }

    pub(super) fn scaled(self, factor: f32) -> Spread {
        Spread { halves: self.halves * factor, quarters: self.quarters * factor }
    }

    /// 2^a, from that of independent samples, a = 1, up to `most`.
    pub(super) fn gain(&self, most: f32) -> f32 {
        let gain = self.quarters / self.halves;
        // Where there is nothing to tell it by, samples count as independent.
        if gain.is_finite() { gain.clamp(2.0, most) } else { 2.0 }
    }

    /// V(N).
    pub(super) fn variance(&self, gain: f32) -> f32 {
        (self.halves + self.quarters) / (gain * gain - 1.0)
    }
}
