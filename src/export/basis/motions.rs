//! Motions that people can follow: of each control element three shifts, three turns and three stretches, and one for every
//! load; each a small sum of columns.
//!
//! They show what the columns do. Turns are those of the linear theory, which stretches what it turns.

use super::body_basis::{BodyBasis, Handle};
use crate::green::{ColumnSource, FIELD_NAMES};

/// One motion; at -1 it is the opposite one.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    pub name: String,
    /// The control element that it moves.
    pub control: Option<usize>,
    /// Columns and their coefficients at 1.
    pub terms: Vec<(usize, f64)>,
}

/// A motion moves no point by more than this part of the body's size, and changes no entry of M by more than this: a turn by
/// 20°, a stretch by 35 %. Of a flat control element half of a turn's columns vanish.
const LARGEST: f64 = 0.12;
const LARGEST_OF_M: f64 = 0.35;

/// Fields and their parts, in the order in which they are shown; rows of M turn x against y with opposite signs.
const OF_CONTROL: [(&str, &[(&str, f64)]); 9] = [
    ("shift x", &[("tx", 1.0)]),
    ("shift y", &[("ty", 1.0)]),
    ("shift z", &[("tz", 1.0)]),
    ("turn x", &[("m32", 1.0), ("m23", -1.0)]),
    ("turn y", &[("m13", 1.0), ("m31", -1.0)]),
    ("turn z", &[("m21", 1.0), ("m12", -1.0)]),
    ("stretch x", &[("m11", 1.0)]),
    ("stretch y", &[("m22", 1.0)]),
    ("stretch z", &[("m33", 1.0)]),
];

/// All motions of a body: those of control elements that hands can take first, then the others', then the loads'. Where columns
/// were chosen one by one, those are the motions.
pub fn motions(body: &BodyBasis) -> Vec<Motion> {
    let single = |k: usize| Motion {
        name: body.columns[k].name.name.clone(),
        control: match body.columns[k].name.source {
            ColumnSource::Field { control, .. } => Some(control),
            ColumnSource::Load | ColumnSource::Model => None,
        },
        terms: vec![(k, 1.0)],
    };
    let all = 0..body.columns.len();
    let mut found: Vec<Motion> = Vec::new();
    if body.is_chosen {
        found.extend(all.map(single));
    } else {
        let order = |grabbed: bool| {
            let handles = body.controls.iter().enumerate();
            handles.filter(move |(_, handle)| handle.is_grabbed == grabbed)
        };
        found.extend(order(true).chain(order(false)).flat_map(|(e, handle)| of_control(body, e, handle)));
        let is_load = |k: &usize| body.columns[*k].name.source == ColumnSource::Load;
        found.extend(all.filter(is_load).map(single));
    }
    found.retain(|motion| !motion.terms.is_empty());
    found.iter_mut().for_each(|motion| scale(body, motion));
    found
}

fn of_control(body: &BodyBasis, e: usize, handle: &Handle) -> Vec<Motion> {
    let motion = |(name, fields): &(&str, &[(&str, f64)])| {
        let term = |(field, weight): &(&str, f64)| {
            let field = FIELD_NAMES.iter().position(|known| known == field)?;
            Some((body.field(e, field)?, *weight))
        };
        Motion {
            name: format!("{} {name}", handle.rest.name),
            control: Some(e),
            terms: fields.iter().filter_map(term).collect(),
        }
    };
    OF_CONTROL.iter().map(motion).collect()
}

fn scale(body: &BodyBasis, motion: &mut Motion) {
    let reach: f64 = motion.terms.iter().map(|(k, weight)| weight.abs() * body.columns[*k].largest).sum();
    let by_size = LARGEST * body.size / reach.max(f64::MIN_POSITIVE);
    let is_of_m = |(k, _): &(usize, f64)| match body.columns[*k].name.source {
        ColumnSource::Field { field, .. } => FIELD_NAMES[field].starts_with('m'),
        ColumnSource::Load | ColumnSource::Model => false,
    };
    let most = if motion.terms.iter().any(is_of_m) { by_size.min(LARGEST_OF_M) } else { by_size };
    motion.terms.iter_mut().for_each(|(_, weight)| *weight *= most);
}

/// Chooses at most `count` motions that show most of a body: the three shifts of the first control element that a hand can take,
/// and its turn about the axis along which it lies from the body's centre.
pub fn few(body: &BodyBasis, all: &[Motion], count: usize) -> Vec<Motion> {
    let first = all.iter().find_map(|motion| motion.control);
    let Some(e) = first else { return all.iter().take(count).cloned().collect() };
    let axis = ["x", "y", "z"][body.controls[e].rest.origin.iamax()];
    let ends =
        ["shift x", "shift y", "shift z"].map(str::to_owned).into_iter().chain([format!("turn {axis}")]);
    let named =
        |end: String| all.iter().find(|motion| motion.control == Some(e) && motion.name.ends_with(&end));
    let chosen: Vec<Motion> = ends.filter_map(named).take(count).cloned().collect();
    if chosen.is_empty() { all.iter().take(count).cloned().collect() } else { chosen }
}
