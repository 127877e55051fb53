//! The strain energy of a body held by control elements, as a function of their frames, to the third order.
//!
//! In: frames g_e = (R_e, p_e) with stretches U_e, the handle stiffness S, the cubic form Θ of the linear fields. Out: V and
//! its derivatives by every frame. The coordinates are screws from a mean frame m, which a common motion leaves alone:
//!
//! ```text
//! Σ_e log(m⁻¹ g_e) = 0     ξ_e = log(m⁻¹ g_e) = (a_e + d_e, ω_e)     a_e = o_e - ō
//! c_e  = (d_e + ½ ω_e × a_e,  [ω_e] + U_e - I)                             the motion of element e to first order
//! c'_e = (½ ω_e × d_e + ω_e × (ω_e × a_e)/6,  ½ [ω_e]² + [ω_e] (U_e - I))    and its second-order part
//! V₂ = ½ cᵀ S c     V₃ = cᵀ S c' + Θ(c, c, c)     Θ = Σ ∫ (C:ε) : ½ HᵀH     V = V₂ φ(V₃/V₂)
//! ```
//!
//! A helix between two elements has no strain along its axis: the arc of a bent beam keeps its length, which its chord does
//! not (V. Sonneville, A. Cardona, O. Brüls, CMAME 268, 2014, 451-474, use the coordinates for beams). Linear fields give
//! the energy to third order (the 2n + 1 theorem; Hylleraas, 1930). φ(κ) = 1 + κ/√(1 + 4κ²) lies between ½ and 1½: a cubic has no
//! lower bound, and where it is not small it says nothing.

use crate::deform::pose::frame::{ControlFrame, FrameSlope, axial, flat};
use crate::deform::pose::se3::{MeanFrame, halves, inverse_left_jacobian, inverse_right_jacobian, joined};
use crate::green::FIELDS;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3, Vector6};

/// A body's energy in the coordinates of its control elements.
#[derive(Clone, Debug)]
pub struct Helicoidal {
    /// a_e, m.
    arms: Vec<Vector3<f64>>,
    stiffness: DMatrix<f64>,
    cubic: Option<CubicForm>,
    mean: MeanFrame,
    /// c, c', S c, S c', ∂Θ/∂c.
    first: DVector<f64>,
    second: DVector<f64>,
    force: DVector<f64>,
    second_force: DVector<f64>,
    cubic_force: DVector<f64>,
}

impl Helicoidal {
    /// `origins` are o_e; S has 12 rows for each. Without `cubic` the energy is V₂.
    pub fn new(
        origins: &[Vector3<f64>],
        stiffness: DMatrix<f64>,
        cubic: Option<CubicForm>,
    ) -> Result<Helicoidal, String> {
        let fields = FIELDS * origins.len();
        if fields == 0 || stiffness.shape() != (fields, fields) {
            let (rows, columns) = stiffness.shape();
            return Err(format!(
                "S has {rows} × {columns} numbers, {} control elements need 12 a side",
                origins.len()
            ));
        }
        if let Some(cubic) = cubic.as_ref().filter(|cubic| cubic.variables() != fields) {
            return Err(format!("the cubic form has {} variables instead of {fields}", cubic.variables()));
        }
        let mean = origins.iter().sum::<Vector3<f64>>() / origins.len() as f64;
        let arms: Vec<Vector3<f64>> = origins.iter().map(|origin| origin - mean).collect();
        let none = DVector::zeros(fields);
        Ok(Helicoidal {
            mean: MeanFrame::new(arms.len()),
            arms,
            stiffness,
            cubic,
            first: none.clone(),
            second: none.clone(),
            force: none.clone(),
            second_force: none.clone(),
            cubic_force: none,
        })
    }

    /// V, and its derivatives by the frames; `None` where the frames have no mean.
    pub fn respond(&mut self, frames: &[ControlFrame], slopes: &mut [FrameSlope]) -> Option<f64> {
        self.mean.find(frames)?;
        for (e, frame) in frames.iter().enumerate() {
            self.take_coefficients(e, &frame.stretch);
        }
        let (energy, [alpha, beta]) = self.energy();
        let mut common = Vector6::zeros();
        for (e, frame) in frames.iter().enumerate() {
            let (screw, stretch) = self.pull_back(e, &frame.stretch, alpha, beta);
            common += inverse_left_jacobian(&self.mean.screws[e]).transpose() * screw;
            // Kept here until the share of the mean frame is known.
            let (force, torque) = halves(&screw);
            slopes[e] = FrameSlope { force, torque, stretch };
        }
        let of_mean = self.mean.share(&common)?;
        for ((slope, frame), screw) in slopes.iter_mut().zip(frames).zip(&self.mean.screws) {
            let own = joined(&slope.force, &slope.torque) - of_mean;
            let (force, torque) = halves(&(inverse_right_jacobian(screw).transpose() * own));
            (slope.force, slope.torque) = (frame.turn * force, frame.turn * torque);
        }
        energy.is_finite().then_some(energy)
    }

    /// V₂ + V₃, without φ; `None` where the frames have no mean.
    pub fn third_order_energy(&mut self, frames: &[ControlFrame]) -> Option<f64> {
        self.mean.find(frames)?;
        for (e, frame) in frames.iter().enumerate() {
            self.take_coefficients(e, &frame.stretch);
        }
        let (quadratic, correction) = self.orders();
        Some(quadratic + correction.unwrap_or(0.0))
    }

    fn take_coefficients(&mut self, e: usize, stretch: &Matrix3<f64>) {
        let (slide, turn) = halves(&self.mean.screws[e]);
        let (a, strain) = (self.arms[e], stretch - Matrix3::identity());
        let (d, cross) = (slide - a, turn.cross_matrix());
        put(&mut self.first, e, &(d + turn.cross(&a) * 0.5), &(cross + strain));
        let place = turn.cross(&d) * 0.5 + turn.cross(&turn.cross(&a)) / 6.0;
        put(&mut self.second, e, &place, &(cross * cross * 0.5 + cross * strain));
    }

    /// V₂, and V₃ where there is a cubic form.
    fn orders(&mut self) -> (f64, Option<f64>) {
        self.force.gemv(1.0, &self.stiffness, &self.first, 0.0);
        let quadratic = 0.5 * self.first.dot(&self.force);
        let Some(cubic) = &self.cubic else { return (quadratic, None) };
        self.second_force.gemv(1.0, &self.stiffness, &self.second, 0.0);
        let form = cubic.evaluate(self.first.as_slice(), self.cubic_force.as_mut_slice());
        (quadratic, Some(self.first.dot(&self.second_force) + form))
    }

    /// V, and how much of ∂V₂ and ∂V₃ is in ∂V.
    fn energy(&mut self) -> (f64, [f64; 2]) {
        let (quadratic, correction) = self.orders();
        let Some(correction) = correction else { return (quadratic, [1.0, 0.0]) };
        let part = correction / quadratic;
        if !part.is_finite() {
            return (quadratic.max(0.0), [1.0, 0.0]);
        }
        let root = (1.0 + 4.0 * part * part).sqrt();
        let (value, slope) = (1.0 + part / root, root.powi(-3));
        (quadratic * value, [value - part * slope, slope])
    }

    /// ∂V/∂ξ_e and ∂V/∂U_e at a mean frame that stands still.
    fn pull_back(
        &self,
        e: usize,
        stretch: &Matrix3<f64>,
        alpha: f64,
        beta: f64,
    ) -> (Vector6<f64>, Matrix3<f64>) {
        let (slide, turn) = halves(&self.mean.screws[e]);
        let (a, strain) = (self.arms[e], stretch - Matrix3::identity());
        let (d, cross) = (slide - a, turn.cross_matrix());
        let rows = FIELDS * e..FIELDS * (e + 1);
        let (mut force, mut matrix) = parts(&self.force.as_slice()[rows.clone()]);
        let (second, second_matrix) = (force * beta, matrix * beta);
        (force, matrix) = (force * alpha, matrix * alpha);
        if beta != 0.0 {
            for of in [&self.second_force, &self.cubic_force] {
                let (more, more_matrix) = parts(&of.as_slice()[rows.clone()]);
                (force, matrix) = (force + more * beta, matrix + more_matrix * beta);
            }
        }
        let by_place = force + second.cross(&turn) * 0.5;
        let by_turn = a.cross(&force) * 0.5
            + axial(&matrix)
            + d.cross(&second) * 0.5
            + (a * turn.dot(&second) + second * turn.dot(&a) - turn * (2.0 * a.dot(&second))) / 6.0
            + (second_matrix + second_matrix.transpose()) * turn * 0.5
            - turn * second_matrix.trace()
            + axial(&(second_matrix * strain));
        let by_stretch = matrix - cross * second_matrix;
        (joined(&by_place, &by_turn), (by_stretch + by_stretch.transpose()) * 0.5)
    }
}

/// The twelve coefficients of element `e`: a translation, then a matrix row by row.
fn put(c: &mut DVector<f64>, e: usize, translation: &Vector3<f64>, matrix: &Matrix3<f64>) {
    c.rows_mut(FIELDS * e, FIELDS).copy_from_slice(&flat(translation, matrix));
}

/// Σ f_i and Σ f_i y_j of twelve generalised forces.
fn parts(g: &[f64]) -> (Vector3<f64>, Matrix3<f64>) {
    (Vector3::new(g[0], g[1], g[2]), Matrix3::from_row_slice(&g[3..FIELDS]))
}

/// A symmetric cubic form by its coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct CubicForm {
    variables: usize,
    /// θ_pqr, r running fastest, then q.
    coefficients: Vec<f64>,
}

impl CubicForm {
    /// Number of coefficients of a form in n variables: n (n + 1)(n + 2)/6.
    pub const fn coefficients_of(variables: usize) -> usize {
        variables * (variables + 1) * (variables + 2) / 6
    }

    /// `None` where there are not [`CubicForm::coefficients_of`] the variables.
    pub fn new(variables: usize, coefficients: Vec<f64>) -> Option<CubicForm> {
        (coefficients.len() == CubicForm::coefficients_of(variables))
            .then_some(CubicForm { variables, coefficients })
    }

    pub fn variables(&self) -> usize {
        self.variables
    }

    /// Θ(c) and ∂Θ/∂c.
    pub fn evaluate(&self, c: &[f64], gradient: &mut [f64]) -> f64 {
        gradient.fill(0.0);
        let (mut total, mut at) = (0.0, 0);
        for p in 0..self.variables {
            let mut of_p = 0.0;
            for q in p..self.variables {
                let row = &self.coefficients[at..at + self.variables - q];
                at += row.len();
                let pair = c[p] * c[q];
                let mut of_pair = 0.0;
                for ((theta, c), g) in row.iter().zip(&c[q..]).zip(&mut gradient[q..]) {
                    of_pair += theta * c;
                    *g += theta * pair;
                }
                of_p += of_pair * c[q];
                gradient[q] += of_pair * c[p];
            }
            gradient[p] += of_p;
            total += of_p * c[p];
        }
        total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gradient_is_that_of_the_form() {
        let n = 5;
        let coefficients = (0..CubicForm::coefficients_of(n)).map(|i| (1.3 * i as f64).sin()).collect();
        let form = CubicForm::new(n, coefficients).unwrap();
        let c: Vec<f64> = (0..n).map(|i| 0.4 + (2.1 * i as f64).cos()).collect();
        let (mut gradient, mut unused) = (vec![0.0; n], vec![0.0; n]);
        let value = form.evaluate(&c, &mut gradient);
        // Euler: c·∂Θ = 3 Θ.
        let euler: f64 = c.iter().zip(&gradient).map(|(c, g)| c * g).sum();
        assert!((euler - 3.0 * value).abs() < 1e-13);
        for k in 0..n {
            let mut at = |by: f64| {
                let mut c = c.clone();
                c[k] += by;
                form.evaluate(&c, &mut unused)
            };
            let expected = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((gradient[k] - expected).abs() < 1e-8, "{k}");
        }
        assert!(CubicForm::new(4, vec![0.0; 19]).is_none());
    }
}
