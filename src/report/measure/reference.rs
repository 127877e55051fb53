//! What the settings are compared with: static equilibria at large strain, and the finest mesh.

use super::candidates::{Candidate, FAMILIES, Meshes, solved, variant};
use super::fields::{difference, displaced, evaluate, evaluate_about, origins, superposed};
use super::norms::Norms;
use super::request::{MeasureError, Request};
use crate::deform::{
    ControlPoses, EquilibriumResult, Kind, MODELS, ModelEntry, Statics, StaticsError, Wrench,
};
use crate::fem::{STVK, TET4, TET10, nearest_turn, tet4};
use crate::green::{self, AFFINE, Requirements};
use crate::mesh::quality;
use crate::report::data::ModelError;
use crate::scene::Scene;
use crate::solve::{Progress, Solver};
use nalgebra::{Matrix3, Vector3};

pub struct References<'a> {
    pub norms: Norms<'a>,
    pub poses: Vec<PoseReference>,
    /// Origins of the scene's control elements with tet4.
    pub origins: Vec<Vector3<f64>>,
    pub models: Vec<ModelError>,
    /// Poses that were left out, and why.
    pub left_out: Vec<String>,
    /// Indices of candidates: the best discretisation, and tet4 on the scene's mesh.
    pub finest: usize,
    own: usize,
    /// tet4 on the scene's mesh with a material that does not lock ([`softened`]), where the scene's own would.
    soft: Option<Candidate>,
}

/// Largest Poisson's ratio at which the models are measured. They are compared with an equilibrium of tet4, which locks
/// near 1/2: at 0.49 the model `linear` seemed to be wrong by 13.0 % in a bar bent by 10°, and by 10.9, 9.2 and 8.4 % on
/// its mesh refined once, twice and three times. At 0.4 it is 8.6 % on the bar's own mesh.
const MOST_POISSON: f64 = 0.4;

/// The scene with the same shear moduli, and Poisson's ratios of at most [`MOST_POISSON`]; `None` where the scene's own
/// are no larger.
fn softened(scene: &Scene, body: &str) -> Option<Scene> {
    let mut scene = scene.clone();
    let body = &mut scene.body[body];
    let materials = std::iter::once(&mut body.material).chain(body.region.values_mut());
    let mut is_other = false;
    for material in materials.filter(|material| material.poisson > MOST_POISSON) {
        // E = 2 G (1 + ν)
        material.young *= (1.0 + MOST_POISSON) / (1.0 + material.poisson);
        material.poisson = MOST_POISSON;
        is_other = true;
    }
    is_other.then_some(scene)
}

/// A pose and its nonlinear equilibrium, with tet4 on the scene's mesh.
pub struct PoseReference {
    pub name: String,
    /// About the origins of that mesh.
    pub poses: ControlPoses,
    /// Of all nodes, m.
    pub displacement: Vec<Vector3<f64>>,
    /// The wrench that holds each control element, about its moved origin.
    pub held: Vec<Wrench>,
    /// The sizes that errors are relative to.
    pub size: Size,
}

/// Sizes of an equilibrium. In a pose that strains nothing, energy and forces are what rounding leaves of them.
pub struct Size {
    /// Norm of the displacement in L2, m.
    pub displacement: f64,
    /// Square root of the strain energy, J^½.
    pub energy: f64,
    /// Largest force on a control element, N, or its torque divided by the body's extent where that is larger: a pose
    /// that only bends has hardly any force.
    pub force: f64,
    /// `force` times the extent, N m.
    pub torque: f64,
}

/// Energies and forces smaller than this part of stiffness times displacement are rounding.
const ROUNDING: f64 = 1e-8;

/// The models that settings have: those of the affine columns alone, which every setting's file holds.
pub fn of_settings() -> impl Iterator<Item = &'static ModelEntry> {
    online().filter(|model| model.requirements.iter().all(|family| family.name == AFFINE.name))
}

/// The models that are made from what every candidate has, where the body suits them.
fn online() -> impl Iterator<Item = &'static ModelEntry> {
    let made = Requirements::of(FAMILIES);
    let is_online = |model: &&ModelEntry| matches!(model.kind, Kind::Online(_));
    let is_made = move |model: &&ModelEntry| model.requirements.iter().all(|family| made.has(*family));
    MODELS.iter().filter(is_online).filter(is_made)
}

impl<'a> References<'a> {
    pub fn new(
        request: &Request<'_>,
        meshes: &'a Meshes,
        candidates: &[Candidate],
        progress: &dyn Progress,
    ) -> Result<References<'a>, MeasureError> {
        let cholesky = |c: &&(usize, &Candidate)| c.1.solver.method.is_direct;
        let all: Vec<(usize, &Candidate)> = candidates.iter().enumerate().collect();
        let finest = all.iter().filter(cholesky).max_by_key(|(_, c)| (c.element.order, c.refine));
        let base = all.iter().filter(cholesky).find(|(_, c)| c.refine == 0 && c.element == &TET4);
        let (Some(&(finest, _)), Some(&(own, _))) = (finest, base) else {
            return Err(MeasureError::NoPose("the scene's own mesh is too large".into()));
        };
        let top = meshes.ladder.levels.len() as u32 - 1;
        let scene = variant(request, top, &TET10, Solver::default());
        let prepared = green::prepare(&scene, request.body)?;
        let stiffness = TET10.assemble(meshes.ladder.top(), &prepared.lame)?;
        let plain = variant(request, 0, &TET4, Solver::default());
        let soft = match softened(&plain, request.body) {
            Some(scene) => Some(solved(&scene, request, Solver::default(), progress)?),
            None => None,
        };
        let mut found = References {
            norms: Norms::new(meshes.ladder.top(), stiffness),
            poses: Vec::new(),
            origins: origins(&candidates[own].solution),
            models: Vec::new(),
            left_out: Vec::new(),
            finest,
            own,
            soft,
        };
        found.settle(request, meshes, candidates, progress)?;
        Ok(found)
    }

    /// The solution that the models' errors are measured with: tet4 on the scene's mesh, of a material that does not lock.
    pub fn base<'c>(&'c self, candidates: &'c [Candidate]) -> &'c Candidate {
        self.soft.as_ref().unwrap_or(&candidates[self.own])
    }

    /// Finds the nonlinear equilibria, and the models' errors against them.
    fn settle(
        &mut self,
        request: &Request<'_>,
        meshes: &Meshes,
        candidates: &[Candidate],
        progress: &dyn Progress,
    ) -> Result<(), MeasureError> {
        let scene = variant(request, 0, &TET4, Solver::default());
        let scene = softened(&scene, request.body).unwrap_or(scene);
        let mut statics = Statics::new(&scene, request.body, &STVK, progress)?;
        let own = &self.base(candidates).solution.clone();
        progress.begin("nonlinear statics", 1000 * request.poses.len() as u64);
        for (name, poses) in request.poses {
            if let Some(model) = self.undefined(candidates, poses) {
                self.left_out.push(format!(
                    "{name}: the control elements are half a turn apart, where the model {model} has no mean rotation"
                ));
                continue;
            }
            let settled = match statics.solve(poses, progress) {
                Ok(settled) if settled.inverted.is_empty() => settled,
                Ok(settled) => {
                    self.left_out
                        .push(format!("{name}: {} tetrahedra turn inside out", settled.inverted.len()));
                    continue;
                }
                Err(StaticsError::Stopped { share, .. }) => {
                    self.left_out
                        .push(format!("{name}: no equilibrium beyond {:.0} % of the way", 100.0 * share));
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let reference = self.reference(meshes, own, name, poses, settled);
            for model in online() {
                let Some(output) = evaluate(model, own, poses) else { continue };
                let u = displaced(own, &output, &superposed(own, &output));
                let error = meshes.ladder.raise(0, &difference(&u, &reference.displacement));
                self.models.push(ModelError {
                    model: model.name.into(),
                    pose: name.clone(),
                    rotation: largest_rotation(own, &reference.displacement),
                    error: self.norms.l2(&error) / reference.size.displacement,
                    displacement_m: largest(&error),
                });
            }
            self.poses.push(reference);
        }
        progress.end();
        if self.poses.is_empty() {
            return Err(MeasureError::NoPose(self.left_out.join("; ")));
        }
        Ok(())
    }

    /// The first model of settings that is undefined in a pose on one of the meshes.
    fn undefined(&self, candidates: &[Candidate], poses: &ControlPoses) -> Option<&'static str> {
        let fails = |model: &&ModelEntry| {
            candidates.iter().any(|c| evaluate_about(model, &c.solution, poses, &self.origins).is_none())
        };
        of_settings().find(fails).map(|model| model.name)
    }

    fn reference(
        &self,
        meshes: &Meshes,
        own: &green::Solution,
        name: &str,
        poses: &ControlPoses,
        settled: EquilibriumResult,
    ) -> PoseReference {
        // EquilibriumResult moments are about where the origins rested.
        let moved = |(wrench, pose): (&Wrench, &crate::deform::ControlPose)| Wrench {
            force: wrench.force,
            moment: wrench.moment - pose.translation.cross(&wrench.force),
        };
        let held: Vec<Wrench> = settled.wrenches.iter().zip(poses).map(moved).collect();
        let most = |of: fn(&Wrench) -> Vector3<f64>| held.iter().map(|w| of(w).norm()).fold(0.0, f64::max);
        let displacement = self.norms.l2(&meshes.ladder.raise(0, &settled.displacement));
        let (low, high) = quality::bounding_box(&own.mesh.nodes);
        let extent = (high - low).amax();
        let stiffest = self.norms.stiffness.diagonal.iter().map(Matrix3::amax).fold(0.0, f64::max);
        let force =
            most(|w| w.force).max(most(|w| w.moment) / extent).max(ROUNDING * stiffest * displacement);
        let size = Size {
            displacement,
            energy: settled.energy.max(0.0).sqrt().max(ROUNDING * stiffest.sqrt() * displacement),
            force,
            torque: force * extent,
        };
        PoseReference {
            name: name.to_owned(),
            poses: poses.clone(),
            displacement: settled.displacement,
            held,
            size,
        }
    }

    /// What each part of the error is compared with, in sentences.
    pub fn sentences(&self, candidates: &[Candidate]) -> Vec<String> {
        let finest = &candidates[self.finest];
        let mut sentences = vec![
            format!(
                "discretisation: {} on the scene's mesh refined {} times, {} nodes; what is as fine as that cannot be \
                 told from it",
                finest.element.name,
                finest.refine,
                finest.solution.mesh.nodes.len()
            ),
            "solver: Cholesky in f64 on the same mesh".into(),
            "storage: the f64 columns of the same mesh".into(),
            format!(
                "model: static equilibrium of a St. Venant-Kirchhoff body, Newton's method, tet4 on the scene's mesh{}",
                match self.soft {
                    Some(_) => format!(
                        ", with Poisson's ratio {MOST_POISSON} and the same shear modulus where the scene's is larger: \
                         tet4 locks near 1/2"
                    ),
                    None => String::new(),
                }
            ),
            "total, force and torque: that equilibrium, corrected by what the finest mesh changes in the linear theory"
                .into(),
        ];
        sentences.extend(self.left_out.iter().map(|pose| format!("left out: {pose}")));
        sentences
    }
}

/// The largest rotation of a tetrahedron, by the polar decomposition of its deformation gradient.
fn largest_rotation(solution: &green::Solution, u: &[Vector3<f64>]) -> f64 {
    let rotation = |tet: usize| {
        let Some(geometry) = tet4::geometry(solution.mesh.corners(tet)) else { return 0.0 };
        let nodes = solution.mesh.tets[tet];
        let h: Matrix3<f64> = (0..4).map(|a| u[nodes[a] as usize] * geometry.gradients[a].transpose()).sum();
        nearest_turn(&(Matrix3::identity() + h)).angle()
    };
    (0..solution.mesh.tets.len()).map(rotation).fold(0.0, f64::max)
}

pub fn largest(field: &[Vector3<f64>]) -> f64 {
    field.iter().map(|u| u.norm()).fold(0.0, f64::max)
}
