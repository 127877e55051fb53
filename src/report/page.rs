//! One self-contained page: the answer in words, the error on the body, plots, tables and a glossary. It needs no network and no
//! script.

use super::answer::{Shown, headline, shown};
use super::canvas::{Picture, STYLE, escape};
use super::pareto::costs;
use super::plots::{PLOTS, PlotEntry, left_out};
use super::relief::{COLOURS, Frame, Relief, View};
use super::tables::{self, capital};
use crate::base::text::base64;
use crate::measure::units::{Unit, metres};
use crate::measure::{EffectCost, Report, Shapes, largest};
use nalgebra::Vector3;

/// The whole file. `pictures` are those of [`super::pictures()`].
pub fn page(report: &Report, pictures: &[(&PlotEntry, Picture)]) -> String {
    let title = format!("What accuracy costs in time: {}", report.body);
    let shown_title = format!("What accuracy costs: {}", report.body);
    let body =
        [answer(report), plots(report, pictures), all_tables(report), measured(report), glossary(report)];
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\"/>\n\
         <title>{title}</title>\n<style>\n{}{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{shown_title}</h1>\n{}</main>\n</body>\n</html>\n",
        include_str!("page.css"),
        // A dot between parameters stays at the end of a line.
        body.concat().replace(" · ", "\u{a0}· "),
        title = escape(&title),
        shown_title = escape(&shown_title),
    )
}

fn paragraph(text: &str) -> String {
    format!("<p>{}</p>\n", escape(text))
}

/// Escaped, with its tabs and ends of lines.
fn escape_lines(text: &str) -> String {
    let line = |line: &str| line.split('\t').map(escape).collect::<Vec<_>>().join("\t");
    text.lines().map(line).collect::<Vec<_>>().join("\n")
}

fn heading(text: &str) -> String {
    format!("<h2>{}</h2>\n", escape(text))
}

/// The answer first: in words, as a table of three settings, and for each goal.
fn answer(report: &Report) -> String {
    let said = headline(report);
    let (first, rest) = said.split_first().map_or(("", &[][..]), |(first, rest)| (first.as_str(), rest));
    let rest: String = rest.iter().map(|text| paragraph(text)).collect();
    let quick = if report.quick {
        paragraph("Measured with --quick: fewer settings and repetitions. Use a full run for decisions.")
    } else {
        String::new()
    };
    let left_out: String = report.left_out.iter().map(|text| paragraph(text)).collect();
    let lead = format!(
        "The body {} was computed with {} settings of mesh, element, solver, storage and model. Each was timed, and compared with \
         static equilibrium at large strain on a finer mesh, in the same poses.",
        report.body,
        report.rows.len()
    );
    [
        format!("<div class=\"answer\">\n<p>{}</p>\n{rest}</div>\n", escape(first)),
        tables::compared(report),
        paragraph(
            "Errors are those of the worst of the measured poses: of the shape relative to how far the body moves (in brackets the \
             largest distance), of force and torque relative to the largest force or torque over length that equilibrium needs. Parts that cancel by chance in \
             these poses are counted as if they did not. One evaluation leads from poses to the surface, without normals and \
             drawing. Up to 5 % a quantity can be \
             trusted, up to 25 % it is a rough guide.",
        ),
        quick,
        left_out,
        figure(report),
        heading("What each accuracy costs"),
        tables::goals(&report.rows),
        paragraph(&lead),
    ]
    .concat()
}

fn measured(report: &Report) -> String {
    let mut facts = String::new();
    let mut fact = |name: &str, lines: &[String]| {
        if !lines.is_empty() {
            let lines: Vec<String> = lines.iter().map(|line| escape(line)).collect();
            facts.push_str(&format!("<dt>{name}</dt><dd>{}</dd>\n", lines.join("<br/>")));
        }
    };
    let size = format!(
        "{}, largest extent {}, of the scene {}",
        report.body,
        Unit::Metres.text(report.size),
        report.scene
    );
    fact("Body", &[&[size], report.about.as_slice()].concat());
    fact("Poses", &[format!("{} ({}): {}", report.poses.len(), report.pose_source, report.poses.join(", "))]);
    fact("Measured against", &report.references);
    fact("Models from 1° to 360°", &report.trials.about);
    fact("Machine", std::slice::from_ref(&report.machine));
    fact("Program", std::slice::from_ref(&report.program));
    heading("What was measured") + "<dl class=\"facts\">\n" + &facts + "</dl>\n"
}

fn plots(report: &Report, pictures: &[(&PlotEntry, Picture)]) -> String {
    let silent = left_out(report);
    let (mut text, mut open) = (String::new(), "");
    for entry in PLOTS {
        if !entry.heading.is_empty() {
            open = entry.heading;
        }
        let picture = pictures.iter().find(|(of, _)| of.name == entry.name).map(|(_, picture)| picture);
        let why = silent.iter().find(|(of, _)| of.name == entry.name).map(|(_, why)| why);
        if picture.is_none() && why.is_none() {
            continue;
        }
        if !open.is_empty() {
            text += &heading(std::mem::take(&mut open));
        }
        if let Some(picture) = picture {
            let mut caption = escape(&(entry.caption)(report));
            if !caption.is_empty() {
                caption = format!(" <strong>Here:</strong> {caption}");
            }
            let (picture, reading) = (picture.inline(), escape(entry.reading));
            text += &format!(
                "<figure>\n<div class=\"plot\">{picture}</div><figcaption>{reading}{caption}</figcaption>\n</figure>\n"
            );
        } else if let Some(why) = why {
            text += &format!(
                "<p class=\"muted\">The plot {} is left out: {}.</p>\n",
                escape(entry.name),
                escape(why)
            );
        }
        if let Some((said, table)) = entry.table {
            text += &(paragraph(said) + &table(report));
        }
    }
    text
}

fn all_tables(report: &Report) -> String {
    let mut text = String::new();
    if !report.models.is_empty() {
        text += &heading("Models, pose by pose");
        text += &paragraph(
            "Relative L2 error, and the largest error of a displacement; the least in each pose is bold.",
        );
        text += &tables::models(report);
    }
    if !report.smooth.is_empty() {
        text += &heading("Smooth problem, in numbers");
        text += &tables::smooth(report);
    }
    if !report.effects.is_empty() {
        text += &heading("Effects");
        text += &paragraph(effects(report));
        if report.effects.iter().any(|of| of.listed || !of.is_free()) {
            text += &tables::effects(report);
        }
    }
    text += &heading("Every setting");
    text += &paragraph(
        "A cost is bold where no other setting reaches as small a total error for less of it, and a setting where one \
         of its costs is. The numbers are in accuracy.csv and accuracy.json beside this page.",
    );
    let count = report.rows.len();
    text += &format!(
        "<details>\n<summary>A table to copy into a spreadsheet (tabs between the columns)</summary>\n<pre>{}</pre>\n</details>\n",
        escape_lines(&tables::to_copy(&report.rows))
    );
    text += &format!(
        "<details>\n<summary>Costs of all {count} settings</summary>\n{}</details>\n",
        tables::costs(&report.rows)
    );
    text += &format!(
        "<details>\n<summary>Errors of all {count} settings</summary>\n{}{}</details>\n",
        paragraph("Median of the poses / worst pose. The largest part is bold. –: not measured."),
        tables::errors(&report.rows)
    );
    text
}

/// Introduces the table of effects.
fn effects(report: &Report) -> &'static str {
    let is_faulty = |of: &EffectCost| !of.listed && !of.is_free();
    if !report.effects.iter().any(|of| of.listed || is_faulty(of)) {
        "The scene lists no effect that was measured; those that it does not list cost nothing."
    } else if !report.effects.iter().any(is_faulty) {
        "What each effect costs on top. Those that the scene does not list cost nothing."
    } else {
        "What each effect costs on top. Some that the scene does not list cost something all the same: a fault."
    }
}

fn glossary(report: &Report) -> String {
    format!(
        "{}{}{}<pre>{}</pre>\n{}",
        heading("Words"),
        include_str!("glossary.html"),
        heading("Measure again"),
        escape(&report.command),
        paragraph("Times depend on the machine; errors do not, up to the last digits."),
    )
}

/// The figure as HTML; empty where there are no shapes.
pub fn figure(report: &Report) -> String {
    let Some(shapes) = &report.shapes else { return String::new() };
    let view = View::facing(&shapes.equilibrium);
    let bent: Vec<Vec<Vector3<f64>>> = shapes.errors.iter().map(|(_, error)| moved(shapes, error)).collect();
    let all = bent.iter().flatten().chain(&shapes.equilibrium);
    let Some(frame) = Frame::around(view, all) else { return String::new() };
    let most = shapes.errors.iter().map(|(_, error)| largest(error)).fold(0.0, f64::max);
    let panel = |Shown { role, row }: &Shown| {
        let at = shapes.errors.iter().position(|(of, _)| of == row)?;
        let error = &shapes.errors[at].1;
        let part: Vec<f64> = error.iter().map(|e| e.norm() / most.max(f64::MIN_POSITIVE)).collect();
        let mut relief = Relief::new(frame);
        relief.ghost(&shapes.triangles, &shapes.equilibrium);
        relief.surface(&shapes.triangles, &bent[at], &part);
        let name = capital(role);
        let setting = &report.rows[*row];
        Some(format!(
            "<figure><img alt=\"{}\" width=\"{}\" height=\"{}\" src=\"data:image/png;base64,{}\"/>\n\
             <figcaption><strong>{}: wrong by up to {}</strong><br/>{}<br/><span class=\"muted\">{}</span></figcaption></figure>\n",
            escape(&format!("The body by {}, coloured by its error", setting.setting)),
            frame.size[0],
            frame.size[1],
            base64(&relief.png()),
            escape(&name),
            escape(&metres(largest(error))),
            escape(&setting.setting.to_string()),
            escape(&costs(&setting.cost)),
        ))
    };
    let panels: String = shown(report).iter().filter_map(panel).collect();
    let stops: Vec<String> = COLOURS.iter().map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    format!(
        "<h2>The error on the body</h2>\n<p>The body in the pose in which this scene's setting is furthest off ({}), as each \
         setting bends it; grey behind it: equilibrium. All pictures have the same colours.</p>\n<div class=\"bodies\">\n{panels}</div>\n\
         <div class=\"scale\"><div style=\"background:linear-gradient(90deg,{})\"></div><p><span>0</span><span>{}</span><span>{}</span></p></div>\n\
         <p class=\"muted\">Colour: distance of a point of the surface from where equilibrium has it.</p>\n",
        escape(&shapes.pose),
        stops.join(","),
        escape(&metres(0.5 * most)),
        escape(&metres(most)),
    )
}

fn moved(shapes: &Shapes, error: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    shapes.equilibrium.iter().zip(error).map(|(x, e)| x + e).collect()
}
