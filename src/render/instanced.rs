//! What lines and quads have in common: strips of four corners, one per instance, blended over the picture.
//!
//! In comes a list of instances per frame; out goes one draw per view. The pipeline and the buffer are made with the
//! first instance that is ever drawn, and grow with the longest list.

pub(super) use super::pipelines::MadeFor;
use super::pipelines::{Pass, Surface, pipeline};
use super::{Gpu, RenderError};
use wgpu::BufferUsages;

/// An instance as it lies in its buffer.
pub(super) trait Strip: bytemuck::Pod {
    const LABEL: &'static str;
    const SHADER: &'static [&'static str];
    const ATTRIBUTES: &'static [wgpu::VertexAttribute];
}

/// The pass of one kind of strip; nothing on the device until it is used.
#[derive(Default)]
pub(super) struct InstancedPass {
    /// For pictures of one eye, and for those of both.
    pipelines: [Option<wgpu::RenderPipeline>; 2],
    buffer: Option<wgpu::Buffer>,
    count: u32,
}

impl InstancedPass {
    /// Takes this frame's instances, to be drawn in pictures of these kinds.
    pub(super) fn upload<S: Strip>(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        strips: &[S],
    ) -> Result<(), RenderError> {
        self.count = strips.len() as u32;
        if strips.is_empty() {
            return Ok(());
        }
        for kind in kinds {
            self.pipelines[usize::from(kind.both_eyes)].get_or_insert_with(|| make_pipeline::<S>(gpu, kind));
        }
        let bytes: &[u8] = bytemuck::cast_slice(strips);
        let buffer = match self.buffer.take() {
            Some(buffer) if buffer.size() >= bytes.len() as u64 => buffer,
            _ => make_buffer::<S>(gpu, strips.len())?,
        };
        gpu.queue.write_buffer(&buffer, 0, bytes);
        self.buffer = Some(buffer);
        Ok(())
    }

    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, both_eyes: bool) {
        let pipeline = self.pipelines[usize::from(both_eyes)].as_ref();
        if let Some((pipeline, buffer)) = pipeline.zip(self.buffer.as_ref()).filter(|_| self.count > 0) {
            pass.set_pipeline(pipeline);
            pass.set_vertex_buffer(0, buffer.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }

    pub(super) fn is_made(&self) -> bool {
        self.buffer.is_some()
    }
}

fn make_buffer<S: Strip>(gpu: &Gpu, count: usize) -> Result<wgpu::Buffer, RenderError> {
    let bytes = (count.next_power_of_two() * size_of::<S>()) as u64;
    gpu.buffer(S::LABEL, bytes, BufferUsages::VERTEX | BufferUsages::COPY_DST)
}

fn make_pipeline<S: Strip>(gpu: &Gpu, made_for: &MadeFor<'_>) -> wgpu::RenderPipeline {
    let buffers = [Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<S>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: S::ATTRIBUTES,
    })];
    let pass = Pass { label: S::LABEL, parts: S::SHADER, buffers: &buffers, surface: Surface::Translucent };
    pipeline(gpu, made_for, &pass)
}
