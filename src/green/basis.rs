//! Green's functions of a scene's body: assembly, partition, factorization, solves, surface rows.

use super::acting::acting;
use super::check::refuse;
use super::control::FIELDS;
use super::error::GreenError;
use super::families::{AFFINE, FAMILIES, KEPT_FACTOR};
use super::family::{Assembled, FamilyEntry, Further};
use super::judge::judge;
use super::kept::{Caching, Keep, Keeping, KeptSolves};
use super::prepare::{Fits, Prepared};
use super::requirements::Requirements;
use super::rigid::RigidMotion;
use super::solution::{Precomputed, Solution, StepTimes};
use crate::base::diagnostic::Severity;
use crate::base::machine;
use crate::fem::{Element, NodeFields, Partition};
use crate::mesh::{Surface, TetMesh};
use crate::scene::{self, Scene};
use crate::solve::{
    Factor, Job, LinearSolver, Method, NO_UNKNOWNS, Progress, SolveError, SolveStats, Solver,
};
use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::time::Instant;

/// Precomputes body `name` of the scene.
pub fn precompute(
    scene: &Scene,
    name: &str,
    requirements: &Requirements,
    progress: &dyn Progress,
) -> Result<Precomputed, GreenError> {
    precompute_kept(scene, name, requirements, None, None, Keeping::default(), progress)
}

/// [`precompute`] of a body that its model judges first, with what is computed further; what is finished is kept, and taken from where
/// it is kept.
pub fn precompute_kept(
    scene: &Scene,
    name: &str,
    requirements: &Requirements,
    fits: Option<Fits>,
    further: Option<Further<'_>>,
    keeping: Keeping<'_>,
    progress: &dyn Progress,
) -> Result<Precomputed, GreenError> {
    // Taken first: what changes while the body is solved makes the file stale, not silently wrong.
    let fingerprint = super::fingerprint(scene, name, requirements)?;
    let keep = keeping.journal.map(|journal| Keep { journal, fingerprint: &fingerprint });
    let (prepared, mesh_s) = prepared(scene, name, progress)?;
    if let Some(Err((Severity::Error, why))) = fits.map(|fits| fits(&prepared)) {
        refuse(scene, &prepared.findings)?;
        return Err(scene.invalid(&format!("body.{name}.model"), why).into());
    }
    let kept = (keep, keeping.caching);
    let mut solution = solve_kept(scene, name, prepared, requirements, (further, kept), progress)?;
    solution.times.mesh_s += mesh_s;
    Ok(Precomputed {
        name: name.to_owned(),
        storage: scene.body[name].storage,
        fingerprint,
        requirements: requirements.clone(),
        plan: scene.body[name].plan.clone(),
        solution,
        sections: BTreeMap::new(),
    })
}

/// Solves all basis fields of body `name` over all nodes, in f64.
pub fn solve(
    scene: &Scene,
    name: &str,
    requirements: &Requirements,
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    let (prepared, mesh_s) = prepared(scene, name, progress)?;
    let mut solution = solve_prepared(scene, name, prepared, requirements, progress)?;
    solution.times.mesh_s += mesh_s;
    Ok(solution)
}

/// The body, and how long it took, s.
fn prepared(scene: &Scene, name: &str, progress: &dyn Progress) -> Result<(Prepared, f64), GreenError> {
    progress.begin("mesh", 0);
    let started = Instant::now();
    let prepared = super::prepare(scene, name)?;
    let mesh_s = started.elapsed().as_secs_f64();
    progress.end();
    Ok((prepared, mesh_s))
}

/// [`solve`] of a body that was prepared, as it is in `prepared`.
pub fn solve_prepared(
    scene: &Scene,
    name: &str,
    prepared: Prepared,
    requirements: &Requirements,
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    solve_kept(scene, name, prepared, requirements, (None, (None, None)), progress)
}

/// Computes what each family holds, and how long that takes; then what else is asked for.
fn add_families(
    families: &[&FamilyEntry],
    further: Option<Further<'_>>,
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    for entry in families {
        if let Some(compute) = entry.compute {
            let started = Instant::now();
            compute(assembled, solution, progress)?;
            let took = started.elapsed().as_secs_f64();
            solution.times.families_s.insert(entry.family.name.to_owned(), took);
        }
    }
    further.map_or(Ok(()), |further| further(assembled, solution, progress))
}

/// Refuses a body for which a family that it requires cannot be made.
pub fn suits(
    scene: &Scene,
    name: &str,
    prepared: &Prepared,
    requirements: &Requirements,
) -> Result<(), GreenError> {
    let place = format!("{}: body.{name}", scene.path.display());
    let required = FAMILIES.iter().filter(|entry| requirements.has(entry.family));
    let mut judges = required.filter_map(|entry| entry.suits);
    judges.try_for_each(|suits| suits(&place, &scene.body[name], prepared))
}

fn solve_kept(
    scene: &Scene,
    name: &str,
    prepared: Prepared,
    requirements: &Requirements,
    (further, (keep, caching)): (Option<Further<'_>>, (Option<Keep<'_>>, Option<Caching>)),
    progress: &dyn Progress,
) -> Result<Solution, GreenError> {
    let body = &scene.body[name];
    if body.method == scene::Method::Bem {
        return super::boundary::solve(scene, name, prepared, requirements, progress);
    }
    suits(scene, name, &prepared, requirements)?;
    let place = format!("{}: body.{name}", scene.path.display());
    let started = Instant::now();
    let Prepared { mesh, controls, lame, findings: mut notices } = prepared;
    notices.extend(acting(scene, name, &mesh, &controls)?);
    refuse(scene, &notices)?;
    let surface = Surface::from_mesh(&mesh);
    let mut times = StepTimes { mesh_s: started.elapsed().as_secs_f64(), ..Default::default() };

    let memory = |source| GreenError::Memory { body: place.clone(), source };
    let columns = if requirements.has(AFFINE) { FIELDS * controls.len() } else { 0 };
    let need = assembly_memory(body.element, &mesh, &surface, columns);
    machine::expect("the stiffness matrix with the columns", need).map_err(memory)?;
    progress.begin("assembly", 0);
    let started = Instant::now();
    let unfit = |source| GreenError::Assembly { body: place.clone(), source };
    let k = body.element.assemble(&mesh, &lame).map_err(unfit)?;
    let partition = Partition::new(mesh.nodes.len(), controls.iter().flat_map(|c| c.nodes.iter().copied()));
    let a = partition.a(&k);
    times.assembly_s = started.elapsed().as_secs_f64();
    progress.end();

    let failed = |source| GreenError::Solve { body: place.clone(), source };
    let prescribed = || {
        let mut fields = NodeFields::zeros(mesh.nodes.len(), columns);
        for (e, control) in controls.iter().enumerate().filter(|_| columns > 0) {
            control.prescribe(&mesh.nodes, FIELDS * e, &mut fields);
        }
        fields
    };
    let mut stats = SolveStats { method: &NO_UNKNOWNS, ..Default::default() };
    let families: Vec<_> = FAMILIES.iter().filter(|entry| requirements.has(entry.family)).collect();
    let needs_factor = further.is_some() || families.iter().any(|entry| entry.solves);
    let mut fields = NodeFields::zeros(mesh.nodes.len(), 0);
    let solver: OnceCell<Box<dyn LinearSolver>> = OnceCell::new();
    let mut factor: Option<Box<dyn Factor>> = None;
    if columns > 0 {
        let rhs = partition.minus_b_times(&k, &prescribed());
        let (a, solver) = (&a, &solver);
        let job = Job { columns, needs_factor };
        let make = move |method: Option<&'static Method>, progress: &dyn Progress| {
            let settings = Solver { method: method.unwrap_or(body.solver.method), ..body.solver };
            let analysed = settings.analyse_for(a, job, progress)?;
            analysed.fits(a, columns)?;
            if requirements.has(KEPT_FACTOR) && !analysed.keeps(a, columns) {
                return Err(SolveError::NoFactor(settings.method.name));
            }
            machine::plan(analysed.memory(a, columns));
            solver.get_or_init(|| analysed).factor(a, progress)
        };
        let factored: Box<dyn Factor> = match keep {
            Some(keep) => Box::new(KeptSolves::new(keep, a, Box::new(make))),
            None => make(None, progress).map_err(failed)?,
        };
        let free;
        (free, stats) = factored.solve_and_judge(&rhs, progress).map_err(failed)?;
        drop(rhs);
        // Made again: they would be in the way of a solve that needs all memory.
        fields = prescribed();
        partition.insert_free(&free, &mut fields);
        factor = Some(factored).filter(|_| needs_factor);
    }

    let mut solution = Solution {
        element: body.element,
        method: body.method,
        mesh,
        surface,
        controls,
        fields,
        tables: BTreeMap::new(),
        loads: Vec::new(),
        compliance: None,
        kept_factor: None,
        compressed: None,
        asymmetry: None,
        rigid: RigidMotion::default(),
        stats,
        times,
        matrix_entries: k.scalar_entries(),
        notices: Vec::new(),
    };
    let solve = |b: &NodeFields, progress: &dyn Progress| match &factor {
        Some(factor) => factor.solve(b, progress).map(|(x, _)| x).map_err(failed),
        None => Ok(NodeFields::zeros(b.nodes, b.columns)),
    };
    let (place, lame, k, partition, factor) = (&*place, &*lame, &k, &partition, factor.as_deref());
    let assembled =
        Assembled { place, scene, name, body, lame, k, partition, factor, caching, solve: &solve };
    add_families(&families, further, &assembled, &mut solution, progress)?;
    if columns > 0 {
        let Solution { mesh, controls, fields, .. } = &solution;
        solution.rigid = RigidMotion::new(mesh, controls, fields, solution.stiffness());
        let forward_error = solution.stats.conditioning.map(|conditioning| conditioning.forward_error);
        let (entity, method) = (format!("body.{name}"), solution.stats.method);
        notices.extend(judge(&entity, method, forward_error, &solution.rigid).map_err(failed)?);
    }
    notices.append(&mut solution.notices);
    notices.sort_by_key(|finding| finding.severity);
    Ok(Solution { notices, ..solution })
}

/// Bytes that assembly takes at its peak, with the prescribed columns and the right-hand sides: 184 for each pair of
/// nodes that have an element in common, in K and A or in K and its rows, 170 for each tetrahedron, 400 for each node.
///
/// With V nodes at corners, T tetrahedra and B triangles of the surface there are F = 2 T + B/2 faces and, by Euler's
/// formula for one piece without holes, V + F - T - 1 edges. Nodes between the corners make three pairs on an edge, six
/// more on a face and three more inside ([`Element::pairs`]).
fn assembly_memory(element: &Element, mesh: &TetMesh, surface: &Surface, columns: usize) -> f64 {
    let (nodes, tets) = (mesh.nodes.len() as f64, mesh.tets.len() as f64);
    // Of a curved triangle, the mesh's surface has four.
    let triangles = surface.triangles.len() as f64;
    let (corners, triangles) = match element.order {
        1 => (nodes, triangles),
        _ => (nodes / 8.0, triangles / 4.0),
    };
    let faces = 2.0 * tets + 0.5 * triangles;
    let edges = corners + faces - tets;
    let [on_edge, on_face, inside] = element.pairs;
    let pairs = on_edge * edges + on_face * faces + inside * tets;
    184.0 * pairs + 170.0 * tets + 400.0 * nodes + 2.0 * 24.0 * nodes * columns as f64
}
