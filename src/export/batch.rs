//! Computes bodies in a list of poses: by superposition from the .green file, by the linear theory over all nodes, or by
//! solving anew for every pose.

use super::result_set::{ControlForces, Geometry, Missed, Needs, PoseResult, ResultSet, StressResult};
use super::statics;
use crate::base::failure::Failure;
use crate::base::notice::notice;
use crate::deform::pose_file::{self, Pose, PoseLoads};
use crate::deform::{
    AppliedLoads, ControlPose, ControlPoses, Deformer, EquilibriumResult, Frame, PoseSlope, Way, Wrench,
    find_model, model_of,
};
use crate::effect::stress::{NAME as STRESS, StressedBody};
use crate::green::{
    self, FIELDS, GreenError, GreenFile, LOAD_COMPLIANCE, LOAD_FIELDS, REACTION, STIFFNESS, Solution,
};
use crate::mesh::{Surface, TetMesh};
use crate::prepare;
use crate::scene::{Body, Scene};
use crate::solve::Silent;
use nalgebra::{DVector, Matrix3, Vector3};
use std::path::Path;
use std::sync::Arc;

/// A pose, and the body that it is for.
pub struct Asked<'a> {
    pub pose: &'a str,
    pub body: &'a str,
    pub control: ControlPoses,
    pub loads: PoseLoads,
    /// Which of the poses asked for it goes on from; rest, where there is none.
    pub after: Option<usize>,
}

/// The poses of one entry of a pose file; errors name the file, the pose and what is wrong.
pub fn ask<'a>(scene: &'a Scene, pose: &'a Pose, path: &Path) -> Result<Asked<'a>, Failure> {
    let names = || scene.body.keys().map(String::as_str);
    let wrong =
        |message: String| Failure::wrong(format!("{}: pose \"{}\": {message}", path.display(), pose.name));
    let body = match &pose.body {
        None if scene.body.len() == 1 => names().next(),
        None => return Err(wrong(format!("name its body: {}", names().collect::<Vec<_>>().join(", ")))),
        Some(name) => names().find(|known| known == name),
    };
    let Some(body) = body else {
        let name = pose.body.as_deref().unwrap_or_default();
        return Err(wrong(crate::config::unknown_name("body", name, names())));
    };
    Ok(Asked {
        pose: &pose.name,
        body,
        control: pose_file::control_poses(pose, body, &scene.body[body], path)?,
        loads: pose_file::loads(pose, body, &scene.body[body], path)?,
        after: pose.goes_on_from,
    })
}

/// All bodies of a scene in the poses that are asked for, and a table of how the solves went, where there were some.
///
/// The .green file is read from `green`, or found or made beside the scene; with `all_nodes` the linear theory is solved
/// in f64 instead.
pub fn solve<'a>(
    scene: &Scene,
    asked: &'a [Asked<'a>],
    green: Option<&Path>,
    all_nodes: bool,
) -> Result<(ResultSet, String), Failure> {
    let online = prepare::summed_part(scene)?;
    let file = match online.body.is_empty() || all_nodes {
        true => None,
        false => Some(prepare::green_file(&online, green)?),
    };
    let (mut set, mut tables) = (ResultSet::default(), String::new());
    for (name, body) in &scene.body {
        let own: Vec<&'a Asked<'a>> = asked.iter().filter(|asked| asked.body == *name).collect();
        // The linear theory takes matrices as they are, not as turns; a pose that goes on from another says which way.
        let doubtful = |asked: &Asked| {
            let doubt = pose_file::doubtful_turn(&asked.control, body);
            doubt.filter(|_| !takes_matrices(body) && asked.after.is_none())
        };
        for (asked, doubt) in own.iter().filter_map(|asked| Some((asked, doubtful(asked)?))) {
            notice!("note: pose \"{}\": body.{name}: {doubt}", asked.pose);
        }
        let (shape, found) = match (prepare::law(scene, name, body)?, &file) {
            (None, Some(file)) => surface_results(scene, file, name, &own, asked)?,
            (None, None) => volume_results(scene, name, body, &own)?,
            (Some(law), _) => {
                let place = |before: usize| own.iter().position(|own| std::ptr::eq(*own, &asked[before]));
                let pose = |asked: &&'a Asked<'a>| statics::PoseToSolve {
                    name: asked.pose,
                    control: &asked.control,
                    after: asked.after.and_then(place),
                };
                let poses: Vec<_> = own.iter().map(pose).collect();
                let solved = statics::solve(scene, name, law, &poses)?;
                tables += &format!("\n{}", solved.table.text());
                static_results(scene, name, solved, &own, &mut set.missed)?
            }
        };
        set.geometry.push(shape);
        set.results.extend(found);
    }
    let order = |result: &PoseResult| {
        asked.iter().position(|asked| asked.pose == result.pose && asked.body == result.body)
    };
    set.results.sort_by_key(order);
    Ok((set, tables))
}

/// What a run will read and give, known before anything is solved.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outlook {
    /// Some body's results will have forces.
    pub has_forces: bool,
    /// Some body's results will have stresses.
    pub has_stress: bool,
    /// Some body is shown from the .green file.
    pub needs_green: bool,
}

/// Stress on the surface of a body that is solved over all nodes.
struct SolvedStress {
    surface: Surface,
    body: StressedBody,
}

/// Where the body lists it.
fn solved_stress(
    scene: &Scene,
    name: &str,
    mesh: &TetMesh,
    held: &[&[u32]],
) -> Result<Option<SolvedStress>, GreenError> {
    if !lists_stress(&scene.body[name]) {
        return Ok(None);
    }
    let (surface, body) = StressedBody::of_mesh(scene, name, mesh, held)?;
    Ok(Some(SolvedStress { surface, body }))
}

impl SolvedStress {
    /// Of the displacements of all nodes.
    fn result(&self, displacement: &[Vector3<f64>]) -> StressResult {
        let SolvedStress { surface, body } = self;
        let u: Vec<Vector3<f64>> = surface.nodes.iter().map(|&node| displacement[node as usize]).collect();
        let at = body.at_nodes(&u);
        let mut reached = body.reached(&at);
        for node in [&mut reached.von_mises.1, &mut reached.strain.1] {
            *node = surface.nodes.get(*node).map_or(0, |&node| node as usize);
        }
        let mut nodes = vec![None; displacement.len()];
        for (&node, at) in surface.nodes.iter().zip(at) {
            nodes[node as usize] = at;
        }
        StressResult { nodes, reached }
    }
}

fn lists_stress(body: &Body) -> bool {
    body.effects.iter().any(|effect| effect == STRESS)
}

/// What a run of the scene will read and give.
pub fn outlook(scene: &Scene) -> Result<Outlook, Failure> {
    let mut outlook = Outlook::default();
    for (name, body) in &scene.body {
        let is_static = prepare::law(scene, name, body)?.is_some();
        outlook.needs_green |= !is_static;
        outlook.has_stress |= lists_stress(body);
        outlook.has_forces |= is_static || prepare::requirements(scene, name, body)?.has(STIFFNESS);
    }
    Ok(outlook)
}

impl Outlook {
    pub fn has(&self, needs: Needs) -> bool {
        match needs {
            Needs::Nothing => true,
            Needs::Forces => self.has_forces,
            Needs::Stress => self.has_stress,
        }
    }
}

/// Whether the body's model is linear in the matrices of the poses, not in their turns.
fn takes_matrices(body: &Body) -> bool {
    find_model(&body.model).is_ok_and(|model| model.frame == Frame::Rest)
}

fn control_forces(body: &Body, (wrenches, energy): (Vec<Wrench>, f64)) -> ControlForces {
    ControlForces { controls: body.control.keys().cloned().zip(wrenches).collect(), energy }
}

fn surface_results(
    scene: &Scene,
    file: &Arc<GreenFile>,
    name: &str,
    own: &[&Asked<'_>],
    all: &[Asked<'_>],
) -> Result<(Geometry, Vec<PoseResult>), Failure> {
    let body = &scene.body[name];
    let stressed = lists_stress(body).then(|| StressedBody::of_file(scene, file, name)).transpose()?;
    let mut deformer = Deformer::new(file.clone(), name, &body.model).map_err(Failure::wrong)?;
    let before = std::iter::once(None).chain(own.iter().copied().map(Some));
    let mut applied = own.iter().map(|asked| {
        let wrong = |message| Failure::wrong(format!("pose \"{}\": body.{name}: {message}", asked.pose));
        asked.loads.applied(&deformer).map_err(wrong)
    });
    let applied: Vec<AppliedLoads> = applied.by_ref().collect::<Result<_, _>>()?;
    let result = |((asked, standing), applied): ((&&Asked<'_>, _), &AppliedLoads)| {
        deformer.apply(applied);
        let result = surface_result(asked, all, standing, body, &mut deformer);
        let stress = stressed.as_ref().map(|stressed| {
            let u: Vec<_> = (0..deformer.node_count()).map(|i| deformer.straining_part(i)).collect();
            let nodes = stressed.at_nodes(&u);
            StressResult { reached: stressed.reached(&nodes), nodes }
        });
        PoseResult { stress, ..result }
    };
    let found = own.iter().zip(before).zip(&applied).map(result).collect();
    Ok((Geometry::surface(&deformer), found))
}

/// Steps in which a body is led from the pose that another goes on from to that one, so that a model that follows turns
/// sees which way they go.
const STEPS: usize = 16;

/// Leads the body through the poses that `asked` goes on from, the first of them as it stands; it is in that of `standing`.
fn lead(asked: &Asked<'_>, all: &[Asked<'_>], standing: Option<&Asked<'_>>, body: &mut Deformer) {
    let Some(before) = asked.after.and_then(|before| all.get(before)) else {
        return body.forget();
    };
    if !standing.is_some_and(|standing| std::ptr::eq(standing, before)) {
        lead(before, all, None, body);
        body.evaluate(&before.control);
    }
    let ways: Vec<Way> =
        before.control.iter().zip(&asked.control).map(|(from, to)| Way::onwards(from, to)).collect();
    for step in 1..STEPS {
        let share = step as f64 / STEPS as f64;
        let between: ControlPoses = ways.iter().map(|way| way.pose(share)).collect();
        body.take(&between);
    }
}

fn surface_result(
    asked: &Asked<'_>,
    all: &[Asked<'_>],
    standing: Option<&Asked<'_>>,
    scene_body: &Body,
    body: &mut Deformer,
) -> PoseResult {
    lead(asked, all, standing, body);
    if body.evaluate(&asked.control).is_some() && body.state.rotation_undefined {
        notice!(
            "warning: pose \"{}\": body.{}: the model \"{}\" finds no frame or no equilibrium of its control elements, which are \
             turned too far against each other or too far apart, and the result is not to be trusted; model = \"linear\" \
             has no such pose",
            asked.pose,
            body.body,
            scene_body.model
        );
    }
    PoseResult {
        pose: asked.pose.to_owned(),
        body: body.body.clone(),
        displacement: (0..body.node_count()).map(|i| body.displacement(i)).collect(),
        wrenches: body.wrenches().map(|found| control_forces(scene_body, found)),
        stress: None,
    }
}

fn volume_results(
    scene: &Scene,
    name: &str,
    body: &Body,
    asked: &[&Asked<'_>],
) -> Result<(Geometry, Vec<PoseResult>), Failure> {
    if !takes_matrices(body) {
        return Err(Failure::request(scene.invalid(
            &format!("body.{name}.model"),
            format!("--all-nodes solves the linear theory, not the model \"{}\"", body.model),
        )));
    }
    if let Some(asked) = asked.iter().find(|asked| !asked.loads.forces.is_empty()) {
        let message = "forces at points are summed from the .green file: leave --all-nodes out";
        return Err(Failure::wrong(format!("pose \"{}\": body.{name}: {message}", asked.pose)));
    }
    let solution = green::solve(scene, name, &prepare::requirements(scene, name, body)?, &Silent)?;
    for notice in &solution.notices {
        notice!("{notice}");
    }
    let held: Vec<&[u32]> = solution.controls.iter().map(|control| &control.nodes[..]).collect();
    let stressed = solved_stress(scene, name, &solution.mesh, &held)?;
    let result = |asked: &&Asked<'_>| {
        let result = volume_result(asked, name, body, &solution);
        PoseResult {
            stress: stressed.as_ref().map(|stressed| stressed.result(&result.displacement)),
            ..result
        }
    };
    let found = asked.iter().map(result).collect();
    Ok((Geometry::volume(name, &solution.mesh), found))
}

fn volume_result(asked: &Asked<'_>, name: &str, body: &Body, solution: &Solution) -> PoseResult {
    let c: Vec<f64> = asked.control.iter().flat_map(ControlPose::coefficients).collect();
    let loads = solution.tables.get(LOAD_FIELDS);
    let loaded = |row: usize| {
        let columns = loads.into_iter().flat_map(|fields| (0..fields.ncols()).map(move |k| fields[(row, k)]));
        columns.zip(&asked.loads.coefficients).map(|(u, c)| u * c).sum::<f64>()
    };
    let value =
        |row: usize| solution.fields.row(row).iter().zip(&c).map(|(u, c)| u * c).sum::<f64>() + loaded(row);
    PoseResult {
        pose: asked.pose.to_owned(),
        body: name.to_owned(),
        displacement: (0..solution.mesh.nodes.len())
            .map(|node| Vector3::from_fn(|axis, _| value(3 * node + axis)))
            .collect(),
        wrenches: volume_forces(asked, body, solution),
        stress: None,
    }
}

/// Forces by the energy of the body's model, where the scene asks for them.
fn volume_forces(asked: &Asked<'_>, body: &Body, solution: &Solution) -> Option<ControlForces> {
    let (mut model, _) = model_of(find_model(&body.model).ok()?, solution).ok()?;
    let mut slopes = vec![PoseSlope::default(); asked.control.len()];
    let response = model.respond(&asked.control, &mut slopes)?;
    let mut energy = response.energy;
    let tables = &solution.tables;
    if let (Some(reaction), Some(compliance)) = (tables.get(REACTION), tables.get(LOAD_COMPLIANCE)) {
        let lambda = DVector::from_column_slice(&asked.loads.coefficients);
        let work = reaction * &lambda;
        for ((slope, pose), h) in
            slopes.iter_mut().zip(&asked.control).zip(work.as_slice().chunks_exact(FIELDS))
        {
            slope.translation -= Vector3::new(h[0], h[1], h[2]);
            slope.matrix -= Matrix3::from_row_slice(&h[3..]);
            energy -= pose.coefficients().iter().zip(h).map(|(c, h)| c * h).sum::<f64>();
        }
        energy -= 0.5 * lambda.dot(&(compliance * &lambda));
    }
    let wrenches = slopes.iter().zip(&asked.control).map(|(slope, pose)| Wrench::of(slope, pose));
    Some(control_forces(body, (wrenches.collect(), energy)))
}

fn static_results(
    scene: &Scene,
    name: &str,
    solved: statics::Solved,
    asked: &[&Asked<'_>],
    missed: &mut Vec<Missed>,
) -> Result<(Geometry, Vec<PoseResult>), Failure> {
    let body = &scene.body[name];
    let held: Vec<&[u32]> = solved.statics.controls.iter().map(|control| &control.nodes[..]).collect();
    let stressed = solved_stress(scene, name, &solved.statics.mesh, &held)?;
    let mut found = Vec::new();
    for (asked, settled) in asked.iter().zip(solved.settled) {
        let (pose, name) = (asked.pose.to_owned(), name.to_owned());
        match settled {
            Ok(EquilibriumResult { displacement, wrenches, energy, .. }) => {
                let wrenches = Some(control_forces(body, (wrenches, energy)));
                let stress = stressed.as_ref().map(|stressed| stressed.result(&displacement));
                found.push(PoseResult { pose, body: name, displacement, wrenches, stress });
            }
            Err(why) => missed.push(Missed { pose, body: name, why }),
        }
    }
    Ok((Geometry::volume(name, &solved.statics.mesh), found))
}
