//! Rays per second, side by side with Embree.
//!
//! | file | holds |
//! | --- | --- |
//! | [`scenes`] | scenes made in memory from a seed: a box, a cluttered room, an atrium |
//! | [`rays`] | the rays that radiosity casts: camera, incoherent, segments |
//! | [`race`] | every engine over the same rays, in turns |

pub(crate) mod race;
pub(crate) mod rays;
pub(crate) mod scenes;
