//! One step: contacts, their compliance, and the forces that hold them apart.
//!
//! In: the touched bodies without contact at the end of a step, places of their candidate nodes at its start, and the tools at both.
//! Out: the contacts with their forces. With x = x_free + C f the gap of a contact, linear about the last place x', is
//!
//! ```text
//! d_n = d_n(x') + n·(x - x')        d_t = what x has moved against what it touches since the start of the step
//! ```
//!
//! where C is that of the step for a body with inertia ([`inertial`]), with φ(x') and ∇φ of a tool, and n·(x' - y') to a spot y of a surface, which moves too. A tool on a spring of stiffness k yields by
//! its force over k, by which all of its contacts move together. Detection and solution alternate until the set of contacts stays and
//! they stand where their gaps were taken.

use super::candidates::Places;
use super::compliance::compliance;
use super::inertial::{self, Inertias};
use super::round::{Outcome, Round, Step, Watch};
use super::slides::Slides;
use super::touch::{Contact, at_nodes, fetch, force_on_tool, friction, turns};
use super::touched_body::TouchedBody;
use crate::base::quantity::quantity;
use crate::deform::contact_axes;
use crate::solve::cone::{Cone, Reached};
use nalgebra::{DVector, Vector3};

type V3 = Vector3<f64>;

/// Rounds of detection and solution at most.
const MOST_ROUNDS: usize = 12;
/// Part of the error that a gap may have within which forces are found.
const FINE: f64 = 1e-2;
/// Part of the force at the beginning of a step below which a contact is open at its end.
const GONE: f64 = 1e-9;

/// Brings the contacts to the end of a step, at this share of the frame.
pub fn advance(
    bodies: &mut [TouchedBody],
    (inertias, share): (&mut Inertias<'_>, f64),
    contacts: &mut Vec<Contact>,
    step: &Step<'_>,
) -> Outcome {
    let mut outcome = Outcome::default();
    contacts.retain(|contact| {
        contact.tool().is_none_or(|tool| step.to[tool].is_some())
            && contact.sides().all(|(body, spot, _)| bodies[body].takes(&spot))
    });
    contacts.iter_mut().for_each(|contact| contact.before = contact.force);
    inertial::begin(bodies, inertias, share);
    inertial::go(bodies, inertias, share, contacts);
    let mut free: Vec<Places> =
        bodies.iter().zip(step.starts).map(|(body, starts)| Places::free(body, starts.nodes())).collect();
    let mut places = with_contact(bodies, contacts, &free);
    let (mut watch, mut slides) = (Watch::new(step.meetings.len()), Slides::default());
    let mut is_exact = false;
    for round in 0..MOST_ROUNDS {
        let yielded = all_yielded(bodies, contacts, step);
        let now = Round { bodies, step, places: &places, yielded: &yielded };
        let solved = contacts.clone();
        let mut found = now.meet_tools(contacts, &mut slides, &mut outcome);
        found |= now.meet_surfaces(contacts, &mut watch, round == 0, &mut outcome);
        if is_exact && !found {
            // The forces that were found hold, at the spots for which they were found.
            *contacts = solved;
            if outcome.is_unfinished || !now.pass_surfaces(contacts, &watch, &mut outcome) {
                break;
            }
        }
        // What has no normal cannot be pressed.
        contacts.retain(|contact| now.gap(contact).1 != V3::zeros());
        if contacts.is_empty() {
            go(bodies, (&mut *inertias, share), contacts, &mut free);
            places.clone_from(&free);
            is_exact = true;
        } else {
            if let Err(warning) = fetch(bodies, contacts) {
                outcome.warn(warning);
                contacts.clear();
                inertial::go(bodies, inertias, share, contacts);
                return outcome;
            }
            inertial::fetch(bodies, inertias, contacts);
            let now = Round { bodies, step, places: &places, yielded: &yielded };
            let (gaps, reached) = solve(&now, contacts, &free);
            let has_left = let_go(bodies, contacts);
            go(bodies, (&mut *inertias, share), contacts, &mut free);
            let after = with_contact(bodies, contacts, &free);
            let yielded = all_yielded(bodies, contacts, step);
            let then = Round { bodies, step, places: &after, yielded: &yielded };
            is_exact = !has_left && then.has_gaps(contacts, &gaps);
            watch.moved(&places, &after);
            (places, outcome.reached) = (after, Some(reached));
        }
        outcome.is_unfinished |= round + 1 == MOST_ROUNDS;
    }
    contacts.retain(|contact| contact.force != V3::zeros() && contact.force.iter().all(|f| f.is_finite()));
    if let Some(Reached { missed, largest, .. }) = outcome.reached.filter(|reached| reached.is_far()) {
        outcome.warn(format!(
            "contact: no forces were found in this frame that hold {} contacts apart: they miss it by {} of {}",
            contacts.len(),
            quantity(missed, "m"),
            quantity(largest, "m")
        ));
    }
    outcome
}

/// Moves all bodies with inertia to the end of the step under the forces of the contacts, and takes their places without contact anew.
fn go(
    bodies: &mut [TouchedBody],
    (inertias, share): (&mut Inertias<'_>, f64),
    contacts: &mut [Contact],
    free: &mut [Places],
) {
    inertial::go(bodies, inertias, share, contacts);
    for ((body, free), _) in bodies.iter().zip(free).zip(inertias).filter(|(_, inertia)| inertia.is_some()) {
        *free = Places::free(body, free.nodes());
    }
}

/// Lets what touches a body with inertia no more at the end of a step go where the step began: otherwise the force of its beginning would
/// still push it away. True if there is any.
fn let_go(bodies: &[TouchedBody], contacts: &mut [Contact]) -> bool {
    let gone = |contact: &&mut Contact| {
        contact.before != V3::zeros()
            && contact.force.norm() <= GONE * contact.before.norm()
            && contact.lives(bodies)
    };
    contacts.iter_mut().filter(gone).map(|contact| contact.before = V3::zeros()).count() > 0
}

/// Places of all candidates with the forces of the contacts.
fn with_contact(bodies: &[TouchedBody], contacts: &[Contact], free: &[Places]) -> Vec<Places> {
    let of = |(number, (body, free)): (usize, (&TouchedBody, &Places))| {
        free.moved(body, &at_nodes(bodies, contacts, number))
    };
    bodies.iter().zip(free).enumerate().map(of).collect()
}

/// Shifts of the tools by which their springs have yielded to their forces, in the room, m.
fn all_yielded(bodies: &[TouchedBody], contacts: &[Contact], step: &Step<'_>) -> Vec<V3> {
    let yielded = |(tool, stiffness): (usize, Option<f64>)| {
        stiffness.map_or_else(V3::zeros, |k| force_on_tool(tool, bodies, contacts) / k)
    };
    step.tools.iter().map(|tool| tool.stiffness).enumerate().map(yielded).collect()
}

/// Finds the forces for gaps that are linear about the present places; the normal gaps to which they lead.
fn solve(now: &Round<'_>, contacts: &mut [Contact], free: &[Places]) -> (Vec<f64>, Reached) {
    let Round { bodies, .. } = *now;
    let turns = turns(bodies);
    let (mut bases, mut wanted) = (Vec::with_capacity(contacts.len()), Vec::new());
    let size = 3 * contacts.len();
    let (mut d0, mut f) = (DVector::zeros(size), DVector::zeros(size));
    let friction: Vec<f64> = contacts.iter().map(|contact| friction(bodies, contact)).collect();
    for (i, contact) in contacts.iter().enumerate() {
        let (gap, normal) = now.gap(contact);
        let basis = contact_axes(&normal);
        let (opened, slip) = now.without(contact, free);
        let (slip, gap) = (basis.tr_mul(&slip), gap + normal.dot(&opened));
        wanted.push(now.wanted(contact));
        d0.fixed_rows_mut::<3>(3 * i).copy_from(&V3::new(gap - wanted[i], slip.y, slip.z));
        f.fixed_rows_mut::<3>(3 * i).copy_from(&basis.tr_mul(&(turns[contact.body] * contact.force)));
        bases.push(basis);
    }
    let (w, skins) = compliance(now, contacts, (&turns, &bases));
    let within = contacts.iter().map(|contact| FINE * now.tolerance(contact));
    let within = within.fold(f64::INFINITY, f64::min);
    let cone = Cone { w: &w, d0: &d0, friction: &friction };
    let reached = cone.solve_within(&mut f, within);
    let d = DVector::from_vec(cone.displacements(f.as_slice()));
    // What a skin yields is no gap.
    let gap = |i: usize| d[3 * i] - skins[i] * f[3 * i] + wanted[i];
    let gaps = (0..contacts.len()).map(gap).collect();
    drop(w);
    for (i, contact) in contacts.iter_mut().enumerate() {
        let [force, slip] = [&f, &d].map(|all| all.fixed_rows::<3>(3 * i).into_owned());
        contact.force = turns[contact.body].tr_mul(&(bases[i] * force));
        contact.slip = slip.yz().norm();
        contact.rubbed = (-force.yz().dot(&slip.yz())).max(0.0);
    }
    (gaps, reached)
}
