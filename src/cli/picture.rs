//! A world on a graphics device: buffers per body, uploaded once a frame, drawn for every screen and eye.

use super::world::World;
use crate::render::{
    BodyBuffers, BodyInstance, COLOR_FORMAT, FrameContents, Gpu, Offscreen, RenderError, Renderer, Viewport,
};
use crate::stage::Eye;
use image::RgbaImage;
use std::time::Instant;

/// The buffers of all bodies of a world.
pub struct Bodies {
    buffers: Vec<BodyBuffers>,
}

impl Bodies {
    pub fn new(gpu: &Gpu, world: &World) -> Result<Bodies, RenderError> {
        let make = |body: &super::world::PlacedBody| {
            BodyBuffers::new(gpu, body.deformer.triangles(), &body.colours())
        };
        Ok(Bodies { buffers: world.bodies.iter().map(make).collect::<Result<_, _>>()? })
    }

    /// Uploads what changed; returns the time it took, s.
    pub fn upload(&mut self, gpu: &Gpu, world: &mut World) -> Result<f64, RenderError> {
        let started = Instant::now();
        for (buffers, body) in self.buffers.iter_mut().zip(&mut world.bodies) {
            if std::mem::take(&mut body.moved) {
                buffers.upload(gpu, &body.deformer.positions, &body.deformer.normals)?;
            }
            if std::mem::take(&mut body.recolour) {
                buffers.set_colors(gpu, &body.colours())?;
            }
        }
        Ok(started.elapsed().as_secs_f64())
    }

    /// The bodies at their places.
    pub fn instances(&self, world: &World) -> Vec<BodyInstance<'_>> {
        let matrix = |body: &super::world::PlacedBody| body.room_from_surface().to_homogeneous().cast();
        self.buffers
            .iter()
            .zip(&world.bodies)
            .map(|(buffers, body)| BodyInstance { buffers, room_from_body: matrix(body) })
            .collect()
    }
}

/// What is drawn in this frame.
pub fn contents<'a>(world: &'a World, instances: &'a [BodyInstance<'a>]) -> FrameContents<'a> {
    FrameContents { bodies: instances, styli: &world.styli, grid: world.grid(), ..Default::default() }
}

/// How the pictures of one screen are laid out offscreen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Layout {
    /// One picture per screen and eye
    Eyes,
    /// One picture per screen, left eye in its left half
    SideBySide,
}

/// Offscreen targets for every picture of a stage.
pub struct Targets {
    pub gpu: Gpu,
    renderer: Renderer,
    bodies: Bodies,
    pictures: Vec<Target>,
}

struct Target {
    screen: usize,
    eyes: Vec<Eye>,
    name: String,
    offscreen: Offscreen,
}

/// A picture and the screen and eye it belongs to.
pub type NamedImage<'a> = (&'a str, RgbaImage);

/// Time of the drawing of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawTimes {
    pub upload_s: f64,
    pub encode_s: f64,
    pub draw_s: f64,
}

impl Targets {
    /// Targets of `scale` times the screens' own pixels.
    pub fn new(world: &World, layout: Layout, samples: u32, scale: f64) -> Result<Targets, RenderError> {
        let gpu = Gpu::headless()?;
        let renderer = Renderer::new(&gpu, COLOR_FORMAT, samples)?;
        let bodies = Bodies::new(&gpu, world)?;
        let mut pictures = Vec::new();
        for (screen, shape) in world.stage.screens.iter().enumerate() {
            let [width, height] =
                shape.pixels.map(|pixels| ((f64::from(pixels) * scale).round() as u32).max(1));
            let eyes = world.stage.eyes();
            let groups: Vec<Vec<Eye>> = match layout {
                Layout::Eyes => eyes.iter().map(|eye| vec![*eye]).collect(),
                Layout::SideBySide => vec![eyes.to_vec()],
            };
            for eyes in groups {
                let names: Vec<&str> = eyes.iter().map(|eye| eye.name()).collect();
                pictures.push(Target {
                    screen,
                    name: format!("{}-{}", shape.name, names.join("-")),
                    offscreen: Offscreen::new(&gpu, &renderer, [width * eyes.len() as u32, height])?,
                    eyes,
                });
            }
        }
        Ok(Targets { gpu, renderer, bodies, pictures })
    }

    /// Draws the world into all targets with one upload and one submission, and waits for the device.
    pub fn draw(&mut self, world: &mut World) -> Result<DrawTimes, RenderError> {
        let upload_s = self.bodies.upload(&self.gpu, world)?;
        let viewports: Vec<Vec<Viewport>> = self
            .pictures
            .iter()
            .map(|target| {
                let size = &target.offscreen.attachments;
                let width = size.width / target.eyes.len() as u32;
                let at = |(i, eye): (usize, &Eye)| Viewport {
                    rect: [i as u32 * width, 0, width, size.height],
                    view: world.view(target.screen, *eye),
                };
                target.eyes.iter().enumerate().map(at).collect()
            })
            .collect();
        let pictures: Vec<_> = self
            .pictures
            .iter()
            .zip(&viewports)
            .map(|(t, viewports)| t.offscreen.picture(viewports))
            .collect();
        let instances = self.bodies.instances(world);
        let encode_s = self.renderer.draw(&self.gpu, &pictures, &contents(world, &instances))?.as_secs_f64();
        let draw_s = self.gpu.wait()?.as_secs_f64();
        Ok(DrawTimes { upload_s, encode_s, draw_s })
    }

    /// Reads all pictures back, named by screen and eye; and the time it took, s.
    pub fn read(&self) -> Result<(Vec<NamedImage<'_>>, f64), RenderError> {
        let mut read_s = 0.0;
        let mut images = Vec::new();
        for target in &self.pictures {
            let (image, time) = target.offscreen.read(&self.gpu)?;
            read_s += time.as_secs_f64();
            images.push((target.name.as_str(), image));
        }
        Ok((images, read_s))
    }
}
