//! The course of a measurement: steps with names and expected times, reported as they go, kept, and left out where a limit of
//! time leaves no room for them.
//!
//! In: the steps ahead (`agenda`), each in the order in which it is done. Out: "7 of 41: tet10 h · cholesky; some
//! 3 min left". Times left are the expected ones times what finished steps of the same kind took against what was expected of
//! them; time between two steps counts to the second.

use super::data::Setting;
use super::request::{MeasureError, TimeLimit};
use super::resume::Kept;
use crate::base::machine::load;
use crate::fem::Element;
use crate::solve::{Progress, Silent, Solver};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::cell::{Cell, RefCell};
use std::time::Instant;

/// Something that will be done.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    pub key: String,
    pub kind: StepKind,
    /// Expected time on an idle machine with two cores, s.
    pub seconds: f64,
    /// Whether it is done however little time is left.
    pub is_needed: bool,
}

impl Step {
    pub const EQUILIBRIA: &str = "equilibria of the poses";
    pub const TRIALS: &str = "models by bends and twists";
    pub const TIMES: &str = "times of an evaluation";
    pub const EFFECTS: &str = "effects";

    /// The name of the step that solves the finer equilibrium of pose number `index`.
    pub fn finer(index: usize, pose: &str) -> String {
        format!("finer equilibrium of pose {}, {pose}", index + 1)
    }

    /// "tet10 h · cholesky", "tet4 h · reduced".
    pub fn solved(refine: u32, element: &Element, solver: Solver, model: Option<&str>) -> String {
        let what = model.map_or_else(|| solver.to_string(), str::to_owned);
        format!("{} · {what}", Setting::mesh_name(element.name, refine))
    }

    /// The name of the step that measures the errors of a solved one.
    pub fn errors(solved: &str) -> String {
        format!("errors of {solved}")
    }

    pub fn smooth(element: &Element) -> String {
        format!("smooth problem, {}", element.name)
    }
}

/// Steps whose expected times are wrong by much the same factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StepKind {
    Solve,
    SolveForModel,
    SolveIteratively,
    Equilibria,
    Finer,
    Trials,
    Errors,
    Other,
}

impl StepKind {
    const COUNT: usize = StepKind::Other as usize + 1;
}

pub struct Course<'a> {
    progress: &'a dyn Progress,
    kept: Option<Kept>,
    steps: Vec<Step>,
    /// Index of the next step.
    next: Cell<usize>,
    /// Seconds that finished steps took, and what was expected of them, of each kind.
    took: Cell<[[f64; 2]; StepKind::COUNT]>,
    /// The expected slowness of this machine before anything is measured, as a factor.
    slowdown: f64,
    /// Time at which the last step ended.
    ended: Cell<Instant>,
    limit: Option<TimeLimit>,
    taken_over: Cell<usize>,
    /// Least and largest load of the machine when steps that were taken over were measured.
    loads: Cell<[f64; 2]>,
    left_out: RefCell<Vec<String>>,
    /// Indices of the steps that were done.
    done: RefCell<Vec<usize>>,
}

/// Weight of an expected time against measured ones before anything is measured, s.
const PRIOR: f64 = 2.0;

impl<'a> Course<'a> {
    pub fn new(
        steps: Vec<Step>,
        limit: Option<TimeLimit>,
        kept: Option<Kept>,
        progress: &'a dyn Progress,
    ) -> Course<'a> {
        Course {
            progress,
            kept,
            steps,
            next: Cell::new(0),
            took: Cell::default(),
            slowdown: slowdown(),
            ended: Cell::new(Instant::now()),
            limit,
            taken_over: Cell::new(0),
            loads: Cell::new([f64::INFINITY, 0.0]),
            left_out: RefCell::default(),
            done: RefCell::default(),
        }
    }

    /// Words for the number of steps, and for the time they will take together.
    pub fn forecast(&self) -> String {
        let most = if self.limit.is_some() { "up to " } else { "" };
        format!("{most}{} steps, {}", self.steps.len(), rounded(self.seconds_left(0)))
    }

    /// Measured time of a step over the expected one: of its kind, and as long as little of its kind is known, of all.
    fn pace(&self, kind: StepKind) -> f64 {
        let took = self.took.get();
        let all = took.iter().fold([self.slowdown * PRIOR, PRIOR], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let [own, of_own] = took[kind as usize];
        (own + PRIOR * all[0] / all[1]) / (of_own + PRIOR)
    }

    /// The time left from a step on: that of all steps that may be done, within the limit, but no less than that of the necessary
    /// ones.
    fn seconds_left(&self, at: usize) -> f64 {
        let all = self.seconds_after(at, |step| self.may_be_done(step));
        self.limit.map_or(all, |limit| {
            let needed = self.seconds_after(at, |step| self.is_due(step));
            all.min(limit.seconds_left().max(needed))
        })
    }

    fn find(&self, key: &str) -> Option<usize> {
        let next = self.next.get();
        self.steps[next..].iter().position(|step| step.key == key).map(|at| next + at)
    }

    fn seconds_after(&self, at: usize, is_counted: impl Fn(&Step) -> bool) -> f64 {
        let rest = self.steps.get(at..).unwrap_or_default().iter().filter(|step| is_counted(step));
        rest.map(|step| step.seconds * self.pace(step.kind)).sum()
    }

    /// Whether a step is needed, or judges what was solved.
    fn is_due(&self, step: &Step) -> bool {
        let done = self.done.borrow();
        step.is_needed || done.iter().any(|&done| Step::errors(&self.steps[done].key) == step.key)
    }

    /// Whether a step is due, or still ahead; errors, with what they judge.
    fn may_be_done(&self, step: &Step) -> bool {
        let mut ahead = self.steps[self.next.get()..].iter();
        self.is_due(step)
            || match step.kind {
                StepKind::Errors => ahead.any(|of| Step::errors(&of.key) == step.key),
                _ => ahead.any(|of| of.key == step.key),
            }
    }

    /// Whether there is time for `seconds` of extra work before what must follow.
    pub fn has_time(&self, seconds: f64) -> bool {
        let needed = || self.seconds_after(self.next.get(), |step| self.is_due(step));
        self.limit.is_none_or(|limit| seconds + needed() <= limit.seconds_left())
    }

    /// Whether there is time for a step; where there is not, it is named among those left out. Errors of what was solved give way
    /// to what is needed alone: the first ones are measured, the last ones left out.
    pub fn affords(&self, key: &str) -> bool {
        let (Some(limit), Some(at)) = (self.limit, self.find(key)) else { return true };
        let step = &self.steps[at];
        if step.is_needed || self.kept.as_ref().is_some_and(|kept| kept.find(key).is_some()) {
            return true;
        }
        // What is solved is judged too.
        let judged = Step::errors(key);
        let own = self.seconds_after(at, |step| step.key == key || step.key == judged);
        let rest = self.seconds_after(at + 1, |other| match step.kind {
            StepKind::Errors => other.is_needed,
            _ => self.is_due(other),
        });
        let fits = own + rest <= limit.seconds_left();
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
        let left = at.map(|at| rounded(self.seconds_left(at)));
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
            self.ended.set(Instant::now());
            return Ok(value);
        }
        if let (Some(at), Some(left)) = (at, left) {
            self.progress.begin(&format!("{} of {}: {key}; {left} left", at + 1, self.steps.len()), 0);
        }
        let made = make(&Silent);
        let seconds = self.ended.replace(Instant::now()).elapsed().as_secs_f64();
        if at.is_some() {
            self.progress.end();
        }
        let value = made?;
        if let Some(at) = at {
            self.done.borrow_mut().push(at);
            let (mut took, step) = (self.took.get(), &self.steps[at]);
            let [own, expected] = took[step.kind as usize];
            took[step.kind as usize] = [own + seconds, expected + step.seconds];
            self.took.set(took);
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

    /// One sentence about what was left out for want of time.
    pub fn left_out(&self) -> Vec<String> {
        let left_out = self.left_out.borrow();
        let Some(limit) = self.limit.filter(|_| !left_out.is_empty()) else { return Vec::new() };
        vec![format!("Left out, to end within {:.0} s: {}.", limit.seconds, left_out.join("; "))]
    }

    /// One sentence about what was taken over from an earlier run.
    pub fn taken_over(&self) -> Option<String> {
        let count = self.taken_over.get();
        let [least, most] = self.loads.get();
        (count > 0).then(|| {
            format!(
                "{count} of {} steps are of a stopped run (load {least:.1} to {most:.1} then, {:.1} now). Their \
                 offline times are of that run.",
                self.steps.len(),
                load()
            )
        })
    }
}

/// Factor by which this machine is slower because of what else runs on it.
fn slowdown() -> f64 {
    let threads = rayon::current_num_threads().max(1) as f64;
    (2.0 / threads).max(0.5) * (1.0 + load() / threads)
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
    use crate::measure::course::StepKind::{Errors, Other, Solve};
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

    fn steps(all: &[(&str, StepKind, f64, bool)]) -> Vec<Step> {
        let step = |&(key, kind, seconds, is_needed): &(&str, StepKind, f64, bool)| Step {
            key: key.into(),
            kind,
            seconds,
            is_needed,
        };
        all.iter().map(step).collect()
    }

    fn within(seconds: f64) -> Option<TimeLimit> {
        Some(TimeLimit { from: Instant::now(), seconds })
    }

    /// A course as on an idle machine; `solved` are the measured and the expected seconds of direct solves.
    fn course<'a>(
        all: &[(&str, StepKind, f64, bool)],
        limit: Option<TimeLimit>,
        solved: [f64; 2],
        said: &'a Said,
    ) -> Course<'a> {
        let mut course = Course::new(steps(all), limit, None, said);
        course.slowdown = 1.0;
        let mut took = [[0.0; 2]; StepKind::COUNT];
        took[Solve as usize] = solved;
        course.took.set(took);
        course
    }

    #[test]
    fn steps_are_counted_with_the_time_that_is_left() {
        let said = Said::default();
        let all = [("a", Solve, 1e-9, true), ("b", Solve, 300.0, true), ("c", Solve, 299.0, true)];
        let course = course(&all, None, [400.0, 200.0], &said);
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

    /// Solves that were fast are weak evidence for the errors of slow ones.
    #[test]
    fn each_kind_has_a_pace_of_its_own() {
        let said = Said::default();
        let course = course(&[], None, [10.0, 100.0], &said);
        assert!((0.09..0.12).contains(&course.pace(Solve)), "{}", course.pace(Solve));
        assert!((course.pace(Errors) - 12.0 / 102.0).abs() < 1e-12, "{}", course.pace(Errors));
        let mut took = course.took.get();
        took[Errors as usize] = [300.0, 100.0];
        course.took.set(took);
        assert!((2.8..3.0).contains(&course.pace(Errors)) && course.pace(Solve) < 0.15);
    }

    #[test]
    fn what_does_not_fit_is_left_out_and_named() {
        let said = Said::default();
        let all = [("dear", Solve, 30.0, false), ("cheap", Solve, 5.0, false), ("needed", Other, 20.0, true)];
        let limited = course(&all, within(45.0), [100.0, 100.0], &said);
        assert_eq!(limited.forecast(), "up to 3 steps, some 45 s");
        assert!(!limited.affords("dear") && limited.affords("cheap") && limited.affords("needed"));
        assert_eq!(limited.left_out(), ["Left out, to end within 45 s: dear (some 30 s)."]);
        let free = course(&[("dear", Solve, 1e9, false)], None, [1.0, 1.0], &said);
        assert!(free.affords("dear") && free.left_out().is_empty());
        // What is needed is done and foreseen, however small the limit.
        let late = course(&all, within(10.0), [100.0, 100.0], &said);
        assert_eq!(late.forecast(), "up to 3 steps, some 20 s");
        assert!(late.affords("needed") && !late.has_time(1.0));
    }

    /// Errors that turn out slow are left out from the last ones on, and are then no part of the time left.
    #[test]
    fn errors_that_are_slower_than_foreseen_are_left_out() {
        let said = Said::default();
        let all = [
            ("a", Solve, 1.0, true),
            ("b", Solve, 1.0, false),
            ("errors of a", Errors, 1.0, true),
            ("errors of b", Errors, 1.0, false),
            ("times", Other, 1.0, true),
        ];
        let course = course(&all, within(20.0), [100.0, 100.0], &said);
        assert!(course.affords("b"));
        for key in ["a", "b", "errors of a"] {
            course.step_as_json(key, |_| Ok(1)).unwrap();
        }
        let mut took = course.took.get();
        took[Errors as usize] = [3000.0, 100.0];
        course.took.set(took);
        assert!(!course.affords("errors of b") && course.affords("times"));
        assert!(course.left_out()[0].contains("errors of b (some 30 s)"), "{:?}", course.left_out());
        course.step_as_json("times", |_| Ok(1)).unwrap();
        assert!(said.0.lock().unwrap().last().unwrap().starts_with("5 of 5: times; some "));
    }
}
