//! A session on screens or in images.
//!
//! In: a [`Session`](crate::session::Session) and a stage. Out: windows ([`application`]) or PNG files ([`pictures`]), each
//! screen and eye drawn off-axis by [`render`](crate::render), with what a lab engineer calls up over them
//! ([`overlays`]): times and readings, the stage from outside, the test pattern.

pub mod application;
pub mod bodies;
pub mod device;
pub mod lettering;
pub mod model_window;
pub mod offscreen;
pub mod overlay;
pub mod overlays;
pub mod pattern;
pub mod pictures;
pub mod screen_windows;
pub mod stage_model;
pub mod window_frame;
pub mod window_layout;
