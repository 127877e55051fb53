//! A scene's .green file that is found or made while windows are already open.
//!
//! In: a scene. Out: its file, and meanwhile how far it is, for the windows as for standard error.

use super::change::Steps;
use crate::base::bars::Bars;
use crate::base::failure::Failure;
use crate::base::progress::Progress;
use crate::green::GreenFile;
use crate::prepare::{self, Resolved};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;

pub struct Making {
    pub steps: Arc<Steps>,
    thread: JoinHandle<Result<Arc<GreenFile>, Failure>>,
}

/// Shows progress in the window as on standard error.
struct Both {
    body: String,
    bars: Bars,
    steps: Arc<Steps>,
}

impl Progress for Both {
    fn begin(&self, step: &str, units: u64) {
        self.bars.begin(step, units);
        self.steps.begin(&format!("{}, {step}", self.body), units);
    }

    fn advance(&self, units: u64) {
        self.bars.advance(units);
        self.steps.advance(units);
    }

    fn end(&self) {
        self.bars.end();
    }

    fn tell(&self, sentence: &str) {
        self.bars.tell(sentence);
    }
}

impl Making {
    /// Begins to find or make the file; `green` is one that is only read.
    ///
    /// # Errors
    /// What of the scene cannot be made.
    pub fn begin(scene: Resolved, green: Option<PathBuf>) -> Result<Making, Failure> {
        for name in scene.body.keys() {
            scene.requirements(name)?;
        }
        let steps = Arc::new(Steps::default());
        let told = steps.clone();
        let make = move || {
            let teller = |name: &str| -> Box<dyn Progress> {
                Box::new(Both { body: name.to_owned(), bars: Bars::new(name, false), steps: told.clone() })
            };
            prepare::green_file_telling(&scene, green.as_deref(), &teller)
        };
        let thread = std::thread::Builder::new().name("making".into()).spawn(make).map_err(Failure::work)?;
        Ok(Making { steps, thread })
    }

    pub fn is_done(&self) -> bool {
        self.thread.is_finished()
    }

    /// The file; waits for it.
    pub fn finish(self) -> Result<Arc<GreenFile>, Failure> {
        let panicked = || {
            Failure::Work(anyhow::anyhow!("precomputing stopped unexpectedly; this is a bug in greenstage"))
        };
        self.thread.join().unwrap_or_else(|_| Err(panicked()))
    }
}
