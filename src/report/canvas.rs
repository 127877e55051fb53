//! A canvas of SVG elements: text, lines, markers, legend and ticks. All numbers are pixels, y points down. Text is escaped,
//! shortened and measured here, for HTML too.

use super::axis::Axis;

pub const STYLE: &str = include_str!("plot.css");
pub const WIDTH: f64 = 760.0;
pub const FONT: f64 = 12.0;
/// Room between the plots and the right edge.
pub const MARGIN: f64 = 40.0;
pub const LONGEST_LABEL: usize = 60;
const LONGEST_NOTE: usize = 118;

/// A finished drawing.
pub struct Picture {
    title: String,
    height: f64,
    /// Elements inside `<svg>`.
    body: String,
}

impl Picture {
    /// The picture as a separate file that follows the reader's light or dark scheme.
    pub fn file(&self) -> String {
        let style = format!("<style>\n{STYLE}</style>\n");
        format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}", self.element(&style))
    }

    /// The picture as an element of a page that has the plots' style.
    pub fn inline(&self) -> String {
        self.element("")
    }

    fn element(&self, style: &str) -> String {
        let (height, title) = (self.height, escape(&self.title));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"gs-plot\" role=\"img\" aria-label=\"{title}\" \
             viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" height=\"{height}\">\n{style}\
             <rect class=\"gs-bg\" width=\"{WIDTH}\" height=\"{height}\" rx=\"6\"/>\n{}</svg>\n",
            self.body
        )
    }
}

/// The shape of each series: corners of a polygon (none: a circle), direction of the first in degrees, and the radii of
/// its even and odd corners.
const MARKERS: [(u32, f64, [f64; 2]); 7] = [
    (0, 0.0, [0.95; 2]),
    (4, 45.0, [1.2; 2]),
    (3, -90.0, [1.25; 2]),
    (4, -90.0, [1.2; 2]),
    (3, 90.0, [1.25; 2]),
    (6, 0.0, [1.15; 2]),
    (8, 0.0, [1.4, 0.55]),
];

/// The number that the style's classes give the colour of a series; plots with more series repeat them.
pub fn colour(series: usize) -> usize {
    series % MARKERS.len()
}

fn points(corners: &[[f64; 2]]) -> String {
    corners.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect::<Vec<_>>().join("L")
}

/// The marker of a series: the same shape in every plot.
pub fn marker(series: usize, [x, y]: [f64; 2], size: f64) -> String {
    let (count, first, radii) = MARKERS[colour(series)];
    if count == 0 {
        return format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{:.1}\"/>", radii[0] * size);
    }
    let corner = |i: u32| {
        let (sin, cos) = (first + 360.0 * f64::from(i) / f64::from(count)).to_radians().sin_cos();
        let radius = size * radii[i as usize % 2];
        [x + radius * cos, y + radius * sin]
    };
    format!("<path d=\"M{}Z\"/>", points(&(0..count).map(corner).collect::<Vec<_>>()))
}

pub struct Canvas {
    title: String,
    pub body: String,
}

impl Canvas {
    /// A canvas with title, note and legend, and the y at which the plot below them begins.
    pub fn new(title: &str, note: &str, series: &[String]) -> (Canvas, f64) {
        let mut canvas = Canvas { title: title.to_owned(), body: String::new() };
        canvas.text([16.0, 26.0], "start", "gs-title", title);
        let mut top = 36.0;
        if !note.is_empty() {
            canvas.text([16.0, top + 9.0], "start", "gs-muted", &shortened(note, LONGEST_NOTE));
            top += 19.0;
        }
        if !series.is_empty() {
            top = canvas.legend(series, top) + 8.0;
        }
        (canvas, top + 8.0)
    }

    /// A row of markers and names, wrapped at the right; returns the y of its last line.
    fn legend(&mut self, names: &[String], top: f64) -> f64 {
        let left = 16.0;
        let (mut x, mut y) = (left, top + 11.0);
        for (i, name) in names.iter().enumerate() {
            let name = shortened(name, LONGEST_LABEL);
            let wide = 20.0 + width(&name, FONT);
            if x > left && x + wide > WIDTH - MARGIN {
                (x, y) = (left, y + 17.0);
            }
            let shape = marker(i, [x + 6.0, y - 4.0], 5.0);
            self.body += &format!("<g class=\"gs-f{}\">{shape}</g>", colour(i));
            self.text([x + 16.0, y], "start", "gs-text", &name);
            x += wide + 14.0;
        }
        y
    }

    pub fn text(&mut self, [x, y]: [f64; 2], anchor: &str, class: &str, words: &str) {
        self.body += &format!(
            "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>\n",
            escape(words)
        );
    }

    /// Text on a halo that keeps it apart from the ground: twice, since not every program knows `paint-order`.
    pub fn text_on_halo(&mut self, at: [f64; 2], anchor: &str, words: &str) {
        self.body += "<g aria-hidden=\"true\">";
        self.text(at, anchor, "gs-halo", words);
        self.body += "</g>";
        self.text(at, anchor, "gs-text", words);
    }

    /// Straight lines from corner to corner.
    pub fn path(&mut self, class: &str, corners: &[[f64; 2]]) {
        self.body += &format!("<path class=\"{class}\" d=\"M{}\"/>\n", points(corners));
    }

    /// Grid lines and numbers of an axis; `across` are the ends of its grid lines.
    pub fn ticks(&mut self, axis: &Axis, vertical: bool, across: [f64; 2]) {
        let zero = axis.zero.map(|at| {
            let floor =
                if axis.floor > 0.0 { format!("< {}", axis.unit.text(axis.floor)) } else { "0".into() };
            (at, "gs-goal", floor)
        });
        let ticks = axis.ticks().into_iter().map(|tick| (axis.at(tick.value), "gs-grid", tick.label));
        let mut last: Option<(f64, f64)> = None;
        for (at, class, label) in zero.into_iter().chain(ticks) {
            let half = 0.5 * if vertical { FONT } else { width(&label, FONT) + 4.0 };
            let free = last.is_none_or(|(before, taken)| (at - before).abs() >= taken + half);
            let label = if free { label.as_str() } else { "" };
            if vertical {
                self.path(class, &[[across[0], at], [across[1], at]]);
                self.text([across[0] - 7.0, at + 4.0], "end", "gs-text", label);
            } else {
                self.path(class, &[[at, across[0]], [at, across[1]]]);
                self.text([at, across[0] + 17.0], "middle", "gs-text", label);
            }
            if !label.is_empty() {
                last = Some((at, half));
            }
        }
    }

    pub fn picture(self, height: f64) -> Picture {
        Picture { title: self.title, height, body: self.body }
    }
}

/// Text as the content of an element or of a quoted attribute. Characters that XML does not know become �.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\t' | '\n' | '\r' => safe.push(' '),
            '\u{0}'..='\u{1f}' | '\u{7f}'..='\u{9f}' | '\u{fffe}' | '\u{ffff}' => safe.push('\u{fffd}'),
            // A text that runs from right to left must not turn the figures beside it.
            '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => {
                safe.push('\u{fffd}');
            }
            c => safe.push(c),
        }
    }
    safe
}

/// Shortens a text to `most` characters, the last of which is then an ellipsis.
pub fn shortened(text: &str, most: usize) -> String {
    match text.char_indices().nth(most) {
        None => text.to_owned(),
        Some(_) => text.chars().take(most.saturating_sub(1)).chain(['…']).collect(),
    }
}

/// Width of `text` in pixels at font size `size`, no less than common sans serif fonts need.
pub fn width(text: &str, size: f64) -> f64 {
    let share = |c: char| match c {
        'i' | 'j' | 'l' | '.' | ',' | '\'' | '|' | ':' | ';' | '!' | '·' | ' ' => 0.33,
        'c' | 's' | 'k' | 'v' | 'x' | 'y' | 'z' => 0.59,
        'f' | 't' | 'r' | '(' | ')' | '/' | '-' | '⁻' | '¹' => 0.41,
        '⁰' | '²'..='³' | '⁴'..='⁹' => 0.42,
        'm' | 'w' | 'M' | 'W' | '%' | '@' | '—' | '…' => 0.97,
        'A'..='Z' => 0.72,
        '\0'..='\u{24f}' => 0.63,
        'Ͱ'..='ӿ' => 0.75,
        _ => 1.0,
    };
    size * text.chars().map(share).sum::<f64>()
}
