//! A deformable body on the device. In come triangles and colours once, positions and normals once per frame, as the
//! CPU has them (no packing: 24 bytes a vertex, and a plain copy is faster than any conversion); out goes one
//! indexed draw per viewport.

use super::uniforms::{INSTANCE_ATTRIBUTES, Instance};
use super::{Gpu, RenderError};
use wgpu::BufferUsages;

/// The buffers of one body, shared by all screens and eyes.
pub struct BodyBuffers {
    pub vertex_count: usize,
    pub triangle_count: usize,
    pub(super) indices: wgpu::Buffer,
    pub(super) positions: wgpu::Buffer,
    pub(super) normals: wgpu::Buffer,
    pub(super) colors: wgpu::Buffer,
}

impl BodyBuffers {
    /// Buffers for `colors.len()` vertices, at the origin until the first [`BodyBuffers::upload`].
    ///
    /// `triangles` are counter-clockwise seen from outside. A colour is red, green and blue in sRGB and a mark: 255 on
    /// a control element, 0 elsewhere; the border between the two is drawn sharply where the mark passes one half.
    ///
    /// # Errors
    /// An empty body, a triangle that names a vertex that is not there, or a body too large for the device.
    pub fn new(gpu: &Gpu, triangles: &[[u32; 3]], colors: &[[u8; 4]]) -> Result<Self, RenderError> {
        let vertices = colors.len();
        if triangles.is_empty() || vertices == 0 {
            return Err(RenderError::EmptyBody { vertices, triangles: triangles.len() });
        }
        for (triangle, nodes) in triangles.iter().enumerate() {
            if let Some(&vertex) = nodes.iter().find(|&&node| node as usize >= vertices) {
                return Err(RenderError::VertexOutOfRange { triangle, vertex, vertices });
            }
        }
        let vertex = BufferUsages::VERTEX | BufferUsages::COPY_DST;
        let index = BufferUsages::INDEX | BufferUsages::COPY_DST;
        let body = Self {
            vertex_count: vertices,
            triangle_count: triangles.len(),
            indices: gpu.buffer("triangles", size_of_val(triangles) as u64, index)?,
            positions: gpu.buffer("positions", vertices as u64 * 12, vertex)?,
            normals: gpu.buffer("normals", vertices as u64 * 12, vertex)?,
            colors: gpu.buffer("vertex colours", vertices as u64 * 4, vertex)?,
        };
        gpu.queue.write_buffer(&body.indices, 0, bytemuck::cast_slice(triangles));
        body.set_colors(gpu, colors)?;
        Ok(body)
    }

    /// Replaces all vertex colours, as for an element that is hovered or held.
    ///
    /// # Errors
    /// [`RenderError::VertexCount`] unless there is one colour per vertex.
    pub fn set_colors(&self, gpu: &Gpu, colors: &[[u8; 4]]) -> Result<(), RenderError> {
        self.write(gpu, "vertex colours", &self.colors, colors)
    }

    /// Writes the deformed surface of this frame: positions in the body's frame, normals of any length but zero.
    ///
    /// # Errors
    /// [`RenderError::VertexCount`] unless there is one position and one normal per vertex.
    pub fn upload(&self, gpu: &Gpu, positions: &[[f32; 3]], normals: &[[f32; 3]]) -> Result<(), RenderError> {
        self.write(gpu, "positions", &self.positions, positions)?;
        self.write(gpu, "normals", &self.normals, normals)
    }

    fn write<T: bytemuck::Pod>(
        &self,
        gpu: &Gpu,
        what: &'static str,
        buffer: &wgpu::Buffer,
        values: &[T],
    ) -> Result<(), RenderError> {
        if values.len() != self.vertex_count {
            return Err(RenderError::VertexCount { what, found: values.len(), expected: self.vertex_count });
        }
        gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(values));
        Ok(())
    }
}

pub(super) const POSITION: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
pub(super) const NORMAL: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![1 => Float32x3];
pub(super) const COLOR: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![2 => Unorm8x4];

/// Vertex buffers of the body pass, in the order they are bound.
pub(super) fn vertex_layout() -> [Option<wgpu::VertexBufferLayout<'static>>; 4] {
    let per_vertex = |array_stride, attributes| {
        Some(wgpu::VertexBufferLayout { array_stride, step_mode: wgpu::VertexStepMode::Vertex, attributes })
    };
    [per_vertex(12, &POSITION), per_vertex(12, &NORMAL), per_vertex(4, &COLOR), Some(instance_layout())]
}

pub(super) fn instance_layout() -> wgpu::VertexBufferLayout<'static> {
    wgpu::VertexBufferLayout {
        array_stride: size_of::<Instance>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &INSTANCE_ATTRIBUTES,
    }
}
