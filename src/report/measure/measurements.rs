//! Errors and costs of every setting: candidates × storages × models.

use super::candidates::{Candidate, Meshes};
use super::fields::{
    ModelOutput, difference, displaced, evaluate_about, storage_error, stored, wrenches_about,
};
use super::frame::{TimedDeformer, time_in_turn};
use super::of_models::{moves_inside, of_affine_columns};
use super::reference::{PoseReference, References, largest};
use super::request::{MeasureError, Request};
use crate::base::statistics::{median, quantile};
use crate::deform::{ControlPoses, MODELS, ModelEntry, Wrench, model_of};
use crate::green::{self, GreenFile, Precomputed, Requirements};
use crate::report::data::{Cost, Errors, Measurement, Setting, Spread};
use crate::scene::Storage;
use crate::solve::Progress;
use nalgebra::Vector3;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
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

/// A row whose evaluation is still to be timed.
struct Untimed {
    row: Measurement,
    deformer: TimedDeformer,
    /// Place of its model among those of its candidate.
    turn: usize,
}

/// All settings with their errors and costs. Tells `left_out` which models have no state on one of the meshes.
pub fn measurements(
    request: &Request<'_>,
    meshes: &Meshes,
    candidates: &[Candidate],
    references: &References<'_>,
    left_out: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Vec<Measurement>, MeasureError> {
    let mut untimed = Vec::new();
    progress.begin("errors", candidates.len() as u64);
    for candidate in candidates {
        let is_measured = |model: &&ModelEntry| {
            references.models_of_settings.iter().any(|measured| measured.name == model.name)
        };
        let models: Vec<&'static ModelEntry> = candidate.models.iter().copied().filter(is_measured).collect();
        let is_wide = candidate.solver.method.is_direct && models.len() > 1;
        let storages = if is_wide { Storage::ALL.to_vec() } else { vec![Storage::F32] };
        let rounded: Vec<Vec<Vec<f64>>> = storages.iter().map(|&s| stored(&candidate.solution, s)).collect();
        let parts = Measured { request, meshes, candidates, candidate, references };
        let mut files = Files::new();
        for (turn, model) in models.into_iter().enumerate() {
            let errors = match parts.errors(model, &rounded) {
                Ok(errors) => errors,
                Err(MeasureError::Model(why)) if !of_affine_columns().any(|m| m.name == model.name) => {
                    if !left_out.contains(&why) {
                        left_out.push(why);
                    }
                    continue;
                }
                Err(error) => return Err(error),
            };
            for (&storage, errors) in storages.iter().zip(&errors) {
                let (row, deformer) = parts.row(model, storage, errors, &mut files)?;
                untimed.push(Untimed { row, deformer, turn });
            }
        }
        progress.advance(1);
    }
    progress.end();
    progress.begin("online timing", 0);
    let poses: Vec<ControlPoses> = references.poses.iter().map(|pose| pose.poses.clone()).collect();
    // Neighbours share a file, and the second would find it in the cache.
    untimed.sort_by_key(|of| of.turn);
    let mut deformers: Vec<&mut TimedDeformer> = untimed.iter_mut().map(|of| &mut of.deformer).collect();
    time_in_turn(&mut deformers, &poses, request.limits.rounds);
    progress.end();
    let timed = untimed.into_iter().map(|Untimed { mut row, deformer, .. }| {
        row.cost.frame_p50_s = median(deformer.all_s.iter().copied());
        row.cost.frame_p99_s = quantile(deformer.all_s.iter().copied(), 0.99);
        row.cost.frame_one_p50_s = median(deformer.one_s.iter().copied());
        row.cost.frame_bytes = deformer.bytes_read();
        row
    });
    let mut rows: Vec<Measurement> = timed.collect();
    rows.sort_by_key(|row| place(candidates, &row.setting));
    Ok(rows)
}

/// The .green files that were written of a candidate, by their names, with their costs: models of the same families share one.
type Files = BTreeMap<String, (Arc<GreenFile>, Cost)>;

/// Candidates in their order, of each the storages in theirs, and of each the models.
fn place(candidates: &[Candidate], setting: &Setting) -> [usize; 3] {
    let is_of = |c: &Candidate| {
        (c.refine, c.element.name, c.solver) == (setting.refine, setting.element.as_str(), setting.solver)
            && c.models.iter().any(|model| model.name == setting.model)
    };
    let storage = Storage::ALL.iter().position(|storage| storage.name() == setting.storage);
    let model = MODELS.iter().position(|model| model.name == setting.model);
    [candidates.iter().position(is_of), storage, model].map(Option::unwrap_or_default)
}

/// A candidate, and what it is compared with.
struct Measured<'a> {
    request: &'a Request<'a>,
    meshes: &'a Meshes,
    candidates: &'a [Candidate],
    candidate: &'a Candidate,
    references: &'a References<'a>,
}

impl Measured<'_> {
    /// Errors of a model with each storage, pose by pose.
    fn errors(
        &self,
        model: &'static ModelEntry,
        rounded: &[Vec<Vec<f64>>],
    ) -> Result<Vec<Vec<PoseErrors>>, MeasureError> {
        let mut errors = vec![Vec::new(); rounded.len()];
        for reference in &self.references.poses {
            let solved = AtPose { of: self, reference, known: RefCell::default() };
            let fields = ErrorFields::new(&solved, model).ok_or_else(|| {
                let mesh = Setting::mesh_name(self.candidate.element.name, self.candidate.refine);
                let (name, pose) = (model.name, &reference.name);
                let unsuited = model_of(model, &self.candidate.solution).err();
                let why = unsuited.unwrap_or_else(|| format!("it has no state in the pose {pose}"));
                MeasureError::Model(format!("model {name} with {mesh}: {why}"))
            })?;
            for (errors, rounded) in errors.iter_mut().zip(rounded) {
                errors.push(fields.with_storage(self, rounded));
            }
        }
        Ok(errors)
    }

    /// The row of a setting without its times, and what they are measured with.
    fn row(
        &self,
        model: &ModelEntry,
        storage: Storage,
        errors: &[PoseErrors],
        files: &mut Files,
    ) -> Result<(Measurement, TimedDeformer), MeasureError> {
        let candidate = self.candidate;
        let (file, cost) = written(self.request, candidate, model, storage, files)?;
        let deformer = TimedDeformer::new(&file, self.request.body, model).map_err(MeasureError::Model)?;
        let row = Measurement {
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
            error: spread(errors),
        };
        Ok((row, deformer))
    }
}

/// A candidate in one pose.
struct AtPose<'a> {
    of: &'a Measured<'a>,
    reference: &'a PoseReference,
    /// What was evaluated already: the same candidate is often that which another is compared with.
    known: RefCell<Vec<(&'a Candidate, &'static str, Rc<Raised>)>>,
}

impl<'a> AtPose<'a> {
    /// A solution of a model raised to the finest mesh.
    fn raised(&self, of: &'a Candidate, model: &'static ModelEntry) -> Option<Rc<Raised>> {
        let is_own = |(known, name, _): &&(&Candidate, &str, Rc<Raised>)| {
            std::ptr::eq(*known, of) && *name == model.name
        };
        if let Some((.., raised)) = self.known.borrow().iter().find(is_own) {
            return Some(raised.clone());
        }
        let (poses, about) = (&self.reference.poses, &self.of.references.origins);
        let output = evaluate_about(model, &of.solution, poses, about)?;
        let field = self.of.meshes.ladder.raise(of.refine as usize, &displaced(&of.solution, &output));
        let held = wrenches_about(&of.solution, &output, poses, about)?;
        let raised = Rc::new(Raised { output, field, held });
        self.known.borrow_mut().push((of, model.name, raised.clone()));
        Some(raised)
    }

    /// The discretisation of a model: this mesh less the finest on which the model is made, and from there on
    /// [`AtPose::carried`]. Of a model that does not move the inside, displacements are carried from this mesh on.
    fn discretisation(&self, model: &'static ModelEntry, here: &Raised) -> Option<Difference> {
        let best = self.finest_of(model)?;
        let own = here.less(&*self.raised(best, model)?);
        let more = self.carried(best)?;
        if moves_inside(model) {
            return Some(own.and(&more));
        }
        let field = self.carried(self.of.candidate)?.field;
        Some(Difference { field, ..own.and(&more) })
    }

    /// What refinement changes from this mesh to the finest of all: by the most accurate model that is made on it and on a
    /// finer one, and so on from there.
    fn carried(&self, from: &'a Candidate) -> Option<Difference> {
        let Measured { candidates, references, .. } = *self.of;
        let finest = &candidates[references.finest];
        if (from.refine, from.element) == (finest.refine, finest.element) {
            let rest = self.raised(finest, finest.models[0])?;
            return Some(rest.less(&rest));
        }
        references.carriers().into_iter().find_map(|carrier| {
            let best = self.finest_of(carrier).filter(|best| best.fineness() > from.fineness())?;
            let here = candidates.iter().find(|c| c.is_of(from.refine, from.element, carrier))?;
            let step = self.raised(here, carrier)?.less(&*self.raised(best, carrier)?);
            Some(step.and(&self.carried(best)?))
        })
    }

    /// The finest mesh on which the model has a state in this pose.
    fn finest_of(&self, model: &'static ModelEntry) -> Option<&'a Candidate> {
        let mut made: Vec<&Candidate> = self.of.candidates.iter().filter(|c| c.is_exact(model)).collect();
        made.sort_by_key(|c| std::cmp::Reverse(c.fineness()));
        made.into_iter().find(|c| self.raised(c, model).is_some())
    }
}

/// A model's displacements on the finest mesh, and its wrenches.
struct Raised {
    output: ModelOutput,
    field: Vec<Vector3<f64>>,
    held: Vec<Wrench>,
}

/// One solution less another, as a field and as wrenches.
struct Difference {
    field: Vec<Vector3<f64>>,
    held: Vec<Wrench>,
}

impl Raised {
    fn less(&self, other: &Raised) -> Difference {
        let less =
            |(a, b): (&Wrench, &Wrench)| Wrench { force: a.force - b.force, moment: a.moment - b.moment };
        let held = self.held.iter().zip(&other.held).map(less).collect();
        Difference { field: difference(&self.field, &other.field), held }
    }
}

impl Difference {
    fn and(&self, other: &Difference) -> Difference {
        let and =
            |(a, b): (&Wrench, &Wrench)| Wrench { force: a.force + b.force, moment: a.moment + b.moment };
        let held = self.held.iter().zip(&other.held).map(and).collect();
        Difference { field: sum(&self.field, &other.field), held }
    }
}

fn sum(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// The parts of a setting's error in one pose except for storage, as fields on the finest mesh.
struct ErrorFields {
    here: Rc<Raised>,
    /// Solver + discretisation + model.
    sum: Vec<Vector3<f64>>,
    pose: PoseErrors,
    /// The part of the model and its largest displacement, m, where they are known on the surface alone and no part of `sum`.
    surface: [f64; 2],
    /// L2 norm of the equilibrium that they are relative to, m.
    size: f64,
}

impl ErrorFields {
    fn new(at: &AtPose<'_>, model: &'static ModelEntry) -> Option<ErrorFields> {
        let Measured { meshes, candidates, candidate, references, .. } = *at.of;
        let reference = at.reference;
        let exact = candidates.iter().find(|c| c.is_of(candidate.refine, candidate.element, model))?;
        let base = references.base(candidates, model)?;
        let (here, solved) = (at.raised(candidate, model)?, at.raised(exact, model)?);
        let Difference { field: discretisation, held: coarse } = at.discretisation(model, &solved)?;
        let at_base = at.raised(base, model)?;
        let (solver, size) = (difference(&here.field, &solved.field), &reference.size);
        let (mut surface, mut sum) = ([0.0; 2], sum(&solver, &discretisation));
        let model_part = match &at_base.output.surface {
            Some(u) => {
                surface = reference.surface_error(&base.solution, u).into();
                surface[0]
            }
            None => {
                let settled = meshes.ladder.raise(0, &reference.displacement);
                let part = difference(&at_base.field, &settled);
                sum.iter_mut().zip(&part).for_each(|(sum, part)| *sum += part);
                references.norms.l2(&part) / size.displacement
            }
        };
        let turned_back: Vec<_> =
            discretisation.iter().map(|e| here.output.motion.rotation.inverse() * e).collect();
        // The control element with the largest error: the whole, and without cancellation.
        let off = |of: fn(&Wrench) -> Vector3<f64>| {
            let of = |e: usize| {
                let parts = [
                    of(&here.held[e]) - of(&solved.held[e]),
                    of(&coarse[e]),
                    of(&at_base.held[e]) - of(&reference.held[e]),
                ];
                let whole = (parts[0] + parts[1] + parts[2]).norm();
                [whole, uncancelled(whole, &parts.map(|part| part.norm()))]
            };
            (0..here.held.len()).map(of).fold([0.0_f64; 2], |most, off| [0, 1].map(|i| most[i].max(off[i])))
        };
        let (force, torque) =
            (off(|w| w.force).map(|f| f / size.force), off(|w| w.moment).map(|m| m / size.torque));
        let errors = PoseErrors {
            discretisation: references.norms.l2(&discretisation) / size.displacement,
            energy: references.norms.energy(&turned_back) / size.energy,
            solver: references.norms.l2(&solver) / size.displacement,
            model: model_part,
            force: force[0],
            torque: torque[0],
            uncancelled_held: force[1].max(torque[1]),
            ..PoseErrors::default()
        };
        Some(ErrorFields { here, sum, pose: errors, surface, size: size.displacement })
    }

    fn with_storage(&self, of: &Measured<'_>, rounded: &[Vec<f64>]) -> PoseErrors {
        let Measured { meshes, candidate, references, .. } = of;
        let error = storage_error(&candidate.solution, rounded, &self.here.output);
        let turned: Vec<_> = error.iter().map(|e| self.here.output.motion.rotation * e).collect();
        let storage = meshes.ladder.raise(candidate.refine as usize, &turned);
        let total: Vec<_> = self.sum.iter().zip(&storage).map(|(sum, s)| sum + s).collect();
        let storage = references.norms.l2(&storage) / self.size;
        let whole = references.norms.l2(&total) / self.size + self.surface[0];
        let PoseErrors { discretisation, solver, model, .. } = self.pose;
        PoseErrors {
            storage,
            total: whole,
            uncancelled: uncancelled(whole, &[discretisation, solver, storage, model]),
            displacement_m: largest(&total) + self.surface[1],
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

/// Writes the .green file of one setting as the program does, with what the model and the scene's effects require and nothing
/// else; returns it with all costs but those of the frame.
fn written(
    request: &Request<'_>,
    candidate: &Candidate,
    model: &ModelEntry,
    storage: Storage,
    files: &mut Files,
) -> Result<(Arc<GreenFile>, Cost), MeasureError> {
    let mut scene = request.scene.clone();
    model.name.clone_into(&mut scene.body[request.body].model);
    let requirements = (request.requirements_of)(&scene).and(Requirements::of(model.requirements));
    let name = format!(
        "{}-{}-{}-{}-{}.green",
        candidate.refine,
        candidate.element.name,
        candidate.solver,
        storage.name(),
        requirements.describe().replace(", ", "+")
    );
    let name = name.replace(' ', "-");
    if let Some(known) = files.get(&name) {
        return Ok(known.clone());
    }
    let path = request.scratch.join(&name);
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
    let mut packed_bytes = None;
    if request.packs {
        let bytes = std::fs::read(&path).map_err(io)?;
        packed_bytes = Some(green::packed(&bytes).map_err(io)?.len() as f64);
    }
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
    let written = (Arc::new(GreenFile::open(&path)?), cost);
    files.insert(name, written.clone());
    Ok(written)
}
