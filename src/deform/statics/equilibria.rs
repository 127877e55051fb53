//! Methods 1a and 1b of the paper's appendix online: the body is in static equilibrium at large strain, found in the
//! background ([`Background`]).
//!
//! In: the poses and loads of every frame. Out: the newest equilibrium, which belongs to poses a moment ago, with its age. Between two
//! equilibria the energy is the quadratic one about the newest, in the coefficients c of the poses,
//!
//! ```text
//! V(c) = V₀ + g·(c - c₀) + ½ (c - c₀)ᵀ H (c - c₀)     H = Φᵀ K Φ
//! ```
//!
//! g being the forces that hold the newest equilibrium and H the stiffness of the control elements there, of which Φ keeps
//! the free nodes in balance. Its gradient is what a hand feels.

use super::background::Background;
use super::held_volume;
use crate::deform::loads::SharedLoads;
use crate::deform::loads::applied::StaticForces;
use crate::deform::loads::lumped::NodalLoads;
use crate::deform::memory::{FoundMemory, ModelMemory, Unknowns};
use crate::deform::model::{BodyState, DeformationModel, ModelInput, Response, StateAge};
use crate::deform::pose::frame::{ControlPose, ControlPoses, PoseSlope, unwrapped};
use crate::deform::pose::screw::from_rest;
use crate::fem::Law;
use crate::green::{FIELDS, Volume};
use nalgebra::{DMatrix, DVector, Quaternion, UnitQuaternion, Vector3, Vector4};
use std::collections::VecDeque;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

/// Number of legs, of 90° at most, in which a body whose turns were set anew goes there from rest.
const LEGS: usize = 4;

/// The model of a body under `law`; the error says why this body cannot have it.
pub fn make(law: &'static Law, input: &ModelInput<'_>) -> Result<Box<dyn DeformationModel>, String> {
    let volume = Volume::read(input.table, input.controls.len())?;
    let columns = input.loads.map(|loads| NodalLoads::of_table(loads.metas, &volume.forces));
    let loads = input.loads.map(|loads| loads.shared.clone());
    let surface = volume.surface.clone();
    let background = Arc::new(held_volume::start(law, volume, columns)?);
    let model = Equilibria::new(background, input.controls.len());
    let origins = input.controls.iter().map(|control| control.origin).collect();
    Ok(Box::new(Equilibria { origins, loads, surface, ..model }))
}

struct Equilibria {
    background: Arc<Background>,
    /// o_e, m.
    origins: Vec<Vector3<f64>>,
    /// Displacements of the newest equilibrium that was taken, and which it is.
    field: Vec<[f32; 3]>,
    is_inverted: bool,
    version: u64,
    turns: Vec<UnitQuaternion<f64>>,
    /// Turns that the next poses continue.
    set: Vec<Option<UnitQuaternion<f64>>>,
    is_forgotten: bool,
    waits: bool,
    /// The loads that are applied, and the mesh's node of every surface node.
    loads: Option<SharedLoads>,
    surface: Vec<u32>,
    acting: StaticForces,
    quadratic: Quadratic,
}

/// V about the newest equilibrium.
struct Quadratic {
    version: u64,
    stiffness_version: u64,
    is_lost: bool,
    energy: f64,
    /// The poses of the equilibrium; c₀, g and H.
    poses: ControlPoses,
    coefficients: DVector<f64>,
    slope: DVector<f64>,
    stiffness: DMatrix<f64>,
    /// c - c₀ and H (c - c₀).
    change: DVector<f64>,
    product: DVector<f64>,
}

impl Equilibria {
    fn new(background: Arc<Background>, controls: usize) -> Equilibria {
        let zeros = DVector::zeros(FIELDS * controls);
        let field = background.newest().field.clone();
        Equilibria {
            field,
            background,
            origins: Vec::new(),
            is_inverted: false,
            version: 0,
            turns: vec![UnitQuaternion::identity(); controls],
            set: vec![None; controls],
            is_forgotten: false,
            waits: false,
            loads: None,
            surface: Vec::new(),
            acting: StaticForces::default(),
            quadratic: Quadratic {
                version: 0,
                stiffness_version: 0,
                is_lost: false,
                energy: 0.0,
                poses: vec![ControlPose::REST; controls],
                coefficients: zeros.clone(),
                slope: zeros.clone(),
                stiffness: DMatrix::zeros(zeros.len(), zeros.len()),
                change: zeros.clone(),
                product: zeros,
            },
        }
    }

    /// The way from rest to these poses, where they are not the next ones on the way that the body goes.
    fn anew(&mut self, poses: &[ControlPose]) -> Option<VecDeque<ControlPoses>> {
        let mut turns = unwrapped(Some(&self.turns), poses);
        let mut is_anew = std::mem::take(&mut self.is_forgotten);
        for (turn, set) in turns.iter_mut().zip(&mut self.set) {
            if set.take().is_some_and(|set| turn.coords.dot(&set.coords) < 0.0) {
                *turn = UnitQuaternion::new_unchecked(-turn.into_inner());
                is_anew = true;
            }
        }
        let way = is_anew.then(|| {
            let leg = |leg: usize| from_rest(&self.origins, poses, &turns, leg as f64 / LEGS as f64);
            (1..LEGS).map(leg).collect()
        });
        self.turns = turns;
        way
    }
}

impl DeformationModel for Equilibria {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        let anew = self.anew(poses);
        if let Some(shared) = &self.loads {
            let applied = shared.lock().unwrap_or_else(PoisonError::into_inner);
            let node_of = |node: u32| self.surface.get(node as usize).copied();
            if let Some(acting) = StaticForces::from_loads(&applied, node_of) {
                self.acting = acting;
            }
        }
        if self.waits {
            // What a state left unfinished is found first: how far it came until these poses would depend on the time.
            drop(self.background.awaited());
        }
        self.background.ask(poses, &self.acting, anew);
        let found = if self.waits { self.background.awaited() } else { self.background.newest() };
        if self.version != found.version {
            self.version = found.version;
            self.is_inverted = found.is_inverted;
            self.field.copy_from_slice(&found.field);
        }
        BodyState::at_rest(0)
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        let quadratic = &mut self.quadratic;
        let newest = match self.waits {
            true => Some(self.background.newest()),
            false => self.background.newest_at_once(),
        };
        if let Some(found) = newest.filter(|found| found.version != quadratic.version) {
            quadratic.version = found.version;
            quadratic.is_lost = found.is_lost;
            quadratic.energy = found.energy;
            quadratic.poses.clone_from(&found.poses);
            write(&mut quadratic.coefficients, found.poses.iter().map(ControlPose::coefficients));
            write(&mut quadratic.slope, found.slopes.iter().map(PoseSlope::numbers));
            if quadratic.stiffness_version != found.stiffness_version {
                quadratic.stiffness_version = found.stiffness_version;
                quadratic.stiffness.copy_from(&found.stiffness);
            }
        }
        let is_defined = quadratic.version > 0 && !quadratic.is_lost;
        Some(Response { energy: quadratic.at(poses, slopes), is_defined })
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        Some(&self.field)
    }

    fn memory(&self) -> ModelMemory {
        let (poses, is_reached, warm) = self.background.keep();
        let Quadratic { is_lost, energy, slope, .. } = &self.quadratic;
        let found = FoundMemory {
            field: self.field.clone(),
            is_inverted: self.is_inverted,
            poses: self.quadratic.poses.clone(),
            is_reached,
            is_lost: *is_lost,
            warm: (*warm).clone(),
        };
        let mut memory = ModelMemory {
            turns: self.turns.clone(),
            poses,
            is_defined: self.quadratic.version > 0,
            energy: *energy,
            slopes: slope.as_slice().chunks_exact(FIELDS).map(PoseSlope::of_numbers).collect(),
            found: Some(Box::new(found)),
            ..ModelMemory::default()
        };
        memory.unknowns.push(f64::from(u8::from(self.is_forgotten)));
        for set in &self.set {
            // A quaternion of zeros is none.
            memory.put(&set.unwrap_or(UnitQuaternion::new_unchecked(Quaternion::from([0.0; 4]))));
        }
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        let controls = self.set.len();
        memory.suits(controls, 1 + 4 * controls)?;
        let found = memory.found.as_ref().ok_or("a model's memory has no equilibrium")?;
        let response = (memory.energy, memory.slopes.clone());
        let version = self.background.restore(found, memory.poses.clone(), response)?;
        let quadratic = &mut self.quadratic;
        (quadratic.energy, quadratic.is_lost) = (memory.energy, found.is_lost);
        quadratic.version = version;
        quadratic.poses.clone_from(&found.poses);
        write(&mut quadratic.coefficients, found.poses.iter().map(ControlPose::coefficients));
        write(&mut quadratic.slope, memory.slopes.iter().map(PoseSlope::numbers));
        self.version = version;
        self.field.copy_from_slice(&found.field);
        self.is_inverted = found.is_inverted;
        self.turns = memory.turns_of(controls);
        let mut unknowns = Unknowns(&memory.unknowns);
        self.is_forgotten = unknowns.take::<f64>() == 1.0;
        for set in &mut self.set {
            let turn: UnitQuaternion<f64> = unknowns.take();
            *set = (turn.coords != Vector4::zeros()).then_some(turn);
        }
        Ok(())
    }

    fn is_inverted(&self) -> bool {
        self.is_inverted
    }

    fn has_news(&mut self) -> bool {
        let (shown, felt) = (self.version, self.quadratic.version);
        let found = self.background.newest_at_once();
        found.is_some_and(|found| found.version != shown || found.version != felt)
    }

    fn forget(&mut self) {
        self.turns.fill(UnitQuaternion::identity());
        self.is_forgotten = true;
        self.set.fill(None);
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.set.get_mut(e) {
            *place = Some(turn);
        }
    }

    /// Waits for every equilibrium if `patience` is [`Duration::MAX`], and for none otherwise.
    fn be_patient(&mut self, patience: Duration) {
        self.waits = patience == Duration::MAX;
        self.background.be_awaited(self.waits);
    }

    fn feel(&mut self) {
        self.background.feel();
    }

    fn for_force_loop(&self) -> Option<Box<dyn DeformationModel>> {
        self.background.feel_in_loop();
        let controls = self.set.len();
        Some(Box::new(Felt { of: Equilibria::new(self.background.clone(), controls) }))
    }

    fn age(&self) -> Option<StateAge> {
        let found = self.background.newest();
        Some(if found.is_lost {
            StateAge::Lost
        } else if self.background.is_up_to_date(&found) {
            StateAge::Current
        } else {
            StateAge::Old { seconds: found.asked_at.elapsed().as_secs_f64() }
        })
    }
}

/// A body's equilibria for a force loop: it asks for none itself, and feels those that are shown.
struct Felt {
    of: Equilibria,
}

impl DeformationModel for Felt {
    fn state(&mut self, _poses: &[ControlPose]) -> BodyState {
        BodyState::at_rest(0)
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.of.respond(poses, slopes)
    }
}

impl Quadratic {
    fn at(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> f64 {
        write(&mut self.change, poses.iter().map(ControlPose::coefficients));
        self.change -= &self.coefficients;
        self.product.gemv(1.0, &self.stiffness, &self.change, 0.0);
        let energy = self.energy + self.change.dot(&self.slope) + 0.5 * self.change.dot(&self.product);
        self.product += &self.slope;
        for (slope, g) in slopes.iter_mut().zip(self.product.as_slice().chunks_exact(FIELDS)) {
            *slope = PoseSlope::of_numbers(g);
        }
        energy
    }
}

fn write(to: &mut DVector<f64>, from: impl Iterator<Item = [f64; FIELDS]>) {
    for (place, numbers) in to.as_mut_slice().chunks_exact_mut(FIELDS).zip(from) {
        place.copy_from_slice(&numbers);
    }
}
