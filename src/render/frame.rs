//! The neutral data of a frame: the visible things, whatever pass draws them. The point of view is that of the views of a
//! [`super::Picture`]. All lengths are metres in the room, all colours of [`Lighting`] and [`Grid`] linear RGB.

use super::body_buffers::BodyBuffers;
use super::lighting::Lighting;
use crate::base::plates::Plate;
use crate::base::strips::Strips;
use nalgebra::{Matrix4, Point3, Vector3};
use std::sync::Arc;

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
    /// Length of the ray when it hits nothing, m.
    pub ray_length_m: f32,
    /// The point that the ray hits, in the room; the ray ends there.
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
    /// Shown through whatever stands before it.
    pub through: bool,
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

/// One parallelogram, as it lies in the buffer. Its front is where `right`, `up` turn counter-clockwise.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Quad {
    pub corner: [f32; 3],
    pub right: [f32; 3],
    pub up: [f32; 3],
    /// Linear RGB and opacity.
    pub front: [f32; 4],
    pub back: [f32; 4],
}

/// One line, as it lies in the buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Line {
    pub from: [f32; 3],
    pub to: [f32; 3],
    /// Linear RGB and opacity.
    pub color: [f32; 4],
    pub width_px: f32,
    /// 1 where it lies over everything, 0 where what is nearer hides it.
    pub over: f32,
}

impl Line {
    pub fn new(from: Point3<f64>, to: Point3<f64>, color: [f32; 4], width_px: f32) -> Self {
        Self { from: from.cast().into(), to: to.cast().into(), color, width_px, over: 0.0 }
    }
}

/// The surface of a [`Ghost`] or a [`Formed`] solid; it is uploaded once, as long as somebody holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct GhostShape {
    /// Positions in the shape's frame, m, and unit normals.
    pub positions: Vec<[f32; 3]>,
    pub normals: Vec<[f32; 3]>,
    /// Counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl GhostShape {
    /// Whether there is something to draw, and each triangle and vertex has what belongs to it.
    pub(super) fn is_whole(&self) -> bool {
        let vertices = self.positions.len();
        let is_known = |node: &u32| (*node as usize) < vertices;
        self.normals.len() == vertices
            && !self.triangles.is_empty()
            && self.triangles.iter().flatten().all(is_known)
    }
}

/// A shape that stands translucent in the room, as a body at rest beside the body as it is.
#[derive(Clone, Debug)]
pub struct Ghost {
    pub shape: Arc<GhostShape>,
    pub room_from_shape: Matrix4<f32>,
    /// Linear RGB, and the opacity of its outline.
    pub color: [f32; 4],
    /// Opacity of the ghost where a body hides it, as a part of the ghost's, 0 to 1.
    pub through: f32,
}

/// A solid of any form, opaque and lit.
#[derive(Clone, Debug)]
pub struct Formed {
    pub shape: Arc<GhostShape>,
    pub room_from_shape: Matrix4<f32>,
    /// Linear RGB.
    pub color: [f32; 3],
}

/// One thing that is drawn beside the bodies; of those of one kind, the first in the list is drawn first.
///
/// Solids (styli, arrows, balls, formed ones) stand among the bodies; then come ghosts, quads, lines and strips, blended in this order.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "a frame has a few dozen of them")]
pub enum Drawable {
    Stylus(StylusShape),
    Arrow(Arrow),
    /// Lit, as heads and eyes in a picture of the room.
    Ball(Ball),
    Formed(Formed),
    Ghost(Ghost),
    Quad(Quad),
    Lines(Vec<Line>),
    /// Strips with their own shader.
    Strips(Strips),
    /// Written over the finished picture, by whoever presents it.
    Plate(Plate),
}

/// Everything that is drawn into each viewport of a frame.
#[derive(Clone, Copy, Default)]
pub struct FrameContents<'a> {
    pub bodies: &'a [BodyInstance<'a>],
    /// Drawables of the frame, and those that its presenter adds.
    pub drawables: [&'a [Drawable]; 2],
    pub grid: Option<Grid>,
    pub lighting: Lighting,
}

/// Methods that return a drawable as one kind.
macro_rules! kinds {
    ($($name:ident: $kind:ident => $of:ty),*) => {
        impl Drawable {
            $(pub fn $name(&self) -> Option<&$of> {
                match self {
                    Drawable::$kind(it) => Some(it),
                    _ => None,
                }
            })*
        }
    };
}

kinds! {
    stylus: Stylus => StylusShape,
    arrow: Arrow => Arrow,
    ball: Ball => Ball,
    formed: Formed => Formed,
    ghost: Ghost => Ghost,
    quad: Quad => Quad,
    lines: Lines => Vec<Line>,
    strips: Strips => Strips,
    plate: Plate => Plate
}

impl<'a> FrameContents<'a> {
    /// All drawables of a kind, such as [`Drawable::ball`].
    pub(super) fn all<T>(
        &self,
        kind: fn(&'a Drawable) -> Option<&'a T>,
    ) -> impl Iterator<Item = &'a T> + use<'a, T> {
        self.drawables.into_iter().flatten().filter_map(kind)
    }
}
