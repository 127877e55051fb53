//! `greenstage deform`: computes displacements and forces for a list of poses.

use super::parsers;
use super::print::print;
use crate::base::failure::Failure;
use crate::config::unknown_name;
use crate::deform::pose_file::{self, Pose};
use crate::export::batch::Outlook;
use crate::export::{Files, PoseRequest, ResultSet, ask, batch, pose_text};
use crate::prepare::{self, Resolved};
use crate::scene::{Scene, SceneError, Updates};
use crate::{green, tuning};
use std::path::PathBuf;

/// Compute displacements and forces for a list of poses
///
/// POSES holds tables `[[pose]]`: name, and per control element
/// control.NAME = { translation = [x, y, z], matrix = [[..], [..], [..]] }; elements that are not listed stay at rest. What
/// free = ["rotation", "x"] names is found, so that no force holds it, or that of force = [x, y, z] and moment. With
/// after = "POSE", a pose goes on from that one, so that turns add up. load.NAME = 3.0 sets a load of the scene (gravity,
/// centrifugal, thermal, or a pattern); [[pose.force]] with at = [x, y, z] or node = TAG and force = [x, y, z] acts on a point of
/// the surface, if the scene has surface_compliance.
///
/// Writes OUT.csv (pose,node,ux,uy,uz by the mesh's node tags), OUT.vtu (the body at rest, with one displacement field per pose),
/// OUT.forces.csv if the scene lists the effect haptics, and OUT.stress.csv if it lists stress, whose fields OUT.vtu then has too:
/// either all files, complete, or none. Overwrites the files of an earlier `deform`, and nothing else.
///
/// A body with a model of large strain (stvk, neo_hookean, corotational) is solved for every pose, over all nodes, with its forces;
/// beyond a critical pose it goes on buckled, and a note reports where. If a pose has no equilibrium, the angle and the mode at which it was lost are printed, the other poses are written, and the
/// status is 1.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Pose file (TOML)
    #[arg(long)]
    pub poses: PathBuf,
    /// Where to write: OUT or OUT.csv
    #[arg(short, long)]
    pub output: PathBuf,
    /// Use this .green file, never rewrite it; default: the scene's own, rebuilt if missing or stale
    #[arg(long)]
    pub green: Option<PathBuf>,
    /// All nodes, those inside too, solved again in f64 and not taken from the .green file (model linear only)
    #[arg(long, conflicts_with = "green")]
    pub all_nodes: bool,
    /// Write the deformed surface of every pose as well, into OUT.POSE.stl, .ply, .obj, .glb or .png (stl,ply writes two of them); m, in
    /// the mesh's coordinates
    #[arg(long, value_delimiter = ',', value_name = "FORMAT")]
    pub surface: Vec<String>,
    /// A control element that holds nothing, as hose.right (scenes with updates); again for more
    #[arg(long, value_name = "BODY.CONTROL", value_parser = parsers::of_body)]
    pub release: Vec<(String, String)>,
    /// Young's modulus of a region, as liver.tumour=2e4, in the same way
    #[arg(long, value_name = "BODY.REGION=PA", value_parser = parsers::modulus)]
    pub young: Vec<(String, String, f64)>,
    /// Draw every pose, into OUT.POSE.png: over its rest shape, with axes, a scale bar, the force and what holds it
    #[arg(long)]
    pub pictures: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = Resolved::new(updated(Scene::load(&args.scene)?, args)?)?;
    let poses = pose_file::load(&args.poses)?;
    // A pose may stand once for each body.
    let names: indexmap::IndexSet<String> = poses.iter().map(|pose| pose.name.clone()).collect();
    let mut surfaces = args.surface.clone();
    surfaces.extend(args.pictures.then(|| "png".to_owned()));
    let files = Files::new(&args.output, &surfaces, names.into_iter().collect())?;
    let inputs = prepare::inputs_and(&scene, [Some(args.poses.as_path()), args.green.as_deref()]);
    try_outputs(args, (&files, &inputs), &scene, poses.iter().any(Pose::finds))?;
    let scene = tuning::settle(scene, false, false)?;
    let asked: Vec<PoseRequest> =
        poses.iter().map(|pose| ask(&scene, pose, &args.poses)).collect::<Result<_, _>>()?;
    let (set, tables) = batch::solve(&scene, &asked, args.green.as_deref(), args.all_nodes)?;
    if set.missed.is_empty() || !set.results.is_empty() {
        let written = files.write(&set, &inputs)?;
        // Once all of them are there: what cannot be printed keeps none of them away.
        print(&written.iter().map(|path| format!("{}\n", path.display())).collect::<String>())?;
        print(&tables)?;
        print(&pose_text::of_set(&set))?;
    }
    if set.missed.is_empty() { Ok(()) } else { Err(missed(&set, asked.len())) }
}

/// The scene with what is asked to be released and changed of it.
fn updated(mut scene: Scene, args: &Args) -> Result<Scene, Failure> {
    let named = args.release.iter().map(|(body, what)| (body, what, None));
    let named = named.chain(args.young.iter().map(|(body, what, young)| (body, what, Some(*young))));
    for (name, what, young) in named {
        let option = if young.is_some() { "--young" } else { "--release" };
        let path = scene.path.display().to_string();
        let wrong = |message: String| Failure::wrong(format!("{path}: {option}: {message}"));
        if !scene.body.contains_key(name) {
            return Err(wrong(unknown_body(&scene, name, what)));
        }
        let body = &mut scene.body[name];
        let listed = |names: fn(&Updates) -> &Vec<String>| {
            body.updates.as_ref().is_some_and(|updates| names(updates).iter().any(|listed| listed == what))
        };
        match young {
            None if listed(|updates| &updates.release) => {
                body.release(what);
            }
            Some(young) if listed(|updates| &updates.modulus) => {
                body.region.get_mut(what).into_iter().for_each(|region| region.young = young);
            }
            None => return Err(wrong(body.cannot_release(name, what))),
            Some(_) => return Err(wrong(cannot_change(&mut scene, name, what))),
        }
    }
    Ok(scene.checked()?)
}

/// Error for an unknown body, whose name may have been written as a key of the scene, body.NAME.CONTROL.
fn unknown_body(scene: &Scene, name: &str, what: &str) -> String {
    let meant = what.split_once('.').filter(|(body, _)| name == "body" && scene.body.contains_key(*body));
    match meant {
        Some((body, part)) => {
            format!("the body is called \"{body}\": write {body}.{part}, without \"body.\" in front")
        }
        None => unknown_name("body", name, scene.body.keys().map(String::as_str)),
    }
}

/// The reason why a modulus cannot be changed: the mesh has no such region, or it was not prepared.
fn cannot_change(scene: &mut Scene, name: &str, region: &str) -> String {
    let told = scene.body[name].cannot_change(name, region);
    let findings = |scene: &Scene| -> Vec<String> {
        let finding = |error: &SceneError| {
            let found = error.finding();
            format!("{}: {}", found.place, found.message)
        };
        green::unjudged(scene, name).iter().map(finding).collect()
    };
    let before = findings(scene);
    let body = &mut scene.body[name];
    let material = body.material;
    body.region.entry(region.to_owned()).or_insert(material);
    findings(scene).into_iter().find(|found| !before.contains(found)).unwrap_or(told)
}

/// Whether everything can be written, before anything is solved.
fn try_outputs(
    args: &Args,
    (files, inputs): (&Files, &[PathBuf]),
    scene: &Resolved,
    has_found: bool,
) -> Result<(), Failure> {
    let outlook = batch::outlook(scene)?;
    let outlook = Outlook { has_found, ..outlook };
    files.try_all(inputs, &outlook)?;
    if outlook.needs_green && !args.all_nodes {
        prepare::try_green(scene, args.green.as_deref())
    } else {
        Ok(())
    }
}

/// Failure that lists the poses without an equilibrium, and why.
fn missed(set: &ResultSet, asked: usize) -> Failure {
    let reasons: Vec<&str> = set.missed.iter().map(|missed| missed.why.as_str()).collect();
    let rest = if set.results.is_empty() { "nothing is written" } else { "all else is written" };
    Failure::Work(anyhow::anyhow!(
        "{}\n{} of {asked} poses not found; {rest}",
        reasons.join("\n"),
        set.missed.len()
    ))
}
