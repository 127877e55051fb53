//! The common part of floor, lines and quads: strips of four corners, one per instance, blended over the picture.
//!
//! In comes a list of instances per frame; out goes one draw per view. The pipeline and the buffer are made with the
//! first instance that is ever drawn, and grow with the longest list.

use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use std::marker::PhantomData;

/// An instance as it lies in its buffer.
pub(super) trait Strip: bytemuck::Pod {
    /// The shader's name.
    const NAME: &'static str;
    const SHADER: &'static [&'static str];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute];

    /// The strips of a frame, in the order in which they are blended.
    fn of(contents: &FrameContents<'_>) -> Vec<Self>;
}

/// The pass of one kind of strip; it makes nothing on the device until it is used.
pub(super) struct StripPass<S> {
    strips: StripBuffer,
    kind: PhantomData<S>,
}

impl<S> Default for StripPass<S> {
    fn default() -> Self {
        Self { strips: StripBuffer::default(), kind: PhantomData }
    }
}

impl<S: Strip> DrawPass for StripPass<S> {
    fn name(&self) -> &'static str {
        S::NAME
    }

    fn shader(&self) -> &'static [&'static str] {
        S::SHADER
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError> {
        let strips = S::of(contents);
        let shape = StripShape {
            name: S::NAME,
            parts: S::SHADER,
            attributes: S::ATTRIBUTES,
            stride: size_of::<S>() as u64,
        };
        self.strips.upload(gpu, kinds, &shape, bytemuck::cast_slice(&strips))
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, _: &FrameContents<'_>) {
        self.strips.draw(to);
    }

    fn is_made(&self) -> bool {
        self.strips.is_made()
    }
}

/// The description of a pipeline of strips.
pub(super) struct StripShape<'a> {
    pub(super) name: &'static str,
    pub(super) parts: &'a [&'a str],
    pub(super) attributes: &'a [wgpu::VertexAttribute],
    /// Bytes of an instance.
    pub(super) stride: u64,
}

/// The instances of one kind on the device, with the pipelines that draw them.
#[derive(Default)]
pub(super) struct StripBuffer {
    pipelines: EyePipelines,
    buffer: Option<wgpu::Buffer>,
    count: u32,
}

impl StripBuffer {
    pub(super) fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        shape: &StripShape<'_>,
        bytes: &[u8],
    ) -> Result<(), RenderError> {
        self.count = (bytes.len() as u64 / shape.stride) as u32;
        if self.count == 0 {
            return Ok(());
        }
        let buffers = [Some(wgpu::VertexBufferLayout {
            array_stride: shape.stride,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: shape.attributes,
        })];
        let blending = Blending::Translucent;
        let recipe =
            Recipe { label: shape.name, parts: shape.parts, buffers: &buffers, blending, groups: &[] };
        self.pipelines.complete(gpu, kinds, &recipe);
        let room = (u64::from(self.count.next_power_of_two()) * shape.stride) as usize;
        gpu.write_vertices(&mut self.buffer, shape.name, bytes, room)
    }

    pub(super) fn draw(&self, to: &mut DrawTo<'_, '_>) {
        let made = self.pipelines.of(to.view_draw).zip(self.buffer.as_ref());
        if let Some((pipeline, buffer)) = made.filter(|_| self.count > 0) {
            to.pass.set_pipeline(pipeline);
            to.pass.set_vertex_buffer(0, buffer.slice(..));
            to.pass.draw(0..4, 0..self.count);
        }
    }

    /// Removes the strips of this frame.
    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    pub(super) fn is_made(&self) -> bool {
        self.buffer.is_some()
    }
}
