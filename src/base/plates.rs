//! What is written over the pictures of a world, beside the overlay: lines of words, plots and legends. Plain data, which the display
//! paints.

use super::legend::Legend;

/// A dark plate with words, and a plot below them.
#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    pub anchor: Anchor,
    /// Words in their tones, line by line.
    pub lines: Vec<Words>,
    pub plot: Option<Plot>,
    /// What colours mean, in place of lines.
    pub legend: Option<Legend>,
}

/// Where a plate stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Anchor {
    /// In a corner of the screen that the viewer looks at; several stand above each other.
    LowerLeft,
    LowerRight,
    /// Beside a place in the room, on every screen that shows it, m.
    Place([f64; 3]),
}

/// A line of words in their tones.
pub type Words = Vec<(String, Tone)>;

/// What a word or a curve says by its colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    Plain,
    Quiet,
    Good,
    Fair,
    Bad,
    /// A ghost's own colour, sRGB.
    Own([u8; 3]),
}

/// Curves over two axes, with values in the axes' units.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    pub x: Axis,
    pub y: Axis,
    /// Places in the order in which they were passed; a gap parts them.
    pub curves: Vec<Vec<[f64; 2]>>,
    /// Between which values y may truly lie: x, lower, upper.
    pub band: Vec<Vec<[f64; 3]>>,
    /// Where the curve is now.
    pub now: Option<[f64; 2]>,
}

/// A quantity that is plotted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    pub name: &'static str,
    /// Of SI, to take a prefix; or `°`, which takes none.
    pub unit: &'static str,
}

impl Plate {
    /// A plate with one line of plain words.
    pub fn of(anchor: Anchor, words: impl Into<String>) -> Plate {
        Plate { anchor, lines: vec![vec![(words.into(), Tone::Plain)]], plot: None, legend: None }
    }
}
