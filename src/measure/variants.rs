//! The variants of a body that are compared: element × refinement × solver, and models with column families of their own.
//!
//! In: a request. Out: the body's [`Meshes`], and a [`Candidate`] for every variant that is affordable. Cholesky solves each
//! element on each mesh, with the families that most models share, and again for each model with families of its own; conjugate
//! gradients solve the scene's own mesh and element. Storages and models are varied on what was solved.

use super::course::{Course, Step};
use super::data::Setting;
use super::norms::MeshLadder;
use super::request::{MeasureError, Request};
use super::resume;
use crate::base::extent::bounding_box;
use crate::deform::{MODELS, ModelEntry};
use crate::fem::{Dilatation, ELEMENTS, Element, TET4, TET10};
use crate::green::{self, AFFINE, CUBIC, Family, PERTURBATION, Requirements, STIFFNESS, Solution};
use crate::mesh::{TetMesh, quadratic};
use crate::scene::{Generate, Scene, Storage};
use crate::solve::{AUTO, Progress, SOLVERS, Solver};
use nalgebra::Vector3;

/// Tolerances of conjugate gradients to be measured.
const TOLERANCES: [f64; 5] = [1e-3, 1e-4, 1e-6, 1e-8, 1e-10];

/// Column families of every candidate.
const COMMON: &[Family] = &[AFFINE, STIFFNESS, CUBIC];

/// Column families that these models and their energies need.
pub fn families(models: &[&ModelEntry]) -> Requirements {
    models.iter().map(|model| model.with_energy()).fold(Requirements::default(), Requirements::and)
}

/// The models that are evaluated in every frame.
pub fn online() -> impl Iterator<Item = &'static ModelEntry> {
    MODELS.iter().filter(|model| model.law().is_none())
}

/// Whether the model is measured beside that of the scene: one that has the energy of a law at large strain only where it is the same
/// law, for a law's equilibrium is no reference for another.
pub fn is_measured(request: &Request<'_>, model: &ModelEntry) -> bool {
    let law = request.scene.bodies[request.body].model.large_strain_law();
    !model.is_reduced() || model.large_strain_law().name == law.name
}

/// Whether the model is made from what every candidate has.
pub fn is_common(model: &ModelEntry) -> bool {
    let made = Requirements::new(COMMON);
    model.requirements.iter().all(|family| made.has(*family))
}

/// The models of the affine columns alone: they suit every body, and where one of them is not defined nothing is measured.
pub fn of_affine_columns() -> impl Iterator<Item = &'static ModelEntry> {
    online().filter(|model| model.requirements.iter().all(|family| family.name == AFFINE.name))
}

/// Whether the model moves the nodes inside the body too, which are in no .green file: those that sum the affine columns do.
/// Others, such as `substructured` and `plate`, have displacements of the surface alone.
pub fn moves_inside(model: &ModelEntry) -> bool {
    model.requirements.iter().any(|family| family.name == AFFINE.name)
}

/// One discretisation, solved.
pub struct Candidate {
    pub refine: u32,
    pub element: &'static Element,
    pub solver: Solver,
    /// The models that are measured with it.
    pub models: Vec<&'static ModelEntry>,
    pub solution: Solution,
}

impl Candidate {
    /// Whether the setting is measured with its solution, whatever the storage.
    pub fn has(&self, setting: &Setting) -> bool {
        (self.refine, self.element.name, self.solver)
            == (setting.refine, setting.element.as_str(), setting.solver)
            && self.models.contains(&setting.model)
    }

    /// The name of the step that solved it.
    pub fn name(&self) -> String {
        Step::solved(self.refine, self.element, self.solver, own_families(&self.models))
    }

    /// Whether it is this discretisation, solved directly, and the model is measured with it.
    pub fn is_of(&self, refine: u32, element: &Element, model: &ModelEntry) -> bool {
        (self.refine, self.element) == (refine, element) && self.is_exact(model)
    }

    /// Orders discretisations: quadratic elements before all refinements.
    pub fn fineness(&self) -> (u32, u32) {
        (self.element.order, self.refine)
    }

    /// Whether it is solved directly, and the model is measured with it.
    pub fn is_exact(&self, model: &ModelEntry) -> bool {
        self.solver.method.is_direct && self.models.iter().any(|own| own.name == model.name)
    }

    /// Time of the whole offline stage with these families, s. Of the families that every candidate has, those for which a model
    /// has no use are no part of its cost.
    pub fn offline_s(&self, needed: &Requirements) -> f64 {
        let is_shared = self.models.iter().all(|model| is_common(model));
        let spared = [STIFFNESS, CUBIC].into_iter().filter(|family| is_shared && !needed.has(*family));
        self.solution.offline_s() - spared.map(|family| self.solution.times.family_s(family)).sum::<f64>()
    }

    /// The solver's estimate; finite.
    pub fn forward_error(&self) -> Option<f64> {
        // NaN and infinity become the largest number, which JSON can hold.
        Some(self.solution.stats.conditioning?.forward_error.min(f64::MAX))
    }
}

/// The name of the model, where it is one with families of its own.
fn own_families(models: &[&'static ModelEntry]) -> Option<&'static str> {
    models.first().filter(|model| !is_common(model)).map(|model| model.name)
}

/// The linear meshes of all refinements, and the quadratic meshes on them. Only refinements whose quadratic mesh is
/// affordable are there, so that the finest solution of all is one of tet10.
pub struct Meshes {
    pub linear: Vec<TetMesh>,
    pub ladder: MeshLadder,
}

impl Meshes {
    pub fn new(request: &Request<'_>) -> Result<Meshes, MeasureError> {
        let tube = match &request.scene.body[request.body].generate {
            Some(Generate::Tube(tube)) => Some(tube.clone()),
            _ => None,
        };
        let curve = |a: &Vector3<f64>, b: &Vector3<f64>| match &tube {
            Some(tube) => tube.curve(a, b),
            None => quadratic::straight(a, b),
        };
        let mut linear: Vec<TetMesh> = Vec::new();
        for refine in 0..=request.limits.refinements {
            // Each refinement has about eight times the nodes.
            let grown = linear.last().map_or(0, |mesh| 6 * mesh.nodes.len());
            if 3.0 * grown as f64 > request.limits.largest {
                break;
            }
            let scene = variant(request, refine, &TET4, Solver::default());
            let mesh = scene.load_mesh(request.body, &scene.body[request.body])?.mesh;
            let nodes = quadratic::quadratic(mesh.clone(), &curve).nodes.len();
            if 3.0 * nodes as f64 <= request.limits.largest {
                linear.push(mesh);
            } else if refine == 0 {
                let (largest, key) = (request.limits.largest, request.largest_key.clone());
                return Err(MeasureError::TooLarge { nodes, largest, key });
            } else {
                break;
            }
        }
        let ladder = MeshLadder::new(linear.clone(), &curve);
        let meshes = Meshes { linear, ladder };
        let scene = variant(request, 0, &TET10, Solver::default());
        let ten = scene.load_mesh(request.body, &scene.body[request.body])?.mesh;
        if ten.nodes != meshes.ladder.levels[0].nodes {
            return Err(MeasureError::TenNodes);
        }
        Ok(meshes)
    }

    /// The largest extent of the body, m.
    pub fn extent(&self) -> f64 {
        let (low, high) = bounding_box(&self.linear[0].nodes);
        (high - low).amax()
    }

    /// The mesh that has the element's nodes, where it is affordable.
    pub fn mesh(&self, request: &Request<'_>, refine: u32, element: &Element) -> Option<&TetMesh> {
        let cost = self.unknowns(refine, element) * element.unknown_cost;
        self.meshes_of(element).get(refine as usize).filter(|_| cost <= request.limits.largest)
    }

    fn meshes_of(&self, element: &Element) -> &[TetMesh] {
        if element.order == 1 { &self.linear } else { &self.ladder.levels }
    }

    /// Unknowns of an element on a mesh; 0 where there is no such mesh.
    pub fn unknowns(&self, refine: u32, element: &Element) -> f64 {
        3.0 * self.meshes_of(element).get(refine as usize).map_or(0, |mesh| mesh.nodes.len()) as f64
    }

    /// The elements on every mesh, by refinement; tet4 on the scene's own mesh first.
    fn all(&self) -> impl Iterator<Item = (u32, &'static Element)> {
        let refinements = 0..self.linear.len() as u32;
        refinements.flat_map(|refine| ELEMENTS.iter().map(move |element| (refine, *element)))
    }

    /// The elements on every mesh that is affordable.
    pub fn affordable(&self, request: &Request<'_>) -> Vec<(u32, &'static Element)> {
        self.all().filter(|(refine, element)| self.mesh(request, *refine, element).is_some()).collect()
    }

    /// The models with families of their own, and the discretisations for which they are affordable, in the order in which they
    /// are solved.
    pub fn for_models(&self, request: &Request<'_>) -> Vec<(&'static ModelEntry, u32, &'static Element)> {
        let limit = request.limits.largest_of_models;
        let cost = |refine: u32, element: &Element| self.unknowns(refine, element) * element.unknown_cost;
        // The series take as long again as the fields of `reduced`, from which they are made.
        let is_dear = |model: &ModelEntry| model.requirements.iter().any(|of| of.name == PERTURBATION.name);
        let is_affordable = |model: &ModelEntry, refine: u32, element: &Element| {
            let is_base = (refine, element) == (0, &TET4);
            let most = if is_base { limit } else { 0.25 * limit };
            let fits =
                cost(0, &TET4) <= limit && cost(refine, element) <= most && (is_base || !is_dear(model));
            fits || is_of_scene(request, model, refine, element)
        };
        let models = online().filter(|model| !is_common(model) && is_measured(request, model));
        let all = models.flat_map(|model| self.all().map(move |(refine, element)| (model, refine, element)));
        all.filter(|(model, refine, element)| is_affordable(model, *refine, element)).collect()
    }
}

/// The scene with another refinement, element and solver for its body.
pub fn variant(request: &Request<'_>, refine: u32, element: &'static Element, solver: Solver) -> Scene {
    let mut scene = Scene::clone(request.scene);
    let body = &mut scene.body[request.body];
    (body.refine, body.element, body.solver) =
        (request.scene.body[request.body].refine + refine, element, solver);
    body.storage = Storage::F32;
    scene
}

/// Whether the scene's own setting needs the model there: on its mesh with its element, and with tet4, where models are compared
/// with equilibria. That is measured whatever it costs.
pub fn is_of_scene(request: &Request<'_>, model: &ModelEntry, refine: u32, element: &Element) -> bool {
    let own = request.scene.body[request.body].element;
    refine == 0 && (element == own || element == &TET4) && model == request.scene.bodies[request.body].model
}

/// Conjugate gradients by tolerance, which are measured on the scene's own mesh and element; the scene's own are among them.
pub fn iterative(request: &Request<'_>) -> Vec<Solver> {
    let methods = SOLVERS.iter().copied().filter(|method| !method.is_direct && **method != AUTO);
    let of = |method| TOLERANCES.map(|tolerance| Solver { method, tolerance, ..Solver::default() });
    let mut all: Vec<Solver> = methods.flat_map(of).collect();
    let Solver { method, tolerance, .. } = request.scene.body[request.body].solver;
    let own = Solver { method, tolerance, ..Solver::default() };
    if !method.is_direct && *method != AUTO && !all.contains(&own) {
        all.push(own);
    }
    all
}

/// The models that every candidate is measured with.
fn common() -> Vec<&'static ModelEntry> {
    online().filter(|model| is_common(model)).collect()
}

/// Whether this discretisation is solved before the poses' equilibria, which are compared with it: tet4 on the scene's own mesh,
/// and the scene's own element there.
pub fn comes_first(request: &Request<'_>, refine: u32, element: &Element) -> bool {
    refine == 0 && (element == &TET4 || element == request.scene.body[request.body].element)
}

/// Solves the variants that come first.
pub fn solve_first(
    request: &Request<'_>,
    meshes: &Meshes,
    course: &Course<'_>,
) -> Result<Vec<Candidate>, MeasureError> {
    solve_common(request, meshes, course, true)
}

/// Solves all other variants; adds to `left_out` which body or element a model refuses, and why.
pub fn solve_rest(
    request: &Request<'_>,
    meshes: &Meshes,
    left_out: &mut Vec<String>,
    course: &Course<'_>,
    candidates: &mut Vec<Candidate>,
) -> Result<(), MeasureError> {
    candidates.append(&mut solve_common(request, meshes, course, false)?);
    let place = |c: &Candidate| meshes.all().position(|of| of == (c.refine, c.element));
    candidates.sort_by_key(place);
    solve_for_models(request, meshes, left_out, course, candidates)?;
    let own = request.scene.body[request.body].element;
    for solver in iterative(request).into_iter().filter(|_| meshes.mesh(request, 0, own).is_some()) {
        // Cholesky has solved this body, so it is the tolerance that is refused: the setting does not exist.
        match candidate(request, 0, own, solver, &common(), course) {
            Ok(candidate) => candidates.extend(candidate),
            Err(MeasureError::Green(_)) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Solves the affordable discretisations for the common models: those that come first, or the others.
fn solve_common(
    request: &Request<'_>,
    meshes: &Meshes,
    course: &Course<'_>,
    first: bool,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    for (refine, element) in meshes.affordable(request) {
        if comes_first(request, refine, element) != first {
            continue;
        }
        match candidate(request, refine, element, Solver::default(), &common(), course) {
            Ok(candidate) => candidates.extend(candidate),
            // Averaged pressures can be too ill-conditioned where the other elements are not. Nothing is compared
            // with them, so the rest can be measured without them.
            Err(MeasureError::Green(_)) if element.dilatation == Dilatation::Nodal => {}
            Err(error) => return Err(error),
        }
    }
    Ok(candidates)
}

/// Solves the body for every model with its own column families: with tet4 on the scene's mesh, where models are compared with
/// equilibria, then on other meshes and elements.
fn solve_for_models(
    request: &Request<'_>,
    meshes: &Meshes,
    left_out: &mut Vec<String>,
    course: &Course<'_>,
    candidates: &mut Vec<Candidate>,
) -> Result<(), MeasureError> {
    let (limit, own) = (request.limits.largest_of_models, meshes.unknowns(0, &TET4) * TET4.unknown_cost);
    if own > limit {
        let is_dropped = |model: &&ModelEntry| {
            !is_common(model) && is_measured(request, model) && !is_of_scene(request, model, 0, &TET4)
        };
        left_out.extend(online().filter(is_dropped).map(|model| {
            format!(
                "model {}: {own:.0} unknowns are more than the {limit:.0} for which a model with columns of its own is \
                 measured; raise {}",
                model.name, request.largest_key
            )
        }));
    }
    // Elements that a model refuses, and models that the scene's own mesh refuses or that there is no time for.
    let mut refused: Vec<(&str, &Element)> = Vec::new();
    let mut without: Vec<&str> = Vec::new();
    for (model, refine, element) in meshes.for_models(request) {
        if without.contains(&model.name) || refused.contains(&(model.name, element)) {
            continue;
        }
        let is_solved = match candidate(request, refine, element, Solver::default(), &[model], course) {
            Ok(candidate) => {
                let is_solved = candidate.is_some();
                candidates.extend(candidate);
                is_solved
            }
            Err(MeasureError::Green(why)) => {
                left_out.push(format!("model {} with {}: {why}", model.name, element.name));
                refused.push((model.name, element));
                false
            }
            Err(error) => return Err(error),
        };
        if !is_solved && (refine, element) == (0, &TET4) {
            without.push(model.name);
        }
    }
    Ok(())
}

/// Solves the body for these models; `None` where there is no time for it.
fn candidate(
    request: &Request<'_>,
    refine: u32,
    element: &'static Element,
    solver: Solver,
    models: &[&'static ModelEntry],
    course: &Course<'_>,
) -> Result<Option<Candidate>, MeasureError> {
    let key = Step::solved(refine, element, solver, own_families(models));
    if !course.affords(&key) {
        return Ok(None);
    }
    let scene = variant(request, refine, element, solver);
    Ok(Some(Candidate { refine, ..solved(&key, &scene, request, models, course)? }))
}

/// Solves the scene's body for these models; the candidate's `refine` is left at 0.
pub fn solved(
    key: &str,
    scene: &Scene,
    request: &Request<'_>,
    models: &[&'static ModelEntry],
    course: &Course<'_>,
) -> Result<Candidate, MeasureError> {
    let read = |bytes: &[u8]| resume::read(scene, request.body, bytes);
    let solution = course.step(key, &resume::write, &read, |progress| {
        let of_files = models.iter().map(|model| request.requirements(model));
        let requirements = of_files.fold(families(models), Requirements::and);
        fastest(scene, request, &requirements, progress)
    })?;
    let body = &scene.body[request.body];
    Ok(Candidate { refine: 0, element: body.element, solver: body.solver, models: models.to_vec(), solution })
}

/// The fastest of three solves: other work of the machine makes short times longer, never shorter.
fn fastest(
    scene: &Scene,
    request: &Request<'_>,
    requirements: &Requirements,
    progress: &dyn Progress,
) -> Result<Solution, MeasureError> {
    let mut solution = green::solve(scene, request.body, requirements, progress)?;
    if solution.offline_s() < 1.0 && !request.quick {
        for _ in 0..2 {
            let again = green::solve(scene, request.body, requirements, progress)?;
            if again.offline_s() < solution.offline_s() {
                solution = again;
            }
        }
    }
    Ok(solution)
}
