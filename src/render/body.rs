//! Draws the deformed bodies: one indexed draw per run of patches that a view can see.

use super::body_buffers::BodyBuffers;
use super::error::RenderError;
use super::frame::{BodyInstance, FrameContents};
use super::gpu::Gpu;
use super::parts::{Instance, Instances, instance_layout};
use super::pass::{Blending, DrawPass, DrawTo, EyePipelines, MadeFor, Recipe};
use super::pattern::image_layout;
use super::shader;
use std::collections::BTreeMap;
use std::ops::Range;

const POSITION: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
const NORMAL: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![1 => Float32x3];
const COLOR: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![2 => Unorm8x4];

const REST: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![8 => Float32x3];

const PLAIN: &str = include_str!("../../shaders/body.wgsl");
const PATTERNED: &str = include_str!("../../shaders/patterned.wgsl");
pub(super) const SHADER: [&str; 7] = [
    shader::VIEW,
    shader::LIGHT,
    shader::SEEN[0],
    shader::PAINT[0],
    shader::HATCH[0],
    shader::SURFACE,
    PLAIN,
];

/// The parts of the shader for bodies of one kind.
pub(super) fn shader(kind: Kind) -> Vec<&'static str> {
    let seen = shader::SEEN[usize::from(kind.shadowed)];
    let paint = shader::PAINT[usize::from(kind.field)];
    let hatch = shader::HATCH[usize::from(kind.hatched)];
    let mut parts = vec![shader::VIEW, shader::LIGHT, seen, paint, hatch, shader::SURFACE];
    match kind.patterned {
        false => parts.push(PLAIN),
        true => parts.extend([shader::IMAGE[usize::from(kind.image)], PATTERNED]),
    }
    parts
}

/// Vertex buffers in the order they are bound; the last is that of a pattern.
fn vertex_layout() -> [Option<wgpu::VertexBufferLayout<'static>>; 5] {
    let per_vertex = |array_stride, attributes| {
        Some(wgpu::VertexBufferLayout { array_stride, step_mode: wgpu::VertexStepMode::Vertex, attributes })
    };
    [
        per_vertex(12, &POSITION),
        per_vertex(12, &NORMAL),
        per_vertex(4, &COLOR),
        Some(instance_layout()),
        per_vertex(12, &REST),
    ]
}

/// The properties on which a body's pipeline depends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Kind {
    /// Whether lines or an image are fixed to the material.
    pub patterned: bool,
    pub image: bool,
    /// Whether the colours of a field are shown.
    pub field: bool,
    /// Whether it is bent beyond its model.
    pub hatched: bool,
    /// Whether it has soft shadows.
    pub shadowed: bool,
}

impl Kind {
    fn new(buffers: &BodyBuffers, shadowed: bool) -> Kind {
        let pattern = buffers.pattern.as_ref();
        Kind {
            patterned: pattern.is_some(),
            image: pattern.is_some_and(|pattern| pattern.image.is_some()) && !buffers.shows_field,
            field: buffers.shows_field,
            hatched: buffers.hatched_per_m.is_some(),
            shadowed,
        }
    }
}

#[derive(Default)]
pub(super) struct BodyPass {
    pipelines: BTreeMap<Kind, EyePipelines>,
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
        let maps = kinds.first().and_then(|kind| kind.maps);
        for body in contents.bodies {
            let kind = Kind::new(body.buffers, maps.is_some());
            let image = kind.image.then(|| image_layout(&gpu.device));
            let maps = maps.map(|maps| &maps.layout);
            let groups: &[_] = match (maps, &image) {
                (None, None) => &[],
                (Some(_), None) => &[maps],
                (_, Some(image)) => &[maps, Some(image)],
            };
            let parts = &shader(kind);
            let buffers = &vertex_layout()[..if kind.patterned { 5 } else { 4 }];
            let recipe = Recipe { label: self.name(), parts, buffers, blending: Blending::Opaque, groups };
            self.pipelines.entry(kind).or_default().complete(gpu, kinds, &recipe);
        }
        let of_body = |body: &BodyInstance<'_>| {
            let pattern = body.buffers.pattern.as_ref();
            let [lines, u, v] = pattern.map_or([0.0; 3], |pattern| pattern.scale);
            let color = [lines, u, v, body.buffers.hatched_per_m.unwrap_or(0.0)];
            Instance { room_from_shape: body.room_from_body.into(), color }
        };
        self.instances.list.clear();
        self.instances.list.extend(contents.bodies.iter().map(of_body));
        self.instances.upload(gpu)
    }

    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>) {
        if let Some(maps) = to.maps {
            to.pass.set_bind_group(1, &maps.group, &[]);
        }
        for (k, body) in contents.bodies.iter().enumerate() {
            let kind = Kind::new(body.buffers, to.maps.is_some());
            if let Some(pipeline) = self.pipelines.get(&kind).and_then(|made| made.pipeline(to.view_draw)) {
                to.pass.set_pipeline(pipeline);
                self.draw_body(to, k, body);
            }
        }
    }

    fn is_made(&self) -> bool {
        !self.pipelines.is_empty()
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
        if let Some(pattern) = &buffers.pattern {
            to.pass.set_vertex_buffer(4, pattern.rest.slice(..));
            if let Some(image) = &pattern.image {
                to.pass.set_bind_group(2, image, &[]);
            }
        }
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
