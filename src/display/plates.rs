//! Paints the plates of a world over its pictures: words in a corner or beside a place in the room.
//!
//! In: [`Plate`]s, and the part of a picture that shows a screen to an eye. Out: dark plates with words, and plots ([`plot`]).
//! Those in corners are the same for both eyes; one beside a place stands at that place's depth.

use super::lettering::{DARK, INK, QUIET};
use super::plot;
use super::window_layout::{Part, view_of};
use crate::base::plates::{Anchor, Plate, Tone};
use crate::stage::Stage;
use egui::{Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, Vec2, pos2, vec2};
use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

const GOOD: Color32 = Color32::from_rgb(116, 196, 118);
const FAIR: Color32 = Color32::from_rgb(240, 180, 60);
const BAD: Color32 = Color32::from_rgb(240, 86, 70);

fn ink(tone: Tone) -> Color32 {
    match tone {
        Tone::Plain => INK,
        Tone::Quiet => QUIET,
        Tone::Good => GOOD,
        Tone::Fair => FAIR,
        Tone::Bad => BAD,
        Tone::Own([r, g, b]) => Color32::from_rgb(r, g, b),
    }
}

/// The plates on their way onto a picture.
pub struct Plates<'a> {
    pub stage: &'a Stage,
    pub room_from_head: &'a Isometry3<f64>,
    pub plates: &'a [Plate],
    /// Of the height below them, for the warnings of an overlay.
    pub lift: f32,
}

/// A plate as it is laid out.
struct LaidOut<'a> {
    plate: &'a Plate,
    lines: Vec<Arc<Galley>>,
    size: Vec2,
}

impl Plates<'_> {
    /// Room for the overlay's warnings.
    pub const OVER_WARNINGS: f32 = 0.11;

    pub fn paint(&self, painter: &Painter, part: &Part) {
        if self.plates.is_empty() {
            return;
        }
        let painter = &painter.with_clip_rect(part.rect);
        let letter = letter_height(part.rect);
        let inside = part.rect.shrink(letter);
        let is_faced = part.screen == self.stage.faced_screen();
        let [mut left, mut right] = [inside.max.y - self.lift * inside.height(); 2];
        for plate in self.plates {
            let laid_out = LaidOut::new(painter, plate, letter, inside);
            let size = laid_out.size;
            let corner = match plate.anchor {
                Anchor::LowerLeft if is_faced => {
                    left -= size.y + 0.5 * letter;
                    pos2(inside.min.x, left)
                }
                Anchor::LowerRight if is_faced => {
                    right -= size.y + 0.5 * letter;
                    pos2(inside.max.x - size.x, right)
                }
                Anchor::Place(place) => match self.pixel(part, place) {
                    Some(at) => beside(painter, at, size, inside, letter),
                    None => continue,
                },
                _ => continue,
            };
            laid_out.paint(painter, corner.round(), letter);
        }
    }

    /// Where a place in the room is seen; `None` where it is not.
    fn pixel(&self, part: &Part, place: [f64; 3]) -> Option<Pos2> {
        let view = view_of(self.stage, self.room_from_head, part)?;
        let clip = view.clip_from_room * Point3::from(place).cast::<f32>().to_homogeneous();
        let ndc = [clip.x / clip.w, clip.y / clip.w];
        let is_seen = clip.w > 0.0 && ndc.iter().all(|x| x.abs() <= 1.0);
        let across = [0.5 * (1.0 + ndc[0]), 0.5 * (1.0 - ndc[1])];
        is_seen.then(|| part.rect.min + vec2(across[0], across[1]) * part.rect.size())
    }
}

/// Letters are 9 to 26 pixels high.
fn letter_height(rect: Rect) -> f32 {
    (rect.height() / 46.0).min(rect.width() / 64.0).clamp(9.0, 26.0)
}

/// Up and to the right of a place, with a line from it; within the picture.
fn beside(painter: &Painter, at: Pos2, size: Vec2, inside: Rect, letter: f32) -> Pos2 {
    let room = (inside.max - size).max(inside.min);
    let corner = (at + vec2(1.5 * letter, -1.5 * letter - size.y)).clamp(inside.min, room);
    let foot = pos2(at.x.clamp(corner.x, corner.x + size.x), at.y.clamp(corner.y, corner.y + size.y));
    painter.line_segment([at, foot], Stroke::new(1.5, INK.gamma_multiply(0.7)));
    corner
}

impl<'a> LaidOut<'a> {
    fn new(painter: &Painter, plate: &'a Plate, letter: f32, inside: Rect) -> LaidOut<'a> {
        let line = |words: &Vec<(String, Tone)>| {
            let mut job = egui::text::LayoutJob::default();
            job.wrap.max_width = (inside.width() - 2.0 * letter).max(8.0 * letter);
            for (text, tone) in words {
                job.append(text, 0.0, egui::TextFormat::simple(FontId::monospace(letter), ink(*tone)));
            }
            painter.layout_job(job)
        };
        let lines: Vec<Arc<Galley>> = plate.lines.iter().map(line).collect();
        let width = lines.iter().map(|line| line.size().x).fold(0.0, f32::max);
        let height: f32 = lines.iter().map(|line| line.size().y).sum();
        let plot = plate.plot.as_ref().map_or(Vec2::ZERO, |_| plot::size(letter, inside));
        let size = vec2(width.max(plot.x), height + plot.y) + vec2(1.2 * letter, 0.8 * letter);
        LaidOut { plate, lines, size }
    }

    fn paint(self, painter: &Painter, corner: Pos2, letter: f32) {
        let plate = Rect::from_min_size(corner, self.size);
        painter.rect_filled(plate, 0.3 * letter, DARK.gamma_multiply(0.86));
        let mut at = corner + vec2(0.6 * letter, 0.4 * letter);
        for line in self.lines {
            let height = line.size().y;
            painter.galley(at.round(), line, INK);
            at.y += height;
        }
        if let Some(shown) = &self.plate.plot {
            let rest = Rect::from_min_max(pos2(corner.x, at.y), plate.max);
            plot::paint(painter, rest, letter, shown);
        }
    }
}
