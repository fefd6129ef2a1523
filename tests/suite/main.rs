//! What the library and the program do as a whole: one binary, a module for each module of `src`.

mod bad_input;
mod balance;
mod bench;
mod cases;
mod cli;
mod crowded;
#[cfg(feature = "embree")]
mod equivalence;
mod faults;
mod fields;
mod form_factor;
mod formats;
mod fuzz;
mod hostile;
mod intervals;
mod outputs;
mod overlaps;
mod radiosity;
mod render;
mod resume;
mod scenery;
mod scenes;
mod shipped;
mod shrinking;
mod signals;
mod snapshots;
mod structure;
mod two_level;
mod verify;
mod views;
