//! Paints what colours mean: a bar with round numbers and units, the limit, and a few lines of values, at the bottom of the
//! picture, or at the top where something is held below.

use super::lettering::{DARK, INK, QUIET};
use crate::base::legend::{Legend, ticks};
use crate::base::si;
use crate::render::{beyond_color, map_color};
use crate::stage::Eye;
use crate::world::World;
use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
use nalgebra::{Matrix4, Point3};

/// Of lines that say that a limit is passed.
const WARNS: Color32 = Color32::from_rgb(255, 120, 200);
/// As near to the eye as anything is drawn, m.
const NEAR_M: f64 = 0.05;
/// Lines below the bar, at most.
const LINES: usize = 4;
/// What is held farther down than this part of the picture sends the legend to the top.
const LOW: f32 = 0.62;

/// The legend on its way onto a picture.
pub struct LegendPanel<'a> {
    pub painter: &'a Painter,
    /// The picture.
    pub rect: Rect,
    pub legend: &'a Legend,
    pub at_top: bool,
    /// What stands above or below it already, in pixels.
    pub taken: f32,
}

impl LegendPanel<'_> {
    pub fn paint(&self) {
        let size = (self.rect.height() / 48.0).min(self.rect.width() / 64.0).clamp(8.0, 22.0);
        let line = (1.3 * size).round();
        let width = (0.5 * self.rect.width()).max(30.0 * size).min(self.rect.width() - 2.0 * size).round();
        let lines = self.legend.lines.len().min(LINES);
        let bar_height = (1.1 * size).round();
        let height = line * (2.4 + lines as f32) + bar_height + size;
        let left = (self.rect.center().x - 0.5 * width).round();
        let top = match self.at_top {
            true => self.rect.min.y + size + self.taken,
            false => self.rect.max.y - size - height - self.taken,
        };
        let plate = Rect::from_min_size(pos2(left, top.round()), vec2(width, height));
        self.painter.rect_filled(plate, 0.3 * size, DARK.gamma_multiply(0.86));
        let inside = plate.shrink2(vec2(1.6 * size, 0.5 * size));
        self.heading(inside, size);
        let beyond = if self.legend.has_limit { 2.2 * size } else { 0.0 };
        let bar =
            Rect::from_min_size(inside.min + vec2(0.0, line), vec2(inside.width() - beyond, bar_height));
        self.bar(bar, size);
        if self.legend.has_limit {
            let patch =
                Rect::from_min_max(pos2(bar.max.x + 0.5 * size, bar.min.y), pos2(inside.max.x, bar.max.y));
            let [r, g, b] = beyond_color();
            self.painter.rect_filled(patch, 0.0, Color32::from_rgb(r, g, b));
        }
        let mut place = pos2(inside.min.x, bar.max.y + 1.4 * line);
        for said in self.legend.lines.iter().take(LINES) {
            let ink = if said.warns { WARNS } else { INK };
            let letters = (inside.width() / (0.61 * size)) as usize;
            self.words((place, Align2::LEFT_TOP), &clipped(&said.text, letters), size, ink);
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
        let range = match legend.has_limit {
            true => format!("range: {}   beyond a limit:", legend.range),
            false => format!("range: {}", legend.range),
        };
        let room = (inside.width() / (0.61 * size)) as usize;
        if title.chars().count() + range.chars().count() < room {
            self.words((pos2(inside.max.x, inside.min.y), Align2::RIGHT_TOP), &range, size, QUIET);
        }
    }

    /// What the numbers at the bar are multiples of.
    fn unit(&self) -> (f64, &'static str) {
        if self.legend.unit.is_empty() { (0.01, "") } else { si::prefix(self.legend.to) }
    }

    fn bar(&self, bar: Rect, size: f32) {
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
            self.words((below, Align2::CENTER_TOP), &si::digits(tick / unit), size, INK);
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

    fn words(&self, (place, anchor): (Pos2, Align2), text: &str, size: f32, ink: Color32) {
        self.painter.text(place.round(), anchor, text, FontId::monospace(size), ink);
    }
}

fn clipped(text: &str, letters: usize) -> String {
    match text.chars().count() > letters {
        true => text.chars().take(letters.saturating_sub(1)).chain(['…']).collect(),
        false => text.to_owned(),
    }
}

/// The legend of a world, and whether it stands at the top: where something is held in the lower part of the screen that the viewer
/// looks at.
pub fn of_world(world: &World) -> Option<(&Legend, bool)> {
    let legend = world.legend.as_ref()?;
    let stage = &world.stage;
    let eye = stage.viewer.eye_in_room(&world.room_from_head, Eye::Centre);
    let view = stage.screens.get(stage.faced_screen()).and_then(|screen| screen.view(&eye, NEAR_M).ok());
    let held = world.styli.iter().filter(|stylus| stylus.pressed).filter_map(|stylus| stylus.hit);
    let is_low = |hit: Point3<f32>| view.as_ref().is_some_and(|view| below(&view.clip_from_room, &hit) > LOW);
    Some((legend, held.into_iter().any(is_low)))
}

/// How far down a point lies in a picture, 0 at its upper edge, 1 at its lower.
fn below(clip_from_room: &Matrix4<f32>, point: &Point3<f32>) -> f32 {
    let clip = clip_from_room * point.to_homogeneous();
    if clip.w <= 0.0 { 0.0 } else { 0.5 - 0.5 * clip.y / clip.w }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::StylusShape;
    use crate::stage::Stage;

    #[test]
    fn the_legend_makes_room_for_what_is_held() {
        let mut world = World::of_stage(Stage::find("desktop").unwrap()).unwrap();
        assert_eq!(of_world(&world), None, "nothing is coloured");
        world.legend = Some(Legend::default());
        assert!(!of_world(&world).unwrap().1);
        let screen = &world.stage.screens[0];
        for (y, at_top) in [(-0.9, true), (0.9, false)] {
            let hit: Point3<f32> = screen.point([0.0, y]).cast();
            for pressed in [true, false] {
                let stylus = StylusShape {
                    room_from_stylus: Matrix4::identity(),
                    size_m: 0.1,
                    ray_length_m: 1.0,
                    hit: Some(hit),
                    bend: None,
                    pressed,
                };
                world.styli = vec![stylus];
                assert_eq!(of_world(&world).unwrap().1, at_top && pressed, "{y}");
            }
        }
    }
}
