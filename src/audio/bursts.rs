//! The test signal of an installation: loudspeaker k gives k short tones and a long one, one loudspeaker after the other.
//!
//! In: a [`Listening`] and a sample rate. Out: samples, and which channel sounds at a moment. The tones have 1 kHz and 70 dB re
//! 20 µPa where the loudspeaker is calibrated: that is what a sound level meter in the viewer's place
//! shall show during the long one.

use super::listening::{Listening, REFERENCE_PA};
use std::f64::consts::TAU;

const TONE_HZ: f64 = 1000.0;
/// RMS sound pressure level of a tone, dB; less where the stage cannot be so loud.
const LEVEL_DB: f64 = 70.0;
/// A short tone's length, and that of the gap after it, s.
const TONE_S: f64 = 0.12;
/// The long tone's length, in which a meter comes to rest, s.
const LONG_S: f64 = 1.5;
/// Silence after the tones of a loudspeaker, s.
const PAUSE_S: f64 = 0.8;
/// A tone swells and fades by half a cosine, s.
const EDGE_S: f64 = 0.01;

/// Tones for all channels of a stage.
#[derive(Clone, Debug)]
pub struct Bursts {
    channels: usize,
    rate_hz: f64,
    /// Amplitude of the tone; 1 is full scale.
    amplitude: f64,
    frame: u64,
}

impl Bursts {
    pub fn new(listening: &Listening, rate_hz: f64) -> Bursts {
        let level_pa = std::f64::consts::SQRT_2 * REFERENCE_PA * 10f64.powf(LEVEL_DB / 20.0);
        let amplitude = (level_pa / listening.full_scale_pa).min(1.0);
        Bursts { channels: listening.channels(), rate_hz, amplitude, frame: 0 }
    }

    /// When a channel begins, and how long it and its pause take, s.
    pub fn turn_s(channel: usize) -> (f64, f64) {
        let length = |channel: usize| 2.0 * TONE_S * (channel + 1) as f64 + LONG_S + PAUSE_S;
        ((0..channel).map(length).sum(), length(channel))
    }

    /// The time that all channels take once, s.
    pub fn round_s(&self) -> f64 {
        Bursts::turn_s(self.channels).0
    }

    /// The channel that has its turn at a time since the start.
    pub fn channel_at(&self, time_s: f64) -> usize {
        let time_s = time_s % self.round_s();
        (0..self.channels).rfind(|&channel| Bursts::turn_s(channel).0 <= time_s).unwrap_or(0)
    }

    /// Writes the next frames; samples of silent channels stay as they are.
    pub fn fill(&mut self, out: &mut [f32]) {
        for frame in out.chunks_mut(self.channels.max(1)) {
            let time_s = (self.frame as f64 / self.rate_hz) % self.round_s();
            let channel = self.channel_at(time_s);
            if let Some(sample) = frame.get_mut(channel) {
                *sample = (self.amplitude * tone(time_s - Bursts::turn_s(channel).0, channel + 1)) as f32;
            }
            self.frame += 1;
        }
    }
}

/// The sample of so many short tones and the long one, `time_s` after the first begins.
fn tone(time_s: f64, count: usize) -> f64 {
    let long_s = time_s - 2.0 * TONE_S * count as f64;
    let (within_s, length_s) =
        if long_s < 0.0 { (time_s % (2.0 * TONE_S), TONE_S) } else { (long_s, LONG_S) };
    if within_s > length_s {
        return 0.0;
    }
    let edge = (within_s.min(length_s - within_s) / EDGE_S).min(1.0);
    (0.5 - 0.5 * (edge * TAU / 2.0).cos()) * (TAU * TONE_HZ * within_s).sin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::Stage;

    /// Each of the CyberStage's eight loudspeakers gives as many short tones as its number and a long one, alone, and at 70 dB.
    #[test]
    fn loudspeaker_k_gives_k_tones_of_70_db() {
        let listening = Listening::new(&Stage::find("cyberstage").unwrap());
        let mut bursts = Bursts::new(&listening, 48_000.0);
        let frames = (bursts.round_s() * 48_000.0).round() as usize;
        let mut out = vec![0.0; 8 * frames];
        out.chunks_mut(1000).for_each(|block| bursts.fill(block));
        for channel in 0..8 {
            let mine: Vec<f32> = out.iter().skip(channel).step_by(8).copied().collect();
            let (start_s, length_s) = Bursts::turn_s(channel);
            // Loud or not, in pieces of a short tone's length from the first tone on: 12.5 of them make the long one.
            let pieces = mine[(start_s * 48_000.0).round() as usize..].chunks(5760);
            let loud = pieces.filter(|piece| piece.iter().any(|x| x.abs() > 0.02)).count();
            assert_eq!(loud, channel + 1 + 13);
            let own = (start_s * 48_000.0).round() as usize..((start_s + length_s) * 48_000.0) as usize;
            assert!(mine.iter().enumerate().all(|(k, x)| own.contains(&k) || *x == 0.0));
            // Ten periods in the middle of the first tone, and of the long one.
            for at in [2400, 11_520 * (channel + 1) + 36_000].map(|at| own.start + at) {
                let power = mine[at..at + 480].iter().map(|x| f64::from(x * x)).sum::<f64>() / 480.0;
                let level_db = 94.0 + 20.0 * (power.sqrt() * 2f64.sqrt()).log10();
                assert!((level_db - 70.0).abs() < 0.01, "{level_db}");
            }
            assert_eq!(bursts.channel_at(start_s + 0.1 + 3.0 * bursts.round_s()), channel);
        }
        let steps = out.iter().zip(&out[8..]).map(|(a, b)| (b - a).abs()).fold(0.0, f32::max);
        assert!(steps < 0.01, "no click: {steps}");
    }
}
