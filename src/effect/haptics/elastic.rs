//! The elastic body in the haptic loop: poses of its control elements in, strain energy and its exact gradient out.
//!
//! The energy is V = ½ cᵀ S c with the coefficients c that the body's model computes from the poses; the hand feels
//! -∂V/∂(its pose). For `linear` the contributions of the other elements are combined into a constant, and a tick is one
//! product of 12 × 12. For `rotation` c is relative to the mean rotation R̄, which moves with the hand in every tick. R̄ is
//! followed by Newton's iteration from its last value, and its part in the gradient is included; otherwise a hand could
//! gain energy on a closed path. f64; nothing is allocated after [`Elastic::new`].

use crate::deform::{ControlPose, ControlRest, Energy, MODELS, Wrench, find_model, is_mean_defined};
use crate::green::FIELDS;
use nalgebra::{DMatrix, Matrix3, Rotation3, Vector3};

/// Newton's iteration ends with a step smaller than this, rad; it converges quadratically.
const STEP: f64 = 1e-9;

/// A body with its handle stiffness S, and the model's constants of the elements.
#[derive(Clone, Debug)]
pub struct Elastic {
    /// S by columns.
    stiffness: Vec<f64>,
    origins: Vec<Vector3<f64>>,
    /// The elements' weights in the mean rotation, by their nodes; empty for the model `linear`.
    weights: Vec<f64>,
    /// C_e - C̄ of `rotation`, over ℓ².
    arms: Vec<Vector3<f64>>,
    poses: Vec<ControlPose>,
    held: usize,
    mean: Rotation3<f64>,
    /// Coefficients of all elements, and S c.
    c: Vec<f64>,
    g: Vec<f64>,
    /// For `linear`: the held element's rows of S c without its own contribution, and ½ cᵀ S c of the others.
    folded: [f64; FIELDS],
    others_energy: f64,
}

/// The result of one evaluation, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// V, J.
    pub energy: f64,
    /// ∂V/∂T of the held element, N: the force that a hand must apply.
    pub slope: Vector3<f64>,
    /// ∂V/∂M of the held element, N·m.
    pub slope_matrix: Matrix3<f64>,
    /// The torque as `greenstage deform` reports it: with lever arms at rest and R̄ held fixed.
    pub wrench: Wrench,
    /// R̄ could not be followed, and the last one was kept.
    pub rotation_undefined: bool,
}

impl Elastic {
    /// `stiffness` is S, 12E × 12E; `model` has an [`Energy`].
    pub fn new(model: &str, stiffness: &DMatrix<f64>, controls: &[ControlRest]) -> Result<Elastic, String> {
        let count = controls.len();
        if stiffness.shape() != (FIELDS * count, FIELDS * count) || count == 0 {
            let (rows, columns) = stiffness.shape();
            return Err(format!("S has {rows} × {columns} numbers, {count} control elements need 12 a side"));
        }
        let origins: Vec<Vector3<f64>> = controls.iter().map(|control| control.origin).collect();
        let (weights, arms) = match find_model(model)?.energy {
            Some(Energy::OfPoses) => (Vec::new(), Vec::new()),
            Some(Energy::OfMeanFrame) => shares(controls),
            None => {
                let known = MODELS.iter().filter(|entry| entry.energy.is_some()).map(|entry| entry.name);
                let known = known.collect::<Vec<_>>().join(" and ");
                return Err(format!("no force is known of the model \"{model}\", but of {known}"));
            }
        };
        Ok(Elastic {
            stiffness: stiffness.as_slice().to_vec(),
            origins,
            weights,
            arms,
            poses: vec![ControlPose::REST; count],
            held: 0,
            mean: Rotation3::identity(),
            c: vec![0.0; FIELDS * count],
            g: vec![0.0; FIELDS * count],
            folded: [0.0; FIELDS],
            others_energy: 0.0,
        })
    }

    pub fn elements(&self) -> usize {
        self.origins.len()
    }

    /// The held element's origin at rest, about the body's centre.
    pub fn origin(&self) -> Vector3<f64> {
        self.origins[self.held]
    }

    /// The held element's pose in the last evaluation.
    pub fn held_pose(&self) -> ControlPose {
        self.poses[self.held]
    }

    /// R̄ of the last evaluation.
    pub fn mean(&self) -> Rotation3<f64> {
        self.mean
    }

    /// Takes the poses of all elements in a frame, of which `held` will be given to [`Elastic::respond`]. Poses that are not
    /// finite and elements that the body does not have are ignored.
    pub fn set(&mut self, held: usize, poses: &[ControlPose]) {
        self.held = held.min(self.elements() - 1);
        for (own, new) in self.poses.iter_mut().zip(poses).filter(|(_, new)| new.is_finite()) {
            *own = *new;
        }
        if self.weights.is_empty() {
            self.fold();
        }
    }

    /// Sets the mean rotation to that of the frame, from where it is followed.
    pub fn set_mean(&mut self, mean: Rotation3<f64>) {
        if mean.matrix().iter().all(|x| x.is_finite()) {
            self.mean = mean;
        }
    }

    /// Energy and slope with the held element at `pose`.
    pub fn respond(&mut self, pose: &ControlPose) -> Response {
        self.poses[self.held] = *pose;
        if self.weights.is_empty() { self.respond_linear(pose) } else { self.respond_rotated() }
    }

    /// The block of S that couples the held element with itself.
    pub fn held_block(&self) -> nalgebra::SMatrix<f64, FIELDS, FIELDS> {
        let (n, first) = (self.c.len(), FIELDS * self.held);
        nalgebra::SMatrix::from_fn(|i, j| self.stiffness[(first + j) * n + first + i])
    }

    fn fold(&mut self) {
        let first = FIELDS * self.held;
        for (c, pose) in self.c.chunks_exact_mut(FIELDS).zip(&self.poses) {
            c.copy_from_slice(&pose.coefficients());
        }
        self.c[first..first + FIELDS].fill(0.0);
        self.multiply();
        self.folded.copy_from_slice(&self.g[first..first + FIELDS]);
        self.others_energy = 0.5 * dot(&self.c, &self.g);
    }

    fn multiply(&mut self) {
        self.g.fill(0.0);
        let n = self.g.len();
        for (column, c) in self.stiffness.chunks_exact(n).zip(&self.c) {
            for (g, s) in self.g.iter_mut().zip(column) {
                *g += s * c;
            }
        }
    }

    fn respond_linear(&mut self, pose: &ControlPose) -> Response {
        let (n, first) = (self.c.len(), FIELDS * self.held);
        let c = pose.coefficients();
        let mut own = [0.0; FIELDS];
        let columns = self.stiffness[first * n..(first + FIELDS) * n].chunks_exact(n);
        for (column, c) in columns.zip(&c) {
            for (g, s) in own.iter_mut().zip(&column[first..first + FIELDS]) {
                *g += s * c;
            }
        }
        let energy = 0.5 * dot(&c, &own) + dot(&c, &self.folded) + self.others_energy;
        let g: [f64; FIELDS] = std::array::from_fn(|k| own[k] + self.folded[k]);
        let (slope, slope_matrix) = parts(&g);
        let wrench = Wrench { force: slope, moment: axial(&slope_matrix) };
        Response { energy, slope, slope_matrix, wrench, rotation_undefined: false }
    }

    /// c_e = (R̄ᵀ(o_e + T_e - t̄) - o_e, R̄ᵀ M_e - 1). With the net torque τ of S c about the deformed places, which turns
    /// to nothing as c does, and y = H⁻¹ τ, the motion of R̄ adds -w R̄\[y\]× to ∂V/∂M and -w R̄\[y\]× (C - C̄)/ℓ² to ∂V/∂T.
    fn respond_rotated(&mut self) -> Response {
        let h_inverse = self.follow_mean();
        let (rotation, inverse) = (*self.mean.matrix(), self.mean.matrix().transpose());
        let shift: Vector3<f64> = (0..self.elements())
            .map(|e| {
                (self.origins[e] + self.poses[e].translation - rotation * self.origins[e]) * self.weights[e]
            })
            .sum();
        for (e, c) in self.c.chunks_exact_mut(FIELDS).enumerate() {
            let place = inverse * (self.origins[e] + self.poses[e].translation - shift);
            let seen =
                ControlPose { translation: place - self.origins[e], matrix: inverse * self.poses[e].matrix };
            c.copy_from_slice(&seen.coefficients());
        }
        self.multiply();
        let energy = 0.5 * dot(&self.c, &self.g);
        let (force, matrix) = parts(&self.g[FIELDS * self.held..][..FIELDS]);
        let wrench = Wrench { force: rotation * force, moment: rotation * axial(&matrix) };
        let (mut slope, mut slope_matrix) = (rotation * force, rotation * matrix);
        if let Some(h_inverse) = h_inverse {
            let turn = rotation * (h_inverse * self.net_torque()).cross_matrix() * self.weights[self.held];
            slope -= turn * self.arms[self.held];
            slope_matrix -= turn;
        }
        Response { energy, slope, slope_matrix, wrench, rotation_undefined: h_inverse.is_none() }
    }

    /// Σ p̄_e × f_e + axial(g_M M̄ᵀ) in the surface's frame.
    fn net_torque(&self) -> Vector3<f64> {
        let of = |e: usize| {
            let (translation, displacement) = parts(&self.c[FIELDS * e..][..FIELDS]);
            let (force, matrix) = parts(&self.g[FIELDS * e..][..FIELDS]);
            let seen = displacement + Matrix3::identity();
            (self.origins[e] + translation).cross(&force) + axial(&(matrix * seen.transpose()))
        };
        (0..self.elements()).map(of).sum()
    }

    /// A = Σ w_e (M_e + (c_e - c̄)(C_e - C̄)ᵀ/ℓ²); at the stationary R̄ of tr(AᵀR), B = R̄ᵀA is symmetric. Newton's step
    /// from R is exp of H⁻¹ axial(B) with H = tr(B) - sym(B). Gives H⁻¹, or `None` where R̄ is not defined.
    fn follow_mean(&mut self) -> Option<Matrix3<f64>> {
        let mut a = Matrix3::zeros();
        for e in 0..self.elements() {
            let moved = self.origins[e] + self.poses[e].translation;
            // Σ w (C - C̄) = 0: the mean of the moved places falls out.
            a += (self.poses[e].matrix + moved * self.arms[e].transpose()) * self.weights[e];
        }
        let mut rotation = self.mean;
        for _ in 0..12 {
            let b = rotation.matrix().transpose() * a;
            let symmetric = (b + b.transpose()) * 0.5;
            let h_inverse = (Matrix3::identity() * b.trace() - symmetric).try_inverse()?;
            let step = h_inverse * axial(&b);
            if step.norm() < STEP {
                if !is_mean_defined(&symmetric.symmetric_eigenvalues()) {
                    return None;
                }
                self.mean = rotation;
                return Some(h_inverse);
            }
            rotation = reorthogonal(rotation * Rotation3::new(step.cap_magnitude(0.5)));
        }
        None
    }
}

/// Weights w_e of the elements by their nodes, and (C_e - C̄)/ℓ² with ℓ² = Σ w_e |C_e - C̄|².
fn shares(controls: &[ControlRest]) -> (Vec<f64>, Vec<Vector3<f64>>) {
    let total = controls.iter().map(|control| control.nodes as f64).sum::<f64>().max(1.0);
    let weights: Vec<f64> = controls.iter().map(|control| control.nodes as f64 / total).collect();
    let mean: Vector3<f64> = controls.iter().zip(&weights).map(|(control, w)| control.origin * *w).sum();
    let square: f64 =
        controls.iter().zip(&weights).map(|(control, w)| w * (control.origin - mean).norm_squared()).sum();
    let arm = |control: &ControlRest| {
        if square > 0.0 { (control.origin - mean) / square } else { Vector3::zeros() }
    };
    let arms = controls.iter().map(arm).collect();
    (weights, arms)
}

/// One step towards the nearest rotation, for a matrix that is a rotation except for rounding.
fn reorthogonal(rotation: Rotation3<f64>) -> Rotation3<f64> {
    let r = rotation.matrix();
    Rotation3::from_matrix_unchecked(r * (Matrix3::identity() * 3.0 - r.transpose() * r) * 0.5)
}

/// Σ f_i and Σ f_i (X - o)_j of twelve generalised forces.
fn parts(g: &[f64]) -> (Vector3<f64>, Matrix3<f64>) {
    (Vector3::new(g[0], g[1], g[2]), Matrix3::from_row_slice(&g[3..FIELDS]))
}

/// Of X the vector a with a · ω = X : \[ω\]×; the moment of Σ f_i r_j.
pub fn axial(x: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(x[(2, 1)] - x[(1, 2)], x[(0, 2)] - x[(2, 0)], x[(1, 0)] - x[(0, 1)])
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
