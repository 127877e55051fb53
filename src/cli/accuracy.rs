//! `greenstage accuracy`: measures what accuracy costs in time.

use super::opening::Guess;
use super::parsers;
use super::print::print;
use crate::base::diagnostic::is_verbose;
use crate::base::extent::bounding_box;
use crate::base::failure::Failure;
use crate::base::output::Scratch;
use crate::base::progress::Bars;
use crate::base::table::count;
use crate::config::unknown_name;
use crate::deform::pose_file;
use crate::green::{self, Requirements};
use crate::measure::{self, Limits, Measurement, Request, TimeLimit};
use crate::prepare::{self, Resolved};
use crate::scene::{AccuracyTarget, Scene};
use crate::tuning::poses::{NamedPoses, scripted_or_random};
use crate::{report, tuning};
use std::path::PathBuf;
use std::time::Instant;

/// Measure what accuracy costs in time: every parameter's errors and costs as a page, plots, CSV and JSON
///
/// Computes the scene's body with every element, mesh refinement, solver tolerance, storage precision and deformation
/// model, measures what each costs offline and in the frame, and compares all with nonlinear statics on a finer mesh,
/// over the poses of the scene's script, of a pose file, or seeded random ones. Every model is also tried alone at bends and
/// twists from 1° to 360°. OUTPUT/index.html explains the figures. The command first estimates how long it will take; after
/// Ctrl-C, run it again and it continues where it stopped.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Scene file (TOML); or a mesh or surface file, for which a scene is proposed
    pub scene: PathBuf,
    #[command(flatten)]
    pub guess: Guess,
    /// Folder for the report; overwrites the files of an older report, and nothing else
    #[arg(short, long)]
    pub output: PathBuf,
    /// The body to measure; default: the scene's first
    #[arg(long)]
    pub body: Option<String>,
    /// Pose file (TOML), as `deform` reads it; default: the scene's script, or random poses if it has none
    #[arg(long)]
    pub poses: Option<PathBuf>,
    /// Seed of random poses, which are then taken even if the scene has a script
    #[arg(long)]
    pub seed: Option<u64>,
    /// A report in about a minute: the hardest pose and the scene's own setting, and of fewer poses and angles, without
    /// refinement, what else fits; the rest is listed
    #[arg(long)]
    pub quick: bool,
    /// Unknowns of the largest solve (those of tet4_anp count threefold)
    #[arg(long, default_value_t = Limits::LARGEST, value_parser = parsers::positive)]
    pub largest: f64,
    /// A Markdown file whose lines between `<!-- accuracy: begin -->` and `<!-- accuracy: end -->` become a table
    #[arg(long)]
    pub readme: Option<PathBuf>,
    /// Also answer a question, as a scene asks it: "displacement = 0.05, force = 10%" for the fastest setting that is as
    /// accurate, "frame_ms = 0.05, file_mb = 5, offline_s = 60" for the most accurate one within these costs; may be repeated
    #[arg(long, value_name = "QUESTION")]
    pub ask: Vec<AccuracyTarget>,
    /// Show no progress bars
    #[arg(long)]
    pub quiet: bool,
}

/// Time of a report with --quick, s: a minute but for the page.
const QUICK_S: f64 = 55.0;

pub fn run(args: &Args) -> Result<(), Failure> {
    let from = Instant::now();
    let scene = Resolved::load(&args.scene)?;
    try_outputs(args, &scene)?;
    let name = match &args.body {
        Some(name) if scene.body.contains_key(name) => name.clone(),
        Some(name) => {
            return Err(Failure::wrong(unknown_name("body", name, scene.body.keys().map(String::as_str))));
        }
        None => scene.body.keys().next().cloned().unwrap_or_default(),
    };
    let requirements = |scene: &Resolved| -> Requirements {
        let unloaded = scene.body[&name].unloaded();
        scene.bodies[&name].requirements(scene, &name, &unloaded).unwrap_or_default()
    };
    scene.measured_requirements(&name)?;
    let (poses, pose_source) = all_poses(args, &scene, &name)?;
    let scratch = Scratch::in_folder(&args.output).map_err(Failure::work)?;
    let keep = args.output.join(measure::FOLDER);
    let request = Request {
        scene: &scene,
        body: &name,
        poses: &poses,
        pose_source,
        limits: Limits {
            largest: args.largest,
            largest_of_models: Limits::MODELS_SHARE * args.largest,
            refinements: if args.quick { 0 } else { 2 },
            rounds: if args.quick { 60 } else { 300 },
        },
        largest_key: "--largest".into(),
        quick: args.quick,
        packs: true,
        requirements_of: &requirements,
        command: command(args),
        scratch: scratch.path(),
        keep: Some(&keep),
        limit: args.quick.then_some(TimeLimit { from, seconds: QUICK_S }),
    };
    let report = report::measure(&request, &Bars::new(&name, args.quiet)).map_err(Failure::work)?;
    let written = report::write(&args.output, &report)?;
    measure::remove(&keep);
    if let Some(readme) = &args.readme {
        super::marks::write_between(readme, "accuracy", &format!("{}\n", report::readme_table(&report)))?;
    }
    let shown = if is_verbose() { written.len() } else { 1 };
    let mut listed: String = written.iter().take(shown).map(|path| format!("{}\n", path.display())).collect();
    if written.len() > shown {
        listed += &format!("and {} beside it (--verbose lists them)\n", count(written.len() - shown, "file"));
    }
    print(&format!("{}\n{}{listed}", report::summary(&report), answers(&args.ask, &report.rows)))
}

/// Answers to the questions by the measured settings.
fn answers(asked: &[AccuracyTarget], rows: &[Measurement]) -> String {
    let answer = |demand: &AccuracyTarget| {
        let lines: String = tuning::answer(rows, demand).iter().map(|line| format!("  {line}\n")).collect();
        format!("Asked for {}:\n{lines}\n", demand.asked())
    };
    asked.iter().map(answer).collect()
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
    words.extend((args.largest != Limits::LARGEST).then(|| format!("--largest {}", args.largest)));
    words.join(" ")
}

/// Part of a body's radius below which a pose of a file moves it by rounding alone.
const ROUNDING: f64 = 1e-6;

/// The poses of an accuracy report, and one sentence on where they come from.
fn all_poses(args: &Args, scene: &Resolved, name: &str) -> Result<NamedPoses, Failure> {
    if let Some(path) = &args.poses {
        let body = &scene.body[name];
        let file = pose_file::load(path)?;
        let (low, high) = bounding_box(&green::prepare(scene, name)?.mesh.nodes);
        let radius = 0.5 * (high - low).norm();
        let own = file.iter().filter(|pose| pose.body.as_deref().is_none_or(|body| body == name));
        let mut poses = Vec::new();
        for pose in own {
            let moved = pose_file::control_poses(pose, name, body, path)?;
            let is_rest = moved.iter().all(|pose| pose.is_rest_within(ROUNDING, radius));
            if let Some(what) = pose.beyond_motion().or(is_rest.then_some("moves nothing")) {
                return Err(Failure::wrong(format!(
                    "{}: pose \"{}\" {what}; the report measures errors of control elements that are moved from rest and held",
                    path.display(),
                    pose.name
                )));
            }
            poses.push((pose.name.clone(), moved));
        }
        return Ok((poses, format!("the pose file {}", path.display())));
    }
    scripted_or_random(scene, name, args.seed, args.quick)
}
