//! A few points of a body, with weights, at which the neo-Hookean law's energy beyond a quartic is summed.
//!
//! In: all points of integration, fields h_k over all nodes, and states z of u = Σ z_k h_k. Out: the table that the model reads, a
//! column for each chosen point: w, λ, μ, D, and the entries of all H_k, entry by entry. The weights w ≥ 0 are those for which
//!
//! ```text
//! g_k(z) = Σ_points vol ∂d/∂F : H_k ≈ Σ_chosen w ∂d/∂F : H_k      d = ψ_NH - ψ_SVK
//! ```
//!
//! The sums of both sides differ least over all states and k, each state in parts of its energy and each k in parts of its stiffness. D
//! is how far below 0 the energy d is at the point in any of the states, and a little more ([`DEEPER`]). Points are taken one after the
//! other, as the non-negative least squares of C. Lawson and R. Hanson (Solving Least Squares Problems, 1974, chapter 23) take columns,
//! until the rest is below [`MISSED`] or there are [`MOST_POINTS`] (S. An, T. Kim, D. James, ACM Transactions on Graphics 27(5), 2008,
//! 165; C. Farhat et al., International Journal for Numerical Methods in Engineering 98, 2014, 625-662).

use crate::base::random::Random;
use crate::fem::{NodeFields, RestPoint, RestPoints, energy_beyond_stvk, stress_beyond_stvk};
use crate::solve::Progress;
use nalgebra::{DMatrix, DMatrixView, DVector, DVectorView, Matrix3};
use rayon::prelude::*;

/// Points that are chosen at most: what the time of a force tick allows.
pub const MOST_POINTS: usize = 320;
/// Part of g that the chosen points may miss, as a root of squares.
const MISSED: f64 = 5e-4;
/// Points from which these are chosen: half of them strain most, the others stand anywhere.
const CANDIDATES: usize = 1600;
/// Points whose g are computed between two sums.
const BLOCK: usize = 64;
/// Numbers of a point before those of its gradients: w, λ, μ, D.
pub const HEAD: usize = 4;
/// D in parts of the depth that was met, and in parts of μ at least.
const DEEPER: f64 = 1.25;
const LEAST_DEPTH: f64 = 1e-3;

/// States that the chosen points must serve.
pub struct States {
    /// z without z_0 = 1, column by column.
    pub z: DMatrix<f64>,
    /// V of each, J.
    pub energies: Vec<f64>,
    /// 1/√(h_kᵀ K h_k) of each k; 0 of a field that strains nothing.
    pub scales: Vec<f64>,
}

/// The chosen points.
pub struct Cubature {
    pub table: DMatrix<f64>,
    /// Part of g that they miss.
    pub missed: f64,
}

/// Rows of a table for `variables` z.
pub fn rows(variables: usize) -> usize {
    HEAD + 9 * (variables - 1)
}

/// Bytes beside the fields while the points are chosen.
pub fn memory(points: usize, variables: usize, states: usize) -> f64 {
    let candidates = CANDIDATES.min(points) as f64;
    8.0 * (candidates * (variables * states) as f64 + 2.0 * candidates * candidates + points as f64)
}

/// Chooses the points.
pub fn cubature(
    points: &RestPoints,
    fields: &NodeFields,
    states: &States,
    progress: &dyn Progress,
) -> Cubature {
    progress.begin("points of the neo-Hookean law", points.count() as u64);
    let (wanted, sizes) = whole(points, fields, states, progress);
    let candidates = candidates(&sizes);
    let mut columns = DMatrix::zeros(wanted.len(), candidates.len());
    let count = wanted.len().max(1);
    columns.as_mut_slice().par_chunks_mut(count).zip(&candidates).for_each(|(column, point)| {
        column.copy_from_slice(share(&points.at(*point), fields, states).as_slice());
    });
    let (chosen, missed) = least_squares(&columns, &wanted);
    progress.end();
    let mut table = DMatrix::zeros(rows(fields.columns + 1), chosen.len());
    let mut h = Vec::new();
    for (mut column, (candidate, weight)) in table.column_iter_mut().zip(chosen) {
        let point = points.at(candidates[candidate]);
        point.gradients_of(fields, &mut h);
        let depth = (DEEPER * depth(&point, &h, states)).max(LEAST_DEPTH * point.lame.mu);
        let head = [weight * point.volume, point.lame.lambda, point.lame.mu, depth];
        let entries = (0..9).flat_map(|entry| h.iter().map(move |h| h[entry]));
        column.iter_mut().zip(head.into_iter().chain(entries)).for_each(|(to, value)| *to = value);
    }
    Cubature { table, missed }
}

/// g of all states, one after the other, and how much each point has in it.
fn whole(
    points: &RestPoints,
    fields: &NodeFields,
    states: &States,
    progress: &dyn Progress,
) -> (DVector<f64>, Vec<f64>) {
    let mut sum = DVector::zeros(states.z.len());
    let mut sizes = Vec::with_capacity(points.count());
    for first in (0..points.count()).step_by(BLOCK) {
        let block = first..points.count().min(first + BLOCK);
        let count = block.len();
        let shares: Vec<_> =
            block.into_par_iter().map(|point| share(&points.at(point), fields, states)).collect();
        for share in shares {
            sizes.push(share.norm());
            sum += DVector::from_vec(share.data.into());
        }
        progress.advance(count as u64);
    }
    (sum, sizes)
}

/// The share of a point in g: a column for each state.
fn share(point: &RestPoint<'_>, fields: &NodeFields, states: &States) -> DMatrix<f64> {
    let mut h = Vec::new();
    point.gradients_of(fields, &mut h);
    let entries: Vec<f64> = h.iter().flat_map(|h| h.iter().copied()).collect();
    let gradients = DMatrixView::from_slice(&entries, 9, h.len());
    let strained = gradients * &states.z;
    let mut stresses = DMatrix::zeros(9, states.z.ncols());
    let all = stresses.column_iter_mut().zip(strained.column_iter()).zip(&states.energies);
    for ((mut stress, h), energy) in all {
        let h = Matrix3::from_iterator(h.iter().copied());
        let scale = point.volume / (2.0 * energy).max(f64::MIN_POSITIVE).sqrt();
        stress.copy_from_slice((stress_beyond_stvk(&h, point.lame) * scale).as_slice());
    }
    let mut share = gradients.tr_mul(&stresses);
    for (mut row, scale) in share.row_iter_mut().zip(&states.scales) {
        row *= *scale;
    }
    share
}

/// Depth below 0 of the energy at a point in any state, J/m³.
fn depth(point: &RestPoint<'_>, h: &[Matrix3<f64>], states: &States) -> f64 {
    let strained =
        |z: DVectorView<'_, f64>| h.iter().zip(z.iter()).map(|(h, z)| h * *z).sum::<Matrix3<f64>>();
    let energies = states.z.column_iter().map(|z| energy_beyond_stvk(&strained(z), point.lame));
    -energies.fold(0.0, f64::min)
}

/// The points from which those of the table are chosen, in their order.
fn candidates(sizes: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    if order.len() > CANDIDATES {
        order.sort_by(|a, b| sizes[*b].total_cmp(&sizes[*a]));
        let mut random = Random::default();
        for at in CANDIDATES / 2..CANDIDATES {
            let other = at + ((random.draw() + 0.5) * (order.len() - at) as f64) as usize;
            order.swap(at, other.min(sizes.len() - 1));
        }
        order.truncate(CANDIDATES);
        order.sort_unstable();
    }
    order
}

/// The columns with their weights x ≥ 0 for which the columns' sum comes nearest to `wanted`, and the part of it that they miss.
fn least_squares(columns: &DMatrix<f64>, wanted: &DVector<f64>) -> (Vec<(usize, f64)>, f64) {
    let (gram, right) = (gram(columns), columns.tr_mul(wanted));
    let whole = wanted.norm_squared();
    let mut chosen: Vec<usize> = Vec::new();
    let mut x: Vec<f64> = Vec::new();
    let mut missed = 1.0;
    while whole > 0.0 && missed > MISSED && chosen.len() < MOST_POINTS {
        let mut slopes = right.clone();
        for (i, x) in chosen.iter().zip(&x) {
            slopes.axpy(-x, &gram.column(*i), 1.0);
        }
        // By how much each would lower the square that is missed.
        let gain = |i: &usize| if slopes[*i] > 0.0 { slopes[*i].powi(2) / gram[(*i, *i)] } else { 0.0 };
        let free = (0..right.len()).filter(|i| !chosen.contains(i));
        let Some(best) = free.max_by(|a, b| gain(a).total_cmp(&gain(b))).filter(|i| gain(i) > 0.0) else {
            break;
        };
        let before = missed;
        chosen.push(best);
        x.push(0.0);
        fit(&gram, &right, &mut chosen, &mut x);
        let square: f64 = chosen.iter().zip(&x).map(|(i, x)| x * right[*i]).sum();
        missed = ((whole - square) / whole).max(0.0).sqrt();
        if missed >= before {
            break;
        }
    }
    (chosen.into_iter().zip(x).collect(), missed)
}

/// The products of all columns, panel by panel.
fn gram(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let count = columns.ncols();
    let mut gram = DMatrix::zeros(count, count);
    gram.as_mut_slice().par_chunks_mut((BLOCK * count).max(1)).enumerate().for_each(|(panel, products)| {
        let width = products.len() / count;
        let own = columns.tr_mul(&columns.columns(panel * BLOCK, width));
        products.copy_from_slice(own.as_slice());
    });
    gram
}

/// The weights of the chosen columns; those that come out negative are given up.
fn fit(gram: &DMatrix<f64>, right: &DVector<f64>, chosen: &mut Vec<usize>, x: &mut Vec<f64>) {
    loop {
        let own = DMatrix::from_fn(chosen.len(), chosen.len(), |i, j| gram[(chosen[i], chosen[j])]);
        let Some(factor) = own.cholesky() else {
            chosen.pop();
            x.pop();
            return;
        };
        let best = factor.solve(&DVector::from_iterator(chosen.len(), chosen.iter().map(|i| right[*i])));
        // As far towards them as all stay positive.
        let ways = x.iter().zip(best.iter()).map(|(x, best)| if *best > 0.0 { 1.0 } else { x / (x - best) });
        let (first, way) =
            ways.enumerate().fold((0, 1.0), |least, next| if next.1 < least.1 { next } else { least });
        x.iter_mut().zip(best.iter()).for_each(|(x, best)| *x += way * (best - *x));
        if way >= 1.0 {
            return;
        }
        chosen.swap_remove(first);
        x.swap_remove(first);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns that make a sum exactly are found, with weights that are not negative.
    #[test]
    fn least_squares_find_the_columns_that_a_sum_is_made_of() {
        let columns =
            DMatrix::from_fn(30, 12, |i, j| (1.3 * i as f64 + 0.7 * (j * j) as f64).sin() + 0.2 * (j as f64));
        let wanted = columns.column(3) * 2.0 + columns.column(7) * 0.5 + columns.column(11) * 1.25;
        let (chosen, missed) = least_squares(&columns, &wanted);
        assert!(missed <= MISSED && chosen.iter().all(|(_, x)| *x >= 0.0), "{chosen:?} {missed:e}");
        let sum: DVector<f64> = chosen.iter().map(|(i, x)| columns.column(*i) * *x).sum();
        assert!((sum - &wanted).norm() <= 1.1 * MISSED * wanted.norm());
    }
}
