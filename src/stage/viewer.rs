//! The viewer's head and eyes, and rotations that look along a direction.

use nalgebra::{Isometry3, Point3, Rotation3, UnitQuaternion, Vector3};

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Eye {
    Left,
    Right,
    /// Midway between the two, for mono stages and for aiming with the mouse.
    Centre,
}

/// The viewer's head while no tracker reports it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewer {
    /// The head's x axis points to the right ear and -z to where it looks; its origin is midway between the eyes.
    pub room_from_head: Isometry3<f64>,
    /// Inter-pupillary distance in metres.
    pub ipd_m: f64,
}

impl Eye {
    pub const ALL: [Eye; 3] = [Eye::Left, Eye::Right, Eye::Centre];

    /// The eye whose picture is shown instead when the eyes are swapped.
    pub fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            Self::Centre => Self::Centre,
        }
    }

    /// The name for files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Centre => "centre",
        }
    }
}

impl Viewer {
    /// The position of an eye: ±ipd/2 along the head's x axis.
    pub fn eye_in_room(&self, room_from_head: &Isometry3<f64>, eye: Eye) -> Point3<f64> {
        let x = match eye {
            Eye::Left => -self.ipd_m / 2.0,
            Eye::Right => self.ipd_m / 2.0,
            Eye::Centre => 0.0,
        };
        room_from_head * Point3::new(x, 0.0, 0.0)
    }
}

/// The rotation whose -z axis points along `direction`, with x horizontal and y as far upward as possible, then
/// turned by `roll` radians about that -z axis, right-handed. Looking straight up or down, x stays the room's.
/// `None` if the direction has no length or is not finite.
pub fn rotation_towards(direction: &Vector3<f64>, roll: f64) -> Option<UnitQuaternion<f64>> {
    let forward = direction.try_normalize(1e-12).filter(|unit| unit.iter().all(|x| x.is_finite()))?;
    let right = forward.cross(&Vector3::y()).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let axes = [right, right.cross(&forward), -forward];
    let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&axes));
    roll.is_finite().then(|| level * UnitQuaternion::from_axis_angle(&-Vector3::z_axis(), roll))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::Stage;

    #[test]
    fn rotation_towards_any_direction_is_level() {
        for direction in
            [[0.0, -0.5, -1.0], [1.0, 0.0, 0.0], [0.3, 0.9, 0.2], [0.0, 1.0, 0.0], [0.0, -2.0, 0.0]]
        {
            let direction = Vector3::from(direction);
            let rotation = rotation_towards(&direction, 0.0).unwrap();
            assert!((rotation * -Vector3::z() - direction.normalize()).norm() < 1e-12);
            assert!((rotation * Vector3::x()).y.abs() < 1e-12);
            assert!((rotation * Vector3::y()).y > -1e-12);
        }
        assert_eq!(rotation_towards(&Vector3::zeros(), 0.0), None);
        assert_eq!(rotation_towards(&Vector3::new(f64::NAN, 0.0, 1.0), 0.0), None);
        assert_eq!(rotation_towards(&Vector3::x(), f64::INFINITY), None);
    }

    #[test]
    fn roll_turns_about_the_ray() {
        let rotation = rotation_towards(&-Vector3::z(), std::f64::consts::FRAC_PI_2).unwrap();
        // Right-handed about -z: x goes to -y.
        assert!((rotation * Vector3::x() + Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn eyes_lie_half_an_ipd_along_the_heads_x() {
        let stage = Stage::find("cyberstage").unwrap();
        let head = stage.viewer.room_from_head;
        let [left, right] = [Eye::Left, Eye::Right].map(|eye| stage.viewer.eye_in_room(&head, eye));
        assert!((right - left - Vector3::new(0.064, 0.0, 0.0)).norm() < 1e-12);
        assert!((stage.viewer.eye_in_room(&head, Eye::Centre) - Point3::new(0.0, 1.7, 0.4)).norm() < 1e-12);
    }
}
