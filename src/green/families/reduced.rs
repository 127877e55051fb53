//! The family `reduced`: fields that a body bends into beyond the affine ones, and its energy as a quartic in all of them.
//!
//! In: the affine fields u_k of E ≤ 4 control elements. Out: `reduced/basis`, fields Φ that vanish on the control elements,
//! and `reduced/quartic`, the strain energy of Σ c_k u_k + Φ q under the St. Venant–Kirchhoff law ([`QuarticShape`]). Φ is
//! chosen from the power series of equilibria along [`screw_paths`](super::screw_paths): the main part of all φ_2, then that of
//! all φ_3. Of two elements the φ_2 span the 21 second derivatives of the equilibrium by their relative motion, and all are kept (J.
//! Barbič, D. James, ACM Transactions on Graphics 24, 2005, 982-990, use the same with vibration modes). Main parts are
//! those of the energy norm.

use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::lift::Lift;
use super::super::prepare::Prepared;
use super::super::requirements::Family;
use super::super::solution::{Precomputed, Solution};
use super::super::tensor::Tensor;
use super::affine::AFFINE;
use super::columns::{self, Names};
use super::dense_fields::{add, beside, combined, principal, products, split_columns, without};
use super::screw_paths::{bend, lifted_order, paths};
use super::table;
use crate::base::columns::ColumnGroup;
use crate::fem::{NodeFields, QuarticShape, RestPoints};
use crate::scene::Body;
use crate::solve::Progress;
use nalgebra::DMatrix;

pub const REDUCED: Family = Family { name: "reduced", from: &[AFFINE] };

/// Its table of the energy's coefficients.
pub const QUARTIC: &str = "reduced/quartic";
/// Φ over all nodes, until it is written.
pub const FIELDS_TABLE: &str = "reduced/fields";

fn names() -> Names {
    Names { basis: "reduced/basis".to_owned(), scale: "reduced/scale".to_owned() }
}

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: REDUCED,
    holds: "fields of second and third order, and the strain energy as a quartic in all fields",
    suits: Some(suits),
    compute: Some(compute),
    solves: true,
    write,
    check,
    groups,
    fixed_bytes: |control_elements| {
        let variables = 1 + Lift::of(control_elements).len() + most_fields(control_elements);
        8 * QuarticShape { variables }.len()
    },
    is_derived: false,
    column_names: None,
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
fn suits(place: &str, _: &Body, prepared: &Prepared) -> Result<(), GreenError> {
    let count = prepared.controls.len();
    if count <= MOST_ELEMENTS {
        return Ok(());
    }
    Err(GreenError::ControlCount { body: place.to_owned(), model: "reduced", count, allowed: "1 to 4" })
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let elements = solution.controls.len();
    let points = RestPoints::of(solution.element, &solution.mesh, assembled.lame).map_err(unfit)?;
    let basis = basis(assembled, solution, &points, progress)?;

    progress.begin("quartic energy", points.count() as u64);
    let lift = Lift::of(elements);
    let lifted = combined(&solution.fields, &lift.columns);
    // In the order of the coordinates (1, y of undeformed elements, q, the other y).
    let (first, others) = split_columns(&lifted, lift.rigid);
    let coefficients = points.quartic(&beside(&[&first, &basis, &others]), &|units| progress.advance(units));
    progress.end();
    solution.tables.insert(QUARTIC, DMatrix::from_vec(coefficients.len(), 1, coefficients));
    let fields = DMatrix::from_row_slice(3 * basis.nodes, basis.columns, &basis.data);
    solution.tables.insert(FIELDS_TABLE, fields);
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
    let paths = paths(solution, PATHS);
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
    // In parts of the energy, so that a path that hardly strains the body counts as much as the others.
    let energies = products(assembled.k, &first, &first).diagonal();
    let scales = DMatrix::from_diagonal(&energies.map(|energy| energy.max(f64::MIN_POSITIVE).sqrt().recip()));
    let third = combined(&bend(assembled, points, &[first, whole], progress)?, &scales);
    let third = without(assembled.k, &third, &main);
    let rest = principal(assembled.k, &third, most - main.columns);
    progress.end();
    Ok(beside(&[&main, &rest]))
}

fn write(body: &Precomputed, _: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let mut tensors = table::write(body, QUARTIC);
    if let Some(fields) = body.solution.tables.get(FIELDS_TABLE) {
        let stored = columns::stored(body, fields.ncols(), &|row, column| fields[(row, column)]);
        tensors.extend(columns::write(body.storage, body.solution.surface.nodes.len(), names(), stored));
    }
    tensors
}

/// No file has more columns; their quartic would be 100 million numbers.
const MOST_FIELDS: usize = 128;

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    let basis = format!("{name}/{}", names().basis);
    let fields = file.tensors.get(&basis).and_then(|(_, shape, _)| shape.first().copied()).unwrap_or(0);
    if fields > MOST_FIELDS {
        return Err(format!("tensor {basis} has {fields} columns, more than the {MOST_FIELDS} of any body"));
    }
    columns::check(file, name, &names(), fields)?;
    let variables = 1 + Lift::of(body.controls.len()).len() + fields;
    table::check(file, name, QUARTIC, [QuarticShape { variables }.len(), 1]).map(drop)
}

fn groups<'a>(file: &'a GreenFile, body: &str) -> Vec<ColumnGroup<'a>> {
    // One element alone has no such columns.
    let group = columns::group(file, body, &names());
    if group.numbers() == 0 { Vec::new() } else { vec![group] }
}
