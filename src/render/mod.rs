//! Pictures: a deformed surface, the stylus and the floor, drawn once per screen and eye.
//!
//! In come deformed vertices, poses and one off-axis [`View`] per viewport; out go window frames or `RgbaImage`s.
//! Each body is uploaded once per frame and drawn from there for all screens and eyes, in one pass per target, with
//! reversed infinite depth (Upchurch and Desbrun, "Tightening the precision of perspective rendering", 2012).
//!
//! The way of a frame: [`BodyBuffers::upload`] or [`BodyBuffers::deform`] → [`FrameContents`] → [`Renderer::draw`] of
//! one [`Picture`] per target → [`Offscreen::read`] or [`window::run`], which presents all windows together. Where a
//! window shows both eyes, [`TilePainter`] draws a picture for each, on which an [`Overlay`] may write, and joins them
//! ([`Composite`]). Each pass is `src/render/X.rs` with `shaders/X.wgsl`: body, solid (styli, rays, hit points, arrows,
//! balls), formed (with the solid's shader), background, grid, ghost, quads, lines, composite; and for bodies that the device deforms itself: deform, parts (for
//! bodies of several parts), normals. Every pass makes its pipelines when it first has something to draw.
mod body;
mod body_buffers;
mod chunk;
mod color_map;
mod columns;
mod composite;
mod deform;
mod error;
mod formed;
mod frame;
mod ghost;
mod gpu;
mod grid;
mod ground;
#[cfg(test)]
mod layout;
mod lighting;
mod normals;
mod offscreen;
mod overlay;
mod parts;
mod pass;
mod patches;
mod pattern;
mod renderer;
mod shader;
mod shadow;
mod shapes;
mod solid;
mod strips;
mod target;
mod tiles;
mod view;
pub mod window;

pub use body_buffers::BodyBuffers;
pub use color_map::{beyond_color, field_code, map_color};
pub use composite::{Anaglyph, Composite, Matrix};
pub use error::RenderError;
pub use frame::{
    Arrow, Ball, BodyInstance, Drawable, Formed, FrameContents, Ghost, GhostShape, Grid, Line, Quad,
    StylusShape,
};
pub use gpu::{Gpu, ResourceCounts};
pub use lighting::Lighting;
pub use offscreen::{COLOR_FORMAT, Offscreen, Readable};
pub use overlay::{Overlay, OverlayMesh};
pub use pass::DrawCounts;
pub use pattern::Pattern;
pub use renderer::Renderer;
pub use shadow::Shadows;
pub use target::{Attachments, Picture, Samples};
pub use tiles::{Canvas, EyePair, EyePicture, Paint, Show, Target, Tile, TilePainter};
pub use view::{Bounds, View, Viewport};

/// The default filter of the log: the libraries used here log too much.
pub const LOGGED: &str = "warn,winit=error,egui_wgpu=error";
