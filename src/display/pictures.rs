//! Writes a session as PNG files: every picture of every frame, and a contact sheet.

use super::contact_sheet::{SheetFrames, contact_sheet};
use super::device;
use super::offscreen::{DrawTimes, Pictures, Targets};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output::{self, Kind, Staged};
use crate::base::table::{count, seconds};
use crate::render::Samples;
use crate::session::{Playback, Session};
use crate::stage::{Stage, Stereo};
use image::{ImageFormat, RgbaImage};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::time::Instant;

const SHEET: &str = "contact-sheet.png";

pub const PNG: Kind = Kind { name: "a PNG file", recognizes: |head| head.starts_with(b"\x89PNG\r\n\x1a\n") };

/// The pictures to draw of a session.
#[derive(Clone, Debug)]
pub struct PictureRequest {
    /// Folder for the pictures.
    pub folder: PathBuf,
    /// Frames, evenly over the script or the recording; 1 or more.
    pub frames: usize,
    pub pictures: Pictures,
    pub samples: Samples,
    /// Size against the screens' own pixels.
    pub scale: f64,
    /// Whether the overlay is drawn on the screen that the viewer looks at.
    pub overlay: bool,
    pub device: device::Args,
}

impl PictureRequest {
    /// Makes the folder, and looks whether everything can be written there, before anything is solved.
    pub fn try_folder(&self, inputs: &[PathBuf]) -> Result<(), Failure> {
        output::make_folder(&self.folder)?;
        output::try_path(&self.folder.join(SHEET), &PNG, inputs)?;
        let pictures = std::fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let mut pictures = pictures.map(|entry| entry.path()).filter(|path| is_frame(path, self.frames));
        Ok(pictures.try_for_each(|path| output::may_replace(&path, &PNG, inputs))?)
    }

    /// Draws all frames into the folder, with a contact sheet of three that differ; returns words about the files and the time it
    /// took. A session in which nothing moves has one frame.
    pub fn draw(&self, session: &mut Session) -> Result<String, Failure> {
        let folder = &self.folder;
        output::make_folder(folder)?;
        let is_recorded = session.input.replay.is_some() || session.recorder.is_some();
        let device = self.device.for_session(is_recorded)?;
        session.world.wait_for_background();
        session.world.is_for_pictures = true;
        let mut targets = Targets::new(&mut session.world, self.pictures, self.samples, self.scale, device)?;
        if self.overlay {
            targets = targets.with_overlay();
        }
        notice!(
            "{}: drawing on {}",
            session.world.assets.stage.name,
            device::describe(&targets.images.gpu, self.samples)
        );
        let mut playback = Playback::new(session, self.frames)?;
        let frames = if playback.moves() { self.frames } else { 1 };
        if frames < self.frames {
            notice!("one frame instead of {}: without a script no time passes (--script bend)", self.frames);
        }
        let bar = indicatif::ProgressBar::new(frames as u64).with_message("frames");
        let mut chosen = SheetFrames::new(frames);
        let (mut drawn_s, mut mechanics_s, mut written) = (0.0, 0.0, 0);
        let started = Instant::now();
        for frame in 0..frames {
            mechanics_s += playback.step_to(session, frame)?.total_s();
            session.world.before_picture();
            let DrawTimes { upload_s, encode_s, draw_s } =
                targets.draw(&session.world).map_err(Failure::work)?;
            drawn_s += upload_s + encode_s + draw_s;
            let (images, _) = targets.read().map_err(Failure::work)?;
            let named = |frame: usize| {
                images.iter().map(move |(name, _)| folder.join(format!("frame{frame:04}-{name}.png")))
            };
            // What an older run drew goes with the first frame, so that it never stands among the new pictures.
            let older: Vec<PathBuf> = match frame {
                0 => (1..self.frames).flat_map(named).chain([folder.join(SHEET)]).collect(),
                _ => Vec::new(),
            };
            let older: Vec<PathBuf> = older.into_iter().filter(|path| output::is(path, &PNG)).collect();
            let staged = named(frame).zip(&images).map(|(path, (_, image))| stage(image, &path));
            output::put_all(staged.collect::<Result<_, Failure>>()?, &older)?;
            written += images.len();
            chosen.take(frame, images);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let path = folder.join(SHEET);
        let stage = &session.world.assets.stage;
        let screens = stage.screens.len();
        // Windows lie as they are listed.
        let (each, from_top) = match self.pictures {
            Pictures::Windows => (count(targets.count(), "window"), (0..targets.count()).collect()),
            _ => (pictures_of_frame(stage, screens), stage.screens_from_top()),
        };
        if chosen.are_alike() {
            notice!("all frames look the same: the script moves nothing that is seen on {}", stage.name);
        }
        save(&contact_sheet(&chosen.frames(), &from_top), &path)?;
        let drawn = format!(
            "{} in {} (all steps, PNG files too: {})\n\
             drawing {:.1} frames/s, each of {each} {}; its mechanics {}\ncontact sheet {}\n",
            count(written, "picture"),
            folder.display(),
            seconds(started.elapsed().as_secs_f64()),
            frames as f64 / drawn_s,
            seconds(drawn_s / frames as f64),
            seconds(mechanics_s / frames as f64),
            path.display()
        );
        Ok(drawn)
    }
}

/// Whether a file has the name of a picture of one of the first `frames` frames.
fn is_frame(path: &Path, frames: usize) -> bool {
    let name = path.file_name().and_then(|name| name.to_str());
    let number = name.and_then(|name| {
        name.strip_prefix("frame")?.strip_suffix(".png")?.split_once('-')?.0.parse::<usize>().ok()
    });
    number.is_some_and(|number| number < frames)
}

/// Words for the pictures of a frame of `screens` screens: both eyes of a screen are a pair.
pub fn pictures_of_frame(stage: &Stage, screens: usize) -> String {
    let what = if stage.stereo == Stereo::Mono { "picture" } else { "stereo pair" };
    format!("{screens} {what}{}", if screens == 1 { "" } else { "s" })
}

pub fn save(image: &RgbaImage, path: &Path) -> Result<(), Failure> {
    Ok(stage(image, path)?.put()?)
}

fn stage(image: &RgbaImage, path: &Path) -> Result<Staged, Failure> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png).map_err(Failure::work)?;
    Ok(output::stage(path, &PNG, |file| file.write_all(bytes.get_ref()))?)
}
