//! A script played as a tracker: for tests, and for demonstrations that move a stylus without a person.
//!
//! In: a script and the stage whose workspace it refers to. Out: sensor 0 is the head, sensor 1 + i the stylus i, in
//! the room's frame; buttons 2 i and 2 i + 1 are its grab and its second button.

use super::device::{DeviceState, Link, Source, now_s};
use super::script::Script;
use crate::stage::Stage;

/// Plays a script repeatedly, from the first call of `latest` on.
pub struct ScriptSource {
    pub script: Script,
    pub stage: Stage,
    pub rate_hz: f64,
    name: String,
    state: DeviceState,
    started_s: Option<f64>,
    readings: u64,
}

/// The pause between two rounds of the script, s.
const PAUSE_S: f64 = 1.0;

impl ScriptSource {
    pub fn new(name: &str, script: Script, stage: Stage, rate_hz: f64) -> ScriptSource {
        let state = DeviceState { link: Link::Up, ..Default::default() };
        ScriptSource { script, stage, rate_hz, name: name.to_owned(), state, started_s: None, readings: 0 }
    }

    /// What each number means: `sensor 0: head`, and so on.
    pub fn legend(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let state = self.script.sample(&self.stage, 0.0);
        if state.head.is_some() {
            lines.push("sensor 0: head".to_owned());
        }
        for (stylus, name) in self.script.stylus_names(&self.stage).enumerate() {
            lines.push(format!("sensor {}: stylus {name}; button {}: its grab", stylus + 1, 2 * stylus));
        }
        lines
    }

    fn take(&mut self, time_s: f64) {
        let state = self.script.sample(&self.stage, time_s);
        if let Some(head) = state.head {
            self.state.take_pose(0, head.cast(), None, 1.0);
        }
        for (stylus, state) in (0..).zip(&state.styli) {
            self.state.take_pose(stylus + 1, state.room_from_stylus.cast(), None, 1.0);
            self.state.take_button(2 * stylus, state.pressed, None);
            self.state.take_button(2 * stylus + 1, state.second, None);
        }
        self.state.counters.packets += 1;
        self.state.counters.messages += 1;
    }
}

impl Source for ScriptSource {
    fn describe(&self) -> String {
        format!("script {}", self.name)
    }

    fn latest(&mut self) -> &DeviceState {
        let now = now_s();
        let since_s = now - *self.started_s.get_or_insert(now);
        let due = (since_s * self.rate_hz) as u64 + 1;
        if due > self.readings {
            self.readings = due;
            self.take(since_s.rem_euclid(self.script.duration_s + PAUSE_S));
        }
        &self.state
    }
}
