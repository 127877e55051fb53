//! A deformable body on the device. In come triangles and colours once; once per frame positions and normals, as the
//! CPU has them (no packing: 24 bytes a vertex, and a plain copy is faster than any conversion), or nothing but
//! coefficients, of a body with columns. Out goes one indexed draw per view that can see it.

use super::deform::DeformPass;
use super::error::RenderError;
use super::gpu::Gpu;
use super::patches::{self, Patch, Reach};
use super::pattern::{Pattern, PatternBuffers};
use super::view::Bounds;
use crate::base::columns::ColumnGroup;
use crate::base::parts::PartWeights;
use nalgebra::Isometry3;
use wgpu::BufferUsages;

/// The buffers of one body, shared by all screens and eyes.
pub struct BodyBuffers {
    pub vertex_count: usize,
    pub triangle_count: usize,
    /// Colours of plain surface are codes of a field ([`super::field_code`]).
    pub shows_field: bool,
    /// Lines of a hatching per metre of the body; `None` without hatching.
    pub hatched_per_m: Option<f32>,
    pub(super) indices: wgpu::Buffer,
    pub(super) positions: wgpu::Buffer,
    pub(super) normals: wgpu::Buffer,
    pub(super) colors: wgpu::Buffer,
    /// One where the CPU deforms the body.
    pub(super) patches: Vec<Patch>,
    /// None where nothing is fixed to the material.
    pub(super) pattern: Option<PatternBuffers>,
    /// The passes by which the device deforms the body; `None` where the CPU does.
    pub(super) deform: Option<DeformPass>,
}

impl BodyBuffers {
    /// Buffers for `colors.len()` vertices, at the origin until the first [`BodyBuffers::upload`].
    ///
    /// `triangles` are counter-clockwise seen from outside. A colour is red, green and blue in sRGB and a mark: 255 on
    /// a control element, 0 elsewhere; the border between the two is drawn sharply where the mark passes one half.
    /// Errors: an empty body, a triangle that names a vertex that is not there, or a body too large for the device.
    pub fn new(gpu: &Gpu, triangles: &[[u32; 3]], colors: &[[u8; 4]]) -> Result<Self, RenderError> {
        let vertex = BufferUsages::VERTEX | BufferUsages::COPY_DST;
        let bytes = colors.len() as u64 * 12;
        Self::with_buffers(gpu, triangles, colors, |what| gpu.buffer(what, bytes, vertex))
    }

    /// Buffers for a body that [`BodyBuffers::deform`] deforms: at `rest` plus the sum of coefficients times columns, group
    /// after group, all in one storage; then moved by its parts, where it has several. It stands at rest. Vertices after the
    /// nodes of `rest` are copies of the nodes `copies`.
    /// Errors: as [`BodyBuffers::new`]; columns or weights of another number of nodes, or mixed storage; a body of
    /// which even a few nodes, or whose positions, are more than the device binds at once.
    pub fn with_columns(
        gpu: &Gpu,
        triangles: &[[u32; 3]],
        colors: &[[u8; 4]],
        rest: &[[f32; 3]],
        groups: &[ColumnGroup<'_>],
        weights: Option<&PartWeights>,
        copies: &[u32],
    ) -> Result<Self, RenderError> {
        let (found, expected) = (rest.len() + copies.len(), colors.len());
        if found != expected {
            return Err(RenderError::VertexCount { what: "rest positions", found, expected });
        }
        let usage =
            BufferUsages::VERTEX | BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        // The shader writes four numbers at a time, which end beyond the last node of most bodies.
        let bytes = (expected as u64 * 12).next_multiple_of(16);
        let mut body = Self::with_buffers(gpu, triangles, colors, |what| gpu.storage(what, bytes, usage))?;
        let written = [&body.positions, &body.normals];
        let mut pass = DeformPass::new(gpu, (triangles, copies), rest, groups, weights, written)?;
        pass.rest(gpu)?;
        let node = |vertex: u32| match (vertex as usize).checked_sub(rest.len()) {
            Some(copy) => copies[copy],
            None => vertex,
        };
        let (mut ordered, lengths) = patches::split(
            triangles,
            &(0..expected as u32).map(|v| rest[node(v) as usize]).collect::<Vec<_>>(),
        );
        gpu.queue.write_buffer(&body.indices, 0, bytemuck::cast_slice(&ordered));
        ordered.as_flattened_mut().iter_mut().for_each(|vertex| *vertex = node(*vertex));
        pass.reaches = patches::reaches(&ordered, &lengths, rest, groups, weights);
        let ends = lengths.iter().scan(0, |end, length| {
            *end += 3 * *length as u32;
            Some(*end)
        });
        let patch = |((end, length), reach): ((u32, &usize), &Reach)| Patch {
            indices: end - 3 * *length as u32..end,
            bounds: pass.bounds(reach),
        };
        body.patches = ends.zip(&lengths).zip(&pass.reaches).map(patch).collect();
        body.deform = Some(pass);
        Ok(body)
    }

    fn with_buffers(
        gpu: &Gpu,
        triangles: &[[u32; 3]],
        colors: &[[u8; 4]],
        moving: impl Fn(&'static str) -> Result<wgpu::Buffer, RenderError>,
    ) -> Result<Self, RenderError> {
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
            shows_field: false,
            hatched_per_m: None,
            indices: gpu.buffer("triangles", size_of_val(triangles) as u64, index)?,
            positions: moving("positions")?,
            normals: moving("normals")?,
            colors: gpu.buffer("vertex colours", vertices as u64 * 4, vertex)?,
            patches: vec![Patch { indices: 0..3 * triangles.len() as u32, bounds: Bounds::around(&[]) }],
            pattern: None,
            deform: None,
        };
        gpu.queue.write_buffer(&body.indices, 0, bytemuck::cast_slice(triangles));
        body.set_colors(gpu, colors)?;
        Ok(body)
    }

    /// Sets the pattern that is fixed to the material; `rest` has the place of each vertex at rest.
    /// Errors: [`RenderError::VertexCount`] unless there is one place per vertex; an image too large for the device.
    pub fn set_pattern(
        &mut self,
        gpu: &Gpu,
        rest: &[[f32; 3]],
        pattern: &Pattern,
    ) -> Result<(), RenderError> {
        let (found, expected) = (rest.len(), self.vertex_count);
        if found != expected {
            return Err(RenderError::VertexCount { what: "rest positions", found, expected });
        }
        self.pattern = PatternBuffers::new(gpu, rest, pattern)?;
        Ok(())
    }

    /// Whether the device deforms this body.
    pub fn is_deformed_here(&self) -> bool {
        self.deform.is_some()
    }

    /// Dispatches of the superposition and of the normals: one each where the device binds the whole body at once.
    pub fn chunks(&self) -> Option<[usize; 2]> {
        self.deform.as_ref().map(DeformPass::chunks)
    }

    /// Positions and normals as the device has them, of a body with columns.
    pub fn read(&self, gpu: &Gpu) -> Result<[Vec<[f32; 3]>; 2], RenderError> {
        let bytes = self.vertex_count as u64 * 12;
        let read = |buffer| -> Result<Vec<[f32; 3]>, RenderError> {
            let readable = gpu.buffer("read-back", bytes, BufferUsages::COPY_DST | BufferUsages::MAP_READ)?;
            let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(buffer, 0, &readable, 0, bytes);
            gpu.queue.submit([encoder.finish()]);
            gpu.mapped(&readable, bytemuck::pod_collect_to_vec)
        };
        Ok([read(&self.positions)?, read(&self.normals)?])
    }

    /// Replaces all vertex colours, as for an element that is hovered or held.
    /// Errors: [`RenderError::VertexCount`] unless there is one colour per vertex.
    pub fn set_colors(&self, gpu: &Gpu, colors: &[[u8; 4]]) -> Result<(), RenderError> {
        self.write(gpu, "vertex colours", &self.colors, colors)
    }

    /// Writes the deformed surface of this frame: positions in the body's frame, normals of any length but zero.
    /// Errors: [`RenderError::VertexCount`] unless there is one position and one normal per vertex.
    pub fn upload(
        &mut self,
        gpu: &Gpu,
        positions: &[[f32; 3]],
        normals: &[[f32; 3]],
    ) -> Result<(), RenderError> {
        self.write(gpu, "positions", &self.positions, positions)?;
        let bounds = Bounds::around(positions);
        self.patches.iter_mut().for_each(|patch| patch.bounds = bounds);
        self.write(gpu, "normals", &self.normals, normals)
    }

    /// Deforms the body on the device; returns false, and does nothing, where neither a coefficient nor, of several parts,
    /// a motion changed. For bodies made by [`BodyBuffers::with_columns`];
    /// others stay as they were uploaded.
    /// Errors: [`RenderError::CoefficientCount`] unless there is one coefficient per column, [`RenderError::PartCount`]
    /// unless each of several parts has a motion, or a device that failed.
    pub fn deform(
        &mut self,
        gpu: &Gpu,
        coefficients: &[f64],
        parts: &[Isometry3<f64>],
    ) -> Result<bool, RenderError> {
        let Some(pass) = &mut self.deform else { return Ok(false) };
        let is_new = pass.run(gpu, coefficients, parts)?;
        if is_new {
            for (patch, reach) in self.patches.iter_mut().zip(&pass.reaches) {
                patch.bounds = pass.bounds(reach);
            }
        }
        Ok(is_new)
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
