//! Errors that the mesh adds to the forces of a body: at most, and in the motion that brings it to a pose.
//!
//! In: the stiffness K of a control element against its small rigid motions x, all others resting, and K' of a better mesh. Out: the
//! part of the wrench that is the mesh's. Of the linear wrench K x this is |(K - K') x| / |K' x|, of each load what was measured of it;
//! what a pose has beside them, by large strain or touch, has the error of the worst motion.

use super::deformer::Deformer;
use super::pose::frame::{ControlPose, Wrench};
use super::pose::se3::inverse_slide_matrix;
use super::trial::Moved;
use super::turn::{RESTS, Relative};
use crate::fem::nearest_turn;
use nalgebra::{Matrix6, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Estimated errors of a linear body by its mesh and element, in the small rigid motion where they are largest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshErrors {
    /// Error of force and torque, relative.
    pub wrench: f64,
    /// Error of the displacements of the surface, relative, root mean square.
    pub shape: f64,
    /// Stiffness by both meshes, for the error of each motion.
    #[serde(default)]
    pub stiffness: Option<RigidStiffness>,
    /// Error of the wrench by a unit of each column of loads: the larger of the errors of force and of torque over the length, N.
    #[serde(default)]
    pub loads: Vec<f64>,
}

impl MeshErrors {
    /// The larger of both.
    pub fn and(&self, other: &MeshErrors) -> MeshErrors {
        let (wrench, shape) = (self.wrench.max(other.wrench), self.shape.max(other.shape));
        MeshErrors { wrench, shape, stiffness: None, loads: Vec::new() }
    }
}

/// Force and moment for a small shift (m) and turn (rad) of a control element about its origin: N and N·m, by two meshes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigidStiffness {
    /// Stiffness by the body's own mesh.
    pub own: [[f64; 6]; 6],
    /// Stiffness by the better mesh.
    pub better: [[f64; 6]; 6],
}

impl RigidStiffness {
    pub fn new(own: &Matrix6<f64>, better: &Matrix6<f64>) -> RigidStiffness {
        let rows = |k: &Matrix6<f64>| [0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|j| k[(i, j)]));
        RigidStiffness { own: rows(own), better: rows(better) }
    }

    /// Rounds to twelve digits, for a slender body can be a hundred thousand times softer in bending than in stretching, and to 0
    /// where an entry is nothing beside its row and column.
    pub fn rounded(&self) -> RigidStiffness {
        let round = |k: [[f64; 6]; 6]| {
            let is_noise = |i: usize, j: usize| k[i][j].powi(2) < 1e-16 * (k[i][i] * k[j][j]).abs();
            let number = |i: usize, j: usize| match is_noise(i, j) {
                true => 0.0,
                false => format!("{:.11e}", k[i][j]).parse().unwrap_or(k[i][j]),
            };
            [0, 1, 2, 3, 4, 5].map(|i| [0, 1, 2, 3, 4, 5].map(|j| number(i, j)))
        };
        RigidStiffness { own: round(self.own), better: round(self.better) }
    }

    pub fn numbers(&self) -> impl Iterator<Item = f64> + use<> {
        [self.own, self.better].into_iter().flatten().flatten()
    }

    /// The wrenches K x and K' x.
    fn wrenches(&self, x: &Vector6<f64>) -> [Vector6<f64>; 2] {
        [self.own, self.better].map(|k| Matrix6::from_fn(|i, j| k[i][j]) * x)
    }
}

/// The larger of force and torque over the length, N.
pub fn wrench_size(w: &Vector6<f64>, length: f64) -> f64 {
    let [force, torque] = sizes(w, length);
    force.max(torque)
}

/// Force and torque over the length, N.
fn sizes(w: &Vector6<f64>, length: f64) -> [f64; 2] {
    [w.fixed_rows::<3>(0).norm(), w.fixed_rows::<3>(3).norm() / length]
}

impl MeshErrors {
    /// The mesh's part of the force on a control element and of its torque over the length, as parts of the larger of both.
    fn at(&self, against: &Against) -> Option<[f64; 2]> {
        let [own, better] = self.stiffness.as_ref()?.wrenches(&against.motion);
        let size = |w: Vector6<f64>| wrench_size(&w, against.length);
        let whole = size(against.wrench);
        let of_motion = sizes(&(own - better), against.length).map(|apart| match apart / size(better) {
            part if part.is_finite() => part * size(own),
            _ => 0.0,
        });
        let loads = &against.loads;
        // Loads that nothing was measured of have none of this part.
        let is_known = self.loads.len() == loads.coefficients.len();
        let (of_loads, by_loads) = match is_known {
            true => {
                (self.loads.iter().zip(&loads.coefficients).map(|(d, c)| d * c.abs()).sum(), loads.wrench)
            }
            false => (0.0, Vector6::zeros()),
        };
        let beside = self.wrench * size(against.wrench - own - by_loads);
        let parts = of_motion.map(|of_motion| (of_motion + of_loads + beside) / whole);
        let most = self.wrench.max(of_loads / whole);
        parts.iter().all(|part| part.is_finite()).then(|| parts.map(|part| part.min(most)))
    }
}

/// Motion of one control element against all others, and the wrench on it.
struct Against {
    /// Motion along the axes of the body that lies half-way between the two: the shift beside that of the arc, m, and the turn,
    /// rad.
    motion: Vector6<f64>,
    wrench: Vector6<f64>,
    length: f64,
    loads: Loads,
}

/// Loads that act, and their wrench on the control element while all rest, along the same axes.
struct Loads {
    coefficients: Vec<f64>,
    wrench: Vector6<f64>,
}

impl Against {
    /// `None` where others move against each other too, where one is not moved rigidly, or by more than half a turn.
    fn new(deformer: &Deformer, wrenches: &[Wrench], element: usize) -> Option<Against> {
        let Deformer { controls, poses, .. } = deformer;
        let turn_of = |pose: &ControlPose| nearest_turn(&pose.matrix);
        let is_rigid =
            |pose: &ControlPose| (pose.matrix - turn_of(pose).to_rotation_matrix().matrix()).amax() < RESTS;
        if !poses.iter().all(is_rigid) || deformer.largest_turn() >= PI {
            return None;
        }
        let base = (0..controls.len()).find(|e| *e != element)?;
        let rests = |e: usize| Relative::between(deformer, base, e).rests();
        if !(0..controls.len()).all(|e| e == element || e == base || rests(e)) {
            return None;
        }
        let Relative { way, turn, shift } = Relative::between(deformer, base, element);
        let shift = inverse_slide_matrix(&turn) * (way + shift) - way + 0.5 * turn.cross(&way);
        let half = UnitQuaternion::from_scaled_axis(-0.5 * turn) * turn_of(&poses[base]).inverse();
        let wrench = wrenches.get(element)?.about_the_place(&poses[element]);
        let (coefficients, by_loads) = deformer.resting_loads(element);
        // What the columns hold turns with the frame in which they are summed.
        let half_from_columns = half * deformer.body_from_surface().rotation;
        let join = |a: Vector3<f64>, b: Vector3<f64>| Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
        let origins: Vec<Vector3<f64>> = controls.iter().map(|control| control.origin).collect();
        Some(Against {
            motion: join(shift, turn),
            wrench: join(half * wrench.force, half * wrench.moment),
            length: Moved::new(&origins, element)?.length,
            loads: Loads {
                coefficients,
                wrench: join(half_from_columns * by_loads.force, half_from_columns * by_loads.moment),
            },
        })
    }
}

impl MeshErrors {
    /// The parts of the force on a control element and of its torque over the length that are the mesh's, of the larger of both, in the pose
    /// as it is; `None` where that was not measured of it.
    pub fn in_pose(&self, deformer: &Deformer, wrenches: &[Wrench], element: usize) -> Option<[f64; 2]> {
        self.at(&Against::new(deformer, wrenches, element)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    /// A strip that lies oblique: what bends it is 10⁻⁵ of what stretches it, and both are in every number of K.
    #[test]
    fn what_is_written_tells_the_error_of_a_soft_motion_of_an_oblique_body() {
        let along = Matrix6::from_diagonal(&Vector6::new(1.0, 1e-3, 1e-5, 1e-5, 1e-5, 1e-3));
        let turn = Rotation3::new(Vector3::new(0.3, -0.8, 0.5));
        let turned = |v: &Vector6<f64>, turn: &Rotation3<f64>| {
            let [a, b] = [v.fixed_rows::<3>(0), v.fixed_rows::<3>(3)].map(|part| turn * part);
            Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
        };
        let rotation = Matrix6::from_fn(|i, j| turned(&Vector6::ith(j, 1.0), &turn)[i]);
        let own = rotation * along * rotation.transpose() * 2.1e6;
        // By 1.7 % too stiff against bending, and not against a stretch.
        let less = Matrix6::from_diagonal(&Vector6::new(1.0, 0.99, 1.0 / 1.017, 1.0 / 1.017, 0.98, 0.97));
        let better = rotation * along * less * rotation.transpose() * 2.1e6;
        let soft = turned(&Vector6::new(0.0, 0.0, 1.0, 0.0, 0.0, 0.0), &turn);
        let [own, better] = RigidStiffness::new(&own, &better).rounded().wrenches(&soft);
        let told = wrench_size(&(own - better), 1.0) / wrench_size(&better, 1.0);
        assert!((told / 0.017 - 1.0).abs() < 1e-3, "{told}");
    }
}
