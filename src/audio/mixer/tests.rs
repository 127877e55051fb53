//! Tests of the mixer: levels through every output, delays, and that nothing clicks.

use super::*;
use crate::audio::ears::{HEAD_RADIUS_M, SPEED_OF_SOUND};
use crate::stage::{BUILT_IN, SoundOutput, Stage};
use nalgebra::{Isometry3, Point3, Vector3};

const RATE: f64 = 48_000.0;

/// The CyberStage heard from this output.
fn listening(output: SoundOutput) -> (Stage, Listening) {
    let mut stage = Stage::find("cyberstage").unwrap();
    stage.sound.output = output;
    let listening = Listening::new(&stage);
    (stage, listening)
}

const OUTPUTS: [SoundOutput; 3] = [SoundOutput::Loudspeakers, SoundOutput::Headphones, SoundOutput::Stereo];

fn tone(hz: f64, k: usize) -> f32 {
    (std::f64::consts::TAU * hz * k as f64 / RATE).sin() as f32
}

/// Pressures at the channels of a tone of 1 Pa at 1 m, in blocks of 256 frames; the paths of each block from `paths`.
fn pressures(listening: &Listening, hz: f64, blocks: usize, paths: impl Fn(usize) -> Paths) -> Vec<f32> {
    let mut mixer = Mixer::new(listening, RATE, 1);
    let block = |k: usize| {
        let samples: Vec<f32> = (0..256).map(|i| tone(hz, 256 * k + i)).collect();
        let mut out = vec![0.0; 256 * listening.channels()];
        mixer.add(0, &paths(k), &samples, &mut out);
        out
    };
    (0..blocks).flat_map(block).collect()
}

/// Amplitude of a tone in a channel, from its second half.
fn amplitude(samples: &[f32], channel: usize, channels: usize, hz: f64) -> f64 {
    let mine: Vec<f64> = samples.iter().skip(channel).step_by(channels).map(|x| f64::from(*x)).collect();
    // Whole periods: 480 samples are 10 ms.
    let start = mine.len() - 4800;
    let sum = |wave: fn(f64) -> f64| {
        let phase = |k: usize| std::f64::consts::TAU * hz * k as f64 / RATE;
        mine[start..].iter().enumerate().map(|(k, x)| x * wave(phase(k))).sum::<f64>() / 2400.0
    };
    sum(f64::sin).hypot(sum(f64::cos))
}

#[test]
fn a_pascal_at_a_metre_is_a_pascal_at_the_head() {
    let (stage, listening) = listening(SoundOutput::Loudspeakers);
    let mut head = stage.viewer.room_from_head;
    for shift in [Vector3::zeros(), Vector3::new(0.5, -0.3, -0.8)] {
        head.translation.vector += shift;
        let place = Point3::from(head.translation.vector);
        let loudspeaker = stage.sound.loudspeakers[2].position;
        // On the ray of a loudspeaker, 2 m away: that one alone makes half a pascal at the head.
        let source = place + (loudspeaker - place).normalize() * 2.0;
        let sound = pressures(&listening, 1000.0, 40, |_| listening.paths(&head, &source));
        let calibrated_m =
            (loudspeaker - Point3::from(stage.viewer.room_from_head.translation.vector)).norm();
        let at_head = amplitude(&sound, 2, 8, 1000.0) * calibrated_m / (loudspeaker - place).norm();
        assert!((at_head - 0.5).abs() < 1e-4, "{at_head}");
        assert!((0..8).filter(|&k| k != 2).all(|k| amplitude(&sound, k, 8, 1000.0) < 1e-6));
    }
}

/// 94 dB re 20 µPa are 1.0024 Pa, by which a sine at full scale is defined; so a tone of 1 Pa RMS comes out just below it.
#[test]
fn full_scale_is_the_loudest_level() {
    for output in OUTPUTS {
        let (_, listening) = listening(output);
        let mut mixer = Mixer::new(&listening, RATE, 1);
        let mut out = vec![1.0; 4 * listening.channels()];
        mixer.finish(&mut out);
        assert!(
            (f64::from(out[0]) * 20e-6 * 10f64.powf(94.0 / 20.0) * 2f64.sqrt() - 1.0).abs() < 1e-6,
            "{out:?}"
        );
        out.fill(100.0);
        mixer.finish(&mut out);
        assert!(out.iter().all(|sample| sample.abs() <= 1.0) && mixer.limited() == 4, "{out:?}");
    }
}

/// Low tones have 1/r at both ears; at high ones the near ear has twice that and the far one a seventh of it.
#[test]
fn headphones_have_the_levels_of_a_sphere() {
    let (_, listening) = listening(SoundOutput::Headphones);
    let head = Isometry3::identity();
    let levels = |hz: f64| {
        let sound = pressures(&listening, hz, 80, |_| listening.paths(&head, &Point3::new(2.0, 0.0, 0.0)));
        [0, 1].map(|ear| amplitude(&sound, ear, 2, hz))
    };
    // |H| by Brown and Duda's equation 3 with ω₀ = c/a.
    let shadow = |alpha: f64, hz: f64| {
        let x = std::f64::consts::TAU * hz * HEAD_RADIUS_M / (2.0 * SPEED_OF_SOUND);
        (1.0 + (alpha * x).powi(2)).sqrt() / (1.0 + x * x).sqrt()
    };
    for (hz, tolerance) in [(100.0, 1e-3), (1000.0, 1e-2), (4000.0, 0.05)] {
        let [left, right] = levels(hz);
        for (found, alpha) in [(left, 0.281_43), (right, 2.0)] {
            let expected = 0.5 * shadow(alpha, hz);
            assert!((found / expected - 1.0).abs() < tolerance, "{hz}: {found} is not {expected}");
        }
    }
}

/// A click from the right arrives a/c (1 + π/2) earlier at the right ear: 31.5 samples.
#[test]
fn the_far_ear_hears_a_click_later() {
    let (_, listening) = listening(SoundOutput::Headphones);
    let mut mixer = Mixer::new(&listening, RATE, 1);
    let mut click = [0.0; 256];
    click[100] = 1.0;
    let mut out = vec![0.0; 512];
    let paths = listening.paths(&Isometry3::identity(), &Point3::new(1.0, 0.0, 0.0));
    mixer.add(0, &paths, &click, &mut out);
    let first = |ear: usize| out.iter().skip(ear).step_by(2).position(|sample| sample.abs() > 0.01).unwrap();
    let expected = HEAD_RADIUS_M / SPEED_OF_SOUND * (1.0 + std::f64::consts::FRAC_PI_2) * RATE;
    assert!(((first(0) - first(1)) as f64 - expected).abs() < 1.5, "{} {}", first(0), first(1));
}

/// A source that jumps across the room within one block: no step is larger than the loudest tone's own, with the sweep of the delay.
#[test]
fn a_source_that_jumps_makes_no_click() {
    for output in OUTPUTS {
        let (stage, listening) = listening(output);
        let head = stage.viewer.room_from_head;
        let [near, far] = [Point3::new(-0.5, 1.2, -0.4), Point3::new(1.2, 2.0, 1.0)];
        let paths = |k: usize| listening.paths(&head, if k % 8 < 4 { &near } else { &far });
        let (hz, channels) = (500.0, listening.channels());
        let sound = pressures(&listening, hz, 64, paths);
        let loudest = sound.iter().fold(0.0f32, |peak, x| peak.max(x.abs()));
        for channel in 0..channels {
            let mine: Vec<f32> = sound.iter().skip(channel).step_by(channels).copied().collect();
            let steps = mine[1..].windows(2).map(|pair| (pair[1] - pair[0]).abs());
            let own = std::f64::consts::TAU * hz / RATE * f64::from(loudest);
            let worst = f64::from(steps.fold(0.0, f32::max)) / own;
            assert!(worst < 1.5, "{output:?} {channel}: {worst}");
        }
    }
}

#[test]
fn a_cleared_source_begins_anew() {
    let (stage, listening) = listening(SoundOutput::Headphones);
    let paths = listening.paths(&stage.viewer.room_from_head, &Point3::new(0.3, 1.5, 0.0));
    let mut mixer = Mixer::new(&listening, RATE, 2);
    let mut out = vec![0.0; 512];
    mixer.add(1, &paths, &[1.0; 256], &mut out);
    mixer.clear(1);
    out.fill(0.0);
    mixer.add(1, &paths, &[0.0; 256], &mut out);
    mixer.add(7, &paths, &[1.0; 256], &mut out);
    assert!(out.iter().all(|sample| *sample == 0.0), "no such source, and nothing left of the other");
}

#[test]
fn every_stage_can_be_heard() {
    for (name, _) in BUILT_IN {
        let stage = Stage::find(name).unwrap();
        let listening = Listening::new(&stage);
        let paths = listening.paths(&stage.viewer.room_from_head, &stage.workspace.centre);
        let power: f32 = paths.0.iter().map(|path| path.gain * path.gain).sum();
        assert!(power > 0.01 && listening.channels() >= 2, "{name}: {power}");
        let nowhere = listening.paths(&stage.viewer.room_from_head, &Point3::new(f64::NAN, 0.0, 0.0));
        assert!(nowhere.0.iter().all(|path| path.gain == 0.0));
    }
}
