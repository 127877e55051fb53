//! Plays through an audio device of the system (ALSA on Linux).
//!
//! In: what a stage is heard from, and a function that makes samples. Out: an open device that calls it in a thread of its own, with
//! 48 kHz and buffers of 256 frames where the device has them. A device that goes away ends nothing: [`Playback::failure`] tells.

use super::error::AudioError;
use super::fill::Fill;
use super::listening::Listening;
use crate::config;
use cpal::traits::{DeviceTrait, HostTrait, StreamTrait};
use cpal::{
    BufferSize, ErrorKind, FromSample, SampleFormat, SizedSample, StreamConfig, SupportedBufferSize,
    SupportedStreamConfigRange,
};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

const USUAL_RATE_HZ: u32 = 48_000;
/// Frames of the device's buffer where it can be chosen, and the most that are made at a time.
const FRAMES: usize = 256;
/// Formats from the best on; what they are made from is f32.
const FORMATS: [SampleFormat; 3] = [SampleFormat::F32, SampleFormat::I32, SampleFormat::I16];

/// An audio device that plays until this is dropped.
pub struct Playback {
    device: String,
    rate_hz: u32,
    /// Frames of the device's buffer.
    buffer: Option<u32>,
    events: Arc<Events>,
    _stream: cpal::Stream,
}

/// Events that the device reports from its own thread.
#[derive(Debug, Default)]
struct Events {
    failure: OnceLock<String>,
    gaps: AtomicU64,
}

impl Playback {
    /// Opens the device that `listening` names, or the system's own, and plays what `fill` makes; `fill` is made for the
    /// device's sample rate in Hz.
    pub fn start(listening: &Listening, fill: impl FnOnce(f64) -> Fill) -> Result<Playback, AudioError> {
        // ALSA's library writes to standard error what the errors here say.
        let _quiet = alsa::Output::local_error_handler();
        let device = find(listening.device.as_deref())?;
        let name = name(&device);
        let failed =
            |error: cpal::Error| AudioError::Device { device: name.clone(), message: advice(&error) };
        let offered = device.supported_output_configs().map(Iterator::collect::<Vec<_>>);
        let offered = offered.map_err(|error| match (error.kind(), &listening.device) {
            // The system has a name for its own device, and nothing behind it.
            (ErrorKind::DeviceNotAvailable, None) => AudioError::NoDevice,
            _ => failed(error),
        })?;
        let (config, format) = choose(offered, &name, listening.channels())?;
        let events = Arc::new(Events::default());
        let fill = Channels::new(fill(f64::from(config.sample_rate)), listening.channels(), config.channels);
        let stream = match format {
            SampleFormat::F32 => stream::<f32>(&device, config, fill, &events),
            SampleFormat::I32 => stream::<i32>(&device, config, fill, &events),
            _ => stream::<i16>(&device, config, fill, &events),
        }
        .map_err(failed)?;
        stream.play().map_err(failed)?;
        let buffer = stream.buffer_size().ok();
        Ok(Playback { device: name, rate_hz: config.sample_rate, buffer, events, _stream: stream })
    }

    /// The device's name.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Samples per second and channel.
    pub fn rate_hz(&self) -> f64 {
        f64::from(self.rate_hz)
    }

    /// Length of the device's buffer, if it tells: a sample is heard so much later at least.
    pub fn buffer_s(&self) -> Option<f64> {
        self.buffer.map(|frames| f64::from(frames) / self.rate_hz())
    }

    /// Number of times that the device ran out of samples.
    pub fn gaps(&self) -> u64 {
        self.events.gaps.load(Ordering::Relaxed)
    }

    /// The reason why the device plays no more.
    pub fn failure(&self) -> Option<&str> {
        self.events.failure.get().map(String::as_str)
    }
}

impl Events {
    fn take(&self, error: &cpal::Error) {
        match error.kind() {
            ErrorKind::Xrun => drop(self.gaps.fetch_add(1, Ordering::Relaxed)),
            // The device plays on.
            ErrorKind::DeviceChanged | ErrorKind::RealtimeDenied => tracing::debug!("audio: {error}"),
            _ => drop(self.failure.set(advice(error))),
        }
    }
}

/// Fills the channels that the stage needs, and leaves the device's others silent.
struct Channels {
    fill: Fill,
    wanted: usize,
    of_device: usize,
    block: Vec<f32>,
}

impl Channels {
    fn new(fill: Fill, wanted: usize, of_device: u16) -> Channels {
        Channels { fill, wanted, of_device: usize::from(of_device), block: vec![0.0; FRAMES * wanted] }
    }

    fn write<T: SizedSample + FromSample<f32>>(&mut self, out: &mut [T]) {
        for out in out.chunks_mut(FRAMES * self.of_device) {
            let block = &mut self.block[..out.len() / self.of_device * self.wanted];
            block.fill(0.0);
            (self.fill)(block);
            for (to, from) in out.chunks_mut(self.of_device).zip(block.chunks(self.wanted)) {
                to.fill(T::EQUILIBRIUM);
                to.iter_mut().zip(from).for_each(|(to, from)| *to = T::from_sample(*from));
            }
        }
    }
}

fn stream<T: SizedSample + FromSample<f32>>(
    device: &cpal::Device,
    config: StreamConfig,
    mut fill: Channels,
    events: &Arc<Events>,
) -> Result<cpal::Stream, cpal::Error> {
    let events = Arc::clone(events);
    let write = move |out: &mut [T], _: &cpal::OutputCallbackInfo| fill.write(out);
    device.build_output_stream(config, write, move |error| events.take(&error), None)
}

/// The device of this name, or the system's own.
fn find(name_wanted: Option<&str>) -> Result<cpal::Device, AudioError> {
    let host = cpal::default_host();
    let Some(wanted) = name_wanted else { return host.default_output_device().ok_or(AudioError::NoDevice) };
    let devices: Vec<cpal::Device> = host.output_devices().into_iter().flatten().collect();
    let names: Vec<String> = devices.iter().map(name).collect();
    if names.is_empty() {
        return Err(AudioError::NoDevice);
    }
    let described = |device: &cpal::Device| device.description().is_ok_and(|known| known.name() == wanted);
    let found = names.iter().position(|name| name == wanted).or_else(|| devices.iter().position(described));
    found.and_then(|at| devices.into_iter().nth(at)).ok_or_else(|| AudioError::Unknown {
        name: wanted.to_owned(),
        nearest: config::nearest(wanted, names.iter().map(String::as_str)).map(str::to_owned),
        known: names.join(", "),
    })
}

/// The name by which a stage file can ask for a device.
fn name(device: &cpal::Device) -> String {
    device.id().map_or_else(|_| "unnamed".to_owned(), |id| id.id().to_owned())
}

/// The device's configuration with the fewest channels that are enough, the usual rate or the one next to it, and the best format.
fn choose(
    mut offered: Vec<SupportedStreamConfigRange>,
    name: &str,
    wanted: usize,
) -> Result<(StreamConfig, SampleFormat), AudioError> {
    let device = name.to_owned();
    offered.retain(|one| {
        FORMATS.contains(&one.sample_format()) && one.min_sample_rate() <= one.max_sample_rate()
    });
    let Some(found) = offered.iter().map(|one| usize::from(one.channels())).max() else {
        let message = format!("it takes samples in none of the formats {FORMATS:?}; name another device");
        return Err(AudioError::Device { device, message });
    };
    let rate =
        |one: &SupportedStreamConfigRange| USUAL_RATE_HZ.clamp(one.min_sample_rate(), one.max_sample_rate());
    let enough = offered.iter().filter(|one| usize::from(one.channels()) >= wanted);
    let best = enough.min_by_key(|one| {
        let format = FORMATS.iter().position(|format| *format == one.sample_format());
        (one.channels(), rate(one).abs_diff(USUAL_RATE_HZ), format)
    });
    let best = best.ok_or(AudioError::Channels { device, found, wanted })?;
    let buffer_size = match *best.buffer_size() {
        SupportedBufferSize::Range { min, max } if min <= max => {
            BufferSize::Fixed((FRAMES as u32).clamp(min, max))
        }
        _ => BufferSize::Default,
    };
    let config = StreamConfig { channels: best.channels(), sample_rate: rate(best), buffer_size };
    Ok((config, best.sample_format()))
}

/// An error of the device with what to do.
fn advice(error: &cpal::Error) -> String {
    let remedy = match error.kind() {
        ErrorKind::DeviceBusy => "end the other program that uses it, or name another device",
        ErrorKind::DeviceNotAvailable | ErrorKind::StreamInvalidated => "connect it and start again",
        ErrorKind::PermissionDenied => "let this user use it (group `audio`)",
        _ => return error.to_string(),
    };
    format!("{}; {remedy}", error.to_string().trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three channels on a device of four, in buffers longer than a block: each sample in its place, the fourth silent.
    #[test]
    fn channels_that_the_stage_has_not_stay_silent() {
        let mut frame = 0;
        let fill = move |out: &mut [f32]| {
            for channels in out.chunks_mut(3) {
                frame += 1;
                channels.copy_from_slice(&[0.5, -0.25, frame as f32 / 1024.0]);
            }
        };
        let mut channels = Channels::new(Box::new(fill), 3, 4);
        let mut out = vec![7i16; 4 * 600];
        channels.write(&mut out);
        for (k, frame) in out.chunks(4).enumerate() {
            assert_eq!(frame, [16384, -8192, 32 * (k + 1) as i16, 0]);
        }
    }

    #[test]
    fn a_device_that_goes_away_is_told_and_gaps_are_counted() {
        let events = Events::default();
        events.take(&ErrorKind::Xrun.into());
        events.take(&ErrorKind::DeviceChanged.into());
        assert_eq!((events.gaps.load(Ordering::Relaxed), events.failure.get()), (1, None));
        events.take(&ErrorKind::DeviceNotAvailable.into());
        events.take(&ErrorKind::Other.into());
        assert!(events.failure.get().unwrap().ends_with("connect it and start again"));
    }

    /// Choice among what devices offer: enough channels and no more, 48 kHz or the next rate, floating point before whole numbers.
    #[test]
    fn the_configuration_is_the_nearest_to_what_is_wanted() {
        let one = |channels: u16, rates: [u32; 2], buffers: [u32; 2], format: SampleFormat| {
            let buffer = SupportedBufferSize::Range { min: buffers[0], max: buffers[1] };
            SupportedStreamConfigRange::new(channels, rates[0], rates[1], buffer, format)
        };
        let offered = vec![
            one(2, [8000, 192_000], [64, 8192], SampleFormat::F32),
            one(8, [44_100, 44_100], [64, 8192], SampleFormat::F32),
            one(8, [44_100, 96_000], [512, 8192], SampleFormat::I16),
            one(8, [44_100, 96_000], [512, 8192], SampleFormat::I32),
            one(8, [48_000, 48_000], [512, 8192], SampleFormat::U8),
            one(32, [48_000, 48_000], [64, 8192], SampleFormat::F32),
        ];
        let chosen = |wanted: usize| {
            let (config, format) = choose(offered.clone(), "card", wanted).unwrap();
            (config.channels, config.sample_rate, config.buffer_size, format)
        };
        assert_eq!(chosen(1), (2, 48_000, BufferSize::Fixed(256), SampleFormat::F32));
        assert_eq!(chosen(5), (8, 48_000, BufferSize::Fixed(512), SampleFormat::I32));
        assert_eq!(chosen(9), (32, 48_000, BufferSize::Fixed(256), SampleFormat::F32));
        let refused =
            |offered: Vec<_>, wanted: usize| choose(offered, "card", wanted).unwrap_err().to_string();
        let few = refused(offered[..1].to_vec(), 8);
        assert!(few.contains("\"card\" has 2 channels, and the stage needs 8"), "{few}");
        assert!(refused(Vec::new(), 2).contains("none of the formats"));
    }

    /// A machine without the device answers with those that it has, or that it has none.
    #[test]
    fn an_unknown_device_is_refused() {
        let error = find(Some("no such device")).err().unwrap().to_string();
        assert!(
            error.contains("there is no audio device \"no such device\"") || error.contains("was found"),
            "{error}"
        );
    }
}
