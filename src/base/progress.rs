//! Progress of long work: the interface [`Progress`] by which it is reported, and [`Bars`], which shows it on standard
//! error: bars on a terminal, and a line for every long step.

use super::diagnostic::{is_verbose, notice};
use super::text::one_line;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Receives the progress of long work: the command line draws bars, tests ignore it.
pub trait Progress: Sync {
    /// Begins a step of `units` units of work; 0 if the number is not known.
    fn begin(&self, step: &str, units: u64);
    fn advance(&self, units: u64);
    fn end(&self);
    /// One sentence to the user.
    fn tell(&self, _sentence: &str) {}
}

/// Hears of the progress of a body, whose name it is given.
pub type Teller<'a> = &'a dyn Fn(&str) -> Box<dyn Progress + 'a>;

impl Progress for &dyn Progress {
    fn begin(&self, step: &str, units: u64) {
        (**self).begin(step, units);
    }

    fn advance(&self, units: u64) {
        (**self).advance(units);
    }

    fn end(&self) {
        (**self).end();
    }

    fn tell(&self, sentence: &str) {
        (**self).tell(sentence);
    }
}

/// Ignores all progress.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _step: &str, _units: u64) {}
    fn advance(&self, _units: u64) {}
    fn end(&self) {}
}

/// A step that took longer than this leaves a line, s; `--verbose` shows a line for every step.
const LONG_S: f64 = 10.0;

/// Shows the steps of the offline stage for one body.
pub struct Bars {
    body: String,
    quiet: bool,
    current: Mutex<Option<Step>>,
}

struct Step {
    name: String,
    started: Instant,
    bar: ProgressBar,
}

impl Bars {
    pub fn new(body: &str, quiet: bool) -> Bars {
        Bars { body: one_line(body), quiet, current: Mutex::new(None) }
    }

    fn with_step(&self, act: impl FnOnce(&mut Option<Step>)) {
        // A panic elsewhere must not hide behind a poisoned progress bar.
        act(&mut self.current.lock().unwrap_or_else(|poisoned| poisoned.into_inner()));
    }
}

impl Drop for Bars {
    /// Removes the bar of work that failed.
    fn drop(&mut self) {
        self.with_step(|current| {
            if let Some(step) = current.take() {
                step.bar.finish_and_clear();
            }
        });
    }
}

/// Moves the bar's clock until it is finished. Without a thread to spare, the bar moves only as the work advances.
fn keep_ticking(bar: &ProgressBar) {
    if bar.is_hidden() {
        return;
    }
    let bar = bar.clone();
    let tick = move || {
        while !bar.is_finished() {
            bar.tick();
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    let _ = std::thread::Builder::new().name("bar".into()).spawn(tick);
}

impl Progress for Bars {
    fn begin(&self, step: &str, units: u64) {
        let bar = if self.quiet || !std::io::stderr().is_terminal() {
            ProgressBar::hidden()
        } else {
            let bar = if units > 0 { ProgressBar::new(units) } else { ProgressBar::new_spinner() };
            let template = if units > 0 {
                "{prefix:>12}  {msg:<18} {bar:32.green} {percent:>3} %  {elapsed} (left {eta})"
            } else {
                "{prefix:>12}  {msg:<18} {spinner:.green} {elapsed}"
            };
            let style =
                ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.with_style(style).with_prefix(self.body.clone()).with_message(step.to_owned())
        };
        keep_ticking(&bar);
        self.with_step(|current| {
            *current = Some(Step { name: step.to_owned(), started: Instant::now(), bar });
        });
    }

    fn advance(&self, units: u64) {
        self.with_step(|current| {
            if let Some(step) = current {
                step.bar.inc(units);
            }
        });
    }

    fn tell(&self, sentence: &str) {
        if !self.quiet {
            notice!("{:>12}  {sentence}", self.body);
        }
    }

    fn end(&self) {
        self.with_step(|current| {
            if let Some(step) = current.take() {
                step.bar.finish_and_clear();
                let seconds = step.started.elapsed().as_secs_f64();
                if !self.quiet && (seconds > LONG_S || is_verbose()) {
                    notice!("{:>12}  {:<30} {seconds:8.3} s", self.body, step.name);
                }
            }
        });
    }
}
