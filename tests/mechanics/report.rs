//! The report of `accuracy`: its files are well formed, honest and safe, whatever was measured. All data are made up.

use crate::report_common::made_up;
use greenstage::measure::poses::Random;
use greenstage::measure::{
    Errors, Measurement, Report, SCHEMA, Setting, Shapes, Spread, Timing, TrialMotion,
};
use greenstage::report::{self, COST_METRICS, ONLINE, ReportError, cheapest, ladder, pictures, summary};
use nalgebra::Vector3;
use proptest::prelude::*;
use quick_xml::escape::resolve_predefined_entity;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::collections::BTreeMap;

/// An element of a document: its name, and its attributes.
type Element = (String, BTreeMap<String, String>);
/// Spoils a number of a report.
type Spoil = fn(&mut Report, f64);

/// The elements and all the text of a document; fails where it is not well formed.
fn parsed(document: &str) -> (Vec<Element>, String) {
    let mut reader = Reader::from_str(document);
    reader.config_mut().check_end_names = true;
    let (mut elements, mut text, mut depth) = (Vec::new(), String::new(), 0_i32);
    let element = |of: &BytesStart| {
        let attributes = of.attributes().map(|attribute| {
            let attribute = attribute.unwrap();
            let key = String::from_utf8(attribute.key.as_ref().to_vec()).unwrap();
            (key, attribute.normalized_value(XmlVersion::Implicit1_0).unwrap().into_owned())
        });
        (String::from_utf8(of.name().as_ref().to_vec()).unwrap(), attributes.collect())
    };
    loop {
        match reader.read_event().unwrap() {
            Event::Start(of) => {
                depth += 1;
                elements.push(element(&of));
            }
            Event::Empty(of) => elements.push(element(&of)),
            Event::End(_) => depth -= 1,
            Event::Text(words) => text.push_str(&words.decode().unwrap()),
            Event::GeneralRef(name) => match name.resolve_char_ref().unwrap() {
                Some(c) => text.push(c),
                None => text.push_str(resolve_predefined_entity(&name.decode().unwrap()).unwrap()),
            },
            Event::Eof => break,
            _ => {}
        }
    }
    assert_eq!(depth, 0, "every element is closed");
    (elements, text)
}

/// All files of a report in a folder of their own.
fn written(report: &Report) -> (tempfile::TempDir, Vec<(String, String)>) {
    let dir = tempfile::tempdir().unwrap();
    let paths = report::write(dir.path(), report).unwrap();
    let name =
        |path: &std::path::PathBuf| path.strip_prefix(dir.path()).unwrap().to_str().unwrap().to_owned();
    let files = paths.iter().map(|path| (name(path), std::fs::read_to_string(path).unwrap())).collect();
    (dir, files)
}

fn well_formed(report: &Report) {
    let (_dir, files) = written(report);
    for (name, text) in &files {
        if name.ends_with(".svg") || name.ends_with(".html") {
            assert!(!parsed(text).0.is_empty(), "{name}");
            assert!(!text.contains("NaN") && !text.contains("inf"), "{name} draws a number that is none");
        }
    }
    assert!(!summary(report).is_empty());
}

/// The plots of the models from 1° to 360°.
const TRIALS: [&str; 4] = ["trial-displacement", "trial-force", "trial-torque", "trial-time"];

#[test]
fn all_files_are_written_and_well_formed() {
    let report = made_up();
    let (dir, files) = written(&report);
    let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
    let first = ["online", "online-force", "split", "mesh", "solver", "storage", "models"];
    let plots = first.into_iter().chain(TRIALS).chain(["smooth-l2", "smooth-energy"]);
    let plots: Vec<String> = plots.map(|name| format!("plots/{name}.svg")).collect();
    assert_eq!(names[..4], ["index.html", "accuracy.json", "accuracy.csv", "models.csv"]);
    assert_eq!(names[4..], plots);
    well_formed(&report);
    assert_eq!(report::read(&dir.path().join("accuracy.json")).unwrap(), report, "to the last bit");
}

/// Corners of a path or the centre of a circle.
fn places((name, attributes): &(String, BTreeMap<String, String>)) -> Vec<[f64; 2]> {
    let number = |text: &str| text.parse::<f64>().unwrap();
    match name.as_str() {
        "circle" => vec![[number(&attributes["cx"]), number(&attributes["cy"])]],
        "path" if !attributes.contains_key("fill") => attributes["d"]
            .trim_end_matches('Z')
            .split(['M', 'L'])
            .filter(|pair| !pair.is_empty())
            .map(|pair| pair.split_once(' ').map(|(x, y)| [number(x), number(y)]).unwrap())
            .collect(),
        _ => Vec::new(),
    }
}

/// The markers of a work-precision plot: how many, and that all are inside the frame.
fn markers_inside(svg: &str) -> usize {
    let (elements, _) = parsed(svg);
    let frame = elements.iter().find(|(_, a)| a.get("class").is_some_and(|c| c == "gs-frame")).unwrap();
    let [x, y, width, height] = ["x", "y", "width", "height"].map(|key| frame.1[key].parse::<f64>().unwrap());
    let titles: Vec<usize> = (0..elements.len()).filter(|&i| elements[i].0 == "title").collect();
    for &i in &titles {
        let corners = places(&elements[i + 1]);
        assert!(!corners.is_empty(), "{:?}", elements[i + 1]);
        for [px, py] in corners {
            let inside = px > x - 8.0 && px < x + width + 8.0 && py > y - 8.0 && py < y + height + 8.0;
            assert!(inside, "{px} {py} is outside of {frame:?}");
        }
    }
    titles.len()
}

#[test]
fn every_row_is_a_point_inside_the_plot() {
    for report in [made_up(), extreme(1e-310, 1e308)] {
        let (_dir, files) = written(&report);
        let plot = |name: &str| match files.iter().find(|(file, _)| file == &format!("plots/{name}.svg")) {
            Some((_, svg)) => svg,
            None => panic!("{name} is not drawn"),
        };
        assert_eq!(markers_inside(plot("online")), report.rows.len());
        assert_eq!(markers_inside(plot("online-force")), report.rows.len());
        for name in ["mesh", "solver", "storage", "models", "smooth-l2", "smooth-energy"] {
            assert!(markers_inside(plot(name)) > 0, "{name}");
        }
        assert_eq!(markers_inside(plot("models")), report.models.len());
        let rows = &report.trials.rows;
        let felt = rows.iter().filter(|row| row.held().is_some());
        let bends = felt.clone().filter(|row| row.motion == TrialMotion::Bend).count();
        let marks = [rows.len(), felt.clone().count(), felt.count(), bends];
        for (name, count) in TRIALS.into_iter().zip(marks) {
            assert_eq!(markers_inside(plot(name)), count, "{name}");
        }
    }
}

/// A plot of one point, of equal points or of errors that are nothing is left out, and the page says so.
#[test]
fn plots_that_say_nothing_are_left_out_with_a_word() {
    let mut one = made_up();
    one.rows.truncate(1);
    one.models.truncate(1);
    let names = |report: &Report| pictures(report).iter().map(|(entry, _)| entry.name).collect::<Vec<_>>();
    let page = |report: &Report| parsed(&written(report).1[0].1).1;
    assert!(!names(&one).contains(&"online") && !names(&one).contains(&"models"), "{:?}", names(&one));
    assert!(page(&one).contains("The plot online is left out: there is only one point."));
    let nothing = extreme(0.0, 0.0);
    assert!(!names(&nothing).contains(&"solver") && !names(&nothing).contains(&"storage"));
    assert!(page(&nothing).contains("The plot storage is left out: all its errors are below 10⁻¹²."));
    let mut coarse = made_up();
    coarse.smooth.retain(|row| row.refine == 0);
    coarse.smooth.iter_mut().for_each(|row| (row.l2_rate, row.energy_rate) = (None, None));
    assert!(!names(&coarse).contains(&"smooth-l2"));
    assert!(page(&coarse).contains("a single refinement has no rate of convergence"));
    // Data that are not there are no fault.
    assert!(!page(&Report { models: Vec::new(), ..made_up() }).contains("left out: there"));
}

/// The first thing on the page is an answer, in words that the rows bear out.
#[test]
fn the_page_begins_with_the_answer() {
    let report = made_up();
    let said = report::headline(&report).join(" ");
    assert!(
        said.starts_with("For ")
            && said.contains(
                " µs an evaluation, in the poses bend 10°, bend 30° and bend 60°, the shape is within "
            ),
        "{said}"
    );
    let text = parsed(&written(&report).1[0].1).1;
    let (answer, goals) = (text.find(&said[..40]).unwrap(), text.find("What each accuracy costs").unwrap());
    assert!(answer < goals && goals < text.find("What was measured").unwrap());
    // 10 %, 1 %, 0.1 %: from lax to strict.
    let lines: Vec<usize> = ["10 %", "1 %", "0.1 %"]
        .map(|goal| text[goals..].find(&format!("\n{goal}")).unwrap_or_default())
        .to_vec();
    assert!(lines.windows(2).all(|pair| pair[0] <= pair[1]), "{lines:?}");
}

/// Three settings, one pose, one scale: a picture of each, as data inside the page.
#[test]
fn the_error_is_shown_on_the_body() {
    let mut report = made_up();
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(Vector3::from);
    let own = report.rows.iter().position(|row| row.setting == report.own).unwrap();
    report.shapes = Some(Shapes {
        pose: "bend <60°>".into(),
        triangles: vec![[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]],
        equilibrium: corners.to_vec(),
        errors: vec![(own, corners.map(|x| 0.01 * x).to_vec())],
    });
    let (_dir, files) = written(&report);
    let (elements, text) = parsed(&files[0].1);
    let pictures: Vec<_> = elements.iter().filter(|(name, _)| name == "img").collect();
    assert_eq!(pictures.len(), 1);
    assert!(pictures[0].1["src"].starts_with("data:image/png;base64,iVBORw0KGgo"));
    assert!(text.contains("wrong by up to 10 mm") && text.contains("(bend <60°>)"), "{text}");
    report.shapes.as_mut().unwrap().equilibrium.fill(Vector3::zeros());
    report.shapes.as_mut().unwrap().errors.clear();
    well_formed(&report);
}

/// Half of the numbers are `a`, the others `b`, in no order that repeats from row to row.
fn extreme(a: f64, b: f64) -> Report {
    let mut report = made_up();
    // Some rows of every mesh, the scene's own among them.
    let mut place = 0..;
    report.rows.retain(|_| place.next().is_some_and(|i: usize| i % 7 == 3));
    let mut bits = Random(1);
    let mut next = || if bits.bits() & 1 == 0 { a } else { b };
    for row in &mut report.rows {
        row.cost.frame_p50_s = next();
        row.cost.offline_s = next();
        row.cost.file_bytes = next();
        let error = &mut row.error;
        let storage = error.storage.as_mut().unwrap();
        let mesh = error.discretisation.as_mut().unwrap();
        for part in [mesh, &mut error.solver, storage, &mut error.model] {
            part.median = next();
            part.worst = b;
        }
        error.total.median = next();
        error.uncancelled.median = error.total.median;
    }
    for of in &mut report.models {
        (of.rotation, of.error) = (next().min(1e300), next());
    }
    for of in &mut report.trials.rows {
        (of.displacement, of.frame_s) = (next(), next());
        (of.force, of.torque, of.energy) = (Some(next()), Some(next()), Some(-next()));
    }
    for of in &mut report.smooth {
        (of.h, of.l2, of.energy) = (next(), next(), next());
    }
    report
}

#[test]
fn few_equal_and_extreme_data_are_drawn() {
    let mut one = made_up();
    one.rows.truncate(1);
    one.models.truncate(1);
    one.trials.rows.truncate(1);
    one.smooth.truncate(1);
    one.smooth[0].l2_rate = None;
    one.effects.clear();
    well_formed(&one);
    for (a, b) in [(0.0, 0.0), (1.0, 1.0), (0.0, 1.0), (5e-324, 1.7e308), (1e-3, 1.0000001e-3)] {
        well_formed(&extreme(a, b));
    }
}

#[test]
fn a_number_that_is_none_is_refused_before_anything_is_written() {
    let cases: [(Spoil, &str); 5] = [
        (
            |report, bad| report.rows[7].error.total.worst = bad,
            "row 8 (tet4 h · cholesky · int16 · rotation): total_worst_relative",
        ),
        (
            |report, bad| report.rows[0].cost.offline_s = bad,
            "row 1 (tet4 h · cholesky · f64 · linear): offline_s",
        ),
        (|report, bad| report.models[1].error = bad, "model linear, pose bend 8°: error"),
        (|report, bad| report.trials.rows[3].force = Some(bad), "model linear, bend by 90°: force_relative"),
        (|report, bad| report.smooth[4].h = bad, "smooth problem, tet4_anp, refined 1 times: h"),
    ];
    for (spoil, told) in cases {
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            let mut report = made_up();
            spoil(&mut report, bad);
            let dir = tempfile::tempdir().unwrap();
            let error = report::write(dir.path(), &report).unwrap_err();
            assert!(error.to_string().starts_with(&format!("{told} is {bad}")), "{error}");
            assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        }
    }
    let empty = Report { rows: Vec::new(), ..made_up() };
    assert!(matches!(report::write(tempfile::tempdir().unwrap().path(), &empty), Err(ReportError::Empty)));
}

#[test]
fn another_schema_and_a_plot_of_an_older_run_do_not_pass_for_this_one() {
    let mut report = made_up();
    let (dir, _) = written(&report);
    let json = dir.path().join("accuracy.json");
    let text = std::fs::read_to_string(&json).unwrap();
    std::fs::write(&json, text.replacen(&format!("\"schema\": {SCHEMA}"), "\"schema\": 3", 1)).unwrap();
    assert!(matches!(report::read(&json), Err(ReportError::Schema { found: 3, .. })));
    report.models.clear();
    assert!(dir.path().join("plots/models.svg").exists());
    report::write(dir.path(), &report).unwrap();
    assert!(!dir.path().join("plots/models.svg").exists());
    assert!(dir.path().join("plots/online.svg").exists());
}

/// The records of RFC 4180.
fn records(csv: &str) -> Vec<Vec<String>> {
    let (mut records, mut record, mut field, mut quoted) = (Vec::new(), Vec::new(), String::new(), false);
    let mut chars = csv.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted && chars.peek() == Some(&'"') => field.push(chars.next().unwrap()),
            '"' => quoted = !quoted,
            ',' if !quoted => record.push(std::mem::take(&mut field)),
            '\r' if !quoted => {
                assert_eq!(chars.next(), Some('\n'));
                record.push(std::mem::take(&mut field));
                records.push(std::mem::take(&mut record));
            }
            c => field.push(c),
        }
    }
    assert!(!quoted && field.is_empty() && record.is_empty(), "the last line ends too");
    records
}

#[test]
fn the_csv_has_a_line_a_row_and_every_number_of_it() {
    let mut report = made_up();
    report.rows[2].setting.storage = "pcg \"1e-4\",\r\nthen".into();
    let (_dir, files) = written(&report);
    let records = records(&files[2].1);
    assert_eq!(records.len(), report.rows.len() + 1);
    let column = |name: &str| records[0].iter().position(|head| head == name).unwrap();
    assert_eq!(records[3][column("storage")], report.rows[2].setting.storage);
    for (record, row) in records[1..].iter().zip(&report.rows) {
        assert_eq!(record.len(), records[0].len());
        let number = |name: &str| record[column(name)].parse::<f64>().ok();
        assert_eq!(number("frame_p50_s"), Some(row.cost.frame_p50_s));
        assert_eq!(number("storage_median_relative"), row.error.storage.map(|part| part.median));
        assert_eq!(number("displacement_worst_m"), Some(row.error.displacement_m.worst));
        assert_eq!(number("torque_median_relative"), Some(row.error.torque.median));
    }
}

#[test]
fn models_csv_has_a_line_a_model_and_motion() {
    let report = made_up();
    let (_dir, files) = written(&report);
    let records = records(&files[3].1);
    assert_eq!(records.len(), report.trials.rows.len() + 1);
    let column = |name: &str| records[0].iter().position(|head| head == name).unwrap();
    for (record, row) in records[1..].iter().zip(&report.trials.rows) {
        let number = |name: &str| record[column(name)].parse::<f64>().ok();
        assert_eq!([&record[column("model")], &record[column("motion")]], [&row.model, row.motion.name()]);
        assert_eq!(number("displacement_relative"), Some(row.displacement));
        let parts = ["force_relative", "torque_relative", "energy_ratio"].map(number);
        assert_eq!(parts, [row.force, row.torque, row.energy]);
        assert_eq!([number("degrees"), number("frame_s")], [Some(row.degrees), Some(row.frame_s)]);
    }
}

/// The table of a terminal names the models that have forces at 90° and 180°, and the page those that have none at 360°.
#[test]
fn models_are_told_by_how_far_they_turn() {
    let report = made_up();
    let said = summary(&report);
    let line = |name: &str| said.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    assert!(line("bend 90°").contains("7.4 % · 74 %"), "{said}");
    assert!(
        line("evaluation with normals and forces").contains("900 µs") && !said.contains("bend 360°"),
        "{said}"
    );
    let page = &written(&report).1[0].1;
    assert!(page.contains("<td>bend 360°</td>") && parsed(page).1.contains("Made up: the control element"));
    let none = Report { trials: Default::default(), ..report };
    assert!(!summary(&none).contains("Models alone"));
    well_formed(&none);
}

#[test]
fn names_from_files_stay_text() {
    let hostile = "<script>alert(1)</script>\"'&]]><img src=x onerror=y>\u{202e}\u{0}\u{1b}[2J";
    let mut report = made_up();
    report.rows.truncate(8);
    let text = &mut [
        &mut report.program,
        &mut report.machine,
        &mut report.scene,
        &mut report.command,
        &mut report.body,
        &mut report.about[0],
        &mut report.references[0],
        &mut report.poses[0],
        &mut report.pose_source,
        &mut report.models[0].model,
        &mut report.smooth[0].element,
        &mut report.trials.about[0],
        &mut report.trials.rows[0].model,
        &mut report.effects[0].effect,
    ];
    text.iter_mut().for_each(|text| hostile.clone_into(text));
    hostile.clone_into(&mut report.models[1].pose);
    let Setting { element, storage, .. } = &mut report.rows[0].setting;
    [element, storage].into_iter().for_each(|text| hostile.clone_into(text));
    let (_dir, files) = written(&report);
    for (name, file) in
        files.iter().filter(|(name, _)| [".svg", ".html"].iter().any(|end| name.ends_with(end)))
    {
        let (elements, text) = parsed(file);
        for (element, attributes) in &elements {
            assert!(!["script", "img", "a", "link"].contains(&element.as_str()), "{name}: <{element}>");
            let known = |key: &String| !key.starts_with("on") && !["src", "href"].contains(&key.as_str());
            assert!(attributes.keys().all(known), "{name}: {attributes:?}");
        }
        assert!(!file.contains(['\u{202e}', '\u{0}', '\u{1b}']), "{name}");
        assert!(
            name.contains("plots") || text.contains("<script>alert(1)</script>"),
            "{name} shows it as text"
        );
    }
    assert!(!summary(&report).contains('\u{1b}'));
}

#[test]
fn the_page_needs_nothing_beside_itself() {
    let (_dir, files) = written(&made_up());
    let page = &files[0].1;
    assert_eq!(page.matches("://").count(), page.matches("xmlns=\"http://www.w3.org/2000/svg\"").count());
    for missing in ["<script", "@import", "url(", "src=", "href="] {
        assert!(!page.contains(missing), "{missing}");
    }
    let text = parsed(page).1;
    for said in [
        "What each accuracy costs",
        "Measure again",
        "greenstage accuracy configs/scenes/tube.toml",
        "Those that the scene does not list cost nothing.",
    ] {
        assert!(text.contains(said), "{said}");
    }
}

#[test]
fn recommendations_are_those_of_a_search_by_hand() {
    let rows = &made_up().rows;
    for metric in COST_METRICS {
        for goal in [1.0, 0.1, 0.03, 0.01, 0.003] {
            let reaching = rows.iter().filter(|row| row.error.uncancelled.median <= goal);
            let least = reaching.map(|row| (metric.of)(&row.cost)).fold(f64::INFINITY, f64::min);
            let chosen = &rows[cheapest(rows, metric, goal).unwrap()];
            assert!(chosen.error.uncancelled.median <= goal);
            assert!((metric.of)(&chosen.cost) <= 1.02 * least);
        }
        assert_eq!(cheapest(rows, metric, 1e-9), None);
    }
    let rungs = ladder(rows, &ONLINE);
    assert!(rungs.len() > 3);
    for pair in rungs.windows(2).map(|pair| [&rows[pair[0]], &rows[pair[1]]]) {
        assert!(pair[1].cost.frame_p50_s > pair[0].cost.frame_p50_s);
        assert!(pair[1].error.uncancelled.median <= 0.9 * pair[0].error.uncancelled.median);
    }
}

/// Rows of the finest mesh are compared with themselves: nothing is known of their error, and nothing recommends them.
#[test]
fn the_reference_is_never_recommended() {
    let mut report = made_up();
    let is_finest = |row: &Measurement| row.setting.element == "tet10" && row.setting.refine == 2;
    for row in report.rows.iter_mut().filter(|row| is_finest(row)) {
        row.error.discretisation = Some(Spread::default());
        (row.error.total, row.error.uncancelled) = (row.error.storage.unwrap(), row.error.storage.unwrap());
        row.cost.frame_p50_s = 1e-9;
    }
    let known: Vec<Measurement> = report.rows.iter().filter(|row| !is_finest(row)).cloned().collect();
    let rows = &report.rows;
    let named = |rows: &[Measurement], found: Vec<usize>| -> Vec<Setting> {
        found.into_iter().map(|i| rows[i].setting.clone()).collect()
    };
    for metric in COST_METRICS {
        for goal in [0.1, 0.01, 1e-6] {
            let of = |rows: &[Measurement]| named(rows, cheapest(rows, metric, goal).into_iter().collect());
            assert_eq!(of(rows), of(&known));
        }
        assert_eq!(named(rows, ladder(rows, metric)), named(&known, ladder(&known, metric)));
    }
    let without = Report { rows: known, ..report.clone() };
    let front = |report: &Report, name: &str| {
        let svg = pictures(report).iter().find(|(entry, _)| entry.name == name).unwrap().1.file();
        let elements = parsed(&svg).0;
        let line = elements.iter().find(|(_, a)| a.get("class").is_some_and(|c| c == "gs-front")).unwrap();
        line.1["d"].matches('L').count()
    };
    assert_eq!(front(&report, "online"), front(&without, "online"));
    let nothing_else = Report { rows: rows.iter().filter(|row| is_finest(row)).cloned().collect(), ..report };
    assert!(pictures(&nothing_else).iter().all(|(_, picture)| !parsed(&picture.file()).0.is_empty()));
    well_formed(&nothing_else);
}

/// A warning of a busy machine stands by the answer, on the page and in a terminal; an idle one has none.
#[test]
fn times_of_a_busy_machine_are_not_offered() {
    let mut report = made_up();
    report.timing = Timing { scatter: 1.05, load: 2.1, processors: 2 };
    let warning = "The machine was busy";
    assert!(!summary(&report).contains(warning) && !report::headline(&report).concat().contains(warning));
    for timing in
        [Timing { scatter: 2.4, ..report.timing.clone() }, Timing { load: 8.0, ..report.timing.clone() }]
    {
        report.timing = timing;
        assert!(summary(&report).contains(warning) && written(&report).1[0].1.contains(warning));
    }
}

/// A value that was not measured is no zero.
#[test]
fn a_part_that_is_not_known_is_a_dash() {
    let mut report = made_up();
    for row in report.rows.iter_mut() {
        (row.error.storage, row.cost.frame_bytes) = (None, None);
    }
    let (_dir, files) = written(&report);
    assert!(!pictures(&report).iter().any(|(entry, _)| entry.name == "storage"));
    assert!(report.rows.iter().all(|row| row.setting.storage == "f32" || !row.can_be_chosen()));
    let records = records(&files[2].1);
    for name in ["storage_median_relative", "frame_bytes"] {
        let column = records[0].iter().position(|head| head == name).unwrap();
        assert!(records[1..].iter().all(|record| record[column].is_empty()), "{name}");
    }
    well_formed(&report);
}

/// The solver of this row adds an error of the opposite sign: in the measured poses the whole looks best, and nothing recommends
/// it.
#[test]
fn errors_that_cancel_are_never_recommended() {
    let mut report = made_up();
    let best = ladder(&report.rows, &ONLINE).pop().unwrap();
    let lucky = |row: &mut Measurement| {
        row.error.total = Spread { median: 1e-6, worst: 2e-6 };
        row.cost.frame_p50_s = 1e-9;
    };
    let mut untrusted = report.rows[best].clone();
    (untrusted.setting.solver, untrusted.forward_error) = ("pcg 1e-4".parse().unwrap(), Some(0.04));
    untrusted.error.uncancelled = Spread { median: 1e-6, worst: 2e-6 };
    lucky(&mut untrusted);
    let mut cancelling = report.rows[0].clone();
    cancelling.setting.solver = "pcg 1e-3".parse().unwrap();
    lucky(&mut cancelling);
    cancelling.cost.frame_p50_s = report.rows[0].cost.frame_p50_s;
    let named = |rows: &[Measurement]| -> Vec<Setting> {
        ladder(rows, &ONLINE).into_iter().map(|i| rows[i].setting.clone()).collect()
    };
    let before = named(&report.rows);
    let goal = 1e-5;
    assert_eq!(cheapest(&report.rows, &ONLINE, goal), None);
    report.rows.extend([untrusted, cancelling]);
    assert_eq!(cheapest(&report.rows, &ONLINE, goal), None);
    assert_eq!(named(&report.rows), before);
}

#[test]
fn the_part_that_limits_is_the_largest() {
    let mut error = Errors::default();
    assert_eq!(error.dominating(), None);
    error.storage = Some(Spread { median: 2e-5, worst: 2e-5 });
    error.model.median = 1e-5;
    assert_eq!(error.dominating(), Some(2));
}

#[test]
fn an_effect_that_is_not_listed_and_costs_is_called_a_fault() {
    let mut report = made_up();
    let fault = "Some that the scene does not list cost something all the same";
    assert!(!written(&report).1[0].1.contains(fault));
    report.effects[2].memory_bytes = 8.0;
    assert!(written(&report).1[0].1.contains(fault));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn any_measured_numbers_are_drawn(
        numbers in prop::collection::vec(
            prop::array::uniform8(prop_oneof![1 => Just(0.0), 5 => (-14.0_f64..6.0).prop_map(|e| 10_f64.powf(e))]),
            1..25,
        )
    ) {
        let pattern = made_up();
        let row = |(i, n): (usize, &[f64; 8])| {
            let mut row: Measurement = pattern.rows[(37 * i) % pattern.rows.len()].clone();
            (row.cost.frame_p50_s, row.cost.offline_s, row.cost.file_bytes) = (n[0], n[1], n[2]);
            row.error.discretisation.as_mut().unwrap().median = n[3];
            row.error.solver.median = n[4];
            row.error.storage.as_mut().unwrap().median = n[5];
            row.error.model.median = n[6];
            row.error.total.median = n[7];
            row.error.uncancelled.median = n[7];
            row
        };
        let report = Report { rows: numbers.iter().enumerate().map(row).collect(), ..pattern.clone() };
        for (entry, picture) in pictures(&report) {
            let svg = picture.file();
            if entry.name != "split" {
                prop_assert!(markers_inside(&svg) > 0);
            }
            prop_assert!(!parsed(&svg).0.is_empty());
        }
    }
}
