//! Spots that follow the nearest point of their triangle or edge from round to round.
//!
//! In: where a spot is, and the nearest point to the tool on the same feature. Out: where it goes. A pressed triangle tilts away from the
//! force, and its nearest point moves to the other side; a spot that went all the way would swing to and fro. The secant between the last
//! two rounds says what share of the way to go.

use super::touched_body::SurfaceSpot;
use std::collections::BTreeMap;

/// Least share of the way.
const LEAST: f64 = 0.1;

/// Body, tool and corners of a spot.
type Feature = (usize, usize, [u32; 3]);

/// The spots of a step.
#[derive(Default)]
pub struct Slides(BTreeMap<Feature, Slide>);

struct Slide {
    /// Weights of the spot in the last round.
    at: [f64; 3],
    /// Way from there to the nearest point.
    ahead: [f64; 3],
}

impl Slides {
    /// The next place of a spot between a body and a tool, on the way to the nearest point of its feature.
    pub fn towards(
        &mut self,
        (body, tool): (usize, usize),
        spot: &SurfaceSpot,
        nearest: &SurfaceSpot,
    ) -> SurfaceSpot {
        let at = spot.weights;
        let ahead = difference(nearest.weights, at);
        let last = self.0.insert((body, tool, spot.nodes), Slide { at, ahead });
        let share = last.map_or(1.0, |last| {
            let moved = difference(at, last.at);
            let answered = dot(difference(last.ahead, ahead), moved);
            if answered > 0.0 { (dot(moved, moved) / answered).clamp(LEAST, 1.0) } else { 1.0 }
        });
        let weights = std::array::from_fn(|k| at[k] + share * ahead[k]);
        SurfaceSpot { nodes: spot.nodes, weights }
    }
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A nearest point that moves back by 3 times what a spot goes: without the secant the spot would leave ever farther.
    #[test]
    fn a_spot_that_its_feature_tilts_away_from_finds_the_point_where_it_stays() {
        let on_edge = |w: f64| SurfaceSpot { nodes: [3, 4, 3], weights: [1.0 - w, w, 0.0] };
        let nearest = |w: f64| 0.4 - 3.0 * (w - 0.4);
        let (mut slides, mut w) = (Slides::default(), 0.42);
        for _ in 0..3 {
            w = slides.towards((0, 0), &on_edge(w), &on_edge(nearest(w))).weights[1];
        }
        assert!((w - 0.4).abs() < 1e-12, "{w}");
        assert_eq!(slides.towards((0, 1), &on_edge(0.1), &on_edge(0.7)), on_edge(0.7), "another tool");
    }
}
