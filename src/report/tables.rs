//! The page's tables. Every cell is escaped here.

use super::answer::{CURRENCIES, GOALS, ONLINE, cheapest, ladder, limit};
use super::markup::escape;
use super::panels::distinct;
use super::pareto;
use super::units::{Unit, bytes, digits, metres, relative, seconds};
use super::{Report, Row, Spread};

struct Cell {
    text: String,
    number: bool,
    bold: bool,
}

fn word(text: impl Into<String>) -> Cell {
    Cell { text: text.into(), number: false, bold: false }
}

fn number(text: impl Into<String>) -> Cell {
    Cell { text: text.into(), number: true, bold: false }
}

fn bold(cell: Cell, bold: bool) -> Cell {
    Cell { bold, ..cell }
}

/// What heads [`knobs`](super::Setting::knobs).
const KNOBS: [&str; 4] = ["mesh and element", "solver", "storage", "model"];

/// Headings stand as their columns do.
fn html(head: &[&str], rows: &[Vec<Cell>]) -> String {
    let right = |column: usize| rows.iter().filter_map(|row| row.get(column)).any(|cell| cell.number);
    let class = |number: bool| if number { " class=\"n\"" } else { "" };
    let heading =
        |(i, name): (usize, &&str)| format!("<th scope=\"col\"{}>{}</th>", class(right(i)), escape(name));
    let head: String = head.iter().enumerate().map(heading).collect();
    let mut text = format!("<div class=\"wide\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n");
    for row in rows {
        text.push_str("<tr>");
        for cell in row {
            let inner = escape(&cell.text);
            let inner = if cell.bold { format!("<strong>{inner}</strong>") } else { inner };
            text.push_str(&format!("<td{}>{inner}</td>", class(cell.number)));
        }
        text.push_str("</tr>\n");
    }
    text + "</tbody>\n</table></div>\n"
}

/// For each goal the cheapest by each cost.
pub fn goals(rows: &[Row]) -> String {
    let line = |goal: f64| {
        let cells = CURRENCIES.map(|by| match cheapest(rows, by, goal) {
            None => word("not reached"),
            Some(i) => word(format!("{}: {}", (by.say)((by.of)(&rows[i].cost)), rows[i].setting)),
        });
        std::iter::once(number(relative(goal))).chain(cells).collect()
    };
    let head = ["total error at most", "least time of an evaluation", "least offline time", "smallest file"];
    format!("<div class=\"fold\">{}</div>", html(&head, &GOALS.map(line)))
}

/// The settings worth their online time.
pub fn rungs(rows: &[Row]) -> String {
    let line = |i: usize| {
        let Row { setting, cost, error, .. } = &rows[i];
        let mut cells: Vec<Cell> = setting.knobs().into_iter().map(word).collect();
        cells.extend([
            number(seconds(cost.frame_p50_s)),
            number(seconds(cost.offline_s)),
            number(bytes(cost.file_bytes)),
            number(relative(error.uncancelled.median)),
            number(relative(error.uncancelled.worst)),
            word(limit(&rows[i])),
        ]);
        cells
    };
    let head =
        [&KNOBS[..], &["one evaluation", "offline", "file", "total error", "worst pose", "largest part"]]
            .concat();
    html(&head, &ladder(rows, &ONLINE).into_iter().map(line).collect::<Vec<_>>())
}

/// For each row and each of [`CURRENCIES`], whether nothing reaches its total error for less.
fn fronts(rows: &[Row]) -> Vec<[bool; 3]> {
    let fronts = CURRENCIES.map(|by| {
        let point = |row: &Row| [(by.of)(&row.cost), row.error.uncancelled.median];
        pareto::front_of(rows.iter(), point)
    });
    (0..rows.len()).map(|i| fronts.each_ref().map(|front| front.contains(&i))).collect()
}

fn knobs(row: &Row, on: [bool; 3]) -> Vec<Cell> {
    row.setting.knobs().into_iter().map(|knob| bold(word(knob), on.contains(&true))).collect()
}

pub fn costs(rows: &[Row]) -> String {
    let line = |(row, on): (&Row, [bool; 3])| {
        let cost = &row.cost;
        let mut cells = knobs(row, on);
        cells.extend([
            number(row.mesh_nodes.to_string()),
            number(row.surface_nodes.to_string()),
            bold(number(seconds(cost.offline_s)), on[1]),
            number(bytes(cost.offline_bytes)),
            bold(number(bytes(cost.file_bytes)), on[2]),
            number(bytes(cost.packed_bytes)),
            bold(number(seconds(cost.frame_p50_s)), on[0]),
            number(seconds(cost.frame_p99_s)),
            number(seconds(cost.frame_one_p50_s)),
            number(bytes(cost.frame_bytes)),
            bold(number(relative(row.error.uncancelled.median)), on.contains(&true)),
        ]);
        cells
    };
    let head = [
        &KNOBS[..],
        &[
            "nodes",
            "of the surface",
            "offline",
            "memory offline",
            "file",
            "file packed",
            "one evaluation",
            "p99",
            "one element moved",
            "reads",
            "total error",
        ],
    ]
    .concat();
    html(&head, &rows.iter().zip(fronts(rows)).map(line).collect::<Vec<_>>())
}

pub fn errors(rows: &[Row]) -> String {
    let both = |spread: Spread| number(format!("{} / {}", relative(spread.median), relative(spread.worst)));
    let maybe = |spread: Option<Spread>| spread.map_or_else(|| number("–"), both);
    let line = |(row, on): (&Row, [bool; 3])| {
        let error = &row.error;
        let largest = error.dominating();
        let mut cells = knobs(row, on);
        cells.extend(
            error.parts().into_iter().enumerate().map(|(i, part)| bold(both(part), largest == Some(i))),
        );
        cells.extend([both(error.uncancelled), both(error.total), both(error.energy)]);
        let displacement = error.displacement_m;
        cells.push(number(format!("{} / {}", metres(displacement.median), metres(displacement.worst))));
        cells.extend([maybe(error.force), maybe(error.torque)]);
        cells
    };
    let head = [
        &KNOBS[..],
        &[
            "discretisation",
            "solver",
            "storage",
            "model",
            "total error",
            "as measured",
            "energy norm",
            "displacement",
            "force",
            "torque",
        ],
    ]
    .concat();
    html(&head, &rows.iter().zip(fronts(rows)).map(line).collect::<Vec<_>>())
}

/// A line a pose, a column a model.
pub fn models(report: &Report) -> String {
    let models = distinct(report.models.iter().map(|of| of.model.as_str()));
    let mut poses = distinct(report.models.iter().map(|of| (of.pose.as_str(), of.rotation)));
    poses.sort_by(|a, b| a.1.total_cmp(&b.1));
    let line = |&(pose, rotation): &(&str, f64)| {
        let here = |model: &&str| {
            report
                .models
                .iter()
                .find(|of| (of.pose.as_str(), of.rotation, of.model.as_str()) == (pose, rotation, *model))
        };
        let least = models.iter().filter_map(here).map(|of| of.error).fold(f64::INFINITY, f64::min);
        let cell = |model: &&str| match here(model) {
            None => number("–"),
            Some(of) => bold(
                number(format!("{} ({})", relative(of.error), metres(of.displacement_m))),
                of.error == least,
            ),
        };
        let first = [word(pose), number(format!("{}°", digits(rotation.to_degrees(), 3)))];
        first.into_iter().chain(models.iter().map(cell)).collect()
    };
    let head: Vec<&str> = ["pose", "largest rotation"].into_iter().chain(models.iter().copied()).collect();
    html(&head, &poses.iter().map(line).collect::<Vec<_>>())
}

pub fn smooth(report: &Report) -> String {
    let slope = |rate: Option<f64>| number(rate.map_or_else(|| "–".into(), |rate| format!("{rate:.2}")));
    let lines = report.smooth.iter().map(|row| {
        vec![
            word(&row.element),
            number(row.refine.to_string()),
            number(Unit::Metres.text(row.h)),
            number(relative(row.l2)),
            slope(row.l2_rate),
            number(digits(row.promised[0], 3)),
            number(relative(row.energy)),
            slope(row.energy_rate),
            number(digits(row.promised[1], 3)),
        ]
    });
    let head =
        ["element", "refined", "h", "L2", "slope of L2", "theory", "energy", "slope of energy", "theory"];
    html(&head, &lines.collect::<Vec<_>>())
}

pub fn effects(report: &Report) -> String {
    let lines = report.effects.iter().map(|of| {
        vec![
            bold(word(&of.effect), of.listed),
            word(if of.listed { "yes" } else { "no" }),
            number(seconds(of.offline_s)),
            number(bytes(of.file_bytes)),
            number(bytes(of.memory_bytes)),
            number(seconds(of.frame_s)),
        ]
    });
    let head = ["effect", "listed in the scene", "offline", "in the file", "memory online", "a frame"];
    html(&head, &lines.collect::<Vec<_>>())
}
