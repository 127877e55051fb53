//! The renderer: four pipelines made once, two more for lines and quads on their first use, and one render pass per
//! target and frame.
//!
//! In come [`Picture`]s (targets with their views) and [`FrameContents`]; out go their pixels. Opaque bodies and solids
//! are drawn first, so that the background only costs where it shows, and the floor's lines last, blended. Nothing is
//! created in a frame but the command buffer; the small buffers grow when a frame holds more than any before it.

use super::body::{self, BodyBuffers};
use super::instanced::{InstancedPass, MadeFor};
use super::solid::{self, SolidMeshes};
use super::target::DEPTH_FORMAT;
use super::uniforms::{FrameUniform, Instance, ViewUniform};
use super::{FrameContents, Gpu, Picture, RenderError, shader};
use std::time::{Duration, Instant};
use wgpu::BufferUsages;

/// Pipelines for one device, colour format and sample count, with the buffers that change every frame.
pub struct Renderer {
    pub format: wgpu::TextureFormat,
    /// 1 or 4 samples a pixel.
    pub samples: u32,
    body: wgpu::RenderPipeline,
    solid: wgpu::RenderPipeline,
    background: wgpu::RenderPipeline,
    grid: wgpu::RenderPipeline,
    quads: InstancedPass,
    lines: InstancedPass,
    solids: SolidMeshes,
    group_layout: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
    uniforms: Uniforms,
    instances: wgpu::Buffer,
    /// Contents of `uniforms.views` and of `instances`, kept to spare their allocation.
    view_bytes: Vec<u8>,
    instance_list: Vec<Instance>,
}

/// Bind group 0: the views at dynamic offsets, and the frame.
struct Uniforms {
    views: wgpu::Buffer,
    frame: wgpu::Buffer,
    group: wgpu::BindGroup,
    /// Bytes from one view to the next, as the device wants them aligned.
    stride: u32,
}

impl Renderer {
    /// # Errors
    /// [`RenderError::Samples`] for a sample count the device cannot draw, [`RenderError::Device`] when it fails.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat, samples: u32) -> Result<Self, RenderError> {
        let flags = gpu.adapter.get_texture_format_features(format).flags;
        let depth_flags = gpu.adapter.get_texture_format_features(DEPTH_FORMAT).flags;
        if !(flags.sample_count_supported(samples) && depth_flags.sample_count_supported(samples)) {
            let offered = (flags & depth_flags).supported_sample_counts();
            return Err(RenderError::Samples { adapter: gpu.adapter_name.clone(), format, samples, offered });
        }
        let group_layout = group_layout(&gpu.device);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&group_layout)],
            immediate_size: 0,
        });
        let pipeline = |label, parts: &[&str], buffers: &[Option<wgpu::VertexBufferLayout<'_>>], surface| {
            let module = shader::module(&gpu.device, label, &parts.concat());
            pipeline(&gpu.device, &Pass { label, layout: &layout, module, buffers, surface }, format, samples)
        };
        let renderer = Self {
            format,
            samples,
            body: pipeline("body", &shader::BODY, &body::vertex_layout(), Surface::Opaque),
            solid: pipeline("solid", &shader::SOLID, &solid::vertex_layout(), Surface::Opaque),
            background: pipeline("background", &shader::BACKGROUND, &[], Surface::Background),
            grid: pipeline("grid", &shader::GRID, &[], Surface::Translucent),
            quads: InstancedPass::default(),
            lines: InstancedPass::default(),
            solids: SolidMeshes::new(gpu)?,
            uniforms: Uniforms::new(gpu, &group_layout, 8)?,
            group_layout,
            layout,
            instances: instance_buffer(gpu, 16)?,
            view_bytes: Vec::new(),
            instance_list: Vec::new(),
        };
        gpu.check()?;
        Ok(renderer)
    }

    /// Draws `contents` into all `pictures` with one submission; returns the time to encode and submit it. The device
    /// draws meanwhile: [`Gpu::wait`] tells how long.
    ///
    /// # Errors
    /// A viewport outside its target, a target of another sample count, or a device that failed.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        pictures: &[Picture<'_>],
        contents: &FrameContents<'_>,
    ) -> Result<Duration, RenderError> {
        let start = Instant::now();
        for picture in pictures {
            picture.check(self.samples)?;
        }
        let offsets = self.write_views(gpu, pictures)?;
        let solid_counts = self.write_instances(gpu, contents)?;
        let made_for = MadeFor { layout: &self.layout, format: self.format, samples: self.samples };
        self.quads.upload(gpu, &made_for, contents.quads)?;
        self.lines.upload(gpu, &made_for, contents.lines)?;
        gpu.queue.write_buffer(&self.uniforms.frame, 0, bytemuck::bytes_of(&FrameUniform::new(contents)));

        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut offsets = offsets.into_iter();
        for picture in pictures {
            let mut pass = begin_pass(&mut encoder, picture);
            for (viewport, offset) in picture.viewports.iter().zip(&mut offsets) {
                let Some(offset) = offset else { continue };
                let [x, y, width, height] = viewport.rect;
                pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
                pass.set_scissor_rect(x, y, width, height);
                pass.set_bind_group(0, &self.uniforms.group, &[offset]);
                self.draw_view(&mut pass, contents, solid_counts);
            }
            // wgpu's OpenGL backend resolves through the last scissor and would lose the other viewports.
            pass.set_scissor_rect(0, 0, picture.attachments.width, picture.attachments.height);
        }
        gpu.queue.submit([encoder.finish()]);
        gpu.check()?;
        Ok(start.elapsed())
    }

    fn draw_view(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        contents: &FrameContents<'_>,
        solid_counts: [u32; 4],
    ) {
        let instances = |first: usize| self.instances.slice((first * size_of::<Instance>()) as u64..);
        pass.set_pipeline(&self.body);
        for (k, body) in contents.bodies.iter().enumerate() {
            let BodyBuffers { indices, positions, normals, colors, triangle_count, .. } = body.buffers;
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.set_vertex_buffer(0, positions.slice(..));
            pass.set_vertex_buffer(1, normals.slice(..));
            pass.set_vertex_buffer(2, colors.slice(..));
            pass.set_vertex_buffer(3, instances(k));
            pass.draw_indexed(0..*triangle_count as u32 * 3, 0, 0..1);
        }
        pass.set_pipeline(&self.solid);
        pass.set_index_buffer(self.solids.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.set_vertex_buffer(0, self.solids.vertices.slice(..));
        let mut first = contents.bodies.len();
        for (range, count) in self.solids.ranges.iter().zip(solid_counts) {
            if count > 0 {
                pass.set_vertex_buffer(1, instances(first));
                pass.draw_indexed(range.clone(), 0, 0..count);
            }
            first += count as usize;
        }
        pass.set_pipeline(&self.background);
        pass.draw(0..3, 0..1);
        if contents.grid.is_some() {
            pass.set_pipeline(&self.grid);
            pass.draw(0..4, 0..1);
        }
        self.quads.draw(pass);
        self.lines.draw(pass);
    }

    /// Whether the pipelines of (quads, lines) are there: only once some were drawn.
    pub fn made(&self) -> (bool, bool) {
        (self.quads.is_made(), self.lines.is_made())
    }

    /// Uploads the views of all pictures; returns each viewport's offset, None where there is nothing to draw.
    fn write_views(&mut self, gpu: &Gpu, pictures: &[Picture<'_>]) -> Result<Vec<Option<u32>>, RenderError> {
        self.view_bytes.clear();
        let mut offsets = Vec::new();
        for viewport in pictures.iter().flat_map(|picture| picture.viewports) {
            let [_, _, width, height] = viewport.rect;
            let uniform = viewport.view.as_ref().and_then(|view| ViewUniform::new(view, [width, height]));
            offsets.push(uniform.map(|uniform| {
                let offset = self.view_bytes.len();
                self.view_bytes.extend_from_slice(bytemuck::bytes_of(&uniform));
                self.view_bytes.resize(offset + self.uniforms.stride as usize, 0);
                offset as u32
            }));
        }
        if self.view_bytes.len() as u64 > self.uniforms.views.size() {
            let count = (self.view_bytes.len() / self.uniforms.stride as usize).next_power_of_two();
            self.uniforms = Uniforms::new(gpu, &self.group_layout, count)?;
        }
        gpu.queue.write_buffer(&self.uniforms.views, 0, &self.view_bytes);
        Ok(offsets)
    }

    /// Uploads the instances: bodies in their order, then the solids; returns how many solids of each shape.
    fn write_instances(&mut self, gpu: &Gpu, contents: &FrameContents<'_>) -> Result<[u32; 4], RenderError> {
        let list = &mut self.instance_list;
        list.clear();
        list.extend(
            contents
                .bodies
                .iter()
                .map(|body| Instance { room_from_shape: body.room_from_body.into(), color: [0.0; 4] }),
        );
        let counts = solid::instances(contents, list);
        let bytes: &[u8] = bytemuck::cast_slice(list);
        if bytes.len() as u64 > self.instances.size() {
            self.instances = instance_buffer(gpu, list.len().next_power_of_two())?;
        }
        gpu.queue.write_buffer(&self.instances, 0, bytes);
        Ok(counts)
    }
}

impl Uniforms {
    fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout, views: usize) -> Result<Self, RenderError> {
        let view_size = size_of::<ViewUniform>() as u32;
        let stride = view_size.next_multiple_of(gpu.device.limits().min_uniform_buffer_offset_alignment);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let views = gpu.buffer("views", u64::from(stride) * views as u64, usage)?;
        let frame = gpu.buffer("frame", size_of::<FrameUniform>() as u64, usage)?;
        let one_view = wgpu::BufferBinding {
            buffer: &views,
            offset: 0,
            size: wgpu::BufferSize::new(u64::from(view_size)),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(one_view) },
                wgpu::BindGroupEntry { binding: 1, resource: frame.as_entire_binding() },
            ],
        });
        Ok(Self { views, frame, group, stride })
    }
}

fn instance_buffer(gpu: &Gpu, count: usize) -> Result<wgpu::Buffer, RenderError> {
    let bytes = count as u64 * size_of::<Instance>() as u64;
    gpu.buffer("instances", bytes, BufferUsages::VERTEX | BufferUsages::COPY_DST)
}

fn group_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
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
    pub(super) layout: &'a wgpu::PipelineLayout,
    pub(super) module: wgpu::ShaderModule,
    pub(super) buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    pub(super) surface: Surface,
}

pub(super) fn pipeline(
    device: &wgpu::Device,
    pass: &Pass<'_>,
    format: wgpu::TextureFormat,
    samples: u32,
) -> wgpu::RenderPipeline {
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
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(pass.label),
        layout: Some(pass.layout),
        vertex: wgpu::VertexState {
            module: &pass.module,
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
            module: &pass.module,
            entry_point: Some("fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState { format, blend, write_mask: wgpu::ColorWrites::ALL })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Everything black and infinitely far.
fn begin_pass<'a>(encoder: &'a mut wgpu::CommandEncoder, picture: &Picture<'_>) -> wgpu::RenderPass<'a> {
    let attachments = picture.attachments;
    let (view, resolve_target, store) = match &attachments.multisampled {
        Some(multisampled) => (multisampled, Some(picture.texture), wgpu::StoreOp::Discard),
        None => (picture.texture, None, wgpu::StoreOp::Store),
    };
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("picture"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target,
            ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store },
        })],
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &attachments.depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0.0),
                store: wgpu::StoreOp::Discard,
            }),
            stencil_ops: None,
        }),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}
