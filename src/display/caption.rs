//! A caption in a window: a title, measured values, the progress of a story, and its keys.
//!
//! In: a [`Caption`]. Out: a plate at the bottom of the picture with its words, and one in its upper right corner with the
//! keys. It lies over everything else that a window shows, once, however many tiles the window has. [`Lettering`] writes the
//! words, also for overlays, patterns and the room view.

use egui::text::LayoutJob;
use egui::{Align, Align2, Color32, FontId, Galley, Painter, Pos2, Rect, TextFormat, Vec2, pos2, vec2};
use std::sync::Arc;

/// The colour of measured values, and of the progress of a story.
const ACCENT: Color32 = Color32::from_rgb(255, 190, 92);

/// Words over a window.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Caption {
    pub title: String,
    /// One or two sentences.
    pub text: String,
    /// Values measured in this frame; an empty line is left out.
    pub numbers: String,
    /// Number of this chapter, counted from 0, and the number of chapters.
    pub chapter: (usize, usize),
    /// Progress of this chapter, or of what it waits for, 0 to 1.
    pub share: f64,
    /// Name of the state, such as "paused".
    pub state: String,
    /// Keys and what they do.
    pub keys: Vec<(String, String)>,
    /// Opacity of the keys, 0 to 1.
    pub keys_shown: f32,
}

impl Caption {
    /// Part of a picture's height that a caption of three lines takes.
    pub const MOST_HEIGHT: f32 = 0.17;

    /// Paints it over a picture of this rectangle.
    pub fn paint(&self, painter: &Painter, picture: Rect) {
        let size = (picture.height() / 36.0).min(picture.width() / 58.0).clamp(8.0, 34.0);
        self.words(painter, picture, size);
        if self.keys_shown > 0.0 && !self.keys.is_empty() {
            self.key_plate(painter, picture, (0.72 * size).max(8.0));
        }
    }

    /// The plate at the bottom.
    fn words(&self, painter: &Painter, picture: Rect, size: f32) {
        let wide = picture.width().min(56.0 * size);
        let inside = wide - 2.0 * size;
        let title = line(painter, &self.title, 1.15 * size, INK, inside);
        let mut rows =
            vec![(title, 0.25 * size), (line(painter, &self.text, 0.88 * size, QUIET, inside), 0.3 * size)];
        if !self.numbers.is_empty() {
            rows.push((line(painter, &self.numbers, 1.05 * size, ACCENT, inside), 0.1 * size));
        }
        let height: f32 = rows.iter().map(|(row, gap)| row.size().y + gap).sum::<f32>() + 1.1 * size;
        let corner = pos2(picture.center().x - wide / 2.0, picture.max.y - height).round();
        let plate = Rect::from_min_size(corner, vec2(wide, height));
        let whole = Rect::from_min_max(pos2(picture.min.x, corner.y), picture.max);
        painter.rect_filled(whole, 0.0, DARK.gamma_multiply(0.9));
        let mut top = plate.min.y + 0.5 * size;
        for (row, gap) in rows {
            let height = row.size().y;
            painter.galley(pos2(plate.min.x + size, top).round(), row, INK);
            top += height + gap;
        }
        self.progress(painter, plate, size);
    }

    /// A mark for each chapter, and how far the present one has come.
    fn progress(&self, painter: &Painter, plate: Rect, size: f32) {
        let (now, all) = self.chapter;
        let (length, gap, thick) = (1.5 * size, 0.3 * size, (0.16 * size).max(2.0));
        let right = plate.max.x - size;
        let top = plate.min.y + 1.05 * size;
        let start = right - all as f32 * (length + gap) + gap;
        for k in 0..all {
            let left = start + k as f32 * (length + gap);
            let part = |share: f64| {
                Rect::from_min_size(pos2(left, top), vec2(length * share.clamp(0.0, 1.0) as f32, thick))
            };
            painter.rect_filled(part(1.0), 0.0, QUIET.gamma_multiply(0.35));
            let share = if k < now {
                1.0
            } else if k == now {
                self.share
            } else {
                0.0
            };
            painter.rect_filled(part(share), 0.0, if k == now { ACCENT } else { QUIET });
        }
        if !self.state.is_empty() {
            let place = pos2(start - 0.8 * size, top + thick / 2.0);
            let font = FontId::proportional(0.8 * size);
            painter.text(place, Align2::RIGHT_CENTER, &self.state, font, ACCENT);
        }
    }

    /// The keys, in the upper right corner.
    fn key_plate(&self, painter: &Painter, picture: Rect, size: f32) {
        let ink = |colour: Color32| colour.gamma_multiply(self.keys_shown.clamp(0.0, 1.0));
        let lay = |text: &str, colour: Color32| line(painter, text, size, ink(colour), f32::INFINITY);
        let rows: Vec<_> = self.keys.iter().map(|(key, what)| (lay(key, INK), lay(what, QUIET))).collect();
        let widest = |of: &dyn Fn(usize) -> f32| (0..rows.len()).map(of).fold(0.0, f32::max);
        let (keys, words) = (widest(&|k| rows[k].0.size().x), widest(&|k| rows[k].1.size().x));
        let step = 1.45 * size;
        let whole = vec2(keys + words + 2.8 * size, rows.len() as f32 * step + size);
        let corner = pos2(picture.max.x - whole.x - 0.7 * size, picture.min.y + 0.7 * size).round();
        painter.rect_filled(Rect::from_min_size(corner, whole), 0.35 * size, ink(DARK).gamma_multiply(0.82));
        for (k, (key, what)) in rows.into_iter().enumerate() {
            let place = corner + vec2(size, 0.6 * size + k as f32 * step);
            painter.galley(place.round(), key, INK);
            painter.galley((place + vec2(keys + 0.8 * size, 0.0)).round(), what, INK);
        }
    }
}

/// Words of letters of their own widths, broken where they are wider than `width`.
fn line(painter: &Painter, text: &str, size: f32, ink: Color32, width: f32) -> std::sync::Arc<egui::Galley> {
    let mut job = LayoutJob { halign: Align::LEFT, ..LayoutJob::default() };
    job.wrap.max_width = width;
    job.append(text, 0.0, TextFormat::simple(FontId::proportional(size.max(7.0)), ink));
    painter.layout_job(job)
}

/// The rectangle in which a caption is painted in a window: its whole picture, when the last tile is painted.
pub fn whole(texture_size: [u32; 2]) -> Rect {
    let [width, height] = texture_size.map(|side| side as f32);
    Rect::from_min_size(Pos2::ZERO, vec2(width, height))
}

pub const INK: Color32 = Color32::from_rgb(222, 228, 236);
pub const QUIET: Color32 = Color32::from_rgb(158, 170, 184);
pub const DARK: Color32 = Color32::from_rgb(13, 16, 21);
/// Lines of axes and tables, and what a bar has not filled.
pub const RULE: Color32 = Color32::from_rgb(54, 62, 74);
pub const GOOD: Color32 = Color32::from_rgb(116, 196, 118);
pub const FAIR: Color32 = Color32::from_rgb(240, 180, 60);
pub const BAD: Color32 = Color32::from_rgb(240, 86, 70);
/// Colour of the left eye, as of red-cyan glasses.
pub const LEFT: Color32 = Color32::from_rgb(236, 58, 48);
/// Colour of the right eye.
pub const RIGHT: Color32 = Color32::from_rgb(38, 208, 228);

/// Text of letters of one width, `size` pixels high, its anchor at `place`, on a plate of the colour `plate`. Lines are
/// aligned to the anchor's side. Returns the plate.
pub fn write(
    painter: &Painter,
    place: (Pos2, Align2),
    text: &str,
    size: f32,
    [ink, plate]: [Color32; 2],
) -> Rect {
    Lettering::new(painter, place, text, size, ink).paint(painter, Vec2::ZERO, plate)
}

/// Text on a plate, laid out and not yet painted.
pub struct Lettering {
    place: Pos2,
    galley: Arc<Galley>,
    /// The plate.
    pub rect: Rect,
}

impl Lettering {
    pub fn new(
        painter: &Painter,
        (place, anchor): (Pos2, Align2),
        text: &str,
        size: f32,
        ink: Color32,
    ) -> Lettering {
        let galley = lines(painter, text, size, ink, anchor.x());
        let top = match anchor.y() {
            Align::Min => 0.0,
            Align::Center => -galley.size().y / 2.0,
            Align::Max => -galley.size().y,
        };
        // A galley that is aligned right or centred begins left of its place; its rectangle tells.
        let place = (place + vec2(0.0, top)).round();
        let rect = galley.rect.translate(place.to_vec2()).expand2(vec2(0.4 * size, 0.1 * size));
        Lettering { place, galley, rect }
    }

    /// Paints it, moved aside by `offset`.
    pub fn paint(self, painter: &Painter, offset: Vec2, plate: Color32) -> Rect {
        let rect = self.rect.translate(offset);
        painter.rect_filled(rect, 0.0, plate);
        painter.galley(self.place + offset, self.galley, INK);
        rect
    }
}

/// Text of letters of one width, broken where it is wider than `width`.
pub fn wrapped(painter: &Painter, text: &str, size: f32, ink: Color32, width: f32) -> Arc<Galley> {
    let font = FontId::monospace(size.max(7.0));
    painter.layout_job(egui::text::LayoutJob::simple(text.to_owned(), font, ink, width.max(size)))
}

/// Letters of less than 7 pixels cannot be read, so there are none.
fn lines(painter: &Painter, text: &str, size: f32, ink: Color32, align: Align) -> Arc<Galley> {
    let font = FontId::monospace(size.max(7.0));
    let mut job = egui::text::LayoutJob::simple(text.to_owned(), font, ink, f32::INFINITY);
    job.halign = align;
    painter.layout_job(job)
}
