//! Which points each plot shows: one plot a question.

use super::answer::{ONLINE, ladder, limit};
use super::pareto;
use super::plot::{Picture, Plot, Point, Scale};
use super::units::{Unit, bytes, relative, seconds};
use super::{Errors, PARTS, Report, Row, Setting, Spread, smooth_panels, split};

/// The stems of all files that plots/ may hold.
pub const NAMES: [&str; 8] =
    ["online", "split", "mesh", "solver", "storage", "models", "smooth-l2", "smooth-energy"];

/// Every plot that the report has data for, in the order of the page.
pub fn panels(report: &Report) -> Vec<Picture> {
    let rows = &report.rows;
    let mut pictures = Vec::new();
    if !rows.is_empty() {
        pictures.push(online(rows).picture());
        pictures.push(split::picture(rows));
        pictures.push(mesh(rows).picture());
        pictures.push(solver(rows).picture());
        pictures.push(storage(rows).picture());
    }
    if !report.models.is_empty() {
        pictures.push(models(report).picture());
    }
    if !report.smooth.is_empty() {
        pictures.extend(smooth_panels::plots(&report.smooth).iter().map(Plot::picture));
    }
    pictures
}

fn ratio(label: &str) -> Scale {
    Scale { label: label.into(), unit: Unit::Ratio, logarithmic: true }
}

fn time(label: &str) -> Scale {
    Scale { label: label.into(), unit: Unit::Seconds, logarithmic: true }
}

/// What differs between settings, and what they share as a note.
pub fn naming(settings: &[&Setting]) -> (Vec<String>, String) {
    let knobs: Vec<[String; 4]> = settings.iter().map(|setting| setting.knobs()).collect();
    let varies: Vec<bool> = (0..4).map(|k| knobs.iter().any(|of| of[k] != knobs[0][k])).collect();
    let chosen = |of: &[String; 4], which: bool| -> Vec<String> {
        (0..4).filter(|&k| varies[k] == which).map(|k| of[k].clone()).collect()
    };
    let shared = knobs.first().map(|of| chosen(of, false)).unwrap_or_default();
    let names =
        knobs.iter().map(|of| if shared.len() == 4 { of.join(" · ") } else { chosen(of, true).join(" · ") });
    let note = if shared.is_empty() || shared.len() == 4 {
        String::new()
    } else {
        format!("In every labelled setting: {}.", shared.join(" · "))
    };
    (names.collect(), note)
}

/// Values in the order of their first appearance.
pub fn distinct<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for value in values {
        if !found.contains(&value) {
            found.push(value);
        }
    }
    found
}

pub fn tip(row: &Row) -> String {
    format!(
        "{}: {} an evaluation, {} offline, {}; total error {} (worst pose {}), most of it {}",
        row.setting,
        seconds(row.cost.frame_p50_s),
        seconds(row.cost.offline_s),
        bytes(row.cost.file_bytes),
        relative(row.error.uncancelled.median),
        relative(row.error.uncancelled.worst),
        limit(row)
    )
}

/// Question 2: microseconds of an evaluation against the total error; which part limits is the colour.
fn online(rows: &[Row]) -> Plot {
    let rungs = ladder(rows, &ONLINE);
    let (names, note) = naming(&rungs.iter().map(|&i| &rows[i].setting).collect::<Vec<_>>());
    let mut points: Vec<Point> = rows
        .iter()
        .map(|row| Point {
            x: row.cost.frame_p50_s,
            y: row.error.uncancelled.median,
            worst: None,
            series: row.error.dominating().unwrap_or(0),
            strong: false,
            label: None,
            tip: tip(row),
        })
        .collect();
    let front = pareto::front_of(rows.iter(), |row| [row.cost.frame_p50_s, row.error.uncancelled.median]);
    for &i in front.iter().chain(&rungs) {
        points[i].strong = true;
    }
    for (&i, name) in rungs.iter().zip(names) {
        points[i].label = Some(name);
        points[i].worst = Some(rows[i].error.uncancelled.worst);
    }
    Plot {
        name: "online",
        title: "What an evaluation costs, and how wrong it is".into(),
        note,
        x: time("time of one evaluation with every control element moved (median)"),
        y: ratio("total error, relative L2 (median of the poses)"),
        series: PARTS.iter().map(|part| format!("mostly {part}")).collect(),
        points,
        lines: Vec::new(),
        front,
        triangles: Vec::new(),
    }
}

/// Question 1: offline seconds against the discretisation error.
fn mesh(rows: &[Row]) -> Plot {
    let elements = distinct(rows.iter().map(|row| &row.setting.element));
    let chosen = fastest_on_each_mesh(rows);
    let mut points: Vec<Point> = chosen
        .iter()
        .map(|row| Point {
            x: row.cost.offline_s,
            y: row.error.discretisation.median,
            worst: Some(row.error.discretisation.worst),
            series: elements.iter().position(|of| **of == row.setting.element).unwrap_or(0),
            strong: false,
            label: Some(row.setting.mesh()),
            tip: format!(
                "{}, {}: {} offline, {} nodes; discretisation error {}",
                row.setting.mesh(),
                row.setting.solver,
                seconds(row.cost.offline_s),
                row.mesh_nodes,
                relative(row.error.discretisation.median)
            ),
        })
        .collect();
    let at = |row: &Row| [row.cost.offline_s, row.error.discretisation.median];
    let front = pareto::front_of(chosen.iter().copied(), at);
    front.iter().for_each(|&i| points[i].strong = true);
    let lines = (0..elements.len()).map(|e| (0..points.len()).filter(|&i| points[i].series == e).collect());
    Plot {
        name: "mesh",
        title: "What the mesh and the element cost, and what they bring".into(),
        note: "h/2: the scene's mesh refined once. The fastest solver that adds no more than a hundredth."
            .into(),
        x: time("offline time"),
        y: ratio("discretisation error, relative L2 (median of the poses)"),
        series: elements.iter().map(|element| (*element).clone()).collect(),
        lines: lines.collect(),
        front,
        triangles: Vec::new(),
        points,
    }
}

/// For every element and refinement the fastest row whose solver adds no more than a hundredth of the discretisation
/// error; where no solver does, the row with the least solver error. By element, then refinement.
pub fn fastest_on_each_mesh(rows: &[Row]) -> Vec<&Row> {
    let meshes = distinct(rows.iter().map(|row| (&row.setting.element, row.setting.refine)));
    let mut chosen: Vec<&Row> = meshes
        .into_iter()
        .filter_map(|(element, refine)| {
            let is_here = |r: &&Row| (&r.setting.element, r.setting.refine) == (element, refine);
            let here = || rows.iter().filter(is_here).filter(|row| row.is_trusted());
            let exact = |row: &&Row| row.error.solver.median <= 0.01 * row.error.discretisation.median;
            here()
                .filter(exact)
                .min_by(|a, b| a.cost.offline_s.total_cmp(&b.cost.offline_s))
                .or_else(|| here().min_by(|a, b| a.error.solver.median.total_cmp(&b.error.solver.median)))
        })
        .collect();
    chosen.sort_by_key(|row| row.setting.refine);
    chosen
}

/// What one knob does on each mesh: a thin line a mesh, a colour and shape for each position of the knob.
struct Knob {
    of: fn(&Setting) -> String,
    cost: fn(&Row) -> f64,
    error: fn(&Errors) -> Spread,
    say: fn(f64) -> String,
}

/// The points, the names of the knob's positions, the lines.
fn by_mesh(rows: &[Row], knob: &Knob) -> (Vec<Point>, Vec<String>, Vec<Vec<usize>>) {
    let mut positions = distinct(rows.iter().map(|row| (knob.of)(&row.setting)));
    positions.sort_by(|a, b| by_number(a, b));
    let mut points = Vec::new();
    let mut lines = Vec::new();
    for mesh in distinct(rows.iter().map(|row| row.setting.mesh())) {
        let mut line = Vec::new();
        for (series, position) in positions.iter().enumerate() {
            let here = rows.iter().filter(|r| r.setting.mesh() == mesh && (knob.of)(&r.setting) == *position);
            let Some(row) = here.min_by(|a, b| (knob.cost)(a).total_cmp(&(knob.cost)(b))) else {
                continue;
            };
            let (x, error) = ((knob.cost)(row), (knob.error)(&row.error));
            let tip = format!("{mesh}, {position}: {}, error {}", (knob.say)(x), relative(error.median));
            line.push(points.len());
            points.push(Point { x, y: error.median, worst: None, series, strong: false, label: None, tip });
        }
        let at: Vec<[f64; 2]> = line.iter().map(|&i| [points[i].x, points[i].y]).collect();
        for k in pareto::front(&at) {
            points[line[k]].strong = true;
        }
        line.sort_by(|&a, &b| points[b].y.total_cmp(&points[a].y).then(points[a].x.total_cmp(&points[b].x)));
        if let Some(&last) = line.last() {
            points[last].label = Some(mesh);
        }
        lines.push(line);
    }
    (points, positions, lines)
}

/// "pcg 1e-10" after "pcg 1e-4": words by their text, the number at their end downwards.
pub fn by_number(a: &str, b: &str) -> std::cmp::Ordering {
    let split =
        |text: &str| match text.rsplit_once(' ').map(|(head, tail)| (head.to_owned(), tail.parse::<f64>())) {
            Some((head, Ok(number))) => (head, number),
            _ => (text.to_owned(), 0.0),
        };
    let ((a, x), (b, y)) = (split(a), split(b));
    a.cmp(&b).then(y.total_cmp(&x))
}

/// Question 3: bytes against the storage error.
fn storage(rows: &[Row]) -> Plot {
    let knob = Knob {
        of: |setting| setting.storage.clone(),
        cost: |row| row.cost.file_bytes,
        error: |errors| errors.storage,
        say: bytes,
    };
    let (points, series, lines) = by_mesh(rows, &knob);
    Plot {
        name: "storage",
        title: "What the storage of the columns costs".into(),
        note: "A thin line joins the storages of one mesh; filled: nothing else on that mesh beats it."
            .into(),
        x: Scale { label: "size of the .green file".into(), unit: Unit::Bytes, logarithmic: true },
        y: ratio("storage error, relative L2 (median of the poses)"),
        series,
        points,
        lines,
        front: Vec::new(),
        triangles: Vec::new(),
    }
}

/// Question 4: offline seconds against the solver error.
fn solver(rows: &[Row]) -> Plot {
    let knob = Knob {
        of: |setting| setting.solver.to_string(),
        cost: |row| row.cost.offline_s,
        error: |errors| errors.solver,
        say: seconds,
    };
    let (points, series, lines) = by_mesh(rows, &knob);
    Plot {
        name: "solver",
        title: "What the solver and its tolerance cost".into(),
        note: "A thin line joins the solvers on one mesh; filled: nothing else on that mesh beats it.".into(),
        x: time("offline time"),
        y: ratio("solver error, relative L2 (median of the poses)"),
        series,
        points,
        lines,
        front: Vec::new(),
        triangles: Vec::new(),
    }
}

/// Question 5: the error of the models by the largest local rotation.
fn models(report: &Report) -> Plot {
    let models = distinct(report.models.iter().map(|of| &of.model));
    let points: Vec<Point> = report
        .models
        .iter()
        .map(|of| Point {
            x: of.rotation.to_degrees(),
            y: of.error,
            worst: None,
            series: models.iter().position(|model| **model == of.model).unwrap_or(0),
            strong: true,
            label: None,
            tip: format!(
                "{}, pose {}: {} at {:.1}°",
                of.model,
                of.pose,
                relative(of.error),
                of.rotation.to_degrees()
            ),
        })
        .collect();
    let line = |series: usize| {
        let mut line: Vec<usize> = (0..points.len()).filter(|&i| points[i].series == series).collect();
        line.sort_by(|&a, &b| points[a].x.total_cmp(&points[b].x));
        line
    };
    Plot {
        name: "models",
        title: "How wrong the models are by how far the body turns".into(),
        note: "Against the converged nonlinear solution on the same mesh: the model's error alone.".into(),
        x: Scale {
            label: "largest local rotation of the pose".into(),
            unit: Unit::Degrees,
            logarithmic: false,
        },
        y: ratio("model error, relative L2"),
        series: models.iter().map(|model| (*model).clone()).collect(),
        lines: (0..models.len()).map(line).collect(),
        front: Vec::new(),
        triangles: Vec::new(),
        points,
    }
}
