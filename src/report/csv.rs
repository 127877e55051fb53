//! accuracy.csv, a line a setting, and models.csv, a line a model and motion; the names of the columns hold their units (RFC
//! 4180).

use super::data::{Measurement, ModelTrial, Spread};
use crate::base::table::quoted;

/// Every number of a row by its name, in the order of the columns; `None` where it was not measured.
pub fn numbers(row: &Measurement) -> Vec<(String, Option<f64>)> {
    let (cost, error) = (&row.cost, &row.error);
    let counts = [("mesh_nodes", row.mesh_nodes as f64), ("surface_nodes", row.surface_nodes as f64)];
    let forward_error = ("forward_error_relative".to_owned(), row.forward_error);
    let costs = [
        ("offline_s", Some(cost.offline_s)),
        ("offline_bytes", Some(cost.offline_bytes)),
        ("file_bytes", Some(cost.file_bytes)),
        ("packed_bytes", cost.packed_bytes),
        ("frame_p50_s", Some(cost.frame_p50_s)),
        ("frame_p99_s", Some(cost.frame_p99_s)),
        ("frame_one_p50_s", Some(cost.frame_one_p50_s)),
        ("frame_bytes", cost.frame_bytes),
    ];
    let errors: [(&str, &str, Option<Spread>); 11] = [
        ("discretisation", "relative", Some(error.discretisation)),
        ("energy", "relative", Some(error.energy)),
        ("solver", "relative", Some(error.solver)),
        ("storage", "relative", error.storage),
        ("model", "relative", Some(error.model)),
        ("total", "relative", Some(error.total)),
        ("uncancelled", "relative", Some(error.uncancelled)),
        ("displacement", "m", Some(error.displacement_m)),
        ("force", "relative", error.force),
        ("torque", "relative", error.torque),
        ("uncancelled_held", "relative", error.uncancelled_held),
    ];
    let counts = counts.map(|(name, count)| (name, Some(count)));
    let plain = counts.into_iter().chain(costs).map(|(name, value)| (name.to_owned(), value));
    let spreads = errors.into_iter().flat_map(|(name, unit, spread)| {
        [("median", spread.map(|s| s.median)), ("worst", spread.map(|s| s.worst))]
            .map(|(which, value)| (format!("{name}_{which}_{unit}"), value))
    });
    plain.chain([forward_error]).chain(spreads).collect()
}

/// Every number of a trial by its name.
pub fn trial_numbers(row: &ModelTrial) -> [(&'static str, Option<f64>); 6] {
    [
        ("degrees", Some(row.degrees)),
        ("displacement_relative", Some(row.displacement)),
        ("force_relative", row.force),
        ("torque_relative", row.torque),
        ("energy_ratio", row.energy),
        ("frame_s", Some(row.frame_s)),
    ]
}

/// The trials of the models, as [`csv`].
pub fn trials(rows: &[ModelTrial]) -> String {
    let mut text =
        "model,motion,degrees,displacement_relative,force_relative,torque_relative,energy_ratio,frame_s\r\n"
            .to_owned();
    for row in rows {
        let numbers = trial_numbers(row).map(|(_, value)| value.map_or_else(String::new, |v| v.to_string()));
        text += &format!("{},{},{}\r\n", quoted(&row.model), row.motion.name(), numbers.join(","));
    }
    text
}

/// Lines end with CR LF. Numbers are the shortest that read back as the same f64; a cell without one was not measured.
pub fn csv(rows: &[Measurement]) -> String {
    let mut text = String::new();
    for (i, row) in rows.iter().enumerate() {
        let setting = &row.setting;
        let (refine, solver) = (setting.refine.to_string(), setting.solver.to_string());
        let words = [
            ("refine", refine.as_str()),
            ("element", &setting.element),
            ("solver", &solver),
            ("storage", &setting.storage),
            ("model", setting.model.name),
        ];
        let words = words.into_iter().map(|(name, word)| (name.to_owned(), quoted(word)));
        let numbers = numbers(row).into_iter();
        let numbers = numbers.map(|(name, value)| (name, value.map_or_else(String::new, |v| v.to_string())));
        let (names, cells): (Vec<String>, Vec<String>) = words.chain(numbers).unzip();
        if i == 0 {
            text.push_str(&names.join(","));
            text.push_str("\r\n");
        }
        text.push_str(&cells.join(","));
        text.push_str("\r\n");
    }
    text
}
