//! The drawing pipelines: one set for pictures of one eye, and one that draws both eyes in one pass.

use super::target::DEPTH_FORMAT;
use super::{Gpu, body, shader, solid};
use std::num::NonZeroU32;

/// Both layers of a target, in one pass.
pub(super) const BOTH_EYES: Option<NonZeroU32> = NonZeroU32::new(0b11);

/// One pipeline per drawing pass, for one format and sample count; none before there is something for it to draw.
#[derive(Default)]
pub(super) struct Pipelines {
    pub(super) background: Option<wgpu::RenderPipeline>,
    pub(super) body: Option<wgpu::RenderPipeline>,
    pub(super) solid: Option<wgpu::RenderPipeline>,
    pub(super) grid: Option<wgpu::RenderPipeline>,
}

/// What a frame has beside its background.
pub(super) struct Listed {
    pub(super) bodies: bool,
    pub(super) solids: bool,
    pub(super) grid: bool,
}

impl Pipelines {
    /// Makes what a frame needs and is not there.
    pub(super) fn complete(&mut self, gpu: &Gpu, made_for: &MadeFor<'_>, listed: &Listed) {
        let make = |slot: &mut Option<wgpu::RenderPipeline>, pass: Pass<'_>| {
            slot.get_or_insert_with(|| pipeline(gpu, made_for, &pass));
        };
        let (parts, surface) = (&shader::BACKGROUND, Surface::Background);
        make(&mut self.background, Pass { label: "background", parts, buffers: &[], surface });
        if listed.bodies {
            let (parts, buffers, surface) = (&shader::BODY, &body::vertex_layout(), Surface::Opaque);
            make(&mut self.body, Pass { label: "body", parts, buffers, surface });
        }
        if listed.solids {
            let (parts, buffers, surface) = (&shader::SOLID, &solid::vertex_layout(), Surface::Opaque);
            make(&mut self.solid, Pass { label: "solid", parts, buffers, surface });
        }
        if listed.grid {
            let (parts, surface) = (&shader::GRID, Surface::Translucent);
            make(&mut self.grid, Pass { label: "grid", parts, buffers: &[], surface });
        }
    }

    /// What is there.
    pub(super) fn made(&self) -> impl Iterator<Item = &'static str> {
        let Self { background, body, solid, grid } = self;
        let passes = [("background", background), ("body", body), ("solid", solid), ("grid", grid)];
        passes.into_iter().filter_map(|(pass, pipeline)| pipeline.as_ref().map(|_| pass))
    }
}

/// Group 0: the views, at a dynamic offset, and the frame.
pub(super) fn group_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let uniform = |binding, has_dynamic_offset| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset,
            min_binding_size: None,
        },
        count: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[uniform(0, true), uniform(1, false)],
    })
}

/// How a pass meets the pixels that are there: nearer wins, only where nothing is, or blended over what is farther.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Surface {
    Opaque,
    Background,
    Translucent,
}

pub(super) struct Pass<'a> {
    pub(super) label: &'a str,
    pub(super) parts: &'a [&'a str],
    pub(super) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(super) surface: Surface,
}

/// For what pictures a pipeline is made.
pub(super) struct MadeFor<'a> {
    pub(super) layout: &'a wgpu::PipelineLayout,
    pub(super) format: wgpu::TextureFormat,
    pub(super) samples: u32,
    /// In one pass.
    pub(super) both_eyes: bool,
}

pub(super) fn pipeline(gpu: &Gpu, made_for: &MadeFor<'_>, pass: &Pass<'_>) -> wgpu::RenderPipeline {
    let &MadeFor { layout, format, samples, both_eyes } = made_for;
    let module = shader::module(&gpu.device, pass.label, &shader::drawing(pass.parts, both_eyes));
    let topology = match pass.surface {
        Surface::Translucent => wgpu::PrimitiveTopology::TriangleStrip,
        Surface::Opaque | Surface::Background => wgpu::PrimitiveTopology::TriangleList,
    };
    // Depth is reversed: nearer is greater, and infinity, where the background lies, is the cleared 0.
    let depth_compare = match pass.surface {
        Surface::Background => wgpu::CompareFunction::Equal,
        Surface::Opaque | Surface::Translucent => wgpu::CompareFunction::Greater,
    };
    let blend =
        (pass.surface == Surface::Translucent).then_some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(pass.label),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: pass.buffers,
        },
        primitive: wgpu::PrimitiveState { topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(pass.surface == Surface::Opaque),
            depth_compare: Some(depth_compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })],
        }),
        multiview_mask: if both_eyes { BOTH_EYES } else { None },
        cache: None,
    })
}
