//! A slender bar that is twisted far beyond the twist at which it buckles: the model `rod` against a rod in space by shooting.

use super::rod::curve;
use crate::common::scene;
use greenstage::deform::{ControlPose, Deformer, find_model};
use greenstage::green;
use greenstage::solve::Silent;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::PI;

/// First root of tan x = x twice (Greenhill, Proc. Inst. Mech. Engrs. 34, 1883, 182-225): M L/EI at which a clamped rod buckles that is
/// twisted without a force along it.
const GREENHILL: f64 = 8.98681891581813;
/// m.
const WIDTH: f64 = 0.004;

/// A rod of length 1 with the same bending stiffness 1 in all directions, that does not shear. Fibres of St. Venant-Kirchhoff material
/// stretch as they bend and twist: the strain of the axis is n·t/EA = e + ½ (A_t κ_t² + A_b κ_b²) with A_t = 2 I/A and A_b = 3 I/A.
#[derive(Clone, Copy, Debug)]
struct Rod {
    twisting: f64,
    stretching: f64,
}

/// Place, tangent and moment at a point of the rod, the turn of its section from one that the x axis would carry along (Fuller, Proc.
/// Natl. Acad. Sci. 75, 1978, 3557-3561), and the least cosine of the angle between tangent and axis before it.
#[derive(Clone, Copy)]
struct Section {
    place: Vector3<f64>,
    tangent: Vector3<f64>,
    moment: Vector3<f64>,
    turn: f64,
    along: f64,
}

impl Section {
    fn plus(&self, by: f64, slope: &Section) -> Section {
        Section {
            place: self.place + slope.place * by,
            tangent: self.tangent + slope.tangent * by,
            moment: self.moment + slope.moment * by,
            turn: self.turn + slope.turn * by,
            along: self.along.min(self.tangent.x),
        }
    }
}

impl Rod {
    /// m' = -r' × n, r' = (1 + e) t, t' = m × t/EI, κ_t = m·t/GJ (Antman, Nonlinear Problems of Elasticity, chapter 8).
    fn slope(&self, at: &Section, force: &Vector3<f64>) -> Section {
        let Section { tangent, moment, .. } = at;
        let along = force.dot(tangent);
        let twist = moment.dot(tangent) / (self.twisting + 2.0 * along / self.stretching);
        let bend = moment.cross(tangent) / (1.0 + 3.0 * along / self.stretching);
        let stretch = (along - twist * twist - 1.5 * bend.norm_squared()) / self.stretching;
        let place = tangent * (1.0 + stretch);
        let carried = Vector3::x().cross(tangent).dot(&bend) / (1.0 + tangent.x);
        Section { place, tangent: bend, moment: -place.cross(force), turn: twist + carried, along: 1.0 }
    }

    /// The section at the end of a rod that a half turn about y takes to itself, by Runge and Kutta's method; `z`: place along y, angle of
    /// the tangent to x, force and moment along x and z, all in the middle.
    fn end(&self, [y, angle, nx, nz, mx, mz]: &[f64; 6]) -> Section {
        const STEPS: usize = 240;
        let force = Vector3::new(*nx, 0.0, *nz);
        let middle = Section {
            place: Vector3::y() * *y,
            tangent: Vector3::new(angle.cos(), 0.0, angle.sin()),
            moment: Vector3::new(*mx, 0.0, *mz),
            turn: 0.0,
            along: 1.0,
        };
        let h = 0.5 / STEPS as f64;
        (0..STEPS).fold(middle, |at, _| {
            let a = self.slope(&at, &force);
            let b = self.slope(&at.plus(0.5 * h, &a), &force);
            let c = self.slope(&at.plus(0.5 * h, &b), &force);
            let d = self.slope(&at.plus(h, &c), &force);
            at.plus(h / 6.0, &a).plus(h / 3.0, &b).plus(h / 3.0, &c).plus(h / 6.0, &d)
        })
    }

    /// Equilibria of the clamped rod with ends nearer by `pressed`, from the buckled column on.
    fn twisted(&self, pressed: f64, steps: (f64, usize)) -> Vec<[f64; 6]> {
        let height = 2.0 * pressed.sqrt() / PI;
        let column = [height, 0.0, -4.0 * PI * PI, 0.0, 0.0, -2.0 * PI * PI * height];
        curve([0.1, 0.3, 40.0, 10.0, 8.0, 8.0], column, 4, steps, |z| {
            let Section { place, tangent, .. } = self.end(z);
            vec![place.x - 0.5 * (1.0 - pressed), place.y, place.z, tangent.y, tangent.z]
        })
    }
}

/// A square bar 1 m long between its clamps, without Poisson's ratio, by which a stretch would change its resistance to twisting.
struct Bar {
    deformer: Deformer,
}

impl Bar {
    fn new() -> Bar {
        let scene = scene(&format!(
            "[body.b]\ngenerate = {{ block = {{ size = [1.0, {WIDTH}, {WIDTH}], cells = [64, 2, 2] }} }}\nelement = \"tet10\"\n\
             material = {{ young = 1e6, poisson = 0.0 }}\nmodel = \"rod\"\n\
             control.a = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n\
             control.b = {{ nodes = {{ group = \"xmax\" }}, grab = \"dragger\" }}\n"
        ));
        let model = find_model("rod").unwrap();
        let made = green::precompute(&scene, "b", &model.with_energy(), &Silent).unwrap();
        let file = green::opened(&[made]).unwrap();
        Bar { deformer: Deformer::new(file, "b", model).unwrap() }
    }

    /// Force and moment on the right end about its place when it is turned by `turn` and moved, N and N·m.
    fn held(&mut self, turn: Vector3<f64>, translation: Vector3<f64>) -> [Vector3<f64>; 2] {
        let pose = ControlPose { translation, matrix: *Rotation3::from_scaled_axis(turn).matrix() };
        self.deformer.evaluate(&[ControlPose::REST, pose]);
        let wrench = &self.deformer.wrenches().unwrap().0[1];
        [wrench.force, wrench.moment - translation.cross(&wrench.force)]
    }

    /// How far the middle of the bar is from its axis, m.
    fn height(&self) -> f64 {
        let ring = |i: &usize| self.deformer.rest()[*i][0].abs() < 1e-6;
        let nodes: Vec<usize> = (0..self.deformer.rest().len()).filter(ring).collect();
        let sum: Vector3<f64> = nodes.iter().map(|&i| self.deformer.displacement(i)).sum();
        (sum / nodes.len() as f64).yz().norm()
    }
}

/// The bar is pressed by 2 % of its length, so that it buckles, and then twisted to ten times the twist at which it would buckle straight. It
/// winds up into a helix that is ever tighter and pulls at its clamps. Its tangents stay within 18° of the axis: no section comes nearer to
/// another than 0.95 of the rod between them, and it never touches itself.
#[test]
fn a_bar_that_is_twisted_ten_times_as_far_as_it_buckles_is_a_rod() {
    let mut bar = Bar::new();
    let small: f64 = 0.02;
    let arc = Vector3::new(small.sin() / small - 1.0, (1.0 - small.cos()) / small, 0.0);
    let bending = bar.held(Vector3::z() * small, arc)[1].z / small;
    bar.deformer.forget();
    let rod = Rod {
        twisting: bar.held(Vector3::x() * small, Vector3::zeros())[1].x / small / bending,
        stretching: bar.held(Vector3::zeros(), Vector3::x() * 1e-5)[0].x / 1e-5 / bending,
    };
    let (pressed, steps) = (0.02, 20);
    for step in 1..=steps {
        bar.held(Vector3::zeros(), Vector3::x() * (-pressed * f64::from(step) / f64::from(steps)));
    }
    let critical = GREENHILL / rod.twisting;
    let (mut turn, mut worst) = (0.0, [0.0_f64; 3]);
    for z in &rod.twisted(pressed, (0.5, 140)) {
        let end = rod.end(z);
        let mut found = [Vector3::zeros(); 2];
        let (before, frames) = (turn, (2.0 * end.turn - turn).abs().ceil().max(1.0));
        for frame in 1..=frames as usize {
            turn = before + (2.0 * end.turn - before) * frame as f64 / frames;
            found = bar.held(Vector3::x() * turn, Vector3::x() * -pressed);
        }
        let [force, torque] = found.map(|own| own.x / bending);
        // Next to the bar's own load where it buckles, and to its own width.
        let pull = 4.0 * PI * PI;
        let off = [
            (torque - end.moment.x) / end.moment.x.abs().max(1.0),
            (force - z[2]) / z[2].abs().max(pull),
            (bar.height() - z[0].abs()) / z[0].abs().max(WIDTH),
        ];
        println!(
            "{:.3} of the critical twist: torque {torque:.4}, pull {force:.3}, height {:.5}; off by {off:.4?}; along {:.3}",
            turn / critical,
            bar.height(),
            end.along
        );
        assert!(
            off.iter().all(|off| off.abs() < 0.02),
            "at {:.2} of the critical twist: {off:.4?}",
            turn / critical
        );
        assert!(end.along > 0.95, "tangents are within 18° of the axis: {}", end.along);
        worst = std::array::from_fn(|k| worst[k].max(off[k].abs()));
        if turn > 10.0 * critical {
            break;
        }
    }
    println!("worst {worst:.4?}, to {:.2} of the critical twist", turn / critical);
    assert!(turn > 10.0 * critical, "{turn}");
}
