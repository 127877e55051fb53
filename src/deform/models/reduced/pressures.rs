//! The neo-Hookean energy of a body that bends into few fields, its volume kept in the mean by few pressures.
//!
//! In: the forms g of the family `reduced_neo_hookean`, exact cubics in z ([`Cubics`]), and z. Out
//!
//! ```text
//! V = g_0 + ½ Σ g_m²     ∂V/∂z_i = ∂g_0/∂z_i + Σ g_m ∂g_m/∂z_i     ∂²V/∂z_i∂z_j = ∂²g_0/∂z_i∂z_j + Σ g_m ∂²g_m/∂z_i∂z_j + Σ ∂g_m/∂z_i ∂g_m/∂z_j
//! ```
//!
//! V is never below a bound: g_0 falls without one as ∫ μ (1 - J) alone, and that is a multiple of g_1.
//!
//! A body that warmth makes s times as large has s³ V(z/s), where its last z is 1/s - 1: the field X, by which F/s - I is more than the
//! sum of the others. Allocates nothing once it is made.

use super::cubics::{Cubics, Forms, Second};
use super::strain_energy::StrainEnergy;
use crate::fem::CubicShape;
use nalgebra::{DMatrix, Matrix3};

/// Parts in which second derivatives are made for the force loop.
const PARTS: usize = 6;
/// Entries of a gradient.
const ENTRIES: usize = 9;

pub struct Pressures {
    /// Numbers z without that of warmth.
    variables: usize,
    cubics: Cubics,
    /// The forms at z/s, and s.
    here: Forms,
    size: f64,
    /// Second derivatives for Newton's method, and those that are prepared in parts.
    newton: Second,
    second: Second,
    /// Gradients of the fields at the points that are pressed most, entry by entry, `variables - 1` numbers each.
    points: Vec<f64>,
}

/// Takes z/s into the forms: the first `active` of z, or all of them and that of warmth.
fn place(forms: &mut Forms, z: &[f64], active: usize, size: f64) {
    let all = forms.z.len();
    forms.active = if size == 1.0 { active } else { all };
    forms.z[active..].fill(0.0);
    for (own, z) in forms.z.iter_mut().zip(&z[..active]) {
        *own = z / size;
    }
    forms.z[0] = 1.0;
    if size != 1.0 {
        forms.z[all - 1] = size.recip() - 1.0;
    }
}

impl Pressures {
    /// The energy of `variables` numbers z; `None` where the tables do not suit them.
    pub fn new(variables: usize, forms: &DMatrix<f64>, points: &DMatrix<f64>) -> Option<Pressures> {
        let all = [variables, variables + 1]
            .into_iter()
            .find(|n| CubicShape { variables: *n }.len() == forms.ncols())?;
        if points.nrows() != ENTRIES * (variables - 1) {
            return None;
        }
        let cubics = Cubics::new(forms)?;
        let here = Forms::new(&cubics, all);
        let second = || Second::new(&here, variables);
        let (newton, second) = (second(), second());
        let points = points.as_slice().to_vec();
        Some(Pressures { variables, cubics, here, size: 1.0, newton, second, points })
    }

    fn evaluate(&mut self, z: &[f64], active: usize, size: f64) {
        self.size = size;
        place(&mut self.here, z, active, size);
        self.here.evaluate(&self.cubics);
    }

    /// Whether the forms are known there.
    fn is_at(&self, z: &[f64], active: usize, size: f64) -> bool {
        let is_same = self.here.active == active && size == 1.0 && self.size == 1.0;
        is_same && self.here.z[1..active] == z[1..active]
    }

    fn slope(&self, k: usize) -> f64 {
        self.size.powi(2) * self.here.slope(k)
    }
}

impl StrainEnergy for Pressures {
    fn stiffness(&self, k: usize) -> f64 {
        let shape = CubicShape { variables: self.variables };
        let linear = self.cubics.others(shape.at([0, 0, k]));
        let squares: f64 = linear.iter().map(|slope| f64::from(slope * slope)).sum();
        self.cubics.first[shape.at([0, k, k])] + 0.5 * squares
    }

    fn slopes(&mut self, z: &[f64], active: usize, size: f64, slopes: &mut [f64]) -> f64 {
        self.evaluate(z, active, size);
        for (k, slope) in slopes.iter_mut().enumerate().take(active) {
            *slope = self.slope(k);
        }
        size.powi(3) * self.here.energy()
    }

    fn slopes_beyond(&mut self, _: &[f64], active: usize, slopes: &mut [f64]) {
        if self.here.active == active {
            self.here.evaluate_beyond(&self.cubics, self.variables);
        }
        for (k, slope) in (active..).zip(slopes) {
            *slope = self.slope(k);
        }
    }

    fn second(&mut self, z: &[f64], active: usize, size: f64) -> &mut [f64] {
        if !self.is_at(z, active, size) {
            self.evaluate(z, active, size);
        }
        self.newton.forms.copy_from(&self.here);
        self.newton.begin();
        self.newton.go_on(&self.cubics, usize::MAX);
        self.newton.finish(active, size)
    }

    fn prepare(&mut self, z: &[f64]) -> bool {
        if !self.second.has_begun() {
            place(&mut self.second.forms, z, self.variables, 1.0);
            self.second.forms.evaluate(&self.cubics);
            self.second.begin();
        } else if !self.is_prepared() {
            let count = CubicShape { variables: self.variables }.len();
            self.second.go_on(&self.cubics, count.div_ceil(PARTS));
            if self.is_prepared() {
                self.second.finish(self.variables, 1.0);
            }
        }
        self.is_prepared()
    }

    fn is_prepared(&self) -> bool {
        self.second.is_summed()
    }

    fn prepared(&self) -> &[f64] {
        self.second.made()
    }

    fn forget(&mut self) {
        self.second.forget();
    }

    fn is_inverted(&self, z: &[f64]) -> bool {
        let fields = self.variables - 1;
        self.points.chunks_exact((ENTRIES * fields).max(1)).any(|rows| {
            let entry = |row: &[f64]| row.iter().zip(&z[1..]).map(|(h, z)| h * z).sum::<f64>();
            let h = Matrix3::from_iterator(rows.chunks_exact(fields).map(entry));
            (h + Matrix3::identity()).determinant() <= 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(variables: usize, forms: usize, is_warm: bool) -> Pressures {
        let all = CubicShape { variables: variables + usize::from(is_warm) }.len();
        let forms = DMatrix::from_fn(forms, all, |form, at| (1.3 * at as f64 + 0.7 * form as f64).sin());
        let points = DMatrix::from_fn(ENTRIES * (variables - 1), 2, |row, point| (row + point) as f64);
        Pressures::new(variables, &forms, &points).unwrap()
    }

    fn value(body: &Pressures, z: &[f64]) -> f64 {
        let (mut g, mut first_value) = (vec![0.0; body.cubics.others(0).len()], 0.0);
        let mut at = 0;
        for c in 0..z.len() {
            for b in 0..=c {
                for a in 0..=b {
                    let (own, monomial) = (body.cubics.others(at), z[a] * z[b] * z[c]);
                    g.iter_mut().zip(own).for_each(|(g, w)| *g += f64::from(*w) * monomial);
                    first_value += body.cubics.first[at] * monomial;
                    at += 1;
                }
            }
        }
        first_value + 0.5 * g.iter().map(|g| g * g).sum::<f64>()
    }

    /// Values against sums over all coefficients, slopes and second derivatives against central differences; those of inactive z too, and
    /// with warmth.
    #[test]
    fn slopes_and_second_derivatives_are_those_of_the_sum() {
        let n = 6;
        for (active, size) in [(n, 1.0), (4, 1.0), (n, 1.03), (4, 0.9)] {
            let mut body = body(n, 11, size != 1.0);
            let mut z: Vec<f64> =
                (0..n).map(|i| if i < active { 0.4 * (0.7 * i as f64).cos() } else { 0.0 }).collect();
            z[0] = 1.0;
            let of = |body: &Pressures, z: &[f64]| {
                let mut all: Vec<f64> = z.iter().map(|z| z / size).collect();
                all[0] = 1.0;
                if size != 1.0 {
                    all.push(1.0 / size - 1.0);
                }
                size.powi(3) * value(body, &all)
            };
            let mut slopes = vec![0.0; n];
            let found = body.slopes(&z, active, size, &mut slopes[..active]);
            body.slopes_beyond(&z, active, &mut slopes[active..]);
            assert!((found - of(&body, &z)).abs() < 1e-12 * found.abs(), "{found} {}", of(&body, &z));
            let second = body.second(&z, active, size).to_vec();
            let moved = |i: usize, by: f64| {
                let mut z = z.clone();
                z[i] += by;
                z
            };
            for i in 1..n {
                let slope = (of(&body, &moved(i, 1e-5)) - of(&body, &moved(i, -1e-5))) / 2e-5;
                assert!((slopes[i] - slope).abs() < 1e-7, "{active} {size} {i}: {} {slope}", slopes[i]);
                let (mut plus, mut minus) = (vec![0.0; active], vec![0.0; active]);
                if i < active {
                    body.slopes(&moved(i, 1e-5), active, size, &mut plus);
                    body.slopes(&moved(i, -1e-5), active, size, &mut minus);
                }
                for j in (1..active).filter(|_| i < active) {
                    let expected = (plus[j] - minus[j]) / 2e-5;
                    let found = second[i * active + j];
                    assert!((found - expected).abs() < 1e-6, "{active} {size} {i} {j}: {found} {expected}");
                }
            }
        }
    }

    /// The derivatives that are made in parts are those that are made at once.
    #[test]
    fn parts_make_the_whole() {
        let n = 9;
        let mut body = body(n, 7, false);
        let z: Vec<f64> = (0..n).map(|i| if i == 0 { 1.0 } else { 0.3 * (i as f64).sin() }).collect();
        let whole = body.second(&z, n, 1.0).to_vec();
        let calls = (1..).find(|_| body.prepare(&z)).unwrap();
        assert!((3..=PARTS + 2).contains(&calls), "{calls}");
        assert_eq!(whole, body.prepared());
    }

    #[test]
    fn a_point_that_is_pressed_flat_is_inside_out() {
        let forms = DMatrix::zeros(1, CubicShape { variables: 2 }.len());
        let flat = DMatrix::from_column_slice(9, 1, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let body = Pressures::new(2, &forms, &flat).unwrap();
        assert!(body.is_inverted(&[1.0, -1.01]) && !body.is_inverted(&[1.0, -0.99]));
    }
}
