//! The studies behind tables of the manual: hard cases, the loop of the force in the hand, and the models at large rotations.
//!
//! In: the name of one of [`STUDIES`]. Out: its [`Study`]: tables, the same as JSON, and whether all held that must.

use super::hard_cases;
use super::large_rotation::{self, HeldPose, ModelAtPose, TriedBody};
use crate::base::failure::Failure;
use crate::base::table::{Table, seconds};
use crate::effect::haptics::bent::{BENDS_DEG, beam, let_go};
use crate::effect::haptics::settling::{MODULI, REPORTS, SettlingResult, settle, still};
use crate::effect::haptics::stability::{RATES_HZ, Run, START_M, STIFFNESSES, boundary, run};
use crate::effect::haptics::{Hand, Measures, Reports};
use crate::measure::online;
use crate::scene::Scene;
use crate::stage::Haptic;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::Path;

/// The results of a study.
pub struct Study {
    /// Tables with their headings in a terminal and in Markdown; empty where there is but one.
    pub tables: Vec<([String; 2], Table)>,
    pub json: Value,
    /// The closing sentence, if any; or what should have held and did not.
    pub verdict: Result<Option<String>, String>,
}

/// Makes a study, and reports the parts that have to be left out.
pub type MakeStudy = fn(&mut dyn FnMut(String)) -> Result<Study, Failure>;

/// The studies by the names by which `verify` is asked for them.
pub const STUDIES: [(&str, MakeStudy); 4] =
    [("hard-cases", hard), ("haptics", stability), ("forces", forces), ("bent", bent)];

/// Bodies for which a solver can silently be wrong.
fn hard(_: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    let rows = hard_cases::run()?;
    let mut table = Table::new(&["no.", "case", "outcome", "measured", "error", "bound"]);
    for row in &rows {
        let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.1e}"));
        let outcome = format!("{:?}", row.outcome).to_lowercase();
        let missed = if row.holds() { "" } else { " MISSED" };
        table.row(&[
            &row.number.to_string(),
            &row.case,
            &(outcome + missed),
            row.measured,
            &number(row.error),
            &number(row.bound),
        ]);
    }
    let missed = rows.iter().filter(|row| !row.holds());
    let missed: Vec<String> =
        missed.map(|row| format!("{} {}: {}", row.number, row.case, row.said)).collect();
    let (count, all) = (missed.len(), rows.len());
    let verdict = match count {
        0 => Ok(Some(format!("all {all} hard cases ended as they must"))),
        _ => Err(format!("{count} of {all} hard cases did not end as they must: {}", missed.join("; "))),
    };
    Ok(Study { tables: vec![(Default::default(), table)], json: json!(rows), verdict })
}

/// The settings: name, safety measures, hand.
const SETTINGS: [(&str, Measures, Hand); 5] = [
    ("plain force, nobody holds the handle", Measures::NONE, Hand::NONE),
    ("plain force, a hand holds the handle", Measures::NONE, Hand::FINGERS),
    ("the observer's brake alone, nobody holds it", BRAKE, Hand::NONE),
    ("coupling, brake and limits, nobody holds it", Measures::ALL, Hand::NONE),
    ("coupling, brake and limits, a hand holds it", Measures::ALL, Hand::FINGERS),
];

const BRAKE: Measures = Measures { brake: true, ..Measures::NONE };

/// The closed loop of hand, device and stiff body, by stiffness and rate, and by delay and jitter.
fn stability(_: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    let (mut tables, mut all) = (Vec::new(), Vec::new());
    let mut table = |name: &str, table: Table| tables.push(([name.to_owned(), format!("{name}:")], table));
    for (name, measures, hand) in SETTINGS {
        let row = |&stiffness: &f64| {
            RATES_HZ.map(|rate_hz| run(&device(rate_hz), hand, stiffness, measures)).to_vec()
        };
        let runs: Vec<Vec<Run>> = STIFFNESSES.par_iter().map(row).collect();
        table(name, verdicts(&runs));
        all.push(json!({ "setting": name, "runs": runs }));
    }
    let (boundaries, found) = boundaries();
    table(
        "The least stiffness that is not stable with the plain force, and K = 2 b / T of theory",
        boundaries,
    );
    let mut delays = Vec::new();
    for (name, measures, hands) in DELAYED {
        let (of_hands, runs) = delayed(measures, hands);
        table(name, of_hands);
        delays.push(json!({ "setting": name, "runs": runs }));
    }
    let judged = judge(&all, &found, &delays);
    let verdict = judged.map(|()| {
        Some("every loop with all measures is stable, and the plain one up to where theory says".into())
    });
    Ok(Study { tables, json: json!({ "settings": all, "boundaries": found, "delays": delays }), verdict })
}

/// A hand and what it is called.
type Named = (&'static str, Hand);

/// The settings with delay and jitter.
const DELAYED: [(&str, Measures, &[Named]); 2] = [
    (
        "With delay and jitter, their part in the bound left out, nobody holds the handle",
        Measures { age: false, ..Measures::ALL },
        &[("none", Hand::NONE)],
    ),
    (
        "With delay and jitter, all measures",
        Measures::ALL,
        &[("none", Hand::NONE), ("light", Hand::LIGHT), ("firm", Hand::FIRM)],
    ),
];

fn device(rate_hz: f64) -> Haptic {
    Haptic { rate_hz, ..Haptic::simulated("table") }
}

/// Energy below this is rounding, or is dissipated at once, J.
const NOTHING_J: f64 = 1e-9;

/// A row for each stiffness, a column for each rate: how it ended, and what the loop generated.
fn verdicts(runs: &[Vec<Run>]) -> Table {
    let heading = RATES_HZ.map(|rate| format!("{rate} Hz"));
    let mut table = Table { rows: vec![std::iter::once("N/m".to_owned()).chain(heading).collect()] };
    for row in runs {
        let cell = |run: &Run| match run.verdict {
            verdict if run.generated_j < NOTHING_J => verdict.name().to_owned(),
            verdict if run.generated_j.is_finite() => {
                format!("{}, {} mJ", verdict.name(), significant(1e3 * run.generated_j))
            }
            verdict => verdict.name().to_owned(),
        };
        let first = row.first().map_or(String::new(), |run| run.stiffness.to_string());
        table.rows.push(std::iter::once(first).chain(row.iter().map(cell)).collect());
    }
    table
}

/// Two digits, or a power of ten.
fn significant(value: f64) -> String {
    if (0.01..1000.0).contains(&value) { format!("{value:.2}") } else { format!("{value:.0e}") }
}

fn boundaries() -> (Table, Vec<Value>) {
    let mut table = Table::new(&["rate", "hand", "theory, N/m", "measured, N/m"]);
    let hands = [("none", Hand::NONE), ("fingers", Hand::FINGERS)];
    let all: Vec<_> = RATES_HZ.into_iter().flat_map(|rate| hands.map(|hand| (rate, hand))).collect();
    let seek = |&(rate_hz, (name, hand)): &(f64, (&'static str, Hand))| {
        let haptic = device(rate_hz);
        let theory = 2.0 * (haptic.damping + hand.damping) * rate_hz;
        (rate_hz, name, theory, boundary(&haptic, hand, Measures::NONE))
    };
    let mut found = Vec::new();
    for (rate_hz, name, theory, plain) in all.par_iter().map(seek).collect::<Vec<_>>() {
        let cell = plain.map_or("above 1e6".to_owned(), |k| format!("{k:.0}"));
        table.row(&[&format!("{rate_hz} Hz"), name, &format!("{theory:.0}"), &cell]);
        found.push(json!({ "rate_hz": rate_hz, "hand": name, "theory": theory, "plain": plain }));
    }
    (table, found)
}

/// A row for each way of reporting and hand, a column for each body: how far the handle still moves, and the energy that the
/// loop generated.
fn delayed(measures: Measures, hands: &[Named]) -> (Table, Vec<Value>) {
    let heading = ["reports", "delay", "jitter", "hand", "bears, N/m"].map(str::to_owned);
    let moduli = MODULI.map(|young| format!("{young:.0e} Pa"));
    let mut table = Table { rows: vec![heading.into_iter().chain(moduli).collect()] };
    let all: Vec<(Reports, Named)> =
        REPORTS.into_iter().flat_map(|reports| hands.iter().map(move |hand| (reports, *hand))).collect();
    let runs = |&(reports, (_, hand)): &(Reports, Named)| {
        MODULI.map(|young| settle(&device(1000.0), reports, young, (hand, still), measures)).to_vec()
    };
    let mut found = Vec::new();
    for ((reports, (hand, _)), row) in all.iter().zip(all.par_iter().map(runs).collect::<Vec<_>>()) {
        let Reports { every_s, delay_s, jitter_s } = reports;
        let bears = row.last().copied().flatten().map_or(f64::NAN, |settled| settled.state.bearable);
        let head = [
            format!("{:.0} Hz", 1.0 / every_s),
            format!("{} ms", 1e3 * delay_s),
            format!("{} ms", 1e3 * jitter_s),
            (*hand).to_owned(),
            format!("{bears:.0}"),
        ];
        let cells = row.iter().map(|settled| settled.as_ref().map_or("none".to_owned(), settled_cell));
        table.rows.push(head.into_iter().chain(cells).collect());
        for (young, SettlingResult { swing_m, turned_rad, speed, made_j, state: felt }) in
            MODULI.iter().zip(&row).filter_map(|(young, settled)| Some((young, (*settled)?)))
        {
            found.push(json!({
                "every_s": every_s, "delay_s": delay_s, "jitter_s": jitter_s, "hand": hand, "young_pa": young,
                "swing_m": swing_m, "turned_rad": turned_rad, "speed": speed, "made_j": made_j, "bearable": felt.bearable, "age_s": felt.age_s,
            }));
        }
    }
    (table, found)
}

/// Moved by less than this in the last second it is at rest, m: a sensor resolves no less.
const REST_M: f64 = 2e-3 * START_M;
/// Turn below which it is at rest, rad: as much, a tenth of a metre away.
const REST_RAD: f64 = 1e-4;

/// One digit, because a limit cycle does not repeat exactly.
fn settled_cell(settled: &SettlingResult) -> String {
    let round = |value: f64| {
        let digits = value.log10().floor();
        let power = 10f64.powf(digits);
        format!("{:.*}", (-digits).max(0.0) as usize, (value / power).round() * power)
    };
    let turned = settled.turned_rad >= REST_RAD;
    let swing = match settled.swing_m >= REST_M {
        false if turned => round(settled.turned_rad.to_degrees()) + "°",
        false => "rest".to_owned(),
        true if turned => {
            format!("{} mm {}°", round(1e3 * settled.swing_m), round(settled.turned_rad.to_degrees()))
        }
        true => round(1e3 * settled.swing_m) + " mm",
    };
    let made = if settled.made_j < NOTHING_J { "0".to_owned() } else { round(1e3 * settled.made_j) + " mJ" };
    format!("{swing}, {made}")
}

/// Judges the runs: with all measures no loop may be unstable or generate energy, and without them the boundary must be that of
/// theory.
fn judge(all: &[Value], boundaries: &[Value], delays: &[Value]) -> Result<(), String> {
    let kept = SETTINGS.iter().zip(all).filter(|((_, measures, _), _)| *measures == Measures::ALL);
    let rows = kept.filter_map(|(_, setting)| setting["runs"].as_array()).flatten();
    let is_kept = rows.flat_map(|row| row.as_array()).flatten().all(|run| run["verdict"] == "stable");
    let is_theory = boundaries.iter().all(|row| {
        let ratio = row["plain"].as_f64().unwrap_or(f64::NAN) / row["theory"].as_f64().unwrap_or(f64::NAN);
        (ratio - 1.0).abs() < 0.1
    });
    let kept = DELAYED.iter().zip(delays).filter(|((_, measures, _), _)| *measures == Measures::ALL);
    let mut delayed = kept.filter_map(|(_, setting)| setting["runs"].as_array()).flatten();
    let is_below = |value: &Value, most: f64| value.as_f64().is_some_and(|value| value < most);
    if !delayed.all(|run| is_below(&run["swing_m"], REST_M) && is_below(&run["made_j"], NOTHING_J)) {
        return Err("a loop with delay or jitter does not come to rest, or generates energy".into());
    }
    match (is_kept, is_theory) {
        (true, true) => Ok(()),
        (false, _) => Err("a loop with all measures is not stable".into()),
        _ => Err("a boundary is more than 10 % off K = 2 b / T".into()),
    }
}

/// Reports of the device on bent bodies: a thousand times a second, and two hundred times with jitter.
const BENT_REPORTS: [Reports; 2] = [
    Reports { every_s: 1e-3, delay_s: 0.0, jitter_s: 0.0 },
    Reports { every_s: 5e-3, delay_s: 0.0, jitter_s: 5e-3 },
];

/// A hand lets go of bodies that are bent by up to 90°, by every model of the .green file that has forces: does the loop make
/// energy? A row for each model, way of reporting and bend, a column for each body.
fn bent(_: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    let heading = ["model", "reports", "bent by"].map(str::to_owned);
    let moduli = MODULI.map(|young| format!("{young:.0e} Pa"));
    let mut table = Table { rows: vec![heading.into_iter().chain(moduli).collect()] };
    let mut found = Vec::new();
    for model in online().filter(|model| model.energy.is_some()) {
        let ways: Vec<(Reports, f64)> =
            BENT_REPORTS.into_iter().flat_map(|r| BENDS_DEG.map(|degrees| (r, degrees))).collect();
        let of_body = |&young: &f64| -> Result<Vec<SettlingResult>, Failure> {
            let body = beam(model, young)?;
            let way = |&(reports, degrees)| let_go(&body, degrees, &device(1000.0), reports, Hand::NONE);
            ways.iter().map(way).collect()
        };
        let runs = MODULI.par_iter().map(of_body).collect::<Result<Vec<_>, _>>()?;
        for (way, (reports, degrees)) in ways.iter().enumerate() {
            let head =
                [model.name.to_owned(), format!("{:.0} Hz", 1.0 / reports.every_s), format!("{degrees}°")];
            table
                .rows
                .push(head.into_iter().chain(runs.iter().map(|runs| settled_cell(&runs[way]))).collect());
            for (young, run) in MODULI.iter().zip(runs.iter().map(|runs| runs[way])) {
                found.push(json!({
                    "model": model.name, "every_s": reports.every_s, "jitter_s": reports.jitter_s,
                    "degrees": degrees, "young_pa": young, "swing_m": run.swing_m,
                    "turned_rad": run.turned_rad, "speed": run.speed, "made_j": run.made_j,
                }));
            }
        }
    }
    // No model's loop may generate energy on a bent body.
    let makes = |run: &&Value| run["made_j"].as_f64().is_none_or(|made| made >= NOTHING_J);
    let verdict = match found.iter().find(makes) {
        None => Ok(Some("no loop makes energy".into())),
        Some(run) => Err(format!("a loop on a bent body generates energy: {run}")),
    };
    Ok(Study { tables: vec![(Default::default(), table)], json: json!(found), verdict })
}

/// Forces, energies and shapes of the models at large rotations, against static equilibrium: a table for each body and quantity.
fn forces(told: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    forces_of(&large_rotation::own_bodies()?, told)
}

/// Forces, energies and shapes of the models on the bodies of scenes.
pub fn forces_of_scenes(scenes: &[String], told: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    let mut bodies = Vec::new();
    for path in scenes {
        bodies.extend(large_rotation::bodies_of(&Scene::load(Path::new(path)).map_err(Failure::request)?));
    }
    forces_of(&bodies, told)
}

fn forces_of(bodies: &[TriedBody], told: &mut dyn FnMut(String)) -> Result<Study, Failure> {
    let rows = large_rotation::run(bodies, told)?;
    let mut tables = Vec::new();
    for rows in rows.chunk_by(|a, b| a.body == b.body) {
        let body = &rows[0].body;
        tables.extend(FORCE_TABLES.iter().map(|(title, write)| {
            ([format!("{body}: {title}"), format!("{body}, {title}:")], force_table(rows, *write))
        }));
    }
    Ok(Study { tables, json: json!(rows), verdict: Ok(None) })
}

type WriteModel = fn(&ModelAtPose) -> String;

/// Titles of the tables of forces, and the function that writes the cells of each.
const FORCE_TABLES: &[(&str, WriteModel)] = &[
    ("errors of force and torque in parts of the largest wrench of the equilibrium, %", |at| {
        let of = at.beside.as_ref().unwrap_or(&at.deviation);
        let another = if at.beside.is_some() { " of another" } else { "" };
        match (of.force, of.torque) {
            (Some(force), Some(torque)) => format!("{} / {}{another}", rounded(force), rounded(torque)),
            _ => "none".into(),
        }
    }),
    ("strain energy over that of the equilibrium", |at| {
        at.deviation.energy.map_or("none".into(), |ratio| format!("{ratio:.3}"))
    }),
    ("error of the shape, root mean square over length, %", |at| {
        format!("{:.3}", 100.0 * at.deviation.shape)
    }),
    ("time of a frame, turned by 0.5° in each: state, forces, surface, normals", |at| seconds(at.frame_s)),
];

fn rounded(part: f64) -> String {
    let value = 100.0 * part;
    if value < 9.95 { format!("{value:.1}") } else { format!("{value:.0}") }
}

fn force_table(rows: &[HeldPose], write: WriteModel) -> Table {
    let models: Vec<&str> = rows[0].models.iter().map(|at| at.model).collect();
    let mut table = Table::new(&[&["pose", "force", "torque"], &models[..]].concat());
    for row in rows {
        let held = [row.pose.clone(), format!("{:.2} N", row.force_n), format!("{:.2} N·m", row.torque_nm)];
        let of_models = models
            .iter()
            .map(|model| row.models.iter().find(|at| at.model == *model).map_or(String::new(), write));
        let cells: Vec<String> = held.into_iter().chain(of_models).collect();
        table.row(&cells.iter().map(String::as_str).collect::<Vec<_>>());
    }
    table
}
