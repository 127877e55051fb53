//! Straight lines in the room, as wide in pixels wherever they are seen from.

use super::instanced::Strip;
use super::shader;
use nalgebra::Point3;

/// One line, as it lies in the buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Line {
    pub from: [f32; 3],
    pub to: [f32; 3],
    /// Linear RGB and opacity.
    pub color: [f32; 4],
    pub width_px: f32,
}

impl Line {
    pub fn new(from: Point3<f64>, to: Point3<f64>, color: [f32; 4], width_px: f32) -> Self {
        Self { from: from.cast().into(), to: to.cast().into(), color, width_px }
    }
}

impl Strip for Line {
    const LABEL: &'static str = "lines";
    const SHADER: &'static [&'static str] = &shader::LINES;
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] =
        &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x4, 3 => Float32];
}
