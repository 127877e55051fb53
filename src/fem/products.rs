//! Products of vectors and matrices of three, by single numbers: nalgebra's own go through views of columns, which are not
//! optimised away where units of code are compiled each by itself, and these are the innermost loops of every equilibrium.

use nalgebra::{Matrix3, Vector3};

/// Adds u ⊗ v.
#[inline]
pub fn add_dyad(sum: &mut Matrix3<f64>, u: &Vector3<f64>, v: &Vector3<f64>) {
    for (column, v) in sum.data.0.iter_mut().zip(v.data.0[0]) {
        for (sum, u) in column.iter_mut().zip(u.data.0[0]) {
            *sum += u * v;
        }
    }
}

/// A v.
#[inline]
pub fn times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let [x, y, z] = &a.data.0;
    Vector3::from(std::array::from_fn::<f64, 3, _>(|i| x[i] * v.x + y[i] * v.y + z[i] * v.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_nalgebra() {
        let (u, v) = (Vector3::new(0.3, -1.2, 2.5), Vector3::new(1.7, 0.4, -0.9));
        let mut sum = Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0);
        let expected = sum + u * v.transpose();
        add_dyad(&mut sum, &u, &v);
        assert_eq!(sum, expected);
        assert_eq!(times(&sum, &v), sum * v);
    }
}
