//! W of contacts: columns that are computed when a force first needs them.
//!
//! In: its blocks, one at a time. Out: displacements by forces. W is symmetric, and of each two blocks that mirror each other one is
//! computed.

use nalgebra::{DMatrix, Matrix3, Vector3};
use std::cell::OnceCell;

type V3 = Vector3<f64>;

pub struct Compliance<'a> {
    /// Blocks on the diagonal.
    diagonal: Vec<Matrix3<f64>>,
    /// The three columns of a contact, one after the other.
    columns: Vec<OnceCell<Vec<f64>>>,
    /// Displacement of one contact by a force at another, m/N.
    block: Box<dyn Fn(usize, usize) -> Matrix3<f64> + 'a>,
}

impl<'a> Compliance<'a> {
    pub fn new(
        diagonal: Vec<Matrix3<f64>>,
        block: impl Fn(usize, usize) -> Matrix3<f64> + 'a,
    ) -> Compliance<'a> {
        let columns = vec![OnceCell::new(); diagonal.len()];
        Compliance { diagonal, columns, block: Box::new(block) }
    }

    /// The compliance of a matrix that is known as a whole.
    pub fn of(w: &'a DMatrix<f64>) -> Compliance<'a> {
        let block = |i: usize, a: usize| w.fixed_view::<3, 3>(3 * i, 3 * a).into_owned();
        Compliance::new((0..w.nrows() / 3).map(|a| block(a, a)).collect(), block)
    }

    /// The compliance of some of the contacts.
    pub fn part<'b>(&'b self, some: &'b [usize]) -> Compliance<'b> {
        let diagonal = some.iter().map(|a| self.diagonal[*a]).collect();
        Compliance::new(diagonal, |i, a| block_of(self.columns(some[a]), some[i]))
    }

    /// The compliance of contacts that yield by so much more to their own forces, m/N.
    pub fn with_skin(&self, skin: f64) -> Compliance<'_> {
        let own = Matrix3::from_diagonal_element(skin);
        let diagonal = self.diagonal.iter().map(|block| block + own).collect();
        Compliance::new(diagonal, |i, a| block_of(self.columns(a), i))
    }

    /// Number of contacts.
    pub fn contacts(&self) -> usize {
        self.diagonal.len()
    }

    /// Displacement of a contact by its own force.
    pub fn own(&self, a: usize) -> &Matrix3<f64> {
        &self.diagonal[a]
    }

    /// Mean compliance of a contact in all directions, above 0.
    pub fn softness(&self, a: usize) -> f64 {
        self.diagonal[a].trace().max(f64::MIN_POSITIVE) / 3.0
    }

    /// Adds to `d` the displacements of all contacts by a force at one.
    pub fn add(&self, a: usize, force: &V3, d: &mut [f64]) {
        let columns = self.columns(a);
        let (x, rest) = columns.split_at(d.len());
        let (y, z) = rest.split_at(d.len());
        for (((d, x), y), z) in d.iter_mut().zip(x).zip(y).zip(z) {
            *d += x * force.x + y * force.y + z * force.z;
        }
    }

    /// Number of contacts whose columns have been computed.
    #[cfg(test)]
    pub fn computed(&self) -> usize {
        self.columns.iter().filter(|columns| columns.get().is_some()).count()
    }

    fn columns(&self, a: usize) -> &[f64] {
        self.columns[a].get_or_init(|| {
            let rows = 3 * self.contacts();
            let mut all = vec![0.0; 3 * rows];
            for (i, mirrored) in self.columns.iter().enumerate() {
                let block = match mirrored.get() {
                    _ if i == a => self.diagonal[a],
                    Some(columns) => block_of(columns, a).transpose(),
                    None => (self.block)(i, a),
                };
                for (k, column) in block.column_iter().enumerate() {
                    all[k * rows + 3 * i..][..3].copy_from_slice(column.as_slice());
                }
            }
            all
        })
    }
}

/// The rows of a contact in the columns of another.
fn block_of(columns: &[f64], i: usize) -> Matrix3<f64> {
    let rows = columns.len() / 3;
    Matrix3::from_fn(|r, k| columns[k * rows + 3 * i + r])
}
