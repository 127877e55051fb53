//! Writes a few words on a plate, for overlays, patterns and the room view.

use egui::{Align, Align2, Color32, FontId, Galley, Painter, Pos2, Rect, Vec2, vec2};
use std::sync::Arc;

pub const INK: Color32 = Color32::from_rgb(222, 228, 236);
pub const QUIET: Color32 = Color32::from_rgb(158, 170, 184);
pub const DARK: Color32 = Color32::from_rgb(13, 16, 21);
/// Colour of the left eye, both as of red-cyan glasses.
/// Colour of the right eye.
pub const LEFT: Color32 = Color32::from_rgb(236, 58, 48);
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
