//! The errors of a setting in a pose, part by part, as fields on the finest mesh and as wrenches.
//!
//! In: a candidate, a model, a pose with its equilibrium. Out: [`PoseErrors`] for each storage. What a mesh lacks on which a
//! model is not made is carried on by other models ([`AtPose::carried`]).

use super::data::{Errors, Measurement, Setting, Shapes, Spread};
use super::fields::{
    ModelOutput, difference, displaced, evaluate_about, storage_error, stored, wrenches_about,
};
use super::norms::largest;
use super::reference::{PoseReference, References};
use super::request::MeasureError;
use super::variants::{Candidate, Meshes, moves_inside};
use crate::base::statistics::{median, quantile};
use crate::deform::{ModelEntry, Wrench, model_of};
use crate::mesh::Surface;
use crate::scene::Storage;
use nalgebra::Vector3;
use std::cell::RefCell;
use std::rc::Rc;

/// One setting's errors in one pose.
#[derive(Clone, Copy, Default)]
pub struct PoseErrors {
    discretisation: f64,
    energy: f64,
    solver: f64,
    storage: Option<f64>,
    model: f64,
    total: f64,
    uncancelled: f64,
    pub displacement_m: f64,
    force: f64,
    torque: f64,
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
        let at = AtPose { of: self, reference, known: RefCell::default() };
        let fields = ErrorFields::new(&at, model)?;
        let (mut total, _) = fields.total(self, rounded);
        for (node, error) in &fields.on_surface {
            total[*node] += error;
        }
        Some((total, fields.with_storage(self, rounded)))
    }
}

/// A candidate in one pose.
struct AtPose<'a> {
    of: &'a Compared<'a>,
    reference: &'a PoseReference,
    /// Results that were evaluated already: the same candidate is often that which another is compared with.
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

    /// The change by refinement from this mesh to the finest of all: by the most accurate model that is made on it and on a finer
    /// one, and so on from there.
    fn carried(&self, from: &'a Candidate) -> Option<Difference> {
        let Compared { candidates, references, .. } = *self.of;
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
    /// The model's part at the nodes of the scene's mesh.
    on_surface: Vec<(usize, Vector3<f64>)>,
    /// L2 norm of the equilibrium that they are relative to, m.
    size: f64,
}

impl ErrorFields {
    fn new(at: &AtPose<'_>, model: &'static ModelEntry) -> Option<ErrorFields> {
        let Compared { meshes, candidates, candidate, references, .. } = *at.of;
        let reference = at.reference;
        let exact = candidates.iter().find(|c| c.is_of(candidate.refine, candidate.element, model))?;
        let base = references.base(candidates, model)?;
        let (here, solved) = (at.raised(candidate, model)?, at.raised(exact, model)?);
        let Difference { field: discretisation, held: coarse } = at.discretisation(model, &solved)?;
        let at_base = at.raised(base, model)?;
        let (solver, size) = (difference(&here.field, &solved.field), &reference.size);
        let (mut surface, mut sum) = ([0.0; 2], sum(&solver, &discretisation));
        let mut on_surface = Vec::new();
        let model_part = match &at_base.output.surface {
            Some(u) => {
                surface = reference.surface_error(&base.solution, u).into();
                let nodes = base.solution.surface.nodes.iter().map(|&node| node as usize);
                on_surface = nodes.zip(u).map(|(n, u)| (n, u - reference.displacement[n])).collect();
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
        Some(ErrorFields { here, sum, pose: errors, surface, on_surface, size: size.displacement })
    }

    /// The whole error but for what is known on the surface alone, and the part of storage, as fields on the finest mesh.
    fn total(&self, of: &Compared<'_>, rounded: &[Vec<f64>]) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
        let Compared { meshes, candidate, .. } = of;
        let error = storage_error(&candidate.solution, rounded, &self.here.output);
        let turned: Vec<_> = error.iter().map(|e| self.here.output.motion.rotation * e).collect();
        let storage = meshes.ladder.raise(candidate.refine as usize, &turned);
        (sum(&self.sum, &storage), storage)
    }

    fn with_storage(&self, of: &Compared<'_>, rounded: &[Vec<f64>]) -> PoseErrors {
        let references = of.references;
        let (total, storage) = self.total(of, rounded);
        // A part or a field of the model's own is stored too, which is not compared here.
        let is_sum = self.here.output.own.is_none() && self.here.output.surface.is_none();
        let storage = is_sum.then(|| references.norms.l2(&storage) / self.size);
        let whole = references.norms.l2(&total) / self.size + self.surface[0];
        let PoseErrors { discretisation, solver, model, .. } = self.pose;
        PoseErrors {
            storage,
            total: whole,
            uncancelled: uncancelled(whole, &[discretisation, solver, storage.unwrap_or(0.0), model]),
            displacement_m: largest(&total) + self.surface[1],
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
    Errors {
        discretisation: of(|p| p.discretisation),
        energy: of(|p| p.energy),
        solver: of(|p| p.solver),
        storage: poses.iter().all(|p| p.storage.is_some()).then(|| of(|p| p.storage.unwrap_or_default())),
        model: of(|p| p.model),
        total: of(|p| p.total),
        uncancelled: of(|p| p.uncancelled),
        displacement_m: of(|p| p.displacement_m),
        force: Some(of(|p| p.force)),
        torque: Some(of(|p| p.torque)),
        uncancelled_held: Some(of(|p| p.uncancelled_held)),
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
    for (p, pose) in references.poses.iter().enumerate() {
        let compared = Compared { meshes, candidates, candidate: judged.1.candidate, references };
        let (_, errors) = compared.field(judged.1.model, &judged.1.rounded, pose)?;
        if worst.is_none_or(|(_, most)| errors.displacement_m > most) {
            worst = Some((p, errors.displacement_m));
        }
    }
    let pose = &references.poses[worst?.0];
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
    let bent: Vec<Vector3<f64>> = mesh.nodes.iter().zip(&pose.displacement).map(|(x, u)| x + u).collect();
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
        let is_own = |of: &&Candidate| {
            (of.refine, of.element.name, of.solver) == (setting.refine, &setting.element, setting.solver)
                && of.models.contains(&model)
        };
        let candidate = candidates.iter().find(is_own)?;
        Some(Drawn { candidate, model, rounded: stored(&candidate.solution, storage) })
    }
}
