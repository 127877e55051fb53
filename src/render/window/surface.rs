//! A window's swap chain: configured when it opens, again when its size changes or the system says so.

use super::super::error::RenderError;
use super::super::gpu::Gpu;
use super::super::offscreen::Readback;
use super::super::target::check_size;
use super::super::tiles::Canvas;
use super::monitor::described;
use super::spec::Monitor;
use image::RgbaImage;
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::{CurrentSurfaceTexture, TextureFormat};
use winit::window::Window;

/// Time between two questions to the window system, each of which takes a round trip.
const OLD_PLACE: Duration = Duration::from_millis(50);

pub(super) struct WindowSurface {
    pub(super) size: [u32; 2],
    /// The window's top left pixel on the desktop; the origin where the window system does not report it.
    pub(super) place: [i32; 2],
    /// Monitors of the desktop; none where the window system does not report the window's place.
    pub(super) monitors: Vec<Monitor>,
    asked: Instant,
    pub(super) canvas: Canvas,
    /// The image that it will show next, once it is there to be drawn into. Dropped before its surface: a swap chain whose image
    /// is still held cannot be destroyed, and panics.
    pub(super) frame: Option<SurfaceFrame>,
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

/// An sRGB format that all windows can present, from what each offers.
/// Errors: The window that has none in common with those before it, and a sentence about it; window 0 where there are
/// none.
pub(super) fn common_format(
    offered: &[Vec<TextureFormat>],
    device: &str,
) -> Result<TextureFormat, (usize, String)> {
    let mut common: Vec<TextureFormat> =
        offered.first().into_iter().flatten().copied().filter(TextureFormat::is_srgb).collect();
    for (index, offered) in offered.iter().enumerate() {
        let before = std::mem::take(&mut common);
        common = before.iter().copied().filter(|format| offered.contains(format)).collect();
        if common.is_empty() {
            let reason = if before.is_empty() {
                format!("{device} cannot present sRGB pictures on it (it offers {offered:?})")
            } else {
                format!(
                    "{device} presents {before:?} on the windows before, {offered:?} on this one. Give all monitors \
                     one colour depth, or run a process for each"
                )
            };
            return Err((index, reason));
        }
    }
    common.first().copied().ok_or((0, "there is no window".to_owned()))
}

impl WindowSurface {
    pub(super) fn new(
        window: Arc<Window>,
        surface: wgpu::Surface<'static>,
        format: TextureFormat,
        vsync: bool,
    ) -> Self {
        let size: [u32; 2] = window.inner_size().into();
        let config = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            format,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width: size[0],
            height: size[1],
            // Never torn, not even when a frame is late, as AutoVsync would: a torn picture has two eyes' heads in it.
            present_mode: if vsync { wgpu::PresentMode::Fifo } else { wgpu::PresentMode::AutoNoVsync },
            // One frame ahead: latency counts more than throughput when a hand moves the picture.
            desired_maximum_frame_latency: 1,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: vec![],
        };
        let canvas = Canvas::default();
        let (place, asked) = ([0, 0], Instant::now());
        let (is_current, frame) = (false, None);
        let monitors = Vec::new();
        let mut surface =
            Self { size, place, monitors, asked, canvas, frame, surface, config, is_current, window };
        surface.find_place();
        surface
    }

    /// Asks the window system where the window stands.
    pub(super) fn find_place(&mut self) {
        (self.place, self.monitors) = match self.window.inner_position() {
            Ok(place) => (place.into(), self.window.available_monitors().map(|m| described(&m)).collect()),
            Err(_) => ([0, 0], Vec::new()),
        };
        self.asked = Instant::now();
    }

    /// Asks again where the last answer is old: without a window manager nobody says that a window was moved.
    pub(super) fn follow(&mut self) {
        if self.asked.elapsed() > OLD_PLACE {
            self.find_place();
        }
    }

    /// Whether that is another size than it had.
    pub(super) fn resize(&mut self, size: [u32; 2]) -> bool {
        let is_new = size != self.size;
        if is_new {
            self.size = size;
            self.is_current = false;
            self.frame = None;
        }
        is_new
    }

    /// Gets the next image to draw into, where there is none yet; without one this frame has to go without this window.
    pub(super) fn acquire(&mut self, gpu: &Gpu) -> Result<(), RenderError> {
        if self.frame.is_some() || self.size.contains(&0) {
            return Ok(());
        }
        if !self.is_current {
            self.configure(gpu)?;
        }
        let texture = match self.surface.get_current_texture() {
            // Some drivers call every image suboptimal. Where the window's size is the reason, it will be told.
            CurrentSurfaceTexture::Success(texture) | CurrentSurfaceTexture::Suboptimal(texture) => texture,
            CurrentSurfaceTexture::Timeout | CurrentSurfaceTexture::Occluded => return Ok(()),
            CurrentSurfaceTexture::Outdated => {
                self.is_current = false;
                return Ok(());
            }
            CurrentSurfaceTexture::Lost => {
                self.is_current = false;
                self.surface = gpu
                    .instance
                    .create_surface(self.window.clone())
                    .map_err(|error| RenderError::Device(format!("a lost window surface: {error}")))?;
                return Ok(());
            }
            CurrentSurfaceTexture::Validation => return gpu.check(),
        };
        let view = texture.texture.create_view(&wgpu::TextureViewDescriptor::default());
        self.frame = Some(SurfaceFrame { texture, view });
        Ok(())
    }

    /// The picture in `frame` as it is shown next. `None` while the swap chain is being made anew, so that it can be read;
    /// a sentence where it cannot be.
    pub(super) fn read(
        &mut self,
        gpu: &Gpu,
        frame: &SurfaceFrame,
    ) -> Result<Option<Result<RgbaImage, String>>, RenderError> {
        let readable = wgpu::TextureUsages::COPY_SRC;
        let size = [frame.texture.texture.width(), frame.texture.texture.height()];
        if frame.texture.texture.usage().contains(readable) {
            let mut image = Readback::new(gpu, size)?.read(gpu, &frame.texture.texture, 0)?;
            if matches!(self.config.format, TextureFormat::Bgra8UnormSrgb | TextureFormat::Bgra8Unorm) {
                image.pixels_mut().for_each(|pixel| pixel.0.swap(0, 2));
            }
            image.pixels_mut().for_each(|pixel| pixel.0[3] = 255);
            return Ok(Some(Ok(image)));
        }
        if !self.surface.get_capabilities(&gpu.adapter).usages.contains(readable) {
            return Ok(Some(Err(format!("{} lets nobody read what a window shows", gpu.adapter_name))));
        }
        self.config.usage |= readable;
        self.is_current = false;
        Ok(None)
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

#[cfg(test)]
mod tests {
    use super::*;
    use TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgba8UnormSrgb};

    #[test]
    fn windows_get_a_format_that_all_can_present() {
        let common = |offered: &[Vec<TextureFormat>]| common_format(offered, "a GPU");
        let two = vec![Bgra8Unorm, Bgra8UnormSrgb, Rgba8UnormSrgb];
        assert_eq!(common(std::slice::from_ref(&two)), Ok(Bgra8UnormSrgb));
        assert_eq!(common(&[two.clone(), vec![Rgba8UnormSrgb]]), Ok(Rgba8UnormSrgb));
        let (window, reason) = common(&[two.clone(), two.clone(), vec![Bgra8Unorm]]).unwrap_err();
        assert!(window == 2 && reason.contains("one colour depth"), "{reason}");
        let (window, reason) = common(&[vec![Bgra8Unorm], two]).unwrap_err();
        assert!(window == 0 && reason.contains("cannot present sRGB"), "{reason}");
        assert_eq!(common(&[]).unwrap_err().0, 0);
    }
}
