//! Paints what colours mean: a bar with round numbers and units, the limit, and a few lines of values.

use super::caption::{INK, QUIET};
use crate::base::legend::{Legend, ticks};
use crate::base::quantity;
use crate::render::{beyond_color, map_color};
use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rangef, Rect, Shape, Stroke, Vec2, pos2, vec2};

/// Colour of lines that say that a limit is passed.
const WARNS: Color32 = Color32::from_rgb(255, 120, 200);
/// Lines below the bar, at most.
const LINES: usize = 4;
/// Smallest height of letters, against the usual, in lines that are too long for it.
const LEAST: f32 = 0.7;

fn line_height(letter: f32) -> f32 {
    (1.3 * letter).round()
}

fn bar_height(letter: f32) -> f32 {
    (1.1 * letter).round()
}

/// The size that a legend takes, at most `room`.
pub fn size(letter: f32, room: Vec2, legend: &Legend) -> Vec2 {
    let width = (0.45 * room.x).max(34.0 * letter).min(room.x - 1.2 * letter).round();
    let lines = legend.lines.len().min(LINES) as f32;
    vec2(width, line_height(letter) * (2.4 + lines) + bar_height(letter))
}

/// Paints it into a rectangle of this size.
pub fn paint(painter: &Painter, rect: Rect, letter: f32, legend: &Legend) {
    Paint { painter, legend }.paint(rect.shrink2(vec2(0.6 * letter, 0.0)), letter);
}

struct Paint<'a> {
    painter: &'a Painter,
    legend: &'a Legend,
}

impl Paint<'_> {
    fn paint(&self, inside: Rect, size: f32) {
        let line = line_height(size);
        self.heading(inside, size);
        let beyond = if self.legend.has_limit { 2.2 * size } else { 0.0 };
        let place = inside.min + vec2(0.0, line);
        let bar = Rect::from_min_size(place, vec2(inside.width() - beyond, bar_height(size)));
        self.bar(bar, size, inside.x_range());
        if self.legend.has_limit {
            let patch =
                Rect::from_min_max(pos2(bar.max.x + 0.5 * size, bar.min.y), pos2(inside.max.x, bar.max.y));
            let [r, g, b] = beyond_color();
            self.painter.rect_filled(patch, 0.0, Color32::from_rgb(r, g, b));
        }
        let mut place = pos2(inside.min.x, bar.max.y + 1.4 * line);
        for said in self.legend.lines.iter().take(LINES) {
            let ink = if said.warns { WARNS } else { INK };
            // A long line has smaller letters before it is cut.
            let letters = (inside.width() / (0.61 * size)) as usize;
            let smaller = (letters as f32 / said.text.chars().count().max(1) as f32).clamp(LEAST, 1.0) * size;
            let letters = (inside.width() / (0.61 * smaller)) as usize;
            self.words((place, Align2::LEFT_TOP), &clipped(&said.text, letters), smaller, ink);
            place.y += line;
        }
    }

    fn heading(&self, inside: Rect, size: f32) {
        let legend = self.legend;
        let (_, prefix) = self.unit();
        let title = match legend.unit.is_empty() {
            true => format!("{} (%)", legend.title),
            false => format!("{} ({prefix}{})", legend.title, legend.unit),
        };
        self.words((inside.min, Align2::LEFT_TOP), &title, size, INK);
        let room = (inside.width() / (0.61 * size)) as usize;
        let range = beside_the_title(legend, room.saturating_sub(title.chars().count() + 1));
        self.words((pos2(inside.max.x, inside.min.y), Align2::RIGHT_TOP), &range, size, QUIET);
    }

    /// The unit of the numbers at the bar.
    fn unit(&self) -> (f64, &'static str) {
        if self.legend.unit.is_empty() { (0.01, "") } else { quantity::scale_of(self.legend.to) }
    }

    fn bar(&self, bar: Rect, size: f32, within: Rangef) {
        const STEPS: u32 = 64;
        let mut mesh = Mesh::default();
        let at = |part: f32| bar.min.x + bar.width() * part;
        for step in 0..STEPS {
            let [from, to] = [step, step + 1].map(|step| at(step as f32 / STEPS as f32));
            let [r, g, b] = map_color((step as f32 + 0.5) / STEPS as f32);
            let rect = Rect::from_min_max(pos2(from, bar.min.y), pos2(to, bar.max.y));
            mesh.add_colored_rect(rect, Color32::from_rgb(r, g, b));
        }
        self.painter.add(Shape::mesh(mesh));
        let place = |value: f64| at((value / self.legend.to) as f32).round();
        let (unit, _) = self.unit();
        for tick in ticks(self.legend.to) {
            let x = place(tick);
            let below = pos2(x, bar.max.y + 0.25 * size);
            self.painter.line_segment([pos2(x, bar.max.y), below], Stroke::new(1.0, QUIET));
            self.number(below, &quantity::short(tick / unit), size, within);
        }
        let [r, g, b] = beyond_color();
        for limit in self.legend.limits.iter().filter(|limit| **limit <= self.legend.to * (1.0 + 1e-9)) {
            let x = place(*limit);
            let mark = Rect::from_min_max(
                pos2(x - 1.5, bar.min.y - 0.2 * size),
                pos2(x + 1.5, bar.max.y + 0.2 * size),
            );
            self.painter.rect_filled(mark, 0.0, Color32::from_rgb(r, g, b));
        }
    }

    /// A number below the bar, in the middle of its tick where it ends within the plate.
    fn number(&self, at: Pos2, text: &str, size: f32, within: Rangef) {
        let galley = self.painter.layout_no_wrap(text.to_owned(), FontId::monospace(size), INK);
        let width = galley.size().x;
        let most = (within.max - width).max(within.min);
        let left = (at.x - 0.5 * width).clamp(within.min, most);
        self.painter.galley(pos2(left, at.y).round(), galley, INK);
    }

    fn words(&self, (place, anchor): (Pos2, Align2), text: &str, size: f32, ink: Color32) {
        self.painter.text(place.round(), anchor, text, FontId::monospace(size), ink);
    }
}

/// Words beside the title, of at most `letters` letters: where the range is from, and what the patch at the bar's end means,
/// which matters more.
fn beside_the_title(legend: &Legend, letters: usize) -> String {
    let range = format!("range: {}", legend.range);
    let words = match legend.has_limit {
        true => vec![format!("{range}   {BEYOND}"), BEYOND.to_owned(), "limit:".to_owned()],
        false => vec![range],
    };
    words.into_iter().find(|words| words.chars().count() <= letters).unwrap_or_default()
}

/// Words for the patch at the bar's end.
const BEYOND: &str = "beyond a limit:";

fn clipped(text: &str, letters: usize) -> String {
    match text.chars().count() > letters {
        true => text.chars().take(letters.saturating_sub(1)).chain(['…']).collect(),
        false => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::legend::LegendLine;

    /// The last number below the bar stood half outside the plate.
    #[test]
    fn all_words_of_a_legend_stand_within_its_plate() {
        for (to, has_limit) in [(1.0, false), (125e6, false), (0.25, true), (2.5e-7, false), (1e15, false)] {
            let legend = Legend {
                title: "largest principal strain".into(),
                unit: "Pa".into(),
                to,
                range: "largest so far (C: reset)".into(),
                limits: vec![to],
                has_limit,
                lines: vec![LegendLine { text: "b: at most 1.2 MPa".repeat(4), warns: false }],
            };
            let (letter, room) = (14.0, vec2(1240.0, 700.0));
            let plate =
                Rect::from_min_size(pos2(20.0, 30.0), size(letter, room, &legend) + vec2(1.2 * letter, 0.0));
            let output = egui::Context::default().run_pass(egui::RawInput::default(), |context| {
                paint(&context.layer_painter(egui::LayerId::background()), plate, letter, &legend);
            });
            let words = output.shapes.iter().filter(|clipped| matches!(clipped.shape, Shape::Text(_)));
            let words: Vec<Rect> = words.map(|clipped| clipped.shape.visual_bounding_rect()).collect();
            assert!(words.len() > 4, "{words:?}");
            let outside = words.iter().find(|rect| !plate.expand(0.5).contains_rect(**rect));
            assert_eq!(outside, None, "{to}: outside {plate}");
        }
    }

    /// A legend of displacements had a magenta patch without an explanation.
    #[test]
    fn the_patch_beyond_a_limit_has_its_caption_before_the_range_has() {
        let legend = Legend {
            title: "displacement".into(),
            unit: "m".into(),
            to: 0.4,
            range: "largest of the session".into(),
            limits: Vec::new(),
            has_limit: true,
            lines: Vec::new(),
        };
        assert_eq!(beside_the_title(&legend, 60), "range: largest of the session   beyond a limit:");
        assert_eq!(beside_the_title(&legend, 40), "beyond a limit:");
        assert_eq!(beside_the_title(&legend, 5), "");
        let plain = Legend { has_limit: false, ..legend };
        assert_eq!(beside_the_title(&plain, 40), "range: largest of the session");
    }
}
