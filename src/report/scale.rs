//! Measures how the offline stage grows with the mesh: boxes of more and more nodes, each solved by every method, as a table, CSV
//! and pictures.
//!
//! In: the largest number of nodes. Out: [`Row`]s with iterations, the time of every phase, memory and forward error.

use super::canvas::Picture;
use super::plot::{Plot, Point, Scale};
use crate::base::progress::Progress;
use crate::base::table::{Table, bytes, seconds};
use crate::green::{self, AFFINE, Requirements};
use crate::measure::units::{Unit, power};
use crate::scene::Scene;
use crate::solve::{Method, SOLVERS, Solver};
use std::path::Path;

/// Sizes that are measured, nodes; boxes come as near as they can.
const SIZES: [f64; 7] = [1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6];

/// Number of nodes of the smallest box.
pub const LEAST: usize = SIZES[0] as usize;

/// The sizes to measure, with their limits.
pub struct Request {
    pub up_to: usize,
    /// Tolerance of the iterative methods.
    pub tolerance: f64,
    /// Time above which a method is given up: that of its next size, by its growth between the last two, s.
    pub limit_s: f64,
}

/// One box, solved by one method for the 24 columns of two control elements.
pub struct Row {
    pub nodes: usize,
    pub solver: &'static str,
    /// The method that was taken, where `solver` chooses.
    pub method: &'static str,
    pub iterations: usize,
    /// Mesh and assembly, ordering and factor or levels, solves, the estimate of the forward error, and all, s.
    pub mesh_s: f64,
    pub factor_s: f64,
    pub solve_s: f64,
    pub conditioning_s: f64,
    pub all_s: f64,
    /// Largest resident memory, bytes; `None` where the system does not report it.
    pub memory: Option<f64>,
    pub forward_error: f64,
    pub residual: f64,
}

/// A method that was not taken to the end, and why.
pub type Left = (&'static str, usize, String);

/// Measures all sizes; the second list names what does not fit, or takes too long.
pub fn measure(request: &Request, progress: &dyn Progress) -> (Vec<Row>, Vec<Left>) {
    let (mut rows, mut left): (Vec<Row>, Vec<Left>) = (Vec::new(), Vec::new());
    // Boxes come to a little more or less than their size.
    for size in SIZES.into_iter().filter(|size| *size <= 1.05 * request.up_to as f64) {
        for method in SOLVERS {
            if left.iter().any(|(name, _, _)| *name == method.name) {
                continue;
            }
            let nodes = side(size).pow(3) as usize;
            let last = rows.iter().rev().find(|row: &&Row| row.solver == method.name);
            // A factor takes n² of the nodes, multigrid n.
            let growth =
                |row: &Row| (nodes as f64 / row.nodes as f64).powi(1 + i32::from(row.iterations == 0));
            let expected = last.map_or(0.0, |row| row.all_s * growth(row));
            if expected > request.limit_s {
                left.push((method.name, nodes, format!("would take about {}", seconds(expected))));
                continue;
            }
            match solve(nodes, side(size), method, request.tolerance, progress) {
                Ok(row) => rows.push(row),
                Err(why) => left.push((method.name, nodes, why)),
            }
        }
    }
    (rows, left)
}

/// Nodes along an edge of the box.
fn side(size: f64) -> u32 {
    size.cbrt().round() as u32
}

fn solve(
    nodes: usize,
    side: u32,
    method: &'static Method,
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<Row, String> {
    let cells = side - 1;
    let text = format!(
        "[body.box]\ngenerate = {{ block = {{ size = [1.0, 1.0, 1.0], cells = [{cells}, {cells}, {cells}] }} }}\n\
         material = {{ young = 1.0e6, poisson = 0.3 }}\n\
         control.low = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
         control.high = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
    );
    let mut scene = Scene::parse(&text, Path::new("box.toml")).map_err(|error| error.to_string())?;
    scene.body["box"].solver = Solver { method, tolerance, ..Solver::default() };
    forget_peak();
    let solution = green::solve(&scene, "box", &Requirements::new(&[AFFINE]), progress)
        .map_err(|error| error.to_string())?;
    let (stats, times) = (&solution.stats, &solution.times);
    let conditioning = stats.conditioning.unwrap_or_default();
    Ok(Row {
        nodes,
        solver: method.name,
        method: stats.method.name,
        iterations: stats.iterations,
        mesh_s: times.mesh_s + times.assembly_s,
        factor_s: stats.ordering_s + stats.symbolic_s + stats.factor_s,
        solve_s: stats.solve_s,
        conditioning_s: conditioning.seconds,
        all_s: solution.offline_s(),
        memory: crate::base::machine::peak_memory(),
        forward_error: conditioning.forward_error,
        residual: stats.worst_residual(),
    })
}

/// The largest memory is counted from here on, where the system allows.
fn forget_peak() {
    // Where it does not, later rows tell the largest so far.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// All rows for a terminal or a README.
pub fn table(rows: &[Row]) -> Table {
    let heading = [
        "nodes",
        "solver",
        "iterations",
        "mesh, assembly",
        "factor",
        "24 columns",
        "conditioning",
        "all",
        "memory",
        "forward error",
    ];
    let mut table = Table::new(&heading);
    for row in rows {
        let solver = match row.solver == row.method {
            true => row.solver.to_owned(),
            false => format!("{}: {}", row.solver, row.method),
        };
        table.row(&[
            &row.nodes.to_string(),
            &solver,
            &(if row.iterations == 0 { String::new() } else { row.iterations.to_string() }),
            &seconds(row.mesh_s),
            &seconds(row.factor_s),
            &seconds(row.solve_s),
            &seconds(row.conditioning_s),
            &seconds(row.all_s),
            &row.memory.map_or(String::new(), bytes),
            &power(row.forward_error),
        ]);
    }
    table
}

/// All rows with all their digits.
pub fn csv(rows: &[Row]) -> String {
    let head = "nodes,solver,method,iterations,mesh_s,factor_s,solve_s,conditioning_s,all_s,memory_bytes,forward_error,residual\n";
    let line = |row: &Row| {
        let memory = row.memory.map_or(String::new(), |memory| memory.to_string());
        format!(
            "{},{},{},{},{},{},{},{},{},{memory},{},{}\n",
            row.nodes,
            row.solver,
            row.method,
            row.iterations,
            row.mesh_s,
            row.factor_s,
            row.solve_s,
            row.conditioning_s,
            row.all_s,
            row.forward_error,
            row.residual
        )
    };
    std::iter::once(head.to_owned()).chain(rows.iter().map(line)).collect()
}

/// Time and memory over the nodes: a name for the file, and the picture, where there are points enough for one.
pub fn pictures(rows: &[Row]) -> Vec<(&'static str, Picture)> {
    let time = plot("Time of the offline stage", "time", Unit::Seconds, rows, |row| Some(row.all_s));
    let memory = plot("Memory of the offline stage", "largest memory", Unit::Bytes, rows, |row| row.memory);
    let told = [("scale-time", time.picture()), ("scale-memory", memory.picture())];
    told.into_iter().filter_map(|(name, picture)| Some((name, picture.ok()?))).collect()
}

fn plot(title: &'static str, label: &str, unit: Unit, rows: &[Row], of: fn(&Row) -> Option<f64>) -> Plot {
    let series: Vec<String> = SOLVERS
        .iter()
        .map(|method| method.name.to_owned())
        .filter(|name| rows.iter().any(|row| row.solver == *name))
        .collect();
    let point = |row: &Row| {
        let series = series.iter().position(|name| *name == row.solver)?;
        let y = of(row)?;
        let tip = format!("{} nodes, {}: {}", row.nodes, row.solver, unit.text(y));
        Some(Point {
            x: row.nodes as f64,
            y,
            series,
            line: Some(series),
            strong: true,
            tip,
            ..Point::default()
        })
    };
    Plot {
        title,
        note: "boxes of tet4, two control elements: 24 columns, with the estimate of their error".into(),
        x: Scale::ratio("nodes"),
        y: Scale { label: label.to_owned(), unit, logarithmic: true },
        points: rows.iter().filter_map(point).collect(),
        series,
        ..Plot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;

    /// Every method solves the smallest box, to the same column; the figures are those that were asked for.
    #[test]
    fn the_smallest_box_is_measured_by_every_method() {
        let request = Request { up_to: 1000, tolerance: 1e-8, limit_s: 60.0 };
        let (rows, left) = measure(&request, &Silent);
        assert_eq!((rows.len(), left.len()), (SOLVERS.len(), 0), "{left:?}");
        for row in &rows {
            assert_eq!(row.nodes, 1000);
            assert!(
                row.forward_error < 1e-7 && row.residual <= 1e-8,
                "{}: {:e}",
                row.solver,
                row.forward_error
            );
            assert_eq!(row.iterations > 0, ["pcg", "mixed"].contains(&row.method), "{}", row.solver);
            assert!(row.iterations < 20, "{}", row.iterations);
        }
        let csv = csv(&rows);
        assert_eq!(csv.lines().count(), 1 + rows.len());
        let columns = csv.lines().map(|line| line.split(',').count());
        assert!(columns.clone().all(|count| count == 12), "{csv}");
        assert!(table(&rows).text().contains("auto: cholesky"));
        assert!(pictures(&rows).iter().all(|(_, picture)| picture.file().contains("1000 nodes")));
    }
}
