//! The way of a frame: how far bodies and tools move in it, in how many steps, and what can meet on it.
//!
//! In: places of all nodes before and after, and the tools at both. Out: the nodes that tools and surfaces can reach. Only what comes near a
//! body counts for it: a tool that is waved elsewhere costs nothing.

use super::candidates::Nodes;
use super::detection::distance;
use super::meeting::{Meeting, meetings};
use super::touched_body::TouchedBody;
use crate::base::extent::extent;
use crate::deform::ControlPose;
use crate::world::tool::{Tool, pose_between};
use nalgebra::{Isometry3, Similarity3, Vector3};
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Length of a step against the thickness of a tool or of a wall, and steps of a frame at most: what moves farther is put down anew.
const STEP: f64 = 0.5;
pub const MOST_STEPS: usize = 64;

/// Steps, at least, of a frame in which a body with inertia moves near something, and of one that is heard: a blow lasts one at least, and
/// excites modes up to about half of their rate.
const STEPS_OF_INERTIA: usize = 8;
const STEPS_OF_SOUND: usize = MOST_STEPS;
/// Way against the edges of a body up to which it rests.
const CALM: f64 = 1e-3;

/// Places in the room of all nodes of each body without contact before and after the frame, and as they were shown last; and by how far each
/// tool moves, m.
pub struct Way {
    pub before: Vec<Vec<V3>>,
    pub shown: Vec<Vec<V3>>,
    pub after: Vec<Vec<V3>>,
    pub tools: Vec<f64>,
}

/// Nodes and surfaces that can meet on the way.
pub struct Near {
    /// Nodes of each body that tools can meet.
    pub by_tools: Vec<Arc<Nodes>>,
    /// Nodes that tools or surfaces can meet, and those of contacts.
    pub all: Vec<Arc<Nodes>>,
    /// Nodes that can meet surfaces in each step.
    pub meetings: Vec<Vec<Meeting>>,
    /// False where something has jumped: it is put down in one step.
    pub is_followed: bool,
}

/// Bodies and tools at the start of a frame.
pub struct Start<'a> {
    pub bodies: &'a [TouchedBody],
    pub tools: &'a [Tool],
    pub pairs: &'a [[usize; 2]],
    /// Surfaces of the tools; of one that was nowhere, where it is now.
    pub places: &'a [Option<Isometry3<f64>>],
    /// Nodes of contacts.
    pub held: &'a [Arc<Nodes>],
}

impl Start<'_> {
    pub fn near(&self, way: &Way) -> Near {
        let mut reaching = vec![vec![false; self.tools.len()]; self.bodies.len()];
        let reached = |(b, own): (usize, &mut Vec<bool>)| self.reached_by_tools(b, own, way);
        let by_tools: Vec<Vec<u32>> = reaching.iter_mut().enumerate().map(reached).collect();
        let pushes = |b: usize| way.fastest(&reaching[b]);
        let together: Vec<_> =
            self.pairs.iter().filter_map(|pair| self.together(*pair, &pushes, way)).collect();
        let walls = together.iter().map(|(pair, travel)| {
            let wall = pair.map(|b| self.bodies[b].thickness()).into_iter().fold(f64::INFINITY, f64::min);
            travel / (STEP * wall).max(f64::MIN_POSITIVE)
        });
        let steps = walls.fold(self.steps_of_tools(&by_tools, &reaching, way), f64::max).ceil() as usize;
        let has_inertia = |b: usize| self.bodies[b].inertial.is_some();
        let moves = |b: usize, way: f64| has_inertia(b) && way > CALM * self.bodies[b].longest();
        let travel = |b: usize| {
            let near = by_tools[b].iter().copied().chain(self.held[b].iter());
            let own = near.map(|node| way.of(b, node as usize)).fold(pushes(b), f64::max);
            let met = together.iter().filter(|(pair, _)| pair.contains(&b)).map(|(_, travel)| *travel);
            met.fold(own, f64::max)
        };
        let lively = (0..self.bodies.len()).filter(|b| moves(*b, travel(*b)));
        let of_lively = |b: usize| if self.bodies[b].is_heard { STEPS_OF_SOUND } else { STEPS_OF_INERTIA };
        let steps = lively.map(of_lively).fold(steps, usize::max);
        let is_followed = steps <= MOST_STEPS;
        let meetings = match is_followed {
            true => (0..steps).map(|step| self.meetings(&together, way, [step, steps])).collect(),
            false => vec![self.meetings(&together, way, [1, 1])],
        };
        let all = (0..self.bodies.len()).map(|b| self.candidates(b, &by_tools[b], &meetings)).collect();
        let nodes =
            by_tools.into_iter().zip(self.bodies).map(|(list, body)| Nodes::new(list, body.takes.len()));
        Near { by_tools: nodes.collect(), all, meetings, is_followed }
    }

    /// Nodes of a body that tools can meet; marks the tools that reach it.
    fn reached_by_tools(&self, b: usize, reaching: &mut [bool], way: &Way) -> Vec<u32> {
        let body = &self.bodies[b];
        let mut is_near = |node: &u32| {
            let at = *node as usize;
            let reach = body.longest() + (way.after[b][at] - way.before[b][at]).norm();
            let mut is_reached = false;
            for (t, tool) in self.tools.iter().enumerate().filter(|(t, _)| body.tools[*t]) {
                let Some(pose) = &self.places[t] else { continue };
                if distance(&tool.shape, pose, &way.shown[b][at]).0 < reach + way.tools[t] {
                    (is_reached, reaching[t]) = (true, true);
                }
            }
            is_reached
        };
        (0..body.takes.len() as u32).filter(|node| is_near(node)).collect()
    }

    /// Steps that the tools need, 1 at least.
    fn steps_of_tools(&self, by_tools: &[Vec<u32>], reaching: &[Vec<bool>], way: &Way) -> f64 {
        let mut most = 1.0_f64;
        for (b, nodes) in by_tools.iter().enumerate().filter(|(_, nodes)| !nodes.is_empty()) {
            let travel = nodes.iter().map(|node| way.of(b, *node as usize)).fold(0.0, f64::max);
            for (t, tool) in self.tools.iter().enumerate().filter(|(t, _)| reaching[b][*t]) {
                most = most.max((way.tools[t] + travel) / (STEP * tool.shape.thickness()));
            }
        }
        most
    }

    /// A pair of bodies that come near each other, and by how far they move there, m.
    fn together(
        &self,
        pair: [usize; 2],
        pushes: &dyn Fn(usize) -> f64,
        way: &Way,
    ) -> Option<([usize; 2], f64)> {
        let push = pair.map(pushes).into_iter().fold(0.0, f64::max);
        let edge = self.edge(pair);
        let towards = |one: usize, other: usize| way.travel_near(one, other, edge + push);
        let travel = towards(pair[0], pair[1])? + towards(pair[1], pair[0])?;
        Some((pair, travel + push))
    }

    fn edge(&self, pair: [usize; 2]) -> f64 {
        pair.map(|b| self.bodies[b].longest()).into_iter().fold(0.0, f64::max)
    }

    /// Nodes that can meet surfaces in one of several steps.
    fn meetings(&self, together: &[([usize; 2], f64)], way: &Way, [step, steps]: [usize; 2]) -> Vec<Meeting> {
        let places: Vec<Vec<V3>> = match together.is_empty() {
            true => return Vec::new(),
            false => (0..self.bodies.len()).map(|b| way.on_it(b, step as f64 / steps as f64)).collect(),
        };
        let of = |(pair, travel): &([usize; 2], f64)| {
            let way = if step == steps { 0.0 } else { travel / steps as f64 };
            meetings(self.bodies, *pair, &places, self.edge(*pair) + way)
        };
        together.iter().flat_map(of).collect()
    }

    fn candidates(&self, b: usize, by_tools: &[u32], meetings: &[Vec<Meeting>]) -> Arc<Nodes> {
        let body = &self.bodies[b];
        let mut all: Vec<u32> = by_tools.iter().copied().chain(self.held[b].iter()).collect();
        for meeting in meetings.iter().flatten() {
            if meeting.body == b {
                all.extend(body.with_neighbours(meeting.node));
            }
            if meeting.other == b {
                all.extend(meeting.corners(self.bodies));
            }
        }
        Nodes::new(all, body.takes.len())
    }
}

impl Way {
    /// Way of a node of a body, m.
    fn of(&self, b: usize, node: usize) -> f64 {
        (self.after[b][node] - self.before[b][node]).norm()
    }

    /// Longest way of the tools that are marked, m.
    fn fastest(&self, marked: &[bool]) -> f64 {
        let tools = self.tools.iter().zip(marked).filter(|(_, marked)| **marked);
        tools.map(|(way, _)| *way).fold(0.0, f64::max)
    }

    /// Longest way of the nodes of a body that come within `reach` of the box about another one; `None` where none does.
    fn travel_near(&self, b: usize, other: usize, reach: f64) -> Option<f64> {
        let (low, high) = extent(self.shown[other].iter().chain(&self.after[other]).copied())?;
        let (low, high) = (low - V3::repeat(reach), high + V3::repeat(reach));
        let comes_near = |node: &usize| {
            let (from, to) = (self.shown[b][*node], self.after[b][*node]);
            let (least, most) = (from.inf(&to), from.sup(&to));
            (0..3).all(|axis| least[axis] <= high[axis] && most[axis] >= low[axis])
        };
        let near = (0..self.after[b].len()).filter(comes_near).map(|node| self.of(b, node));
        near.reduce(f64::max)
    }

    /// Places of a body's nodes about after this share of the way.
    fn on_it(&self, b: usize, share: f64) -> Vec<V3> {
        if share == 1.0 {
            return self.after[b].clone();
        }
        let ways = self.after[b].iter().zip(&self.before[b]);
        self.shown[b]
            .iter()
            .zip(ways)
            .map(|(shown, (after, before))| shown + (after - before) * share)
            .collect()
    }
}

/// Longest way of a point of a tool, m.
pub fn tool_way(tool: &Tool, last: Option<Isometry3<f64>>, new: Option<Isometry3<f64>>) -> f64 {
    let Some((last, new)) = last.zip(new) else { return 0.0 };
    let turn = last.rotation.angle_to(&new.rotation);
    (new.translation.vector - last.translation.vector).norm() + tool.shape.reach() * turn
}

/// Poses on the way from one list to another.
pub fn poses_between(from: &[ControlPose], to: &[ControlPose], share: f64) -> Vec<ControlPose> {
    let of = |(from, to): (&ControlPose, &ControlPose)| ControlPose {
        translation: from.translation.lerp(&to.translation, share),
        matrix: from.matrix + (to.matrix - from.matrix) * share,
    };
    if share == 1.0 { to.to_vec() } else { from.iter().zip(to).map(of).collect() }
}

/// Place of a body on the way from one to another.
pub fn place_between(from: &Similarity3<f64>, to: &Similarity3<f64>, share: f64) -> Similarity3<f64> {
    if share == 1.0 || from == to {
        return *to;
    }
    let scaling = from.scaling() + (to.scaling() - from.scaling()) * share;
    Similarity3::from_isometry(pose_between(&from.isometry, &to.isometry, share), scaling)
}

/// Whether all bodies have been moved alike, as by navigation: then they have not moved against each other.
pub fn are_moved_alike(from: &[Similarity3<f64>], to: &[Similarity3<f64>]) -> bool {
    let motion = |(from, to): (&Similarity3<f64>, &Similarity3<f64>)| to * from.inverse();
    let mut motions = from.iter().zip(to).map(motion);
    let Some(first) = motions.next() else { return true };
    let is_alike = |other: Similarity3<f64>| (other.to_homogeneous() - first.to_homogeneous()).amax() < 1e-9;
    motions.all(is_alike)
}
