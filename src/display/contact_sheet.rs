//! The contact sheet of a session: some of its frames on one picture, as their screens stand.
//!
//! In: the pictures of each frame, with their names. Out: one picture. Frames stand from left to right below their numbers, in each
//! one column for each eye; a column has the screens from the highest to the lowest, so that a wall stands on the table before
//! it. Each picture has its name in its corner.

use crate::export::raster::Raster;
use egui::{Align2, Color32, FontId, pos2};
use image::{RgbaImage, imageops};

/// Width of one picture.
const PICTURE: u32 = 400;
const GAP: u32 = 8;
/// Height of a line of words; left out of narrow pictures, which have no room for one.
const CAPTION: u32 = 20;
const NARROW: u32 = 200;
const BACKGROUND: [u8; 3] = [24, 26, 30];
const INK: Color32 = Color32::from_gray(200);

/// Pictures of a frame with their names, screen by screen and in each eye by eye.
type Pictures = Vec<(String, RgbaImage)>;

/// One frame, with its number.
pub struct SheetFrame {
    pub number: usize,
    pictures: Pictures,
}

impl SheetFrame {
    /// Keeps the pictures as small as they stand on the sheet.
    pub fn new(number: usize, pictures: &[(String, RgbaImage)]) -> SheetFrame {
        let small = |(name, picture): &(String, RgbaImage)| (name.clone(), small(picture));
        SheetFrame { number, pictures: pictures.iter().map(small).collect() }
    }
}

/// Distance of the pixels by which two frames are compared, in both directions.
const SAMPLED: usize = 4;

/// Colours of every [`SAMPLED`]th pixel of a frame's pictures.
struct Sample(Vec<u8>);

impl Sample {
    fn from_pictures(pictures: &[(String, RgbaImage)]) -> Sample {
        let rows = pictures.iter().flat_map(|(_, picture)| picture.rows().step_by(SAMPLED));
        let pixels = rows.flat_map(|row| row.step_by(SAMPLED));
        Sample(pixels.flat_map(|pixel| [pixel.0[0], pixel.0[1], pixel.0[2]]).collect())
    }

    /// The visible difference from another frame: the mean difference of a colour's byte.
    fn difference(&self, other: &Sample) -> f64 {
        let off = self.0.iter().zip(&other.0).map(|(one, other)| u64::from(one.abs_diff(*other)));
        off.sum::<u64>() as f64 / self.0.len().max(1) as f64
    }
}

/// The frames that represent a session best, chosen as they come: the first, the one between that looks most different from it,
/// and the last. Where that is the last itself, the middle one stands between them; where all look alike, the first stands alone.
pub struct SheetFrames {
    first: Option<(Sample, SheetFrame)>,
    middle: Option<SheetFrame>,
    /// The difference from the first frame, and the pictures as they were drawn.
    farthest: Option<(f64, usize, Pictures)>,
    /// The difference from the first frame, and the last one.
    last: Option<(f64, SheetFrame)>,
    count: usize,
}

impl SheetFrames {
    /// A choice among `count` frames.
    pub fn new(count: usize) -> SheetFrames {
        SheetFrames { first: None, middle: None, farthest: None, last: None, count }
    }

    pub fn take(&mut self, number: usize, pictures: Vec<(&str, RgbaImage)>) {
        let pictures: Pictures =
            pictures.into_iter().map(|(name, picture)| (name.to_owned(), picture)).collect();
        let sample = Sample::from_pictures(&pictures);
        let Some((first, _)) = &self.first else {
            self.first = Some((sample, SheetFrame::new(number, &pictures)));
            return;
        };
        let off = sample.difference(first);
        if number + 1 == self.count {
            if self.farthest.as_ref().is_some_and(|(most, ..)| off >= *most) {
                self.farthest = None;
            }
            self.last = Some((off, SheetFrame::new(number, &pictures)));
            return;
        }
        if number == self.count / 2 {
            self.middle = Some(SheetFrame::new(number, &pictures));
        }
        if off > self.farthest.as_ref().map_or(0.0, |(most, ..)| *most) {
            self.farthest = Some((off, number, pictures));
        }
    }

    /// Whether nothing in the pictures ever changed.
    pub fn are_alike(&self) -> bool {
        self.farthest.is_none() && self.last.as_ref().is_some_and(|(off, _)| *off == 0.0)
    }

    /// The frames, in their order.
    pub fn frames(self) -> Vec<SheetFrame> {
        let first = self.first.map(|(_, frame)| frame);
        let last = self.last.filter(|(off, _)| self.farthest.is_some() || *off > 0.0);
        if last.is_none() {
            return first.into_iter().collect();
        }
        let farthest = self.farthest.map(|(_, number, pictures)| SheetFrame::new(number, &pictures));
        let between = farthest.or(self.middle);
        [first, between, last.map(|(_, frame)| frame)].into_iter().flatten().collect()
    }
}

/// The sheet; `from_top` numbers the screens from the highest to the lowest. Each row is as high as its highest picture.
pub fn contact_sheet(frames: &[SheetFrame], from_top: &[usize]) -> RgbaImage {
    let all = || frames.iter().flat_map(|frame| &frame.pictures).map(|(_, picture)| picture);
    let most = frames.iter().map(|frame| frame.pictures.len()).max().unwrap_or(0);
    let eyes = most.checked_div(from_top.len()).unwrap_or(0).max(1);
    let width = all().map(RgbaImage::width).max().unwrap_or(1);
    let caption = if width < NARROW { 0 } else { CAPTION };
    let height_of = |screen: usize| {
        let row = frames.iter().flat_map(|frame| frame.pictures.iter().skip(screen * eyes).take(eyes));
        row.map(|(_, picture)| picture.height()).max().unwrap_or(0) + 1
    };
    let heights: Vec<u32> = from_top.iter().map(|&screen| height_of(screen)).collect();
    let frame_width = eyes as u32 * (width + GAP) + 2 * GAP;
    let size = [frames.len() as u32 * frame_width + GAP, caption + heights.iter().sum::<u32>() + 2 * GAP];
    let [r, g, b] = BACKGROUND;
    let mut sheet = RgbaImage::from_pixel(size[0], size[1], image::Rgba([r, g, b, 255]));
    for (f, frame) in frames.iter().enumerate() {
        for eye in 0..eyes {
            let x = i64::from(2 * GAP + f as u32 * frame_width + eye as u32 * (width + GAP));
            let of_screen = |screen: &usize| frame.pictures.get(screen * eyes + eye);
            let column = || from_top.iter().map(of_screen);
            if caption > 0 && eye == 0 {
                let number = line(&format!("frame{:04}", frame.number), [width, caption]);
                imageops::replace(&mut sheet, &number, x, i64::from(GAP / 2));
            }
            let mut y = i64::from(GAP + caption);
            for (picture, height) in column().zip(&heights) {
                if let Some((name, picture)) = picture {
                    imageops::replace(&mut sheet, picture, x, y);
                    if caption > 0 {
                        imageops::replace(&mut sheet, &plate(name, [picture.width(), caption]), x, y);
                    }
                }
                y += i64::from(*height);
            }
        }
    }
    sheet
}

fn small(picture: &RgbaImage) -> RgbaImage {
    let width = PICTURE.min(picture.width());
    let height = (u64::from(picture.height()) * u64::from(width) / u64::from(picture.width())).max(1) as u32;
    imageops::resize(picture, width, height, imageops::FilterType::Triangle)
}

/// [`line()`] with a margin, no longer than the words.
fn plate(words: &str, size: [u32; 2]) -> RgbaImage {
    let line = line(&format!(" {words}"), size);
    let is_inked = |x: &u32| (0..size[1]).any(|y| line.get_pixel(*x, y).0[0] > 2 * BACKGROUND[0]);
    let end = (0..size[0]).rev().find(is_inked).map_or(0, |last| size[0].min(last + 6));
    imageops::crop_imm(&line, 0, 0, end, size[1]).to_image()
}

/// Words on the sheet's ground, cut where they are longer than the size has room.
fn line(words: &str, size: [u32; 2]) -> RgbaImage {
    let mut raster = Raster::new(size.map(|side| side as usize), BACKGROUND);
    raster.paint(|painter| {
        let middle = pos2(0.0, 0.5 * size[1] as f32);
        painter.text(middle, Align2::LEFT_CENTER, words, FontId::proportional(14.0), INK);
    });
    raster.picture()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RED: image::Rgba<u8> = image::Rgba([255, 0, 0, 255]);
    const BLUE: image::Rgba<u8> = image::Rgba([0, 0, 255, 255]);

    /// A table and a wall above it, for two eyes.
    fn frame(number: usize, width: u32) -> SheetFrame {
        let picture =
            |name: &str, high, colour| (name.to_owned(), RgbaImage::from_pixel(width, high, colour));
        let pictures = [
            picture("table-left", 50, RED),
            picture("table-right", 50, RED),
            picture("wall-left", 30, BLUE),
            picture("wall-right", 30, BLUE),
        ];
        SheetFrame::new(number, &pictures)
    }

    #[test]
    fn screens_stand_below_their_names_as_they_do_in_the_room() {
        let sheet = contact_sheet(&[frame(0, 300), frame(7, 300)], &[1, 0]);
        let column = 300 + GAP;
        assert_eq!(sheet.dimensions(), (2 * (2 * column + 2 * GAP) + GAP, CAPTION + 31 + 51 + 2 * GAP));
        for frame in 0..2 {
            for eye in 0..2 {
                let x = 2 * GAP + frame * (2 * column + 2 * GAP) + eye * column;
                assert_eq!(*sheet.get_pixel(x + 299, GAP + CAPTION + 29), BLUE, "the wall");
                assert_eq!(*sheet.get_pixel(x + 299, GAP + CAPTION + 31), RED, "the table");
                // As long as its name.
                let named =
                    |y: u32| (x..x + 300).filter(|&x| sheet.get_pixel(x, y).0[2] == BACKGROUND[2]).count();
                let [wall, table] = [GAP + CAPTION + 1, GAP + CAPTION + 32].map(named);
                assert!((40..100).contains(&wall) && table > wall, "{wall} {table}");
            }
            let x = 2 * GAP + frame * (2 * column + 2 * GAP);
            let inked = (x..x + 300).filter(|&x| (0..CAPTION).any(|y| sheet.get_pixel(x, y).0[0] > 128));
            assert!((40..100).contains(&inked.count()), "its number");
        }
    }

    /// The names of six screens, one after the other in one line, were cut off, and three pictures could be the same.
    #[test]
    fn frames_that_differ_are_chosen() {
        let chosen = |colours: &[u8]| {
            let mut chosen = SheetFrames::new(colours.len());
            for (number, colour) in colours.iter().enumerate() {
                let picture = RgbaImage::from_pixel(300, 20, image::Rgba([*colour, 0, 0, 255]));
                chosen.take(number, vec![("wall-left", picture)]);
            }
            let are_alike = chosen.are_alike();
            (chosen.frames().iter().map(|frame| frame.number).collect::<Vec<_>>(), are_alike)
        };
        assert_eq!(chosen(&[0, 9, 0, 0, 0]), (vec![0, 1, 4], false), "the first and the last look the same");
        assert_eq!(chosen(&[0, 1, 2, 3, 4]), (vec![0, 2, 4], false), "one way");
        assert_eq!(chosen(&[0, 0, 0, 0, 4]), (vec![0, 2, 4], false));
        assert_eq!(chosen(&[7; 5]), (vec![0], true));
        assert_eq!(chosen(&[7]), (vec![0], false));
        assert_eq!(chosen(&[7, 8]), (vec![0, 1], false));
    }

    #[test]
    fn narrow_pictures_have_no_names_and_no_pictures_make_an_empty_sheet() {
        let sheet = contact_sheet(&[frame(0, 40)], &[1, 0]);
        assert_eq!(sheet.dimensions(), (2 * (40 + GAP) + 3 * GAP, 31 + 51 + 2 * GAP));
        assert_eq!(*sheet.get_pixel(2 * GAP, GAP), BLUE);
        assert!(contact_sheet(&[], &[]).width() > 0);
    }
}
