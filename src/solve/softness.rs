//! An estimate of the condition number of A in a small part of the time of its factor; a factor in f32 is useless above 1e7.
//!
//! In: A with the places of its nodes. Out: about κ₂ of A scaled by its diagonal, from below and to an order of magnitude.
//!
//! The nodes are gathered into a few groups that move as rigid bodies (Rayleigh and Ritz). All strain is then between the
//! groups, in one layer of elements instead of many: the least eigenvalue is too large by as many times as a group has layers.

use crate::fem::StiffnessMatrix;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x6, Vector3};

/// Number of halvings by which groups are made, 2 to this power.
/// Least number of nodes of a group.
const HALVINGS: u32 = 5;
const NODES: usize = 16;
/// Steps of the inverse iteration.
const STEPS: usize = 6;
/// The largest eigenvalue of a stiffness matrix that is scaled by its diagonal.
const LARGEST: f64 = 3.0;

/// Estimate of κ₂(S A S) with S = diag(A)^-1/2; infinite where A is not positive definite, `None` without places.
pub(super) fn condition(a: &StiffnessMatrix) -> Option<f64> {
    if a.places.len() != a.nodes() || a.nodes() == 0 {
        return None;
    }
    let mut nodes: Vec<u32> = (0..a.nodes() as u32).collect();
    let mut groups: Vec<&mut [u32]> = vec![&mut nodes];
    for _ in 0..HALVINGS {
        if groups.iter().any(|group| group.len() < 2 * NODES) {
            break;
        }
        groups = groups.into_iter().flat_map(|group| <[_; 2]>::from(halves(group, &a.places))).collect();
    }
    let mut of_node = vec![0; a.nodes()];
    let mut motion = vec![Matrix3x6::zeros(); a.nodes()];
    for (number, group) in groups.iter().enumerate() {
        let place = |&node: &u32| Vector3::from(a.places[node as usize]);
        let centre = group.iter().map(place).sum::<Vector3<f64>>() / group.len() as f64;
        let size = group.iter().map(|node| (place(node) - centre).norm()).fold(f64::MIN_POSITIVE, f64::max);
        for node in group.iter() {
            of_node[*node as usize] = number;
            let arm = (place(node) - centre) / size;
            let own = &mut motion[*node as usize];
            own.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            own.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm.cross_matrix());
        }
    }
    let count = 6 * groups.len();
    let (mut stiffness, mut scale) = (DMatrix::zeros(count, count), DMatrix::zeros(count, count));
    for (node, block) in a.diagonal.iter().enumerate() {
        let (of, at) = (&motion[node], 6 * of_node[node]);
        let mut own = stiffness.fixed_view_mut::<6, 6>(at, at);
        own += of.transpose() * block * of;
        let mut own = scale.fixed_view_mut::<6, 6>(at, at);
        own += of.transpose() * Matrix3::from_diagonal(&block.diagonal()) * of;
    }
    let mut between: usize = 0;
    for (&[i, j], block) in a.edges.iter().zip(&a.blocks) {
        let [i, j] = [i as usize, j as usize];
        let part = motion[i].transpose() * block * motion[j];
        let (row, column) = (6 * of_node[i], 6 * of_node[j]);
        between += usize::from(row != column);
        let mut to = stiffness.fixed_view_mut::<6, 6>(row, column);
        to += part;
        let mut to = stiffness.fixed_view_mut::<6, 6>(column, row);
        to += part.transpose();
    }
    let layers = a.edges.len() as f64 / between.max(1) as f64;
    let Some(factor) = stiffness.cholesky() else { return Some(f64::INFINITY) };
    let mut x = DVector::from_fn(count, |i, _| 1.0 + (i as f64).sin());
    let mut softest = 0.0;
    for _ in 0..STEPS {
        let force = &scale * &x;
        let next = factor.solve(&force);
        softest = next.dot(&(&scale * &next)) / next.dot(&force);
        x = &next / next.amax().max(f64::MIN_POSITIVE);
    }
    Some(LARGEST * softest * layers.max(1.0))
}

/// Both halves of a group across its longest side.
fn halves<'a>(group: &'a mut [u32], places: &[[f64; 3]]) -> (&'a mut [u32], &'a mut [u32]) {
    let side = |axis: usize| {
        let along = || group.iter().map(|&node| places[node as usize][axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let sides = [0, 1, 2].map(side);
    let axis = (0..3).fold(0, |most, axis| if sides[axis] > sides[most] { axis } else { most });
    let middle = group.len() / 2;
    group.select_nth_unstable_by(middle, |&a, &b| {
        places[a as usize][axis].total_cmp(&places[b as usize][axis]).then(a.cmp(&b))
    });
    group.split_at_mut(middle)
}
