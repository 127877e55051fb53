//! Locking against the manual's figures, and the handle stiffness against reciprocity, energy and rigid motions. Closed
//! forms and rates of convergence are those of `greenstage verify` ([`super::verify`]).

use crate::common::{self, HAPTICS, block_scene, some_pose};
use greenstage::deform::ControlPose;
use greenstage::fem::{Lame, NodeFields};
use greenstage::green::{self, FIELDS, Solution};
use greenstage::solve::Silent;
use nalgebra::{DVector, Matrix3, Vector3};

/// Force that moves one end of a beam of 4 × 1 × 1 m sideways by 1 m without turning it, N, with n cells through its
/// thickness.
fn shear_force(element: &str, poisson: &str, n: u32) -> f64 {
    let scene = common::scene(&format!(
        "[body.block]\ngenerate = {{ block = {{ size = [4.0, 1.0, 1.0], cells = [{}, {n}, {n}] }} }}\n\
         element = \"{element}\"\nmaterial = {{ young = 1.0e3, poisson = {poisson} }}\n\
         [body.block.control.high]\nnodes = {{ group = \"xmax\" }}\ngrab = \"dragger\"\n\
         [body.block.control.low]\nnodes = {{ group = \"xmin\" }}\ngrab = \"fixed\"\n",
        4 * n
    ));
    green::solve(&scene, "block", &HAPTICS, &Silent).unwrap().stiffness().unwrap()[(1, 1)]
}

/// How much too stiff linear tetrahedra are in bending, how slowly that heals near ν = 1/2, and what the two other
/// elements make of it. The manual's chapter `method` has these figures.
#[test]
fn linear_tetrahedra_lock_as_the_manual_says() {
    let manual = include_str!("../../src/manual/method.md");
    let mut missing = Vec::new();
    for poisson in ["0.3", "0.45", "0.49", "0.499", "0.4999"] {
        let cells = [("tet4", 4), ("tet4", 8), ("tet4_anp", 4), ("tet4_anp", 8), ("tet10", 2), ("tet10", 4)];
        let forces = cells.map(|(element, n)| format!("{:.1}", shear_force(element, poisson, n)));
        let row = format!("| {poisson} | {} |", forces.join(" | "));
        println!("{row}");
        missing.extend((!manual.contains(&row)).then_some(row));
    }
    assert!(missing.is_empty(), "the manual lacks {missing:#?}");
}

fn solved_block() -> Solution {
    green::solve(&block_scene([5, 4, 4], ""), "block", &HAPTICS, &Silent).unwrap()
}

#[test]
fn handle_stiffness_is_reciprocal() {
    let solution = solved_block();
    let asymmetry = solution.asymmetry.unwrap();
    assert!(asymmetry < 1e-13, "Betti: max |S - Sᵀ| / max |S| = {asymmetry:e}");
}

/// S c against central differences of W(c) = ½ uᵀ K u with u = Σ cₖ u⁽ᵏ⁾ taken over all nodes.
#[test]
fn handle_stiffness_is_the_second_derivative_of_the_energy() {
    let solution = solved_block();
    let lame = Lame::from_young_poisson(1e3, 0.3);
    let k = solution.element.assemble(&solution.mesh, &vec![lame; solution.mesh.tets.len()]).unwrap();
    let energy = |c: &[f64]| {
        let data = (0..3 * solution.mesh.nodes.len())
            .map(|row| solution.fields.row(row).iter().zip(c).map(|(u, c)| u * c).sum())
            .collect();
        let u = NodeFields { nodes: solution.mesh.nodes.len(), columns: 1, data };
        let mut force = NodeFields::zeros(u.nodes, 1);
        k.multiply(&u, &mut force);
        0.5 * u.dots(&force)[0]
    };
    let c: Vec<f64> = [some_pose(0.3), some_pose(2.0)].iter().flat_map(|pose| pose.coefficients()).collect();
    let force = solution.stiffness().unwrap() * DVector::from_column_slice(&c);
    assert!((energy(&c) - 0.5 * force.dot(&DVector::from_column_slice(&c))).abs() < 1e-12 * energy(&c));
    for i in 0..2 * FIELDS {
        let shifted = |by: f64| {
            let mut c = c.clone();
            c[i] += by;
            energy(&c)
        };
        let slope = (shifted(1e-3) - shifted(-1e-3)) / 2e-3;
        assert!((slope - force[i]).abs() < 1e-9 * force.amax(), "field {i}: {slope} against {}", force[i]);
    }
}

#[test]
fn handle_stiffness_does_not_feel_rigid_motions() {
    let solution = solved_block();
    let s = solution.stiffness().unwrap();
    for mode in 0..6 {
        let axis = Vector3::<f64>::ith(mode % 3, 1.0);
        let c: Vec<f64> = solution
            .controls
            .iter()
            .flat_map(|control| {
                let (translation, spin) = match mode {
                    0..3 => (axis, Matrix3::zeros()),
                    _ => (axis.cross(&control.origin), axis.cross_matrix()),
                };
                ControlPose { translation, matrix: Matrix3::identity() + spin }.coefficients()
            })
            .collect();
        let force = s * DVector::from_vec(c);
        assert!(force.amax() < 1e-12 * s.amax(), "mode {mode}: {:e}", force.amax() / s.amax());
    }
}
