//! Paints curves over two axes with ticks, units and SI prefixes, a band about them, and a point where they are now.

use super::caption::{INK, QUIET, RULE};
use crate::base::plates::{Axis, Plot};
use crate::base::quantity::{power_of, prefix};
use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rect, Shape, Stroke, Vec2, pos2, vec2};

const CURVE: Color32 = Color32::from_rgb(97, 175, 239);
const NOW: Color32 = Color32::from_rgb(170, 214, 84);

/// Size of a plot with its axes where `room` is free.
pub(super) fn size(letter: f32, room: Vec2) -> Vec2 {
    vec2((25.0 * letter).min(0.42 * room.x), (12.5 * letter).min(0.4 * room.y))
}

/// An axis over a range of values that holds 0, with its ticks.
struct Scale {
    low: f64,
    high: f64,
    step: f64,
    /// The unit of the values.
    unit: f64,
    title: String,
}

impl Scale {
    fn new(axis: Axis, values: impl Iterator<Item = f64>) -> Scale {
        let finite = values.filter(|value| value.is_finite());
        let (low, high) =
            finite.fold((0.0_f64, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
        let high = if high - low > 0.0 { high } else { low + 1.0 };
        let step = nice_step((high - low) / 4.0);
        let (low, high) = ((low / step).floor() * step, (high / step).ceil() * step);
        let power = if axis.unit == "°" { 0 } else { power_of(low.abs().max(high.abs())) };
        let title = format!("{} ({}{})", axis.name, prefix(power), axis.unit);
        Scale { low, high, step, unit: 1000f64.powi(power), title }
    }

    fn share(&self, value: f64) -> f32 {
        ((value - self.low) / (self.high - self.low)) as f32
    }

    fn ticks(&self) -> impl Iterator<Item = (f64, String)> + '_ {
        let count = ((self.high - self.low) / self.step).round() as usize;
        let decimals = (-(self.step / self.unit).log10()).ceil().clamp(0.0, 6.0) as usize;
        (0..=count).map(move |k| {
            let value = self.low + k as f64 * self.step;
            let told = value / self.unit;
            // A zero has no minus sign.
            let told = if told.abs() < 1e-9 * (self.high - self.low) / self.unit { 0.0 } else { told };
            (value, format!("{told:.decimals$}"))
        })
    }
}

/// 1, 2 or 5 times a power of ten, at least this much.
fn nice_step(least: f64) -> f64 {
    let ten = 10f64.powf(least.log10().floor());
    let nice = [1.0, 2.0, 5.0, 10.0].into_iter().find(|nice| nice * ten >= least * (1.0 - 1e-9));
    nice.unwrap_or(10.0) * ten
}

/// Paints `plot` into `rect`.
pub(super) fn paint(painter: &Painter, rect: Rect, letter: f32, plot: &Plot) {
    let small = FontId::monospace((0.8 * letter).max(7.0));
    let points = || plot.curves.iter().flatten().copied().chain(plot.now);
    let bands = || plot.band.iter().flatten();
    let x = Scale::new(plot.x, points().map(|[x, _]| x));
    let bounds = bands().flat_map(|[_, low, high]| [*low, *high]);
    let y = Scale::new(plot.y, points().map(|[_, y]| y).chain(bounds));
    let inner = Rect::from_min_max(
        rect.min + vec2(4.2 * letter, 1.6 * letter),
        rect.max - vec2(1.4 * letter, 2.6 * letter),
    );
    let at = |[a, b]: [f64; 2]| -> Pos2 {
        pos2(inner.min.x + x.share(a) * inner.width(), inner.max.y - y.share(b) * inner.height())
    };
    for (value, text) in x.ticks() {
        let foot = at([value, y.low]);
        painter.line_segment([foot, pos2(foot.x, inner.min.y)], Stroke::new(1.0, RULE));
        painter.text(foot + vec2(0.0, 0.2 * letter), Align2::CENTER_TOP, text, small.clone(), QUIET);
    }
    for (value, text) in y.ticks() {
        let foot = at([x.low, value]);
        painter.line_segment([foot, pos2(inner.max.x, foot.y)], Stroke::new(1.0, RULE));
        painter.text(foot - vec2(0.3 * letter, 0.0), Align2::RIGHT_CENTER, text, small.clone(), QUIET);
    }
    let below = pos2(inner.center().x, rect.max.y - 0.3 * letter);
    painter.text(below, Align2::CENTER_BOTTOM, &x.title, small.clone(), INK);
    painter.text(rect.min + vec2(0.6 * letter, 0.1 * letter), Align2::LEFT_TOP, &y.title, small, INK);
    let mut shade = Mesh::default();
    for two in plot.band.iter().flat_map(|band| band.windows(2)) {
        let [[xa, la, ha], [xb, lb, hb]] = [two[0], two[1]];
        let first = shade.vertices.len() as u32;
        for place in [[xa, la], [xa, ha], [xb, lb], [xb, hb]] {
            shade.colored_vertex(at(place), CURVE.gamma_multiply(0.28));
        }
        shade.add_triangle(first, first + 1, first + 2);
        shade.add_triangle(first + 2, first + 1, first + 3);
    }
    painter.add(Shape::mesh(shade));
    let zero = Stroke::new(1.0, QUIET);
    painter.line_segment([at([x.low, 0.0]), at([x.high, 0.0])], zero);
    painter.line_segment([at([0.0, y.low]), at([0.0, y.high])], zero);
    for curve in &plot.curves {
        let line: Vec<Pos2> = curve.iter().map(|place| at(*place)).collect();
        painter.add(Shape::line(line, Stroke::new((0.14 * letter).max(1.5), CURVE)));
    }
    if let Some(now) = plot.now {
        painter.circle_filled(at(now), (0.3 * letter).max(2.5), NOW);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_hold_zero() {
        let of = |unit, values: &[f64]| {
            let scale = Scale::new(Axis { name: "force", unit }, values.iter().copied());
            (scale.ticks().map(|(_, text)| text).collect::<Vec<_>>().join(" "), scale.title)
        };
        for (unit, values, ticks, title) in [
            ("N", &[1300.0, 250.0][..], "0.0 0.5 1.0 1.5", "force (kN)"),
            ("m", &[-0.012, 0.03], "-20 0 20 40", "force (mm)"),
            ("N", &[-2500.0, -90.0], "-3 -2 -1 0", "force (kN)"),
            ("°", &[0.0, 57.0], "0 20 40 60", "force (°)"),
            ("N", &[], "0.0 0.5 1.0", "force (N)"),
            ("N", &[f64::NAN, 3.0e-4], "0 100 200 300", "force (µN)"),
        ] {
            assert_eq!(of(unit, values), (ticks.to_owned(), title.to_owned()), "{values:?}");
        }
    }

    #[test]
    fn steps_are_one_two_or_five() {
        for (least, step) in [(0.25, 0.5), (0.2, 0.2), (1.1, 2.0), (6.0, 10.0), (3.0e-5, 5.0e-5)] {
            assert!((nice_step(least) / step - 1.0).abs() < 1e-9, "{least}: {}", nice_step(least));
        }
    }
}
