//! A step of a cut while it is worked out, and a new base: frames go on meanwhile.
//!
//! In: a body, its cut so far, and the cut after one more step. Out: the cut body, in the background; the frame in which it is taken
//! does not depend on how fast that is.

use super::base::Base;
use super::opened::{Cuttable, Known, Moved, Opened};
use crate::green::{GreenFile, resurfaced};
use crate::mesh::split::{CutEdges, CutSurface, Split};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Edges that are cut together, and where.
pub type Edges = Vec<([u32; 2], f64)>;

/// A step of a cut: its edges, and how many of the steps are cut in the base from which the body after it is found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CutStep {
    pub edges: Edges,
    pub base: usize,
}

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
    /// The base from which it is found, and how many steps are cut in that.
    pub base: (Arc<Base>, usize),
    pub known: Arc<Known>,
    /// Changes of the columns at all nodes by the cut.
    pub moved: Arc<Moved>,
    /// Copies of nodes, and the part by which its equations are missed; `None` while it is whole.
    pub outcome: Option<(usize, f64)>,
    /// The file that has its surface and its columns.
    pub file: Arc<GreenFile>,
}

/// The base from which the body after a step is found.
pub enum From {
    /// The base of the body before.
    Before,
    /// Another one, which is worked out.
    Renewed(Renewal),
    /// The body itself, after so many steps.
    Itself(usize),
}

impl Whole {
    /// The body without cuts.
    pub fn state(&self) -> Result<State, String> {
        Ok(State {
            cut: CutEdges::new(),
            split: Arc::default(),
            surface: Arc::default(),
            base: (self.cuttable.base.clone(), 0),
            known: Arc::default(),
            moved: Arc::new(self.cuttable.unmoved()?),
            outcome: None,
            file: self.file.clone(),
        })
    }

    /// The body after a cut that goes on from `before`; its file is the same where nothing more is divided. Else it has the columns of the
    /// points `pressed`, which will be asked for next.
    pub fn cut(&self, before: &State, cut: CutEdges, pressed: &[u32], from: From) -> Result<State, String> {
        let (base, split) = match from {
            From::Before => (before.base.clone(), self.cuttable.split(&cut, &before.base.0)),
            From::Renewed(renewal) => {
                let (base, at) = (renewal.work.finish()?, renewal.at);
                let split = self.cuttable.split(&cut, &base);
                ((base, at), split)
            }
            From::Itself(at) => {
                let split = self.cuttable.split(&cut, &before.base.0);
                let base = self.cuttable.cut_base(Arc::new(split.clone()), cut.len())?;
                ((base, at), split)
            }
        };
        let surface = self.cuttable.matter.splitter.surface(&split, &cut);
        let is_same =
            split.pieces == before.split.pieces && (split.pieces.is_empty() || surface == *before.surface);
        if is_same && Arc::ptr_eq(&base.0, before.moved.base()) {
            return Ok(State { cut, ..before.clone() });
        }
        let known = if base.1 == before.base.1 { before.known.clone() } else { Arc::default() };
        let opened = self.cuttable.open(&base.0, &known, (&split, &surface))?;
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
        Ok(State { cut, split, surface, base, known, moved, outcome, file })
    }
}

/// Something that is worked out.
pub enum Work<T> {
    Thread(JoinHandle<Result<T, String>>),
    Done(Box<Result<T, String>>),
}

impl<T: Send + 'static> Work<T> {
    /// Begins it in a thread.
    fn begin(work: impl FnOnce() -> Result<T, String> + Send + 'static) -> Work<T> {
        match std::thread::Builder::new().name("cut".into()).spawn(work) {
            Ok(thread) => Work::Thread(thread),
            Err(no_thread) => Work::Done(Box::new(Err(format!("no thread works it out: {no_thread}")))),
        }
    }

    /// The result; waits for it.
    fn finish(self) -> Result<T, String> {
        match self {
            Work::Done(done) => *done,
            Work::Thread(thread) => thread
                .join()
                .unwrap_or_else(|_panic| Err("the thread that works it out has ended".to_owned())),
        }
    }
}

/// A new base that is worked out.
pub struct Renewal {
    /// Number of steps that are cut in it, and of their edges.
    pub at: usize,
    pub edges: usize,
    /// Frames until a step may begin from it.
    pub left: u32,
    work: Work<Arc<Base>>,
}

impl Renewal {
    /// Begins with a mesh after so many steps with so many edges.
    pub fn begin(of: &Whole, split: &Arc<Split>, [at, edges]: [usize; 2], left: u32) -> Renewal {
        let (cuttable, split) = (of.cuttable.clone(), split.clone());
        Renewal { at, edges, left, work: Work::begin(move || cuttable.cut_base(split, edges)) }
    }
}

/// A step that is being worked out.
pub struct Opening {
    pub step: CutStep,
    /// Frames until it is taken.
    pub left: u32,
    work: Work<State>,
}

impl Opening {
    /// Begins with the edges of a step, the whole cut after it, the points that are pressed, and a base.
    pub fn begin(
        of: &Whole,
        before: &State,
        (edges, cut, pressed): (Edges, CutEdges, Vec<u32>),
        from: From,
        left: u32,
    ) -> Opening {
        let base = match &from {
            From::Before => before.base.1,
            From::Renewed(renewal) => renewal.at,
            From::Itself(at) => *at,
        };
        let (own, before) = (of.clone(), before.clone());
        let work = Work::begin(move || own.cut(&before, cut, &pressed, from));
        Opening { step: CutStep { edges, base }, left, work }
    }

    /// The result; waits for it.
    pub fn finish(self) -> (CutStep, Result<State, String>) {
        (self.step, self.work.finish())
    }
}
