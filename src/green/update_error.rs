//! How inexact a body is after a change that was not solved for anew ([`super::update`]).
//!
//! In: the family `updates`, a change, and the body after it. Out: the largest relative error of its columns, its handle
//! stiffness and its compliance. A change of many decades, or one that leaves little to hold the body, takes the difference of
//! large numbers, whose errors no residual of the small dense system shows. So the change is made a second time with numbers
//! that differ at random by as much as they may be wrong, and what then differs is the error (J. Vignes, Mathematics and
//! Computers in Simulation 35, 1993, 233-261).

use super::control::FIELDS;
use super::update::{Change, Changed, Updated, Updates};
use crate::base::random::Random;
use nalgebra::DMatrix;

/// The error of a displacement that was solved for in f64, as a part of the largest of its field.
const FIELD: f64 = 1e-15;
/// A row of the handle stiffness below this part of the largest number in it is rounding, as of a rigid motion of the only
/// control element that holds.
const ROUNDING: f64 = 1e-6;

/// Numbers on which an update is compared.
pub struct Measure<'a> {
    /// The columns of control elements and loads on the surface after the change.
    pub columns: &'a DMatrix<f64>,
    /// The Hessian before the change ([`Changed::body`]).
    pub hessian: &'a DMatrix<f64>,
    /// Half the body's extent, m: it makes a displacement of a unit field that is not a shift.
    pub reach: f64,
    /// Nodes of the surface whose compliance is compared.
    pub pressed: &'a [u32],
    /// Relative residual with which the body was solved.
    pub residual: f64,
}

/// The largest relative error of `after`, which `changed` made; infinite where no digit is left.
pub fn error(
    updates: &Updates,
    change: &Change,
    changed: &Changed<'_>,
    after: &Updated,
    measure: &Measure<'_>,
) -> f64 {
    let disturbed = disturbed(updates, measure.residual.max(FIELD));
    let Some(again) = disturbed.prepare(change) else { return f64::INFINITY };
    let other = again.body(measure.hessian);
    let columns = relative(&after.added, &other.added, measure.columns);
    let hessian = of_hessian(&after.hessian, &other.hessian, FIELDS * after.kept.len(), measure.reach);
    let [yields, others] = [changed, &again].map(|changed| changed.compliance(measure.pressed));
    [columns, hessian, relative(&yields, &others, &yields), after.asymmetry].into_iter().fold(0.0, larger)
}

/// Displacements off by [`FIELD`], forces by `part` of the largest of their field.
fn disturbed(updates: &Updates, part: f64) -> Updates {
    let mut random = Random::default();
    let mut disturb = |table: &mut DMatrix<f64>, part: f64| {
        for mut column in table.column_iter_mut() {
            let size = 2.0 * part * column.amax();
            column.iter_mut().for_each(|value| *value += size * random.draw());
        }
    };
    let mut other = updates.clone();
    disturb(&mut other.values, FIELD);
    disturb(&mut other.columns, FIELD);
    disturb(&mut other.reactions, part);
    disturb(&mut other.work, part);
    other.ports.regions.iter_mut().for_each(|region| disturb(&mut region.stiffness, part));
    other
}

fn larger(most: f64, value: f64) -> f64 {
    if value > most || value.is_nan() { value } else { most }
}

fn part(difference: f64, of: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / of }
}

/// The largest difference in a column, as a part of the largest number of that column of `all`.
fn relative(a: &DMatrix<f64>, b: &DMatrix<f64>, all: &DMatrix<f64>) -> f64 {
    let columns = a.column_iter().zip(b.column_iter()).zip(all.column_iter());
    columns.map(|((a, b), all)| part((a - b).amax(), all.amax())).fold(0.0, larger)
}

/// Largest difference of forces: S row by row, reactions to loads column by column, and the work of loads on each other as a part
/// of that which each does by itself.
fn of_hessian(a: &DMatrix<f64>, b: &DMatrix<f64>, affine: usize, reach: f64) -> f64 {
    let scale = |i: usize| if i < affine && i % FIELDS >= 3 { 1.0 / reach } else { 1.0 };
    let scaled =
        |h: &DMatrix<f64>| DMatrix::from_fn(h.nrows(), h.ncols(), |i, j| h[(i, j)] * scale(i) * scale(j));
    let (a, b) = (scaled(a), scaled(b));
    let difference = &a - &b;
    let s = |of: &DMatrix<f64>| -> DMatrix<f64> { of.view((0, 0), (affine, affine)).into() };
    let (own, off) = (s(&a), s(&difference));
    let least = ROUNDING * own.amax();
    let rows = (0..affine).map(|i| part(off.row(i).amax(), own.row(i).amax().max(least)));
    let reaction = |of: &DMatrix<f64>, j: usize| of.view((0, j), (affine, 1)).amax();
    let loads = || affine..a.ncols();
    let reactions = loads().map(|j| part(reaction(&difference, j), reaction(&a, j)));
    let of_pair = |i: usize, j: usize| part(difference[(i, j)].abs(), (a[(i, i)] * a[(j, j)]).abs().sqrt());
    let work = loads().flat_map(|i| loads().map(move |j| (i, j))).map(|(i, j)| of_pair(i, j));
    rows.chain(reactions).chain(work).fold(0.0, larger)
}
