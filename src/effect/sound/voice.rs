//! The sound of one source, sample by sample.
//!
//! In: phrases of its frames. Out: pressure at 1 m, Pa. Nothing here allocates, locks or waits once a voice is made: what is fresh is swapped
//! with what it replaces.

use super::noise::Noise;
use super::phrase::{Beat, Phrase};
use super::ringing::Ringing;
use super::sine::Sine;
use nalgebra::Complex;

/// |z|² below which a tone has ended, kg m².
const FADED: f64 = 1e-40;
/// Time in which tones that are replaced fade away, s.
const FADE_S: f64 = 0.005;

/// The sound of one source.
#[derive(Debug)]
pub struct Voice {
    rate_hz: f64,
    ringing: Ringing,
    /// Tones that were replaced, and samples until they have faded away.
    fading: Ringing,
    left: usize,
    noise: Noise,
    tone: Sine,
}

impl Voice {
    /// A silent voice, whose noise is another one for each seed.
    pub fn new(rate_hz: f64, seed: u64) -> Voice {
        let (ringing, fading) = (Ringing::default(), Ringing::default());
        let (noise, tone) = (Noise::new(rate_hz, seed), Sine::new(rate_hz));
        Voice { rate_hz, ringing, fading, left: 0, noise, tone }
    }

    /// Begins a phrase that ends after so many samples; what it replaces goes into it in the end.
    pub fn begin(&mut self, phrase: &mut Phrase, samples: usize) {
        phrase.noise.iter().for_each(|aim| self.noise.go(aim, samples));
        phrase.tone.iter().for_each(|aim| self.tone.go(aim, samples));
        let Some(fresh) = &mut phrase.fresh else { return };
        std::mem::swap(&mut self.ringing, fresh);
        std::mem::swap(&mut self.fading, fresh);
        self.left = if self.fading.tones.is_some() { self.fade() } else { 0 };
    }

    /// Begins a step `late_s` after it should have begun.
    pub fn beat(&mut self, beat: &Beat, late_s: f64) {
        let Some(tones) = &self.ringing.tones else { return };
        for ((z, tone), jump) in self.ringing.z.iter_mut().zip(&tones.all).zip(&beat.jumps) {
            *z += jump * (tone.rate * late_s).exp();
        }
    }

    /// Writes the next samples.
    pub fn fill(&mut self, samples: &mut [f32]) {
        samples.fill(0.0);
        self.ring(samples);
        self.noise.add(samples);
        self.tone.add(samples);
    }

    fn ring(&mut self, samples: &mut [f32]) {
        if self.left == 0 {
            return self.ringing.add(samples, |_| 1.0);
        }
        let (fade, left) = (self.fade() as f64, self.left);
        let old = move |n: usize| left.saturating_sub(n) as f64 / fade;
        self.fading.add(samples, old);
        self.ringing.add(samples, |n| 1.0 - old(n));
        self.left = left.saturating_sub(samples.len());
    }

    fn fade(&self) -> usize {
        (FADE_S * self.rate_hz).ceil() as usize
    }
}

impl Ringing {
    /// Adds the next samples, each with its gain.
    fn add(&mut self, samples: &mut [f32], gain: impl Fn(usize) -> f64) {
        for ((z, turn), pressure) in self.z.iter_mut().zip(&self.turns).zip(&self.pressures) {
            for (n, sample) in samples.iter_mut().enumerate() {
                *sample += (gain(n) * (z.re * pressure.re - z.im * pressure.im)) as f32;
                *z *= *turn;
            }
            // What has faded away would be computed with ever smaller numbers, slowly.
            if z.norm_sqr() < FADED {
                *z = Complex::ZERO;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::listener::Listener;
    use super::super::radiation::Radiator;
    use super::*;
    use crate::world::vibration::{ModeStep, Vibration, VibrationModes, VibrationStep};
    use nalgebra::Vector3;
    use std::f64::consts::TAU;
    use std::sync::Arc;

    const RATE_HZ: f64 = 48_000.0;
    const FRAME_S: f64 = 1.0 / 60.0;

    /// A small ball whose breathing modes have these frequencies, Hz, and decays, 1/s.
    fn body(modes: &[[f64; 2]]) -> (Arc<VibrationModes>, Radiator) {
        let nodes: [[f32; 3]; 6] = std::array::from_fn(|i| {
            let mut place = [0.0; 3];
            place[i / 2] = if i % 2 == 0 { 0.05 } else { -0.05 };
            place
        });
        let faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
        let outward: Vec<Vector3<f32>> = nodes.iter().map(|node| Vector3::from(*node) * 20.0).collect();
        let square = |[hertz, decay]: &[f64; 2]| (TAU * hertz).powi(2) + decay * decay;
        let modes = VibrationModes {
            squares: modes.iter().map(square).collect(),
            decays: modes.iter().map(|[_, decay]| *decay).collect(),
            shapes: vec![outward; modes.len()],
        };
        (Arc::new(modes), Radiator::new(&nodes, &faces))
    }

    /// x and ẋ of a mode at rest that a load of 1 has pulled since t = 0.
    fn pulled([hertz, decay]: [f64; 2], t: f64) -> [f64; 2] {
        let (omega, fading) = (TAU * hertz, (-decay * t).exp());
        let square = omega * omega + decay * decay;
        let (sine, cosine) = (omega * t).sin_cos();
        [(1.0 - fading * (cosine + decay / omega * sine)) / square, fading * sine / omega]
    }

    /// A load that sets in within a frame and stays is heard as ẋ has it, from step to step and from frame to frame.
    #[test]
    fn a_voice_plays_the_speed_of_its_modes() {
        let of = [1234.0, 30.0];
        let (modes, radiator) = body(&[of]);
        let mut listener = Listener::new(RATE_HZ);
        let mut voice = Voice::new(RATE_HZ, 0);
        let pressure = radiator.pressure(&modes.shapes[0], TAU * of[0]);
        let begins_s = 0.004;
        let mut heard = Vec::new();
        for frame in 0..6 {
            let from_s = FRAME_S * f64::from(frame);
            let ends = if frame == 0 { vec![begins_s, FRAME_S] } else { vec![0.3 * FRAME_S, FRAME_S] };
            let (mut at_s, mut steps) = (0.0, Vec::new());
            for end_s in ends {
                let since = from_s + at_s - begins_s;
                let is_pulled = since > -1e-9;
                let state = if is_pulled { pulled(of, since) } else { [0.0; 2] };
                let load = [if is_pulled { 1.0 } else { 0.0 }, 0.0, 0.0];
                let mode = ModeStep { state, load, ..ModeStep::default() };
                steps.push(VibrationStep { dt_s: end_s - at_s, modes: vec![mode] });
                at_s = end_s;
            }
            let mut phrase = listener.phrase(&Vibration { modes: modes.clone(), steps }, &radiator);
            voice.begin(&mut phrase, 800);
            let mut samples = vec![0.0; 800];
            let mut done = 0;
            for (n, beat) in phrase.beats.iter().enumerate() {
                let place = |at_s: f64| ((at_s * RATE_HZ).ceil() as usize).min(800);
                let end = phrase.beats.get(n + 1).map_or(800, |next| place(next.at_s));
                voice.beat(beat, done as f64 / RATE_HZ - beat.at_s);
                voice.fill(&mut samples[done..end]);
                done = end;
            }
            heard.extend(samples);
        }
        let speed = |n: usize| {
            let since = n as f64 / RATE_HZ - begins_s;
            if since > 0.0 { pressure * pulled(of, since)[1] } else { 0.0 }
        };
        let loudest = pressure / (TAU * of[0]);
        let mut most = 0.0_f64;
        for (n, heard) in heard.iter().enumerate() {
            let off = f64::from(*heard) - speed(n);
            most = most.max(off.abs() / loudest);
            assert!(off.abs() < 3e-7 * loudest, "sample {n}: {heard} {}", speed(n));
        }
        println!("samples {most:e}");
    }

    /// A body rings on and fades where no frame comes.
    #[test]
    fn a_voice_without_a_next_frame_fades_as_its_modes_do() {
        let (modes, radiator) = body(&[[440.0, 20.0], [880.0, 20.0], [30_000.0, 20.0], [3.0, 1.0]]);
        let struck = ModeStep { state: [0.0, 1.0], ..ModeStep::default() };
        let steps = vec![VibrationStep { dt_s: FRAME_S, modes: vec![struck; 4] }];
        let mut phrase = Listener::new(RATE_HZ).phrase(&Vibration { modes, steps }, &radiator);
        assert_eq!(phrase.beats[0].jumps.len(), 2, "neither what is too high nor too low to be heard");
        let mut voice = Voice::new(RATE_HZ, 0);
        voice.begin(&mut phrase, 800);
        voice.beat(&phrase.beats[0], 0.0);
        let level = |voice: &mut Voice| {
            let mut samples = [0.0; 4800];
            voice.fill(&mut samples);
            samples.iter().map(|p| f64::from(p * p)).sum::<f64>().sqrt()
        };
        let (first, second) = (level(&mut voice), level(&mut voice));
        // 0.1 s at 20 1/s.
        assert!((second / first - (-2.0_f64).exp()).abs() < 1e-3, "{first} {second}");
        (0..60).for_each(|_| voice.fill(&mut [0.0; 4800]));
        assert_eq!(level(&mut voice), 0.0, "it ends");
    }

    /// A hand that takes an element changes the modes. Where the motion goes on, nothing is heard of that.
    #[test]
    fn tones_that_are_replaced_while_they_ring_do_not_click() {
        let play = |swaps: bool| {
            let (modes, radiator) = body(&[[500.0, 0.0]]);
            let (others, _) = body(&[[500.0, 0.0]]);
            let (mut listener, mut voice) = (Listener::new(RATE_HZ), Voice::new(RATE_HZ, 0));
            let mut heard = Vec::new();
            for frame in 0..6 {
                let omega = TAU * 500.0;
                let turn = omega * f64::from(frame) * FRAME_S;
                let mode = ModeStep { state: [turn.sin() / omega, turn.cos()], ..ModeStep::default() };
                let steps = vec![VibrationStep { dt_s: FRAME_S, modes: vec![mode] }];
                let modes = if swaps && frame >= 3 { others.clone() } else { modes.clone() };
                let mut phrase = listener.phrase(&Vibration { modes, steps }, &radiator);
                assert_eq!(phrase.fresh.is_some(), frame == 0 || swaps && frame == 3);
                voice.begin(&mut phrase, 800);
                voice.beat(&phrase.beats[0], 0.0);
                let mut samples = [0.0; 800];
                // In pieces, as a device asks for them.
                samples.chunks_mut(130).for_each(|piece| voice.fill(piece));
                heard.extend(samples);
            }
            heard
        };
        let (same, swapped) = (play(false), play(true));
        let loudest = same.iter().fold(0.0_f32, |most, sample| most.max(sample.abs()));
        let off = same.iter().zip(&swapped).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 1e-6 * loudest, "{off} of {loudest}");
    }
}
