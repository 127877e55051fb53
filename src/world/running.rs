//! A world, and effects as they take part in it: their phases in a frame, and their memory.
//!
//! | phase of a frame | sees | adds |
//! |---|---|---|
//! | [`input`](RunningEffect::input) | the state of trackers, mouse or script; not in a replay | other poses of styli |
//! | [`solve`](RunningEffect::solve) | hands and new poses of this frame, bodies in the shape of the last one | coefficients, forces at points, energy, slopes, curvatures, other triangles; bodies with another surface ([`remade`](RunningEffect::remade)); poses of elements that no hand holds ([`moved`](RunningEffect::moved)) |
//! | [`surface`](RunningEffect::surface) | bodies in their new shape | colours, scales and errors of forces |
//! | [`show`](RunningEffect::show) | the whole frame | drawables, plates, warnings |
//!
//! In `solve`, the new pose of control element `c` of body `b` is `world.graph.get(world.fields.bodies[b].poses[c])`; the body's
//! `deformer` is still that of the last frame.

use super::assets::Assets;
use super::edit_state::EditState;
use super::flow::{Bodies, Fields};
use super::frame::{BodyFrame, Frame};
use super::inertia::Inertia;
use crate::base::output::Kind;
use crate::base::plates::Words;
use crate::deform::{Contribution, ControlPose};
use crate::field::Graph;
use crate::green::GreenFile;
use crate::track::{Source, TrackerState};
use nalgebra::Isometry3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// An effect's part of the state, as JSON.
pub type Memory = Box<RawValue>;

/// Writes a memory. `None` if it cannot be serialised, which does not happen with plain data.
pub fn written(memory: &impl Serialize) -> Option<Memory> {
    serde_json::value::to_raw_value(memory).ok()
}

/// Reads a memory.
pub fn read<T: DeserializeOwned>(memory: &Memory) -> Result<T, String> {
    serde_json::from_str(memory.get()).map_err(|error| error.to_string())
}

/// The loaded assets, all that changes ([`State`](super::State)), and what follows from both. [`World::step`] moves it on.
pub struct World {
    /// The effects of the scene's bodies. Dropped first, so that force devices stop before anything else is waited for.
    pub effects: Vec<Box<dyn RunningEffect>>,
    /// The loaded data.
    pub assets: Arc<Assets>,
    pub bodies: Bodies,
    pub room_from_head: Isometry3<f64>,
    /// The content of the last frame.
    pub frame: Frame,
    /// Whether each picture is kept, and waits for what is computed in the background.
    pub is_for_pictures: bool,
    /// Number of times that the field shown in colours was switched; only the picture changes.
    pub field_changes: usize,
    /// Warnings, each given once, with its time since the start, s.
    pub warnings: Vec<(f64, String)>,
    /// Time since the start of the session, s; a script's own time begins anew with every round.
    pub(super) clock_s: f64,
    pub graph: Graph<Bodies>,
    pub fields: Fields,
    pub edit: EditState,
    /// The memories with which effects that act on bodies joined, by their names.
    pub(super) first_memories: BTreeMap<String, Memory>,
    /// Keys of the black screens, by screen, eye and reason, of which a warning was given already.
    pub(super) told: BTreeSet<String>,
}

/// What is heard of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heard<'a> {
    pub rate_hz: u32,
    pub channels: usize,
    /// Samples of all channels, one after the other for each moment; 1 is full scale.
    pub samples: &'a [f32],
    /// Pressure at full scale, Pa.
    pub full_scale_pa: f64,
    /// Moments since the start that were turned down, for they were beyond full scale.
    pub limited: u64,
}

/// A control element that an effect moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovedElement {
    pub body: usize,
    pub control: usize,
    pub pose: ControlPose,
}

/// An effect of a world, until it is dropped; a thread that it has started ends with it.
pub trait RunningEffect {
    /// The effect's name in scenes.
    fn name(&self) -> &'static str;

    /// Changes the state of trackers, script or mouse before the world goes through a frame. Not called in a replay: the
    /// recording already contains the changed styli.
    fn input(&mut self, _state: &mut TrackerState) {}

    /// Return true if [`RunningEffect::solve`] does anything. Unless an effect of the scene returns true, `solve` is never
    /// called.
    fn acts(&self) -> bool {
        false
    }

    /// Adds coefficients, energies and forces to the bodies in this frame, whose hands and poses are known. The bodies still have
    /// the shape of the frame before. Effects act one after the other, in the order of the program's list of effects; `inertias` are those
    /// of the effects that come later.
    fn solve(
        &mut self,
        _world: &World,
        _contributions: &mut [Contribution],
        _inertias: &mut [&mut dyn Inertia],
    ) {
    }

    /// The bodies to which it gives inertia.
    fn inertias(&mut self) -> Vec<&mut dyn Inertia> {
        Vec::new()
    }

    /// The bodies that have got another surface and other columns since this was asked last, with the file that has them.
    fn remade(&mut self) -> Vec<(usize, Arc<GreenFile>)> {
        Vec::new()
    }

    /// Sees that the body of this number has been remade: its nodes beyond the first `kept` are others. The error says why it cannot go on
    /// with it.
    fn reshaped(&mut self, _world: &World, _body: usize, _kept: usize) -> Result<(), String> {
        Ok(())
    }

    /// Whether a change has begun since this was asked last that [`RunningEffect::undo`] takes back.
    fn has_begun(&mut self) -> bool {
        false
    }

    /// Takes back the last change that it has told of, or does again what was taken back last. The error says why it cannot.
    fn undo(&mut self) -> Result<(), String> {
        Ok(())
    }

    fn redo(&mut self) -> Result<(), String> {
        Ok(())
    }

    /// The control elements to which [`RunningEffect::solve`] gave another pose. It asks [`World::is_carried`] first: what a hand
    /// holds goes where the hand is.
    fn moved(&self) -> Vec<MovedElement> {
        Vec::new()
    }

    /// Whether the hand that has the stylus of this number holds something that is none of the world's control elements.
    fn holds(&self, _stylus: usize) -> bool {
        false
    }

    /// Sees the bodies in the shape of this frame; colours them, and adds what it knows of their forces.
    fn surface(&mut self, _world: &World, _bodies: &mut [BodyFrame]) {}

    /// Sees the world at the end of a frame, and adds what is drawn.
    fn show(&mut self, _world: &World, _frame: &mut Frame) {}

    /// Sees the world before a picture that is kept: waits for the background, and adds drawables from it.
    fn before_picture(&mut self, _world: &World, _frame: &mut Frame) {}

    /// The memory of the effect: all that it keeps from one frame to the next; `None` if all that it shows follows from the
    /// frame.
    fn memory(&self) -> Option<Memory> {
        None
    }

    /// Goes on from the memory of an effect of the same scene. The error says why it cannot.
    fn set_memory(&mut self, _memory: &Memory) -> Result<(), String> {
        Ok(())
    }

    /// Forgets what was drawn of the past, such as a curve.
    fn clear(&mut self) {}

    /// The table that it has recorded, as CSV.
    fn table(&self) -> Option<(&'static Kind, String)> {
        None
    }

    /// What is heard of the last frame, if this was asked for in the frame before.
    fn heard(&mut self) -> Option<Heard<'_>> {
        None
    }

    /// Hands over the device of this name as a tracker's source; returns it only the first time.
    fn source(&mut self, _tracker: &str) -> Option<Box<dyn Source>> {
        None
    }

    /// Rows of the overlay for each of its devices, as they are now.
    fn readings(&mut self) -> Vec<Vec<Words>> {
        Vec::new()
    }

    /// Lines about the effect for the end of a session.
    fn summary(&mut self) -> String {
        String::new()
    }
}
