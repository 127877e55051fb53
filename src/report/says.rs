//! What each plot says of this body, in sentences made from the data.

use super::answer::{ONLINE, ladder};
use super::panels::{by_number, distinct, fastest_on_each_mesh};
use super::units::{digits, relative, seconds, times};
use super::{PARTS, Report, Row, Setting, SmoothRow};

/// For the plot of this name; empty where there is nothing to say.
pub fn says(report: &Report, name: &str) -> String {
    match name {
        "online" => online(&report.rows),
        "split" => split(&report.rows),
        "mesh" => mesh(&report.rows),
        "solver" => knob(&report.rows, &SOLVER),
        "storage" => knob(&report.rows, &STORAGE),
        "models" => models(report),
        "smooth-l2" => smooth(&report.smooth, |row| row.l2_rate, 0),
        "smooth-energy" => smooth(&report.smooth, |row| row.energy_rate, 1),
        _ => String::new(),
    }
}

/// "a, b and c".
fn listed(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

fn online(rows: &[Row]) -> String {
    let rungs = ladder(rows, &ONLINE);
    let (Some(&first), Some(&last)) = (rungs.first(), rungs.last()) else {
        return String::new();
    };
    let (cheap, best) = (&rows[first], &rows[last]);
    let end = |row: &Row| {
        format!(
            "{} ({}, {})",
            row.setting,
            seconds(row.cost.frame_p50_s),
            relative(row.error.uncancelled.median)
        )
    };
    if first == last {
        return format!("{} is the cheapest and, to a tenth, the most accurate.", end(cheap));
    }
    let time = best.cost.frame_p50_s / cheap.cost.frame_p50_s;
    let error = cheap.error.uncancelled.median / best.error.uncancelled.median;
    let ratio = if time.is_finite() && error.is_finite() {
        format!(": {} times the time, {} times less error", times(time), times(error))
    } else {
        String::new()
    };
    let known: Vec<Row> = rows.iter().filter(|row| row.can_be_chosen()).cloned().collect();
    format!("From {} to {}{ratio}. {}", end(cheap), end(best), limits(&known, "settings"))
}

fn split(rows: &[Row]) -> String {
    let shown: Vec<Row> = ladder(rows, &ONLINE).into_iter().map(|i| rows[i].clone()).collect();
    limits(&shown, "settings drawn here")
}

/// How many rows each part limits.
fn limits(rows: &[Row], what: &str) -> String {
    let count = |part| rows.iter().filter(|row| row.error.dominating() == Some(part)).count();
    let counts: Vec<String> = (0..PARTS.len())
        .filter(|&part| count(part) > 0)
        .map(|part| format!("{} in {}", PARTS[part], count(part)))
        .collect();
    if counts.is_empty() {
        return String::new();
    }
    format!("Of {} {what} the largest part is {}.", rows.len(), listed(&counts))
}

fn mesh(rows: &[Row]) -> String {
    let chosen = fastest_on_each_mesh(rows);
    let told = distinct(chosen.iter().map(|row| &row.setting.element)).into_iter().map(|element| {
        let of: Vec<&&Row> = chosen.iter().filter(|row| row.setting.element == *element).collect();
        let end = |row: &Row| {
            format!("{} in {}", relative(row.error.discretisation.median), seconds(row.cost.offline_s))
        };
        match of[..] {
            [first, .., last] => format!("{element} goes from {} to {}", end(first), end(last)),
            [one] => format!("{element} has {}", end(one)),
            [] => String::new(),
        }
    });
    format!("{}.", listed(&told.collect::<Vec<_>>()))
}

struct Told {
    of: fn(&Setting) -> String,
    cost: fn(&Row) -> f64,
    error: fn(&Row) -> f64,
    /// What the cost is a multiple of.
    unit: &'static str,
}

const SOLVER: Told = Told {
    of: |setting| setting.solver.to_string(),
    cost: |row| row.cost.offline_s,
    error: |row| row.error.solver.median,
    unit: "Offline times as multiples of the fastest on the same mesh",
};

const STORAGE: Told = Told {
    of: |setting| setting.storage.clone(),
    cost: |row| row.cost.file_bytes,
    error: |row| row.error.storage.median,
    unit: "File sizes as multiples of the smallest on the same mesh",
};

/// For every position of a knob: its largest error, and its cost as a multiple of the least on the same mesh.
fn knob(rows: &[Row], told: &Told) -> String {
    let least = |row: &Row| {
        let here = rows.iter().filter(|other| other.setting.mesh() == row.setting.mesh());
        here.map(told.cost).fold(f64::INFINITY, f64::min)
    };
    let mut positions = distinct(rows.iter().map(|row| (told.of)(&row.setting)));
    positions.sort_by(|a, b| by_number(a, b));
    let say = |position: &String| {
        let of: Vec<&Row> = rows.iter().filter(|row| (told.of)(&row.setting) == *position).collect();
        let error = of.iter().map(|row| (told.error)(row)).fold(0.0, f64::max);
        let ratios = of.iter().map(|row| (told.cost)(row) / least(row)).filter(|ratio| ratio.is_finite());
        let (low, high) = ratios.fold((f64::INFINITY, 0.0_f64), |(a, b), ratio| (a.min(ratio), b.max(ratio)));
        let range = match (times(low), times(high)) {
            _ if low > high => String::new(),
            (low, high) if low == high => format!("{low} times, "),
            (low, high) => format!("{low} to {high} times, "),
        };
        format!("{position} {range}error at most {}", relative(error))
    };
    format!("{}: {}.", told.unit, positions.iter().map(say).collect::<Vec<_>>().join("; "))
}

fn models(report: &Report) -> String {
    let bearable = 0.05;
    let told = distinct(report.models.iter().map(|of| &of.model)).into_iter().map(|model| {
        let mut of: Vec<_> = report.models.iter().filter(|row| row.model == *model).collect();
        of.sort_by(|a, b| a.rotation.total_cmp(&b.rotation));
        let good = of.iter().take_while(|row| row.error <= bearable).count();
        let degrees = |i: usize| format!("{}°", digits(of[i].rotation.to_degrees(), 2));
        match good {
            0 => format!("{model} in none (not at {})", degrees(0)),
            n if n == of.len() => format!("{model} in all of them (up to {})", degrees(n - 1)),
            n => format!("{model} up to {} (not at {})", degrees(n - 1), degrees(n)),
        }
    });
    format!(
        "An error of at most {} in these poses: {}.",
        relative(bearable),
        listed(&told.collect::<Vec<_>>())
    )
}

/// Fitted slopes that fall short of the theory's by more than this are named.
const SHORT: f64 = 0.2;

fn smooth(rows: &[SmoothRow], rate: fn(&SmoothRow) -> Option<f64>, norm: usize) -> String {
    let told = distinct(rows.iter().map(|row| &row.element)).into_iter().filter_map(|element| {
        let row = rows.iter().find(|row| row.element == *element)?;
        let promised = row.promised[norm];
        let slope = rate(row)?;
        let verdict = if slope < promised - SHORT { ", which falls short" } else { "" };
        Some(format!("{element} {slope:.2} (theory {}){verdict}", digits(promised, 3)))
    });
    let told: Vec<String> = told.collect();
    if told.is_empty() {
        return "One refinement has no slope.".into();
    }
    format!("Fitted slopes: {}.", listed(&told))
}
