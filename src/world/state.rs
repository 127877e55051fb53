//! All that changes from frame to frame, as plain data.
//!
//! In: a world between two frames. Out: its [`State`], from which a world of the same scene and stage goes on bit by bit as this one
//! does: the same frames from the same trackers' states and commands. Recordings begin with one.
//!
//! [`World::state_hash`] is the state as a hash in hexadecimal digits, by which a replay is compared with its recording.
//! [`Input`] is all that comes into a world from outside in one frame.

use super::body::PlacedBody;
use super::body_memory::BodyMemory;
use super::edit_state::EditState;
use super::flow::MOST_STYLI;
use super::frame::Frame;
use super::running::{Memory, RunningEffect, World};
use crate::field::FieldState;
use crate::interact::Action;
use crate::track::TrackerState;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// All that changes from frame to frame.
///
/// Not here, because it follows from the state: positions, normals, factors, the [`Frame`]. Not here, because it comes in as
/// [`Input`]: trackers, script, devices. Background work under way is forgotten.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Time since the start of the session, s.
    #[serde(with = "crate::field::numbers")]
    pub clock_s: f64,
    /// Number of styli that have fields.
    pub styli: usize,
    /// Head, styli, hands, poses, loads, places, coefficients, and what they were in the frame before.
    pub fields: Vec<FieldState>,
    pub edit: EditState,
    pub bodies: Vec<BodyMemory>,
    /// Number of times that the field shown in colours was switched.
    pub field_changes: usize,
    /// Warnings that were given already, with their times, s.
    pub warnings: Vec<(f64, String)>,
    /// Keys of the black screens of which a warning was given already.
    pub told: BTreeSet<String>,
    /// The memory of each effect, by its name.
    pub effects: BTreeMap<String, Memory>,
}

impl World {
    /// The state between two frames.
    pub fn state(&self) -> serde_json::Result<State> {
        Ok(State {
            clock_s: self.clock_s,
            styli: self.styli_count(),
            fields: self.graph.states()?,
            edit: self.edit.clone(),
            bodies: self.bodies.iter().map(PlacedBody::memory).collect(),
            field_changes: self.field_changes,
            warnings: self.warnings.clone(),
            told: self.told.clone(),
            effects: self.memories(|_| true),
        })
    }

    /// Goes on from the state of a world of the same scene and stage. The error names what does not fit; the world is then not to
    /// be used.
    pub fn set_state(&mut self, state: &State) -> Result<(), String> {
        let (found, expected) = (state.bodies.len(), self.bodies.len());
        if found != expected {
            return Err(format!("it has {found} bodies, the scene has {expected}"));
        }
        if state.styli > MOST_STYLI {
            return Err(format!("it has {} styli, at most {MOST_STYLI} are followed", state.styli));
        }
        state.edit.suits(self.bodies.len(), self.fields.targets.len())?;
        self.have_styli(state.styli);
        self.graph.set_states(&state.fields, 1).map_err(|error| error.to_string())?;
        if let Some((name, error)) = self.set_memories(&state.effects).pop_first() {
            return Err(format!("the effect {name}: {error}"));
        }
        for (body, memory) in self.bodies.iter_mut().zip(&state.bodies) {
            body.set_memory(memory)?;
        }
        self.check_points(&state.edit)?;
        self.room_from_head = self.graph.get(self.fields.head).0;
        self.clock_s = state.clock_s;
        self.edit = state.edit.clone();
        self.field_changes = state.field_changes;
        self.warnings = state.warnings.clone();
        self.told = state.told.clone();
        self.frame = Frame::at_rest(&self.assets);
        self.colour();
        Ok(())
    }

    /// Fails where the ruler or a touch is at a point of a surface that is not there.
    fn check_points(&self, edit: &EditState) -> Result<(), String> {
        let is_there = |body: usize, corners: &[u32; 3]| {
            let nodes = self.bodies.get(body).map_or(0, |body| body.deformer.node_count());
            corners.iter().all(|corner| (*corner as usize) < nodes)
        };
        if !edit.ruler.ends.iter().all(|end| is_there(end.body, &end.corners)) {
            return Err("its ruler lies on a surface that is not there".into());
        }
        let touches = self.fields.touch.as_ref().map(|touch| self.graph.get(touch.touches));
        let mut points = touches.into_iter().flat_map(|touches| touches.all().chain(touches.coming()));
        if !points.all(|touch| is_there(touch.body, &touch.nodes)) {
            return Err("it touches a surface that is not there".into());
        }
        Ok(())
    }

    /// The memories of some of the effects, by their names.
    pub(super) fn memories(&self, of: fn(&dyn RunningEffect) -> bool) -> BTreeMap<String, Memory> {
        let effects = self.effects.iter().filter(|effect| of(effect.as_ref()));
        effects.filter_map(|effect| Some((effect.name().to_owned(), effect.memory()?))).collect()
    }

    /// Gives the effects their memories, one after the other, and bodies what these remake of them. Returns why an effect, by its
    /// name, cannot go on from its memory; it is then as it was when it joined.
    pub(super) fn set_memories(&mut self, memories: &BTreeMap<String, Memory>) -> BTreeMap<String, String> {
        let mut effects = std::mem::take(&mut self.effects);
        let mut refused = BTreeMap::new();
        for at in 0..effects.len() {
            let name = effects[at].name();
            if let Some(Err(error)) = memories.get(name).map(|memory| effects[at].set_memory(memory)) {
                effects[at].clear();
                // Of some of the bodies it may have taken the memory already.
                let first = self.first_memories.get(name).map(|first| effects[at].set_memory(first));
                let also = first.and_then(Result::err).map_or_else(String::new, |also| format!("; {also}"));
                refused.insert(name.to_owned(), error + &also);
            }
            self.remake(&mut effects, at);
        }
        self.effects = effects;
        refused
    }
}

impl World {
    /// blake3 over the bits of all that a frame makes: the head's pose, and per body its place, control poses,
    /// coefficients, and the blake3 of its deformed positions, which is only computed anew where they changed. It is the
    /// same for the same session, whatever the number of threads.
    pub fn state_hash(&mut self) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut numbers = |numbers: &mut dyn Iterator<Item = &f64>| {
            for number in numbers {
                hasher.update(&number.to_bits().to_le_bytes());
            }
        };
        let head = &self.room_from_head;
        numbers(&mut head.translation.vector.iter().chain(head.rotation.coords.iter()));
        for body in &self.bodies {
            let place = &body.room_from_body;
            let rigid = &place.isometry;
            numbers(&mut rigid.translation.vector.iter().chain(rigid.rotation.coords.iter()));
            numbers(&mut std::iter::once(&place.scaling()));
            for pose in &body.deformer.poses {
                numbers(&mut pose.translation.iter().chain(pose.matrix.iter()));
            }
            let made = &body.deformer.state;
            numbers(&mut made.coefficients.iter());
            for rigid in &made.parts {
                numbers(&mut rigid.translation.vector.iter().chain(rigid.rotation.coords.iter()));
            }
        }
        for body in &mut self.bodies {
            let version = body.deformer.version;
            let hash = match body.positions_hash {
                Some((of, hash)) if of == version => hash,
                _ => blake3::hash(bytemuck::cast_slice(body.deformer.positions().as_ref())),
            };
            body.positions_hash = Some((version, hash));
            hasher.update(hash.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }
}

/// The input of a frame: all that comes from outside, from trackers, mouse or script, keys and panels, and the threads that
/// compute in the background. It is recorded as it is: the same state and the same inputs give the same frames, bit by bit.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Time since the start of the session, s; a script's own time ([`TrackerState::time_s`]) begins anew with every round.
    pub clock_s: f64,
    /// Commands of keys and panels, and what the session does for a script: its loads, and let go or reset at its end or new
    /// round. They are carried out in this order before the styli move.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actions: Vec<Action>,
    /// The bodies for which the background has a new state ([`World::arrivals`](super::World::arrivals)).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub arrivals: Vec<usize>,
    /// Warnings of the session, such as that a script's press grabs nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Head and styli.
    pub trackers: TrackerState,
}

impl From<TrackerState> for Input {
    /// Head and styli alone, at the trackers' time.
    fn from(trackers: TrackerState) -> Input {
        Input { clock_s: trackers.time_s, trackers, ..Input::default() }
    }
}
