//! The discretisations and solvers that a body is solved with.

use super::ladder::Ladder;
use super::{MeasureError, Request};
use crate::base::statistics::median;
use crate::green::{self, Requirements, STIFFNESS, Solution};
use crate::mesh::{TetMesh, quadratic};
use crate::scene::{Element, Generate, Method, Scene, Solver, Storage};
use crate::solve::Progress;
use nalgebra::Vector3;

/// How large what is computed may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Unknowns of a solve; each of tet4_anp counts three times.
    pub largest: f64,
    pub refinements: u32,
    /// Rounds of the online race.
    pub rounds: usize,
}

/// What one of its unknowns costs against one of tet4: rows of K of averaged pressures are longer.
fn cost(element: Element) -> f64 {
    match element {
        Element::Tet4 | Element::Tet10 => 1.0,
        Element::Tet4Anp => 3.0,
    }
}

/// Tolerances of conjugate gradients that are tried.
const TOLERANCES: [f64; 5] = [1e-3, 1e-4, 1e-6, 1e-8, 1e-10];

/// The linear meshes M_r, and all of them with their mids: those whose quadratic mesh is affordable, so that the finest
/// solution of all is one of tet10.
pub struct Meshes {
    pub linear: Vec<TetMesh>,
    pub ladder: Ladder,
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
            let scene = variant(request, refine, Element::Tet4, Solver::default());
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
        let ladder = Ladder::new(linear.clone(), &curve);
        let meshes = Meshes { linear, ladder };
        let scene = variant(request, 0, Element::Tet10, Solver::default());
        let ten = scene.load_mesh(request.body, &scene.body[request.body])?.mesh;
        if ten.nodes != meshes.ladder.levels[0].nodes {
            return Err(MeasureError::TenNodes);
        }
        Ok(meshes)
    }

    /// Those with the element's nodes, by refinement.
    fn of(&self, element: Element) -> &[TetMesh] {
        match element {
            Element::Tet4 | Element::Tet4Anp => &self.linear,
            Element::Tet10 => &self.ladder.levels,
        }
    }

    pub fn affords(&self, request: &Request<'_>, refine: usize, element: Element) -> bool {
        let unknowns = |mesh: &TetMesh| 3.0 * mesh.nodes.len() as f64;
        self.of(element)
            .get(refine)
            .is_some_and(|mesh| unknowns(mesh) * cost(element) <= request.limits.largest)
    }
}

/// One discretisation, solved.
pub struct Candidate {
    pub refine: u32,
    pub element: Element,
    /// "cholesky", or "pcg 1e-6".
    pub solver: String,
    pub solution: Solution,
    pub offline_s: f64,
}

impl Candidate {
    /// As the solver estimated it; finite.
    pub fn forward_error(&self) -> Option<f64> {
        // NaN and infinity become the largest number: a file of the rows can hold that.
        Some(self.solution.stats.conditioning?.forward_error.min(f64::MAX))
    }
}

/// The scene with its body's knobs set.
pub fn variant(request: &Request<'_>, refine: u32, element: Element, solver: Solver) -> Scene {
    let mut scene = request.scene.clone();
    let body = &mut scene.body[request.body];
    (body.refine, body.element, body.solver) =
        (request.scene.body[request.body].refine + refine, element, solver);
    body.storage = Storage::F32;
    scene
}

/// Every element on every mesh that is affordable, by Cholesky; conjugate gradients on the scene's own.
pub fn solve(
    request: &Request<'_>,
    meshes: &Meshes,
    progress: &dyn Progress,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    for refine in 0..meshes.linear.len() as u32 {
        for element in Element::ALL.into_iter().filter(|e| meshes.affords(request, refine as usize, *e)) {
            match candidate(request, refine, element, Solver::default(), progress) {
                Ok(candidate) => candidates.push(candidate),
                // Averaged pressures can be too ill-conditioned where the other elements, which the rest is measured
                // against, are not.
                Err(MeasureError::Green(_)) if element == Element::Tet4Anp => {}
                Err(error) => return Err(error),
            }
        }
    }
    let own = request.scene.body[request.body].element;
    if meshes.affords(request, 0, own) {
        for tolerance in TOLERANCES {
            let solver = Solver { method: Method::Pcg, tolerance, ..Solver::default() };
            // Cholesky has solved this body: what is refused now is the tolerance, and the setting does not exist.
            match candidate(request, 0, own, solver, progress) {
                Ok(candidate) => candidates.push(candidate),
                Err(MeasureError::Green(_)) => {}
                Err(error) => return Err(error),
            }
        }
    }
    Ok(candidates)
}

fn candidate(
    request: &Request<'_>,
    refine: u32,
    element: Element,
    solver: Solver,
    progress: &dyn Progress,
) -> Result<Candidate, MeasureError> {
    Ok(Candidate { refine, ..solved(&variant(request, refine, element, solver), request, solver, progress)? })
}

/// The scene's body solved by `solver`; its refinement is not looked at.
pub fn solved(
    scene: &Scene,
    request: &Request<'_>,
    solver: Solver,
    progress: &dyn Progress,
) -> Result<Candidate, MeasureError> {
    let element = scene.body[request.body].element;
    let mut times = Vec::new();
    loop {
        let solution = green::solve(scene, request.body, &Requirements::of(&[STIFFNESS]), progress)?;
        times.push(solution.offline_s());
        // What is fast is noisy, and is measured three times.
        if times.len() == 3 || times[0] > 1.0 || request.quick {
            let name = match solver.method {
                Method::Cholesky => "cholesky".to_owned(),
                Method::Pcg => format!("pcg {:.0e}", solver.tolerance),
            };
            let offline_s = median(times);
            return Ok(Candidate { refine: 0, element, solver: name, solution, offline_s });
        }
    }
}

/// The mesh of one element on one refinement, for the smooth problem.
pub fn smooth_mesh(meshes: &Meshes, request: &Request<'_>, element: Element, refine: u32) -> Option<TetMesh> {
    let refine = refine as usize;
    meshes.affords(request, refine, element).then(|| meshes.of(element)[refine].clone())
}
