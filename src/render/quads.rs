//! Translucent parallelograms in the room: one colour seen from the front, another from the back.

use super::frame::{Drawable, FrameContents, Quad};
use super::shader;
use super::strips::Strip;

impl Strip for Quad {
    const NAME: &'static str = "quads";
    const SHADER: &'static [&'static str] = &[shader::VIEW, include_str!("../../shaders/quads.wgsl")];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] = &wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x4, 4 => Float32x4];

    fn of(contents: &FrameContents<'_>) -> Vec<Self> {
        contents.all(Drawable::quad).copied().collect()
    }
}
