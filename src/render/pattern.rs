//! Patterns that are fixed to a body's material: lines, an image.
//!
//! In: the surface at rest, as it is drawn, and a [`Pattern`]. Out: the places of the vertices at rest as a vertex buffer, and
//! the image with its smaller copies as a texture. A body without a pattern has none of it, and is drawn by a pipeline that reads
//! none of it.

use super::error::RenderError;
use super::gpu::Gpu;
use super::target::check_size;
use image::{RgbaImage, imageops};
use std::sync::Arc;
use wgpu::BufferUsages;

/// Lines and an image on the surface of a body.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pattern {
    /// The point where the lines of all three directions meet and the image begins, in the frame of the surface at rest.
    pub middle: [f32; 3],
    /// Distance from line to line; lines are drawn where a plane across an axis cut the surface at rest.
    pub line_spacing_m: Option<f32>,
    /// sRGB, and the width of one repetition, m: projected along the axes on the surface at rest.
    pub image: Option<(Arc<RgbaImage>, f32)>,
}

/// Pixels of an image's longer side on the device.
const MOST_PIXELS: u32 = 4096;

/// The pattern of one body on the device.
pub(super) struct PatternBuffers {
    pub(super) rest: wgpu::Buffer,
    pub(super) image: Option<wgpu::BindGroup>,
    /// [`super::parts::Instance::color`] of a body: lines a metre, repetitions a metre along u and v.
    pub(super) scale: [f32; 3],
}

impl PatternBuffers {
    /// None where the pattern shows nothing.
    pub(super) fn new(gpu: &Gpu, rest: &[[f32; 3]], pattern: &Pattern) -> Result<Option<Self>, RenderError> {
        if pattern.line_spacing_m.is_none() && pattern.image.is_none() {
            return Ok(None);
        }
        let from_middle: Vec<[f32; 3]> =
            rest.iter().map(|x| [0, 1, 2].map(|axis| x[axis] - pattern.middle[axis])).collect();
        let usage = BufferUsages::VERTEX | BufferUsages::COPY_DST;
        let buffer = gpu.buffer("rest surface of a pattern", size_of_val(&from_middle[..]) as u64, usage)?;
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&from_middle));
        let [u, v] = pattern.image.as_ref().map_or([0.0; 2], |(image, size)| {
            [1.0 / size, image.width() as f32 / (image.height().max(1) as f32 * size)]
        });
        let image = pattern.image.as_ref().map(|(image, _)| upload(gpu, image)).transpose()?;
        let lines = pattern.line_spacing_m.map_or(0.0, |spacing| 1.0 / spacing);
        gpu.check()?;
        Ok(Some(Self { rest: buffer, image, scale: [lines, u, v] }))
    }
}

/// Layout of an image and its sampler: bindings 0 and 1.
pub(super) fn image_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty,
        count: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("image"),
        entries: &[
            entry(
                0,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
            entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        ],
    })
}

fn upload(gpu: &Gpu, image: &RgbaImage) -> Result<wgpu::BindGroup, RenderError> {
    let longer = image.width().max(image.height());
    let reduced = (longer > MOST_PIXELS).then(|| {
        let side =
            |pixels: u32| (u64::from(pixels) * u64::from(MOST_PIXELS) / u64::from(longer)).max(1) as u32;
        imageops::resize(image, side(image.width()), side(image.height()), imageops::FilterType::Triangle)
    });
    let mut level = reduced.unwrap_or_else(|| image.clone());
    let (width, height) = level.dimensions();
    check_size(gpu, [width, height])?;
    let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let levels = size.max_mips(wgpu::TextureDimension::D2);
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("image"),
        size,
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    for mip_level in 0..levels {
        let (width, height) = level.dimensions();
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level,
                origin: wgpu::Origin3d::ZERO,
                aspect: wgpu::TextureAspect::All,
            },
            &level,
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        let half = |side: u32| (side / 2).max(1);
        level = imageops::resize(&level, half(width), half(height), imageops::FilterType::Triangle);
    }
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("image"),
        address_mode_u: wgpu::AddressMode::Repeat,
        address_mode_v: wgpu::AddressMode::Repeat,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        anisotropy_clamp: if gpu.is_software { 1 } else { 8 },
        ..Default::default()
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    Ok(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("image"),
        layout: &image_layout(&gpu.device),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(&view) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&sampler) },
        ],
    }))
}
