//! The closed loop on a body that is bent far: a beam whose end the handle of a simulated device holds, turned by up to 90°, and
//! then lets go.
//!
//! In: a model, Young's modulus, how the device reports, the hand. Out: the [`SettlingResult`] of every release: whether the handle
//! comes to rest, and the energy that the loop gave beyond what the body and the coupling held.

use super::elastic::Elastic;
use super::grasp::{ElementHold, Grasp, HoldConstraint};
use super::settling::{SettlingResult, release, still};
use super::simulated::{Hand, Reports};
use super::tick::Control;
use crate::base::failure::Failure;
use crate::base::progress::Silent;
use crate::deform::{ControlPose, Deformer, ModelEntry, PLATE};
use crate::green::{self, Requirements};
use crate::scene::Scene;
use crate::stage::Haptic;
use nalgebra::{Isometry3, Matrix4, Similarity3, Translation3, UnitQuaternion, Vector3};
use std::path::Path;

/// Length of the beam, m.
const LENGTH_M: f64 = 0.3;

/// Section, m, and cells of the beam: a tenth as wide as it is long; for the model of thin bodies, which refuses that, a leaf
/// that is bent out of its plane.
const BEAM: ([f64; 2], [u32; 3]) = ([0.03, 0.03], [2, 2, 12]);
const LEAF: ([f64; 2], [u32; 3]) = ([0.006, 0.06], [1, 6, 30]);

/// Bends of the end, °.
pub const BENDS_DEG: [f64; 3] = [30.0, 60.0, 90.0];

/// The beam as a session has it, of Young's modulus `young`, Pa.
pub fn beam(model: &'static ModelEntry, young: f64) -> Result<Deformer, Failure> {
    of_section(model, young, if *model == PLATE { LEAF } else { BEAM })
}

fn of_section(
    model: &'static ModelEntry,
    young: f64,
    ([thick, wide], cells): ([f64; 2], [u32; 3]),
) -> Result<Deformer, Failure> {
    let text = format!(
        "[body.beam]\ngenerate = {{ block = {{ size = [{thick}, {wide}, {LENGTH_M}], cells = {cells:?} }} }}\n\
         material = {{ young = {young:e}, poisson = 0.3 }}\nmodel = \"{}\"\n\
         control.low = {{ nodes = {{ group = \"zmin\" }}, grab = \"fixed\" }}\n\
         control.high = {{ nodes = {{ group = \"zmax\" }}, grab = \"dragger\" }}\n",
        model.name
    );
    let scene = Scene::parse(&text, Path::new("bent.toml")).map_err(Failure::request)?;
    let requirements = [model.requirements, model.energy.unwrap_or_default()]
        .map(Requirements::new)
        .into_iter()
        .fold(Requirements::default(), Requirements::and);
    let made = green::precompute(&scene, "beam", &requirements, &Silent).map_err(Failure::work)?;
    let file = green::opened(&[made]).map_err(Failure::work)?;
    Deformer::new(file, "beam", model).map_err(Failure::wrong)
}

/// Lets go of the end, bent by `degrees` along a circular arc.
pub fn let_go(
    body: &Deformer,
    degrees: f64,
    haptic: &Haptic,
    reports: Reports,
    hand: Hand,
) -> Result<SettlingResult, Failure> {
    let elastic = Elastic::from_deformer(body).map_err(Failure::wrong)?;
    let origin = body.controls[1].origin;
    let angle = degrees.to_radians();
    let end = Vector3::new((1.0 - angle.cos()) / angle, 0.0, angle.sin() / angle - 1.0) * LENGTH_M;
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    // The handle is at the origin while the element rests.
    let start = Isometry3::from_parts(Translation3::from(origin + end - turn * origin), turn);
    let held = ElementHold {
        grip: 1,
        body: 0,
        element: 1,
        room_from_body: Similarity3::identity(),
        constraint: HoldConstraint::Rigid(Matrix4::new_translation(&origin)),
    };
    let grasp = Grasp { held: Some(held), poses: vec![ControlPose::REST; 2], ..Grasp::default() };
    let control = Control::new(haptic.clone(), vec![elastic], 0.0);
    Ok(release(control, &grasp, reports, (hand, still), &start))
}
