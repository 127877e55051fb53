//! `greenstage verify haptics`: the closed loop of hand, device and stiff body, by stiffness and rate, and by delay and jitter.

use super::print::print;
use crate::base::failure::Failure;
use crate::base::table::Table;
use crate::effect::haptics::settling::{MODULI, REPORTS, SettlingResult, settle, still};
use crate::effect::haptics::stability::{RATES_HZ, Run, START_M, STIFFNESSES, boundary, run};
use crate::effect::haptics::{Hand, Measures, Reports};
use crate::stage::Haptic;
use rayon::prelude::*;
use serde_json::json;
use std::path::Path;

/// Asks for this instead of problems.
pub const NAME: &str = "haptics";

/// The settings: name, safety measures, hand.
const SETTINGS: [(&str, Measures, Hand); 5] = [
    ("plain force, nobody holds the handle", Measures::NONE, Hand::NONE),
    ("plain force, a hand holds the handle", Measures::NONE, Hand::FINGERS),
    ("the observer's brake alone, nobody holds it", BRAKE, Hand::NONE),
    ("coupling, brake and limits, nobody holds it", Measures::ALL, Hand::NONE),
    ("coupling, brake and limits, a hand holds it", Measures::ALL, Hand::FINGERS),
];

const BRAKE: Measures = Measures { brake: true, ..Measures::NONE };

/// Runs all settings; prints tables or JSON, and writes the tables into a Markdown file where one is named.
pub fn run_all(json: bool, readme: Option<&Path>) -> Result<(), Failure> {
    let (mut text, mut all) = (Vec::new(), Vec::new());
    for (name, measures, hand) in SETTINGS {
        let row = |&stiffness: &f64| {
            RATES_HZ.map(|rate_hz| run(&device(rate_hz), hand, stiffness, measures)).to_vec()
        };
        let runs: Vec<Vec<Run>> = STIFFNESSES.par_iter().map(row).collect();
        text.push((name.to_owned(), verdicts(&runs)));
        all.push(json!({ "setting": name, "runs": runs }));
    }
    let (boundaries, found) = boundaries();
    text.push((
        "The least stiffness that is not stable with the plain force, and K = 2 b / T of theory".to_owned(),
        boundaries,
    ));
    let mut delays = Vec::new();
    for (name, measures, hands) in DELAYED {
        let (table, runs) = delayed(measures, hands);
        text.push((name.to_owned(), table));
        delays.push(json!({ "setting": name, "runs": runs }));
    }
    if json {
        let all = json!({ "settings": all, "boundaries": found, "delays": delays });
        print(&format!("{all:#}\n"))?;
    } else {
        let tables: String =
            text.iter().map(|(name, table)| format!("{name}\n\n{}\n", table.text())).collect();
        print(&tables)?;
    }
    if let Some(path) = readme {
        let tables: String =
            text.iter().map(|(name, table)| format!("{name}:\n\n{}\n", table.markdown())).collect();
        super::marks::write_between(path, NAME, &tables)?;
    }
    judge(&all, &found, &delays)
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

pub(super) fn device(rate_hz: f64) -> Haptic {
    Haptic { rate_hz, ..Haptic::simulated("table") }
}

/// Energy below this is rounding, or is dissipated at once, J.
pub(super) const NOTHING_J: f64 = 1e-9;

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

fn boundaries() -> (Table, Vec<serde_json::Value>) {
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
fn delayed(measures: Measures, hands: &[Named]) -> (Table, Vec<serde_json::Value>) {
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
pub(super) fn settled_cell(settled: &SettlingResult) -> String {
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
fn judge(
    all: &[serde_json::Value],
    boundaries: &[serde_json::Value],
    delays: &[serde_json::Value],
) -> Result<(), Failure> {
    let kept = SETTINGS.iter().zip(all).filter(|((_, measures, _), _)| *measures == Measures::ALL);
    let rows = kept.filter_map(|(_, setting)| setting["runs"].as_array()).flatten();
    let is_kept = rows.flat_map(|row| row.as_array()).flatten().all(|run| run["verdict"] == "stable");
    let is_theory = boundaries.iter().all(|row| {
        let ratio = row["plain"].as_f64().unwrap_or(f64::NAN) / row["theory"].as_f64().unwrap_or(f64::NAN);
        (ratio - 1.0).abs() < 0.1
    });
    let kept = DELAYED.iter().zip(delays).filter(|((_, measures, _), _)| *measures == Measures::ALL);
    let mut delayed = kept.filter_map(|(_, setting)| setting["runs"].as_array()).flatten();
    let is_below = |value: &serde_json::Value, most: f64| value.as_f64().is_some_and(|value| value < most);
    if !delayed.all(|run| is_below(&run["swing_m"], REST_M) && is_below(&run["made_j"], NOTHING_J)) {
        return Err(Failure::Work(anyhow::anyhow!(
            "a loop with delay or jitter does not come to rest, or generates energy"
        )));
    }
    match (is_kept, is_theory) {
        (true, true) => Ok(()),
        (false, _) => Err(Failure::Work(anyhow::anyhow!("a loop with all measures is not stable"))),
        _ => Err(Failure::Work(anyhow::anyhow!("a boundary is more than 10 % off K = 2 b / T"))),
    }
}
