//! One frame, from what the trackers say to what is drawn: draggers, control poses, deformed bodies, eyes.
//!
//! In: a scene, its .green file, a stage, and a [`TrackerState`] per frame. Out: deformed bodies at their places,
//! styli with their rays, and one view per screen and eye. It knows no window and no device. What moves is a graph of
//! fields ([`flow`]), evaluated once a frame.

pub mod body;
mod desk;
pub mod flow;
mod force;
mod hand;
mod state;

pub use body::{Mood, PlacedBody};
pub use desk::Desk;
pub use flow::{Bodies, Fields};
pub use force::HeldForce;
pub use hand::shape;

use super::failure::Failure;
use super::session;
use crate::base::notice::notice;
use crate::field::{Field, Graph, Value};
use crate::green::GreenFile;
use crate::interact::Action;
use crate::render::{Arrow, Grid, StylusShape, View};
use crate::scene::Scene;
use crate::stage::{Eye, Stage};
use crate::track::{Signal, TrackerState};
use flow::{BodyPlace, Tracked};
use hand::Held;
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
    /// What held elements pull with, and how it is shown; of bodies whose scene wants it.
    pub forces: Vec<HeldForce>,
    pub arrows: Vec<Arrow>,
    /// What the mechanics of this frame took.
    pub times: StepTimes,
    /// What is wrong, each said once; with the tracker's time at which it was, s.
    pub warnings: Vec<(f64, String)>,
    pub graph: Graph<Bodies>,
    pub fields: Fields,
    pub desk: Desk,
    /// What was commanded before this frame, and what has been since.
    pub actions: Vec<Action>,
    pending: Vec<Action>,
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
        let (graph, fields) = flow::graph(scene, &stage).map_err(Failure::request)?;
        let mut world = World {
            desk: Desk::new(&stage.workspace, bodies.len(), fields.targets.len()),
            stage,
            bodies,
            room_from_head,
            styli: Vec::new(),
            forces: Vec::new(),
            arrows: Vec::new(),
            times: StepTimes::default(),
            warnings: Vec::new(),
            graph,
            fields,
            actions: Vec::new(),
            pending: Vec::new(),
            told: BTreeSet::new(),
        };
        for b in 0..world.bodies.len() {
            world.put(world.fields.bodies[b].place, BodyPlace(world.bodies[b].room_from_body));
        }
        Ok(world)
    }

    /// Moves everything to what the trackers say: one evaluation of the graph.
    pub fn step(&mut self, state: &TrackerState) -> StepTimes {
        let started = Instant::now();
        std::mem::swap(&mut self.actions, &mut self.pending);
        self.pending.clear();
        self.have_styli(state.styli.len());
        self.put(self.fields.tracked_head, Tracked(state.head));
        self.put(self.fields.time, state.time_s);
        for stylus in 0..self.fields.styli.len() {
            self.put(self.fields.styli[stylus].stylus, state.styli.get(stylus).copied());
        }
        self.ease(state.time_s);
        self.evaluate();
        self.times.interact_s = started.elapsed().as_secs_f64() - self.times.deform_s - self.times.normals_s;
        self.times
    }

    /// Sets a field that is fed from outside.
    fn put<T: Value>(&mut self, field: Field<T>, value: T) {
        if let Err(error) = self.graph.set(field, value) {
            unreachable!("nothing is connected to what is fed from outside: {error}");
        }
    }

    /// Evaluates the graph, and takes over what pictures show of it.
    fn evaluate(&mut self) {
        for body in &mut self.bodies {
            body.times = StepTimes::default();
        }
        self.graph.evaluate(&mut self.bodies);
        self.times = StepTimes::default();
        let mut warnings = Vec::new();
        for body in &mut self.bodies {
            self.times.deform_s += body.times.deform_s;
            self.times.normals_s += body.times.normals_s;
            warnings.append(&mut body.warnings);
        }
        for warning in warnings {
            self.warn(warning);
        }
        self.room_from_head = self.graph.get(self.fields.head).0;
        self.follow_hands(*self.graph.get(self.fields.time));
        self.show_hands();
    }

    /// Tells it once, and the overlay.
    pub fn warn(&mut self, warning: String) {
        if self.warnings.iter().all(|(_, told)| *told != warning) {
            notice!("note: {warning}");
            self.warnings.push((*self.graph.get(self.fields.time), warning));
        }
    }

    /// Styli as they are drawn, what they feel, and the colours of what they point at.
    fn show_hands(&mut self) {
        let (graph, workspace) = (&self.graph, &self.stage.workspace);
        let hands = &graph.get(self.fields.hands).hands;
        let mut touched: Vec<((usize, usize), Mood)> = Vec::new();
        (self.styli, self.forces, self.arrows) = (Vec::new(), Vec::new(), Vec::new());
        for (i, fields) in self.fields.styli.iter().enumerate() {
            // One that is lost is not drawn where it was.
            let seen = graph.get(fields.stylus).as_ref().filter(|s| !matches!(s.signal, Signal::Lost { .. }));
            let (Some(stylus), Some(pose)) = (seen, hands.room_from_stylus(i)) else {
                continue;
            };
            let hit = graph.get(fields.hit).as_ref();
            let grip = hands.grip(i).zip(hands.grip(i).and_then(|grip| self.fields.targets.get(grip.target)));
            let held = grip.map(|(grip, &(b, c))| {
                let now = self.bodies[b].room_from_element(c, graph.get(self.fields.bodies[b].poses[c]));
                let place = now.transform_point(&grip.place_in_element);
                touched.push(((b, c), Mood::Held));
                let is_told = self.forces.iter().any(|force| (force.body, force.control) == (b, c));
                if self.bodies[b].force_scale.is_some() && !is_told {
                    let force = force::held_force(b, &self.bodies[b], c);
                    let origin = now.transform_point(&Point3::origin());
                    let shown =
                        force.as_ref().and_then(|f| force::arrow(f, &place, &origin, workspace.radius_m));
                    self.forces.extend(force);
                    self.arrows.extend(shown);
                }
                Held { grip, place }
            });
            let hit = hit.filter(|_| held.is_none());
            let target = hit.and_then(|hit| self.fields.targets.get(hit.target));
            touched.extend(target.map(|&target| (target, Mood::Hovered)));
            self.styli.push(hand::shape(stylus, pose, hit, held, workspace));
        }
        for (b, body) in self.bodies.iter_mut().enumerate() {
            for (c, control) in body.controls.iter_mut().enumerate() {
                let by = touched.iter().filter(|(target, _)| *target == (b, c));
                let mood = by.map(|(_, mood)| *mood).max().unwrap_or(Mood::Idle);
                body.recolour |= control.mood != mood;
                control.mood = mood;
            }
        }
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
                    self.warn(format!("{} eye: {unseen}", eye.name()));
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
pub mod tests;
