//! The costs that settings can be compared by.

use super::data::Cost;
use super::units::{Unit, bytes, seconds};

pub struct CostMetric {
    /// Names the axis of a plot.
    pub name: &'static str,
    pub of: fn(&Cost) -> f64,
    pub unit: Unit,
    /// Heads the column of the settings that cost least.
    pub least: &'static str,
}

pub const ONLINE: CostMetric = CostMetric {
    name: "time of one evaluation with every control element moved (median)",
    of: |cost| cost.frame_p50_s,
    unit: Unit::Seconds,
    least: "least time of an evaluation",
};
pub const OFFLINE: CostMetric = CostMetric {
    name: "offline time",
    of: |cost| cost.offline_s,
    unit: Unit::Seconds,
    least: "least offline time",
};
pub const FILE: CostMetric = CostMetric {
    name: "size of the .green file",
    of: |cost| cost.file_bytes,
    unit: Unit::Bytes,
    least: "smallest file",
};
pub const COST_METRICS: [&CostMetric; 3] = [&ONLINE, &OFFLINE, &FILE];

/// "43 µs an evaluation, 0.84 s offline, a file of 1.2 MB".
pub fn costs(cost: &Cost) -> String {
    let (online, offline, file) =
        (seconds(cost.frame_p50_s), seconds(cost.offline_s), bytes(cost.file_bytes));
    format!("{online} an evaluation, {offline} offline, a file of {file}")
}
