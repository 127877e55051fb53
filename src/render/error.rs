//! Errors between a frame's data and its picture, with the numbers and the remedy.

use crate::base::failure::Failure;

/// Every failure of the renderer.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    #[error(
        "no graphics device: no adapter by Vulkan or OpenGL ({0}). Install a driver, or a software one \
         (Debian: apt install mesa-vulkan-drivers)"
    )]
    NoAdapter(String),
    #[error("the graphics device {adapter} refused to open: {reason}")]
    NoDevice { adapter: String, reason: String },
    #[error(
        "{adapter} cannot draw {format:?} pictures with {samples} samples a pixel; it offers {offered:?}"
    )]
    Samples { adapter: String, format: wgpu::TextureFormat, samples: u32, offered: Vec<u32> },
    #[error(
        "a picture of {width} × {height} pixels cannot be drawn: this device allows 1 to {limit} each way"
    )]
    PictureSize { width: u32, height: u32, limit: u32 },
    #[error(
        "the {what} need {bytes} bytes, and this device allows {limit} in one buffer: use a coarser surface"
    )]
    BufferSize { what: &'static str, bytes: u64, limit: u64 },
    #[error(
        "viewport {rect:?} (x, y, width, height) does not lie within its picture of {width} × {height} pixels"
    )]
    ViewportOutside { rect: [u32; 4], width: u32, height: u32 },
    #[error("a target with {found} samples a pixel was handed to a renderer made for {expected}")]
    SamplesDiffer { found: u32, expected: u32 },
    #[error(
        "{adapter} cannot draw both eyes in one pass with {samples} samples a pixel: use --multiview auto or off"
    )]
    NoMultiview { adapter: String, samples: u32 },
    #[error("a pass for both eyes needs two viewports of one rectangle; {found} were handed over")]
    NotAPair { found: usize },
    #[error(
        "a body needs at least one triangle and one vertex; this has {vertices} vertices, {triangles} triangles"
    )]
    EmptyBody { vertices: usize, triangles: usize },
    #[error("triangle {triangle} names vertex {vertex}, but the body has only {vertices} vertices")]
    VertexOutOfRange { triangle: usize, vertex: u32, vertices: usize },
    #[error("{found} {what} were handed over for a body of {expected} vertices")]
    VertexCount { what: &'static str, found: usize, expected: usize },
    #[error("columns of {numbers} numbers were handed over for a body of {per_column} numbers a column")]
    ColumnLength { numbers: usize, per_column: usize },
    #[error("the columns of one body must all be stored alike")]
    MixedStorage,
    #[error("{found} coefficients were handed over for a body of {expected} columns")]
    CoefficientCount { found: usize, expected: usize },
    #[error("{found} motions were handed over for a body of {expected} parts")]
    PartCount { found: usize, expected: usize },
    #[error("the graphics device reported: {0}")]
    Device(String),
    #[error("no display to open windows on: {0}")]
    NoDisplay(String),
    #[error("window {window} (\"{title}\"): {reason}")]
    Window { window: usize, title: String, reason: String },
    #[error("viewports for {found} windows were handed over, but {expected} are open")]
    WindowCount { found: usize, expected: usize },
    /// The error that the application returned from its own part of the frame.
    #[error(transparent)]
    App(Box<dyn std::error::Error + Send + Sync>),
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Failure {
        match error {
            RenderError::PictureSize { .. } | RenderError::BufferSize { .. } => Failure::request(error),
            _ => Failure::work(error),
        }
    }
}
