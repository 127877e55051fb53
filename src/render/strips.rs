//! What the floor, lines and quads have in common: strips of four corners, one per instance, blended over the picture.
//!
//! In comes a list of instances per frame; out goes one draw per view. The pipeline and the buffer are made with the
//! first instance that is ever drawn, and grow with the longest list.

use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::pass::{Blending, DrawCounts, DrawPass, EyePipelines, MadeFor, Recipe, ViewDraw};
use std::borrow::Cow;
use std::marker::PhantomData;
use wgpu::BufferUsages;

/// An instance as it lies in its buffer.
pub(super) trait Strip: bytemuck::Pod {
    /// Its shader's name.
    const NAME: &'static str;
    const SHADER: &'static [&'static str];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute];

    /// Those of a frame, in the order in which they are blended.
    fn of<'a>(contents: &FrameContents<'a>) -> Cow<'a, [Self]>;
}

/// The pass of one kind of strip; nothing on the device until it is used.
pub(super) struct StripPass<S> {
    pipelines: EyePipelines,
    buffer: Option<wgpu::Buffer>,
    count: u32,
    kind: PhantomData<S>,
}

impl<S> Default for StripPass<S> {
    fn default() -> Self {
        Self { pipelines: EyePipelines::default(), buffer: None, count: 0, kind: PhantomData }
    }
}

impl<S: Strip> DrawPass for StripPass<S> {
    fn name(&self) -> &'static str {
        S::NAME
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError> {
        let strips = S::of(contents);
        self.count = strips.len() as u32;
        if strips.is_empty() {
            return Ok(());
        }
        let buffers = [Some(wgpu::VertexBufferLayout {
            array_stride: size_of::<S>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: S::ATTRIBUTES,
        })];
        let recipe =
            Recipe { label: S::NAME, parts: S::SHADER, buffers: &buffers, blending: Blending::Translucent };
        self.pipelines.complete(gpu, kinds, &recipe);
        let bytes: &[u8] = bytemuck::cast_slice(&strips);
        let buffer = match self.buffer.take() {
            Some(buffer) if buffer.size() >= bytes.len() as u64 => buffer,
            _ => {
                let room = (strips.len().next_power_of_two() * size_of::<S>()) as u64;
                gpu.buffer(S::NAME, room, BufferUsages::VERTEX | BufferUsages::COPY_DST)?
            }
        };
        gpu.queue.write_buffer(&buffer, 0, bytes);
        self.buffer = Some(buffer);
        Ok(())
    }

    fn draw(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view_draw: &ViewDraw,
        _: &FrameContents<'_>,
        _: &mut DrawCounts,
    ) {
        let made = self.pipelines.of(view_draw).zip(self.buffer.as_ref());
        if let Some((pipeline, buffer)) = made.filter(|_| self.count > 0) {
            pass.set_pipeline(pipeline);
            pass.set_vertex_buffer(0, buffer.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }

    fn is_made(&self) -> bool {
        self.buffer.is_some()
    }
}
