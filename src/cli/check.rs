//! `greenstage check`: lists all that can be found wrong with a scene, without solving it.

use super::opening::Guess;
use super::print::print;
use super::{check_stage, expected, inspect};
use crate::base::diagnostic::{Diagnostic, Severity, is_verbose, listing};
use crate::base::failure::Failure;
use crate::base::table::{Table, bytes};
use crate::config;
use crate::deform::{Bearing, ExpectedErrors, MODELS, ModelEntry, ModelReach, ROD, Statics};
use crate::effect::{EFFECTS, EffectEntry, ResolvedBody, name_of};
use crate::fem::TET4_ANP;
use crate::green::{self, Forecast, GreenError, GreenFile, Prepared, Requirements, SUBSTRUCTURES};
use crate::mesh::Surface;
use crate::mesh::diagnostics::digits;
use crate::mesh::surface_files::TriangleSurface;
use crate::prepare;
use crate::scene::proposal::choice::of_two_ends;
use crate::scene::survey::State;
use crate::scene::{Body, KeptForm, Limit, Material, Method, Scene, SceneError, Tool};
use crate::session::open;
use crate::solve::Solver;
use crate::stage::Stage;
use crate::world::place;
use crate::world::place::overlaps;
use indexmap::IndexMap;
use nalgebra::{Point3, Similarity3, Vector3};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// List everything wrong with a scene, without solving it, or with a stage
///
/// Prints one line for each finding, all that can be told in one run, the most severe first: errors (it is refused), warnings (it is solved or shown, but may
/// not be what you meant), notes (what was repaired, what is worth knowing). The exit status is 2 if there is an error. `precompute`
/// runs a scene's checks first. For a scene it then lists what the effects add, and the errors of force and shape to expect if the
/// .green file beside the scene has them, else how to have them measured. For a stage it checks how the screens meet, their shapes
/// and sides, the eyes, and the windows on the monitors of the running display (without one, of the file's `monitor` tables).
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene or stage file (TOML), or the name of a built-in stage; or a mesh or surface file, for which a scene is proposed
    pub scene: PathBuf,
    #[command(flatten)]
    pub guess: Guess,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if inspect::is_stage(&args.scene)? {
        return check_stage::run(&args.scene, args.json);
    }
    let survey = Scene::survey(&args.scene)?;
    let mut findings: Vec<Diagnostic> = survey.faults.iter().map(SceneError::finding).collect();
    let (mut effects, mut known, mut models) = (Vec::new(), Vec::new(), Vec::new());
    let scene = survey.scene.as_ref().map(completed);
    if let Some(scene) = &scene {
        findings.extend(unused_tools(scene));
        findings.extend(unused_legend(scene));
        let mut meshes = Vec::new();
        for ((name, body), state) in scene.body.iter().zip(&survey.states) {
            let resolved = ResolvedBody::new(scene, name, EFFECTS);
            if let (Err(unknown), false) = (&resolved, *state == State::Faulty) {
                findings.extend(unknown.iter().map(SceneError::finding));
            }
            let resolved = resolved.ok();
            match state {
                State::Sound => {
                    findings.extend(of_body(scene, name, resolved.as_ref(), &mut meshes, &mut models)?);
                    effects.extend(effects_of(name, body, resolved.as_ref()));
                    let errors = resolved.as_ref().map(|resolved| expected::known(scene, name, resolved));
                    known.push((name, errors.unwrap_or_else(|| Err(expected::NOT_SHOWN.into()))));
                }
                // Of what is faulty already no more is told.
                State::HasMesh => {
                    let all = green::unjudged(scene, name);
                    let is_told = |place: &str, known: &str| !known.is_empty() && place.starts_with(known);
                    let known = |place: &str| findings.iter().any(|known| is_told(place, &known.place));
                    let new: Vec<Diagnostic> =
                        all.iter().map(SceneError::finding).filter(|found| !known(&found.place)).collect();
                    findings.extend(new);
                }
                State::Faulty => {}
            }
        }
        findings.extend(unreadable(scene));
        if let Ok(stage) = open::stage(scene, None) {
            findings.extend(places(&meshes, &stage));
        }
        let problems = [open::stage(scene, None).err(), open::script(scene, None).err()];
        findings.extend(problems.iter().flatten().map(|problem| of_failure(problem, "")));
    }
    findings.sort_by_key(|finding| finding.severity);
    if args.json {
        let errors: BTreeMap<&str, Option<&ExpectedErrors>> =
            known.iter().map(|(name, errors)| (name.as_str(), errors.as_ref().ok())).collect();
        let value = serde_json::json!({
            "scene": args.scene.to_string_lossy(), "findings": findings, "effects": effects, "expected_errors": errors,
        });
        print(&format!("{value:#}\n"))?;
    } else {
        let models: String = models.concat();
        let path = scene.as_ref().map_or(&args.scene, |scene| &scene.path);
        let listed: Vec<Diagnostic> = findings.iter().map(|finding| placed(finding, path)).collect();
        print(&format!("{}{models}{}{}", listing(&listed), effects_text(&effects), errors_text(&known)))?;
    }
    check_stage::verdict(&findings, &args.scene)
}

/// A finding with the line of its key in the scene's file.
fn placed(finding: &Diagnostic, scene: &Path) -> Diagnostic {
    let line = config::line_in(scene, &finding.place);
    let place = line.map(|line| format!("{}:{line}: {}", scene.display(), finding.place));
    Diagnostic { place: place.unwrap_or_else(|| finding.place.clone()), ..finding.clone() }
}

/// The scene with what the effects of its bodies add to them.
fn completed(scene: &Scene) -> Scene {
    let mut completed = scene.clone();
    for (name, body) in &mut completed.body {
        if let Ok(resolved) = ResolvedBody::new(scene, name, EFFECTS) {
            resolved.complete(body);
        }
    }
    completed
}

/// Tools that touch or cut nothing, because no body lists an effect by which they would.
fn unused_tools(scene: &Scene) -> Vec<Diagnostic> {
    let is_listed =
        |effect: &str| scene.body.values().any(|body| body.effects.iter().any(|listed| listed == effect));
    let of = |(name, tool): (&String, &Tool)| {
        let (effect, does) = match tool.shape.is_blade() {
            true => (name_of(|effect| effect.is_cut), "cuts"),
            false => (name_of(|effect| effect.presses_points), "touches"),
        };
        let message = format!("it {does} nothing and is not shown: no body has effects = [\"{effect}\"]");
        (!is_listed(effect)).then(|| Diagnostic::new(Severity::Warning, format!("tool.{name}"), message))
    };
    scene.tool.iter().filter_map(of).collect()
}

/// The legend of a scene in which no body has the colours that it explains.
fn unused_legend(scene: &Scene) -> Option<Diagnostic> {
    let has_colours = |name: &String| {
        let resolved = ResolvedBody::new(scene, name, EFFECTS);
        resolved.is_ok_and(|body| body.entries().any(|effect| effect.shows_stress))
    };
    let is_used = scene.legend.is_none() || scene.body.keys().any(has_colours);
    let effect = name_of(|effect| effect.shows_stress);
    let message = format!("is not used: no body has effects = [\"{effect}\"]");
    (!is_used).then(|| Diagnostic::new(Severity::Note, "legend", message))
}

/// Keys of a body that its model and its solver do not read.
fn unused_keys(name: &str, body: &Body, model: &ModelEntry) -> Vec<Diagnostic> {
    let mut found = Vec::new();
    let mut note = |key: &str, message: String| {
        found.push(Diagnostic::new(Severity::Note, format!("body.{name}.{key}"), message));
    };
    if body.parts.is_some() && !model.with_energy().has(SUBSTRUCTURES) {
        note("parts", format!("is not used: the model \"{model}\" does not cut the body into parts"));
    }
    let (Solver { method, tolerance, max_iterations }, usual) = (body.solver, Solver::default());
    if method.is_direct && (tolerance != usual.tolerance || max_iterations != usual.max_iterations) {
        let message =
            format!("tolerance and max_iterations are not used: \"{}\" does not iterate", method.name);
        note("solver", message);
    }
    found
}

/// A body with its surface, in the mesh's frame.
struct StandingBody<'a> {
    name: &'a String,
    body: &'a Body,
    points: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

/// Findings about a body whose keys are sound.
fn of_body<'a>(
    scene: &'a Scene,
    name: &'a String,
    resolved: Option<&ResolvedBody>,
    meshes: &mut Vec<StandingBody<'a>>,
    models: &mut Vec<String>,
) -> Result<Vec<Diagnostic>, Failure> {
    let (entity, body) = (format!("body.{name}"), &scene.body[name]);
    let mut findings = Vec::new();
    let required = resolved.map(|resolved| resolved.requirements(scene, name, body));
    if let (Some(Err(failure)), Some(resolved)) = (&required, resolved) {
        let mut found = of_failure(failure, &entity);
        if is_solved_anew(scene, name, resolved) {
            found.severity = Severity::Warning;
            found.message += "; until then `greenstage deform` alone solves the body";
        }
        findings.push(found);
    }
    findings.extend(scene.load_texture(name, body).err().map(|wrong| wrong.finding()));
    findings.extend(unwatched_limit(name, body, resolved));
    findings.extend(holds(scene, name, body));
    findings.extend(in_degrees(name, body));
    let prepared = match green::prepare(scene, name) {
        Ok(prepared) => prepared,
        Err(GreenError::Scene(first)) => {
            let all = green::unjudged(scene, name);
            let all = if all.is_empty() { vec![first] } else { all };
            findings.extend(all.iter().map(SceneError::finding));
            return Ok(findings);
        }
        Err(other) => return Err(other.into()),
    };
    if let Some(resolved) = resolved {
        findings.extend(unused_keys(name, body, resolved.model));
        let required = required.as_ref().and_then(|required| required.as_ref().ok());
        let measured = required.and_then(|required| measured_reach(scene, name, required, resolved.model));
        models.extend(measured.or_else(|| reach(scene, name, resolved, &prepared)));
    }
    match green::acting(scene, name, &prepared.mesh, &prepared.controls) {
        Ok(found) => findings.extend(found),
        Err(GreenError::Scene(wrong)) => findings.push(wrong.finding()),
        Err(wrong) => findings.push(Diagnostic::new(Severity::Error, &entity, wrong.to_string())),
    }
    if let Some(Ok(required)) = &required
        && let Err(refused) = green::suits(scene, name, &prepared, required)
    {
        findings.push(Diagnostic::new(Severity::Error, format!("{entity}.model"), refused.to_string()));
    }
    findings.extend(forecast(name, body, resolved.map(|resolved| resolved.model), &prepared));
    // A mesh that is refused tells nothing of the shape that is meant.
    let is_refused = prepared.findings.iter().any(|finding| finding.severity == Severity::Error);
    let fits = resolved.and_then(|resolved| resolved.model.fits);
    if let Some(fits) = fits.filter(|_| !is_refused)
        && let Err((severity, why)) = fits(&prepared)
    {
        findings.push(Diagnostic::new(severity, format!("{entity}.model"), why));
    }
    findings.extend(prepared.findings);
    let Surface { triangles, nodes } = Surface::from_mesh(&prepared.mesh);
    let points = nodes.iter().map(|&node| Point3::from(prepared.mesh.nodes[node as usize])).collect();
    meshes.push(StandingBody { name, body, points, triangles });
    Ok(findings)
}

/// A failure as a finding; `place` is that of one that names none.
fn of_failure(failure: &Failure, place: &str) -> Diagnostic {
    let (Failure::Request(error) | Failure::Work(error)) = failure;
    let found = error.downcast_ref().map(SceneError::finding);
    found.unwrap_or_else(|| Diagnostic::new(Severity::Error, place, failure.to_string()))
}

/// Whether `deform` solves the body although no session shows it: with the loads of a model of large strain.
fn is_solved_anew(scene: &Scene, name: &str, resolved: &ResolvedBody) -> bool {
    let body = &scene.body[name];
    let law = resolved.law(scene, name, body).ok().flatten();
    law.is_some_and(|law| Statics::suits(scene, name, law).is_ok())
}

/// The forecast of the time and memory that precomputing the body takes.
fn forecast(name: &str, body: &Body, model: Option<&ModelEntry>, prepared: &Prepared) -> Vec<Diagnostic> {
    let entity = format!("body.{name}");
    let mut forecast = Forecast::new(&prepared.mesh, prepared.controls.len());
    let (nodes, elements) = (prepared.mesh.nodes.len(), prepared.controls.len());
    if model.is_some_and(ModelEntry::is_reduced) && green::has_equilibria(&body.solver, elements, 3 * nodes) {
        let points = body.element.points(&prepared.mesh, &prepared.lame).map_or(0, |points| points.count());
        forecast = forecast.with_equilibria(nodes, points);
    }
    let mut findings = Vec::new();
    if let Some(asked) = &body.surface_compliance {
        let held = prepared.controls.iter().flat_map(|control| control.nodes.iter().copied());
        let place = format!("{entity}.surface_compliance");
        let size = green::compliance_size(&prepared.mesh, held, asked).ok();
        let told = |size: [usize; 3]| match asked.kept {
            KeptForm::Factor => forecast.kept_factor_told(size),
            KeptForm::Compressed(error) => forecast.compressed_told(size, error),
            KeptForm::Inverse => forecast.compliance_told(size),
        };
        if let Some(size) = size {
            findings.push(Diagnostic::new(Severity::Note, &place, told(size)));
            let fits = if asked.kept == KeptForm::Inverse { green::compliance_fits(size[2]) } else { Ok(()) };
            findings.extend(fits.err().map(|told| Diagnostic::new(Severity::Warning, &place, told)));
        }
    }
    if body.method == Method::Fem
        && let Err(told) = forecast.fits(&body.solver)
    {
        findings.push(Diagnostic::new(Severity::Warning, &entity, told));
    }
    findings.extend(match body.method {
        Method::Fem => forecast.told().map(|told| Diagnostic::new(Severity::Note, &entity, told)),
        Method::Bem => Some(match green::boundary_told(&prepared.mesh, &prepared.controls) {
            Ok(told) => Diagnostic::new(Severity::Note, &entity, told),
            Err(refused) => Diagnostic::new(Severity::Error, &entity, refused),
        }),
    });
    findings
}

/// Bodies that the viewer of the stage does not see, and bodies that are inside each other.
fn places(meshes: &[StandingBody<'_>], stage: &Stage) -> Vec<Diagnostic> {
    let standing: Vec<_> = meshes.iter().map(|of| (of.body, &of.points[..])).collect();
    let rooms = place::rooms_from_meshes(&standing, stage);
    let unseen = |(of, at): (&StandingBody<'_>, &Similarity3<f64>)| {
        let message = format!("on stage {}, {}", stage.name, place::fault(&of.points, at, stage)?);
        Some(Diagnostic::new(Severity::Warning, format!("body.{}.place", of.name), message))
    };
    let mut findings: Vec<Diagnostic> = meshes.iter().zip(&rooms).filter_map(unseen).collect();
    let in_room = |(of, at): (&StandingBody<'_>, &Similarity3<f64>)| TriangleSurface {
        vertices: of.points.iter().map(|x| (at * x).coords).collect(),
        triangles: of.triangles.clone(),
    };
    let surfaces: Vec<TriangleSurface> = meshes.iter().zip(&rooms).map(in_room).collect();
    findings.extend(overlaps(&surfaces).into_iter().map(|([one, other], depth)| {
        let message = format!(
            "on stage {}, it reaches {} m into body {}. Give one of them another place",
            stage.name,
            digits(depth),
            meshes[other].name
        );
        Diagnostic::new(Severity::Warning, format!("body.{}.place", meshes[one].name), message)
    }));
    findings
}

/// A warning of a turn by more than once around, which looks like degrees.
fn in_degrees(name: &str, body: &Body) -> Option<Diagnostic> {
    let angle = Vector3::from(body.place?.rotation?).norm();
    let message = format!(
        "a turn by {angle:.4} rad is more than once around. If degrees are meant, write {:.4} rad",
        angle.to_radians()
    );
    (angle > 1.001 * std::f64::consts::TAU)
        .then(|| Diagnostic::new(Severity::Warning, format!("body.{name}.place.rotation"), message))
}

/// The consequence of a body in which nothing is fixed, or nothing can be grabbed.
fn holds(scene: &Scene, name: &str, body: &Body) -> Option<Diagnostic> {
    let message = body.held_by(!scene.tool.is_empty())?;
    Some(Diagnostic::new(Severity::Note, format!("body.{name}.control"), message))
}

/// A finding about a limit that no effect watches.
fn unwatched_limit(name: &str, body: &Body, resolved: Option<&ResolvedBody>) -> Option<Diagnostic> {
    let is_own = |material: &Material| {
        material.known.and_then(|known| known.yield_stress).map(Limit::Stress) != material.limit
    };
    let limited: Vec<&Material> = body.materials().filter(|material| material.limit.is_some()).collect();
    let is_watched = resolved.is_some_and(|resolved| resolved.entries().any(|effect| effect.shows_stress));
    // Whoever wrote a limit wants to hear of it; the library's stands there unasked.
    let severity =
        if limited.iter().any(|material| is_own(material)) { Severity::Warning } else { Severity::Note };
    let message = format!(
        "nothing watches the limit of its material. effects = [\"{}\"] shows where it is passed",
        name_of(|effect| effect.shows_stress)
    );
    let entity = format!("body.{name}");
    (!limited.is_empty() && !is_watched).then(|| Diagnostic::new(severity, &entity, message))
}

/// A table of the effects that are listed, or of all.
fn effects_text(effects: &[Cost]) -> String {
    let mut table = Table::new(&["body", "effect", "", "file and memory"]);
    for cost in effects.iter().filter(|cost| cost.listed || is_verbose()) {
        let listed = if cost.listed { "listed" } else { "not listed" };
        let own = if cost.has_section { ", and its section" } else { "" };
        table.row(&[&cost.body, cost.effect, listed, &format!("{}{own}", bytes(cost.bytes as f64))]);
    }
    if table.rows.len() > 1 { format!("\n{}", table.text()) } else { String::new() }
}

/// A warning of a .green file beside the scene that is there and cannot be used.
fn unreadable(scene: &Scene) -> Option<Diagnostic> {
    let error = GreenFile::open(&prepare::green_path(scene)).err()?;
    let is_absent = matches!(&error, GreenError::Io { source, .. } if source.kind() == ErrorKind::NotFound);
    (!is_absent).then(|| Diagnostic::new(Severity::Warning, "", error.to_string()))
}

/// The reach of a body's model as its .green file has it measured, while that file is fresh.
fn measured_reach(
    scene: &Scene,
    name: &str,
    required: &Requirements,
    model: &'static ModelEntry,
) -> Option<String> {
    let file = Arc::new(GreenFile::open(&prepare::green_path(scene)).ok()?);
    file.check_belongs(scene, name, required).ok()?;
    let reach = ModelReach::measure(&file, name, model).ok()??;
    Some(model_line(name, model, &reach.text()))
}

/// The reach of the model of a body that is bent at two ends, and the model that holds further where the body takes one.
fn reach(scene: &Scene, name: &str, resolved: &ResolvedBody, prepared: &Prepared) -> Option<String> {
    let (body, model) = (&scene.body[name], resolved.model);
    // What holds further has no such element, and its nodes on the edges are seven to a corner.
    let (factor, with) = if *body.element == TET4_ANP { (7, " with element = \"tet10\"") } else { (1, "") };
    let is_of_two = prepared.controls.len() == 2;
    let best = of_two_ends(&prepared.mesh, factor * prepared.mesh.nodes.len()).filter(|_| is_of_two);
    let (best, reach) = best?;
    if best == ROD.name && ROD.fits.is_some_and(|fits| fits(prepared).is_err()) {
        return None;
    }
    let is_taken = |model: &'static ModelEntry| {
        let other = ResolvedBody { model, ..resolved.clone() };
        model.name == best && other.requirements(scene, name, body).is_ok()
    };
    let text = match model.loads {
        _ if model.name == best => reach,
        Bearing::Columns => {
            let [good, fair] = model.turn_limits_deg;
            let is_taken = MODELS.iter().any(is_taken);
            let further = if is_taken { format!("; {best}{with}: {reach}") } else { String::new() };
            format!(
                "its shape is good where a piece of its surface turns by {good:.0}°, fair to {fair:.0}°{further}"
            )
        }
        Bearing::Forces(_) => return None,
    };
    Some(model_line(name, model, &text))
}

/// A line about the model of a body.
pub fn model_line(name: &str, model: &ModelEntry, text: &str) -> String {
    format!("{name}: model {model}: {text}\n")
}

/// The table of the errors that are known, and how the others can be.
fn errors_text(known: &[(&String, Result<ExpectedErrors, String>)]) -> String {
    let mut text = String::new();
    let measured: Vec<_> =
        known.iter().filter_map(|(name, errors)| Some((name.as_str(), errors.as_ref().ok()?))).collect();
    if measured.iter().any(|(_, errors)| !errors.moved.is_empty()) {
        let table = expected::table(measured.iter().copied());
        let parts = if is_verbose() { format!("{}\n", expected::PARTS) } else { String::new() };
        text.push_str(&format!("\nErrors to expect, as measured on the body:\n{parts}{}", table.text()));
    }
    let mut alike: IndexMap<String, Vec<&str>> = IndexMap::new();
    for (name, errors) in known {
        match errors {
            Ok(errors) => errors
                .left_out
                .iter()
                .for_each(|why| text.push_str(&format!("\n{name}: errors not measured: {why}\n"))),
            Err(to_do) => {
                alike.entry(format!("errors of force and shape unknown: {to_do}")).or_default().push(name)
            }
        }
    }
    for (unknown, names) in alike {
        text.push_str(&format!("\n{}: {unknown}\n", names.join(", ")));
    }
    text
}

/// The bytes that one effect adds to one body's file and memory, but for a section of its own, whose size is known when it is
/// written; `greenstage accuracy` measures its times too.
#[derive(serde::Serialize)]
struct Cost {
    body: String,
    effect: &'static str,
    listed: bool,
    bytes: usize,
    has_section: bool,
}

/// Every effect of a body: one that is not listed adds nothing.
fn effects_of(name: &str, body: &Body, resolved: Option<&ResolvedBody>) -> Vec<Cost> {
    let cost = |effect: &EffectEntry| {
        let lists = resolved.filter(|resolved| resolved.lists(effect));
        let bytes = lists.map_or(0, |resolved| effect.bytes(resolved.model, body.control.len()));
        let (listed, has_section) = (lists.is_some(), lists.is_some() && effect.precompute.is_some());
        Cost { body: name.to_owned(), effect: effect.name, listed, bytes, has_section }
    };
    EFFECTS.iter().map(cost).collect()
}
