//! The family `reduced`: fields that a body bends into beyond the affine ones, and its energy as a quartic in all of them.
//!
//! In: the affine fields u_k of E ≤ 4 control elements. Out: `reduced/basis`, fields Φ that vanish on the control elements,
//! and `reduced/quartic`, the strain energy of Σ c_k u_k + Φ q under the St. Venant–Kirchhoff law ([`QuarticShape`]). Φ is
//! chosen from power series of equilibria along paths on which the elements move along screws:
//!
//! ```text
//! element e at ō + V(a ω_e) (o_e - ō + a d_e), turned by exp(a [ω_e])     Σ d_e = Σ ω_e = 0
//! u(a) = Σ a^k (Σ_j c_j⁽ᵏ⁾ u_j + φ_k)     φ_k = 0 on the elements         Φ = the main part of {φ_2}, then of {φ_3}
//! ```
//!
//! Of two elements the φ_2 span the 21 second derivatives of the equilibrium by their relative motion, and all are kept (J.
//! Barbič, D. James, ACM Transactions on Graphics 24, 2005, 982-990, use the same with vibration modes). Main parts are
//! those of the energy norm.

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::lift::Lift;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::super::tensor::Tensor;
use super::affine::AFFINE;
use super::columns::{self, Names};
use super::table;
use crate::base::columns::ColumnGroup;
use crate::fem::{NodeFields, QuarticShape, RestPoints, StiffnessMatrix};
use crate::solve::Progress;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::time::Instant;

pub const REDUCED: Family = Family { name: "reduced", from: &[AFFINE] };

/// Its table of the energy's coefficients.
pub const QUARTIC: &str = "reduced/quartic";
/// Φ over all nodes, until it is written.
const FIELDS_TABLE: &str = "reduced/fields";

fn names() -> Names {
    Names { basis: "reduced/basis".to_owned(), scale: "reduced/scale".to_owned() }
}

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: REDUCED,
    holds: "fields of second and third order, and the strain energy as a quartic in all fields",
    compute: Some(compute),
    solves: true,
    write,
    check,
    groups,
    fixed_bytes: |control_elements| {
        let variables = 1 + Lift::of(control_elements).len() + most_fields(control_elements);
        8 * QuarticShape { variables }.len()
    },
};

/// Control elements that a body may have: the coefficients grow with the fourth power of their number. At four there are
/// about 0.9 million, read in about 1 ms.
const MOST_ELEMENTS: usize = 4;

/// Fields Φ of a body of so many control elements: what the time of a force tick allows.
fn most_fields(control_elements: usize) -> usize {
    match control_elements {
        0 | 1 => 0,
        2 => 33,
        3 => 24,
        _ => 20,
    }
}

/// The part of them that is of second order.
const SECOND_ORDER_PART: f64 = 0.65;
/// Paths for each coordinate of the elements' relative motion.
const PATHS: usize = 8;
/// At a = 1 two elements are turned against each other by so much, rad, …
const TURN: f64 = 75.0 * std::f64::consts::PI / 180.0;
/// … and moved by this part of their distance beside that.
const SLIDE: f64 = 0.08;
/// A field whose energy is smaller than this part of the largest is rounding.
const RANK: f64 = 1e-12;

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let started = Instant::now();
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let elements = solution.controls.len();
    if elements > MOST_ELEMENTS {
        let body = assembled.place.to_owned();
        return Err(GreenError::TooManyControls { body, count: elements, most: MOST_ELEMENTS });
    }
    let points = RestPoints::of(solution.element, &solution.mesh, assembled.lame).map_err(unfit)?;
    let basis = basis(assembled, solution, &points, progress)?;

    progress.begin("quartic energy", points.points.len() as u64);
    let lift = Lift::of(elements);
    let lifted = combined(&solution.fields, &lift.columns);
    // In the order of the coordinates (1, y of undeformed elements, q, the other y).
    let (first, others) = split_columns(&lifted, lift.rigid);
    let coefficients = points.quartic(&beside(&[&first, &basis, &others]), &|units| progress.advance(units));
    progress.end();
    solution.tables.insert(QUARTIC, DMatrix::from_vec(coefficients.len(), 1, coefficients));
    let fields = DMatrix::from_row_slice(3 * basis.nodes, basis.columns, &basis.data);
    solution.tables.insert(FIELDS_TABLE, fields);
    solution.times.stiffness_s += started.elapsed().as_secs_f64();
    Ok(())
}

/// Φ over all nodes, orthonormal in the energy of small displacements.
fn basis(
    assembled: &Assembled<'_>,
    solution: &Solution,
    points: &RestPoints,
    progress: &dyn Progress,
) -> Result<NodeFields, GreenError> {
    let most = most_fields(solution.controls.len());
    let paths = paths(solution);
    if most == 0 || paths.is_empty() || assembled.partition.free.is_empty() {
        return Ok(NodeFields::zeros(points.nodes, 0));
    }
    let of_second_order = (SECOND_ORDER_PART * most as f64).round() as usize;
    progress.begin("fields of second order", 0);
    let first = lifted_order(solution, &paths, 1);
    let second = bend(assembled, points, std::slice::from_ref(&first), progress)?;
    let main = principal(assembled.k, &second, of_second_order);
    progress.end();
    progress.begin("fields of third order", 0);
    let mut whole = lifted_order(solution, &paths, 2);
    add(&mut whole, 1.0, &second);
    let third = bend(assembled, points, &[first, whole], progress)?;
    let third = without(assembled.k, &third, &main);
    let rest = principal(assembled.k, &third, most - main.columns);
    progress.end();
    Ok(beside(&[&main, &rest]))
}

/// φ_k from the orders before it.
fn bend(
    assembled: &Assembled<'_>,
    points: &RestPoints,
    orders: &[NodeFields],
    progress: &dyn Progress,
) -> Result<NodeFields, GreenError> {
    let loads = points.series_loads(orders).at(&assembled.partition.free);
    let mut fields = NodeFields::zeros(points.nodes, loads.columns);
    assembled.partition.insert_free(&(assembled.solve)(&loads, progress)?, &mut fields);
    Ok(fields)
}

/// d_e and ω_e of every element.
type Path = Vec<(Vector3<f64>, Vector3<f64>)>;

/// Paths of the elements in directions that fill the space of their relative motion evenly, the same in every run.
fn paths(solution: &Solution) -> Vec<Path> {
    let elements = solution.controls.len();
    let origins: Vec<Vector3<f64>> = solution.controls.iter().map(|control| control.origin).collect();
    let distance = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm();
    let pairs = |of: &[Vector3<f64>]| -> f64 {
        of.iter().flat_map(|a| of.iter().map(move |b| distance(a, b))).fold(0.0, f64::max)
    };
    let reach = pairs(&origins);
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut apart = |largest: f64| -> Vec<Vector3<f64>> {
        let some: Vec<Vector3<f64>> = (0..elements).map(|_| random.in_ball()).collect();
        let mean = some.iter().sum::<Vector3<f64>>() / elements as f64;
        let some: Vec<Vector3<f64>> = some.iter().map(|one| one - mean).collect();
        let scale = largest / pairs(&some).max(f64::MIN_POSITIVE);
        some.iter().map(|one| one * scale).collect()
    };
    let count = if elements < 2 { 0 } else { PATHS * 6 * (elements - 1) };
    (0..count)
        .map(|path| {
            // Slides of all sizes.
            let share = (path as f64 + 0.5) / count as f64;
            apart(SLIDE * reach * share.cbrt()).into_iter().zip(apart(TURN)).collect()
        })
        .collect()
}

/// Marsaglia's xorshift, for directions alone.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn in_ball(&mut self) -> Vector3<f64> {
        loop {
            let v = Vector3::new(self.next(), self.next(), self.next());
            if v.norm() <= 1.0 {
                return v;
            }
        }
    }
}

/// Σ_j c_j⁽ᵏ⁾ u_j of every path.
fn lifted_order(solution: &Solution, paths: &[Path], k: usize) -> NodeFields {
    let controls = &solution.controls;
    let mean = controls.iter().map(|control| control.origin).sum::<Vector3<f64>>() / controls.len() as f64;
    let mut c = DMatrix::zeros(FIELDS * controls.len(), paths.len());
    for (column, path) in paths.iter().enumerate() {
        for (e, (slide, turn)) in path.iter().enumerate() {
            let own = screw_order(&(controls[e].origin - mean), slide, turn, k);
            c.view_mut((FIELDS * e, column), (FIELDS, 1)).copy_from(&own);
        }
    }
    combined(&solution.fields, &c)
}

/// The coefficients of an element's affine motion at a^k, with arm v: T = V(a ω)(v + a d) - v, M = exp(a \[ω\]).
fn screw_order(arm: &Vector3<f64>, slide: &Vector3<f64>, turn: &Vector3<f64>, k: usize) -> DVector<f64> {
    // [ω]^n / n!
    let power = |n: usize| (1..=n).fold(Matrix3::identity(), |m, i| m * turn.cross_matrix() / i as f64);
    let translation = power(k) * arm / (k + 1) as f64 + power(k - 1) * slide / k as f64;
    let matrix = power(k).transpose();
    DVector::from_iterator(FIELDS, translation.iter().chain(matrix.iter()).copied())
}

fn dense(fields: &NodeFields) -> DMatrix<f64> {
    DMatrix::from_row_slice(3 * fields.nodes, fields.columns, &fields.data)
}

/// Fields times a matrix from the right.
fn combined(fields: &NodeFields, by: &DMatrix<f64>) -> NodeFields {
    let product = by.transpose() * dense(fields).transpose();
    NodeFields { nodes: fields.nodes, columns: by.ncols(), data: product.as_slice().to_vec() }
}

fn add(fields: &mut NodeFields, factor: f64, others: &NodeFields) {
    fields.data.iter_mut().zip(&others.data).for_each(|(a, b)| *a += factor * b);
}

/// The first columns, and the rest.
fn split_columns(fields: &NodeFields, at: usize) -> (NodeFields, NodeFields) {
    let part = |columns: std::ops::Range<usize>| NodeFields {
        nodes: fields.nodes,
        columns: columns.len(),
        data: (0..3 * fields.nodes).flat_map(|row| fields.row(row)[columns.clone()].to_vec()).collect(),
    };
    (part(0..at), part(at..fields.columns))
}

/// All columns, one list after the other.
fn beside(lists: &[&NodeFields]) -> NodeFields {
    let nodes = lists[0].nodes;
    let columns = lists.iter().map(|list| list.columns).sum();
    let data = (0..3 * nodes).flat_map(|row| lists.iter().flat_map(move |list| list.row(row).to_vec()));
    NodeFields { nodes, columns, data: data.collect() }
}

/// Fᵀ K G.
fn products(k: &StiffnessMatrix, f: &NodeFields, g: &NodeFields) -> DMatrix<f64> {
    let mut force = NodeFields::zeros(g.nodes, g.columns);
    k.multiply(g, &mut force);
    dense(f).transpose() * dense(&force)
}

/// The part of `fields` that is orthogonal to the orthonormal `basis`.
fn without(k: &StiffnessMatrix, fields: &NodeFields, basis: &NodeFields) -> NodeFields {
    let mut rest = fields.clone();
    // Twice, for the digits that cancel.
    for _ in 0..2 {
        let share = combined(basis, &products(k, basis, &rest));
        add(&mut rest, -1.0, &share);
    }
    rest
}

/// The `most` fields, orthonormal in K, from which the `fields` differ least in energy.
fn principal(k: &StiffnessMatrix, fields: &NodeFields, most: usize) -> NodeFields {
    let gram = products(k, fields, fields);
    let eigen = ((&gram + gram.transpose()) * 0.5).symmetric_eigen();
    let mut order: Vec<usize> = (0..fields.columns).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |&first| eigen.eigenvalues[first]);
    order.truncate(most);
    order.retain(|&i| eigen.eigenvalues[i] > RANK * largest);
    let by = DMatrix::from_fn(fields.columns, order.len(), |row, column| {
        eigen.eigenvectors[(row, order[column])] / eigen.eigenvalues[order[column]].sqrt()
    });
    combined(fields, &by)
}

fn write(body: &Precomputed, _: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let mut tensors = table::write(body, QUARTIC);
    if let Some(fields) = body.solution.tables.get(FIELDS_TABLE) {
        let stored = columns::stored(body, fields.ncols(), &|row, column| fields[(row, column)]);
        tensors.extend(columns::write(body, names(), stored));
    }
    tensors
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let basis = format!("{name}/{}", names().basis);
    let fields = file.tensors.get(&basis).and_then(|(_, shape, _)| shape.first().copied()).unwrap_or(0);
    columns::check(file, name, &names(), fields)?;
    let variables = 1 + Lift::of(body.controls.len()).len() + fields;
    table::check(file, name, QUARTIC, [QuarticShape { variables }.len(), 1]).map(drop)
}

fn groups<'a>(file: &'a GreenFile, body: &str) -> Vec<ColumnGroup<'a>> {
    vec![columns::group(file, body, &names())]
}
