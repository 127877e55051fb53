//! Pictures: a deformed surface, the stylus and the floor, drawn once per screen and eye.
//!
//! In come deformed vertices, poses and one off-axis [`View`] per viewport; out go window frames or `RgbaImage`s.
//! Each body is uploaded once per frame and drawn from there for all screens and eyes, in one pass per target, with
//! reversed infinite depth (Upchurch and Desbrun, "Tightening the precision of perspective rendering", 2012).
//!
//! The way of a frame: [`BodyBuffers::upload`] or [`BodyBuffers::deform`] → [`FrameContents`] → [`Renderer::draw`] of
//! one [`Picture`] per target → [`Offscreen::read`] or [`window::run`], which presents all windows together. One pass,
//! one shader of the same name under `shaders/`: body, solid (stylus, ray, hit point), background, grid; and for bodies
//! that the device deforms itself: deform, normals. An [`Overlay`] writes over it.

mod body;
mod bounds;
mod chunk;
mod clock;
mod columns;
mod deform;
mod error;
mod frame;
mod gpu;
mod normals;
mod offscreen;
mod overlay;
mod pair;
mod pipelines;
mod renderer;
mod shader;
mod solid;
mod target;
mod uniforms;
pub mod window;

pub use body::BodyBuffers;
pub use bounds::Bounds;
pub use columns::ColumnData;
pub use error::RenderError;
pub use frame::{BodyInstance, FrameContents, Grid, Look, StylusShape, View, Viewport};
pub use gpu::{Gpu, Made};
pub use offscreen::{COLOR_FORMAT, Offscreen};
pub use overlay::{Overlay, Sheet};
pub use pair::EyePair;
pub use renderer::{DrawCounts, Renderer};
pub use target::{Attachments, Picture};
