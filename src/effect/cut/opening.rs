//! A step of a cut while it is worked out: frames go on meanwhile.
//!
//! In: a body, its cut so far, and the cut after one more step. Out: the cut body, in the background; the frame in which it is taken
//! does not depend on how fast that is.

use super::opened::{Cuttable, Known, Moved, Opened};
use crate::green::{GreenFile, resurfaced};
use crate::mesh::split::{CutEdges, CutSurface, Split};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Edges that were cut together, and where.
pub type CutStep = Vec<([u32; 2], f64)>;

/// A body and the name that it has in its file, as it was before any cut.
#[derive(Clone)]
pub struct Whole {
    pub name: String,
    pub file: Arc<GreenFile>,
    pub cuttable: Arc<Cuttable>,
}

/// A cut body.
#[derive(Clone)]
pub struct State {
    pub cut: CutEdges,
    /// The mesh after it, and its surface.
    pub split: Arc<Split>,
    pub surface: Arc<CutSurface>,
    pub known: Arc<Known>,
    /// Changes of the columns at all nodes by the cut.
    pub moved: Arc<Moved>,
    /// Copies of nodes, and the part by which its equations are missed; `None` while it is whole.
    pub outcome: Option<(usize, f64)>,
    /// The file that has its surface and its columns.
    pub file: Arc<GreenFile>,
}

impl Whole {
    /// The body without cuts.
    pub fn state(&self) -> Result<State, String> {
        Ok(State {
            cut: CutEdges::new(),
            split: Arc::default(),
            surface: Arc::default(),
            known: Arc::default(),
            moved: Arc::new(self.cuttable.unmoved()?),
            outcome: None,
            file: self.file.clone(),
        })
    }

    /// The body after a cut that goes on from `before`; its file is the same where nothing more is divided. Else it has the columns of the
    /// points `pressed`, which will be asked for next.
    pub fn cut(&self, before: &State, cut: CutEdges, pressed: &[u32]) -> Result<State, String> {
        let split = self.cuttable.split(&cut);
        let surface = self.cuttable.splitter.surface(&split, &cut);
        if split.pieces == before.split.pieces && (split.pieces.is_empty() || surface == *before.surface) {
            return Ok(State { cut, ..before.clone() });
        }
        let opened = self.cuttable.open(&before.known, &split, &surface)?;
        let Opened { surface: new, moved, known, error } = opened;
        let file = resurfaced(self.file.clone(), &self.name, &new).map_err(|error| error.to_string())?;
        let outcome = Some((split.copies.len(), error));
        let (split, surface, file) = (Arc::new(split), Arc::new(surface), Arc::new(file));
        if let Some(compliance) = file.compliance(&self.name).filter(|_| !pressed.is_empty()) {
            let places = compliance.places();
            let places: Vec<usize> = pressed.iter().filter_map(|point| places.get(point).copied()).collect();
            // An error comes again when they are asked for.
            let _ = file.columns(&self.name, &places, Duration::MAX);
        }
        let (known, moved) = (Arc::new(known), Arc::new(moved));
        Ok(State { cut, split, surface, known, moved, outcome, file })
    }
}

/// A step that is being worked out.
pub struct Opening {
    pub step: CutStep,
    /// Frames until it is taken.
    pub left: u32,
    work: Work,
}

enum Work {
    Thread(JoinHandle<Result<State, String>>),
    Done(Box<Result<State, String>>),
}

impl Opening {
    /// Begins with a step, the whole cut after it, and the points that are pressed.
    pub fn begin(
        of: &Whole,
        before: &State,
        (step, cut, pressed): (CutStep, CutEdges, Vec<u32>),
        left: u32,
    ) -> Opening {
        let (own, from, to) = (of.clone(), before.clone(), cut.clone());
        let work = move || own.cut(&from, to, &pressed);
        let work = match std::thread::Builder::new().name("cut".into()).spawn(work) {
            Ok(thread) => Work::Thread(thread),
            Err(_no_thread) => Work::Done(Box::new(of.cut(before, cut, &[]))),
        };
        Opening { step, left, work }
    }

    /// The result; waits for it.
    pub fn finish(self) -> (CutStep, Result<State, String>) {
        let next = match self.work {
            Work::Done(next) => *next,
            Work::Thread(thread) => thread
                .join()
                .unwrap_or_else(|_panic| Err("the thread that works it out has ended".to_owned())),
        };
        (self.step, next)
    }
}
