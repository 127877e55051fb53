//! The effect in a world: bodies and tools from frame to frame.
//!
//! In: where hands put the tools, and the places of the bodies and the poses of their control elements. Out: forces at points of the
//! bodies. In a frame all of them move on in steps that are short against tools and walls ([`way`](super::way)), so that none passes
//! through a body and friction knows its way.

use super::acting::{self, poses_of};
use super::candidates::{Nodes, Places};
use super::detection::distance;
use super::felt::{Felt, Touching};
use super::inertial::{self, Inertias};
use super::motion::{Motion, Placed, Push};
use super::rest;
use super::round::{Outcome, Step};
use super::rubbed::add_friction;
use super::settings::NAME;
use super::shown::Shown;
use super::system::advance;
use super::touch::{Contact, at_nodes, at_spots, force_on_tool, shifted};
use super::touched_body::TouchedBody;
use super::way::{MOST_STEPS, Near, Start, Way, are_moved_alike, place_between, poses_between, tool_way};
use crate::deform::{Contribution, DeformerState};
use crate::stage::Stage;
use crate::world::dissipation::Dissipation;
use crate::world::inertia::{Gone, Inertia, StepForces};
use crate::world::running::{Memory, read, written};
use crate::world::tool::{Tool, pose_between};
use crate::world::{BodyFrame, Frame, RunningEffect, World};
use nalgebra::{Isometry3, Similarity3, Vector3};
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Time since the first frame within which a tool's stylus should be seen, s.
const SEEN_S: f64 = 2.0;

pub struct Contacts {
    bodies: Vec<TouchedBody>,
    tools: Vec<Tool>,
    /// Bodies that touch each other, or themselves.
    pairs: Vec<[usize; 2]>,
    motion: Motion,
    felt: Felt,
    /// Time of the first frame, s.
    first_s: Option<f64>,
    /// Warnings of this frame.
    warnings: Vec<String>,
    /// Length of this frame for bodies with inertia, s.
    frame_s: f64,
}

/// The bodies in a frame, as the world has them.
struct Now {
    tools: Vec<Option<Isometry3<f64>>>,
    places: Vec<Similarity3<f64>>,
    /// Poses of control elements; of a body with inertia those to which it would fly under the forces of the last frame.
    ends: Vec<Gone>,
}

impl Contacts {
    pub fn new(
        bodies: Vec<TouchedBody>,
        tools: Vec<Tool>,
        pairs: Vec<[usize; 2]>,
        stage: &Stage,
    ) -> Contacts {
        let motion = Motion { tools: vec![Placed::default(); tools.len()], ..Motion::default() };
        let felt = Felt::new(&bodies, &tools, stage);
        Contacts { bodies, tools, pairs, motion, felt, first_s: None, warnings: Vec::new(), frame_s: 0.0 }
    }

    /// Moves tools and bodies to where they are now.
    fn step(&mut self, world: &World, contributions: &[Contribution], given: &mut [&mut dyn Inertia]) {
        self.warnings.clear();
        self.bodies.iter_mut().for_each(|body| body.rubbed = Dissipation::default());
        self.felt.rests();
        let mut inertias = self.inertias_of(given);
        let (mut changed, frame_s) = acting::take(&mut self.bodies, world, contributions, &mut inertias);
        self.frame_s = frame_s.unwrap_or(self.frame_s);
        let places: Vec<_> = self.bodies.iter().map(|body| world.bodies[body.b].room_from_body).collect();
        if self.motion.places.is_empty() {
            self.put(&places);
        }
        // A tool whose stylus is not seen stays where it was.
        let place = |(tool, last): (&Tool, &Placed)| tool.place.pose(world).or(last.pose);
        let tools: Vec<_> = self.tools.iter().zip(&self.motion.tools).map(place).collect();
        changed |= tools.iter().zip(&self.motion.tools).any(|(new, last)| *new != last.pose);
        changed |= places != self.motion.places;
        self.motion.places.clone_from(&places);
        let is_disturbed = changed
            || self
                .bodies
                .iter()
                .zip(&inertias)
                .any(|(body, inertia)| inertia.is_none() && poses_of(world, body.b) != body.free.poses);
        if !self.rests(is_disturbed, &inertias) {
            self.move_on(world, (tools, places), changed, &mut inertias);
        }
        self.bodies.iter_mut().for_each(|body| body.inertial = None);
    }

    /// Whether bodies that have lain still go on lying there in this frame.
    fn rests(&mut self, is_disturbed: bool, inertias: &Inertias<'_>) -> bool {
        let lie = rest::lie(&self.bodies, inertias, &self.motion.contacts);
        let still = rest::rested(self.motion.still, is_disturbed).filter(|_| lie);
        if self.motion.still >= rest::FRAMES {
            self.motion.still = still.unwrap_or(0);
        }
        still.is_some()
    }

    /// Moves bodies on to where they are led, and where they go by their inertia.
    fn move_on(
        &mut self,
        world: &World,
        (tools, places): (Vec<Option<Isometry3<f64>>>, Vec<Similarity3<f64>>),
        mut changed: bool,
        inertias: &mut Inertias<'_>,
    ) {
        let mut ends = Vec::new();
        for (number, inertia) in inertias.iter_mut().enumerate() {
            let body = &self.bodies[number];
            let end = match inertia {
                Some(inertia) => {
                    let turn = body.free.state.body_from_surface().rotation;
                    let pushed = self.motion.pushed.get(number).map_or(&[][..], Vec::as_slice);
                    let forces: Vec<_> = pushed.iter().map(|push| (push.node, push.force)).collect();
                    inertia.go(1.0, &turn, &body.free, StepForces { mean: &forces, end: &forces })
                }
                None => Gone { poses: poses_of(world, body.b), amplitudes: Vec::new() },
            };
            changed |= inertia.is_some() || end.poses != body.free.poses;
            ends.push(end);
        }
        let is_living = inertias.iter().any(Option::is_some);
        self.motion.pushed = if is_living { vec![Vec::new(); self.bodies.len()] } else { Vec::new() };
        if !changed && self.motion.is_settled {
            return;
        }
        let before = inertial::poses(inertias);
        self.advance(world, &Now { tools, places, ends }, inertias);
        if is_living {
            let is_still = rest::are_still(&self.bodies, &before, &inertial::poses(inertias));
            self.motion.still = if is_still { (self.motion.still + 1).min(rest::FRAMES) } else { 0 };
        }
    }

    /// The inertia of each body that has one.
    fn inertias_of<'a>(&self, given: &'a mut [&mut dyn Inertia]) -> Inertias<'a> {
        let mut found: Inertias<'a> = self.bodies.iter().map(|_| None).collect();
        for inertia in given {
            if let Some(number) = self.bodies.iter().position(|body| body.b == inertia.body()) {
                found[number] = Some(&mut **inertia);
            }
        }
        found
    }

    /// Goes the way from the last frame to this one.
    fn advance(&mut self, world: &World, now: &Now, inertias: &mut Inertias<'_>) {
        let before: Vec<DeformerState> = self.bodies.iter().map(TouchedBody::state).collect();
        // Bodies that are moved alike, as by navigation, are where they are now at once.
        let placed: Vec<_> = self.bodies.iter().map(|body| body.room_from_body).collect();
        let is_alike = are_moved_alike(&placed, &now.places);
        let placed = if is_alike { now.places.clone() } else { placed };
        self.put(&placed);
        let held = self.nodes_of_contacts();
        let known = self.places(&held);
        let shown =
            self.bodies.iter().map(|body| body.summed_places(&world.bodies[body.b].deformer)).collect();
        let outlines = self.outlines();
        self.put(&now.places);
        for ((body, end), inertia) in self.bodies.iter_mut().zip(&now.ends).zip(inertias.iter()) {
            let has_moved = match inertia {
                Some(inertia) => body.follow(&**inertia, end),
                None => body.free.take(&end.poses),
            };
            if has_moved {
                body.free.deform();
            }
        }
        let last = std::mem::take(&mut self.motion.tools);
        let moved = self.tools.iter().zip(&last).zip(&now.tools);
        let tools = moved.map(|((tool, last), new)| tool_way(tool, last.pose, *new)).collect();
        let mut way = Way { before: outlines, shown, after: self.outlines(), tools };
        self.motion.tools =
            now.tools.iter().map(|pose| Placed { pose: *pose, yielded: V3::zeros() }).collect();
        let from: Vec<_> = last.iter().map(Placed::surface).collect();
        let places: Vec<_> = from.iter().zip(&now.tools).map(|(from, to)| from.or(*to)).collect();
        let (bodies, tools, pairs) = (&self.bodies, &self.tools, &self.pairs);
        let near = Start { bodies, tools, pairs, places: &places, held: &held }.near(&way);
        self.motion.is_settled = true;
        if near.all.iter().all(|nodes| nodes.is_empty()) {
            inertial::keep(inertias);
        } else {
            match near.meetings.len() {
                1 if near.is_followed => {
                    let starts = first_places(&near.all, &known, &way.shown);
                    self.go_back(inertias);
                    self.one_step([&from, &now.tools], &starts, (&way, &near, 0), (inertias, 1.0));
                }
                1 => {
                    self.warnings.push(format!(
                        "contact: a tool or a body moved in one frame by more than {MOST_STEPS} steps of half the thickness of what \
                         touches; it is put down anew, and may lie beyond what it passed"
                    ));
                    self.motion.contacts.clear();
                    self.go_back(inertias);
                    inertial::begin(&mut self.bodies, inertias, 1.0);
                    inertial::go(&mut self.bodies, inertias, 1.0, &mut []);
                    let starts = self.places(&near.all);
                    self.go_back(inertias);
                    self.one_step([&now.tools, &now.tools], &starts, (&way, &near, 0), (inertias, 1.0));
                }
                _ => self.go(now, (&before, &placed), &last, (&known, &mut way, &near), inertias),
            }
        }
        self.forget_columns(&near.all);
        self.prepare_columns(&near.all, &way, &now.tools);
        self.felt.moved(near.by_tools, way.tools);
    }

    /// Puts bodies with inertia where the last step left them.
    fn go_back(&mut self, inertias: &Inertias<'_>) {
        for (body, inertia) in self.bodies.iter_mut().zip(inertias) {
            if let Some(inertia) = inertia {
                body.follow(&**inertia, &inertia.now());
            }
        }
    }

    fn put(&mut self, places: &[Similarity3<f64>]) {
        self.bodies.iter_mut().zip(places).for_each(|(body, place)| body.room_from_body = *place);
    }

    /// Goes the way in several steps, from these states and places of the bodies.
    fn go(
        &mut self,
        now: &Now,
        (before, placed): (&[DeformerState], &[Similarity3<f64>]),
        last: &[Placed],
        (known, way, near): (&[Places], &mut Way, &Near),
        inertias: &mut Inertias<'_>,
    ) {
        for (body, state) in self.bodies.iter_mut().zip(before) {
            if let Err(message) = body.free.restore(state) {
                self.warnings.push(message);
            }
        }
        self.put(placed);
        let mut from: Vec<Option<Isometry3<f64>>> = last.iter().map(Placed::surface).collect();
        let steps = near.meetings.len();
        for number in 0..steps {
            let share = (number + 1) as f64 / steps as f64;
            let starts = match number {
                0 => first_places(&near.all, known, &way.shown),
                _ => self.places(&near.all),
            };
            let tools = last.iter().zip(&now.tools);
            let to: Vec<_> = tools
                .map(|(last, new)| new.map(|new| pose_between(&last.pose.unwrap_or(new), &new, share)))
                .collect();
            let ends = now.ends.iter().zip(&now.places);
            for ((body, start), (end, place)) in
                self.bodies.iter_mut().zip(before.iter().zip(placed)).zip(ends)
            {
                if body.inertial.is_none() {
                    body.free.take(&poses_between(&start.0.poses, &end.poses, share));
                }
                body.room_from_body = place_between(start.1, place, share);
            }
            for (body, outline) in self.bodies.iter_mut().zip(&mut way.after) {
                if body.inertial.is_some() {
                    body.free.deform();
                    *outline = body.summed_places(&body.free);
                }
            }
            self.one_step([&from, &to], &starts, (way, near, number), (&mut *inertias, share));
            let shifted =
                |(to, tool): (&Option<Isometry3<f64>>, &Placed)| to.map(|to| shifted(&to, &tool.yielded));
            from = to.iter().zip(&self.motion.tools).map(shifted).collect();
        }
        for body in &mut self.bodies {
            body.free.deform();
        }
    }

    fn one_step(
        &mut self,
        [from, to]: [&[Option<Isometry3<f64>>]; 2],
        starts: &[Places],
        (way, near, number): (&Way, &Near, usize),
        (inertias, share): (&mut Inertias<'_>, f64),
    ) {
        // A tool that was nowhere comes from where it is.
        let from: Vec<_> = from.iter().zip(to).map(|(from, to)| from.or(*to)).collect();
        let step = Step {
            length_s: self.frame_s / near.meetings.len() as f64,
            tools: &self.tools,
            from: &from,
            to,
            starts,
            outlines: &way.after,
            by_tools: &near.by_tools,
            meetings: &near.meetings[number],
        };
        let Outcome { warnings, reached, is_unfinished } =
            advance(&mut self.bodies, (&mut *inertias, share), &mut self.motion.contacts, &step);
        inertial::keep(inertias);
        add_friction(&mut self.bodies, &self.motion.contacts, starts, near.meetings.len());
        let part = 1.0 / near.meetings.len() as f64;
        for number in 0..self.bodies.len() {
            let Some(turn) = self.bodies[number].turn_of_inertia() else { continue };
            for (node, force) in at_nodes(&self.bodies, &self.motion.contacts, number) {
                self.motion.pushed[number].push(Push { node, force: turn * force * part });
            }
        }
        for warning in warnings {
            if !self.warnings.contains(&warning) {
                self.warnings.push(warning);
            }
        }
        // Forces that are not found yet are sought on in the next frame.
        self.motion.is_settled = !is_unfinished && reached.is_none_or(|reached| reached.is_solved);
        for (t, tool) in self.tools.iter().enumerate() {
            let force = force_on_tool(t, &self.bodies, &self.motion.contacts);
            self.motion.tools[t].yielded = tool.stiffness.map_or_else(V3::zeros, |k| force / k);
        }
    }

    /// Warnings of tools whose stylus has not been seen since the start.
    fn unseen(&mut self, world: &World) -> Vec<String> {
        let now_s = *world.graph.get(world.fields.time);
        let is_late = now_s - *self.first_s.get_or_insert(now_s) > SEEN_S;
        let placed = self.tools.iter().zip(&self.motion.tools);
        let tools = placed.filter(|(_, placed)| is_late && placed.pose.is_none());
        let warning = |(tool, _): (&Tool, &Placed)| tool.place.unseen(&tool.name, SEEN_S, world);
        tools.filter_map(warning).collect()
    }

    /// Places in the room of all nodes of each body without contact.
    fn outlines(&self) -> Vec<Vec<V3>> {
        self.bodies.iter().map(|body| body.summed_places(&body.free)).collect()
    }

    /// Nodes of each body that have a share in contacts.
    fn nodes_of_contacts(&self) -> Vec<Arc<Nodes>> {
        let of = |(b, body): (usize, &TouchedBody)| {
            let nodes = self.motion.contacts.iter().flat_map(|contact| contact.nodes_of(b));
            Nodes::new(nodes.collect(), body.takes.len())
        };
        self.bodies.iter().enumerate().map(of).collect()
    }

    /// Places of nodes with the forces of the contacts, in the states that were taken last.
    fn places(&self, nodes: &[Arc<Nodes>]) -> Vec<Places> {
        let of = |(b, (body, nodes)): (usize, (&TouchedBody, &Arc<Nodes>))| {
            Places::free(body, nodes).moved(body, &at_nodes(&self.bodies, &self.motion.contacts, b))
        };
        self.bodies.iter().zip(nodes).enumerate().map(of).collect()
    }

    /// Has the columns of nodes that tools and surfaces come near solved for before they touch, the nearest to tools first.
    fn prepare_columns(&mut self, near: &[Arc<Nodes>], way: &Way, poses: &[Option<Isometry3<f64>>]) {
        for ((body, near), places) in self.bodies.iter_mut().zip(near).zip(&way.after) {
            let tools = self.tools.iter().zip(poses).zip(&body.tools).filter(|(_, touches)| **touches);
            let tools: Vec<_> = tools.filter_map(|((tool, pose), _)| Some((&tool.shape, (*pose)?))).collect();
            let gap = |node: u32| {
                let gaps = tools.iter().map(|(shape, pose)| distance(shape, pose, &places[node as usize]).0);
                gaps.fold(f64::INFINITY, f64::min)
            };
            let mut nodes: Vec<(f64, u32)> = near.iter().map(|node| (gap(node), node)).collect();
            nodes.sort_by(|(a, _), (b, _)| a.total_cmp(b));
            if let Err(message) = body.prepare(nodes.into_iter().map(|(_, node)| node).collect()) {
                self.warnings.push(message);
            }
        }
    }

    /// Drops the columns of nodes that nothing is near.
    fn forget_columns(&mut self, near: &[Arc<Nodes>]) {
        for (body, near) in self.bodies.iter_mut().zip(near) {
            body.keep(&|node| near.contains(node));
        }
    }
}

/// Places at the start of a frame: exact where contact was, as they were shown elsewhere.
fn first_places(near: &[Arc<Nodes>], known: &[Places], shown: &[Vec<V3>]) -> Vec<Places> {
    let of = |((near, known), shown): ((&Arc<Nodes>, &Places), &Vec<V3>)| {
        Places::new(near, |node| known.get(node).unwrap_or(shown[node as usize]))
    };
    near.iter().zip(known).zip(shown).map(of).collect()
}

impl RunningEffect for Contacts {
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
        inertias: &mut [&mut dyn Inertia],
    ) {
        self.step(world, contributions, inertias);
        for (number, body) in self.bodies.iter().enumerate() {
            for (spot, force) in at_spots(&self.bodies, &self.motion.contacts, number) {
                body.press(&spot, force, &mut contributions[body.b]);
            }
        }
    }

    fn reshaped(&mut self, world: &World, body: usize, kept: usize) -> Result<(), String> {
        let Some(number) = self.bodies.iter().position(|touched| touched.b == body) else { return Ok(()) };
        let is_kept = |contact: &Contact| contact.nodes_of(number).all(|node| (node as usize) < kept);
        self.motion.contacts.retain(is_kept);
        (self.motion.is_settled, self.motion.still) = (false, 0);
        self.felt.forget();
        self.bodies[number].reshape(&world.bodies[body].deformer, kept)?;
        let nodes = self.nodes_of_contacts();
        self.bodies[number].fetch(nodes[number].iter())
    }

    fn surface(&mut self, world: &World, bodies: &mut [BodyFrame]) {
        self.bodies.iter().for_each(|body| bodies[body.b].dissipation.add(&body.rubbed));
        if self.felt.tools().is_empty() {
            return;
        }
        let near = self.places(self.felt.near());
        for &t in self.felt.tools() {
            let placed = &self.motion.tools[t];
            let Some((hand, surface)) = placed.pose.zip(placed.surface()) else { continue };
            let touching = Touching { t, hand, surface, contacts: &self.motion.contacts, near: &near };
            match self.felt.touch(&touching, (&mut self.bodies, &self.tools), world) {
                Ok(Some((body, touch))) => bodies[self.bodies[body].b].touches.push(touch),
                Ok(None) => {}
                Err(warning) => self.warnings.push(warning),
            }
        }
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        frame.warnings.append(&mut self.warnings);
        let unseen = self.unseen(world);
        frame.warnings.extend(unseen);
        let places: Vec<_> = self.motion.tools.iter().map(Placed::surface).collect();
        let (bodies, tools, contacts) = (&self.bodies, &self.tools, &self.motion.contacts);
        Shown { bodies, tools, pairs: &self.pairs, places: &places, contacts }.show(world, frame);
    }

    fn memory(&self) -> Option<Memory> {
        let free = self.bodies.iter().map(TouchedBody::state).collect();
        written(&Motion { free, ..self.motion.clone() })
    }

    fn set_memory(&mut self, memory: &Memory) -> Result<(), String> {
        let motion: Motion = read(memory)?;
        if !motion.fits(&self.bodies, &self.tools, &self.pairs) {
            return Err("its tools and contacts are those of another scene".to_owned());
        }
        for (body, state) in self.bodies.iter_mut().zip(&motion.free) {
            body.free.restore(state)?;
            // With the last amplitudes, which those of the next frame replace.
            body.others.clone_from(body.free.contribution());
        }
        self.put(&motion.places);
        self.motion = Motion { free: Vec::new(), ..motion };
        let nodes = self.nodes_of_contacts();
        for (body, nodes) in self.bodies.iter_mut().zip(nodes) {
            body.fetch(nodes.iter())?;
        }
        self.felt.moved(self.nodes_of_contacts(), vec![0.0; self.tools.len()]);
        Ok(())
    }
}
