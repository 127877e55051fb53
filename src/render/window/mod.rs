//! Windows of one process on one device, one per screen or pair of eyes.
//!
//! In come window sizes and places and an application; out go its pictures, drawn by the same [`Renderer`] as offscreen
//! ones and presented together after all were drawn, and the user's input in neutral terms ([`Input`]).

mod display;
mod event_loop;
mod input;
mod monitor;
pub(super) mod spec;
mod surface;

pub use display::find_display;
pub use input::{Button, Input, Key};
pub use monitor::monitors;
pub use spec::{Monitor, MonitorChoice, WindowSpec};

use super::error::RenderError;
use super::frame::FrameContents;
use super::gpu::Gpu;
use super::overlay::{Overlay, OverlayMesh};
use super::renderer::Renderer;
use super::target::Samples;
use super::tiles::{Paint, Target, Tile, TilePainter};
use crate::base::text::one_line;
use event_loop::{event_loop, no_display};
use image::RgbaImage;
use std::sync::Arc;
use std::time::{Duration, Instant};
use surface::WindowSurface;
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, ControlFlow};
use winit::window::{Fullscreen, Window, WindowId};

/// Time to sleep when no window can be drawn: all are minimised or hidden.
const IDLE: Duration = Duration::from_millis(20);

/// Options by which all windows draw and present.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowOptions {
    pub samples: Samples,
    /// Wait for the display's refresh; false presents at once, for benchmarks.
    pub vsync: bool,
}

/// Whether the windows stay open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    Continue,
    Quit,
}

/// The error that an application may return.
pub type AppError = Box<dyn std::error::Error + Send + Sync>;

/// The application behind the windows. Closing any window quits without asking it.
pub trait WindowApp {
    /// Called once, when the windows are open and the device is there to make buffers on.
    /// Errors: any error ends [`run`] with it.
    fn start(&mut self, gpu: &Gpu) -> Result<(), AppError>;

    fn input(&mut self, input: Input);

    /// Whether Escape quits.
    fn quits(&mut self) -> bool {
        true
    }

    /// Called once per frame, when all input that came while waiting for the displays was passed on: ask trackers,
    /// update, upload, then [`Windows::draw`] once. What is asked here is in the picture that is shown next.
    /// Errors: any error ends [`run`] with it.
    fn frame(&mut self, windows: &mut Windows) -> Result<Flow, AppError>;
}

/// An overlay over the finished picture of a window.
pub struct Glass {
    pub window: usize,
    pub overlay: Overlay,
    pub mesh: OverlayMesh,
}

/// The open windows with their device and renderer.
pub struct Windows {
    pub gpu: Gpu,
    pub renderer: Renderer,
    /// Time for which this frame's images were waited for, before it was begun; with vsync this is the display's time.
    pub waited: Duration,
    /// The overlay over the finished picture of one window, both eyes joined.
    pub glass: Option<Glass>,
    /// The window whose picture is to be read as it is shown next; what became of it stands in `taken` a frame or two later.
    pub wanted: Option<usize>,
    pub taken: Option<Result<RgbaImage, String>>,
    /// Windows to be opened instead of those that are open, once this frame is over.
    pub reopen: Option<Vec<WindowSpec>>,
    /// All windows that can be drawn have their image.
    is_ready: bool,
    painter: TilePainter,
    surfaces: Vec<WindowSurface>,
}

/// Times of a frame's steps on the CPU; with vsync, waiting for the display may be in `present`, too.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PresentTimes {
    pub encode: Duration,
    pub present: Duration,
}

impl Windows {
    /// Width and height of each window in pixels; zero while it is minimised.
    pub fn sizes(&self) -> impl Iterator<Item = [u32; 2]> {
        self.surfaces.iter().map(|surface| surface.size)
    }

    /// Draws into each window's tiles what `contents` has for it, and presents all windows together. A window that cannot be drawn just
    /// now (minimised, covered, being resized) is left out of this frame. `paint` draws over the eyes' pictures.
    /// Errors: a tile outside its window, a number of windows that differs, or a device that failed.
    pub fn draw(
        &mut self,
        tiles: &[Vec<Tile>],
        contents: &[&FrameContents<'_>],
        paint: Option<Paint<'_>>,
    ) -> Result<PresentTimes, RenderError> {
        let expected = self.surfaces.len();
        if let Some(found) = [tiles.len(), contents.len()].into_iter().find(|found| *found != expected) {
            return Err(RenderError::WindowCount { found, expected });
        }
        self.is_ready = false;
        let mut frames = Vec::new();
        for (window, (surface, tiles)) in self.surfaces.iter_mut().zip(tiles).enumerate() {
            if tiles.iter().any(Tile::takes_turns) {
                surface.follow();
            }
            if let Some(frame) = surface.frame.take() {
                frames.push((window, frame, surface, tiles));
            }
        }
        if frames.is_empty() {
            return Ok(PresentTimes::default());
        }
        let mut targets: Vec<_> = frames
            .iter_mut()
            .map(|(window, frame, surface, tiles)| Target {
                window: *window,
                texture: &frame.view,
                size: surface.size,
                desktop: surface.place,
                monitors: &surface.monitors,
                canvas: &mut surface.canvas,
                tiles,
                contents: contents[*window],
            })
            .collect();
        let encode = self.painter.draw(&self.gpu, &mut self.renderer, &mut targets, paint)?;
        drop(targets);
        for (window, frame, surface, _) in &mut frames {
            if let Some(glass) = self.glass.as_mut().filter(|glass| glass.window == *window) {
                // Laid out before the window got another size, it would not fit.
                if glass.mesh.size == surface.size {
                    glass.overlay.draw(&self.gpu, &frame.view, &glass.mesh)?;
                }
            }
            if self.wanted == Some(*window) {
                self.taken = surface.read(&self.gpu, frame)?;
                self.wanted = self.wanted.filter(|_| self.taken.is_none());
            }
        }

        let start = Instant::now();
        for (_, frame, surface, _) in frames {
            surface.window.pre_present_notify();
            self.gpu.queue.present(frame.texture);
        }
        self.gpu.check()?;
        Ok(PresentTimes { encode, present: start.elapsed() })
    }

    /// Waits until every window that can be drawn has an image to draw into.
    fn acquire(&mut self) -> Result<(), RenderError> {
        let start = Instant::now();
        for surface in &mut self.surfaces {
            surface.acquire(&self.gpu)?;
        }
        if self.surfaces.iter().all(|surface| surface.frame.is_none()) {
            std::thread::sleep(IDLE);
        }
        self.waited = start.elapsed();
        self.is_ready = true;
        Ok(())
    }
}

/// Opens the windows and runs `app` until it quits, Escape is pressed or a window is closed.
/// Errors: [`RenderError::NoDisplay`] where windows cannot be opened, any error of the device, and what `app` returns.
pub fn run(
    specs: &[WindowSpec],
    options: WindowOptions,
    app: &mut impl WindowApp,
) -> Result<(), RenderError> {
    let event_loop = event_loop()?;
    event_loop.set_control_flow(ControlFlow::Poll);
    let mut handler = Handler { specs, options, app, windows: None, result: Ok(()) };
    event_loop.run_app(&mut handler).map_err(|error| no_display(error.to_string()))?;
    handler.result
}

struct Handler<'a, A> {
    specs: &'a [WindowSpec],
    options: WindowOptions,
    app: &'a mut A,
    windows: Option<Windows>,
    result: Result<(), RenderError>,
}

impl<A: WindowApp> Handler<'_, A> {
    fn finish(&mut self, event_loop: &ActiveEventLoop, result: Result<(), RenderError>) {
        if self.result.is_ok() {
            self.result = result;
        }
        event_loop.exit();
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<(), RenderError> {
        let opened = create(event_loop, self.specs)?;
        let display = Box::new(event_loop.owned_display_handle());
        let instance =
            wgpu::Instance::new(wgpu::InstanceDescriptor::new_with_display_handle_from_env(display));
        let surfaces = present_on(&instance, &opened, self.specs)?;
        let gpu = Gpu::open(instance, surfaces.first())?;
        let offered: Vec<_> =
            surfaces.iter().map(|surface| surface.get_capabilities(&gpu.adapter).formats).collect();
        let format = surface::common_format(&offered, &gpu.adapter_name).map_err(|(index, reason)| {
            self.specs.get(index).map_or(RenderError::WindowCount { found: 0, expected: 1 }, |spec| {
                window_error(index, spec, reason)
            })
        })?;
        let configured = opened.into_iter().zip(surfaces);
        let surfaces = configured
            .map(|(window, surface)| WindowSurface::new(window, surface, format, self.options.vsync))
            .collect();
        let renderer = Renderer::new(&gpu, format, self.options.samples.on(&gpu))?;
        let painter = TilePainter::new(format);
        self.app.start(&gpu).map_err(RenderError::App)?;
        self.windows = Some(Windows {
            gpu,
            renderer,
            waited: Duration::ZERO,
            glass: None,
            wanted: None,
            taken: None,
            reopen: None,
            is_ready: false,
            painter,
            surfaces,
        });
        Ok(())
    }

    /// Opens other windows on the same device, and closes those that were open.
    fn reopen(&mut self, event_loop: &ActiveEventLoop, specs: &[WindowSpec]) -> Result<(), RenderError> {
        let Some(windows) = &mut self.windows else { return Ok(()) };
        let opened = create(event_loop, specs)?;
        let surfaces = present_on(&windows.gpu.instance, &opened, specs)?;
        let format = windows.renderer.format;
        for (index, surface) in surfaces.iter().enumerate() {
            if !surface.get_capabilities(&windows.gpu.adapter).formats.contains(&format) {
                let reason = format!("{} cannot present {format:?} pictures on it", windows.gpu.adapter_name);
                return Err(window_error(index, &specs[index], reason));
            }
        }
        let of = |(window, surface)| WindowSurface::new(window, surface, format, self.options.vsync);
        windows.surfaces = opened.into_iter().zip(surfaces).map(of).collect();
        (windows.is_ready, windows.glass, windows.wanted) = (false, None, None);
        Ok(())
    }
}

impl<A: WindowApp> ApplicationHandler for Handler<'_, A> {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.windows.is_none()
            && let Err(error) = self.open(event_loop)
        {
            self.finish(event_loop, Err(error));
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        let Some(windows) = &mut self.windows else { return };
        let Some(index) = windows.surfaces.iter().position(|surface| surface.window.id() == id) else {
            return;
        };
        if let WindowEvent::ScaleFactorChanged { mut inner_size_writer, .. } = event {
            // A stage's windows are in pixels: winit would keep their size in points, and multiply their pixels.
            let size = windows.surfaces[index].window.inner_size();
            // Refused only once the event is over.
            let _ = inner_size_writer.request_inner_size(size);
            return;
        }
        if let WindowEvent::Resized(size) = event {
            // The image that it may have has the old size.
            windows.is_ready &= !windows.surfaces[index].resize(size.into());
        }
        if let WindowEvent::Resized(_) | WindowEvent::Moved(_) = event {
            windows.surfaces[index].find_place();
        }
        if let WindowEvent::CloseRequested = event {
            return self.finish(event_loop, Ok(()));
        }
        if let Some(input) = input::neutral(index, windows.surfaces[index].size, &event) {
            if let Input::Key { key: Key::Escape, pressed: true, .. } = input {
                if !self.app.quits() {
                    return;
                }
                return self.finish(event_loop, Ok(()));
            }
            self.app.input(input);
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(windows) = &mut self.windows else { return };
        if event_loop.exiting() {
            return;
        }
        if !windows.is_ready {
            // Before the frame begins, input that came meanwhile is passed on.
            if let Err(error) = windows.acquire() {
                self.finish(event_loop, Err(error));
            }
            return;
        }
        match self.app.frame(windows) {
            Ok(Flow::Continue) => {
                let specs = self.windows.as_mut().and_then(|windows| windows.reopen.take());
                if let Some(Err(error)) = specs.map(|specs| self.reopen(event_loop, &specs)) {
                    self.finish(event_loop, Err(error));
                }
            }
            Ok(Flow::Quit) => self.finish(event_loop, Ok(())),
            Err(error) => self.finish(event_loop, Err(RenderError::App(error))),
        }
    }
}

/// Opens windows at their places.
fn create(event_loop: &ActiveEventLoop, specs: &[WindowSpec]) -> Result<Vec<Arc<Window>>, RenderError> {
    let open = |(index, spec): (usize, &WindowSpec)| {
        let (position, size) =
            monitor::place(event_loop, spec).map_err(|reason| window_error(index, spec, reason))?;
        let window = event_loop
            .create_window(attributes(event_loop, spec, position, size))
            .map_err(|error| window_error(index, spec, error.to_string()))?;
        if let Some([x, y]) = position {
            // Some window managers only heed the place once the window is there.
            window.set_outer_position(PhysicalPosition::new(x, y));
        }
        Ok(Arc::new(window))
    };
    specs.iter().enumerate().map(open).collect()
}

/// The surfaces on which the windows present their pictures.
fn present_on(
    instance: &wgpu::Instance,
    opened: &[Arc<Window>],
    specs: &[WindowSpec],
) -> Result<Vec<wgpu::Surface<'static>>, RenderError> {
    let of = |(index, (window, spec)): (usize, (&Arc<Window>, &WindowSpec))| {
        let surface = instance.create_surface(window.clone());
        surface.map_err(|error| window_error(index, spec, error.to_string()))
    };
    opened.iter().zip(specs).enumerate().map(of).collect()
}

fn window_error(window: usize, spec: &WindowSpec, reason: String) -> RenderError {
    RenderError::Window { window, title: spec.title.clone(), reason }
}

fn attributes(
    event_loop: &ActiveEventLoop,
    spec: &WindowSpec,
    position: Option<[i32; 2]>,
    [width, height]: [u32; 2],
) -> winit::window::WindowAttributes {
    let mut attributes = Window::default_attributes()
        // Names come from files.
        .with_title(one_line(&spec.title))
        .with_inner_size(PhysicalSize::new(width.max(1), height.max(1)))
        .with_decorations(spec.decorated);
    if let Some([x, y]) = position {
        attributes = attributes.with_position(PhysicalPosition::new(x, y));
    }
    #[cfg(target_os = "linux")]
    {
        use winit::platform::x11::WindowAttributesExtX11;
        attributes = attributes.with_override_redirect(spec.unmanaged);
    }
    if spec.fullscreen {
        let monitor = monitor::holding(event_loop, position.unwrap_or_default());
        attributes = attributes.with_fullscreen(Some(Fullscreen::Borderless(monitor)));
    }
    attributes
}
