//! Files: whole or not at all.

mod destination;
pub(crate) mod file;
pub(crate) mod picture;
pub(crate) mod sealed;
pub(crate) mod staging;
