//! Decides who moves head and styli: a recording, a script, trackers, or mouse and keyboard.
//!
//! In: a stage's trackers, a script, and what a person does with mouse and keyboard. Out: one [`TrackerState`] a frame. A
//! recording leads alone. A script leads until a tracker has been seen, or a person presses a button or a key other than function
//! and modifier keys and the key for the next field; the script is then removed for good. After that trackers lead, and mouse and
//! keyboard move what they do not.

use super::recording::Replay;
use super::trackers::merge;
use crate::base::diagnostic::notice;
use crate::stage::Stage;
use crate::track::device::now_s;
use crate::track::doubts::{DoubtKind, doubts};
use crate::track::tracker_set::TrackerReport;
use crate::track::{Mouse, Script, TrackerSet, TrackerState};

/// All that may move a world; [`InputSource::leader`] names the part that does.
#[derive(Default)]
pub struct InputSource {
    pub replay: Option<Replay>,
    /// Tracked devices, where the stage names some.
    pub trackers: Option<TrackerSet>,
    pub script: Option<Script>,
    pub mouse: Option<Mouse>,
    /// Number of the script's round.
    round: u32,
    /// Time of the last state, s.
    last_s: f64,
    /// Sensors about which it was warned that they are far away.
    told_far: Vec<String>,
    /// Time of the next check of the sensors, s.
    next_look_s: f64,
}

/// The source that moves head and styli now.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Leader {
    Recording,
    Script,
    /// Trackers; mouse and keyboard move the rest.
    Trackers,
    Mouse,
    Nobody,
}

/// Time between two checks whether sensors are where anyone can be, s.
const LOOK_S: f64 = 1.0;

/// Change of the world at a script's end or new round, before the frame's state is applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScriptChange {
    /// The script is over: the hands let go of what it held.
    LetGo,
    /// The script begins a new round: bodies go back to rest.
    Reset,
}

impl InputSource {
    pub fn leader(&self) -> Leader {
        match self {
            InputSource { replay: Some(_), .. } => Leader::Recording,
            InputSource { script: Some(_), .. } => Leader::Script,
            InputSource { trackers: Some(trackers), .. } if trackers.has_spoken() => Leader::Trackers,
            InputSource { mouse: Some(_), .. } => Leader::Mouse,
            _ => Leader::Nobody,
        }
    }

    /// Words for the source that moves head and styli.
    pub fn describe(&self) -> &'static str {
        match self.leader() {
            Leader::Recording => "moved by a recording",
            Leader::Script => "moved by the script",
            Leader::Trackers if self.trackers.as_ref().is_some_and(TrackerSet::is_pointing) => {
                "moved by trackers"
            }
            Leader::Trackers => "moved by trackers, mouse and keyboard",
            Leader::Mouse | Leader::Nobody => "moved by mouse and keyboard",
        }
    }

    /// Lets a person take over from the script, if it leads.
    pub fn take_over(&mut self) -> Option<ScriptChange> {
        if self.leader() != Leader::Script {
            return None;
        }
        self.script.take().map(|_| ScriptChange::LetGo)
    }

    /// Head and styli at `time_s` since the start, and what has to be done with the world before they are applied. Until a
    /// tracker speaks, the script or else the mouse moves everything. Afterwards trackers move what they see and the mouse the
    /// rest.
    pub fn state(&mut self, stage: &Stage, time_s: f64) -> (TrackerState, Vec<ScriptChange>) {
        let mut changes = Vec::new();
        let step_s = (time_s - self.last_s).max(0.0);
        self.last_s = time_s;
        let tracked = self.trackers.as_mut().map(|trackers| trackers.state(now_s()));
        if let (Some(tracked), Some(mouse)) = (&tracked, &mut self.mouse) {
            mouse.tracked_head = tracked.head.map(|head| head.cast());
        }
        let mut state = match (&self.script, &mut self.mouse) {
            (Some(script), _) => {
                let (round, in_round_s) = script.round_at(time_s);
                if std::mem::replace(&mut self.round, round) != round {
                    changes.push(ScriptChange::Reset);
                }
                script.sample(stage, in_round_s)
            }
            (None, Some(mouse)) => {
                mouse.advance(step_s);
                mouse.state(time_s)
            }
            (None, None) => TrackerState { time_s, ..TrackerState::default() },
        };
        if let Some((trackers, tracked)) = self.trackers.as_mut().zip(tracked) {
            // Trackers that were never seen add no styli to those of a script.
            if trackers.has_spoken() || self.script.is_none() {
                state = merge(tracked, state);
            }
            for told in trackers.take_notices() {
                notice!("note: {told}");
            }
            if now_s() >= self.next_look_s {
                self.next_look_s = now_s() + LOOK_S;
                let doubts = doubts(stage, &trackers.report(now_s())).into_iter();
                for doubt in doubts.filter(|doubt| matches!(doubt.kind, DoubtKind::Far | DoubtKind::Number)) {
                    if !self.told_far.contains(&doubt.sensor) {
                        notice!("warning: {}", doubt.text);
                        self.told_far.push(doubt.sensor);
                    }
                }
            }
            if trackers.has_spoken() {
                changes.extend(self.take_over());
            }
        }
        (state, changes)
    }

    /// The loads that the script sets at `time_s`, while it leads.
    pub fn loads(&self, time_s: f64) -> Vec<(String, f64)> {
        let leads = self.leader() == Leader::Script;
        let Some(script) = self.script.as_ref().filter(|_| leads) else { return Vec::new() };
        let loads = script.loads(script.round_at(time_s).1);
        loads.map(|(name, value)| (name.to_owned(), value)).collect()
    }

    /// The reports of the trackers about all their sensors.
    pub fn tracker_reports(&mut self) -> Vec<TrackerReport> {
        self.trackers.as_mut().map(|trackers| trackers.report(now_s())).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::FakeSource;
    use nalgebra::Isometry3;
    use std::path::Path;

    /// The stage's silent styli stood before the script's, so that a tool on stylus 1 did not move.
    #[test]
    fn a_script_moves_the_stylus_of_its_name_while_trackers_are_silent() {
        let keys = "[tracker.a]\nosc = \"0\"\n[sensor.wand]\ntracker = \"a\"\nid = 1\n\
                    [stylus.right]\nsensor = \"wand\"\n";
        let text = format!("{}{keys}", crate::stage::BUILT_IN[0].1);
        let stage = Stage::parse(&text, Path::new("a.toml")).unwrap();
        let script = "frame = \"room\"\n[[key]]\ntime = 0.0\nstylus.right = { position = [0, 1, 0], direction = [0, 0, -1] }\n";
        let source = FakeSource::default();
        let sources: Vec<Box<dyn crate::track::Source>> = vec![Box::new(source.clone())];
        let mut input = InputSource {
            trackers: Some(TrackerSet::with_sources(&stage.tracking, sources, now_s())),
            script: Some(Script::parse(script, Path::new("s.toml")).unwrap()),
            ..InputSource::default()
        };
        let mut heights = || {
            let (state, changes) = input.state(&stage, 0.0);
            let heights: Vec<f32> =
                state.styli.iter().map(|stylus| stylus.room_from_stylus.translation.y).collect();
            (heights, changes)
        };
        assert_eq!(heights(), (vec![1.0], vec![]));
        source.change(|state| state.take_pose(1, Isometry3::translation(0.0, 1.5, 0.0), None, 1.0));
        assert_eq!(heights(), (vec![1.5], vec![ScriptChange::LetGo]));
    }
}
