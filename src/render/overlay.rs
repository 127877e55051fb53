//! Writing and flat shapes over a finished picture: laid out by egui's painter, drawn without clearing what is there.
//!
//! In: a closure that paints in pixels (one point is one pixel, the origin at the top left). Out: its triangles on
//! a target of any size, in one step: triangles point into the letters' texture, and laying out more may enlarge that.
//! What is painted lies on the glass, at zero parallax, so both eyes get the same. Fonts are read when the first
//! mesh is laid out; pipeline and textures are made when the first is drawn. Letters are filtered in the shader and
//! colours are not dithered, so that every device draws the same.

use super::error::RenderError;
use super::gpu::Gpu;
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};

/// Paints over targets of one format.
pub struct Overlay {
    format: wgpu::TextureFormat,
    context: egui::Context,
    /// Changes of the letters' texture since the last drawing.
    letters: Vec<egui::epaint::ImageDelta>,
    renderer: Option<Renderer>,
}

/// Widgets over one picture, to be drawn before the next ones are laid out.
pub struct OverlayMesh {
    pub size: [u32; 2],
    primitives: Vec<egui::ClippedPrimitive>,
}

impl Overlay {
    pub fn new(format: wgpu::TextureFormat) -> Self {
        Self { format, context: egui::Context::default(), letters: Vec::new(), renderer: None }
    }

    /// Paints over what a target of `size` pixels holds.
    pub fn paint(
        &mut self,
        gpu: &Gpu,
        target: &wgpu::TextureView,
        size: [u32; 2],
        mut paint: impl FnMut(&egui::Painter),
    ) -> Result<(), RenderError> {
        let [width, height] = size.map(|side| side as f32);
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height))),
            ..Default::default()
        };
        let layer = egui::LayerId::background();
        let output = self.context.run_pass(input, |context| paint(&context.layer_painter(layer)));
        let mesh = self.mesh(size, output);
        self.draw(gpu, target, &mesh)
    }

    /// A mesh of widgets that take `input`, for pictures of `size` pixels.
    pub fn lay_out_widgets(
        &mut self,
        size: [u32; 2],
        input: egui::RawInput,
        show: impl FnMut(&egui::Context),
    ) -> OverlayMesh {
        let output = self.context.run_pass(input, show);
        self.mesh(size, output)
    }

    fn mesh(&mut self, size: [u32; 2], mut output: egui::FullOutput) -> OverlayMesh {
        // The letters are the only texture: nobody loads another.
        let deltas = output.textures_delta.set.remove(&egui::TextureId::default());
        self.letters.extend(deltas.into_iter().flatten());
        OverlayMesh { size, primitives: self.context.tessellate(output.shapes, 1.0) }
    }

    /// Whether pipeline and textures are there: only once something was drawn.
    pub fn is_made(&self) -> bool {
        self.renderer.is_some()
    }

    /// Draws a mesh over what its target holds.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        target: &wgpu::TextureView,
        mesh: &OverlayMesh,
    ) -> Result<(), RenderError> {
        if mesh.primitives.is_empty() {
            return Ok(());
        }
        let format = self.format;
        let renderer = self
            .renderer
            .get_or_insert_with(|| Renderer::new(&gpu.device, format, RendererOptions::PREDICTABLE));
        for delta in self.letters.drain(..) {
            renderer.update_texture(&gpu.device, &gpu.queue, egui::TextureId::default(), &delta);
        }
        draw(gpu, renderer, target, mesh);
        gpu.check()
    }
}

fn draw(gpu: &Gpu, renderer: &mut Renderer, target: &wgpu::TextureView, mesh: &OverlayMesh) {
    let screen = ScreenDescriptor { size_in_pixels: mesh.size, pixels_per_point: 1.0 };
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    // No mesh holds a callback, so there are no further command buffers.
    renderer.update_buffers(&gpu.device, &gpu.queue, &mut encoder, &mesh.primitives, &screen);
    let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("overlay"),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view: target,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load: wgpu::LoadOp::Load, store: wgpu::StoreOp::Store },
        })],
        depth_stencil_attachment: None,
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    });
    renderer.render(&mut pass.forget_lifetime(), &mesh.primitives, &screen);
    gpu.queue.submit([encoder.finish()]);
}
