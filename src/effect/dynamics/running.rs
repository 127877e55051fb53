//! The effect in a world: its bodies, and what they add to a frame.

use super::moving::{Motion, Moving, Now, Pressed};
use super::section::SWINGING;
use super::settings::{NAME, Settings};
use super::tables::Tables;
use crate::base::failure::Failure;
use crate::deform::{Contribution, ControlPose, Deformer};
use crate::effect::entry::EffectInput;
use crate::world::inertia::{Coming, Gone, Inertia, NodeForces, StepForces};
use crate::world::running::{Memory, MovedElement, read, written};
use crate::world::vibration::{Vibration, VibrationModes};
use crate::world::{BodyFrame, Frame, RunningEffect, World};
use nalgebra::{DMatrix, UnitQuaternion, Vector3};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// Frames in a row in which an element stops before its user is warned.
const TOLD: u32 = 6;

/// The bodies that list the effect.
struct Dynamics {
    bodies: Vec<DynamicBody>,
}

struct DynamicBody {
    b: usize,
    /// Whether each control element is released while no hand holds it.
    free: Vec<bool>,
    moving: Moving,
    /// Whether another effect has begun this frame.
    is_begun: bool,
    /// The modes of its surface for each set of released elements, if another effect makes them heard.
    heard: Option<BTreeMap<Vec<bool>, Arc<VibrationModes>>>,
    /// Place of the modes' columns among those of effects.
    columns: Range<usize>,
    /// N of nodes that forces press.
    shapes: RefCell<BTreeMap<u32, Arc<DMatrix<f64>>>>,
}

pub fn attach(
    listed: &EffectInput<'_>,
    world: &mut World,
) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let mut bodies = Vec::new();
    for &(b, name) in &listed.bodies {
        let settings = Settings::of(&listed.scene.bodies[name]);
        let invalid = |message| listed.scene.invalid(&format!("body.{name}.effect.{NAME}.free"), message);
        let free = settings.free_of(&listed.scene.body[name]).map_err(|m| Failure::request(invalid(m)))?;
        let deformer = &mut world.bodies[b].deformer;
        deformer.feel();
        let tables = Tables::read(listed.file, name)?;
        let moving = Moving::new(tables, settings.damping(), deformer, free.contains(&true));
        let mut moving = moving.map_err(|m| Failure::request(anyhow::anyhow!("body.{name}: {m}")))?;
        let columns = deformer.coefficients_of(NAME);
        let is_heard = listed.scene.bodies[name].entries().any(|effect| effect.is_heard);
        moving.is_heard = is_heard;
        let heard = is_heard.then(BTreeMap::new);
        let shapes = RefCell::default();
        bodies.push(DynamicBody { b, free, moving, is_begun: false, heard, columns, shapes });
    }
    Ok(Some(Box::new(Dynamics { bodies })))
}

impl DynamicBody {
    fn shapes(&self, deformer: &Deformer, node: u32) -> Arc<DMatrix<f64>> {
        let first = deformer.first_of_effects() + self.columns.start;
        let make = || Arc::new(self.moving.shapes_at(deformer, first, node));
        self.shapes.borrow_mut().entry(node).or_insert_with(make).clone()
    }

    /// The vibration in the frame, if it is to be heard.
    fn vibration(&mut self, deformer: &Deformer) -> Option<Arc<Vibration>> {
        let (moving, known) = (&self.moving, self.heard.as_mut()?);
        let system = moving.system.as_ref().filter(|_| !moving.vibration.is_empty())?;
        let first = deformer.first_of_effects() + self.columns.start;
        let make = || Arc::new(moving.vibration_modes(system, deformer, first));
        let modes = known.entry(system.released.clone()).or_insert_with(make).clone();
        Some(Arc::new(Vibration { modes, steps: moving.vibration.clone() }))
    }

    /// A warning for each released element that has stopped though forces would move it.
    fn standstill(&self, world: &World) -> Vec<String> {
        let deformer = &world.bodies[self.b].deformer;
        let model = deformer.entry.name;
        let others = SWINGING.iter().map(|entry| entry.name).filter(|name| *name != model);
        let others: Vec<String> = others.map(|name| format!("\"{name}\"")).collect();
        let warning = |e: usize| {
            format!(
                "body.{}.control.{}: stopped in mid-swing for {TOLD} frames: every motion that model \"{model}\" finds from there needs \
                 more energy than the body has. Move it by hand and let it go elsewhere; if it stops again, write model = {}",
                deformer.body,
                deformer.controls[e].name,
                others.join(" or ")
            )
        };
        let is_told = self.moving.motion.stopped == TOLD;
        let is_free = |e: &usize| is_told && self.free[*e] && !world.is_carried(self.b, *e);
        (0..self.free.len()).filter(is_free).map(warning).collect()
    }

    fn step(&mut self, world: &World) {
        let fields = &world.fields.bodies[self.b];
        let poses: Vec<ControlPose> = fields.poses.iter().map(|pose| *world.graph.get(*pose)).collect();
        let is_held = |c: usize| !self.free[c] || world.is_carried(self.b, c);
        let held: Vec<bool> = (0..poses.len()).map(is_held).collect();
        let deformer = &world.bodies[self.b].deformer;
        self.moving.step(&Now {
            time_s: *world.graph.get(world.fields.time),
            poses: &poses,
            held: &held,
            deformer,
        });
    }
}

impl Inertia for DynamicBody {
    fn body(&self) -> usize {
        self.b
    }

    fn begin(&mut self, coming: Coming, body: &Deformer) -> Option<f64> {
        self.is_begun = true;
        let held: Vec<bool> =
            coming.carried.iter().zip(&self.free).map(|(held, free)| *held || !free).collect();
        self.moving.set_out(coming.time_s, (coming.poses, &held), body)
    }

    fn moves(&self, control: usize) -> bool {
        self.moving.releases(control)
    }

    fn columns(&self) -> Range<usize> {
        self.columns.clone()
    }

    fn now(&self) -> Gone {
        let motion = &self.moving.motion;
        Gone { poses: motion.poses().to_vec(), amplitudes: self.moving.amplitudes(motion) }
    }

    fn rows(&self, deformer: &Deformer, node: u32) -> Vec<Vector3<f64>> {
        self.moving.rows(&self.shapes(deformer, node))
    }

    fn weights(&self, share: f64, part: f64) -> Vec<f64> {
        self.moving.weights(share, part)
    }

    fn go(
        &mut self,
        share: f64,
        turn: &UnitQuaternion<f64>,
        deformer: &Deformer,
        forces: StepForces<'_>,
    ) -> Gone {
        let acting = |forces: &NodeForces| {
            let shapes: Vec<_> =
                forces.iter().map(|(node, force)| (self.shapes(deformer, *node), *force)).collect();
            self.moving.pressing(turn, shapes.iter().map(|(shapes, force)| (&**shapes, *force)))
        };
        let pressed = Pressed { mean: acting(forces.mean), end: acting(forces.end) };
        let motion = self.moving.tried(share, turn, &pressed).clone();
        Gone { poses: motion.poses().to_vec(), amplitudes: self.moving.amplitudes(&motion) }
    }

    fn keep(&mut self) {
        self.moving.keep();
    }
}

/// The axes of the model's displacements in the last frame.
fn turn(deformer: &Deformer) -> UnitQuaternion<f64> {
    deformer.state.body_from_surface().rotation
}

impl RunningEffect for Dynamics {
    fn name(&self) -> &'static str {
        NAME
    }

    fn acts(&self) -> bool {
        true
    }

    fn solve(
        &mut self,
        world: &World,
        contributions: &mut [Contribution],
        _inertias: &mut [&mut dyn Inertia],
    ) {
        for body in &mut self.bodies {
            match std::mem::take(&mut body.is_begun) {
                true => body.moving.arrive(),
                false => body.step(world),
            }
            let deformer = &world.bodies[body.b].deformer;
            body.moving.add(body.columns.clone(), &turn(deformer), &mut contributions[body.b]);
        }
    }

    fn inertias(&mut self) -> Vec<&mut dyn Inertia> {
        self.bodies.iter_mut().map(|body| body as &mut dyn Inertia).collect()
    }

    fn surface(&mut self, world: &World, bodies: &mut [BodyFrame]) {
        for body in &mut self.bodies {
            bodies[body.b].vibration = body.vibration(&world.bodies[body.b].deformer);
        }
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        frame.warnings.extend(self.bodies.iter().flat_map(|body| body.standstill(world)));
    }

    fn moved(&self) -> Vec<MovedElement> {
        let of = |body: &DynamicBody| {
            let place = body.b;
            let moved = move |(control, pose): &(usize, ControlPose)| MovedElement {
                body: place,
                control: *control,
                pose: *pose,
            };
            body.moving.moved.iter().map(moved).collect::<Vec<_>>()
        };
        self.bodies.iter().flat_map(of).collect()
    }

    fn memory(&self) -> Option<Memory> {
        written(&self.bodies.iter().map(|body| &body.moving.motion).collect::<Vec<_>>())
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let motions: Vec<Motion> = read(memory)?;
        if motions.len() != self.bodies.len() {
            return Err(format!("it has {} bodies, the scene has {}", motions.len(), self.bodies.len()));
        }
        self.bodies.iter_mut().zip(motions).try_for_each(|(body, motion)| body.moving.set_motion(motion))
    }
}
