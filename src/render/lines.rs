//! Straight lines in the room, as wide in pixels wherever they are seen from.

use super::frame::{Drawable, FrameContents, Line};
use super::shader;
use super::strips::Strip;

impl Strip for Line {
    const NAME: &'static str = "lines";
    const SHADER: &'static [&'static str] = &[shader::VIEW, include_str!("../../shaders/lines.wgsl")];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] =
        &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32, 4 => Float32];

    fn of(contents: &FrameContents<'_>) -> Vec<Self> {
        contents.all(Drawable::lines).flatten().copied().collect()
    }
}
