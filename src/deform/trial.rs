//! Trials of a body: motions of one of its control elements whose static equilibrium is known, and how far a model is from it.
//!
//! In: the [`Statics`] of a [`Truth`], which element moves, [`Motion`]s. Out: [`Trial`]s, and the [`Deviation`] of a [`Deformer`]
//! in each: force and torque as parts of the largest wrench, energy over energy, shape over length.

use super::deformer::Deformer;
use super::model::ModelEntry;
use super::models::large_strain_law_of;
use super::pose::frame::{ControlPose, ControlPoses, Wrench};
use super::pose::se3::slide_matrix;
use super::statics::{EquilibriumResult, HeldBody, Statics, StaticsError};
use crate::base::statistics::median;
use crate::fem::TET10;
use crate::green::{self, GreenError, Precomputed};
use crate::scene::Scene;
use crate::solve::{Progress, Solver};
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Serialize;
use std::f64::consts::PI;
use std::time::Instant;

/// Direction about which a control element is turned, along the axis towards it, the axis about which it is bent, and the third
/// perpendicular to both: (1, 0, 0) twists it, (0, 1, 0) bends it.
pub type Direction = [i8; 3];

/// Motion of one control element against the others, which rest, along an axis towards it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Bend along a circular arc that keeps its length, °.
    Bend(f64),
    /// Twist about the axis, °.
    Twist(f64),
    /// Turn about a direction, °, along an arc or a helix that keeps its length.
    Turn(Direction, f64),
    /// Shift by parts of the length, along and across.
    Shift([f64; 2]),
    /// Turned across the axis, °, and shifted across it.
    Mixed(f64, f64),
    /// Bend along a circular arc, °, and shift along its chord by a part of the chord: pulled, or pressed where it is negative.
    BentAndPulled(f64, f64),
}

impl Motion {
    pub fn name(self) -> String {
        match self {
            Motion::Bend(degrees) => format!("bent by {degrees}°"),
            Motion::Twist(degrees) => format!("twisted by {degrees}°"),
            Motion::Turn([0, 0, 1], degrees) => format!("bent aside by {degrees}°"),
            Motion::Turn([1, 1, 1], degrees) => format!("bent and twisted by {degrees}°"),
            Motion::Turn([0, b, c], degrees) => format!("bent by {degrees}° about ({b}, {c})"),
            Motion::Turn([a, b, c], degrees) => {
                format!("bent and twisted by {degrees}° about ({a}, {b}, {c})")
            }
            Motion::Shift([0.0, across]) => format!("across by {} %", 100.0 * across),
            Motion::Shift([along, _]) => format!("along by {} %", 100.0 * along),
            Motion::Mixed(degrees, across) => {
                format!("turned by {degrees}°, aside by {} %", 100.0 * across)
            }
            Motion::BentAndPulled(degrees, along) => {
                format!("bent by {degrees}°, along its chord by {} %", 100.0 * along)
            }
        }
    }

    /// This share of the way from rest.
    pub fn part(self, share: f64) -> Motion {
        match self {
            Motion::Bend(degrees) => Motion::Bend(share * degrees),
            Motion::Twist(degrees) => Motion::Twist(share * degrees),
            Motion::Turn(about, degrees) => Motion::Turn(about, share * degrees),
            Motion::Shift(parts) => Motion::Shift(parts.map(|part| share * part)),
            Motion::Mixed(degrees, across) => Motion::Mixed(share * degrees, share * across),
            Motion::BentAndPulled(degrees, along) => Motion::BentAndPulled(share * degrees, share * along),
        }
    }

    /// Whether `other` goes on where this motion ends.
    fn leads_to(self, other: Motion) -> bool {
        match (self, other) {
            (Motion::Bend(from), Motion::Bend(to)) | (Motion::Twist(from), Motion::Twist(to)) => {
                from * to > 0.0 && (to - from).abs() < 180.0
            }
            (Motion::Turn(about, from), Motion::Turn(to_about, to)) => {
                about == to_about && from * to > 0.0 && (to - from).abs() < 180.0
            }
            _ => false,
        }
    }
}

/// A control element that is moved in trials: the axis from the mean origin of the others to its own, and their distance.
#[derive(Clone, Debug, PartialEq)]
pub struct Moved {
    pub element: usize,
    pub elements: usize,
    pub axis: Vector3<f64>,
    /// Direction about which it is bent and turned, and along which it is shifted; perpendicular to the axis.
    pub across: Vector3<f64>,
    /// m.
    pub length: f64,
}

impl Moved {
    /// A control element for trials; `None` where there are no others, or their mean origin is too near its own to fix an axis,
    /// as it is for one between two others.
    pub fn new(origins: &[Vector3<f64>], element: usize) -> Option<Moved> {
        let others = origins.iter().enumerate().filter(|(e, _)| *e != element).map(|(_, origin)| origin);
        let mean = others.sum::<Vector3<f64>>() / (origins.len() - 1) as f64;
        let way = origins[element] - mean;
        let (length, elements) = (way.norm(), origins.len());
        let centre = origins.iter().sum::<Vector3<f64>>() / elements as f64;
        let size = origins.iter().map(|origin| (origin - centre).norm()).fold(f64::MIN_POSITIVE, f64::max);
        (length > 0.1 * size && length.is_finite()).then(|| {
            let axis = way / length;
            let across = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
            Moved { element, elements, axis, across, length }
        })
    }

    /// This control element, bent about another direction, as far as that is perpendicular to the axis.
    pub fn about(self, across: Vector3<f64>) -> Moved {
        let across = across - self.axis * self.axis.dot(&across);
        Moved { across: across.try_normalize(1e-9).unwrap_or(self.across), ..self }
    }

    /// The axis, the direction across it, and the third one, about which a [`Direction`] turns.
    pub fn directions(&self) -> Matrix3<f64> {
        Matrix3::from_columns(&[self.axis, self.across, self.across.cross(&self.axis)])
    }

    /// The poses of all control elements.
    pub fn poses(&self, motion: Motion) -> ControlPoses {
        let mut poses = vec![ControlPose::REST; self.elements];
        poses[self.element] = self.pose(motion);
        poses
    }

    fn pose(&self, motion: Motion) -> ControlPose {
        let Moved { axis, across, length, .. } = self;
        let lateral = across.cross(axis);
        let turned = |about: Vector3<f64>, degrees: f64| {
            *Rotation3::from_scaled_axis(about * degrees.to_radians()).matrix()
        };
        // Along an arc in the plane of the axis and `to`.
        let bent = |degrees: f64, about: Vector3<f64>, to: Vector3<f64>| match degrees.to_radians() {
            0.0 => (Vector3::zeros(), Matrix3::identity()),
            angle => {
                let end = (axis * angle.sin() + to * (1.0 - angle.cos())) / angle;
                ((end - axis) * *length, turned(about, degrees))
            }
        };
        let (translation, matrix) = match motion {
            Motion::Bend(degrees) => bent(degrees, *across, lateral),
            Motion::Twist(degrees) => (Vector3::zeros(), turned(*axis, degrees)),
            Motion::Turn(about, degrees) => {
                let about = (self.directions() * Vector3::from(about.map(f64::from))).normalize();
                let end = slide_matrix(&(about * degrees.to_radians())) * axis;
                ((end - axis) * *length, turned(about, degrees))
            }
            Motion::Shift([along, aside]) => ((axis * along + across * aside) * *length, Matrix3::identity()),
            Motion::Mixed(degrees, aside) => (lateral * (aside * *length), turned(*across, degrees)),
            Motion::BentAndPulled(degrees, along) => {
                let (translation, matrix) = bent(degrees, *across, lateral);
                (translation + (axis * *length + translation) * along, matrix)
            }
        };
        ControlPose { translation, matrix }
    }
}

/// An error of force and torque that is small enough for most work.
pub const GOOD: f64 = 0.05;

/// A motion and its equilibrium.
pub struct Trial {
    pub moved: Moved,
    pub motion: Motion,
    pub poses: ControlPoses,
    pub settled: EquilibriumResult,
}

/// Solves the motions one after the other; a bend or twist goes on from the one before where it is of the same kind, so that
/// turns add up; where that one has no equilibrium, neither is it solved. `told` is called for motions without an equilibrium,
/// and for those that turn tetrahedra inside out, which have an equilibrium only where the law resists that. `progress` is advanced by 1000 for each motion.
pub fn trials(
    statics: &mut Statics,
    moved: &Moved,
    motions: &[Motion],
    progress: &dyn Progress,
    told: &mut dyn FnMut(Motion, String),
) -> Result<Vec<Trial>, StaticsError> {
    let mut found = Vec::new();
    let mut last: Option<(Motion, HeldBody)> = None;
    let mut lost: Option<Motion> = None;
    for &motion in motions {
        if let Some(before) = lost.filter(|before| before.leads_to(motion)) {
            told(motion, format!("no equilibrium on the way, where it is {}", before.name()));
            lost = Some(motion);
            progress.advance(1000);
            continue;
        }
        let poses = moved.poses(motion);
        let solved = match last.take().filter(|(before, _)| before.leads_to(motion)) {
            Some((before, held)) => statics.solve_after(&before.name(), &held, &poses, progress),
            None => statics.solve(&poses, progress),
        };
        match solved {
            Ok(settled) if !settled.inverted.is_empty() && !statics.law().resists_inversion => {
                lost = Some(motion);
                told(motion, format!("{} tetrahedra turn inside out", settled.inverted.len()));
            }
            Ok(settled) => {
                if !settled.inverted.is_empty() {
                    told(
                        motion,
                        format!("in equilibrium {} tetrahedra are inside out", settled.inverted.len()),
                    );
                }
                last = statics.held().cloned().map(|held| (motion, held));
                found.push(Trial { moved: moved.clone(), motion, poses, settled });
            }
            Err(StaticsError::Stopped { share, critical, .. }) => {
                let way = 100.0 * share;
                let how = critical.map(|critical| format!(": {critical}")).unwrap_or_default();
                lost = Some(motion);
                told(motion, format!("no equilibrium beyond {way:.0} % of the way there{how}"));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(found)
}

/// The equilibrium that errors are measured against, at large strain under the law of the body's model. Another reference is another
/// variant: all comparisons solve it here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// The body's own element on its own mesh: discretisation has no part in the errors.
    SameMesh,
    /// tet10: of linear elements on the same mesh, of quadratic ones on the mesh refined once more.
    Finer,
}

impl Truth {
    /// The body ready to be held in any pose; it is factorised, whatever solver the scene names.
    pub fn statics(
        self,
        scene: &Scene,
        name: &str,
        progress: &dyn Progress,
    ) -> Result<Statics, StaticsError> {
        let mut scene = scene.clone();
        let body = &mut scene.body[name];
        body.solver = Solver::default();
        if self == Truth::Finer {
            body.refine += u32::from(body.element.order > 1);
            body.element = &TET10;
        }
        let law = large_strain_law_of(&body.model);
        Statics::new(&scene, name, law, progress)
    }
}

/// The body as a session has it, from a .green file that is gone afterwards; the inner error says why it does not suit the model.
pub fn in_session(
    made: &Precomputed,
    model: &'static ModelEntry,
) -> Result<Result<Deformer, String>, GreenError> {
    Ok(Deformer::new(green::opened(std::slice::from_ref(made))?, &made.name, model))
}

/// A body in one pose, by a model or in equilibrium: what is compared.
pub struct PoseResult {
    /// Wrenches about the places of the control elements; `None` if the model has no forces.
    pub wrenches: Option<Vec<Wrench>>,
    /// Strain energy less the work of the loads, J; 0 if the model has no forces.
    pub energy: f64,
    /// Displacements of the surface nodes, m.
    pub surface: Vec<Vector3<f64>>,
}

impl PoseResult {
    /// A model's result in the poses that the deformer has evaluated, at all of its surface nodes.
    pub fn of_model(deformer: &Deformer) -> PoseResult {
        let held = deformer.wrenches();
        let energy = held.as_ref().map_or(0.0, |(_, energy)| *energy);
        let placed = |(wrench, pose): (&Wrench, &ControlPose)| wrench.about_the_place(pose);
        let wrenches = held.map(|(all, _)| all.iter().zip(&deformer.poses).map(placed).collect());
        let surface = (0..deformer.node_count()).map(|i| deformer.displacement(i)).collect();
        PoseResult { wrenches, energy, surface }
    }

    /// An equilibrium at these nodes of its mesh.
    pub fn of_equilibrium(settled: &EquilibriumResult, poses: &[ControlPose], nodes: &[usize]) -> PoseResult {
        let surface = nodes.iter().map(|&node| settled.displacement[node]).collect();
        PoseResult { wrenches: Some(settled.balance(poses)), energy: settled.energy, surface }
    }
}

/// Deviation of a model from static equilibrium.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Deviation {
    /// Largest error of a control element's force, and of its torque over the length, as parts of the largest force or
    /// torque over length of the equilibrium; `None` where the model says that it has none.
    pub force: Option<f64>,
    pub torque: Option<f64>,
    /// V over that of the equilibrium; `None` too where that stores none.
    pub energy: Option<f64>,
    /// Root mean square of the surface nodes' errors, as a part of the length.
    pub shape: f64,
}

impl Deviation {
    /// Compares two results at the same nodes, each about the places of its own control elements.
    pub fn new(model: &PoseResult, truth: &PoseResult, length: f64) -> Deviation {
        let apart = model.surface.iter().zip(&truth.surface).map(|(a, b)| (a - b).norm_squared());
        let shape = (apart.sum::<f64>() / model.surface.len().max(1) as f64).sqrt() / length;
        let held = truth.wrenches.as_deref().unwrap_or_default();
        let sizes = held.iter().map(|w| w.force.norm().max(w.moment.norm() / length));
        let size = sizes.fold(f64::MIN_POSITIVE, f64::max);
        let off = |of: &dyn Fn(&Wrench) -> Vector3<f64>| {
            let both = model.wrenches.as_ref()?.iter().zip(held);
            let most = both.map(|(a, b)| (of(a) - of(b)).norm()).fold(0.0, f64::max) / size;
            Some(most).filter(|part| part.is_finite())
        };
        let energy = model.wrenches.as_ref().map(|_| model.energy / truth.energy);
        let energy = energy.filter(|ratio| ratio.is_finite());
        Deviation { force: off(&|w| w.force), torque: off(&|w| w.moment / length), energy, shape }
    }

    /// The larger of the errors of force and torque; infinite without forces.
    pub fn worst(&self) -> f64 {
        let of = |part: Option<f64>| part.unwrap_or(f64::INFINITY);
        of(self.force).max(of(self.torque))
    }
}

impl Trial {
    /// The mesh node of each of the deformer's surface nodes.
    pub fn surface_nodes(statics: &Statics, deformer: &Deformer) -> Vec<usize> {
        let place = |tag: &u64| statics.mesh.tags.iter().position(|own| own == tag).unwrap_or(0);
        deformer.tags().iter().map(place).collect()
    }

    /// Brings the deformer to the poses in steps from rest, as a hand does, and compares; `nodes` are those of
    /// [`Trial::surface_nodes`].
    pub fn deviation(&self, deformer: &mut Deformer, nodes: &[usize]) -> Deviation {
        self.follow(deformer);
        let truth = PoseResult::of_equilibrium(&self.settled, &self.poses, nodes);
        Deviation::new(&PoseResult::of_model(deformer), &truth, self.moved.length)
    }

    /// Deviation of the deformer, as it was compared last, from another stable equilibrium in the same poses: a body that buckles has
    /// several. `None` where it is not within [`GOOD`] of one.
    pub fn beside(
        &self,
        statics: &mut Statics,
        deformer: &Deformer,
        nodes: &[usize],
    ) -> Result<Option<Deviation>, StaticsError> {
        let model = PoseResult::of_model(deformer);
        let Some(found) = statics.solve_near_some(nodes, &model.surface, &self.poses)? else {
            return Ok(None);
        };
        let truth = PoseResult::of_equilibrium(&found, &self.poses, nodes);
        let deviation = Deviation::new(&model, &truth, self.moved.length);
        Ok(Some(deviation).filter(|deviation| deviation.worst() <= GOOD))
    }

    /// Takes the deformer to the poses from rest in steps of about 10° at most.
    fn follow(&self, deformer: &mut Deformer) {
        const STEPS: u32 = 36;
        deformer.forget();
        for step in 1..STEPS {
            let share = f64::from(step) / f64::from(STEPS);
            deformer.take(&self.moved.poses(self.motion.part(share)));
        }
        deformer.evaluate(&self.poses);
    }

    /// Median time from poses to the deformed surface with its forces, s, of a deformer that has come to the poses: the element turns to and
    /// fro about them by 0.5° a frame, as a hand does that turns by 30° a second at 60 frames.
    pub fn frame_time(&self, deformer: &mut Deformer) -> f64 {
        const FRAMES: i32 = 32;
        const STEP: f64 = PI / 360.0;
        let times = (0..FRAMES).map(|frame| {
            // 0 to 4, to -4, and to 0 again.
            let steps = 4 - ((frame + 4) % 16 - 8).abs();
            let mut near = self.poses.clone();
            let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), STEP * f64::from(steps));
            let matrix = &mut near[self.moved.element].matrix;
            *matrix = turn.matrix() * *matrix;
            let started = Instant::now();
            deformer.evaluate(&near);
            started.elapsed().as_secs_f64()
        });
        median(times)
    }
}
