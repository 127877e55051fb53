//! One frame, from what the trackers say to what is drawn: draggers, control poses, deformed bodies, eyes.
//!
//! In: a scene, its .green file, a stage, and a [`TrackerState`] per frame. Out: deformed bodies at their places,
//! styli with their rays, and one view per screen and eye. It knows no window and no device. What moves is a graph of
//! fields ([`flow`]), evaluated once a frame.

pub mod body;
pub mod flow;
pub mod hand;

pub use body::{Mood, PlacedBody};
pub use flow::{Bodies, Fields};

use super::failure::Failure;
use super::session;
use crate::deform::{ControlPose, PoseGuard};
use crate::field::{Field, Graph, Value};
use crate::green::GreenFile;
use crate::render::{Grid, StylusShape, View};
use crate::scene::Scene;
use crate::stage::{Eye, Stage};
use crate::track::{Signal, TrackerState};
use flow::Tracked;
use hand::Grip;
use nalgebra::{Isometry3, Point3};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

/// A ray or a view nearer to the eye than this is cut off, m.
const NEAR_M: f64 = 0.05;

/// All that moves.
pub struct World {
    pub stage: Stage,
    pub bodies: Bodies,
    pub room_from_head: Isometry3<f64>,
    /// What each stylus looks like in this frame.
    pub styli: Vec<StylusShape>,
    /// What the mechanics of this frame took.
    pub times: StepTimes,
    /// What is wrong, each said once.
    pub warnings: Vec<String>,
    pub graph: Graph<Bodies>,
    pub fields: Fields,
    /// Why a screen is black: what was told already.
    told: BTreeSet<String>,
}

/// Time of the mechanics of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Pick rays and draggers.
    pub interact_s: f64,
    pub deform_s: f64,
    pub normals_s: f64,
}

impl World {
    pub fn new(scene: &Scene, file: &Arc<GreenFile>, stage: Stage) -> Result<World, Failure> {
        let bodies = body::place(scene, file, session::deformers(scene, file)?, &stage);
        let room_from_head = stage.viewer.room_from_head;
        let (graph, fields) = flow::graph(scene, room_from_head).map_err(Failure::request)?;
        Ok(World {
            stage,
            bodies,
            room_from_head,
            styli: Vec::new(),
            times: StepTimes::default(),
            warnings: Vec::new(),
            graph,
            fields,
            told: BTreeSet::new(),
        })
    }

    /// Moves everything to what the trackers say: one evaluation of the graph.
    pub fn step(&mut self, state: &TrackerState) -> StepTimes {
        let started = Instant::now();
        while self.fields.hands.len() < state.styli.len() {
            if let Err(error) = self.fields.add_hand(&mut self.graph) {
                unreachable!("the names of hands are their own: {error}");
            }
        }
        self.put(self.fields.tracked_head, Tracked(state.head));
        for hand in 0..self.fields.hands.len() {
            // One that is lost neither holds nor is seen.
            let stylus = state.styli.get(hand).filter(|stylus| !matches!(stylus.signal, Signal::Lost { .. }));
            self.put(self.fields.hands[hand].stylus, stylus.copied());
        }
        self.evaluate();
        self.times.interact_s = started.elapsed().as_secs_f64() - self.times.deform_s - self.times.normals_s;
        self.times
    }

    /// Sets a field that the trackers feed.
    fn put<T: Value>(&mut self, field: Field<T>, value: T) {
        if let Err(error) = self.graph.set(field, value) {
            unreachable!("nothing is connected to what trackers feed: {error}");
        }
    }

    /// Evaluates the graph, and takes over what pictures show of it.
    fn evaluate(&mut self) {
        for body in &mut self.bodies {
            body.times = StepTimes::default();
        }
        self.graph.evaluate(&mut self.bodies);
        self.times = StepTimes::default();
        for body in &mut self.bodies {
            self.times.deform_s += body.times.deform_s;
            self.times.normals_s += body.times.normals_s;
            for warning in body.warnings.drain(..) {
                if !self.warnings.contains(&warning) {
                    eprintln!("note: {warning}");
                    self.warnings.push(warning);
                }
            }
        }
        self.room_from_head = self.graph.get(self.fields.head).0;
        self.show_hands();
    }

    /// Styli as they are drawn, and the colours of what they point at.
    fn show_hands(&mut self) {
        let (graph, workspace) = (&self.graph, &self.stage.workspace);
        let mut touched = Vec::new();
        self.styli.clear();
        for hand in &self.fields.hands {
            let (hit, grip) = (graph.get(hand.hit).as_ref(), graph.get(hand.dragger));
            let Some(stylus) = graph.get(hand.stylus) else { continue };
            self.styli.extend(hand::shape(stylus, hit, grip, workspace));
            let mood = if grip.drag.is_some() { Mood::Held } else { Mood::Hovered };
            let target = grip.drag.map(|drag| drag.target).or(hit.map(|hit| hit.target));
            touched.extend(target.map(|target| (self.fields.targets[target], mood)));
        }
        for (b, body) in self.bodies.iter_mut().enumerate() {
            for (c, control) in body.controls.iter_mut().enumerate() {
                let by = touched.iter().filter(|(target, _)| *target == (b, c));
                let mood = by.map(|(_, mood)| *mood).next_back().unwrap_or(Mood::Idle);
                body.recolour |= control.mood != mood;
                control.mood = mood;
            }
        }
    }

    /// Every stylus lets go of what it holds.
    pub fn let_go(&mut self) {
        for hand in &self.fields.hands {
            self.graph.restore(hand.dragger, Grip::default());
        }
    }

    /// Lets go of everything and puts every body back to rest.
    pub fn reset(&mut self) {
        self.let_go();
        for hand in 0..self.fields.hands.len() {
            self.put(self.fields.hands[hand].stylus, None);
        }
        for (body, fields) in self.bodies.iter_mut().zip(&self.fields.bodies) {
            for (control, pose) in body.controls.iter_mut().zip(&fields.poses) {
                control.guard = PoseGuard::default();
                self.graph.restore(*pose, ControlPose::REST);
            }
        }
        self.evaluate();
    }

    /// Distance from the first stylus to what it points at, for the mouse to grab there.
    pub fn hit_distance_m(&self) -> Option<f64> {
        let stylus = self.styli.first()?;
        let hit: Point3<f64> = stylus.hit?.cast();
        let eye = self.stage.viewer.eye_in_room(&self.room_from_head, Eye::Centre);
        Some((hit - eye).norm())
    }

    /// The view of every screen for `eye`; `None` where that screen stays black. Why is said once.
    pub fn view(&mut self, screen: usize, eye: Eye) -> Option<View> {
        let place = self.stage.viewer.eye_in_room(&self.room_from_head, eye);
        match self.stage.screens[screen].view(&place, NEAR_M) {
            Ok(view) => Some(View { clip_from_room: view.clip_from_room, eye_in_room: view.eye_in_room }),
            Err(unseen) => {
                let key = format!("{screen} {eye:?} {:?}", std::mem::discriminant(&unseen));
                if self.told.insert(key) {
                    let warning = format!("{} eye: {unseen}", eye.name());
                    eprintln!("note: {warning}");
                    self.warnings.push(warning);
                }
                None
            }
        }
    }

    /// The floor grid of the stage.
    pub fn grid(&self) -> Option<Grid> {
        self.stage.grid.map(|grid| {
            let centre = self.stage.workspace.centre;
            let centre = Point3::new(centre.x, grid.height_m, centre.z).cast::<f32>();
            let half = grid.half_size_m as f32;
            Grid::new(centre, [half, half], half / 8.0)
        })
    }
}

#[cfg(test)]
mod tests;
