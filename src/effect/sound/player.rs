//! The voices of all sources, mixed into the channels of a stage.
//!
//! In: frames, one after the other, each as long as the world's frame. Out: as many samples as are asked for, wherever a frame begins or ends
//! meanwhile. Where the next frame is late, bodies ring on, and it is taken up where it would be by then: the time of the voices is that
//! of the world. Where frames have piled up, they are taken up a little later than they begin. It runs in the audio thread: no lock, no
//! allocation, and what is done with is handed back.

use super::phrase::Phrase;
use super::voice::Voice;
use crate::audio::{Listening, Mixer, Paths};

/// Samples that are played at once.
const BLOCK: usize = 256;
/// Frames that may wait, and the part of a frame that is left out while more do.
const PILE: usize = 1;
const LEFT_OUT: usize = 8;
/// Time by which a frame's end may have passed before it came, s: beyond, the world's clock stood.
const AHEAD_S: f64 = 0.05;
/// Part of a sample by which the beginning of a step is rounded.
const EXACT: f64 = 1e-6;

/// A frame of all sources.
#[derive(Debug, Default)]
pub struct SoundFrame {
    /// Number of samples.
    pub samples: usize,
    /// Time from its first sample to its beginning, in samples, less than one.
    pub offset: f64,
    /// Phrase of each source, and its paths to the channels at the end of the frame.
    pub phrases: Vec<Phrase>,
    pub paths: Vec<Paths>,
}

/// Queue of a player's frames, which takes back those that were played.
pub trait Frames {
    fn next(&mut self) -> Option<Box<SoundFrame>>;
    fn done(&mut self, frame: Box<SoundFrame>);
    /// Frames that are there after the next.
    fn waiting(&self) -> usize;
}

/// The voices of all sources.
pub struct Player {
    rate_hz: f64,
    channels: usize,
    sources: Vec<Sounding>,
    mixer: Mixer,
    block: Vec<f32>,
    now: Option<Playing>,
    /// Samples since the last frame ended, once there was one.
    ahead: Option<usize>,
}

struct Sounding {
    voice: Voice,
    /// Paths at the end of the last frame and of this one.
    from: Paths,
    to: Paths,
    /// Beats of the frame that have begun.
    begun: usize,
}

/// The frame that is being played.
struct Playing {
    frame: Box<SoundFrame>,
    /// Samples that are behind.
    at: usize,
}

impl Player {
    pub fn new(listening: &Listening, rate_hz: f64, sources: usize) -> Player {
        let source = |number: usize| {
            let (voice, silent) = (Voice::new(rate_hz, number as u64 + 1), Paths::SILENT);
            Sounding { voice, from: silent, to: silent, begun: 0 }
        };
        Player {
            rate_hz,
            channels: listening.channels(),
            sources: (0..sources).map(source).collect(),
            mixer: Mixer::new(listening, rate_hz, sources),
            block: vec![0.0; BLOCK],
            now: None,
            ahead: None,
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
            let left = self.now.as_ref().map(|playing| playing.frame.samples.saturating_sub(playing.at));
            let count = left.map_or(wanted, |left| wanted.min(left));
            let (block, after) = rest.split_at_mut(count * self.channels);
            self.play(block, count);
            rest = after;
            if left == Some(count) {
                self.end(frames);
            }
        }
        self.mixer.finish(out);
    }

    /// Moments that were turned down, for they were louder than the output can be.
    pub fn limited(&self) -> u64 {
        self.mixer.limited()
    }

    /// Begins the next frame, if there is one.
    fn begin(&mut self, frames: &mut dyn Frames) {
        let Some(mut frame) = frames.next() else { return };
        let is_first = self.ahead.is_none();
        let ahead = self.ahead.unwrap_or(0);
        let left_out = if frames.waiting() > PILE { frame.samples / LEFT_OUT } else { 0 };
        let at = ahead.max(left_out).min(frame.samples);
        for (number, source) in self.sources.iter_mut().enumerate() {
            if let Some(phrase) = frame.phrases.get_mut(number) {
                source.voice.begin(phrase, frame.samples - at);
            }
            let to = frame.paths.get(number).copied().unwrap_or(source.to);
            (source.from, source.to) = (if is_first { to } else { source.to }, to);
            source.begun = 0;
        }
        let most = (AHEAD_S * self.rate_hz) as usize;
        // While the world's clock stands, it is not overtaken.
        self.ahead = Some(if frame.samples == 0 { 0 } else { ahead.saturating_sub(frame.samples).min(most) });
        self.now = Some(Playing { frame, at });
    }

    fn end(&mut self, frames: &mut dyn Frames) {
        let Some(Playing { frame, .. }) = self.now.take() else { return };
        for (source, phrase) in self.sources.iter_mut().zip(&frame.phrases) {
            for beat in phrase.beats.iter().skip(source.begun) {
                source.voice.beat(beat, frame.samples as f64 / self.rate_hz - beat.at_s);
            }
        }
        frames.done(frame);
    }

    /// Plays samples of all sources, within the frame if there is one.
    fn play(&mut self, out: &mut [f32], count: usize) {
        let Player { rate_hz, sources, mixer, block, now, ahead, .. } = self;
        let block = &mut block[..count];
        if block.is_empty() {
            return;
        }
        for (number, source) in sources.iter_mut().enumerate() {
            let paths = match now {
                Some(playing) => source.play(number, playing, *rate_hz, block),
                None => {
                    source.voice.fill(block);
                    source.to
                }
            };
            mixer.add(number, &paths, block, out);
        }
        match (now, ahead) {
            (Some(playing), _) => playing.at += count,
            (None, Some(ahead)) => *ahead += count,
            (None, None) => {}
        }
    }
}

impl Sounding {
    /// Plays samples within a frame; its paths where they end.
    fn play(&mut self, number: usize, playing: &Playing, rate_hz: f64, block: &mut [f32]) -> Paths {
        let Playing { frame, at } = playing;
        let beats = frame.phrases.get(number).map_or(&[][..], |phrase| &phrase.beats);
        let mut done = 0;
        for beat in &beats[self.begun.min(beats.len())..] {
            let begins = beat.at_s * rate_hz + frame.offset;
            let first = (begins - EXACT).ceil().max(0.0) as usize;
            if first >= at + block.len() {
                break;
            }
            let here = first.saturating_sub(*at).max(done);
            self.voice.fill(&mut block[done..here]);
            self.voice.beat(beat, ((at + here) as f64 - begins) / rate_hz);
            (done, self.begun) = (here, self.begun + 1);
        }
        self.voice.fill(&mut block[done..]);
        let share = (at + block.len()) as f32 / frame.samples.max(1) as f32;
        self.from.towards(&self.to, share)
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
            let mode = ModeStep { state, ..ModeStep::default() };
            let steps = vec![VibrationStep { dt_s: 1.0 / 60.0, modes: vec![mode] }];
            let phrase = listener.phrase(&Vibration { modes: modes.clone(), steps }, &radiator);
            Box::new(SoundFrame { samples: 800, offset: 0.0, phrases: vec![phrase], paths: vec![paths] })
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

    /// A body that rings, is stopped by a jump of -z and struck again: frames that come late are taken up where they would be by then,
    /// so that the stop hits it in the right phase, and there is neither gap nor click.
    #[test]
    fn late_frames_are_played_as_if_they_had_come_in_time() {
        let play = |late: &[usize]| {
            let (mut player, mut frames) = player();
            // The ringing ends with the sixth frame.
            let ended = frames[5].phrases[0].beats[0].clone();
            let turned = nalgebra::Complex::new(0.0, TAU * 500.0 * 5.0 / 60.0).exp();
            let begun = frames[0].phrases[0].beats[0].jumps[0];
            let stop = super::super::phrase::Beat { jumps: vec![-begun * turned], ..ended };
            frames[5].phrases[0].beats = vec![stop];
            let mut queue = Queue::default();
            let (mut all, mut waits) = (Vec::new(), 0);
            for (number, frame) in frames.into_iter().take(8).enumerate() {
                // A frame that is late by so many samples lets the device ask for more before it comes.
                let wait = late.get(number).copied().unwrap_or(0);
                let mut before = vec![0.0; 2 * wait];
                player.fill(&mut before, &mut queue);
                queue.coming.push_back(frame);
                let mut out = vec![0.0; 2 * (800 - waits.min(800))];
                waits = wait;
                player.fill(&mut out, &mut queue);
                all.extend(before.into_iter().chain(out));
            }
            all.chunks(2).map(|both| both[0]).collect::<Vec<f32>>()
        };
        let (in_time, late) = (play(&[]), play(&[0, 0, 100, 0, 0, 0, 0, 0]));
        let loudest = in_time.iter().fold(0.0_f32, |most, sample| most.max(sample.abs()));
        let same = in_time.iter().zip(&late).take(3900).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        println!("late frames: {:e}", same / loudest);
        assert!(same < 1e-13 * loudest, "{same} of {loudest}");
        for heard in [in_time, late] {
            let left = heard[4900..].iter().fold(0.0_f32, |most, sample| most.max(sample.abs()));
            println!("left {:e}", left / loudest);
            assert!(left < 3e-13 * loudest, "it was stopped, and rings on with {left} of {loudest}");
        }
    }

    /// Frames that have piled up are made up for, without a click.
    #[test]
    fn frames_that_piled_up_are_taken_up_later() {
        let (mut player, frames) = player();
        let mut queue = Queue { coming: frames, done: 0 };
        let mut out = vec![0.0; 2 * 800 * 9];
        player.fill(&mut out, &mut queue);
        assert_eq!(queue.waiting(), 1, "of 12 frames, after the time of 9");
        let left: Vec<f32> = out.chunks(2).map(|both| both[0]).collect();
        let loudest = left.iter().fold(0.0_f32, |most, sample| most.max(sample.abs()));
        // ω/48000 of the amplitude from sample to sample.
        let steepest = left[200..].windows(2).map(|two| (two[1] - two[0]).abs()).fold(0.0, f32::max);
        assert!(steepest < 0.07 * loudest, "{steepest} of {loudest}");
    }

    /// A noise whose frames come late goes on; where none comes any more it falls to zero within 50 ms, and rises again with the next.
    #[test]
    fn a_noise_without_frames_ends() {
        let stage = Stage::find("desktop").unwrap();
        let listening = Listening::new(&stage);
        let paths = listening.paths(&stage.viewer.room_from_head, &nalgebra::Point3::origin());
        let frame = || {
            let noise = Some(super::super::noise::NoiseAim { square: 1e-4, hertz: 2000.0 });
            let phrases = vec![Phrase { noise, ..Phrase::default() }];
            Box::new(SoundFrame { samples: 800, offset: 0.0, phrases, paths: vec![paths] })
        };
        let mut player = Player::new(&listening, RATE_HZ, 1);
        let mut queue = Queue::default();
        let mut square = |player: &mut Player, frames: usize, samples: usize| {
            queue.coming.extend((0..frames).map(|_| frame()));
            let mut out = vec![0.0; 2 * samples];
            player.fill(&mut out, &mut queue);
            out.iter().map(|p| f64::from(*p).powi(2)).sum::<f64>() / samples as f64
        };
        square(&mut player, 1, 800);
        let steady = square(&mut player, 1, 800);
        // 5 ms late.
        let late = [square(&mut player, 0, 240), square(&mut player, 1, 560)];
        println!("late: {} and {} of {steady}", late[0], late[1]);
        assert!(late.iter().all(|part| (part / steady - 1.0).abs() < 0.5), "{late:?} {steady}");
        square(&mut player, 0, 2400);
        assert_eq!(square(&mut player, 0, 800), 0.0);
        let again = [square(&mut player, 1, 800), square(&mut player, 1, 800)];
        assert!(again.iter().all(|part| *part > 0.1 * steady), "{again:?} {steady}");
    }

    /// Two bodies, one on the left and one on the right of a desk, each in its own channel and with its own steps.
    #[test]
    fn bodies_are_heard_side_by_side() {
        let stage = Stage::find("desktop").unwrap();
        let listening = Listening::new(&stage);
        let of = |side: f64| {
            let place =
                stage.viewer.room_from_head * nalgebra::Point3::new(side * 0.5, 0.0, -0.75_f64.sqrt());
            listening.paths(&stage.viewer.room_from_head, &place)
        };
        let level = |rings: [bool; 2]| {
            let mut player = Player::new(&listening, RATE_HZ, 2);
            let phrase = |rings: bool| match rings {
                true => frames(&listening, &stage, 1).remove(0).unwrap().phrases.remove(0),
                false => Phrase::default(),
            };
            let frame = SoundFrame {
                samples: 800,
                phrases: rings.map(phrase).into(),
                paths: vec![of(-1.0), of(1.0)],
                ..SoundFrame::default()
            };
            let mut queue = Queue { coming: [Box::new(frame)].into(), done: 0 };
            let mut out = vec![0.0; 1600];
            player.fill(&mut out, &mut queue);
            [0, 1].map(|channel| out.iter().skip(channel).step_by(2).map(|p| f64::from(p * p)).sum::<f64>())
        };
        let ([left, none], [silent, right]) = (level([true, false]), level([false, true]));
        assert!(none < 1e-9 * left && silent < 1e-9 * right, "{left} {none} {silent} {right}");
        let both = level([true, true]);
        assert!((both[0] / left - 1.0).abs() < 1e-6 && (both[1] / right - 1.0).abs() < 1e-6, "{both:?}");
    }
}
