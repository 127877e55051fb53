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
use nalgebra::{DMatrix, DVector, DVectorView, Matrix3};
use rayon::prelude::*;

/// Pressures that are chosen at most: what the time of a force tick allows.
pub const MOST_PRESSURES: usize = 40;
/// Part of the energy of a state that may be missed.
const MISSED: f64 = 1e-5;

/// States that the pressures must serve.
pub struct States {
    /// A column for each.
    pub u: NodeFields,
    /// Weight of each; of one below 1 nothing more is asked.
    pub weights: Vec<f64>,
}

/// The chosen pressures.
pub struct Pressures {
    /// ψ, a row for each point.
    pub weights: DMatrix<f64>,
    /// The largest part that they miss of the energy of a state whose weight is 1 or more.
    pub missed: f64,
    /// The points at which states are pressed most.
    pub pressed: Vec<usize>,
}

/// Bytes while the pressures are chosen: dilatations and energies of the states, and the modes.
pub fn memory(points: usize, states: usize) -> f64 {
    8.0 * (points * (4 * states + 2 * MOST_PRESSURES)) as f64
}

/// Chooses the pressures.
pub fn pressures(points: &RestPoints, states: &States) -> Pressures {
    let Dilatations { roots, mut strains, energies } = Dilatations::new(points, states);
    let pressed = pressed(&roots, &strains);
    // √(vol/κ) μ.
    let first = roots.iter().enumerate().map(|(at, root)| {
        let point = points.at(at);
        point.lame.mu * point.volume / root
    });
    let mut modes = vec![DVector::from_iterator(roots.len(), first).normalize()];
    let own = strains.tr_mul(&modes[0]);
    strains.ger(-1.0, &modes[0], &own, 1.0);
    // Each state in parts of its energy.
    let sizes = energies.map(|energy| (2.0 * energy).max(f64::MIN_POSITIVE).sqrt());
    strains.column_iter_mut().zip(sizes.iter()).for_each(|(mut strain, size)| strain /= *size);
    let weights = DMatrix::from_diagonal(&DVector::from_column_slice(&states.weights));
    let seen = &strains * weights;
    let eigen = seen.tr_mul(&seen).symmetric_eigen();
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    // Of states that count less than a whole one, nothing is asked.
    let asked: Vec<usize> = (0..sizes.len()).filter(|state| states.weights[*state] >= 1.0).collect();
    let mut left: Vec<f64> = asked.iter().map(|state| strains.column(*state).norm_squared()).collect();
    let most = |left: &[f64]| left.iter().copied().fold(0.0, f64::max);
    for k in order {
        let value = eigen.eigenvalues[k];
        if modes.len() == MOST_PRESSURES || most(&left) <= MISSED || value <= f64::EPSILON * largest {
            break;
        }
        let mode = &seen * eigen.eigenvectors.column(k) / value.sqrt();
        let shares = strains.tr_mul(&mode);
        left.iter_mut().zip(&asked).for_each(|(left, state)| *left -= shares[*state] * shares[*state]);
        modes.push(mode);
    }
    // ψ = √(κ/vol) of what is orthonormal.
    let of = |point: usize, mode: usize| modes[mode][point] * roots[point] / points.at(point).volume;
    Pressures { weights: DMatrix::from_fn(roots.len(), modes.len(), of), missed: most(&left), pressed }
}

/// Dilatations and energies of the states.
struct Dilatations {
    /// √(vol κ) of each point.
    roots: Vec<f64>,
    /// √(vol κ) (J - 1), a column for each state.
    strains: DMatrix<f64>,
    /// V of each state, J.
    energies: DVector<f64>,
}

impl Dilatations {
    fn new(points: &RestPoints, states: &States) -> Dilatations {
        let of_point = |at: usize| {
            let (point, mut h) = (points.at(at), Vec::new());
            point.gradients_of(&states.u, &mut h);
            let root = (point.volume * (point.lame.lambda + point.lame.mu)).sqrt();
            let strains = h.iter().map(|h| root * (NEO_HOOKEAN.dilatation)(h)).collect::<Vec<_>>();
            let energies = h.iter().map(|h| point.volume * (NEO_HOOKEAN.energy)(h, point.lame));
            (root, strains, energies.collect::<Vec<_>>())
        };
        let all: Vec<_> = (0..points.count()).into_par_iter().map(of_point).collect();
        let count = states.u.columns;
        Dilatations {
            roots: all.iter().map(|(root, ..)| *root).collect(),
            strains: DMatrix::from_fn(all.len(), count, |point, state| all[point].1[state]),
            energies: DVector::from_fn(count, |state, _| {
                all.iter().map(|(.., energies)| energies[state]).sum()
            }),
        }
    }
}

/// The point at which each state is pressed most, each point once.
fn pressed(roots: &[f64], strains: &DMatrix<f64>) -> Vec<usize> {
    let least = |strains: DVectorView<'_, f64>| {
        let dilatations = strains.iter().zip(roots).map(|(strain, root)| strain / root);
        dilatations.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).map(|(point, _)| point)
    };
    let mut pressed: Vec<usize> = strains.column_iter().filter_map(least).collect();
    pressed.sort_unstable();
    pressed.dedup();
    pressed
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, TET10};
    use crate::mesh::{Block, block, quadratic};

    /// Pressures are orthonormal, and of few states they miss nothing of the energy of volume.
    #[test]
    fn few_states_have_the_energy_of_their_own_pressures() {
        let mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [1, 1, 2] }).unwrap();
        let lame: Vec<Lame> = (0..mesh.tets.len())
            .map(|i| Lame::from_young_poisson(1.0 + 9.0 * (i % 2) as f64, 0.45))
            .collect();
        let mesh = quadratic::quadratic(mesh, &quadratic::straight);
        let points = RestPoints::new(&TET10, &mesh, &lame).unwrap();
        let mut u = NodeFields::zeros(mesh.nodes.len(), 3);
        u.data.iter_mut().enumerate().for_each(|(i, u)| *u = 0.1 * (1.7 * i as f64).sin());
        let states = States { u, weights: vec![1.0, 2.0, 1e-3] };
        let found = pressures(&points, &states);
        assert!(found.weights.ncols() == 3 && found.missed < 1e-5, "two states count: {}", found.missed);
        let states = States { weights: vec![1.0, 2.0, 10.0], ..states };
        let found = pressures(&points, &states);
        assert!(
            found.weights.ncols() == 4 && found.missed < 1e-12,
            "{} {}",
            found.weights.ncols(),
            found.missed
        );
        let bulk = |point: usize| points.at(point).lame.lambda + points.at(point).lame.mu;
        let by_bulk = DMatrix::from_fn(points.count(), 4, |point, mode| {
            found.weights[(point, mode)] * points.at(point).volume / bulk(point)
        });
        let unit = found.weights.tr_mul(&by_bulk);
        assert!((&unit - DMatrix::identity(4, 4)).amax() < 1e-12, "{unit}");
        let mut h = Vec::new();
        for state in 0..3 {
            let (mut energy, mut means) = (0.0, DVector::zeros(4));
            for at in 0..points.count() {
                let point = points.at(at);
                point.gradients_of(&states.u, &mut h);
                let dilatation = (NEO_HOOKEAN.dilatation)(&h[state]);
                energy += 0.5 * point.volume * bulk(at) * dilatation * dilatation;
                means += found.weights.row(at).transpose() * (point.volume * dilatation);
            }
            let found = 0.5 * means.norm_squared();
            assert!((found - energy).abs() < 1e-10 * energy, "{state}: {found} {energy}");
        }
        assert!(!found.pressed.is_empty() && found.pressed.len() <= 3);
    }
}
