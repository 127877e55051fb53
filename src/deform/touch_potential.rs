//! The energy of a tool's contacts with bodies, about a pose of the tool: what a force loop feels between two frames.
//!
//! In: the contacts at the end of a frame, each with its place, its axes B (the normal into the body, and two tangents), its force f and
//! its gap, and the compliance W between them. Out: for a motion of the tool by v and R the forces f, N, with
//!
//! ```text
//! d = W f + d₀ - Bᵀ (v + (R - 1) r)      0 ≤ d_n ⊥ f_n ≥ 0      |f_t| ≤ μ f_n against d_t
//! ```
//!
//! where r leads from the tool's origin to the contact and d₀ is such that the frame's own forces solve it where nothing moves: a
//! contact sticks where the frame has left it. The energy is ½ fᵀ W f, J. While no contact slides, the force on the tool is its
//! negative gradient; one that slides dissipates. It is the problem of the next frame, with gaps linear about the last one.
//!
//! A device that cannot bear the stiffness of the contacts feels them through a spring of compliance Γ
//! ([`soften`](TouchPotential::soften)), which is part of W as J Γ Jᵀ, J the motion of the points by that of the tool: then the forces,
//! not an iteration beside them, know where a point lifts off.
//!
//! Where a body breaks, as under a blade, f_n is at most a limit: farther in, the force stays the same, and the energy grows by limit times
//! way. Every frame begins anew at the place to which it has come.
//!
//! [`respond`](TouchPotential::respond) allocates nothing: it begins with the forces that follow linearly while each contact stays as it
//! is, and sweeps over the contacts. Contacts beyond [`MOST_POINTS`] are merged with their neighbours, which makes the touch softer,
//! never stiffer: the energy is the greatest of all forces' (Castigliano), and fewer forces are left to choose from.

use super::pose::se3;
use super::touch_points::{MOST_POINTS, TouchPoint, clusters, merged, strongest};
use crate::solve::cone::{Compliance, Cone, single, within};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Matrix3x6, Matrix6, UnitQuaternion, Vector2, Vector3, Vector6,
};

type V3 = Vector3<f64>;

/// Solutions of single contacts at most, which bounds the time of a tick, and the part of the largest displacement at which they end:
/// what is left is found by the next frame.
const MOST_SOLUTIONS: usize = 160;
const NEAR: f64 = 1e-7;
/// Part of the mean compliance that is added to the diagonal where forces are predicted: neighbours may depend on one another.
const RIDGE: f64 = 1e-9;

/// The contacts of the tool of one stylus.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TouchPotential {
    /// Index of the stylus.
    pub stylus: usize,
    /// Poses in the frame, of the stylus and of the tool that it carries.
    pub room_from_stylus: Isometry3<f64>,
    pub room_from_tool: Isometry3<f64>,
    /// The stiffness against the tool's motion (v, ω) about its origin, 6 × 6 in N/m, N and N·m, while all points touch and none
    /// slides: no touch is stiffer.
    pub stiffness: Matrix6<f64>,
    /// The stiffness before it was softened over what the device bears, in the stiffest direction.
    pub stiffer: f64,
    points: Vec<TouchPoint>,
    /// W in the points' axes, row by row, m/N, and d₀, m.
    compliance: Vec<Matrix3<f64>>,
    free: Vec<V3>,
    /// Forces in the frame, in the points' axes, and their slope by the tool's motion while each point stays as it is.
    forces: Vec<V3>,
    slopes: Vec<Matrix3x6<f64>>,
}

/// Energy and force for a pose of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchResponse {
    /// J.
    pub energy: f64,
    /// Force on the tool and torque about its origin, along the room's axes, N and N·m.
    pub force: V3,
    pub torque: V3,
}

impl TouchPotential {
    /// The touch with these points; `compliance` is that between two of them along the room's axes, m/N. Without friction only normal
    /// forces count.
    pub fn new(
        (stylus, room_from_stylus, room_from_tool): (usize, Isometry3<f64>, Isometry3<f64>),
        points: &[TouchPoint],
        compliance: &dyn Fn(usize, usize) -> Matrix3<f64>,
    ) -> TouchPotential {
        let clusters = clusters(points);
        let merged: Vec<TouchPoint> = clusters.iter().map(|members| merged(points, members)).collect();
        let n = merged.len();
        let strongest: Vec<_> = clusters.iter().map(|members| strongest(members)).collect();
        let mut blocks = Vec::with_capacity(n * n);
        for (i, a) in strongest.iter().enumerate() {
            for (j, b) in strongest.iter().enumerate() {
                let mut block = Matrix3::zeros();
                for (one, v) in a {
                    for (other, w) in b {
                        block += compliance(*one, *other) * (v * w);
                    }
                }
                blocks.push(merged[i].axes.tr_mul(&block) * merged[j].axes);
            }
        }
        let forces: Vec<V3> = merged.iter().map(|point| point.axes.tr_mul(&point.force)).collect();
        let mut touch = TouchPotential {
            stylus,
            room_from_stylus,
            room_from_tool,
            stiffness: Matrix6::zeros(),
            stiffer: 0.0,
            free: vec![V3::zeros(); n],
            points: merged,
            compliance: blocks,
            slopes: vec![Matrix3x6::zeros(); n],
            forces,
        };
        for i in 0..n {
            let gap = if touch.is_pressed(i) { 0.0 } else { touch.points[i].gap.max(0.0) };
            touch.free[i] = V3::x() * gap - touch.yields(i, &touch.forces);
        }
        touch.linearise();
        touch
    }

    /// Stiffness, and slopes of the forces, for the present compliance.
    fn linearise(&mut self) {
        let all: Vec<usize> = (0..self.points.len()).collect();
        let slopes = self.predicted(&all);
        self.stiffness = slopes
            .iter()
            .enumerate()
            .fold(Matrix6::zeros(), |sum, (i, slope)| sum + self.motion_of(i).transpose() * slope);
        let pressed: Vec<usize> = all.into_iter().filter(|i| self.is_pressed(*i)).collect();
        self.slopes = self.predicted(&pressed);
    }

    /// Puts a spring of compliance Γ between the hand and the tool: 6 × 6 about the tool's origin, in m/N and so on, by force and torque
    /// on the tool. `stiffer` is how many times too stiff it was.
    pub fn soften(&mut self, spring: &Matrix6<f64>, stiffer: f64) {
        self.stiffer = stiffer;
        let n = self.points.len();
        if n == 0 || *spring == Matrix6::zeros() {
            return;
        }
        for i in 0..n {
            for j in 0..n {
                let more = self.motion_of(i) * spring * self.motion_of(j).transpose();
                self.compliance[i * n + j] += more;
            }
        }
        if self.points.iter().any(|point| point.limit.is_finite()) {
            // What yields has the force of the frame through any spring.
            for i in 0..n {
                self.free[i] = V3::x() * self.free[i].x.max(0.0) - self.yields(i, &self.forces);
            }
            return self.linearise();
        }
        let w = DMatrix::from_fn(3 * n, 3 * n, |r, c| {
            0.5 * (self.block(r / 3, c / 3)[(r % 3, c % 3)] + self.block(c / 3, r / 3)[(c % 3, r % 3)])
        });
        let d0 = DVector::from_fn(3 * n, |r, _| self.free[r / 3][r % 3]);
        let friction: Vec<f64> = self.points.iter().map(|point| point.friction).collect();
        let mut forces = DVector::from_fn(3 * n, |r, _| self.forces[r / 3][r % 3]);
        Cone { w: &Compliance::of(&w), d0: &d0, friction: &friction }.solve(&mut forces);
        for (i, force) in self.forces.iter_mut().enumerate() {
            force.copy_from(&forces.fixed_rows::<3>(3 * i));
        }
        self.linearise();
    }

    /// Whether any point is pressed where nothing has moved.
    pub fn presses(&self) -> bool {
        (0..self.points.len()).any(|i| self.is_pressed(i))
    }

    /// Number of points after merging.
    pub fn points(&self) -> usize {
        self.points.len()
    }

    /// Takes the contents of another, in the memory that it has.
    pub fn copy_from(&mut self, other: &TouchPotential) {
        let TouchPotential { stylus, room_from_stylus, room_from_tool, stiffness, stiffer, .. } = *other;
        (self.stylus, self.room_from_stylus, self.room_from_tool) =
            (stylus, room_from_stylus, room_from_tool);
        (self.stiffness, self.stiffer) = (stiffness, stiffer);
        self.points.clone_from(&other.points);
        self.compliance.clone_from(&other.compliance);
        self.free.clone_from(&other.free);
        self.forces.clone_from(&other.forces);
        self.slopes.clone_from(&other.slopes);
    }

    /// An empty touch with memory for [`MOST_POINTS`].
    pub fn with_room() -> TouchPotential {
        let mut touch = TouchPotential::default();
        touch.points.reserve(MOST_POINTS);
        touch.compliance.reserve(MOST_POINTS * MOST_POINTS);
        touch.free.reserve(MOST_POINTS);
        touch.forces.reserve(MOST_POINTS);
        touch.slopes.reserve(MOST_POINTS);
        touch
    }

    fn is_pressed(&self, i: usize) -> bool {
        self.forces[i].x > 0.0
    }

    fn block(&self, i: usize, j: usize) -> &Matrix3<f64> {
        &self.compliance[i * self.points.len() + j]
    }

    /// Row i of W f.
    fn yields(&self, i: usize, forces: &[V3]) -> V3 {
        forces.iter().enumerate().map(|(j, force)| self.block(i, j) * force).sum()
    }

    /// The motion of point i along its axes by that of the tool.
    fn motion_of(&self, i: usize) -> Matrix3x6<f64> {
        let TouchPoint { arm, axes, .. } = &self.points[i];
        let mut motion = Matrix3x6::zeros();
        motion.fixed_view_mut::<3, 3>(0, 0).copy_from(&axes.transpose());
        motion.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-axes.transpose() * arm.cross_matrix()));
        motion
    }

    /// Slopes W⁻¹ J of the forces by the tool's motion while these points touch and, with friction, stick.
    fn predicted(&self, points: &[usize]) -> Vec<Matrix3x6<f64>> {
        let rows: Vec<(usize, usize)> = points
            .iter()
            .flat_map(|i| (0..if self.points[*i].friction > 0.0 { 3 } else { 1 }).map(move |axis| (*i, axis)))
            .collect();
        let mut w = DMatrix::from_fn(rows.len(), rows.len(), |r, c| {
            let ((i, a), (j, b)) = (rows[r], rows[c]);
            0.5 * (self.block(i, j)[(a, b)] + self.block(j, i)[(b, a)])
        });
        let ridge = RIDGE * w.trace() / rows.len().max(1) as f64;
        (0..rows.len()).for_each(|r| w[(r, r)] += ridge);
        let mut slopes = vec![Matrix3x6::zeros(); self.points.len()];
        let motion = DMatrix::from_fn(rows.len(), 6, |r, c| self.motion_of(rows[r].0)[(rows[r].1, c)]);
        if let Some(factor) = w.cholesky() {
            let solved = factor.solve(&motion);
            for (r, (i, axis)) in rows.iter().enumerate() {
                slopes[*i].row_mut(*axis).copy_from(&solved.row(r));
            }
        }
        slopes
    }

    /// Energy and force where the tool is at `room_from_tool`.
    pub fn respond(&self, room_from_tool: &Isometry3<f64>) -> TouchResponse {
        let n = self.points.len().min(MOST_POINTS);
        let moved = room_from_tool.translation.vector - self.room_from_tool.translation.vector;
        let turn: UnitQuaternion<f64> = room_from_tool.rotation * self.room_from_tool.rotation.inverse();
        let motion: Vector6<f64> = se3::joined(&moved, &turn.scaled_axis());
        let mut forces = [V3::zeros(); MOST_POINTS];
        let mut free = [V3::zeros(); MOST_POINTS];
        let mut largest = 0.0_f64;
        for (i, point) in self.points.iter().enumerate() {
            free[i] = self.free[i] - point.axes.tr_mul(&(moved + turn * point.arm - point.arm));
            largest = largest.max(free[i].norm());
            if self.is_pressed(i) {
                let predicted = self.forces[i] + self.slopes[i] * motion;
                let normal = predicted.x.clamp(0.0, point.limit);
                let tangent = within(&Vector2::new(predicted.y, predicted.z), point.friction * normal);
                forces[i] = V3::new(normal, tangent.x, tangent.y);
            }
        }
        for _ in 0..MOST_SOLUTIONS / n.max(1) {
            let mut change = 0.0_f64;
            for i in 0..n {
                let (own, old) = (self.block(i, i), forces[i]);
                let without = free[i] + self.yields(i, &forces[..n]) - own * old;
                forces[i] = single(own, &without, self.points[i].friction, &old);
                forces[i].x = forces[i].x.min(self.points[i].limit);
                change = change.max((own * (forces[i] - old)).norm());
            }
            if change <= NEAR * largest {
                break;
            }
        }
        let mut response = TouchResponse { energy: 0.0, force: V3::zeros(), torque: V3::zeros() };
        for (i, point) in self.points.iter().enumerate() {
            let on_tool = -(point.axes * forces[i]);
            let yielded = self.yields(i, &forces[..n]);
            response.energy += 0.5 * forces[i].dot(&yielded);
            if forces[i].x >= point.limit {
                response.energy += point.limit * (-(free[i].x + yielded.x)).max(0.0);
            }
            response.force += on_tool;
            response.torque += (turn * point.arm).cross(&on_tool);
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::touch_points::contact_axes;

    /// Points on a floor that the tool presses by `depth`, each on a spring of its own and all on a common one.
    fn touch(count: usize, friction: f64, depth: f64) -> TouchPotential {
        let place = |i: usize| {
            let angle = i as f64 * 2.4;
            V3::new(angle.cos(), 0.0, angle.sin()) * (0.002 * (i as f64 + 1.0)) - V3::y() * 0.01
        };
        let compliance = |i: usize, j: usize| {
            Matrix3::identity()
                * (if i == j { 1.0 / 300.0 } else { 0.0 } + 1.0 / 900.0 / (1.0 + (i + j) as f64))
                + Matrix3::identity() * (0.2 / 900.0)
        };
        // Unloaded and just touching, then pressed: its response gives the forces of a pressed frame.
        let down = contact_axes(&-V3::y());
        let point = |i| TouchPoint {
            arm: place(i),
            axes: down,
            friction,
            force: V3::zeros(),
            gap: 0.0,
            limit: f64::INFINITY,
        };
        let points: Vec<TouchPoint> = (0..count).map(point).collect();
        let at = (0, Isometry3::identity(), Isometry3::identity());
        let just = TouchPotential::new(at, &points, &compliance);
        let lower = Isometry3::translation(0.0, -depth, 0.0);
        let forces = solved(&just, depth);
        let pressed: Vec<TouchPoint> =
            points.iter().zip(forces).map(|(point, f)| TouchPoint { force: down * f, ..*point }).collect();
        TouchPotential::new((0, lower, lower), &pressed, &compliance)
    }

    /// Forces by pressing straight down, where no point slides.
    fn solved(touch: &TouchPotential, depth: f64) -> Vec<V3> {
        let n = touch.points();
        let w = DMatrix::from_fn(n, n, |i, j| touch.block(i, j)[(0, 0)]);
        let f = w.cholesky().unwrap().solve(&DMatrix::from_element(n, 1, depth));
        assert!(f.iter().all(|f| *f > 0.0), "{f}");
        f.iter().map(|f| V3::x() * *f).collect()
    }

    /// A point that yields at 2 N: pressed by the frame up to there, the force stays at 2 N farther in and falls where the tool goes back; it is the
    /// slope of the energy, through the spring of a softened touch as well.
    #[test]
    fn what_breaks_gives_no_more_force() {
        let (limit, length) = (2.0, 5e-3);
        let point = TouchPoint {
            arm: V3::zeros(),
            axes: contact_axes(&-V3::y()),
            friction: 0.0,
            force: V3::y() * -limit,
            gap: 0.0,
            limit,
        };
        let at = (0, Isometry3::identity(), Isometry3::identity());
        let plain = TouchPotential::new(at, &[point], &|_, _| Matrix3::identity() * (length / limit));
        let mut soft = plain.clone();
        soft.soften(&(Matrix6::identity() * (length / limit)), 2.0);
        for (touch, length) in [(plain, length), (soft, 2.0 * length)] {
            let at = |depth: f64| touch.respond(&Isometry3::translation(0.0, -depth, 0.0));
            for (depth, part) in [(-2.0, 0.0), (-0.5, 0.5), (0.0, 1.0), (0.3, 1.0), (4.0, 1.0)] {
                let force = at(depth * length).force.y;
                assert!((force - part * limit).abs() < 1e-12, "{depth}: {force} N");
                let step = 1e-6;
                let [less, more] = [-step, step].map(|step| at(depth * length + step).energy);
                assert!(((more - less) / (2.0 * step) - force).abs() < 1e-3, "{depth}: {less} J, {more} J");
            }
        }
    }

    #[test]
    fn where_nothing_has_moved_the_force_is_the_frames() {
        for friction in [0.0, 0.5] {
            let touch = touch(6, friction, 1e-3);
            let sum: f64 = touch.forces.iter().map(|f| f.x).sum();
            let found = touch.respond(&touch.room_from_tool);
            assert!((found.force - V3::y() * sum).norm() < 1e-9 * sum, "{found:?}, {sum} N");
        }
    }

    /// Minus the slopes of the energy, in all six directions, while points lift off at one side too.
    #[test]
    fn the_force_is_the_slope_of_the_energy() {
        for (friction, tilt) in [(0.0, 0.0), (0.0, 0.25), (5.0, 0.01)] {
            let touch = touch(6, friction, 1e-3);
            let tilted = UnitQuaternion::from_scaled_axis(V3::new(0.4, 0.1, 1.0) * tilt);
            let pose = Isometry3::from_parts((touch.room_from_tool.translation.vector * 0.9).into(), tilted);
            let found = touch.respond(&pose);
            let step = 1e-7;
            for k in 0..6 {
                let beside = |by: f64| {
                    let mut moved = Vector6::zeros();
                    moved[k] = by;
                    let (v, w) = se3::halves(&moved);
                    let turn = UnitQuaternion::from_scaled_axis(w) * pose.rotation;
                    touch.respond(&Isometry3::from_parts((pose.translation.vector + v).into(), turn)).energy
                };
                let slope = (beside(step) - beside(-step)) / (2.0 * step);
                let own = se3::joined(&found.force, &found.torque);
                let size =
                    if k < 3 { own.fixed_rows::<3>(0).norm() } else { 0.02 * own.fixed_rows::<3>(0).norm() };
                assert!(
                    (slope + own[k]).abs() < 1e-4 * size,
                    "μ {friction}, tilt {tilt}, {k}: {slope} {}",
                    own[k]
                );
            }
        }
    }

    /// A tool that is lifted is let go at the place where it touched first, and never pulled; a point that is not reached yet pushes from
    /// its gap on.
    #[test]
    fn a_lifted_tool_is_not_held_back() {
        let touch = touch(6, 0.3, 1e-3);
        let mut last = f64::INFINITY;
        for lifted in [0.0, 0.5e-3, 0.9e-3, 0.999e-3, 1.001e-3, 5e-3] {
            let found = touch.respond(&Isometry3::translation(0.0, -1e-3 + lifted, 0.0));
            assert!(found.force.y >= 0.0 && found.force.y <= last, "{lifted}: {found:?}");
            assert_eq!(found.force.y > 0.0, lifted < 1e-3, "{lifted}");
            last = found.force.y;
        }
        let ahead = TouchPoint {
            arm: V3::zeros(),
            axes: contact_axes(&-V3::y()),
            friction: 0.0,
            force: V3::zeros(),
            gap: 1e-3,
            limit: f64::INFINITY,
        };
        let at = (0, Isometry3::identity(), Isometry3::identity());
        let near = TouchPotential::new(at, &[ahead], &|_, _| Matrix3::identity() / 200.0);
        for (depth, force) in [(0.0, 0.0), (0.9e-3, 0.0), (3e-3, 0.4)] {
            let found = near.respond(&Isometry3::translation(0.0, -depth, 0.0));
            assert!((found.force.y - force).abs() < 1e-12, "{depth}: {found:?}");
        }
        assert!((near.stiffness[(1, 1)] - 200.0).abs() < 1e-6);
    }

    /// Friction holds a tool that moves sideways by its stiffness, up to μ times the normal force.
    #[test]
    fn sideways_it_sticks_and_then_slides() {
        let touch = touch(4, 0.2, 1e-3);
        let press = touch.respond(&touch.room_from_tool).force.y;
        for (aside, slides) in [(1e-5, false), (5e-3, true)] {
            let mut pose = touch.room_from_tool;
            pose.translation.vector.x += aside;
            let force = touch.respond(&pose).force;
            if slides {
                assert!((force.x + 0.2 * press).abs() < 1e-3 * press, "{force} of {press} N");
            } else {
                assert!((force.x + touch.stiffness[(0, 0)] * aside).abs() < 1e-6 * press, "{force}");
            }
        }
    }

    /// A spring before the tool is one in series with its contacts, and the force stays the slope of the energy.
    #[test]
    fn a_softened_touch_is_two_springs_in_series() {
        let mut touch = touch(1, 0.0, 1e-3);
        let (alone, press) = (touch.stiffness[(1, 1)], touch.respond(&touch.room_from_tool).force.y);
        let mut spring = Matrix6::zeros();
        spring[(1, 1)] = 3.0 / alone;
        touch.soften(&spring, 4.0);
        assert!((touch.stiffness[(1, 1)] - alone / 4.0).abs() < 1e-6 * alone);
        for (lifted, share) in [(0.0, 0.25), (0.5e-3, 0.125), (1.1e-3, 0.0), (-1e-3, 0.5)] {
            let force = touch.respond(&Isometry3::translation(0.0, -1e-3 + lifted, 0.0)).force.y;
            assert!((force - share * press).abs() < 1e-9, "{lifted}: {force} of {press} N");
        }
    }

    /// Many points become few: the force stays, the stiffness does not grow.
    #[test]
    fn merged_points_press_as_all_do_and_are_no_stiffer() {
        let all = touch(MOST_POINTS, 0.0, 1e-3);
        let points: Vec<TouchPoint> = all
            .points
            .iter()
            .flat_map(|point| {
                let half = |by: f64| TouchPoint {
                    arm: point.arm + V3::x() * by,
                    force: point.force / 2.0,
                    ..*point
                };
                [half(1e-5), half(-1e-5)]
            })
            .collect();
        let compliance = |i: usize, j: usize| {
            let own = if i == j { 0.1 / 300.0 } else { 0.0 };
            all.points[i / 2].axes * all.block(i / 2, j / 2) * all.points[j / 2].axes.transpose()
                + Matrix3::identity() * own
        };
        let few = TouchPotential::new((0, all.room_from_stylus, all.room_from_tool), &points, &compliance);
        assert!(few.points() <= MOST_POINTS);
        let [a, b] = [&all, &few].map(|touch| touch.respond(&touch.room_from_tool).force.y);
        assert!((a - b).abs() < 1e-6 * a, "{a} {b} N");
        assert!((all.stiffness - few.stiffness).symmetric_eigenvalues().min() > -1e-6 * all.stiffness.norm());
    }
}
