//! Targets of pictures: the multisampled colour and depth of one size, the plain texture they resolve to, and the number of
//! samples a pixel: as asked for, or as the device can afford.

use super::error::RenderError;
use super::gpu::Gpu;
use super::view::Viewport;

pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Depth, and multisampled colour where there is more than one sample, for targets of one size. Nothing of it lasts
/// beyond a pass, so targets that are drawn one after another share it ([`super::Renderer::attachments`]).
pub struct Attachments {
    pub width: u32,
    pub height: u32,
    pub samples: u32,
    /// 2 where both eyes are drawn in one pass, each into its layer.
    pub layers: u32,
    pub(super) multisampled: Option<wgpu::TextureView>,
    pub(super) depth: wgpu::TextureView,
}

impl Attachments {
    /// Errors: [`RenderError::PictureSize`] outside 1 to the device's texture limit, [`RenderError::NoMultiview`] for
    /// two layers where the device cannot draw both in one pass.
    pub fn new(
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        samples: u32,
        [width, height]: [u32; 2],
        layers: u32,
    ) -> Result<Self, RenderError> {
        check_size(gpu, [width, height])?;
        if layers > 1 && !gpu.can_multiview(samples) {
            return Err(RenderError::NoMultiview { adapter: gpu.adapter_name.clone(), samples });
        }
        let attachment = |format| {
            let usage = wgpu::TextureUsages::RENDER_ATTACHMENT;
            layered(gpu, [width, height], layers, format, samples, usage)
                .create_view(&wgpu::TextureViewDescriptor::default())
        };
        let attachments = Self {
            width,
            height,
            samples,
            layers,
            multisampled: (samples > 1).then(|| attachment(format)),
            depth: attachment(DEPTH_FORMAT),
        };
        gpu.check()?;
        Ok(attachments)
    }

    /// Memory on the device: four bytes of depth a sample, and four of colour where there is more than one.
    pub fn bytes(&self) -> u64 {
        let a_sample = if self.samples > 1 { 8 } else { 4 };
        u64::from(self.width) * u64::from(self.height) * u64::from(self.samples * self.layers * a_sample)
    }
}

/// One target of a frame: where it is drawn and which views it holds. What no viewport covers stays black.
#[derive(Clone, Copy)]
pub struct Picture<'a> {
    pub attachments: &'a Attachments,
    /// A plain two-dimensional texture: some software drivers resolve layers of an array into the wrong one. Of
    /// attachments with two layers, an array of two, which one pass resolves right.
    pub texture: &'a wgpu::TextureView,
    /// Viewports of the views; for attachments with two layers, one of each layer, both with the same rectangle.
    pub viewports: &'a [Viewport],
}

impl Picture<'_> {
    pub(super) fn check(&self, samples: u32) -> Result<(), RenderError> {
        let &Attachments { width, height, samples: found, layers, .. } = self.attachments;
        if found != samples {
            return Err(RenderError::SamplesDiffer { found, expected: samples });
        }
        let is_pair = matches!(self.viewports, [left, right] if left.rect == right.rect);
        if layers > 1 && !is_pair {
            return Err(RenderError::NotAPair { found: self.viewports.len() });
        }
        for viewport in self.viewports {
            let rect @ [x, y, w, h] = viewport.rect.map(u64::from);
            let inside = w > 0 && h > 0 && x + w <= u64::from(width) && y + h <= u64::from(height);
            if !inside {
                let rect = rect.map(|side| side as u32);
                return Err(RenderError::ViewportOutside { rect, width, height });
            }
        }
        Ok(())
    }
}

pub(super) fn check_size(gpu: &Gpu, [width, height]: [u32; 2]) -> Result<(), RenderError> {
    let limit = gpu.device.limits().max_texture_dimension_2d;
    if width == 0 || height == 0 || width > limit || height > limit {
        return Err(RenderError::PictureSize { width, height, limit });
    }
    Ok(())
}

pub(super) fn texture(
    [width, height]: [u32; 2],
    format: wgpu::TextureFormat,
    sample_count: u32,
    usage: wgpu::TextureUsages,
) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    }
}

/// Makes a texture of `layers` layers.
pub(super) fn layered(
    gpu: &Gpu,
    size: [u32; 2],
    layers: u32,
    format: wgpu::TextureFormat,
    samples: u32,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    let mut descriptor = texture(size, format, samples, usage);
    descriptor.size.depth_or_array_layers = layers;
    gpu.device.create_texture(&descriptor)
}

/// The number of samples of each pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Samples {
    /// 4 on a graphics device; 1 on a software device, where 4 take about six times as long.
    #[default]
    Auto,
    /// 1 or 4.
    Exactly(u32),
}

impl Samples {
    pub fn on(self, gpu: &Gpu) -> u32 {
        match self {
            Samples::Auto if gpu.is_software => 1,
            Samples::Auto => 4,
            Samples::Exactly(samples) => samples,
        }
    }
}
