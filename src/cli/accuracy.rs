//! `greenstage accuracy`: measures what accuracy costs in time.

use super::parsers;
use super::print::print;
use crate::base::bars::Bars;
use crate::base::failure::Failure;
use crate::base::output::Scratch;
use crate::config::unknown_name;
use crate::deform::pose_file;
use crate::deform::{ControlPose, ControlPoses};
use crate::fem::TET4;
use crate::green::{self, GreenFile, Requirements};
use crate::prepare;
use crate::report::{self, Limits, Request, measure::poses::random};
use crate::scene::Scene;
use crate::session::{Playback, Session, open};
use crate::solve::Solver;
use crate::world::World;
use std::path::PathBuf;
use std::sync::Arc;

/// Measure what accuracy costs in time: every parameter's errors and costs as a page, plots, CSV and JSON
///
/// Computes the scene's body with every element, mesh refinement, solver tolerance, storage precision and deformation
/// model, measures what each costs offline and in the frame, and compares all with nonlinear statics and a finer mesh,
/// over the poses of the scene's script, of a pose file, or seeded random ones. DIR/index.html explains the figures.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML)
    pub scene: PathBuf,
    /// Folder for the report; overwrites the files of an older report, and nothing else
    #[arg(short, long)]
    pub output: PathBuf,
    /// The body to measure; default: the scene's first
    #[arg(long)]
    pub body: Option<String>,
    /// Pose file (TOML), as `deform` reads it; default: the scene's script, without one random poses
    #[arg(long)]
    pub poses: Option<PathBuf>,
    /// Seed of random poses, which are then taken even if the scene has a script
    #[arg(long)]
    pub seed: Option<u64>,
    /// Take fewer poses, no refinement and one timing each: under a minute for ten thousand nodes
    #[arg(long)]
    pub quick: bool,
    /// Unknowns of the largest solve (those of tet4_anp count threefold)
    #[arg(long, default_value_t = LARGEST, value_parser = parsers::positive)]
    pub largest: f64,
    /// A Markdown file whose lines between `<!-- accuracy: begin -->` and `<!-- accuracy: end -->` become a table
    #[arg(long)]
    pub readme: Option<PathBuf>,
    /// Show no progress bars
    #[arg(long)]
    pub quiet: bool,
}

const LARGEST: f64 = 300_000.0;
/// Angles of the random poses, degrees.
const ANGLES: [f64; 8] = [2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0];
const QUICK_ANGLES: [f64; 3] = [10.0, 30.0, 60.0];
/// How far random poses move on beside turning, as a part of the body's size.
const PLAY: f64 = 0.02;
/// Pictures of the script that are taken as poses.
const SCRIPT_POSES: usize = 12;
const QUICK_SCRIPT_POSES: usize = 4;
const SEED: u64 = 1;

pub fn run(args: &Args) -> Result<(), Failure> {
    let scene = Scene::load(&args.scene)?;
    try_outputs(args, &scene)?;
    let name = match &args.body {
        Some(name) if scene.body.contains_key(name) => name.clone(),
        Some(name) => {
            return Err(Failure::wrong(unknown_name("body", name, scene.body.keys().map(String::as_str))));
        }
        None => scene.body.keys().next().cloned().unwrap_or_default(),
    };
    let requirements = |scene: &Scene| -> Requirements {
        prepare::requirements(scene, &name, &scene.body[&name]).unwrap_or_default()
    };
    prepare::requirements(&scene, &name, &scene.body[&name])?;
    let (poses, pose_source) = all_poses(args, &scene, &name)?;
    let scratch = Scratch::in_folder(&args.output).map_err(Failure::work)?;
    let request = Request {
        scene: &scene,
        body: &name,
        poses: &poses,
        pose_source,
        limits: Limits {
            largest: args.largest,
            refinements: if args.quick { 0 } else { 2 },
            rounds: if args.quick { 60 } else { 300 },
        },
        largest_key: "--largest".into(),
        quick: args.quick,
        requirements_of: &requirements,
        command: command(args),
        scratch: scratch.path(),
    };
    let report = report::measure(&request, &Bars::new(&name, args.quiet)).map_err(Failure::work)?;
    let written = report::write(&args.output, &report)?;
    if let Some(readme) = &args.readme {
        super::marks::write_between(readme, "accuracy", &format!("{}\n", report::readme_table(&report)))?;
    }
    let listed: String = written.iter().map(|path| format!("{}\n", path.display())).collect();
    print(&format!("{}\n{listed}", report::summary(&report)))
}

/// Whether all that is written can be, before anything is measured.
fn try_outputs(args: &Args, scene: &Scene) -> Result<(), Failure> {
    let inputs = prepare::inputs_and(scene, [args.poses.as_deref()]);
    report::try_folder(&args.output, &inputs)?;
    args.readme.as_ref().map_or(Ok(()), |readme| super::marks::try_between(readme, "accuracy"))
}

/// The command that writes the same report.
fn command(args: &Args) -> String {
    let mut words =
        vec![format!("greenstage accuracy {} -o {}", args.scene.display(), args.output.display())];
    words.extend(args.body.iter().map(|body| format!("--body {body}")));
    words.extend(args.poses.iter().map(|poses| format!("--poses {}", poses.display())));
    words.extend(args.seed.map(|seed| format!("--seed {seed}")));
    words.extend(args.quick.then(|| "--quick".to_owned()));
    words.extend((args.largest != LARGEST).then(|| format!("--largest {}", args.largest)));
    words.join(" ")
}

/// The poses of an accuracy report, and one sentence on where they come from.
fn all_poses(
    args: &Args,
    scene: &Scene,
    name: &str,
) -> Result<(Vec<(String, ControlPoses)>, String), Failure> {
    if let Some(path) = &args.poses {
        let body = &scene.body[name];
        let file = pose_file::load(path)?;
        let own = file.iter().filter(|pose| pose.body.as_deref().is_none_or(|body| body == name));
        let own = own.map(|pose| Ok((pose.name.clone(), pose_file::control_poses(pose, name, body, path)?)));
        return Ok((own.collect::<Result<_, Failure>>()?, format!("the pose file {}", path.display())));
    }
    scripted_or_random(scene, name, args.seed, args.quick)
}

/// Moments of the scene's script; without one, or where a seed is given, random poses.
pub fn scripted_or_random(
    scene: &Scene,
    name: &str,
    seed: Option<u64>,
    quick: bool,
) -> Result<(Vec<(String, ControlPoses)>, String), Failure> {
    if let (None, Some(script)) = (seed, open::script(scene, None)?) {
        let count = if quick { QUICK_SCRIPT_POSES } else { SCRIPT_POSES };
        let folder = tempfile::tempdir().map_err(Failure::work)?;
        let path = folder.path().join("script.green");
        green::write(&path, &prepare::precompute(scene, true)?)?;
        let file = Arc::new(GreenFile::open(&path)?);
        let world = World::new(scene, &file, open::stage(scene, None)?)?;
        let duration_s = script.duration_s;
        let mut session = Session::new(world, Some(script));
        let mut playback = Playback::new(&session, count)?;
        let mut taken: Vec<(String, ControlPoses)> = Vec::new();
        for frame in 0..count {
            playback.step_to(&mut session, frame)?;
            let of_body = session.world.bodies.iter().find(|body| body.deformer.body == name);
            let Some(poses) = of_body.map(|body| body.deformer.poses.clone()) else { continue };
            let is_rest = poses.iter().all(|pose| *pose == ControlPose::REST);
            if !is_rest && taken.iter().all(|(_, other)| *other != poses) {
                let time_s = duration_s * frame as f64 / (count - 1) as f64;
                taken.push((format!("{time_s:.2} s"), poses));
            }
        }
        if !taken.is_empty() {
            return Ok((taken, format!("{count} moments of the scene's script, those at rest left out")));
        }
    }
    let seed = seed.unwrap_or(SEED);
    let mut plain = scene.clone();
    (plain.body[name].element, plain.body[name].solver) = (&TET4, Solver::default());
    let prepared = green::prepare(&plain, name)?;
    let origins: Vec<_> = prepared.controls.iter().map(|control| control.origin).collect();
    let (low, high) = crate::mesh::quality::bounding_box(&prepared.mesh.nodes);
    let degrees: &[f64] = if quick { &QUICK_ANGLES } else { &ANGLES };
    let angles: Vec<f64> = degrees.iter().map(|angle| angle.to_radians()).collect();
    let source = format!(
        "random, seed {seed}: all control elements but the first turn about axes of their own, carried along as by a rod \
         of constant curvature and twist, and move by up to {:.0} % of the body's size",
        100.0 * PLAY
    );
    Ok((random(&origins, &angles, PLAY * (high - low).amax(), seed), source))
}
