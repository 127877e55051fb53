//! The effect in a live session: the audio device plays what the world has gone through.
//!
//! In: the world after each frame. Out: its sound, from the next buffer of the device on. Frames go to the audio thread and come back through
//! two rings, so that nothing there waits, allocates or frees.

use super::player::{Frames, SoundFrame};
use super::running::Ensemble;
use super::settings::NAME;
use crate::audio::{Listening, Playback};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::effect::entry::EffectInput;
use crate::world::{Frame, RunningEffect, World};
use rtrb::{Consumer, Producer, PushError, RingBuffer};

/// Frames on their way at most.
const FRAMES: usize = 16;

struct Live {
    ensemble: Ensemble,
    to_play: Producer<Box<SoundFrame>>,
    played: Consumer<Box<SoundFrame>>,
    playback: Playback,
    is_told: bool,
}

/// The rings as the audio thread sees them.
struct Rings {
    to_play: Consumer<Box<SoundFrame>>,
    played: Producer<Box<SoundFrame>>,
}

impl Frames for Rings {
    fn next(&mut self) -> Option<Box<SoundFrame>> {
        self.to_play.pop().ok()
    }

    fn done(&mut self, frame: Box<SoundFrame>) {
        // There is room: no more frames are on their way than the ring holds. Freeing one would make the audio thread wait.
        if let Err(PushError::Full(frame)) = self.played.push(frame) {
            std::mem::forget(frame);
        }
    }

    fn waiting(&self) -> usize {
        self.to_play.slots()
    }
}

/// Opens the audio device. Without one the session goes on without sound, and says so.
pub fn start(listed: &EffectInput<'_>, world: &World) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let (to_play, coming) = RingBuffer::new(FRAMES);
    let (done, played) = RingBuffer::new(2 * FRAMES);
    let mut ensemble = None;
    let started = Playback::start(&Listening::new(&world.assets.stage), |rate_hz| {
        let of_device = Ensemble::new(listed, world, rate_hz);
        let mut player = of_device.player();
        ensemble = Some(of_device);
        let mut rings = Rings { to_play: coming, played: done };
        Box::new(move |out: &mut [f32]| player.fill(out, &mut rings))
    });
    match (started, ensemble) {
        (Ok(playback), Some(ensemble)) => {
            Ok(Some(Box::new(Live { ensemble, to_play, played, playback, is_told: false })))
        }
        (Ok(_), None) => Ok(None),
        (Err(error), _) => {
            notice!("{NAME}: {error}; the session goes on without sound");
            Ok(None)
        }
    }
}

impl RunningEffect for Live {
    fn name(&self) -> &'static str {
        NAME
    }

    fn show(&mut self, world: &World, frame: &mut Frame) {
        while self.played.pop().is_ok() {}
        let (of_frame, warnings) = self.ensemble.frame(world, frame);
        frame.warnings.extend(warnings);
        if self.to_play.push(Box::new(of_frame)).is_err() {
            // The device stands still. What comes next does not follow from what it has played.
            self.ensemble.break_off();
        }
        if let Some(failure) = self.playback.failure().filter(|_| !self.is_told) {
            self.is_told = true;
            frame.warnings.push(format!("{NAME}: the audio device stopped: {failure}"));
        }
    }

    fn summary(&mut self) -> String {
        let (device, rate_hz) = (self.playback.device(), self.playback.rate_hz());
        let (channels, gaps) = (self.ensemble.listening().channels(), self.playback.gaps());
        let buffer = self.playback.buffer_s();
        let buffer = buffer.map_or(String::new(), |s| format!(", its buffer {:.1} ms", 1e3 * s));
        format!("{NAME} by {device}: {channels} channels of {rate_hz} Hz{buffer}, {gaps} gaps\n")
    }
}
