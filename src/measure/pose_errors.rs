//! The errors of a setting in a pose, part by part, as fields on the finest mesh and as wrenches.
//!
//! In: a candidate, a model, a pose with its equilibria. Out: [`PoseErrors`] for each storage. The whole is what the setting
//! shows less the finer equilibrium; the part of the mesh is the same for every model ([`AtPose::mesh_part`]), and the model's is what
//! is left.

use super::data::{Errors, Measurement, Setting, Shapes, Spread};
use super::fields::{
    ModelOutput, difference, displaced, evaluate_about, less, storage_error, stored, wrenches_about,
};
use super::finer::{FinerReference, Size};
use super::norms::{largest, relative};
use super::reference::{PoseReference, References};
use super::request::MeasureError;
use super::variants::{Candidate, Meshes};
use crate::base::statistics::{median, quantile};
use crate::deform::{ModelEntry, Wrench, model_of};
use crate::fem::{TET4, TET10};
use crate::mesh::Surface;
use crate::scene::Storage;
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// One setting's errors in one pose.
#[derive(Clone, Copy, Default)]
pub struct PoseErrors {
    discretisation: Option<f64>,
    energy: Option<f64>,
    solver: f64,
    storage: Option<f64>,
    model: f64,
    total: f64,
    uncancelled: f64,
    pub displacement_m: f64,
    force: f64,
    torque: f64,
    mesh_held: Option<f64>,
    model_held: f64,
    uncancelled_held: f64,
}

/// The whole error, or the root of the sum of its parts' squares where that is larger. Settings are chosen by it, since
/// parts that cancel in this pose may not cancel in others.
fn uncancelled(whole: f64, parts: &[f64]) -> f64 {
    whole.max(parts.iter().map(|part| part * part).sum::<f64>().sqrt())
}

/// A candidate, and what it is compared with.
pub struct Compared<'a> {
    pub meshes: &'a Meshes,
    pub candidates: &'a [Candidate],
    pub candidate: &'a Candidate,
    pub references: &'a References<'a>,
}

impl Compared<'_> {
    /// Errors of a model with each storage, pose by pose.
    pub fn errors(
        &self,
        model: &'static ModelEntry,
        rounded: &[Vec<Vec<f64>>],
    ) -> Result<Vec<Vec<PoseErrors>>, MeasureError> {
        let mut errors = vec![Vec::new(); rounded.len()];
        for reference in self.references.judged() {
            let solved = AtPose { of: self, reference };
            let fields = ErrorFields::new(&solved, model).ok_or_else(|| {
                let mesh = Setting::mesh_name(self.candidate.element.name, self.candidate.refine);
                let (name, pose) = (model.name, &reference.name);
                let unsuited = model_of(model, &self.candidate.solution).err();
                let why = unsuited.unwrap_or_else(|| format!("it has no state in the pose {pose}"));
                MeasureError::Model(format!("model {name} with {mesh}: {why}"))
            })?;
            for (errors, rounded) in errors.iter_mut().zip(rounded) {
                errors.push(fields.with_storage(self, rounded, &reference.size));
            }
        }
        Ok(errors)
    }
}

impl Compared<'_> {
    /// The whole error of a setting in a pose at the first nodes of the finest mesh, which are those of the scene's own, m; and
    /// its figures.
    pub fn field(
        &self,
        model: &'static ModelEntry,
        rounded: &[Vec<f64>],
        reference: &PoseReference,
    ) -> Option<(Vec<Vector3<f64>>, PoseErrors)> {
        let at = AtPose { of: self, reference };
        let fields = ErrorFields::new(&at, model)?;
        let (mut total, _) = fields.total(self, rounded);
        if let Some(nodes) = &fields.surface {
            let mut all = vec![Vector3::zeros(); self.meshes.linear[0].nodes.len()];
            nodes.iter().zip(&total).for_each(|(&node, error)| all[node as usize] = *error);
            total = all;
        }
        Some((total, fields.with_storage(self, rounded, &reference.size)))
    }
}

impl Compared<'_> {
    /// The whole error of a setting in a pose against another equilibrium on the finest mesh, relative to that: of shape and of
    /// wrench. `None` where the model has no state.
    pub fn against(
        &self,
        model: &'static ModelEntry,
        rounded: &[Vec<f64>],
        reference: &PoseReference,
        truth: &FinerReference,
    ) -> Option<[f64; 2]> {
        let at = AtPose { of: self, reference };
        let here = at.placed(self.candidate, model)?;
        let off = |(a, b): (&Wrench, &Wrench)| {
            let (force, torque) = ((a.force - b.force).norm(), (a.moment - b.moment).norm());
            (force / truth.size.force).max(torque / truth.size.torque)
        };
        let held = here.held.iter().zip(&truth.held).map(off).fold(0.0, f64::max);
        if here.output.surface.is_some() {
            let right: Vec<_> = at.surface().iter().map(|&node| truth.field[node as usize]).collect();
            return Some([relative(&difference(&here.field, &right), &right), held]);
        }
        let error = sum(&difference(&here.field, &truth.field), &self.storage_field(rounded, &here.output));
        Some([self.references.norms.l2(&error) / truth.size.displacement, held])
    }

    /// What the storage adds to the displacements, on the finest mesh.
    fn storage_field(&self, rounded: &[Vec<f64>], output: &ModelOutput) -> Vec<Vector3<f64>> {
        let error = storage_error(&self.candidate.solution, rounded, output);
        let turned: Vec<_> = error.iter().map(|e| output.motion.rotation * e).collect();
        self.meshes.ladder.raise(self.candidate.refine as usize, &turned)
    }
}

/// A candidate in one pose.
struct AtPose<'a> {
    of: &'a Compared<'a>,
    reference: &'a PoseReference,
}

impl AtPose<'_> {
    /// A model's displacements at the places where errors are compared, and its wrenches about the scene's origins.
    fn placed(&self, of: &Candidate, model: &ModelEntry) -> Option<Placed> {
        let (poses, about) = (&self.reference.poses, &self.of.references.origins);
        let output = evaluate_about(model, &of.solution, poses, about)?;
        let field = match &output.surface {
            Some(u) => {
                let by_node: BTreeMap<u32, Vector3<f64>> =
                    of.solution.surface.nodes.iter().copied().zip(u.iter().copied()).collect();
                // The first nodes of a finer mesh are those of the scene's.
                self.surface().iter().map(|node| by_node.get(node).copied()).collect::<Option<_>>()?
            }
            None => self.of.meshes.ladder.raise(of.refine as usize, &displaced(&of.solution, &output)),
        };
        let held = wrenches_about(&of.solution, &output, poses, about)?;
        Some(Placed { output, field, held })
    }

    /// The part of the mesh, as a field on the finest mesh and as wrenches: nothing without a finer equilibrium, and of the mesh that
    /// is the reference itself. Else what the most accurate model that is made here shows too much, less its own error, which is
    /// that with tet4 on the scene's mesh.
    fn mesh_part(&self, truth: &[Vector3<f64>], held: &[Wrench]) -> Option<(Vec<Vector3<f64>>, Vec<Wrench>)> {
        let Compared { meshes, candidates, candidate, references } = *self.of;
        let here = (candidate.refine, candidate.element);
        let is_reference = |finer: &FinerReference| finer.doubt.is_none() && here == (0, &TET10);
        if self.reference.finer.as_ref().map_or(true, is_reference) {
            let nothing = Wrench { force: Vector3::zeros(), moment: Vector3::zeros() };
            return Some((vec![Vector3::zeros(); truth.len()], vec![nothing; held.len()]));
        }
        let settled = meshes.ladder.raise(0, &self.reference.displacement);
        references.carriers().into_iter().find_map(|carrier| {
            let exact = candidates.iter().find(|c| c.is_of(candidate.refine, candidate.element, carrier))?;
            let (here, base) =
                (self.placed(exact, carrier)?, self.placed(references.base(candidates, carrier)?, carrier)?);
            let own = difference(&base.field, &settled);
            let field = difference(&difference(&here.field, truth), &own);
            let own = less(&base.held, &self.reference.held);
            Some((field, less(&less(&here.held, held), &own)))
        })
    }

    /// The nodes of the surface of the scene's mesh.
    fn surface(&self) -> &[u32] {
        let own = self.of.candidates.iter().find(|c| c.refine == 0 && c.element == &TET4);
        own.map_or(&[], |own| &own.solution.surface.nodes)
    }
}

/// A model's displacements, and its wrenches.
struct Placed {
    output: ModelOutput,
    field: Vec<Vector3<f64>>,
    held: Vec<Wrench>,
}

fn sum(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// The parts of a setting's error in one pose except for storage: fields on the finest mesh or, of a model that moves the surface
/// alone, at the surface nodes of the scene's mesh.
struct ErrorFields {
    here: Placed,
    /// Solver + discretisation + model.
    sum: Vec<Vector3<f64>>,
    pose: PoseErrors,
    /// The field that errors are relative to: that of the equilibrium, m.
    truth: Vec<Vector3<f64>>,
    /// The nodes of the surface, for a model that moves it alone.
    surface: Option<Vec<u32>>,
}

impl ErrorFields {
    fn new(at: &AtPose<'_>, model: &'static ModelEntry) -> Option<ErrorFields> {
        let Compared { meshes, candidates, candidate, references } = *at.of;
        let reference = at.reference;
        let exact = candidates.iter().find(|c| c.is_of(candidate.refine, candidate.element, model))?;
        let (here, solved) = (at.placed(candidate, model)?, at.placed(exact, model)?);
        let surface = here.output.surface.as_ref().map(|_| at.surface().to_vec());
        let at_places = |field: &[Vector3<f64>]| match &surface {
            Some(nodes) => nodes.iter().map(|&node| field[node as usize]).collect(),
            None => field.to_vec(),
        };
        let finer = reference.finer.as_ref().ok();
        let (whole_truth, held) = match finer {
            Some(finer) => (finer.field.clone(), &finer.held),
            None => (meshes.ladder.raise(0, &reference.displacement), &reference.held),
        };
        let (mesh_field, mesh_held) = at.mesh_part(&whole_truth, held)?;
        let (truth, mesh_part) = (at_places(&whole_truth), at_places(&mesh_field));
        let model_part = difference(&difference(&solved.field, &truth), &mesh_part);
        let model_held = less(&less(&solved.held, held), &mesh_held);
        let solver = difference(&here.field, &solved.field);
        let size = &reference.size;
        let norm = |field: &[Vector3<f64>]| match &surface {
            Some(_) => relative(field, &truth),
            None => references.norms.l2(field) / size.displacement,
        };
        let turned_back: Vec<_> =
            mesh_field.iter().map(|e| here.output.motion.rotation.inverse() * e).collect();
        let energy = finer.map(|_| references.norms.energy(&turned_back) / size.energy);
        let solver_held = less(&here.held, &solved.held);
        // The control element with the largest error: the whole, and without cancellation; then the parts of mesh and model.
        let off = |of: fn(&Wrench) -> Vector3<f64>| {
            let of = |e: usize| {
                let parts = [of(&solver_held[e]), of(&mesh_held[e]), of(&model_held[e])];
                let whole = (parts[0] + parts[1] + parts[2]).norm();
                let norms = parts.map(|part| part.norm());
                [whole, uncancelled(whole, &norms), norms[1], norms[2]]
            };
            let larger = |a: [f64; 4], b: [f64; 4]| [0, 1, 2, 3].map(|i| a[i].max(b[i]));
            (0..here.held.len()).map(of).fold([0.0; 4], larger)
        };
        let (force, torque) =
            (off(|w| w.force).map(|f| f / size.force), off(|w| w.moment).map(|m| m / size.torque));
        let larger = |i: usize| force[i].max(torque[i]);
        let pose = PoseErrors {
            discretisation: finer.map(|_| norm(&mesh_part)),
            energy,
            solver: norm(&solver),
            model: norm(&model_part),
            force: force[0],
            torque: torque[0],
            mesh_held: finer.map(|_| larger(2)),
            model_held: larger(3),
            uncancelled_held: larger(1),
            ..PoseErrors::default()
        };
        let sum = sum(&sum(&solver, &mesh_part), &model_part);
        Some(ErrorFields { here, sum, pose, truth, surface })
    }

    /// The whole error, and the part of storage, as fields.
    fn total(&self, of: &Compared<'_>, rounded: &[Vec<f64>]) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
        if self.surface.is_some() {
            return (self.sum.clone(), vec![Vector3::zeros(); self.sum.len()]);
        }
        let storage = of.storage_field(rounded, &self.here.output);
        (sum(&self.sum, &storage), storage)
    }

    fn with_storage(&self, of: &Compared<'_>, rounded: &[Vec<f64>], size: &Size) -> PoseErrors {
        let references = of.references;
        let norm = |field: &[Vector3<f64>]| match &self.surface {
            Some(_) => relative(field, &self.truth),
            None => references.norms.l2(field) / size.displacement,
        };
        let (total, storage) = self.total(of, rounded);
        // A part or a field of the model's own is stored too, which is not compared here.
        let is_sum = self.here.output.own.is_none() && self.surface.is_none();
        let storage = is_sum.then(|| norm(&storage));
        let whole = norm(&total);
        let PoseErrors { discretisation, solver, model, .. } = self.pose;
        let parts = [discretisation.unwrap_or(0.0), solver, storage.unwrap_or(0.0), model];
        PoseErrors {
            storage,
            total: whole,
            uncancelled: uncancelled(whole, &parts),
            displacement_m: largest(&total),
            ..self.pose
        }
    }
}

/// Median and worst of every error over the poses.
pub fn spread(poses: &[PoseErrors]) -> Errors {
    let of = |part: fn(&PoseErrors) -> f64| Spread {
        median: median(poses.iter().map(part)),
        worst: quantile(poses.iter().map(part), 1.0),
    };
    let maybe = |part: fn(&PoseErrors) -> Option<f64>| {
        let known = poses.iter().map(part).collect::<Option<Vec<f64>>>()?;
        Some(Spread { median: median(known.iter().copied()), worst: quantile(known.iter().copied(), 1.0) })
    };
    Errors {
        discretisation: maybe(|p| p.discretisation),
        energy: maybe(|p| p.energy),
        solver: of(|p| p.solver),
        storage: maybe(|p| p.storage),
        model: of(|p| p.model),
        total: of(|p| p.total),
        uncancelled: of(|p| p.uncancelled),
        displacement_m: of(|p| p.displacement_m),
        force: of(|p| p.force),
        torque: of(|p| p.torque),
        mesh_held: maybe(|p| p.mesh_held),
        model_held: of(|p| p.model_held),
        uncancelled_held: of(|p| p.uncancelled_held),
    }
}

/// The body in the pose in which the scene's own setting is furthest off, as some of the settings bend it, for the page's
/// picture. `None` where none of the rows can be drawn.
pub fn shapes(
    meshes: &Meshes,
    candidates: &[Candidate],
    references: &References<'_>,
    rows: &[Measurement],
    shown: &[usize],
    own: &Setting,
) -> Option<Shapes> {
    let settings: Vec<(usize, Drawn<'_>)> =
        shown.iter().filter_map(|&i| Some((i, Drawn::new(candidates, &rows[i].setting)?))).collect();
    let judged = settings.iter().find(|(i, _)| rows[*i].setting == *own).or_else(|| settings.first())?;
    let mut worst: Option<(usize, f64)> = None;
    let poses: Vec<&PoseReference> = references.judged().collect();
    for (p, pose) in poses.iter().enumerate() {
        let compared = Compared { meshes, candidates, candidate: judged.1.candidate, references };
        let (_, errors) = compared.field(judged.1.model, &judged.1.rounded, pose)?;
        if worst.is_none_or(|(_, most)| errors.displacement_m > most) {
            worst = Some((p, errors.displacement_m));
        }
    }
    let pose = poses[worst?.0];
    let mesh = &meshes.linear[0];
    let surface = Surface::from_mesh(mesh);
    let on_surface = |field: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        surface.nodes.iter().map(|&node| field[node as usize]).collect()
    };
    let errors = settings.iter().filter_map(|(i, drawn)| {
        let compared = Compared { meshes, candidates, candidate: drawn.candidate, references };
        let (field, _) = compared.field(drawn.model, &drawn.rounded, pose)?;
        Some((*i, on_surface(&field)))
    });
    let settled = pose.finer.as_ref().map_or(&pose.displacement, |finer| &finer.field);
    let bent: Vec<Vector3<f64>> = mesh.nodes.iter().zip(settled).map(|(x, u)| x + u).collect();
    Some(Shapes {
        pose: pose.name.clone(),
        errors: errors.collect(),
        equilibrium: on_surface(&bent),
        triangles: surface.triangles,
    })
}

/// A setting with what it was computed from.
struct Drawn<'a> {
    candidate: &'a Candidate,
    model: &'static ModelEntry,
    rounded: Vec<Vec<f64>>,
}

impl<'a> Drawn<'a> {
    fn new(candidates: &'a [Candidate], setting: &Setting) -> Option<Drawn<'a>> {
        let model = setting.model;
        let storage = Storage::named(&setting.storage)?;
        let candidate = candidates.iter().find(|candidate| candidate.has(setting))?;
        Some(Drawn { candidate, model, rounded: stored(&candidate.solution, storage) })
    }
}
