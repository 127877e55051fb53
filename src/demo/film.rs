//! The demo without a display: a picture of each moment that the chapters name, a contact sheet of them, and a film.
//!
//! The film is an animated PNG, and an MP4 file too where `ffmpeg` is there ([`crate::display::film`]).

use super::chapters::CHAPTERS;
use super::preparation::Preparation;
use super::story::Story;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::output::{self, Kind};
use crate::base::table;
use crate::display::device;
use crate::display::film::apng::Apng;
use crate::display::film::mp4::{Mp4, PROGRAM};
use crate::display::pictures::{PNG, save};
use crate::display::presenter::Images;
use crate::render::{Gpu, Samples};
use image::{DynamicImage, RgbaImage, imageops};
use std::io::{Cursor, ErrorKind};
use std::path::PathBuf;

/// The pictures and the film to make.
#[derive(Clone, Debug)]
pub struct Request {
    pub folder: PathBuf,
    /// Chapters, counted from 0.
    pub chapters: Vec<usize>,
    /// Size of a picture, pixels; the film is half as wide and high.
    pub size: [u32; 2],
    pub samples: Samples,
    /// Whether a film is made.
    pub film: bool,
    pub device: device::Args,
}

const SHEET: &str = "contact-sheet.png";
const FILM: &str = "demo.png";
const MP4: &str = "demo.mp4";
const VIDEO: Kind = Kind { name: "an MP4 file", recognizes: |head| head.get(4..8) == Some(b"ftyp") };
/// Pictures of the animated PNG a second, and how many times as many the MP4 file has.
const RATE_HZ: u16 = 8;
const FINER: u32 = 3;
/// Length of the hidden steps between two pictures, s: a grab needs the moment of the press.
const STEP_S: f64 = 1.0 / 48.0;
/// Time for which the end of a chapter is seen in the film, s.
const END_S: f64 = 0.8;
const COLUMNS: u32 = 3;

impl Request {
    /// Makes the folder, and looks whether everything can be written there.
    pub fn try_folder(&self) -> Result<(), Failure> {
        output::make_folder(&self.folder)?;
        for name in [SHEET, FILM] {
            output::try_path(&self.folder.join(name), &PNG, &[])?;
        }
        Ok(output::try_path(&self.folder.join(MP4), &VIDEO, &[])?)
    }

    /// Makes the pictures and the film; returns words about the files.
    pub fn make(&self) -> Result<String, Failure> {
        self.try_folder()?;
        let (told, stills) = self.stills()?;
        let film = if self.film { self.film(&stills)? } else { String::new() };
        Ok(format!("{told}{film}"))
    }

    /// One image of this size, in place of a window.
    fn image(&self, size: [u32; 2]) -> Result<Images, Failure> {
        let mut image = Images::new(self.samples)?;
        self.device.apply(&image.gpu, &mut image.renderer)?;
        image.add(size, [0; 2])?;
        Ok(image)
    }

    fn story(&self) -> Result<Story, Failure> {
        let preparation = Preparation::start(self.chapters.clone()).map_err(Failure::work)?;
        Ok(Story::new(preparation, 0, self.device).without_keys())
    }

    /// The words about the pictures, and the pictures.
    fn stills(&self) -> Result<(String, Vec<RgbaImage>), Failure> {
        let (mut image, mut story) = (self.image(self.size)?, self.story()?);
        notice!("demo: drawing on {}", image.gpu.describe());
        let mut pictures = Vec::new();
        for &chapter in &self.chapters {
            story.begin(chapter, &image.gpu)?;
            for (k, &at_s) in CHAPTERS[chapter].stills_s.iter().enumerate() {
                story.tell_until(at_s)?;
                story.wait_for_effects();
                story.frame(&mut image, 0.0)?;
                let picture = shown(&image)?;
                let name = format!("{}-{}-{}.png", chapter + 1, CHAPTERS[chapter].name, k + 1);
                save(&picture, &self.folder.join(&name))?;
                notice!("{}", self.folder.join(&name).display());
                pictures.push(picture);
            }
        }
        let sheet = self.folder.join(SHEET);
        save(&contact_sheet(&pictures), &sheet)?;
        let (count, folder) = (pictures.len(), self.folder.display());
        Ok((format!("{count} pictures in {folder}, all on {}\n", sheet.display()), pictures))
    }

    /// Makes the film; the colours come from `stills`.
    fn film(&self, stills: &[RgbaImage]) -> Result<String, Failure> {
        let size = self.size.map(|side| (side / 2).max(2) & !1);
        let (mut image, mut story) = (self.image(size)?, self.story()?);
        let path = self.folder.join(MP4);
        let mut video = match Mp4::start(PROGRAM, &path, size, u32::from(RATE_HZ) * FINER) {
            Ok(video) => Some(video),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(Failure::work(error)),
        };
        let finer = if video.is_some() { FINER } else { 1 };
        let step_s = 1.0 / (f64::from(RATE_HZ) * f64::from(finer));
        let mut counts = Vec::new();
        for &chapter in &self.chapters {
            story.begin(chapter, &image.gpu)?;
            let length_s = story.duration_s().unwrap_or(1.0) + END_S;
            counts.push((length_s * f64::from(RATE_HZ)) as u32 * finer);
        }
        let bar = indicatif::ProgressBar::new(counts.iter().map(|&count| u64::from(count)).sum())
            .with_message("film");
        let mut animation = Apng::new(Cursor::new(Vec::new()));
        let rgb = |still: &RgbaImage| DynamicImage::from(still.clone()).to_rgb8();
        animation.expect(&stills.iter().map(rgb).collect::<Vec<_>>());
        for (&chapter, count) in self.chapters.iter().zip(counts) {
            story.begin(chapter, &image.gpu)?;
            let last_s = CHAPTERS[chapter].stills_s.last().copied().unwrap_or(f64::INFINITY);
            for frame in 0..count {
                let at_s = f64::from(frame) * step_s;
                story.tell_until(at_s)?;
                // From the last moment on: what is solved for every pose of a motion would take minutes.
                if at_s >= last_s {
                    story.wait_for_effects();
                }
                story.frame(&mut image, 0.0)?;
                let picture = DynamicImage::from(shown(&image)?).to_rgb8();
                if frame % finer == 0 {
                    animation.add(&picture, 1.0 / f64::from(RATE_HZ)).map_err(Failure::work)?;
                }
                let at_s = bar.position() as f64 * step_s;
                if let Some(Err(error)) = video.as_mut().map(|video| video.add(&picture, at_s)) {
                    // Where it takes no more pictures, it knows why.
                    let known = video.and_then(|video| video.finish().err());
                    return Err(Failure::work(known.unwrap_or(error)));
                }
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        let bytes = animation.finish().map_err(Failure::work)?.into_inner();
        let png = self.folder.join(FILM);
        output::write(&png, &PNG, |file| file.write_all(&bytes))?;
        let mut told = format!("film {} ({})\n", png.display(), table::bytes(bytes.len() as f64));
        if let Some(video) = video {
            video.finish().map_err(Failure::work)?;
            let size = std::fs::metadata(&path).map_or(0, |of| of.len());
            told += &format!("film {} ({})\n", path.display(), table::bytes(size as f64));
        }
        Ok(told)
    }
}

impl Story {
    /// Begins a chapter as soon as what it needs is made.
    fn begin(&mut self, chapter: usize, gpu: &Gpu) -> Result<(), Failure> {
        self.go_to(chapter);
        self.open_ready(gpu)
    }

    /// Moves the story on to a time of the chapter, in fine steps that are not shown.
    fn tell_until(&mut self, time_s: f64) -> Result<(), Failure> {
        while self.clock_s < time_s {
            self.advance(STEP_S.min(time_s - self.clock_s).max(1e-9))?;
        }
        Ok(())
    }
}

/// The picture that was shown last.
fn shown(image: &Images) -> Result<RgbaImage, Failure> {
    let (pictures, _) = image.read()?;
    pictures.into_iter().next().ok_or_else(|| Failure::wrong("no picture was shown"))
}

/// Pictures in rows, each a third of the sheet's width.
fn contact_sheet(pictures: &[RgbaImage]) -> RgbaImage {
    const GAP: u32 = 8;
    let Some(first) = pictures.first() else { return RgbaImage::new(1, 1) };
    let width = 480.min(first.width());
    let height = (width * first.height() / first.width()).max(1);
    let rows = (pictures.len() as u32).div_ceil(COLUMNS);
    let size = [COLUMNS * (width + GAP) + GAP, rows * (height + GAP) + GAP];
    let mut sheet = RgbaImage::from_pixel(size[0], size[1], image::Rgba([24, 26, 30, 255]));
    for (k, picture) in (0..).zip(pictures) {
        let small = imageops::resize(picture, width, height, imageops::FilterType::Triangle);
        let place = [k % COLUMNS * (width + GAP) + GAP, k / COLUMNS * (height + GAP) + GAP];
        imageops::replace(&mut sheet, &small, place[0].into(), place[1].into());
    }
    sheet
}
