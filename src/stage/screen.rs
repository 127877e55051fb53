//! One screen and what an eye sees on it.
//!
//! In: three corners in the room and the place of an eye. Out: [`EyeView`], the off-axis projection of that eye
//! onto that screen. From R. Kooima, "Generalized Perspective Projection" (2008), with reversed depth and no
//! far plane.

use nalgebra::{Matrix4, Point3, Vector3, matrix};

/// An eye closer than this to a screen's plane gets no picture, m: the projection would magnify f32's rounding beyond a
/// pixel, and the glass fills the whole field of view anyway.
pub const MIN_EYE_DISTANCE_M: f64 = 0.01;
/// Distance of the near plane of all views of the stage, m.
pub const NEAR_M: f64 = 0.05;

/// The largest coordinate of a room, a head or a stylus, m; larger ones come from a fault or another unit.
pub const ROOM_LIMIT_M: f64 = 1000.0;

/// A rectangular screen. Corners in metres, in the room's frame, named as its viewer sees the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Screen {
    pub name: String,
    pub lower_left: Point3<f64>,
    pub lower_right: Point3<f64>,
    pub upper_left: Point3<f64>,
    /// Columns and rows of the picture.
    pub pixels: [u32; 2],
}

/// The pyramid from an eye through a screen's four edges, cut at `near`: Kooima's l, r, b, t and n, in metres,
/// in the axes right, up, normal of the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    pub left: f64,
    pub right: f64,
    pub bottom: f64,
    pub top: f64,
    pub near: f64,
}

/// The projection of one eye's picture on one screen, for the renderer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyeView {
    /// Room to clip space: x right, y up, both -w..w over the screen; depth z/w = near/distance along the
    /// screen's normal, hence 1 at the near plane and 0 at infinity (compare with `Greater`, clear to 0).
    pub clip_from_room: Matrix4<f32>,
    pub eye_in_room: Point3<f32>,
    pub near_m: f32,
}

/// The reason why an eye gets no picture on a screen, which then stays black.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unseen {
    #[error("screen `{screen}` stays black: the eye is {:.3} m behind its plane", -distance_m)]
    Behind { screen: String, distance_m: f64 },
    #[error(
        "screen `{screen}` stays black: the eye is {distance_m:.4} m from its plane, nearer than {MIN_EYE_DISTANCE_M} m"
    )]
    TooNear { screen: String, distance_m: f64 },
    #[error(
        "screen `{screen}` stays black: the eye's place {eye:?} is not within {ROOM_LIMIT_M} m of the room"
    )]
    Lost { screen: String, eye: [f64; 3] },
}

impl Screen {
    pub fn width_m(&self) -> f64 {
        (self.lower_right - self.lower_left).norm()
    }

    pub fn height_m(&self) -> f64 {
        (self.upper_left - self.lower_left).norm()
    }

    pub fn upper_right(&self) -> Point3<f64> {
        self.lower_right + (self.upper_left - self.lower_left)
    }

    /// Counter-clockwise from the lower left, as the viewer sees them.
    pub fn corners(&self) -> [Point3<f64>; 4] {
        [self.lower_left, self.lower_right, self.upper_right(), self.upper_left]
    }

    /// Unit vectors right, up and normal; right-handed, the normal towards the viewer. Up is made perpendicular
    /// to right, so that a screen whose measured corners are skewed within the tolerance keeps a lower edge
    /// that is exact.
    pub fn axes(&self) -> [Vector3<f64>; 3] {
        let right = (self.lower_right - self.lower_left).normalize();
        let normal = right.cross(&(self.upper_left - self.lower_left)).normalize();
        [right, normal.cross(&right), normal]
    }

    /// Width and height of a pixel in metres.
    pub fn pixel_size_m(&self) -> [f64; 2] {
        [self.width_m() / f64::from(self.pixels[0]), self.height_m() / f64::from(self.pixels[1])]
    }

    /// Distance of a point to the screen's plane in metres; negative behind it.
    pub fn distance_m(&self, point: &Point3<f64>) -> f64 {
        (point - self.lower_left).dot(&self.axes()[2])
    }

    /// Distance of a point to the nearest point of the picture, m.
    pub fn away_m(&self, point: &Point3<f64>) -> f64 {
        (point - self.nearest(point)).norm()
    }

    /// The point of the picture that is nearest to a point.
    pub fn nearest(&self, point: &Point3<f64>) -> Point3<f64> {
        let ([right, up, _], from_corner) = (self.axes(), point - self.lower_left);
        let along = |axis: Vector3<f64>, side_m: f64| axis * from_corner.dot(&axis).clamp(0.0, side_m);
        self.lower_left + along(right, self.width_m()) + along(up, self.height_m())
    }

    /// The point on the screen with these normalised device coordinates (x right, y up, -1..1), metres in the room.
    pub fn point(&self, ndc: [f64; 2]) -> Point3<f64> {
        self.lower_left
            + (self.lower_right - self.lower_left) * ((ndc[0] + 1.0) / 2.0)
            + (self.upper_left - self.lower_left) * ((ndc[1] + 1.0) / 2.0)
    }

    /// Angles in radians that the screen's middle row and middle column span, seen from `eye`.
    pub fn field_of_view(&self, eye: &Point3<f64>) -> [f64; 2] {
        let angle = |from: [f64; 2], to: [f64; 2]| (self.point(from) - eye).angle(&(self.point(to) - eye));
        [angle([-1.0, 0.0], [1.0, 0.0]), angle([0.0, -1.0], [0.0, 1.0])]
    }

    /// The frustum of an eye at distance d before the screen:
    ///
    /// l = right·(lower_left - eye)·n/d, and so on for r, b and t.
    ///
    /// The near distance n is `near_limit_m`, but at most d/4, so that a body before the glass is still drawn
    /// when the head comes close, and at least d/1000. With reversed floating-point depth this costs no precision.
    pub fn frustum(&self, eye: &Point3<f64>, near_limit_m: f64) -> Result<Frustum, Unseen> {
        let screen = || self.name.clone();
        let [right, up, _] = self.axes();
        let in_room = |coordinate: &f64| coordinate.abs() <= ROOM_LIMIT_M;
        if !eye.iter().all(in_room) {
            return Err(Unseen::Lost { screen: screen(), eye: eye.coords.into() });
        }
        let distance_m = self.distance_m(eye);
        if distance_m <= 0.0 {
            return Err(Unseen::Behind { screen: screen(), distance_m });
        }
        if distance_m < MIN_EYE_DISTANCE_M {
            return Err(Unseen::TooNear { screen: screen(), distance_m });
        }
        let near = near_limit_m.min(distance_m / 4.0).max(distance_m / 1000.0);
        let scale = near / distance_m;
        Ok(Frustum {
            left: right.dot(&(self.lower_left - eye)) * scale,
            right: right.dot(&(self.lower_right - eye)) * scale,
            bottom: up.dot(&(self.lower_left - eye)) * scale,
            top: up.dot(&(self.upper_left - eye)) * scale,
            near,
        })
    }

    /// The view of an eye on this screen, or why there is none.
    ///
    /// Clip = P · rows(right, up, normal) · translate(-eye), computed in f64 and rounded to f32 at the end.
    pub fn view(&self, eye: &Point3<f64>, near_limit_m: f64) -> Result<EyeView, Unseen> {
        let frustum = self.frustum(eye, near_limit_m)?;
        let [right, up, normal] = self.axes();
        let screen_from_room = matrix![
            right.x, right.y, right.z, -right.dot(&eye.coords);
            up.x, up.y, up.z, -up.dot(&eye.coords);
            normal.x, normal.y, normal.z, -normal.dot(&eye.coords);
            0.0, 0.0, 0.0, 1.0];
        Ok(EyeView {
            clip_from_room: (frustum.projection() * screen_from_room).cast(),
            eye_in_room: eye.cast(),
            near_m: frustum.near as f32,
        })
    }
}

impl Frustum {
    /// Perspective projection with reversed depth and an infinite far plane, for a clip space of depth 0..1.
    pub fn projection(&self) -> Matrix4<f64> {
        let Frustum { left: l, right: r, bottom: b, top: t, near: n } = *self;
        matrix![
            2.0 * n / (r - l), 0.0, (r + l) / (r - l), 0.0;
            0.0, 2.0 * n / (t - b), (t + b) / (t - b), 0.0;
            0.0, 0.0, 0.0, n;
            0.0, 0.0, -1.0, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The CyberStage's front wall.
    fn front() -> Screen {
        Screen {
            name: "front".to_owned(),
            lower_left: Point3::new(-1.5, 0.0, -1.5),
            lower_right: Point3::new(1.5, 0.0, -1.5),
            upper_left: Point3::new(-1.5, 2.4, -1.5),
            pixels: [1280, 1024],
        }
    }

    fn project(view: &EyeView, point: Point3<f64>) -> [f64; 3] {
        let clip = view.clip_from_room * point.cast::<f32>().to_homogeneous();
        [0, 1, 2].map(|i| f64::from(clip[i] / clip.w))
    }

    #[test]
    fn cyberstage_front_wall_has_the_reference_frustum() {
        let eye = Point3::new(0.4, 1.7, 0.2);
        let frustum = front().frustum(&eye, 0.1).unwrap();
        let Frustum { left, right, bottom, top, near } = frustum;
        let expected = [-0.1117647, 0.0647059, -0.1, 0.0411765, 0.1];
        for (got, want) in [left, right, bottom, top, near].into_iter().zip(expected) {
            assert!((got - want).abs() < 1e-7, "{got} is not {want}");
        }
        let depth_at_wall = project(&front().view(&eye, 0.1).unwrap(), Point3::new(0.3, 0.7, -1.5))[2];
        assert!((depth_at_wall - 0.058824).abs() < 1e-6, "{depth_at_wall}");
    }

    #[test]
    fn depth_is_one_at_the_near_plane_and_zero_at_infinity() {
        let eye = Point3::new(0.4, 1.7, 0.2);
        let view = front().view(&eye, 0.1).unwrap();
        assert!((project(&view, eye + Vector3::new(0.0, 0.0, -0.1))[2] - 1.0).abs() < 1e-5);
        assert!(project(&view, eye + Vector3::new(0.0, 0.0, -1e6))[2] < 2e-7);
    }

    #[test]
    fn corners_land_on_the_corners_of_the_picture() {
        let screen = front();
        let view = screen.view(&Point3::new(-0.9, 0.3, 1.1), 0.1).unwrap();
        for (corner, x, y) in [
            (screen.lower_left, -1.0, -1.0),
            (screen.lower_right, 1.0, -1.0),
            (screen.upper_left, -1.0, 1.0),
            (screen.upper_right(), 1.0, 1.0),
        ] {
            let ndc = project(&view, corner);
            assert!((ndc[0] - x).abs() < 1e-6 && (ndc[1] - y).abs() < 1e-6, "{corner}: {ndc:?}");
        }
    }

    #[test]
    fn the_near_plane_shrinks_as_the_eye_comes_close() {
        let near = |z: f64| front().frustum(&Point3::new(0.0, 1.0, z), 0.1).map(|frustum| frustum.near);
        assert_eq!(near(0.5), Ok(0.1));
        assert!((near(-1.4).unwrap() - 0.025).abs() < 1e-12);
        assert!((near(-1.48).unwrap() - 0.005).abs() < 1e-12);
    }

    #[test]
    fn no_picture_from_in_or_behind_the_plane_and_it_says_why() {
        let unseen = |z: f64| front().view(&Point3::new(0.0, 1.0, z), 0.1).unwrap_err();
        assert!(matches!(unseen(-1.5), Unseen::Behind { .. }));
        assert!(matches!(unseen(-1.495), Unseen::TooNear { .. }));
        assert!(matches!(unseen(f64::NAN), Unseen::Lost { .. }));
        assert!(matches!(unseen(f64::INFINITY), Unseen::Lost { .. }));
        assert!(matches!(unseen(1e300), Unseen::Lost { .. }));
        let text = unseen(-2.25).to_string();
        assert_eq!(text, "screen `front` stays black: the eye is 0.750 m behind its plane");
    }

    #[test]
    fn an_unusable_near_limit_still_gives_a_usable_near_plane() {
        let eye = Point3::new(0.0, 1.0, 0.5);
        for limit in [f64::NAN, -1.0, 0.0, f64::INFINITY] {
            let near = front().frustum(&eye, limit).unwrap().near;
            assert!((0.002..=0.5).contains(&near), "limit {limit} gave {near}");
        }
    }

    #[test]
    fn a_point_behind_the_glass_has_uncrossed_parallax_and_one_before_it_crossed() {
        let screen = front();
        let [left, right] = [-0.032, 0.032].map(|x| screen.view(&Point3::new(x, 1.7, 0.4), 0.1).unwrap());
        let parallax = |z: f64| {
            let point = Point3::new(0.2, 1.1, z);
            project(&right, point)[0] - project(&left, point)[0]
        };
        // Similar triangles: parallax = ipd·(1 - d/w), in units of half the screen's width.
        assert!((parallax(-3.4) - 0.064 * 0.5 / 1.5).abs() < 1e-6);
        assert!((parallax(-0.55) + 0.064 / 1.5).abs() < 1e-6);
        assert!(parallax(-1.5).abs() < 1e-6);
    }

    /// The near plane is where it is asked for, but at most at a quarter of the eye's distance and at least at a thousandth.
    #[test]
    fn the_near_plane_lies_between_a_thousandth_and_a_quarter() {
        let eye = Point3::new(0.0, 1.2, 0.5);
        for (asked_m, expected_m) in [(0.1, 0.1), (0.6, 0.5), (1e-5, 2e-3), (0.0, 2e-3)] {
            let near = front().frustum(&eye, asked_m).unwrap().near;
            assert!((near - expected_m).abs() < 1e-12, "{asked_m}: {near}");
        }
    }

    #[test]
    fn the_nearest_place_lies_on_the_screen_beyond_each_of_its_sides() {
        for (point, nearest) in [
            ([0.3, 0.7, 2.0], [0.3, 0.7, -1.5]),
            ([2.5, 3.4, -1.5], [1.5, 2.4, -1.5]),
            ([-2.5, -1.0, 0.5], [-1.5, 0.0, -1.5]),
        ] {
            let (point, nearest) = (Point3::from(point), Point3::from(nearest));
            assert!((front().nearest(&point) - nearest).norm() < 1e-12, "{}", front().nearest(&point));
            assert!((front().away_m(&point) - (point - nearest).norm()).abs() < 1e-12);
        }
    }
}
