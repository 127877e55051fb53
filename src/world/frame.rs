//! One frame of the world, from the trackers' poses to what is drawn: hands, control poses, deformed bodies, eyes.
//!
//! In: a scene, its .green file, a stage, and a [`TrackerState`] per frame. Out: deformed bodies at their places,
//! styli with their rays, and one view per screen and eye. Everything that moves is a field of one graph
//! ([`flow`]), which is evaluated once a frame.

use super::body;
use super::edit_state::EditState;
use super::flow::{self, Bodies, BodyPlace, Contributions, Fields, Tracked};
use super::force::{self, HeldForce};
use super::hand::{self, HeldPlace};
use super::highlight::Highlight;
use super::running::Memory;
use super::times::StepTimes;
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::base::output::Kind;
use crate::base::plates::{Plate, Words};
use crate::base::strips::Strips;
use crate::deform::{Contribution, ControlPose, Deformer, ModelEntry};
use crate::field::{Field, Graph, Value};
use crate::green::GreenFile;
use crate::interact::{Action, Grip};
use crate::render::{Arrow, Ball, Ghost, Grid, Line, StylusShape, View};
use crate::scene::Scene;
use crate::stage::{Eye, Stage, Workspace};
use crate::track::{Signal, Source, TrackerState};
use indexmap::IndexMap;
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is nearer to the eye than this is not drawn, m.
const NEAR_M: f64 = 0.05;

/// At most so many styli are followed; further ones are ignored.
pub(super) const MOST_STYLI: usize = 16;

/// An effect of a world, until it is dropped; a thread that it has started ends with it.
pub trait RunningEffect {
    /// As scenes name it.
    fn name(&self) -> &'static str;

    /// Changes what trackers, script or mouse say, before the world goes through a frame. A replay, whose recording holds what came
    /// of it, does not ask.
    fn input(&mut self, _state: &mut TrackerState) {}

    /// Whether it acts on bodies ([`RunningEffect::act`]).
    fn acts(&self) -> bool {
        false
    }

    /// Adds to what the bodies' shapes, energies and forces are made of in this frame, whose hands and poses are known; a replay
    /// asks, too. The bodies are as they were shaped in the frame before. Effects act one after the other, in the order of
    /// the program's table of effects.
    fn act(&mut self, _world: &World, _contributions: &mut [Contribution]) {}

    /// Sees the world at the end of a frame, and adds what it draws ([`Frame::strips`]).
    fn show(&mut self, _world: &mut World) {}

    /// Sees the world before a picture that is kept: waits for what comes from the background, and adds what it draws of it.
    fn before_picture(&mut self, _world: &mut World) {}

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

/// What one frame shows beside bodies; the next one begins empty.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// What each stylus looks like.
    pub styli: Vec<StylusShape>,
    /// The forces of held elements, and the arrows that show them, for bodies that list an effect with forces.
    pub forces: Vec<HeldForce>,
    pub arrows: Vec<Arrow>,
    /// What effects draw with shaders of their own.
    pub strips: Vec<Strips>,
    /// Translucent shapes, lines, balls, and what is written over the pictures: of effects, and of the ruler.
    pub ghosts: Vec<Ghost>,
    pub lines: Vec<Line>,
    pub balls: Vec<Ball>,
    pub plates: Vec<Plate>,
    /// What the mechanics took.
    pub times: StepTimes,
}

/// All that moves.
pub struct World {
    /// What the effects of the scene's bodies do in a frame. First, so that it is dropped first: no device pushes while others are
    /// waited for.
    pub effects: Vec<Box<dyn RunningEffect>>,
    pub stage: Stage,
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
    /// Commands that came before this frame, and those that have come since.
    pub actions: Vec<Action>,
    pub(super) pending: Vec<Action>,
    /// The reasons for black screens that were told already.
    pub(super) told: BTreeSet<String>,
}

impl World {
    /// The bodies of a scene, each with its model, from its .green file, at their places on the stage.
    pub fn new(
        scene: &Scene,
        models: &[&'static ModelEntry],
        file: &Arc<GreenFile>,
        stage: Stage,
    ) -> Result<World, Failure> {
        World::of_bodies(scene, file, World::deformers(scene, models, file)?, stage)
    }

    /// What takes time of [`World::new`], for another thread.
    pub fn deformers(
        scene: &Scene,
        models: &[&'static ModelEntry],
        file: &Arc<GreenFile>,
    ) -> Result<Vec<Deformer>, Failure> {
        let deformer = |(name, model): (&String, &&'static _)| Deformer::new(file.clone(), name, model);
        scene.body.keys().zip(models).map(deformer).collect::<Result<_, _>>().map_err(Failure::wrong)
    }

    /// The rest of it.
    pub fn of_bodies(
        scene: &Scene,
        file: &GreenFile,
        deformers: Vec<Deformer>,
        stage: Stage,
    ) -> Result<World, Failure> {
        let bodies = body::place(scene, file, deformers, &stage)?;
        let models: Vec<_> = bodies.iter().map(|body| body.model).collect();
        let (graph, fields) = flow::graph(&scene.body, &models, &stage).map_err(Failure::request)?;
        Ok(World::of(stage, bodies, graph, fields))
    }

    /// A stage without bodies: head and styli alone.
    pub fn of_stage(stage: Stage) -> Result<World, Failure> {
        let (graph, fields) = flow::graph(&IndexMap::new(), &[], &stage).map_err(Failure::request)?;
        Ok(World::of(stage, Bodies::new(), graph, fields))
    }

    fn of(stage: Stage, bodies: Bodies, graph: Graph<Bodies>, fields: Fields) -> World {
        let mut world = World {
            edit: EditState::new(&stage.workspace, bodies.len(), fields.targets.len()),
            effects: Vec::new(),
            room_from_head: stage.viewer.room_from_head,
            stage,
            bodies,
            frame: Frame::default(),
            is_for_pictures: false,
            field_changes: 0,
            warnings: Vec::new(),
            clock_s: 0.0,
            graph,
            fields,
            actions: Vec::new(),
            pending: Vec::new(),
            told: BTreeSet::new(),
        };
        for b in 0..world.bodies.len() {
            world.put(world.fields.bodies[b].place, BodyPlace(world.bodies[b].room_from_body));
        }
        world
    }

    /// The ball that bodies without a place of their own fill as they were put: the stage's workspace, or higher and smaller where
    /// they would not be seen whole.
    pub fn filled(&self) -> Workspace {
        let fitted = self.bodies.iter().filter(|body| body.is_fitted);
        let places = fitted.flat_map(|body| {
            let point = |x: &[f32; 3]| body.home * Point3::from(Vector3::from(*x).cast::<f64>());
            body.deformer.rest().iter().map(point)
        });
        let bounds = places.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
        bounds.map_or(self.stage.workspace, |(low, high)| Workspace {
            centre: nalgebra::center(&low, &high),
            radius_m: (high - low).max() / 2.0 / Workspace::FILL,
        })
    }

    /// Moves everything to where the trackers say it is, by one evaluation of the graph.
    pub fn step(&mut self, state: &TrackerState) -> StepTimes {
        self.step_at(state.time_s, state)
    }

    /// Lets states in that have come from the background.
    fn take_news(&mut self) {
        for b in 0..self.bodies.len() {
            if let Some(arrived) = self.fields.bodies[b].arrived
                && self.bodies[b].deformer.has_news()
            {
                self.put(arrived, self.graph.get(arrived) + 1.0);
            }
        }
    }

    /// From now on every frame shows the state of its own poses, however long it takes: for pictures and recordings.
    pub fn wait_for_background(&mut self) {
        self.bodies.iter_mut().for_each(|body| body.deformer.be_patient(Duration::MAX));
    }

    pub fn styli_count(&self) -> usize {
        self.fields.styli.len()
    }

    /// Makes fields for so many styli.
    pub fn have_styli(&mut self, count: usize) {
        while self.fields.styli.len() < count.min(MOST_STYLI) {
            if let Err(error) = self.fields.add_stylus(&mut self.graph) {
                unreachable!("the names of styli are their own: {error}");
            }
        }
    }

    /// The same at another time since the start of the session than the tracker's, s.
    pub fn step_at(&mut self, clock_s: f64, state: &TrackerState) -> StepTimes {
        let started = Instant::now();
        self.clock_s = clock_s;
        self.frame = Frame::default();
        std::mem::swap(&mut self.actions, &mut self.pending);
        self.pending.clear();
        self.have_styli(state.styli.len());
        self.put(self.fields.tracked_head, Tracked(state.head));
        self.put(self.fields.time, state.time_s);
        for stylus in 0..self.fields.styli.len() {
            self.put(self.fields.styli[stylus].stylus, state.styli.get(stylus).copied());
        }
        self.ease(state.time_s);
        self.take_news();
        self.evaluate();
        self.show_ruler();
        self.show_touches();
        self.frame.times.interact_s =
            started.elapsed().as_secs_f64() - self.frame.times.deform_s - self.frame.times.normals_s;
        self.frame.times
    }

    /// Lets the effects see the frame, and add what they draw.
    pub fn show_effects(&mut self) {
        self.with_effects(|effect, world| effect.show(world));
    }

    /// Lets the effects see the world before a picture that is kept.
    pub fn before_picture(&mut self) {
        self.with_effects(|effect, world| effect.before_picture(world));
    }

    /// Asks the effects what they add to the bodies, where one acts.
    fn gather_contributions(&mut self) {
        let Some(field) = self.fields.contributions else { return };
        let poses: Vec<Vec<Field<ControlPose>>> =
            self.fields.bodies.iter().map(|body| body.poses.clone()).collect();
        self.graph.evaluate_first(&poses, &mut self.bodies);
        let mut contributions: Vec<Contribution> =
            self.bodies.iter().map(|body| body.deformer.no_contribution()).collect();
        self.with_effects(|effect, world| effect.act(world, &mut contributions));
        self.put(field, Contributions(contributions));
    }

    /// Takes the scene's effects, before the first frame.
    pub fn join(&mut self, effects: Vec<Box<dyn RunningEffect>>) -> Result<(), Failure> {
        if effects.iter().any(|effect| effect.acts()) {
            self.fields.connect_effects(&mut self.graph, &self.bodies).map_err(Failure::request)?;
        }
        self.effects = effects;
        Ok(())
    }

    fn with_effects(&mut self, mut act: impl FnMut(&mut dyn RunningEffect, &mut World)) {
        let mut effects = std::mem::take(&mut self.effects);
        effects.iter_mut().for_each(|effect| act(effect.as_mut(), self));
        self.effects = effects;
    }

    /// Sets a field that is fed from outside.
    pub(super) fn put<T: Value>(&mut self, field: Field<T>, value: T) {
        if let Err(error) = self.graph.set(field, value) {
            unreachable!("nothing is connected to what is fed from outside: {error}");
        }
    }

    /// Evaluates the graph, and takes over what pictures show of it.
    pub(super) fn evaluate(&mut self) {
        for body in &mut self.bodies {
            body.times = StepTimes::default();
        }
        self.gather_contributions();
        self.graph.evaluate(&mut self.bodies);
        self.frame.times = StepTimes::default();
        let mut warnings = Vec::new();
        for body in &mut self.bodies {
            self.frame.times.deform_s += body.times.deform_s;
            self.frame.times.normals_s += body.times.normals_s;
            warnings.append(&mut body.warnings);
        }
        for warning in warnings {
            self.warn(warning);
        }
        self.room_from_head = self.graph.get(self.fields.head).0;
        self.follow_hands(*self.graph.get(self.fields.time));
        self.show_hands();
    }

    /// Tells a warning once, on standard error and in the overlay.
    pub fn warn(&mut self, warning: String) {
        if self.warnings.iter().all(|(_, told)| *told != warning) {
            notice!("note: {warning}");
            self.warnings.push((self.clock_s, warning));
        }
    }

    /// Styli as they are drawn, what they feel, and the colours of what they point at.
    fn show_hands(&mut self) {
        let (graph, workspace) = (&self.graph, &self.stage.workspace);
        let hands = &graph.get(self.fields.hands).hands;
        let mut touched: Vec<((usize, usize), Highlight)> = Vec::new();
        (self.frame.styli, self.frame.forces, self.frame.arrows) = (Vec::new(), Vec::new(), Vec::new());
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
                touched.push(((b, c), Highlight::Held));
                let is_told = self.frame.forces.iter().any(|force| (force.body, force.control) == (b, c));
                if self.bodies[b].force_scale.is_some() && !is_told {
                    let force = force::held_force(b, &self.bodies[b], c);
                    let shown = force.as_ref().and_then(|f| force::arrow(f, &place, workspace.radius_m));
                    self.frame.forces.extend(force);
                    self.frame.arrows.extend(shown);
                }
                HeldPlace { grip, place }
            });
            let touched_point = self.touched(i).map(|(touch, place)| (touch.place_in_stylus, place));
            let as_grip = touched_point.map(|(place_in_stylus, place)| {
                let place_in_element = Point3::origin();
                (Grip { target: usize::MAX, place_in_stylus, place_in_element, is_near: false }, place)
            });
            let held = held.or(as_grip.as_ref().map(|(grip, place)| HeldPlace { grip, place: *place }));
            let hit = hit.filter(|_| held.is_none());
            let target = hit.and_then(|hit| self.fields.targets.get(hit.target));
            touched.extend(target.map(|&target| (target, Highlight::Hovered)));
            self.frame.styli.push(hand::shape(stylus, pose, hit, held, workspace));
        }
        for (b, body) in self.bodies.iter_mut().enumerate() {
            for (c, control) in body.controls.iter_mut().enumerate() {
                let by = touched.iter().filter(|(target, _)| *target == (b, c));
                let highlight = by.map(|(_, highlight)| *highlight).max().unwrap_or(Highlight::Idle);
                body.recolour |= control.highlight != highlight;
                control.highlight = highlight;
            }
        }
    }

    /// Distance from the first stylus to what it points at, for the mouse to grab there.
    pub fn hit_distance_m(&self) -> Option<f64> {
        let stylus = self.frame.styli.first()?;
        let hit: Point3<f64> = stylus.hit?.cast();
        let eye = self.stage.viewer.eye_in_room(&self.room_from_head, Eye::Centre);
        Some((hit - eye).norm())
    }

    /// What `eye` sees on one screen; `None` where it stays black. The reason is told once.
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
