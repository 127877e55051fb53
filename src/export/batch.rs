//! Computes bodies in a list of poses: by superposition from the .green file, by the linear theory over all nodes, or by
//! solving anew for every pose.

use super::all_nodes::{self, AllNodes};
use super::asked::{PoseRequest, has_forces, lead};
use super::result_set::{ControlForces, Geometry, MissedPose, Needs, PoseResult, ResultSet, StressResult};
use super::told::{PointPush, PoseFacts, Sureness};
use super::{free_poses, statics, unsure};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::deform::{AppliedLoads, Deformer, EquilibriumResult, Strain, Wrench, pose_file};
use crate::effect::expected;
use crate::effect::stress::{StressedBody, SurfaceLoads};
use crate::green::{GreenError, GreenFile, Solution};
use crate::mesh::{Surface, TetMesh};
use crate::prepare::{self, Resolved};
use crate::scene::Body;
use crate::world::{beyond_law, out_of_range_of, wrench_error_of};
use nalgebra::Vector3;
use std::path::Path;
use std::sync::Arc;

/// Checks also the parts of the file that opening it leaves unchecked.
fn verified(file: Arc<GreenFile>) -> Result<Arc<GreenFile>, Failure> {
    file.verify()?;
    Ok(file)
}

/// Results of all bodies of a scene in the given poses, and a table of the solves, where there were some.
///
/// The .green file is read from `green`, or found or made beside the scene; with `all_nodes` the linear theory is solved
/// in f64 instead.
pub fn solve(
    scene: &Resolved,
    asked: &[PoseRequest<'_>],
    green: Option<&Path>,
    all_nodes: bool,
) -> Result<(ResultSet, String), Failure> {
    let online = prepare::summed_part(scene)?;
    let anew = (all_nodes && !online.body.is_empty()).then(|| AllNodes::solve(&online, asked)).transpose()?;
    let file = match &anew {
        Some(anew) => Some(anew.file.clone()),
        None if online.body.is_empty() => None,
        // Nobody would notice a force that is missing because the file is damaged.
        None => Some(prepare::green_file(&online, green).and_then(verified)?),
    };
    let (mut set, mut tables) = (ResultSet::default(), String::new());
    let asked = &free_poses::found(scene, asked, file.as_ref(), &mut set.missed)?[..];
    for (name, body) in &scene.body {
        let is_missed = |asked: &PoseRequest<'_>| {
            set.missed.iter().any(|missed| missed.pose == asked.pose && missed.body == *name)
        };
        let own: Vec<&PoseRequest<'_>> =
            asked.iter().filter(|asked| asked.body == *name && !is_missed(asked)).collect();
        // The linear theory takes matrices as they are, not as turns; a pose that continues another one has a known direction.
        let doubtful = |asked: &PoseRequest<'_>| {
            let doubt = pose_file::doubtful_turn(&asked.control, body);
            doubt.filter(|_| !scene.bodies[name].model.is_linear() && asked.after.is_none())
        };
        for (asked, doubt) in own.iter().filter_map(|asked| Some((asked, doubtful(asked)?))) {
            notice!("note: {}: {doubt}", asked.place());
        }
        let solution = anew.as_ref().and_then(|anew| anew.solution(name));
        let (shape, found) = match (scene.law(name)?, &file) {
            (None, Some(file)) => {
                surface_results(scene, (file, solution), name, (&own, asked), &mut set.missed)?
            }
            // No such body is left without a file.
            (None, None) => continue,
            (Some(law), _) => {
                let place = |before: usize| own.iter().position(|own| std::ptr::eq(*own, &asked[before]));
                let poses: Vec<_> = own
                    .iter()
                    .map(|asked| statics::PoseToSolve { asked, after: asked.after.and_then(place) })
                    .collect();
                let solved = statics::solve(scene, name, law, &poses)?;
                tables += &format!("\n{}", solved.table.text());
                static_results(scene, name, solved, &own, &mut set.missed)?
            }
        };
        let measured = match scene.law(name)? {
            Some(_) => prepare::measured_errors(scene, name, &scene.requirements(name)?).ok().flatten(),
            None => None,
        };
        let looked = match &measured {
            Some(errors) => unsure::ErrorSource::InFile(Some(errors)),
            None => unsure::ErrorSource::Nowhere,
        };
        let told = found.into_iter().map(|result| with_facts(scene, asked, looked, result));
        set.geometry.push(solution.map_or(shape, |solution| Geometry::volume(name, &solution.mesh)));
        set.results.extend(told.map(|result| match solution {
            Some(solution) => all_nodes::spread(result, solution),
            None => result,
        }));
    }
    let order = |result: &PoseResult| {
        asked.iter().position(|asked| asked.pose == result.pose && asked.body == result.body)
    };
    set.results.sort_by_key(order);
    Ok((set, tables))
}

/// Adds to a result the poses, freedom and loads of its control elements, and a reason where its error is unknown.
fn with_facts(
    scene: &Resolved,
    all: &[PoseRequest<'_>],
    looked: unsure::ErrorSource<'_>,
    result: PoseResult,
) -> PoseResult {
    let Some(asked) = all.iter().find(|one| one.pose == result.pose && one.body == result.body) else {
        return result;
    };
    let mut told = result.told;
    if told.control.is_empty() {
        told.control.clone_from(&asked.control);
    }
    told.model = scene.bodies[&result.body].model;
    told.names = scene.body[&result.body].control.keys().cloned().collect();
    told.freedom.clone_from(&asked.freedom);
    told.loads.clone_from(&asked.loads);
    told.after = asked.after.map(|before| all[before].pose.to_owned());
    if told.error == Sureness::default() {
        let why = unsure::why(scene, &result.body, looked, &asked.freedom);
        told.error = Sureness::Unknown(why);
    }
    PoseResult { told, ..result }
}

/// The contents of a run's results, and whether it needs the .green file, known before anything is solved.
#[derive(Clone, Copy, Debug, Default)]
pub struct Outlook {
    /// Whether some body's results will have forces.
    pub has_forces: bool,
    /// Whether some body's results will have stresses.
    pub has_stress: bool,
    /// Whether some body is shown from the .green file.
    pub needs_green: bool,
    /// Whether some control element is free, so that its pose is searched for.
    pub has_found: bool,
}

/// Stress on the surface of a body that is solved over all nodes.
struct SolvedStress {
    surface: Surface,
    body: StressedBody,
}

/// Prepares the stress of the body, if the body lists an effect that shows stress.
fn solved_stress(
    scene: &Resolved,
    name: &str,
    mesh: &TetMesh,
    held: &[&[u32]],
) -> Result<Option<SolvedStress>, GreenError> {
    if !lists_stress(scene, name) {
        return Ok(None);
    }
    let (surface, body) = StressedBody::of_mesh(scene, name, mesh, held)?;
    Ok(Some(SolvedStress { surface, body }))
}

impl SolvedStress {
    /// The stress from the displacements of all nodes under loads; `points`: the nodes of the mesh with forces at single
    /// points.
    fn result(
        &self,
        displacement: &[Vector3<f64>],
        stretch: f64,
        coefficients: &[f64],
        points: &[u32],
    ) -> StressResult {
        let SolvedStress { surface, body } = self;
        let on_surface = |node: &u32| Some(surface.nodes.binary_search(node).ok()? as u32);
        let points: Vec<u32> = points.iter().filter_map(on_surface).collect();
        let loads = SurfaceLoads { coefficients, points: &points };
        let u: Vec<Vector3<f64>> = surface.nodes.iter().map(|&node| displacement[node as usize]).collect();
        let nodes = body.at_nodes(&u, stretch, Strain::Finite, &loads);
        let on_surface = StressResult { reached: body.reached(&nodes), nodes };
        on_surface.spread(&surface.nodes, displacement.len())
    }
}

fn lists_stress(scene: &Resolved, body: &str) -> bool {
    scene.bodies[body].entries().any(|effect| effect.shows_stress)
}

/// Finds whether a run of the scene will give forces and stresses, and whether it needs the .green file.
pub fn outlook(scene: &Resolved) -> Result<Outlook, Failure> {
    let mut outlook = Outlook::default();
    for name in scene.body.keys() {
        outlook.needs_green |= scene.law(name)?.is_none();
        outlook.has_stress |= lists_stress(scene, name);
        outlook.has_forces |= has_forces(scene, name)?;
    }
    Ok(outlook)
}

impl Outlook {
    pub fn has(&self, needs: Needs) -> bool {
        match needs {
            Needs::Nothing => true,
            Needs::Forces => self.has_forces,
            Needs::Stress => self.has_stress,
            Needs::Found => self.has_found,
        }
    }
}

fn control_forces(body: &Body, (wrenches, energy): (Vec<Wrench>, f64)) -> ControlForces {
    ControlForces { controls: body.control.keys().cloned().zip(wrenches).collect(), energy }
}

/// Results of a body over its surface, from its columns in a file; with a solution, that is a file of what was solved anew.
fn surface_results(
    scene: &Resolved,
    (file, solution): (&Arc<GreenFile>, Option<&Solution>),
    name: &str,
    (own, all): (&[&PoseRequest<'_>], &[PoseRequest<'_>]),
    missed: &mut Vec<MissedPose>,
) -> Result<(Geometry, Vec<PoseResult>), Failure> {
    let (body, model) = (&scene.body[name], scene.bodies[name].model);
    let stressed = match solution {
        None if lists_stress(scene, name) => Some(StressedBody::of_file(scene, file, name)?),
        None => None,
        Some(Solution { mesh, controls, .. }) => {
            let held: Vec<&[u32]> = controls.iter().map(|control| &control.nodes[..]).collect();
            solved_stress(scene, name, mesh, &held)?.map(|solved| solved.body)
        }
    };
    let mut deformer = Deformer::new(file.clone(), name, model).map_err(Failure::wrong)?;
    let expected = expected::read(file, name)?.filter(|errors| errors.model == model);
    let before = std::iter::once(None).chain(own.iter().copied().map(Some));
    let mut applied = own.iter().map(|asked| {
        let wrong = |message| Failure::wrong(format!("{}: {message}", asked.place()));
        asked.loads.applied(&deformer).map_err(wrong)
    });
    let applied: Vec<AppliedLoads> = applied.by_ref().collect::<Result<_, _>>()?;
    let geometry = Geometry::surface(&deformer);
    let result = |((asked, standing), applied): ((&&PoseRequest<'_>, _), &AppliedLoads)| {
        deformer.apply(applied);
        let result = surface_result(asked, all, standing, body, &mut deformer)
            .map_err(|why| {
                missed.push(MissedPose { pose: asked.pose.to_owned(), body: name.to_owned(), why });
            })
            .ok()?;
        let stress = stressed.as_ref().map(|stressed| {
            let nodes = stressed.stress(&deformer);
            StressResult { reached: stressed.reached(&nodes), nodes }
        });
        let wrenches = deformer.wrenches().map(|(wrenches, _)| wrenches);
        let known = expected.as_ref().zip(wrenches.as_ref());
        let error =
            known.and_then(|(expected, found)| wrench_error_of(expected, &deformer, found, &asked.freedom));
        let unknown = || {
            let looked = match solution {
                Some(_) => unsure::ErrorSource::Nowhere,
                None => unsure::ErrorSource::InFile(expected.as_ref()),
            };
            Sureness::Unknown(unsure::why(scene, name, looked, &asked.freedom))
        };
        let mut told =
            PoseFacts { error: error.map_or_else(unknown, Sureness::Measured), ..PoseFacts::default() };
        told.places = deformer.controls.iter().map(|control| control.origin + deformer.centre).collect();
        told.beyond = out_of_range_of(&deformer);
        told.pushed = PointPush::list(&applied.points, &geometry.rest, &result.displacement);
        if let Some(stressed) = stressed.as_ref().filter(|_| free_poses::yields(stress.as_ref())) {
            told.first_yield = free_poses::first_yield(asked, &mut deformer, stressed, expected.as_ref());
            // Later poses may continue from this one: the deformer returns to it.
            lead(asked, all, None, &mut deformer);
            deformer.evaluate(&asked.control);
        }
        Some(PoseResult { stress, told, ..result })
    };
    let found = own.iter().zip(before).zip(&applied).filter_map(result).collect();
    Ok((geometry, found))
}

/// The body in a pose; the error says that the model has no state there.
fn surface_result(
    asked: &PoseRequest<'_>,
    all: &[PoseRequest<'_>],
    standing: Option<&PoseRequest<'_>>,
    scene_body: &Body,
    body: &mut Deformer,
) -> Result<PoseResult, String> {
    lead(asked, all, standing, body);
    if body.evaluate(&asked.control).is_some() && body.state.rotation_undefined {
        return Err(format!(
            "{}: the model \"{}\" has no result for this pose: take model = \"stvk\" for it",
            asked.place(),
            body.entry.name
        ));
    }
    Ok(PoseResult {
        pose: asked.pose.to_owned(),
        body: body.body.clone(),
        displacement: (0..body.node_count()).map(|i| body.displacement(i)).collect(),
        wrenches: body.wrenches().map(|found| control_forces(scene_body, found)),
        stress: None,
        told: PoseFacts::default(),
    })
}

fn static_results(
    scene: &Resolved,
    name: &str,
    mut solved: statics::Solved,
    asked: &[&PoseRequest<'_>],
    missed: &mut Vec<MissedPose>,
) -> Result<(Geometry, Vec<PoseResult>), Failure> {
    let (body, model) = (&scene.body[name], scene.bodies[name].model);
    let held: Vec<&[u32]> = solved.statics.controls.iter().map(|control| &control.nodes[..]).collect();
    let stressed = solved_stress(scene, name, &solved.statics.mesh, &held)?;
    let surface = Surface::from_mesh(&solved.statics.mesh);
    let mut found = Vec::new();
    for ((asked, settled), control) in asked.iter().zip(solved.settled).zip(solved.control) {
        let (pose, name) = (asked.pose.to_owned(), name.to_owned());
        let places = solved.statics.controls.iter().map(|control| control.origin).collect();
        let told = PoseFacts { control, places, ..PoseFacts::default() };
        match settled {
            Ok(EquilibriumResult { displacement, wrenches, energy, .. }) => {
                let wrenches = Some(control_forces(body, (wrenches, energy)));
                let stretch = asked.loads.free_stretch(body);
                let forces = asked.loads.on_mesh(&solved.statics).map_err(Failure::wrong)?;
                let points: Vec<u32> = forces.at_nodes.iter().map(|(node, _)| *node).collect();
                let stress_of = |stressed: &SolvedStress, u: &[Vector3<f64>]| {
                    stressed.result(u, stretch, &asked.loads.coefficients, &points)
                };
                let stress = stressed.as_ref().map(|stressed| stress_of(stressed, &displacement));
                let mut told = told;
                let corners = |node: u32| {
                    let node = surface.nodes[node as usize] as usize;
                    [solved.statics.mesh.nodes[node], displacement[node]]
                };
                told.beyond = beyond_law(model, &surface.triangles, &corners, stretch);
                let forced = asked.loads.points_on_mesh(&solved.statics).map_err(Failure::wrong)?;
                told.pushed = PointPush::list(&forced, &solved.statics.mesh.nodes, &displacement);
                if let Some(stressed) = stressed.as_ref().filter(|_| free_poses::yields(stress.as_ref())) {
                    let parts = |u: &[Vector3<f64>]| free_poses::parts(&stress_of(stressed, u).reached);
                    statics::apply(asked, &mut solved.statics)?;
                    told.first_yield = free_poses::first_yield_of(asked, model, &mut solved.statics, &parts);
                }
                found.push(PoseResult { pose, body: name, displacement, wrenches, stress, told });
            }
            Err(why) => missed.push(MissedPose { pose, body: name, why }),
        }
    }
    Ok((Geometry::volume(name, &solved.statics.mesh), found))
}
