//! Draws translucent shapes after all that is opaque: they test depth and write none, so that their order is the same for
//! every eye. Their far side is left out; what lies hidden behind a body shows through it, where that is asked for.
//!
//! A shape is uploaded once, as long as somebody holds it; a frame moves, colours and draws it.

use super::error::RenderError;
use super::frame::{Drawable, FrameContents, Ghost, GhostShape};
use super::gpu::Gpu;
use super::parts::{Instance, Instances, instance_layout};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;
use super::view::Bounds;
use std::sync::{Arc, Weak};
use wgpu::BufferUsages;

const POSITION: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
const NORMAL: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![1 => Float32x3];

const SHADER: [&str; 2] = [shader::VIEW, include_str!("../../shaders/ghost.wgsl")];

#[derive(Default)]
pub(super) struct GhostPass {
    /// Pipelines for visible and for hidden ghosts.
    pipelines: [EyePipelines; 2],
    /// Two per ghost: as it is seen, and where it is hidden.
    instances: Instances,
    shapes: Vec<GhostBuffers>,
    /// The shape of each ghost of this frame, where it has triangles.
    drawn: Vec<Option<usize>>,
}

/// A shape on the device.
struct GhostBuffers {
    shape: Weak<GhostShape>,
    positions: wgpu::Buffer,
    normals: wgpu::Buffer,
    indices: wgpu::Buffer,
    corners: u32,
    bounds: Bounds,
}

impl GhostBuffers {
    fn new(gpu: &Gpu, shape: &Arc<GhostShape>) -> Result<GhostBuffers, RenderError> {
        let GhostShape { positions, normals, triangles } = &**shape;
        let (vertex, index) = (BufferUsages::VERTEX, BufferUsages::INDEX);
        let buffer = |what, bytes: &[u8], usage| -> Result<wgpu::Buffer, RenderError> {
            let buffer = gpu.buffer(what, bytes.len() as u64, usage | BufferUsages::COPY_DST)?;
            gpu.queue.write_buffer(&buffer, 0, bytes);
            Ok(buffer)
        };
        Ok(GhostBuffers {
            shape: Arc::downgrade(shape),
            positions: buffer("ghost positions", bytemuck::cast_slice(positions), vertex)?,
            normals: buffer("ghost normals", bytemuck::cast_slice(normals), vertex)?,
            indices: buffer("ghost triangles", bytemuck::cast_slice(triangles), index)?,
            corners: 3 * triangles.len() as u32,
            bounds: Bounds::around(positions),
        })
    }
}

impl GhostPass {
    /// Number of the shape on the device; `None` if it has nothing to draw.
    fn shape(&mut self, gpu: &Gpu, shape: &Arc<GhostShape>) -> Result<Option<usize>, RenderError> {
        if !shape.is_whole() {
            return Ok(None);
        }
        let known = self.shapes.iter().position(|known| known.shape.as_ptr() == Arc::as_ptr(shape));
        if known.is_some() {
            return Ok(known);
        }
        self.shapes.push(GhostBuffers::new(gpu, shape)?);
        Ok(Some(self.shapes.len() - 1))
    }
}

impl DrawPass for GhostPass {
    fn name(&self) -> &'static str {
        "ghost"
    }

    fn shader(&self) -> &'static [&'static str] {
        &SHADER
    }

    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError> {
        self.drawn.clear();
        self.instances.list.clear();
        self.shapes.retain(|known| known.shape.strong_count() > 0);
        if contents.all(Drawable::ghost).next().is_none() {
            return Ok(());
        }
        let per_vertex = |attributes| {
            let step_mode = wgpu::VertexStepMode::Vertex;
            Some(wgpu::VertexBufferLayout { array_stride: 12, step_mode, attributes })
        };
        let (label, parts) = (self.name(), self.shader());
        let buffers = &[per_vertex(&POSITION), per_vertex(&NORMAL), Some(instance_layout())];
        for (pipelines, blending) in self.pipelines.iter_mut().zip([Blending::Ghost, Blending::Hidden]) {
            pipelines.complete(gpu, kinds, &Recipe { label, parts, buffers, blending, groups: &[] });
        }
        for Ghost { shape, room_from_shape, color, through } in contents.all(Drawable::ghost) {
            let drawn = self.shape(gpu, shape)?;
            self.drawn.push(drawn);
            let [r, g, b, opacity] = *color;
            for opacity in [opacity, -opacity * through] {
                let color = [r, g, b, opacity];
                self.instances.list.push(Instance { room_from_shape: (*room_from_shape).into(), color });
            }
        }
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>) {
        for (k, (ghost, drawn)) in contents.all(Drawable::ghost).zip(&self.drawn).enumerate() {
            let Some(shape) = drawn.and_then(|at| self.shapes.get(at)) else { continue };
            let clip_from_shape = to.view_draw.clip_from_shape(&ghost.room_from_shape);
            if !to.shows(&shape.bounds, &clip_from_shape) {
                continue;
            }
            let ways = if ghost.through > 0.0 { 2 } else { 1 };
            for (way, pipelines) in self.pipelines.iter().enumerate().take(ways) {
                let Some(pipeline) = pipelines.pipeline(to.view_draw) else { continue };
                to.pass.set_pipeline(pipeline);
                to.pass.set_index_buffer(shape.indices.slice(..), wgpu::IndexFormat::Uint32);
                to.pass.set_vertex_buffer(0, shape.positions.slice(..));
                to.pass.set_vertex_buffer(1, shape.normals.slice(..));
                self.instances.bind(to.pass, 2, 2 * k + way);
                to.pass.draw_indexed(0..shape.corners, 0, 0..1);
            }
        }
    }

    fn is_made(&self) -> bool {
        self.pipelines.iter().any(EyePipelines::is_made)
    }
}
