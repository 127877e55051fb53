//! Method 3b of the paper's appendix for slender bodies: a geometrically exact rod between two control elements.
//!
//! In: the poses of two control elements, whose frames clamp the rod's ends. Out: the frames of the rod's sections in
//! equilibrium, on which the surface of the finite-element body is skinned; the rod's energy and its gradient. The rod is
//! straight and uniform; its section comes from the body's own handle stiffness ([`Section`]), so that small motions give
//! the linear solution, forces and surface. A rod has no stretching control elements: their stretch moves its clamps, as S
//! says, and resists linearly.
//!
//! Loads and forces at points act on the two sections between which they are, each as on a rigid section, in parts that grow linearly
//! from one to the other; what they do to the shape of a section by themselves is left out. Warmth lengthens the rod at rest, and
//! what its ends would be without stress.
//!
//! Whether a body is slender enough is seen before it is solved: by its length between the control elements over its radius of
//! gyration r, from the tetrahedra between them (r⊥ is the distance from the axis through their middle, E Young's modulus):
//!
//! ```text
//! r² = ½ ∫ E r⊥² dV / ∫ E dV
//! ```
//!
//! which is I/A of a uniform straight rod, in the mean of both directions of bending. The rod itself takes its radius from the solved
//! body's compliance ([`Section`]), which differs where the body narrows or its ends give way.

mod chain;
mod section;
mod skin;

use super::helicoidal::{CubicForm, Helicoidal};
use crate::base::diagnostic::Severity;
use crate::base::parts::PartWeights;
use crate::deform::loads::{Borne, Lumped, SLOTS};
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{
    Bearing, BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{ControlFrame, ControlPose, FrameSlope, PoseSlope};
use crate::deform::pose::se3::{Tangent, exp, halves};
use crate::fem::Lame;
use crate::green::{AFFINE, CUBIC, ControlElement, FIELDS, LOAD_FORCES, Prepared, STIFFNESS};
use chain::{Chain, Standing};
use nalgebra::{Isometry3, Matrix3, SVector, Translation3, UnitQuaternion, Vector3, Vector6};
use section::{SLENDER, Section, stretch_of};
use skin::Skin;

pub const ENTRY: ModelEntry = ModelEntry {
    name: "rod",
    summary: "method 3b: a geometrically exact rod between two control elements, for slender straight bodies",
    requirements: &[AFFINE, STIFFNESS, CUBIC],
    frame: Frame::MeanMotion,
    energy: Some(&[]),
    // Measured against St. Venant-Kirchhoff statics up to 180°.
    turn_limits_deg: [60.0, 180.0],
    kind: Kind::Online(|input| Ok(Box::new(Rod::new(input)?))),
    loads: Bearing::Forces(&[LOAD_FORCES]),
    fits: Some(fits),
};

/// Segments between the clamps, of a short rod and of any: a segment is 8 radii of gyration long where that makes more than the least of
/// them. A slender rod can be twisted far within the strain that a material bears, and winds up into many turns.
const SEGMENTS: [usize; 2] = [32, 128];
const RADII: f64 = 8.0;

/// A slender body.
pub struct Rod {
    controls: [ControlRest; 2],
    section: Section,
    chain: Chain,
    /// Another one, to come from rest with.
    spare: Chain,
    skin: Skin,
    loads: Option<Lumped>,
    turns: [UnitQuaternion<f64>; 2],
    frames: [ControlFrame; 2],
    /// The poses of the last evaluation, and what was found.
    poses: Option<[ControlPose; 2]>,
    standing: Option<Standing>,
    is_defined: bool,
}

impl Rod {
    pub fn new(input: &ModelInput<'_>) -> Result<Rod, String> {
        let [first, last] = input.controls else {
            return Err(format!(
                "model \"rod\" is for bodies with two control elements, one at each end; it has {}: write model = \
                 \"rotation\"",
                input.controls.len()
            ));
        };
        let stiffness = (input.table)(STIFFNESS.name)
            .ok_or("model \"rod\" needs the handle stiffness of the .green file")?;
        let origins = [first.origin, last.origin];
        let held = [0, 1].map(|e| (input.control_nodes)(e));
        let axis = (origins[1] - origins[0]).normalize();
        let reach = |e: usize| {
            let towards = if e == 0 { axis } else { -axis };
            let along = |&node: &u32| {
                let x = input.rest.get(node as usize).map(|x| Vector3::from(*x).cast::<f64>());
                x.map_or(0.0, |x| (x - origins[e]).dot(&towards))
            };
            held[e].iter().map(along).fold(0.0, f64::max)
        };
        let fitted = |segments: usize| {
            Section::fit(&stiffness, origins, [reach(0), reach(1)], segments).map_err(|why| {
                format!("model \"rod\" does not suit this body: {why}; write model = \"rotation\"")
            })
        };
        let [least, most] = SEGMENTS;
        let segments = ((fitted(least)?.slenderness() / RADII) as usize).clamp(least, most);
        let mut section = fitted(segments)?;
        let cubic = (input.table)(CUBIC.name);
        if let Some(cubic) = cubic.and_then(|table| CubicForm::new(2 * FIELDS, table.as_slice().to_vec())) {
            section.fit_second(origins, &mut Helicoidal::new(&origins, stiffness, Some(cubic))?);
        }
        let first_frame = section.frame_at(0.0);
        let chain =
            Chain::new(&section.stiffness, &section.second, section.rest(segments), segments, first_frame);
        let columns = (input.table)(AFFINE.name);
        let skin = Skin::new(&section, segments, origins, input.rest, &held, columns.as_ref());
        let (place, along) = (section.clone(), section.ends[1] - section.ends[0]);
        let shares = move |x: &Vector3<f64>| -> Vec<(usize, f64)> {
            let at = ((x - place.ends[0]).dot(&along) / along.norm_squared() * segments as f64)
                .clamp(0.0, segments as f64);
            let first = (at as usize).min(segments - 1);
            let of = |i: usize, share: f64| {
                let arm = (x - place.frame_at(i as f64 / segments as f64).translation.vector) * share;
                Borne::shares(SLOTS * i, share, &arm)
            };
            let share = at - first as f64;
            of(first, 1.0 - share).into_iter().chain(of(first + 1, share)).collect()
        };
        let loads = Lumped::new(input, SLOTS * (segments + 1), Box::new(shares))?;
        Ok(Rod {
            loads,
            controls: [first.clone(), last.clone()],
            section,
            spare: chain.clone(),
            chain,
            skin,
            turns: [UnitQuaternion::identity(); 2],
            frames: origins.map(ControlFrame::at_rest),
            poses: None,
            standing: None,
            is_defined: false,
        })
    }

    /// The rod between the frames of these poses; where there is none, the last one is kept.
    fn hold(&mut self, poses: &[ControlPose]) {
        let Ok(poses) = <[ControlPose; 2]>::try_from(poses) else { return };
        let has_changed = self.loads.as_mut().is_some_and(Lumped::read);
        if self.poses == Some(poses) && !has_changed {
            return;
        }
        self.poses = Some(poses);
        self.is_defined = false;
        self.bear();
        let frame = |e: usize| ControlFrame::new(&self.controls[e].origin, &poses[e], Some(&self.turns[e]));
        let (Some(first), Some(last)) = (frame(0), frame(1)) else { return };
        let frames = [first, last];
        // The hand turns on where the rod cannot follow.
        self.turns = frames.map(|frame| frame.turn);
        if let Some(loads) = self.loads.as_mut().filter(|loads| !loads.is_none()) {
            loads.follow(&poses, &frames.map(|frame| frame.turn));
            self.bear();
        }
        let clamps = [0, 1].map(|e| self.clamp(e, &frames[e]));
        let held = self.chain.hold(&clamps).or_else(|| {
            // A way from rest may exist where none from the last state was found.
            self.spare.reset(clamps[0]);
            let held = self.spare.hold(&clamps)?;
            std::mem::swap(&mut self.chain, &mut self.spare);
            Some(held)
        });
        if let Some(standing) = held {
            self.standing = Some(standing);
            self.frames = frames;
            self.is_defined = true;
        }
    }

    /// The pose at which control element `e` is held.
    fn held_pose(&self, e: usize) -> ControlPose {
        let frame = &self.frames[e];
        ControlPose { translation: frame.place - self.controls[e].origin, matrix: frame.matrix() }
    }

    /// Gives the rod its loads.
    fn bear(&mut self) {
        let Some(loads) = &self.loads else { return };
        for chain in [&mut self.chain, &mut self.spare] {
            let slots = if loads.is_none() { &[] } else { loads.slots() };
            chain.bear(slots.chunks_exact(SLOTS).map(Borne::of_slots), 1.0 + loads.strain());
        }
    }

    /// Thermal strain: the relative elongation of the body where it is free.
    fn strain(&self) -> f64 {
        self.loads.as_ref().map_or(0.0, Lumped::strain)
    }

    /// U - I of an end beside what warmth makes of it.
    fn stretch(&self, frame: &ControlFrame) -> section::Stretch {
        let strain = self.strain();
        let mut stretch = stretch_of(&frame.stretch);
        [0, 4, 8].iter().for_each(|&k| stretch[k] -= strain);
        stretch
    }

    /// Vector from the origin of a control element to the end of the rod, where nothing strains it.
    fn arm(&self, e: usize) -> Vector3<f64> {
        (self.section.ends[e] - self.controls[e].origin) * (1.0 + self.strain())
    }

    /// Frame of the rod's end by that of its control element: the end's place in it, moved by the stretch.
    fn clamp(&self, e: usize, frame: &ControlFrame) -> Isometry3<f64> {
        let offset = self.section.offsets[e] * self.stretch(frame);
        frame.motion() * Translation3::from(self.arm(e)) * exp(&offset)
    }

    /// U - I of both ends, one after the other.
    fn stretches(&self) -> SVector<f64, 18> {
        let [first, last] = [0, 1].map(|e| self.stretch(&self.frames[e]));
        SVector::from_fn(|k, _| if k < 9 { first[k] } else { last[k - 9] })
    }

    /// The slope of V by the frame of element `e`.
    fn slope(&self, e: usize, standing: &Standing, resisting: &SVector<f64, 18>) -> FrameSlope {
        let frame = &self.frames[e];
        let offset = self.section.offsets[e] * self.stretch(frame);
        // By a motion of the offset's own end, then by one of the control element's frame.
        let wrench = standing.wrenches[e];
        let last = Tangent::at(&offset).last;
        let by_offset = last.transpose().lu().solve(&wrench).unwrap_or(wrench);
        let pulled = self.section.offsets[e].tr_mul(&by_offset);
        let by_stretch = Matrix3::from_fn(|i, j| pulled[3 * i + j] + resisting[9 * e + 3 * i + j]);
        let turned = exp(&offset);
        let (force, moment) = halves(&wrench);
        let force = turned.rotation * force;
        let moment = turned.rotation * moment + turned.translation.vector.cross(&force);
        let arm = self.arm(e);
        let (force, moment) = (frame.turn * force, frame.turn * (moment + arm.cross(&force)));
        FrameSlope { force, torque: moment, stretch: (by_stretch + by_stretch.transpose()) * 0.5 }
    }
}

impl DeformationModel for Rod {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.hold(poses);
        let mut motions = Vec::with_capacity(self.chain.segments() + 4);
        self.skin.motions(&self.chain, &self.frames.map(|frame| frame.motion()), &mut motions);
        self.skin.update(&self.chain, [&self.frames[0].stretch, &self.frames[1].stretch], self.strain());
        BodyState {
            parts: motions,
            coefficients: Vec::new(),
            rotation_undefined: !self.is_defined,
            ..BodyState::at_rest(0)
        }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.hold(poses);
        let standing = self.standing?;
        let stretches = self.stretches();
        let resisting = self.section.stretching * stretches;
        for (e, slope) in slopes.iter_mut().enumerate().take(2) {
            *slope = self.frames[e].pull_back(&self.slope(e, &standing, &resisting));
        }
        let mut energy = standing.energy + 0.5 * stretches.dot(&resisting);
        if let Some(loads) = self.loads.as_ref().filter(|loads| !loads.is_none()) {
            let poses = [0, 1].map(|e| self.held_pose(e));
            energy += loads.hold(&poses, slopes);
        }
        Some(Response { energy, is_defined: self.is_defined })
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        Some(self.skin.field())
    }

    fn part_weights(&self, _rest: &[[f32; 3]]) -> Option<PartWeights> {
        self.skin.weights().ok()
    }

    fn memory(&self) -> ModelMemory {
        let mut memory = ModelMemory {
            turns: self.turns.to_vec(),
            poses: self.poses.map_or_else(Vec::new, |poses| poses.to_vec()),
            is_defined: self.is_defined,
            ..ModelMemory::default()
        };
        self.frames.iter().for_each(|frame| memory.put(frame));
        // An energy that is not a number stands for a rod that was never held.
        memory.energy = self.standing.map_or(f64::NAN, |standing| standing.energy);
        for wrench in self.standing.map_or([Vector6::zeros(); 2], |standing| standing.wrenches) {
            memory.unknowns.extend(wrench.iter());
        }
        self.chain.keep(&mut memory);
        if let Some(loads) = &self.loads {
            loads.keep(&mut memory);
        }
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        let of_loads = if self.loads.is_some() { Lumped::KEPT } else { 0 };
        memory.suits(2, 2 * (7 + 9) + 2 * 6 + self.chain.kept() + of_loads)?;
        let (of_rod, of_loads) = memory.unknowns.split_at(memory.unknowns.len() - of_loads);
        if let Some(loads) = &mut self.loads {
            loads.take_back(memory.loads.as_ref(), &mut Unknowns(of_loads));
            self.bear();
        }
        let turns = memory.turns_of(2);
        self.turns = [turns[0], turns[1]];
        self.poses = <[ControlPose; 2]>::try_from(memory.poses.as_slice()).ok();
        self.is_defined = memory.is_defined;
        let mut unknowns = Unknowns(of_rod);
        self.frames.iter_mut().for_each(|frame| *frame = unknowns.take());
        let mut wrenches = [Vector6::zeros(); 2];
        wrenches.iter_mut().for_each(|wrench| unknowns.fill(wrench.as_mut_slice()));
        let standing = Standing { energy: memory.energy, wrenches, iterations: 0, buckled: false };
        self.standing = (!memory.energy.is_nan()).then_some(standing);
        self.chain.take_back(&mut unknowns);
        self.skin.update(&self.chain, [&self.frames[0].stretch, &self.frames[1].stretch], self.strain());
        Ok(())
    }

    fn forget(&mut self) {
        self.chain.reset(self.section.frame_at(0.0));
        self.turns = [UnitQuaternion::identity(); 2];
        self.poses = None;
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.get_mut(e) {
            *place = turn;
            self.poses = None;
        }
    }
}

/// Part of the slenderness that is needed, below which the solved body will not have it either.
const SURELY: f64 = 0.8;

pub fn fits(body: &Prepared) -> Result<(), (Severity, String)> {
    let refused = |why: String| Err((Severity::Error, why));
    let [first, last] = &body.controls[..] else {
        return refused(format!(
            "model \"rod\" is for bodies with two control elements, one at each end; it has {}: write model = \"rotation\"",
            body.controls.len()
        ));
    };
    let chord = last.origin - first.origin;
    let Some(axis) = chord.try_normalize(0.0) else {
        return refused(
            "model \"rod\": both control elements have the same place: write model = \"rotation\"".to_owned(),
        );
    };
    let reach = |control: &ControlElement, towards: Vector3<f64>| {
        let along = |&node: &u32| (body.mesh.nodes[node as usize] - control.origin).dot(&towards);
        control.nodes.iter().map(along).fold(0.0, f64::max)
    };
    let ends = [reach(first, axis), chord.norm() - reach(last, -axis)];
    let length = ends[1] - ends[0];
    let slenderness = length / radius(body, &first.origin, &axis, ends);
    if slenderness.is_nan() || slenderness >= SLENDER {
        return Ok(());
    }
    let why = format!(
        "model \"rod\": between its control elements the body is {:.3e} m long, about {slenderness:.1} radii of gyration, and a \
         rod needs {SLENDER}",
        length.max(0.0)
    );
    if slenderness < SURELY * SLENDER {
        return refused(format!("{why}: write model = \"rotation\""));
    }
    Err((
        Severity::Warning,
        format!("{why}; whether it suits, the solved body tells: else write model = \"rotation\""),
    ))
}

/// r, of the tetrahedra whose middles lie between two places along the axis; NaN where there are none.
fn radius(body: &Prepared, origin: &Vector3<f64>, axis: &Vector3<f64>, ends: [f64; 2]) -> f64 {
    let (mut weight, mut first, mut second) = (0.0, Vector3::zeros(), 0.0);
    for (tet, lame) in body.mesh.tets.iter().zip(&body.lame) {
        let corners = tet.map(|node| {
            let x = body.mesh.nodes[node as usize] - origin;
            (x.dot(axis), x - axis * x.dot(axis))
        });
        let middle = corners.iter().map(|(along, _)| along).sum::<f64>() / 4.0;
        if !(ends[0]..=ends[1]).contains(&middle) {
            continue;
        }
        let place = |i: usize| corners[i].1 + axis * corners[i].0;
        let edges = [1, 2, 3].map(|i| place(i) - place(0));
        let own = young(lame) * edges[0].cross(&edges[1]).dot(&edges[2]).abs() / 6.0;
        // Exact for linear tetrahedra: ∫ x² dV = V (Σ x_i² + (Σ x_i)²) / 20.
        let sum: Vector3<f64> = corners.iter().map(|(_, aside)| aside).sum();
        let squares: f64 = corners.iter().map(|(_, aside)| aside.norm_squared()).sum();
        weight += own;
        first += sum * (own / 4.0);
        second += own * (squares + sum.norm_squared()) / 20.0;
    }
    let centre = first / weight;
    (0.5 * (second / weight - centre.norm_squared())).sqrt()
}

/// E.
fn young(lame: &Lame) -> f64 {
    lame.mu * (3.0 * lame.lambda + 2.0 * lame.mu) / (lame.lambda + lame.mu)
}

#[cfg(test)]
mod tests;
