//! Draws the deformed bodies: one indexed draw per run of patches that a view can see.

use super::error::RenderError;
use super::frame::{BodyInstance, FrameContents};
use super::gpu::Gpu;
use super::instances::{Instance, Instances, instance_layout};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::shader;
use std::ops::Range;

const POSITION: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
const NORMAL: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![1 => Float32x3];
const COLOR: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![2 => Unorm8x4];

const BODY: &str = include_str!("../../shaders/body.wgsl");
pub(super) const SHADER: [&str; 4] =
    [shader::VIEW, shader::LIGHT, include_str!("../../shaders/common/plain.wgsl"), BODY];
/// The same for bodies that show a field.
pub(super) const FIELD_SHADER: [&str; 4] =
    [shader::VIEW, shader::LIGHT, include_str!("../../shaders/common/field.wgsl"), BODY];
/// Vertex buffers in the order they are bound.
fn vertex_layout() -> [Option<wgpu::VertexBufferLayout<'static>>; 4] {
    let per_vertex = |array_stride, attributes| {
        Some(wgpu::VertexBufferLayout { array_stride, step_mode: wgpu::VertexStepMode::Vertex, attributes })
    };
    [per_vertex(12, &POSITION), per_vertex(12, &NORMAL), per_vertex(4, &COLOR), Some(instance_layout())]
}

#[derive(Default)]
pub(super) struct BodyPass {
    pipelines: EyePipelines,
    /// Of bodies that show a field.
    field_pipelines: EyePipelines,
    instances: Instances,
}

impl DrawPass for BodyPass {
    fn name(&self) -> &'static str {
        "body"
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
        if contents.bodies.is_empty() {
            return Ok(());
        }
        let buffers = &vertex_layout();
        let recipe = |label, parts| Recipe { label, parts, buffers, blending: Blending::Opaque };
        if contents.bodies.iter().any(|body| !body.buffers.shows_field) {
            self.pipelines.complete(gpu, kinds, &recipe(self.name(), &SHADER));
        }
        if contents.bodies.iter().any(|body| body.buffers.shows_field) {
            self.field_pipelines.complete(gpu, kinds, &recipe("body with a field", &FIELD_SHADER));
        }
        let of_body = |body: &BodyInstance<'_>| Instance {
            room_from_shape: body.room_from_body.into(),
            color: [0.0; 4],
        };
        self.instances.list.clear();
        self.instances.list.extend(contents.bodies.iter().map(of_body));
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>) {
        for (pipelines, shows_field) in [(&self.pipelines, false), (&self.field_pipelines, true)] {
            let mut bodies = contents.bodies.iter().enumerate().peekable();
            let Some(pipeline) = pipelines.of(to.view_draw).filter(|_| bodies.peek().is_some()) else {
                continue;
            };
            to.pass.set_pipeline(pipeline);
            for (k, body) in bodies.filter(|(_, body)| body.buffers.shows_field == shows_field) {
                self.draw_body(to, k, body);
            }
        }
    }

    fn is_made(&self) -> bool {
        self.pipelines.is_made() || self.field_pipelines.is_made()
    }
}

impl BodyPass {
    fn draw_body(&self, to: &mut DrawTo<'_, '_>, k: usize, body: &BodyInstance<'_>) {
        let buffers = body.buffers;
        let clip_from_body = to.view_draw.clip_from_shape(&body.room_from_body);
        let draw = |pass: &mut wgpu::RenderPass<'_>, run: Range<u32>| {
            if !run.is_empty() {
                pass.draw_indexed(run, 0, 0..1);
            }
        };
        to.pass.set_index_buffer(buffers.indices.slice(..), wgpu::IndexFormat::Uint32);
        to.pass.set_vertex_buffer(0, buffers.positions.slice(..));
        to.pass.set_vertex_buffer(1, buffers.normals.slice(..));
        to.pass.set_vertex_buffer(2, buffers.colors.slice(..));
        self.instances.bind(to.pass, 3, k);
        // Neighbours in the index buffer in one draw.
        let mut run = 0..0;
        for patch in &buffers.patches {
            if !to.shows(&patch.bounds, &clip_from_body) {
                continue;
            }
            if run.end == patch.indices.start {
                run.end = patch.indices.end;
                continue;
            }
            draw(to.pass, run);
            run = patch.indices.clone();
        }
        draw(to.pass, run);
    }
}
