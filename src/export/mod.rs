//! Files: whole or not at all.

pub mod file;
pub mod picture;
