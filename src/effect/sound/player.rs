//! The voices of all bodies, mixed into the channels of a stage.
//!
//! In: frames, one after the other, each as long as the world's frame. Out: as many samples as are asked for, wherever a frame begins or ends
//! meanwhile. Where the next frame is late, bodies ring on; where frames have piled up, they are played in half of their time. It runs in
//! the audio thread: no lock, no allocation, and what is done with is handed back.

use super::listener::Phrase;
use super::voice::Voice;
use crate::audio::{Listening, Mixer, Paths};

/// Samples that are played at once.
const BLOCK: usize = 256;
/// Frames that may wait before time is made up for.
const PILE: usize = 2;

/// Part of a sample by which the beginning of a step is rounded.
const EXACT: f64 = 1e-6;

/// A frame of all bodies.
#[derive(Debug, Default)]
pub struct SoundFrame {
    /// Its length.
    pub samples: usize,
    /// Of each body, and how it reaches the channels.
    pub phrases: Vec<Phrase>,
    pub paths: Vec<Paths>,
}

/// Where a player's frames come from, and where they go when they were played.
pub trait Frames {
    fn next(&mut self) -> Option<Box<SoundFrame>>;
    fn done(&mut self, frame: Box<SoundFrame>);
    /// Frames that are there after the next.
    fn waiting(&self) -> usize;
}

/// The voices of all bodies.
pub struct Player {
    rate_hz: f64,
    channels: usize,
    bodies: Vec<Body>,
    mixer: Mixer,
    block: Vec<f32>,
    now: Option<Playing>,
}

struct Body {
    voice: Voice,
    paths: Paths,
    /// Beats of the frame that have begun.
    begun: usize,
}

/// The frame that is being played.
struct Playing {
    frame: Box<SoundFrame>,
    /// Samples that are behind, of how many.
    at: usize,
    samples: usize,
    /// Time in the player over that in the frame.
    pace: f64,
}

impl Player {
    pub fn new(listening: &Listening, rate_hz: f64, bodies: usize) -> Player {
        let body = |_| Body { voice: Voice::new(rate_hz), paths: Paths::SILENT, begun: 0 };
        Player {
            rate_hz,
            channels: listening.channels(),
            bodies: (0..bodies).map(body).collect(),
            mixer: Mixer::new(listening, rate_hz, bodies),
            block: vec![0.0; BLOCK],
            now: None,
        }
    }

    /// Fills all channels, whose samples alternate.
    pub fn fill(&mut self, out: &mut [f32], frames: &mut dyn Frames) {
        out.fill(0.0);
        let mut rest = &mut out[..];
        while rest.len() >= self.channels {
            if self.now.is_none() {
                self.begin(frames);
            }
            let wanted = (rest.len() / self.channels).min(BLOCK);
            let count = self.now.as_ref().map_or(wanted, |playing| wanted.min(playing.samples - playing.at));
            let (block, after) = rest.split_at_mut(count * self.channels);
            self.play(block, count);
            rest = after;
            if self.now.as_ref().is_some_and(|playing| playing.at == playing.samples) {
                self.end(frames);
            }
        }
        self.mixer.finish(out);
    }

    /// Samples that were turned down, for they were louder than the output can be.
    pub fn limited(&self) -> u64 {
        self.mixer.limited()
    }

    /// Begins the next frame, if there is one.
    fn begin(&mut self, frames: &mut dyn Frames) {
        let Some(mut frame) = frames.next() else { return };
        for (number, body) in self.bodies.iter_mut().enumerate() {
            if let Some(phrase) = frame.phrases.get_mut(number) {
                body.voice.begin(phrase);
            }
            body.paths = frame.paths.get(number).copied().unwrap_or(body.paths);
            body.begun = 0;
        }
        let is_late = frames.waiting() > PILE && frame.samples > 1;
        let samples = if is_late { frame.samples / 2 } else { frame.samples };
        let pace = samples as f64 / frame.samples.max(1) as f64;
        self.now = Some(Playing { frame, at: 0, samples, pace });
    }

    fn end(&mut self, frames: &mut dyn Frames) {
        let Some(playing) = self.now.take() else { return };
        for (body, phrase) in self.bodies.iter_mut().zip(&playing.frame.phrases) {
            phrase.beats.iter().skip(body.begun).for_each(|beat| body.voice.beat(beat, 0.0));
            body.voice.rest();
        }
        frames.done(playing.frame);
    }

    /// Plays samples of all bodies, within the frame if there is one.
    fn play(&mut self, out: &mut [f32], count: usize) {
        let Player { rate_hz, bodies, mixer, block, now, .. } = self;
        let block = &mut block[..count];
        for (number, body) in bodies.iter_mut().enumerate() {
            match now {
                Some(playing) => body.play(number, playing, *rate_hz, block),
                None => body.voice.fill(block),
            }
            mixer.add(number, &body.paths, block, out);
        }
        if let Some(playing) = now {
            playing.at += count;
        }
    }
}

impl Body {
    /// Plays samples within a frame.
    fn play(&mut self, number: usize, playing: &Playing, rate_hz: f64, block: &mut [f32]) {
        let beats = playing.frame.phrases.get(number).map_or(&[][..], |phrase| &phrase.beats);
        let mut done = 0;
        for beat in &beats[self.begun.min(beats.len())..] {
            let begins = beat.at_s * playing.pace * rate_hz;
            let first = (begins - EXACT).ceil().max(0.0) as usize;
            if first >= playing.at + block.len() {
                break;
            }
            let here = first.saturating_sub(playing.at).max(done);
            self.voice.fill(&mut block[done..here]);
            self.voice.beat(beat, ((playing.at + here) as f64 - begins) / rate_hz);
            (done, self.begun) = (here, self.begun + 1);
        }
        self.voice.fill(&mut block[done..]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::listener::Listener;
    use super::super::radiation::Radiator;
    use super::*;
    use crate::stage::Stage;
    use crate::world::vibration::{ModeStep, Vibration, VibrationModes, VibrationStep};
    use nalgebra::Vector3;
    use std::collections::VecDeque;
    use std::f64::consts::TAU;
    use std::sync::Arc;

    const RATE_HZ: f64 = 48_000.0;

    #[derive(Default)]
    struct Queue {
        coming: VecDeque<Box<SoundFrame>>,
        done: usize,
    }

    impl Frames for Queue {
        fn next(&mut self) -> Option<Box<SoundFrame>> {
            self.coming.pop_front()
        }

        fn done(&mut self, _: Box<SoundFrame>) {
            self.done += 1;
        }

        fn waiting(&self) -> usize {
            self.coming.len()
        }
    }

    /// Frames of a sheet that was struck when the first began, and rings at 500 Hz.
    fn frames(listening: &Listening, stage: &Stage, count: usize) -> VecDeque<Box<SoundFrame>> {
        let radiator = Radiator::new(&[[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], &[[0, 1, 2]]);
        let omega = TAU * 500.0;
        let modes = Arc::new(VibrationModes {
            squares: vec![omega * omega],
            decays: vec![0.0],
            shapes: vec![vec![Vector3::z(); 3]],
        });
        let paths = listening.paths(&stage.viewer.room_from_head, &nalgebra::Point3::new(0.0, 0.0, 0.0));
        let mut listener = Listener::new(RATE_HZ);
        let mut of = |frame: usize| {
            let turn = omega * frame as f64 / 60.0;
            let state = [turn.sin() / omega, turn.cos()];
            let steps =
                vec![VibrationStep { dt_s: 1.0 / 60.0, modes: vec![ModeStep { state, load: [0.0; 3] }] }];
            let phrase = listener.phrase(&Vibration { modes: modes.clone(), steps }, &radiator);
            Box::new(SoundFrame { samples: 800, phrases: vec![phrase], paths: vec![paths] })
        };
        (0..count).map(&mut of).collect()
    }

    fn player() -> (Player, VecDeque<Box<SoundFrame>>) {
        let stage = Stage::find("desktop").unwrap();
        let listening = Listening::new(&stage);
        (Player::new(&listening, RATE_HZ, 1), frames(&listening, &stage, 12))
    }

    /// A frame that has just come sounds in the next block, whatever was played before.
    #[test]
    fn a_frame_is_heard_in_the_next_block() {
        let (mut player, frames) = player();
        let mut queue = Queue::default();
        let mut out = [0.0; 2 * BLOCK];
        player.fill(&mut out, &mut queue);
        assert!(out.iter().all(|sample| *sample == 0.0));
        queue.coming.extend(frames.into_iter().take(1));
        player.fill(&mut out, &mut queue);
        let first = out.iter().position(|sample| *sample != 0.0).unwrap();
        assert!(first / 2 < 4, "sample {}", first / 2);
    }

    /// Late frames leave no gap and no click: the body rings on, and where it is told what it does already, nothing changes.
    #[test]
    fn late_frames_are_not_heard() {
        let (mut player, frames) = player();
        let mut queue = Queue::default();
        let mut all = Vec::new();
        for (number, frame) in frames.into_iter().enumerate() {
            queue.coming.push_back(frame);
            // Every third frame comes half a frame late.
            let samples = if number % 3 == 2 { 1200 } else { 800 };
            let mut out = vec![0.0; 2 * samples];
            player.fill(&mut out, &mut queue);
            all.extend(out.chunks(2).map(|both| both[0]));
        }
        let loudest = all.iter().fold(0.0_f32, |most, sample| most.max(sample.abs()));
        // ω/48000 of the amplitude from sample to sample.
        let steepest = all[200..].windows(2).map(|two| (two[1] - two[0]).abs()).fold(0.0, f32::max);
        assert!(steepest < 0.07 * loudest, "{steepest} of {loudest}");
        assert_eq!(queue.done, 12);
    }

    /// Frames that have piled up are made up for, without a click.
    #[test]
    fn frames_that_piled_up_are_played_faster() {
        let (mut player, frames) = player();
        let mut queue = Queue { coming: frames, done: 0 };
        let mut out = vec![0.0; 2 * 800 * 8];
        player.fill(&mut out, &mut queue);
        assert!(queue.waiting() <= PILE, "{} wait", queue.waiting());
        let left: Vec<f32> = out.chunks(2).map(|both| both[0]).collect();
        let loudest = left.iter().fold(0.0_f32, |most, sample| most.max(sample.abs()));
        let steepest = left[200..].windows(2).map(|two| (two[1] - two[0]).abs()).fold(0.0, f32::max);
        assert!(steepest < 0.07 * loudest, "{steepest} of {loudest}");
    }
}
