//! Work of friction in a frame, where it is to be heard.
//!
//! In: the contacts at the end of a step, with the way that each has slipped and the work of friction on it. Out: the work on each body that is
//! heard; that of two such bodies counts half for each. Ways are those in the body's own metres, for which its forces are.

use super::candidates::Places;
use super::touch::Contact;
use super::touched_body::TouchedBody;
use crate::world::dissipation::Dissipation;

/// Adds the work of a step, one of so many in the frame; `starts` are the places of the bodies where it began.
pub fn add_friction(bodies: &mut [TouchedBody], contacts: &[Contact], starts: &[Places], steps: usize) {
    for contact in contacts.iter().filter(|contact| contact.rubbed > 0.0) {
        let heard = contact.sides().filter(|(body, ..)| bodies[*body].is_heard).count();
        for (number, spot, _) in contact.sides() {
            let body = &mut bodies[number];
            if body.is_heard {
                let (place, scale) = (starts[number].of(&spot), body.room_from_body.scaling());
                let (work, way) = (contact.rubbed / scale, contact.slip * steps as f64 / scale);
                body.rubbed.add(&Dissipation::of(work / heard as f64, &place, way));
            }
        }
    }
}
