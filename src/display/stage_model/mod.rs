//! The stage as a model, seen from outside: [`StageModel`] holds the lines, quads, balls and labels, a [`Camera`] looks at
//! them.

mod camera;
mod model;

pub use camera::{Camera, Orbit};
pub use model::{StageModel, write_names};
