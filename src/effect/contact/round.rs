//! One round: where the bodies are, what touches there, and the gaps.
//!
//! Between surfaces the nodes of the finer one are held back; nodes of the other, and edges, where they pass through nevertheless.

use super::candidates::{Nodes, Places};
use super::crossing::{Side, apart, crossing, edge_of, near_edges, pass_through};
use super::detection::{distance, find};
use super::meeting::{Meeting, Met};
use super::slides::Slides;
use super::touch::{Against, Contact, shifted};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::solve::cone::Reached;
use crate::world::tool::Tool;
use nalgebra::{Isometry3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Parts of a tool's thickness, and of a surface's edges, by which a gap may be off.
const EXACT: f64 = 1e-5;
const EXACT_SURFACE: f64 = 2e-4;
/// Part of an edge by which nodes of the coarser of two surfaces, and edges, may pass into the other: as much as rounds one between its
/// nodes.
const BETWEEN_NODES: f64 = 0.02;
/// Contacts at most: beyond, a step would take longer than a frame.
const MOST_CONTACTS: usize = 600;

/// Speed with which bodies with inertia that reach into each other are brought apart, m/s.
const RECOVERY: f64 = 0.05;

/// Data of a step beside the bodies.
pub struct Step<'a> {
    /// s; 0 where no body has inertia.
    pub length_s: f64,
    pub tools: &'a [Tool],
    /// Poses of the tools' surfaces at the start, and of the tools as hands put them at the end; `None` for one that is not there.
    pub from: &'a [Option<Isometry3<f64>>],
    pub to: &'a [Option<Isometry3<f64>>],
    /// Places of each body's candidates at the start, and of all of its nodes without contact at about the end of the frame.
    pub starts: &'a [Places],
    pub outlines: &'a [Vec<V3>],
    /// Nodes of each body that tools can meet.
    pub by_tools: &'a [Arc<Nodes>],
    /// Nodes that can meet surfaces.
    pub meetings: &'a [Meeting],
}

/// Results of a step beside the contacts' forces.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    pub warnings: Vec<String>,
    pub reached: Option<Reached>,
    /// Whether the next frame has to look again: surfaces had passed through each other between the nodes that were held back, or a node
    /// has slid off an end.
    pub is_unfinished: bool,
}

impl Outcome {
    pub fn warn(&mut self, warning: String) {
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }
}

/// The bodies in a round.
pub struct Round<'a> {
    pub bodies: &'a [TouchedBody],
    pub step: &'a Step<'a>,
    pub places: &'a [Places],
    /// Shifts of the tools.
    pub yielded: &'a [V3],
}

impl Round<'_> {
    /// Error that the gap of a contact may have, m.
    pub fn tolerance(&self, contact: &Contact) -> f64 {
        let own = self.bodies[contact.body].longest();
        match contact.against {
            Against::Tool(tool) => EXACT * own.min(self.step.tools[tool].shape.thickness()),
            Against::Surface { body, .. } => EXACT_SURFACE * own.min(self.bodies[body].longest()),
        }
    }

    fn place_of(&self, body: usize, node: u32) -> V3 {
        self.places[body].get(node).unwrap_or_else(|| self.step.outlines[body][node as usize])
    }

    /// The gap of a contact, and the direction in which it opens.
    pub fn gap(&self, contact: &Contact) -> (f64, V3) {
        let x = self.places[contact.body].of(&contact.spot);
        match contact.against {
            Against::Tool(tool) => {
                let pose = shifted(&self.step.to[tool].unwrap_or_default(), &self.yielded[tool]);
                distance(&self.step.tools[tool].shape, &pose, &x)
            }
            Against::Surface { body, spot } => {
                let at = |node: u32| self.place_of(body, node);
                let crossed = edge_of(&contact.spot).zip(edge_of(&spot)).map(|(own, other)| {
                    let own_at = |node: u32| self.place_of(contact.body, node);
                    let side = |body: usize, place| Side { body: &self.bodies[body], place };
                    apart(&[side(contact.body, &own_at), side(body, &at)], [own, other])
                });
                let normal = crossed.unwrap_or_else(|| self.bodies[body].normal(&spot, &at));
                (normal.dot(&(x - self.places[body].of(&spot))), normal)
            }
        }
    }

    /// Opening of a contact beyond its present gap if there were no contact, and its slip since the step began.
    pub fn without(&self, contact: &Contact, free: &[Places]) -> (V3, V3) {
        let step = self.step;
        let all = |body: usize, spot: &SurfaceSpot| {
            let [now, without, start] = [self.places, free, step.starts].map(|places| places[body].of(spot));
            [now, without - self.bodies[body].moved_by_inertia(spot), start]
        };
        let [now, without, start] = all(contact.body, &contact.spot);
        match contact.against {
            Against::Tool(tool) => {
                let pose = step.to[tool].unwrap_or_default();
                // The point of the tool that was there at the start, where the tool would be without its spring's yielding.
                let from = step.from[tool].unwrap_or(pose);
                let carried = pose * from.inverse_transform_point(&start.into());
                (without - now + self.yielded[tool], without - carried.coords)
            }
            Against::Surface { body, spot } => {
                let [other_now, other_without, other_start] = all(body, &spot);
                (
                    (without - now) - (other_without - other_now),
                    (without - start) - (other_without - other_start),
                )
            }
        }
    }

    /// Gap to which a step leads a contact at least: of a body with inertia that was pressed in before the step, less than 0, so that
    /// it comes out no faster than [`RECOVERY`].
    pub fn wanted(&self, contact: &Contact) -> f64 {
        if !contact.lives(self.bodies) {
            return 0.0;
        }
        let start = self.step.starts[contact.body].of(&contact.spot);
        let gap = match contact.against {
            Against::Tool(tool) => {
                let pose = self.step.from[tool].or(self.step.to[tool]).unwrap_or_default();
                distance(&self.step.tools[tool].shape, &pose, &start).0
            }
            Against::Surface { body, spot } => {
                let (_, normal) = self.gap(contact);
                normal.dot(&(start - self.step.starts[body].of(&spot)))
            }
        };
        (gap + RECOVERY * self.step.length_s).min(0.0)
    }

    /// Whether the gaps of contacts are these.
    pub fn has_gaps(&self, contacts: &[Contact], gaps: &[f64]) -> bool {
        contacts
            .iter()
            .zip(gaps)
            .all(|(contact, gap)| (self.gap(contact).0 - gap).abs() <= self.tolerance(contact))
    }

    /// Adds contacts where a tool touches a body, and moves those whose nearest point has moved. True if one of them has reached into the body
    /// by more than its gap may be off.
    pub fn meet_tools(
        &self,
        contacts: &mut Vec<Contact>,
        slides: &mut Slides,
        outcome: &mut Outcome,
    ) -> bool {
        let mut has_changed = false;
        let step = self.step;
        for (number, body) in self.bodies.iter().enumerate() {
            for (t, tool) in step.tools.iter().enumerate().filter(|(t, _)| body.tools[*t]) {
                let Some(pose) = &step.to[t] else { continue };
                let pose = shifted(pose, &self.yielded[t]);
                let near = EXACT * tool.shape.thickness().min(body.longest());
                let candidates = (&*step.by_tools[number], &self.places[number]);
                let found = find(&tool.shape, &pose, body, candidates, &step.outlines[number], near);
                let name = &body.free.body;
                if found.meets_stiff {
                    outcome.warn(format!(
                        "tool.{}: it reaches into nodes of body.{name} that do not yield: those of a control element, or such as \
                         surface_compliance leaves out",
                        tool.name
                    ));
                }
                let is_of = |contact: &Contact| (contact.body, contact.tool()) == (number, Some(t));
                if found.is_within && !contacts.iter().any(is_of) {
                    outcome.warn(format!(
                        "tool.{}: it is inside body.{name}, and touches it once it has come out",
                        tool.name
                    ));
                }
                let gap = |spot: &SurfaceSpot| distance(&tool.shape, &pose, &self.places[number].of(spot)).0;
                for spot in found.spots {
                    let is_same = |contact: &&mut Contact| is_of(contact) && contact.spot.nodes == spot.nodes;
                    match contacts.iter_mut().find(is_same) {
                        // The nearest point of the same triangle, or of the same edge.
                        Some(contact) if gap(&spot) < gap(&contact.spot) - near => {
                            contact.spot = slides.towards((number, t), &contact.spot, &spot);
                            has_changed = true;
                        }
                        Some(_) => {}
                        None => {
                            has_changed |= gap(&spot) < -near;
                            add(contacts, number, spot, Against::Tool(t), outcome);
                        }
                    }
                }
            }
        }
        has_changed
    }

    /// Adds contacts where nodes of the finer of two surfaces reach the other, and moves those whose nearest point has moved; lets go what
    /// nothing faces any more, where the step begins. True if any has come, gone or moved.
    pub fn meet_surfaces(
        &self,
        contacts: &mut Vec<Contact>,
        watch: &mut Watch,
        begins: bool,
        outcome: &mut Outcome,
    ) -> bool {
        let before = contacts.len();
        let mut own = of_nodes(contacts);
        let (mut has_moved, mut gone) = (false, Vec::new());
        for (number, meeting) in self.step.meetings.iter().enumerate() {
            let known = own.remove(&key(meeting));
            if known.is_none() && (!self.leads(meeting) || watch.is_far(number, 0.0)) {
                continue;
            }
            let near = known.map_or(EXACT_SURFACE * self.edge(meeting), |_| f64::INFINITY);
            let met = meeting.met(self.bodies, self.places, self.step.outlines);
            watch.see(number, &met);
            match (known, met.filter(|met| met.is_before && met.gap < near)) {
                (Some(known), Some(Met { spot, gap, yields: true, .. })) => {
                    has_moved |= self.has_slid(&contacts[known], gap);
                    contacts[known].against = Against::Surface { body: meeting.other, spot };
                }
                (Some(known), _) => gone.push(known),
                (None, Some(met)) => self.meet(meeting, &met, contacts, outcome),
                (None, None) => {}
            }
        }
        gone.extend(own.into_values());
        has_moved |= self.follow_edges(contacts, &mut gone);
        outcome.is_unfinished |= !begins && !gone.is_empty();
        has_moved |= contacts.len() != before;
        if begins && !gone.is_empty() {
            has_moved = true;
            gone.sort_unstable();
            gone.into_iter().rev().for_each(|i| {
                contacts.remove(i);
            });
        }
        has_moved
    }

    /// Moves contacts of edges to where these cross now. True if any has moved; those that cross no more are added to `gone`.
    fn follow_edges(&self, contacts: &mut [Contact], gone: &mut Vec<usize>) -> bool {
        let mut has_moved = false;
        for (i, contact) in contacts.iter_mut().enumerate() {
            let Some((bodies, edges)) = crossed_edges(contact) else { continue };
            let places = bodies.map(|body| move |node: u32| self.place_of(body, node));
            let sides = [0, 1].map(|k| Side { body: &self.bodies[bodies[k]], place: &places[k] });
            match crossing(&sides, edges) {
                Some(([spot, across], gap)) => {
                    has_moved |= self.has_slid(contact, gap);
                    contact.spot = spot;
                    contact.against = Against::Surface { body: bodies[1], spot: across };
                }
                None => gone.push(i),
            }
        }
        has_moved
    }

    /// Adds contacts where surfaces have passed through each other between the nodes that are held back: at nodes of the coarser one, and where
    /// edges cross. True if there are any.
    pub fn pass_surfaces(&self, contacts: &mut Vec<Contact>, watch: &Watch, outcome: &mut Outcome) -> bool {
        let before = contacts.len();
        let own = of_nodes(contacts);
        for (number, meeting) in self.step.meetings.iter().enumerate() {
            let edge = self.edge(meeting);
            if self.leads(meeting) {
                // An edge reaches as far as its length from its node.
                let longest = self.bodies[meeting.body].longest();
                if !watch.is_far(number, longest + edge) {
                    self.cross(meeting, -BETWEEN_NODES * edge, contacts, outcome);
                }
            } else if !own.contains_key(&key(meeting))
                && let Some(met) = meeting.met(self.bodies, self.places, self.step.outlines)
                && (met.is_before && met.gap < -BETWEEN_NODES * edge)
            {
                self.meet(meeting, &met, contacts, outcome);
            }
        }
        outcome.is_unfinished |= contacts.len() != before;
        contacts.len() != before
    }

    /// Length of the edges of the finer of two surfaces, m.
    fn edge(&self, meeting: &Meeting) -> f64 {
        self.bodies[meeting.body].longest().min(self.bodies[meeting.other].longest())
    }

    fn leads(&self, meeting: &Meeting) -> bool {
        leads(self.bodies, [meeting.body, meeting.other])
    }

    /// Whether the nearest point of a contact, where its gap is this, is another than it was.
    fn has_slid(&self, contact: &Contact, gap: f64) -> bool {
        (gap - self.gap(contact).0).abs() > self.tolerance(contact)
    }

    /// Adds the contact of a node with a surface, or tells why there can be none.
    fn meet(&self, meeting: &Meeting, met: &Met, contacts: &mut Vec<Contact>, outcome: &mut Outcome) {
        let Meeting { body, node, other, .. } = *meeting;
        if met.yields {
            let against = Against::Surface { body: other, spot: met.spot };
            add(contacts, body, SurfaceSpot::node(node), against, outcome);
        } else if met.gap < -BETWEEN_NODES * self.edge(meeting) {
            let [one, two] = [body, other].map(|body| &self.bodies[body].free.body);
            outcome.warn(format!(
                "body.{one} reaches into body.{two} where one of them does not yield: at the nodes of a control element, or such as \
                 surface_compliance leaves out"
            ));
        }
    }

    /// Adds contacts of edges that have passed through each other by more than `-near`, m.
    fn cross(&self, meeting: &Meeting, near: f64, contacts: &mut Vec<Contact>, outcome: &mut Outcome) {
        let bodies = [meeting.body, meeting.other];
        let deepest =
            bodies.map(|body| self.bodies[body].thickness()).into_iter().fold(f64::INFINITY, f64::min);
        let places = bodies.map(|body| move |node: u32| self.place_of(body, node));
        let sides = [0, 1].map(|k| Side { body: &self.bodies[bodies[k]], place: &places[k] });
        for edges in near_edges(meeting, &sides, deepest.min(self.edge(meeting))) {
            let Some((spots, gap)) = crossing(&sides, edges) else { continue };
            let takes = |k: usize| edges[k].iter().all(|node| sides[k].body.takes[*node as usize]);
            let is_through = gap < near && gap > -deepest && takes(0) && takes(1);
            if !is_through || !pass_through(&sides, edges) {
                continue;
            }
            if !contacts.iter().any(|contact| crossed_edges(contact) == Some((bodies, edges))) {
                let against = Against::Surface { body: bodies[1], spot: spots[1] };
                add(contacts, bodies[0], spots[0], against, outcome);
            }
        }
    }
}

/// Distances of nodes as the rounds of a step have found them: those far away are not looked at again.
pub struct Watch {
    /// Way of each meeting, summed over both sides, within which nothing touches there, m.
    clear: Vec<f64>,
    /// Longest way of a place since the step began, summed over both sides, m.
    way: f64,
}

impl Watch {
    pub fn new(meetings: usize) -> Watch {
        Watch { clear: vec![0.0; meetings], way: 0.0 }
    }

    /// Takes note that places have moved.
    pub fn moved(&mut self, from: &[Places], to: &[Places]) {
        let way = |(from, to): (&Places, &Places)| from.farthest(to);
        self.way += 2.0 * from.iter().zip(to).map(way).fold(0.0, f64::max);
    }

    /// Whether a node is still farther than this from what it can meet.
    fn is_far(&self, meeting: usize, far: f64) -> bool {
        self.clear[meeting] > self.way + far
    }

    /// Takes where a node is; one that faces nothing does not do so within a step.
    fn see(&mut self, meeting: usize, met: &Option<Met>) {
        self.clear[meeting] = match met {
            Some(met) if met.is_before => self.way + met.gap.max(0.0),
            Some(_) => self.way,
            None => f64::INFINITY,
        };
    }
}

/// Body and node of a contact, and the other body.
type Key = (usize, u32, usize);

fn key(meeting: &Meeting) -> Key {
    (meeting.body, meeting.node, meeting.other)
}

/// Places in the list of the contacts of single nodes with surfaces.
fn of_nodes(contacts: &[Contact]) -> BTreeMap<Key, usize> {
    let of = |(i, contact): (usize, &Contact)| {
        let (other, _) = contact.other()?;
        let node = contact.spot.nodes[0];
        (contact.spot == SurfaceSpot::node(node)).then_some(((contact.body, node, other), i))
    };
    contacts.iter().enumerate().filter_map(of).collect()
}

/// The bodies and edges of a contact of edges.
fn crossed_edges(contact: &Contact) -> Option<([usize; 2], [[u32; 2]; 2])> {
    let (other, spot) = contact.other()?;
    Some(([contact.body, other], [edge_of(&contact.spot)?, edge_of(&spot)?]))
}

/// Whether the nodes of the first body are held back by the surface of the second, and not the other way round.
pub fn leads(bodies: &[TouchedBody], [one, two]: [usize; 2]) -> bool {
    let fineness = |body: usize| (bodies[body].longest(), body);
    fineness(one) <= fineness(two)
}

/// Adds a contact while there is room.
fn add(contacts: &mut Vec<Contact>, body: usize, spot: SurfaceSpot, against: Against, outcome: &mut Outcome) {
    if contacts.len() < MOST_CONTACTS {
        contacts.push(Contact::new(body, spot, against));
        return;
    }
    outcome.warn(format!(
        "contact: more than {MOST_CONTACTS} nodes touch, of which the first are held back; a coarser surface has fewer"
    ));
}
