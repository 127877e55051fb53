//! Navigation: moves, turns and scales the whole scene for inspection, and sets bodies aside.
//!
//! In: the navigating hands, and commands. Out: room_from_scene, a similarity that is applied after every body's own place,
//! and the place at the border of the workspace for each body that is set aside. The bodies' own poses do not change.

use super::carry::{HandMotion, carry, held_line};
use super::ease::{Ease, between};
use nalgebra::{Isometry3, Point3, Similarity3, Translation3, Vector3};
use serde::{Deserialize, Serialize};

/// The smallest and the largest scale of the scene.
pub const SCENE_SCALE: [f64; 2] = [0.01, 100.0];
/// The scene's origin moves no farther from the workspace's centre than this many radii.
const FARTHEST: f64 = 1e3;
/// The radius of a body that is set aside, as a fraction of the workspace's.
pub const ASIDE_SIZE: f64 = 0.2;
/// The angle between the places of bodies that are set aside, on the workspace's border from the lower right upwards, rad.
const ASIDE_STEP: f64 = std::f64::consts::PI / 6.0;

/// A hand that moves the scene, and its pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovingHand {
    pub number: usize,
    #[serde(with = "crate::field::numbers")]
    pub room_from_hand: Isometry3<f64>,
}

/// The scene's place as the user has moved it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Navigation {
    #[serde(with = "crate::field::numbers")]
    pub room_from_scene: Similarity3<f64>,
    #[serde(with = "crate::field::numbers")]
    pub centre: Point3<f64>,
    pub radius_m: f64,
    /// The hands as they were when this part of the navigation began, and the scene then.
    hands: Vec<MovingHand>,
    #[serde(with = "crate::field::numbers")]
    scene_then: Similarity3<f64>,
    /// See [`held_line`].
    #[serde(with = "crate::field::numbers::option")]
    line: Option<Vector3<f64>>,
    /// The motion back to the scene's own place.
    reset: Option<Return>,
}

/// A motion in progress, and the place at which it began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Return {
    ease: Ease,
    #[serde(with = "crate::field::numbers")]
    from: Similarity3<f64>,
}

impl Navigation {
    /// The scene at its own place; `centre` and `radius_m` are the workspace's.
    pub fn new(centre: Point3<f64>, radius_m: f64) -> Self {
        Self {
            room_from_scene: Similarity3::identity(),
            centre,
            radius_m,
            hands: Vec::new(),
            scene_then: Similarity3::identity(),
            line: None,
            reset: None,
        }
    }

    /// Moves the scene rigidly with one hand, and scales it too with two, see [`carry`]: each hand holds the scene by its
    /// tip. True if the scene moved.
    pub fn step(&mut self, hands: &[MovingHand], time_s: f64) -> bool {
        let before = self.room_from_scene;
        if let Some(Return { ease, from }) = self.reset {
            let share = ease.share(time_s);
            self.room_from_scene = between(&from, &Similarity3::identity(), share);
            self.reset = self.reset.filter(|_| share < 1.0);
        }
        let numbers = |hands: &[MovingHand]| hands.iter().map(|hand| hand.number).collect::<Vec<_>>();
        if numbers(hands) != numbers(&self.hands) {
            (self.hands, self.scene_then, self.line) = (hands.to_vec(), self.room_from_scene, None);
            return self.room_from_scene != before;
        }
        let motion = |(then, now): (&MovingHand, &MovingHand)| HandMotion {
            room_from_hand_then: then.room_from_hand,
            room_from_hand_now: now.room_from_hand,
            held_then: then.room_from_hand.translation.vector.into(),
        };
        let motions: Vec<HandMotion> = self.hands.iter().zip(hands).map(motion).collect();
        let motion = carry(&motions, self.line);
        self.line = held_line(&motions, self.line);
        if let Some(motion) = motion {
            self.reset = None;
            self.put(motion * self.scene_then);
        }
        self.room_from_scene != before
    }

    /// Scales the scene about the workspace's centre, as the wheel does.
    pub fn scale(&mut self, factor: f64) {
        let about = Translation3::from(self.centre.coords);
        let scaling =
            Similarity3::from_parts(Translation3::identity(), Default::default(), factor.abs().max(1e-6));
        self.reset = None;
        self.put(about * scaling * about.inverse() * self.room_from_scene);
        self.hands.clear();
    }

    /// Starts the motion back to the scene's own place.
    pub fn reset(&mut self, time_s: f64) {
        if self.room_from_scene != Similarity3::identity() {
            self.reset = Some(Return { ease: Ease::start(time_s), from: self.room_from_scene });
        }
    }

    /// Accepts a place that is finite, near enough and scaled within [`SCENE_SCALE`]; keeps the last one otherwise.
    fn put(&mut self, room_from_scene: Similarity3<f64>) {
        let scale = room_from_scene.scaling();
        let way = room_from_scene * self.centre - self.centre;
        let is_near = way.norm() <= FARTHEST * self.radius_m;
        if is_near && (SCENE_SCALE[0]..=SCENE_SCALE[1]).contains(&scale) {
            self.room_from_scene = room_from_scene;
        }
    }
}

/// Whether a body is set aside, and its motion there or back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Aside {
    pub is_aside: bool,
    moving: Option<Return>,
}

impl Aside {
    /// Starts the motion aside, or back; `room_from_body` is the body's place now.
    pub fn toggle(&mut self, time_s: f64, room_from_body: &Similarity3<f64>) {
        self.is_aside = !self.is_aside;
        self.moving = Some(Return { ease: Ease::start(time_s), from: *room_from_body });
    }

    /// The body's place now, on its way aside or back.
    pub fn place(
        &mut self,
        time_s: f64,
        home: &Similarity3<f64>,
        aside: &Similarity3<f64>,
    ) -> Similarity3<f64> {
        let goal = if self.is_aside { aside } else { home };
        let Some(Return { ease, from }) = self.moving else { return *goal };
        let share = ease.share(time_s);
        self.moving = self.moving.filter(|_| share < 1.0);
        between(&from, goal, share)
    }
}

/// room_from_body of the place aside number `slot` for a body with this middle and radius (body frame, m): its axes
/// along the room's, on the border of the workspace, in the plane that faces the viewer.
pub fn place_aside(
    centre: &Point3<f64>,
    radius_m: f64,
    slot: usize,
    middle_in_body: &Point3<f64>,
    body_radius_m: f64,
) -> Similarity3<f64> {
    let (sin, cos) = (ASIDE_STEP * (slot as f64 - 1.0)).sin_cos();
    let place = centre + Vector3::new(cos, sin, 0.0) * radius_m;
    let scale = ASIDE_SIZE * radius_m / body_radius_m.max(1e-9);
    let shift = place.coords - middle_in_body.coords * scale;
    Similarity3::from_parts(Translation3::from(shift), Default::default(), scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn navigation() -> Navigation {
        Navigation::new(Point3::new(0.0, 1.0, 0.5), 0.35)
    }

    fn pose(x: f64, turn: f64) -> Isometry3<f64> {
        Isometry3::new(Vector3::new(x, 1.2, 0.8), Vector3::y() * turn)
    }

    fn hand(number: usize, x: f64, turn: f64) -> MovingHand {
        MovingHand { number, room_from_hand: pose(x, turn) }
    }

    #[test]
    fn one_hand_carries_the_scene_rigidly_and_two_scale_it() {
        let mut navigation = navigation();
        assert!(!navigation.step(&[hand(0, 0.0, 0.0)], 0.0), "the grab moves nothing");
        assert!(navigation.step(&[hand(0, 0.1, 0.5)], 0.1));
        let expected = pose(0.1, 0.5) * pose(0.0, 0.0).inverse();
        let moved = navigation.room_from_scene;
        assert!((moved.to_homogeneous() - expected.to_homogeneous()).norm() < 1e-12);
        assert!(!navigation.step(&[hand(0, 0.1, 0.5), hand(1, 0.3, 0.0)], 0.2), "nor does the second hand");
        navigation.step(&[hand(0, 0.0, 0.5), hand(1, 0.4, 0.0)], 0.3);
        assert!((navigation.room_from_scene.scaling() - 2.0).abs() < 1e-12);
        assert!(!navigation.step(&[], 0.4), "it stays where it was let go");
    }

    #[test]
    fn the_wheel_scales_about_the_workspaces_centre_within_limits() {
        let mut navigation = navigation();
        navigation.scale(2.0);
        assert!((navigation.room_from_scene * navigation.centre - navigation.centre).norm() < 1e-12);
        for _ in 0..100 {
            navigation.scale(1.5);
        }
        assert!(navigation.room_from_scene.scaling() <= SCENE_SCALE[1]);
        let before = navigation.room_from_scene;
        for bad in [f64::NAN, f64::INFINITY, 0.0] {
            navigation.scale(bad);
        }
        assert_eq!(navigation.room_from_scene, before);
    }

    #[test]
    fn a_reset_ends_exactly_where_the_stage_has_the_scene() {
        let mut navigation = navigation();
        navigation.scale(3.0);
        navigation.reset(1.0);
        assert!(navigation.step(&[], 1.2) && navigation.room_from_scene.scaling() < 3.0);
        navigation.step(&[], 1.4001);
        assert_eq!(navigation.room_from_scene, Similarity3::identity());
        assert!(!navigation.step(&[], 1.5));
    }

    #[test]
    fn a_body_goes_aside_and_comes_back_to_where_home_is_by_then() {
        let home = Similarity3::from_parts(Translation3::identity(), UnitQuaternion::identity(), 2.0);
        let aside = place_aside(&Point3::origin(), 0.35, 0, &Point3::new(5.0, 0.0, 0.0), 1.0);
        let shown = aside * Point3::new(5.0, 0.0, 0.0);
        assert!((shown.coords.norm() - 0.35).abs() < 1e-12 && (aside.scaling() - 0.07).abs() < 1e-12);
        let mut state = Aside::default();
        assert_eq!(state.place(0.0, &home, &aside), home);
        state.toggle(1.0, &home);
        assert_eq!(state.place(1.0, &home, &aside), home);
        let half = state.place(1.2, &home, &aside).scaling();
        assert!(half < 2.0 && half > 0.07);
        assert_eq!(state.place(1.5, &home, &aside), aside);
        let moved_home = Translation3::new(1.0, 0.0, 0.0) * home;
        state.toggle(2.0, &aside);
        assert_eq!(state.place(2.5, &moved_home, &aside), moved_home);
    }
}
