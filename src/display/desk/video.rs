//! Records what a window shows: as MP4 by ffmpeg where that is installed, else as an animated PNG.
//!
//! In: pictures as they are shown, with their times. Out: a file beside which nothing else is left. A thread writes, so that
//! the window goes on; pictures that come while it is behind are left out, and the one before is shown longer.

use crate::display::film::apng::Apng;
use crate::display::film::mp4::{Mp4, PROGRAM};
use image::{RgbImage, RgbaImage};
use std::fs::File;
use std::io::{BufWriter, Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;

/// Pictures that may wait for the writer.
const WAITING: usize = 4;
/// Pictures a second of an MP4 file; those of a PNG have times of their own.
const RATE: u32 = 30;
/// Largest rate at which pictures are written into a PNG, which is larger, pictures a second.
const PNG_RATE: f64 = 12.0;
/// Time for which the last picture is shown, s.
const LAST_S: f64 = 0.5;

/// A recording that goes on.
pub struct Video {
    pub path: PathBuf,
    size: [u32; 2],
    pictures: SyncSender<(RgbImage, f64)>,
    writer: JoinHandle<Result<u32>>,
    /// Time of the last picture that was taken, s.
    last_s: Option<f64>,
    rate: f64,
}

/// A finished recording.
pub struct Recording {
    pub path: PathBuf,
    pub pictures: u32,
}

impl Video {
    /// Begins a recording of pictures of `size`. Its name is `stem` with the end that says what it is.
    pub fn begin(stem: &Path, size: [u32; 2]) -> Result<Video> {
        Video::with(stem, size, PROGRAM)
    }

    fn with(stem: &Path, size: [u32; 2], program: &str) -> Result<Video> {
        let named = |end: &str| PathBuf::from(format!("{}.{end}", stem.display()));
        let (pictures, received) = sync_channel(WAITING);
        let mp4 = named("mp4");
        let spawn = |name: &str| std::thread::Builder::new().name(name.to_owned());
        let (path, writer, rate) = match Mp4::start(program, &mp4, size, RATE) {
            Ok(film) => (mp4, spawn("video").spawn(move || write_mp4(film, &received))?, f64::from(RATE)),
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let path = named("png");
                let film = Apng::new(BufWriter::new(File::create_new(&path)?));
                (path, spawn("video").spawn(move || write_png(film, &received))?, PNG_RATE)
            }
            Err(error) => return Err(error),
        };
        Ok(Video { path, size, pictures, writer, last_s: None, rate })
    }

    /// Whether a picture shown at `time_s` is wanted.
    pub fn is_due(&self, time_s: f64) -> bool {
        self.last_s.is_none_or(|last_s| time_s - last_s >= 0.999 / self.rate)
    }

    /// Takes a picture; false where the recording cannot go on: the window has another size now, or the writer failed.
    pub fn add(&mut self, picture: RgbaImage, time_s: f64) -> bool {
        if [picture.width(), picture.height()] != self.size {
            return false;
        }
        let picture = image::DynamicImage::from(picture).to_rgb8();
        match self.pictures.try_send((picture, time_s)) {
            Ok(()) => self.last_s = Some(time_s),
            Err(TrySendError::Full(_)) => {}
            Err(TrySendError::Disconnected(_)) => return false,
        }
        true
    }

    /// Ends the recording; waits until all is written.
    pub fn finish(self) -> Result<Recording> {
        drop(self.pictures);
        let broke_off = |_| Err(Error::other("the writer of the video broke off"));
        let pictures = self.writer.join().unwrap_or_else(broke_off)?;
        Ok(Recording { path: self.path, pictures })
    }
}

/// Each picture as often as it is shown at a constant rate.
fn write_mp4(mut film: Mp4, received: &Receiver<(RgbImage, f64)>) -> Result<u32> {
    let mut count = 0;
    let added = received.iter().try_for_each(|(picture, time_s)| {
        count += 1;
        film.add(&picture, time_s)
    });
    // Where it takes no more pictures, it knows why.
    film.finish()?;
    added.map(|()| count)
}

fn write_png(mut film: Apng<BufWriter<File>>, received: &Receiver<(RgbImage, f64)>) -> Result<u32> {
    let (mut count, mut before) = (0, None::<(RgbImage, f64)>);
    for (picture, time_s) in received {
        if let Some((shown, since_s)) = before.replace((picture, time_s)) {
            film.add(&shown, time_s - since_s)?;
        }
        count += 1;
    }
    if let Some((last, _)) = before {
        film.add(&last, LAST_S)?;
    }
    film.finish()?.into_inner().map_err(|error| error.into_error())?.sync_all()?;
    Ok(count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn record(program: &str) -> (tempfile::TempDir, Result<Recording>) {
        let folder = tempfile::tempdir().unwrap();
        let mut video = Video::with(&folder.path().join("film"), [4, 2], program).unwrap();
        assert!(!video.add(RgbaImage::new(5, 2), 0.0), "of another size");
        for k in 0..3 {
            let time_s = 0.1 * f64::from(k);
            assert!(video.is_due(time_s) && video.add(RgbaImage::new(4, 2), time_s));
            assert!(!video.is_due(time_s + 0.01));
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let recorded = video.finish();
        (folder, recorded)
    }

    #[test]
    fn without_ffmpeg_an_animated_png_is_written() {
        let (_folder, recorded) = record("greenstage-no-such-program");
        let Recording { path, pictures } = recorded.unwrap();
        assert!(path.ends_with("film.png") && pictures == 3);
        assert_eq!(image::open(path).unwrap().to_rgb8().dimensions(), (4, 2));
    }

    /// A program that stands in for ffmpeg and keeps its input: each picture as often as it is due at a constant rate.
    #[test]
    fn ffmpeg_is_given_pictures_at_a_constant_rate() {
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("ffmpeg");
        std::fs::write(&program, "#!/bin/sh\nfor last; do :; done\ncat > \"$last\"\n").unwrap();
        std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
        let (_folder, recorded) = record(program.to_str().unwrap());
        let Recording { path, pictures } = recorded.unwrap();
        assert!(path.ends_with("film.mp4") && pictures == 3);
        assert_eq!(
            std::fs::metadata(path).unwrap().len(),
            7 * 4 * 2 * 3,
            "0.2 s at 30 pictures a second, both ends"
        );
        std::fs::write(&program, "#!/bin/sh\ncat > /dev/null\necho no codec >&2\nexit 1\n").unwrap();
        let (_folder, recorded) = record(program.to_str().unwrap());
        assert!(recorded.err().unwrap().to_string().contains("no codec"));
    }
}
