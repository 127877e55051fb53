//! The few colours of an indexed picture, chosen so that nobody sees that they are few.
//!
//! In: the colours of pictures, and how often each occurs. Out: a [`Palette`] that grows while there is room. Colours are
//! chosen as by X. Wu ("Efficient statistical computations for optimal color quantization", Graphics Gems II, 1991, 126-133): the box with the largest
//! squared error is cut into two at its mean, across the axis along which its colours differ most.

use image::RgbImage;
use std::collections::BTreeMap;

pub type Colour = [u8; 3];

/// Bits of a channel by which colours are looked up: colours that differ in the others alone are shown alike.
const BITS: u32 = 6;

/// Colours with numbers.
pub struct Palette {
    pub colours: Vec<Colour>,
    most: usize,
    /// The number of the colour nearest to each cell, where that was asked for since the last colour came.
    nearest: Box<[Option<u8>]>,
}

/// Colours, and how often each occurs.
pub type Histogram = BTreeMap<Colour, u32>;

impl Palette {
    /// A palette of at most `most` colours, 256 at most.
    pub fn new(most: usize) -> Palette {
        let cells = 1 << (3 * BITS);
        Palette { colours: Vec::new(), most: most.min(256), nearest: vec![None; cells].into() }
    }

    /// Number of colours that it may still take.
    pub fn room(&self) -> usize {
        self.most - self.colours.len()
    }

    /// Takes up to `most` colours that stand for those of the histogram.
    pub fn grow(&mut self, histogram: &Histogram, most: usize) {
        self.colours.extend(chosen(histogram, most.min(self.room())));
        self.nearest.fill(None);
    }

    /// The number of the nearest colour; 0 of an empty palette.
    pub fn index(&mut self, colour: Colour) -> u8 {
        let cell =
            colour.into_iter().fold(0, |cell, channel| cell << BITS | usize::from(channel >> (8 - BITS)));
        if let Some(known) = self.nearest[cell] {
            return known;
        }
        let nearest = (0..=255).zip(&self.colours).min_by_key(|(_, own)| apart(**own, colour));
        let index = nearest.map_or(0, |(index, _)| index);
        self.nearest[cell] = Some(index);
        index
    }

    /// Counts the colours of those pixels that it shows worse than by `tolerance` steps of 255 in a channel.
    pub fn missed(&mut self, picture: &RgbImage, tolerance: u8, missed: &mut Histogram) {
        for pixel in picture.pixels() {
            let index = self.index(pixel.0);
            let own = self.colours.get(usize::from(index));
            if own.is_none_or(|own| differ(*own, pixel.0) > tolerance) {
                *missed.entry(pixel.0).or_default() += 1;
            }
        }
    }
}

/// The largest difference in a channel.
pub fn differ(a: Colour, b: Colour) -> u8 {
    (0..3).map(|channel| a[channel].abs_diff(b[channel])).max().unwrap_or(0)
}

/// Squared distance.
fn apart(a: Colour, b: Colour) -> u32 {
    (0..3).map(|channel| u32::from(a[channel].abs_diff(b[channel])).pow(2)).sum()
}

/// Colours of a part of the colour cube.
struct Cube(Vec<(Colour, f64)>);

impl Cube {
    fn mean(&self) -> [f64; 3] {
        let whole: f64 = self.0.iter().map(|(_, weight)| weight).sum();
        [0, 1, 2].map(|channel| {
            self.0.iter().map(|(colour, weight)| f64::from(colour[channel]) * weight).sum::<f64>() / whole
        })
    }

    /// Sum of squares of its colours' deviations from their mean, per channel.
    fn squares(&self) -> [f64; 3] {
        let mean = self.mean();
        // By rounding, the mean of one colour may differ from it.
        if self.0.len() < 2 {
            return [0.0; 3];
        }
        [0, 1, 2].map(|channel| {
            let square = |(colour, weight): &(Colour, f64)| {
                weight * (f64::from(colour[channel]) - mean[channel]).powi(2)
            };
            self.0.iter().map(square).sum()
        })
    }

    /// Two halves; the first is empty where all its colours are one.
    fn halves(self) -> [Cube; 2] {
        let (mean, squares) = (self.mean(), self.squares());
        let axis = (0..3).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).unwrap_or(0);
        let (low, high) = self.0.into_iter().partition(|(colour, _)| f64::from(colour[axis]) < mean[axis]);
        [Cube(low), Cube(high)]
    }
}

/// Chooses at most `most` colours that stand for all; rare ones count for more than their share, because few pixels can be all of
/// a thing.
fn chosen(histogram: &Histogram, most: usize) -> Vec<Colour> {
    let weighed = histogram.iter().map(|(colour, count)| (*colour, f64::from(*count).sqrt())).collect();
    let mut cubes: Vec<(f64, Cube)> = Vec::new();
    if most > 0 && !histogram.is_empty() {
        let all = Cube(weighed);
        cubes.push((all.squares().iter().sum(), all));
    }
    while cubes.len() < most {
        let worst = (0..cubes.len()).max_by(|&a, &b| cubes[a].0.total_cmp(&cubes[b].0)).unwrap_or(0);
        if cubes.get(worst).is_none_or(|(error, _)| *error <= 0.0) {
            break;
        }
        let parts = cubes.swap_remove(worst).1.halves().into_iter().filter(|cube| !cube.0.is_empty());
        cubes.extend(parts.map(|cube| (cube.squares().iter().sum(), cube)));
    }
    let colour = |(_, cube): &(f64, Cube)| cube.mean().map(|channel| channel.round() as u8);
    cubes.iter().map(colour).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    /// Against all ways to part colours on a line into three neighbourhoods.
    #[test]
    fn a_few_colours_stand_for_many_nearly_as_well_as_the_best() {
        let greys: Vec<(u8, u32)> = (0..40).map(|k| ((7 * k * k % 251) as u8, 1 + 13 * k % 17)).collect();
        let histogram: Histogram = greys.iter().map(|&(grey, count)| ([grey; 3], count)).collect();
        let sorted: Vec<(f64, f64)> =
            histogram.iter().map(|(c, n)| (f64::from(c[0]), f64::from(*n).sqrt())).collect();
        let error = |part: &[(f64, f64)]| {
            let whole: f64 = part.iter().map(|(_, w)| w).sum();
            let mean = part.iter().map(|(x, w)| x * w).sum::<f64>() / whole;
            part.iter().map(|(x, w)| w * (x - mean).powi(2)).sum::<f64>()
        };
        let n = sorted.len();
        let cuts = (1..n - 1).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
        let best = cuts
            .map(|(a, b)| error(&sorted[..a]) + error(&sorted[a..b]) + error(&sorted[b..]))
            .fold(f64::INFINITY, f64::min);
        let three = chosen(&histogram, 3);
        let nearest =
            |x: f64| three.iter().map(|c| (f64::from(c[0]) - x).powi(2)).fold(f64::INFINITY, f64::min);
        let ours: f64 = sorted.iter().map(|(x, w)| w * nearest(*x)).sum();
        assert!(three.len() == 3 && ours < 1.5 * best, "{ours} against {best}");
    }

    #[test]
    fn as_many_colours_as_there_is_room_for_come_out_as_they_are() {
        let colours: Vec<Colour> = (0..200_u8).map(|k| [k, 255 - k, k / 2]).collect();
        let histogram: Histogram = colours.iter().map(|colour| (*colour, 3)).collect();
        let mut found = chosen(&histogram, 255);
        found.sort_unstable();
        assert_eq!(found, colours);
        assert!(chosen(&histogram, 0).is_empty() && chosen(&Histogram::new(), 9).is_empty());

        let mut palette = Palette::new(3);
        assert_eq!(palette.index([1, 2, 3]), 0);
        palette.grow(&Histogram::from([([10, 10, 10], 1), ([200, 0, 0], 1)]), 9);
        assert_eq!(palette.room(), 1);
        let red = palette.index([190, 5, 3]);
        assert_eq!(palette.colours[usize::from(red)], [200, 0, 0]);
        let picture = RgbImage::from_fn(4, 1, |x, _| Rgb([[12, 9, 10], [0, 0, 250]][usize::from(x == 2)]));
        let mut left = Histogram::new();
        palette.missed(&picture, 4, &mut left);
        assert_eq!(left, Histogram::from([([0, 0, 250], 1)]));
        palette.grow(&left, 9);
        assert_eq!(palette.room(), 0);
        left.clear();
        palette.missed(&picture, 4, &mut left);
        assert!(left.is_empty());
    }
}
