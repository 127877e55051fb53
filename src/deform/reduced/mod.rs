//! Method 2b as a basis: the mean frame of the control elements carries the body, which bends into fields of second and
//! third order so that its strain energy is least.
//!
//! In: the coefficients of the affine fields of the poses seen from the mean frame m ([`Posed`]), and the tables of the
//! family `reduced`. Out: x = m (X + Σ c_k u_k + Φ q - ō) with ∂V/∂q = 0 for V(y, q), y = Lᵀ c, the exact energy of St.
//! Venant–Kirchhoff's law in these fields; an upper bound of that of the mesh, exact to the fifth order for two elements.
//! Forces are the derivative of V by the poses, that of m included; q has no part in it. Loads and forces at points are forces on
//! (y, q) and m ([`FrameForces`]), and what they do at rest is among the fields Φ.

mod curvature;
mod equilibrium;
mod posed;
mod quartic;

use super::frames::PoseSlope;
use super::loads::FrameForces;
use super::memory::{ModelMemory, Unknowns};
use super::model::{Bearing, BodyState, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response};
use super::pose::ControlPose;
use crate::fem::QuarticShape;
use crate::green::{AFFINE, Lift, QUARTIC, REDUCED};
use equilibrium::ReducedBody;
use nalgebra::UnitQuaternion;

pub use curvature::Curvature;
pub use posed::Posed;
pub use quartic::Quartic;

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "reduced",
    summary: "method 2b as a basis: fields of second and third order in equilibrium; forces within 2 % to 60°, mostly to 90°",
    requirements: &[AFFINE, REDUCED],
    frame: Frame::MeanMotion,
    energy: Some(&[]),
    // Two elements at 90° turn the pieces at their ends by 45° against the mean frame.
    turn_limits_deg: [40.0, 75.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Reduced::new(input)?))),
    loads: Bearing::Forces(&[]),
    fits: None,
};

pub struct Reduced {
    posed: Posed,
    body: ReducedBody,
    loads: Option<FrameForces>,
    /// Poses that were settled last; none where they had no equilibrium.
    poses: Vec<ControlPose>,
    /// Energy and slopes of the last poses that had an equilibrium.
    energy: f64,
    slopes: Vec<PoseSlope>,
}

/// The table of the energy, and how many fields Φ it has; the error says what is wrong with it.
pub fn quartic_table(input: &ModelInput<'_>) -> Result<(Vec<f64>, usize), String> {
    let table = (input.table)(QUARTIC)
        .ok_or_else(|| format!("the table {QUARTIC} is missing; run `greenstage precompute` on the scene"))?;
    let lifted = Lift::of(input.controls.len()).len();
    let is_of = |fields: &usize| QuarticShape { variables: 1 + lifted + fields }.len() == table.len();
    let fields = (0..256)
        .find(is_of)
        .ok_or_else(|| format!("the table {QUARTIC} has {} numbers, which suits no fields", table.len()))?;
    Ok((table.as_slice().to_vec(), fields))
}

impl Reduced {
    pub fn new(input: &ModelInput<'_>) -> Result<Reduced, String> {
        let (coefficients, fields) = quartic_table(input)?;
        let elements = input.controls.len();
        let lift = Lift::of(elements);
        let body = ReducedBody::new(lift.rigid, lift.len() - lift.rigid, fields, &coefficients);
        Ok(Reduced {
            loads: FrameForces::of(input, fields)?,
            posed: Posed::new(input.controls),
            body: body.ok_or_else(|| format!("the table {QUARTIC} does not suit the control elements"))?,
            poses: Vec::with_capacity(elements),
            energy: 0.0,
            slopes: vec![PoseSlope::default(); elements],
        })
    }

    /// Loads have second derivatives of their own, which are not made beside the equilibrium.
    fn is_loaded(&self) -> bool {
        self.loads.as_ref().is_some_and(|loads| !loads.is_none)
    }

    /// Finds m, c and q of the poses; `None` where there are none.
    fn settle(&mut self, poses: &[ControlPose]) -> Option<()> {
        let has_changed = self.loads.as_mut().is_some_and(FrameForces::read);
        if self.poses == poses && !has_changed {
            return Some(());
        }
        self.poses.clear();
        self.posed.take(poses)?;
        let y = self.posed.coordinates();
        self.energy = match self.loads.as_mut().filter(|loads| !loads.is_none) {
            None => self.body.settle(y, None)?,
            Some(loads) => {
                let m = self.posed.mean();
                loads.find(m);
                self.body.settle(y, Some(&mut loads.burden))? + loads.beside(m)
            }
        };
        self.poses.extend_from_slice(poses);
        Some(())
    }
}

impl DeformationModel for Reduced {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        let is_found = self.settle(poses).is_some();
        let coefficients = self.posed.coefficients().iter().chain(self.body.q()).copied().collect();
        BodyState {
            parts: vec![self.posed.body_from_surface()],
            coefficients,
            rotation_undefined: !is_found,
            field_version: 0,
        }
    }

    /// Energy and forces at `poses`; where there is no mean frame or no equilibrium, the last ones go on.
    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        let found = self.settle(poses);
        let (body, posed) = (&self.body, &mut self.posed);
        let loads = self.loads.as_ref().filter(|loads| !loads.is_none);
        let by_mean = loads.map(|loads| -loads.by_frame(posed.mean(), body.z()));
        let own = &mut self.slopes;
        let found = found.and_then(|()| posed.pull_back(poses, &|k| body.slope(k), (None, by_mean), own));
        slopes.copy_from_slice(&self.slopes);
        Some(Response { energy: self.energy, is_defined: found.is_some() })
    }

    fn prepare_beside(&mut self, anew: bool) -> bool {
        self.poses.is_empty() || self.is_loaded() || self.body.prepare_beside(anew)
    }

    fn respond_beside(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        if self.poses.is_empty() || self.is_loaded() {
            return None;
        }
        let (body, posed) = (&mut self.body, &mut self.posed);
        let found = posed.take(poses).and_then(|()| body.settle_beside(posed.coordinates()));
        let found = found.and_then(|added| {
            posed.pull_back(poses, &|k| body.slope_beside(k), (None, None), slopes)?;
            Some(Response { energy: self.energy + added, is_defined: true })
        });
        // Where that fails, the poses are settled anew.
        if posed.take(&self.poses).is_none() {
            self.poses.clear();
        }
        found
    }

    fn was_long(&self) -> bool {
        self.body.was_long()
    }

    fn memory(&self) -> ModelMemory {
        let (poses, slopes) = (self.poses.clone(), self.slopes.clone());
        let mut memory = ModelMemory { poses, slopes, energy: self.energy, ..ModelMemory::default() };
        self.posed.keep(&mut memory);
        self.body.keep(&mut memory.unknowns);
        memory.loads = self.loads.as_ref().map(|loads| loads.applied().clone());
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        memory.suits(self.posed.elements(), self.posed.kept() + self.body.kept())?;
        let mut unknowns = Unknowns(&memory.unknowns);
        self.posed.take_back(memory, &mut unknowns);
        self.body.take_back(&mut unknowns);
        self.poses.clone_from(&memory.poses);
        self.energy = memory.energy;
        self.slopes.clone_from(&memory.slopes);
        self.slopes.resize(self.posed.elements(), PoseSlope::default());
        if let (Some(loads), Some(applied)) = (&mut self.loads, &memory.loads) {
            loads.set_applied(applied);
            loads.find(self.posed.mean());
        }
        Ok(())
    }

    fn forget(&mut self) {
        self.poses.clear();
        self.posed.forget();
        self.body.forget();
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        self.poses.clear();
        self.posed.set_turn(e, turn);
    }
}

#[cfg(test)]
pub mod tests;
