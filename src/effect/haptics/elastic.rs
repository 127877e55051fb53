//! The elastic body in the haptic loop: poses of its control elements in, strain energy and its exact gradient out.
//!
//! The energy is that of the body's model, [`DeformationModel::respond`], the same from which the picture shows forces and
//! `greenstage deform` writes them. The loop has its own model, which follows the hand from tick to tick. Nothing is
//! allocated after [`Elastic::new`].

use crate::deform::{
    ControlPose, ControlRest, DeformationModel, Deformer, ElementPotential, Kind, ModelEntry, ModelInput,
    PoseCurvature, PoseSlope, Response,
};
use nalgebra::{DMatrix, UnitQuaternion, Vector3};

/// Relative change of the stiffness that effects add from which on it counts as another one.
const STIFFENED: f64 = 0.05;

/// A body with the energy of its model.
pub struct Elastic {
    model: Box<dyn DeformationModel>,
    origins: Vec<Vector3<f64>>,
    poses: Vec<ControlPose>,
    slopes: Vec<PoseSlope>,
    held: usize,
    /// Poses at the last [`Elastic::mark`].
    marked: Vec<ControlPose>,
    /// Energy that other effects add to that of the held element, as of the last frame.
    added: Option<ElementPotential>,
    /// Whether the stiffness of that has changed since [`Elastic::mark`].
    is_stiffened: bool,
}

/// The result of one evaluation, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticResponse {
    /// V, J.
    pub energy: f64,
    /// ∂V by the pose of the held element: the force that a hand must apply.
    pub slope: PoseSlope,
    /// The frame or the equilibrium of these poses was found; otherwise an earlier one was kept.
    pub is_defined: bool,
}

impl Elastic {
    /// Errors where the model has no energy.
    pub fn new(mut model: Box<dyn DeformationModel>, controls: &[ControlRest]) -> Result<Elastic, String> {
        let poses = vec![ControlPose::REST; controls.len()];
        let mut slopes = vec![PoseSlope::default(); controls.len()];
        if controls.is_empty() || model.respond(&poses, &mut slopes).is_none() {
            return Err(
                "the .green file has no forces of this body: list the effect \"haptics\" in the scene"
                    .to_owned(),
            );
        }
        let origins = controls.iter().map(|control| control.origin).collect();
        Ok(Elastic {
            model,
            origins,
            marked: poses.clone(),
            poses,
            slopes,
            held: 0,
            added: None,
            is_stiffened: false,
        })
    }

    /// The body of a deformer, with its own instance of the model.
    pub fn from_deformer(deformer: &Deformer) -> Result<Elastic, String> {
        Elastic::new(deformer.another_model()?, &deformer.controls)
    }

    /// A body of these tables alone, without a surface.
    pub fn of_tables(
        model: &ModelEntry,
        controls: &[ControlRest],
        table: &dyn Fn(&str) -> Option<DMatrix<f64>>,
    ) -> Result<Elastic, String> {
        let Kind::Online(make) = model.kind else {
            return Err(format!("the model \"{}\" is not made from tables", model.name));
        };
        let none = |_| Vec::new();
        let input =
            ModelInput { controls, rest: &[], triangles: &[], control_nodes: &none, table, loads: None };
        Elastic::new(make(&input)?, controls)
    }

    pub fn elements(&self) -> usize {
        self.origins.len()
    }

    /// The held element's origin at rest, about the body's centre.
    pub fn origin(&self) -> Vector3<f64> {
        self.origins[self.held]
    }

    /// The held element's pose in the last evaluation.
    pub fn held_pose(&self) -> ControlPose {
        self.poses[self.held]
    }

    /// Takes the poses of all elements in a frame, of which `held` will be given to [`Elastic::respond`]. Poses that are not
    /// finite and elements that the body does not have are ignored.
    pub fn set(&mut self, held: usize, poses: &[ControlPose]) {
        self.held = held.min(self.elements() - 1);
        for (own, new) in self.poses.iter_mut().zip(poses).filter(|(_, new)| new.is_finite()) {
            *own = *new;
        }
    }

    /// The next pose of element `e` continues this turn.
    pub fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        self.model.set_turn(e, turn);
    }

    /// Goes on with another model of the same elements, as after a cut, and leaves its own in its place. The stiffness has to be found anew.
    pub fn exchange(&mut self, model: &mut Box<dyn DeformationModel>) {
        std::mem::swap(&mut self.model, model);
        self.is_stiffened = true;
    }

    /// The next response begins at rest.
    pub fn forget(&mut self) {
        self.model.forget();
    }

    /// Energy and slope with the held element at `pose`.
    pub fn respond(&mut self, pose: &ControlPose) -> ElasticResponse {
        self.poses[self.held] = *pose;
        let response = self.model.respond(&self.poses, &mut self.slopes);
        self.with_added(response, pose)
    }

    /// [`Elastic::respond`] for a pose of the held element near its own, which stays; to first order, where the model can.
    pub fn respond_beside(&mut self, pose: &ControlPose) -> ElasticResponse {
        let own = std::mem::replace(&mut self.poses[self.held], *pose);
        let beside = self.model.respond_beside(&self.poses, &mut self.slopes);
        let response = beside.or_else(|| self.model.respond(&self.poses, &mut self.slopes));
        self.poses[self.held] = own;
        self.with_added(response, pose)
    }

    /// Does a part of the preparation that makes responses near the last one cheap; true when nothing is left to do.
    pub fn prepare_beside(&mut self, anew: bool) -> bool {
        self.model.prepare_beside(anew)
    }

    /// Whether the last response took much longer than most do.
    pub fn was_long(&self) -> bool {
        self.model.was_long()
    }

    /// The model's response and slopes with what other effects add at the held element's pose.
    fn with_added(&self, response: Option<Response>, pose: &ControlPose) -> ElasticResponse {
        let (mut energy, is_defined) =
            response.map_or((f64::NAN, false), |found| (found.energy, found.is_defined));
        let mut slope = self.slopes[self.held];
        if let Some((more, of_more)) = self.added.map(|added| added.respond(pose)) {
            energy += more;
            slope.translation += of_more.translation;
            slope.matrix += of_more.matrix;
        }
        ElasticResponse { energy, slope, is_defined }
    }

    /// Takes what other effects add to the held element's energy in a frame; returns by how much that raises the energy at
    /// `pose`, J.
    pub fn add(&mut self, added: Option<ElementPotential>, pose: &ControlPose) -> f64 {
        let energy = |added: &Option<ElementPotential>| added.map_or(0.0, |added| added.respond(pose).0);
        let curvature =
            |added: &Option<ElementPotential>| added.map_or(PoseCurvature::zeros(), |a| a.curvature);
        let raised = energy(&added) - energy(&self.added);
        let (now, before) = (curvature(&added), curvature(&self.added));
        self.is_stiffened |= (now - before).norm() > STIFFENED * before.norm();
        self.added = added;
        raised
    }

    /// Remembers the poses of all elements.
    pub fn mark(&mut self) {
        self.marked.copy_from_slice(&self.poses);
        self.is_stiffened = false;
    }

    /// Largest motion of an element since [`Elastic::mark`]: the change of its matrix, and that of its place as a part of the
    /// distance between the elements; infinite if the stiffness that effects add has changed.
    pub fn moved(&self) -> f64 {
        if self.is_stiffened {
            return f64::INFINITY;
        }
        let size = self.origins.iter().map(|origin| (origin - self.origins[0]).norm()).fold(0.0, f64::max);
        let of = |(now, then): (&ControlPose, &ControlPose)| {
            let turned = (now.matrix - then.matrix).norm() / std::f64::consts::SQRT_2;
            let shifted = (now.translation - then.translation).norm();
            turned.max(if size > 0.0 { shifted / size } else { 0.0 })
        };
        self.poses.iter().zip(&self.marked).map(of).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::super::device::Reading;
    use super::super::stability::spring;
    use super::super::tick::Renewal;
    use super::*;
    use crate::deform::LINEAR;
    use crate::green::STIFFNESS;
    use crate::stage::Haptic;
    use nalgebra::{Isometry3, Translation3};

    fn model(stiffness: f64) -> Box<dyn DeformationModel> {
        let matrix = DMatrix::from_fn(12, 12, |i, j| if i == j && i < 3 { stiffness } else { 0.0 });
        let rest = ControlRest { name: "spring".into(), origin: Vector3::zeros(), nodes: 1 };
        let table = |name: &str| (name == STIFFNESS.name).then(|| matrix.clone());
        Elastic::of_tables(&LINEAR, &[rest], &table).unwrap().model
    }

    /// A spring that a hand holds stretched is cut to half its stiffness: half of the force is left, and the energy that went into the cut is
    /// not braked as if the loop had made it.
    #[test]
    fn a_body_that_is_cut_is_felt_softer() {
        let haptic = Haptic::simulated("cut");
        let (mut control, grasp) = spring(&haptic, 200.0).unwrap();
        let mut renewal = Renewal { body: 0, model: model(100.0) };
        let mut forces = Vec::new();
        for tick in 0..2000_u32 {
            let now_s = 1e-3 * f64::from(tick);
            if tick == 1600 {
                control.renew(&mut renewal);
            }
            if tick.is_multiple_of(16) {
                control.take(&grasp);
            }
            let at = Translation3::new(2e-3 * (now_s / 0.5).min(1.0), 0.0, 0.0);
            let push = control.tick(Some(&Reading::at(Isometry3::from(at), now_s)), now_s);
            forces.push(push.force.x);
        }
        println!("{} N, then {} N and {} N", forces[1599], forces[1601], forces[1999]);
        assert!((forces[1599] + 0.4).abs() < 1e-6, "{} N", forces[1599]);
        for at in [1601, 1700, 1999] {
            assert!((forces[at] + 0.2).abs() < 1e-6, "tick {at}: {} N", forces[at]);
        }
    }
}
