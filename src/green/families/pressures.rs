//! Pressures of a body of the neo-Hookean law: the few fields ψ_m in which its energy of volume is summed.
//!
//! In: the integration points, and displacements over all nodes of states that the body takes. Out: ψ at every point, orthonormal in the
//! energy of volume,
//!
//! ```text
//! Σ vol ψ_m ψ_n/κ = δ_mn     V_J = ½ Σ vol κ (J - 1)² ≈ ½ Σ_m (Σ vol ψ_m (J - 1))²     κ = λ + μ
//! ```
//!
//! ψ_1 is μ up to a factor, so that the whole energy cannot fall below that of [`volume_forms`](crate::fem::RestPoints::volume_forms)
//! without bound; the others are a proper orthogonal decomposition of the pressures κ (J - 1) that the states have beside it. A sum of fields
//! in which a body of ν near ½ bends keeps the volume only in the mean. With a pressure of its own at every point it would resist
//! that, and be too stiff (locking); with as few as its equilibria have it does not (F. Brezzi, M. Fortin, Mixed and Hybrid Finite Element
//! Methods, Springer 1991, section VI.3; for reduced bases G. Rozza, K. Veroy, Comput. Methods Appl. Mech. Engng. 196, 2007, 1244-1260).

use crate::fem::{NEO_HOOKEAN, NodeFields, RestPoints};
use nalgebra::{DMatrix, DVector, Matrix3};
use rayon::prelude::*;

/// Pressures that are chosen at most: what the time of a force tick allows.
pub const MOST_PRESSURES: usize = 39;
/// Part of the energy of a state that may be missed.
const MISSED: f64 = 1e-5;

/// States that the pressures must serve.
pub struct States {
    /// A column for each.
    pub u: NodeFields,
    /// How much each counts.
    pub weights: Vec<f64>,
}

/// The chosen pressures.
pub struct Pressures {
    /// ψ, a row for each point.
    pub weights: DMatrix<f64>,
    /// The largest part of a state's energy that they miss.
    pub missed: f64,
    /// For some of the states the point that is pressed most.
    pub pressed: Vec<usize>,
}

/// Bytes while the pressures are chosen.
pub fn memory(points: usize, states: usize) -> f64 {
    8.0 * (points * (states + MOST_PRESSURES)) as f64
}

/// Chooses the pressures.
pub fn pressures(points: &RestPoints, states: &States) -> Pressures {
    let (roots, strains, energies, pressed) = strains(points, states);
    let first = DVector::from_iterator(
        points.count(),
        roots.iter().enumerate().map(|(point, root)| {
            let own = points.at(point);
            // √(vol/κ) μ.
            own.lame.mu * own.volume / root
        }),
    )
    .normalize();
    let mut strains = strains;
    let own = strains.tr_mul(&first);
    strains.ger(-1.0, &first, &own, 1.0);
    let weights = states.weights.iter().zip(energies.iter());
    let scales = DMatrix::from_diagonal(&DVector::from_iterator(
        energies.len(),
        weights.map(|(weight, energy)| weight / (2.0 * energy).max(f64::MIN_POSITIVE).sqrt()),
    ));
    let seen = &strains * &scales;
    let eigen = seen.tr_mul(&seen).symmetric_eigen();
    let mut order: Vec<usize> = (0..energies.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |k| eigen.eigenvalues[*k]);
    let mut left: Vec<f64> = strains.column_iter().map(|strain| strain.norm_squared()).collect();
    let missed = |left: &[f64]| {
        let parts = left
            .iter()
            .zip(energies.iter())
            .map(|(left, energy)| left / (2.0 * energy).max(f64::MIN_POSITIVE));
        parts.fold(0.0, f64::max)
    };
    let mut modes = vec![first];
    for k in order {
        let value = eigen.eigenvalues[k];
        if modes.len() == MOST_PRESSURES || missed(&left) <= MISSED || value <= f64::EPSILON * largest {
            break;
        }
        let mode = &seen * eigen.eigenvectors.column(k) / value.sqrt();
        for (left, strain) in left.iter_mut().zip(strains.column_iter()) {
            *left -= mode.dot(&strain).powi(2);
        }
        modes.push(mode);
    }
    let weights = DMatrix::from_fn(points.count(), modes.len(), |point, mode| {
        // ψ = √(κ/vol) of what is orthonormal.
        modes[mode][point] * roots[point] / points.at(point).volume
    });
    Pressures { weights, missed: missed(&left).max(0.0), pressed }
}

/// √(vol κ) of each point; times J - 1 of every state; energies of the states; the points pressed most.
fn strains(points: &RestPoints, states: &States) -> (Vec<f64>, DMatrix<f64>, DVector<f64>, Vec<usize>) {
    let count = states.u.columns;
    let mut strains = DMatrix::zeros(count, points.count());
    let mut energies = DMatrix::zeros(count, points.count());
    let columns = strains.as_mut_slice().par_chunks_mut(count.max(1));
    let rows = energies.as_mut_slice().par_chunks_mut(count.max(1));
    let roots: Vec<f64> = columns
        .zip(rows)
        .enumerate()
        .map(|(point, (strains, energies))| {
            let (point, mut h) = (points.at(point), Vec::new());
            let root = (point.volume * (point.lame.lambda + point.lame.mu)).sqrt();
            point.gradients_of(&states.u, &mut h);
            for ((strain, energy), h) in strains.iter_mut().zip(energies).zip(&h) {
                *strain = root * (NEO_HOOKEAN.dilatation)(h);
                *energy = point.volume * (NEO_HOOKEAN.energy)(h, point.lame);
            }
            root
        })
        .collect();
    let sums = energies.column_sum();
    let least = |state: usize| {
        let dilatations = roots.iter().enumerate().map(|(point, root)| strains[(state, point)] / root);
        dilatations.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(point, _)| point)
    };
    let mut pressed: Vec<usize> = (0..count).filter_map(least).collect();
    pressed.sort_unstable();
    pressed.dedup();
    (roots, strains.transpose(), sums, pressed)
}

/// ∇h of every field at some points, a column for each point, entry by entry over the fields.
pub fn gradients(points: &RestPoints, fields: &NodeFields, chosen: &[usize]) -> DMatrix<f64> {
    let mut table = DMatrix::zeros(9 * fields.columns, chosen.len());
    let mut h: Vec<Matrix3<f64>> = Vec::new();
    for (mut column, point) in table.column_iter_mut().zip(chosen) {
        points.at(*point).gradients_of(fields, &mut h);
        let entries = (0..9).flat_map(|entry| h.iter().map(move |h| h[entry]));
        column.iter_mut().zip(entries).for_each(|(to, value)| *to = value);
    }
    table
}
