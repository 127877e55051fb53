//! Rays along the thinnest direction of a body, on a fine grid over its cells: where it is, and how thick.

use super::plane::Plane;
use super::spline::Grid;
use nalgebra::{Vector2, Vector3};

/// Rays along each side of a cell; an even number.
pub const RAYS: usize = 16;
/// Normals of opposite faces have a larger product, whatever their signs.
const OPPOSITE: f64 = 0.8;

/// Heights at which a ray enters and leaves the body.
#[derive(Clone, Copy)]
pub struct Faces {
    pub low: f64,
    pub high: f64,
    /// Whether the faces stand one behind the other, so that neither is a side wall.
    pub are_opposite: bool,
}

/// Findings of the rays along the thinnest direction: the heights of both faces, where they meet the body.
pub struct Rays {
    places: [Vec<f64>; 2],
    pub faces: Vec<Option<Faces>>,
    /// Rays that meet more than two faces.
    pub folded: usize,
}

/// Rays of a quarter of a cell.
pub struct Quarter {
    pub inside: usize,
    pub outside: usize,
    /// Their mean places.
    pub place_inside: [f64; 2],
    pub place_outside: [f64; 2],
    /// The mean height between faces that are opposite, and how many rays of that height the others amount to: at a slanted
    /// border a ray meets a part of the thickness.
    pub height: f64,
    pub filled: f64,
}

impl Rays {
    pub fn cast(plane: &Plane, grid: &Grid, triangles: &[[Vector3<f64>; 3]]) -> Rays {
        let places = [0, 1].map(|axis| {
            let rays = |pair: &[f64]| {
                let (from, step) = (pair[0], (pair[1] - pair[0]) / RAYS as f64);
                (0..RAYS).map(move |k| from + (k as f64 + 0.5 + ASIDE[axis]) * step)
            };
            grid.knots[axis].windows(2).flat_map(rays).collect::<Vec<f64>>()
        });
        let mut met: Vec<Vec<(f64, Vector3<f64>)>> = vec![Vec::new(); places[0].len() * places[1].len()];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|x| plane.axes.transpose() * (x - plane.corner));
            let whole = (b - a).xy().perp(&(c - a).xy());
            if whole == 0.0 {
                continue;
            }
            let normal = (b - a).cross(&(c - a)).normalize();
            let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
            let range = |axis: usize| {
                let before = |x: f64| places[axis].partition_point(|place| *place < x);
                before(low[axis])..before(high[axis])
            };
            for i in range(0) {
                for j in range(1) {
                    let ray = Vector2::new(places[0][i], places[1][j]);
                    let part = |from: &Vector3<f64>, to: &Vector3<f64>| {
                        (to.xy() - from.xy()).perp(&(ray - from.xy())) / whole
                    };
                    let shares = [part(&b, &c), part(&c, &a), part(&a, &b)];
                    if shares.iter().all(|share| *share >= 0.0) {
                        let height = a.z * shares[0] + b.z * shares[1] + c.z * shares[2];
                        met[i * places[1].len() + j].push((height, normal));
                    }
                }
            }
        }
        let folded = met.iter().filter(|heights| heights.len() > 2).count();
        let faces = met.into_iter().map(|heights| match heights[..] {
            [(a, one), (b, other)] => {
                Some(Faces { low: a.min(b), high: a.max(b), are_opposite: one.dot(&other).abs() > OPPOSITE })
            }
            _ => None,
        });
        Rays { faces: faces.collect(), places, folded }
    }

    pub fn place(&self, ray: usize) -> [f64; 2] {
        let across = self.places[1].len();
        [self.places[0][ray / across], self.places[1][ray % across]]
    }

    pub fn quarter(&self, corner: [usize; 2], quarter: usize) -> Quarter {
        let half = RAYS / 2;
        let (first_i, first_j) =
            (corner[0] * RAYS + quarter / 2 * half, corner[1] * RAYS + quarter % 2 * half);
        let (mut inside, mut outside) = (Vec::new(), Vec::new());
        for k in 0..half * half {
            let ray = (first_i + k / half) * self.places[1].len() + first_j + k % half;
            match self.faces[ray] {
                Some(faces) => inside.push((self.place(ray), faces)),
                None => outside.push(self.place(ray)),
            }
        }
        let heights = |faces: &Faces| faces.high - faces.low;
        let (opposite, sum) = inside
            .iter()
            .filter(|(_, faces)| faces.are_opposite)
            .fold((0.0, 0.0), |(count, sum), (_, faces)| (count + 1.0, sum + heights(faces)));
        let height = if opposite > 0.0 { sum / opposite } else { 0.0 };
        let whole: f64 = inside.iter().map(|(_, faces)| heights(faces)).sum();
        let places: Vec<[f64; 2]> = inside.iter().map(|(place, _)| *place).collect();
        Quarter {
            inside: inside.len(),
            outside: outside.len(),
            place_inside: mean(&places),
            place_outside: mean(&outside),
            height,
            filled: if height > 0.0 { whole / height } else { inside.len() as f64 },
        }
    }
}

fn mean(places: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f64>() / places.len().max(1) as f64)
}

/// Rays stand a little aside of where edges of a regular mesh are, in parts of their distance.
const ASIDE: [f64; 2] = [0.003_141_59, 0.002_718_28];
