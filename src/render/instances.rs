//! Vertex data that advances once per instance: where a shape stands, and its colour.

use super::error::RenderError;
use super::gpu::Gpu;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct Instance {
    pub(super) room_from_shape: [[f32; 4]; 4],
    /// Linear RGB and the share of it that glows; of bodies, how densely their pattern and hatching lie.
    pub(super) color: [f32; 4],
}

pub(super) const INSTANCE_ATTRIBUTES: [wgpu::VertexAttribute; 5] =
    wgpu::vertex_attr_array![3 => Float32x4, 4 => Float32x4, 5 => Float32x4, 6 => Float32x4, 7 => Float32x4];

pub(super) fn instance_layout() -> wgpu::VertexBufferLayout<'static> {
    wgpu::VertexBufferLayout {
        array_stride: size_of::<Instance>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &INSTANCE_ATTRIBUTES,
    }
}

/// A frame's instances; the buffer is made with the first of them, and grows with the longest list.
#[derive(Default)]
pub(super) struct Instances {
    pub(super) list: Vec<Instance>,
    buffer: Option<wgpu::Buffer>,
}

impl Instances {
    pub(super) fn upload(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        if self.list.is_empty() {
            return Ok(());
        }
        let room = self.list.len().next_power_of_two().max(16) * size_of::<Instance>();
        gpu.write_vertices(&mut self.buffer, "instances", bytemuck::cast_slice(&self.list), room)
    }

    /// Binds the instances from `first` on to a slot of vertex buffers.
    pub(super) fn bind(&self, pass: &mut wgpu::RenderPass<'_>, slot: u32, first: usize) {
        if let Some(buffer) = &self.buffer {
            pass.set_vertex_buffer(slot, buffer.slice((first * size_of::<Instance>()) as u64..));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_is_the_last_attribute() {
        assert_eq!(INSTANCE_ATTRIBUTES[4].offset as usize, std::mem::offset_of!(Instance, color));
    }
}
