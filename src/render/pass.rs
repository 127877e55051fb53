//! A drawing pass: `src/render/X.rs` with the shader `shaders/X.wgsl`. It takes its part of a frame, makes its pipelines
//! when it first has something to draw, and draws it once per view.

use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::shader;
use super::shadow::{ShadowMaps, Shadows};
use super::target::DEPTH_FORMAT;
use super::view::Bounds;
use nalgebra::Matrix4;
use std::num::NonZeroU32;

/// Both layers of a target, in one pass.
pub(super) const BOTH_EYES: Option<NonZeroU32> = NonZeroU32::new(0b11);

/// One kind of thing that a frame can hold.
pub(super) trait DrawPass {
    /// The shader's name.
    fn name(&self) -> &'static str;

    /// The parts of its WGSL source in their order; none where its users bring their own.
    fn shader(&self) -> &'static [&'static str];

    /// Takes this frame's part, to be drawn in pictures of these kinds. Without anything to draw it makes nothing.
    fn upload(
        &mut self,
        gpu: &Gpu,
        kinds: &[MadeFor<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<(), RenderError>;

    /// Draws what was taken into the viewport of a view, which is set.
    fn draw(&self, to: &mut DrawTo<'_, '_>, contents: &FrameContents<'_>);

    /// Whether it has anything on the device.
    fn is_made(&self) -> bool;
}

/// The target of a pass for one view, and the counts of its shapes.
pub(super) struct DrawTo<'a, 'p> {
    pub(super) pass: &'a mut wgpu::RenderPass<'p>,
    pub(super) view_draw: &'a ViewDraw,
    pub(super) counts: &'a mut DrawCounts,
    /// Present with [`Shadows::Soft`].
    pub(super) maps: Option<&'a ShadowMaps>,
}

impl DrawTo<'_, '_> {
    /// Whether a shape is to be drawn; counts it. `clip_from_shape` is for each eye of the view.
    pub(super) fn shows(&mut self, bounds: &Bounds, clip_from_shape: &[Option<Matrix4<f32>>; 2]) -> bool {
        let is_seen = clip_from_shape.iter().flatten().any(|clip| bounds.is_visible(clip));
        let shows = is_seen || !self.view_draw.culling;
        *if shows { &mut self.counts.drawn } else { &mut self.counts.culled } += 1;
        shows
    }
}

/// Patches of bodies, and solids, over all passes of a frame; both eyes in one pass count once. A body that the CPU
/// deforms is one patch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DrawCounts {
    pub passes: usize,
    pub drawn: usize,
    /// Left out, because no eye of the pass can see them.
    pub culled: usize,
}

/// A viewport that shows something: to one eye, or to one or both of a pair.
pub(super) struct ViewDraw {
    pub(super) rect: [u32; 4],
    /// Offset of its views in the uniform buffer.
    pub(super) offset: u32,
    pub(super) both_eyes: bool,
    /// Leave out what none of its eyes sees.
    pub(super) culling: bool,
    pub(super) clip_from_room: [Option<Matrix4<f32>>; 2],
}

impl ViewDraw {
    /// The transform for each of its views.
    pub(super) fn clip_from_shape(&self, room_from_shape: &Matrix4<f32>) -> [Option<Matrix4<f32>>; 2] {
        self.clip_from_room.map(|clip_from_room| Some(clip_from_room? * room_from_shape))
    }
}

/// The pipelines of one pass: for pictures of one eye, and for those of both.
#[derive(Default)]
pub(super) struct EyePipelines([Option<wgpu::RenderPipeline>; 2]);

impl EyePipelines {
    /// Makes those of these kinds that are not there.
    pub(super) fn complete(&mut self, gpu: &Gpu, kinds: &[MadeFor<'_>], recipe: &Recipe<'_>) {
        for kind in kinds {
            self.0[usize::from(kind.both_eyes)].get_or_insert_with(|| pipeline(gpu, kind, recipe));
        }
    }

    pub(super) fn pipeline(&self, view_draw: &ViewDraw) -> Option<&wgpu::RenderPipeline> {
        self.0[usize::from(view_draw.both_eyes)].as_ref()
    }

    pub(super) fn is_made(&self) -> bool {
        self.0.iter().any(Option::is_some)
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

/// The way in which a pass meets the pixels that are there: nearer wins, only where nothing is, blended over what is farther, or
/// blended over what is nearer. Ghosts are triangles; what is merely translucent comes in strips.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Blending {
    Opaque,
    Background,
    Translucent,
    Ghost,
    Hidden,
}

impl Blending {
    fn is_blended(self) -> bool {
        matches!(self, Blending::Translucent | Blending::Ghost | Blending::Hidden)
    }

    /// Ghosts that touch a body, as at a held end, count as behind it: they do not flicker.
    fn bias(self) -> wgpu::DepthBiasState {
        match self {
            Blending::Ghost | Blending::Hidden => {
                wgpu::DepthBiasState { constant: -64, slope_scale: -2.0, clamp: 0.0 }
            }
            _ => wgpu::DepthBiasState::default(),
        }
    }
}

/// The description of a pass's pipeline.
pub(super) struct Recipe<'a> {
    pub(super) label: &'a str,
    /// Parts of the shader, as `shader` lists them.
    pub(super) parts: &'a [&'a str],
    pub(super) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(super) blending: Blending,
    /// Bind groups from 1 on.
    pub(super) groups: &'a [Option<&'a wgpu::BindGroupLayout>],
}

/// The kind of pictures for which a pipeline is made.
pub(super) struct MadeFor<'a> {
    /// Layout of group 0, and of pipelines that have no other.
    pub(super) group_layout: &'a wgpu::BindGroupLayout,
    pub(super) layout: &'a wgpu::PipelineLayout,
    pub(super) shadows: Shadows,
    /// Present with [`Shadows::Soft`].
    pub(super) maps: Option<&'a ShadowMaps>,
    pub(super) format: wgpu::TextureFormat,
    pub(super) samples: u32,
    /// Whether both eyes are drawn in one pass.
    pub(super) both_eyes: bool,
}

fn pipeline(gpu: &Gpu, made_for: &MadeFor<'_>, recipe: &Recipe<'_>) -> wgpu::RenderPipeline {
    let &MadeFor { layout, group_layout, format, samples, both_eyes, .. } = made_for;
    let with_groups = (!recipe.groups.is_empty()).then(|| {
        let bind_group_layouts = &[&[Some(group_layout)], recipe.groups].concat();
        let descriptor = wgpu::PipelineLayoutDescriptor {
            label: Some(recipe.label),
            bind_group_layouts,
            immediate_size: 0,
        };
        gpu.device.create_pipeline_layout(&descriptor)
    });
    let layout = with_groups.as_ref().unwrap_or(layout);
    let module = shader::module(&gpu.device, recipe.label, &shader::drawing(recipe.parts, both_eyes));
    let topology = match recipe.blending {
        Blending::Translucent => wgpu::PrimitiveTopology::TriangleStrip,
        _ => wgpu::PrimitiveTopology::TriangleList,
    };
    // Depth is reversed: nearer is greater, and infinity, where the background lies, is the cleared 0.
    let depth_compare = match recipe.blending {
        Blending::Background => wgpu::CompareFunction::Equal,
        Blending::Hidden => wgpu::CompareFunction::LessEqual,
        _ => wgpu::CompareFunction::Greater,
    };
    let blend = recipe.blending.is_blended().then_some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(recipe.label),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: recipe.buffers,
        },
        primitive: wgpu::PrimitiveState { topology, ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(recipe.blending == Blending::Opaque),
            depth_compare: Some(depth_compare),
            stencil: wgpu::StencilState::default(),
            bias: recipe.blending.bias(),
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
