//! Paints the plates of a world over its pictures: words in a corner or beside a place in the room.
//!
//! In: [`Plate`]s, and the part of a picture that shows a screen to an eye. Out: dark plates with words, and plots ([`plot`]).
//! Those in corners are the same for both eyes, and go aside where something is held ([`PlateSeats`]); one beside a place stands at
//! that place's depth.

use super::caption::{BAD, DARK, FAIR, GOOD, INK, QUIET};
use super::plate_seats::{KeepClear, PlateRequest, PlateSeats, Room, Side, covered, is_over};
use super::window_layout::{Part, view_of};
use super::{legend, plot};
use crate::base::plates::{Anchor, Plate, Tone};
use crate::stage::Stage;
use egui::{Color32, FontId, Galley, Painter, Pos2, Rect, Stroke, Vec2, pos2, vec2};
use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

/// The colour of a tone.
pub fn ink(tone: Tone) -> Color32 {
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
    /// The part of the height that stays free below them, for a caption.
    pub lift: f32,
    /// Rectangles of the picture that are taken: the overlay's plates, the panel, messages.
    pub taken: &'a [Rect],
    /// Rectangles to keep clear on the screen that the viewer looks at.
    pub clear: &'a KeepClear,
    /// Time of the trackers, s.
    pub time_s: f64,
}

/// Sizes of plates against the full one, where there is less and less room.
const SCALES: [f32; 3] = [1.0, 0.8, 0.65];

/// A plate as it is laid out.
struct LaidOut<'a> {
    plate: &'a Plate,
    lines: Vec<Arc<Galley>>,
    size: Vec2,
    letter: f32,
}

impl Plates<'_> {
    /// Returns the rectangles of all plates for which there is room: those of the right corner, those of the left one, and those
    /// beside places.
    pub fn paint(&self, painter: &Painter, part: &Part, seats: &mut PlateSeats) -> Vec<Rect> {
        let painter = &painter.with_clip_rect(part.rect);
        let letter = letter_height(part.rect);
        let inside = part.rect.shrink(letter);
        let held = part.pixels(&self.clear.held);
        let mut painted = Vec::new();
        if part.screen == self.stage.faced_screen() {
            painted = self.paint_corners(painter, part, letter, &held, seats);
        }
        for plate in self.plates {
            let Anchor::Place(place) = plate.anchor else { continue };
            let Some(at) = self.pixel(part, place) else { continue };
            let laid_out = LaidOut::new(painter, plate, letter, inside.size());
            let taken: Vec<Rect> = self.taken.iter().chain(&painted).copied().collect();
            let corner = beside(at, laid_out.size, inside, letter, &taken).round();
            let foot = at.clamp(corner, corner + laid_out.size);
            painter.line_segment([at, foot], Stroke::new(1.5, INK.gamma_multiply(0.7)));
            painted.push(laid_out.paint(painter, corner));
        }
        painted
    }

    fn paint_corners(
        &self,
        painter: &Painter,
        part: &Part,
        letter: f32,
        held: &[Rect],
        seats: &mut PlateSeats,
    ) -> Vec<Rect> {
        // Both eyes' pictures have the same seats, wherever they stand in their textures.
        let origin = part.rect.min.to_vec2();
        let here =
            |rects: &[Rect]| -> Vec<Rect> { rects.iter().map(|rect| rect.translate(-origin)).collect() };
        let mut inside = part.rect.translate(-origin).shrink(letter);
        let room = inside.size();
        inside.max.y -= self.lift * inside.height();
        let (mut wanted, mut sheets) = (Vec::new(), Vec::new());
        let mut width = room.x;
        for (side, anchor) in [(Side::Right, Anchor::LowerRight), (Side::Left, Anchor::LowerLeft)] {
            let mut widest = 0.0_f32;
            for plate in self.plates.iter().filter(|plate| plate.anchor == anchor) {
                let sheet = SCALES.map(|scale| {
                    let least = (scale * letter).max(LEAST_LETTER);
                    LaidOut::new(painter, plate, least, vec2(scale * width, scale * room.y))
                });
                widest = widest.max(sheet[0].size.x + letter);
                wanted.push(PlateRequest { side, sizes: sheet.iter().map(|sheet| sheet.size).collect() });
                sheets.push(sheet);
            }
            // Words in the left corner break where the plates in the right one begin.
            width -= widest;
        }
        let (taken, held) = (here(self.taken), here(held));
        let [loose, bodies] = [&self.clear.loose, &self.clear.bodies].map(|rects| here(&part.pixels(rects)));
        let room = Room {
            inside,
            gap: 0.5 * letter,
            taken: &taken,
            held: &held,
            loose: &loose,
            bodies: &bodies,
            time_s: self.time_s,
        };
        let seats = seats.take(&room, &wanted);
        let seated = seats.into_iter().zip(sheets).filter_map(|(seat, sheets)| {
            let seat = seat?;
            let sheet = sheets.into_iter().nth(seat.size)?;
            Some(sheet.paint(painter, (seat.rect.min + origin).round()))
        });
        seated.collect()
    }

    /// The pixel of a place in the room; `None` where it is not seen.
    fn pixel(&self, part: &Part, place: [f64; 3]) -> Option<Pos2> {
        let view = view_of(self.stage, self.room_from_head, part)?;
        let clip = view.clip_from_room * Point3::from(place).cast::<f32>().to_homogeneous();
        let ndc = [clip.x / clip.w, clip.y / clip.w];
        let is_seen = clip.w > 0.0 && ndc.iter().all(|x| x.abs() <= 1.0);
        let across = [0.5 * (1.0 + ndc[0]), 0.5 * (1.0 - ndc[1])];
        is_seen.then(|| part.rect.min + vec2(across[0], across[1]) * part.rect.size())
    }
}

/// Height of the smallest letters, pixels.
const LEAST_LETTER: f32 = 9.0;

/// Letters are up to 26 pixels high.
fn letter_height(rect: Rect) -> f32 {
    (rect.height() / 50.0).min(rect.width() / 76.0).clamp(LEAST_LETTER, 26.0)
}

/// The rectangle up and to the right of a place, or elsewhere beside it; where all that is taken, the nearest above or below what
/// stands there, or else where it covers least. Within the picture.
fn beside(at: Pos2, size: Vec2, inside: Rect, letter: f32, taken: &[Rect]) -> Pos2 {
    let room = (inside.max - size).max(inside.min);
    let away = 1.5 * letter;
    let (right, left) = (away, -away - size.x);
    let (up, down) = (-away - size.y, away);
    let middle = -0.5 * size.x;
    let places = [(right, up), (left, up), (right, down), (left, down), (middle, up), (middle, down)];
    let corners = places.map(|(x, y)| (at + vec2(x, y)).clamp(inside.min, room));
    let over = |corner: &Pos2| covered(Rect::from_min_size(*corner, size), taken);
    let is_free = |corner: &Pos2| !is_over(Rect::from_min_size(*corner, size), taken);
    let gap = 0.5 * letter;
    let rows = taken.iter().flat_map(|rect| [rect.min.y - gap - size.y, rect.max.y + gap]);
    let further = rows.flat_map(|y| [right, left, middle].map(|x| pos2(at.x + x, y).clamp(inside.min, room)));
    let away = |corner: &Pos2| (Rect::from_min_size(*corner, size).center() - at).length();
    let nearest = || further.filter(is_free).min_by(|a, b| away(a).total_cmp(&away(b)));
    let least = || corners.into_iter().min_by(|a, b| over(a).total_cmp(&over(b)));
    corners.into_iter().find(is_free).or_else(nearest).or_else(least).unwrap_or(inside.min)
}

impl<'a> LaidOut<'a> {
    fn new(painter: &Painter, plate: &'a Plate, letter: f32, room: Vec2) -> LaidOut<'a> {
        let line = |words: &Vec<(String, Tone)>| {
            let mut job = egui::text::LayoutJob::default();
            job.wrap.max_width = (room.x - 1.2 * letter).max(8.0 * letter);
            for (text, tone) in words {
                job.append(text, 0.0, egui::TextFormat::simple(FontId::monospace(letter), ink(*tone)));
            }
            painter.layout_job(job)
        };
        let lines: Vec<Arc<Galley>> = plate.lines.iter().map(line).collect();
        let width = lines.iter().map(|line| line.size().x).fold(0.0, f32::max);
        let height: f32 = lines.iter().map(|line| line.size().y).sum();
        let plot = plate.plot.as_ref().map_or(Vec2::ZERO, |_| plot::size(letter, room));
        let legend = plate.legend.as_ref().map_or(Vec2::ZERO, |shown| legend::size(letter, room, shown));
        let inside = vec2(width.max(plot.x).max(legend.x), height + plot.y + legend.y);
        let size = inside + vec2(1.2 * letter, 0.8 * letter);
        LaidOut { plate, lines, size, letter }
    }

    fn paint(self, painter: &Painter, corner: Pos2) -> Rect {
        let letter = self.letter;
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
        if let Some(shown) = &self.plate.legend {
            let rest = Rect::from_min_max(pos2(corner.x, at.y), plate.max);
            legend::paint(painter, rest, letter, shown);
        }
        plate
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::plates::{Axis, Plot};
    use crate::stage::{Eye, Stereo, Tile};

    /// The rectangles of plates on a screen of 1280 by 800 pixels, and where a place is seen on it.
    fn painted(plates: &[Plate], place: [f64; 3], taken: &[Rect]) -> (Vec<Rect>, Option<Pos2>) {
        let stage = Stage::find("desktop").unwrap();
        let visible = Tile::whole(&stage, 0, Stereo::Mono).visible(&stage.screens[0], [1280, 800]).unwrap();
        let rect = Rect::from_min_size(Pos2::ZERO, vec2(1280.0, 800.0));
        let part = Part { screen: 0, eye: Eye::Centre, rect, visible };
        let plates = Plates {
            stage: &stage,
            room_from_head: &stage.viewer.room_from_head,
            plates,
            lift: 0.0,
            taken,
            clear: &KeepClear::default(),
            time_s: 0.0,
        };
        let (mut rects, context) = (Vec::new(), egui::Context::default());
        let input = egui::RawInput { screen_rect: Some(rect), ..Default::default() };
        let layer = egui::LayerId::background();
        let _ = context.run_pass(input, |context| {
            rects = plates.paint(&context.layer_painter(layer), &part, &mut PlateSeats::default());
        });
        (rects, plates.pixel(&part, place))
    }

    #[test]
    fn plates_stand_in_their_corners_and_over_no_other() {
        let plot = Plot {
            x: Axis { name: "displacement", unit: "m" },
            y: Axis { name: "force", unit: "N" },
            curves: vec![vec![[0.0, 0.0], [0.1, 5.0]]],
            band: Vec::new(),
            now: None,
        };
        let long = "a sentence of many words that goes on and on ".repeat(4);
        let plates = [
            Plate::new(Anchor::LowerLeft, long.clone()),
            Plate { plot: Some(plot), ..Plate::new(Anchor::LowerRight, "curve") },
            Plate::new(Anchor::LowerLeft, "second"),
        ];
        let (rects, _) = painted(&plates, [0.0; 3], &[]);
        let [right, left, above] = rects[..] else { panic!("{rects:?}") };
        assert!(right.max.x > 1200.0 && right.max.y > 760.0 && left.min.x < 40.0 && left.max.y > 760.0);
        assert!(above.max.y < left.min.y && above.min.x == left.min.x, "above each other");
        assert!(
            !right.intersects(left) && left.height() > 2.0 * above.height(),
            "{right} {left}: it is wrapped"
        );
    }

    #[test]
    fn a_plate_stands_beside_its_place_and_not_where_that_is_not_seen() {
        let stage = Stage::find("desktop").unwrap();
        let centre = stage.workspace.centre;
        let [seen, behind] = [centre.into(), (centre + nalgebra::Vector3::z() * 10.0).into()];
        let plates = [Plate::new(Anchor::Place(seen), "here"), Plate::new(Anchor::Place(behind), "nowhere")];
        let (rects, at) = painted(&plates, seen, &[]);
        let ([rect], Some(at)) = (&rects[..], at) else { panic!("{rects:?} {at:?}") };
        assert!((at.x - 640.0).abs() < 2.0, "the middle of the workspace is before the viewer: {at}");
        assert!(
            rect.min.x > at.x && rect.max.y < at.y && rect.min.distance(at) < 200.0,
            "{rect} beside {at}"
        );
        // Where the overlay stands there, it goes to the other side.
        let (moved, _) = painted(&plates, seen, &[*rect]);
        assert!(!moved[0].intersects(*rect) && moved[0].max.x < at.x, "{moved:?}");
    }

    /// Five rods side by side that were all bent too far: their warnings lay over each other.
    #[test]
    fn plates_beside_neighbouring_places_stand_apart() {
        let centre = Stage::find("desktop").unwrap().workspace.centre;
        let words = "reduced: turned 1.0 times round; the model reduced holds up to 75°";
        let plate = |k: i32| {
            let place = centre + nalgebra::Vector3::x() * (0.05 * f64::from(k));
            Plate::new(Anchor::Place(place.into()), words)
        };
        let plates: Vec<Plate> = (-2..=2).map(plate).collect();
        let (rects, _) = painted(&plates, centre.into(), &[]);
        assert_eq!(rects.len(), 5);
        for (k, rect) in rects.iter().enumerate() {
            assert!(!is_over(*rect, &rects[..k]), "{rects:?}");
        }
    }
}
