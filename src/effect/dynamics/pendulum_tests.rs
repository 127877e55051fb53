//! A pendulum: a bear that hangs on a soft strip.

use super::coupled::Damping;
use super::system::System;
use super::tables::Tables;
use super::tests::{risings, step, world};
use crate::deform::ControlPose;
use crate::effect::{Resolved, file_of};
use crate::green::GreenFile;
use crate::mesh::TetMesh;
use crate::mesh::quality::signed_volume;
use nalgebra::{DMatrix, Rotation3, Vector3};
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

const GRAVITY: f64 = 9.80665;

/// A rigid body that hangs on a strip whose upper end is clamped.
struct Pendulum {
    /// Length, m; bending stiffness, N·m²; mass per length, kg/m.
    length: f64,
    bending: f64,
    by_length: f64,
    /// kg; depth of its centre of mass below the strip's lower end, m; moment of inertia about that centre, kg·m².
    mass: f64,
    depth: f64,
    moment: f64,
}

impl Pendulum {
    /// Period of the slowest motion, s: the strip as 20 beam elements with their stiffness under the weight that each bears (J.
    /// Przemieniecki, Theory of Matrix Structural Analysis, sections 5.6, 11.4 and 15.2).
    fn period(&self) -> f64 {
        let parts = 20;
        let l = self.length / parts as f64;
        let size = 2 * (parts + 1);
        let (mut stiffness, mut mass) = (DMatrix::zeros(size, size), DMatrix::zeros(size, size));
        let beam = |[a, b, c, d, e, f]: [f64; 6]| {
            DMatrix::from_row_slice(
                4,
                4,
                &[
                    a,
                    b * l,
                    c,
                    d * l,
                    b * l,
                    e * l * l,
                    -d * l,
                    f * l * l,
                    c,
                    -d * l,
                    a,
                    -b * l,
                    d * l,
                    f * l * l,
                    -b * l,
                    e * l * l,
                ],
            )
        };
        for k in 0..parts {
            let borne = self.mass + self.by_length * (self.length - (k as f64 + 0.5) * l);
            let bent = beam([12.0, 6.0, -12.0, 6.0, 4.0, 2.0]) * (self.bending / l.powi(3));
            let drawn = beam([36.0, 3.0, -36.0, 3.0, 4.0, -1.0]) * (borne * GRAVITY / (30.0 * l));
            let moved = beam([156.0, 22.0, 54.0, -13.0, 4.0, -3.0]) * (self.by_length * l / 420.0);
            let mut own = stiffness.view_mut((2 * k, 2 * k), (4, 4));
            own += bent + drawn;
            let mut own = mass.view_mut((2 * k, 2 * k), (4, 4));
            own += moved;
        }
        let end = size - 2;
        mass[(end, end)] += self.mass;
        mass[(end, end + 1)] += self.mass * self.depth;
        mass[(end + 1, end)] += self.mass * self.depth;
        mass[(end + 1, end + 1)] += self.moment + self.mass * self.depth.powi(2);
        stiffness[(end + 1, end + 1)] += self.mass * GRAVITY * self.depth;
        let free = |of: &DMatrix<f64>| of.view((2, 2), (size - 2, size - 2)).into_owned();
        let root = free(&stiffness).cholesky().unwrap().l().try_inverse().unwrap();
        TAU * (&root * free(&mass) * root.transpose()).symmetric_eigenvalues().max().sqrt()
    }

    /// T = 2π √(I/(m g l)) about the middle of the strip, as if it had no stiffness.
    fn as_on_an_axis(&self) -> f64 {
        let arm = self.depth + 0.5 * self.length;
        TAU * ((self.moment + self.mass * arm * arm) / (self.mass * GRAVITY * arm)).sqrt()
    }
}

#[test]
fn a_pendulum_on_a_short_soft_strip_is_one_on_an_axis() {
    let soft = Pendulum { length: 1e-3, bending: 1e-7, by_length: 0.0, mass: 0.1, depth: 0.2, moment: 2e-3 };
    let off = soft.period() / soft.as_on_an_axis() - 1.0;
    println!("{off:.1e} beside");
    assert!(off.abs() < 4e-3, "{off:e}");
}

/// Period with which a body's second element swings, s, let go after a turn about the body's z-axis at `pivot`.
fn swung(scene: &Resolved, file: &Arc<GreenFile>, turn: f64, pivot: Vector3<f64>, frames: usize) -> f64 {
    let mut world = world(scene, file);
    let field = world.fields.bodies[0].poses[1];
    step(&mut world, 0);
    let deformer = &world.bodies[0].deformer;
    let matrix = *Rotation3::from_scaled_axis(Vector3::z() * turn).matrix();
    let arm = deformer.controls[1].origin + deformer.centre - pivot;
    world.graph.restore(field, ControlPose { translation: matrix * arm - arm, matrix });
    let mut signal = Vec::new();
    for frame in 1..=frames {
        step(&mut world, frame);
        let pose = world.graph.get(field);
        signal.push((frame as f64 / 60.0, pose.matrix[(1, 0)]));
    }
    let times = risings(&signal);
    (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64
}

/// Mass, centre of mass and moment of inertia about the axis through it along z, of the tetrahedra that a test takes.
fn mass_of(mesh: &TetMesh, density: f64, takes: &dyn Fn(f64) -> bool) -> (f64, Vector3<f64>, f64) {
    let (mut mass, mut first, mut second) = (0.0, Vector3::zeros(), 0.0);
    for tet in 0..mesh.tets.len() {
        let corners = mesh.corners(tet);
        if !corners.iter().all(|x| takes(x.y)) {
            continue;
        }
        let (own, sum) = (density * signed_volume(&corners), corners.iter().sum::<Vector3<f64>>());
        mass += own;
        first += sum * (own / 4.0);
        // ∫ x² dm = m/20 (Σ xᵢ² + (Σ xᵢ)²) of a tetrahedron with corners xᵢ.
        second += own / 20.0
            * (corners.iter().map(|x| x.xy().norm_squared()).sum::<f64>() + sum.xy().norm_squared());
    }
    let centre = first / mass;
    (mass, centre, second - mass * centre.xy().norm_squared())
}

/// The bear of `drop.toml` on a strip of 30 mm above its head, all of which below the strip is one rigid element.
const BEAR: &str = r#"
[body.bear]
material = { young = 1.0e6, poisson = 0.4, density = 1100.0 }
model = "rod"
gravity = true
effects = ["dynamics"]
effect.dynamics = { modes = 2, damping = 0.005, free = ["tip"] }
place = { position = [0.0, 0.0, 0.0], rotation = [0.0, 0.0, 0.0], scale = 1.0 }
control.root = { nodes = { box = { min = [-1.0, 0.0949, -1.0], max = [1.0, 1.0, 1.0] } }, grab = "fixed" }
control.tip = { nodes = { box = { min = [-1.0, -1.0, -1.0], max = [1.0, 0.0651, 1.0] } }, grab = "dragger" }

[body.bear.generate.blobs]
cell = 0.005
blend = 0.007
parts = [
    { from = [0.0, -0.0204, 0.0], to = [0.0, 0.0132, -0.0012], radius = 0.0258, end_radius = 0.0198 },
    { from = [0.0, -0.0168, 0.0084], radius = 0.0216 },
    { from = [0.0, 0.0408, 0.0012], radius = 0.0192 },
    { from = [0.0, 0.036, 0.0156], to = [0.0, 0.0348, 0.0216], radius = 0.0084, end_radius = 0.0072 },
    { from = [-0.015, 0.0576, -0.0012], radius = 0.0072 },
    { from = [0.015, 0.0576, -0.0012], radius = 0.0072 },
    { from = [-0.018, 0.0156, 0.0024], to = [-0.042, 0.0132, 0.0144], radius = 0.0099, end_radius = 0.0084 },
    { from = [0.018, 0.0156, 0.0024], to = [0.042, 0.0132, 0.0144], radius = 0.0099, end_radius = 0.0084 },
    { from = [-0.0156, -0.0348, 0.0072], to = [-0.024, -0.0396, 0.0312], radius = 0.0132, end_radius = 0.0108 },
    { from = [0.0156, -0.0348, 0.0072], to = [0.024, -0.0396, 0.0312], radius = 0.0132, end_radius = 0.0108 },
    { from = [0.0, 0.055, 0.0], to = [0.0, 0.105, 0.0], radius = 0.005 },
]
"#;

/// Swings sideways about the middle of its strip, whose length and bending stiffness are those of the uniform beam that answers a force and a
/// moment on its end as the mesh does.
#[test]
fn a_bear_on_a_strip_swings_as_a_compound_pendulum() {
    let scene = Resolved::parse(BEAR, Path::new("bear.toml")).unwrap();
    let file = file_of(&scene).unwrap();
    let tables = Tables::read(&file, "bear").unwrap();
    let system = System::new(&tables, vec![false, true], false, Damping::Ratio(0.0));
    let stiffness = (&system.stiffness * &system.all_from_own).view((0, 0), (6, 6)).into_owned();
    let yields = stiffness.try_inverse().unwrap();
    let [shift, both, turn] = [(0, 0), (0, 5), (5, 5)].map(|at| yields[at]);
    let length = (12.0 * (shift - both * both / turn) / turn).sqrt();
    let origin = file.meta.bodies["bear"].controls[1].origin;
    let mesh = scene.load_mesh("bear", &scene.body["bear"]).unwrap().mesh;
    let middle = world(&scene, &file).bodies[0].deformer.centre.y + origin[1] + both / turn;
    let density = 1100.0;
    let (mass, centre, moment) = mass_of(&mesh, density, &|y| y < 0.0651);
    let (whole, ..) = mass_of(&mesh, density, &|y| y < 0.0949);
    let expected = Pendulum {
        length,
        bending: length / turn,
        by_length: (whole - mass) / length,
        mass,
        depth: middle - 0.5 * length - centre.y,
        moment,
    };
    let period = swung(&scene, &file, 0.05, Vector3::y() * middle, 150);
    let off = period / expected.period() - 1.0;
    println!(
        "{mass:.4} kg, {:.1} mm below a strip of {:.1} mm: period {period:.4} s, on the strip {:.4} s ({off:.1e} beside), on an axis {:.4} s",
        1e3 * expected.depth,
        1e3 * length,
        expected.period(),
        expected.as_on_an_axis()
    );
    assert!(off.abs() < 1e-2, "{off:e}");
}

/// A thin plate that hangs on a strip of 60 mm of its own, below which it is one rigid element.
const PLATE: &str = r#"
[body.plate]
generate = { block = { size = [0.4, 0.006, 0.012], cells = [40, 1, 2] } }
element = "tet10"
material = { young = 1.0e7, poisson = 0.0, density = 5000.0 }
model = "rod"
gravity = true
effects = ["dynamics"]
effect.dynamics = { modes = 2, damping = 0.005, free = ["tip"] }
place = { position = [0.0, 0.0, 0.0], rotation = [0.0, 0.0, -1.5707963267948966], scale = 1.0 }
control.root = { nodes = { group = "xmin" }, grab = "fixed" }
control.tip = { nodes = { box = { min = [-0.14001, -1.0, -1.0], max = [1.0, 1.0, 1.0] } }, grab = "dragger" }
"#;

/// Was seen to stop after 20 frames: the rod's sections buckled under its weight.
#[test]
fn a_plate_on_a_strip_swings_as_a_compound_pendulum() {
    let scene = Resolved::parse(PLATE, Path::new("plate.toml")).unwrap();
    let file = file_of(&scene).unwrap();
    let [length, height, width, density] = [0.06, 0.006, 0.012, 5000.0];
    let mass = 0.34 * height * width * density;
    let expected = Pendulum {
        length,
        bending: 1e7 * width * height.powi(3) / 12.0,
        by_length: height * width * density,
        mass,
        depth: 0.17,
        moment: mass * (0.34_f64.powi(2) + height * height) / 12.0,
    };
    let period = swung(&scene, &file, 0.03, -Vector3::x() * 0.17, 240);
    let off = period / expected.period() - 1.0;
    println!("period {period:.4} s, on the strip {:.4} s ({off:.1e} beside)", expected.period());
    assert!(off.abs() < 5e-3, "{off:e}");
}
