//! Errors and costs of every setting: candidates × storages × models.

use super::candidates::{Candidate, Meshes};
use super::fields::{
    ModelOutput, difference, displaced, evaluate_about, storage_error, stored, superposed, wrenches_about,
};
use super::frame::{TimedDeformer, time_in_turn};
use super::reference::{References, largest, of_settings};
use super::request::{MeasureError, Request};
use crate::base::statistics::{median, quantile};
use crate::deform::{ControlPoses, ModelEntry, Wrench};
use crate::green::{self, GreenFile, Precomputed};
use crate::report::data::{Cost, Errors, Measurement, Setting, Spread};
use crate::scene::Storage;
use crate::solve::Progress;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// One setting's errors in one pose.
#[derive(Clone, Copy, Default)]
struct PoseErrors {
    discretisation: f64,
    energy: f64,
    solver: f64,
    storage: f64,
    model: f64,
    total: f64,
    uncancelled: f64,
    displacement_m: f64,
    force: f64,
    torque: f64,
    uncancelled_held: f64,
}

/// The whole error, or the root of the sum of its parts' squares where that is larger. Settings are chosen by it, since
/// parts that cancel in this pose may not cancel in others.
fn uncancelled(whole: f64, parts: &[f64]) -> f64 {
    whole.max(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
}

/// All settings with their errors and costs.
pub fn measurements(
    request: &Request<'_>,
    meshes: &Meshes,
    candidates: &[Candidate],
    references: &References<'_>,
    progress: &dyn Progress,
) -> Result<Vec<Measurement>, MeasureError> {
    let mut rows = Vec::new();
    let mut timed_deformers = Vec::new();
    let models: Vec<&ModelEntry> = of_settings().collect();
    progress.begin("errors", (candidates.len() * models.len() * references.poses.len()) as u64);
    for candidate in candidates {
        let is_own = candidate.solver.method.is_direct;
        let storages = if is_own { Storage::ALL.to_vec() } else { vec![Storage::F32] };
        let rounded: Vec<Vec<Vec<f64>>> = storages.iter().map(|&s| stored(&candidate.solution, s)).collect();
        let mut errors = vec![Vec::new(); storages.len() * models.len()];
        for (m, model) in models.iter().enumerate() {
            for pose in 0..references.poses.len() {
                let parts = ErrorFields::new(meshes, candidates, candidate, references, model, pose)
                    .ok_or_else(|| {
                        let (element, pose) = (candidate.element.name, &references.poses[pose].name);
                        MeasureError::Model(format!(
                            "pose {pose}: {} with {element} cannot be measured",
                            model.name
                        ))
                    })?;
                for (s, rounded) in rounded.iter().enumerate() {
                    errors[s * models.len() + m]
                        .push(parts.with_storage(meshes, candidate, references, rounded));
                }
                progress.advance(1);
            }
        }
        for (s, &storage) in storages.iter().enumerate() {
            let (file, cost) = written(request, candidate, storage)?;
            for (m, model) in models.iter().enumerate() {
                let timed_deformer =
                    TimedDeformer::new(&file, request.body, model.name).map_err(MeasureError::Model)?;
                let width = if storage == Storage::F32 { 4 } else { 2 };
                let cost = Cost { frame_bytes: timed_deformer.bytes(width), ..cost.clone() };
                timed_deformers.push(timed_deformer);
                rows.push(Measurement {
                    setting: Setting {
                        refine: candidate.refine,
                        element: candidate.element.name.into(),
                        solver: candidate.solver,
                        storage: storage.name().into(),
                        model: model.name.into(),
                    },
                    mesh_nodes: candidate.solution.mesh.nodes.len(),
                    surface_nodes: candidate.solution.surface.nodes.len(),
                    forward_error: candidate.forward_error(),
                    cost,
                    error: spread(&errors[s * models.len() + m]),
                });
            }
        }
    }
    progress.end();
    progress.begin("online timing", 0);
    let poses: Vec<ControlPoses> = references.poses.iter().map(|pose| pose.poses.clone()).collect();
    time_in_turn(&mut timed_deformers, models.len(), &poses, request.limits.rounds);
    progress.end();
    for (row, timed_deformer) in rows.iter_mut().zip(&timed_deformers) {
        row.cost.frame_p50_s = median(timed_deformer.all_s.iter().copied());
        row.cost.frame_p99_s = quantile(timed_deformer.all_s.iter().copied(), 0.99);
        row.cost.frame_one_p50_s = median(timed_deformer.one_s.iter().copied());
    }
    Ok(rows)
}

/// The parts of a setting's error in one pose except for storage, as fields on the finest mesh.
struct ErrorFields {
    output: ModelOutput,
    /// Solver + discretisation + model.
    sum: Vec<Vector3<f64>>,
    pose: PoseErrors,
    /// L2 norm of the equilibrium that they are relative to, m.
    size: f64,
}

impl ErrorFields {
    fn new(
        meshes: &Meshes,
        candidates: &[Candidate],
        candidate: &Candidate,
        references: &References<'_>,
        model: &ModelEntry,
        pose: usize,
    ) -> Option<ErrorFields> {
        let (ladder, reference) = (&meshes.ladder, &references.poses[pose]);
        let evaluate_about =
            |c: &Candidate| evaluate_about(model, &c.solution, &reference.poses, &references.origins);
        let whole = |c: &Candidate, output: &ModelOutput| {
            ladder.raise(c.refine as usize, &displaced(&c.solution, output, &superposed(&c.solution, output)))
        };
        let exact = candidates.iter().find(|other| {
            other.solver.method.is_direct
                && (other.refine, other.element) == (candidate.refine, candidate.element)
        })?;
        let (finest, base) = (&candidates[references.finest], references.base(candidates));
        let output = evaluate_about(candidate)?;
        let (of_finest, of_base) = (evaluate_about(finest)?, evaluate_about(base)?);
        let here = whole(candidate, &output);
        let of_exact = evaluate_about(exact)?;
        let solved = whole(exact, &of_exact);
        let (best, at_base) = (whole(finest, &of_finest), whole(base, &of_base));
        let settled = ladder.raise(0, &reference.displacement);
        let (solver, discretisation) = (difference(&here, &solved), difference(&solved, &best));
        let model_part = difference(&at_base, &settled);
        let size = &reference.size;
        let sum = solver.iter().zip(&discretisation).zip(&model_part).map(|((s, d), m)| s + d + m).collect();
        let turned_back: Vec<_> =
            discretisation.iter().map(|e| output.motion.rotation.inverse() * e).collect();
        let held = |c: &Candidate, output: &ModelOutput| {
            wrenches_about(&c.solution, output, &reference.poses, &references.origins)
        };
        let (here, solved) = (held(candidate, &output)?, held(exact, &of_exact)?);
        let (best, at_base) = (held(finest, &of_finest)?, held(base, &of_base)?);
        // The control element with the largest error: the whole, and without cancellation.
        let off = |of: fn(&Wrench) -> Vector3<f64>| {
            let of = |e: usize| {
                let parts = [
                    of(&here[e]) - of(&solved[e]),
                    of(&solved[e]) - of(&best[e]),
                    of(&at_base[e]) - of(&reference.held[e]),
                ];
                let whole = (parts[0] + parts[1] + parts[2]).norm();
                [whole, uncancelled(whole, &parts.map(|part| part.norm()))]
            };
            (0..here.len()).map(of).fold([0.0_f64; 2], |most, off| [0, 1].map(|i| most[i].max(off[i])))
        };
        let (force, torque) =
            (off(|w| w.force).map(|f| f / size.force), off(|w| w.moment).map(|m| m / size.torque));
        let errors = PoseErrors {
            discretisation: references.norms.l2(&discretisation) / size.displacement,
            energy: references.norms.energy(&turned_back) / size.energy,
            solver: references.norms.l2(&solver) / size.displacement,
            model: references.norms.l2(&model_part) / size.displacement,
            force: force[0],
            torque: torque[0],
            uncancelled_held: force[1].max(torque[1]),
            ..PoseErrors::default()
        };
        let size = size.displacement;
        Some(ErrorFields { output, sum, pose: errors, size })
    }

    fn with_storage(
        &self,
        meshes: &Meshes,
        candidate: &Candidate,
        references: &References<'_>,
        rounded: &[Vec<f64>],
    ) -> PoseErrors {
        let error = storage_error(&candidate.solution, rounded, &self.output);
        let turned: Vec<_> = error.iter().map(|e| self.output.motion.rotation * e).collect();
        let storage = meshes.ladder.raise(candidate.refine as usize, &turned);
        let total: Vec<_> = self.sum.iter().zip(&storage).map(|(sum, s)| sum + s).collect();
        let storage = references.norms.l2(&storage) / self.size;
        let whole = references.norms.l2(&total) / self.size;
        let PoseErrors { discretisation, solver, model, .. } = self.pose;
        PoseErrors {
            storage,
            total: whole,
            uncancelled: uncancelled(whole, &[discretisation, solver, storage, model]),
            displacement_m: largest(&total),
            ..self.pose
        }
    }
}

fn spread(poses: &[PoseErrors]) -> Errors {
    let of = |part: fn(&PoseErrors) -> f64| Spread {
        median: median(poses.iter().map(part)),
        worst: quantile(poses.iter().map(part), 1.0),
    };
    Errors {
        discretisation: of(|p| p.discretisation),
        energy: of(|p| p.energy),
        solver: of(|p| p.solver),
        storage: of(|p| p.storage),
        model: of(|p| p.model),
        total: of(|p| p.total),
        uncancelled: of(|p| p.uncancelled),
        displacement_m: of(|p| p.displacement_m),
        force: Some(of(|p| p.force)),
        torque: Some(of(|p| p.torque)),
        uncancelled_held: Some(of(|p| p.uncancelled_held)),
    }
}

/// Writes the .green file of one setting as the program does; returns it with all costs but those of the frame.
fn written(
    request: &Request<'_>,
    candidate: &Candidate,
    storage: Storage,
) -> Result<(Arc<GreenFile>, Cost), MeasureError> {
    // Sections of effects are no part of what is compared here.
    let requirements = (request.requirements_of)(request.scene).without_sections();
    let name = format!(
        "{}-{}-{}-{}.green",
        candidate.refine,
        candidate.element.name,
        candidate.solver,
        storage.name()
    );
    let path = request.scratch.join(name.replace(' ', "-"));
    let precomputed = Precomputed {
        name: request.body.to_owned(),
        fingerprint: String::new(),
        storage,
        requirements,
        plan: None,
        solution: candidate.solution.clone(),
        sections: BTreeMap::new(),
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
