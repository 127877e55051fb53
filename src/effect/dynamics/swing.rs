//! Released elements beside held ones in a model whose frame turns: their way through a frame, in legs.
//!
//! In: motion, poses to which held elements move, and the forces of the model. Out: the motion at the end of the frame. In each leg, with
//! H the derivatives of the model's own forces by the released elements' shifts and turns where it begins,
//!
//! ```text
//! M z̈ + D ż + H z = f + a t + b t²      H = sym D,  a = -(D - H) ż + ∂f/∂P_h Ṗ_h      a, b: what the forces differ by from f - H z
//! ```
//!
//! an exponential step of Rosenbrock's kind (M. Hochbruck and A. Ostermann, Exponential integrators, Acta Numerica 19, 2010, 209-286,
//! section 2.4), whose b is found by iteration from the forces at the end of the leg: a stiff direction follows the arc on which the
//! element turns, which it would otherwise leave along the tangent. Then the speeds are scaled so that kinetic energy, V and the work of
//! what is held balance, as seen from the mean motion of what is held: the energy never rises, however long a step is and however
//! negative an eigenvalue of H. In such a direction the element leaves an unstable place as e^(√-λ t), within a leg by no more than
//! in any other motion.
//!
//! The axes R are the mean turn of the elements that are not released, so that M is constant while these rest. What a bend changes of M
//! is left out, of the second order in its angle. The elements stand still beside what is held before a pose without equilibrium, and
//! where even the shortest leg does not balance; [`Motion::stopped`] counts the frames in which they do so.

use super::coupled::{Coupled, Phase, StepLoads};
use super::forces::{Felt, Forces, difference};
use super::held_step::Leg;
use super::moving::{Motion, Moving, Now};
use super::system::System;
use super::tables::squared;
use crate::deform::{ControlPose, PoseSlope, same_side, unwrapped};
use crate::green::FIELDS;
use nalgebra::{DMatrix, DVector, DVectorView, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Turn of an element in a leg, rad, and its shift in parts of the distance between elements, at which a leg aims; one that leads
/// twice as far is halved.
const REACH: f64 = 0.2;
/// The shortest leg, in parts of a frame.
const SHORTEST: f64 = 1.0 / 64.0;
/// Shifts and turns by which forces are differentiated, in the same parts and rad.
const DIFFERENCE: f64 = 1e-3;
/// A change of the way by less than this part of it is the last of the iteration.
const FOUND: f64 = 3e-3;
/// Iterations, beyond which a leg is too long.
const MOST: usize = 6;
/// Way from rest in a frame, in the same parts and rad, below which an element that stops is where its forces vanish: the rounding of V ends
/// its motion there.
const STILL: f64 = 1e-6;

/// A frame in which elements swing.
struct Swing<'a> {
    moving: &'a Moving,
    system: &'a System,
    now: &'a Now<'a>,
    dt_s: f64,
    /// ∂V'/∂P of what effects add, which stands in space during the frame.
    added: Vec<PoseSlope>,
}

/// The beginning of a leg.
struct Start {
    motion: Motion,
    felt: Felt,
    /// Share of the frame that is behind.
    share: f64,
    /// -∂f/∂z and ∂f/∂t, with held elements on their way, in the body's axes.
    by_place: DMatrix<f64>,
    by_time: DVector<f64>,
}

/// The pose on the way from one to another: the turn along the shortest way, all else evenly.
pub(super) fn between(from: &ControlPose, to: &ControlPose, share: f64) -> ControlPose {
    if from == to || share >= 1.0 {
        return *to;
    }
    let [start, end] = [from, to].map(|pose| unwrapped(None, &[*pose])[0]);
    let [before, after] = [(start, from), (end, to)]
        .map(|(turn, pose)| turn.to_rotation_matrix().inverse().matrix() * pose.matrix);
    let turn = UnitQuaternion::from_scaled_axis((end * start.inverse()).scaled_axis() * share) * start;
    ControlPose {
        translation: from.translation.lerp(&to.translation, share),
        matrix: turn.to_rotation_matrix().matrix() * (before + (after - before) * share),
    }
}

/// Blocks of three rows and columns, those of shifts and turns, seen in other axes.
fn turned(block: &DMatrix<f64>, by: &Matrix3<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::identity(block.nrows(), block.nrows());
    (0..block.nrows()).step_by(3).for_each(|i| all.fixed_view_mut::<3, 3>(i, i).copy_from(by));
    &all * block * all.transpose()
}

impl Moving {
    /// Moves released elements through a frame; where the model has no forces, they stand still.
    pub(super) fn swung(&self, forces: &mut Forces, system: &System, now: &Now<'_>, dt_s: f64) -> Motion {
        let mut motion = self.motion.clone();
        let total = now.deformer.slopes().map(|slopes| difference(slopes, &motion.slopes));
        let mut is_stopped = false;
        let mut inertia = vec![PoseSlope::default(); motion.poses.len()];
        if let (Some(own), Some(total)) = (forces.begin(now.deformer), total) {
            let added = difference(&total, &own.slopes);
            let swing = Swing { moving: self, system, now, dt_s, added };
            let (mut felt, mut left_s) = (own, dt_s);
            while left_s > 0.0 {
                let share = 1.0 - left_s / dt_s;
                let Some(leg) = swing
                    .start(forces, &motion, felt, share)
                    .and_then(|start| swing.leg_within(forces, &start, left_s))
                else {
                    break;
                };
                (motion, felt) = leg;
                left_s -= motion.step_s;
                for (sum, own) in inertia.iter_mut().zip(&motion.slopes) {
                    sum.translation += own.translation * (motion.step_s / dt_s);
                    sum.matrix += own.matrix * (motion.step_s / dt_s);
                }
            }
            if left_s > 0.0 {
                is_stopped = swing.would_move(forces, &total);
                swing.stop(&mut motion, left_s);
            }
        } else {
            is_stopped = true;
            Swing { moving: self, system, now, dt_s, added: Vec::new() }.stop(&mut motion, dt_s);
        }
        let stopped = if is_stopped { self.motion.stopped.saturating_add(1) } else { 0 };
        Motion { step_s: dt_s, turn: Some(now.turn()), slopes: inertia, stopped, ..motion }
    }
}

impl Swing<'_> {
    /// Elements stand still beside what is held, which goes on: before poses in which the model has no forces, and where nothing is left of
    /// their energy.
    fn stop(&self, motion: &mut Motion, left_s: f64) {
        motion.speeds.fill(0.0);
        motion.rates.fill(0.0);
        let held: Vec<usize> = (0..motion.poses.len()).filter(|e| !self.system.released[*e]).collect();
        let mut speed = Vector3::zeros();
        for &e in held.iter().filter(|e| self.now.poses[**e].is_finite()) {
            if self.now.held[e] {
                let ends = [self.now.poses[e], self.moving.motion.poses[e]].map(|pose| pose.coefficients());
                let own = &mut motion.speeds[FIELDS * e..][..FIELDS];
                own.iter_mut().enumerate().for_each(|(i, own)| *own = (ends[0][i] - ends[1][i]) / self.dt_s);
                speed += Vector3::from_column_slice(&own[..3]) / held.len() as f64;
            }
            motion.poses[e] = self.now.poses[e];
        }
        for e in (0..motion.poses.len()).filter(|e| self.system.released[*e]) {
            motion.poses[e].translation += speed * left_s;
            motion.speeds[FIELDS * e..][..3].copy_from_slice(speed.as_slice());
        }
    }

    /// Whether these slopes ∂V/∂P at the beginning of the frame would move a released element from rest.
    fn would_move(&self, forces: &Forces, slopes: &[PoseSlope]) -> bool {
        let (moving, system) = (self.moving, self.system);
        let load = moving.load(system, slopes, &moving.motion.poses, &Matrix3::identity());
        let none = StepLoads::none(load.len());
        let rest = Phase { place: none.load.clone(), speed: none.load.clone() };
        let to = system.coupled.advanced(&rest, &StepLoads { load, ..none }, self.dt_s);
        let [shift, turn] = self.fastest(&to.place);
        turn.max(shift / forces.size) > STILL
    }

    /// Poses of all elements with those that are held on their way; what was put elsewhere is there at once.
    fn goals(&self, motion: &Motion, share: f64) -> Vec<ControlPose> {
        let Now { poses, held, .. } = self.now;
        let begin = &self.moving.motion.poses;
        let goal = |e: usize| match (self.system.released[e], held[e] && poses[e].is_finite()) {
            (true, _) => motion.poses[e],
            (false, true) => between(&begin[e], &poses[e], share),
            (false, false) => poses[e],
        };
        (0..poses.len()).map(goal).collect()
    }

    /// R: the mean turn of the elements that are not released.
    fn axes(&self, poses: &[ControlPose]) -> UnitQuaternion<f64> {
        let turns = unwrapped(None, poses).into_iter().zip(&self.system.released);
        let mut turns = turns.filter(|(_, released)| !**released).map(|(turn, _)| turn);
        let first = turns.next().unwrap_or_else(UnitQuaternion::identity);
        let sum = turns.fold(first.into_inner(), |sum, turn| sum + same_side(&first, turn).into_inner());
        UnitQuaternion::try_new(sum, 1e-3).unwrap_or(first)
    }

    /// -∂V/∂z in the axes `into`⁻¹, of the model and of what effects add.
    fn load(&self, slopes: &[PoseSlope], poses: &[ControlPose], into: &Matrix3<f64>) -> DVector<f64> {
        let own = self.moving.load(self.system, slopes, poses, into);
        own + self.moving.load(self.system, &self.added, poses, into)
    }

    /// The derivatives of the forces where a leg begins.
    fn start(&self, forces: &mut Forces, motion: &Motion, felt: Felt, share: f64) -> Option<Start> {
        let into = Matrix3::identity();
        forces.prepare();
        let released = (0..motion.poses.len()).filter(|e| self.system.released[*e]);
        let count = 6 * released.clone().count();
        let now = self.load(&felt.slopes, &motion.poses, &into);
        let mut by_place = DMatrix::zeros(count, count);
        let mut poses = motion.poses.clone();
        for (k, e) in released.enumerate() {
            for axis in 0..6 {
                let from = motion.poses[e];
                let along = Vector3::ith(axis % 3, 1.0);
                let mut step = DIFFERENCE;
                if axis >= 3 {
                    poses[e].matrix = Rotation3::from_scaled_axis(along * step).matrix() * from.matrix;
                } else {
                    step *= forces.size;
                    poses[e].translation += along * step;
                }
                let change = (&now - self.load(&forces.beside(&poses)?, &poses, &into)) / step;
                by_place.column_mut(6 * k + axis).copy_from(&change.rows(0, count));
                poses[e] = from;
            }
        }
        let goals = self.goals(motion, share + DIFFERENCE);
        let mut by_time = DVector::zeros(now.len());
        if goals != motion.poses {
            let then = self.load(&forces.beside(&goals)?, &goals, &into);
            by_time = (then - now) / (DIFFERENCE * self.dt_s);
        }
        Some(Start { motion: motion.clone(), felt, share, by_place, by_time })
    }

    /// The longest leg of up to `left_s` that the forces allow; `None` where they are not defined even next to its beginning.
    fn leg_within(&self, forces: &mut Forces, start: &Start, left_s: f64) -> Option<(Motion, Felt)> {
        let [speed, spin] =
            self.fastest(&self.moving.phase(self.system, &start.motion, &Matrix3::identity()).speed);
        let rate = spin.max(speed / forces.size);
        let shortest_s = (SHORTEST * self.dt_s).min(left_s);
        let mut leg_s = (left_s / (rate * left_s / REACH).ceil().max(1.0)).max(shortest_s);
        loop {
            let is_last = leg_s <= shortest_s;
            if let Some(found) = self.leg(forces, start, leg_s, is_last) {
                return Some(found);
            }
            if is_last {
                return None;
            }
            leg_s = (0.5 * leg_s).max(shortest_s);
        }
    }

    /// Largest shift and turn, or their rates, of a released element.
    fn fastest(&self, of: &DVector<f64>) -> [f64; 2] {
        let count = of.len() - self.moving.tables.modes();
        let mut most = [0.0_f64; 2];
        for (i, part) in of.as_slice()[..count].chunks_exact(3).enumerate() {
            most[i % 2] = most[i % 2].max(Vector3::from_column_slice(part).norm());
        }
        most
    }

    /// A leg with the forces at its end; `None` where it is too long, unless it must do.
    fn leg(&self, forces: &mut Forces, start: &Start, dt_s: f64, must: bool) -> Option<(Motion, Felt)> {
        let (moving, system) = (self.moving, self.system);
        let last = &start.motion;
        let at = |share: f64| self.goals(last, start.share + share * dt_s / self.dt_s);
        let goals = at(1.0);
        let [begin, middle, end] = [&at(0.0), &at(0.5), &goals].map(|poses| self.axes(poses));
        let spin = (begin.inverse() * end).scaled_axis() / dt_s;
        let leg = Leg { last, poses: &goals, held: self.now.held, axes: middle, dt_s };
        let [_, into] = leg.matrices();
        let by_place = turned(&start.by_place, &into);
        let count = by_place.nrows();
        let curvature = (&by_place + by_place.transpose()) * 0.5;
        let mut by_time = start.by_time.clone();
        for first in (0..count).step_by(3) {
            let part = into * Vector3::from_column_slice(&by_time.as_slice()[first..first + 3]);
            by_time.rows_mut(first, 3).copy_from(&part);
        }
        let coupled = self.coupled(&curvature);

        let carried = moving.carried(system, &leg);
        let from = moving.phase(system, last, &into);
        let load = self.load(&start.felt.slopes, &last.poses, &into);
        let bent = (&by_place - &curvature) * from.speed.rows(0, count);
        by_time.rows_mut(0, count).zip_apply(&bent, |slope, bent| *slope -= bent);
        let centrifugal = &system.centrifugal * DVectorView::from_slice(&squared(&spin), 9);
        let mut loads = StepLoads {
            load: &load - system.all_from_own.tr_mul(&centrifugal),
            impulse: -(&system.mass * &carried.jumps),
            carried: self.carried_along(&leg, &spin),
            slope: by_time,
            ..StepLoads::none(load.len())
        };
        let mut before: Option<DVector<f64>> = None;
        for iteration in 0.. {
            let to = coupled.advanced(&from, &loads, dt_s);
            let reach = |of: &DVector<f64>| {
                let [shift, turn] = self.fastest(of);
                turn.max(shift / forces.size)
            };
            let way = reach(&to.place).max(reach(&to.speed) * dt_s);
            if !(must || way <= 2.0 * REACH) {
                return None;
            }
            let is_found = before.as_ref().is_some_and(|before| reach(&(&to.place - before)) <= FOUND * way);
            if iteration >= MOST && !is_found && !must {
                return None;
            }
            let end = |to: &Phase| {
                let carried = moving.carried(system, &leg);
                moving.ended(system, &leg, carried, [&from, to], centrifugal.clone())
            };
            let ended = end(&to);
            let felt = forces.at(&ended.poses)?;
            if is_found || iteration >= MOST {
                let along = self.evenly(&leg);
                let raised = self.raised(start, &ended, &felt, &(along * dt_s));
                let along = self.as_speeds(&(into * along));
                let way = &to.place - &from.place - &along * dt_s;
                let outward = system.all_from_own.tr_mul(&centrifugal).dot(&way);
                let scale = match raised {
                    Some(raised) => {
                        coupled.balance([&from, &to], &loads, (&along, raised + outward), dt_s)?
                    }
                    None => 1.0,
                };
                let ended = end(&Phase { speed: &along + (&to.speed - &along) * scale, place: to.place });
                return ended.is_finite().then_some((ended, felt));
            }
            let end = self.load(&felt.slopes, &ended.poses, &into);
            let place = to.place.rows(0, count);
            let rest = (end - &load).rows(0, count) + &curvature * place - loads.slope.rows(0, count) * dt_s;
            loads.bend.rows_mut(0, count).copy_from(&(rest / (dt_s * dt_s)));
            before = Some(to.place);
        }
        None
    }

    /// Mean velocity of what is held, in the body's axes. Seen from this even motion elastic forces do no work on it, which would have to be
    /// summed over their vibration in the leg.
    fn evenly(&self, leg: &Leg<'_>) -> Vector3<f64> {
        let held = (0..leg.poses.len()).filter(|e| !self.system.released[*e]);
        let moved = |e: usize| leg.poses[e].translation - leg.last.poses[e].translation;
        held.clone().map(moved).sum::<Vector3<f64>>() / (held.count().max(1) as f64 * leg.dt_s)
    }

    /// ż of a body that moves with this velocity, in the axes of a leg.
    fn as_speeds(&self, velocity: &Vector3<f64>) -> DVector<f64> {
        let mut speeds = DVector::zeros(self.system.mass.nrows());
        let released = self.system.released.iter().filter(|released| **released).count();
        (0..released).for_each(|k| speeds.rows_mut(6 * k, 3).copy_from(velocity));
        speeds
    }

    /// The amount by which V, V' and the energy of the modes have risen in a leg beyond the work of what is held, J, as it is seen from an
    /// even motion that has gone by `along`; `None` where an element was put elsewhere.
    fn raised(&self, start: &Start, ended: &Motion, felt: &Felt, along: &Vector3<f64>) -> Option<f64> {
        let last = &start.motion;
        let mut raised = felt.energy - start.felt.energy;
        // What moves with it as a whole changes V by the work of loads alone.
        let on_all =
            |slopes: &[PoseSlope]| slopes.iter().map(|slope| slope.translation.dot(along)).sum::<f64>();
        raised -= 0.5 * (on_all(&start.felt.slopes) + on_all(&felt.slopes));
        for e in 0..ended.poses.len() {
            let change = PoseSlope {
                translation: ended.poses[e].translation - last.poses[e].translation - along,
                matrix: ended.poses[e].matrix - last.poses[e].matrix,
            };
            let along = |slope: &PoseSlope| {
                slope.translation.dot(&change.translation) + slope.matrix.dot(&change.matrix)
            };
            if self.system.released[e] {
                raised += along(&self.added[e]);
            } else if self.now.held[e] || ended.poses[e] == last.poses[e] {
                raised -= 0.5 * (along(&start.felt.slopes[e]) + along(&felt.slopes[e]));
            } else {
                return None;
            }
        }
        let of_modes = |motion: &Motion| -> f64 {
            let pairs = motion.places.iter().zip(&self.moving.tables.squares);
            pairs.map(|(q, square)| 0.5 * square * q * q).sum()
        };
        Some(raised + of_modes(ended) - of_modes(last))
    }

    /// Speed with which the mean motion of held elements carries the released ones along in the middle of a leg, and its rate: the speed
    /// that is not damped. `spin` is ω of the leg's axes, in these.
    fn carried_along(&self, leg: &Leg<'_>, spin: &Vector3<f64>) -> [DVector<f64>; 2] {
        let ([out, into], origins) = (leg.matrices(), &self.moving.tables.origins);
        let held = (0..origins.len()).filter(|e| !self.system.released[*e]);
        let count = held.clone().count().max(1) as f64;
        let mean = |poses: &[ControlPose]| -> Vector3<f64> {
            held.clone().map(|e| origins[e] + poses[e].translation).sum::<Vector3<f64>>() / count
        };
        let [begin, end] = [mean(&leg.last.poses), mean(leg.poses)];
        let (velocity, middle, spin_in_body) = ((end - begin) / leg.dt_s, (begin + end) * 0.5, out * spin);
        let mut carried = [0, 1].map(|_| DVector::zeros(self.system.mass.nrows()));
        let released = (0..origins.len()).filter(|e| self.system.released[*e]);
        for (k, e) in released.enumerate() {
            let speed = Vector3::from_column_slice(&leg.last.speeds[FIELDS * e..][..3]);
            let place = origins[e] + leg.last.poses[e].translation + speed * (0.5 * leg.dt_s);
            let about = spin_in_body.cross(&(place - middle));
            carried[0].rows_mut(6 * k, 3).copy_from(&(into * (velocity + about)));
            carried[0].rows_mut(6 * k + 3, 3).copy_from(spin);
            carried[1].rows_mut(6 * k, 3).copy_from(&(into * spin_in_body.cross(&about)));
        }
        carried
    }

    /// The modes with this stiffness of the released elements.
    fn coupled(&self, curvature: &DMatrix<f64>) -> Coupled {
        let (count, squares) = (curvature.nrows(), &self.moving.tables.squares);
        let mut stiffness = DMatrix::zeros(count + squares.len(), count + squares.len());
        stiffness.view_mut((0, 0), curvature.shape()).copy_from(curvature);
        squares.iter().enumerate().for_each(|(k, square)| stiffness[(count + k, count + k)] = *square);
        self.system.coupled.with_stiffness(&stiffness, self.moving.damping)
    }
}
