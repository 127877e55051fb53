//! Method 3b of the paper's appendix for thin bodies: a Kirchhoff–Love shell between control elements.
//!
//! In: the poses of the control elements, which hold the middle surface of the body ([`Middle`]). Out: that surface in
//! equilibrium with large rotations ([`Sheet`]), on which the surface of the finite-element body is skinned; its energy and
//! its gradient. The shell's four moduli come from the body's own handle stiffness ([`constants`]).

mod band;
mod constants;
mod grips;
mod middle;
mod path;
mod point;
mod sheet;
mod skin;
mod spline;

use super::cubic_form::CubicForm;
use super::frames::{ControlFrame, PoseSlope};
use super::helicoidal::Helicoidal;
use super::model::{BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response};
use super::pose::ControlPose;
use crate::green::{CUBIC, FIELDS, STIFFNESS};
use grips::grips_of;
use middle::Middle;
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use point::{Hold, Point};
use sheet::{Sheet, Standing};
use skin::Skin;

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "plate",
    summary: "method 3b: a Kirchhoff-Love shell between control elements, for thin bodies",
    requirements: &[STIFFNESS, CUBIC],
    frame: Frame::MeanMotion,
    energy: Some(&[]),
    turn_limits_deg: [30.0, 90.0],
    kind: Kind::Online(|input| Ok(Box::new(Plate::new(input)?))),
};

/// A thin body.
pub struct Plate {
    controls: Vec<ControlRest>,
    sheet: Sheet,
    skin: Skin,
    /// Of the whole body, with the first control element; what follows is seen from it.
    motion: Isometry3<f64>,
    /// How the control elements are held; the frames of the last state that was found, and of the next one.
    holds: Vec<Hold>,
    frames: Vec<ControlFrame>,
    target: Vec<ControlFrame>,
    turns: Vec<Option<UnitQuaternion<f64>>>,
    /// The poses of the last evaluation, and what was found.
    poses: Vec<ControlPose>,
    standing: Standing,
    is_defined: bool,
}

impl Plate {
    pub fn new(input: &ModelInput<'_>) -> Result<Plate, String> {
        let refuse = |why: String| {
            format!("model \"plate\" does not suit this body: {why}; write model = \"rotation\" or \"substructured\"")
        };
        let stiffness = (input.table)(STIFFNESS.name)
            .ok_or("model \"plate\" needs the handle stiffness of the .green file")?;
        let origins: Vec<Vector3<f64>> = input.controls.iter().map(|control| control.origin).collect();
        let held: Vec<Vec<u32>> = (0..origins.len()).map(|e| (input.control_nodes)(e)).collect();
        let place = |x: &[f32; 3]| Vector3::from(*x).cast::<f64>();
        let nodes: Vec<Vector3<f64>> = input.rest.iter().map(place).collect();
        let place_of = |&node: &u32| nodes.get(node as usize).copied();
        let of_controls: Vec<Vec<Vector3<f64>>> =
            held.iter().map(|held| held.iter().filter_map(place_of).collect()).collect();
        let middle = Middle::of(&nodes, input.triangles, &of_controls).map_err(refuse)?;
        let points = middle.parts.iter().filter_map(|part| {
            let shape = middle.grid.at(part.place);
            Point::new(&shape, &middle.rest, part.seen, part.thickness)
        });
        let mut grips = Vec::new();
        for (e, nodes) in of_controls.iter().enumerate() {
            grips.extend(grips_of(&middle, e, &origins[e], nodes));
        }
        let mut sheet = Sheet::new(middle.grid.clone(), middle.rest.clone(), points.collect(), grips);
        let (moduli, _) = constants::fit(&mut sheet, &origins, &stiffness);
        if std::env::var("FORCES").is_ok() { println!("{moduli:?}"); }
        let cubic = (input.table)(CUBIC.name)
            .and_then(|table| CubicForm::new(FIELDS * origins.len(), table.as_slice().to_vec()));
        let energy = cubic.map(|cubic| Helicoidal::new(&origins, stiffness, Some(cubic))).transpose()?;
        constants::fit_second(&mut sheet, &moduli, &origins, &middle.through(), energy);
        if std::env::var("FORCES").is_ok() { println!("{:?} {:?}", sheet.points[0].second_order, sheet.points[0].thickness.powi(2)/24.); }
        let skin = Skin::new(&middle, &origins, input.rest, &held, constants::POISSON);
        let hold = |&place: &Vector3<f64>| Hold { place, matrix: Matrix3::identity() };
        let frame = |&place: &Vector3<f64>| ControlFrame {
            place,
            turn: UnitQuaternion::identity(),
            stretch: Matrix3::identity(),
        };
        let frames: Vec<ControlFrame> = origins.iter().map(frame).collect();
        Ok(Plate {
            controls: input.controls.to_vec(),
            sheet,
            skin,
            motion: Isometry3::identity(),
            holds: origins.iter().map(hold).collect(),
            target: frames.clone(),
            frames,
            turns: vec![None; origins.len()],
            poses: Vec::new(),
            standing: Standing { energy: 0.0, iterations: 0, buckled: false },
            is_defined: true,
        })
    }

    /// The shell held at these poses; where no equilibrium is found, the last one is kept.
    fn hold(&mut self, poses: &[ControlPose]) {
        if poses.len() != self.controls.len() || poses == self.poses {
            return;
        }
        self.poses.clear();
        self.poses.extend_from_slice(poses);
        self.is_defined = false;
        self.target.clear();
        for (e, (pose, control)) in poses.iter().zip(&self.controls).enumerate() {
            let Some(frame) = ControlFrame::of(&control.origin, pose, self.turns[e].as_ref()) else { return };
            self.target.push(frame);
        }
        let turns = self.target.iter().map(|frame| Some(frame.turn)).collect();
        let motion = self.take_motion();
        if let Some(standing) = self.go().or_else(|| self.go_from_rest()) {
            (self.standing, self.motion, self.turns) = (standing, motion, turns);
            self.frames.clone_from_slice(&self.target);
            self.is_defined = true;
        }
    }

    /// The motion of the first control element is that of the whole body, which does not feel it: it is taken out of the
    /// target.
    fn take_motion(&mut self) -> Isometry3<f64> {
        let first = self.target.first().zip(self.controls.first());
        let motion = first.map_or_else(Isometry3::identity, |(frame, control)| {
            path::placed(frame) * Translation3::from(-control.origin)
        });
        for frame in &mut self.target {
            let seen = motion.inverse() * path::placed(frame);
            (frame.place, frame.turn) = (seen.translation.vector, seen.rotation);
        }
        motion
    }

    /// From the last state to the target.
    fn go(&mut self) -> Option<Standing> {
        let found = path::follow(&self.frames, &self.target, &mut self.holds, &mut self.sheet);
        if found.is_none() {
            self.take_holds();
        }
        found
    }

    fn take_holds(&mut self) {
        for (hold, frame) in self.holds.iter_mut().zip(&self.frames) {
            *hold = path::held(frame);
        }
    }

    /// A way from rest may exist where none from the last state was found.
    fn go_from_rest(&mut self) -> Option<Standing> {
        let (kept, frames) = (self.sheet.q.clone(), self.frames.clone());
        self.rest();
        let found = self.go();
        if found.is_none() {
            self.sheet.put(&kept);
            self.frames = frames;
            self.take_holds();
        }
        found
    }

    /// The sheet and its holds at rest.
    fn rest(&mut self) {
        self.sheet.reset();
        for (frame, control) in self.frames.iter_mut().zip(&self.controls) {
            let (turn, stretch) = (UnitQuaternion::identity(), Matrix3::identity());
            *frame = ControlFrame { place: control.origin, turn, stretch };
        }
        self.take_holds();
    }
}

impl DeformationModel for Plate {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.hold(poses);
        self.skin.update(&self.sheet.q, &self.holds);
        BodyState {
            parts: vec![self.motion],
            rotation_undefined: !self.is_defined,
            ..BodyState::at_rest(0)
        }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.hold(poses);
        self.sheet.slopes(&self.holds, slopes);
        let turn = self.motion.rotation.to_rotation_matrix();
        for slope in slopes.iter_mut() {
            *slope = PoseSlope { translation: turn * slope.translation, matrix: turn * slope.matrix };
        }
        Some(Response { energy: self.standing.energy, is_defined: self.is_defined })
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        Some(self.skin.field())
    }

    fn forget(&mut self) {
        self.rest();
        self.motion = Isometry3::identity();
        self.turns.fill(None);
        self.poses.clear();
        self.standing = Standing { energy: 0.0, iterations: 0, buckled: false };
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.get_mut(e) {
            *place = Some(turn);
            self.poses.clear();
        }
    }
}

#[cfg(test)]
mod oracles;
#[cfg(test)]
mod tests;
