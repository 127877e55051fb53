//! One step of a world, from an [`Input`] to a [`Frame`]: hands, control poses, deformed bodies, and the places of the eyes.
//!
//! In: a scene, its .green file, a stage, and an [`Input`] per frame. Out: a [`Frame`], the deformed bodies at their places,
//! and one view per screen and eye. Only [`World::step`] moves a world: it sets the fields of one graph ([`flow`]), which is
//! evaluated once a frame, and the rest of the [`State`](super::State).

use super::assets::{self, Assets};
use super::body::PlacedBody;
use super::edit_state::{EditState, Step};
use super::flow::{self, Bodies, BodyPlace, Contributions, Fields, MOST_STYLI, Tracked};
use super::force;
use super::frame::{Frame, HeldForce, Highlight, StepTimes};
use super::hand::{self, HeldPlace};
use super::running::{MovedElement, RunningEffect, World};
use super::state::Input;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::deform::{Contribution, ControlPose, Deformer, ModelEntry, PoseLimiter};
use crate::field::{Field, Graph, Value};
use crate::green::GreenFile;
use crate::interact::Grip;
use crate::render::{Drawable, Grid, View};
use crate::scene::Scene;
use crate::stage::{Eye, NEAR_M, Stage, Workspace};
use crate::track::Signal;
use indexmap::IndexMap;
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

impl World {
    /// Builds a world: the bodies of a scene, each with its model, from its .green file, at their places on the stage.
    pub fn new(
        scene: &Scene,
        models: &[&'static ModelEntry],
        file: &Arc<GreenFile>,
        stage: Stage,
    ) -> Result<World, Failure> {
        World::of_bodies(scene, file, World::deformers(scene, models, file)?, stage)
    }

    /// Makes a deformer for each body: the slow part of [`World::new`], which may run on another thread.
    pub fn deformers(
        scene: &Scene,
        models: &[&'static ModelEntry],
        file: &Arc<GreenFile>,
    ) -> Result<Vec<Deformer>, Failure> {
        let deformer = |(name, model): (&String, &&'static _)| Deformer::new(file.clone(), name, model);
        scene.body.keys().zip(models).map(deformer).collect::<Result<_, _>>().map_err(Failure::wrong)
    }

    /// Builds the world from deformers that were made on another thread.
    pub fn of_bodies(
        scene: &Scene,
        file: &GreenFile,
        mut deformers: Vec<Deformer>,
        stage: Stage,
    ) -> Result<World, Failure> {
        let assets = assets::of_bodies(scene, file, &mut deformers, &stage)?;
        let body = |(deformer, (assets, warnings))| PlacedBody::new(assets, deformer, warnings);
        let bodies: Bodies = deformers.into_iter().zip(assets).map(body).collect();
        let (graph, fields) = flow::graph(&scene.body, &stage).map_err(Failure::request)?;
        Ok(World::from_parts(stage, bodies, graph, fields))
    }

    /// Builds a world without bodies: a stage, head and styli.
    pub fn of_stage(stage: Stage) -> Result<World, Failure> {
        let (graph, fields) = flow::graph(&IndexMap::new(), &stage).map_err(Failure::request)?;
        Ok(World::from_parts(stage, Bodies::new(), graph, fields))
    }

    fn from_parts(stage: Stage, bodies: Bodies, graph: Graph<Bodies>, fields: Fields) -> World {
        let assets = Assets { stage, bodies: bodies.iter().map(|body| body.assets.clone()).collect() };
        let mut world = World {
            edit: EditState::new(&assets.stage.workspace, bodies.len(), fields.targets.len()),
            effects: Vec::new(),
            room_from_head: assets.stage.viewer.room_from_head,
            frame: Frame::at_rest(&assets),
            assets: Arc::new(assets),
            bodies,
            is_for_pictures: false,
            field_changes: 0,
            warnings: Vec::new(),
            clock_s: 0.0,
            graph,
            fields,
            first_memories: BTreeMap::new(),
            told: BTreeSet::new(),
        };
        for b in 0..world.bodies.len() {
            world.put(world.fields.bodies[b].place, BodyPlace(world.bodies[b].room_from_body));
        }
        world
    }

    /// The ball into which bodies without a `place` were fitted: the workspace, or a higher or smaller ball where they would
    /// otherwise be cut off.
    pub fn filled(&self) -> Workspace {
        let fitted = self.bodies.iter().filter(|body| body.assets.is_fitted);
        let places = fitted.flat_map(|body| {
            let point = |x: &[f32; 3]| body.assets.home * Point3::from(Vector3::from(*x).cast::<f64>());
            body.deformer.rest().iter().map(point)
        });
        let bounds = places.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
        bounds.map_or(self.assets.stage.workspace, |(low, high)| Workspace {
            centre: nalgebra::center(&low, &high),
            radius_m: (high - low).max() / 2.0 / Workspace::FILL,
        })
    }

    /// Indices of the bodies for which a background thread has a new state. Pass them on in the next [`Input`].
    pub fn arrivals(&mut self) -> Vec<usize> {
        let bodies = self.bodies.iter_mut().enumerate();
        bodies.filter_map(|(b, body)| body.deformer.has_news().then_some(b)).collect()
    }

    /// Makes every later frame wait until the background threads have solved exactly its poses: for pictures and recordings.
    pub fn wait_for_background(&mut self) {
        self.bodies.iter_mut().for_each(|body| body.deformer.be_patient(Duration::MAX));
    }

    pub fn styli_count(&self) -> usize {
        self.fields.styli.len()
    }

    /// Makes sure that there are fields for at least `count` styli, at most 16.
    pub fn have_styli(&mut self, count: usize) {
        while self.fields.styli.len() < count.min(MOST_STYLI) {
            if let Err(error) = self.fields.add_stylus(&mut self.graph) {
                unreachable!("every stylus has its own name: {error}");
            }
        }
    }

    /// Moves the world on by one frame.
    pub fn step(&mut self, input: &Input) -> &Frame {
        let started = Instant::now();
        for action in &input.actions {
            self.carry_out(*action);
        }
        let trackers = &input.trackers;
        self.frame = Frame { dt_s: (input.clock_s - self.clock_s).max(0.0), ..Frame::at_rest(&self.assets) };
        self.clock_s = input.clock_s;
        input.warnings.iter().for_each(|warning| self.warn(warning.clone()));
        self.have_styli(trackers.styli.len());
        self.put(self.fields.tracked_head, Tracked(trackers.head));
        self.put(self.fields.time, trackers.time_s);
        for stylus in 0..self.fields.styli.len() {
            self.put(self.fields.styli[stylus].stylus, trackers.styli.get(stylus).copied());
        }
        self.ease(trackers.time_s);
        for b in 0..self.bodies.len() {
            let is_homeward = self.bodies[b].deformer.pass_frame();
            if is_homeward || input.arrivals.contains(&b) {
                let arrived = self.fields.bodies[b].arrived;
                let count = self.graph.get(arrived) + 1.0;
                self.put(arrived, count);
            }
        }
        self.evaluate();
        self.warn_of_black_screens();
        self.show_ruler();
        self.show_touches();
        let times = &mut self.frame.times;
        times.interact_s = started.elapsed().as_secs_f64() - times.deform_s - times.normals_s;
        self.with_frame(|effect, world, frame| effect.show(world, frame));
        &self.frame
    }

    /// Lets the effects see the world before a picture is saved.
    pub fn before_picture(&mut self) {
        self.with_frame(|effect, world, frame| effect.before_picture(world, frame));
    }

    /// Collects the energy and slopes that effects add to the bodies, if any effect acts on bodies.
    fn gather_contributions(&mut self) {
        let Some(field) = self.fields.contributions else { return };
        let poses: Vec<Vec<Field<ControlPose>>> =
            self.fields.bodies.iter().map(|body| body.poses.clone()).collect();
        let touches: Vec<_> = self.fields.touch.iter().map(|touch| touch.touches).collect();
        self.graph.evaluate_first(&(self.fields.hands, touches, poses), &mut self.bodies);
        let mut contributions = self.no_contributions();
        let mut effects = std::mem::take(&mut self.effects);
        for at in 0..effects.len() {
            let (now, later) = effects.split_at_mut(at + 1);
            let mut inertias: Vec<_> = later.iter_mut().flat_map(|effect| effect.inertias()).collect();
            let effect = &mut now[at];
            effect.solve(self, &mut contributions, &mut inertias);
            if effect.has_begun() {
                self.edit.history.push(Step::Effect(effect.name().to_owned()));
            }
            effect.moved().iter().for_each(|moved| self.move_element(moved));
            self.remake(&mut effects, at);
        }
        self.effects = effects;
        self.put(field, Contributions(contributions));
    }

    /// Gives bodies the surfaces and columns that an effect has made for them.
    pub(super) fn remake(&mut self, effects: &mut [Box<dyn RunningEffect>], by: usize) {
        for (b, file) in effects[by].remade() {
            let kept = kept_nodes(&file, &self.bodies[b].deformer.body);
            self.bodies[b].remake(file, kept);
            for effect in effects.iter_mut() {
                if let Err(message) = effect.reshaped(self, b, kept) {
                    self.warn(message);
                }
            }
            let ends = &mut self.edit.ruler.ends;
            let before = ends.len();
            ends.retain(|end| end.body != b);
            if ends.len() < before {
                let name = &self.bodies[b].deformer.body;
                self.warn(format!(
                    "body.{name}: the ruler is taken away, since the surface is another one now"
                ));
            }
        }
    }

    /// Sets the pose of a control element that an effect moves, as if it had always had it: a hand that takes hold of it later
    /// finds it there.
    fn move_element(&mut self, moved: &MovedElement) {
        let MovedElement { body, control, pose } = moved;
        let field = self.fields.bodies.get(*body).and_then(|body| body.poses.get(*control)).copied();
        if let Some(field) = field.filter(|_| pose.is_finite()) {
            self.bodies[*body].limiters[*control] = PoseLimiter::default();
            self.graph.restore(field, *pose);
        }
    }

    /// Whether a hand holds a control element in this frame, or a command brings it back to rest.
    pub fn is_carried(&self, body: usize, control: usize) -> bool {
        let target = self.fields.targets.iter().position(|target| *target == (body, control));
        let easing = self.edit.easing.iter().flat_map(|(_, from)| from.iter().map(|(target, _)| *target));
        let held = self.graph.get(self.fields.hands).hands.held();
        target.is_some_and(|target| held.contains(&target) || easing.into_iter().any(|eased| eased == target))
    }

    fn no_contributions(&self) -> Vec<Contribution> {
        self.bodies.iter().map(|body| body.deformer.no_contribution()).collect()
    }

    /// Evaluates the graph without effects and pictures, between two frames.
    pub(super) fn settle(&mut self) {
        if let Some(field) = self.fields.contributions {
            self.put(field, Contributions(self.no_contributions()));
        }
        self.graph.evaluate(&mut self.bodies);
    }

    /// Adds effects to the world, which begin with the memories that they have now.
    pub fn join(&mut self, effects: Vec<Box<dyn RunningEffect>>) -> Result<(), Failure> {
        if self.fields.contributions.is_none() && effects.iter().any(|effect| effect.acts()) {
            self.fields.connect_effects(&mut self.graph, &self.bodies).map_err(Failure::request)?;
        }
        self.effects.extend(effects);
        for (name, memory) in self.memories(|effect| effect.acts()) {
            self.first_memories.entry(name).or_insert(memory);
        }
        self.colour();
        Ok(())
    }

    fn with_effects(&mut self, mut take_part: impl FnMut(&mut dyn RunningEffect, &World)) {
        let mut effects = std::mem::take(&mut self.effects);
        effects.iter_mut().for_each(|effect| take_part(effect.as_mut(), self));
        self.effects = effects;
    }

    /// Lets the effects colour the bodies in their present shapes.
    pub(super) fn colour(&mut self) {
        let mut bodies = std::mem::take(&mut self.frame.bodies);
        self.with_effects(|effect, world| effect.surface(world, &mut bodies));
        self.frame.bodies = bodies;
    }

    /// Runs `surface` and `show` of an effect that has not joined this world (tests only).
    #[cfg(test)]
    pub fn show_by(&mut self, effect: &mut dyn RunningEffect) {
        let mut frame = std::mem::take(&mut self.frame);
        effect.surface(self, &mut frame.bodies);
        effect.show(self, &mut frame);
        frame.warnings.iter().for_each(|warning| self.warn(warning.clone()));
        self.frame = frame;
    }

    /// Lets the effects add to the frame one after the other; each sees what the earlier ones added.
    fn with_frame(&mut self, take_part: impl Fn(&mut dyn RunningEffect, &World, &mut Frame)) {
        let mut frame = std::mem::take(&mut self.frame);
        self.with_effects(|effect, world| take_part(effect, world, &mut frame));
        frame.warnings.iter().for_each(|warning| self.warn(warning.clone()));
        self.frame = frame;
    }

    /// Sets an input field of the graph, to which nothing is connected.
    pub(super) fn put<T: Value>(&mut self, field: Field<T>, value: T) {
        if let Err(error) = self.graph.set(field, value) {
            unreachable!("nothing is connected to an input field: {error}");
        }
    }

    /// Evaluates the graph and copies the results into the frame.
    pub(super) fn evaluate(&mut self) {
        for body in &mut self.bodies {
            body.times = StepTimes::default();
        }
        self.gather_contributions();
        self.graph.evaluate(&mut self.bodies);
        self.frame.times = StepTimes::default();
        self.frame.bodies.iter_mut().for_each(|body| body.highlights.fill(Highlight::Idle));
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
        self.colour();
        self.show_hands();
    }

    /// Gives a warning once, on standard error and in the overlay.
    pub fn warn(&mut self, warning: String) {
        if self.warnings.iter().all(|(_, known)| *known != warning) {
            notice!("note: {warning}");
            self.warnings.push((self.clock_s, warning));
        }
    }

    /// Fills the frame with styli, the forces on the control elements that they hold, and highlights.
    fn show_hands(&mut self) {
        let (graph, workspace) = (&self.graph, &self.assets.stage.workspace);
        let hands = &graph.get(self.fields.hands).hands;
        let mut touched: Vec<((usize, usize), Highlight)> = Vec::new();
        let (mut forces, mut drawables): (Vec<HeldForce>, Vec<Drawable>) = (Vec::new(), Vec::new());
        for (i, fields) in self.fields.styli.iter().enumerate() {
            // A lost stylus is not drawn.
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
                let is_listed = forces.iter().any(|force| (force.body, force.control) == (b, c));
                if let Some(scale) = self.frame.bodies[b].force_scale.as_ref().filter(|_| !is_listed) {
                    let force = force::held_force(b, &self.bodies[b], scale, c);
                    let shown = force.as_ref().and_then(|f| force::arrow(f, &place, workspace.radius_m));
                    forces.extend(force);
                    drawables.extend(shown.map(Drawable::Arrow));
                }
                HeldPlace { grip, place }
            });
            let touched_point = self.touched(i).map(|(touch, place)| (touch.place_in_stylus, place));
            let as_grip = touched_point.map(|(place_in_stylus, place)| {
                let place_in_element = Point3::origin();
                // No control element: only the place is drawn.
                (Grip { target: usize::MAX, place_in_stylus, place_in_element }, place)
            });
            let held = held.or(as_grip.as_ref().map(|(grip, place)| HeldPlace { grip, place: *place }));
            let hit = hit.filter(|_| held.is_none());
            let target = hit.and_then(|hit| self.fields.targets.get(hit.target));
            touched.extend(target.map(|&target| (target, Highlight::Hovered)));
            drawables.push(Drawable::Stylus(hand::shape(stylus, pose, hit, held, workspace)));
        }
        for ((b, c), highlight) in touched {
            let now = &mut self.frame.bodies[b].highlights[c];
            *now = highlight.max(*now);
        }
        (self.frame.forces, self.frame.drawables) = (forces, drawables);
    }

    /// Distance from the centre eye to the point that the first drawn stylus hits, m. The mouse grabs at this distance.
    pub fn hit_distance_m(&self) -> Option<f64> {
        let stylus = self.frame.all(Drawable::stylus).next()?;
        let hit: Point3<f64> = stylus.hit?.cast();
        Some((hit - self.eye(Eye::Centre)).norm())
    }

    /// The view of `eye` through one screen; `None` if the screen stays black for this eye ([`World::step`] warns).
    pub fn view(&self, screen: usize, eye: Eye) -> Option<View> {
        let view = self.assets.stage.screens.get(screen)?.view(&self.eye(eye), NEAR_M).ok()?;
        Some(View { clip_from_room: view.clip_from_room, eye_in_room: view.eye_in_room })
    }

    fn eye(&self, eye: Eye) -> Point3<f64> {
        self.assets.stage.viewer.eye_in_room(&self.room_from_head, eye)
    }

    /// Warns of screens that should be seen but stay black: once for each screen, eye and reason.
    fn warn_of_black_screens(&mut self) {
        let mut unseen = Vec::new();
        for (number, screen) in self.assets.stage.screens.iter().enumerate() {
            for eye in Eye::ALL.into_iter().filter(|eye| self.assets.stage.shows(number, *eye)) {
                unseen.extend(screen.view(&self.eye(eye), NEAR_M).err().map(|why| (number, eye, why)));
            }
        }
        for (screen, eye, why) in unseen {
            let key = format!("{screen} {eye:?} {:?}", std::mem::discriminant(&why));
            if self.told.insert(key) {
                self.warn(format!("{} eye: {why}", eye.name()));
            }
        }
    }

    /// The floor grid of the stage.
    pub fn grid(&self) -> Option<Grid> {
        self.assets.stage.grid.map(|grid| {
            let centre = self.assets.stage.workspace.centre;
            let centre = Point3::new(centre.x, grid.height_m, centre.z).cast::<f32>();
            let half = grid.half_size_m as f32;
            Grid::new(centre, [half, half], half / 8.0)
        })
    }
}

/// Number of the first nodes of a body's surface in a file that are those of every other file of it, however it was remade.
fn kept_nodes(file: &GreenFile, body: &str) -> usize {
    let mut first = file;
    while let Some(base) = &first.base {
        first = base;
    }
    first.rest(body).len()
}
