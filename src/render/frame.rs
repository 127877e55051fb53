//! The neutral data of a frame: what is seen (bodies, styli, floor, light) and from where (one view per viewport).
//! All lengths are metres in the room, all colours of [`Look`] and [`Grid`] linear RGB.

use super::{BodyBuffers, Line, Quad};
use nalgebra::{Matrix4, Point3, Vector3};

/// One eye's picture of one screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Off-axis projection times the eye's pose: depth reversed (1 at the near plane, 0 at infinity).
    pub clip_from_room: Matrix4<f32>,
    pub eye_in_room: Point3<f32>,
}

/// A rectangle of a target and what is drawn there: a view, or black when the eye is behind its screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewport {
    /// x, y of the top left pixel, width, height.
    pub rect: [u32; 4],
    pub view: Option<View>,
}

impl Viewport {
    /// One eye over the whole target.
    pub fn full([width, height]: [u32; 2], view: Option<View>) -> [Self; 1] {
        [Self { rect: [0, 0, width, height], view }]
    }
}

/// A body's buffers at a place in the room.
#[derive(Clone, Copy)]
pub struct BodyInstance<'a> {
    pub buffers: &'a BodyBuffers,
    /// A similarity without reflection: rotation, translation and uniform scale.
    pub room_from_body: Matrix4<f32>,
}

/// A pen with its tip at the stylus' origin, pointing along its -Z, and the ray that leaves the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StylusShape {
    pub room_from_stylus: Matrix4<f32>,
    /// Length of the pen in metres; the ray's radius is a hundredth of it, the hit point's radius a twenty-fifth.
    pub size_m: f32,
    /// Where the ray ends when it hits nothing.
    pub ray_length_m: f32,
    /// Where the ray hits, in the room; the ray ends there.
    pub hit: Option<Point3<f32>>,
    /// The middle control point of the ray as a quadratic Bézier curve from the tip to the hit; `None`: straight.
    pub bend: Option<Point3<f32>>,
    /// The button is held: ring, ray and hit point change from green to yellow.
    pub pressed: bool,
}

/// A glowing arrow, as of a force; its head is a third of it, at most eight radii.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrow {
    pub from: Point3<f32>,
    pub along: Vector3<f32>,
    pub radius_m: f32,
    pub color: [f32; 3],
}

/// A horizontal floor of lines to see depth by; every fifth line is stronger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Middle of the rectangle, where two strong lines cross; its y is the floor's height.
    pub center: Point3<f32>,
    /// Half the extent along x and z; the lines fade out towards the ellipse inscribed in it.
    pub half_size: [f32; 2],
    pub spacing: f32,
    pub line_width: f32,
    pub color: [f32; 3],
}

impl Grid {
    /// Lines of 2 % of the spacing in a quiet blue-grey.
    pub fn new(center: Point3<f32>, half_size: [f32; 2], spacing: f32) -> Self {
        Self { center, half_size, spacing, line_width: 0.02 * spacing, color: [0.085, 0.115, 0.16] }
    }
}

/// A lit ball in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    pub center: Point3<f32>,
    pub radius_m: f32,
    pub color: [f32; 3],
}

/// Lights and background, fixed in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Towards the main light, any length but zero.
    pub to_key: Vector3<f32>,
    pub key: [f32; 3],
    /// Towards the weaker light that opens the shadows.
    pub to_fill: Vector3<f32>,
    pub fill: [f32; 3],
    /// Light from above and from below, as it falls on a surface facing it.
    pub sky: [f32; 3],
    pub ground: [f32; 3],
    /// The background straight up, level and straight down.
    pub zenith: [f32; 3],
    pub horizon: [f32; 3],
    pub nadir: [f32; 3],
}

impl Default for Look {
    /// A warm key from the upper left front, a cool fill from the right, a dark blue room.
    fn default() -> Self {
        Self {
            to_key: Vector3::new(-0.62, 0.70, 0.36),
            key: [2.30, 2.14, 1.90],
            to_fill: Vector3::new(0.90, -0.10, 0.40),
            fill: [0.13, 0.18, 0.27],
            sky: [0.22, 0.27, 0.36],
            ground: [0.035, 0.030, 0.030],
            zenith: [0.010, 0.014, 0.024],
            horizon: [0.040, 0.052, 0.076],
            nadir: [0.006, 0.008, 0.012],
        }
    }
}

/// Everything that is drawn into each viewport of a frame.
#[derive(Clone, Copy, Default)]
pub struct FrameContents<'a> {
    pub bodies: &'a [BodyInstance<'a>],
    pub styli: &'a [StylusShape],
    pub arrows: &'a [Arrow],
    pub grid: Option<Grid>,
    pub look: Look,
    /// Lit, as heads and eyes in a picture of the room.
    pub balls: &'a [Ball],
    /// Blended in this order, all before the lines.
    pub quads: &'a [Quad],
    pub lines: &'a [Line],
}
