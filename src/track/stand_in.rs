//! A script that stands in for a stage's trackers: for tests, and to try a bench, with its calibration, before its trackers
//! are there.
//!
//! In: a script and a stage. Out: a [`DeviceState`] for each device that the stage's trackers listen to, in its own frame and
//! unit: `room_from_tracker` and `sensor_from_body` are undone, so that whoever applies them gets the script's poses. A
//! stage without trackers has one device, `Tracker0`, in the room's frame: sensor 0 is the head, sensor 1 + i stylus i, buttons
//! 2 i and 2 i + 1 are its grab and its second button.
//!
//! [`FakeSource`] is a source for tests that reports what the test sets.

use super::device::{DeviceState, Link, Source, now_s};
use super::script::Script;
use super::vrpn::Address;
use crate::stage::Stage;
use crate::stage::tracking::{ButtonId, Sensor, Stylus, Tracker, TrackerFrame, TrackerSource, Tracking};
use nalgebra::Isometry3;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Plays a script repeatedly, from the first call of [`StandIn::take_due`] on.
pub struct StandIn {
    pub devices: Vec<Device>,
    /// Heads and styli of the script for which the stage has no sensor.
    pub left_out: Vec<String>,
    script: Script,
    stage: Stage,
    rate_hz: f64,
    head: Option<Seat>,
    hands: Vec<Hand>,
    started_s: Option<f64>,
    readings: u64,
}

/// One device, as its server names it.
pub struct Device {
    pub name: String,
    /// The stage's trackers that listen to it.
    pub trackers: Vec<String>,
    pub state: DeviceState,
}

/// The sensor of a head or a stylus.
struct Seat {
    device: usize,
    id: i32,
    frame: TrackerFrame,
    body_from_sensor: Isometry3<f64>,
}

/// A stylus of the script: its place among the script's, its name, sensor, and both buttons as device and number.
struct Hand {
    index: usize,
    name: String,
    seat: Seat,
    buttons: [Option<(usize, i32)>; 2],
}

/// The device of a stage without trackers.
const USUAL_DEVICE: &str = "Tracker0";

impl StandIn {
    pub fn new(script: Script, stage: Stage, rate_hz: f64) -> StandIn {
        let mut made = StandIn {
            devices: Vec::new(),
            left_out: Vec::new(),
            script,
            stage,
            rate_hz,
            head: None,
            hands: Vec::new(),
            started_s: None,
            readings: 0,
        };
        let names: Vec<String> = made.script.stylus_names(&made.stage).map(str::to_owned).collect();
        let has_head = made.script.sample(&made.stage, 0.0).head.is_some();
        match made.stage.tracking.trackers.values().any(has_table) {
            true => made.follow_stage(names, has_head),
            false => made.follow_room(names, has_head),
        }
        made
    }

    /// The meaning of each number: `Tracker0: sensor 0 is the head`, and so on.
    pub fn legend(&self) -> Vec<String> {
        let device = |index: usize| &self.devices[index].name;
        let of = |seat: &Seat| format!("{}: sensor {} is ", device(seat.device), seat.id);
        let mut lines: Vec<String> = self.head.iter().map(|seat| of(seat) + "the head").collect();
        for Hand { name, seat, buttons, .. } in &self.hands {
            let mut line = of(seat) + &format!("stylus {name}");
            for (button, what) in buttons.iter().zip(["its grab", "its second button"]) {
                if let Some((at, number)) = button {
                    line += &format!("; button {number} of {} is {what}", device(*at));
                }
            }
            lines.push(line);
        }
        lines
    }

    /// Takes the reading that is due by now, if one is.
    pub fn take_due(&mut self) {
        let now = now_s();
        let since_s = now - *self.started_s.get_or_insert(now);
        let due = (since_s * self.rate_hz) as u64 + 1;
        if due > self.readings {
            self.readings = due;
            self.take(self.script.round_at(since_s).1);
        }
    }

    fn take(&mut self, time_s: f64) {
        let state = self.script.sample(&self.stage, time_s);
        let devices = &mut self.devices;
        let mut sit = |seat: &Seat, room_from_body: Isometry3<f64>| {
            let pose = seat.frame.tracker_from_sensor(&(room_from_body * seat.body_from_sensor));
            devices[seat.device].state.take_pose(seat.id, pose, None, 1.0);
        };
        if let (Some(seat), Some(head)) = (&self.head, state.head) {
            sit(seat, head.cast());
        }
        for hand in &self.hands {
            let Some(stylus) = state.styli.get(hand.index) else { continue };
            sit(&hand.seat, stylus.room_from_stylus.cast());
        }
        for hand in &self.hands {
            let Some(stylus) = state.styli.get(hand.index) else { continue };
            for (button, pressed) in hand.buttons.iter().zip([stylus.pressed, stylus.second]) {
                if let Some((device, number)) = button {
                    self.devices[*device].state.take_button(*number, pressed, None);
                }
            }
        }
        for Device { state, .. } in &mut self.devices {
            state.counters.packets += 1;
            state.counters.messages += 1;
        }
    }

    /// One device in the room's frame.
    fn follow_room(&mut self, styli: Vec<String>, has_head: bool) {
        let device = self.device(USUAL_DEVICE, None);
        let seat = |id: i32| Seat {
            device,
            id,
            frame: TrackerFrame::default(),
            body_from_sensor: Isometry3::identity(),
        };
        self.head = has_head.then(|| seat(0));
        let hands = (0..).zip(styli).map(|(i, name)| {
            let buttons = [Some((device, 2 * i)), Some((device, 2 * i + 1))];
            Hand { index: i as usize, name, seat: seat(i + 1), buttons }
        });
        self.hands = hands.collect();
    }

    /// The devices of the stage's trackers. A stylus of the script moves the stage's of its name, else the first that
    /// nothing moves.
    fn follow_stage(&mut self, styli: Vec<String>, has_head: bool) {
        let tracking = self.stage.tracking.clone();
        let named = tracking.trackers.iter().zip(device_names(&tracking));
        let served: BTreeMap<&str, usize> = named
            .filter(|((_, tracker), _)| has_table(tracker))
            .map(|((name, _), device)| (name.as_str(), self.device(&device, Some(name))))
            .collect();
        let seat = |sensor: &Sensor| {
            let device = *served.get(sensor.tracker.as_str())?;
            let frame = tracking.trackers.get(&sensor.tracker)?.frame;
            let body_from_sensor = sensor.sensor_from_body.inverse();
            Some(Seat { device, id: sensor.id, frame, body_from_sensor })
        };
        let seat_of = |name: &String| seat(tracking.sensors.get(name)?);
        self.head = tracking.head.as_ref().filter(|_| has_head).and_then(seat_of);
        if has_head && self.head.is_none() {
            self.left_out.push("the head: the stage's viewer has no `head`".into());
        }
        let mut free: Vec<(&String, &Stylus)> = tracking.styli.iter().collect();
        for (index, script_name) in styli.into_iter().enumerate() {
            let own = free.iter().position(|(name, _)| **name == script_name);
            let next = own.or((!free.is_empty()).then_some(0));
            let found = next.map(|k| free.remove(k)).and_then(|(name, stylus)| {
                let button = |id: &Option<ButtonId>| {
                    id.as_ref().and_then(|id| Some((*served.get(id.tracker.as_str())?, id.button)))
                };
                let buttons = [button(&stylus.grab), button(&stylus.second)];
                Some(Hand { index, name: name.clone(), seat: seat_of(&stylus.sensor)?, buttons })
            });
            match found {
                Some(hand) => self.hands.push(hand),
                None => self.left_out.push(format!("stylus {script_name}: the stage has no [stylus] for it")),
            }
        }
    }

    /// The index of the device of this name, which is added if it is not there.
    fn device(&mut self, name: &str, tracker: Option<&str>) -> usize {
        let index = self.devices.iter().position(|device| device.name == name).unwrap_or_else(|| {
            let state = DeviceState { link: Link::Up, ..DeviceState::default() };
            self.devices.push(Device { name: name.to_owned(), trackers: Vec::new(), state });
            self.devices.len() - 1
        });
        self.devices[index].trackers.extend(tracker.map(str::to_owned));
        index
    }
}

fn has_table(tracker: &Tracker) -> bool {
    matches!(tracker.source, TrackerSource::Table(_))
}

/// The devices as which a stage's trackers are passed on, in their order: each as that of its VRPN address, or by the tracker's
/// own name where it has none, or where another address or tracker has that device's name.
pub fn device_names(tracking: &Tracking) -> Vec<String> {
    let mut passed: Vec<(Option<Address>, String)> = Vec::new();
    for (name, tracker) in &tracking.trackers {
        let address = vrpn_address(tracker);
        let same = passed.iter().find(|(other, _)| other.is_some() && *other == address);
        let is_free = |device: &String| {
            let is_passed = passed.iter().any(|(_, other)| other == device);
            !is_passed && (device == name || !tracking.trackers.contains_key(device))
        };
        let own = address.iter().map(|address| &address.device).find(|device| is_free(device));
        let device = same.map(|(_, device)| device).or(own).unwrap_or(name).clone();
        passed.push((address, device));
    }
    passed.into_iter().map(|(_, device)| device).collect()
}

fn vrpn_address(tracker: &Tracker) -> Option<Address> {
    match &tracker.source {
        TrackerSource::Table(table) => Address::parse(table.keys.get("vrpn")?.as_str()?).ok(),
        TrackerSource::Haptic(_) => None,
    }
}

/// A source without a device; clones report the same state.
#[derive(Clone, Default)]
pub struct FakeSource {
    shared: Arc<Mutex<DeviceState>>,
    latest: DeviceState,
}

impl FakeSource {
    /// Changes what the source reports from now on.
    pub fn change(&self, change: impl FnOnce(&mut DeviceState)) {
        change(&mut self.shared.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Source for FakeSource {
    fn describe(&self) -> String {
        "fake source".into()
    }

    fn latest(&mut self) -> &DeviceState {
        self.latest.clone_from(&self.shared.lock().unwrap_or_else(PoisonError::into_inner));
        &self.latest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::BUILT_IN;
    use crate::track::tracker_set::TrackerSet;
    use crate::track::{FakeSource, Source};
    use nalgebra::Vector3;
    use std::path::Path;

    /// Inches, z up, the head's sensor above and behind the eyes; the stylus by a left-handed tracker, its button by a pad.
    const KEYS: &str = r#"
    [tracker.lab]
    vrpn = "Head3@tracker.lab"
    room_from_tracker = { position = [0.3, 0.1, -0.2], axes = [[1, 0, 0], [0, 0, -1], [0, 1, 0]], scale = 0.0254 }
    [tracker.hands]
    dtrack = "0.0.0.0:5000"
    room_from_tracker = { position = [0.0, 0.9, 0.6], rotation_degrees = [0, 30, 0], mirror = "z" }
    [tracker.pad]
    gamepad = "/dev/input/js0"
    [sensor.head]
    tracker = "lab"
    id = 4
    body_from_sensor = { position = [0.0, 0.10, 0.03], axes = [[1, 0, 0], [0, 0, -1], [0, 1, 0]] }
    [sensor.wand]
    tracker = "hands"
    id = 1000
    sensor_from_body = { position = [0.0, 0.0, -0.1], rotation_degrees = [0, 0, 20] }
    [stylus.pen]
    sensor = "wand"
    grab = { tracker = "pad", button = 7 }
    "#;

    fn bench(keys: &str) -> Stage {
        let text = BUILT_IN[0].1.replacen("[viewer]", "[viewer]\nhead = \"head\"", 1);
        Stage::parse(&format!("{text}{keys}"), Path::new("bench.toml")).unwrap()
    }

    /// The readings that the stand-in serves come out of the bench's own calibration as the script has them.
    #[test]
    fn the_calibration_is_undone() {
        let stage = bench(KEYS);
        let script = Script::find("bend").unwrap();
        let mut stand_in = StandIn::new(script.clone(), stage.clone(), 120.0);
        let names: Vec<&str> = stand_in.devices.iter().map(|device| device.name.as_str()).collect();
        assert_eq!(names, ["Head3", "hands", "pad"]);
        assert!(stand_in.left_out.is_empty(), "{:?}", stand_in.left_out);
        let legend = stand_in.legend().join("\n");
        assert!(legend.contains("Head3: sensor 4 is the head"), "{legend}");
        assert!(legend.contains("hands: sensor 1000 is stylus pen; button 7 of pad is its grab"), "{legend}");
        for time_s in [0.0, 1.3, 2.6] {
            let expected = script.sample(&stage, time_s);
            stand_in.take(time_s);
            let sources = stand_in.devices.iter().map(|device| {
                let source = FakeSource::default();
                source.change(|state| state.clone_from(&device.state));
                Box::new(source) as Box<dyn Source>
            });
            let mut trackers = TrackerSet::with_sources(&stage.tracking, sources.collect(), now_s());
            let state = trackers.state(now_s());
            let off =
                |a: &Isometry3<f32>, b: &Isometry3<f32>| (a.to_homogeneous() - b.to_homogeneous()).amax();
            assert!(off(&state.head.unwrap(), &expected.head.unwrap()) < 1e-5, "{time_s} s");
            let [a, b] = [&state.styli[0], &expected.styli[0]];
            assert!(off(&a.room_from_stylus, &b.room_from_stylus) < 1e-5, "{time_s} s");
            assert_eq!(stand_in.devices[2].state.buttons[&7].value, b.pressed);
        }
        let inches = stand_in.devices[0].state.sensors[&4].value.translation.vector;
        assert!(inches.norm() > 30.0, "a head stands tens of inches from the tracker: {inches}");
        assert!((inches - Vector3::zeros()).iter().all(|x| x.is_finite()));
    }

    /// Devices of one name on several hosts became one, whose sensors overwrote each other.
    #[test]
    fn trackers_share_a_device_only_at_the_same_address() {
        let text = [("a", "Tracker0@x"), ("b", "Tracker0@y"), ("c", "Tracker0@x:3883"), ("d", "a@z")]
            .map(|(name, address)| format!("[tracker.{name}]\nvrpn = \"{address}\"\n"))
            .concat();
        let stage = Stage::parse(&format!("{}{text}", BUILT_IN[0].1), Path::new("bench.toml")).unwrap();
        assert_eq!(device_names(&stage.tracking), ["Tracker0", "b", "Tracker0", "d"]);
        let stand_in = StandIn::new(Script::find("bend").unwrap(), stage, 120.0);
        let listening: Vec<String> =
            stand_in.devices.iter().map(|device| device.trackers.join(" ")).collect();
        assert_eq!(listening, ["a c", "b", "d"]);
    }

    #[test]
    fn without_trackers_there_is_one_device_in_the_room() {
        let stage = Stage::find("workbench").unwrap();
        let script = Script::find("bend").unwrap();
        let mut stand_in = StandIn::new(script.clone(), stage.clone(), 120.0);
        stand_in.take_due();
        let [Device { name, trackers, state }] = &stand_in.devices[..] else { panic!("one device") };
        assert!(name == "Tracker0" && trackers.is_empty());
        let head = script.sample(&stage, 0.0).head.unwrap().translation.vector.cast::<f64>();
        assert!((state.sensors[&0].value.translation.vector - head).norm() < 1e-6);
        assert!(state.sensors.contains_key(&1) && state.buttons.contains_key(&0));
    }

    #[test]
    fn what_the_stage_has_no_sensor_for_is_told() {
        let text = BUILT_IN[0].1.to_owned() + "[tracker.lab]\nvrpn = \"Tracker0@lab\"\n";
        let stage = Stage::parse(&text, Path::new("bench.toml")).unwrap();
        let stand_in = StandIn::new(Script::find("bend").unwrap(), stage, 120.0);
        assert_eq!(stand_in.left_out.len(), 2, "{:?}", stand_in.left_out);
        assert!(stand_in.left_out[1].contains("stylus hand"), "{:?}", stand_in.left_out);
    }
}
