//! The stage as a model, seen from outside: [`StageModel`] holds what is drawn, a [`Camera`] looks at it.

mod camera;
mod extent;
mod model;

pub use camera::{Camera, Orbit};
pub use model::{StageModel, write_names};
