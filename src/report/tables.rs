//! The tables of a report: in HTML for its page, as text for a terminal, as Markdown for a README. A row is a list of named cells;
//! every cell of the page is escaped here.

use super::answer::{
    GOALS, Shown, Trust, cheapest_with, headline, ladder, most_accurate, recommendations, shown,
};
use super::canvas::escape;
use super::pareto::{self, COLUMNS, COST_METRICS, CostMetric, FILE, OFFLINE, ONLINE};
use super::plots::common::distinct;
use crate::base::statistics::median;
use crate::base::table::Table;
use crate::base::text::plain;
use crate::measure::units::{Unit, bytes, digits, metres, relative, seconds};
use crate::measure::{Measurement, ModelTrial, PARAMETERS, Report, Spread, TrialMotion};

pub struct Cell {
    pub text: String,
    number: bool,
    bold: bool,
    /// Class of the page's style, by how far a number can be trusted.
    class: Option<&'static str>,
}

/// Cells under the names of their columns.
pub type NamedCells<'a> = Vec<(&'a str, Cell)>;

fn word(text: impl Into<String>) -> Cell {
    Cell { text: text.into(), number: false, bold: false, class: None }
}

fn number(text: impl Into<String>) -> Cell {
    Cell { text: text.into(), number: true, bold: false, class: None }
}

fn bold(cell: Cell, bold: bool) -> Cell {
    Cell { bold, ..cell }
}

/// Columns with a number stand to the right, their headings too.
fn html(lines: &[NamedCells<'_>]) -> String {
    let right = |column: usize| lines.iter().filter_map(|line| line.get(column)).any(|(_, cell)| cell.number);
    let class = |number: bool| if number { " class=\"n\"" } else { "" };
    let heading = |(i, (name, _)): (usize, &(&str, Cell))| {
        format!("<th scope=\"col\"{}>{}</th>", class(right(i)), escape(name))
    };
    let cell = |(_, cell): &(&str, Cell)| {
        let inner = escape(&cell.text);
        let inner = if cell.bold { format!("<strong>{inner}</strong>") } else { inner };
        match cell.class {
            Some(trust) => format!("<td class=\"n {trust}\">{inner}</td>"),
            None => format!("<td{}>{inner}</td>", class(cell.number)),
        }
    };
    let head: String = lines.first().into_iter().flatten().enumerate().map(heading).collect();
    let body: String = lines
        .iter()
        .map(|line| format!("<tr>{}</tr>\n", line.iter().map(cell).collect::<String>()))
        .collect();
    format!(
        "<div class=\"wide\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody>\n</table></div>\n"
    )
}

/// The settings that the page compares: their costs, and their reliability.
pub fn compared(report: &Report) -> String {
    let line = |Shown { role, row }: &Shown| {
        let Measurement { setting, cost, error, .. } = &report.rows[*row];
        let judged = |text: String, error: f64| {
            let trust = Trust::from_error(error);
            Cell { class: Some(trust_class(trust)), ..number(format!("{text}: {}", trust.word())) }
        };
        let held = error.uncancelled_held.worst;
        let shape = format!("{} ({})", relative(error.uncancelled.worst), metres(error.displacement_m.worst));
        let both = |shape: Spread, held: Spread| {
            number(format!("{}, {}", relative(shape.worst), relative(held.worst)))
        };
        let mesh = error.discretisation.zip(error.mesh_held);
        vec![
            ("setting", bold(word(capital(role)), true)),
            ("", word(setting.to_string())),
            ("one evaluation", number(seconds(cost.frame_p50_s))),
            ("shape", judged(shape, error.uncancelled.worst)),
            ("force and torque", judged(relative(held), held)),
            (
                "the mesh alone: shape, force and torque",
                mesh.map_or_else(|| number("not measured"), |(shape, held)| both(shape, held)),
            ),
            ("the model alone", both(error.model, error.model_held)),
            ("offline", number(seconds(cost.offline_s))),
            ("file", number(bytes(cost.file_bytes))),
        ]
    };
    format!("<div class=\"fold\">{}</div>", html(&shown(report).iter().map(line).collect::<Vec<_>>()))
}

fn trust_class(trust: Trust) -> &'static str {
    match trust {
        Trust::Good => "good",
        Trust::Rough => "rough",
        Trust::Bad => "bad",
    }
}

/// A table with the cheapest setting for the shape and for force and torque, in the worst pose, for each goal, from lax to
/// strict.
pub fn goals(rows: &[Measurement]) -> String {
    let line = |goal: f64| {
        let by = |metric: &CostMetric, is_good: &dyn Fn(&Measurement) -> bool| {
            cheapest_with(rows, metric, is_good).map_or_else(
                || word("nothing that was measured"),
                |i| word(format!("{}: {}", metric.unit.text((metric.of)(&rows[i].cost)), rows[i].setting)),
            )
        };
        let shape = |row: &Measurement| row.shape() <= goal;
        let held = |row: &Measurement| row.held() <= goal;
        let both = |row: &Measurement| shape(row) && held(row);
        vec![
            ("within", bold(number(relative(goal)), true)),
            ("shape: fastest evaluation", by(&ONLINE, &shape)),
            ("force and torque: fastest evaluation", by(&ONLINE, &held)),
            ("all of them: least offline time", by(&OFFLINE, &both)),
            ("all of them: smallest file", by(&FILE, &both)),
        ]
    };
    format!("<div class=\"fold\">{}</div>", html(&GOALS.map(line)))
}

/// The settings worth their time as lines with tabs between numbers without units, for a spreadsheet.
pub fn to_copy(rows: &[Measurement]) -> String {
    let percent = |error: f64| digits(100.0 * error, 3);
    let mut text = "mesh and element\tsolver\tstorage\tmodel\tone evaluation (µs)\toffline (s)\tfile (MB)\t\
                    shape, worst (%)\tlargest displacement error (mm)\tforce and torque, worst (%)\n"
        .to_owned();
    let mut shown = ladder(rows, &ONLINE);
    shown.extend(most_accurate(rows).filter(|best| !shown.contains(best)));
    for Measurement { setting, cost, error, .. } in shown.into_iter().map(|i| &rows[i]) {
        let cells = [
            digits(1e6 * cost.frame_p50_s, 3),
            digits(cost.offline_s, 3),
            digits(1e-6 * cost.file_bytes, 3),
            percent(error.uncancelled.worst),
            digits(1e3 * error.displacement_m.worst, 3),
            percent(error.uncancelled_held.worst),
        ];
        text += &format!("{}\t{}\n", setting.values().join("\t"), cells.join("\t"));
    }
    text
}

/// The settings worth their online time, from cheap to accurate.
pub fn efficient_settings(rows: &[Measurement]) -> Vec<NamedCells<'static>> {
    let line = |i: usize| {
        let Measurement { cost, error, .. } = &rows[i];
        let mut line = parameters(&rows[i], false);
        line.extend([
            ("one evaluation", number(seconds(cost.frame_p50_s))),
            ("offline", number(seconds(cost.offline_s))),
            ("file", number(bytes(cost.file_bytes))),
            ("shape", number(relative(error.uncancelled.median))),
            ("worst pose", number(relative(error.uncancelled.worst))),
            ("force and torque, worst", number(relative(rows[i].held()))),
            ("largest part", word(error.largest_part())),
        ]);
        line
    };
    ladder(rows, &ONLINE).into_iter().map(line).collect()
}

/// [`efficient_settings`] as a table of the page.
pub fn efficient(rows: &[Measurement]) -> String {
    html(&efficient_settings(rows))
}

/// Whether nothing reaches the total error of each row for less, by each of [`COST_METRICS`].
fn fronts(rows: &[Measurement]) -> Vec<[bool; 3]> {
    let fronts = COST_METRICS.map(|metric| {
        let point = |row: &Measurement| [(metric.of)(&row.cost), row.error.uncancelled.median];
        pareto::front_of(rows.iter(), point)
    });
    (0..rows.len()).map(|i| fronts.each_ref().map(|front| front.contains(&i))).collect()
}

fn parameters(row: &Measurement, is_bold: bool) -> NamedCells<'static> {
    let cells = row.setting.values().map(|value| bold(word(value), is_bold));
    PARAMETERS.iter().map(|parameter| parameter.name).zip(cells).collect()
}

pub fn costs(rows: &[Measurement]) -> String {
    let line = |(row, [online, offline, file]): (&Measurement, [bool; 3])| {
        let on_any = online || offline || file;
        let mut line = parameters(row, on_any);
        line.extend(COLUMNS.iter().map(|column| {
            let is_best = match column.name {
                "offline_s" => offline,
                "file_bytes" => file,
                "frame_p50_s" => online,
                _ => false,
            };
            let text = (column.of)(row).map_or_else(|| "–".into(), |value| column.unit.text(value));
            (column.heading, bold(number(text), is_best))
        }));
        line.push(("total error", bold(number(relative(row.error.uncancelled.median)), on_any)));
        line
    };
    html(&rows.iter().zip(fronts(rows)).map(line).collect::<Vec<_>>())
}

pub fn errors(rows: &[Measurement]) -> String {
    let both = |spread: Spread| number(format!("{} / {}", relative(spread.median), relative(spread.worst)));
    let maybe = |spread: Option<Spread>| spread.map_or_else(|| number("–"), both);
    let line = |(row, on): (&Measurement, [bool; 3])| {
        let error = &row.error;
        let largest = error.dominating();
        let mut line = parameters(row, on.contains(&true));
        let parts = PARAMETERS.iter().zip(error.parts()).enumerate();
        line.extend(parts.map(|(i, (parameter, part))| {
            let is_reference = i == 0 && row.is_reference();
            let cell = if is_reference { number("reference") } else { maybe(part) };
            (parameter.part, bold(cell, largest == Some(i)))
        }));
        let displacement = error.displacement_m;
        line.extend([
            ("total error", both(error.uncancelled)),
            ("as measured", both(error.total)),
            ("energy norm", if row.is_reference() { number("reference") } else { maybe(error.energy) }),
            (
                "displacement",
                number(format!("{} / {}", metres(displacement.median), metres(displacement.worst))),
            ),
            ("force", both(error.force)),
            ("torque", both(error.torque)),
            ("of them the mesh", maybe(error.mesh_held)),
            ("of them the model", both(error.model_held)),
        ]);
        line
    };
    html(&rows.iter().zip(fronts(rows)).map(line).collect::<Vec<_>>())
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
            Some(of) => {
                let text = format!("{} ({})", relative(of.error), metres(of.displacement_m));
                bold(number(text), of.error == least)
            }
        };
        let angle = number(format!("{}°", digits(rotation.to_degrees(), 3)));
        let first = [("pose", word(pose)), ("largest rotation", angle)];
        first.into_iter().chain(models.iter().map(|model| (*model, cell(model)))).collect()
    };
    html(&poses.iter().map(line).collect::<Vec<_>>())
}

/// A line a motion, a column a model; the last line has the median times of an evaluation with normals and forces.
pub fn trials(report: &Report) -> String {
    let cell = |row: &ModelTrial| {
        let energy = row.energy.map_or_else(|| "–".into(), |energy| format!("{energy:.3}"));
        format!("{} · {energy}", errors_of(row))
    };
    html(&trial_lines(report, &|_| true, &cell))
}

/// "0.1 % · 2 %": displacement, and the larger of force and torque.
pub fn errors_of(row: &ModelTrial) -> String {
    format!("{} · {}", relative(row.displacement), row.held().map_or_else(|| "–".into(), relative))
}

/// The motions by angles that `is_shown`, each with `text` about every model's errors.
pub fn trial_lines<'a>(
    report: &'a Report,
    is_shown: &dyn Fn(f64) -> bool,
    text: &dyn Fn(&ModelTrial) -> String,
) -> Vec<NamedCells<'a>> {
    let rows = &report.trials.rows;
    let models = distinct(rows.iter().map(|row| row.model.as_str()));
    let mut motions = distinct(rows.iter().map(|row| (row.motion, row.degrees)));
    motions.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    motions.retain(|(_, degrees)| is_shown(*degrees));
    let line = |&(motion, degrees): &(TrialMotion, f64)| {
        let here = |model: &str| {
            rows.iter().find(|row| (row.motion, row.degrees, row.model.as_str()) == (motion, degrees, model))
        };
        // Without forces a model is worse than any with them.
        let worst = |row: &ModelTrial| row.held().map_or(f64::MAX, |held| held.max(row.displacement));
        let least = models.iter().filter_map(|model| here(model)).map(worst).fold(f64::INFINITY, f64::min);
        let cell = |model: &&'a str| {
            let cell = match here(model) {
                None => number("–"),
                Some(row) => bold(number(text(row)), worst(row) == least),
            };
            (*model, cell)
        };
        let name = format!("{} {}°", motion.name(), digits(degrees, 4));
        std::iter::once(("motion", word(name))).chain(models.iter().map(cell)).collect()
    };
    let mut lines: Vec<NamedCells<'a>> = motions.iter().map(line).collect();
    if !lines.is_empty() {
        let time = |model: &&'a str| {
            let of = rows.iter().filter(|row| row.model == *model).map(|row| row.frame_s);
            (*model, number(seconds(median(of))))
        };
        let name = ("motion", word("evaluation with normals and forces"));
        lines.push(std::iter::once(name).chain(models.iter().map(time)).collect());
    }
    lines
}

pub fn smooth(report: &Report) -> String {
    let slope = |rate: Option<f64>| number(rate.map_or_else(|| "–".into(), |rate| format!("{rate:.2}")));
    let lines = report.smooth.iter().map(|row| {
        vec![
            ("element", word(&row.element)),
            ("refined", number(row.refine.to_string())),
            ("h", number(Unit::Metres.text(row.h))),
            ("L2", number(relative(row.l2))),
            ("slope of L2", slope(row.l2_rate)),
            ("theory", number(digits(row.promised[0], 3))),
            ("energy", number(relative(row.energy))),
            ("slope of energy", slope(row.energy_rate)),
            ("theory", number(digits(row.promised[1], 3))),
        ]
    });
    html(&lines.collect::<Vec<_>>())
}

pub fn effects(report: &Report) -> String {
    let lines = report.effects.iter().filter(|of| of.listed || !of.is_free()).map(|of| {
        vec![
            ("effect", bold(word(&of.effect), of.listed)),
            ("listed in the scene", word(if of.listed { "yes" } else { "no" })),
            ("offline", number(seconds(of.offline_s))),
            ("in the file", number(bytes(of.file_bytes))),
            ("memory online", number(bytes(of.memory_bytes))),
            ("its part of a frame", number(seconds(of.frame_s))),
        ]
    });
    html(&lines.collect::<Vec<_>>())
}

/// Begins a text with a capital letter.
pub fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// The angles in the table of models, degrees.
const TURNS: [f64; 4] = [10.0, 30.0, 90.0, 180.0];

/// The answer in words, the settings that are worth their online time, from cheap to accurate, and the recommendations in sentences.
pub fn summary(report: &Report) -> String {
    let settings = efficient_settings(&report.rows);
    let motions = trial_lines(report, &|degrees| TURNS.contains(&degrees), &errors_of);
    let models = if motions.is_empty() {
        String::new()
    } else {
        let lead = "Models alone, where one control element moves: error of shape · of force and torque";
        format!("\n{lead}:\n{}", text(&motions))
    };
    format!(
        "{}\n{} of {} settings, each the fastest for its error (relative L2, median of {} poses):\n{}\n{}\n{models}",
        plain(headline(report).join("\n")),
        settings.len(),
        report.rows.len(),
        report.compared.len(),
        text(&settings),
        plain(recommendations(report).join("\n")),
    )
}

/// Lines as a table for a terminal.
fn text(lines: &[NamedCells<'_>]) -> String {
    let heading: Vec<&str> = lines.first().into_iter().flatten().map(|(name, _)| *name).collect();
    let mut table = Table::new(&heading);
    for line in lines {
        let cells: Vec<String> = line.iter().map(|(_, cell)| plain(&cell.text)).collect();
        table.row(&cells.iter().map(String::as_str).collect::<Vec<_>>());
    }
    table.text()
}

/// A table with a line, for each parameter, for every setting that differs from the first row's in that parameter only.
pub fn readme_table(report: &Report) -> String {
    let heading =
        ["parameter", "setting", "offline", "file", "one evaluation", "its part of the error", "worst pose"];
    let mut table = Table::new(&heading);
    let Some(first) = report.rows.first() else { return String::new() };
    let first = first.setting.values();
    for (changed, parameter) in PARAMETERS.iter().enumerate() {
        for row in &report.rows {
            let values = row.setting.values();
            if (0..values.len()).any(|other| other != changed && values[other] != first[other]) {
                continue;
            }
            let part = (parameter.error)(&row.error);
            let is_reference = changed == 0 && row.is_reference();
            let error = |of: fn(Spread) -> f64| match part {
                _ if is_reference => "reference".to_owned(),
                None => "–".to_owned(),
                Some(part) => relative(of(part)),
            };
            table.row(&[
                parameter.name,
                &values[changed],
                &seconds(row.cost.offline_s),
                &bytes(row.cost.file_bytes),
                &seconds(row.cost.frame_p50_s),
                &error(|part| part.median),
                &error(|part| part.worst),
            ]);
        }
    }
    let references: String = report.references.iter().map(|line| format!("- {line}\n")).collect();
    format!(
        "{}, {} poses from {}; errors are relative L2, median and worst over the poses:\n\n{}\nErrors are against:\n\n{references}",
        report.machine,
        report.poses.len(),
        report.pose_source,
        table.markdown()
    )
}
