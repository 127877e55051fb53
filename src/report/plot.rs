//! A work-precision plot as SVG: points on two axes, what nothing else beats drawn bold, and labels beside it.

use super::axis::Axis;
use super::labels::{Obstacles, Rect, Wish, place};
use super::markup::{escape, shortened, width};
use super::units::Unit;

pub const STYLE: &str = include_str!("plot.css");
pub const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 450.0;
const FONT: f64 = 12.0;
const LINE: f64 = 15.0;
const LONGEST_LABEL: usize = 60;

/// A finished drawing.
pub struct Picture {
    /// The stem of its file.
    pub name: &'static str,
    pub title: String,
    pub width: f64,
    pub height: f64,
    /// Elements inside `<svg>`.
    pub body: String,
}

impl Picture {
    /// A file of its own: follows the reader's light or dark scheme.
    pub fn file(&self) -> String {
        let style = format!("<style>\n{STYLE}</style>\n");
        format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}", self.element(&style))
    }

    /// To be put into a page that has the plots' own style.
    pub fn inline(&self) -> String {
        self.element("")
    }

    fn element(&self, style: &str) -> String {
        let (width, height, title) = (self.width, self.height, escape(&self.title));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"gs-plot\" role=\"img\" aria-label=\"{title}\" \
             viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">\n{style}\
             <rect class=\"gs-bg\" width=\"{width}\" height=\"{height}\" rx=\"6\"/>\n{}</svg>\n",
            self.body
        )
    }
}

pub struct Scale {
    pub label: String,
    pub unit: Unit,
    pub logarithmic: bool,
}

pub struct Point {
    pub x: f64,
    pub y: f64,
    /// The end of a thin line upward from `y`.
    pub worst: Option<f64>,
    /// Index into the plot's series: colour and shape.
    pub series: usize,
    /// Not beaten by another: filled.
    pub strong: bool,
    pub label: Option<String>,
    /// Shown by a browser under the pointer.
    pub tip: String,
}

/// Slope `rate` from `x[0]` to `x[1]`, ending at `y` on the right: y ∝ x^rate.
pub struct Triangle {
    pub x: [f64; 2],
    pub y: f64,
    pub rate: f64,
}

pub struct Plot {
    pub name: &'static str,
    pub title: String,
    /// What all points share, or how to read it; one line.
    pub note: String,
    pub x: Scale,
    pub y: Scale,
    pub series: Vec<String>,
    pub points: Vec<Point>,
    /// Thin lines through points, in their colour where they share one.
    pub lines: Vec<Vec<usize>>,
    /// Bold steps through these points, by ascending x.
    pub front: Vec<usize>,
    pub triangles: Vec<Triangle>,
}

/// The same shape for the same series in every plot.
pub fn marker(series: usize, [x, y]: [f64; 2], r: f64) -> String {
    let polygon = |points: &[[f64; 2]]| {
        let corners = points.iter().enumerate().map(|(i, [dx, dy])| {
            format!("{}{:.1} {:.1}", if i == 0 { 'M' } else { 'L' }, x + r * dx, y + r * dy)
        });
        format!("<path d=\"{}Z\"/>", corners.collect::<String>())
    };
    match series % 7 {
        0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\"/>", 0.95 * r),
        1 => polygon(&[[-0.85, -0.85], [0.85, -0.85], [0.85, 0.85], [-0.85, 0.85]]),
        2 => polygon(&[[0.0, -1.15], [1.05, 0.75], [-1.05, 0.75]]),
        3 => polygon(&[[0.0, -1.25], [1.1, 0.0], [0.0, 1.25], [-1.1, 0.0]]),
        4 => polygon(&[[0.0, 1.15], [1.05, -0.75], [-1.05, -0.75]]),
        5 => polygon(&[[0.55, -1.0], [1.1, 0.0], [0.55, 1.0], [-0.55, 1.0], [-1.1, 0.0], [-0.55, -1.0]]),
        _ => polygon(&[
            [-0.38, -1.1],
            [0.38, -1.1],
            [0.38, -0.38],
            [1.1, -0.38],
            [1.1, 0.38],
            [0.38, 0.38],
            [0.38, 1.1],
            [-0.38, 1.1],
            [-0.38, 0.38],
            [-1.1, 0.38],
            [-1.1, -0.38],
            [-0.38, -0.38],
        ]),
    }
}

pub fn text(at: [f64; 2], anchor: &str, class: &str, words: &str) -> String {
    let [x, y] = at;
    format!(
        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>\n",
        escape(words)
    )
}

pub fn line(class: &str, [a, b]: [[f64; 2]; 2]) -> String {
    let ([ax, ay], [bx, by]) = (a, b);
    format!("<path class=\"{class}\" d=\"M{ax:.1} {ay:.1}L{bx:.1} {by:.1}\"/>\n")
}

/// A row of markers and names below `top`, wrapped at `right`; and the height that it takes.
pub fn legend(names: &[String], left: f64, right: f64, top: f64) -> (String, f64) {
    let (mut x, mut y, mut drawn) = (left, top + 11.0, String::new());
    for (i, name) in names.iter().enumerate() {
        let name = shortened(name, LONGEST_LABEL);
        let wide = 20.0 + width(&name, FONT);
        if x > left && x + wide > right {
            (x, y) = (left, y + 17.0);
        }
        drawn += &format!("<g class=\"gs-f{}\">{}</g>", i % 7, marker(i, [x + 6.0, y - 4.0], 5.0));
        drawn += &text([x + 16.0, y], "start", "gs-text", &name);
        x += wide + 14.0;
    }
    (drawn, if names.is_empty() { 0.0 } else { y - top + 8.0 })
}

/// Grid lines and numbers of an axis; `across` are the ends of its grid lines.
pub fn ticks(axis: &Axis, vertical: bool, across: [f64; 2]) -> String {
    let mut drawn = String::new();
    let mut mark = |at: f64, class: &str, label: &str| {
        if vertical {
            drawn += &line(class, [[across[0], at], [across[1], at]]);
            drawn += &text([across[0] - 7.0, at + 4.0], "end", "gs-text", label);
        } else {
            drawn += &line(class, [[at, across[0]], [at, across[1]]]);
            drawn += &text([at, across[0] + 17.0], "middle", "gs-text", label);
        }
    };
    let room = |label: &str| if vertical { FONT } else { width(label, FONT) + 4.0 };
    let mut last: Option<(f64, f64)> = None;
    if let Some(zero) = axis.zero {
        let label = if axis.floor > 0.0 { format!("< {}", axis.unit.text(axis.floor)) } else { "0".into() };
        mark(zero, "gs-goal", &label);
        last = Some((zero, 0.5 * room(&label)));
    }
    for tick in axis.ticks() {
        let at = axis.at(tick.value);
        let half = 0.5 * room(&tick.label);
        let free = last.is_none_or(|(before, taken)| (at - before).abs() >= taken + half);
        mark(at, "gs-grid", if free { &tick.label } else { "" });
        if free && !tick.label.is_empty() {
            last = Some((at, half));
        }
    }
    drawn
}

impl Plot {
    pub fn picture(&self) -> Picture {
        let (left, right) = (76.0, WIDTH - 40.0);
        let mut body = text([16.0, 26.0], "start", "gs-title", &self.title);
        let mut top = 36.0;
        if !self.note.is_empty() {
            body += &text([16.0, top + 9.0], "start", "gs-muted", &shortened(&self.note, 118));
            top += 19.0;
        }
        let (key, used) = legend(&self.series, 16.0, right, top);
        body += &key;
        let area = Rect { x: left, y: top + used + 8.0, width: right - left, height: HEIGHT - 56.0 - 84.0 };
        let bottom = area.y + area.height;
        let (x, y) = self.axes(area);
        body += &ticks(&x, false, [bottom, area.y]);
        body += &ticks(&y, true, [left, right]);
        body += &goal(&y, area);
        body += &format!(
            "<rect class=\"gs-frame\" x=\"{left}\" y=\"{:.1}\" width=\"{}\" height=\"{}\"/>\n",
            area.y, area.width, area.height
        );
        body += &text([0.5 * (left + right), bottom + 38.0], "middle", "gs-text", &self.x.label);
        let middle = area.y + 0.5 * area.height;
        body += &format!(
            "<text class=\"gs-text\" transform=\"translate(18 {middle:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
            escape(&self.y.label)
        );
        let at: Vec<[f64; 2]> = self.points.iter().map(|p| [x.at(p.x), y.at(p.y)]).collect();
        let (steps, mut lines) = self.steps(&at, area);
        body += &self.marks(&at, &y, &steps);
        body += &self.slopes(&x, &y, &mut lines);
        body += &self.labels(&at, lines, area);
        Picture { name: self.name, title: self.title.clone(), width: WIDTH, height: bottom + 50.0, body }
    }

    fn axes(&self, area: Rect) -> (Axis, Axis) {
        let rise = |t: &Triangle| t.y * (t.x[0] / t.x[1]).powf(t.rate);
        let corners = |t: &Triangle| [(t.x[0], rise(t)), (t.x[1], t.y)];
        let xs = self.points.iter().map(|p| p.x).chain(self.triangles.iter().flat_map(|t| t.x));
        let ys = self.points.iter().flat_map(|p| [Some(p.y), p.worst.filter(|_| p.strong)]).flatten();
        let ys = ys.chain(self.triangles.iter().flat_map(corners).map(|(_, y)| y));
        let (xs, ys): (Vec<f64>, Vec<f64>) = (xs.collect(), ys.collect());
        let bottom = area.y + area.height;
        (
            Axis::new(&xs, self.x.unit, self.x.logarithmic, area.x, area.x + area.width),
            Axis::new(&ys, self.y.unit, self.y.logarithmic, bottom, area.y),
        )
    }

    /// The bold steps: to the right at the same error, then down. With the lines that labels should avoid.
    fn steps(&self, at: &[[f64; 2]], area: Rect) -> (String, Vec<[[f64; 2]; 2]>) {
        let mut lines: Vec<[[f64; 2]; 2]> = Vec::new();
        for of in &self.lines {
            lines.extend(of.windows(2).map(|pair| [at[pair[0]], at[pair[1]]]));
        }
        let Some(&first) = self.front.first() else {
            return (String::new(), lines);
        };
        let mut path = vec![at[first]];
        for &i in &self.front[1..] {
            let before = path[path.len() - 1];
            path.extend([[at[i][0], before[1]], at[i]]);
        }
        path.push([area.x + area.width, path[path.len() - 1][1]]);
        lines.extend(path.windows(2).map(|pair| [pair[0], pair[1]]));
        let corners: Vec<String> = path.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
        (format!("<path class=\"gs-front\" d=\"M{}\"/>\n", corners.join("L")), lines)
    }

    fn marks(&self, at: &[[f64; 2]], y: &Axis, steps: &str) -> String {
        let mut drawn = String::new();
        for of in self.lines.iter().filter(|of| of.len() > 1) {
            let corners: Vec<String> =
                of.iter().map(|&i| format!("{:.1} {:.1}", at[i][0], at[i][1])).collect();
            let series = self.points[of[0]].series;
            let one = of.iter().all(|&i| self.points[i].series == series);
            let class = if one { format!("gs-thin gs-s{}", series % 7) } else { "gs-leader".into() };
            drawn += &format!("<path class=\"{class}\" d=\"M{}\"/>\n", corners.join("L"));
        }
        let draw = |(i, point): (usize, &Point)| {
            let colour = point.series % 7;
            let (class, size) = if point.strong {
                (format!("gs-strong gs-f{colour}"), 5.5)
            } else {
                (format!("gs-pale gs-s{colour}"), 4.2)
            };
            let mut shape = marker(point.series, at[i], size);
            if point.y == 0.0 && self.y.logarithmic {
                let [px, py] = at[i];
                shape += &format!(
                    "<path class=\"gs-s{colour}\" fill=\"none\" d=\"M{px:.1} {:.1}v7m-3 -3l3 3l3 -3\"/>",
                    py + 4.5
                );
            }
            let title = escape(&point.tip);
            format!("<g class=\"{class}\"><title>{title}</title>{shape}</g>\n")
        };
        let strong = |(_, point): &(usize, &Point)| point.strong;
        drawn.extend(self.points.iter().enumerate().filter(|p| !strong(p)).map(draw));
        drawn += steps;
        for (i, point) in self.points.iter().enumerate().filter(strong) {
            if let Some(worst) = point.worst.filter(|&worst| worst > point.y) {
                let class = format!("gs-whisker gs-s{}", point.series % 7);
                let [px, top] = [at[i][0], y.at(worst)];
                drawn += &line(&class, [at[i], [px, top]]);
                drawn += &line(&class, [[px - 3.0, top], [px + 3.0, top]]);
            }
        }
        drawn.extend(self.points.iter().enumerate().filter(strong).map(draw));
        drawn
    }

    fn slopes(&self, x: &Axis, y: &Axis, lines: &mut Vec<[[f64; 2]; 2]>) -> String {
        let mut drawn = String::new();
        for triangle in &self.triangles {
            let [a, b] = triangle.x.map(|h| x.at(h));
            let right = y.at(triangle.y);
            let left = y.at(triangle.y * (triangle.x[0] / triangle.x[1]).powf(triangle.rate));
            drawn +=
                &format!("<path class=\"gs-slope\" d=\"M{a:.1} {left:.1}L{b:.1} {right:.1}V{left:.1}Z\"/>\n");
            lines.extend([[[a, left], [b, right]], [[b, right], [b, left]], [[a, left], [b, left]]]);
            let rate = super::units::digits(triangle.rate, 2);
            drawn += &text([b + 5.0, 0.5 * (left + right) + 4.0], "start", "gs-muted", &rate);
            drawn += &text([0.5 * (a + b), left + 13.0], "middle", "gs-muted", "1");
        }
        drawn
    }

    fn labels(&self, at: &[[f64; 2]], lines: Vec<[[f64; 2]; 2]>, area: Rect) -> String {
        let labelled = self.points.iter().zip(at).filter_map(|(p, at)| Some((p.label.as_deref()?, *at)));
        let labelled = together(labelled);
        let wishes: Vec<Wish> = labelled
            .iter()
            .map(|(label, at)| Wish { at: *at, width: width(label, FONT), height: LINE })
            .collect();
        let inside =
            Rect { x: area.x + 3.0, y: area.y + 3.0, width: area.width - 6.0, height: area.height - 6.0 };
        let placed = place(&wishes, &Obstacles { points: at.to_vec(), lines }, inside);
        let mut leaders = String::new();
        let mut words = String::new();
        for ((label, at), rect) in labelled.iter().zip(placed) {
            let Some(rect) = rect else {
                continue;
            };
            let end = rect.nearest(*at);
            if (end[0] - at[0]).hypot(end[1] - at[1]) > 15.0 {
                leaders += &line("gs-leader", [*at, end]);
            }
            // Beside its point a label begins or ends there, whatever width the reader's font gives it.
            let (x, anchor) = match at[0] {
                x if x <= rect.x => (rect.x, "start"),
                x if x >= rect.x + rect.width => (rect.x + rect.width, "end"),
                _ => (rect.x + 0.5 * rect.width, "middle"),
            };
            words += &text([x, rect.y + 11.5], anchor, "gs-text gs-halo", label);
        }
        leaders + &words
    }
}

/// Labels of points that cover each other become one.
fn together<'a>(labels: impl Iterator<Item = (&'a str, [f64; 2])>) -> Vec<(String, [f64; 2])> {
    let mut joined: Vec<(String, [f64; 2])> = Vec::new();
    for (label, at) in labels {
        let near = |other: &&mut (String, [f64; 2])| (other.1[0] - at[0]).hypot(other.1[1] - at[1]) < 2.0;
        match joined.iter_mut().find(near) {
            Some((words, _)) => *words = format!("{words}; {label}"),
            None => joined.push((label.to_owned(), at)),
        }
    }
    joined.into_iter().map(|(words, at)| (shortened(&words, LONGEST_LABEL), at)).collect()
}

/// Where an axis of errors passes one per cent.
fn goal(y: &Axis, area: Rect) -> String {
    let one = 1e-2;
    if y.unit != Unit::Ratio || !y.logarithmic || !(y.low..=y.high).contains(&one) {
        return String::new();
    }
    let (at, right) = (y.at(one), area.x + area.width);
    line("gs-goal", [[area.x, at], [right, at]]) + &text([right + 6.0, at + 4.0], "start", "gs-muted", "1 %")
}
