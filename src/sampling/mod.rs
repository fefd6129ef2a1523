//! Random and low-discrepancy points, the maps that carry them onto triangles and hemispheres, and what blocks of
//! them say of the error of a mean.
//!
//! Every number is a function of (seed, purpose, index) alone, never of a thread: that is what
//! makes a result the same on 1, 2 or 64 threads.

mod maps;
mod shuffled;
mod spread;
mod streams;
#[cfg(test)]
mod uniformity;

pub use maps::{cosine_hemisphere, orthonormal_basis, regular_triangle, uniform_triangle};
pub use shuffled::Shuffled;
pub use spread::EIGHTHS;
pub(crate) use spread::{
    LEVELS_OF_EIGHTHS, LEVELS_OF_QUARTERS, MOST_GAIN, MOST_GAIN_OF_JUMPS, QUARTERS, Spread, block,
    numbers, paired,
};
pub use streams::{PointSet, Purpose, Stream};
