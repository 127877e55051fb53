//! A rigid piece that meets tools: it lies on them, slides by Coulomb's friction, and does not bounce.
//!
//! In: a piece with its motion, gravity, and tools on their way through the frame. Out: its motion at the end of the frame. In each of
//! several steps, impulses p at the corners that could reach a tool make the velocities there as they must be, one after the other until
//! they agree (projected Gauss–Seidel; M. Anitescu and F. Potra, Nonlinear Dynamics 14, 1997, 231-247):
//!
//! ```text
//! v·n ≥ -φ/dt,   p·n ≥ 0,   |p - n n·p| ≤ μ p·n against the sliding
//! ```
//!
//! φ is the distance of a corner, negative inside, so that nothing is passed within a step. Free flight is exact ([`RigidInertia::flown`]).

use crate::scene::STANDARD_GRAVITY;
use crate::world::flight::{RigidInertia, Twist};
use crate::world::tool::pose_between;
use crate::world::tool_shape::Shape;
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

type V3 = Vector3<f64>;

/// Steps in a frame, and rounds of impulses in each at most: they end when no impulse changes by more than this part of a piece's weight in
/// the step.
const STEPS: usize = 4;
const ROUNDS: usize = 400;
const SETTLED: f64 = 1e-6;
/// Corners that meet one tool at most; those that are deepest.
const MOST: usize = 32;
/// Depth that is left where it is, as a part of a piece's size, and rounds in which deeper corners are moved out.
const SLACK: f64 = 1e-4;
const OUTWARD: usize = 4;

/// Pose and velocity of a piece in the room, with lengths and speeds as the body has them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Pose of its centre of mass.
    #[serde(with = "crate::field::numbers")]
    pub pose: Isometry3<f64>,
    /// m/s and rad/s.
    #[serde(with = "crate::field::numbers")]
    pub velocity: V3,
    #[serde(with = "crate::field::numbers")]
    pub spin: V3,
}

impl Motion {
    pub fn at_rest(pose: Isometry3<f64>) -> Motion {
        Motion { pose, velocity: V3::zeros(), spin: V3::zeros() }
    }

    /// Motion after another one, `by`, has carried the body along.
    pub fn carried(&self, by: &Isometry3<f64>) -> Motion {
        let (velocity, spin) = (by.rotation * self.velocity, by.rotation * self.spin);
        Motion { pose: by * self.pose, velocity, spin }
    }

    /// The even motion that reaches a pose in this time.
    fn towards(&self, pose: &Isometry3<f64>, time_s: f64) -> Motion {
        let way = pose.translation.vector - self.pose.translation.vector;
        let turn = pose.rotation * self.pose.rotation.inverse();
        Motion { pose: self.pose, velocity: way / time_s, spin: turn.scaled_axis() / time_s }
    }

    /// Goes on with the same velocities.
    fn evenly(&self, time_s: f64) -> Motion {
        let place = self.pose.translation.vector + self.velocity * time_s;
        let turn = UnitQuaternion::from_scaled_axis(self.spin * time_s);
        Motion { pose: Isometry3::from_parts(place.into(), turn * self.pose.rotation), ..*self }
    }

    pub fn is_finite(&self) -> bool {
        let Motion { pose, velocity, spin } = self;
        let vectors = [&pose.translation.vector, velocity, spin];
        vectors.iter().all(|v| v.iter().all(|x| x.is_finite()))
            && pose.rotation.coords.iter().all(|x| x.is_finite())
    }
}

/// A piece about its centre of mass.
pub struct Solid {
    pub corners: Vec<V3>,
    /// `None` of a piece without mass, which stays where it is.
    pub inertia: Option<RigidInertia>,
}

/// Cause of a piece's motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// Gravity, m/s².
    Weight(V3),
    /// A hand, which has brought it to this pose by the end of the frame, unless a tool is in the way.
    Hand(Isometry3<f64>),
}

/// A tool and its way through the frame, in the room.
pub struct Obstacle<'a> {
    pub shape: &'a Shape,
    pub from: Isometry3<f64>,
    pub to: Isometry3<f64>,
    pub friction: f64,
}

/// A corner that a tool can be met with.
struct Meeting {
    /// Place from the centre of mass.
    arm: V3,
    normal: V3,
    /// m.
    distance: f64,
    /// Velocity of the tool there, m/s.
    velocity: V3,
    friction: f64,
    impulse: V3,
}

impl Solid {
    /// The motion after a frame of this length.
    pub fn moved(
        &self,
        from: &Motion,
        drive: &Drive,
        (obstacles, scale): (&[Obstacle<'_>], f64),
        dt_s: f64,
    ) -> Motion {
        let Some(inertia) = &self.inertia else {
            return match drive {
                Drive::Weight(_) => *from,
                Drive::Hand(pose) => Motion::at_rest(*pose),
            };
        };
        let mut motion = *from;
        let (step_s, each) = (dt_s / STEPS as f64, 1.0 / STEPS as f64);
        for step in 0..STEPS {
            let ways: Vec<Way<'_>> = obstacles
                .iter()
                .map(|obstacle| Way::new(obstacle, [step as f64 * each, (step + 1) as f64 * each], scale))
                .collect();
            let driven = match drive {
                Drive::Weight(gravity) => Motion { velocity: motion.velocity + gravity * step_s, ..motion },
                Drive::Hand(pose) => motion.towards(pose, step_s * (STEPS - step) as f64),
            };
            motion = self.stepped(&motion, (&driven, drive), (&ways, inertia), step_s);
        }
        motion
    }

    fn stepped(
        &self,
        from: &Motion,
        (driven, drive): (&Motion, &Drive),
        (ways, inertia): (&[Way<'_>], &RigidInertia),
        dt_s: f64,
    ) -> Motion {
        let mut meetings: Vec<Meeting> =
            ways.iter().flat_map(|way| self.meetings(driven, way, dt_s)).collect();
        if meetings.is_empty() {
            return match drive {
                Drive::Weight(gravity) => flown(inertia, from, &(gravity * inertia.mass), dt_s),
                Drive::Hand(_) => driven.evenly(dt_s),
            };
        }
        let mut motion = *driven;
        let turn = motion.pose.rotation.to_rotation_matrix();
        let inverse =
            turn.matrix() * inertia.moments.try_inverse().unwrap_or_default() * turn.matrix().transpose();
        let pull = match drive {
            Drive::Weight(gravity) => gravity.norm(),
            Drive::Hand(_) => STANDARD_GRAVITY,
        };
        let settled = SETTLED * inertia.mass * pull * dt_s;
        for _ in 0..ROUNDS {
            let mut most = 0.0_f64;
            for meeting in &mut meetings {
                let more = meeting.more(&motion, (1.0 / inertia.mass, &inverse), dt_s);
                motion.velocity += more / inertia.mass;
                motion.spin += inverse * meeting.arm.cross(&more);
                most = most.max(more.norm());
            }
            if most <= settled {
                break;
            }
        }
        let mut motion = match drive {
            Drive::Weight(_) => flown(inertia, &motion, &V3::zeros(), dt_s),
            Drive::Hand(_) => motion.evenly(dt_s),
        };
        ways.iter().for_each(|way| self.move_out(&mut motion, way));
        motion
    }

    /// Radius of a ball about its centre of mass.
    fn radius(&self) -> f64 {
        self.corners.iter().map(V3::norm).fold(0.0, f64::max)
    }

    /// The corners that can reach a tool in a step.
    fn meetings(&self, motion: &Motion, way: &Way<'_>, dt_s: f64) -> Vec<Meeting> {
        let radius = self.radius();
        let centre = motion.pose.translation.vector;
        let (away, _) = way.distance(&way.from, &centre);
        let quick = motion.velocity.norm() + motion.spin.norm() * radius + way.velocity(&centre, dt_s).norm();
        let reach = quick * dt_s + SLACK * radius;
        if away > radius + reach {
            return Vec::new();
        }
        let mut meetings: Vec<Meeting> = self
            .corners
            .iter()
            .filter_map(|corner| {
                let arm = motion.pose.rotation * corner;
                let (distance, normal) = way.distance(&way.from, &(centre + arm));
                let velocity = way.velocity(&(centre + arm), dt_s);
                let friction = way.friction;
                let meeting = Meeting { arm, normal, distance, velocity, friction, impulse: V3::zeros() };
                (distance <= reach).then_some(meeting)
            })
            .collect();
        meetings.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        meetings.truncate(MOST);
        meetings
    }

    /// Moves a piece out of a tool without turning it.
    fn move_out(&self, motion: &mut Motion, way: &Way<'_>) {
        let slack = SLACK * self.radius();
        for _ in 0..OUTWARD {
            let centre = motion.pose.translation.vector;
            let place = |corner: &V3| way.distance(&way.to, &(centre + motion.pose.rotation * corner));
            let deepest = self.corners.iter().map(place).min_by(|a, b| a.0.total_cmp(&b.0));
            match deepest {
                Some((distance, normal)) if distance < -slack => {
                    motion.pose.translation.vector -= normal * (distance + slack);
                }
                _ => return,
            }
        }
    }
}

/// A tool in a step, with the piece's lengths.
struct Way<'a> {
    shape: &'a Shape,
    from: Isometry3<f64>,
    to: Isometry3<f64>,
    scale: f64,
    friction: f64,
}

impl<'a> Way<'a> {
    fn new(of: &Obstacle<'a>, [from, to]: [f64; 2], scale: f64) -> Way<'a> {
        let [from, to] = [from, to].map(|share| pose_between(&of.from, &of.to, share));
        Way { shape: of.shape, from, to, scale, friction: of.friction }
    }

    /// φ and ∇φ at a place.
    fn distance(&self, pose: &Isometry3<f64>, x: &V3) -> (f64, V3) {
        let (distance, normal) =
            self.shape.distance(&pose.inverse_transform_point(&Point3::from(x * self.scale)).coords);
        (distance / self.scale, pose.rotation * normal)
    }

    /// Velocity of the tool's point at a place.
    fn velocity(&self, x: &V3, dt_s: f64) -> V3 {
        let own = self.from.inverse_transform_point(&Point3::from(x * self.scale));
        (self.to * own - self.from * own) / (self.scale * dt_s)
    }
}

impl Meeting {
    /// The impulse that is added to make its velocity as it must be. In: 1/m and J⁻¹ in the axes of the room.
    fn more(&mut self, motion: &Motion, (of_mass, inverse): (f64, &Matrix3<f64>), dt_s: f64) -> V3 {
        let cross = self.arm.cross_matrix();
        let yielding = Matrix3::from_diagonal_element(of_mass) - cross * inverse * cross;
        let sliding = motion.velocity + motion.spin.cross(&self.arm) - self.velocity;
        let along = self.normal.dot(&(yielding * self.normal));
        let due = self.distance.max(0.0) / dt_s;
        let before = self.impulse;
        let pressing = (self.normal.dot(&before) - (self.normal.dot(&sliding) + due) / along).max(0.0);
        let across = |x: &V3| x - self.normal * self.normal.dot(x);
        let softest = yielding.trace() / 3.0;
        let rubbing = across(&before) - across(&sliding) / softest;
        let most = self.friction * pressing;
        let rubbing = if rubbing.norm() > most { rubbing.cap_magnitude(most) } else { rubbing };
        self.impulse = self.normal * pressing + rubbing;
        self.impulse - before
    }
}

/// Free flight under a force that is constant in space.
fn flown(inertia: &RigidInertia, from: &Motion, force: &V3, dt_s: f64) -> Motion {
    let turn = from.pose.rotation;
    let into = turn.inverse();
    let twist = Twist { velocity: into * from.velocity, spin: into * from.spin };
    let flight = inertia.flown(&twist, &(into * force), &V3::zeros(), dt_s);
    let place = from.pose.translation.vector + turn * flight.shift;
    Motion {
        pose: Isometry3::from_parts(Translation3::from(place), turn * flight.turn),
        velocity: turn * flight.twist.velocity,
        spin: turn * flight.twist.spin,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, ToolShape};
    use std::path::Path;

    const G: V3 = V3::new(0.0, -9.81, 0.0);
    const FRAME_S: f64 = 1.0 / 60.0;

    /// A brick of 0.2 m × 0.1 m × 0.1 m and 3 kg.
    fn brick() -> Solid {
        let corner = |i: usize| {
            let side = |bit: usize, half: f64| if i & bit == 0 { -half } else { half };
            V3::new(side(1, 0.1), side(2, 0.05), side(4, 0.05))
        };
        let moments = V3::new(0.02, 0.05, 0.05) * (3.0 / 12.0);
        let inertia =
            RigidInertia { mass: 3.0, centre: V3::zeros(), moments: Matrix3::from_diagonal(&moments) };
        Solid { corners: (0..8).map(corner).collect(), inertia: Some(inertia) }
    }

    fn floor() -> Shape {
        let scene = Scene::parse(
            "[body.b]\nmesh = \"b.msh\"\nmaterial = { young = 1.0, poisson = 0.3 }\n[body.b.control]\n\
             a = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n",
            Path::new("s.toml"),
        );
        Shape::new(&scene.unwrap(), "t", &ToolShape::Floor).unwrap()
    }

    /// The brick after so many frames on a plane that is tilted about z; the plane moves at this speed.
    fn after(frames: usize, tilt: f64, friction: f64, start: Motion, speed: V3) -> Motion {
        let (shape, solid) = (floor(), brick());
        let turn = UnitQuaternion::from_axis_angle(&V3::z_axis(), tilt);
        let pose = |frame: usize| Isometry3::from_parts((speed * (frame as f64 * FRAME_S)).into(), turn);
        (0..frames).fold(start, |motion, frame| {
            let way = Obstacle { shape: &shape, from: pose(frame), to: pose(frame + 1), friction };
            solid.moved(&motion, &Drive::Weight(G), (&[way], 1.0), FRAME_S)
        })
    }

    fn lying(tilt: f64) -> Motion {
        let turn = UnitQuaternion::from_axis_angle(&V3::z_axis(), tilt);
        Motion::at_rest(Isometry3::from_parts((turn * V3::new(0.0, 0.05, 0.0)).into(), turn))
    }

    /// A block on an incline: it stays below the angle of friction, and beyond it slides with g (sin φ - μ cos φ).
    #[test]
    fn a_brick_slides_beyond_the_angle_of_friction() {
        let friction: f64 = 0.4;
        for beyond in [-0.5_f64, 0.5] {
            let tilt = friction.atan() + beyond.to_radians();
            let gone = after(120, tilt, friction, lying(tilt), V3::zeros());
            let way = (gone.pose.translation.vector - lying(tilt).pose.translation.vector).norm();
            let expected = 0.5 * 9.81 * (tilt.sin() - friction * tilt.cos()).max(0.0) * 4.0;
            println!("{beyond}°: slid by {way} m of {expected} m");
            assert!((way - expected).abs() < 0.01 * expected + 5e-6, "{beyond}°: {way} m of {expected} m");
        }
    }

    /// A brick that falls onto its corner comes to lie on a face; a platform carries it along and lifts it.
    #[test]
    fn a_brick_lands_and_is_carried() {
        let turn = UnitQuaternion::from_euler_angles(0.6, 0.3, 0.4);
        let start = Motion::at_rest(Isometry3::from_parts(V3::new(0.0, 0.5, 0.0).into(), turn));
        let lies = after(300, 0.0, 0.5, start, V3::zeros());
        let height = lies.pose.translation.y;
        println!("lies {height} m high, at {} m/s and {} rad/s", lies.velocity.norm(), lies.spin.norm());
        let off = [0.05, 0.1].map(|half: f64| (height - half).abs()).into_iter().fold(f64::MAX, f64::min);
        assert!(off < 5e-7 && lies.velocity.norm() < 4e-8 && lies.spin.norm() < 6e-7, "{lies:?}");
        for speed in [V3::new(0.3, 0.0, 0.1), V3::new(0.0, 0.4, 0.0)] {
            let carried = after(120, 0.0, 0.5, lying(0.0), speed);
            let moved = carried.pose.translation.vector - lying(0.0).pose.translation.vector;
            // Friction takes it to the platform's speed within a time of v/(μ g).
            let along = V3::new(speed.x, 0.0, speed.z);
            let expected = speed * 2.0 - along * (along.norm() / (2.0 * 0.5 * 9.81));
            println!("carried by {moved:?}, {expected:?}, {:e} m/s off", (carried.velocity - speed).norm());
            assert!((moved - expected).norm() < 2e-3 && (carried.velocity - speed).norm() < 6e-7, "{moved}");
        }
    }

    /// A brick at 40 m/s would be a meter below the floor in two frames, but it stops there.
    #[test]
    fn nothing_is_passed_within_a_frame() {
        let start = Motion { velocity: V3::new(0.0, -40.0, 0.0), ..lying(0.0) };
        let high = Motion { pose: Translation3::new(0.0, 0.7, 0.0) * start.pose, ..start };
        let stopped = after(10, 0.0, 0.3, high, V3::zeros());
        println!("stopped {:e} m off", stopped.pose.translation.y - 0.05);
        assert!((stopped.pose.translation.y - 0.05).abs() < 7e-11, "{}", stopped.pose.translation);
    }
}
