//! Grips: places where a control element holds the middle surface.
//!
//! In: the nodes that it holds. Out: [`Grip`]s: in each cell those of its places that lie farthest out in eight directions, which
//! mark the edge of the held region, and the one in the middle. Fibres are held as far as the nodes spread across the plate: a
//! face or a band holds them, nodes of one of its two faces alone do not.

use super::middle::Middle;
use super::point::{Grip, Point};
use nalgebra::Vector3;

/// The grips of `control`, which holds `nodes` and has its origin at `origin`.
pub fn grips_of(middle: &Middle, control: usize, origin: &Vector3<f64>, nodes: &[Vector3<f64>]) -> Vec<Grip> {
    let places: Vec<[f64; 2]> = nodes.iter().map(|x| middle.place_of(x)).collect();
    let height = |(x, place): (&Vector3<f64>, &[f64; 2])| {
        middle.normal(*place).dot(&(x - middle.grid.at(*place).point(&middle.rest)))
    };
    let heights: Vec<f64> = nodes.iter().zip(&places).map(height).collect();
    let count = nodes.len().max(1) as f64;
    let mean = heights.iter().sum::<f64>() / count;
    let spread = heights.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / count;

    let [along, across] = middle.grid.cells();
    let mut of_cells: Vec<Vec<[f64; 2]>> = vec![Vec::new(); along * across];
    for place in places {
        let [i, j] = [0, 1].map(|axis| middle.grid.cell_at(axis, place[axis]));
        of_cells[i * across + j].push(place);
    }
    let grips = of_cells.iter().flat_map(|places| {
        let chosen = spread_out(places, CLOSE * middle.thickness);
        let share = middle.thickness / chosen.len().max(1) as f64;
        chosen.into_iter().filter_map(move |place| {
            let shape = middle.grid.at(place);
            let point = Point::new(&shape, &middle.rest, 1.0, middle.thickness)?;
            Some(Grip {
                control,
                nodes: shape.nodes,
                value: shape.value,
                slope: point.slope,
                arm: shape.point(&middle.rest) - origin,
                normal: middle.normal(place),
                share,
                spread,
                pull: 0.0,
                turn: 0.0,
            })
        })
    });
    grips.collect()
}

/// The places of a cell that lie farthest out in eight directions, and the one nearest to the mean; each once.
fn spread_out(places: &[[f64; 2]], close: f64) -> Vec<[f64; 2]> {
    const DIRECTIONS: [[f64; 2]; 8] = [
        [1.0, 0.0],
        [-1.0, 0.0],
        [0.0, 1.0],
        [0.0, -1.0],
        [1.0, 1.0],
        [-1.0, -1.0],
        [1.0, -1.0],
        [-1.0, 1.0],
    ];
    let count = places.len().max(1) as f64;
    let mean = [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f64>() / count);
    let least = |of: &dyn Fn(&[f64; 2]) -> f64| places.iter().min_by(|a, b| of(a).total_cmp(&of(b))).copied();
    let outer = DIRECTIONS.iter().map(|d| least(&|place| -(place[0] * d[0] + place[1] * d[1])));
    let inner = least(&|place| (place[0] - mean[0]).powi(2) + (place[1] - mean[1]).powi(2));
    let mut chosen: Vec<[f64; 2]> = Vec::new();
    for place in outer.chain([inner]).flatten() {
        let is_new = |old: &[f64; 2]| (old[0] - place[0]).abs().max((old[1] - place[1]).abs()) > close;
        if chosen.iter().all(is_new) {
            chosen.push(place);
        }
    }
    chosen
}

/// Places so near to each other, in thicknesses, are one.
const CLOSE: f64 = 0.05;
