//! Published and analytic solutions, with fitted rates of convergence.

use crate::common;

use common::{block_scene, some_pose};
use greenstage::fem::{Lame, NodeFields, Partition, TET4, tet4};
use greenstage::green::{self, FIELDS, Requirements, STIFFNESS, Solution};
use greenstage::mesh::{Surface, TetMesh, generate, quality};
use greenstage::scene::Scene;
use greenstage::solve::{Silent, Solver};
use nalgebra::{DVector, Matrix3, Vector3};
use std::sync::LazyLock;

static HAPTICS: LazyLock<Requirements> = LazyLock::new(|| Requirements::new(&[STIFFNESS]));

/// Lamé's thick cylinder in plane strain (Timoshenko and Goodier, Theory of Elasticity, 3rd ed., article 28):
/// u_r = (1+ν) p a² / (E (b²-a²)) ((1-2ν) r + b²/r) under inner pressure p.
struct LameCylinder {
    a: f64,
    b: f64,
    young: f64,
    poisson: f64,
    pressure: f64,
}

impl LameCylinder {
    fn factors(&self) -> (f64, f64) {
        let LameCylinder { a, b, young, poisson, pressure } = *self;
        let c = (1.0 + poisson) * pressure * a * a / (young * (b * b - a * a));
        (c * (1.0 - 2.0 * poisson), c * b * b)
    }

    /// The tube's axis is x.
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let (linear, inverse) = self.factors();
        let r = Vector3::new(0.0, x.y, x.z);
        r * (linear + inverse / r.norm_squared())
    }

    /// ∇u = (linear + inverse/r²) P - 2 inverse/r⁴ r⊗r with P the projector off the axis.
    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64> {
        let (linear, inverse) = self.factors();
        let r = Vector3::new(0.0, x.y, x.z);
        let off_axis = Matrix3::from_diagonal(&Vector3::new(0.0, 1.0, 1.0));
        let square = r.norm_squared();
        off_axis * (linear + inverse / square) - r * r.transpose() * (2.0 * inverse / (square * square))
    }
}

#[test]
fn lame_formula_has_its_published_values() {
    // a = 1, b = 2, E = 1, ν = 0.3, p = 1: u(a) = 1.90666666666667, u(b) = 1.21333333333333.
    let exact = LameCylinder { a: 1.0, b: 2.0, young: 1.0, poisson: 0.3, pressure: 1.0 };
    assert!((exact.displacement(&Vector3::new(0.0, 1.0, 0.0)).y - 1.906_666_666_666_67).abs() < 1e-13);
    assert!((exact.displacement(&Vector3::new(3.0, 0.0, 2.0)).z - 1.213_333_333_333_33).abs() < 1e-13);
}

/// Solves the cylinder with its inner wall under pressure, its outer wall free and the exact motion on its end
/// faces; returns h and the relative errors in L2 and in energy.
fn solve_lame(exact: &LameCylinder, n: u32) -> (f64, f64, f64) {
    let length = 0.5;
    let mesh = generate::tube(&generate::Tube {
        inner_radius: exact.a,
        outer_radius: exact.b,
        length,
        radial: n,
        around: 8 * n,
        along: n / 2,
        control_length: 0.0,
    })
    .unwrap();
    let lame = Lame::from_young_poisson(exact.young, exact.poisson);
    let k = TET4.assemble(&mesh, &vec![lame; mesh.tets.len()]).unwrap();
    let ends = mesh.groups["left"].iter().chain(&mesh.groups["right"]).copied();
    let partition = Partition::new(mesh.nodes.len(), ends);

    let mut u = NodeFields::zeros(mesh.nodes.len(), 1);
    for &node in &partition.controlled {
        let exact = exact.displacement(&mesh.nodes[node as usize]);
        u.data[3 * node as usize..][..3].copy_from_slice(exact.as_slice());
    }
    let mut rhs = partition.minus_b_times(&k, &u);
    let pressure = pressure_forces(&mesh, exact.a, exact.pressure);
    for (row, &node) in partition.free.iter().enumerate() {
        for axis in 0..3 {
            rhs.data[3 * row + axis] += pressure[node as usize][axis];
        }
    }
    let a = partition.a(&k);
    let solver = Solver::default().analyse(&a, &Silent).unwrap();
    let (free, _) = solver.factor(&a, &Silent).unwrap().solve(&rhs, &Silent).unwrap();
    partition.insert_free(&free, &mut u);
    let (l2, energy) = errors(exact, &mesh, lame, &u);
    ((exact.b - exact.a) / f64::from(n), l2, energy)
}

/// Consistent nodal forces of the pressure on the inner wall: a third of p times the area vector to each corner.
fn pressure_forces(mesh: &TetMesh, inner_radius: f64, pressure: f64) -> Vec<Vector3<f64>> {
    let mut forces = vec![Vector3::zeros(); mesh.nodes.len()];
    let surface = Surface::from_mesh(mesh);
    for triangle in &surface.triangles {
        let nodes = triangle.map(|corner| surface.nodes[corner as usize] as usize);
        let x = nodes.map(|node| mesh.nodes[node]);
        if x.iter().all(|x| x.y.hypot(x.z) < inner_radius * (1.0 + 1e-9)) {
            let area = (x[1] - x[0]).cross(&(x[2] - x[0])) * 0.5;
            nodes.iter().for_each(|&node| forces[node] -= area * (pressure / 3.0));
        }
    }
    forces
}

/// Relative errors ‖u - u_h‖ / ‖u‖ in L2 and in energy, by the four-point rule of degree 2.
fn errors(exact: &LameCylinder, mesh: &TetMesh, lame: Lame, u: &NodeFields) -> (f64, f64) {
    let (near, far) = (0.585_410_196_624_968_5, 0.138_196_601_125_010_5);
    let energy_of = |h: &Matrix3<f64>| {
        let strain = (h + h.transpose()) * 0.5;
        lame.lambda * strain.trace().powi(2) + 2.0 * lame.mu * strain.norm_squared()
    };
    let mut sums = [0.0; 4];
    for (tet, nodes) in mesh.tets.iter().enumerate() {
        let x = mesh.corners(tet);
        let element = tet4::geometry(x).unwrap();
        let at = nodes.map(|node| Vector3::from_column_slice(&u.data[3 * node as usize..][..3]));
        let h: Matrix3<f64> = (0..4).map(|a| at[a] * element.gradients[a].transpose()).sum();
        for point in 0..4 {
            let weight = |corner: usize| if corner == point { near } else { far };
            let position: Vector3<f64> = (0..4).map(|a| x[a] * weight(a)).sum();
            let value: Vector3<f64> = (0..4).map(|a| at[a] * weight(a)).sum();
            let (wanted, gradient) = (exact.displacement(&position), exact.gradient(&position));
            let volume = 0.25 * quality::signed_volume(&x);
            sums[0] += volume * (value - wanted).norm_squared();
            sums[1] += volume * wanted.norm_squared();
            sums[2] += volume * energy_of(&(h - gradient));
            sums[3] += volume * energy_of(&gradient);
        }
    }
    ((sums[0] / sums[1]).sqrt(), (sums[2] / sums[3]).sqrt())
}

/// Slope of the least-squares line through (ln h, ln e).
fn rate(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(h, e)| (h.ln(), e.ln())).collect();
    let (mx, my) = (logs.iter().map(|p| p.0).sum::<f64>() / n, logs.iter().map(|p| p.1).sum::<f64>() / n);
    logs.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum::<f64>()
        / logs.iter().map(|p| (p.0 - mx).powi(2)).sum::<f64>()
}

#[test]
fn lames_thick_cylinder_converges_at_rate_2_in_l2_and_1_in_energy() {
    let exact = LameCylinder { a: 1.0, b: 2.0, young: 1.0, poisson: 0.3, pressure: 1.0 };
    let solved: Vec<(f64, f64, f64)> = [4, 8, 16].map(|n| solve_lame(&exact, n)).to_vec();
    let l2 = rate(&solved.iter().map(|s| (s.0, s.1)).collect::<Vec<_>>());
    let energy = rate(&solved.iter().map(|s| (s.0, s.2)).collect::<Vec<_>>());
    println!("Lamé: (h, L2, energy) {solved:?}; rates {l2:.3}, {energy:.3}");
    assert!((l2 - 2.0).abs() < 0.15, "L2 rate {l2}: {solved:?}");
    assert!((energy - 1.0).abs() < 0.1, "energy rate {energy}: {solved:?}");
}

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

/// The excess stiffness of linear tetrahedra in bending, how slowly that heals near ν = 1/2, and the results of the two other
/// elements. The manual's chapter `verify` has these figures.
#[test]
fn linear_tetrahedra_lock_as_the_manual_says() {
    let manual = include_str!("../../src/manual/reference/verify.md");
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

fn solved_block() -> (Scene, Solution) {
    let scene = block_scene([5, 4, 4], "");
    let solution = green::solve(&scene, "block", &HAPTICS, &Silent).unwrap();
    (scene, solution)
}

#[test]
fn handle_stiffness_is_reciprocal() {
    let (_, solution) = solved_block();
    let asymmetry = solution.asymmetry.unwrap();
    assert!(asymmetry < 1e-13, "Betti: max |S - Sᵀ| / max |S| = {asymmetry:e}");
}

/// S c against central differences of W(c) = ½ uᵀ K u with u = Σ cₖ u⁽ᵏ⁾ taken over all nodes.
#[test]
fn handle_stiffness_is_the_second_derivative_of_the_energy() {
    let (_, solution) = solved_block();
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
    let (_, solution) = solved_block();
    let s = solution.stiffness().unwrap();
    for mode in 0..6 {
        let axis = Vector3::<f64>::ith(mode % 3, 1.0);
        let c: Vec<f64> = solution
            .controls
            .iter()
            .flat_map(|control| {
                let (shift, spin) = if mode < 3 {
                    (axis, Matrix3::zeros())
                } else {
                    (axis.cross(&control.origin), axis.cross_matrix())
                };
                shift
                    .iter()
                    .copied()
                    .chain(spin.transpose().iter().copied().collect::<Vec<_>>())
                    .collect::<Vec<_>>()
            })
            .collect();
        let force = s * DVector::from_vec(c);
        assert!(force.amax() < 1e-12 * s.amax(), "mode {mode}: {:e}", force.amax() / s.amax());
    }
}
