//! Adds sources to channels, block by block, where a block must be made in time: no allocation, no lock.
//!
//! In: for each source its pressure at 1 m and its [`Paths`]. Out: samples for all channels. Gains, delays and shadows go in a
//! straight line from the last block's to this block's.

use super::ears::SHADOW_S;
use super::limiter::Limiter;
use super::line::DelayLine;
use super::listening::Listening;
use super::paths::{MOST_CHANNELS, Paths};

/// Sources on their way to the channels.
#[derive(Clone, Debug)]
pub struct Mixer {
    channels: usize,
    rate_hz: f32,
    /// 2 τ times the sample rate: the bilinear transform of the head's shadow.
    shadow: f32,
    per_pa: f32,
    sources: Vec<Source>,
    limiter: Limiter,
}

#[derive(Clone, Debug)]
struct Source {
    line: DelayLine,
    /// Paths at the end of the last block; `None` before the first.
    paths: Option<Paths>,
    /// The last sample before and after the shadow, by channel.
    shadows: [[f32; 2]; MOST_CHANNELS],
}

impl Mixer {
    pub fn new(listening: &Listening, rate_hz: f64, sources: usize) -> Mixer {
        let source =
            Source { line: DelayLine::new(rate_hz), paths: None, shadows: [[0.0; 2]; MOST_CHANNELS] };
        Mixer {
            channels: listening.channels().max(1),
            rate_hz: rate_hz as f32,
            shadow: (2.0 * SHADOW_S * rate_hz) as f32,
            per_pa: (1.0 / listening.full_scale_pa) as f32,
            sources: vec![source; sources],
            limiter: Limiter::new(rate_hz),
        }
    }

    /// Adds a block of a source: `samples` is its pressure at 1 m in Pa, `out` the frames of all channels, interleaved. A source that
    /// has no block is as if time had stood still for it; [`Mixer::clear`] ends that.
    pub fn add(&mut self, source: usize, paths: &Paths, samples: &[f32], out: &mut [f32]) {
        let Some(source) = self.sources.get_mut(source) else { return };
        let before = source.paths.replace(*paths).unwrap_or(*paths);
        let step = 1.0 / samples.len() as f32;
        for (k, (sample, frame)) in samples.iter().zip(out.chunks_exact_mut(self.channels)).enumerate() {
            source.line.push(*sample);
            let now = (k + 1) as f32 * step;
            for (channel, sum) in frame.iter_mut().enumerate() {
                let [from, to] = [&before.0[channel], &paths.0[channel]];
                if from.gain == 0.0 && to.gain == 0.0 {
                    continue;
                }
                let path = from.towards(to, now);
                let heard = source.line.read(path.delay_s * self.rate_hz);
                let state = &mut source.shadows[channel];
                let heard =
                    if path.shadow == 1.0 { heard } else { shadowed(heard, path.shadow, self.shadow, state) };
                *sum += path.gain * heard;
            }
        }
    }

    /// Forgets what is on its way from a source, so that it begins anew.
    pub fn clear(&mut self, source: usize) {
        if let Some(source) = self.sources.get_mut(source) {
            source.line.clear();
            source.paths = None;
            source.shadows = [[0.0; 2]; MOST_CHANNELS];
        }
    }

    /// Makes samples, within -1 and 1, of the pressures of a block.
    pub fn finish(&mut self, out: &mut [f32]) {
        for frame in out.chunks_mut(self.channels) {
            frame.iter_mut().for_each(|sample| *sample *= self.per_pa);
            self.limiter.frame(frame);
        }
    }

    /// The number of frames that were louder than the output can be, and so were turned down.
    pub fn limited(&self) -> u64 {
        self.limiter.limited
    }
}

/// H(s) = (1 + α τ s) / (1 + τ s) by the bilinear transform s = 2 rate (1 - z⁻¹) / (1 + z⁻¹); `twice` is 2 τ rate.
fn shadowed(sample: f32, alpha: f32, twice: f32, state: &mut [f32; 2]) -> f32 {
    let [before, answered] = *state;
    let answer = ((1.0 + alpha * twice) * sample + (1.0 - alpha * twice) * before - (1.0 - twice) * answered)
        / (1.0 + twice);
    *state = [sample, answer];
    answer
}

#[cfg(test)]
mod tests;
