//! Method 3b of the paper's appendix for thin bodies: a Kirchhoff–Love shell between control elements.
//!
//! In: the poses of the control elements, which hold the middle surface of the body ([`Middle`]). Out: that surface in
//! equilibrium with large rotations ([`Sheet`]), on which the surface of the finite-element body is skinned ([`Skin`]); the
//! shell's energy and its gradient. Its moduli come from the body's own handle stiffness and cubic energy ([`constants`]).
//!
//! The springs with which control elements hold the shell ([`point::Grip`]) are part of the energy, and take poses as they are,
//! stretches included: forces are its exact gradient.
//!
//! Loads and forces at points act on the middle surface, each at the place next to it; the moments of those above and below it
//! are left out. Warmth lengthens the middle surface without stress.

mod constants;
mod equilibrium;
mod middle;
mod point;
mod sheet;
mod skin;
mod spline;

use super::helicoidal::{CubicForm, Helicoidal};
use crate::base::diagnostic::Severity;
use crate::deform::loads::Lumped;
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{
    Bearing, BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{ControlFrame, ControlPose, PoseSlope};
use crate::green::{CUBIC, FIELDS, LOAD_FORCES, Prepared, STIFFNESS};
use crate::mesh::Surface;
use middle::{Middle, Part};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use point::{Hold, Point};
use sheet::{Sheet, Standing};
use skin::{Skin, grips_of};

pub const ENTRY: ModelEntry = ModelEntry {
    name: "plate",
    summary: "method 3b: a Kirchhoff-Love shell between control elements, for thin bodies",
    requirements: &[STIFFNESS, CUBIC],
    frame: Frame::MeanMotion,
    energy: Some(&[]),
    // Measured against St. Venant-Kirchhoff statics up to 180°.
    turn_limits_deg: [60.0, 180.0],
    kind: Kind::Online(|input| Ok(Box::new(Plate::new(input)?))),
    loads: Bearing::Forces(&[LOAD_FORCES]),
    fits: Some(fits),
};

/// Largest distance of its answers to small motions from those of the body, as the root mean square of relative errors.
const UNFIT: f64 = 0.15;

/// A thin body.
pub struct Plate {
    controls: Vec<ControlRest>,
    sheet: Sheet,
    skin: Skin,
    loads: Option<Lumped>,
    /// Motion of the whole body, with the first control element; the state below is seen from it.
    motion: Isometry3<f64>,
    /// Holds of the control elements; the frames of the last state that was found, and of the next one.
    holds: Vec<Hold>,
    frames: Vec<ControlFrame>,
    target: Vec<ControlFrame>,
    turns: Vec<UnitQuaternion<f64>>,
    /// The last state, while a way to the next one is tried.
    kept: (Vec<Vector3<f64>>, Vec<ControlFrame>),
    /// The last target, where it had no equilibrium; otherwise none.
    lost: Vec<ControlFrame>,
    /// The poses of the last evaluation, and what was found.
    poses: Vec<ControlPose>,
    standing: Standing,
    is_defined: bool,
}

impl Plate {
    pub fn new(input: &ModelInput<'_>) -> Result<Plate, String> {
        let stiffness = (input.table)(STIFFNESS.name)
            .ok_or("model \"plate\" needs the handle stiffness of the .green file")?;
        let origins: Vec<Vector3<f64>> = input.controls.iter().map(|control| control.origin).collect();
        check_count(origins.len()).map_err(unsuited)?;
        let held: Vec<Vec<u32>> = (0..origins.len()).map(|e| (input.control_nodes)(e)).collect();
        let (middle, mut sheet) = unfitted(input, &origins, &held).map_err(unsuited)?;
        let (moduli, off) = constants::fit(&mut sheet, &origins, &stiffness);
        if off.is_nan() || off > UNFIT {
            return Err(unsuited(format!(
                "its shell errs by {:.0} % in small motions (at most {:.0} %): hold it at its edges, or write \
                 element = \"tet10\"",
                100.0 * off,
                100.0 * UNFIT
            )));
        }
        let cubic = (input.table)(CUBIC.name)
            .and_then(|table| CubicForm::new(FIELDS * origins.len(), table.as_slice().to_vec()));
        let energy = cubic.map(|cubic| Helicoidal::new(&origins, stiffness, Some(cubic))).transpose()?;
        constants::fit_second(&mut sheet, &moduli, &origins, &middle.through(), energy);
        let frames: Vec<ControlFrame> = origins.iter().copied().map(ControlFrame::at_rest).collect();
        let skin = Skin::new(&middle, &origins, input.rest, &held, constants::POISSON);
        let shares = move |x: &Vector3<f64>| skin::shares(&middle, x);
        Ok(Plate {
            controls: input.controls.to_vec(),
            skin,
            loads: Lumped::new(input, sheet.q.len(), Box::new(shares))?,
            motion: Isometry3::identity(),
            holds: frames.iter().map(constants::held).collect(),
            target: frames.clone(),
            turns: vec![UnitQuaternion::identity(); origins.len()],
            kept: (sheet.q.clone(), frames.clone()),
            lost: Vec::with_capacity(origins.len()),
            frames,
            sheet,
            poses: Vec::with_capacity(origins.len()),
            standing: REST,
            is_defined: true,
        })
    }

    /// The shell held at these poses; where no equilibrium is found, the last one is kept.
    fn hold(&mut self, poses: &[ControlPose]) {
        let has_changed = self.loads.as_mut().is_some_and(Lumped::read);
        if poses.len() != self.controls.len() || (poses == self.poses && !has_changed) {
            return;
        }
        if has_changed {
            self.lost.clear();
        }
        self.poses.clear();
        self.poses.extend_from_slice(poses);
        (self.is_defined, self.sheet.work) = (false, 0);
        self.target.clear();
        for (e, (pose, control)) in poses.iter().zip(&self.controls).enumerate() {
            let Some(frame) = ControlFrame::new(&control.origin, pose, self.turns.get(e)) else {
                // As many as there are holds, whatever comes next.
                self.target.clone_from(&self.frames);
                return;
            };
            self.target.push(frame);
        }
        // Hands turn on where the shell cannot follow.
        self.turns.clear();
        self.turns.extend(self.target.iter().map(|frame| frame.turn));
        let motion = self.take_motion();
        if let Some(loads) = &mut self.loads {
            if !loads.is_none() {
                loads.follow(poses, &self.turns);
            }
            bear(loads, &motion, &mut self.sheet);
        }
        let from_lost = match self.lost.is_empty() {
            true => f64::INFINITY,
            false => constants::distance(&self.lost, &self.target, self.sheet.size),
        };
        if from_lost < AGAIN {
            return;
        }
        self.kept.0.clone_from(&self.sheet.q);
        self.kept.1.clone_from(&self.frames);
        match self.go().or_else(|| self.go_from_rest(from_lost)) {
            Some(standing) => {
                (self.standing, self.motion, self.is_defined) = (standing, motion, true);
                self.frames.clone_from(&self.target);
                self.lost.clear();
            }
            None => {
                self.sheet.put(&self.kept.0);
                self.frames.clone_from(&self.kept.1);
                self.take_holds();
                self.lost.clone_from(&self.target);
            }
        }
    }

    /// The motion of the first control element is that of the whole body, which does not feel it: it is taken out of the
    /// target.
    fn take_motion(&mut self) -> Isometry3<f64> {
        let first = self.target.first().zip(self.controls.first());
        let motion = first.map_or_else(Isometry3::identity, |(frame, control)| {
            frame.motion() * Translation3::from(-control.origin)
        });
        for frame in &mut self.target {
            let seen = motion.inverse() * frame.motion();
            (frame.place, frame.turn) = (seen.translation.vector, seen.rotation);
        }
        motion
    }

    /// Goes from the last state to the target; where that fails, the sheet stands somewhere on the way.
    fn go(&mut self) -> Option<Standing> {
        constants::follow(&self.frames, &self.target, &mut self.holds, &mut self.sheet)
    }

    fn take_holds(&mut self) {
        for (hold, frame) in self.holds.iter_mut().zip(&self.frames) {
            *hold = constants::held(frame);
        }
    }

    /// A way from rest may exist where none from the last state was found; not tried again beside poses that had none.
    fn go_from_rest(&mut self, from_lost: f64) -> Option<Standing> {
        if from_lost < 1.0 {
            return None;
        }
        self.rest();
        self.go()
    }

    /// Thermal strain: the relative elongation of the body where it is free.
    fn strain(&self) -> f64 {
        self.loads.as_ref().map_or(0.0, Lumped::strain)
    }

    /// The poses at which the control elements are held.
    fn held_poses(&self) -> Vec<ControlPose> {
        let pose = |(frame, control): (&ControlFrame, &ControlRest)| {
            let seen = self.motion * frame.motion();
            ControlPose {
                translation: seen.translation.vector - control.origin,
                matrix: seen.rotation.to_rotation_matrix() * frame.stretch,
            }
        };
        self.frames.iter().zip(&self.controls).map(pose).collect()
    }

    /// The sheet and its holds at rest.
    fn rest(&mut self) {
        self.sheet.reset();
        for (frame, control) in self.frames.iter_mut().zip(&self.controls) {
            *frame = ControlFrame::at_rest(control.origin);
        }
        self.take_holds();
    }
}

/// Gives the sheet, which is seen from this motion, what acts on it.
fn bear(loads: &Lumped, motion: &Isometry3<f64>, sheet: &mut Sheet) {
    let inverse = motion.rotation.inverse();
    sheet.loads.iter_mut().zip(loads.slots()).for_each(|(own, load)| *own = inverse * load);
    sheet.warm(loads.strain());
}

/// A target that is nearer than this to one that had no equilibrium, in steps of [`constants::follow`], is not tried: each
/// attempt takes long.
const AGAIN: f64 = 0.125;

/// An equilibrium that takes more evaluations is a long one.
const USUAL_WORK: usize = 8;

/// The shell at rest.
const REST: Standing = Standing { energy: 0.0, iterations: 0, buckled: false };

/// The middle surface, and the shell on it before its moduli are known.
fn unfitted(
    input: &ModelInput<'_>,
    origins: &[Vector3<f64>],
    held: &[Vec<u32>],
) -> Result<(Middle, Sheet), String> {
    let nodes: Vec<Vector3<f64>> = input.rest.iter().map(|x| Vector3::from(*x).cast()).collect();
    let place_of = |&node: &u32| nodes.get(node as usize).copied();
    let held: Vec<Vec<Vector3<f64>>> =
        held.iter().map(|held| held.iter().filter_map(place_of).collect()).collect();
    let middle = Middle::new(&nodes, input.triangles, &held)?;
    let point =
        |part: &Part| Point::new(&middle.grid.at(part.place), &middle.rest, part.seen, part.thickness);
    let points = middle.parts.iter().filter_map(point).collect();
    let grips = held.iter().enumerate().flat_map(|(e, nodes)| grips_of(&middle, e, &origins[e], nodes));
    let sheet = Sheet::new(&middle.grid, middle.rest.clone(), points, grips.collect());
    Ok((middle, sheet))
}

/// Refuses a body whose S cannot tell how stiff the shell is.
fn check_count(controls: usize) -> Result<(), String> {
    if controls < 2 {
        return Err(format!(
            "its shell gets its stiffness from two or more control elements moved against each other; it has {controls}"
        ));
    }
    Ok(())
}

/// Refuses a body that is not thin, by its surface alone.
fn fits(body: &Prepared) -> Result<(), (Severity, String)> {
    check_count(body.controls.len()).map_err(|why| (Severity::Error, unsuited(why)))?;
    let surface = Surface::from_mesh(&body.mesh);
    let nodes: Vec<Vector3<f64>> = surface.nodes.iter().map(|&node| body.mesh.nodes[node as usize]).collect();
    let place = |node: &u32| surface.nodes.binary_search(node).ok().map(|place| nodes[place]);
    let held: Vec<Vec<Vector3<f64>>> =
        body.controls.iter().map(|control| control.nodes.iter().filter_map(place).collect()).collect();
    Middle::new(&nodes, &surface.triangles, &held).map(drop).map_err(|why| (Severity::Error, unsuited(why)))
}

fn unsuited(why: String) -> String {
    format!("model \"plate\" does not suit this body: {why}; write model = \"rotation\" or \"substructured\"")
}

impl DeformationModel for Plate {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.hold(poses);
        self.skin.update(&self.sheet.q, &self.holds, self.strain());
        BodyState { parts: vec![self.motion], rotation_undefined: !self.is_defined, ..BodyState::at_rest(0) }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.hold(poses);
        self.sheet.slopes(&self.holds, slopes);
        let turn = self.motion.rotation.to_rotation_matrix();
        for slope in slopes.iter_mut() {
            *slope = PoseSlope { translation: turn * slope.translation, matrix: turn * slope.matrix };
        }
        let mut energy = self.standing.energy;
        if let Some(loads) = self.loads.as_ref().filter(|loads| !loads.is_none()) {
            // The sheet has the work from rest on, as it is seen from the motion.
            for (load, rest) in loads.slots().iter().zip(&self.sheet.rest) {
                energy -= load.dot(&(self.motion * Point3::from(*rest)).coords);
            }
            energy += loads.hold(&self.held_poses(), slopes);
        }
        Some(Response { energy, is_defined: self.is_defined })
    }

    fn was_long(&self) -> bool {
        self.sheet.work > USUAL_WORK
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        Some(self.skin.field())
    }

    fn memory(&self) -> ModelMemory {
        let controls = self.controls.len();
        let mut memory = ModelMemory {
            turns: self.turns.clone(),
            poses: self.poses.clone(),
            is_defined: self.is_defined,
            energy: self.standing.energy,
            ..ModelMemory::default()
        };
        memory.put(&self.motion);
        memory.unknowns.push(f64::from(u8::from(!self.lost.is_empty())));
        let lost = if self.lost.is_empty() { &self.frames } else { &self.lost };
        for frame in self.frames.iter().chain(lost) {
            memory.put(frame);
        }
        self.sheet.keep(controls, &mut memory);
        if let Some(loads) = &self.loads {
            loads.keep(&mut memory);
        }
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        let controls = self.controls.len();
        let of_loads = if self.loads.is_some() { Lumped::KEPT } else { 0 };
        memory.suits(controls, 7 + 1 + 2 * controls * (7 + 9) + self.sheet.kept(controls) + of_loads)?;
        let (of_sheet, of_loads) = memory.unknowns.split_at(memory.unknowns.len() - of_loads);
        if let Some(loads) = &mut self.loads {
            loads.take_back(memory.loads.as_ref(), &mut Unknowns(of_loads));
            self.sheet.warm(loads.strain());
        }
        self.turns = memory.turns_of(controls);
        self.poses.clone_from(&memory.poses);
        self.is_defined = memory.is_defined;
        self.standing = Standing { energy: memory.energy, ..REST };
        let mut unknowns = Unknowns(of_sheet);
        self.motion = unknowns.take();
        let is_lost = unknowns.take::<f64>() == 1.0;
        self.frames.iter_mut().for_each(|own| *own = unknowns.take());
        self.lost.clear();
        self.lost.extend((0..controls).map(|_| unknowns.take::<ControlFrame>()));
        if !is_lost {
            self.lost.clear();
        }
        self.sheet.take_back(controls, &mut unknowns);
        self.take_holds();
        self.skin.update(&self.sheet.q, &self.holds, self.strain());
        Ok(())
    }

    fn forget(&mut self) {
        self.rest();
        self.lost.clear();
        self.motion = Isometry3::identity();
        self.turns.fill(UnitQuaternion::identity());
        self.poses.clear();
        self.standing = REST;
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.get_mut(e) {
            *place = turn;
            self.poses.clear();
        }
    }
}

#[cfg(test)]
mod oracles;

#[cfg(test)]
mod tests;
