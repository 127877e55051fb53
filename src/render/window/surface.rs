//! A window's swap chain: configured when it opens, again when its size changes or the system says so.

use super::super::target::check_size;
use super::super::{Canvas, Gpu, RenderError};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::CurrentSurfaceTexture;
use winit::window::Window;

/// Between two questions to the window system, each of which takes a round trip.
const OLD_PLACE: Duration = Duration::from_millis(50);

pub(super) struct WindowSurface {
    pub(super) size: [u32; 2],
    /// The window's top left pixel on the desktop; the origin where the window system does not tell.
    pub(super) place: [i32; 2],
    asked: Instant,
    pub(super) canvas: Canvas,
    surface: wgpu::Surface<'static>,
    config: wgpu::SurfaceConfiguration,
    /// The swap chain fits the window.
    is_current: bool,
    /// Last, so that the surface goes before its window.
    pub(super) window: Arc<Window>,
}

/// The image that a window will show next.
pub(super) struct SurfaceFrame {
    pub(super) texture: wgpu::SurfaceTexture,
    pub(super) view: wgpu::TextureView,
}

impl WindowSurface {
    /// # Errors
    /// A sentence when the device cannot present on this window, or not in sRGB.
    pub(super) fn new(
        gpu: &Gpu,
        window: Arc<Window>,
        surface: wgpu::Surface<'static>,
        vsync: bool,
    ) -> Result<Self, String> {
        let capabilities = surface.get_capabilities(&gpu.adapter);
        let formats = &capabilities.formats;
        let Some(&format) = formats.iter().find(|format| format.is_srgb()) else {
            return Err(format!(
                "{} cannot present sRGB pictures on this window (it offers {formats:?})",
                gpu.adapter_name
            ));
        };
        let size: [u32; 2] = window.inner_size().into();
        let config = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            format,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width: size[0],
            height: size[1],
            present_mode: if vsync { wgpu::PresentMode::AutoVsync } else { wgpu::PresentMode::AutoNoVsync },
            // One frame ahead: latency counts more than throughput when a hand moves the picture.
            desired_maximum_frame_latency: 1,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: vec![],
        };
        let canvas = Canvas::default();
        let (place, asked) = ([0, 0], Instant::now());
        let mut surface = Self { size, place, asked, canvas, surface, config, is_current: false, window };
        surface.find_place();
        Ok(surface)
    }

    /// Asks the window system where the window stands; Wayland does not tell.
    pub(super) fn find_place(&mut self) {
        self.place = self.window.inner_position().map_or([0, 0], Into::into);
        self.asked = Instant::now();
    }

    /// Asks again where the last answer is old: without a window manager nobody says that a window was moved.
    pub(super) fn follow(&mut self) {
        if self.asked.elapsed() > OLD_PLACE {
            self.find_place();
        }
    }

    pub(super) fn format(&self) -> wgpu::TextureFormat {
        self.config.format
    }

    pub(super) fn resize(&mut self, size: [u32; 2]) {
        if size != self.size {
            self.size = size;
            self.is_current = false;
        }
    }

    /// The next image to draw into, or None when this frame has to go without this window.
    pub(super) fn acquire(&mut self, gpu: &Gpu) -> Result<Option<SurfaceFrame>, RenderError> {
        if self.size.contains(&0) {
            return Ok(None);
        }
        if !self.is_current {
            self.configure(gpu)?;
        }
        let texture = match self.surface.get_current_texture() {
            CurrentSurfaceTexture::Success(texture) => texture,
            CurrentSurfaceTexture::Suboptimal(texture) => {
                // Still good for this frame; the next one starts from a new swap chain.
                self.is_current = false;
                texture
            }
            CurrentSurfaceTexture::Timeout | CurrentSurfaceTexture::Occluded => return Ok(None),
            CurrentSurfaceTexture::Outdated => {
                self.is_current = false;
                return Ok(None);
            }
            CurrentSurfaceTexture::Lost => {
                self.is_current = false;
                self.surface = gpu
                    .instance
                    .create_surface(self.window.clone())
                    .map_err(|error| RenderError::Device(format!("a lost window surface: {error}")))?;
                return Ok(None);
            }
            CurrentSurfaceTexture::Validation => {
                gpu.check()?;
                return Ok(None);
            }
        };
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        Ok(Some(SurfaceFrame { texture, view }))
    }

    fn configure(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        // Before the swap chain would refuse it.
        check_size(gpu, self.size)?;
        [self.config.width, self.config.height] = self.size;
        self.surface.configure(&gpu.device, &self.config);
        gpu.check()?;
        self.is_current = true;
        Ok(())
    }
}
