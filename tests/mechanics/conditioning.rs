//! The condition number and the bound on the forward error that stand in the .green file.

use crate::common;

use common::scene;
use greenstage::fem::{Lame, NodeFields, Partition, assemble};
use greenstage::green::{self, FIELDS, Needs, Solution};
use greenstage::solve::Silent;
use nalgebra::DMatrix;

/// A cube of side 1, held at two faces.
fn solve(poisson: &str, extra: &str) -> Solution {
    let scene = scene(&format!(
        "[body.block]\ngenerate = {{ block = {{ size = [1.0, 1.0, 1.0], cells = [4, 4, 4] }} }}\n\
         material = {{ young = 1.0e3, poisson = {poisson} }}\n{extra}\n\
         [body.block.control.high]\nnodes = {{ group = \"xmax\" }}\ngrab = \"dragger\"\n\
         [body.block.control.low]\nnodes = {{ group = \"xmin\" }}\ngrab = \"fixed\"\n"
    ));
    green::solve(&scene, "block", Needs::default(), &Silent).unwrap()
}

/// κ₂ of A scaled by its diagonal, from all its eigenvalues.
fn dense_condition(solution: &Solution, poisson: f64) -> f64 {
    let mesh = &solution.mesh;
    let k = assemble(mesh, &vec![Lame::from_young_poisson(1e3, poisson); mesh.tets.len()]).unwrap();
    let held = solution.controls.iter().flat_map(|control| control.nodes.iter().copied());
    let a = Partition::new(mesh.nodes.len(), held).a(&k);
    let n = 3 * a.nodes();
    let mut identity = NodeFields::zeros(a.nodes(), n);
    (0..n).for_each(|i| identity.row_mut(i)[i] = 1.0);
    let mut dense = NodeFields::zeros(a.nodes(), n);
    a.multiply(&identity, &mut dense);
    let dense = DMatrix::from_row_slice(n, n, &dense.data);
    let scale: Vec<f64> = dense.diagonal().iter().map(|d| d.sqrt()).collect();
    let values = DMatrix::from_fn(n, n, |i, j| dense[(i, j)] / (scale[i] * scale[j])).symmetric_eigenvalues();
    values.max() / values.min()
}

#[test]
fn the_condition_number_is_that_of_all_eigenvalues() {
    for poisson in ["0.3", "0.49", "0.4999"] {
        let solution = solve(poisson, "");
        let estimate = solution.stats.conditioning.unwrap().scaled_condition;
        let exact = dense_condition(&solution, poisson.parse().unwrap());
        println!("ν = {poisson}: κ {exact:.4e}, estimated {estimate:.4e}");
        assert!(estimate <= exact * (1.0 + 1e-9) && estimate > 0.8 * exact, "{estimate:e} of {exact:e}");
    }
}

/// All control elements shifted by 1 shift every node by 1, whatever the matrix: the sum of the two columns is known
/// exactly, and its error is at most that of both.
#[test]
fn the_forward_error_is_bounded_and_not_by_nonsense() {
    for poisson in ["0.3", "0.49", "0.4999", "0.499999", "-0.99"] {
        let solution = solve(poisson, "");
        let bound = solution.stats.conditioning.unwrap().forward_error;
        let mut error: f64 = 0.0;
        for axis in 0..3 {
            for node in 0..solution.mesh.nodes.len() {
                let row = solution.fields.row(3 * node + axis);
                error = error.max((row[axis] + row[FIELDS + axis] - 1.0).abs());
            }
        }
        println!("ν = {poisson}: error {error:.1e}, bound {bound:.1e}");
        assert!(error <= 2.0 * bound && bound <= 500.0 * error, "ν = {poisson}: {error:e}, bound {bound:e}");
    }
}

/// Conjugate gradients see the spectrum on their way: the block-Jacobi condition number is near the Jacobi one here.
#[test]
fn conjugate_gradients_tell_a_condition_number_too() {
    let cholesky = solve("0.3", "").stats.conditioning.unwrap();
    let pcg = solve("0.3", "solver = { method = \"pcg\", tolerance = 1e-12 }").stats.conditioning.unwrap();
    println!("Jacobi {:.1}, block-Jacobi {:.1}", cholesky.scaled_condition, pcg.scaled_condition);
    let ratio = pcg.scaled_condition / cholesky.scaled_condition;
    assert!((0.2..=1.05).contains(&ratio), "{ratio}");
    assert!(pcg.forward_error < 1e-12 * pcg.scaled_condition && pcg.forward_error > 0.0);
}
