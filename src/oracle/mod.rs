//! Embree as oracle: another ray tracer, by other people, behind the same [`RayCaster`] interface.
//!
//! A [`Device`] makes a [`SceneBuilder`], which takes triangles and, committed, becomes an
//! [`EmbreeScene`]; only that can be traced. Every Embree object is released when its owner is
//! dropped, and every Embree error becomes an [`Error`](crate::error::Error) with Embree's own
//! words. All `unsafe` of the boundary lies in this folder.
//!
//! ```no_run
//! use isolux::geometry::{Ray, RayCaster, Triangle};
//! use isolux::oracle::{Device, EmbreeScene, Options};
//! # fn run(triangles: &[Triangle], ray: &Ray) -> isolux::error::Result<()> {
//! let scene = EmbreeScene::build(&Device::new("")?, triangles, Options::default())?;
//! let hit = scene.nearest(ray);
//! # Ok(()) }
//! ```
//!
//! A scene that is not committed cannot be traced:
//!
//! ```compile_fail,E0599
//! use isolux::geometry::{Ray, RayCaster};
//! use isolux::oracle::SceneBuilder;
//! fn trace(scene: &SceneBuilder, ray: &Ray) -> bool {
//!     scene.occluded(ray)
//! }
//! ```
//!
//! `layout` holds the structs as the installed Embree lays them out; `embree4_sys` serves the
//! functions, handles and enums.
//!
//! [`RayCaster`]: crate::geometry::RayCaster

mod cast;
mod device;
mod error;
mod isa;
mod layout;
mod memory;
mod packet;
mod query;
mod scene;

#[cfg(test)]
mod tests;

pub use device::Device;
pub use isa::Isa;
pub use scene::{EmbreeScene, Options, Packets, SceneBuilder};
