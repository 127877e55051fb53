//! Method 3a of the paper's appendix: the body is cut into parts, each bends little, and between them large rotations are exact.
//!
//! Each part has its own Green's functions and strain energy ([`energy`]) in the screws between its ends: interfaces to
//! other parts, and control elements ([`LinkedPart`]). For every pose the frames of the interfaces go to where the sum V of
//! all parts' energies is least ([`equilibrium`]); there ∂V by the control elements is the whole derivative (envelope
//! theorem), so that forces and moments are in equilibrium. [`PartShape`] makes the surface. Loads and forces at points act
//! on the ends of the part that they are on ([`loads`]); the bending of the part that they cause between its ends is left
//! out. Warmth lengthens parts at rest.

mod energy;
mod equilibrium;
mod link;
mod loads;

use crate::deform::loads::{Borne, Lumped, SLOTS};
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{
    Bearing, BodyState, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{ControlFrame, ControlPose, FrameSlope, PoseSlope, axial};
use crate::green::substructure::{Joint, StoredParts};
use crate::green::{LOAD_FORCES, SUBSTRUCTURES};
use energy::PartEnergy;
use equilibrium::{Assembly, Follower, Search};
use link::{ControlState, LinkedPart, PartEnd, Places};
use loads::{PartShape, Shares};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

pub const ENTRY: ModelEntry = ModelEntry {
    name: "substructured",
    summary: "method 3a: the body is cut into parts, whose interfaces are kept in equilibrium at any rotation",
    requirements: &[SUBSTRUCTURES],
    frame: Frame::Solved,
    energy: Some(&[]),
    // Of two ends against each other, with eight parts.
    turn_limits_deg: [60.0, 100.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Substructured::new(input)?))),
    loads: Bearing::Forces(&[LOAD_FORCES]),
    fits: None,
};

/// A body in parts.
pub struct Substructured {
    origins: Vec<Vector3<f64>>,
    rest: Places,
    /// The last that were settled, and those of the search.
    settled: Places,
    places: Places,
    assembly: Assembly,
    follower: Follower,
    shapes: Vec<PartShape>,
    field: Vec<[f32; 3]>,
    loads: Option<Lumped>,
    /// The poses of the last search, as many as there are control elements once there was one; and how it ended.
    poses: Vec<ControlPose>,
    is_defined: bool,
    search: Search,
    /// Energy of the last poses that were settled, J.
    energy: f64,
    /// The turns that the next poses continue.
    turns: Vec<UnitQuaternion<f64>>,
    frames: Vec<ControlFrame>,
    wanted: Vec<ControlState>,
    slopes: Vec<PoseSlope>,
}

const NO_TURN: FrameSlope =
    FrameSlope { force: Vector3::new(0.0, 0.0, 0.0), torque: Vector3::new(0.0, 0.0, 0.0), stretch: NOTHING };
const NOTHING: Matrix3<f64> = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
/// Factor by which the steps of a second try are finer.
const FINER: f64 = 4.0;

impl Substructured {
    /// The error says what the file lacks.
    pub fn new(input: &ModelInput<'_>) -> Result<Substructured, String> {
        let stored = StoredParts::read(input.table, input.controls.len(), input.rest.len())?;
        let at_rest = |place: &Vector3<f64>| Isometry3::from(*place);
        let origins: Vec<Vector3<f64>> = input.controls.iter().map(|control| control.origin).collect();
        let rest = Places {
            interfaces: stored.interfaces.iter().map(at_rest).collect(),
            controls: origins
                .iter()
                .map(|origin| ControlState { frame: at_rest(origin), stretch: [0.0; 6] })
                .collect(),
        };
        let everywhere =
            rest.interfaces.iter().map(|frame| frame.translation.vector).chain(origins.iter().copied());
        let first = origins.first().copied().unwrap_or_default();
        let size = everywhere.map(|place| (place - first).norm()).fold(0.0, f64::max);
        let size = if size > 0.0 { size } else { 1.0 };
        let (mut parts, mut shapes, mut all_ends) = (Vec::new(), Vec::new(), Vec::new());
        for part in &stored.parts {
            let end = |joint: &Joint| match joint {
                Joint::Interface(i) => PartEnd::Interface(*i),
                Joint::Control(e) => PartEnd::Control(*e),
            };
            let ends: Vec<PartEnd> = part.ends.iter().map(end).collect();
            let places: Vec<Vector3<f64>> =
                ends.iter().map(|end| rest.frame(*end).translation.vector).collect();
            shapes.push(PartShape::new(part, &places, input.rest, size));
            let energy = PartEnergy::new(&part.stiffness, &part.quadratic, &part.quartic);
            parts.push(LinkedPart::new(ends.clone(), &places, energy));
            all_ends.push(ends);
        }
        let mut assembly = Assembly::new(parts, &rest, size);
        let slots = SLOTS * (rest.interfaces.len() + rest.controls.len());
        let shares = Shares::new(&stored.parts, &all_ends, &rest, input.rest);
        let loads = Lumped::new(input, slots, Box::new(move |x| shares.at(x)))?;
        let mut places = rest.clone();
        let search = assembly.settle(&mut places);
        Ok(Substructured {
            follower: Follower::new(&rest, size),
            settled: rest.clone(),
            places,
            assembly,
            shapes,
            field: vec![[0.0; 3]; input.rest.len()],
            loads,
            poses: Vec::with_capacity(origins.len()),
            is_defined: true,
            energy: search.energy,
            search,
            turns: vec![UnitQuaternion::identity(); origins.len()],
            frames: Vec::with_capacity(origins.len()),
            wanted: rest.controls.clone(),
            slopes: vec![PoseSlope::default(); origins.len()],
            origins,
            rest,
        })
    }

    /// Goes to new poses, unless it is there; false where it was not.
    fn follow(&mut self, poses: &[ControlPose]) -> bool {
        let has_changed = self.loads.as_mut().is_some_and(Lumped::read);
        if self.poses == poses && !has_changed {
            return false;
        }
        self.poses.clear();
        self.poses.extend_from_slice(poses);
        self.bear();
        self.frames.clear();
        for ((origin, pose), turn) in self.origins.iter().zip(poses).zip(&self.turns) {
            self.frames.extend(ControlFrame::new(origin, pose, Some(turn)));
        }
        self.is_defined = self.frames.len() == self.origins.len();
        if !self.is_defined {
            return true;
        }
        // Hands turn on where the parts cannot follow.
        self.turns.iter_mut().zip(&self.frames).for_each(|(turn, frame)| *turn = frame.turn);
        if let Some(loads) = self.loads.as_mut().filter(|loads| !loads.is_none()) {
            loads.follow(poses, &self.turns);
            self.bear();
        }
        for (wanted, frame) in self.wanted.iter_mut().zip(&self.frames) {
            let s = frame.stretch - Matrix3::identity();
            let stretch = [s[(0, 0)], s[(1, 1)], s[(2, 2)], s[(0, 1)], s[(1, 2)], s[(2, 0)]];
            *wanted = ControlState { frame: frame.motion(), stretch };
        }
        for finer in [1.0, FINER] {
            self.search = self.follower.follow(&mut self.assembly, &mut self.places, &self.wanted, finer);
            if self.search.is_settled {
                break;
            }
            self.go_back();
        }
        self.is_defined = self.search.is_settled;
        if self.is_defined {
            self.keep();
        }
        true
    }

    /// Gives the parts what they bear.
    fn bear(&mut self) {
        let Some(loads) = &self.loads else { return };
        let slots = if loads.is_none() { &[][..] } else { loads.slots() };
        let interfaces = SLOTS * self.rest.interfaces.len();
        self.assembly.bear(slots.get(..interfaces).unwrap_or(&[]).chunks_exact(SLOTS).map(Borne::of_slots));
        let strain = loads.strain();
        self.assembly.parts.iter_mut().for_each(|part| part.strain = strain);
    }

    /// Loads on the frames of control elements beside the wrenches that hold these; empty where nothing acts.
    fn on_controls(&self) -> impl Iterator<Item = Borne> + '_ {
        let slots = self.loads.as_ref().filter(|loads| !loads.is_none()).map_or(&[][..], Lumped::slots);
        slots.chunks_exact(SLOTS).skip(self.rest.interfaces.len()).map(Borne::of_slots)
    }

    /// Makes the surface of the places at which the parts were last evaluated.
    fn shape(&mut self) {
        self.field.fill([0.0; 3]);
        for (shape, part) in self.shapes.iter_mut().zip(&self.assembly.parts) {
            shape.add(part, &self.places, &mut self.field);
        }
    }

    /// Back to the last settled places.
    fn go_back(&mut self) {
        self.places.interfaces.copy_from_slice(&self.settled.interfaces);
        self.places.controls.copy_from_slice(&self.settled.controls);
    }

    /// Keeps settled places and their slopes.
    fn keep(&mut self) {
        self.settled.interfaces.copy_from_slice(&self.places.interfaces);
        self.settled.controls.copy_from_slice(&self.places.controls);
        self.energy = self.search.energy;
        let on_controls: Vec<Borne> = self.on_controls().collect();
        for (e, (slope, frame)) in self.slopes.iter_mut().zip(&self.frames).enumerate() {
            let mut own = NO_TURN;
            for part in &self.assembly.parts {
                part.add_slope(e, &mut own);
            }
            if let Some(load) = on_controls.get(e) {
                let along = load.along(&frame.turn);
                own.force -= along.force;
                own.torque -= axial(&along.moments);
                self.energy += load.potential(&frame.place, &frame.turn);
            }
            own.force = frame.turn * own.force;
            own.torque = frame.turn * own.torque;
            *slope = frame.pull_back(&own);
        }
        if let Some(loads) = self.loads.as_ref().filter(|loads| !loads.is_none()) {
            self.energy += loads.hold(&self.poses, &mut self.slopes);
        }
    }
}

impl DeformationModel for Substructured {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.follow(poses);
        if self.is_defined {
            self.shape();
        }
        BodyState { rotation_undefined: !self.is_defined, ..BodyState::at_rest(0) }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.follow(poses);
        slopes.copy_from_slice(&self.slopes);
        Some(Response { energy: self.energy, is_defined: self.is_defined })
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        Some(&self.field)
    }

    fn memory(&self) -> ModelMemory {
        let mut memory = ModelMemory {
            turns: self.turns.clone(),
            poses: self.poses.clone(),
            is_defined: self.is_defined,
            energy: self.energy,
            slopes: self.slopes.clone(),
            ..ModelMemory::default()
        };
        for control in &self.settled.controls {
            memory.put(&control.frame);
            memory.unknowns.extend(control.stretch);
        }
        self.settled.interfaces.iter().for_each(|interface| memory.put(interface));
        if let Some(loads) = &self.loads {
            loads.keep(&mut memory);
        }
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        let Places { interfaces, controls } = &mut self.settled;
        let of_loads = if self.loads.is_some() { Lumped::KEPT } else { 0 };
        memory.suits(controls.len(), (7 + 6) * controls.len() + 7 * interfaces.len() + of_loads)?;
        let mut unknowns = Unknowns(&memory.unknowns);
        for control in controls {
            control.frame = unknowns.take();
            unknowns.fill(&mut control.stretch);
        }
        interfaces.iter_mut().for_each(|interface| *interface = unknowns.take());
        if let Some(loads) = &mut self.loads {
            loads.take_back(memory.loads.as_ref(), &mut unknowns);
            self.bear();
        }
        self.turns = memory.turns_of(self.origins.len());
        self.poses.clone_from(&memory.poses);
        self.is_defined = memory.is_defined;
        self.energy = memory.energy;
        self.slopes.clone_from(&memory.slopes);
        self.slopes.resize(self.origins.len(), PoseSlope::default());
        self.go_back();
        self.assembly.value(&self.places);
        self.shape();
        Ok(())
    }

    fn forget(&mut self) {
        self.poses.clear();
        self.turns.fill(UnitQuaternion::identity());
        self.places.clone_from(&self.rest);
        self.settled.clone_from(&self.rest);
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.get_mut(e) {
            *place = turn;
            self.poses.clear();
        }
    }
}

#[cfg(test)]
mod tests;
