//! A thread that solves static equilibria of one body, one after another.
//!
//! In: a [`Question`], poses and loads with the displacements that the model has of them. Out: an [`Answer`], the equilibrium of
//! these very poses and loads by [`Statics`], and how far that surface is from it. The body's mesh is loaded when the first is asked.

use crate::base::progress::Progress;
use crate::deform::{
    AppliedLoads, ControlPoses, EquilibriumResult, StaticForces, Statics, StaticsError, legs,
};
use crate::fem::Law;
use crate::scene::Scene;
use crate::solve::Solver;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

/// The body that is solved, and its law.
pub struct Subject {
    pub scene: Scene,
    pub body: String,
    pub law: &'static Law,
    /// Mesh tags of the surface nodes.
    pub tags: Vec<u64>,
}

/// Poses and loads of a body.
#[derive(Clone)]
pub struct PosedBody {
    pub poses: ControlPoses,
    /// All forces at points of the surface are given.
    pub loads: AppliedLoads,
}

/// A state whose equilibrium is asked for.
#[derive(Clone)]
pub struct Question {
    pub held: PosedBody,
    /// Turn of each control element, up to 360°.
    pub turns: Vec<UnitQuaternion<f64>>,
    /// Displacements of the surface nodes as the model has them, m: what an effect adds to them, such as a vibration, is no error of it.
    pub by_model: Vec<Vector3<f64>>,
}

/// An equilibrium, or why there is none.
pub struct Answer {
    pub held: PosedBody,
    pub result: Result<Solved, String>,
    pub seconds: f64,
}

/// The equilibrium of poses on the surface.
pub struct Solved {
    /// Displacements of the surface nodes, m.
    pub displacement: Vec<[f64; 3]>,
    /// Distance of the surface nodes from where the model has them: the largest, and the root mean square, m.
    pub largest_m: f64,
    pub rms_m: f64,
}

/// The thread, until it is dropped; an equilibrium that it has begun is then left to itself.
pub struct Solving {
    questions: Sender<Question>,
    answers: Receiver<Answer>,
    share: Arc<Share>,
    /// The time at which the question was asked that is not yet answered.
    pub asked: Option<Instant>,
}

/// Progress of the thread with its equilibrium: units done, and their number.
struct Share([AtomicU64; 2]);

impl Progress for Share {
    fn begin(&self, _step: &str, _units: u64) {}

    fn advance(&self, units: u64) {
        self.0[0].fetch_add(units, Ordering::Relaxed);
    }

    fn end(&self) {}
}

impl Solving {
    pub fn start(subject: Subject) -> Result<Solving, String> {
        let share = Arc::new(Share([AtomicU64::new(0), AtomicU64::new(1000)]));
        let ((questions, asked), (tell, answers)) = (channel(), channel());
        let told = share.clone();
        let thread = std::thread::Builder::new().name("ghost".into());
        let run = move || run(&subject, &asked, &tell, &told);
        thread.spawn(run).map_err(|error| format!("no thread can be started: {error}"))?;
        Ok(Solving { questions, answers, share, asked: None })
    }

    /// Asks, where nothing is being solved.
    pub fn ask(&mut self, question: Question) {
        if self.asked.is_none() {
            let [done, all] = &self.share.0;
            done.store(0, Ordering::Relaxed);
            all.store(1000 * legs(&question.turns) as u64, Ordering::Relaxed);
            self.asked = self.questions.send(question).ok().map(|()| Instant::now());
        }
    }

    /// The share of the way that is done, 0 to 1.
    pub fn share(&self) -> f64 {
        let [done, all] = [0, 1].map(|k| self.share.0[k].load(Ordering::Relaxed) as f64);
        (done / all).min(1.0)
    }

    /// The answer, if there is one; with `waits`, waits for the answer to the last question.
    pub fn answer(&mut self, waits: bool) -> Option<Answer> {
        self.asked?;
        let answer = if waits { self.answers.recv().ok() } else { self.answers.try_recv().ok() };
        if answer.is_some() || waits {
            self.asked = None;
        }
        answer
    }
}

fn run(subject: &Subject, questions: &Receiver<Question>, answers: &Sender<Answer>, share: &Share) {
    let mut statics: Option<Statics> = None;
    for Question { held, turns, by_model } in questions {
        let started = Instant::now();
        let result = solved(subject, &mut statics, &held, &turns, share);
        let result = result.map(|displacement| compared(displacement, &by_model));
        let seconds = started.elapsed().as_secs_f64();
        if answers.send(Answer { held, result, seconds }).is_err() {
            return;
        }
    }
}

fn solved(
    subject: &Subject,
    statics: &mut Option<Statics>,
    held: &PosedBody,
    turns: &[UnitQuaternion<f64>],
    share: &Share,
) -> Result<Vec<[f64; 3]>, String> {
    let statics = match statics {
        Some(statics) => statics,
        None => statics.insert(statics_of(subject)?),
    };
    let number: BTreeMap<u64, u32> = (0..).zip(&statics.mesh.tags).map(|(i, tag)| (*tag, i)).collect();
    let nodes: Option<Vec<u32>> = subject.tags.iter().map(|tag| number.get(tag).copied()).collect();
    let nodes = nodes.ok_or("the mesh has changed since the body was precomputed")?;
    let forces = StaticForces::from_loads(&held.loads, |node| nodes.get(node as usize).copied());
    let forces = forces.ok_or("a point of the surface is held whose force is not known")?;
    statics.apply(&forces).map_err(|error| error.to_string())?;
    let EquilibriumResult { displacement, inverted, .. } =
        statics.solve_turned(&held.poses, turns, share).map_err(|error| reason(&error))?;
    if !inverted.is_empty() {
        return Err(format!("{} tetrahedra turn inside out", inverted.len()));
    }
    Ok(nodes.into_iter().map(|node| displacement[node as usize].into()).collect())
}

/// The scene's body under the law, factorised whatever the scene's own solver is.
fn statics_of(subject: &Subject) -> Result<Statics, String> {
    let mut scene = subject.scene.clone();
    scene.body[&subject.body].solver = Solver::default();
    Statics::new(&scene, &subject.body, subject.law, &crate::solve::Silent).map_err(|error| error.to_string())
}

/// A short reason, for a plate.
fn reason(error: &StaticsError) -> String {
    match error {
        StaticsError::Stopped { share, critical, .. } => {
            let how = match critical.as_ref().is_some_and(|critical| critical.is_critical) {
                true => "the body gives way there",
                false => "Newton's iteration ends there",
            };
            format!("none beyond {:.0} % of the way; {how}", 100.0 * share)
        }
        error => error.to_string(),
    }
}

fn compared(displacement: Vec<[f64; 3]>, by_model: &[Vector3<f64>]) -> Solved {
    let apart = |(u, own): (&[f64; 3], &Vector3<f64>)| (Vector3::from(*u) - own).norm();
    let apart: Vec<f64> = displacement.iter().zip(by_model).map(apart).collect();
    let squares: f64 = apart.iter().map(|apart| apart * apart).sum();
    let rms_m = (squares / apart.len().max(1) as f64).sqrt();
    Solved { displacement, largest_m: apart.into_iter().fold(0.0, f64::max), rms_m }
}
