//! Pictures without a window: draw into a texture, read it back as an `RgbaImage`.

use super::target::{check_size, texture};
use super::{Attachments, Gpu, Picture, RenderError, Renderer, Viewport};
use image::RgbaImage;
use std::time::{Duration, Instant};

/// The format of offscreen pictures: sRGB-encoded by the device, as PNG files hold them.
pub const COLOR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

/// A texture of one size with its read-back buffer, made once and drawn into every frame.
pub struct Readable {
    pub size: [u32; 2],
    pub view: wgpu::TextureView,
    texture: wgpu::Texture,
    /// Rows padded to wgpu's 256 bytes.
    readback: wgpu::Buffer,
    bytes_per_row: u32,
}

/// A readable target that is drawn in one pass.
pub struct Offscreen {
    pub attachments: Attachments,
    pub image: Readable,
}

impl Offscreen {
    /// A target for `renderer`, which must draw [`COLOR_FORMAT`].
    ///
    /// # Errors
    /// [`RenderError::PictureSize`] or [`RenderError::BufferSize`] beyond the device's limits.
    pub fn new(gpu: &Gpu, renderer: &Renderer, size: [u32; 2]) -> Result<Self, RenderError> {
        let attachments = Attachments::new(gpu, COLOR_FORMAT, renderer.samples, size)?;
        Ok(Self { attachments, image: Readable::new(gpu, size)? })
    }

    pub fn picture<'a>(&'a self, viewports: &'a [Viewport]) -> Picture<'a> {
        Picture { attachments: &self.attachments, texture: &self.image.view, viewports }
    }

    /// See [`Readable::read`].
    ///
    /// # Errors
    /// [`RenderError::Device`] when the device failed or was lost.
    pub fn read(&self, gpu: &Gpu) -> Result<(RgbaImage, Duration), RenderError> {
        self.image.read(gpu)
    }
}

impl Readable {
    /// # Errors
    /// [`RenderError::PictureSize`] or [`RenderError::BufferSize`] beyond the device's limits.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self, RenderError> {
        check_size(gpu, size)?;
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = gpu.device.create_texture(&texture(size, COLOR_FORMAT, 1, usage));
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let bytes_per_row = (size[0] * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let bytes = u64::from(bytes_per_row) * u64::from(size[1]);
        let readback = gpu.buffer(
            "picture to read back",
            bytes,
            wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        )?;
        gpu.check()?;
        Ok(Self { size, view, texture, readback, bytes_per_row })
    }

    /// The picture as drawn by everything submitted so far, and the time to fetch it. [`Gpu::wait`] first tells the
    /// time of drawing from that of reading.
    ///
    /// # Errors
    /// [`RenderError::Device`] when the device failed or was lost.
    pub fn read(&self, gpu: &Gpu) -> Result<(RgbaImage, Duration), RenderError> {
        let start = Instant::now();
        let [width, height] = self.size;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let rows = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(self.bytes_per_row),
            rows_per_image: None,
        };
        encoder.copy_texture_to_buffer(
            self.texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &self.readback, layout: rows },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        gpu.queue.submit([encoder.finish()]);

        let pixels = gpu.mapped(&self.readback, |mapped| {
            let mut pixels = Vec::with_capacity(width as usize * height as usize * 4);
            for row in mapped.chunks_exact(self.bytes_per_row as usize) {
                pixels.extend_from_slice(&row[..width as usize * 4]);
            }
            pixels
        })?;
        let image = RgbaImage::from_raw(width, height, pixels)
            .ok_or_else(|| RenderError::Device("the picture came back incomplete".to_owned()))?;
        Ok((image, start.elapsed()))
    }
}
