//! Shapes on the device, each uploaded once, as long as somebody holds it.
//!
//! In: the [`GhostShape`]s that a pass draws in a frame. Out: their vertices and triangles, in the order in which they are drawn.

use super::error::RenderError;
use super::frame::GhostShape;
use super::gpu::Gpu;
use super::solid::SolidVertex;
use super::view::Bounds;
use std::sync::{Arc, Weak};
use wgpu::BufferUsages;

#[derive(Default)]
pub(super) struct Shapes {
    known: Vec<Shape>,
    /// The shape of each thing of this frame, where it has triangles.
    drawn: Vec<Option<usize>>,
}

/// A shape on the device.
pub(super) struct Shape {
    shape: Weak<GhostShape>,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    corners: u32,
    pub bounds: Bounds,
}

impl Shapes {
    /// Begins a frame, and gives up what nobody holds any longer.
    pub fn begin(&mut self) {
        self.drawn.clear();
        self.known.retain(|known| known.shape.strong_count() > 0);
    }

    /// Adds the shape of the next thing of this frame.
    pub fn add(&mut self, gpu: &Gpu, shape: &Arc<GhostShape>) -> Result<(), RenderError> {
        let known = self.known.iter().position(|known| known.shape.as_ptr() == Arc::as_ptr(shape));
        let drawn = match known {
            None if shape.is_whole() => {
                self.known.push(Shape::new(gpu, shape)?);
                Some(self.known.len() - 1)
            }
            known => known,
        };
        self.drawn.push(drawn);
        Ok(())
    }

    /// The shapes of this frame's things; `None` of one that has nothing to draw.
    pub fn drawn(&self) -> impl Iterator<Item = Option<&Shape>> {
        self.drawn.iter().map(|drawn| drawn.and_then(|at| self.known.get(at)))
    }
}

impl Shape {
    fn new(gpu: &Gpu, shape: &Arc<GhostShape>) -> Result<Shape, RenderError> {
        let vertex = |(position, normal): (&[f32; 3], &[f32; 3])| SolidVertex {
            position: *position,
            normal: *normal,
            color: [0, 0, 0, 255],
        };
        let vertices: Vec<SolidVertex> = shape.positions.iter().zip(&shape.normals).map(vertex).collect();
        let buffer = |what, bytes: &[u8], usage| -> Result<wgpu::Buffer, RenderError> {
            let buffer = gpu.buffer(what, bytes.len() as u64, usage | BufferUsages::COPY_DST)?;
            gpu.queue.write_buffer(&buffer, 0, bytes);
            Ok(buffer)
        };
        Ok(Shape {
            shape: Arc::downgrade(shape),
            vertices: buffer("shape vertices", bytemuck::cast_slice(&vertices), BufferUsages::VERTEX)?,
            indices: buffer("shape triangles", bytemuck::cast_slice(&shape.triangles), BufferUsages::INDEX)?,
            corners: 3 * shape.triangles.len() as u32,
            bounds: Bounds::around(&shape.positions),
        })
    }

    /// Draws it with the one instance that is bound.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.draw_indexed(0..self.corners, 0, 0..1);
    }
}
