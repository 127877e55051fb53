//! The floor (lines on a horizontal rectangle, every fifth one stronger, fading towards its rim), and the empty room behind
//! everything: a gradient over the height of the sight line.

use super::error::RenderError;
use super::frame::{FrameContents, Grid};
use super::gpu::Gpu;
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
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

    fn from_contents(contents: &FrameContents<'_>) -> Vec<Self> {
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

pub(super) const SHADER: [&str; 2] = [shader::VIEW, include_str!("../../shaders/background.wgsl")];
#[derive(Default)]
pub(super) struct BackgroundPass(EyePipelines);

impl DrawPass for BackgroundPass {
    fn name(&self) -> &'static str {
        "background"
    }

    fn shader(&self) -> &'static [&'static str] {
        &SHADER
    }

    fn upload(&mut self, gpu: &Gpu, kinds: &[MadeFor<'_>], _: &FrameContents<'_>) -> Result<(), RenderError> {
        let (parts, blending) = (self.shader(), Blending::Background);
        self.0.complete(
            gpu,
            kinds,
            &Recipe { label: self.name(), parts, buffers: &[], blending, groups: &[] },
        );
        Ok(())
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, _: &FrameContents<'_>) {
        if let Some(pipeline) = self.0.pipeline(to.view_draw) {
            to.pass.set_pipeline(pipeline);
            to.pass.draw(0..3, 0..1);
        }
    }

    fn is_made(&self) -> bool {
        self.0.is_made()
    }
}
