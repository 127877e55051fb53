//! Shows finished pictures: in the stage's windows, in memory, or elsewhere.
//!
//! In: for each picture the tiles that it shows ([`ViewSource`](super::view_source::ViewSource)) and what is drawn into them.
//! Out: pictures handed to the display, presented together. A headset's compositor or a render node's link is one more `impl`. A
//! presenter has no loop: whoever uses it calls [`Session::advance`](crate::session::Session::advance) and then
//! [`show`](super::view_source::show), once a frame.

use crate::render::window::{Monitor, PresentTimes, Windows};
use crate::render::{
    COLOR_FORMAT, Canvas, FrameContents, Gpu, Paint, Readable, RenderError, Renderer, Samples, Target, Tile,
    TilePainter,
};
use image::RgbaImage;
use std::time::Duration;

/// Shows pictures.
pub trait Presenter {
    fn gpu(&self) -> &Gpu;

    /// Width and height of each picture, pixels; zero for one that is hidden.
    fn sizes(&self) -> Vec<[u32; 2]>;

    /// Time that the presenter has waited for the display in this frame.
    fn waited(&self) -> Duration {
        Duration::ZERO
    }

    /// Draws all pictures, one entry of `tiles` and `contents` for each, and presents them together; `paint` may draw over each
    /// eye's picture before the two are joined. The call may wait for the device or the display.
    ///
    /// # Errors
    /// If the counts differ, a tile lies outside of its picture, or the device failed.
    fn present(
        &mut self,
        tiles: &[Vec<Tile>],
        contents: &[&FrameContents<'_>],
        paint: Option<Paint<'_>>,
    ) -> Result<PresentTimes, RenderError>;
}

impl Presenter for Windows {
    fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    fn sizes(&self) -> Vec<[u32; 2]> {
        Windows::sizes(self).collect()
    }

    fn waited(&self) -> Duration {
        self.waited
    }

    fn present(
        &mut self,
        tiles: &[Vec<Tile>],
        contents: &[&FrameContents<'_>],
        paint: Option<Paint<'_>>,
    ) -> Result<PresentTimes, RenderError> {
        self.draw(tiles, contents, paint)
    }
}

/// Images in memory, each with its own size.
pub struct Images {
    pub gpu: Gpu,
    pub renderer: Renderer,
    painter: TilePainter,
    images: Vec<(Readable, Canvas)>,
    /// The top left pixel of each image on the desktop. Interlaced stereo depends on it: it decides which eye a pixel line
    /// belongs to.
    pub places: Vec<[i32; 2]>,
    /// Monitors of the desktop, on which interlaced stereo depends as well.
    pub monitors: Vec<Monitor>,
}

impl Images {
    /// Opens a device without a display; add images with [`Images::add`].
    pub fn new(samples: Samples) -> Result<Images, RenderError> {
        let gpu = Gpu::headless()?;
        Ok(Images {
            renderer: Renderer::new(&gpu, COLOR_FORMAT, samples.on(&gpu))?,
            gpu,
            painter: TilePainter::new(COLOR_FORMAT),
            images: Vec::new(),
            places: Vec::new(),
            monitors: Vec::new(),
        })
    }

    /// Adds an image; `place` is its top left pixel on an imagined desktop.
    pub fn add(&mut self, size: [u32; 2], place: [i32; 2]) -> Result<(), RenderError> {
        self.images.push((Readable::new(&self.gpu, size)?, Canvas::default()));
        self.places.push(place);
        Ok(())
    }

    pub fn count(&self) -> usize {
        self.images.len()
    }

    /// All images as they were presented last, and the time that reading them took, s.
    pub fn read(&self) -> Result<(Vec<RgbaImage>, f64), RenderError> {
        let (mut images, mut read_s) = (Vec::new(), 0.0);
        for (image, _) in &self.images {
            let (picture, time) = image.read(&self.gpu)?;
            read_s += time.as_secs_f64();
            images.push(picture);
        }
        Ok((images, read_s))
    }
}

impl Presenter for Images {
    fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    fn sizes(&self) -> Vec<[u32; 2]> {
        self.images.iter().map(|(image, _)| image.size).collect()
    }

    fn present(
        &mut self,
        tiles: &[Vec<Tile>],
        contents: &[&FrameContents<'_>],
        paint: Option<Paint<'_>>,
    ) -> Result<PresentTimes, RenderError> {
        let expected = self.images.len();
        if let Some(found) = [tiles.len(), contents.len()].into_iter().find(|found| *found != expected) {
            return Err(RenderError::WindowCount { found, expected });
        }
        let mut targets: Vec<Target<'_>> = Vec::new();
        for (window, ((image, canvas), place)) in self.images.iter_mut().zip(&self.places).enumerate() {
            targets.push(Target {
                window,
                canvas,
                texture: &image.view,
                size: image.size,
                desktop: *place,
                monitors: &self.monitors,
                tiles: &tiles[window],
                contents: contents[window],
            });
        }
        let encode = self.painter.draw(&self.gpu, &mut self.renderer, &mut targets, paint)?;
        Ok(PresentTimes { encode, present: self.gpu.wait()? })
    }
}
