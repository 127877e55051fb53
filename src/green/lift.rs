//! Coordinates y of the affine fields for energies that a common translation leaves alone.
//!
//! In: how many control elements there are. Out: orthonormal columns L over the 12 E coefficients c, y = Lᵀ c, in which those
//! come first that turned but undeformed elements need, seen from the middle between them: of two elements, the difference
//! of their translations and of their skew parts and the sum of their symmetric parts (a turn by ±φ has cos φ - 1 in both).

use super::control::FIELDS;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// L.
#[derive(Clone, Debug, PartialEq)]
pub struct Lift {
    /// Columns of L that undeformed elements need; the others follow them.
    pub rigid: usize,
    /// L, 12 E rows.
    pub columns: DMatrix<f64>,
}

impl Lift {
    pub fn new(elements: usize) -> Lift {
        let (differences, mean) = split(elements);
        let translations: Vec<[f64; 12]> = (0..3).map(unit).collect();
        let skew: Vec<[f64; 12]> = (0..3).map(turn).collect();
        let symmetric: Vec<[f64; 12]> =
            [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].map(stretch).to_vec();
        let mut columns: Vec<Vec<f64>> = Vec::new();
        let mut add = |shares: &[Vec<f64>], fields: &[[f64; 12]]| {
            for share in shares {
                columns.extend(fields.iter().map(|field| {
                    share.iter().flat_map(|share| field.iter().map(move |value| share * value)).collect()
                }));
            }
            columns.len()
        };
        add(&differences, &translations);
        add(&differences, &skew);
        let mut rigid = 0;
        if elements == 2 {
            rigid = add(&mean, &symmetric);
        }
        if elements > 1 {
            add(&mean, &skew);
        }
        if elements != 2 {
            add(&mean, &symmetric);
        }
        let all = add(&differences, &symmetric);
        if elements > 2 {
            rigid = all;
        }
        let rows = FIELDS * elements;
        Lift { rigid, columns: DMatrix::from_fn(rows, all, |row, column| columns[column][row]) }
    }

    /// Numbers y.
    pub fn len(&self) -> usize {
        self.columns.ncols()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Shares of the elements that are orthonormal: E - 1 that sum to nothing (Helmert's), and the equal one.
fn split(elements: usize) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let difference = |k: usize| -> Vec<f64> {
        let norm = ((k * (k + 1)) as f64).sqrt();
        let share = |e: usize| match e.cmp(&k) {
            std::cmp::Ordering::Less => -1.0 / norm,
            std::cmp::Ordering::Equal => k as f64 / norm,
            std::cmp::Ordering::Greater => 0.0,
        };
        (0..elements).map(share).collect()
    };
    let equal = vec![1.0 / (elements.max(1) as f64).sqrt(); elements];
    ((1..elements).map(difference).collect(), vec![equal])
}

fn unit(field: usize) -> [f64; 12] {
    std::array::from_fn(|k| f64::from(u8::from(k == field)))
}

/// A turn about an axis, of unit length.
fn turn(axis: usize) -> [f64; 12] {
    of_matrix(&Vector3::ith(axis, std::f64::consts::FRAC_1_SQRT_2).cross_matrix())
}

fn stretch((i, j): (usize, usize)) -> [f64; 12] {
    let mut matrix = Matrix3::zeros();
    let length: f64 = if i == j { 1.0 } else { std::f64::consts::FRAC_1_SQRT_2 };
    (matrix[(i, j)], matrix[(j, i)]) = (length, length);
    of_matrix(&matrix)
}

fn of_matrix(matrix: &Matrix3<f64>) -> [f64; 12] {
    std::array::from_fn(|k| if k < 3 { 0.0 } else { matrix[(k / 3 - 1, k % 3)] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_orthonormal_and_leave_out_the_common_translation_alone() {
        for (elements, rigid, all) in [(1, 0, 6), (2, 12, 21), (3, 33, 33), (4, 45, 45)] {
            let lift = Lift::new(elements);
            assert_eq!((lift.rigid, lift.len()), (rigid, all));
            let gram = lift.columns.transpose() * &lift.columns;
            assert!((gram - DMatrix::identity(all, all)).amax() < 1e-15);
            for axis in 0..3 {
                let common = DMatrix::from_fn(1, 12 * elements, |_, k| f64::from(u8::from(k % 12 == axis)));
                assert!((common * &lift.columns).amax() < 1e-15);
            }
        }
    }
}
