//! What moves a world where nobody does: a script or a recording, played in a number of pictures.

use super::failure::Failure;
use super::recording::{Recorder, Replay};
use super::render::{self, Show};
use super::table::seconds;
use super::world::{StepTimes, World};
use crate::base::statistics::{median, quantile};
use crate::track::Script;

/// Where head and styli come from.
pub enum Source<'a> {
    /// Nothing moves.
    Rest,
    Script(&'a Script),
    /// A session that was recorded, and how many frames it has.
    Replay(&'a mut Replay, u64),
}

impl<'a> Source<'a> {
    /// The recording, or else the script, where there is one.
    pub fn new(script: Option<&'a Script>, replay: Option<&'a mut Replay>) -> Result<Source<'a>, Failure> {
        match (replay, script) {
            (Some(replay), _) => {
                let length = replay.length()?;
                Ok(Source::Replay(replay, length))
            }
            (None, Some(script)) => Ok(Source::Script(script)),
            (None, None) => Ok(Source::Rest),
        }
    }
}

/// A source played in a number of pictures, with fine steps between them that nobody sees: a grab needs the moment at
/// which the button goes down.
pub struct Playback<'a> {
    pub source: Source<'a>,
    /// Pictures over the whole of it, 1 or more.
    pub frames: usize,
    /// Writes every step down.
    pub recorder: Option<&'a mut Recorder>,
    done: u64,
}

/// Fine steps over a whole script, at least.
const SCRIPT_STEPS: usize = 240;

impl<'a> Playback<'a> {
    pub fn new(source: Source<'a>, frames: usize) -> Playback<'a> {
        Playback { source, frames, recorder: None, done: 0 }
    }

    /// Moves the world on to picture `frame`, counted from 0; returns what the mechanics of the last step took.
    pub fn step_to(&mut self, world: &mut World, frame: usize) -> Result<StepTimes, Failure> {
        let mut times = world.times;
        match &mut self.source {
            Source::Rest => {
                let state = Default::default();
                times = world.step(&state);
                self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.frame(world, &state))?;
            }
            Source::Script(script) => {
                let between = SCRIPT_STEPS.div_ceil(self.frames) as u64;
                let last = ((self.frames as u64 - 1) * between).max(1);
                while self.done <= frame as u64 * between {
                    let time_s = script.duration_s * self.done as f64 / last as f64;
                    let state = script.sample(&world.stage, time_s);
                    times = world.step(&state);
                    self.recorder.as_mut().map_or(Ok(()), |recorder| recorder.frame(world, &state))?;
                    self.done += 1;
                }
            }
            Source::Replay(replay, length) => {
                // A single picture is of the end.
                let (last, pictures) = (length.saturating_sub(1), self.frames as u64 - 1);
                let until = (last * frame as u64).checked_div(pictures).unwrap_or(last);
                while self.done <= until {
                    let Some(frame) = replay.next_frame()? else { break };
                    replay.play(world, frame);
                    times = world.times;
                    self.done += 1;
                }
            }
        }
        Ok(times)
    }
}

/// The script or the recording without windows and devices: every frame's state against the recorded one, and what
/// the mechanics took.
pub fn check(
    show: &mut Show,
    script: Option<&Script>,
    mut recorder: Option<&mut Recorder>,
) -> Result<(), Failure> {
    let source = Source::new(script, show.replay.as_mut())?;
    let frames = match &source {
        Source::Rest => 1,
        Source::Script(_) => SCRIPT_STEPS,
        Source::Replay(_, length) => *length as usize,
    };
    let mut playback = Playback::new(source, frames);
    playback.recorder = recorder.as_deref_mut();
    let mut times = Vec::new();
    for frame in 0..frames {
        let StepTimes { interact_s, deform_s, normals_s } = playback.step_to(&mut show.world, frame)?;
        times.push(interact_s + deform_s + normals_s);
    }
    render::report(show.replay.as_ref(), recorder)?;
    let (middle, most) = (median(times.iter().copied()), quantile(times.iter().copied(), 0.99));
    super::print(&format!(
        "mechanics of a frame: median {}, 99 % within {}\n",
        seconds(middle),
        seconds(most)
    ))
}
