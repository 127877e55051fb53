//! The memory of a model: all that it keeps from one frame to the next, as plain data.
//!
//! A model that is given the memory of another one of the same body answers all further poses with the same bits. Scratch
//! and whatever follows from the memory, such as a factor or the shape that is drawn, is no part of it.

use super::loads::applied::{AppliedLoads, StaticForces};
use super::pose::frame::{ControlPoses, PoseSlope};
use crate::field::numbers::Numbers;
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

/// The memory of one model; a model leaves empty what it does not need.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ModelMemory {
    /// Rotations of the control elements; the next poses continue them.
    #[serde(with = "crate::field::numbers::list")]
    pub turns: Vec<UnitQuaternion<f64>>,
    /// The poses that were evaluated last. Without them the next evaluation is not skipped, whatever its poses.
    pub poses: ControlPoses,
    /// Whether these had a mean frame and an equilibrium.
    pub is_defined: bool,
    /// V, J, and its slopes by the poses, at the last poses that had them.
    #[serde(with = "crate::field::numbers")]
    pub energy: f64,
    pub slopes: Vec<PoseSlope>,
    /// Mean frames, equilibria and where the next search begins, in the order in which the model reads them.
    #[serde(with = "crate::field::numbers::flat")]
    pub unknowns: Vec<f64>,
    /// Loads that acted then, for a model that has loads in its equilibrium.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loads: Option<AppliedLoads>,
    /// An equilibrium that was found in the background, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub found: Option<Box<FoundMemory>>,
}

/// The newest equilibrium of a thread that searches for them, and the warm start from which it goes on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoundMemory {
    /// Displacements of the surface nodes, m, and the poses of the equilibrium that is shown.
    pub field: Vec<[f32; 3]>,
    pub poses: ControlPoses,
    /// Whether an element is turned inside out in it.
    pub is_inverted: bool,
    /// Whether it is that of the poses that were asked for last, or no equilibrium was found beyond it.
    pub is_reached: bool,
    pub is_lost: bool,
    /// Warm start of the next search.
    pub warm: Warm,
}

/// Warm start of a search for equilibria.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Warm {
    /// The last equilibrium, and the one at which the factor was made.
    pub held: HeldNodes,
    pub factored: HeldNodes,
    /// Whether no equilibrium was found with that factor yet, and how often the step was halved.
    pub is_new: bool,
    pub halved: u32,
}

/// All nodes of a body in equilibrium.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldNodes {
    pub poses: ControlPoses,
    /// Displacements, three for each node, m.
    #[serde(with = "crate::field::numbers::flat")]
    pub u: Vec<f64>,
    /// Rotations of the control elements since rest.
    #[serde(with = "crate::field::numbers::list")]
    pub turns: Vec<UnitQuaternion<f64>>,
    /// Loads beside the control elements.
    pub loads: StaticForces,
}

impl ModelMemory {
    /// Checks that the memory is that of a model with `elements` control elements and `unknowns` unknowns; the error says how it
    /// differs.
    pub(super) fn suits(&self, elements: usize, unknowns: usize) -> Result<(), String> {
        let lists = [("turns", self.turns.len()), ("poses", self.poses.len()), ("slopes", self.slopes.len())];
        if let Some((what, count)) = lists.iter().find(|(_, count)| *count != 0 && *count != elements) {
            return Err(format!(
                "a model's memory has {count} {what}, the body has {elements} control elements: it belongs to another body"
            ));
        }
        if self.unknowns.len() != unknowns {
            return Err(format!(
                "a model's memory has {} unknowns, the model has {unknowns}: it belongs to another model or body",
                self.unknowns.len()
            ));
        }
        Ok(())
    }

    pub(super) fn put<T: Numbers>(&mut self, value: &T) {
        self.unknowns.extend(value.list());
    }

    /// The turns; those at rest where there are none.
    pub(super) fn turns_of(&self, elements: usize) -> Vec<UnitQuaternion<f64>> {
        let mut turns = self.turns.clone();
        turns.resize(elements, UnitQuaternion::identity());
        turns
    }
}

/// Reads unknowns in the order in which they were put. [`ModelMemory::suits`] has counted them.
pub(super) struct Unknowns<'a>(pub &'a [f64]);

impl Unknowns<'_> {
    pub fn take<T: Numbers>(&mut self) -> T {
        let (own, rest) = self.0.split_at(T::COUNT);
        self.0 = rest;
        T::made(own)
    }

    pub fn fill(&mut self, to: &mut [f64]) {
        let (own, rest) = self.0.split_at(to.len());
        self.0 = rest;
        to.copy_from_slice(own);
    }
}
