//! The sound of a session in a WAV file.
//!
//! In: the effects of the world after each frame. Out: their samples for all channels of the stage, and a sentence on how loud it was.

use crate::audio::WavFile;
use crate::base::failure::Failure;
use crate::world::World;
use crate::world::running::Sound;
use std::path::{Path, PathBuf};

/// Pressure of 0 dB, Pa.
const THRESHOLD_PA: f64 = 20e-6;

/// A file for the sound of a session.
pub struct SoundFile {
    path: PathBuf,
    /// `None` before the first frame.
    file: Option<WavFile>,
    format: Format,
    moments: u64,
    /// Largest sample.
    loudest: f32,
    limited: u64,
}

#[derive(Clone, Copy, Default)]
struct Format {
    rate_hz: u32,
    channels: usize,
    full_scale_pa: f64,
}

impl SoundFile {
    pub fn new(path: &Path) -> SoundFile {
        SoundFile {
            path: path.to_owned(),
            file: None,
            format: Format::default(),
            moments: 0,
            loudest: 0.0,
            limited: 0,
        }
    }

    /// Adds the sound of the world's last frame.
    pub fn hear(&mut self, world: &mut World) -> Result<(), Failure> {
        let Some(sound) = world.effects.iter_mut().find_map(|effect| effect.sound()) else { return Ok(()) };
        let Sound { rate_hz, channels, samples, full_scale_pa, limited } = sound;
        let file = match &mut self.file {
            Some(file) => file,
            None => self.file.insert(WavFile::create(&self.path, channels, rate_hz)?),
        };
        file.write(samples)?;
        self.format = Format { rate_hz, channels, full_scale_pa };
        self.moments += (samples.len() / channels.max(1)) as u64;
        self.loudest = samples.iter().fold(self.loudest, |most, sample| most.max(sample.abs()));
        self.limited = limited;
        Ok(())
    }

    /// Puts the file in its place; a line about it.
    pub fn end(self) -> Result<String, Failure> {
        let path = self.path.display();
        let Some(file) = self.file else {
            return Ok(format!("note: no frame was played: {path} is not written\n"));
        };
        file.finish()?;
        let Format { rate_hz, channels, full_scale_pa } = self.format;
        let seconds = self.moments as f64 / f64::from(rate_hz.max(1));
        let peak_pa = f64::from(self.loudest) * full_scale_pa;
        let level = match self.loudest > 0.0 {
            true => format!("at most {:.1} dB", 20.0 * (peak_pa / THRESHOLD_PA / 2.0_f64.sqrt()).log10()),
            false => "silent".to_owned(),
        };
        let limited = match self.limited {
            0 => String::new(),
            limited => format!(
                "; {limited} samples were turned down to full scale: raise loudest_db in [sound] of the stage"
            ),
        };
        Ok(format!("sound {path}: {seconds:.2} s, {channels} channels of {rate_hz} Hz, {level}{limited}\n"))
    }
}
