//! Writing over pictures: nothing is made for an overlay that is never shown, what is drawn lies exactly on its pixels,
//! and the test pattern shows what a display's installer looks for.

use crate::common::{folder, greenstage};
use crate::render_common::require_gpu;
use greenstage::render::{COLOR_FORMAT, FrameContents, Gpu, Offscreen, Overlay, Renderer, Viewport};
use image::{Rgb, RgbImage};

/// A picture of 64 × 48 pixels, black, with what `paint` writes over it.
fn written(gpu: &Gpu, overlay: &mut Overlay, paint: impl FnMut(&egui::Painter)) -> RgbImage {
    let size = [64, 48];
    let mut renderer = Renderer::new(gpu, COLOR_FORMAT, 1).unwrap();
    let target = Offscreen::new(gpu, &renderer, size).unwrap();
    renderer.draw(gpu, &[target.picture(&Viewport::full(size, None))], &FrameContents::default()).unwrap();
    overlay.paint(gpu, &target.image.view, size, paint).unwrap();
    image::DynamicImage::from(target.read(gpu).unwrap().0).to_rgb8()
}

#[test]
fn an_overlay_that_shows_nothing_makes_nothing() {
    let Some(gpu) = require_gpu() else { return };
    let mut overlay = Overlay::new(COLOR_FORMAT);
    let picture = written(&gpu, &mut overlay, |_| {});
    assert!(!overlay.is_made() && picture.pixels().all(|pixel| pixel.0 == [0; 3]));
    let write = |painter: &egui::Painter| {
        painter.text(
            egui::pos2(8.0, 8.0),
            egui::Align2::LEFT_TOP,
            "12.5",
            egui::FontId::monospace(14.0),
            egui::Color32::WHITE,
        );
    };
    let first = written(&gpu, &mut overlay, write);
    assert!(overlay.is_made() && first.pixels().any(|pixel| pixel.0 == [255; 3]), "text is there");
    assert_eq!(first, written(&gpu, &mut overlay, write), "the same letters, laid out again");
    assert_eq!(first, written(&gpu, &mut Overlay::new(COLOR_FORMAT), write), "and by another overlay");
}

/// A plate with letters of new sizes enlarges the texture of all letters: those laid out before it were drawn at half their height.
#[test]
fn letters_keep_their_height_when_a_plate_appears() {
    let Some(gpu) = require_gpu() else { return };
    let write = |painter: &egui::Painter, text: &str, size: f32, y: f32| {
        let (at, font) = (egui::pos2(2.0, y), egui::FontId::monospace(size));
        painter.text(at, egui::Align2::LEFT_TOP, text, font, egui::Color32::WHITE);
    };
    let alone = written(&gpu, &mut Overlay::new(COLOR_FORMAT), |painter| write(painter, "12.5", 14.0, 2.0));
    let mut overlay = Overlay::new(COLOR_FORMAT);
    let _ = written(&gpu, &mut overlay, |painter| write(painter, "12.5", 14.0, 2.0));
    let both = written(&gpu, &mut overlay, |painter| {
        write(painter, "12.5", 14.0, 2.0);
        for size in 15..60 {
            write(painter, "abcdefghijklmnopqrstuvwxyz", size as f32, 200.0);
        }
    });
    assert_eq!(alone, both, "the plate is outside the picture");
}

#[test]
fn a_rectangle_of_whole_pixels_covers_them_and_no_other() {
    let Some(gpu) = require_gpu() else { return };
    let picture = written(&gpu, &mut Overlay::new(COLOR_FORMAT), |painter| {
        let mut mesh = egui::Mesh::default();
        let rect = egui::Rect::from_min_max(egui::pos2(3.0, 5.0), egui::pos2(4.0, 11.0));
        mesh.add_colored_rect(rect, egui::Color32::from_rgb(13, 130, 250));
        painter.add(egui::Shape::mesh(mesh));
    });
    for (x, y, pixel) in picture.enumerate_pixels() {
        let inside = x == 3 && (5..11).contains(&y);
        assert_eq!(pixel.0, if inside { [13, 130, 250] } else { [0; 3] }, "{x}, {y}");
    }
}

fn pattern(name: &str, stage: &str, screen: &str) -> [RgbImage; 2] {
    let place = folder(name);
    greenstage(&place, &["pattern", stage, "-o", "out"]);
    ["left", "right"].map(|eye| image::open(place.join(format!("out/{screen}-{eye}.png"))).unwrap().to_rgb8())
}

const WHITE: Rgb<u8> = Rgb([255; 3]);

#[test]
fn the_pattern_has_a_border_of_one_pixel_and_blocks_of_single_pixels() {
    let Some(_) = require_gpu() else { return };
    let [left, right] = pattern("pattern-workbench", "workbench", "wall");
    let (width, height) = left.dimensions();
    assert_eq!((width, height), (1280, 1024));
    for picture in [&left, &right] {
        for (x, y, pixel) in picture.enumerate_pixels() {
            let edge = x.min(width - 1 - x).min(y).min(height - 1 - y);
            assert!(edge != 0 || *pixel == WHITE, "{x}, {y} is {pixel:?}");
            // The middle lines, the grid and the ticks run to the edge, but no white line does beside it.
            assert!(edge != 1 || pixel.0 != [255; 3], "{x}, {y} is {pixel:?}");
        }
    }
    // The blocks are the only places where white and black alternate.
    let is = |x: u32, y: u32, white: bool| left.get_pixel(x, y).0 == [if white { 255 } else { 0 }; 3];
    let block = |rule: fn(u32, u32) -> bool| {
        (100..1180).step_by(2).any(|x0| {
            (600..900)
                .step_by(2)
                .any(|y0| (0..60).all(|i| (0..60).all(|k| is(x0 + i, y0 + k, rule(x0 + i, y0 + k)))))
        })
    };
    assert!(block(|_, y| y % 2 == 0), "rows");
    assert!(block(|x, _| x % 2 == 0), "columns");
    assert!(block(|x, y| (x + y) % 2 == 0), "checkerboard");
}

/// Only the left eye's picture has red, on its left side; only the right eye's has cyan, on its right side.
#[test]
fn swapped_eyes_are_seen_at_once() {
    let Some(_) = require_gpu() else { return };
    let [left, right] = pattern("pattern-cyberstage", "cyberstage", "front");
    let count = |picture: &RgbImage, red: bool| {
        let is = |pixel: &Rgb<u8>| {
            let [r, g, b] = pixel.0.map(i32::from);
            if red { r > 200 && g < 100 && b < 100 } else { r < 100 && g > 150 && b > 150 }
        };
        let half = picture.width() / 2;
        picture
            .enumerate_pixels()
            .filter(|(_, _, pixel)| is(pixel))
            .fold([0, 0], |[l, r], (x, ..)| if x < half { [l + 1, r] } else { [l, r + 1] })
    };
    let [red, cyan] = [count(&left, true), count(&right, false)];
    assert!(red[0] > 5000 && red[1] == 0, "{red:?}");
    assert!(cyan[1] > 5000 && cyan[0] == 0, "{cyan:?}");
    assert_eq!([count(&left, false), count(&right, true)], [[0, 0], [0, 0]]);
}
