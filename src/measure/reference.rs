//! References of the settings' errors: static equilibria at large strain, on the scene's mesh and on a finer one.

use super::course::{Course, Step};
use super::data::ModelError;
use super::fields::{ModelOutput, difference, displaced, evaluate, evaluate_about, origins};
use super::finer::{EquilibriumOfPose, Finer, FinerReference, Size};
use super::norms::{Norms, largest, relative};
use super::poses::hardest_first;
use super::request::{MeasureError, Request};
use super::units;
use super::variants::{Candidate, Meshes, moves_inside, of_affine_columns, online, solved, variant};
use crate::deform::{ControlPoses, ModelEntry, StaticsError, Truth, Wrench, model_of};
use crate::fem::{TET4, TET10, nearest_turn, tet4};
use crate::green;
use crate::scene::Scene;
use crate::solve::{Silent, Solver};
use nalgebra::{Matrix3, Vector3};
use std::time::Instant;

pub struct References<'a> {
    pub norms: Norms<'a>,
    pub poses: Vec<PoseReference>,
    /// Origins of the scene's control elements with tet4.
    pub origins: Vec<Vector3<f64>>,
    pub models: Vec<ModelError>,
    /// Poses that were left out, and why.
    pub left_out: Vec<String>,
    /// Models that were left out, with a pose, mesh or element where only that was, and why.
    pub models_left_out: Vec<String>,
    /// The models that were measured in every pose.
    pub models_of_settings: Vec<&'static ModelEntry>,
    /// tet4 on the scene's mesh with a material that does not lock ([`softened`]), where the scene's own would.
    soft: Vec<Candidate>,
}

/// Largest Poisson's ratio at which the models are measured. They are compared with an equilibrium of tet4, which locks
/// near 1/2: at 0.49 the model `linear` seemed to be wrong by 13.0 % in a bar bent by 10°, and by 10.9, 9.2 and 8.4 % on
/// its mesh refined once, twice and three times. At 0.4 it is 8.6 % on the bar's own mesh.
pub const MOST_POISSON: f64 = 0.4;

/// The scene with the same shear moduli, and Poisson's ratios of at most [`MOST_POISSON`]; `None` where the scene's own
/// are no larger.
pub fn softened(scene: &Scene, body: &str) -> Option<Scene> {
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
    /// Poses about the origins of that mesh.
    pub poses: ControlPoses,
    /// Displacement of all nodes, m.
    pub displacement: Vec<Vector3<f64>>,
    /// The wrench that holds each control element, about its moved origin.
    pub held: Vec<Wrench>,
    /// The sizes that errors are relative to: those of the finer equilibrium, where there is one.
    pub size: Size,
    /// The finer equilibrium, or why there is none.
    pub finer: Result<FinerReference, String>,
}

impl<'a> References<'a> {
    pub fn new(
        request: &Request<'_>,
        meshes: &'a Meshes,
        candidates: &[Candidate],
        course: &Course<'_>,
    ) -> Result<References<'a>, MeasureError> {
        let is_ordinary = |c: &Candidate| of_affine_columns().all(|model| c.is_exact(model));
        let own = candidates.iter().find(|c| is_ordinary(c) && c.refine == 0 && c.element == &TET4);
        let Some(own) = own else {
            return Err(MeasureError::NoPose("the scene's own mesh is too large".into()));
        };
        let top = meshes.ladder.levels.len() as u32 - 1;
        let scene = variant(request, top, &TET10, Solver::default());
        let prepared = green::prepare(&scene, request.body)?;
        let stiffness = TET10.assemble(meshes.ladder.top(), &prepared.lame)?;
        let mut found = References {
            norms: Norms::new(meshes.ladder.top(), stiffness),
            poses: Vec::new(),
            origins: origins(&own.solution),
            models: Vec::new(),
            models_of_settings: Vec::new(),
            left_out: Vec::new(),
            models_left_out: Vec::new(),
            soft: Vec::new(),
        };
        found.settle(request, meshes, candidates, course)?;
        Ok(found)
    }

    /// The solution that a model's error is measured with: tet4 on the scene's mesh, of a material that does not lock.
    pub fn base<'c>(&'c self, candidates: &'c [Candidate], model: &ModelEntry) -> Option<&'c Candidate> {
        let of = if self.soft.is_empty() { candidates } else { &self.soft };
        of.iter().find(|c| c.is_of(0, &TET4, model))
    }

    /// Measures the models' errors against the equilibria on the scene's mesh, with the solutions of all candidates.
    pub fn judge_models(
        &mut self,
        request: &Request<'_>,
        meshes: &Meshes,
        candidates: &[Candidate],
        course: &Course<'_>,
    ) -> Result<(), MeasureError> {
        let plain = variant(request, 0, &TET4, Solver::default());
        if let Some(scene) = softened(&plain, request.body) {
            for own in candidates.iter().filter(|c| c.refine == 0 && c.element == &TET4) {
                if own.solver.method.is_direct {
                    let of: Vec<&str> = own.models.iter().map(|model| model.name).collect();
                    let key = format!("a material that does not lock: {}", of.join(", "));
                    self.soft.push(solved(&key, &scene, request, &own.models, course)?);
                }
            }
        }
        let suited = self.suited(candidates);
        let (mut stateless, mut errors, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        for reference in &self.poses {
            for &model in &suited {
                let Some(base) = self.base(candidates, model) else { continue };
                match evaluate(model, &base.solution, &reference.poses) {
                    Some(output) if output.wrenches.is_some() => {
                        errors.push(self.model_error(meshes, base, model, &output, reference));
                    }
                    _ => {
                        stateless.push(model.name);
                        let (model, pose) = (model.name, &reference.name);
                        left_out.push(format!("model {model}: it has no state in the pose {pose}"));
                    }
                }
            }
        }
        self.models = errors;
        self.models_left_out.append(&mut left_out);
        self.models_of_settings = suited.into_iter().filter(|m| !stateless.contains(&m.name)).collect();
        Ok(())
    }

    /// Finds the nonlinear equilibria, on the scene's mesh and on the finer ones.
    fn settle(
        &mut self,
        request: &Request<'_>,
        meshes: &Meshes,
        candidates: &[Candidate],
        course: &Course<'_>,
    ) -> Result<(), MeasureError> {
        let scene = variant(request, 0, &TET4, Solver::default());
        let scene = softened(&scene, request.body).unwrap_or(scene);
        let mut statics = Truth::SameMesh.statics(&scene, request.body, &Silent)?;
        let order = hardest_first(request.poses, meshes.extent());
        let origins = self.origins.clone();
        let all = course.step_as_json(Step::EQUILIBRIA, |progress| {
            let (started, mut count) = (Instant::now(), 0);
            let of = |(name, poses): &(String, ControlPoses)| {
                if count > 0 && !course.has_time(started.elapsed().as_secs_f64() / f64::from(count)) {
                    return Ok(Err(format!("{name}: there was no time for it")));
                }
                count += 1;
                if let Some(model) = self.undefined(candidates, poses) {
                    return Ok(Err(format!(
                        "{name}: the control elements are half a turn apart, where the model {model} has no mean rotation"
                    )));
                }
                match statics.solve(poses, progress) {
                    Ok(settled) if settled.inverted.is_empty() => Ok(Ok(EquilibriumOfPose::from(settled))),
                    Ok(settled) => {
                        Ok(Err(format!("{name}: {} tetrahedra turn inside out", settled.inverted.len())))
                    }
                    Err(StaticsError::Stopped { share, .. }) => {
                        Ok(Err(format!("{name}: no equilibrium beyond {:.0} % of the way", 100.0 * share)))
                    }
                    Err(error) => Err(error.into()),
                }
            };
            order.iter().map(|&pose| &request.poses[pose]).map(of).collect::<Result<Vec<Result<_, String>>, MeasureError>>()
        })?;
        let mut all: Vec<(usize, Result<EquilibriumOfPose, String>)> =
            order.iter().copied().zip(all).collect();
        let mut finer = Finer::new(request, meshes, &origins);
        let mut references = Vec::new();
        for (pose, settled) in &all {
            if let Ok(settled) = settled {
                references.push((*pose, finer.solve(&self.norms, *pose, &settled.field(), course)?));
            }
        }
        all.sort_by_key(|(pose, _)| *pose);
        references.sort_by_key(|(pose, _)| *pose);
        let mut references = references.into_iter().map(|(_, finer)| finer);
        for (pose, settled) in all {
            let (name, poses) = &request.poses[pose];
            let settled = match settled {
                Ok(settled) => settled,
                Err(why) => {
                    self.left_out.push(why);
                    continue;
                }
            };
            let finer = references.next().unwrap_or_else(|| Err("it was not solved".into()));
            self.poses.push(self.reference(meshes, name, poses, settled, finer));
        }
        if self.poses.is_empty() {
            return Err(MeasureError::NoPose(self.left_out.join("; ")));
        }
        Ok(())
    }

    /// The models that the body suits; the reasons for the others go into `models_left_out`.
    fn suited(&mut self, candidates: &[Candidate]) -> Vec<&'static ModelEntry> {
        let mut suited = Vec::new();
        for model in online() {
            let Some(base) = self.base(candidates, model) else { continue };
            match model_of(model, &base.solution) {
                Ok(_) => suited.push(model),
                Err(why) => self.models_left_out.push(format!("model {}: {why}", model.name)),
            }
        }
        suited
    }

    /// The model's error alone, in the norm of the whole body, or of its surface where the model does not move the inside.
    fn model_error(
        &self,
        meshes: &Meshes,
        base: &Candidate,
        model: &ModelEntry,
        output: &ModelOutput,
        reference: &PoseReference,
    ) -> ModelError {
        let (error, displacement_m) = match &output.surface {
            Some(u) => reference.surface_error(&base.solution, u),
            None => {
                let error = difference(&displaced(&base.solution, output), &reference.displacement);
                let raised = |field: &[Vector3<f64>]| meshes.ladder.raise(0, field);
                let (error, settled) = (raised(&error), raised(&reference.displacement));
                (self.norms.l2(&error) / self.norms.l2(&settled).max(f64::MIN_POSITIVE), largest(&error))
            }
        };
        ModelError {
            model: model.name.into(),
            pose: reference.name.clone(),
            rotation: largest_rotation(&base.solution, &reference.displacement),
            error,
            displacement_m,
        }
    }

    /// The first model of the affine columns that is undefined in a pose on one of the meshes.
    fn undefined(&self, candidates: &[Candidate], poses: &ControlPoses) -> Option<&'static str> {
        let fails = |model: &&ModelEntry| {
            let mut measured =
                candidates.iter().filter(|c| c.models.iter().any(|own| own.name == model.name));
            measured.any(|c| evaluate_about(model, &c.solution, poses, &self.origins).is_none())
        };
        of_affine_columns().find(fails).map(|model| model.name)
    }

    fn reference(
        &self,
        meshes: &Meshes,
        name: &str,
        poses: &ControlPoses,
        settled: EquilibriumOfPose,
        finer: Result<FinerReference, String>,
    ) -> PoseReference {
        let held: Vec<Wrench> =
            settled.wrenches.iter().zip(poses).map(|(wrench, pose)| wrench.about_the_place(pose)).collect();
        let displacement = settled.field();
        let size = match &finer {
            Ok(finer) => finer.size,
            Err(_) => Size::new(&self.norms, &meshes.ladder.raise(0, &displacement), &held, settled.energy),
        };
        PoseReference { name: name.to_owned(), poses: poses.clone(), displacement, held, size, finer }
    }

    /// The models by which the part of a mesh is found, the most accurate first: those that move the inside, by their worst error in
    /// the poses.
    pub fn carriers(&self) -> Vec<&'static ModelEntry> {
        let worst = |model: &ModelEntry| {
            let own = self.models.iter().filter(|error| error.model == model.name);
            own.map(|error| error.error).fold(0.0, f64::max)
        };
        let mut carriers = self.models_of_settings.clone();
        carriers.retain(|model| moves_inside(model));
        carriers.sort_by(|a, b| worst(a).total_cmp(&worst(b)));
        carriers
    }

    /// The poses by which settings are judged: those with a finer equilibrium, or all where there is none.
    pub fn judged(&self) -> impl Iterator<Item = &PoseReference> {
        let is_any = self.poses.iter().any(|pose| pose.finer.is_ok());
        self.poses.iter().filter(move |pose| pose.finer.is_ok() || !is_any)
    }

    /// Names of the poses with a finer equilibrium, and sentences about the others.
    pub fn compared(&self) -> (Vec<String>, Vec<String>) {
        let with = self.poses.iter().filter(|pose| pose.finer.is_ok());
        let without = self.poses.iter().filter_map(PoseReference::not_compared);
        let without = without.chain(self.left_out.iter().cloned());
        (with.map(|pose| pose.name.clone()).collect(), without.collect())
    }

    /// The largest error of the finer equilibria themselves, where it is known of all.
    pub fn doubt(&self) -> Option<[f64; 2]> {
        let known = self.poses.iter().filter_map(|pose| pose.finer.as_ref().ok()).map(|finer| finer.doubt);
        let all = known.collect::<Option<Vec<[f64; 2]>>>()?;
        all.into_iter().reduce(|a, b| [0, 1].map(|i| a[i].max(b[i])))
    }

    /// Sentences about the reference of each part of the error.
    pub fn sentences(&self, meshes: &Meshes) -> Vec<String> {
        let top = meshes.ladder.levels.len() - 1;
        let mesh = match top {
            0 => "on the scene's mesh".to_owned(),
            n => format!("on the scene's mesh refined {n} times"),
        };
        let own = match self.doubt() {
            Some([shape, wrench]) => format!(
                "extrapolated from it and the mesh before it, which changes the shape by up to {} and the wrench by up to {}",
                units::relative(shape),
                units::relative(wrench)
            ),
            None => "whose own error was not measured, for it is the only mesh of its kind".into(),
        };
        let softened = match self.soft.is_empty() {
            false => format!(
                ", with Poisson's ratio {MOST_POISSON} and the same shear modulus where the scene's is larger: tet4 locks near \
                 1/2"
            ),
            true => String::new(),
        };
        let mut sentences = vec![
            format!(
                "total, force and torque: static equilibrium of a St. Venant-Kirchhoff body, Newton's method, tet10 {mesh}, {} \
                 nodes, {own}",
                self.norms.mesh.nodes.len()
            ),
            format!(
                "model: what is left; with tet4 on the scene's mesh against the same equilibrium on that mesh{softened}"
            ),
            "discretisation: with tet4 on the scene's mesh its equilibrium against the finer one; from there on what the mesh changes \
             in the most accurate model that is made on both"
                .into(),
            "solver: Cholesky in f64 on the same mesh".into(),
            "storage: the f64 columns of the same mesh".into(),
        ];
        let names = |of: &dyn Fn(&ModelEntry) -> bool| -> String {
            let own = self.models_of_settings.iter().filter(|model| of(model)).map(|model| model.name);
            own.collect::<Vec<_>>().join(", ")
        };
        let surface = names(&|model| !moves_inside(model));
        if !surface.is_empty() {
            sentences.push(format!(
                "{surface}: displacements of the surface alone, at the nodes of the scene's mesh"
            ));
        }
        let without = self.poses.iter().filter_map(PoseReference::not_compared);
        sentences.extend(without.map(|why| format!("not measured against it: {why}")));
        sentences.extend(
            self.left_out.iter().chain(&self.models_left_out).map(|pose| format!("left out: {pose}")),
        );
        sentences
    }
}

impl PoseReference {
    /// Says why it has no finer equilibrium.
    fn not_compared(&self) -> Option<String> {
        self.finer.as_ref().err().map(|why| format!("{}: {why}", self.name))
    }

    /// Errors of displacements `u` of the surface nodes: their root mean square over that of the equilibrium, and the largest, m.
    pub fn surface_error(&self, solution: &green::Solution, u: &[Vector3<f64>]) -> (f64, f64) {
        let settled: Vec<_> = solution.surface.nodes.iter().map(|&n| self.displacement[n as usize]).collect();
        let error = difference(u, &settled);
        (relative(&error, &settled), largest(&error))
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
