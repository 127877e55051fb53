//! One step: contacts, their compliance, and the forces that hold them apart.
//!
//! In: the touched bodies without contact at the end of a step, places of their candidate nodes at its start, and the tools at both.
//! Out: the contacts with their forces. With x = x_free + C f the gap of a contact, linear about the last place x', is
//!
//! ```text
//! d_n = d_n(x') + n·(x - x')        d_t = what x has moved against what it touches since the start of the step
//! ```
//!
//! with φ(x') and ∇φ of a tool, and n·(x' - y') to a spot y of a surface, which moves too. A tool on a spring of stiffness k yields by
//! its force over k, by which all of its contacts move together. Detection and solution alternate until the set of contacts stays and
//! they stand where their gaps were taken. Between surfaces the nodes of the finer one are held back; those of the other where they
//! pass through nevertheless.

use super::contact::{
    Against, Contact, Places, at_nodes, between, fetch, force_on_tool, friction, place, shifted, turns,
};
use super::crossing::{Side, apart, crossing, edge_of, edges_of, pass_through};
use super::detection::{distance, find};
use super::meeting::{Meeting, Met};
use super::tool::Tool;
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::base::quantity::quantity;
use crate::deform::contact_axes;
use crate::solve::cone::{Cone, Reached};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Vector3};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Rounds of detection and solution at most, and the part of a tool's thickness by which a gap may be off at their end.
const MOST_ROUNDS: usize = 12;
const EXACT: f64 = 1e-5;
/// Part of its own compliance by which a spot between nodes yields more.
const SKIN: f64 = 1e-3;
/// Change of a spot's weights by which it has moved.
const SHIFT: f64 = 1e-4;
/// Part of an edge by which nodes of the coarser of two surfaces may pass into the finer one: as much as rounds one between its nodes.
const BETWEEN_NODES: f64 = 0.02;
/// Contacts at most: beyond, a step would take longer than a frame.
pub const MOST_CONTACTS: usize = 600;

/// Data of a step beside the bodies.
pub struct Step<'a> {
    pub tools: &'a [Tool],
    /// Poses of the tools' surfaces at the start, and of the tools as hands put them at the end; `None` for one that is not there.
    pub from: &'a [Option<Isometry3<f64>>],
    pub to: &'a [Option<Isometry3<f64>>],
    /// Places of each body's candidates at the start, and of all of its nodes without contact at about the end of the frame.
    pub starts: &'a [BTreeMap<u32, V3>],
    pub outlines: &'a [Vec<V3>],
    /// Nodes that can meet surfaces.
    pub meetings: &'a [Meeting],
}

/// Results of a step beside the contacts' forces.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    pub warnings: Vec<String>,
    pub reached: Option<Reached>,
}

/// Brings the contacts to the end of a step.
pub fn advance(bodies: &mut [TouchedBody], contacts: &mut Vec<Contact>, step: &Step<'_>) -> Outcome {
    let mut outcome = Outcome::default();
    contacts.retain(|contact| contact.tool().is_none_or(|tool| step.to[tool].is_some()));
    let free: Vec<Places> = bodies
        .iter()
        .zip(step.starts)
        .map(|(body, starts)| starts.keys().map(|node| (*node, body.free_place(*node))).collect())
        .collect();
    let mut is_settled = false;
    for round in 0..MOST_ROUNDS {
        let places = with_contact(bodies, contacts, &free);
        let yielded: Vec<V3> =
            (0..step.tools.len()).map(|tool| yielded(tool, bodies, contacts, step)).collect();
        let now = Now { bodies, step, places: &places, yielded: &yielded };
        let mut found = now.meet_tools(contacts, &mut outcome);
        found |= now.meet_surfaces(contacts, (round == 0, is_settled), &mut outcome);
        if let Err(warning) = fetch(bodies, contacts) {
            outcome.warnings.push(warning);
            contacts.clear();
            return outcome;
        }
        if contacts.is_empty() {
            if is_settled || !step.meets_surfaces() {
                return outcome;
            }
            is_settled = true;
            continue;
        }
        let now = Now { bodies, step, places: &places, yielded: &yielded };
        let (is_exact, reached) = solve(&now, contacts, &free);
        outcome.reached = Some(reached);
        let was_settled = std::mem::replace(&mut is_settled, !found && is_exact);
        if is_settled && (was_settled || !step.meets_surfaces() && round > 0) {
            break;
        }
    }
    contacts.retain(|contact| contact.force != V3::zeros());
    if let Some(Reached { missed, largest, .. }) = outcome.reached.filter(|reached| reached.is_far()) {
        outcome.warnings.push(format!(
            "contact: no forces were found in this frame that hold {} contacts apart: they miss it by {} of {}",
            contacts.len(),
            quantity(missed, "m"),
            quantity(largest, "m")
        ));
    }
    outcome
}

/// Places of all candidates with the forces of the contacts.
fn with_contact(bodies: &[TouchedBody], contacts: &[Contact], free: &[Places]) -> Vec<Places> {
    let of = |(number, (body, free)): (usize, (&TouchedBody, &Places))| {
        let moved = body.moved(&at_nodes(bodies, contacts, number));
        free.iter().map(|(node, x)| (*node, x + moved(*node))).collect()
    };
    bodies.iter().zip(free).enumerate().map(of).collect()
}

/// Places of the contacts' nodes with the forces of the contacts.
fn of_contacts(bodies: &[TouchedBody], contacts: &[Contact], free: &[Places]) -> Vec<Places> {
    let own = |(number, free): (usize, &Places)| -> Places {
        let nodes = contacts.iter().flat_map(|contact| contact.nodes_of(number));
        nodes.map(|node| (node, free[&node])).collect()
    };
    with_contact(bodies, contacts, &free.iter().enumerate().map(own).collect::<Vec<_>>())
}

/// Shift of a tool by which its spring has yielded to its force, in the room, m.
fn yielded(tool: usize, bodies: &[TouchedBody], contacts: &[Contact], step: &Step<'_>) -> V3 {
    step.tools[tool].stiffness.map_or_else(V3::zeros, |k| force_on_tool(tool, bodies, contacts) / k)
}

impl Step<'_> {
    fn meets_surfaces(&self) -> bool {
        !self.meetings.is_empty()
    }
}

/// The bodies in a round.
struct Now<'a> {
    bodies: &'a [TouchedBody],
    step: &'a Step<'a>,
    places: &'a [Places],
    /// Shifts of the tools.
    yielded: &'a [V3],
}

impl Now<'_> {
    /// A length against which a gap of a contact is exact, m.
    fn size(&self, contact: &Contact) -> f64 {
        let own = self.bodies[contact.body].longest();
        match contact.against {
            Against::Tool(tool) => own.min(self.step.tools[tool].shape.thickness()),
            Against::Surface { body, .. } => own.min(self.bodies[body].longest()),
        }
    }

    fn place_of(&self, body: usize, node: u32) -> V3 {
        let known = self.places[body].get(&node).copied();
        known.unwrap_or_else(|| self.step.outlines[body][node as usize])
    }

    /// The gap of a contact, and the direction in which it opens.
    fn gap(&self, contact: &Contact) -> (f64, V3) {
        let x = place(&self.places[contact.body], &contact.spot);
        match contact.against {
            Against::Tool(tool) => {
                let pose = shifted(&self.step.to[tool].unwrap_or_default(), &self.yielded[tool]);
                distance(&self.step.tools[tool].shape, &pose, &x)
            }
            Against::Surface { body, spot } => {
                let at = |node: u32| self.place_of(body, node);
                let crossed = edge_of(&contact.spot).zip(edge_of(&spot)).and_then(|(own, other)| {
                    let own_at = |node: u32| self.place_of(contact.body, node);
                    let side = |body: usize, place| Side { body: &self.bodies[body], place };
                    apart(&[side(contact.body, &own_at), side(body, &at)], [own, other])
                });
                let normal = crossed.unwrap_or_else(|| self.bodies[body].normal(&spot, &at));
                (normal.dot(&(x - place(&self.places[body], &spot))), normal)
            }
        }
    }

    /// Adds contacts where a tool reaches into a body, and moves those whose nearest point has moved. True if there are any.
    fn meet_tools(&self, contacts: &mut Vec<Contact>, outcome: &mut Outcome) -> bool {
        let (before, mut has_moved) = (contacts.len(), false);
        let step = self.step;
        for (number, body) in self.bodies.iter().enumerate() {
            for (t, tool) in step.tools.iter().enumerate().filter(|(t, _)| body.tools[*t]) {
                let Some(pose) = &step.to[t] else { continue };
                let pose = shifted(pose, &self.yielded[t]);
                let near = EXACT * tool.shape.thickness().min(body.longest());
                let found =
                    find(&tool.shape, &pose, body, &self.places[number], &step.outlines[number], near);
                let name = &body.free.body;
                if found.meets_stiff {
                    outcome.warnings.push(format!(
                        "tool.{}: it reaches into nodes of body.{name} that do not yield: those of a control element, or such as \
                         surface_compliance leaves out",
                        tool.name
                    ));
                }
                let is_of = |contact: &Contact| (contact.body, contact.tool()) == (number, Some(t));
                if found.is_within && !contacts.iter().any(is_of) {
                    outcome.warnings.push(format!(
                        "tool.{}: it is inside body.{name}, and touches it once it has come out",
                        tool.name
                    ));
                }
                for spot in found.spots {
                    let is_same = |contact: &&mut Contact| is_of(contact) && contact.spot.nodes == spot.nodes;
                    if let Some(contact) = contacts.iter_mut().find(is_same) {
                        // The nearest point of the same triangle, or of the same edge.
                        let old = contact.spot.weights.iter();
                        let shift = old.zip(spot.weights).map(|(old, new)| (old - new).abs());
                        has_moved |= shift.fold(0.0, f64::max) > SHIFT;
                        contact.spot = spot;
                    } else {
                        add(contacts, number, spot, Against::Tool(t), outcome);
                    }
                }
            }
        }
        has_moved || contacts.len() > before
    }

    /// The same where surfaces meet; what slid off an end is let go where a step begins, and nodes of the coarser surface join once those
    /// of the finer one stand still.
    fn meet_surfaces(
        &self,
        contacts: &mut Vec<Contact>,
        (begins, is_settled): (bool, bool),
        outcome: &mut Outcome,
    ) -> bool {
        let (before, mut has_moved) = (contacts.len(), false);
        for meeting in self.step.meetings {
            let Meeting { body, node, other, .. } = *meeting;
            let is_own = |contact: &Contact| {
                let is_of = contact.body == body && contact.spot == SurfaceSpot::node(node);
                is_of && contact.other().is_some_and(|(touched, _)| touched == other)
            };
            let own = contacts.iter().position(is_own);
            let met = meeting.met(self.bodies, self.places, self.step.outlines);
            match (own, met) {
                (Some(own), Some(Met { spot, gap, yields: true })) => {
                    let was = self.gap(&contacts[own]).0;
                    has_moved |= (gap - was).abs() > EXACT * self.size(&contacts[own]);
                    contacts[own].against = Against::Surface { body: other, spot };
                }
                (Some(own), _) if begins => drop(contacts.swap_remove(own)),
                (None, Some(Met { spot, gap, yields })) => {
                    let edge = self.bodies[body].longest().min(self.bodies[other].longest());
                    let leads = leads(self.bodies, [body, other]);
                    let near = if leads { EXACT * edge } else { -BETWEEN_NODES * edge };
                    if gap >= near || !(leads || is_settled) {
                        continue;
                    }
                    if yields {
                        let against = Against::Surface { body: other, spot };
                        add(contacts, body, SurfaceSpot::node(node), against, outcome);
                    } else if gap < -BETWEEN_NODES * edge {
                        let [one, two] = [body, other].map(|body| &self.bodies[body].free.body);
                        outcome.warnings.push(format!(
                            "body.{one} reaches into body.{two} where one of them does not yield: at the nodes of a control \
                             element, or such as surface_compliance leaves out"
                        ));
                    }
                }
                _ => {}
            }
        }
        has_moved |= self.cross_edges(contacts, (begins, is_settled), outcome);
        has_moved || contacts.len() != before
    }

    /// The same for edges that cross: those that have passed through each other once all nodes stand still.
    fn cross_edges(
        &self,
        contacts: &mut Vec<Contact>,
        (begins, is_settled): (bool, bool),
        outcome: &mut Outcome,
    ) -> bool {
        let mut has_moved = false;
        let crossed = |bodies: [usize; 2], edges: [[u32; 2]; 2], must_pass: bool| {
            let places = bodies.map(|body| move |node: u32| self.place_of(body, node));
            let side = |k: usize| Side { body: &self.bodies[bodies[k]], place: &places[k] };
            let sides = [side(0), side(1)];
            crossing(&sides, edges).filter(|_| !must_pass || pass_through(&sides, edges))
        };
        for i in (0..contacts.len()).rev() {
            let contact = contacts[i];
            let Some((other, spot)) = contact.other() else { continue };
            let Some((own, across)) = edge_of(&contact.spot).zip(edge_of(&spot)) else { continue };
            match crossed([contact.body, other], [own, across], false) {
                Some(([spot, across], gap)) => {
                    has_moved |= (gap - self.gap(&contact).0).abs() > EXACT * self.size(&contact);
                    contacts[i].spot = spot;
                    contacts[i].against = Against::Surface { body: other, spot: across };
                }
                None if begins => drop(contacts.swap_remove(i)),
                None => {}
            }
        }
        if !is_settled {
            return has_moved;
        }
        for meeting in self.step.meetings {
            let Meeting { body, other, .. } = *meeting;
            if !leads(self.bodies, [body, other]) {
                continue;
            }
            let edge = self.bodies[body].longest().min(self.bodies[other].longest());
            let deepest = self.bodies[body].thickness().min(self.bodies[other].thickness());
            for edges in edges_of(meeting, self.bodies) {
                let takes = |(body, edge): (usize, [u32; 2])| {
                    edge.iter().all(|node| self.bodies[body].takes[*node as usize])
                };
                let Some((spots, gap)) = crossed([body, other], edges, true) else { continue };
                if !(gap < -BETWEEN_NODES * edge && gap > -deepest)
                    || !takes((body, edges[0]))
                    || !takes((other, edges[1]))
                {
                    continue;
                }
                let is_same = |contact: &Contact| {
                    let own = (contact.body, edge_of(&contact.spot));
                    let across = contact.other().map(|(body, spot)| (body, edge_of(&spot)));
                    own == (body, Some(edges[0])) && across == Some((other, Some(edges[1])))
                };
                if !contacts.iter().any(is_same) {
                    let against = Against::Surface { body: other, spot: spots[1] };
                    add(contacts, body, spots[0], against, outcome);
                }
            }
        }
        has_moved
    }
}

/// Whether the nodes of the first body are held back by the surface of the second, and not the other way round.
fn leads(bodies: &[TouchedBody], [one, two]: [usize; 2]) -> bool {
    let fineness = |body: usize| (bodies[body].longest(), body);
    fineness(one) <= fineness(two)
}

/// Adds a contact while there is room.
fn add(contacts: &mut Vec<Contact>, body: usize, spot: SurfaceSpot, against: Against, outcome: &mut Outcome) {
    if contacts.len() < MOST_CONTACTS {
        contacts.push(Contact { body, spot, against, force: V3::zeros() });
        return;
    }
    let full = format!(
        "contact: more than {MOST_CONTACTS} nodes touch, of which the first are held back; a coarser surface has fewer"
    );
    if !outcome.warnings.contains(&full) {
        outcome.warnings.push(full);
    }
}

/// Finds the forces for gaps that are linear about the present places; whether the gaps hold there.
fn solve(now: &Now<'_>, contacts: &mut [Contact], free: &[Places]) -> (bool, Reached) {
    let Now { bodies, step, .. } = *now;
    let turns = turns(bodies);
    let mut bases = Vec::with_capacity(contacts.len());
    let size = 3 * contacts.len();
    let (mut d0, mut f) = (DVector::zeros(size), DVector::zeros(size));
    let friction: Vec<f64> = contacts.iter().map(|contact| friction(bodies, contact)).collect();
    for (i, contact) in contacts.iter().enumerate() {
        let (gap, normal) = now.gap(contact);
        let basis = contact_axes(&normal);
        let (opened, slip) = now.without(contact, free);
        d0[3 * i] = gap + normal.dot(&opened);
        let slip = basis.tr_mul(&slip);
        (d0[3 * i + 1], d0[3 * i + 2]) = (slip.y, slip.z);
        f.fixed_rows_mut::<3>(3 * i).copy_from(&basis.tr_mul(&(turns[contact.body] * contact.force)));
        bases.push(basis);
    }
    let w = compliance(bodies, contacts, step, (&turns, &bases));
    let skins: Vec<f64> = (0..contacts.len()).map(|i| skin(bodies, &contacts[i], &w, i)).collect();
    let mut with_skins = w.clone();
    skins
        .iter()
        .enumerate()
        .for_each(|(i, skin)| (0..3).for_each(|k| with_skins[(3 * i + k, 3 * i + k)] += skin));
    let reached = Cone { w: &with_skins, d0: &d0, friction: &friction }.solve(&mut f);
    for (i, contact) in contacts.iter_mut().enumerate() {
        contact.force = turns[contact.body].tr_mul(&(bases[i] * f.fixed_rows::<3>(3 * i)));
    }
    // Whether the gaps, taken anew, are those for which the forces were found.
    let d = &w * &f + d0;
    let yielded: Vec<V3> =
        (0..step.tools.len()).map(|tool| self::yielded(tool, bodies, contacts, step)).collect();
    let after = Now { places: &of_contacts(bodies, contacts, free), yielded: &yielded, ..*now };
    let is_exact = contacts.iter().enumerate().all(|(i, contact)| {
        let (gap, _) = after.gap(contact);
        (gap - d[3 * i]).abs() <= EXACT * after.size(contact)
    });
    (is_exact, reached)
}

impl Now<'_> {
    /// How far a contact would open beyond its present gap without contact, and how far it would have slipped since the step began.
    fn without(&self, contact: &Contact, free: &[Places]) -> (V3, V3) {
        let step = self.step;
        let all = |body: usize, spot: &SurfaceSpot| {
            [self.places, free, step.starts].map(|places| place(&places[body], spot))
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
}

/// Compliance of a contact beside that of its bodies, m/N: one between nodes depends on those at the nodes, as do both sides of two
/// surfaces on each other, and a thin skin makes their forces unique.
fn skin(bodies: &[TouchedBody], contact: &Contact, w: &DMatrix<f64>, i: usize) -> f64 {
    let is_node = contact.spot.corners().count() == 1;
    let is_one_way = |(other, _)| other != contact.body && leads(bodies, [contact.body, other]);
    let is_alone = is_node && contact.other().is_none_or(is_one_way);
    if is_alone { 0.0 } else { SKIN * w.fixed_view::<3, 3>(3 * i, 3 * i).trace() / 3.0 }
}

/// W, 3n × 3n, m/N.
fn compliance(
    bodies: &[TouchedBody],
    contacts: &[Contact],
    step: &Step<'_>,
    (turns, bases): (&[Matrix3<f64>], &[Matrix3<f64>]),
) -> DMatrix<f64> {
    let size = 3 * contacts.len();
    let mut w = DMatrix::zeros(size, size);
    for (i, a) in contacts.iter().enumerate() {
        for (j, b) in contacts.iter().enumerate().take(i + 1) {
            let block = bases[i].tr_mul(&between(bodies, step.tools, turns, (a, b))) * bases[j];
            w.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block);
            w.fixed_view_mut::<3, 3>(3 * j, 3 * i).copy_from(&block.transpose());
        }
    }
    w
}
