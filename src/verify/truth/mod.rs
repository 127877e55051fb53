//! Counts on random bodies how often the errors hold that the program prints of its own answers, against a true equilibrium.
//!
//! In: seeds, and the planner's answer to a demand. Out: for each body ([`RandomBody`]) the [`Statement`]s that a user reads of it, each
//! with the true error: of the report's rows, of the planner's answer, and the ± beside forces. The truth is the equilibrium with
//! tet10 on the mesh refined once ([`RefinedBody`]).

mod bodies;
mod kept;
mod statement;
mod summary;

pub use bodies::{BodyKind, CONTROLS, RandomBody, RandomMaterial, RandomPose};
pub use kept::KeptBodies;
pub use statement::{JudgedBody, Quantity, Source, Statement};
pub use summary::{held, offenders, summary};

use crate::base::failure::Failure;
use crate::base::statistics::larger;
use crate::effect::{Resolved, expected};
use crate::green::{self, Requirements, STIFFNESS};
use crate::measure::{
    EquilibriumOfPose, Limits, Measurement, RefinedBody, Request, SettingInSession, settings_against,
};
use crate::scene::AccuracyTarget;
use crate::solve::Silent;
use crate::world::wrench_error_of;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The planner's answer: the scene with the chosen setting, or the nearest one, and its row with the errors that are printed of it.
pub type Answer = Option<(Resolved, Measurement)>;
/// Answers a demand from measured rows of a scene's body.
pub type Planner<'a> =
    &'a (dyn Fn(&Resolved, &str, Vec<Measurement>, &AccuracyTarget) -> Result<Answer, Failure> + Sync);

const BODY: &str = "b";
/// Demands of the planner, taken in turn by the seed.
const DEMANDS: [&str; 3] =
    ["displacement = 0.1, force = 0.3", "displacement = 0.03, force = 0.1", "displacement = 0.01"];

/// Judges the body of one seed; without a planner the ± alone.
pub fn judge(seed: u64, planner: Option<Planner<'_>>) -> Result<JudgedBody, Failure> {
    judge_body(&RandomBody::new(seed).map_err(|why| Failure::work(anyhow::anyhow!(why)))?, planner)
}

fn judge_body(body: &RandomBody, planner: Option<Planner<'_>>) -> Result<JudgedBody, Failure> {
    let started = Instant::now();
    let folder = tempfile::tempdir().map_err(Failure::work)?;
    let file = body.mesh_file().map_err(Failure::work)?;
    std::fs::write(folder.path().join("body.msh"), file).map_err(Failure::work)?;
    let scene = Resolved::parse(&body.scene(), &folder.path().join("body.toml"))?;
    let mut refined = RefinedBody::new(&scene, BODY).map_err(Failure::work)?;
    let mut left_out = Vec::new();
    let mut truths = Vec::new();
    for pose in &body.poses {
        let found = refined.equilibrium(&pose.poses).map_err(Failure::work)?;
        truths.push(found.map_err(|why| left_out.push(format!("{}: {why}", pose.name))).ok());
    }
    let mut judged = JudgedBody {
        seed: body.seed,
        kind: body.kind,
        model: body.model.to_owned(),
        nodes: body.mesh.nodes.len(),
        seconds: 0.0,
        statements: Vec::new(),
        left_out,
    };
    if truths.iter().any(Option::is_some) {
        let of = Judge { scene: &scene, body, refined: &refined, truths: &truths };
        of.expected(&mut judged)?;
        if let Some(planner) = planner {
            of.report_and_planner(folder.path(), planner, &mut judged)?;
        }
    }
    judged.seconds = started.elapsed().as_secs_f64();
    Ok(judged)
}

/// A body with its true equilibria, one for each pose.
struct Judge<'a> {
    scene: &'a Resolved,
    body: &'a RandomBody,
    refined: &'a RefinedBody,
    truths: &'a [Option<EquilibriumOfPose>],
}

impl Judge<'_> {
    /// The ± beside force and torque, of the scene's own model.
    fn expected(&self, judged: &mut JudgedBody) -> Result<(), Failure> {
        let model = self.scene.bodies[BODY].model;
        let required = model.with_energy().and(Requirements::new(&[STIFFNESS]));
        let mut made = match green::precompute(self.scene, BODY, &required, &Silent) {
            Ok(made) => made,
            Err(why) => {
                judged.left_out.push(format!("model {}: {why}", model.name));
                return Ok(());
            }
        };
        let errors = expected::measure(self.scene, &mut made, &Silent);
        let mut setting = SettingInSession::of_precomputed(self.scene, BODY, &made)?;
        for (pose, truth) in self.body.poses.iter().zip(self.truths) {
            let Some(truth) = truth else { continue };
            setting.take(&pose.poses);
            let Some((held, (wrenches, _))) = setting.held(&pose.poses).zip(setting.deformer.wrenches())
            else {
                judged.left_out.push(format!("{}: model {} has no forces", pose.name, model.name));
                continue;
            };
            let shown =
                wrench_error_of(&errors, &setting.deformer, &wrenches, &[]).filter(|shown| shown.is_whole);
            let off = held.iter().zip(&truth.wrenches);
            let most = off.map(|(a, b)| [(a.force - b.force).norm(), (a.moment - b.moment).norm()]);
            let [force, torque] = most.fold([0.0; 2], |a, b| [0, 1].map(|i| larger(a[i], b[i])));
            let part = |part: Option<f64>| part.map_or("unknown".into(), |part| format!("{part:.3}"));
            let parts =
                |[model, mesh]: [Option<f64>; 2]| format!(" (model {}, mesh {})", part(model), part(mesh));
            let parts = shown.map_or(String::new(), |shown| parts(shown.parts));
            let of = format!("{} {}{parts}", model.name, pose.name);
            for (quantity, shown, truth) in [
                (Quantity::Force, shown.map(|shown| shown.force), force),
                (Quantity::Torque, shown.map(|shown| shown.moment), torque),
            ] {
                let (of, turn) = (of.clone(), pose.turn);
                judged.statements.push(Statement {
                    source: Source::Expected,
                    quantity,
                    of,
                    turn,
                    shown,
                    doubt: 0.0,
                    truth,
                });
            }
        }
        let why = errors.left_out.iter().map(|why| format!("± {why}"));
        judged.left_out.extend(why);
        Ok(())
    }

    /// The rows of a report in these poses, and what the planner answers from them.
    fn report_and_planner(
        &self,
        scratch: &Path,
        planner: Planner<'_>,
        judged: &mut JudgedBody,
    ) -> Result<(), Failure> {
        let poses: Vec<_> =
            self.body.poses.iter().map(|pose| (pose.name.clone(), pose.poses.clone())).collect();
        let nodes = self.body.mesh.nodes.len() as f64;
        let request = Request {
            scene: self.scene,
            body: BODY,
            poses: &poses,
            pose_source: "random".into(),
            limits: Limits {
                largest: Limits::LARGEST,
                // Models with columns of their own on the scene's mesh alone.
                largest_of_models: 3.1 * nodes,
                refinements: 1,
                rounds: 1,
            },
            largest_key: "--largest".into(),
            quick: true,
            packs: false,
            requirements_of: &|scene| {
                let unloaded = scene.body[BODY].unloaded();
                scene.bodies[BODY].requirements(scene, BODY, &unloaded).unwrap_or_default()
            },
            command: String::new(),
            scratch,
            keep: None,
            limit: None,
        };
        let (measured, truths) = match settings_against(&request, self.truths, &Silent) {
            Ok(measured) => measured,
            Err(why) => {
                judged.left_out.push(format!("report: {why}"));
                return Ok(());
            }
        };
        let doubt = measured.doubt.unwrap_or_default();
        let why = measured.not_compared.iter().chain(&measured.models_left_out);
        judged.left_out.extend(why.map(|why| format!("report: {why}")));
        for (row, truth) in measured.rows.iter().zip(&truths) {
            let Some(truth) = truth else { continue };
            let of = row.setting.to_string();
            judged.statements.extend(statements(Source::Report, &of, row, doubt, truth.map(Some)));
        }
        let demand: AccuracyTarget =
            DEMANDS[(judged.seed / 3 % 3) as usize].parse().map_err(Failure::wrong)?;
        let Some((chosen, row)) = planner(self.scene, BODY, measured.rows, &demand)? else {
            judged.left_out.push("the planner found nothing".into());
            return Ok(());
        };
        let mut in_session = SettingInSession::new(&chosen, BODY)?;
        let places = in_session.places(&self.refined.mesh().nodes);
        let mut worst = [Some(0.0_f64); 2];
        for ((name, pose), truth) in poses.iter().zip(self.truths) {
            let Some(truth) = truth.as_ref().filter(|_| measured.compared.contains(name)) else { continue };
            in_session.take(pose);
            let found = in_session.errors(pose, &places, &truth.field(), truth.wrenches.clone());
            worst = [0, 1].map(|i| Some(larger(worst[i]?, found[i]?)));
        }
        judged.statements.extend(statements(Source::Planner, &row.setting.to_string(), &row, doubt, worst));
        Ok(())
    }
}

/// Statements of a row about shape and wrench, beside the true errors.
fn statements(
    source: Source,
    of: &str,
    row: &Measurement,
    doubt: [f64; 2],
    truth: [Option<f64>; 2],
) -> impl Iterator<Item = Statement> {
    let known = |shown: Option<f64>| shown.filter(|_| row.is_mesh_known());
    let shown = [known(Some(row.shape())), known(Some(row.held()))];
    let of = of.to_owned();
    [Quantity::Shape, Quantity::Wrench].into_iter().enumerate().filter_map(move |(i, quantity)| {
        let of = of.clone();
        Some(Statement {
            source,
            quantity,
            of,
            turn: 0.0,
            shown: shown[i],
            doubt: doubt[i],
            truth: truth[i]?,
        })
    })
}

/// A run over many bodies.
pub struct Run {
    pub seeds: Vec<u64>,
    pub threads: usize,
    /// No body is begun that would probably end later.
    pub limit: Option<Duration>,
}

/// A seed, and its judged body or why the program failed on it.
type Found = (u64, Result<JudgedBody, String>);

/// Progress of a run after a body.
pub struct Standing<'a> {
    pub body: &'a Result<JudgedBody, String>,
    pub done: usize,
    /// s.
    pub left: f64,
}

impl Run {
    /// Judges the bodies, each in one thread, and calls `each` after every one. The inner errors are bodies on which the program
    /// failed.
    pub fn judge(
        &self,
        planner: Option<Planner<'_>>,
        each: &(dyn Fn(Standing<'_>) + Sync),
    ) -> Vec<Result<JudgedBody, String>> {
        let started = Instant::now();
        let (next, all) = (AtomicUsize::new(0), Mutex::new(Vec::<Found>::new()));
        let worker = || {
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(&seed) = self.seeds.get(index).filter(|_| self.has_time(started, &all)) else {
                    return;
                };
                let of_seed = || catch_unwind(AssertUnwindSafe(|| judge(seed, planner)));
                let found = match in_one_thread(of_seed) {
                    Ok(Ok(Ok(body))) => Ok(body),
                    Ok(Ok(Err(why))) => Err(format!("seed {seed}: {why}")),
                    Ok(Err(_)) => Err(format!("seed {seed}: the program panicked")),
                    Err(why) => Err(format!("seed {seed}: {why}")),
                };
                let mut all = all.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                all.push((seed, found));
                let done = all.len();
                let pace = started.elapsed().as_secs_f64() / done as f64;
                let left = pace * self.seeds.len().saturating_sub(done) as f64;
                let limit = self.limit.map(|limit| limit.saturating_sub(started.elapsed()).as_secs_f64());
                each(Standing {
                    body: &all[done - 1].1,
                    done,
                    left: limit.map_or(left, |limit| left.min(limit)),
                });
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..self.threads.max(1) {
                scope.spawn(worker);
            }
        });
        let mut all = all.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        all.sort_by_key(|(seed, _)| *seed);
        all.into_iter().map(|(_, found)| found).collect()
    }

    /// Whether a body that is begun now would probably end in time, by the longest so far.
    fn has_time(&self, started: Instant, all: &Mutex<Vec<Found>>) -> bool {
        let Some(limit) = self.limit else { return true };
        let all = all.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let longest = all.iter().flat_map(|(_, found)| found).map(|body| body.seconds).fold(0.0, f64::max);
        started.elapsed().as_secs_f64() + longest <= limit.as_secs_f64()
    }
}

/// Runs work whose inner parallel loops stay in one thread, so that bodies do not wait for one another.
fn in_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, String> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|error| error.to_string())?;
    Ok(pool.install(work))
}

#[cfg(test)]
mod tests;
