//! The empty room behind everything: a gradient over the height of the sight line.

use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;

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
        if let Some(pipeline) = self.0.of(to.view_draw) {
            to.pass.set_pipeline(pipeline);
            to.pass.draw(0..3, 0..1);
        }
    }

    fn is_made(&self) -> bool {
        self.0.is_made()
    }
}
