//! Plates over the pictures of a world, beside the overlay: lines of words, plots and legends. Plain data, which the display
//! paints.

use super::legend::Legend;

/// A dark plate with words, and a plot below them.
#[derive(Clone, Debug, PartialEq)]
pub struct Plate {
    pub anchor: Anchor,
    /// Words in their tones, line by line.
    pub lines: Vec<Words>,
    pub plot: Option<Plot>,
    /// A legend of colours, in place of lines.
    pub legend: Option<Legend>,
}

/// The place of a plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Anchor {
    /// A corner of the screen that the viewer looks at; several plates stand above each other.
    LowerLeft,
    LowerRight,
    /// A place in the room, m: the plate stands near it on every screen that shows it.
    Place([f64; 3]),
}

/// A line of words in their tones.
pub type Words = Vec<(String, Tone)>;

/// The meaning of a colour, of words or of a curve.
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
    /// Bands between which y may truly lie: x, lower, upper.
    pub band: Vec<Vec<[f64; 3]>>,
    /// The point of the curve for now.
    pub now: Option<[f64; 2]>,
}

/// A quantity that is plotted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axis {
    pub name: &'static str,
    /// A unit of SI, to take a prefix; or `°`, which takes none.
    pub unit: &'static str,
}

impl Plate {
    /// A plate with one line of plain words.
    pub fn new(anchor: Anchor, words: impl Into<String>) -> Plate {
        Plate { anchor, lines: vec![vec![(words.into(), Tone::Plain)]], plot: None, legend: None }
    }
}
