//! Rays, triangles, and the two ways in which they meet.

pub mod bounds;
pub mod brute_force;
pub mod caster;
pub mod kernel;
pub mod moller_trumbore;
pub mod plane;
pub mod ray;
pub mod shapes;
pub mod surface;
pub mod triangle;

pub use brute_force::BruteForce;
pub use caster::RayCaster;
pub use kernel::{Kernel, KernelKind};
pub use moller_trumbore::MollerTrumbore;
pub use plane::Plane;
pub use ray::{Hit, Ray};
pub use triangle::{Triangle, TriangleId};
