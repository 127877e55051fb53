//! The sound of a session in a WAV file.
//!
//! In: the effects of the world after each frame. Out: their samples for all channels of the stage, and a sentence on how loud it was.

use crate::audio::{REFERENCE_PA, WavFile};
use crate::base::failure::Failure;
use crate::world::World;
use crate::world::running::Heard;
use std::path::{Path, PathBuf};

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
    /// Why the file has ended before the session.
    fault: Option<String>,
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
            fault: None,
        }
    }

    /// Adds the sound of the world's last frame.
    pub fn hear(&mut self, world: &mut World) -> Result<(), Failure> {
        let Some(heard) = world.effects.iter_mut().find_map(|effect| effect.heard()) else { return Ok(()) };
        let Heard { rate_hz, channels, samples, full_scale_pa, limited } = heard;
        if self.format.channels != 0 && self.format.channels != channels && self.fault.is_none() {
            let before = self.format.channels;
            self.stop(format!("the stage has {channels} channels now, and had {before}"));
        }
        let file = match &mut self.file {
            _ if self.fault.is_some() => return Ok(()),
            Some(file) => file,
            None => self.file.insert(WavFile::create(&self.path, channels, rate_hz)?),
        };
        if let Err(error) = file.write(samples) {
            self.stop(error.to_string());
            return Ok(());
        }
        self.format = Format { rate_hz, channels, full_scale_pa };
        self.moments += (samples.len() / channels.max(1)) as u64;
        self.loudest = samples.iter().fold(self.loudest, |most, sample| most.max(sample.abs()));
        self.limited = limited;
        Ok(())
    }

    /// Ends the file before the session, which goes on.
    fn stop(&mut self, fault: String) {
        self.fault = Some(match self.close() {
            Ok(()) => fault,
            Err(error) => format!("{fault}; {error}"),
        });
    }

    fn close(&mut self) -> Result<(), Failure> {
        Ok(self.file.take().map_or(Ok(()), WavFile::finish)?)
    }

    /// Puts the file in its place; a line about it.
    pub fn end(mut self) -> Result<String, Failure> {
        self.close()?;
        let path = self.path.display();
        if self.format.channels == 0 {
            return Ok(format!("note: no frame was played: {path} is not written\n"));
        }
        let Format { rate_hz, channels, full_scale_pa } = self.format;
        let seconds = self.moments as f64 / f64::from(rate_hz.max(1));
        let peak_pa = f64::from(self.loudest) * full_scale_pa;
        let level = match self.loudest > 0.0 {
            true => format!("at most {:.1} dB", 20.0 * (peak_pa / REFERENCE_PA / 2.0_f64.sqrt()).log10()),
            false => "silent".to_owned(),
        };
        let limited = match self.limited {
            0 => String::new(),
            limited => format!(
                "; {limited} moments were turned down to 1 dB below full scale: lower gain_db of the bodies"
            ),
        };
        let fault = self.fault.map_or(String::new(), |fault| format!("; it ends there: {fault}"));
        Ok(format!(
            "sound {path}: {seconds:.2} s, {channels} channels of {rate_hz} Hz, {level}{limited}{fault}\n"
        ))
    }
}
