//! Random poses from a seed, for a body that no script moves.

use crate::base::slide::slide_matrix;
use crate::deform::{ControlPose, ControlPoses, Screw, Way};
use crate::fem::nearest_turn;
use nalgebra::{Rotation3, UnitQuaternion, UnitVector3, Vector3};

/// Random numbers that are the same on every machine (SplitMix64: Steele, Lea and Flood, OOPSLA 2014); every seed gives
/// its own sequence.
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A random number in [0, 1).
    pub fn number(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A vector of length 1; all directions are equally likely.
    pub fn direction(&mut self) -> Vector3<f64> {
        loop {
            let v = Vector3::from_fn(|_, _| 2.0 * self.number() - 1.0);
            let square = v.norm_squared();
            if square > 1e-4 && square <= 1.0 {
                return v / square.sqrt();
            }
        }
    }
}

/// One pose for each of `angles` (rad): every control element but the first turns by that angle about its own random axis and
/// comes to stand where a rod of constant curvature and twist from the first one would carry it, T = ∫₀¹ exp(s θ a×) ds d - d
/// with d the way between their origins at rest, moved on by up to `play` (m) across the chord. Neither stretches the rod: a
/// slender body resists a stretch of some percent so much more than a bend that the force of the bend would be lost beside that
/// of the stretch.
pub fn random(origins: &[Vector3<f64>], angles: &[f64], play: f64, seed: u64) -> Vec<(String, ControlPoses)> {
    let mut random = Random(seed);
    angles
        .iter()
        .map(|&angle| {
            let poses = origins.iter().enumerate().map(|(e, origin)| {
                if e == 0 {
                    return ControlPose::REST;
                }
                let axis = UnitVector3::new_normalize(random.direction());
                let way = origin - origins[0];
                let chord = slide_matrix(&(axis.into_inner() * angle)) * way;
                let translation =
                    chord - way + across(&random.direction(), &chord) * (play * random.number());
                ControlPose { translation, matrix: *Rotation3::from_axis_angle(&axis, angle).matrix() }
            });
            (format!("turned {:.0}°", angle.to_degrees()), poses.collect())
        })
        .collect()
}

/// The largest angle between the rotations of two control elements, rad.
pub fn largest_turn(poses: &[ControlPose]) -> f64 {
    let rotations: Vec<UnitQuaternion<f64>> = poses.iter().map(|pose| nearest_turn(&pose.matrix)).collect();
    let pairs =
        rotations.iter().enumerate().flat_map(|(i, a)| rotations[..i].iter().map(move |b| a.angle_to(b)));
    pairs.fold(0.0, f64::max)
}

/// How far a pose bends and stretches a body of this extent, m: the largest angle between two control elements, rad, and their
/// largest shift against each other as a part of the extent.
fn hardness(poses: &[ControlPose], extent: f64) -> f64 {
    let shifts = poses.iter().flat_map(|a| poses.iter().map(|b| (a.translation - b.translation).norm()));
    largest_turn(poses) + shifts.fold(0.0, f64::max) / extent.max(f64::MIN_POSITIVE)
}

/// Indices of the poses of a body of this extent, m, the hardest one first.
pub fn hardest_first(poses: &[(String, ControlPoses)], extent: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..poses.len()).collect();
    let of = |pose: usize| hardness(&poses[pose].1, extent);
    order.sort_by(|&a, &b| of(b).total_cmp(&of(a)));
    order
}

/// The part of `v` across the direction of `chord`.
fn across(v: &Vector3<f64>, chord: &Vector3<f64>) -> Vector3<f64> {
    chord.try_normalize(f64::MIN_POSITIVE).map_or(*v, |along| v - along * along.dot(v))
}

/// Largest turn of a control element between two poses of [`on_the_way`], rad.
const STEP: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// The poses between rest and `poses` through which a hand brings a body there: a model with its own equilibrium finds it from
/// the last one.
pub fn on_the_way(poses: &[ControlPose]) -> Vec<ControlPoses> {
    let way = |pose: &ControlPose| Way::between(Screw::default(), Screw::from_pose(pose));
    let ways: Vec<Way> = poses.iter().map(way).collect();
    let most = ways.iter().map(|way| way.length().0).fold(0.0, f64::max);
    let steps = (most / STEP).ceil().max(1.0) as usize;
    (1..steps).map(|i| ways.iter().map(|way| way.pose(i as f64 / steps as f64)).collect()).collect()
}

/// The poses of the same affine motions about other origins.
pub fn about_origins(poses: &[ControlPose], from: &[Vector3<f64>], to: &[Vector3<f64>]) -> ControlPoses {
    poses.iter().zip(from).zip(to).map(|((pose, from), to)| pose.with_origin(from, to)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_comes_in_steps_of_ten_degrees() {
        let (_, poses) = random(&[Vector3::zeros(), Vector3::x()], &[0.6], 0.0, 1).remove(0);
        let way = on_the_way(&poses);
        assert_eq!(way.len(), 3, "0.6 rad are 34.4°");
        let turn = |pose: &ControlPose| Rotation3::from_matrix_unchecked(pose.matrix).angle();
        for (i, between) in way.iter().enumerate() {
            assert!((turn(&between[1]) - 0.15 * (i + 1) as f64).abs() < 1e-12);
        }
        assert!(on_the_way(&[ControlPose::REST; 2]).is_empty());
    }

    #[test]
    fn the_same_seed_gives_the_same_poses_and_the_angles_are_kept() {
        let origins = [Vector3::zeros(), Vector3::x(), Vector3::new(1.0, 1.0, 0.0)];
        let still = random(&origins, &[0.5, 1.0], 0.0, 7);
        let poses = random(&origins, &[0.5, 1.0], 0.01, 7);
        assert_eq!(poses, random(&origins, &[0.5, 1.0], 0.01, 7));
        assert_ne!(poses, random(&origins, &[0.5, 1.0], 0.01, 8));
        for ((_, poses), angle) in poses.iter().zip([0.5, 1.0]) {
            assert_eq!(poses[0], ControlPose::REST);
            for pose in &poses[1..] {
                assert!((Rotation3::from_matrix_unchecked(pose.matrix).angle() - angle).abs() < 1e-12);
            }
        }
        // The play moves across the chord.
        for ((_, poses), (_, still)) in poses.iter().zip(&still) {
            for e in 1..origins.len() {
                let shift = poses[e].translation - still[e].translation;
                let chord = origins[e] - origins[0] + still[e].translation;
                assert!(shift.norm() > 1e-4 && shift.dot(&chord).abs() < 1e-12, "{shift} across {chord}");
            }
        }
    }
}
