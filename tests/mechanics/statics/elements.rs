//! Large strain with every element: a bent block's closed form, and a bar that is bent as Poisson's ratio comes near 1/2.

use crate::common::scene;
use greenstage::deform::{ControlPose, Statics};
use greenstage::fem::{
    ELEMENTS, Element, Hyperelastic, LAWS, Lame, NEO_HOOKEAN, NodeFields, Partition, STVK, StiffnessMatrix,
    TET4, TET4_ANP, TET10,
};
use greenstage::mesh::{Block, TetMesh, block, quadratic};
use greenstage::scene::Scene;
use greenstage::solve::{LinearSolver, Silent, Solver};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::path::Path;

/// A block bent into a sector of a ring without stretching along z: R. S. Rivlin, Large elastic deformations of isotropic
/// materials VI, Phil. Trans. R. Soc. A 242, 1949, 173-195, for the incompressible neo-Hookean material.
///
/// r² = 2 A x + A √(A² + h²), φ = y/A, with A the length over the angle: both curved sides are free of traction where
/// r₁ r₂ = A². The energy density is μ/2 (A²/r² + r²/A² - 2).
struct Flexure {
    length: f64,
    thickness: f64,
    width: f64,
    mu: f64,
}

impl Flexure {
    fn radius_squared(&self, angle: f64, x: f64) -> f64 {
        let a = self.length / angle;
        2.0 * a * x + a * self.thickness.hypot(a)
    }

    fn place(&self, angle: f64, x: &Vector3<f64>) -> Vector3<f64> {
        let (a, r) = (self.length / angle, self.radius_squared(angle, x.x).sqrt());
        Vector3::new(r * (x.y / a).cos() - a, r * (x.y / a).sin(), x.z)
    }

    fn energy(&self, angle: f64) -> f64 {
        let (a, h) = (self.length / angle, self.thickness);
        let ratio = self.radius_squared(angle, 0.5 * h) / self.radius_squared(angle, -0.5 * h);
        let integral = 0.5 * a * ratio.ln() + h * h.hypot(a) / a - 2.0 * h;
        0.5 * self.mu * self.length * self.width * integral
    }

    /// Moment on an end, about the sector's centre: ∂W/∂angle.
    fn moment(&self, angle: f64) -> f64 {
        let step = 1e-5;
        (self.energy(angle + step) - self.energy(angle - step)) / (2.0 * step)
    }
}

const FLEXURE: Flexure = Flexure { length: 1.0, thickness: 0.5, width: 0.25, mu: 1.0 };

/// A bent block of `n` cells across its width: the faces z = ±b/2 stay flat, held by a spring.
struct Bent {
    mesh: TetMesh,
    body: Hyperelastic,
    partition: Partition,
    ends: Vec<usize>,
    flat: Vec<bool>,
    solver: Box<dyn LinearSolver>,
}

impl Bent {
    fn new(element: &Element, n: u32, poisson: f64) -> Bent {
        let Flexure { length, thickness, width, mu } = FLEXURE;
        let mut mesh = block(&Block { size: [thickness, length, width], cells: [2 * n, 4 * n, n] }).unwrap();
        if element.order == 2 {
            mesh = quadratic(mesh, &quadratic::straight);
        }
        let lame = Lame { lambda: 2.0 * mu * poisson / (1.0 - 2.0 * poisson), mu };
        let body = Hyperelastic::new(element, &NEO_HOOKEAN, &mesh, &vec![lame; mesh.tets.len()]).unwrap();
        let is_end = |x: &Vector3<f64>| x.y.abs() > 0.5 * length - 1e-9;
        let ends: Vec<usize> = (0..mesh.nodes.len()).filter(|&node| is_end(&mesh.nodes[node])).collect();
        let flat = mesh.nodes.iter().map(|x| x.z.abs() > 0.5 * width - 1e-9).collect();
        let partition = Partition::new(mesh.nodes.len(), ends.iter().map(|&node| node as u32));
        let rest = body.gradients(&NodeFields::zeros(mesh.nodes.len(), 1));
        let solver = Solver::default().analyse(&partition.a(&body.tangent(&rest)), &Silent).unwrap();
        Bent { mesh, body, partition, ends, flat, solver }
    }

    fn solve(&self, mut k: StiffnessMatrix, rhs: impl Fn(&StiffnessMatrix) -> NodeFields) -> NodeFields {
        let flat = self.flat.iter().zip(&mut k.diagonal).filter(|(is_flat, _)| **is_flat);
        flat.for_each(|(_, block)| block[(2, 2)] += 1e9);
        let (free, _) =
            self.solver.factor(&self.partition.a(&k), &Silent).unwrap().solve(&rhs(&k), &Silent).unwrap();
        let mut d = NodeFields::zeros(k.nodes(), 1);
        self.partition.insert_free(&free, &mut d);
        d
    }

    fn downhill(&self, u: &NodeFields) -> NodeFields {
        let mut forces = self.body.forces(&self.body.gradients(u));
        for (force, is_flat) in forces.data.chunks_mut(3).zip(&self.flat) {
            force.iter_mut().for_each(|force| *force = -*force);
            force[2] = if *is_flat { 0.0 } else { force[2] };
        }
        forces.at(&self.partition.free)
    }

    /// Displacements where the block is bent by `angle`.
    fn bend(&self, angle: f64) -> NodeFields {
        let mut u = NodeFields::zeros(self.mesh.nodes.len(), 1);
        for step in 1..=8 {
            let mut d = NodeFields::zeros(u.nodes, 1);
            for &node in &self.ends {
                let moved = FLEXURE.place(angle * f64::from(step) / 8.0, &self.mesh.nodes[node]);
                for axis in 0..3 {
                    d.data[3 * node + axis] =
                        moved[axis] - self.mesh.nodes[node][axis] - u.data[3 * node + axis];
                }
            }
            let before = self.body.gradients(&u);
            let free = self.solve(self.body.tangent(&before), |k| self.partition.minus_b_times(k, &d));
            add(&mut d, &free);
            let mut pressures = self.body.pressures_after(&before, &d);
            add(&mut u, &d);
            let mut last = f64::INFINITY;
            for _ in 0..12 {
                let state = self.body.gradients(&u);
                let d = self.solve(self.body.tangent_with(&state, &pressures), |_| self.downhill(&u));
                pressures = self.body.pressures_after(&state, &d);
                add(&mut u, &d);
                last = d.data.iter().fold(0.0, |most, d| d.abs().max(most));
                if last < 1e-10 {
                    break;
                }
            }
            assert!(last < 1e-10, "Newton's iteration ended with a step of {last:e}");
        }
        u
    }

    /// Errors of the energy and of the moment of the upper end, relative.
    fn errors(&self, angle: f64) -> [f64; 2] {
        let u = self.bend(angle);
        let state = self.body.gradients(&u);
        let forces = self.body.forces(&state);
        let at = |fields: &NodeFields, node: usize| Vector3::from_column_slice(&fields.data[3 * node..][..3]);
        let centre = -Vector3::x() * FLEXURE.length / angle;
        let of = |&&node: &&usize| self.mesh.nodes[node].y > 0.0;
        let moment =
            |&node: &usize| (self.mesh.nodes[node] + at(&u, node) - centre).cross(&at(&forces, node)).z;
        let moment: f64 = self.ends.iter().filter(of).map(moment).sum();
        [self.body.energy(&state) / FLEXURE.energy(angle), moment / FLEXURE.moment(angle)].map(|of| of - 1.0)
    }
}

fn add(sum: &mut NodeFields, other: &NodeFields) {
    sum.data.iter_mut().zip(&other.data).for_each(|(sum, other)| *sum += other);
}

/// Rates of the errors at ν = 0.4999 and 60°: elements without locking tend to the closed form as on any material, the energy as
/// h² (tet4_anp) and better than h³ (tet10).
#[test]
fn rivlins_flexure_is_met_near_incompressibility() {
    let angle = 60f64.to_radians();
    for (element, [coarse, fine], least_rate, most) in
        [(&TET4_ANP, [2, 4], 1.8, 0.04), (&TET10, [1, 2], 3.0, 2e-3)]
    {
        let errors = [coarse, fine].map(|n| Bent::new(element, n, 0.4999).errors(angle));
        let [energy, moment] = [0, 1].map(|i| [errors[0][i], errors[1][i]]);
        let rate = (energy[0] / energy[1]).abs().log2();
        println!("{}: energy {energy:.5?}, rate {rate:.2}, moment {moment:.5?}", element.name);
        assert!(rate > least_rate && energy[1].abs() < most, "{}: {energy:?}", element.name);
        assert!(moment[1].abs() < most && moment[1].abs() < moment[0].abs(), "{}", element.name);
    }
}

/// A bar of 1 × 0.25 × 0.25 m, E = 1 MPa, its far end carried along the arc of a bend by 60°: the moment there, N m.
fn end_moment(element: &Element, n: u32, poisson: &str, law: &'static greenstage::fem::Law) -> f64 {
    let scene = scene(&format!(
        "[body.bar]\ngenerate = {{ block = {{ size = [1.0, 0.25, 0.25], cells = [{}, {n}, {n}] }} }}\n\
         element = \"{}\"\nmaterial = {{ young = 1.0e6, poisson = {poisson} }}\n\
         [body.bar.control.high]\nnodes = {{ group = \"xmax\" }}\ngrab = \"dragger\"\n\
         [body.bar.control.low]\nnodes = {{ group = \"xmin\" }}\ngrab = \"fixed\"\n",
        4 * n,
        element.name
    ));
    let mut statics = Statics::new(&scene, "bar", law, &Silent).unwrap();
    let angle = 60f64.to_radians();
    let translation = Vector3::new(angle.sin() / angle - 1.0, (1.0 - angle.cos()) / angle, 0.0);
    let matrix: Matrix3<f64> = *Rotation3::from_axis_angle(&Vector3::z_axis(), angle).matrix();
    let poses = vec![ControlPose { translation, matrix }, ControlPose::REST];
    let settled = statics.solve(&poses, &Silent).unwrap();
    assert!(settled.residual < 1e-9 && settled.inverted.is_empty(), "{} {poisson}", law.name);
    // Nearly incompressible or not, two load steps of 30° converge without being halved.
    assert!(settled.counts.halved <= 1 && settled.counts.factorizations < 30, "{:?}", settled.counts);
    let wrench = settled.wrenches[0];
    wrench.moment.z - translation.cross(&wrench.force).z
}

/// Moments by tet10 with 6 cells across (7,417 nodes), N m: stvk, neo_hookean, corotational at ν = 0.3, 0.49 and 0.4999. With 4
/// cells they are 0.2, 1.3 and 1.7 % larger.
const FINE: [(&str, [f64; 3]); 3] = [
    ("0.3", [367.0601, 325.7681, 338.7714]),
    ("0.49", [384.4057, 333.1655, 352.8097]),
    ("0.4999", [387.6270, 334.9650, 355.2618]),
];

/// Every element with every law, near ν = 1/2 too; the manual's chapter `verify` has how much too stiff each is.
#[test]
fn every_law_bends_with_every_element_as_the_manual_says() {
    let manual = include_str!("../../../src/manual/reference/verify.md");
    let mut missing = Vec::new();
    for (poisson, fine) in FINE {
        for (law, fine) in LAWS.iter().zip(fine) {
            let error = |(element, n)| end_moment(element, n, poisson, law) / fine - 1.0;
            let errors = [(&TET4, 4), (&TET4_ANP, 4), (&TET10, 2)].map(error);
            assert!(errors.iter().all(|error| *error > -0.01), "a coarse mesh is too stiff: {errors:?}");
            let shown = errors.map(|error| format!("{:.0} %", 100.0 * error));
            let row = format!("| {poisson} | `{}` | {} |", law.name, shown.join(" | "));
            println!("{row}");
            missing.extend((!manual.contains(&row)).then_some(row));
        }
    }
    assert!(missing.is_empty(), "the manual lacks {missing:#?}");
    assert_eq!(ELEMENTS.len(), 3, "an element has no column");
}

/// A plate clamped at both ends, of which one is moved aside: `greenstage check` says by how much its linear tetrahedra are too stiff, and
/// says nothing of thicker plates and of `tet10`.
#[test]
fn the_stiffness_of_thin_walls_is_what_the_check_says() {
    let scene = |thickness: f64, element: &str| {
        let text = format!(
            "[body.b]\nelement = \"{element}\"\nmaterial = {{ young = 1.0e9, poisson = 0.3 }}\n\
             generate = {{ block = {{ size = [1.0, 0.2, {thickness}], cells = [10, 2, 2] }} }}\n\
             control.a = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.b = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
        );
        Scene::parse(&text, Path::new("plate.toml")).unwrap()
    };
    let said = |scene: &Scene| -> Vec<String> {
        let found = greenstage::green::prepare(scene, "b").unwrap().findings;
        found.into_iter().map(|finding| finding.message).filter(|text| text.starts_with("walls")).collect()
    };
    let force = |scene: &Scene| {
        let mut statics = Statics::new(scene, "b", &STVK, &Silent).unwrap();
        let aside = ControlPose { translation: Vector3::z() * 1e-7, ..ControlPose::REST };
        statics.solve(&vec![ControlPose::REST, aside], &Silent).unwrap().wrenches[1].force.z
    };
    for (thickness, told) in [(0.02, 19.0), (0.01, 73.0)] {
        let linear = scene(thickness, "tet4");
        let factor = force(&linear) / force(&scene(thickness, "tet10"));
        println!("{thickness} m: {factor:.1} times too stiff");
        assert!((factor / told - 1.0).abs() < 0.1, "{factor}");
        assert!(
            said(&linear)[0].contains(&format!("bend about {told:.1} times too stiffly")),
            "{:?}",
            said(&linear)
        );
    }
    assert!(said(&scene(0.05, "tet4")).is_empty() && said(&scene(0.01, "tet10")).is_empty());
}
