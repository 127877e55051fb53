//! All trackers of a stage together: from the newest state of each source to one [`TrackerState`] for any time.
//!
//! In: a stage's [`Tracking`], and the running sources. Out: head and styli in the room, calibrated, filtered and predicted,
//! with a policy for sensors that are not tracked; and a report on every sensor, button and valuator.
//!
//! ```text
//! source → DeviceState → Follower (calibration → jumps held back → One Euro → prediction → bridge) → TrackerState
//! ```

mod clock;
mod follower;
mod motion;
mod one_euro;
mod report;

pub use clock::DeviceClock;
pub use follower::{Event, Follower, SensorFaults};
pub use motion::Motion;
pub use one_euro::PoseFilter;
pub use report::{ChannelReport, SensorReport, TrackerReport};

use super::device::{DeviceState, Link, Source, now_s};
use super::state::{Signal, StylusState, TrackerState};
use crate::stage::Tracking;
use crate::stage::tracking::{ButtonId, TrackerFrame, TrackerSource};
use nalgebra::Isometry3;

/// The running trackers of a stage; their sources stop when it is dropped.
pub struct TrackerSet {
    trackers: Vec<Running>,
    sensors: Vec<Followed>,
    /// Index of the head's sensor.
    head: Option<usize>,
    styli: Vec<Hand>,
    notices: Vec<String>,
}

struct Running {
    name: String,
    source: Box<dyn Source>,
    frame: TrackerFrame,
    link: Link,
    reconnects: u64,
    was_there: bool,
    /// The time since which it has been connected; `None` if it is not.
    there_since_s: Option<f64>,
}

struct Followed {
    name: String,
    tracker: usize,
    follower: Follower,
    pose: Option<Isometry3<f64>>,
}

struct Hand {
    name: String,
    sensor: usize,
    /// The one that grabs, and the second one.
    buttons: [Option<HandButton>; 2],
}

struct HandButton {
    tracker: usize,
    number: i32,
    /// After the stylus or the button's tracker was lost, it counts again only once it was seen released.
    must_release: bool,
}

impl HandButton {
    /// Whether it is down and counts. A button of a tracker that is not connected is up.
    fn is_pressed(&mut self, tracker: &mut Running, is_lost: bool, now_s: f64) -> bool {
        let greets = tracker.there_since_s.is_none_or(|since_s| now_s - since_s < GREETING_S);
        let state = tracker.source.latest();
        let is_down =
            is_there(&state.link) && state.buttons.get(&self.number).is_some_and(|reading| reading.value);
        self.must_release = is_lost || greets || self.must_release && is_down;
        is_down && !self.must_release
    }
}

/// A tracker that has just connected reports within this time which buttons are down, s: these were not pressed now.
const GREETING_S: f64 = 0.1;
/// The most notices that are kept.
const MOST_NOTICES: usize = 64;

impl TrackerSet {
    /// Opens all sources that a stage names, each by `open` ([`super::open()`] opens all but force devices); `None` if the
    /// stage names none, and then there is no thread and no socket.
    pub fn start<E>(
        tracking: &Tracking,
        mut open: impl FnMut(&str, &TrackerSource) -> Result<Box<dyn Source>, E>,
    ) -> Result<Option<TrackerSet>, E> {
        if tracking.trackers.is_empty() {
            return Ok(None);
        }
        let sources = tracking
            .trackers
            .iter()
            .map(|(name, tracker)| open(name, &tracker.source))
            .collect::<Result<Vec<_>, E>>()?;
        Ok(Some(TrackerSet::with_sources(tracking, sources, now_s())))
    }

    /// A set with running sources, one for each of `tracking.trackers` in their order.
    pub fn with_sources(tracking: &Tracking, sources: Vec<Box<dyn Source>>, now_s: f64) -> TrackerSet {
        // In a checked `Tracking` all names are known.
        let tracker_of = |name: &str| tracking.trackers.get_index_of(name);
        let sensor_of = |name: &str| tracking.sensors.get_index_of(name);
        let sensors = tracking.sensors.iter().filter_map(|(name, sensor)| {
            let frame = tracking.trackers.get(&sensor.tracker)?.frame;
            Some(Followed {
                name: name.clone(),
                tracker: tracker_of(&sensor.tracker)?,
                follower: Follower::new(sensor.clone(), frame, now_s),
                pose: None,
            })
        });
        let button = |id: &Option<ButtonId>| {
            let id = id.as_ref()?;
            Some(HandButton { tracker: tracker_of(&id.tracker)?, number: id.button, must_release: true })
        };
        let styli = tracking.styli.iter().filter_map(|(name, stylus)| {
            Some(Hand {
                name: name.clone(),
                sensor: sensor_of(&stylus.sensor)?,
                buttons: [button(&stylus.grab), button(&stylus.second)],
            })
        });
        TrackerSet {
            trackers: tracking
                .trackers
                .iter()
                .zip(sources)
                .map(|((name, tracker), source)| Running {
                    name: name.clone(),
                    source,
                    frame: tracker.frame,
                    link: Link::Waiting,
                    reconnects: 0,
                    was_there: false,
                    there_since_s: None,
                })
                .collect(),
            sensors: sensors.collect(),
            head: tracking.head.as_deref().and_then(sensor_of),
            styli: styli.collect(),
            notices: Vec::new(),
        }
    }

    /// Head and styli at `now_s` (the clock of [`now_s`]), predicted as each sensor's `predict` says.
    ///
    /// The head is `None` until its sensor was tracked; until then the stage's viewer holds. A lost stylus has its last pose,
    /// [`Signal::Lost`], and no button pressed. After it came back, or after a button's tracker was gone, that button counts
    /// only once it was seen released.
    pub fn state(&mut self, now_s: f64) -> TrackerState {
        self.update(now_s);
        let head = self.head().map(|pose| pose.cast());
        let mut styli = Vec::with_capacity(self.styli.len());
        for hand in &mut self.styli {
            let followed = &self.sensors[hand.sensor];
            let signal = followed.follower.signal;
            let is_lost = matches!(signal, Signal::Lost { .. });
            let [pressed, second] = hand.buttons.each_mut().map(|button| {
                button.as_mut().is_some_and(|button| {
                    button.is_pressed(&mut self.trackers[button.tracker], is_lost, now_s)
                })
            });
            styli.push(StylusState {
                room_from_stylus: followed.pose.unwrap_or_else(Isometry3::identity).cast(),
                pressed,
                second,
                signal,
                from_eye: false,
            });
        }
        TrackerState { head, styli, time_s: now_s }
    }

    /// The head's pose at the last call of [`TrackerSet::state`]; `None` if it is not tracked.
    pub fn head(&self) -> Option<Isometry3<f64>> {
        self.sensors[self.head?].pose
    }

    /// Whether any stylus is tracked, or was until a moment ago.
    pub fn is_pointing(&self) -> bool {
        let is_seen = |hand: &Hand| !matches!(self.sensors[hand.sensor].follower.signal, Signal::Lost { .. });
        self.styli.iter().any(is_seen)
    }

    /// Whether any sensor was ever tracked.
    pub fn has_spoken(&self) -> bool {
        self.sensors.iter().any(|followed| followed.pose.is_some())
    }

    /// Notices since the last call, one for each event: sensors lost and found again, links that broke or came back.
    pub fn take_notices(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notices)
    }

    /// The newest raw state of every tracker, for passing them on.
    pub fn devices(&mut self) -> impl Iterator<Item = &DeviceState> {
        self.trackers.iter_mut().map(|running| running.source.latest())
    }

    /// Names of the styli, in the order of [`TrackerState::styli`].
    pub fn stylus_names(&self) -> impl Iterator<Item = &str> {
        self.styli.iter().map(|hand| hand.name.as_str())
    }

    /// A report on every tracker at `now_s`, with the newest states of the sources.
    pub fn report(&mut self, now_s: f64) -> Vec<TrackerReport> {
        self.update(now_s);
        let mut reports = Vec::with_capacity(self.trackers.len());
        for (index, running) in self.trackers.iter_mut().enumerate() {
            let source = running.source.describe();
            let state = running.source.latest();
            let named: Vec<_> = self.sensors.iter().filter(|followed| followed.tracker == index).collect();
            let mut sensors: Vec<SensorReport> = named
                .iter()
                .map(|followed| {
                    let follower = &followed.follower;
                    let reading = state.sensors.get(&follower.sensor.id);
                    SensorReport {
                        name: Some(followed.name.clone()),
                        in_room: followed.pose,
                        signal: follower.signal,
                        faults: follower.faults,
                        ..report::sensor(follower.sensor.id, reading, now_s)
                    }
                })
                .collect();
            let is_named = |id: i32| named.iter().any(|followed| followed.follower.sensor.id == id);
            let unnamed = state.sensors.iter().filter(|(id, _)| !is_named(**id));
            sensors.extend(unnamed.map(|(id, reading)| {
                let report = report::sensor(*id, Some(reading), now_s);
                let in_room = report.raw.map(|raw| running.frame.room_from_sensor(&raw));
                SensorReport { in_room, ..report }
            }));
            reports.push(TrackerReport {
                name: running.name.clone(),
                source,
                link: state.link.clone(),
                counters: state.counters,
                sensors,
                buttons: report::channels(&state.buttons, now_s),
                valuators: report::channels(&state.valuators, now_s),
            });
        }
        reports
    }

    /// Takes the newest states of the sources.
    fn update(&mut self, now_s: f64) {
        for (index, running) in self.trackers.iter_mut().enumerate() {
            let state = running.source.latest();
            for followed in self.sensors.iter_mut().filter(|followed| followed.tracker == index) {
                if let Some(reading) = state.sensors.get(&followed.follower.sensor.id) {
                    followed.follower.take(reading);
                }
            }
            let is_anew = state.counters.reconnects != running.reconnects;
            running.reconnects = state.counters.reconnects;
            let since_s = running.there_since_s.filter(|_| !is_anew).unwrap_or(now_s);
            running.there_since_s = is_there(&state.link).then_some(since_s);
            if state.link != running.link {
                let what = match &state.link {
                    Link::Down(why) if running.link == Link::Waiting => {
                        Some(format!("not there: {why}; it is tried again"))
                    }
                    Link::Down(why) => Some(format!("gone: {why}; it is tried again")),
                    Link::Up if matches!(running.link, Link::Down(_)) => {
                        Some(if running.was_there { "back" } else { "there now" }.to_owned())
                    }
                    _ => None,
                };
                running.link.clone_from(&state.link);
                running.was_there |= is_there(&state.link);
                if let Some(what) = what {
                    let source = running.source.describe();
                    push(&mut self.notices, format!("tracker {} ({source}) is {what}", running.name));
                }
            }
        }
        for (index, followed) in self.sensors.iter_mut().enumerate() {
            let (pose, event) = followed.follower.pose(now_s);
            let is_first = followed.pose.is_none();
            followed.pose = pose;
            let Some(event) = event else { continue };
            let Followed { name, follower, .. } = followed;
            let who = format!("sensor {name} (number {} of {})", follower.sensor.id, follower.sensor.tracker);
            push(
                &mut self.notices,
                match event {
                    Event::Lost { age_s } if pose.is_none() => {
                        format!("{who} was not heard of in {age_s:.1} s")
                    }
                    Event::Lost { age_s } => {
                        let hand = self.styli.iter().find(|hand| hand.sensor == index);
                        let then = match hand {
                            Some(hand) => {
                                format!("stylus {} lets go, and is gone until it is back", hand.name)
                            }
                            None => "its last pose is held".to_owned(),
                        };
                        format!("{who} was not seen for {age_s:.1} s: {then}")
                    }
                    Event::Back { gap_s } if is_first => {
                        format!("{who} is seen for the first time, after {gap_s:.1} s")
                    }
                    Event::Back { gap_s } => format!("{who} is back after {gap_s:.1} s"),
                },
            );
        }
    }
}

fn push(notices: &mut Vec<String>, notice: String) {
    if notices.len() < MOST_NOTICES {
        // Text from a device or a peer must not send control characters to a terminal.
        notices.push(notice.replace(char::is_control, "?"));
    }
}

fn is_there(link: &Link) -> bool {
    matches!(link, Link::Up | Link::Quiet)
}

#[cfg(test)]
mod tests;
