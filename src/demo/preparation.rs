//! Makes the scenes and files of the chapters, one after another on a separate thread, and reports its progress.
//!
//! In: the chapters. Out: for each a scene with its .green file, from the cache folder or made anew; or why not.

use super::chapters::{CHAPTERS, Chapter};
use crate::base::failure::Failure;
use crate::base::progress::Progress;
use crate::green::GreenFile;
use crate::prepare::{self, Resolved};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};

/// A chapter's scene and .green file.
#[derive(Clone)]
pub struct Ready {
    pub scene: Arc<Resolved>,
    pub file: Arc<GreenFile>,
}

/// The state of a chapter's preparation.
#[derive(Clone)]
pub enum Readiness {
    Waiting,
    /// A step in words, and the share of it that is done, where that is known.
    Working {
        step: String,
        share: f64,
    },
    Ready(Ready),
    Failed(String),
}

#[derive(Default)]
struct SharedReadiness {
    chapters: Mutex<Vec<Readiness>>,
    changed: Condvar,
}

impl SharedReadiness {
    fn lock(&self) -> MutexGuard<'_, Vec<Readiness>> {
        self.chapters.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    fn put(&self, chapter: usize, readiness: Readiness) {
        self.lock()[chapter] = readiness;
        self.changed.notify_all();
    }
}

/// The preparation of all chapters; the thread goes on until it is done, or the program ends.
pub struct Preparation {
    told: Arc<SharedReadiness>,
}

impl Preparation {
    /// Starts with the chapters of these numbers, in this order.
    pub fn start(order: Vec<usize>) -> std::io::Result<Preparation> {
        let told = Arc::new(SharedReadiness::default());
        told.lock().resize_with(CHAPTERS.len(), || Readiness::Waiting);
        let telling = told.clone();
        std::thread::Builder::new().name("preparation".into()).spawn(move || {
            for number in order {
                let made = make(&CHAPTERS[number], &telling, number);
                telling.put(number, made.unwrap_or_else(|failure| Readiness::Failed(failure.to_string())));
            }
        })?;
        Ok(Preparation { told })
    }

    pub fn readiness(&self, chapter: usize) -> Readiness {
        self.told.lock()[chapter].clone()
    }

    /// Waits for a chapter's scene and file.
    pub fn wait(&self, chapter: usize) -> Result<Ready, Failure> {
        let mut chapters = self.told.lock();
        loop {
            match &chapters[chapter] {
                Readiness::Ready(ready) => return Ok(ready.clone()),
                Readiness::Failed(why) => return Err(Failure::work(anyhow::anyhow!("{why}"))),
                _ => {}
            }
            chapters = self.told.changed.wait(chapters).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
    }
}

fn make(chapter: &Chapter, told: &Arc<SharedReadiness>, number: usize) -> Result<Readiness, Failure> {
    let scene = chapter.scene()?;
    let file = prepare::green_file_telling(&scene, None, &|body| {
        let step = Mutex::new(Step { body: body.to_owned(), ..Step::default() });
        Box::new(Steps { told: told.clone(), number, step })
    })?;
    Ok(Readiness::Ready(Ready { scene: Arc::new(scene), file }))
}

/// Leaves the steps of a body's precomputation where the caption finds them.
struct Steps {
    told: Arc<SharedReadiness>,
    number: usize,
    step: Mutex<Step>,
}

#[derive(Clone, Default)]
struct Step {
    body: String,
    name: String,
    done: u64,
    units: u64,
}

impl Steps {
    fn change(&self, change: impl FnOnce(&mut Step)) {
        let mut step = self.step.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        change(&mut step);
        let share = if step.units > 0 { step.done as f64 / step.units as f64 } else { 0.0 };
        let step = format!("{}: {}", step.body, step.name);
        self.told.put(self.number, Readiness::Working { step, share });
    }
}

impl Progress for Steps {
    fn begin(&self, name: &str, units: u64) {
        self.change(|step| (step.name, step.units, step.done) = (name.to_owned(), units, 0));
    }

    fn advance(&self, units: u64) {
        self.change(|step| step.done += units);
    }

    fn end(&self) {
        self.change(|step| step.done = step.units);
    }
}
