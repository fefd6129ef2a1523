//! Who is right when two ray tracers differ: an exact referee, and verdicts.
//!
//! From the bottom up:
//!
//! | file | holds |
//! | --- | --- |
//! | `cramer` | Cramer's determinants for one ray and one triangle in f64, with their rounding |
//! | `exact` | the same determinants' signs, and comparisons of distances, without any rounding |
//! | `contact` | whether one ray meets one triangle: miss, touch or hit, decided exactly |
//! | [`bounds`] | how far each f32 kernel, ours or Embree's, may stray from it |
//! | `referee` | the truth about one ray and all triangles |
//! | [`verdict`] | two answers and the truth: agree, tie, touching, precision, or who is wrong |
//! | `tally` | verdicts, counted |
//! | [`cross_checked`] | two casters asked at once, in the place of one |
//! | `rays` | rays to ask about, ordinary and adversarial |
//! | `survey` | every kind of ray through every pair of casters |
//! | `interior` | points inside closed meshes of any shape |
//! | `leaks` | how often a closed mesh lets a ray out |
//! | `grid` | scenes of small integers, on which every bit is demanded |
//! | `stress_mesh` | a mesh of slivers, duplicates, overlaps and the like |
//! | `source` | rays, triangles and answers as Rust source, bit for bit, to paste into a test |
//!
//! The checks prove themselves at every run of the tests: over twenty deliberate faults, in the data of
//! the hierarchy and in its kernel, are each caught by one of them (`mutants`).
//!
//! Nothing here is decided by a guessed tolerance. What is true is decided exactly: f64 with a
//! proven bound first, `robust`'s expansions next, integers of any length last. What an f32 kernel
//! may be forgiven is derived, rounding by rounding, in [`bounds`].

pub mod bounds;
pub(crate) mod contact;
pub(crate) mod cramer;
pub mod cross_checked;
pub(crate) mod exact;
pub(crate) mod grid;
pub(crate) mod interior;
pub(crate) mod leaks;
pub(crate) mod rays;
pub(crate) mod referee;
pub(crate) mod source;
pub(crate) mod stress_mesh;
pub(crate) mod survey;
pub(crate) mod tally;
pub mod verdict;

#[cfg(test)]
mod mutants;
#[cfg(test)]
mod rational;

pub use bounds::Arithmetic;
pub use contact::Contact;
pub use referee::Referee;
pub use verdict::{Grade, Judge, Judgement, Verdict};
