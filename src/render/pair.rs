//! Both eyes' pictures of one screen: drawn in one pass where the device has multiview, in two where not.
//!
//! In: a size; out: a picture per eye, plain two-dimensional and equal in both ways. In one pass every vertex is fetched
//! once and every command is recorded once for both eyes; each eye's picture is then a layer of one texture.

use super::error::RenderError;
use super::gpu::Gpu;
use super::offscreen::Readback;
use super::renderer::Renderer;
use super::target::{Attachments, Picture, layered};
use super::view::Viewport;
use image::RgbaImage;
use std::sync::Arc;
use wgpu::TextureUsages;

/// Two pictures of one size.
pub struct EyePair {
    pub size: [u32; 2],
    /// Each eye's picture by itself.
    pub eyes: [wgpu::TextureView; 2],
    /// Both as layers of one texture, for one pass; None where they are drawn one after the other.
    both: Option<wgpu::TextureView>,
    attachments: Arc<Attachments>,
    /// One texture of two layers, or two textures: some software drivers resolve samples into the wrong layer of an array when
    /// its layers are drawn in separate passes.
    textures: Vec<wgpu::Texture>,
}

impl EyePair {
    /// The usage of a pair that is only drawn into.
    pub const NO_OTHER_USAGE: TextureUsages = TextureUsages::empty();

    /// Makes a pair for `renderer`, drawn in one pass if its `multiview` says so. `usage` is added to that of a target.
    /// Errors: as [`Attachments::new`].
    pub fn new(
        gpu: &Gpu,
        renderer: &Renderer,
        size: [u32; 2],
        usage: TextureUsages,
    ) -> Result<Self, RenderError> {
        let layers = if renderer.multiview { 2 } else { 1 };
        let attachments = renderer.attachments(gpu, size, layers)?;
        let usage = usage | TextureUsages::RENDER_ATTACHMENT;
        let textures: Vec<_> =
            (0..2 / layers).map(|_| layered(gpu, size, layers, renderer.format, 1, usage)).collect();
        let whole = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let layer = |base_array_layer| wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2),
            base_array_layer,
            array_layer_count: Some(1),
            ..Default::default()
        };
        let (eyes, both) = match textures.as_slice() {
            [left, right] => ([whole(left), whole(right)], None),
            both => ([0, 1].map(|eye| both[0].create_view(&layer(eye))), Some(whole(&both[0]))),
        };
        gpu.check()?;
        Ok(Self { size, eyes, both, attachments, textures })
    }

    /// A pair that can be read back: see [`EyePair::read`].
    /// Errors: as [`EyePair::new`].
    pub fn readable(gpu: &Gpu, renderer: &Renderer, size: [u32; 2]) -> Result<Self, RenderError> {
        Self::new(gpu, renderer, size, TextureUsages::COPY_SRC)
    }

    /// Whether a pair of this size would be made for `renderer` as this one was.
    pub(super) fn fits(&self, renderer: &Renderer, size: [u32; 2]) -> bool {
        self.size == size && self.is_one_pass() == renderer.multiview
    }

    pub fn is_one_pass(&self) -> bool {
        self.both.is_some()
    }

    /// The pictures to draw: one with both eyes, or one for each. Both viewports have one rectangle.
    pub fn pictures<'a>(&'a self, viewports: &'a [Viewport; 2]) -> Vec<Picture<'a>> {
        let attachments = &*self.attachments;
        match &self.both {
            Some(texture) => vec![Picture { attachments, texture, viewports }],
            None => {
                let alone = viewports.chunks_exact(1);
                let eyes = self.eyes.iter().zip(alone);
                eyes.map(|(texture, viewports)| Picture { attachments, texture, viewports }).collect()
            }
        }
    }

    /// Reads the picture of eye 0 or 1 of a readable pair, as drawn by everything submitted so far.
    /// Errors: [`RenderError::Device`] when the device failed or was lost, [`RenderError::BufferSize`] beyond its limits.
    pub fn read(&self, gpu: &Gpu, eye: usize) -> Result<RgbaImage, RenderError> {
        let (texture, layer) = match self.textures.as_slice() {
            [left, right] => ([left, right][eye], 0),
            both => (&both[0], eye as u32),
        };
        Readback::new(gpu, self.size)?.read(gpu, texture, layer)
    }
}
