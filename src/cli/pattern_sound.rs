//! `greenstage pattern --sound`: short tones from each loudspeaker, to find wrong cables and to set levels.

use super::print::print;
use crate::audio::{Bursts, Fill, Listening, Playback, WavFile};
use crate::base::failure::Failure;
use crate::base::table::count;
use crate::stage::{Bearing, SoundOutput, Stage};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Sample rate of a file.
const FILE_RATE_HZ: u32 = 48_000;
/// Time between two looks at which channel sounds.
const LOOK: Duration = Duration::from_millis(20);

/// Plays the tones until the program is ended or `limit_s` is over, or writes one round of them to a WAV file.
pub fn run(stage: &Stage, wav: Option<&Path>, limit_s: Option<f64>) -> Result<(), Failure> {
    let listening = Listening::new(stage);
    match wav {
        Some(path) => write(&listening, path, limit_s),
        None => play(&listening, &channels(stage), limit_s),
    }
}

/// Words for each channel: its number, and where its tones should be heard from.
fn channels(stage: &Stage) -> Vec<String> {
    let head = &stage.viewer.room_from_head;
    if stage.sound.output == SoundOutput::Headphones {
        return ["1 left ear".to_owned(), "2 right ear".to_owned()].into();
    }
    let used = stage.sound.used(head);
    let one = |(k, it): (usize, &crate::stage::Loudspeaker)| {
        format!("{} {}: {}", k + 1, it.name, Bearing::new(head, &it.position))
    };
    used.iter().enumerate().map(one).collect()
}

fn play(listening: &Listening, channels: &[String], limit_s: Option<f64>) -> Result<(), Failure> {
    let frames = Arc::new(AtomicU64::new(0));
    let played = Arc::clone(&frames);
    let fill = |rate_hz: f64| -> Fill {
        let mut bursts = Bursts::new(listening, rate_hz);
        let channels = listening.channels();
        Box::new(move |out| {
            bursts.fill(out);
            played.fetch_add((out.len() / channels) as u64, Ordering::Relaxed);
        })
    };
    let playback = Playback::start(listening, fill)?;
    let late = playback.buffer_s().map_or(String::new(), |s| format!(", buffer {:.1} ms", 1e3 * s));
    print(&format!(
        "{}, {} at {} Hz{late}; loudspeaker k gives k short tones and a long one, 1 kHz, 70 dB at the viewer's place; end \
         with Ctrl+C\n",
        playback.device(),
        count(listening.channels(), "channel"),
        playback.rate_hz()
    ))?;
    let bursts = Bursts::new(listening, playback.rate_hz());
    let mut last = None;
    loop {
        if let Some(reason) = playback.failure() {
            return Err(Failure::work(anyhow::anyhow!("audio device \"{}\": {reason}", playback.device())));
        }
        let time_s = frames.load(Ordering::Relaxed) as f64 / playback.rate_hz();
        if limit_s.is_some_and(|limit_s| time_s >= limit_s) {
            return Ok(());
        }
        let now = bursts.channel_at(time_s);
        if last != Some(now) {
            last = Some(now);
            print(&format!("{}\n", channels.get(now).map_or("", String::as_str)))?;
        }
        std::thread::sleep(LOOK);
    }
}

fn write(listening: &Listening, path: &Path, limit_s: Option<f64>) -> Result<(), Failure> {
    let mut bursts = Bursts::new(listening, f64::from(FILE_RATE_HZ));
    let channels = listening.channels();
    let length_s = limit_s.unwrap_or_else(|| bursts.round_s());
    let mut file = WavFile::create(path, channels, FILE_RATE_HZ)?;
    let mut left = (length_s * f64::from(FILE_RATE_HZ)).round() as u64;
    let mut block = vec![0.0; 4800 * channels];
    while left > 0 {
        let frames = left.min(4800);
        let out = &mut block[..frames as usize * channels];
        out.fill(0.0);
        bursts.fill(out);
        file.write(out)?;
        left -= frames;
    }
    file.finish()?;
    print(&format!("{length_s:.1} s of {} in {}\n", count(channels, "channel"), path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_told_with_where_they_should_be_heard() {
        let mut stage = Stage::find("cyberstage").unwrap();
        let told = channels(&stage);
        assert_eq!(told.len(), 8);
        assert_eq!(told[0], "1 floor front left: 2.96 m away, 38° left, 35° down");
        stage.sound.output = SoundOutput::Stereo;
        assert_eq!(channels(&stage)[1], "2 right: 1.00 m away, 33° right, 23° down");
        stage.sound.output = SoundOutput::Headphones;
        assert_eq!(channels(&stage), ["1 left ear", "2 right ear"]);
    }

    #[test]
    fn a_file_has_one_round_of_all_channels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tones.wav");
        run(&Stage::find("desktop").unwrap(), Some(&path), None).unwrap();
        let wav = hound::WavReader::open(&path).unwrap();
        // Two loudspeakers: 3 short tones of 0.24 s with their gaps, two long ones of 1.5 s, and two pauses of 0.8 s.
        assert_eq!((wav.spec().channels, wav.duration()), (2, 48_000 * (72 + 2 * 150 + 2 * 80) / 100));
    }
}
