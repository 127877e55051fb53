//! The empty room behind everything: a gradient over the height of the sight line.

use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::pass::{Blending, DrawCounts, DrawPass, EyePipelines, MadeFor, Recipe, ViewDraw};
use super::shader;

#[derive(Default)]
pub(super) struct BackgroundPass(EyePipelines);

impl DrawPass for BackgroundPass {
    fn name(&self) -> &'static str {
        "background"
    }

    fn upload(&mut self, gpu: &Gpu, kinds: &[MadeFor<'_>], _: &FrameContents<'_>) -> Result<(), RenderError> {
        let (parts, blending) = (&shader::BACKGROUND, Blending::Background);
        self.0.complete(gpu, kinds, &Recipe { label: self.name(), parts, buffers: &[], blending });
        Ok(())
    }

    fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view_draw: &ViewDraw,
        _: &FrameContents<'_>,
        _: &mut DrawCounts,
    ) {
        if let Some(pipeline) = self.0.of(view_draw) {
            pass.set_pipeline(pipeline);
            pass.draw(0..3, 0..1);
        }
    }

    fn is_made(&self) -> bool {
        self.0.is_made()
    }
}
