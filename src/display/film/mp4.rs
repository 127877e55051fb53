//! An MP4 file, which ffmpeg makes of the pictures that it is given.
//!
//! In: pictures with the times at which they come. Out: each as often as it is shown at a constant rate.

use image::RgbImage;
use std::io::{Error, Result, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

pub const PROGRAM: &str = "ffmpeg";

/// A film on its way into a file; a file that was there is overwritten.
pub struct Mp4 {
    path: PathBuf,
    child: Child,
    input: Option<ChildStdin>,
    rate_hz: u32,
    written: u64,
    start_s: Option<f64>,
}

impl Mp4 {
    /// An error of the kind `NotFound` says that `program`, [`PROGRAM`] but in tests, is not installed.
    pub fn start(program: &str, path: &Path, [width, height]: [u32; 2], rate_hz: u32) -> Result<Mp4> {
        let mut child = Command::new(program)
            .args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"])
            .args([
                "-video_size",
                &format!("{width}x{height}"),
                "-framerate",
                &rate_hz.to_string(),
                "-i",
                "-",
            ])
            // Players ask for even sides and for colours at half the resolution.
            .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .arg(path)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()?;
        let input = child.stdin.take();
        Ok(Mp4 { path: path.to_owned(), child, input, rate_hz, written: 0, start_s: None })
    }

    /// Adds a picture that is shown from `time_s` on; frames that were missed before it show it as well.
    pub fn add(&mut self, picture: &RgbImage, time_s: f64) -> Result<()> {
        let start_s = *self.start_s.get_or_insert(time_s);
        let due = ((time_s - start_s) * f64::from(self.rate_hz)).round() as u64 + 1;
        while self.written < due {
            self.input.as_mut().map_or(Ok(()), |input| input.write_all(picture.as_raw()))?;
            self.written += 1;
        }
        Ok(())
    }

    /// Ends the film, and gives ffmpeg's reason where it failed; nothing is left of the file then.
    pub fn finish(mut self) -> Result<()> {
        drop(self.input.take());
        let output = self.child.wait_with_output()?;
        if output.status.success() {
            return Ok(());
        }
        let _ = std::fs::remove_file(&self.path);
        let said = String::from_utf8_lossy(&output.stderr);
        let last = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it gives no reason");
        Err(Error::other(format!("ffmpeg failed ({}): {last}", output.status)))
    }
}
