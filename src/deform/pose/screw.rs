//! The way of a control element from rest to a pose: a screw motion and a growing stretch.
//!
//! M = R S with R a rotation and S symmetric; R and T are the screw motion exp(ω, v) in SE(3), and
//!
//! ```text
//! R = exp [ω]    T = V v    V = I + (1 - cos θ)/θ² [ω] + (θ - sin θ)/θ³ [ω]²    θ = |ω| ≤ π
//! ```
//!
//! (Murray, Li and Sastry, A Mathematical Introduction to Robotic Manipulation, section 2.3.) On the straight line in
//! (ω, v, S) no part of the way is flattened, as it is on that in (T, M), and if all control elements move as one rigid
//! body, they do so on the whole way.

use super::frame::{ControlPose, ControlPoses, nearest};
use super::se3::{long_turn, slide_matrix};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// A pose as a screw motion and a stretch; all zero at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Screw {
    /// ω, rad: the shorter turn.
    pub turn: Vector3<f64>,
    /// v, m.
    pub slide: Vector3<f64>,
    /// S - I.
    pub stretch: Matrix3<f64>,
}

impl Screw {
    /// The screw and stretch of a pose; where M is too flat to have a rotation, it is all stretch.
    pub fn from_pose(pose: &ControlPose) -> Screw {
        let is_rotation = (pose.matrix.transpose() * pose.matrix - Matrix3::identity()).amax() < 1e-12;
        let rotation = match nearest(&pose.matrix) {
            // As it stands: the last bits decide which way half a turn goes.
            Some(_) if is_rotation && pose.matrix.determinant() > 0.0 => {
                Rotation3::from_matrix_unchecked(pose.matrix)
            }
            rotation => rotation.unwrap_or_else(Rotation3::identity),
        };
        let turn = UnitQuaternion::from_rotation_matrix(&rotation).scaled_axis();
        // det V = 2 (1 - cos θ)/θ² is at least 4/π².
        let slide = slide_matrix(&turn).lu().solve(&pose.translation).unwrap_or(pose.translation);
        Screw { turn, slide, stretch: rotation.matrix().transpose() * pose.matrix - Matrix3::identity() }
    }

    pub fn pose(&self) -> ControlPose {
        ControlPose {
            translation: slide_matrix(&self.turn) * self.slide,
            matrix: Rotation3::from_scaled_axis(self.turn) * (Matrix3::identity() + self.stretch),
        }
    }

    fn rotation(&self) -> Rotation3<f64> {
        Rotation3::from_scaled_axis(self.turn)
    }

    /// The screw at `share` 0 to 1 of the way to `other`.
    pub fn towards(&self, other: &Screw, share: f64) -> Screw {
        Screw {
            turn: self.turn.lerp(&other.turn, share),
            slide: self.slide.lerp(&other.slide, share),
            stretch: self.stretch * (1.0 - share) + other.stretch * share,
        }
    }
}

/// The way of a control element from one pose to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// The pose that is turned and shifted along the way: R₀ and T₀; rest, where the screws are those of the poses themselves.
    base: ControlPose,
    start: Screw,
    end: Screw,
}

impl Way {
    /// The way between two screws from rest.
    pub fn between(start: Screw, end: Screw) -> Way {
        Way { base: ControlPose::REST, start, end }
    }

    /// The way from the pose `from` onwards, by the shorter turn from there: R = exp(ω) R₀, T = V v + exp(ω) T₀.
    pub fn onwards(from: &ControlPose, to: &ControlPose) -> Way {
        let (before, after) = (Screw::from_pose(from), Screw::from_pose(to));
        let base = ControlPose { translation: from.translation, matrix: *before.rotation().matrix() };
        let matrix = after.rotation() * before.rotation().inverse();
        let translation = to.translation - matrix * from.translation;
        let between = Screw::from_pose(&ControlPose { translation, matrix: *matrix.matrix() });
        let stretched = |stretch, screw: Screw| Screw { stretch, ..screw };
        Way {
            base,
            start: stretched(before.stretch, Screw::default()),
            end: stretched(after.stretch, between),
        }
    }

    /// The pose at `share` 0 to 1 of the way.
    pub fn pose(&self, share: f64) -> ControlPose {
        let screw = self.start.towards(&self.end, share);
        let turn = screw.rotation();
        ControlPose {
            translation: slide_matrix(&screw.turn) * screw.slide + turn * self.base.translation,
            matrix: turn * self.base.matrix * (Matrix3::identity() + screw.stretch),
        }
    }

    /// Turn, rad, slide, m, and change of the stretch from end to end.
    pub fn length(&self) -> (f64, Vector3<f64>, f64) {
        (
            (self.end.turn - self.start.turn).norm(),
            self.end.slide - self.start.slide,
            (self.end.stretch - self.start.stretch).norm(),
        )
    }
}

/// The pose at `share` of a way from rest on which the turn grows to `turn`, of up to 360° by its sign.
pub fn part_of(pose: &ControlPose, turn: &UnitQuaternion<f64>, share: f64) -> ControlPose {
    let stretch = turn.to_rotation_matrix().transpose() * pose.matrix - Matrix3::identity();
    let part = Rotation3::from_scaled_axis(long_turn(turn) * share);
    ControlPose {
        translation: pose.translation * share,
        matrix: part * (Matrix3::identity() + stretch * share),
    }
}

/// The poses at `share` 0 to 1 of a way from rest on which the first control element stands still where it ends, and the others go
/// by screw motions as they are seen from it: no part of the way squeezes a body that is turned or shifted as a whole. `turns` are
/// those of the poses; with their signs they tell turns by up to 360° against the first one.
pub fn from_rest(
    origins: &[Vector3<f64>],
    poses: &[ControlPose],
    turns: &[UnitQuaternion<f64>],
    share: f64,
) -> ControlPoses {
    let (Some(origin), Some(first), Some(base)) = (origins.first(), poses.first(), turns.first()) else {
        return Vec::new();
    };
    let (to_first, from_first) = (base.inverse().to_rotation_matrix(), base.to_rotation_matrix());
    let arms = origins.iter().map(|own| own - origin);
    let way = |((pose, turn), arm): ((&ControlPose, &UnitQuaternion<f64>), Vector3<f64>)| {
        let seen = ControlPose {
            translation: to_first * (arm + pose.translation - first.translation) - arm,
            matrix: to_first * pose.matrix,
        };
        let part = part_by_turn(&seen, &(base.inverse() * turn), share);
        let shift = from_first * (arm + part.translation) - arm;
        ControlPose { translation: first.translation + shift, matrix: from_first * part.matrix }
    };
    poses.iter().zip(turns).zip(arms).map(way).collect()
}

/// The poses at `share` 0 to 1 of a way from rest on which each control element goes by its own screw motion.
pub fn each_from_rest(poses: &[ControlPose], turns: &[UnitQuaternion<f64>], share: f64) -> ControlPoses {
    poses.iter().zip(turns).map(|(pose, turn)| part_by_turn(pose, turn, share)).collect()
}

/// The pose at `share` of the way from rest: by a screw motion, unless the turn's sign says that it is the longer one.
fn part_by_turn(pose: &ControlPose, turn: &UnitQuaternion<f64>, share: f64) -> ControlPose {
    match turn.w < 0.0 {
        true => part_of(pose, turn, share),
        false => Screw::default().towards(&Screw::from_pose(pose), share).pose(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_comes_back_from_its_screw() {
        let stretch = Matrix3::new(0.2, 0.1, -0.05, 0.1, -0.1, 0.15, -0.05, 0.15, 0.1);
        for turn in [[0.0; 3], [1e-5, 0.0, 0.0], [0.009, 0.0, 0.0], [0.4, -1.1, 2.0], [0.0, 3.1, 0.0]] {
            let screw = Screw { turn: turn.into(), slide: Vector3::new(0.3, -2.0, 0.7), stretch };
            let back = Screw::from_pose(&screw.pose());
            let off = (back.turn - screw.turn).amax() + (back.slide - screw.slide).amax();
            assert!(off + (back.stretch - stretch).amax() < 1e-12, "{turn:?}: {back:?}");
        }
    }

    /// Half a turn as a pose file has it, with a sine of 1e-16 whose sign says which way.
    #[test]
    fn half_a_turn_goes_the_way_its_sine_says() {
        for sign in [1.0, -1.0] {
            let matrix = Matrix3::new(-1.0, -sign * 1.2e-16, 0.0, sign * 1.2e-16, -1.0, 0.0, 0.0, 0.0, 1.0);
            let turn = Screw::from_pose(&ControlPose { matrix, ..ControlPose::REST }).turn;
            assert!((turn - Vector3::z() * sign * std::f64::consts::PI).amax() < 1e-15, "{turn}");
        }
    }

    #[test]
    fn elements_that_move_as_one_do_so_on_the_whole_way() {
        let (rotation, shift) =
            (Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 2.0)), Vector3::new(0.3, -2.0, 0.7));
        let part_of = |origin: Vector3<f64>| {
            let pose =
                ControlPose { translation: rotation * origin + shift - origin, matrix: *rotation.matrix() };
            let part = Screw::default().towards(&Screw::from_pose(&pose), 0.3).pose();
            (part.matrix, origin + part.translation - part.matrix * origin)
        };
        let (one, other) = (part_of(Vector3::zeros()), part_of(Vector3::new(1.0, 2.0, -3.0)));
        assert!((one.0 - other.0).amax() < 1e-14 && (one.1 - other.1).amax() < 1e-14, "{one:?} {other:?}");
    }

    /// Half a turn, then half a turn on the same way: not back.
    #[test]
    fn a_way_onwards_ends_at_its_pose_and_does_not_turn_back() {
        let stretch = Matrix3::from_diagonal(&Vector3::new(0.1, 0.0, -0.2));
        let at = |degrees: f64| {
            let turn = Vector3::x() * degrees.to_radians();
            Screw { turn, slide: Vector3::new(0.3, -2.0, 0.7), stretch: stretch * (degrees / 360.0) }.pose()
        };
        for (from, to) in [(0.0, 170.0), (170.0, 340.0), (300.0, 360.0), (100.0, 30.0)] {
            let way = Way::onwards(&at(from), &at(to));
            for (share, end) in [(0.0, from), (1.0, to)] {
                let (pose, end) = (way.pose(share), at(end));
                let off = (pose.matrix - end.matrix).amax() + (pose.translation - end.translation).amax();
                assert!(off < 1e-14, "{from} to {to}: {off:e}");
            }
            assert!((way.length().0 - (to - from).to_radians().abs()).abs() < 1e-14);
            let half = Screw::from_pose(&way.pose(0.5)).turn.x.to_degrees();
            let off = (half - 0.5 * (from + to)).rem_euclid(360.0);
            assert!(off.min(360.0 - off) < 1e-9, "{from} to {to}: {half}°");
        }
    }

    #[test]
    fn a_flat_pose_is_all_stretch() {
        for matrix in [Matrix3::zeros(), Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0))] {
            let pose = ControlPose { matrix, ..ControlPose::REST };
            let back = Screw::from_pose(&pose).pose();
            assert!((back.matrix - matrix).amax() < 1e-14, "{matrix}");
        }
    }
}
