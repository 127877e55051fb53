//! The test pattern of one screen for one eye, painted in pixels.
//!
//! In: a screen with its corners in the room, and the rectangle of pixels that shows it, or a part of it. Out: a grid of
//! square cells in centimetres, a border of one pixel at the very edge, rulers, a circle, labels, and blocks of single
//! pixels. Everything that must be exact to the pixel is a rectangle with whole coordinates, which anti-aliasing does not
//! change.

use crate::display::caption::{DARK, INK, LEFT, QUIET, RIGHT, wrapped, write};
use crate::stage::{Eye, Screen};
use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rect, Shape, Stroke, pos2, vec2};
use std::f32::consts::TAU;

const FAINT: Color32 = Color32::from_rgb(44, 52, 63);
const STRONG: Color32 = Color32::from_rgb(92, 106, 124);

/// Steps of rulers and grids, m.
const STEPS: [f64; 13] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0];
/// Least distance between two ticks of a ruler, pixels.
const TICK_PIXELS: f64 = 5.0;
/// Chords of a circle: of a radius of 1000 pixels they stay within 0.1 pixel of it.
const CIRCLE: u16 = 256;
/// Cells of the grid over the shorter side, at most.
const MOST_CELLS: f64 = 18.0;

/// Whether the pixel in this column and row of the picture is white.
type IsWhite = fn(i32, i32) -> bool;

/// Paints the pattern of one screen.
pub struct Pattern<'a> {
    pub painter: &'a Painter,
    /// Whole pixels.
    pub rect: Rect,
    /// Left, right, bottom and top of `rect` in the screen's normalised device coordinates.
    pub on_screen: [f64; 4],
    pub stage: &'a str,
    pub screen: &'a Screen,
    pub eye: Eye,
}

impl Pattern<'_> {
    pub fn paint(&self) {
        if !self.rect.is_positive() {
            return;
        }
        let mut ground = Mesh::default();
        ground.add_colored_rect(self.rect, DARK);
        self.grid(&mut ground);
        self.rulers(&mut ground);
        self.border(&mut ground);
        self.painter.add(Shape::mesh(ground));
        self.circle();
        self.ruler_labels();
        self.title();
        self.corners();
        self.eye_marks();
        self.parity_blocks();
        self.grey_ramp();
    }

    /// A hundredth of the shorter side, px.
    fn unit(&self) -> f32 {
        self.rect.width().min(self.rect.height()) / 100.0
    }

    fn pixels_per_m(&self) -> [f64; 2] {
        let ([left, right, bottom, top], size) = (self.on_screen, self.rect.size());
        [
            f64::from(size.x) / (self.screen.width_m() * (right - left) / 2.0),
            f64::from(size.y) / (self.screen.height_m() * (top - bottom) / 2.0),
        ]
    }

    /// The screen's middle, which may lie beside the part that is shown.
    fn middle(&self) -> Pos2 {
        let ([left, right, bottom, top], Rect { min, .. }) = (self.on_screen, self.rect);
        let size = self.rect.size();
        min + vec2((-left / (right - left)) as f32 * size.x, (top / (top - bottom)) as f32 * size.y)
    }

    /// Side of a cell of the grid, m.
    fn cell_m(&self) -> f64 {
        let [x, y] = self.pixels_per_m();
        let shorter = self.screen.width_m().min(self.screen.height_m());
        step(|step| step * MOST_CELLS >= shorter && step * x.min(y) >= TICK_PIXELS)
    }

    /// Distance of two ticks of the rulers, m.
    fn tick_m(&self) -> f64 {
        let [x, y] = self.pixels_per_m();
        step(|step| step * x.min(y) >= TICK_PIXELS)
    }

    /// The columns (axis 0) or rows (axis 1) at whole multiples of `step_m` from the middle, with the multiple.
    fn marks(&self, axis: usize, step_m: f64) -> Vec<(i32, f32)> {
        let step = step_m * self.pixels_per_m()[axis];
        let middle = f64::from(self.middle()[axis]);
        let multiple = |edge: f32| ((f64::from(edge) - middle) / step).clamp(-1e4, 1e4);
        let range =
            multiple(self.rect.min[axis]).ceil() as i32..=multiple(self.rect.max[axis]).floor() as i32;
        range.map(|k| (k, (middle + f64::from(k) * step).round() as f32)).collect()
    }

    /// A line of `width` pixels whose middle lies on the edge between two pixels before `at`, or right of it.
    fn line(&self, mesh: &mut Mesh, axis: usize, at: f32, width: f32, color: Color32) {
        let (from, to) = (self.rect.min, self.rect.max);
        let start = at - (width / 2.0).floor();
        let line = match axis {
            0 => Rect::from_min_max(pos2(start, from.y), pos2(start + width, to.y)),
            _ => Rect::from_min_max(pos2(from.x, start), pos2(to.x, start + width)),
        };
        mesh.add_colored_rect(line.intersect(self.rect), color);
    }

    fn grid(&self, mesh: &mut Mesh) {
        for (every_fifth, color) in [(false, FAINT), (true, STRONG)] {
            for axis in [0, 1] {
                let marks = self.marks(axis, self.cell_m());
                for (_, at) in marks.into_iter().filter(|(k, _)| (k % 5 == 0) == every_fifth) {
                    self.line(mesh, axis, at, 1.0, color);
                }
            }
        }
        for axis in [0, 1] {
            self.line(mesh, axis, self.middle()[axis].round(), 2.0, INK);
        }
    }

    /// Ticks along the two middle lines.
    fn rulers(&self, mesh: &mut Mesh) {
        let center = self.middle().round();
        for axis in [0, 1] {
            for (k, at) in self.marks(axis, self.tick_m()) {
                let half = (self.unit()
                    * if k % 10 == 0 {
                        1.5
                    } else if k % 5 == 0 {
                        1.0
                    } else {
                        0.55
                    })
                .round();
                let tick = match axis {
                    0 => Rect::from_min_max(pos2(at, center.y - half), pos2(at + 1.0, center.y + half)),
                    _ => Rect::from_min_max(pos2(center.x - half, at), pos2(center.x + half, at + 1.0)),
                };
                mesh.add_colored_rect(tick.intersect(self.rect), INK);
            }
        }
    }

    /// One pixel, white, at the very edge.
    fn border(&self, mesh: &mut Mesh) {
        let Rect { min, max } = self.rect;
        for side in [
            Rect::from_min_max(min, pos2(max.x, min.y + 1.0)),
            Rect::from_min_max(pos2(min.x, max.y - 1.0), max),
            Rect::from_min_max(min, pos2(min.x + 1.0, max.y)),
            Rect::from_min_max(pos2(max.x - 1.0, min.y), max),
        ] {
            mesh.add_colored_rect(side, Color32::WHITE);
        }
    }

    /// Radius of the circle: the most cells that fit, m.
    fn radius_m(&self) -> f64 {
        let shorter = self.screen.width_m().min(self.screen.height_m());
        let cell = self.cell_m();
        cell * (0.46 * shorter / cell).floor().max(1.0)
    }

    fn circle(&self) {
        let [x, y] = self.pixels_per_m();
        let radius = self.radius_m();
        let radii = vec2((x * radius) as f32, (y * radius) as f32);
        let stroke = Stroke::new((0.18 * self.unit()).max(1.0), INK);
        let at = |k: u16| egui::Vec2::angled(TAU * f32::from(k) / f32::from(CIRCLE)) * radii;
        let points = (0..CIRCLE).map(|k| self.middle() + at(k)).collect();
        self.painter.add(Shape::closed_line(points, stroke));
    }

    fn ruler_labels(&self) {
        let unit = self.unit();
        let center = self.middle();
        let size = 1.5 * unit;
        for axis in [0, 1] {
            let marks = self.marks(axis, self.cell_m());
            let width = 4.0 * size;
            let every = marks.get(1).map_or(1, |next| (width / (next.1 - marks[0].1)).ceil().max(1.0) as i32);
            let inside = self.rect.shrink(1.2 * size);
            for (k, at) in marks.into_iter().filter(|(k, _)| *k != 0 && k % every == 0) {
                let text = format!("{}", ((self.cell_m() * f64::from(k) * 1e3).round() / 10.0).abs());
                let (place, align) = match axis {
                    0 => (pos2(at, center.y + 1.8 * unit), Align2::CENTER_TOP),
                    _ => (pos2(center.x + 1.9 * unit, at), Align2::LEFT_CENTER),
                };
                if inside.contains(place) {
                    self.write(place, align, &text, size, QUIET);
                }
            }
        }
    }

    fn title(&self) {
        let unit = self.unit();
        let Screen { name, .. } = self.screen;
        // The ruler's labels stay free between the name and what is told of it.
        let top = pos2(self.rect.center().x, self.rect.min.y + 7.0 * unit);
        self.write(top - vec2(3.0 * unit, 0.0), Align2::RIGHT_TOP, name, 6.0 * unit, INK);
        let lines = self.told();
        let place = top + vec2(7.0 * unit, 0.0);
        let told =
            wrapped(self.painter, &lines.join("\n"), 1.6 * unit, QUIET, self.rect.max.x - place.x - unit);
        let plate = Rect::from_min_size(place, told.size()).expand2(vec2(0.64, 0.16) * unit);
        self.painter.rect_filled(plate, 0.0, DARK);
        self.painter.galley(place.round(), told, QUIET);
    }

    /// Sizes of the visible part, as a tape measures them: a tile may show a part of the screen, and hide some at its edges.
    fn told(&self) -> Vec<String> {
        let (size, density) = (self.rect.size(), self.pixels_per_m());
        let [x, y] = density.map(|density| 1e3 / density);
        let [width_m, height_m] = [0, 1].map(|axis| f64::from(size[axis]) / density[axis]);
        let mut lines = vec![format!("{}   {width_m:.3} × {height_m:.3} m", self.stage)];
        if self.on_screen != [-1.0, 1.0, -1.0, 1.0] {
            let [whole_x, whole_y] = [self.screen.width_m(), self.screen.height_m()];
            lines.push(format!("shown of {whole_x:.3} × {whole_y:.3} m"));
        }
        lines.extend([
            format!("both diagonals {:.3} m", width_m.hypot(height_m)),
            format!("{} × {} pixels", size.x, size.y),
            format!("of {x:.3} × {y:.3} mm",),
            format!("grid {}, ticks {}", length(self.cell_m()), length(self.tick_m())),
            format!("circle {} across, rulers in cm", length(2.0 * self.radius_m())),
        ]);
        lines
    }

    /// The corners of the visible part by their names, where the stage file has them in the room.
    fn corners(&self) {
        let unit = self.unit();
        let inside = self.rect.shrink(2.0 * unit);
        let [left, right, bottom, top] = self.on_screen;
        for (name, place, align) in [
            ("lower left", [left, bottom], Align2::LEFT_BOTTOM),
            ("lower right", [right, bottom], Align2::RIGHT_BOTTOM),
            ("upper left", [left, top], Align2::LEFT_TOP),
            ("upper right", [right, top], Align2::RIGHT_TOP),
        ] {
            let point = self.screen.point(place);
            let text = format!("{name}\n{:.3} {:.3} {:.3}", point.x, point.y, point.z);
            self.write(align.pos_in_rect(&inside), align, &text, 1.8 * unit, INK);
        }
    }

    /// Each eye's picture has a filled mark on its own side, in its own shape and colour, and the outline of the other's.
    fn eye_marks(&self) {
        let (unit, center) = (self.unit(), self.rect.center());
        let radius = 6.0 * unit;
        // Square and round on the screen, whose pixels may not be square.
        let [x, y] = self.pixels_per_m().map(|density| density as f32);
        let shape = vec2(x, y) / (x * y).sqrt();
        let sides = [(Eye::Left, -1.0, LEFT, "L", "left eye"), (Eye::Right, 1.0, RIGHT, "R", "right eye")];
        if self.eye == Eye::Centre {
            let place = center + vec2(-0.27 * self.rect.width(), -0.22 * self.rect.height());
            self.write(place, Align2::CENTER_CENTER, "one picture\nfor both eyes", 2.2 * unit, INK);
            return;
        }
        for (eye, side, color, letter, name) in sides {
            let place = center + vec2(side * 0.27 * self.rect.width(), -0.22 * self.rect.height());
            let own = eye == self.eye;
            let (fill, stroke) = match own {
                true => (color, Stroke::NONE),
                false => (DARK, Stroke::new((0.3 * unit).max(1.0), STRONG)),
            };
            self.painter.add(match eye {
                Eye::Left => {
                    let square = Rect::from_center_size(place, 2.0 * radius * shape);
                    Shape::Rect(egui::epaint::RectShape::new(
                        square,
                        0,
                        fill,
                        stroke,
                        egui::StrokeKind::Inside,
                    ))
                }
                _ => Shape::Ellipse(egui::epaint::EllipseShape {
                    center: place,
                    radius: 1.1 * radius * shape,
                    fill,
                    stroke,
                    angle: 0.0,
                }),
            });
            if own {
                let font = FontId::proportional(9.0 * unit);
                self.painter.text(place, Align2::CENTER_CENTER, letter, font, DARK);
                self.write(
                    place + vec2(0.0, 1.3 * radius * shape.y),
                    Align2::CENTER_TOP,
                    name,
                    3.0 * unit,
                    color,
                );
            }
        }
    }

    /// Alternating rows, columns and a checkerboard of single pixels, by their parity on the whole picture.
    fn parity_blocks(&self) {
        let unit = self.unit();
        let side = (5.0 * unit).floor().max(4.0) * 2.0;
        let center = self.rect.center();
        let top = (center.y + 0.19 * self.rect.height()).floor();
        let mut mesh = Mesh::default();
        let kinds: [(&str, IsWhite); 3] = [
            ("rows", |_, y| y % 2 == 0),
            ("columns", |x, _| x % 2 == 0),
            ("checkerboard", |x, y| (x + y) % 2 == 0),
        ];
        for (i, (name, is_white)) in kinds.into_iter().enumerate() {
            let middle = center.x - (0.39 - 0.12 * i as f32) * self.rect.width();
            let block = Rect::from_min_size(pos2((middle - side / 2.0).floor(), top), vec2(side, side));
            add_pixels(&mut mesh, block, self.rect.min, is_white);
            // In a small picture the names do not fit beside each other: the middle one stands a line lower.
            let letter = (1.8 * unit).max(7.0);
            let is_narrow = 0.12 * self.rect.width() < 6.5 * letter;
            let below = if is_narrow && i == 1 { unit + 1.3 * letter } else { unit };
            let place = block.center_bottom() + vec2(0.0, below);
            self.write(place, Align2::CENTER_TOP, name, 1.8 * unit, QUIET);
        }
        self.painter.add(Shape::mesh(mesh));
    }

    /// 17 steps from black to white, even in sRGB.
    fn grey_ramp(&self) {
        const STEPS: u8 = 17;
        let unit = self.unit();
        let width = (0.36 * self.rect.width() / f32::from(STEPS)).floor().max(1.0);
        let height = (10.0 * unit).floor().max(2.0);
        let start = self.rect.center() + vec2(0.09 * self.rect.width(), 0.19 * self.rect.height());
        let mut mesh = Mesh::default();
        for k in 0..STEPS {
            let at = start.round() + vec2(width * f32::from(k), 0.0);
            let grey = (u32::from(k) * 255 / u32::from(STEPS - 1)) as u8;
            mesh.add_colored_rect(Rect::from_min_size(at, vec2(width, height)), Color32::from_gray(grey));
        }
        self.painter.add(Shape::mesh(mesh));
        let below = start + vec2(width * f32::from(STEPS) / 2.0, height + unit);
        self.write(below, Align2::CENTER_TOP, "grey, 0 to 255 in steps of 16", 1.8 * unit, QUIET);
    }

    /// Text on a dark plate, so that no line of the grid runs through it.
    fn write(&self, place: Pos2, anchor: Align2, text: &str, size: f32, ink: Color32) {
        write(self.painter, (place, anchor), text, size, [ink, DARK]);
    }
}

/// The smallest step that is large enough, or the largest.
fn step(is_enough: impl Fn(f64) -> bool) -> f64 {
    STEPS.into_iter().find(|step| is_enough(*step)).unwrap_or(10.0)
}

fn length(m: f64) -> String {
    if m < 0.01 { format!("{} mm", (m * 1e3).round()) } else { format!("{} cm", (m * 1e2).round()) }
}

/// A block of white pixels where `is_white` says so of the pixel counted from `origin`, black elsewhere; runs of white
/// pixels in a row are one rectangle.
fn add_pixels(mesh: &mut Mesh, block: Rect, origin: Pos2, is_white: IsWhite) {
    mesh.add_colored_rect(block, Color32::BLACK);
    let [columns, rows] = [0, 1].map(|axis| {
        let start = (block.min[axis] - origin[axis]) as i32;
        start..start + block.size()[axis] as i32
    });
    for y in rows {
        let mut x = columns.start;
        while x < columns.end {
            let end = (x..columns.end).find(|x| !is_white(*x, y)).unwrap_or(columns.end);
            if end > x {
                let from = origin + vec2(x as f32, y as f32);
                mesh.add_colored_rect(Rect::from_min_size(from, vec2((end - x) as f32, 1.0)), Color32::WHITE);
            }
            x = end + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::Stage;

    /// A table of 1.7 m × 1.36 m whose tile hides 12 of 1024 rows is 1.344 m high where it is seen, 2.167 m from corner to
    /// corner: the pattern showed the whole screen's 2.177 m.
    #[test]
    fn the_sizes_are_those_that_a_tape_measures() {
        let mut screen = Stage::find("desktop").unwrap().screens.remove(0);
        let corner = screen.lower_left;
        screen.lower_right = corner + nalgebra::Vector3::x() * 1.7;
        screen.upper_left = corner + nalgebra::Vector3::y() * 1.36;
        let painter = egui::Context::default().layer_painter(egui::LayerId::background());
        let told = |on_screen: [f64; 4], height: f32| {
            let rect = Rect::from_min_size(Pos2::ZERO, vec2(1280.0, height));
            let screen = &screen;
            Pattern { painter: &painter, rect, on_screen, stage: "bench", screen, eye: Eye::Left }.told()
        };
        let whole = told([-1.0, 1.0, -1.0, 1.0], 1024.0);
        assert_eq!(whole[..2], ["bench   1.700 × 1.360 m", "both diagonals 2.177 m"]);
        let seen = told([-1.0, 1.0, -1.0 + 24.0 / 1024.0, 1.0], 1012.0);
        let expected = ["bench   1.700 × 1.344 m", "shown of 1.700 × 1.360 m", "both diagonals 2.167 m"];
        assert_eq!(seen[..3], expected);
    }
}
