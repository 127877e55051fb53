//! Pictures without a window: draw into a texture, read it back as an `RgbaImage`.

use super::error::RenderError;
use super::gpu::Gpu;
use super::renderer::Renderer;
use super::target::{Attachments, Picture, check_size, texture};
use super::view::Viewport;
use image::RgbaImage;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The format of offscreen pictures: sRGB-encoded by the device, as PNG files hold them.
pub const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// A texture of one size with its read-back buffer, made once and drawn into every frame.
pub struct Readable {
    pub size: [u32; 2],
    pub view: wgpu::TextureView,
    texture: wgpu::Texture,
    readback: Readback,
}

/// A readable target that is drawn in one pass.
pub struct Offscreen {
    pub attachments: Arc<Attachments>,
    pub image: Readable,
}

impl Offscreen {
    /// A target for `renderer`, which must draw [`COLOR_FORMAT`].
    /// Errors: [`RenderError::PictureSize`] or [`RenderError::BufferSize`] beyond the device's limits.
    pub fn new(gpu: &Gpu, renderer: &Renderer, size: [u32; 2]) -> Result<Self, RenderError> {
        let attachments = renderer.attachments(gpu, size, 1)?;
        Ok(Self { attachments, image: Readable::new(gpu, size)? })
    }

    pub fn picture<'a>(&'a self, viewports: &'a [Viewport]) -> Picture<'a> {
        Picture { attachments: &self.attachments, texture: &self.image.view, viewports }
    }

    /// See [`Readable::read`].
    pub fn read(&self, gpu: &Gpu) -> Result<(RgbaImage, Duration), RenderError> {
        self.image.read(gpu)
    }
}

impl Readable {
    /// Errors: [`RenderError::PictureSize`] or [`RenderError::BufferSize`] beyond the device's limits.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, RenderError> {
        check_size(gpu, size)?;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = gpu.device.create_texture(&texture(size, COLOR_FORMAT, 1, usage));
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        gpu.check()?;
        Ok(Self { size, view, texture, readback: Readback::new(gpu, size)? })
    }

    /// The picture as drawn by everything submitted so far, and the time to fetch it. Call [`Gpu::wait`] first to separate the
    /// time of drawing from that of reading.
    pub fn read(&self, gpu: &Gpu) -> Result<(RgbaImage, Duration), RenderError> {
        let start = Instant::now();
        Ok((self.readback.read(gpu, &self.texture, 0)?, start.elapsed()))
    }
}

/// The way of a picture from the device to memory.
pub(super) struct Readback {
    size: [u32; 2],
    /// Rows padded to wgpu's 256 bytes.
    bytes_per_row: u32,
    buffer: wgpu::Buffer,
}

impl Readback {
    pub(super) fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, RenderError> {
        let bytes_per_row = (size[0] * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(bytes_per_row) * u64::from(size[1]);
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        Ok(Self { size, bytes_per_row, buffer: gpu.buffer("picture to read back", bytes, usage)? })
    }

    /// Reads one layer of a texture of this size, as drawn by everything submitted so far.
    pub(super) fn read(
        &self,
        gpu: &Gpu,
        texture: &wgpu::Texture,
        layer: u32,
    ) -> Result<RgbaImage, RenderError> {
        let [width, height] = self.size;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let rows = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(self.bytes_per_row),
            rows_per_image: None,
        };
        let mut from = texture.as_image_copy();
        from.origin.z = layer;
        encoder.copy_texture_to_buffer(
            from,
            wgpu::TexelCopyBufferInfo { buffer: &self.buffer, layout: rows },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        gpu.queue.submit([encoder.finish()]);
        let pixels = gpu.mapped(&self.buffer, |mapped| {
            let mut pixels = Vec::with_capacity(width as usize * height as usize * 4);
            for row in mapped.chunks_exact(self.bytes_per_row as usize) {
                pixels.extend_from_slice(&row[..width as usize * 4]);
            }
            pixels
        })?;
        RgbaImage::from_raw(width, height, pixels)
            .ok_or_else(|| RenderError::Device("the picture came back incomplete".to_owned()))
    }
}
