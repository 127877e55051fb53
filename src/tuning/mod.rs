//! Chooses the settings of a body that asks for an accuracy or a budget instead of naming them.
//!
//! In: a scene, and rows that [`measure`](crate::measure) measured on this body or that its .green file keeps. Out: the
//! scene with element, refinement, solver, storage and model chosen for every body that asks.

mod choice;
mod planner;
pub mod poses;

pub use choice::{Choice, answer, choose, miss, time};
pub use planner::{answered, forget_steps, settle, settle_from_file};
