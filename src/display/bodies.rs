//! The bodies of a world on a graphics device: buffers for each body, uploaded once a frame and drawn for every screen and
//! eye. A body that is bent further than its model holds is hatched, and has a plate above it.

use super::device;
use super::device::Choice;
use crate::base::diagnostic::{is_verbose, notice};
use crate::base::plates::{Anchor, Plate, Tone};
use crate::render::{BodyBuffers, BodyInstance, Drawable, FrameContents, Gpu, RenderError};
use crate::world::{BodyFrame, PlacedBody, World, out_of_range};
use nalgebra::{Point3, Vector3};
use std::time::Instant;

/// Lines of the hatching of a body that is bent beyond its model, along the radius of the ball about it.
const HATCH_LINES: f64 = 12.0;

/// The buffers of all bodies of a world.
pub struct GpuBodies {
    buffers: Vec<BodyBuffers>,
    /// The place where each body deforms: CPU or graphics device.
    pub choices: Vec<Choice>,
    watches: Vec<Watch>,
    /// State of each body in its buffers.
    uploaded: Vec<UploadedState>,
    /// Whether each frame is looked at for bodies that are bent too far: in pictures, which are far apart.
    pub looks_at_each: bool,
}

/// The state of a body in its buffers.
#[derive(Default)]
struct UploadedState {
    /// Version of the surface's triangles ([`crate::deform::Deformer::topology`]).
    topology: u64,
    /// Version of its positions ([`crate::deform::Deformer::version`]).
    version: Option<u64>,
    colours: Option<BodyFrame>,
}

impl GpuBodies {
    /// Makes the buffers of all bodies. Each body deforms where it is asked to, or is faster, which a note reports.
    pub fn new(gpu: &Gpu, world: &mut World, asked: device::Args) -> Result<GpuBodies, RenderError> {
        let mut bodies = GpuBodies {
            buffers: Vec::new(),
            choices: Vec::new(),
            watches: vec![Watch::default(); world.bodies.len()],
            uploaded: Vec::new(),
            looks_at_each: false,
        };
        for (body, shown) in world.bodies.iter_mut().zip(&world.frame.bodies) {
            let (buffers, choice) = device::buffers(gpu, body, shown, asked.deform)?;
            if is_verbose() {
                notice!("body.{}: {}", body.deformer.body, choice.describe());
            }
            bodies.buffers.push(buffers);
            bodies
                .uploaded
                .push(UploadedState { topology: body.deformer.topology, ..UploadedState::default() });
            bodies.choices.push(choice);
        }
        Ok(bodies)
    }

    /// Words for the overlay about where the bodies deform.
    pub fn deformation(&self) -> String {
        device::brief(&self.choices)
    }

    /// Uploads what changed; returns the time it took, s.
    pub fn upload(&mut self, gpu: &Gpu, world: &World) -> Result<f64, RenderError> {
        let has_moved =
            |uploaded: &UploadedState, body: &PlacedBody| uploaded.version != Some(body.deformer.version);
        for ((watch, uploaded), body) in self.watches.iter_mut().zip(&self.uploaded).zip(&world.bodies) {
            watch.look(body, has_moved(uploaded, body), self.looks_at_each);
        }
        let started = Instant::now();
        let own = self.buffers.iter_mut().zip(&self.watches).zip(&mut self.uploaded);
        for (((buffers, watch), uploaded), (body, shown)) in
            own.zip(world.bodies.iter().zip(&world.frame.bodies))
        {
            if uploaded.topology != body.deformer.topology {
                *buffers = device::remade(gpu, body, shown, buffers.is_deformed_here())?;
                *uploaded = UploadedState { topology: body.deformer.topology, ..UploadedState::default() };
            }
            buffers.hatched_per_m = watch.text.is_some().then(|| (HATCH_LINES / body.assets.ball.1) as f32);
            if has_moved(uploaded, body) {
                if buffers.is_deformed_here() {
                    device::deform(gpu, buffers, body)?;
                } else {
                    buffers.upload(gpu, &body.deformer.drawn_positions(), &body.deformer.normals())?;
                }
                uploaded.version = Some(body.deformer.version);
            }
            if uploaded.colours.as_ref().is_none_or(|colours| !colours.is_drawn_as(shown)) {
                buffers.shows_field = shown.colours.is_some();
                buffers.set_colors(gpu, &body.colours(shown))?;
                uploaded.colours = Some(shown.clone());
            }
        }
        Ok(started.elapsed().as_secs_f64())
    }

    /// Plates over the pictures: those of the world, and warnings about bodies that are bent beyond their models' range.
    pub fn plates(&self, world: &World) -> Vec<Plate> {
        let beyond = self.watches.iter().zip(&world.bodies).filter_map(|(watch, body)| watch.plate(body));
        world.frame.all(Drawable::plate).cloned().chain(beyond).collect()
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

/// Contents of this frame.
pub fn contents<'a>(world: &'a World, instances: &'a [BodyInstance<'a>]) -> FrameContents<'a> {
    FrameContents {
        bodies: instances,
        drawables: [&world.frame.drawables, &[]],
        grid: world.grid(),
        ..Default::default()
    }
}

/// A moving body is looked at in one of this number of frames, in windows.
const EVERY: u8 = 4;

/// The state of one body's warning.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    /// Frames in which it moved since it was looked at.
    unseen: u8,
    /// The warning.
    pub text: Option<String>,
}

impl Watch {
    /// Looks at a body that may have moved: at each move, or at every fourth and after the last.
    pub fn look(&mut self, body: &PlacedBody, has_moved: bool, at_each: bool) {
        self.unseen = self.unseen.saturating_add(u8::from(has_moved));
        let is_due = self.unseen > 0 && (at_each || !has_moved || self.unseen >= EVERY);
        if is_due {
            self.unseen = 0;
            self.text = out_of_range(body);
        }
    }

    /// The plate above the highest control element.
    pub fn plate(&self, body: &PlacedBody) -> Option<Plate> {
        let text = self.text.clone()?;
        let positions = body.deformer.kept_positions();
        let room_from_surface = body.room_from_surface();
        let place = |node: u32| {
            let position = Vector3::from(*positions.get(node as usize)?).cast::<f64>();
            Some(room_from_surface * Point3::from(position))
                .filter(|place| place.iter().all(|x| x.is_finite()))
        };
        let places = body.pickable().into_iter().filter_map(place);
        let (low, high) = places.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
        let middle = nalgebra::center(&low, &high);
        let size_m = 2.0 * body.assets.ball.1 * body.room_from_body.scaling();
        let place = Point3::new(middle.x, high.y + 0.08 * size_m, middle.z);
        let line = vec![(format!("{}: {text}", body.deformer.body), Tone::Bad)];
        Some(Plate { anchor: Anchor::Place(place.into()), lines: vec![line], plot: None, legend: None })
    }
}
