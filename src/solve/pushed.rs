//! Rigid pieces of a body that are pushed, not held: their few motions q are unknowns beside the displacements of the free nodes.
//!
//! In: where the pieces' nodes stand after q, J = ∂u/∂q there, and the forces Q along q. Out: Newton's steps of both together. With
//! K = (A B; Bᵀ C) over free and controlled nodes, net forces f and G = Σ f·∂²u/∂q²,
//!
//! ```text
//! | A       B J         | | d  |   | -f_free          |     S = G + Jᵀ K X,  X = J - A⁻¹ B J
//! | JᵀBᵀ    JᵀC J + G   | | dq | = | Q - Jᵀ f_control  |     d = -A⁻¹ f_free + X dq
//! ```
//!
//! The whole has as many negative eigenvalues as A and S together (Haynsworth, Linear Algebra Appl. 1, 1968).

use super::error::SolveError;
use super::solver::Factor;
use crate::base::progress::Silent;
use crate::fem::{NodeFields, Partition, StiffnessMatrix};
use nalgebra::{DMatrix, SymmetricEigen};

/// Pieces of a body that are pushed.
pub trait Pushed {
    /// Number of the motions q.
    fn count(&self) -> usize;

    /// Writes the displacements of the pieces' nodes at a share of the way and after the motions `q`, in m and rad.
    fn place(&self, share: f64, q: &[f64], u: &mut NodeFields);

    /// J over all nodes, a column for each motion.
    fn motions(&self, share: f64, q: &[f64]) -> NodeFields;

    /// Q, in N and N·m.
    fn forces(&self, share: f64, q: &[f64]) -> Vec<f64>;
}

/// The border of a tangent stiffness.
pub(super) struct Border {
    /// J over all nodes: 3·nodes rows.
    pub motions: DMatrix<f64>,
    /// G less ∂Q/∂q, symmetric.
    pub curvature: DMatrix<f64>,
}

/// Step of a difference along a motion, rad or m.
const STEP: f64 = 1e-6;

impl Border {
    pub fn none(nodes: usize) -> Border {
        Border { motions: DMatrix::zeros(3 * nodes, 0), curvature: DMatrix::zeros(0, 0) }
    }

    /// The border at the motions `q`, with these net forces over all nodes.
    pub fn new(pushed: &dyn Pushed, share: f64, q: &[f64], net: &NodeFields) -> Border {
        let motions = |q: &[f64]| matrix(&pushed.motions(share, q));
        let net = DMatrix::from_column_slice(net.data.len(), 1, &net.data);
        let slope = |q: &[f64]| {
            motions(q).tr_mul(&net) - DMatrix::from_column_slice(q.len(), 1, &pushed.forces(share, q))
        };
        let mut curvature = DMatrix::zeros(q.len(), q.len());
        for k in 0..q.len() {
            let [low, high] = [-STEP, STEP].map(|by| {
                let mut moved = q.to_vec();
                moved[k] += by;
                slope(&moved)
            });
            curvature.set_column(k, &((high - low) / (2.0 * STEP)).column(0));
        }
        Border { motions: motions(q), curvature: (&curvature + curvature.transpose()) * 0.5 }
    }

    pub fn count(&self) -> usize {
        self.motions.ncols()
    }
}

/// Fields as a matrix: 3·nodes rows.
pub(super) fn matrix(fields: &NodeFields) -> DMatrix<f64> {
    DMatrix::from_row_slice(3 * fields.nodes, fields.columns, &fields.data)
}

/// A matrix of 3·nodes rows as fields.
pub(super) fn fields(matrix: &DMatrix<f64>) -> NodeFields {
    let data = matrix.transpose().as_slice().to_vec();
    NodeFields { nodes: matrix.nrows() / 3, columns: matrix.ncols(), data }
}

/// A tangent stiffness with its border, ready to be solved with.
pub(super) struct Tangent<'t> {
    partition: &'t Partition,
    k: &'t StiffnessMatrix,
    factor: &'t dyn Factor,
    border: &'t Border,
    /// X over all nodes.
    follow: DMatrix<f64>,
    schur: DMatrix<f64>,
    /// Number of negative eigenvalues of S.
    pub negative: usize,
}

impl<'t> Tangent<'t> {
    pub fn new(
        partition: &'t Partition,
        k: &'t StiffnessMatrix,
        factor: &'t dyn Factor,
        border: &'t Border,
    ) -> Result<Tangent<'t>, SolveError> {
        let mut follow = DMatrix::zeros(3 * k.nodes(), 0);
        let mut schur = border.curvature.clone();
        let mut negative = 0;
        if border.count() > 0 {
            let mut all = fields(&border.motions);
            let (free, _) = factor.solve(&partition.minus_b_times(k, &all), &Silent)?;
            partition.insert_free(&free, &mut all);
            follow = matrix(&all);
            schur += border.motions.tr_mul(&product(k, &follow));
            schur = (&schur + schur.transpose()) * 0.5;
            negative = SymmetricEigen::new(schur.clone()).eigenvalues.iter().filter(|l| **l <= 0.0).count();
        }
        Ok(Tangent { partition, k, factor, border, follow, schur, negative })
    }

    /// Displacements of all nodes, and motions, under forces at the free nodes and along the motions: of each as many columns.
    pub fn solve(
        &self,
        free: &NodeFields,
        pushes: &DMatrix<f64>,
    ) -> Result<(NodeFields, DMatrix<f64>), SolveError> {
        let (x, _) = self.factor.solve(free, &Silent)?;
        let mut d = NodeFields::zeros(self.k.nodes(), free.columns);
        self.partition.insert_free(&x, &mut d);
        if self.border.count() == 0 {
            return Ok((d, DMatrix::zeros(0, free.columns)));
        }
        let d = matrix(&d);
        let rest = pushes - self.border.motions.tr_mul(&product(self.k, &d));
        let dq = self.schur.clone().lu().solve(&rest).ok_or(SolveError::Loose)?;
        Ok((fields(&(d + &self.follow * &dq)), dq))
    }

    /// The motion with the least stiffness S of its nodes, and that in parts of the largest; `None` without motions.
    pub fn loosest(&self) -> Option<(usize, f64)> {
        let lengths: Vec<f64> = self.border.motions.column_iter().map(|own| own.norm()).collect();
        let count = self.border.count();
        let scaled = DMatrix::from_fn(count, count, |i, j| self.schur[(i, j)] / (lengths[i] * lengths[j]));
        let eigen = SymmetricEigen::new(scaled);
        let order =
            |i: &usize, j: &usize| eigen.eigenvalues[*i].abs().total_cmp(&eigen.eigenvalues[*j].abs());
        let (least, most) = ((0..count).min_by(order)?, (0..count).max_by(order)?);
        let ratio = eigen.eigenvalues[least].abs() / eigen.eigenvalues[most].abs();
        Some((eigen.eigenvectors.column(least).iamax(), ratio))
    }

    /// The least eigenvalues, N/m, ascending, and the mode of the first over all nodes, of length 1: those of displacements, the
    /// motions of the pieces taken as what their nodes move by.
    pub fn least_modes(&self, tolerance: f64) -> Result<(Vec<f64>, NodeFields), SolveError> {
        let (rows, count) = (3 * self.partition.free.len(), self.border.count());
        let metric = self.border.motions.tr_mul(&self.border.motions);
        // q = L⁻ᵀ q̂ with Jᵀ J = L Lᵀ has the length of the nodes' displacements.
        let lower = metric.cholesky().map_or_else(|| DMatrix::identity(count, count), |made| made.l());
        let inverse = lower.clone().try_inverse().unwrap_or_else(|| DMatrix::identity(count, count));
        let at_free = |all: &NodeFields| matrix(&all.at(&self.partition.free));
        let joined = |free: DMatrix<f64>, q: DMatrix<f64>| {
            let columns = free.ncols();
            let mut all = free.resize_vertically(rows + count, 0.0);
            all.view_mut((rows, 0), (count, columns)).copy_from(&q);
            all
        };
        let whole = |x: &DMatrix<f64>| {
            let q = inverse.tr_mul(&x.rows(rows, count));
            let mut all = fields(&(&self.border.motions * &q));
            self.partition.insert_free(&fields(&x.rows(0, rows).into_owned()), &mut all);
            (all, q)
        };
        let solve = |x: &DMatrix<f64>| {
            let free = fields(&x.rows(0, rows).into_owned());
            let (d, dq) = self.solve(&free, &(&lower * x.rows(rows, count)))?;
            Ok(joined(at_free(&d), lower.tr_mul(&dq)))
        };
        let multiply = |x: &DMatrix<f64>| {
            let (all, q) = whole(x);
            let forces = product(self.k, &matrix(&all));
            let pushes = self.border.motions.tr_mul(&forces) + &self.border.curvature * q;
            joined(at_free(&fields(&forces)), &inverse * pushes)
        };
        let (values, mode) = super::stability::least_modes(rows + count, tolerance, &solve, &multiply)?;
        Ok((values, whole(&mode).0))
    }
}

fn product(k: &StiffnessMatrix, x: &DMatrix<f64>) -> DMatrix<f64> {
    let mut product = NodeFields::zeros(k.nodes(), x.ncols());
    k.multiply(&fields(x), &mut product);
    matrix(&product)
}
