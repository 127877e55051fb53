//! Pareto fronts: the settings that no other beats in both cost and error; and the costs that they can be compared by.

use crate::measure::units::{Unit, bytes, seconds};
use crate::measure::{Cost, Measurement};

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

/// A number of every row: its name in files, its heading in tables, its unit; `None` where it was not measured.
pub struct Column {
    pub name: &'static str,
    pub heading: &'static str,
    pub unit: Unit,
    pub of: fn(&Measurement) -> Option<f64>,
}

const fn column(
    name: &'static str,
    heading: &'static str,
    unit: Unit,
    of: fn(&Measurement) -> Option<f64>,
) -> Column {
    Column { name, heading, unit, of }
}

/// Sizes and costs, in the order of the columns of files and tables.
pub const COLUMNS: [Column; 10] = [
    column("mesh_nodes", "nodes", Unit::Count, |row| Some(row.mesh_nodes as f64)),
    column("surface_nodes", "of the surface", Unit::Count, |row| Some(row.surface_nodes as f64)),
    column("offline_s", "offline", Unit::Seconds, |row| Some(row.cost.offline_s)),
    column("offline_bytes", "memory offline", Unit::Bytes, |row| Some(row.cost.offline_bytes)),
    column("file_bytes", "file", Unit::Bytes, |row| Some(row.cost.file_bytes)),
    column("packed_bytes", "file packed", Unit::Bytes, |row| row.cost.packed_bytes),
    column("frame_p50_s", "one evaluation", Unit::Seconds, |row| Some(row.cost.frame_p50_s)),
    column("frame_p99_s", "p99", Unit::Seconds, |row| Some(row.cost.frame_p99_s)),
    column("frame_one_p50_s", "one element moved", Unit::Seconds, |row| Some(row.cost.frame_one_p50_s)),
    column("frame_bytes", "reads", Unit::Bytes, |row| row.cost.frame_bytes),
];

/// "43 µs an evaluation, 0.84 s offline, a file of 1.2 MB".
pub fn costs(cost: &Cost) -> String {
    let (online, offline, file) =
        (seconds(cost.frame_p50_s), seconds(cost.offline_s), bytes(cost.file_bytes));
    format!("{online} an evaluation, {offline} offline, a file of {file}")
}

/// Whether each point `[cost, error]` is on the front: no other has neither larger and one of them smaller. Equal
/// points are on it together. Coordinates are no NaN.
fn on_front(points: &[[f64; 2]]) -> Vec<bool> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    // -0.0 + 0.0 is 0.0: the order of `total_cmp` is then that of `<`.
    let key = |i: usize, axis: usize| points[i][axis] + 0.0;
    order.sort_by(|&a, &b| key(a, 0).total_cmp(&key(b, 0)).then(key(a, 1).total_cmp(&key(b, 1))));
    let mut front = vec![false; points.len()];
    let mut last: Option<[f64; 2]> = None;
    for i in order {
        let better = last.is_none_or(|[_, error]| points[i][1] < error);
        if better || last == Some(points[i]) {
            front[i] = true;
            last = Some(points[i]);
        }
    }
    front
}

/// Errors closer than this are equal.
const SAME_ERROR: f64 = 0.98;

/// The points of the front by ascending cost, without those whose error is less than 2 % below the one before.
pub fn front(points: &[[f64; 2]]) -> Vec<usize> {
    let on = on_front(points);
    let mut front: Vec<usize> = (0..points.len()).filter(|&i| on[i]).collect();
    front.sort_by(|&a, &b| points[a][0].total_cmp(&points[b][0]));
    let mut last: Option<[f64; 2]> = None;
    front.retain(|&i| {
        let point = points[i];
        let kept = last.is_none_or(|last| point == last || point[1] <= SAME_ERROR * last[1]);
        last = if kept { Some(point) } else { last };
        kept
    });
    front
}

/// The front of those rows that can be chosen; the others are left out of the comparison.
pub fn front_of<'a>(
    rows: impl Iterator<Item = &'a Measurement>,
    point: impl Fn(&Measurement) -> [f64; 2],
) -> Vec<usize> {
    let (own, points): (Vec<usize>, Vec<[f64; 2]>) =
        rows.enumerate().filter(|(_, row)| row.can_be_chosen()).map(|(i, row)| (i, point(row))).unzip();
    front(&points).into_iter().map(|i| own[i]).collect()
}

/// Says which rows lie under the steps of a front without being part of it, and why; empty where there are none.
pub fn outside(rows: &[&Measurement], front: &[usize], point: impl Fn(&Measurement) -> [f64; 2]) -> String {
    let beats = |a: [f64; 2], b: [f64; 2]| a[0] <= b[0] && a[1] <= b[1];
    let is_under = |(i, row): &(usize, &&Measurement)| {
        !front.contains(i) && !front.iter().any(|&on| beats(point(rows[on]), point(row)))
    };
    let under: Vec<&Measurement> = rows.iter().enumerate().filter(is_under).map(|(_, row)| *row).collect();
    let count = |is: fn(&Measurement) -> bool| under.iter().filter(|row| is(row)).count();
    let causes = [
        (count(Measurement::is_reference), "on the finest mesh, whose own error is not known"),
        (count(|row| !row.is_mesh_known()), "on a mesh whose error was not measured"),
        (
            count(|row| row.is_mesh_known() && !row.is_reference() && !row.is_trusted()),
            "with a solver whose own estimate of its error is too large",
        ),
        (
            count(|row| {
                row.is_mesh_known() && !row.is_reference() && row.is_trusted() && !row.is_storage_known()
            }),
            "with a coarser storage whose error was not measured",
        ),
        (count(Measurement::can_be_chosen), "less than 2 % better than a step"),
    ];
    let said: Vec<String> =
        causes.iter().filter(|(count, _)| *count > 0).map(|(count, why)| format!("{count} {why}")).collect();
    if said.is_empty() {
        String::new()
    } else {
        format!(" Under the steps, and no part of them: {}.", said.join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn by_definition(points: &[[f64; 2]]) -> Vec<bool> {
        let beats = |a: &[f64; 2], b: &[f64; 2]| a[0] <= b[0] && a[1] <= b[1] && (a[0] < b[0] || a[1] < b[1]);
        points.iter().map(|point| !points.iter().any(|other| beats(other, point))).collect()
    }

    #[test]
    fn a_front_by_hand() {
        let points = [[1.0, 9.0], [2.0, 4.0], [2.0, 5.0], [3.0, 4.0], [4.0, 0.0], [4.0, 0.0], [0.0, 9.5]];
        assert_eq!(on_front(&points), [true, true, false, false, true, true, true]);
        assert_eq!(on_front(&[]), [false; 0]);
        assert_eq!(on_front(&[[0.0, 1.0], [-0.0, 2.0]]), [true, false], "the two zeros are one");
    }

    #[test]
    fn a_difference_that_no_one_can_measure_is_no_step() {
        let points = [[1.0, 1.0], [2.0, 0.999], [3.0, 0.9], [3.0, 0.9], [4.0, 0.0], [5.0, 0.0]];
        assert_eq!(front(&points), [0, 2, 3, 4]);
    }

    proptest! {
        /// Few distinct values, so that ties are common.
        #[test]
        fn the_front_is_what_the_definition_says(
            points in prop::collection::vec([0_u8..8, 0_u8..8].prop_map(|p| p.map(f64::from)), 0..40)
        ) {
            prop_assert_eq!(on_front(&points), by_definition(&points));
        }

        #[test]
        fn any_numbers(points in prop::collection::vec(prop::array::uniform2(-1e300_f64..1e300), 0..40)) {
            prop_assert_eq!(on_front(&points), by_definition(&points));
        }
    }
}
