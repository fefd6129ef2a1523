pub mod bvh;
pub mod color;
pub mod error;
pub mod geometry;
pub mod sampling;
