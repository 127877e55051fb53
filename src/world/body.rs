//! A body at its place in the room: its deformer, the parts of it that a ray can hit, and its colours.

use super::assets::BodyAssets;
use super::body_memory::BodyMemory;
use super::frame::{BodyFrame, StepTimes};
use crate::deform::{Contribution, ControlPose, Deformer, PoseLimiter};
use crate::green::GreenFile;
use crate::interact::{PickShape, PickTarget, control_pose_in_body, room_from_element};
use crate::mesh::Surface;
use crate::scene::{Color, Grab};
use nalgebra::{Matrix4, Point3, Similarity3};
use std::sync::Arc;

/// A body at its place in the room: its assets, its state, and what follows from both.
pub struct PlacedBody {
    pub assets: Arc<BodyAssets>,
    pub deformer: Deformer,
    /// The parts of the control elements that a ray can hit, for the triangles as they are now.
    shapes: Vec<ControlShape>,
    /// The place where it is shown now.
    pub room_from_body: Similarity3<f64>,
    /// One per control element.
    pub(super) limiters: Vec<PoseLimiter>,
    /// Whether it was warned that the range was left.
    range_left: bool,
    /// Number of deformations since the start of the session.
    pub deformations: u64,
    /// Hash of its deformed positions, for this version of its surface ([`Deformer::version`]).
    pub(super) positions_hash: Option<(u64, blake3::Hash)>,
    /// Times of this frame's deformation.
    pub times: StepTimes,
    /// Warnings of this frame.
    pub warnings: Vec<String>,
}

/// The part of a control element that a ray can hit.
struct ControlShape {
    whole: PickShape,
    /// Balls around its surface nodes, for a ray that passes by.
    near: PickShape,
}

impl ControlShape {
    /// The shapes of all control elements.
    fn all(deformer: &Deformer) -> Vec<ControlShape> {
        let surface = Surface {
            triangles: deformer.triangles().to_vec(),
            nodes: (0..deformer.node_count() as u32).collect(),
        };
        let of = |c: usize| ControlShape {
            whole: PickShape::new(&surface, deformer.control_nodes(c)),
            near: PickShape { triangles: Vec::new(), points: deformer.control_nodes(c).to_vec() },
        };
        (0..deformer.controls.len()).map(of).collect()
    }
}

impl PlacedBody {
    /// A body at home, as it was loaded.
    pub(super) fn new(assets: Arc<BodyAssets>, deformer: Deformer, warnings: Vec<String>) -> PlacedBody {
        PlacedBody {
            shapes: ControlShape::all(&deformer),
            room_from_body: assets.home,
            limiters: vec![PoseLimiter::default(); assets.controls.len()],
            range_left: false,
            deformations: 0,
            positions_hash: None,
            times: StepTimes::default(),
            warnings,
            assets,
            deformer,
        }
    }

    /// The transform from the frame in which the deformed surface is computed.
    pub fn room_from_surface(&self) -> Similarity3<f64> {
        self.room_from_body * self.deformer.body_from_surface()
    }

    /// Control element `c` as a target for picking; `near` widens it to balls about its nodes, for rays that narrowly miss.
    pub fn pick_target(&self, c: usize, near: bool) -> PickTarget<'_> {
        let shape = &self.shapes[c];
        PickTarget {
            shape: if near { &shape.near } else { &shape.whole },
            positions: bytemuck::cast_slice(self.deformer.kept_positions()),
            ball_radius_m: (self.assets.passing_m / self.room_from_body.scaling()) as f32,
            room_from_body: self.room_from_surface(),
        }
    }

    /// Surface nodes that picking looks at: those of all control elements.
    pub fn pickable(&self) -> Vec<u32> {
        let of = |c: usize| self.deformer.control_nodes(c).iter().copied();
        let nodes: std::collections::BTreeSet<u32> = (0..self.assets.controls.len()).flat_map(of).collect();
        nodes.into_iter().collect()
    }

    /// The matrix in the room of control element `c` at `pose`.
    pub fn room_from_element(&self, c: usize, pose: &ControlPose) -> Matrix4<f64> {
        let origin = Point3::from(self.deformer.controls[c].origin);
        room_from_element(&self.room_from_body, &origin, &pose.translation, &pose.matrix)
    }

    /// The pose of control element `c` whose matrix in the room is this; `None` where it is not finite.
    pub fn pose_of(&self, c: usize, room_from_element: &Matrix4<f64>) -> Option<ControlPose> {
        let origin = Point3::from(self.deformer.controls[c].origin);
        let (translation, matrix) = control_pose_in_body(room_from_element, &self.room_from_body, &origin)?;
        Some(ControlPose { translation, matrix })
    }

    /// The whole surface as a target for picking; `shape` is [`PlacedBody::whole_shape`], `positions` are those of
    /// the deformer.
    pub fn whole<'a>(&self, shape: &'a PickShape, positions: &'a [[f32; 3]]) -> PickTarget<'a> {
        PickTarget {
            shape,
            positions: bytemuck::cast_slice(positions),
            ball_radius_m: 0.0,
            room_from_body: self.room_from_surface(),
        }
    }

    /// All triangles, made when they are first asked for.
    pub fn whole_shape(&self) -> PickShape {
        PickShape { triangles: self.deformer.triangles().to_vec(), points: Vec::new() }
    }

    /// The memory of the body: all that it keeps from one frame to the next beside its fields.
    pub(super) fn memory(&self) -> BodyMemory {
        BodyMemory {
            room_from_body: self.room_from_body,
            limiters: self.limiters.clone(),
            range_left: self.range_left,
            deformations: self.deformations,
            deformer: self.deformer.snapshot(),
        }
    }

    /// Goes on from the memory of a body of the same scene.
    pub(super) fn set_memory(&mut self, memory: &BodyMemory) -> Result<(), String> {
        let (found, expected) = (memory.limiters.len(), self.limiters.len());
        if found != expected {
            let body = &self.deformer.body;
            return Err(format!("body.{body}: it has {found} control elements, the scene has {expected}"));
        }
        self.deformer.restore(&memory.deformer)?;
        self.shapes = ControlShape::all(&self.deformer);
        self.limiters.clone_from(&memory.limiters);
        self.room_from_body = memory.room_from_body;
        self.range_left = memory.range_left;
        self.deformations = memory.deformations;
        Ok(())
    }

    /// `pose` if a body can follow it after `last`, or what it can follow instead.
    pub(super) fn admit(&mut self, c: usize, last: &ControlPose, pose: &ControlPose) -> ControlPose {
        let (admitted, faults) = self.limiters[c].admit(last, pose);
        for fault in faults {
            let (body, name) = (&self.deformer.body, &self.deformer.controls[c].name);
            self.warnings.push(format!("body.{body}.control.{name}: {}", fault.explain()));
        }
        admitted
    }

    /// Takes what effects add; if that cannot be used, keeps what they added last, with a warning.
    pub(super) fn take_contribution(&mut self, contribution: &Contribution) {
        let before = self.deformer.topology;
        if self.deformer.contribute(contribution) {
            if self.deformer.topology != before {
                self.shapes = ControlShape::all(&self.deformer);
            }
        } else {
            let body = &self.deformer.body;
            self.warnings.push(format!(
                "body.{body}: what its effects add in this frame is not finite or does not fit the body; it keeps what they added last"
            ));
        }
    }

    /// Goes on with another surface and other columns of this body, of whose nodes the first `kept` are the same. Where these do not fit, it
    /// stays as it was, with a warning.
    pub(super) fn remake(&mut self, file: Arc<GreenFile>, kept: usize) {
        match self.deformer.remade(file, kept) {
            Ok(deformer) => {
                let is_partial = self.deformer.is_partial();
                self.deformer = deformer;
                self.shapes = ControlShape::all(&self.deformer);
                if is_partial {
                    let nodes = self.pickable();
                    self.deformer.sum_only_at(nodes);
                }
            }
            Err(message) => self.warnings.push(message),
        }
    }

    /// Says that the body has left the state in which it was for the equilibrium from rest, where it came home so often before.
    pub(super) fn check_path(&mut self, homecomings: u64) {
        if self.deformer.homecomings != homecomings {
            let body = &self.deformer.body;
            self.warnings.push(format!(
                "body.{body}: its state was not the one that hands reach from rest; it has gone back to that one"
            ));
        }
    }

    /// Warns once when a planned body turns farther than its error was measured for.
    pub(super) fn check_range(&mut self) {
        let left = |range: &f64| !self.range_left && self.deformer.largest_turn() > *range;
        if let Some(range) = self.assets.range.filter(left) {
            self.range_left = true;
            let (body, degrees) = (&self.deformer.body, range.to_degrees());
            let warning = format!(
                "body.{body}: turned by more than {degrees:.0}°; the accuracy was measured only up to there"
            );
            self.warnings.push(warning);
        }
    }

    /// sRGB and mark per vertex that is drawn: the body has its colour or shows a field, fixed control elements are grey, and those that can be taken orange,
    /// brighter while a ray points at them and green while a hand holds them.
    pub fn colours(&self, shown: &BodyFrame) -> Vec<[u8; 4]> {
        let Color([r, g, b]) = self.assets.color;
        let plain = || vec![[r, g, b, 0]; self.deformer.node_count()];
        let mut colours = shown.colours.as_ref().map_or_else(plain, |codes| codes.to_vec());
        for (c, (control, highlight)) in self.assets.controls.iter().zip(&shown.highlights).enumerate() {
            let Color([r, g, b]) = match control.grab {
                Grab::Fixed => Color([128, 130, 136]),
                Grab::Dragger => highlight.color(),
            };
            for &vertex in self.deformer.control_nodes(c) {
                colours[vertex as usize] = [r, g, b, 255];
            }
        }
        self.deformer.drawn(colours)
    }
}
