//! Writing and flat shapes over a finished picture: laid out by egui's painter, drawn without clearing what is there.
//!
//! In comes a closure that paints in pixels (one point is one pixel, the origin at the top left); out go its triangles on
//! a target of any size. It lies on the glass, at zero parallax, so both eyes get the same. Fonts are read when the first
//! mesh is laid out; pipeline and textures are made when the first is drawn. Letters are filtered in the shader and
//! colours are not dithered, so that every device draws the same.

use super::error::RenderError;
use super::gpu::Gpu;
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};

/// Lays meshes out and draws them, all on targets of one format.
pub struct Overlay {
    format: wgpu::TextureFormat,
    context: egui::Context,
    /// Changes of the letters' texture since the last drawing.
    letters: Vec<egui::epaint::ImageDelta>,
    renderer: Option<Renderer>,
}

/// What is written over one picture, to be drawn in the same frame.
pub struct OverlayMesh {
    pub size: [u32; 2],
    primitives: Vec<egui::ClippedPrimitive>,
}

impl Overlay {
    pub fn new(format: wgpu::TextureFormat) -> Self {
        Self { format, context: egui::Context::default(), letters: Vec::new(), renderer: None }
    }

    /// A mesh for pictures of `size` pixels.
    pub fn lay_out(&mut self, size: [u32; 2], mut paint: impl FnMut(&egui::Painter)) -> OverlayMesh {
        let [width, height] = size.map(|side| side as f32);
        let input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, egui::vec2(width, height))),
            ..Default::default()
        };
        let layer = egui::LayerId::background();
        let output = self.context.run_pass(input, |context| paint(&context.layer_painter(layer)));
        self.mesh(size, output)
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

    /// Draws each mesh over what its target holds.
    pub fn draw<'a>(
        &mut self,
        gpu: &Gpu,
        meshes: impl IntoIterator<Item = (&'a wgpu::TextureView, &'a OverlayMesh)>,
    ) -> Result<(), RenderError> {
        let mut meshes = meshes.into_iter().filter(|(_, mesh)| !mesh.primitives.is_empty()).peekable();
        if meshes.peek().is_none() {
            return Ok(());
        }
        let format = self.format;
        let renderer = self
            .renderer
            .get_or_insert_with(|| Renderer::new(&gpu.device, format, RendererOptions::PREDICTABLE));
        for delta in self.letters.drain(..) {
            renderer.update_texture(&gpu.device, &gpu.queue, egui::TextureId::default(), &delta);
        }
        // One submission each, since all share one vertex buffer.
        for (target, mesh) in meshes {
            draw(gpu, renderer, target, mesh);
        }
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
