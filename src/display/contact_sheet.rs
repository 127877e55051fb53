//! The contact sheet of a session: some of its frames on one picture, as their screens stand.
//!
//! In: the pictures of each frame, with their names. Out: one picture. Frames stand from left to right, in each one column for each
//! eye; a column has the screens from the highest to the lowest, so that a wall stands on the table before it, below the names of
//! their files.

use crate::export::raster::Raster;
use egui::{Align2, Color32, FontId, pos2};
use image::{RgbaImage, imageops};

/// Width of one picture.
const PICTURE: u32 = 400;
const GAP: u32 = 8;
/// Height of the line of names; left out above narrow pictures, which have no room for one.
const CAPTION: u32 = 20;
const NARROW: u32 = 200;
const BACKGROUND: [u8; 3] = [24, 26, 30];
const INK: Color32 = Color32::from_gray(200);

/// One frame: its pictures, screen by screen and in each eye by eye.
pub struct SheetFrame {
    pub number: usize,
    pictures: Vec<(String, RgbaImage)>,
}

impl SheetFrame {
    /// Keeps the pictures as small as they stand on the sheet.
    pub fn new(number: usize, pictures: &[(&str, RgbaImage)]) -> SheetFrame {
        let small = |(name, picture): &(&str, RgbaImage)| ((*name).to_owned(), small(picture));
        SheetFrame { number, pictures: pictures.iter().map(small).collect() }
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
            if caption > 0 {
                let names: Vec<&str> = column().flatten().map(|(name, _)| name.as_str()).collect();
                let names = format!("frame{:04}: {}", frame.number, names.join(", "));
                imageops::replace(&mut sheet, &line(&names, [width, caption]), x, i64::from(GAP / 2));
            }
            let mut y = i64::from(GAP + caption);
            for (picture, height) in column().zip(&heights) {
                if let Some((_, picture)) = picture {
                    imageops::replace(&mut sheet, picture, x, y);
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
        let picture = |name, high, colour| (name, RgbaImage::from_pixel(width, high, colour));
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
                assert_eq!(*sheet.get_pixel(x, GAP + CAPTION + 31), RED, "the table");
                let inked = (x..x + 300).filter(|&x| (0..CAPTION).any(|y| sheet.get_pixel(x, y).0[0] > 128));
                assert!((60..300).contains(&inked.count()), "names above each column");
            }
        }
        let differ = |a: u32, b: u32| {
            (0..300).any(|x| (0..CAPTION).any(|y| sheet.get_pixel(a + x, y) != sheet.get_pixel(b + x, y)))
        };
        assert!(differ(2 * GAP, 2 * GAP + column), "each column its own");
    }

    #[test]
    fn narrow_pictures_have_no_names_and_no_pictures_make_an_empty_sheet() {
        let sheet = contact_sheet(&[frame(0, 40)], &[1, 0]);
        assert_eq!(sheet.dimensions(), (2 * (40 + GAP) + 3 * GAP, 31 + 51 + 2 * GAP));
        assert_eq!(*sheet.get_pixel(2 * GAP, GAP), BLUE);
        assert!(contact_sheet(&[], &[]).width() > 0);
    }
}
