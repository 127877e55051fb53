//! Scripts of key frames that move a head and styli, for demonstrations and tests without a person.
//!
//! In: a strict TOML file. Out: the [`TrackerState`] at any time, on any stage. Between key frames motion is
//! smooth and never overshoots; before the first and after the last it rests.
//!
//! ```toml
//! frame = "workspace"       # or "room": metres in the room
//! [[key]]
//! time = 0.0                # seconds, strictly increasing
//! head = { offset = [0.0, 0.0, 0.0] }
//! stylus.right = { position = [0.9, 0.7, 0.8], target = [0.9, 0.0, 0.0] }
//! [[key]]
//! time = 1.0
//! stylus.right = { pressed = true }
//! ```
//!
//! | key | meaning |
//! |---|---|
//! | `frame` | `workspace`: the room's axes, origin at the middle of the ball that the bodies fill, unit its radius, so that one script serves all stages. It is the stage's workspace; where bodies had to be put higher or made smaller to be seen, the ball is moved and scaled with them |
//! | `position` | place, in the frame |
//! | `target`, `direction`, `rotation` | orientation: -z towards a place, or along a direction, or a rotation vector in radians; one of them |
//! | `roll` | with target or direction: radians about the -z axis |
//! | `pressed`, `second` | the stylus' buttons, from this key frame on |
//! | `load.NAME`, `load."BODY.NAME"` | what a load of the scene comes to, as in pose files: N, N·m, Pa, rad/s or kelvins; linear between key frames |
//! | `head.offset` | instead of all those: metres in the room's axes from where the stage has the viewer, looking as there |
//!
//! The first key frame must state everything that the script moves; later ones state only what changes.

use super::interpolate::{interpolate, locate};
use super::state::{StylusState, TrackerState};
use crate::config::{self, ConfigError};
use crate::stage::{ROOM_LIMIT_M, Stage, Workspace, rotation_towards};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// A checked script: head and styli have a value at every key time.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    pub frame: Frame,
    /// The ball that the bodies fill where they stand; `None` for the stage's workspace.
    pub filled: Option<Workspace>,
    /// Time of the last key frame.
    pub duration_s: f64,
    times_s: Vec<f64>,
    /// Empty if the script does not move the head.
    head: Vec<HeadKey>,
    /// Values of the loads at the key times, by `BODY.LOAD`.
    loads: BTreeMap<String, Vec<f64>>,
    /// Styli by name, sorted.
    styli: BTreeMap<String, Vec<StylusKey>>,
}

/// The frame of a script's positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    Room,
    Workspace,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum HeadKey {
    Offset(Vector3<f64>),
    Pose(Isometry3<f64>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct StylusKey {
    pose: Isometry3<f64>,
    pressed: bool,
    second: bool,
}

/// The built-in scripts, by name.
pub const BUILT_IN: [(&str, &str); 7] = [
    ("bend", include_str!("../../configs/scripts/bend.toml")),
    ("liver", include_str!("../../configs/scripts/liver.toml")),
    ("pull", include_str!("../../configs/scripts/pull.toml")),
    ("two-hands", include_str!("../../configs/scripts/two-hands.toml")),
    ("raise", include_str!("../../configs/scripts/raise.toml")),
    ("models", include_str!("../../configs/scripts/models.toml")),
    ("stylus", include_str!("../../configs/scripts/stylus.toml")),
];

#[derive(Debug, thiserror::Error)]
pub enum ScriptError {
    #[error(transparent)]
    File(#[from] ConfigError),
    #[error("no script is named `{name}`; there are {known}, or give the path of a .toml file")]
    Unknown { name: String, known: String },
    #[error("{}: the script has no key frame: add a [[key]] with time and what it moves", path.display())]
    Empty { path: PathBuf },
    #[error("{}:{line}: key frame {key}: {fault}", path.display())]
    Invalid { path: PathBuf, line: usize, key: usize, fault: KeyFrameFault },
}

/// A fault of a key frame, with what to do about it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum KeyFrameFault {
    #[error("time is {time_s}: give seconds between 0 and {LONGEST_S}")]
    Time { time_s: f64 },
    #[error(
        "time is {time_s} s, not later than the key frame before it ({previous_s} s): order them by time"
    )]
    Order { time_s: f64, previous_s: f64 },
    #[error("{who} has no {what}: the first key frame must state it")]
    Missing { who: String, what: &'static str },
    #[error("{who} is not in the first key frame, which must state all that moves{hint}")]
    Unknown { who: String, hint: String },
    #[error("{who} has several of `target`, `direction` and `rotation`: keep one")]
    SeveralOrientations { who: String },
    #[error("{who} has a `roll` without `target` or `direction` to turn about: add one, or use `rotation`")]
    LoneRoll { who: String },
    #[error("{who} points nowhere: `target` must differ from `position`, `direction` must not be zero")]
    NoDirection { who: String },
    #[error("{who} is {value}: give a number between -{LARGEST_LOAD:e} and {LARGEST_LOAD:e}")]
    Load { who: String, value: f64 },
    #[error("the head has `offset` and a pose: keep one; with `offset` it looks as the stage has it")]
    OffsetAndPose,
    #[error("{what} of {who} is {value}: give numbers between -{ROOM_LIMIT_M} and {ROOM_LIMIT_M}")]
    Number { who: String, what: &'static str, value: f64 },
}

const LONGEST_S: f64 = 86400.0;
/// Pause between two rounds of a script, each of which starts at rest, s.
const PAUSE_S: f64 = 1.0;

/// N, N·m or Pa.
const LARGEST_LOAD: f64 = 1e12;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct ScriptFile {
    frame: Frame,
    #[serde(default, rename = "key")]
    keys: Vec<Spanned<KeyFile>>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyFile {
    time: f64,
    head: Option<HeadFile>,
    #[serde(default)]
    load: BTreeMap<String, f64>,
    #[serde(default)]
    stylus: BTreeMap<String, StylusFile>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct HeadFile {
    offset: Option<[f64; 3]>,
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    roll: Option<f64>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct StylusFile {
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    roll: Option<f64>,
    pressed: Option<bool>,
    second: Option<bool>,
}

/// The keys that a head and a stylus have in common.
struct PoseFile<'a> {
    who: &'a str,
    position: Option<[f64; 3]>,
    target: Option<[f64; 3]>,
    direction: Option<[f64; 3]>,
    rotation: Option<[f64; 3]>,
    roll: Option<f64>,
}

impl Script {
    /// The built-in script of this name, or the script in a file: anything that ends in `.toml` is a path.
    pub fn find(name_or_path: &str) -> Result<Self, ScriptError> {
        if name_or_path.ends_with(".toml") {
            return Self::load(Path::new(name_or_path));
        }
        match BUILT_IN.iter().find(|(name, _)| *name == name_or_path) {
            Some((name, text)) => Self::parse(text, Path::new(&format!("configs/scripts/{name}.toml"))),
            None => {
                let known = BUILT_IN.map(|(name, _)| format!("`{name}`")).join(", ");
                Err(ScriptError::Unknown { name: name_or_path.to_owned(), known })
            }
        }
    }

    pub fn load(path: &Path) -> Result<Self, ScriptError> {
        let text = config::read(path)?;
        Self::parse(&text, path)
    }

    /// Checks the text of a script; `path` is only named in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ScriptError> {
        let file: ScriptFile = config::parse(text, path)?;
        let mut script = Self {
            frame: file.frame,
            filled: None,
            duration_s: 0.0,
            times_s: Vec::new(),
            head: Vec::new(),
            loads: BTreeMap::new(),
            styli: BTreeMap::new(),
        };
        for (index, key) in file.keys.iter().enumerate() {
            script.push(key.get_ref()).map_err(|fault| ScriptError::Invalid {
                path: path.to_owned(),
                line: config::line_and_column(text, key.span().start).0,
                key: index + 1,
                fault,
            })?;
        }
        match script.times_s.last() {
            Some(&last_s) => Ok(Self { duration_s: last_s, ..script }),
            None => Err(ScriptError::Empty { path: path.to_owned() }),
        }
    }

    /// The styli's names, in the order of [`TrackerState::styli`]: first those that the stage knows, in its order, then the
    /// others by name.
    pub fn stylus_names(&self, stage: &Stage) -> impl Iterator<Item = &str> {
        self.styli_on(stage).into_iter().map(|(name, _)| name)
    }

    fn styli_on(&self, stage: &Stage) -> Vec<(&str, &[StylusKey])> {
        let known = stage.tracking.stylus_names();
        let place = |name: &str| known.iter().position(|known| *known == name).unwrap_or(known.len());
        let mut styli: Vec<(&str, &[StylusKey])> =
            self.styli.iter().map(|(name, keys)| (name.as_str(), keys.as_slice())).collect();
        styli.sort_by_key(|(name, _)| place(name));
        styli
    }

    /// The round of the script, repeated after a pause, at `time_s` since its first start, counted from 0, and the time since that
    /// round's start, s.
    pub fn round_at(&self, time_s: f64) -> (u32, f64) {
        let round_s = self.duration_s + PAUSE_S;
        ((time_s / round_s) as u32, time_s % round_s)
    }

    /// The values of the loads at `time_s`, by their names.
    pub fn loads(&self, time_s: f64) -> impl Iterator<Item = (&str, f64)> {
        let at = locate(&self.times_s, time_s);
        self.loads.iter().map(move |(name, values)| {
            let (from, to) = (values[at.left], values.get(at.left + 1).unwrap_or(&values[at.left]));
            (name.as_str(), from + at.s * (to - from))
        })
    }

    /// The state at `time_s`, as a tracker on `stage` would report it.
    pub fn sample(&self, stage: &Stage, time_s: f64) -> TrackerState {
        let times = &self.times_s;
        let at = locate(times, time_s);
        let head = (!self.head.is_empty())
            .then(|| interpolate(times, at, |k| self.room_from_head(stage, &self.head[k])).cast());
        let styli = self.styli_on(stage).into_iter().map(|(_, keys)| StylusState {
            room_from_stylus: interpolate(times, at, |k| self.in_room(stage, &keys[k].pose)).cast(),
            pressed: keys[at.left].pressed,
            second: keys[at.left].second,
            ..Default::default()
        });
        TrackerState { head, styli: styli.collect(), time_s }
    }

    fn room_from_head(&self, stage: &Stage, key: &HeadKey) -> Isometry3<f64> {
        match key {
            HeadKey::Offset(offset) => Translation3::from(*offset) * stage.viewer.room_from_head,
            HeadKey::Pose(pose) => self.in_room(stage, pose),
        }
    }

    fn in_room(&self, stage: &Stage, pose: &Isometry3<f64>) -> Isometry3<f64> {
        match self.frame {
            Frame::Room => *pose,
            Frame::Workspace => {
                let ball = self.filled.unwrap_or(stage.workspace);
                let place = ball.centre.coords + pose.translation.vector * ball.radius_m;
                Isometry3::from_parts(Translation3::from(place), pose.rotation)
            }
        }
    }

    /// Adds one key frame to every track.
    fn push(&mut self, key: &KeyFile) -> Result<(), KeyFrameFault> {
        let time_s = key.time;
        if !(0.0..=LONGEST_S).contains(&time_s) {
            return Err(KeyFrameFault::Time { time_s });
        }
        let is_first = self.times_s.is_empty();
        if let Some(&previous_s) = self.times_s.last()
            && previous_s >= time_s
        {
            return Err(KeyFrameFault::Order { time_s, previous_s });
        }
        self.times_s.push(time_s);

        let previous = self.head.last().copied();
        match &key.head {
            Some(_) if previous.is_none() && !is_first => {
                return Err(KeyFrameFault::Unknown { who: "the head".to_owned(), hint: String::new() });
            }
            Some(head) => self.head.push(head_key(head, previous)?),
            None => self.head.extend(previous),
        }

        for (name, value) in &key.load {
            let who = format!("load `{name}`");
            if value.is_nan() || value.abs() > LARGEST_LOAD {
                return Err(KeyFrameFault::Load { who, value: *value });
            }
            if is_first {
                self.loads.insert(name.clone(), Vec::new());
            } else if !self.loads.contains_key(name) {
                let hint = hint(name, self.loads.keys());
                return Err(KeyFrameFault::Unknown { who, hint });
            }
        }
        for (name, values) in &mut self.loads {
            values.extend(key.load.get(name).copied().or(values.last().copied()));
        }
        for name in key.stylus.keys() {
            if is_first {
                self.styli.insert(name.clone(), Vec::new());
            } else if !self.styli.contains_key(name) {
                let hint = hint(name, self.styli.keys());
                return Err(KeyFrameFault::Unknown { who: format!("stylus `{name}`"), hint });
            }
        }
        for (name, keys) in &mut self.styli {
            let previous = keys.last().copied();
            match key.stylus.get(name) {
                Some(stylus) => keys.push(stylus_key(name, stylus, previous)?),
                None => keys.extend(previous),
            }
        }
        Ok(())
    }
}

/// The nearest of the known names, as a question.
fn hint<'a>(name: &str, known: impl Iterator<Item = &'a String>) -> String {
    let nearest = config::nearest(name, known.map(String::as_str));
    nearest.map_or_else(String::new, |known| format!("; did you mean `{known}`?"))
}

fn head_key(head: &HeadFile, previous: Option<HeadKey>) -> Result<HeadKey, KeyFrameFault> {
    let HeadFile { offset, position, target, direction, rotation, roll } = *head;
    let pose = PoseFile { who: "the head", position, target, direction, rotation, roll };
    let Some(offset) = offset else {
        let previous = match previous {
            Some(HeadKey::Pose(pose)) => Some(pose),
            _ => None,
        };
        return Ok(HeadKey::Pose(pose.resolve(previous)?));
    };
    if position.or(target).or(direction).or(rotation).is_some() || roll.is_some() {
        return Err(KeyFrameFault::OffsetAndPose);
    }
    Ok(HeadKey::Offset(pose.vector("offset", offset)?))
}

fn stylus_key(
    name: &str,
    stylus: &StylusFile,
    previous: Option<StylusKey>,
) -> Result<StylusKey, KeyFrameFault> {
    let StylusFile { position, target, direction, rotation, roll, pressed, second } = *stylus;
    let who = format!("stylus `{name}`");
    let pose = PoseFile { who: &who, position, target, direction, rotation, roll };
    Ok(StylusKey {
        pose: pose.resolve(previous.map(|key| key.pose))?,
        pressed: pressed.unwrap_or(previous.is_some_and(|key| key.pressed)),
        second: second.unwrap_or(previous.is_some_and(|key| key.second)),
    })
}

impl PoseFile<'_> {
    /// The whole pose; parts that are not stated come from the previous one.
    fn resolve(&self, previous: Option<Isometry3<f64>>) -> Result<Isometry3<f64>, KeyFrameFault> {
        let missing = |what| KeyFrameFault::Missing { who: self.who.to_owned(), what };
        let position = match self.position {
            Some(position) => self.vector("position", position)?,
            None => previous.ok_or_else(|| missing("position"))?.translation.vector,
        };
        let rotation = match self.orientation(&Point3::from(position))? {
            Some(rotation) => rotation,
            None => {
                previous.ok_or_else(|| missing("orientation (`target`, `direction` or `rotation`)"))?.rotation
            }
        };
        Ok(Isometry3::from_parts(Translation3::from(position), rotation))
    }

    fn orientation(&self, position: &Point3<f64>) -> Result<Option<UnitQuaternion<f64>>, KeyFrameFault> {
        let direction = match (self.target, self.direction, self.rotation) {
            (None, None, None) if self.roll.is_none() => return Ok(None),
            (None, None, Some(rotation)) if self.roll.is_none() => {
                return Ok(Some(UnitQuaternion::from_scaled_axis(self.vector("rotation", rotation)?)));
            }
            (Some(target), None, None) => self.vector("target", target)? - position.coords,
            (None, Some(direction), None) => self.vector("direction", direction)?,
            (None, None, _) => return Err(KeyFrameFault::LoneRoll { who: self.who.to_owned() }),
            _ => return Err(KeyFrameFault::SeveralOrientations { who: self.who.to_owned() }),
        };
        let roll = self.number("roll", self.roll.unwrap_or(0.0))?;
        match rotation_towards(&direction, roll) {
            Some(rotation) => Ok(Some(rotation)),
            None => Err(KeyFrameFault::NoDirection { who: self.who.to_owned() }),
        }
    }

    fn vector(&self, what: &'static str, numbers: [f64; 3]) -> Result<Vector3<f64>, KeyFrameFault> {
        for value in numbers {
            self.number(what, value)?;
        }
        Ok(numbers.into())
    }

    fn number(&self, what: &'static str, value: f64) -> Result<f64, KeyFrameFault> {
        if value.abs() <= ROOM_LIMIT_M {
            Ok(value)
        } else {
            Err(KeyFrameFault::Number { who: self.who.to_owned(), what, value })
        }
    }
}

#[cfg(test)]
mod tests;
