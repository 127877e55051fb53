//! The family `perturbation`: how the equilibrium of a body depends on the relative motion of two control elements, as a power
//! series to the third order, and how far that converges.
//!
//! In: the fields Φ of the family `reduced`, and the power series of equilibria along [`screw_paths`](super::screw_paths),
//! whose directions x are the orthonormal differences of (d_e, ω_e). Out: `perturbation/series`, the coefficients of
//! q(x) = Σ x_i x_j q_ij + Σ x_i x_j x_k q_ijk over i ≤ j ≤ k with q = Φᵀ K φ, a column for each monomial; and
//! `perturbation/radius`, a matrix G with √(xᵀ G x) the part of the radius of convergence ρ at which x lies:
//!
//! ```text
//! 1/ρ = lim ‖φ_k‖^(1/k), from the line through ln ‖φ_k‖ over the last orders     nᵀ G n ≥ 1/ρ² on every path n
//! ```
//!
//! (The root test; consecutive ratios are of no use, since odd and even orders alternate.)

use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::prepare::Prepared;
use super::super::requirements::Family;
use super::super::solution::Solution;
use super::reduced::{FIELDS_TABLE, REDUCED};
use super::screw_paths::{Path, bend, lifted_order, paths, series_memory};
use super::table;
use crate::base::machine;
use crate::fem::dense_fields::{add, products};
use crate::fem::{NodeFields, RestPoints};
use crate::scene::Body;
use crate::solve::{Progress, Silent};
use nalgebra::{DMatrix, DVector, Vector3};

pub const PERTURBATION: Family = Family { name: "perturbation", from: &[REDUCED] };

/// Tables of the family.
pub const SERIES: &str = "perturbation/series";
pub const RADIUS: &str = "perturbation/radius";

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: PERTURBATION,
    holds: "the equilibrium as a power series in the relative motion, and its radius of convergence",
    suits: Some(suits),
    compute: Some(compute),
    solves: true,
    write: |body, _| [table::write(body, SERIES), table::write(body, RADIUS)].concat(),
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |_| 8 * (MOST_FIELDS * MONOMIALS + COORDINATES * COORDINATES),
    is_derived: false,
    column_names: None,
};

/// Coordinates of the relative motion of two elements.
const COORDINATES: usize = 6;
/// Monomials of second and of third order.
const MONOMIALS: usize = 21 + 56;
/// Fields Φ of two elements, at most.
const MOST_FIELDS: usize = 64;
/// Paths for each coordinate: more than there are monomials of third order, and so with those that slide alone, so that the
/// coefficients are found by least squares.
const PATHS: usize = 20;
/// The first paths, on which the series is continued to find its radius, beside those along each coordinate.
const LONG_PATHS: usize = 30;
const LAST_ORDER: usize = 9;
/// The radius is that of the line through the orders from here on.
const FIRST_ORDER: usize = 4;

fn suits(place: &str, _: &Body, prepared: &Prepared) -> Result<(), GreenError> {
    let count = prepared.controls.len();
    if count == 2 {
        return Ok(());
    }
    Err(GreenError::ControlCount { body: place.to_owned(), model: "perturbation", count, allowed: "2" })
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let fields = solution.tables.get(FIELDS_TABLE).filter(|fields| fields.ncols() > 0).cloned();
    let Some(fields) = fields else {
        // Nothing is free to bend.
        solution.tables.insert(SERIES, DMatrix::zeros(0, MONOMIALS));
        solution.tables.insert(RADIUS, DMatrix::zeros(COORDINATES, COORDINATES));
        return Ok(());
    };
    let points = RestPoints::new(solution.element, &solution.mesh, assembled.lame).map_err(unfit)?;
    let all = paths(solution, PATHS);
    // Each order but the first stands alone and in the whole.
    let kept = |order: usize| 2 * order - 2;
    let [third, last] = [(all.len(), 3), (COORDINATES + LONG_PATHS, LAST_ORDER)]
        .map(|(paths, order)| series_memory(points.nodes, paths, kept(order)));
    machine::expect("the series of the model \"perturbation\"", third.max(last))
        .map_err(|source| GreenError::Memory { body: assembled.place.to_owned(), source })?;
    let directions: Vec<DVector<f64>> = all.iter().map(direction).collect();

    progress.begin("series of third order", 0);
    let bent = continued(assembled, solution, &points, &all, 3, &mut |_| ())?;
    let basis = NodeFields {
        nodes: points.nodes,
        columns: fields.ncols(),
        data: fields.transpose().as_slice().to_vec(),
    };
    let series: Vec<DMatrix<f64>> = bent
        .iter()
        .enumerate()
        .map(|(i, bent)| coefficients(&directions, i + 2, &products(assembled.k, &basis, bent)))
        .collect();
    progress.end();

    progress.begin("radius of convergence", (LAST_ORDER - 1) as u64);
    let long = [along_coordinates(&all), all[..LONG_PATHS].to_vec()].concat();
    let orders = continued(assembled, solution, &points, &long, LAST_ORDER, &mut |_| progress.advance(1))?;
    let norms = |bent: &NodeFields| -> Vec<f64> {
        let energies = products(assembled.k, bent, bent);
        energies.diagonal().iter().map(|energy| energy.max(0.0).sqrt()).collect()
    };
    let sizes: Vec<Vec<f64>> = orders.iter().map(norms).collect();
    let directions: Vec<DVector<f64>> = long.iter().map(direction).collect();
    let radius = ellipsoid(&directions, &sizes);
    progress.end();

    let joined = DMatrix::from_fn(basis.columns, MONOMIALS, |row, column| match column.checked_sub(21) {
        None => series[0][(row, column)],
        Some(column) => series[1][(row, column)],
    });
    solution.tables.insert(SERIES, joined);
    solution.tables.insert(RADIUS, radius);
    Ok(())
}

/// x of a path at a = 1.
fn direction(path: &Path) -> DVector<f64> {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let (slide, turn) = ((path[1].0 - path[0].0) * half, (path[1].1 - path[0].1) * half);
    DVector::from_iterator(COORDINATES, slide.iter().chain(turn.iter()).copied())
}

/// φ of the orders 2 to `last` on all paths.
fn continued(
    assembled: &Assembled<'_>,
    solution: &Solution,
    points: &RestPoints,
    paths: &[Path],
    last: usize,
    told: &mut dyn FnMut(usize),
) -> Result<Vec<NodeFields>, GreenError> {
    let mut orders = vec![lifted_order(solution, paths, 1)];
    let mut all = Vec::new();
    for order in 2..=last {
        let bent = bend(assembled, points, &orders, &Silent)?;
        let mut whole = lifted_order(solution, paths, order);
        add(&mut whole, 1.0, &bent);
        orders.push(whole);
        all.push(bent);
        told(order);
    }
    Ok(all)
}

/// A path along each coordinate of x, as long as `paths` are.
fn along_coordinates(paths: &[Path]) -> Vec<Path> {
    let size = |of: &dyn Fn(&Path) -> f64| paths.iter().map(of).fold(0.0, f64::max);
    let slide = size(&|path| path[1].0.norm());
    let turn = size(&|path| path[1].1.norm());
    let unit = |axis: usize, length: f64| Vector3::ith(axis, length);
    let of = |slide: Vector3<f64>, turn: Vector3<f64>| vec![(-slide, -turn), (slide, turn)];
    let slides = (0..3).map(|axis| of(unit(axis, slide), Vector3::zeros()));
    slides.chain((0..3).map(|axis| of(Vector3::zeros(), unit(axis, turn)))).collect()
}

/// All products of `order` of the x, i ≤ j ≤ k, i running slowest.
fn monomials(x: &[f64], order: usize, each: &mut dyn FnMut(f64)) {
    for i in 0..x.len() {
        for j in i..x.len() {
            if order == 2 {
                each(x[i] * x[j]);
                continue;
            }
            for k in j..x.len() {
                each(x[i] * x[j] * x[k]);
            }
        }
    }
}

/// The coefficients of the homogeneous polynomials that have the `values` (a column for each direction), by least squares.
fn coefficients(directions: &[DVector<f64>], order: usize, values: &DMatrix<f64>) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = directions
        .iter()
        .map(|x| {
            let mut row = Vec::new();
            monomials(x.as_slice(), order, &mut |value| row.push(value));
            row
        })
        .collect();
    let mut matrix = DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j]);
    let scales: Vec<f64> = matrix.column_iter().map(|column| column.norm().max(f64::MIN_POSITIVE)).collect();
    for (mut column, scale) in matrix.column_iter_mut().zip(&scales) {
        column /= *scale;
    }
    // It fails without U and V alone.
    let solved =
        matrix.svd(true, true).solve(&values.transpose(), 1e-13).unwrap_or_else(|_| DMatrix::zeros(0, 0));
    let mut out = solved.transpose();
    for (mut column, scale) in out.column_iter_mut().zip(&scales) {
        column /= *scale;
    }
    out
}

/// The quadratic form nearest to the `wanted` values, in parts of each.
fn fitted(directions: &[DVector<f64>], wanted: &DMatrix<f64>) -> DMatrix<f64> {
    // n → n/√w makes every value 1.
    let scaled = |(n, w): (&DVector<f64>, &f64)| n / w.max(f64::MIN_POSITIVE).sqrt();
    let scaled: Vec<DVector<f64>> = directions.iter().zip(wanted.iter()).map(scaled).collect();
    coefficients(&scaled, 2, &DMatrix::from_element(1, directions.len(), 1.0))
}

/// G from the sizes of the orders 2, 3, … on each path.
fn ellipsoid(directions: &[DVector<f64>], sizes: &[Vec<f64>]) -> DMatrix<f64> {
    let places: Vec<f64> = (FIRST_ORDER..2 + sizes.len()).map(|k| k as f64).collect();
    let mean = places.iter().sum::<f64>() / places.len() as f64;
    // 1/ρ² on each path.
    let inverse = |path: usize| -> f64 {
        let logs: Vec<f64> = sizes[FIRST_ORDER - 2..].iter().map(|s| s[path].max(1e-300).ln()).collect();
        let over: f64 = places.iter().zip(&logs).map(|(k, log)| (k - mean) * log).sum();
        let under: f64 = places.iter().map(|k| (k - mean).powi(2)).sum();
        (2.0 * over / under).exp()
    };
    let wanted = DMatrix::from_fn(1, directions.len(), |_, path| inverse(path));
    let found = fitted(directions, &wanted);
    let mut form = DMatrix::<f64>::zeros(COORDINATES, COORDINATES);
    let mut at = 0;
    for i in 0..COORDINATES {
        for j in i..COORDINATES {
            form[(i, j)] += 0.5 * found[at];
            form[(j, i)] += 0.5 * found[at];
            at += 1;
        }
    }
    // In the units of the paths, so that metres and radians compare.
    let scale = DVector::from_fn(COORDINATES, |i, _| {
        directions.iter().map(|x| x[i].abs()).fold(f64::MIN_POSITIVE, f64::max)
    });
    let scaled = DMatrix::from_fn(COORDINATES, COORDINATES, |i, j| form[(i, j)] * scale[i] * scale[j]);
    let mut eigen = scaled.symmetric_eigen();
    let least = 1e-4 * eigen.eigenvalues.amax();
    eigen.eigenvalues.apply(|value: &mut f64| *value = value.max(least));
    let scaled = eigen.recompose();
    let form = DMatrix::from_fn(COORDINATES, COORDINATES, |i, j| scaled[(i, j)] / (scale[i] * scale[j]));
    let short = directions.iter().zip(wanted.iter()).map(|(x, wanted)| wanted / x.dot(&(&form * x)));
    let most = short.fold(f64::MIN_POSITIVE, f64::max);
    form * most
}

fn check(file: &GreenFile, name: &str, _: &BodyMeta) -> Result<(), String> {
    let tensor = format!("{name}/{SERIES}");
    let fields = file.tensors.get(&tensor).and_then(|(_, shape, _)| shape.get(1).copied()).unwrap_or(0);
    table::check(file, name, SERIES, [fields, MONOMIALS])?;
    table::check(file, name, RADIUS, [COORDINATES, COORDINATES]).map(drop)
}
