//! A world, and effects as they take part in it: their phases in a frame, and their memory.
//!
//! | phase of a frame | sees | adds |
//! |---|---|---|
//! | [`input`](RunningEffect::input) | what trackers, mouse or script say; not in a replay | other poses of styli |
//! | [`solve`](RunningEffect::solve) | hands and poses of this frame, bodies as they were shaped last | coefficients, energy, slopes, curvatures, other triangles |
//! | [`surface`](RunningEffect::surface) | bodies in their new shape | colours, and what is known of forces |
//! | [`show`](RunningEffect::show) | the whole frame | what is drawn and written, warnings |

use super::assets::Assets;
use super::edit_state::EditState;
use super::flow::{Bodies, Fields};
use super::frame::{BodyFrame, Frame};
use crate::base::output::Kind;
use crate::base::plates::Words;
use crate::deform::Contribution;
use crate::field::Graph;
use crate::track::{Source, TrackerState};
use nalgebra::Isometry3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;
use std::collections::BTreeSet;
use std::sync::Arc;

/// An effect's part of the state, as JSON.
pub type Memory = Box<RawValue>;

/// Writes a memory. The error of what cannot be written is left to whoever reads it: plain data always can.
pub fn written(memory: &impl Serialize) -> Option<Memory> {
    serde_json::value::to_raw_value(memory).ok()
}

/// Reads a memory.
pub fn read<T: DeserializeOwned>(memory: &Memory) -> Result<T, String> {
    serde_json::from_str(memory.get()).map_err(|error| error.to_string())
}

/// What was loaded, all that changes ([`State`](super::State)), and what follows from both. [`World::step`] moves it on.
pub struct World {
    /// What the effects of the scene's bodies do in a frame. First, so that it is dropped first: no device pushes while others are
    /// waited for.
    pub effects: Vec<Box<dyn RunningEffect>>,
    /// What was loaded.
    pub assets: Arc<Assets>,
    pub bodies: Bodies,
    pub room_from_head: Isometry3<f64>,
    /// What the last frame shows.
    pub frame: Frame,
    /// Each picture is kept, and waits for what is computed in the background.
    pub is_for_pictures: bool,
    /// How often somebody asked for another field; only the picture changes.
    pub field_changes: usize,
    /// Warnings, each told once, with the time since the start at which it was told, s.
    pub warnings: Vec<(f64, String)>,
    /// Time since the start of the session, s; a script's own time begins anew with every round.
    pub(super) clock_s: f64,
    pub graph: Graph<Bodies>,
    pub fields: Fields,
    pub edit: EditState,
    /// The reasons for black screens that were told already.
    pub(super) told: BTreeSet<String>,
}

/// An effect of a world, until it is dropped; a thread that it has started ends with it.
pub trait RunningEffect {
    /// As scenes name it.
    fn name(&self) -> &'static str;

    /// Changes what trackers, script or mouse say, before the world goes through a frame. A replay, whose recording holds what came
    /// of it, does not ask.
    fn input(&mut self, _state: &mut TrackerState) {}

    /// Whether it acts on bodies ([`RunningEffect::solve`]).
    fn acts(&self) -> bool {
        false
    }

    /// Adds to what the bodies' shapes, energies and forces are made of in this frame, whose hands and poses are known. The bodies
    /// are as they were shaped in the frame before. Effects act one after the other, in the order of the program's table of effects.
    fn solve(&mut self, _world: &World, _contributions: &mut [Contribution]) {}

    /// Sees the bodies in the shape of this frame; colours them, and adds what it knows of their forces.
    fn surface(&mut self, _world: &World, _bodies: &mut [BodyFrame]) {}

    /// Sees the world at the end of a frame, and adds what is drawn.
    fn show(&mut self, _world: &World, _frame: &mut Frame) {}

    /// Sees the world before a picture that is kept: waits for what comes from the background, and adds what is drawn of it.
    fn before_picture(&mut self, _world: &World, _frame: &mut Frame) {}

    /// What it keeps from one frame to the next; `None` where all that it shows follows from the frame.
    fn memory(&self) -> Option<Memory> {
        None
    }

    /// Goes on from what an effect of the same scene kept. The error says why it cannot.
    fn set_memory(&mut self, _memory: &Memory) -> Result<(), String> {
        Ok(())
    }

    /// Forgets what was drawn of the past, such as a curve.
    fn clear(&mut self) {}

    /// What it has recorded, as a CSV table of this kind.
    fn table(&self) -> Option<(&'static Kind, String)> {
        None
    }

    /// What the effect's device of this name measures, as a tracker's source; once.
    fn source(&mut self, _tracker: &str) -> Option<Box<dyn Source>> {
        None
    }

    /// Rows of the overlay for each of its devices, as they are now.
    fn readings(&mut self) -> Vec<Vec<Words>> {
        Vec::new()
    }

    /// How it went, in lines for the end of a session.
    fn summary(&mut self) -> String {
        String::new()
    }
}
