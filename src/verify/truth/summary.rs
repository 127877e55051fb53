//! The table of how many printed errors hold, and the worst of those that do not.

use super::bodies::BodyKind;
use super::statement::{JudgedBody, Quantity, Source, Statement};
use crate::base::statistics::median;
use crate::base::table::Table;

/// A row of the table: its name, the statements that belong to it, and the largest turn of their pose, °.
struct Group(&'static str, Source, Quantity, f64);

const GROUPS: [Group; 8] = [
    Group("report: shape", Source::Report, Quantity::Shape, 180.0),
    Group("report: force, torque", Source::Report, Quantity::Wrench, 180.0),
    Group("planner: shape", Source::Planner, Quantity::Shape, 180.0),
    Group("planner: force, torque", Source::Planner, Quantity::Wrench, 180.0),
    Group("± force, to 60°", Source::Expected, Quantity::Force, 60.0),
    Group("± torque, to 60°", Source::Expected, Quantity::Torque, 60.0),
    Group("± force, to 90°", Source::Expected, Quantity::Force, 180.0),
    Group("± torque, to 90°", Source::Expected, Quantity::Torque, 180.0),
];

impl Group {
    fn has(&self, statement: &Statement) -> bool {
        let Group(_, source, quantity, most) = self;
        statement.source == *source && statement.quantity == *quantity && statement.turn <= *most
    }
}

/// A row for each kind of statement: how many hold of those that were printed, for each kind of body and for all; the median of
/// the printed error over the true one; and how many were not printed.
pub fn summary(bodies: &[&JudgedBody]) -> Table {
    let kinds = BodyKind::ALL.map(BodyKind::name);
    let mut table =
        Table::new(&[&["statement"], &kinds[..], &["all", "hold", "shown/true", "not measured"]].concat());
    for group in GROUPS {
        let of = |kind: Option<BodyKind>| {
            let bodies = bodies.iter().filter(move |body| kind.is_none_or(|kind| body.kind == kind));
            bodies.flat_map(|body| &body.statements).filter(|statement| group.has(statement))
        };
        let counts = |kind: Option<BodyKind>| {
            let known: Vec<bool> = of(kind).filter_map(Statement::holds).collect();
            (known.iter().filter(|holds| **holds).count(), known.len())
        };
        let cell = |kind: Option<BodyKind>| {
            let (held, all) = counts(kind);
            format!("{held} of {all}")
        };
        let (held, all) = counts(None);
        let unknown = of(None).filter(|statement| statement.shown.is_none()).count();
        let ratio = median(of(None).filter_map(Statement::ratio));
        let part = |count: usize, all: usize| match all {
            0 => String::new(),
            _ => format!("{:.1} %", 100.0 * count as f64 / all as f64),
        };
        let mut cells = vec![group.0.to_owned()];
        cells.extend(BodyKind::ALL.map(|kind| cell(Some(kind))));
        cells.extend([
            cell(None),
            part(held, all),
            if all == 0 { String::new() } else { format!("{ratio:.2}") },
            format!("{unknown} ({})", part(unknown, unknown + all)),
        ]);
        table.row(&cells.iter().map(String::as_str).collect::<Vec<_>>());
    }
    table
}

/// The statements that do not hold, the worst one of each body and source, by how far the truth is beyond them; at most `most`.
pub fn offenders(bodies: &[&JudgedBody], most: usize) -> Vec<String> {
    let mut found: Vec<(f64, String)> = Vec::new();
    for body in bodies {
        for group in [Source::Report, Source::Planner, Source::Expected] {
            let own = body.statements.iter().filter(|statement| statement.source == group);
            let broken = own.filter(|statement| statement.holds() == Some(false));
            let worst = broken.max_by(|a, b| excess(a).total_cmp(&excess(b)));
            found.extend(worst.map(|statement| (excess(statement), line(body, statement))));
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.into_iter().take(most).map(|(_, line)| line).collect()
}

/// The true error over the printed one.
fn excess(statement: &Statement) -> f64 {
    statement.shown.map_or(0.0, |shown| statement.truth / (shown + statement.doubt).max(f64::MIN_POSITIVE))
}

fn line(body: &JudgedBody, statement: &Statement) -> String {
    let Statement { source, quantity, of, shown, truth, .. } = statement;
    let number = |x: f64| match quantity {
        Quantity::Shape | Quantity::Wrench => format!("{:.3} %", 100.0 * x),
        Quantity::Force => format!("{x:.3e} N"),
        Quantity::Torque => format!("{x:.3e} N·m"),
    };
    let source = match source {
        Source::Report => "report",
        Source::Planner => "planner",
        Source::Expected => "±",
    };
    let quantity = match quantity {
        Quantity::Shape => "shape",
        Quantity::Wrench => "force or torque",
        Quantity::Force => "force",
        Quantity::Torque => "torque",
    };
    format!(
        "seed {} ({}): {source}, {of}: {quantity} {} shown, {} true ({:.1} times)",
        body.seed,
        body.kind.name(),
        number(shown.unwrap_or(0.0)),
        number(*truth),
        excess(statement)
    )
}

/// Number of a source's statements that hold, for the line of a body: "34/34".
pub fn held(body: &JudgedBody, source: Source) -> String {
    let own = || body.statements.iter().filter(|statement| statement.source == source);
    let held = own().filter(|statement| statement.holds() == Some(true)).count();
    format!("{held}/{}", own().filter(|statement| statement.shown.is_some()).count())
}
