//! What lines and quads have in common: strips of four corners, one per instance, blended over the picture.
//!
//! In comes a list of instances per frame; out goes one draw per view. The pipeline and the buffer are made with the
//! first instance that is ever drawn, and grow with the longest list.

use super::renderer::{Pass, Surface, pipeline};
use super::{Gpu, RenderError, shader};
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
    made: Option<(wgpu::RenderPipeline, wgpu::Buffer)>,
    count: u32,
}

/// For what pictures a pipeline is made.
pub(super) struct MadeFor<'a> {
    pub(super) layout: &'a wgpu::PipelineLayout,
    pub(super) format: wgpu::TextureFormat,
    pub(super) samples: u32,
}

impl InstancedPass {
    /// Takes this frame's instances.
    pub(super) fn upload<S: Strip>(
        &mut self,
        gpu: &Gpu,
        made_for: &MadeFor<'_>,
        strips: &[S],
    ) -> Result<(), RenderError> {
        self.count = strips.len() as u32;
        if strips.is_empty() {
            return Ok(());
        }
        let bytes: &[u8] = bytemuck::cast_slice(strips);
        let fits = |buffer: &wgpu::Buffer| buffer.size() >= bytes.len() as u64;
        let (pipeline, buffer) = match self.made.take() {
            Some((pipeline, buffer)) if fits(&buffer) => (pipeline, buffer),
            Some((pipeline, _)) => (pipeline, make_buffer::<S>(gpu, strips.len())?),
            None => (make_pipeline::<S>(gpu, made_for), make_buffer::<S>(gpu, strips.len())?),
        };
        gpu.queue.write_buffer(&buffer, 0, bytes);
        self.made = Some((pipeline, buffer));
        Ok(())
    }

    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some((pipeline, buffer)) = self.made.as_ref().filter(|_| self.count > 0) {
            pass.set_pipeline(pipeline);
            pass.set_vertex_buffer(0, buffer.slice(..));
            pass.draw(0..4, 0..self.count);
        }
    }

    pub(super) fn is_made(&self) -> bool {
        self.made.is_some()
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
    let module = shader::module(&gpu.device, S::LABEL, &S::SHADER.concat());
    let pass = Pass {
        label: S::LABEL,
        layout: made_for.layout,
        module,
        buffers: &buffers,
        surface: Surface::Translucent,
    };
    pipeline(&gpu.device, &pass, made_for.format, made_for.samples)
}
