//! Errors and costs of every setting: candidates × storages × models.

use super::course::{Course, Step};
use super::data::{Cost, Errors, Measurement, Setting, Timing};
use super::fields::stored;
use super::pose_errors::{Compared, spread};
use super::reference::References;
use super::request::{MeasureError, Request};
use super::times::{TimedDeformer, time_in_turn};
use super::variants::{Candidate, Meshes, families, moves_inside, of_affine_columns};
use crate::base::machine::load;
use crate::base::statistics::median;
use crate::deform::{ControlPoses, MODELS, ModelEntry};
use crate::green::{self, GreenFile, Precomputed};
use crate::scene::Storage;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

/// A key of settings that are the same for the code of a frame: they differ in the solver alone.
type FrameKey = (u32, String, String, &'static ModelEntry);

fn frame_key(setting: &Setting) -> FrameKey {
    (setting.refine, setting.element.clone(), setting.storage.clone(), setting.model)
}

/// All settings with their errors and costs, and how far the times can be relied on. Settings that differ in the solver alone are
/// timed as one. Adds to `left_out` which models have no state on one of the meshes.
pub fn measurements(
    request: &Request<'_>,
    meshes: &Meshes,
    candidates: &[Candidate],
    references: &References<'_>,
    left_out: &mut Vec<String>,
    course: &Course<'_>,
) -> Result<(Vec<Measurement>, Timing), MeasureError> {
    let mut rows: Vec<Measurement> = Vec::new();
    // With the place of the model among those of its candidate.
    let mut untimed: BTreeMap<FrameKey, (usize, TimedDeformer)> = BTreeMap::new();
    for candidate in candidates {
        if !course.affords(&Step::errors(&candidate.name())) {
            continue;
        }
        let is_measured = |model: &&ModelEntry| {
            references.models_of_settings.iter().any(|measured| measured.name == model.name)
        };
        // What the solver does to displacements of the surface alone is not known.
        let is_known = |model: &&ModelEntry| candidate.solver.method.is_direct || moves_inside(model);
        let models = candidate.models.iter().copied().filter(is_measured).filter(is_known);
        let models: Vec<&'static ModelEntry> = models.collect();
        let is_wide = candidate.solver.method.is_direct && models.len() > 1;
        // Where time is short, the other storages of the finest mesh are the first to go.
        let is_spared =
            request.limit.is_some() && candidates.iter().all(|c| c.fineness() <= candidate.fineness());
        let own = request.scene.body[request.body].storage;
        let mut storages = Storage::ALL.to_vec();
        if !storages.contains(&own) {
            storages.push(own);
        }
        let is_of_scene = |model: &&ModelEntry| {
            candidate.element == request.scene.body[request.body].element
                && super::variants::is_of_scene(request, model, candidate.refine, candidate.element)
        };
        let is_own = |storage: Storage| storage == own && models.iter().any(is_of_scene);
        storages.retain(|&storage| {
            storage == Storage::F32 || is_wide && (!is_spared || storage == own) || is_own(storage)
        });
        let mut files = Files::default();
        let judged = course.step_as_json(&Step::errors(&candidate.name()), |_| {
            let rounded: Vec<Vec<Vec<f64>>> =
                storages.iter().map(|&s| stored(&candidate.solution, s)).collect();
            let parts = Compared { meshes, candidates, candidate, references };
            let mut errors = Vec::new();
            for model in &models {
                errors.push(match parts.errors(model, &rounded) {
                    Ok(of) => Ok(of.iter().map(|poses| spread(poses)).collect()),
                    Err(MeasureError::Model(why)) if !of_affine_columns().any(|m| m.name == model.name) => {
                        Err(why)
                    }
                    Err(error) => return Err(error),
                });
                if request.packs {
                    for storage in &storages {
                        written(request, candidate, model, *storage, &mut files)?;
                    }
                }
            }
            Ok(Judged { errors, packed: files.packed.clone() })
        })?;
        files.packed.extend(judged.packed);
        for (turn, (model, errors)) in models.into_iter().zip(judged.errors).enumerate() {
            match errors {
                Ok(errors) => {
                    for (&storage, errors) in storages.iter().zip(errors) {
                        let (row, file) = row(request, candidate, model, storage, errors, &mut files)?;
                        if let Entry::Vacant(vacant) = untimed.entry(frame_key(&row.setting)) {
                            let timed = TimedDeformer::new(&file, request.body, model);
                            vacant.insert((turn, timed.map_err(MeasureError::Model)?));
                        }
                        rows.push(row);
                    }
                }
                Err(why) if left_out.contains(&why) => {}
                Err(why) => left_out.push(why),
            }
        }
    }
    let poses: Vec<ControlPoses> = references.poses.iter().map(|pose| pose.poses.clone()).collect();
    let mut in_turn: Vec<&mut (usize, TimedDeformer)> = untimed.values_mut().collect();
    // Neighbours share a file, and the second would find it in the cache.
    in_turn.sort_by_key(|(turn, _)| *turn);
    let mut deformers: Vec<&mut TimedDeformer> = in_turn.into_iter().map(|(_, timed)| timed).collect();
    course.step_anew(Step::TIMES, |_| {
        time_in_turn(&mut deformers, &poses, request.limits.rounds);
        Ok(())
    })?;
    let timing = Timing {
        scatter: median(untimed.values().map(|(_, timed)| timed.scatter())),
        load: load(),
        processors: std::thread::available_parallelism().map_or(1, usize::from),
    };
    for row in &mut rows {
        let Some((_, timed)) = untimed.get(&frame_key(&row.setting)) else { continue };
        let cost = &mut row.cost;
        [cost.frame_p50_s, cost.frame_p99_s, cost.frame_one_p50_s] = timed.times_s();
        cost.frame_bytes = timed.bytes_read();
    }
    rows.sort_by_key(|row| place(candidates, &row.setting));
    Ok((rows, timing))
}

/// The .green files that were written of a candidate, by their names: models of the same families share one.
#[derive(Default)]
struct Files {
    /// Files with their costs.
    written: BTreeMap<String, (Arc<GreenFile>, Cost)>,
    /// Bytes when packed.
    packed: BTreeMap<String, f64>,
}

/// The errors of a candidate as they are kept: of each model, for each storage, or why it has no state.
#[derive(Serialize, Deserialize)]
struct Judged {
    errors: Vec<Result<Vec<Errors>, String>>,
    packed: BTreeMap<String, f64>,
}

/// Candidates in their order, of each the storages in theirs, and of each the models.
fn place(candidates: &[Candidate], setting: &Setting) -> [usize; 3] {
    // The scene's own, where it is none of them, comes last.
    let storage = Storage::ALL.iter().take_while(|storage| storage.name() != setting.storage).count();
    let model = MODELS.iter().position(|model| model == setting.model);
    [candidates.iter().position(|candidate| candidate.has(setting)), Some(storage), model]
        .map(Option::unwrap_or_default)
}

/// The row of a setting without its times, and the file that they are measured with.
fn row(
    request: &Request<'_>,
    candidate: &Candidate,
    model: &'static ModelEntry,
    storage: Storage,
    error: Errors,
    files: &mut Files,
) -> Result<(Measurement, Arc<GreenFile>), MeasureError> {
    let (file, mut cost) = written(request, candidate, model, storage, files)?;
    cost.offline_s = candidate.offline_s(&request.requirements(model).and(families(&[model])));
    let row = Measurement {
        setting: Setting {
            refine: candidate.refine,
            element: candidate.element.name.into(),
            solver: candidate.solver,
            storage: storage.name(),
            model,
        },
        mesh_nodes: candidate.solution.mesh.nodes.len(),
        surface_nodes: candidate.solution.surface.nodes.len(),
        forward_error: candidate.forward_error(),
        cost,
        error,
    };
    Ok((row, file))
}

/// Writes the .green file of one setting as the program does, with what the model and the scene's effects require and nothing
/// else; returns it with its sizes.
fn written(
    request: &Request<'_>,
    candidate: &Candidate,
    model: &'static ModelEntry,
    storage: Storage,
    files: &mut Files,
) -> Result<(Arc<GreenFile>, Cost), MeasureError> {
    let requirements = request.requirements(model);
    let name = format!(
        "{}-{}-{}-{}-{}.green",
        candidate.refine,
        candidate.element.name,
        candidate.solver,
        storage.name(),
        requirements.describe().replace(", ", "+")
    );
    let name = name.replace(' ', "-");
    if let Some(known) = files.written.get(&name) {
        return Ok(known.clone());
    }
    let path = request.scratch.join(&name);
    let solution = candidate.solution.clone();
    let precomputed = Precomputed::from_solution(request.body, storage, requirements, solution);
    let file_bytes = green::write(&path, std::slice::from_ref(&precomputed))? as f64;
    let io = |source| MeasureError::Io { path: path.clone(), source };
    let mut packed_bytes = None;
    if request.packs {
        let known = files.packed.get(&name).copied();
        packed_bytes = Some(match known {
            Some(bytes) => bytes,
            None => green::packed(&std::fs::read(&path).map_err(io)?).map_err(io)?.len() as f64,
        });
        files.packed.extend(packed_bytes.map(|bytes| (name.clone(), bytes)));
    }
    let stats = &candidate.solution.stats;
    let columns = candidate.solution.fields.data.len() as f64;
    let cost = Cost {
        offline_bytes: 8.0
            * (stats.factor_entries as f64 + candidate.solution.matrix_entries as f64 + columns),
        file_bytes,
        packed_bytes,
        ..Cost::default()
    };
    let written = (Arc::new(GreenFile::open(&path)?), cost);
    files.written.insert(name, written.clone());
    Ok(written)
}
