//! The floor: lines on a horizontal rectangle, every fifth one stronger, fading towards its rim.

use super::frame::{FrameContents, Grid};
use super::shader;
use super::strips::Strip;

/// A floor as it lies in the buffer.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Floor {
    center: [f32; 3],
    half_size: [f32; 2],
    spacing: f32,
    /// Width of the lines, in cells.
    line_width: f32,
    color: [f32; 3],
}

impl Strip for Floor {
    const NAME: &'static str = "grid";
    const SHADER: &'static [&'static str] = &[shader::VIEW, include_str!("../../shaders/grid.wgsl")];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute] = &wgpu::vertex_attr_array![
        0 => Float32x3, 1 => Float32x2, 2 => Float32, 3 => Float32, 4 => Float32x3];

    fn of(contents: &FrameContents<'_>) -> Vec<Self> {
        let floor = |grid: &Grid| Floor {
            center: grid.center.into(),
            half_size: grid.half_size,
            spacing: grid.spacing,
            line_width: grid.line_width / grid.spacing,
            color: grid.color,
        };
        contents.grid.iter().map(floor).collect()
    }
}
