//! The rows on the right, of each body: how far it is bent, what errors to expect, poses and forces of its control elements.

use super::readings::{BodyReading, ControlReading, ErrorReading, ForceReading};
use super::row::{GAP, Rank, Ranked, Row, words};
use crate::base::fixed::{ENERGY, FORCE, LENGTH, LETTERS, Scale, TORQUE, Unit, clipped, fixed};
use crate::deform::{ErrorsAt, StateAge, percent};
use crate::display::caption::{BAD, FAIR, GOOD, INK, QUIET};
use crate::world::Verdict;
use nalgebra::Vector3;
use std::f64::consts::PI;

pub(super) fn body_rows(body: &BodyReading) -> Vec<Ranked> {
    let effects = match body.effects.is_empty() {
        true => "no effects".to_owned(),
        false => clipped(&format!("effects {}", body.effects.join(", ")), LETTERS),
    };
    let mut rows = vec![
        words(clipped(&body.name, LETTERS), INK).ranked(Rank::First),
        words(clipped(&format!("model {}", body.model), LETTERS), QUIET).ranked(Rank::Third),
        words(effects, QUIET).ranked(Rank::Detail),
    ];
    rows.extend(gauge_rows(body));
    rows.extend(body.age.map(|age| age_row(age).ranked(Rank::Second)));
    if let Some(energy) = body.energy {
        let row = Row::Words(vec![("energy ".into(), QUIET), (ENERGY.quantity(energy), INK)]);
        rows.push(row.ranked(Rank::Third));
    }
    rows.extend(body.errors.iter().flat_map(error_rows).map(|row| row.ranked(Rank::Third)));
    for control in &body.controls {
        rows.push(GAP);
        rows.extend(control_rows(control));
    }
    rows
}

/// Age of an equilibrium that was found in the background.
fn age_row(age: StateAge) -> Row {
    match age {
        StateAge::Current => words("equilibrium of these poses".to_owned(), QUIET),
        StateAge::Old { seconds } => words(format!("equilibrium {} s old", fixed(seconds, 7, 2)), FAIR),
        StateAge::Lost => words("no equilibrium beyond this one".to_owned(), BAD),
    }
}

/// Errors to expect, as they were measured on this body; or why they are unknown.
pub(super) fn error_rows(errors: &ErrorReading) -> Vec<Row> {
    let part = |name: &str, part: String| [(format!("{part:<7}"), INK), (name.to_owned(), QUIET)];
    let of_model = |at: &ErrorsAt| {
        let force = at.wrench().map_or("none".into(), percent);
        let parts = part("force  ", force).into_iter().chain(part("shape", percent(at.shape)));
        std::iter::once(("errors ~".into(), QUIET)).chain(parts).collect()
    };
    let of_mesh = |mesh: &f64| {
        let parts = part("force", percent(*mesh));
        std::iter::once(("of mesh ~".into(), QUIET)).chain(parts).collect()
    };
    let unknown = |why: &&str| vec![("error unknown: ".into(), QUIET), ((*why).to_owned(), FAIR)];
    let (model, mesh) = (errors.model.iter().map(of_model), errors.mesh.iter().map(of_mesh));
    model.chain(mesh).chain(errors.unknown.iter().map(unknown)).map(Row::Words).collect()
}

/// Part of the largest force above which an error of the forces is shown beside the verdict on the shape.
const DOUBTFUL: f64 = 0.1;

/// The error to expect of the forces, if it is large; shapes may be good all the same.
fn doubtful_force(body: &BodyReading) -> Option<f64> {
    let errors = body.errors?;
    let part = errors.model?.wrench()? + errors.mesh.unwrap_or(0.0);
    (part > DOUBTFUL).then_some(part)
}

/// The turn of the body, compared with that up to which its model is good; beyond half a turn in turns.
pub(super) fn gauge_rows(body: &BodyReading) -> Vec<Ranked> {
    let (turn, limits) = (body.turn, body.limits);
    let verdict = limits.verdict(turn);
    let ink = match verdict {
        _ if body.doubt.is_some() => BAD,
        Verdict::Good => GOOD,
        Verdict::Fair => FAIR,
        _ => BAD,
    };
    let turned = format!("{}°  ", fixed(turn.to_degrees(), 6, 1));
    let told = match (verdict, body.doubt) {
        (Verdict::Beyond, _) => format!("{} turns · too far", fixed(turn / (2.0 * PI), 6, 2).trim_start()),
        (_, Some(doubt)) => doubt.name().to_owned(),
        (_, None) => match doubtful_force(body) {
            // No longer than the column.
            Some(part) if part >= 9.99 => format!("shape {}, forces wrong", verdict.name()),
            Some(part) => {
                let least = if body.errors.is_some_and(|errors| errors.mesh.is_none()) { ">" } else { "" };
                format!("shape {}, forces ±{least}{}", verdict.name(), percent(part))
            }
            None => verdict.name().to_owned(),
        },
    };
    let ink = if doubtful_force(body).is_some() && ink == GOOD { BAD } else { ink };
    let whole = 1.5 * limits.fair;
    let bounds = match limits.is_measured {
        true => format!("measured to {:.0}°", limits.fair.to_degrees()),
        false => {
            format!("good to {:.0}°, fair to {:.0}°", limits.good.to_degrees(), limits.fair.to_degrees())
        }
    };
    let marks = vec![limits.good / whole, limits.fair / whole];
    vec![
        Row::Words(vec![("turn ".into(), QUIET), (turned, INK), (told, ink)]).ranked(Rank::First),
        Row::Gauge { share: turn / whole, marks, ink }.ranked(Rank::Second),
        words(clipped(&bounds, LETTERS), QUIET).ranked(Rank::Third),
    ]
}

/// The twelve coefficients, a row per axis: T, then M - I; force and torque with what they may be wrong by.
pub(super) fn control_rows(control: &ControlReading) -> Vec<Ranked> {
    let held = if control.held { ("   held", GOOD) } else { ("", QUIET) };
    // What a hand holds matters more.
    let (first, then) = if control.held { (Rank::First, Rank::Second) } else { (Rank::Second, Rank::Third) };
    let shift = control.pose.translation;
    let scale = LENGTH.scale(0.001f64.max(shift.amax()));
    let header =
        format!("{:>11}   {:>7} {:>7} {:>7}", format!("T ({})", scale.plain_name()), "M - I", "", "");
    let mut rows = vec![
        Row::Words(vec![(clipped(&control.name, LETTERS - 8), INK), (held.0.to_owned(), held.1)])
            .ranked(first),
    ];
    let mut table = vec![vec![(header, QUIET)]];
    for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let m = |column: usize| {
            let unit = if axis == column { 1.0 } else { 0.0 };
            fixed(control.pose.matrix[(axis, column)] - unit, 7, 3)
        };
        table.push(vec![
            (format!("{letter} "), QUIET),
            (format!(" {}", scale.number(shift[axis])), INK),
            (format!("   {} {} {}", m(0), m(1), m(2)), INK),
        ]);
    }
    rows.push(Row::Table(table).ranked(Rank::Detail));
    if let Some(ForceReading { wrench, error }) = &control.force {
        let is_whole = error.is_none_or(|error| error.is_whole);
        let force = (FORCE, wrench.force, error.map(|error| error.force));
        let torque = (TORQUE, wrench.moment, error.map(|error| error.moment));
        for (name, (unit, vector, error)) in [("force ", force), ("torque", torque)] {
            let [whole, parts] = force_rows(name, unit, &vector, error, is_whole);
            rows.push(whole.ranked(first));
            rows.push(parts.ranked(then));
        }
    }
    rows
}

/// `force    12.34 N  ±   0.30`, and its components in the same unit. Where a part of the error is not known, `>` stands before it.
fn force_rows(name: &str, unit: Unit, vector: &Vector3<f64>, error: Option<f64>, is_whole: bool) -> [Row; 2] {
    let scale: Scale = unit.scale(vector.norm().max(error.unwrap_or(0.0)));
    let least = if is_whole { "" } else { ">" };
    let parts: String = vector.iter().map(|part| scale.part(*part)).collect();
    let [sign, by] = match error {
        Some(error) => [(format!(" ±{least:>1}"), QUIET), (fixed(scale.value(error), 6, 2), INK)],
        None => [(" error ".to_owned(), QUIET), ("unknown".to_owned(), FAIR)],
    };
    let size = (scale.number(vector.norm()), INK);
    [
        Row::Words(vec![(name.to_owned(), QUIET), size, (format!(" {}", scale.name()), QUIET), sign, by]),
        words(format!("  x y z {parts}"), QUIET),
    ]
}
