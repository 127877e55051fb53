//! The course of a measurement: steps with names and expected times, told as they go, kept, and left out where a limit of time
//! leaves no room for them.
//!
//! In: the steps ahead ([`agenda`](super::agenda)), each in the order in which it is done. Out: "7 of 41: tet10 h · cholesky; some
//! 3 min left". Times left are the expected ones times what the finished steps took against what was expected of them.

use super::kept::{self, Kept};
use super::names;
use super::request::MeasureError;
use crate::solve::{Progress, Silent};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::cell::{Cell, RefCell};
use std::time::Instant;

/// Something that will be done.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    pub key: String,
    /// On an idle machine with two cores, s.
    pub seconds: f64,
    /// Whether it is done however little time is left.
    pub is_needed: bool,
}

pub struct Course<'a> {
    progress: &'a dyn Progress,
    kept: Option<Kept>,
    steps: Vec<Step>,
    /// Index of the next step.
    next: Cell<usize>,
    /// Seconds that finished steps took, and what was expected of them.
    took: Cell<[f64; 2]>,
    started: Instant,
    /// s
    limit: Option<f64>,
    taken_over: Cell<usize>,
    /// Least and largest load of the machine when steps that were taken over were measured.
    loads: Cell<[f64; 2]>,
    left_out: RefCell<Vec<String>>,
    /// Indices of the steps that were done.
    done: RefCell<Vec<usize>>,
}

/// What an expected time counts against measured ones before anything is measured, s.
const PRIOR: f64 = 2.0;

impl<'a> Course<'a> {
    pub fn new(
        steps: Vec<Step>,
        limit: Option<f64>,
        kept: Option<Kept>,
        progress: &'a dyn Progress,
    ) -> Course<'a> {
        Course {
            progress,
            kept,
            steps,
            next: Cell::new(0),
            took: Cell::new([PRIOR * slowdown(), PRIOR]),
            started: Instant::now(),
            limit,
            taken_over: Cell::new(0),
            loads: Cell::new([f64::INFINITY, 0.0]),
            left_out: RefCell::default(),
            done: RefCell::default(),
        }
    }

    /// How many steps there are, and how long they will take together.
    pub fn forecast(&self) -> String {
        let all = self.steps.iter().map(|step| step.seconds).sum::<f64>() * self.pace();
        let time = self.limit.map_or(all, |limit| all.min(limit));
        let most = if self.limit.is_some() { "up to " } else { "" };
        format!("{most}{} steps, {}", self.steps.len(), rounded(time))
    }

    /// Measured time of a step over the expected one.
    fn pace(&self) -> f64 {
        let [took, expected] = self.took.get();
        took / expected
    }

    fn find(&self, key: &str) -> Option<usize> {
        let next = self.next.get();
        self.steps[next..].iter().position(|step| step.key == key).map(|at| next + at)
    }

    fn seconds_after(&self, at: usize, is_counted: impl Fn(&Step) -> bool) -> f64 {
        let rest = self.steps.get(at..).unwrap_or_default().iter().filter(|step| is_counted(step));
        rest.map(|step| step.seconds).sum::<f64>() * self.pace()
    }

    /// Whether there is time for a step; where there is not, it is named among those left out.
    pub fn affords(&self, key: &str) -> bool {
        let (Some(limit), Some(at)) = (self.limit, self.find(key)) else { return true };
        if self.steps[at].is_needed || self.kept.as_ref().is_some_and(|kept| kept.find(key).is_some()) {
            return true;
        }
        // What is solved is judged too.
        let judged = names::errors(key);
        let own = self.seconds_after(at, |step| step.key == key || step.key == judged);
        let done = self.done.borrow();
        let is_due = |step: &Step| {
            step.is_needed || done.iter().any(|&done| names::errors(&self.steps[done].key) == step.key)
        };
        let rest = self.seconds_after(at + 1, is_due);
        let fits = self.started.elapsed().as_secs_f64() + own + rest <= limit;
        if !fits {
            self.left_out.borrow_mut().push(format!("{key} ({})", rounded(own)));
        }
        fits
    }

    /// Does a step, or takes its result over from an earlier run. Steps without a name on the agenda are done unsaid.
    pub fn step<T>(
        &self,
        key: &str,
        write: &dyn Fn(&T) -> Option<Vec<u8>>,
        read: &dyn Fn(&[u8]) -> Option<T>,
        make: impl FnOnce(&dyn Progress) -> Result<T, MeasureError>,
    ) -> Result<T, MeasureError> {
        let at = self.find(key);
        let expected = at.map_or(0.0, |at| self.steps[at].seconds);
        if let Some(at) = at {
            self.next.set(at + 1);
        }
        if let Some(old) = self.kept.as_ref().and_then(|kept| kept.find(key))
            && let Some(value) = read(&old.bytes)
        {
            self.taken_over.set(self.taken_over.get() + 1);
            self.done.borrow_mut().extend(at);
            let [least, most] = self.loads.get();
            self.loads.set([least.min(old.load), most.max(old.load)]);
            return Ok(value);
        }
        if let Some(at) = at {
            let left = self.seconds_after(at, |_| true);
            let left = self.limit.map_or(left, |limit| {
                left.min((limit - self.started.elapsed().as_secs_f64()).max(expected * self.pace()))
            });
            self.progress
                .begin(&format!("{} of {}: {key}; {} left", at + 1, self.steps.len(), rounded(left)), 0);
        }
        let started = Instant::now();
        let made = make(&Silent);
        let seconds = started.elapsed().as_secs_f64();
        if at.is_some() {
            self.progress.end();
        }
        let value = made?;
        if let Some(at) = at {
            self.done.borrow_mut().push(at);
            let [took, of] = self.took.get();
            self.took.set([took + seconds, of + expected]);
        }
        if let (Some(kept), Some(bytes)) = (&self.kept, self.kept.as_ref().and_then(|_| write(&value))) {
            kept.keep(key, &bytes);
        }
        Ok(value)
    }

    /// [`Course::step`] of a result that is kept as JSON.
    pub fn step_as_json<T: Serialize + DeserializeOwned>(
        &self,
        key: &str,
        make: impl FnOnce(&dyn Progress) -> Result<T, MeasureError>,
    ) -> Result<T, MeasureError> {
        self.step(
            key,
            &|value| serde_json::to_vec(value).ok(),
            &|bytes| serde_json::from_slice(bytes).ok(),
            make,
        )
    }

    /// A step whose result is not kept: times that must be measured together.
    pub fn step_anew<T>(
        &self,
        key: &str,
        make: impl FnOnce(&dyn Progress) -> Result<T, MeasureError>,
    ) -> Result<T, MeasureError> {
        self.step(key, &|_| None, &|_| None, make)
    }

    /// What was left out for want of time, as one sentence.
    pub fn left_out(&self) -> Vec<String> {
        let (left_out, limit) = (self.left_out.borrow(), self.limit.unwrap_or_default());
        if left_out.is_empty() {
            return Vec::new();
        }
        vec![format!("Left out, to end within {limit:.0} s: {}.", left_out.join("; "))]
    }

    /// What was taken over from an earlier run, as one sentence.
    pub fn taken_over(&self) -> Option<String> {
        let count = self.taken_over.get();
        let [least, most] = self.loads.get();
        (count > 0).then(|| {
            format!(
                "{count} of {} steps were taken over from a run that was stopped; the machine's load was {least:.1} to {most:.1} \
                 then, and is {:.1} now. Offline times are of the run that measured them, times of a frame all of this one.",
                self.steps.len(),
                kept::load()
            )
        })
    }
}

/// How much slower this machine is by what else runs on it.
fn slowdown() -> f64 {
    let threads = rayon::current_num_threads().max(1) as f64;
    (2.0 / threads).max(0.5) * (1.0 + kept::load() / threads)
}

/// "some 40 s", "some 3 min", "some 2 h".
fn rounded(seconds: f64) -> String {
    match seconds {
        s if s < 1.5 => "some 1 s".into(),
        s if s < 10.0 => format!("some {s:.0} s"),
        s if s < 100.0 => format!("some {:.0} s", 5.0 * (s / 5.0).ceil()),
        s if s < 5400.0 => format!("some {:.0} min", (s / 60.0).ceil()),
        s => format!("some {:.1} h", s / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[derive(Default)]
    struct Said(Mutex<Vec<String>>);

    impl Progress for Said {
        fn begin(&self, step: &str, _units: u64) {
            self.0.lock().unwrap().push(step.to_owned());
        }
        fn advance(&self, _units: u64) {}
        fn end(&self) {}
    }

    fn steps(all: &[(&str, f64, bool)]) -> Vec<Step> {
        let step =
            |&(key, seconds, is_needed): &(&str, f64, bool)| Step { key: key.into(), seconds, is_needed };
        all.iter().map(step).collect()
    }

    #[test]
    fn steps_are_counted_with_the_time_that_is_left() {
        let said = Said::default();
        let course = Course::new(
            steps(&[("a", 1e-9, true), ("b", 300.0, true), ("c", 299.0, true)]),
            None,
            None,
            &said,
        );
        course.took.set([4.0, 2.0]);
        assert_eq!(course.forecast(), "3 steps, some 20 min");
        course.step_as_json("a", |_| Ok(1)).unwrap();
        // What is not on the agenda is done without a word.
        course.step_as_json("aside", |_| Ok(1)).unwrap();
        course.step_as_json("c", |_| Ok(1)).unwrap();
        let said = said.0.lock().unwrap();
        assert!(
            said[0].starts_with("1 of 3: a; some ") && said[1].starts_with("3 of 3: c; some 10 min"),
            "{said:?}"
        );
        assert_eq!(said.len(), 2);
    }

    #[test]
    fn what_does_not_fit_is_left_out_and_named() {
        let course = Course::new(
            steps(&[("dear", 30.0, false), ("cheap", 5.0, false), ("needed", 20.0, true)]),
            Some(45.0),
            None,
            &Silent,
        );
        course.took.set([1.0, 1.0]);
        assert!(!course.affords("dear") && course.affords("cheap") && course.affords("needed"));
        assert_eq!(course.left_out(), ["Left out, to end within 45 s: dear (some 30 s)."]);
        let free = Course::new(steps(&[("dear", 1e9, false)]), None, None, &Silent);
        assert!(free.affords("dear") && free.left_out().is_empty());
    }
}
