//! One frame, from what the trackers say to what is drawn: draggers, control poses, deformed bodies, eyes.
//!
//! In: a scene, its .green file, a stage, and a [`TrackerState`] per frame. Out: deformed bodies at their places,
//! styli with their rays, and one view per screen and eye. It knows no window and no device.

use super::failure::Failure;
use super::plan;
use super::session;
use crate::deform::{ControlPose, Deformer, PoseGuard};
use crate::green::GreenFile;
use crate::interact::{
    Dragger, Hit, PickRay, PickShape, PickTarget, control_pose_in_body, pick, room_from_element,
};
use crate::mesh::Surface;
use crate::render::{Grid, StylusShape, View};
use crate::scene::{Grab, Place, Scene};
use crate::stage::{Eye, Stage};
use crate::track::{HeldPose, StylusState, TrackerState};
use nalgebra::{Isometry3, Matrix4, Point3, Similarity3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

/// A ray or a view nearer to the eye than this is cut off, m.
const NEAR_M: f64 = 0.05;

/// How near a ray must pass a node of a control element to take it, as part of the workspace's radius.
const PASSING_BY: f64 = 0.05;

/// All that moves.
pub struct World {
    pub stage: Stage,
    pub bodies: Vec<PlacedBody>,
    pub room_from_head: Isometry3<f64>,
    /// What each stylus looks like in this frame.
    pub styli: Vec<StylusShape>,
    head: HeldPose,
    grips: Vec<Grip>,
    /// Why a screen is black or a pose was not taken: what was told already.
    told: BTreeSet<String>,
}

/// A body at its place in the room.
pub struct PlacedBody {
    pub deformer: Deformer,
    pub room_from_body: Similarity3<f64>,
    /// Per control element: can it be taken, what of it can be hit, and what its colour tells now.
    pub controls: Vec<PlacedControl>,
    guard: PoseGuard,
    /// Largest turn for which a planned body's error was measured, rad.
    range: Option<f64>,
    /// Deformed, or coloured anew, since it was last uploaded.
    pub moved: bool,
    pub recolour: bool,
}

pub struct PlacedControl {
    grab: Grab,
    shape: PickShape,
    /// Its surface nodes as balls, for a ray that passes by.
    near: PickShape,
    mood: Mood,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mood {
    Idle,
    Hovered,
    Held,
}

#[derive(Default)]
struct Grip {
    dragger: Dragger,
    /// The place that was hit at the grab, in the stylus' frame.
    hit_in_stylus: Option<Point3<f64>>,
}

/// Time of the mechanics of one frame, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepTimes {
    /// Pick rays and draggers.
    pub interact_s: f64,
    pub deform_s: f64,
    pub normals_s: f64,
}

impl World {
    pub fn new(scene: &Scene, file: &Arc<GreenFile>, stage: Stage) -> Result<World, Failure> {
        let deformers = session::deformers(scene, file)?;
        let fitted = fit(scene, &deformers, &stage);
        let bodies = deformers
            .into_iter()
            .zip(scene.body.values())
            .map(|(deformer, body)| {
                let mesh_from_body = Translation3::from(deformer.centre);
                let room_from_mesh = body.place.as_ref().map_or(fitted, placed);
                PlacedBody {
                    room_from_body: room_from_mesh * mesh_from_body,
                    controls: placed_controls(&deformer, body.control.values().map(|control| control.grab)),
                    range: plan::range(file, &deformer.body),
                    guard: PoseGuard::default(),
                    moved: true,
                    recolour: true,
                    deformer,
                }
            })
            .collect();
        Ok(World {
            room_from_head: stage.viewer.room_from_head,
            bodies,
            styli: Vec::new(),
            head: HeldPose::default(),
            grips: Vec::new(),
            told: BTreeSet::new(),
            stage,
        })
    }

    /// Moves everything to what the trackers say: draggers first, then every body whose poses changed.
    pub fn step(&mut self, state: &TrackerState) -> StepTimes {
        let started = Instant::now();
        if let Some(head) = &state.head {
            self.head.update(head);
        }
        self.room_from_head = self.head.last.unwrap_or(self.stage.viewer.room_from_head);
        let mut poses: Vec<Vec<ControlPose>> =
            self.bodies.iter().map(|body| body.deformer.poses.clone()).collect();
        let mut moods: Vec<Vec<Mood>> =
            self.bodies.iter().map(|body| vec![Mood::Idle; body.controls.len()]).collect();
        self.grips.resize_with(state.styli.len(), Grip::default);
        let mut grips = std::mem::take(&mut self.grips);
        self.styli = state
            .styli
            .iter()
            .zip(&mut grips)
            .filter_map(|(stylus, grip)| self.follow(stylus, grip, &mut poses, &mut moods))
            .collect();
        self.grips = grips;
        let mut times = StepTimes { interact_s: started.elapsed().as_secs_f64(), ..Default::default() };
        for ((body, poses), moods) in self.bodies.iter_mut().zip(&poses).zip(moods) {
            let (poses, faults) = body.guard.admit(poses);
            for (control, fault) in faults {
                let name = &body.deformer.controls[control].name;
                if self.told.insert(format!("{} {name} {fault:?}", body.deformer.body)) {
                    eprintln!("note: body.{}.control.{name}: {}", body.deformer.body, fault.explain());
                }
            }
            if let Some(range) = body.range.take_if(|range| plan::largest_turn(&poses) > *range) {
                eprintln!(
                    "note: body.{}: control elements turn by more than {:.0}° against each other, for which the accuracy \
                     asked for was not measured",
                    body.deformer.body,
                    range.to_degrees()
                );
            }
            if body.deformer.evaluate(&poses).is_some() {
                body.moved = true;
                times.deform_s += body.deformer.times.deform_s;
                times.normals_s += body.deformer.times.normals_s;
            }
            for (control, mood) in body.controls.iter_mut().zip(moods) {
                body.recolour |= control.mood != mood;
                control.mood = mood;
            }
        }
        times
    }

    /// Every stylus lets go of what it holds.
    pub fn let_go(&mut self) {
        self.grips.clear();
    }

    /// Lets go of everything and puts every body back to rest.
    pub fn reset(&mut self) {
        self.let_go();
        for body in &mut self.bodies {
            body.deformer.evaluate(&vec![ControlPose::REST; body.controls.len()]);
            body.guard = PoseGuard::default();
            body.moved = true;
        }
    }

    /// Distance from the first stylus to what it points at, for the mouse to grab there.
    pub fn hit_distance_m(&self) -> Option<f64> {
        let stylus = self.styli.first()?;
        let hit: Point3<f64> = stylus.hit?.cast();
        let eye = self.stage.viewer.eye_in_room(&self.room_from_head, Eye::Centre);
        Some((hit - eye).norm())
    }

    /// One stylus: what it points at or holds, and the new pose of that control element.
    fn follow(
        &self,
        stylus: &StylusState,
        grip: &mut Grip,
        poses: &mut [Vec<ControlPose>],
        moods: &mut [Vec<Mood>],
    ) -> Option<StylusShape> {
        let targets = self.targets();
        let was_held = grip.dragger.held().is_some();
        let hit =
            PickRay::from_stylus(stylus).filter(|_| !was_held).and_then(|ray| self.pick(&ray, &targets));
        let matrix = |target: usize| {
            let (b, c) = targets[target];
            self.room_from_element(b, c, &poses[b][c])
        };
        let drag = grip.dragger.update(stylus, hit.as_ref(), matrix);
        let room_from_stylus = grip.dragger.stylus.last?;
        let target = drag.map(|drag| drag.target).or(hit.map(|hit| hit.target));
        if let Some(drag) = drag {
            let (b, c) = targets[drag.target];
            if !was_held {
                grip.hit_in_stylus =
                    hit.map(|hit| room_from_stylus.inverse() * hit.point_in_room.cast::<f64>());
            }
            if let Some(pose) = self.pose_of(b, c, &drag.room_from_element) {
                poses[b][c] = pose;
            }
        }
        if let Some((b, c)) = target.map(|target| targets[target]) {
            moods[b][c] = if drag.is_some() { Mood::Held } else { Mood::Hovered };
        }
        let place = match drag {
            Some(_) => grip.hit_in_stylus.map(|point| room_from_stylus * point),
            None => hit.map(|hit| hit.point_in_room.cast()),
        };
        Some(self.stylus_shape(stylus, &room_from_stylus, place, drag.is_some()))
    }

    /// All control elements that can be taken, as (body, control element).
    fn targets(&self) -> Vec<(usize, usize)> {
        let of = |(b, body): (usize, &PlacedBody)| {
            let takable = body.controls.iter().enumerate().filter(|(_, c)| c.grab == Grab::Dragger);
            takable.map(move |(c, _)| (b, c)).collect::<Vec<_>>()
        };
        self.bodies.iter().enumerate().flat_map(of).collect()
    }

    /// What the ray hits, or else what it passes within a hand's aim: the end of a tube is hard to hit from the side.
    fn pick(&self, ray: &PickRay, targets: &[(usize, usize)]) -> Option<Hit> {
        let among = |shape: fn(&PlacedControl) -> &PickShape| {
            let shapes: Vec<PickTarget> = targets
                .iter()
                .map(|&(b, c)| {
                    let body = &self.bodies[b];
                    let radius_m = PASSING_BY * self.stage.workspace.radius_m / body.room_from_body.scaling();
                    PickTarget {
                        shape: shape(&body.controls[c]),
                        positions: bytemuck::cast_slice(&body.deformer.positions),
                        ball_radius_m: radius_m as f32,
                        room_from_body: body.room_from_surface(),
                    }
                })
                .collect();
            pick(ray, &shapes)
        };
        among(|control| &control.shape).or_else(|| among(|control| &control.near))
    }

    fn room_from_element(&self, b: usize, c: usize, pose: &ControlPose) -> Matrix4<f64> {
        let body = &self.bodies[b];
        let origin = Point3::from(body.deformer.controls[c].origin);
        room_from_element(&body.room_from_body, &origin, &pose.translation, &pose.matrix)
    }

    fn pose_of(&self, b: usize, c: usize, room_from_element: &Matrix4<f64>) -> Option<ControlPose> {
        let body = &self.bodies[b];
        let origin = Point3::from(body.deformer.controls[c].origin);
        let (translation, matrix) = control_pose_in_body(room_from_element, &body.room_from_body, &origin)?;
        Some(ControlPose { translation, matrix })
    }

    /// How a stylus is drawn. One that starts at the eye would be seen end-on: its pen is drawn as held in the right
    /// hand instead, pointing at the same place.
    fn stylus_shape(
        &self,
        stylus: &StylusState,
        room_from_stylus: &Isometry3<f64>,
        hit: Option<Point3<f64>>,
        pressed: bool,
    ) -> StylusShape {
        let reach = 3.0 * self.stage.workspace.radius_m;
        let size_m = 0.45 * self.stage.workspace.radius_m;
        let mut shown = *room_from_stylus;
        let mut ray_length_m = reach;
        if stylus.from_eye {
            let eye = shown.translation.vector;
            let to_workspace = (self.stage.workspace.centre.coords - eye).norm();
            let aim = hit.unwrap_or(shown * Point3::new(0.0, 0.0, -to_workspace));
            let hand = self.stage.workspace.radius_m;
            let hand =
                shown * Point3::new(0.9 * hand, -0.9 * hand, -(to_workspace - 1.4 * hand).max(0.5 * hand));
            if let Some(rotation) = crate::stage::rotation_towards(&(aim - hand), 0.0) {
                shown = Isometry3::from_parts(Translation3::from(hand.coords), rotation);
                ray_length_m = (aim - hand).norm();
            }
        }
        StylusShape {
            room_from_stylus: shown.to_homogeneous().cast(),
            size_m: size_m as f32,
            ray_length_m: ray_length_m as f32,
            hit: hit.map(|point| point.cast()),
            bend: None,
            pressed,
        }
    }

    /// The view of every screen for `eye`; `None` where that screen stays black. Why is said once.
    pub fn view(&mut self, screen: usize, eye: Eye) -> Option<View> {
        let place = self.stage.viewer.eye_in_room(&self.room_from_head, eye);
        match self.stage.screens[screen].view(&place, NEAR_M) {
            Ok(view) => Some(View { clip_from_room: view.clip_from_room, eye_in_room: view.eye_in_room }),
            Err(unseen) => {
                let key = format!("{screen} {eye:?} {:?}", std::mem::discriminant(&unseen));
                if self.told.insert(key) {
                    eprintln!("note: {} eye: {unseen}", eye.name());
                }
                None
            }
        }
    }

    /// The floor grid of the stage.
    pub fn grid(&self) -> Option<Grid> {
        self.stage.grid.map(|grid| {
            let centre = self.stage.workspace.centre;
            let centre = Point3::new(centre.x, grid.height_m, centre.z).cast::<f32>();
            let half = grid.half_size_m as f32;
            Grid::new(centre, [half, half], half / 8.0)
        })
    }
}

impl PlacedBody {
    /// From the frame in which the deformed surface stands.
    pub fn room_from_surface(&self) -> Similarity3<f64> {
        self.room_from_body * self.deformer.displacements.body_from_surface
    }

    /// sRGB and mark per vertex: a quiet blue body, grey elements that are fixed, orange ones that can be taken,
    /// brighter under the ray and green in the hand.
    pub fn colours(&self) -> Vec<[u8; 4]> {
        let mut colours = vec![[96, 142, 186, 0]; self.deformer.positions.len()];
        for (c, control) in self.controls.iter().enumerate() {
            let [r, g, b] = match (control.grab, control.mood) {
                (Grab::Fixed, _) => [128, 130, 136],
                (Grab::Dragger, Mood::Idle) => [224, 138, 52],
                (Grab::Dragger, Mood::Hovered) => [255, 186, 96],
                (Grab::Dragger, Mood::Held) => [170, 214, 84],
            };
            for &vertex in self.deformer.control_nodes(c) {
                colours[vertex as usize] = [r, g, b, 255];
            }
        }
        colours
    }
}

fn placed_controls(deformer: &Deformer, grabs: impl Iterator<Item = Grab>) -> Vec<PlacedControl> {
    let surface = Surface {
        triangles: deformer.triangles().to_vec(),
        nodes: (0..deformer.positions.len() as u32).collect(),
    };
    grabs
        .enumerate()
        .map(|(c, grab)| PlacedControl {
            grab,
            shape: PickShape::new(&surface, deformer.control_nodes(c)),
            near: PickShape { triangles: Vec::new(), points: deformer.control_nodes(c).to_vec() },
            mood: Mood::Idle,
        })
        .collect()
}

fn placed(place: &Place) -> Similarity3<f64> {
    Similarity3::from_parts(
        Translation3::from(Vector3::from(place.position)),
        UnitQuaternion::from_scaled_axis(Vector3::from(place.rotation)),
        place.scale,
    )
}

/// room_from_mesh that fits all bodies without a place of their own, together, into the stage's workspace.
fn fit(scene: &Scene, deformers: &[Deformer], stage: &Stage) -> Similarity3<f64> {
    let unplaced = deformers.iter().zip(scene.body.values()).filter(|(_, body)| body.place.is_none());
    let mut corners = unplaced.flat_map(|(deformer, _)| {
        deformer.rest().iter().map(|x| Point3::from(Vector3::from(*x).cast::<f64>() + deformer.centre))
    });
    let Some(first) = corners.next() else {
        return Similarity3::identity();
    };
    let (low, high) = corners.fold((first, first), |(low, high), x| (low.inf(&x), high.sup(&x)));
    stage.workspace.room_from_body(low, high).unwrap_or_else(Similarity3::identity)
}

#[cfg(test)]
mod tests;
