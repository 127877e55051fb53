//! Mixer and player run in the audio thread, which must not wait for memory.

use crate::memory;
use greenstage::audio::{Listening, Mixer};
use greenstage::effect::sound::{Frames, Listener, NoiseAim, Player, Radiator, SineAim, SoundFrame};
use greenstage::stage::{SoundOutput, Stage};
use greenstage::world::vibration::{ModeStep, Vibration, VibrationModes, VibrationStep};
use nalgebra::{Point3, Vector3};
use std::collections::VecDeque;
use std::sync::Arc;

/// Blocks of sources that move, through each output, allocate nothing, also where the limiter acts.
#[test]
fn mixing_allocates_nothing() {
    for output in [SoundOutput::Loudspeakers, SoundOutput::Headphones, SoundOutput::Stereo] {
        let mut stage = Stage::find("cyberstage").unwrap();
        stage.sound.output = output;
        let listening = Listening::new(&stage);
        let mut mixer = Mixer::new(&listening, 48_000.0, 4);
        let samples: Vec<f32> = (0..256).map(|k| (k as f32 * 0.1).sin()).collect();
        let mut out = vec![0.0; samples.len() * listening.channels()];
        let path = |k: usize| {
            let place = Point3::new((k as f64).sin(), 1.2, (k as f64).cos());
            listening.paths(&stage.viewer.room_from_head, &place)
        };
        let paths: Vec<_> = (0..32).map(path).collect();
        let mix = || {
            for (k, paths) in paths.iter().enumerate() {
                out.fill(0.0);
                mixer.add(k % 4, paths, &samples, &mut out);
                out[0] = 1e3;
                mixer.finish(&mut out);
            }
        };
        let ((), bytes) = memory::peak_of(mix);
        assert_eq!(bytes, 0, "{output:?}");
    }
}

/// Frames that come one after the other and are kept when they were played.
struct Kept {
    coming: VecDeque<Box<SoundFrame>>,
    done: VecDeque<Box<SoundFrame>>,
}

impl Frames for Kept {
    fn next(&mut self) -> Option<Box<SoundFrame>> {
        self.coming.pop_front()
    }

    fn done(&mut self, frame: Box<SoundFrame>) {
        self.done.push_back(frame);
    }

    fn waiting(&self) -> usize {
        self.coming.len()
    }
}

/// New tones, steps within a frame, noise and pitch, frames that have piled up and none at all: nothing is allocated or freed.
#[test]
fn playing_allocates_nothing() {
    let stage = Stage::find("cyberstage").unwrap();
    let listening = Listening::new(&stage);
    let radiator = Radiator::new(&[[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], &[[0, 1, 2]]);
    let mut listener = Listener::new(48_000.0);
    let paths = listening.paths(&stage.viewer.room_from_head, &Point3::new(0.0, 1.0, -1.0));
    let modes = |count: usize| {
        let squares = (0..count).map(|k| (500.0 * (k + 1) as f64).powi(2)).collect();
        let shapes = vec![vec![Vector3::z(); 3]; count];
        Arc::new(VibrationModes { squares, decays: vec![3.0; count], shapes })
    };
    let sets = [modes(3), modes(40)];
    let mut frame = |number: usize| {
        let modes = sets[number / 5 % 2].clone();
        let struck = ModeStep { state: [0.0, 1.0], load: [0.1, 0.2, 0.0], kick: 0.1 };
        let step = VibrationStep { dt_s: 1.0 / 480.0, modes: vec![struck; modes.squares.len()] };
        let mut phrase = listener.phrase(&Vibration { modes, steps: vec![step; 8] }, &radiator);
        phrase.noise = Some(NoiseAim { square: 1e-3 * (number % 3) as f64, hertz: 300.0 * number as f64 });
        phrase.tone = Some(SineAim { pressure: 1e-2, hertz: 110.0 + 20.0 * number as f64 });
        Box::new(SoundFrame { samples: 800, offset: 0.0, phrases: vec![phrase], paths: vec![paths] })
    };
    let coming: VecDeque<_> = (0..20).map(&mut frame).collect();
    let mut frames = Kept { done: VecDeque::with_capacity(coming.len()), coming };
    let mut player = Player::new(&listening, 48_000.0, 1);
    let mut out = vec![0.0; 256 * listening.channels()];
    let ((), bytes) = memory::peak_of(|| (0..80).for_each(|_| player.fill(&mut out, &mut frames)));
    assert_eq!((bytes, frames.done.len()), (0, 20));
    assert!(out.iter().any(|sample| *sample != 0.0));
}
