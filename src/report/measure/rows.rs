//! The parts of every setting's error, and what it costs.

use super::candidates::{Candidate, Meshes};
use super::fields::{Asked, asked_of, combined, displaced, minus, storage_error, stored, wrenches_about};
use super::frame::{Contender, race};
use super::truth::{Truth, largest, online};
use super::{MeasureError, Request};
use crate::base::statistics::{median, quantile};
use crate::deform::{ControlPoses, ModelEntry, Wrench};
use crate::green::{self, GreenFile, Precomputed};
use crate::report::{Cost, Errors, Row, Setting, Spread};
use crate::scene::Storage;
use crate::solve::Progress;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// One setting's errors in one pose.
#[derive(Clone, Copy, Default)]
struct Pose {
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

/// The whole error, or the root of the sum of its parts' squares where that is larger: what is chosen by. Parts that
/// cancel in this pose make nothing better.
fn uncancelled(whole: f64, parts: &[f64]) -> f64 {
    whole.max(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
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
                let parts =
                    Parts::new(meshes, candidates, candidate, truth, model, pose).ok_or_else(|| {
                        let (element, pose) = (candidate.element.name(), &truth.poses[pose].name);
                        MeasureError::Model(format!(
                            "pose {pose}: {} with {element} cannot be measured",
                            model.name
                        ))
                    })?;
                for (s, rounded) in rounded.iter().enumerate() {
                    errors[s * models.len() + m].push(parts.with_storage(meshes, candidate, truth, rounded));
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
                    forward_error: candidate.forward_error(),
                    cost,
                    error: spread(&errors[s * models.len() + m]),
                });
            }
        }
    }
    progress.end();
    progress.begin("online race", 0);
    let poses: Vec<ControlPoses> = truth.poses.iter().map(|pose| pose.poses.clone()).collect();
    race(&mut contenders, models.len(), &poses, request.limits.rounds);
    progress.end();
    for (row, contender) in rows.iter_mut().zip(&contenders) {
        row.cost.frame_p50_s = median(contender.all_s.iter().copied());
        row.cost.frame_p99_s = quantile(contender.all_s.iter().copied(), 0.99);
        row.cost.frame_one_p50_s = median(contender.one_s.iter().copied());
    }
    Ok(rows)
}

/// A setting's error fields in one pose but for storage, on the finest mesh and turned into the body's frame.
struct Parts {
    asked: Asked,
    /// Solver + discretisation + model.
    sum: Vec<Vector3<f64>>,
    pose: Pose,
    /// L2 norm of what they are relative to, m.
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
        let (ladder, reference) = (&meshes.ladder, &truth.poses[pose]);
        let asked_of = |c: &Candidate| asked_of(model, &c.solution, &reference.poses, &truth.origins);
        let whole = |c: &Candidate, asked: &Asked| {
            ladder.raise(c.refine as usize, &displaced(&c.solution, asked, &combined(&c.solution, asked)))
        };
        let exact = candidates.iter().find(|other| {
            other.solver == "cholesky"
                && (other.refine, other.element) == (candidate.refine, candidate.element)
        })?;
        let (finest, base) = (&candidates[truth.finest], truth.base(candidates));
        let asked = asked_of(candidate)?;
        let (of_finest, of_base) = (asked_of(finest)?, asked_of(base)?);
        let here = whole(candidate, &asked);
        let of_exact = asked_of(exact)?;
        let solved = whole(exact, &of_exact);
        let (best, at_base) = (whole(finest, &of_finest), whole(base, &of_base));
        let settled = ladder.raise(0, &reference.displacement);
        let (solver, discretisation) = (minus(&here, &solved), minus(&solved, &best));
        let model_part = minus(&at_base, &settled);
        let size = &reference.size;
        let sum = solver.iter().zip(&discretisation).zip(&model_part).map(|((s, d), m)| s + d + m).collect();
        let turned_back: Vec<_> =
            discretisation.iter().map(|e| asked.motion.rotation.inverse() * e).collect();
        let held = |c: &Candidate, asked: &Asked| wrenches_about(&c.solution, asked, &truth.origins);
        let (here, solved) = (held(candidate, &asked)?, held(exact, &of_exact)?);
        let (best, at_base) = (held(finest, &of_finest)?, held(base, &of_base)?);
        // Of the control element that is worst: the whole, and what does not cancel.
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
        let errors = Pose {
            discretisation: truth.norms.l2(&discretisation) / size.displacement,
            energy: truth.norms.energy(&turned_back) / size.energy,
            solver: truth.norms.l2(&solver) / size.displacement,
            model: truth.norms.l2(&model_part) / size.displacement,
            force: force[0],
            torque: torque[0],
            uncancelled_held: force[1].max(torque[1]),
            ..Pose::default()
        };
        let size = size.displacement;
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
        let storage = truth.norms.l2(&storage) / self.size;
        let whole = truth.norms.l2(&total) / self.size;
        let Pose { discretisation, solver, model, .. } = self.pose;
        Pose {
            storage,
            total: whole,
            uncancelled: uncancelled(whole, &[discretisation, solver, storage, model]),
            displacement_m: largest(&total),
            ..self.pose
        }
    }
}

fn spread(poses: &[Pose]) -> Errors {
    let of = |part: fn(&Pose) -> f64| Spread {
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
    let precomputed = Precomputed {
        name: request.body.to_owned(),
        fingerprint: String::new(),
        storage,
        requirements: needs,
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
