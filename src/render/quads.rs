//! Translucent parallelograms in the room: one colour seen from the front, another from the back.

use super::instanced::Strip;
use super::shader;

/// One parallelogram, as it lies in the buffer. Its front is where `right`, `up` turn counter-clockwise.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Quad {
    pub corner: [f32; 3],
    pub right: [f32; 3],
    pub up: [f32; 3],
    /// Linear RGB and opacity.
    pub front: [f32; 4],
    pub back: [f32; 4],
}

impl Strip for Quad {
    const LABEL: &'static str = "quads";
    const SHADER: &'static [&'static str] = &shader::QUADS;
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] = &wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Float32x3, 2 => Float32x3, 3 => Float32x4, 4 => Float32x4];
}
