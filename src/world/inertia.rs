//! Bodies that move by their own inertia, for an effect that presses them in the course of a frame.
//!
//! In: forces at nodes of the surface. Out: poses of control elements that nothing holds and amplitudes of modes, at the end of each of
//! several steps into which the effect divides the frame. With r_ik the motion of node i in coordinate k and the weights w_k of a step, a
//! force f at node j moves node i by Σ_k w_k r_ik r_jkᵀ f until its end, beyond what the columns of the compliance give.

use crate::deform::{ControlPose, Deformer};
use nalgebra::{UnitQuaternion, Vector3};
use std::ops::Range;

/// Forces at nodes of the surface, along the body's axes.
pub type NodeForces = [(u32, Vector3<f64>)];

/// Forces on a body in a step.
#[derive(Clone, Copy, Debug)]
pub struct StepForces<'a> {
    /// Mean over the step: what acts on the motion.
    pub mean: &'a NodeForces,
    /// Forces at its end: what the columns show.
    pub end: &'a NodeForces,
}

/// Poses and amplitudes of a body at the end of a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Gone {
    pub poses: Vec<ControlPose>,
    pub amplitudes: Vec<f64>,
}

/// The end of a frame, as hands and commands have it.
pub struct Coming {
    pub time_s: f64,
    pub poses: Vec<ControlPose>,
    /// Whether a hand holds each control element ([`World::is_carried`](super::World::is_carried)).
    pub carried: Vec<bool>,
}

/// A body with inertia.
pub trait Inertia {
    /// Index in the world.
    fn body(&self) -> usize;

    /// Begins the frame of a body, given without inertia and pressing forces; its length, s. `None` where time does not go on.
    fn begin(&mut self, coming: Coming, body: &Deformer) -> Option<f64>;

    /// Whether a control element moves by inertia in this frame.
    fn moves(&self, control: usize) -> bool;

    /// The place of the amplitudes among the coefficients of effects.
    fn columns(&self) -> Range<usize>;

    /// Poses and amplitudes where the last step ended.
    fn now(&self) -> Gone;

    /// r of a node for each coordinate, along the axes of the columns.
    fn rows(&self, deformer: &Deformer, node: u32) -> Vec<Vector3<f64>>;

    /// w of a step from the last one's end to this share of the frame, if a force at its end acts with `part` of it in the mean.
    fn weights(&self, share: f64, part: f64) -> Vec<f64>;

    /// Tries a step to this share of the frame. `turn` is the axes of the columns where it begins, body_from_columns.
    fn go(
        &mut self,
        share: f64,
        turn: &UnitQuaternion<f64>,
        deformer: &Deformer,
        forces: StepForces<'_>,
    ) -> Gone;

    /// Ends the step that was tried last.
    fn keep(&mut self);
}
