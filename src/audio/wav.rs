//! WAV files of any length, with 32-bit floating point samples.
//!
//! In: frames of samples, interleaved, in as many pieces as there are. Out: a file that is there whole or not at all. Until it
//! is finished its bytes are in a file without a name in the same folder, which is gone when the program ends.

use super::error::AudioError;
use crate::base::output::{self, Kind};
use hound::{SampleFormat, WavSpec, WavWriter};
use std::fs::File;
use std::io::{BufWriter, Seek};
use std::path::{Path, PathBuf};

pub const WAV: Kind = Kind {
    name: "a WAV file",
    recognizes: |head| head.starts_with(b"RIFF") && head.get(8..12).is_some_and(|kind| kind == b"WAVE"),
};

/// Bytes of samples that the sizes in the header can count.
const MOST_BYTES: u64 = u32::MAX as u64 - 1024;

/// A WAV file that is being written.
pub struct WavFile {
    path: PathBuf,
    file: File,
    writer: WavWriter<BufWriter<File>>,
    bytes: u64,
}

impl WavFile {
    /// Begins a file; what stands there is replaced when it is finished, if it is a WAV file too.
    pub fn create(path: &Path, channels: usize, rate_hz: u32) -> Result<WavFile, AudioError> {
        output::try_path(path, &WAV, &[])?;
        let failed = |message: String| AudioError::Wav { path: path.to_owned(), message };
        // A device has no folder for files beside it.
        let beside = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = tempfile::tempfile_in(beside).or_else(|_| tempfile::tempfile());
        let file = file.map_err(|error| failed(error.to_string()))?;
        let channels =
            u16::try_from(channels).map_err(|error| failed(format!("{channels} channels: {error}")))?;
        let spec = WavSpec {
            channels,
            sample_rate: rate_hz,
            bits_per_sample: 32,
            sample_format: SampleFormat::Float,
        };
        let buffer = file.try_clone().map(BufWriter::new).map_err(|error| failed(error.to_string()))?;
        let writer = WavWriter::new(buffer, spec).map_err(|error| failed(error.to_string()))?;
        Ok(WavFile { path: path.to_owned(), file, writer, bytes: 0 })
    }

    /// Adds frames: as many samples as channels for each.
    pub fn write(&mut self, samples: &[f32]) -> Result<(), AudioError> {
        let failed = |message: String| AudioError::Wav { path: self.path.clone(), message };
        self.bytes += 4 * samples.len() as u64;
        if self.bytes > MOST_BYTES {
            return Err(failed("a WAV file has at most 4 GiB; write a shorter session".to_owned()));
        }
        samples
            .iter()
            .try_for_each(|sample| self.writer.write_sample(*sample))
            .map_err(|error| failed(error.to_string()))
    }

    /// Puts the whole file in its place.
    pub fn finish(self) -> Result<(), AudioError> {
        let WavFile { path, mut file, writer, .. } = self;
        let failed = |message: String| AudioError::Wav { path: path.clone(), message };
        writer.finalize().map_err(|error| failed(error.to_string()))?;
        file.rewind().map_err(|error| failed(error.to_string()))?;
        output::write(&path, &WAV, |out| std::io::copy(&mut file, out).map(drop))?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_back_and_a_file_is_there_only_when_it_is_finished() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.wav");
        let samples: Vec<f32> = (0..300).map(|k| (k as f32 - 150.0) / 150.0).collect();
        let mut wav = WavFile::create(&path, 3, 48_000).unwrap();
        samples.chunks(30).for_each(|frames| wav.write(frames).unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        wav.finish().unwrap();
        let mut read = hound::WavReader::open(&path).unwrap();
        assert_eq!((read.spec().channels, read.spec().sample_rate, read.duration()), (3, 48_000, 100));
        assert_eq!(read.samples::<f32>().map(Result::unwrap).collect::<Vec<_>>(), samples);
        assert!(output::is(&path, &WAV));
        WavFile::create(&path, 1, 8000).unwrap().finish().unwrap();
        assert_eq!(hound::WavReader::open(&path).unwrap().duration(), 0, "it may be replaced");
    }

    #[test]
    fn other_files_are_left_alone_and_a_missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, "a letter").unwrap();
        let told = |path: &Path| WavFile::create(path, 2, 48_000).err().unwrap().to_string();
        assert!(told(&path).contains("is not a WAV file"), "{}", told(&path));
        let missing = folder.path().join("no/such.wav");
        assert!(told(&missing).contains("the folder"), "{}", told(&missing));
    }
}
