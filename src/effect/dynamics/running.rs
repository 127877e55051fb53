//! The effect in a world: its bodies, and what they add to a frame.

use super::moving::{Motion, Moving, Now};
use super::settings::{NAME, Settings};
use super::tables::Tables;
use crate::base::failure::Failure;
use crate::deform::{Contribution, ControlPose, Deformer};
use crate::effect::entry::EffectInput;
use crate::world::running::{Memory, MovedElement, read, written};
use crate::world::{RunningEffect, World};
use nalgebra::UnitQuaternion;

/// The bodies that list the effect.
struct Dynamics {
    bodies: Vec<DynamicBody>,
}

struct DynamicBody {
    b: usize,
    /// Whether each control element is released while no hand holds it.
    free: Vec<bool>,
    moving: Moving,
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
        let moving = moving.map_err(|m| Failure::request(anyhow::anyhow!("body.{name}: {m}")))?;
        bodies.push(DynamicBody { b, free, moving });
    }
    Ok(Some(Box::new(Dynamics { bodies })))
}

impl DynamicBody {
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

    fn solve(&mut self, world: &World, contributions: &mut [Contribution]) {
        for body in &mut self.bodies {
            body.step(world);
            let deformer = &world.bodies[body.b].deformer;
            let columns = deformer.coefficients_of(NAME);
            body.moving.add(columns, &turn(deformer), &mut contributions[body.b]);
        }
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
