//! Plays a session as a number of pictures, moved by a script, a recording, or nothing.

use super::advance::Session;
use super::input::Leader;
use crate::base::failure::Failure;
use crate::base::statistics::{median, quantile};
use crate::base::table::seconds;
use crate::world::StepTimes;

/// A session played in a number of pictures, with fine steps between them that nobody sees: a grab needs the moment at
/// which the button goes down.
pub struct Playback {
    source: Source,
    /// Pictures over the whole of it, 1 or more.
    frames: usize,
    done: u64,
}

#[derive(Clone, Copy)]
enum Source {
    /// No motion.
    Rest,
    Script {
        duration_s: f64,
    },
    /// A recording of `length` frames.
    Recording {
        length: u64,
    },
}

/// Steps of the session over a whole script, at least; the first is at its start, the last at its end.
const SCRIPT_STEPS: u64 = 240;

impl Source {
    fn from_session(session: &Session) -> Result<Source, Failure> {
        Ok(match (session.input.leader(), &session.input.replay, &session.input.script) {
            (Leader::Recording, Some(replay), _) => Source::Recording { length: replay.length()? },
            (Leader::Script, _, Some(script)) => Source::Script { duration_s: script.duration_s },
            _ => Source::Rest,
        })
    }
}

impl Playback {
    /// Plays the session's recording, or its script, in `frames` pictures.
    pub fn new(session: &Session, frames: usize) -> Result<Playback, Failure> {
        Ok(Playback { source: Source::from_session(session)?, frames: frames.max(1), done: 0 })
    }

    /// Whether a recording or a script moves anything.
    pub fn moves(&self) -> bool {
        !matches!(self.source, Source::Rest)
    }

    /// Moves the session on to picture `frame`, counted from 0; returns what the mechanics of the last step took.
    pub fn step_to(&mut self, session: &mut Session, frame: usize) -> Result<StepTimes, Failure> {
        let pictures = self.frames as u64 - 1;
        // A single picture is of the end.
        let until = |last: u64| (last * frame as u64).checked_div(pictures).unwrap_or(last);
        match self.source {
            Source::Rest => {
                session.advance(0.0)?;
            }
            Source::Script { duration_s } => {
                let spans = pictures.max(1);
                let last = spans * (SCRIPT_STEPS - 1).div_ceil(spans);
                while self.done <= until(last) {
                    session.advance(duration_s * self.done as f64 / last as f64)?;
                    self.done += 1;
                }
            }
            Source::Recording { length } => {
                let until = until(length.saturating_sub(1));
                while self.done <= until && session.play_frame()? {
                    self.done += 1;
                }
            }
        }
        Ok(session.world.frame.times)
    }
}

/// Plays the script or the recording without windows and devices: every frame's state against the recorded one, and
/// what the mechanics took, in words.
pub fn check(session: &mut Session) -> Result<String, Failure> {
    let source = Source::from_session(session)?;
    let frames = match source {
        Source::Rest => 1,
        Source::Script { .. } => SCRIPT_STEPS as usize,
        Source::Recording { length } => length as usize,
    };
    let mut playback = Playback { source, frames: frames.max(1), done: 0 };
    let mut times = Vec::new();
    for frame in 0..frames {
        times.push(playback.step_to(session, frame)?.total_s());
    }
    let report = session.report()?;
    let (middle, most) = (median(times.iter().copied()), quantile(times.iter().copied(), 0.99));
    Ok(format!("{report}mechanics of a frame: median {}, 99 % within {}\n", seconds(middle), seconds(most)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::Script;
    use std::path::Path;

    #[test]
    fn the_last_picture_is_of_the_scripts_end() {
        let script = "frame = \"room\"\n[[key]]\ntime = 0.0\nstylus.pen = { position = [0, 1, 0], direction = [0, 0, -1] }\n\
                      [[key]]\ntime = 3.0\n";
        for (frames, steps) in [(1, 240), (2, 240), (7, 241), (240, 240), (300, 300)] {
            let world = crate::world::tests::world();
            let script = Script::parse(script, Path::new("s.toml")).unwrap();
            let mut session = Session::new(world, Some(script));
            let mut playback = Playback::new(&session, frames).unwrap();
            let first_s = if frames == 1 { 3.0 } else { 0.0 };
            for (frame, time_s) in [(0, first_s), (frames - 1, 3.0)] {
                playback.step_to(&mut session, frame).unwrap();
                let found_s = *session.world.graph.get(session.world.fields.time);
                assert!((found_s - time_s).abs() < 1e-9, "picture {frame} of {frames}: {found_s} s");
            }
            assert_eq!(playback.done, steps, "{frames} pictures");
        }
    }
}
