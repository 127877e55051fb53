//! A plot of points on two axes as SVG: points that nothing else beats are bold, with labels beside them.

use super::axis::Axis;
use super::canvas::{
    Canvas, FONT, LONGEST_LABEL, MARGIN, Picture, WIDTH, colour, escape, marker, shortened, width,
};
use super::labels::{Label, Obstacles, Rect, place};
use crate::measure::units::{Unit, digits};
use crate::report::pareto::CostMetric;

const LEFT: f64 = 76.0;
/// Height between the axes.
const HEIGHT: f64 = 310.0;
const LINE: f64 = 15.0;

#[derive(Default)]
pub struct Scale {
    pub label: String,
    pub unit: Unit,
    pub logarithmic: bool,
}

impl Scale {
    /// A logarithmic axis of errors.
    pub fn ratio(label: &str) -> Scale {
        Scale { label: label.to_owned(), unit: Unit::Ratio, logarithmic: true }
    }

    /// A logarithmic axis of costs.
    pub fn cost(metric: &CostMetric) -> Scale {
        Scale { label: metric.name.to_owned(), unit: metric.unit, logarithmic: true }
    }
}

#[derive(Default)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    /// The end of a thin line upward from `y`.
    pub worst: Option<f64>,
    /// Index into the plot's series: colour and shape.
    pub series: usize,
    /// Points of the same number are joined by a thin line, in their order.
    pub line: Option<usize>,
    /// Whether no other point beats it: then it is filled.
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

impl Triangle {
    pub fn left(&self) -> f64 {
        self.y * (self.x[0] / self.x[1]).powf(self.rate)
    }
}

#[derive(Default)]
pub struct Plot {
    pub title: &'static str,
    /// The property that all points share, or how to read the plot; one line.
    pub note: String,
    pub x: Scale,
    pub y: Scale,
    pub series: Vec<String>,
    pub points: Vec<Point>,
    /// Bold steps through these points, by ascending x.
    pub front: Vec<usize>,
    pub triangles: Vec<Triangle>,
}

/// Errors below this are rounding.
const NOTHING: f64 = 1e-12;
/// Values within this ratio are one value.
const SAME: f64 = 1.02;

impl Plot {
    /// The picture, or the reason why it would show nothing; empty where there are no points.
    pub fn picture(&self) -> Result<Picture, String> {
        let same = |of: fn(&Point) -> f64| {
            let values = || self.points.iter().map(of);
            let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max));
            high <= SAME * low || high <= 0.0
        };
        let why = match &self.points[..] {
            [] => "",
            [_] => "there is only one point",
            points if self.y.unit == Unit::Ratio && points.iter().all(|point| point.y < NOTHING) => {
                "all its errors are below 10⁻¹²"
            }
            _ if same(|point| point.x) && same(|point| point.y) => "all its points are in one place",
            _ => return Ok(self.drawn()),
        };
        Err(why.to_owned())
    }

    fn drawn(&self) -> Picture {
        let (mut canvas, top) = Canvas::new(self.title, &self.note, &self.series);
        let area = Rect { x: LEFT, y: top, width: WIDTH - MARGIN - LEFT, height: HEIGHT };
        let [right, bottom] = [area.x + area.width, area.y + area.height];
        let (x, y) = self.axes(area);
        canvas.ticks(&x, false, [bottom, area.y]);
        canvas.ticks(&y, true, [LEFT, right]);
        let goal = 1e-2;
        if y.unit == Unit::Ratio && y.logarithmic && (y.low..=y.high).contains(&goal) {
            canvas.path("gs-goal", &[[LEFT, y.at(goal)], [right, y.at(goal)]]);
            canvas.text([right + 6.0, y.at(goal) + 4.0], "start", "gs-muted", "1 %");
        }
        canvas.body += &format!(
            "<rect class=\"gs-frame\" x=\"{LEFT}\" y=\"{:.1}\" width=\"{}\" height=\"{HEIGHT}\"/>\n",
            area.y, area.width
        );
        canvas.text([0.5 * (LEFT + right), bottom + 38.0], "middle", "gs-text", &self.x.label);
        canvas.body += &format!(
            "<text class=\"gs-text\" transform=\"translate(18 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n",
            0.5 * (area.y + bottom),
            escape(&self.y.label)
        );
        let at: Vec<[f64; 2]> = self.points.iter().map(|p| [x.at(p.x), y.at(p.y)]).collect();
        let mut obstacles = self.thin_lines(&mut canvas, &at);
        self.marks(&mut canvas, &at, false);
        let steps = self.steps(&at, right);
        if !steps.is_empty() {
            canvas.path("gs-front", &steps);
        }
        self.whiskers(&mut canvas, &at, &y);
        self.marks(&mut canvas, &at, true);
        obstacles.extend(segments(&steps));
        obstacles.extend(self.slopes(&mut canvas, &x, &y));
        self.labels(&mut canvas, Obstacles { points: at, lines: obstacles }, area);
        canvas.picture(bottom + 50.0)
    }

    fn axes(&self, area: Rect) -> (Axis, Axis) {
        let xs = self.points.iter().map(|p| p.x).chain(self.triangles.iter().flat_map(|t| t.x));
        let ys = self.points.iter().flat_map(|p| [Some(p.y), p.worst.filter(|_| p.strong)]).flatten();
        let ys = ys.chain(self.triangles.iter().flat_map(|t| [t.left(), t.y]));
        let (xs, ys): (Vec<f64>, Vec<f64>) = (xs.collect(), ys.collect());
        (
            Axis::new(&xs, self.x.unit, self.x.logarithmic, area.x, area.x + area.width),
            Axis::new(&ys, self.y.unit, self.y.logarithmic, area.y + area.height, area.y),
        )
    }

    /// Draws the thin lines, in the colour of their points where they share one.
    fn thin_lines(&self, canvas: &mut Canvas, at: &[[f64; 2]]) -> Vec<[[f64; 2]; 2]> {
        let count = self.points.iter().filter_map(|p| p.line).max().map_or(0, |last| last + 1);
        let mut drawn = Vec::new();
        for line in 0..count {
            let of: Vec<usize> = (0..at.len()).filter(|&i| self.points[i].line == Some(line)).collect();
            if of.len() < 2 {
                continue;
            }
            let series = self.points[of[0]].series;
            let is_one = of.iter().all(|&i| self.points[i].series == series);
            let class = if is_one { format!("gs-thin gs-s{}", colour(series)) } else { "gs-leader".into() };
            let corners: Vec<[f64; 2]> = of.iter().map(|&i| at[i]).collect();
            canvas.path(&class, &corners);
            drawn.extend(segments(&corners));
        }
        drawn
    }

    /// The corners of the bold steps: to the right at the same error, then down.
    fn steps(&self, at: &[[f64; 2]], right: f64) -> Vec<[f64; 2]> {
        let mut corners: Vec<[f64; 2]> = Vec::new();
        for &i in &self.front {
            if let Some(&[_, before]) = corners.last() {
                corners.push([at[i][0], before]);
            }
            corners.push(at[i]);
        }
        if let Some(&[_, last]) = corners.last() {
            corners.push([right, last]);
        }
        corners
    }

    fn marks(&self, canvas: &mut Canvas, at: &[[f64; 2]], strong: bool) {
        for (point, &[x, y]) in self.points.iter().zip(at).filter(|(point, _)| point.strong == strong) {
            let colour = colour(point.series);
            let (class, size) = if strong { ("gs-strong gs-f", 5.5) } else { ("gs-pale gs-s", 4.2) };
            let mut shape = marker(point.series, [x, y], size);
            // An arrow downwards: zero is below every logarithmic axis.
            if point.y == 0.0 && self.y.logarithmic {
                let from = y + 4.5;
                shape += &format!(
                    "<path class=\"gs-s{colour}\" fill=\"none\" d=\"M{x:.1} {from:.1}v7m-3 -3l3 3l3 -3\"/>"
                );
            }
            let tip = escape(&point.tip);
            canvas.body += &format!("<g class=\"{class}{colour}\"><title>{tip}</title>{shape}</g>\n");
        }
    }

    fn whiskers(&self, canvas: &mut Canvas, at: &[[f64; 2]], axis: &Axis) {
        for (point, &[x, y]) in self.points.iter().zip(at).filter(|(point, _)| point.strong) {
            if let Some(worst) = point.worst.filter(|&worst| worst > point.y) {
                let class = format!("gs-whisker gs-s{}", colour(point.series));
                let top = axis.at(worst);
                canvas.path(&class, &[[x, y], [x, top]]);
                canvas.path(&class, &[[x - 3.0, top], [x + 3.0, top]]);
            }
        }
    }

    fn slopes(&self, canvas: &mut Canvas, x: &Axis, y: &Axis) -> Vec<[[f64; 2]; 2]> {
        let mut drawn = Vec::new();
        for triangle in &self.triangles {
            let [a, b] = triangle.x.map(|h| x.at(h));
            let [left, right] = [triangle.left(), triangle.y].map(|value| y.at(value));
            let corners = [[a, left], [b, right], [b, left], [a, left]];
            canvas.path("gs-slope", &corners);
            drawn.extend(segments(&corners));
            let rate = digits(triangle.rate, 2);
            canvas.text([b + 5.0, 0.5 * (left + right) + 4.0], "start", "gs-muted", &rate);
            canvas.text([0.5 * (a + b), left + 13.0], "middle", "gs-muted", "1");
        }
        drawn
    }

    fn labels(&self, canvas: &mut Canvas, obstacles: Obstacles, area: Rect) {
        let labelled = self.points.iter().zip(&obstacles.points);
        let labelled = together(labelled.filter_map(|(p, at)| Some((p.label.as_deref()?, *at))));
        let sized =
            |(label, at): &(String, [f64; 2])| Label { at: *at, width: width(label, FONT), height: LINE };
        let sizes: Vec<Label> = labelled.iter().map(sized).collect();
        let placed = place(&sizes, &obstacles, area.grown([-3.0; 2]));
        let placed =
            || labelled.iter().zip(&placed).filter_map(|((label, at), rect)| Some((label, *at, (*rect)?)));
        for (_, at, rect) in placed() {
            let end = rect.nearest(at);
            if (end[0] - at[0]).hypot(end[1] - at[1]) > 15.0 {
                canvas.path("gs-leader", &[at, end]);
            }
        }
        for (label, at, rect) in placed() {
            // Beside its point a label begins or ends there, whatever width the reader's font gives it.
            let (x, anchor) = match at[0] {
                x if x <= rect.x => (rect.x, "start"),
                x if x >= rect.x + rect.width => (rect.x + rect.width, "end"),
                _ => (rect.x + 0.5 * rect.width, "middle"),
            };
            canvas.text_on_halo([x, rect.y + 11.5], anchor, label);
        }
    }
}

fn segments(corners: &[[f64; 2]]) -> impl Iterator<Item = [[f64; 2]; 2]> {
    corners.windows(2).map(|pair| [pair[0], pair[1]])
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
