//! The renderer: one render pass per target and frame, or per pair of eyes, in which each of [`PASSES`] draws its part.
//!
//! In come [`Picture`]s (targets with their views) and [`FrameContents`]; out go their pixels. Opaque bodies and solids
//! are drawn first, so that the background only costs where it shows, and the floor's lines last, blended. What lies
//! outside of a view is not drawn in it. Nothing is created in a frame but the command buffer; the small buffers grow
//! when a frame holds more than any before it, and the pipelines for both eyes are made with the first such picture.

use super::body::BodyPass;
use super::error::RenderError;
use super::formed::FormedPass;
use super::frame::{FrameContents, Line, Quad};
use super::ghost::GhostPass;
use super::gpu::Gpu;
use super::grid::{BackgroundPass, Floor};
use super::ground::GroundPass;
use super::lighting::LightingUniform;
use super::pass::{BOTH_EYES, DrawCounts, DrawPass, DrawTo, MadeFor, ViewDraw, group_layout};
use super::shadow::{ShadowMaps, Shadows};
use super::solid::SolidPass;
use super::strips::{CustomStripsPass, StripPass};
use super::target::{Attachments, Picture};
use super::view::{View, ViewUniform};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};
use wgpu::BufferUsages;

/// The passes in their order: opaque things first, so that the background costs only where it shows, and blended things last. One
/// file each, beside the shader of the same name.
pub(super) const PASSES: &[fn() -> Box<dyn DrawPass>] = &[
    || Box::<BodyPass>::default(),
    || Box::<SolidPass>::default(),
    || Box::<FormedPass>::default(),
    || Box::<BackgroundPass>::default(),
    || Box::<StripPass<Floor>>::default(),
    || Box::<GhostPass>::default(),
    || Box::<GroundPass>::default(),
    || Box::<StripPass<Quad>>::default(),
    || Box::<StripPass<Line>>::default(),
    || Box::<CustomStripsPass>::default(),
];

/// Pipelines for one device, colour format and sample count, with the buffers that change every frame.
pub struct Renderer {
    pub format: wgpu::TextureFormat,
    /// 1 or 4 samples a pixel.
    pub samples: u32,
    /// Draw both eyes of a screen in one pass, where the caller has two pictures of one size. From the start, whether
    /// a hardware device can: under lavapipe of Mesa 22.3 a triangle that the picture's edge cuts loses its view, and
    /// is drawn into the first eye's layer with view_index 0. One triangle without buffers, depth or multisampling
    /// shows that: it is right as long as all its corners lie within the picture.
    pub multiview: bool,
    /// Leave out what no eye of a pass can see; from the start, true.
    pub culling: bool,
    /// The kind of shadows; none at the start, because they cost time in every frame.
    pub shadows: Shadows,
    /// Made with the first bodies that have soft shadows.
    maps: Option<ShadowMaps>,
    /// Counts of the shapes that the last frame drew.
    pub counts: DrawCounts,
    passes: Vec<Box<dyn DrawPass>>,
    group_layout: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
    uniforms: Uniforms,
    /// Contents of `uniforms.views`, kept to spare their allocation.
    view_bytes: Vec<u8>,
    /// Targets of each size that are in use.
    attachments: Mutex<Vec<Weak<Attachments>>>,
}

/// Bind group 0: the views at dynamic offsets, and the lighting.
struct Uniforms {
    views: wgpu::Buffer,
    lighting: wgpu::Buffer,
    group: wgpu::BindGroup,
    /// Bytes from one view to the next, as the device wants them aligned.
    stride: u32,
}

impl Renderer {
    /// Errors: [`RenderError::Samples`] for a sample count the device cannot draw, [`RenderError::Device`] when it
    /// fails.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat, samples: u32) -> Result<Self, RenderError> {
        let flags = gpu.adapter.get_texture_format_features(format).flags;
        let depth_flags = gpu.adapter.get_texture_format_features(super::target::DEPTH_FORMAT).flags;
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
        let renderer = Self {
            format,
            samples,
            multiview: gpu.can_multiview(samples) && !gpu.is_software,
            culling: true,
            shadows: Shadows::Off,
            maps: None,
            counts: DrawCounts::default(),
            passes: PASSES.iter().map(|new| new()).collect(),
            uniforms: Uniforms::new(gpu, &group_layout, 8)?,
            group_layout,
            layout,
            view_bytes: Vec::new(),
            attachments: Mutex::default(),
        };
        gpu.check()?;
        Ok(renderer)
    }

    /// The attachments for targets of one size and number of layers; all that are in use at the same time are the same.
    /// Errors: as [`Attachments::new`].
    pub fn attachments(
        &self,
        gpu: &Gpu,
        size: [u32; 2],
        layers: u32,
    ) -> Result<Arc<Attachments>, RenderError> {
        let mut all = self.attachments.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|known| known.strong_count() > 0);
        let fits = |known: &Arc<Attachments>| ([known.width, known.height], known.layers) == (size, layers);
        if let Some(known) = all.iter().filter_map(Weak::upgrade).find(fits) {
            return Ok(known);
        }
        let new = Arc::new(Attachments::new(gpu, self.format, self.samples, size, layers)?);
        all.push(Arc::downgrade(&new));
        Ok(new)
    }

    /// Bytes of the attachments in use, and what they would be if every target had its own.
    pub fn attachment_bytes(&self) -> [u64; 2] {
        let all = self.attachments.lock().unwrap_or_else(PoisonError::into_inner);
        let of = |known: &Weak<Attachments>| known.upgrade().map_or(0, |known| known.bytes());
        let alone = |known: &Weak<Attachments>| of(known) * known.strong_count() as u64;
        [all.iter().map(of).sum(), all.iter().map(alone).sum()]
    }

    /// Draws `contents` into all `pictures` with one submission; returns the time to encode and submit it. The device draws
    /// meanwhile: [`Gpu::wait`] returns how long.
    /// Errors: a viewport outside its target, a target of another sample count, or a device that failed.
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
        let is_pair = |picture: &Picture<'_>| picture.attachments.layers > 1;
        let (format, samples) = (self.format, self.samples);
        self.draw_maps(gpu, contents)?;
        let (shadows, maps) = (self.shadows, self.maps.as_ref().filter(|_| self.shadows == Shadows::Soft));
        let (group_layout, layout) = (&self.group_layout, &self.layout);
        let made_for =
            |both_eyes| MadeFor { group_layout, layout, format, samples, both_eyes, shadows, maps };
        let kinds: Vec<MadeFor<'_>> = [false, true]
            .into_iter()
            .filter(|both_eyes| pictures.iter().any(|picture| is_pair(picture) == *both_eyes))
            .map(made_for)
            .collect();
        for pass in &mut self.passes {
            pass.upload(gpu, &kinds, contents)?;
        }
        let view_draws = self.write_views(gpu, pictures)?;
        let maps = self.maps.as_ref().filter(|_| self.shadows == Shadows::Soft);
        gpu.queue.write_buffer(
            &self.uniforms.lighting,
            0,
            bytemuck::bytes_of(&LightingUniform::new(&contents.lighting)),
        );

        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut counts = DrawCounts::default();
        for (picture, view_draws) in pictures.iter().zip(view_draws) {
            let mut pass = begin_pass(gpu, &mut encoder, picture);
            counts.passes += 1;
            for view_draw in view_draws {
                let [x, y, width, height] = view_draw.rect;
                pass.set_viewport(x as f32, y as f32, width as f32, height as f32, 0.0, 1.0);
                pass.set_scissor_rect(x, y, width, height);
                pass.set_bind_group(0, &self.uniforms.group, &[view_draw.offset]);
                let mut to = DrawTo { pass: &mut pass, view_draw: &view_draw, counts: &mut counts, maps };
                self.passes.iter().for_each(|kind| kind.draw(&mut to, contents));
            }
            // wgpu's OpenGL backend resolves through the last scissor and would lose the other viewports.
            pass.set_scissor_rect(0, 0, picture.attachments.width, picture.attachments.height);
        }
        gpu.queue.submit([encoder.finish()]);
        gpu.check()?;
        self.counts = counts;
        Ok(start.elapsed())
    }

    /// The shadow maps of the frame, where there are soft shadows.
    fn draw_maps(&mut self, gpu: &Gpu, contents: &FrameContents<'_>) -> Result<(), RenderError> {
        if self.shadows != Shadows::Soft || contents.bodies.is_empty() {
            return Ok(());
        }
        let mut maps = self.maps.take().map_or_else(|| ShadowMaps::new(gpu), Ok)?;
        maps.draw(gpu, &contents.lighting, contents.bodies)?;
        self.maps = Some(maps);
        Ok(())
    }

    /// The passes that have anything on the device: only once there was something for them to draw.
    pub fn made(&self) -> Vec<&'static str> {
        self.passes.iter().filter(|pass| pass.is_made()).map(|pass| pass.name()).collect()
    }

    /// Uploads the views of all pictures; returns what there is to draw in each.
    fn write_views(
        &mut self,
        gpu: &Gpu,
        pictures: &[Picture<'_>],
    ) -> Result<Vec<Vec<ViewDraw>>, RenderError> {
        self.view_bytes.clear();
        let (bytes, stride) = (&mut self.view_bytes, self.uniforms.stride as usize);
        let culling = self.culling;
        let mut view_draw = |rect: [u32; 4], both_eyes: bool, views: &[Option<View>]| {
            let size = [rect[2], rect[3]];
            let uniforms: Vec<Option<ViewUniform>> = views
                .iter()
                .map(|view| view.as_ref().and_then(|view| ViewUniform::new(view, size)))
                .collect();
            if uniforms.iter().all(Option::is_none) {
                return None;
            }
            let offset = bytes.len();
            let mut clip_from_room = [None; 2];
            for (k, uniform) in uniforms.into_iter().enumerate() {
                clip_from_room[k] = uniform.and(views[k]).map(|view| view.clip_from_room);
                bytes.extend_from_slice(bytemuck::bytes_of(&uniform.unwrap_or(ViewUniform::HIDDEN)));
            }
            bytes.resize(bytes.len().next_multiple_of(stride), 0);
            Some(ViewDraw { rect, offset: offset as u32, both_eyes, culling, clip_from_room })
        };
        let view_draws = pictures
            .iter()
            .map(|picture| match picture.viewports {
                [left, right] if picture.attachments.layers > 1 => {
                    view_draw(left.rect, true, &[left.view, right.view]).into_iter().collect()
                }
                viewports => {
                    viewports.iter().filter_map(|one| view_draw(one.rect, false, &[one.view])).collect()
                }
            })
            .collect();
        if self.view_bytes.len() + size_of::<ViewUniform>() > self.uniforms.views.size() as usize {
            let count = (self.view_bytes.len() / stride + 1).next_power_of_two();
            self.uniforms = Uniforms::new(gpu, &self.group_layout, count)?;
        }
        gpu.queue.write_buffer(&self.uniforms.views, 0, &self.view_bytes);
        Ok(view_draws)
    }
}

impl Uniforms {
    fn new(gpu: &Gpu, layout: &wgpu::BindGroupLayout, views: usize) -> Result<Self, RenderError> {
        let view_size = size_of::<ViewUniform>() as u32;
        let stride = view_size.next_multiple_of(gpu.device.limits().min_uniform_buffer_offset_alignment);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        // A pass for one eye binds two views as well, and reads the first.
        let views = gpu.buffer("views", u64::from(stride) * views as u64 + u64::from(view_size), usage)?;
        let lighting = gpu.buffer("lighting", size_of::<LightingUniform>() as u64, usage)?;
        let two_views = wgpu::BufferBinding {
            buffer: &views,
            offset: 0,
            size: wgpu::BufferSize::new(2 * u64::from(view_size)),
        };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(two_views) },
                wgpu::BindGroupEntry { binding: 1, resource: lighting.as_entire_binding() },
            ],
        });
        Ok(Self { views, lighting, group, stride })
    }
}

/// Everything black and infinitely far.
fn begin_pass<'a>(
    gpu: &Gpu,
    encoder: &'a mut wgpu::CommandEncoder,
    picture: &Picture<'_>,
) -> wgpu::RenderPass<'a> {
    let attachments = picture.attachments;
    let span = gpu.clock().and_then(|clock| clock.span("draw"));
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
        timestamp_writes: span.map(|(query_set, begin, end)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(end),
        }),
        occlusion_query_set: None,
        multiview_mask: if attachments.layers > 1 { BOTH_EYES } else { None },
    })
}
