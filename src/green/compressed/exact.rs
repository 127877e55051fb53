//! Columns that are solved for anew, and how wrong others are beside them.
//!
//! In: a factor. Out: [`Exact`], which measures what bases leave out, and the error of a compressed compliance.

use super::column::Shape;
use super::samples::some;
use super::tree::{Surface, unit_columns};
use crate::solve::{Progress, SolveError};
use faer::Mat;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Nodes whose columns are solved for anew.
pub const MEASURED: usize = 64;

type M3 = Matrix3<f64>;
/// One column: `[node][axis][force]`.
type Column = [[[f64; 3]; 3]];
/// A column for a place, beside the exact one.
type Approximation<'a> = &'a (dyn Fn(usize, &Column) -> Vec<[[f64; 3]; 3]> + Sync);

/// Columns that were solved for.
pub struct Exact {
    pub places: Vec<usize>,
    /// The column of each place: `[node][axis][force]`.
    columns: Vec<Vec<[[f64; 3]; 3]>>,
}

pub fn exact(of: &Surface<'_>, progress: &dyn Progress) -> Result<Exact, SolveError> {
    let places = some(of.n, MEASURED, 7);
    let mut columns = Vec::new();
    progress.begin("columns to compare with", places.len() as u64);
    for chunk in places.chunks(8) {
        let x = unit_columns(of, chunk, 0)?;
        for column in 0..chunk.len() {
            let value = |node: usize, axis: usize, force: usize| x.row(3 * node + axis)[3 * column + force];
            let of_node = |node: usize| [0, 1, 2].map(|axis| [0, 1, 2].map(|force| value(node, axis, force)));
            columns.push((0..of.nodes.len()).map(of_node).collect());
        }
        progress.advance(chunk.len() as u64);
    }
    progress.end();
    Ok(Exact { places, columns })
}

impl Exact {
    /// The largest error of these columns, whose blocks have these numbers.
    pub fn error(&self, shape: &Shape, block: &(dyn Fn(usize) -> Mat<f64> + Sync)) -> f64 {
        self.largest(&|place, _| {
            let found = shape.column(place, |index| Ok::<_, std::convert::Infallible>(block(index)));
            found.unwrap_or_else(|never| match never {})
        })
    }

    /// The largest error where all that is far away has nothing but the fields of the bases.
    pub fn left_out(&self, shape: &Shape) -> f64 {
        self.largest(&|place, exact| shape.seen(place, exact))
    }

    fn largest(&self, found: Approximation<'_>) -> f64 {
        let of_column =
            |(&place, exact): (&usize, &Vec<[[f64; 3]; 3]>)| error(place, &found(place, exact), exact);
        self.places.par_iter().zip(&self.columns).map(of_column).reduce(|| 0.0, f64::max)
    }
}

/// ‖E_ij (K⁻¹)_jj⁻¹‖₂ of a column j, the largest of all nodes i.
fn error(place: usize, found: &[[[f64; 3]; 3]], exact: &[[[f64; 3]; 3]]) -> f64 {
    let matrix = |of: &[[f64; 3]; 3]| M3::from_fn(|axis, force| of[axis][force]);
    let Some(inverse) = matrix(&exact[place]).try_inverse() else { return f64::INFINITY };
    let larger = |largest: f64, (found, exact): (&[[f64; 3]; 3], &[[f64; 3]; 3])| {
        let relative = (matrix(found) - matrix(exact)) * inverse;
        // ‖·‖₂ is at most Frobenius' norm.
        if relative.norm() <= largest {
            return largest;
        }
        largest.max((relative.transpose() * relative).symmetric_eigenvalues().amax().sqrt())
    };
    found.iter().zip(exact).fold(0.0, larger)
}
