//! Solves the body with every element, refinement and solver that is affordable.

use super::ladder::MeshLadder;
use super::of_models::{families, is_common, online};
use super::request::{MeasureError, Request};
use crate::base::statistics::median;
use crate::deform::ModelEntry;
use crate::fem::{Dilatation, ELEMENTS, Element, TET4, TET10};
use crate::green::{self, Requirements, Solution};
use crate::mesh::{TetMesh, quadratic};
use crate::scene::{Generate, Scene, Storage};
use crate::solve::{Progress, SOLVERS, Solver};
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

/// One discretisation, solved.
pub struct Candidate {
    pub refine: u32,
    pub element: &'static Element,
    pub solver: Solver,
    /// The models that are measured with it.
    pub models: Vec<&'static ModelEntry>,
    pub solution: Solution,
    pub offline_s: f64,
}

impl Candidate {
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

    /// The solver's estimate; finite.
    pub fn forward_error(&self) -> Option<f64> {
        // NaN and infinity become the largest number, which JSON can hold.
        Some(self.solution.stats.conditioning?.forward_error.min(f64::MAX))
    }
}

/// The scene with another refinement, element and solver for its body.
pub fn variant(request: &Request<'_>, refine: u32, element: &'static Element, solver: Solver) -> Scene {
    let mut scene = request.scene.clone();
    let body = &mut scene.body[request.body];
    (body.refine, body.element, body.solver) =
        (request.scene.body[request.body].refine + refine, element, solver);
    body.storage = Storage::F32;
    scene
}

/// Solves every element on every affordable mesh by Cholesky, and the scene's own by conjugate gradients too.
pub fn solve(
    request: &Request<'_>,
    meshes: &Meshes,
    progress: &dyn Progress,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    let common: Vec<_> = online().filter(|model| is_common(model)).collect();
    for refine in 0..meshes.linear.len() as u32 {
        for element in ELEMENTS.iter().copied().filter(|e| meshes.affords(request, refine as usize, e)) {
            match candidate(request, refine, element, Solver::default(), &common, progress) {
                Ok(candidate) => candidates.push(candidate),
                // Averaged pressures can be too ill-conditioned where the other elements are not. Nothing is compared
                // with them, so the rest can be measured without them.
                Err(MeasureError::Green(_)) if element.dilatation == Dilatation::Nodal => {}
                Err(error) => return Err(error),
            }
        }
    }
    let own = request.scene.body[request.body].element;
    if meshes.affords(request, 0, own) {
        let iterative = SOLVERS.iter().copied().filter(|method| !method.is_direct);
        for (method, tolerance) in
            iterative.flat_map(|method| TOLERANCES.map(|tolerance| (method, tolerance)))
        {
            let solver = Solver { method, tolerance, ..Solver::default() };
            // Cholesky has solved this body, so it is the tolerance that is refused: the setting does not exist.
            match candidate(request, 0, own, solver, &common, progress) {
                Ok(candidate) => candidates.push(candidate),
                Err(MeasureError::Green(_)) => {}
                Err(error) => return Err(error),
            }
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
    progress: &dyn Progress,
) -> Result<Candidate, MeasureError> {
    let scene = variant(request, refine, element, solver);
    Ok(Candidate { refine, ..solved(&scene, request, models, progress)? })
}

/// Solves the scene's body for these models; the candidate's `refine` is left at 0.
pub fn solved(
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
    let mut times = Vec::new();
    loop {
        let solution = green::solve(scene, request.body, &requirements, progress)?;
        times.push(solution.offline_s());
        // Short times scatter, so they are measured three times.
        if times.len() == 3 || times[0] > 1.0 || request.quick {
            let offline_s = median(times);
            return Ok(Candidate { refine: 0, element, solver, models, solution, offline_s });
        }
    }
}
