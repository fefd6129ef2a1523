//! Rays, triangles, and the two ways in which they meet.

pub mod bounds;
mod brute_force;
mod caster;
mod ending;
pub mod kernel;
pub mod moller_trumbore;
mod plane;
mod ray;
pub mod shapes;
pub(crate) mod surface;
pub mod triangle;

pub use brute_force::BruteForce;
pub use caster::{RayCaster, Stops};
pub use ending::Ending;
pub use kernel::{Kernel, KernelKind};
pub use moller_trumbore::MollerTrumbore;
pub use plane::Plane;
pub use ray::{Hit, Ray};
pub use triangle::{Triangle, TriangleId};
