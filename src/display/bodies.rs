//! The bodies of a world on a graphics device: buffers for each body, uploaded once a frame and drawn for every screen and
//! eye.

use super::device::{self, Choice};
use super::out_of_range::Watch;
use crate::base::notice::notice;
use crate::base::plates::Plate;
use crate::render::{BodyBuffers, BodyInstance, FrameContents, Gpu, RenderError};
use crate::world::{PlacedBody, World};
use std::borrow::Cow;
use std::time::Instant;

/// Lines of the hatching of a body that is bent beyond its model, along the radius of the ball about it.
const HATCH_LINES: f64 = 12.0;

/// The buffers of all bodies of a world.
pub struct GpuBodies {
    buffers: Vec<BodyBuffers>,
    /// Where each body deforms.
    pub choices: Vec<Choice>,
    watches: Vec<Watch>,
    /// Whether each frame is looked at for bodies that are bent too far: in pictures, which are far apart.
    pub looks_at_each: bool,
}

impl GpuBodies {
    /// Each body deforms where it is asked to, or is faster; which is told.
    pub fn new(gpu: &Gpu, world: &mut World, asked: device::Args) -> Result<GpuBodies, RenderError> {
        let watches = vec![Watch::default(); world.bodies.len()];
        let mut bodies =
            GpuBodies { buffers: Vec::new(), choices: Vec::new(), watches, looks_at_each: false };
        for body in &mut world.bodies {
            let (buffers, choice) = device::buffers(gpu, body, asked.deform)?;
            notice!("body.{}: {}", body.deformer.body, choice.describe());
            bodies.buffers.push(buffers);
            bodies.choices.push(choice);
        }
        Ok(bodies)
    }

    /// Where the bodies deform, for the overlay.
    pub fn deformation(&self) -> String {
        device::brief(&self.choices)
    }

    /// Uploads what changed; returns the time it took, s.
    pub fn upload(&mut self, gpu: &Gpu, world: &mut World) -> Result<f64, RenderError> {
        for (watch, body) in self.watches.iter_mut().zip(&mut world.bodies) {
            watch.look(body, self.looks_at_each);
        }
        let started = Instant::now();
        let watched = self.buffers.iter_mut().zip(&self.watches);
        for ((buffers, watch), body) in watched.zip(&mut world.bodies) {
            buffers.hatched_per_m = watch.text.is_some().then(|| (HATCH_LINES / body.ball.1) as f32);
            let moved = std::mem::take(&mut body.moved);
            if moved && buffers.is_deformed_here() {
                device::deform(gpu, buffers, body)?;
            } else if moved {
                buffers.upload(gpu, &body.deformer.drawn_positions(), &body.deformer.normals())?;
            }
            if std::mem::take(&mut body.recolour) {
                buffers.shows_field = body.field.is_some();
                buffers.set_colors(gpu, &body.colours())?;
            }
        }
        Ok(started.elapsed().as_secs_f64())
    }

    /// What is written over the pictures: what the world says, and bodies that are bent further than their models hold.
    pub fn plates<'a>(&self, world: &'a World) -> Cow<'a, [Plate]> {
        let beyond = self.watches.iter().zip(&world.bodies).filter_map(|(watch, body)| watch.plate(body));
        let mut plates = Cow::Borrowed(&world.frame.plates[..]);
        for plate in beyond {
            plates.to_mut().push(plate);
        }
        plates
    }

    /// The bodies at their places.
    pub fn instances(&self, world: &World) -> Vec<BodyInstance<'_>> {
        let matrix = |body: &PlacedBody| body.room_from_surface().to_homogeneous().cast();
        self.buffers
            .iter()
            .zip(&world.bodies)
            .map(|(buffers, body)| BodyInstance { buffers, room_from_body: matrix(body) })
            .collect()
    }
}

/// What is drawn in this frame.
pub fn contents<'a>(world: &'a World, instances: &'a [BodyInstance<'a>]) -> FrameContents<'a> {
    FrameContents {
        bodies: instances,
        styli: &world.frame.styli,
        arrows: &world.frame.arrows,
        grid: world.grid(),
        strips: &world.frame.strips,
        ghosts: &world.frame.ghosts,
        lines: &world.frame.lines,
        balls: &world.frame.balls,
        ..Default::default()
    }
}
