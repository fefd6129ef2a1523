//! Files: whole or not at all.

pub(crate) mod file;
pub(crate) mod picture;
pub(crate) mod sealed;
pub(crate) mod staging;
