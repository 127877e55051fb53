//! A body at its place in the room: its deformer, which of its control elements a hand can take, and its colours.

use super::body_memory::BodyMemory;
use super::force_scale::ForceScale;
use super::frame::BodyFrame;
use super::highlight::Highlight;
use super::place;
use super::times::StepTimes;
use crate::base::failure::Failure;
use crate::deform::{Contribution, ControlPose, Deformer, ExpectedErrors, ModelEntry, PoseLimiter};
use crate::green::GreenFile;
use crate::interact::{PickShape, PickTarget, control_pose_in_body, room_from_element};
use crate::mesh::Surface;
use crate::render::Pattern;
use crate::scene::{Body, Color, GRAVITY, Grab, Scene};
use crate::stage::Stage;
use nalgebra::{Matrix4, Point3, Similarity3, Translation3, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

/// How near a ray must pass a node of a control element to take it, as part of the workspace's radius.
const PASSING_BY: f64 = 0.05;

/// So long a frame waits for columns that are solved for when a point is touched.
const PATIENCE: Duration = Duration::from_millis(5);

/// A body at its place in the room.
pub struct PlacedBody {
    pub deformer: Deformer,
    /// Where it is shown now.
    pub room_from_body: Similarity3<f64>,
    /// Where it stands before anybody navigates.
    pub home: Similarity3<f64>,
    /// It has no place of its own.
    pub is_fitted: bool,
    /// Middle and radius of a ball about it at rest, in its frame.
    pub ball: (Point3<f64>, f64),
    /// Per control element: whether a hand can take it, and which part of it a ray can hit.
    pub controls: Vec<PlacedControl>,
    pub model: &'static ModelEntry,
    /// Names of its effects, as in the scene.
    pub effects: Vec<String>,
    color: Color,
    /// Lines and image on the surface.
    pub pattern: Pattern,
    /// Where an effect shows forces: how.
    pub force_scale: Option<ForceScale>,
    /// What errors to expect of it, where that was measured for its model.
    pub expected: Option<ExpectedErrors>,
    /// Nodes of the surface that take forces, where the scene has them touched, and the spring by which.
    pub takes_forces: BTreeSet<u32>,
    pub spring: Option<f64>,
    /// Its first loads are those of gravity.
    pub has_gravity: bool,
    /// Largest turn for which a planned body's error was measured, rad.
    pub range: Option<f64>,
    /// Whether a warning has told that the range was left.
    range_left: bool,
    /// How near a ray must pass a node of a control element that it misses, m in the room.
    passing_m: f64,
    /// How often it was deformed since the start of the session, and what that took in this frame.
    pub deformations: u64,
    /// Of its deformed positions, as its surface was in this version ([`Deformer::version`]).
    pub(super) positions_hash: Option<(u64, blake3::Hash)>,
    pub times: StepTimes,
    /// What went wrong in this frame.
    pub warnings: Vec<String>,
}

pub struct PlacedControl {
    pub grab: Grab,
    pub(super) limiter: PoseLimiter,
    shape: PickShape,
    /// Its surface nodes as balls, for a ray that passes by.
    near: PickShape,
}

/// The turn up to which the error of a planned body was measured, rad, with a tenth to spare; nothing of other bodies.
fn measured_range(file: &GreenFile, body: &str) -> Option<f64> {
    file.meta.bodies.get(body)?.plan.as_ref()?.get("range")?.as_f64().map(|range| 1.1 * range)
}

/// All bodies of a scene at their places.
pub fn place(
    scene: &Scene,
    file: &GreenFile,
    deformers: Vec<Deformer>,
    stage: &Stage,
) -> Result<Vec<PlacedBody>, Failure> {
    let points: Vec<_> = deformers.iter().map(in_mesh).collect();
    let standing: Vec<(&Body, &[Point3<f64>])> =
        scene.body.values().zip(points.iter().map(Vec::as_slice)).collect();
    let places = place::rooms_from_meshes(&standing, stage);
    let place = |(((mut deformer, body), points), room_from_mesh): (((Deformer, &Body), &Vec<_>), &_)| {
        deformer.keep_sharp(body.crease.to_radians());
        deformer.be_patient(PATIENCE);
        let mesh_from_body = Translation3::from(deformer.centre);
        let wrong = place::fault(points, room_from_mesh, stage);
        let home = room_from_mesh * mesh_from_body;
        let ball = ball(&deformer);
        Ok(PlacedBody {
            color: body.color,
            pattern: pattern(scene, body, &deformer)?,
            room_from_body: home,
            home,
            is_fitted: body.place.is_none(),
            ball,
            force_scale: None,
            expected: None,
            controls: placed_controls(&deformer, body.control.values().map(|control| control.grab)),
            model: deformer.entry,
            effects: body.effects.clone(),
            takes_forces: deformer.takes_forces(),
            spring: body.surface_compliance.as_ref().and_then(|of| of.spring),
            has_gravity: deformer.load_metas().first().is_some_and(|load| load.name == GRAVITY),
            range: measured_range(file, &deformer.body),
            range_left: false,
            passing_m: PASSING_BY * stage.workspace.radius_m,
            deformations: 0,
            positions_hash: None,
            times: StepTimes::default(),
            warnings: [wrong.map(|wrong| ("place", wrong)), body.held_by().map(|how| ("control", how))]
                .into_iter()
                .flatten()
                .map(|(key, message)| format!("body.{}.{key}: {message}", deformer.body))
                .collect(),
            deformer,
        })
    };
    deformers.into_iter().zip(scene.body.values()).zip(&points).zip(&places).map(place).collect()
}

impl PlacedBody {
    /// From the frame in which the deformed surface stands.
    pub fn room_from_surface(&self) -> Similarity3<f64> {
        self.room_from_body * self.deformer.body_from_surface()
    }

    /// Control element `c` as a target for picking; `near` widens it to balls about its nodes, for rays that narrowly miss.
    pub fn pick_target(&self, c: usize, near: bool) -> PickTarget<'_> {
        let control = &self.controls[c];
        PickTarget {
            shape: if near { &control.near } else { &control.shape },
            positions: bytemuck::cast_slice(self.deformer.kept_positions()),
            ball_radius_m: (self.passing_m / self.room_from_body.scaling()) as f32,
            room_from_body: self.room_from_surface(),
        }
    }

    /// Surface nodes that picking looks at: those of all control elements.
    pub fn pickable(&self) -> Vec<u32> {
        let of = |c: usize| self.deformer.control_nodes(c).iter().copied();
        let nodes: std::collections::BTreeSet<u32> = (0..self.controls.len()).flat_map(of).collect();
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

    /// What it keeps from one frame to the next beside its fields.
    pub(super) fn memory(&self) -> BodyMemory {
        BodyMemory {
            room_from_body: self.room_from_body,
            limiters: self.controls.iter().map(|control| control.limiter).collect(),
            range_left: self.range_left,
            deformations: self.deformations,
            deformer: self.deformer.snapshot(),
        }
    }

    /// Goes on from what a body of the same scene kept.
    pub(super) fn set_memory(&mut self, memory: &BodyMemory) -> Result<(), String> {
        let (found, expected) = (memory.limiters.len(), self.controls.len());
        if found != expected {
            let body = &self.deformer.body;
            return Err(format!("body.{body}: it has {found} control elements, the scene has {expected}"));
        }
        self.deformer.restore(&memory.deformer)?;
        for (control, limiter) in self.controls.iter_mut().zip(&memory.limiters) {
            control.limiter = *limiter;
        }
        self.room_from_body = memory.room_from_body;
        self.range_left = memory.range_left;
        self.deformations = memory.deformations;
        Ok(())
    }

    /// `pose` if a body can follow it after `last`, or what it can follow instead.
    pub(super) fn admit(&mut self, c: usize, last: &ControlPose, pose: &ControlPose) -> ControlPose {
        let (admitted, faults) = self.controls[c].limiter.admit(last, pose);
        for fault in faults {
            let (body, name) = (&self.deformer.body, &self.deformer.controls[c].name);
            self.warnings.push(format!("body.{body}.control.{name}: {}", fault.explain()));
        }
        admitted
    }

    /// Takes what effects add; what cannot be used is left out, and told.
    pub(super) fn take_contribution(&mut self, contribution: &Contribution) {
        if !self.deformer.contribute(contribution) {
            let body = &self.deformer.body;
            self.warnings.push(format!(
                "body.{body}: what its effects add in this frame is no finite number; it keeps what they added last"
            ));
        }
    }

    /// Warns once when a planned body turns farther than its error was measured for.
    pub(super) fn check_range(&mut self) {
        let left = |range: &f64| !self.range_left && self.deformer.largest_turn() > *range;
        if let Some(range) = self.range.filter(left) {
            self.range_left = true;
            let (body, degrees) = (&self.deformer.body, range.to_degrees());
            let warning = format!(
                "body.{body}: control elements turn by more than {degrees:.0}° against each other; the accuracy \
                 that the scene asks for was measured only up to there"
            );
            self.warnings.push(warning);
        }
    }

    /// sRGB and mark per vertex that is drawn: the body has its colour or shows a field, fixed control elements are grey, and those that can be taken orange,
    /// brighter while a ray points at them and green while a hand holds them.
    pub fn colours(&self, shown: &BodyFrame) -> Vec<[u8; 4]> {
        let Color([r, g, b]) = self.color;
        let plain = || vec![[r, g, b, 0]; self.deformer.node_count()];
        let mut colours = shown.colours.as_ref().map_or_else(plain, |codes| codes.to_vec());
        for (c, (control, highlight)) in self.controls.iter().zip(&shown.highlights).enumerate() {
            let [r, g, b] = match (control.grab, highlight) {
                (Grab::Fixed, _) => [128, 130, 136],
                (Grab::Dragger, Highlight::Idle) => [224, 138, 52],
                (Grab::Dragger, Highlight::Hovered) => [255, 186, 96],
                (Grab::Dragger, Highlight::Held) => [170, 214, 84],
            };
            for &vertex in self.deformer.control_nodes(c) {
                colours[vertex as usize] = [r, g, b, 255];
            }
        }
        self.deformer.drawn(colours)
    }
}

fn placed_controls(deformer: &Deformer, grabs: impl Iterator<Item = Grab>) -> Vec<PlacedControl> {
    let surface = Surface {
        triangles: deformer.triangles().to_vec(),
        nodes: (0..deformer.node_count() as u32).collect(),
    };
    grabs
        .enumerate()
        .map(|(c, grab)| PlacedControl {
            grab,
            limiter: PoseLimiter::default(),
            shape: PickShape::new(&surface, deformer.control_nodes(c)),
            near: PickShape { triangles: Vec::new(), points: deformer.control_nodes(c).to_vec() },
        })
        .collect()
}

/// Lowest and highest corner of the body at rest.
fn extent(deformer: &Deformer) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let corners = deformer.rest().iter().map(|x| Vector3::from(*x).cast::<f64>());
    corners.map(|x| (x, x)).reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))
}

/// A ball about the body at rest.
fn ball(deformer: &Deformer) -> (Point3<f64>, f64) {
    let Some((low, high)) = extent(deformer) else {
        return (Point3::origin(), 1.0);
    };
    (Point3::from((low + high) / 2.0), (high - low).norm() / 2.0)
}

/// The surface at rest in the mesh's frame.
fn in_mesh(deformer: &Deformer) -> Vec<Point3<f64>> {
    let point = |x: &[f32; 3]| Point3::from(Vector3::from(*x).cast::<f64>() + deformer.centre);
    deformer.rest().iter().map(point).collect()
}

/// The lines and the image that the scene asks for, about the middle of the body at rest.
fn pattern(scene: &Scene, body: &Body, deformer: &Deformer) -> Result<Pattern, Failure> {
    let (low, high) = extent(deformer).unwrap_or_default();
    let longest = (high - low).max();
    let image = scene.load_texture(&deformer.body, body)?;
    let size = body.texture.as_ref().and_then(|texture| texture.size).unwrap_or(longest / 2.0);
    Ok(Pattern {
        middle: ((low + high) / 2.0).cast().into(),
        line_spacing_m: body.lines.spacing(longest).map(|spacing| spacing as f32),
        image: image.map(|image| (Arc::new(image), size as f32)),
    })
}
