//! One step: contacts, their compliance, and the forces that hold them apart.
//!
//! In: the touched bodies without contact at the end of a step, places of their candidate nodes at its start, and the tools at both.
//! Out: the contacts with their forces. With x = x_free + C f the gap of a contact, linear about the last place x', is
//!
//! ```text
//! d_n = φ(x') + ∇φ·(x - x')        d_t = what x has moved against the tool's surface since the start of the step
//! ```
//!
//! A tool on a spring of stiffness k yields by its force over k, by which all of its contacts move together. Detection and solution
//! alternate until the set of contacts stays and they stand where their gaps were taken.

use super::detection::{distance, find};
use super::tool::Tool;
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::base::quantity::quantity;
use crate::deform::contact_axes;
use crate::solve::cone::{Cone, Reached};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Translation3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Rounds of detection and solution at most, and the part of a tool's thickness by which a gap may be off at their end.
const MOST_ROUNDS: usize = 12;
const EXACT: f64 = 1e-5;
/// Part of its own compliance by which a spot between nodes yields more.
const SKIN: f64 = 1e-3;
/// Change of a spot's weights by which it has moved.
const SHIFT: f64 = 1e-4;
/// Contacts at most: beyond, a step would take longer than a frame.
pub const MOST_CONTACTS: usize = 600;

/// A contact of a tool with a spot of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Indices among the touched bodies and the tools.
    pub body: usize,
    pub tool: usize,
    pub nodes: [u32; 3],
    pub weights: [f64; 3],
    /// Force on the body along the axes of its columns, N.
    #[serde(with = "crate::field::numbers")]
    pub force: V3,
}

impl Contact {
    pub fn spot(&self) -> SurfaceSpot {
        SurfaceSpot { nodes: self.nodes, weights: self.weights }
    }
}

/// Data of a step beside the bodies.
pub struct Step<'a> {
    pub tools: &'a [Tool],
    /// Poses of the tools' surfaces at the start, and of the tools as hands put them at the end; `None` for one that is not there.
    pub from: &'a [Option<Isometry3<f64>>],
    pub to: &'a [Option<Isometry3<f64>>],
    /// Places of each body's candidates at the start, and of all of its nodes without contact at about the end of the frame.
    pub starts: &'a [BTreeMap<u32, V3>],
    pub outlines: &'a [Vec<V3>],
}

/// Results of a step beside the contacts' forces.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    pub warnings: Vec<String>,
    pub reached: Option<Reached>,
}

/// Places of a body's candidates, in the room.
pub type Places = BTreeMap<u32, V3>;

/// Brings the contacts to the end of a step.
pub fn advance(bodies: &mut [TouchedBody], contacts: &mut Vec<Contact>, step: &Step<'_>) -> Outcome {
    let mut outcome = Outcome::default();
    contacts.retain(|contact| step.to[contact.tool].is_some());
    let free: Vec<Places> = bodies
        .iter()
        .zip(step.starts)
        .map(|(body, starts)| starts.keys().map(|node| (*node, body.free_place(*node))).collect())
        .collect();
    for round in 0..MOST_ROUNDS {
        let places = with_contact(bodies, contacts, &free);
        let yielded: Vec<V3> =
            (0..step.tools.len()).map(|tool| yielded(tool, bodies, contacts, step)).collect();
        let found = add_new(bodies, contacts, step, (&places, &yielded), &mut outcome);
        if let Err(warning) = fetch(bodies, contacts) {
            outcome.warnings.push(warning);
            contacts.clear();
            return outcome;
        }
        if contacts.is_empty() {
            return outcome;
        }
        let (is_exact, reached) = solve(bodies, contacts, step, (&free, &places, &yielded));
        outcome.reached = Some(reached);
        if !found && is_exact && round > 0 {
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
        let moved = body.moved(&at_nodes(contacts, number));
        free.iter().map(|(node, x)| (*node, x + moved(*node))).collect()
    };
    bodies.iter().zip(free).enumerate().map(of).collect()
}

/// Places of the contacts' nodes with the forces of the contacts.
fn of_contacts(bodies: &[TouchedBody], contacts: &[Contact], free: &[Places]) -> Vec<Places> {
    let own = |(number, free): (usize, &Places)| -> Places {
        let nodes =
            contacts.iter().filter(|contact| contact.body == number).flat_map(|contact| contact.nodes);
        nodes.map(|node| (node, free[&node])).collect()
    };
    with_contact(bodies, contacts, &free.iter().enumerate().map(own).collect::<Vec<_>>())
}

/// Place of a spot whose nodes have these places.
pub fn place(places: &Places, spot: &SurfaceSpot) -> V3 {
    spot.corners().map(|(node, w)| places[&node] * w).sum()
}

/// Forces of the contacts at single nodes of a body.
pub fn at_nodes(contacts: &[Contact], body: usize) -> Vec<(u32, V3)> {
    let mut all: BTreeMap<u32, V3> = BTreeMap::new();
    for contact in contacts.iter().filter(|contact| contact.body == body) {
        for (node, w) in contact.spot().corners() {
            *all.entry(node).or_default() += contact.force * w;
        }
    }
    all.into_iter().collect()
}

/// Shift of a tool by which its spring has yielded to its force, in the room, m.
fn yielded(tool: usize, bodies: &[TouchedBody], contacts: &[Contact], step: &Step<'_>) -> V3 {
    step.tools[tool].stiffness.map_or_else(V3::zeros, |k| force_on_tool(tool, bodies, contacts) / k)
}

/// Force of the bodies on a tool, in the room, N.
pub fn force_on_tool(tool: usize, bodies: &[TouchedBody], contacts: &[Contact]) -> V3 {
    let own = contacts.iter().filter(|contact| contact.tool == tool);
    -own.map(|contact| bodies[contact.body].turn() * contact.force).sum::<V3>()
}

/// A tool where its spring holds it.
pub fn shifted(pose: &Isometry3<f64>, by: &V3) -> Isometry3<f64> {
    Translation3::from(*by) * pose
}

/// Adds contacts where a tool reaches into a body, and moves those whose nearest point has moved. True if there are any.
fn add_new(
    bodies: &[TouchedBody],
    contacts: &mut Vec<Contact>,
    step: &Step<'_>,
    (places, yielded): (&[Places], &[V3]),
    outcome: &mut Outcome,
) -> bool {
    let (before, mut has_moved) = (contacts.len(), false);
    for (number, body) in bodies.iter().enumerate() {
        for (t, tool) in step.tools.iter().enumerate().filter(|(t, _)| body.tools[*t]) {
            let Some(pose) = &step.to[t] else { continue };
            let pose = shifted(pose, &yielded[t]);
            let near = EXACT * tool.shape.thickness().min(body.longest());
            let found = find(&tool.shape, &pose, body, &places[number], &step.outlines[number], near);
            let name = &body.free.body;
            if found.meets_stiff {
                outcome.warnings.push(format!(
                    "tool.{}: it reaches into nodes of body.{name} that do not yield: those of a control element, or such as \
                     surface_compliance leaves out",
                    tool.name
                ));
            }
            if found.is_within && contacts.iter().all(|contact| (contact.body, contact.tool) != (number, t)) {
                outcome.warnings.push(format!(
                    "tool.{}: it is inside body.{name}, and touches it once it has come out",
                    tool.name
                ));
            }
            for spot in found.spots {
                let is_same = |contact: &&mut Contact| {
                    (contact.body, contact.tool, contact.nodes) == (number, t, spot.nodes)
                };
                if let Some(contact) = contacts.iter_mut().find(is_same) {
                    // The nearest point of the same triangle, or of the same edge.
                    let shift = contact.weights.iter().zip(spot.weights).map(|(old, new)| (old - new).abs());
                    has_moved |= shift.fold(0.0, f64::max) > SHIFT;
                    contact.weights = spot.weights;
                } else if contacts.len() < MOST_CONTACTS {
                    let SurfaceSpot { nodes, weights } = spot;
                    contacts.push(Contact { body: number, tool: t, nodes, weights, force: V3::zeros() });
                }
            }
        }
    }
    if contacts.len() == MOST_CONTACTS {
        outcome.warnings.push(format!(
            "contact: more than {MOST_CONTACTS} nodes touch tools, of which the first are held back; a coarser surface has fewer"
        ));
    }
    has_moved || contacts.len() > before
}

/// Makes sure that the columns of all contacts are there. The error says why one cannot be read.
pub fn fetch(bodies: &mut [TouchedBody], contacts: &[Contact]) -> Result<(), String> {
    for (number, body) in bodies.iter_mut().enumerate() {
        let own = contacts.iter().filter(|contact| contact.body == number);
        body.fetch(own.flat_map(|contact| contact.spot().corners()).map(|(node, _)| node))?;
    }
    Ok(())
}

/// Finds the forces for gaps that are linear about the present places; whether the gaps hold there.
fn solve(
    bodies: &[TouchedBody],
    contacts: &mut [Contact],
    step: &Step<'_>,
    (free, places, yielded): (&[Places], &[Places], &[V3]),
) -> (bool, Reached) {
    let turns = turns(bodies);
    let mut bases = Vec::with_capacity(contacts.len());
    let size = 3 * contacts.len();
    let (mut d0, mut f) = (DVector::zeros(size), DVector::zeros(size));
    let friction: Vec<f64> = contacts.iter().map(|contact| bodies[contact.body].friction).collect();
    for (i, contact) in contacts.iter().enumerate() {
        let (spot, tool) = (contact.spot(), contact.tool);
        let [x, without] = [places, free].map(|all| place(&all[contact.body], &spot));
        let start = place(&step.starts[contact.body], &spot);
        let pose = step.to[tool].unwrap_or_default();
        let (gap, normal) = distance(&step.tools[tool].shape, &shifted(&pose, &yielded[tool]), &x);
        let basis = contact_axes(&normal);
        // The point of the tool that was there at the start, where the tool would be without its spring's yielding.
        let from = step.from[tool].unwrap_or(pose);
        let carried = pose * from.inverse_transform_point(&start.into());
        let slip = basis.tr_mul(&(without - carried.coords));
        d0[3 * i] = gap + normal.dot(&(without - x + yielded[tool]));
        (d0[3 * i + 1], d0[3 * i + 2]) = (slip.y, slip.z);
        f.fixed_rows_mut::<3>(3 * i).copy_from(&basis.tr_mul(&(turns[contact.body] * contact.force)));
        bases.push(basis);
    }
    let w = compliance(bodies, contacts, step, (&turns, &bases));
    let skins: Vec<f64> = (0..contacts.len()).map(|i| skin(&contacts[i], &w, i)).collect();
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
    let after = of_contacts(bodies, contacts, free);
    let is_exact = contacts.iter().enumerate().all(|(i, contact)| {
        let tool = &step.tools[contact.tool];
        let by = self::yielded(contact.tool, bodies, contacts, step);
        let pose = shifted(&step.to[contact.tool].unwrap_or_default(), &by);
        let (gap, _) = distance(&tool.shape, &pose, &place(&after[contact.body], &contact.spot()));
        (gap - d[3 * i]).abs() <= EXACT * tool.shape.thickness().min(bodies[contact.body].longest())
    });
    (is_exact, reached)
}

/// Compliance of a spot beside that of its body, m/N: spots between nodes depend on those at the nodes, and a thin skin makes their forces
/// unique.
fn skin(contact: &Contact, w: &DMatrix<f64>, i: usize) -> f64 {
    let is_node = contact.spot().corners().count() == 1;
    if is_node { 0.0 } else { SKIN * w.fixed_view::<3, 3>(3 * i, 3 * i).trace() / 3.0 }
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

/// Displacement of one contact by a force at another, along the room's axes, m/N.
pub fn between(
    bodies: &[TouchedBody],
    tools: &[Tool],
    turns: &[Matrix3<f64>],
    (a, b): (&Contact, &Contact),
) -> Matrix3<f64> {
    let mut block = Matrix3::zeros();
    if a.body == b.body {
        let [one, other] = [(a, b), (b, a)].map(|(a, b)| bodies[a.body].between(&a.spot(), &b.spot()));
        let turn = &turns[a.body];
        block += turn * (one + other.transpose()) * turn.transpose() * 0.5;
    }
    if let Some(k) = tools[a.tool].stiffness.filter(|_| a.tool == b.tool) {
        block += Matrix3::from_diagonal_element(1.0 / k);
    }
    block
}

/// Turns of the bodies from the axes of their columns to those of the room.
pub fn turns(bodies: &[TouchedBody]) -> Vec<Matrix3<f64>> {
    bodies.iter().map(|body| body.turn().into_inner()).collect()
}
