//! How far the forces of a model hold on one body: the model against the equilibria that the body's file keeps with their wrenches.
//!
//! In: a [`GreenFile`] whose body has the table of equilibria of a reduced model. Out: the worst error of force and torque among
//! those turned up to 30°, 60°, 90° and further, and among those pulled and pressed. Some of the equilibria made no field of the
//! model ([`PathKind::HeldOut`]), so that it cannot know them.

use super::deformer::Deformer;
use super::model::ModelEntry;
use super::pose::frame::{ControlPose, Wrench};
use super::pose::se3;
use super::trial::{Deviation, PoseResult};
use crate::base::table::count;
use crate::green::{EQUILIBRIA, FIELDS, GreenFile, KnownEquilibrium, PathKind};
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3, Vector6};
use serde::Serialize;
use std::sync::Arc;

/// Turns of two control elements against each other up to which errors are told apart, °.
const TURNS: [f64; 3] = [30.0, 60.0, 90.0];
/// Largest step of a turn on the way to an equilibrium, °, and the least number of steps.
const STEP: f64 = 10.0;
const LEAST_STEPS: f64 = 4.0;

/// The worst errors of a model's forces and torques, as parts of the largest force or torque over length of each equilibrium.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ModelReach {
    /// Turned by up to 30°, 60°, 90°, and further; `None` where the body has no such equilibrium.
    pub turned: [Option<f64>; 4],
    /// Pulled or pressed by up to a tenth.
    pub stretched: Option<f64>,
    pub equilibria: usize,
    /// Those among them of which no field was made.
    pub held_out: usize,
    /// Equilibria with tetrahedra inside out, which no real body has; they are in none of the other numbers.
    pub inverted: usize,
}

impl ModelReach {
    /// Compares a body's model with its equilibria; `None` where the file has none or the model has no forces.
    pub fn measure(
        file: &Arc<GreenFile>,
        body: &str,
        model: &'static ModelEntry,
    ) -> Result<Option<ModelReach>, String> {
        let Some(table) = file.table(body, EQUILIBRIA) else { return Ok(None) };
        let mut deformer = Deformer::new(file.clone(), body, model)?;
        let mut reach = ModelReach::default();
        for known in table.column_iter().filter_map(|column| KnownEquilibrium::read(column.as_slice())) {
            if known.is_inverted {
                reach.inverted += 1;
                continue;
            }
            let Some((turn, error)) = compare(&mut deformer, &known) else { return Ok(None) };
            reach.equilibria += 1;
            reach.held_out += usize::from(known.kind == PathKind::HeldOut);
            let place = match known.kind {
                PathKind::Stretched => &mut reach.stretched,
                _ => {
                    let band = TURNS.iter().position(|most| turn <= most + 0.5);
                    &mut reach.turned[band.unwrap_or(TURNS.len())]
                }
            };
            *place = Some(place.map_or(error, |worst| worst.max(error)));
        }
        Ok((reach.equilibria > 0).then_some(reach))
    }

    /// A line about it.
    pub fn text(&self) -> String {
        let percent = |part: f64| match part {
            part if part < 1e-3 => "0.1 %".to_owned(),
            part if part < 0.1 => format!("{:.1} %", 100.0 * part),
            part => format!("{:.0} %", 100.0 * part),
        };
        let mut worst = 0.0_f64;
        let mut parts = Vec::new();
        let names = ["to 30°", "to 60°", "to 90°", "twisted to 330°"];
        for (name, error) in names.iter().zip(self.turned) {
            let Some(error) = error else { continue };
            worst = worst.max(error);
            parts.push(format!("{} {name}", percent(worst)));
        }
        parts.extend(self.stretched.map(|error| format!("{} pulled or pressed", percent(error))));
        let inverted = match self.inverted {
            0 => String::new(),
            some => format!("; {} more have tetrahedra inside out", count(some, "state")),
        };
        format!(
            "forces within {}, measured against {} equilibria of this body, {} of which the model was not made from{inverted}",
            parts.join(", "),
            self.equilibria,
            self.held_out
        )
    }
}

/// The turn of an equilibrium, °, and how far the deformer's forces are from it; `None` of a model without forces.
fn compare(deformer: &mut Deformer, known: &KnownEquilibrium) -> Option<(f64, f64)> {
    let origins: Vec<Vector3<f64>> = deformer.controls.iter().map(|control| control.origin).collect();
    let screws: Vec<Vector6<f64>> =
        known.coefficients.chunks_exact(FIELDS).zip(&origins).map(|(c, origin)| screw(c, origin)).collect();
    let [low, high] = screws[..] else { return None };
    let turn = (high - low).fixed_rows::<3>(3).norm().to_degrees();
    let steps = (turn / STEP).ceil().max(LEAST_STEPS);
    let poses = |share: f64| -> Vec<ControlPose> {
        screws.iter().zip(&origins).map(|(screw, origin)| pose(&se3::exp(&(screw * share)), origin)).collect()
    };
    deformer.forget();
    (1..steps as usize).for_each(|step| {
        deformer.take(&poses(step as f64 / steps));
    });
    deformer.evaluate(&poses(1.0));
    let found = PoseResult::of_model(deformer);
    found.wrenches.as_ref()?;
    let wrench = |[force, moment]: [Vector3<f64>; 2]| Wrench { force, moment };
    let truth = PoseResult {
        wrenches: Some(known.wrenches.map(wrench).to_vec()),
        energy: known.energy,
        surface: Vec::new(),
    };
    let length = (origins[1] - origins[0]).norm();
    let off = Deviation::new(&PoseResult { surface: Vec::new(), ..found }, &truth, length);
    let of = |part: Option<f64>| part.unwrap_or(f64::INFINITY);
    Some((turn, of(off.force).max(of(off.torque))))
}

/// ξ of the motion with the coefficients c of an element.
fn screw(c: &[f64], origin: &Vector3<f64>) -> Vector6<f64> {
    let matrix = Matrix3::identity() + Matrix3::from_row_slice(&c[3..FIELDS]);
    let turn = UnitQuaternion::from_matrix(&matrix);
    se3::log(&turn, &(origin + Vector3::from_column_slice(&c[..3]) - turn * origin))
}

/// The pose of an element that goes along with a rigid motion.
fn pose(motion: &Isometry3<f64>, origin: &Vector3<f64>) -> ControlPose {
    let Isometry3 { rotation, translation: Translation3 { vector } } = motion;
    ControlPose {
        translation: vector + rotation * origin - origin,
        matrix: *rotation.to_rotation_matrix().matrix(),
    }
}
