//! One page that explains itself: the answer, the plots, the tables, the words. No network, no script.

use super::answer::answers;
use super::markup::escape;
use super::plot::{Picture, STYLE};
use super::says::says;
use super::units::Unit;
use super::{EffectCost, Report, tables};

/// Name of a plot, the heading above it, and how it is read.
const READING: [(&str, &str, &str); 8] = [
    (
        "online",
        "Time of an evaluation against the total error",
        "Each mark is one setting of all knobs; left is faster, down is more accurate. The bold steps join the \
         settings that nothing beats; a thin line upward ends at the worst pose. Colour and shape say which part of \
         the error is the largest: turn that knob first.",
    ),
    (
        "split",
        "Which knob limits",
        "The settings worth their time, from cheap to accurate. The mark furthest to the right is the part that \
         limits. Knobs whose marks lie far to its left can be set cheaper without loss.",
    ),
    (
        "mesh",
        "Mesh and element",
        "Offline time against the error of the finite elements alone. A thin line joins the refinements of one \
         element; the lower line is the better buy.",
    ),
    (
        "solver",
        "Solver and tolerance",
        "Offline time against the error that the solver adds on the same mesh. It is small enough where it lies a \
         decade below the discretisation error of that mesh.",
    ),
    (
        "storage",
        "Storage",
        "Size of the file against the error of rounding its columns. Hollow marks buy nothing on their mesh.",
    ),
    (
        "models",
        "Models at large rotations",
        "Each mark is a pose. Where a line passes the dotted one, the model is wrong by more than 1 %.",
    ),
    (
        "smooth-l2",
        "Smooth problem",
        "A smooth displacement whose exact solution is known, solved on the body's own mesh: the error must fall as \
         the theory says, line parallel to triangle. Where it does not, the elements or the mesh are at fault, not \
         the body's corners.",
    ),
    ("smooth-energy", "", "The same in the energy norm, which falls one order slower."),
];

/// The whole file. `pictures` are those of [`super::panels()`].
pub fn page(report: &Report, pictures: &[Picture]) -> String {
    let title = format!("What accuracy costs in time: {}", report.body);
    let body = [answer(report), measured(report), plots(report, pictures), all_tables(report), words(report)];
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\"/>\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\"/>\n\
         <title>{title}</title>\n<style>\n{}{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n{}</main>\n</body>\n</html>\n",
        include_str!("page.css"),
        // A dot between knobs stays at the end of a line.
        body.concat().replace(" · ", "\u{a0}· "),
        title = escape(&title),
    )
}

fn paragraph(text: &str) -> String {
    format!("<p>{}</p>\n", escape(text))
}

fn heading(text: &str) -> String {
    format!("<h2>{}</h2>\n", escape(text))
}

fn answer(report: &Report) -> String {
    let lead = format!(
        "An elastic body was computed with {} choices of mesh, element, solver, storage and model. Each was timed \
         and compared with a more accurate solution. This page says what each per cent costs.",
        report.rows.len()
    );
    let told: String = answers(report).iter().map(|text| paragraph(text)).collect();
    let quick = if report.quick {
        paragraph("Measured with --quick: fewer settings and repetitions. Use a full run for decisions.")
    } else {
        String::new()
    };
    [
        paragraph(&lead),
        quick,
        format!("<div class=\"answer\">\n{told}</div>\n"),
        tables::goals(&report.rows),
        "<p class=\"muted\">Errors are relative L2, medians of the poses. Costs within 2 % count as equal.</p>\n"
            .into(),
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
    fact("Machine", std::slice::from_ref(&report.machine));
    fact("Program", std::slice::from_ref(&report.program));
    heading("What was measured") + "<dl class=\"facts\">\n" + &facts + "</dl>\n"
}

fn plots(report: &Report, pictures: &[Picture]) -> String {
    let mut text = String::new();
    for picture in pictures {
        let (_, head, reading) =
            READING.iter().find(|(name, ..)| *name == picture.name).unwrap_or(&("", "", ""));
        if !head.is_empty() {
            text += &heading(head);
        }
        let here = says(report, picture.name);
        let here = if here.is_empty() { here } else { format!(" <strong>Here:</strong> {}", escape(&here)) };
        text += &format!(
            "<figure>\n{}<figcaption>{}{here}</figcaption>\n</figure>\n",
            picture.inline(),
            escape(reading)
        );
        if picture.name == "online" {
            text += &paragraph(
                "The settings worth their online time, which the plot labels: each costs more than the one above, \
                 and has at most nine tenths of its error.",
            );
            text += &tables::rungs(&report.rows);
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
        text += &tables::effects(report);
    }
    text += &heading("Every setting");
    text += &paragraph(
        "A cost is bold where no other setting reaches as small a total error for less of it, and a setting where one \
         of its costs is. The numbers are in accuracy.csv and accuracy.json beside this page.",
    );
    let count = report.rows.len();
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

/// What the table of effects says of those that the scene does not list.
fn effects(report: &Report) -> &'static str {
    let free = |of: &EffectCost| {
        [of.offline_s, of.file_bytes, of.memory_bytes, of.frame_s].iter().all(|c| *c == 0.0)
    };
    if report.effects.iter().filter(|of| !of.listed).all(free) {
        "What each effect costs on top. Those that the scene does not list cost nothing."
    } else {
        "What each effect costs on top. Some that the scene does not list cost something all the same: a fault."
    }
}

fn words(report: &Report) -> String {
    format!(
        "{}{}{}<pre>{}</pre>\n{}",
        heading("Words"),
        include_str!("glossary.html"),
        heading("Measure again"),
        escape(&report.command),
        paragraph("Times depend on the machine; errors do not, up to the last digits."),
    )
}
