//! Draws solids of any form, such as tools: opaque, lit like styli and arrows.
//!
//! In: [`Formed`]s, whose surface is uploaded once, as long as somebody holds it. Out: one instance each.

use super::error::RenderError;
use super::frame::{Drawable, Formed, FrameContents, GhostShape};
use super::gpu::Gpu;
use super::parts::{Instance, Instances};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::solid::{SHADER, SolidVertex, vertex_layout};
use super::view::Bounds;
use std::sync::{Arc, Weak};
use wgpu::BufferUsages;

#[derive(Default)]
pub(super) struct FormedPass {
    pipelines: EyePipelines,
    instances: Instances,
    forms: Vec<Form>,
    /// The form of each solid of this frame, where it has triangles.
    drawn: Vec<Option<usize>>,
}

/// A form on the device.
struct Form {
    shape: Weak<GhostShape>,
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    corners: u32,
    bounds: Bounds,
}

impl Form {
    fn new(gpu: &Gpu, shape: &Arc<GhostShape>) -> Result<Form, RenderError> {
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
        Ok(Form {
            shape: Arc::downgrade(shape),
            vertices: buffer("form vertices", bytemuck::cast_slice(&vertices), BufferUsages::VERTEX)?,
            indices: buffer("form triangles", bytemuck::cast_slice(&shape.triangles), BufferUsages::INDEX)?,
            corners: 3 * shape.triangles.len() as u32,
            bounds: Bounds::around(&shape.positions),
        })
    }
}

impl FormedPass {
    /// Number of the form on the device; `None` if it has nothing to draw.
    fn form(&mut self, gpu: &Gpu, shape: &Arc<GhostShape>) -> Result<Option<usize>, RenderError> {
        if !shape.is_whole() {
            return Ok(None);
        }
        let known = self.forms.iter().position(|known| known.shape.as_ptr() == Arc::as_ptr(shape));
        if known.is_some() {
            return Ok(known);
        }
        self.forms.push(Form::new(gpu, shape)?);
        Ok(Some(self.forms.len() - 1))
    }
}

impl DrawPass for FormedPass {
    fn name(&self) -> &'static str {
        "formed"
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
        self.forms.retain(|known| known.shape.strong_count() > 0);
        if contents.all(Drawable::formed).next().is_none() {
            return Ok(());
        }
        let (label, parts, buffers) = (self.name(), self.shader(), &vertex_layout());
        let recipe = Recipe { label, parts, buffers, blending: Blending::Opaque, groups: &[] };
        self.pipelines.complete(gpu, kinds, &recipe);
        for Formed { shape, room_from_shape, color: [r, g, b] } in contents.all(Drawable::formed) {
            let drawn = self.form(gpu, shape)?;
            self.drawn.push(drawn);
            let color = [*r, *g, *b, 0.0];
            self.instances.list.push(Instance { room_from_shape: (*room_from_shape).into(), color });
        }
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>) {
        let Some(pipeline) = self.pipelines.pipeline(to.view_draw).filter(|_| !self.drawn.is_empty()) else {
            return;
        };
        to.pass.set_pipeline(pipeline);
        for (k, (formed, drawn)) in contents.all(Drawable::formed).zip(&self.drawn).enumerate() {
            let Some(form) = drawn.and_then(|at| self.forms.get(at)) else { continue };
            if to.shows(&form.bounds, &to.view_draw.clip_from_shape(&formed.room_from_shape)) {
                to.pass.set_index_buffer(form.indices.slice(..), wgpu::IndexFormat::Uint32);
                to.pass.set_vertex_buffer(0, form.vertices.slice(..));
                self.instances.bind(to.pass, 1, k);
                to.pass.draw_indexed(0..form.corners, 0, 0..1);
            }
        }
    }

    fn is_made(&self) -> bool {
        self.pipelines.is_made()
    }
}
