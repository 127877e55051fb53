//! Solves the body with every element, refinement and solver that is affordable.

use super::candidate::Candidate;
use super::course::Course;
use super::kept_solution;
use super::ladder::MeshLadder;
use super::names;
use super::of_models::{families, is_common, online};
use super::request::{MeasureError, Request};
use crate::deform::ModelEntry;
use crate::fem::{Dilatation, ELEMENTS, Element, TET4, TET10};
use crate::green::{self, Requirements};
use crate::mesh::{TetMesh, quadratic};
use crate::scene::{Generate, Scene, Storage};
use crate::solve::{AUTO, Progress, SOLVERS, Solver};
use nalgebra::Vector3;

/// Tolerances of conjugate gradients to be measured.
const TOLERANCES: [f64; 5] = [1e-3, 1e-4, 1e-6, 1e-8, 1e-10];

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

    /// The meshes that have the element's nodes, by refinement.
    pub fn of(&self, element: &Element) -> &[TetMesh] {
        if element.order == 1 { &self.linear } else { &self.ladder.levels }
    }

    pub fn affords(&self, request: &Request<'_>, refine: usize, element: &Element) -> bool {
        let unknowns = |mesh: &TetMesh| 3.0 * mesh.nodes.len() as f64;
        self.of(element)
            .get(refine)
            .is_some_and(|mesh| unknowns(mesh) * element.unknown_cost <= request.limits.largest)
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

/// The elements on every mesh that is affordable, by refinement.
pub fn discretisations(request: &Request<'_>, meshes: &Meshes) -> Vec<(u32, &'static Element)> {
    let refinements = 0..meshes.linear.len() as u32;
    let all = refinements.flat_map(|refine| ELEMENTS.iter().map(move |element| (refine, *element)));
    all.filter(|(refine, element)| meshes.affords(request, *refine as usize, element)).collect()
}

/// Conjugate gradients by tolerance, which are measured on the scene's own mesh and element.
pub fn iterative() -> impl Iterator<Item = Solver> {
    let methods = SOLVERS.iter().copied().filter(|method| !method.is_direct && **method != AUTO);
    methods.flat_map(|method| TOLERANCES.map(|tolerance| Solver { method, tolerance, ..Solver::default() }))
}

/// The models that every candidate is measured with.
fn common() -> Vec<&'static ModelEntry> {
    online().filter(|model| is_common(model)).collect()
}

/// Solves every element on every affordable mesh by Cholesky.
pub fn solve(
    request: &Request<'_>,
    meshes: &Meshes,
    course: &Course<'_>,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    for (refine, element) in discretisations(request, meshes) {
        if !course.affords(&names::solved(refine, element, Solver::default(), None)) {
            continue;
        }
        match candidate(request, refine, element, Solver::default(), &common(), course) {
            Ok(candidate) => candidates.push(candidate),
            // Averaged pressures can be too ill-conditioned where the other elements are not. Nothing is compared
            // with them, so the rest can be measured without them.
            Err(MeasureError::Green(_)) if element.dilatation == Dilatation::Nodal => {}
            Err(error) => return Err(error),
        }
    }
    Ok(candidates)
}

/// Solves the scene's own mesh and element by conjugate gradients too.
pub fn solve_iteratively(
    request: &Request<'_>,
    meshes: &Meshes,
    course: &Course<'_>,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    let own = request.scene.body[request.body].element;
    for solver in iterative().filter(|_| meshes.affords(request, 0, own)) {
        if !course.affords(&names::solved(0, own, solver, None)) {
            continue;
        }
        // Cholesky has solved this body, so it is the tolerance that is refused: the setting does not exist.
        match candidate(request, 0, own, solver, &common(), course) {
            Ok(candidate) => candidates.push(candidate),
            Err(MeasureError::Green(_)) => {}
            Err(error) => return Err(error),
        }
    }
    Ok(candidates)
}

/// Solves the body for these models.
pub fn candidate(
    request: &Request<'_>,
    refine: u32,
    element: &'static Element,
    solver: Solver,
    models: &[&'static ModelEntry],
    course: &Course<'_>,
) -> Result<Candidate, MeasureError> {
    let scene = variant(request, refine, element, solver);
    let own = models.first().filter(|model| !is_common(model)).map(|model| model.name);
    let key = names::solved(refine, element, solver, own);
    Ok(Candidate { refine, ..solved(&key, &scene, request, models, course)? })
}

/// Solves the scene's body for these models; the candidate's `refine` is left at 0.
pub fn solved(
    key: &str,
    scene: &Scene,
    request: &Request<'_>,
    models: &[&'static ModelEntry],
    course: &Course<'_>,
) -> Result<Candidate, MeasureError> {
    let read = |bytes: &[u8]| kept_solution::read(scene, request.body, models, bytes);
    course.step(key, &kept_solution::write, &read, |progress| solve_once(scene, request, models, progress))
}

fn solve_once(
    scene: &Scene,
    request: &Request<'_>,
    models: &[&'static ModelEntry],
    progress: &dyn Progress,
) -> Result<Candidate, MeasureError> {
    let body = &scene.body[request.body];
    let (element, solver) = (body.element, body.solver);
    let of_files = models.iter().map(|model| request.requirements(model));
    let requirements = of_files.fold(families(models), Requirements::and);
    let models = models.to_vec();
    let mut solution = green::solve(scene, request.body, &requirements, progress)?;
    // What else the machine does makes short times longer, never shorter: the fastest of three.
    if solution.offline_s() < 1.0 && !request.quick {
        for _ in 0..2 {
            let again = green::solve(scene, request.body, &requirements, progress)?;
            if again.offline_s() < solution.offline_s() {
                solution = again;
            }
        }
    }
    Ok(Candidate { refine: 0, element, solver, models, solution })
}
