//! The parts of every setting's error, and what it costs.

use super::candidates::{Candidate, Meshes, variant};
use super::fields::{
    Asked, ask, combined, displaced, minus, moved_origins, origins, storage_error, stored, wrenches_about,
};
use super::frame::{Contender, quantile, race};
use super::{MeasureError, Norms, Request};
use crate::deform::{ControlPoses, Kind, MODELS, ModelEntry, Settled, Statics, StaticsError, Wrench};
use crate::fem::{STVK, nearest_turn, tet4};
use crate::green::{self, GreenFile, Precomputed};
use crate::report::{Cost, Errors, ModelError, Row, Setting, Spread};
use crate::scene::{Element, Solver, Storage};
use crate::solve::Progress;
use nalgebra::{Matrix3, Vector3};
use std::sync::Arc;

/// What the settings are measured against.
pub struct Truth<'a> {
    pub norms: Norms<'a>,
    /// The poses that have a nonlinear equilibrium, about the origins of the scene's own mesh.
    pub poses: Vec<(String, ControlPoses)>,
    /// Of those poses, with tet4 on the scene's mesh.
    pub settled: Vec<Settled>,
    /// Largest local rotation of each, rad.
    rotations: Vec<f64>,
    /// L2 and energy norm of each, raised to the finest mesh.
    sizes: Vec<[f64; 2]>,
    /// Origins of the scene's control elements with tet4.
    origins: Vec<Vector3<f64>>,
    models: Vec<ModelError>,
    dropped: Vec<String>,
    finest: usize,
    base: usize,
}

fn online() -> impl Iterator<Item = &'static ModelEntry> {
    MODELS.iter().filter(|model| matches!(model.kind, Kind::Online(_)))
}

impl<'a> Truth<'a> {
    pub fn new(
        request: &Request<'_>,
        meshes: &'a Meshes,
        candidates: &[Candidate],
        progress: &dyn Progress,
    ) -> Result<Truth<'a>, MeasureError> {
        let cholesky = |c: &&(usize, &Candidate)| c.1.solver == "cholesky";
        let all: Vec<(usize, &Candidate)> = candidates.iter().enumerate().collect();
        let finest = all.iter().filter(cholesky).max_by_key(|(_, c)| (c.element == Element::Tet10, c.refine));
        let base = all.iter().filter(cholesky).find(|(_, c)| c.refine == 0 && c.element == Element::Tet4);
        let (Some(&(finest, _)), Some(&(base, own))) = (finest, base) else {
            return Err(MeasureError::NoPose("the scene's own mesh is too large".into()));
        };
        let top = meshes.ladder.levels.len() as u32 - 1;
        let scene = variant(request, top, Element::Tet10, Solver::default());
        let prepared = green::prepare(&scene, request.body)?;
        let stiffness = crate::fem::assemble(meshes.ladder.top(), &prepared.lame)?;
        let norms = Norms { mesh: meshes.ladder.top(), stiffness };
        let mut truth = Truth {
            norms,
            poses: Vec::new(),
            settled: Vec::new(),
            rotations: Vec::new(),
            sizes: Vec::new(),
            origins: origins(&own.solution),
            models: Vec::new(),
            dropped: Vec::new(),
            finest,
            base,
        };
        truth.settle(request, meshes, &own.solution, progress)?;
        Ok(truth)
    }

    /// Finds the nonlinear equilibria, and the models' errors against them.
    fn settle(
        &mut self,
        request: &Request<'_>,
        meshes: &Meshes,
        own: &green::Solution,
        progress: &dyn Progress,
    ) -> Result<(), MeasureError> {
        let scene = variant(request, 0, Element::Tet4, Solver::default());
        let mut statics = Statics::new(&scene, request.body, &STVK, progress)?;
        progress.begin("nonlinear statics", 1000 * request.poses.len() as u64);
        for (name, poses) in request.poses {
            let settled = match statics.solve(poses, progress) {
                Ok(settled) if settled.inverted.is_empty() => settled,
                Ok(settled) => {
                    self.dropped
                        .push(format!("{name}: {} tetrahedra turn inside out", settled.inverted.len()));
                    continue;
                }
                Err(StaticsError::Stopped { share, .. }) => {
                    self.dropped
                        .push(format!("{name}: no equilibrium beyond {:.0} % of the way", 100.0 * share));
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let raised = meshes.ladder.raise(0, &settled.displacement);
            let size = self.norms.l2(&raised);
            let rotation = largest_rotation(own, &settled.displacement);
            for model in online() {
                let Some(asked) = ask(model, own, poses) else { continue };
                let u = displaced(own, &asked, &combined(own, &asked));
                let error = meshes.ladder.raise(0, &minus(&u, &settled.displacement));
                self.models.push(ModelError {
                    model: model.name.into(),
                    pose: name.clone(),
                    rotation,
                    error: self.norms.l2(&error) / size,
                    displacement_m: largest(&error),
                });
            }
            let linear = ask(&MODELS[0], own, poses);
            let strain = linear
                .map_or(0.0, |asked| self.norms.energy(&meshes.ladder.raise(0, &combined(own, &asked))));
            self.sizes.push([size, strain]);
            self.rotations.push(rotation);
            self.poses.push((name.clone(), poses.clone()));
            self.settled.push(settled);
        }
        progress.end();
        if self.poses.is_empty() {
            return Err(MeasureError::NoPose(self.dropped.join("; ")));
        }
        Ok(())
    }

    pub fn models(&self) -> Vec<ModelError> {
        self.models.clone()
    }

    /// What each part of the error is taken against.
    pub fn references(&self, candidates: &[Candidate]) -> Vec<String> {
        let finest = &candidates[self.finest];
        let mut sentences = vec![
            format!(
                "discretisation: {} on the scene's mesh refined {} times, {} nodes; what is as fine as that cannot be \
                 told from it",
                finest.element.name(),
                finest.refine,
                finest.solution.mesh.nodes.len()
            ),
            "solver: Cholesky in f64 on the same mesh".into(),
            "storage: the f64 columns of the same mesh".into(),
            "model: static equilibrium of a St. Venant-Kirchhoff body, Newton's method, tet4 on the scene's mesh".into(),
            "total: that equilibrium, corrected by what the finest mesh changes in the linear theory".into(),
        ];
        sentences.extend(self.dropped.iter().map(|dropped| format!("left out: {dropped}")));
        sentences
    }
}

/// The largest rotation of a tetrahedron: that of the polar decomposition of its F.
fn largest_rotation(solution: &green::Solution, u: &[Vector3<f64>]) -> f64 {
    let rotation = |tet: usize| {
        let Some(geometry) = tet4::geometry(solution.mesh.corners(tet)) else { return 0.0 };
        let nodes = solution.mesh.tets[tet];
        let h: Matrix3<f64> = (0..4).map(|a| u[nodes[a] as usize] * geometry.gradients[a].transpose()).sum();
        nearest_turn(&(Matrix3::identity() + h)).angle()
    };
    (0..solution.mesh.tets.len()).map(rotation).fold(0.0, f64::max)
}

fn largest(field: &[Vector3<f64>]) -> f64 {
    field.iter().map(|u| u.norm()).fold(0.0, f64::max)
}

/// One setting's errors in one pose.
#[derive(Clone, Copy, Default)]
struct Pose {
    discretisation: f64,
    energy: f64,
    solver: f64,
    storage: f64,
    model: f64,
    total: f64,
    displacement_m: f64,
    force: f64,
    torque: f64,
}

/// Every setting with its errors and costs.
pub fn rows(
    request: &Request<'_>,
    meshes: &Meshes,
    candidates: &[Candidate],
    truth: &Truth<'_>,
    progress: &dyn Progress,
) -> Result<Vec<Row>, MeasureError> {
    let mut rows = Vec::new();
    let mut contenders = Vec::new();
    let models: Vec<&ModelEntry> = online().collect();
    progress.begin("errors", (candidates.len() * models.len() * truth.poses.len()) as u64);
    for candidate in candidates {
        let is_own = candidate.solver == "cholesky";
        let storages = if is_own { Storage::ALL.to_vec() } else { vec![Storage::F32] };
        let rounded: Vec<Vec<Vec<f64>>> = storages.iter().map(|&s| stored(&candidate.solution, s)).collect();
        let mut errors = vec![Vec::new(); storages.len() * models.len()];
        for (m, model) in models.iter().enumerate() {
            for pose in 0..truth.poses.len() {
                let parts = Parts::new(meshes, candidates, candidate, truth, model, pose);
                for (s, rounded) in rounded.iter().enumerate() {
                    if let Some(parts) = &parts {
                        errors[s * models.len() + m]
                            .push(parts.with_storage(meshes, candidate, truth, rounded));
                    }
                }
                progress.advance(1);
            }
        }
        for (s, &storage) in storages.iter().enumerate() {
            let (file, cost) = written(request, candidate, storage)?;
            for (m, model) in models.iter().enumerate() {
                let contender =
                    Contender::new(&file, request.body, model.name).map_err(MeasureError::Model)?;
                let width = if storage == Storage::F32 { 4 } else { 2 };
                let cost = Cost { frame_bytes: contender.bytes(width), ..cost.clone() };
                contenders.push(contender);
                rows.push(Row {
                    setting: Setting {
                        refine: candidate.refine,
                        element: candidate.element.name().into(),
                        solver: candidate.solver.clone(),
                        storage: storage.name().into(),
                        model: model.name.into(),
                    },
                    mesh_nodes: candidate.solution.mesh.nodes.len(),
                    surface_nodes: candidate.solution.surface.nodes.len(),
                    cost,
                    error: spread(&errors[s * models.len() + m]),
                });
            }
        }
    }
    progress.end();
    progress.begin("online race", 0);
    let poses: Vec<ControlPoses> = truth.poses.iter().map(|(_, poses)| poses.clone()).collect();
    race(&mut contenders, models.len(), &poses, request.limits.rounds);
    progress.end();
    for (row, contender) in rows.iter_mut().zip(&contenders) {
        row.cost.frame_p50_s = quantile(&contender.all_s, 0.5);
        row.cost.frame_p99_s = quantile(&contender.all_s, 0.99);
        row.cost.frame_one_p50_s = quantile(&contender.one_s, 0.5);
    }
    Ok(rows)
}

/// A setting's error fields in one pose but for storage, on the finest mesh and turned into the body's frame.
struct Parts {
    asked: Asked,
    /// Solver + discretisation + model.
    sum: Vec<Vector3<f64>>,
    pose: Pose,
    size: f64,
}

impl Parts {
    fn new(
        meshes: &Meshes,
        candidates: &[Candidate],
        candidate: &Candidate,
        truth: &Truth<'_>,
        model: &ModelEntry,
        pose: usize,
    ) -> Option<Parts> {
        let (ladder, poses) = (&meshes.ladder, &truth.poses[pose].1);
        let asked_of = |solution: &green::Solution| {
            ask(model, solution, &moved_origins(poses, &truth.origins, &origins(solution)))
        };
        let whole = |c: &Candidate, asked: &Asked| {
            ladder.raise(c.refine as usize, &displaced(&c.solution, asked, &combined(&c.solution, asked)))
        };
        let exact = candidates.iter().find(|other| {
            other.solver == "cholesky"
                && (other.refine, other.element) == (candidate.refine, candidate.element)
        })?;
        let (finest, base) = (&candidates[truth.finest], &candidates[truth.base]);
        let asked = asked_of(&candidate.solution)?;
        let here = whole(candidate, &asked);
        let solved = whole(exact, &asked_of(&exact.solution)?);
        let best = whole(finest, &asked_of(&finest.solution)?);
        let at_base = whole(base, &asked_of(&base.solution)?);
        let settled = ladder.raise(0, &truth.settled[pose].displacement);
        let (solver, discretisation) = (minus(&here, &solved), minus(&solved, &best));
        let model_part = minus(&at_base, &settled);
        let [size, strain] = truth.sizes[pose];
        let sum = solver.iter().zip(&discretisation).zip(&model_part).map(|((s, d), m)| s + d + m).collect();
        let turned_back: Vec<_> =
            discretisation.iter().map(|e| asked.motion.rotation.inverse() * e).collect();
        let mut errors = Pose {
            discretisation: truth.norms.l2(&discretisation) / size,
            energy: truth.norms.energy(&turned_back) / strain,
            solver: truth.norms.l2(&solver) / size,
            model: truth.norms.l2(&model_part) / size,
            ..Pose::default()
        };
        let about = &truth.origins;
        let held = wrenches_about(&candidate.solution, &asked, about)?;
        let finest_held = wrenches_about(&finest.solution, &asked_of(&finest.solution)?, about)?;
        let part = |of: fn(&Wrench) -> Vector3<f64>| {
            let most = finest_held.iter().map(|w| of(w).norm()).fold(0.0, f64::max);
            let off = held.iter().zip(&finest_held).map(|(a, b)| (of(a) - of(b)).norm()).fold(0.0, f64::max);
            if most == 0.0 { 0.0 } else { off / most }
        };
        (errors.force, errors.torque) = (part(|w| w.force), part(|w| w.moment));
        Some(Parts { asked, sum, pose: errors, size })
    }

    fn with_storage(
        &self,
        meshes: &Meshes,
        candidate: &Candidate,
        truth: &Truth<'_>,
        rounded: &[Vec<f64>],
    ) -> Pose {
        let error = storage_error(&candidate.solution, rounded, &self.asked);
        let turned: Vec<_> = error.iter().map(|e| self.asked.motion.rotation * e).collect();
        let storage = meshes.ladder.raise(candidate.refine as usize, &turned);
        let total: Vec<_> = self.sum.iter().zip(&storage).map(|(sum, s)| sum + s).collect();
        Pose {
            storage: truth.norms.l2(&storage) / self.size,
            total: truth.norms.l2(&total) / self.size,
            displacement_m: largest(&total),
            ..self.pose
        }
    }
}

fn spread(poses: &[Pose]) -> Errors {
    let of = |part: fn(&Pose) -> f64| {
        let values: Vec<f64> = poses.iter().map(part).collect();
        Spread { median: quantile(&values, 0.5), worst: quantile(&values, 1.0) }
    };
    Errors {
        discretisation: of(|p| p.discretisation),
        energy: of(|p| p.energy),
        solver: of(|p| p.solver),
        storage: of(|p| p.storage),
        model: of(|p| p.model),
        total: of(|p| p.total),
        displacement_m: of(|p| p.displacement_m),
        force: Some(of(|p| p.force)),
        torque: Some(of(|p| p.torque)),
    }
}

/// The .green file of one setting as the program writes it, and what it costs but for the frame.
fn written(
    request: &Request<'_>,
    candidate: &Candidate,
    storage: Storage,
) -> Result<(Arc<GreenFile>, Cost), MeasureError> {
    let needs = (request.needs_of)(request.scene);
    let name = format!(
        "{}-{}-{}-{}.green",
        candidate.refine,
        candidate.element.name(),
        candidate.solver,
        storage.name()
    );
    let path = request.scratch.join(name.replace(' ', "-"));
    let mut solution = candidate.solution.clone();
    if !needs.stiffness {
        (solution.stiffness, solution.asymmetry) = (None, None);
    }
    let precomputed = Precomputed {
        name: request.body.to_owned(),
        fingerprint: String::new(),
        storage,
        needs,
        plan: None,
        solution,
    };
    let file_bytes = green::write(&path, std::slice::from_ref(&precomputed))? as f64;
    let io = |source| MeasureError::Io { path: path.clone(), source };
    let bytes = std::fs::read(&path).map_err(io)?;
    let packed_bytes = green::packed(&bytes).map_err(io)?.len() as f64;
    let stats = &candidate.solution.stats;
    let columns = candidate.solution.fields.data.len() as f64;
    let cost = Cost {
        offline_s: candidate.offline_s,
        offline_bytes: 8.0
            * (stats.factor_entries as f64 + candidate.solution.matrix_entries as f64 + columns),
        file_bytes,
        packed_bytes,
        ..Cost::default()
    };
    Ok((Arc::new(GreenFile::open(&path)?), cost))
}
