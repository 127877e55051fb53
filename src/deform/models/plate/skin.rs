//! The surface of the finite-element body on its middle surface.
//!
//! In: the surface at rest and the middle one. Out: the displacement of every node:
//!
//! ```text
//! x = r + α_1 r,1 + α_2 r,2 + z (1 - ν' (ε₁₁ + ε₂₂)) n     ν' = ν/(1 - ν)
//! ```
//!
//! with the node's place (r, α, z) at rest, and the contraction across the plate of plane stress. Nodes of the control
//! elements go exactly where they are held.
//!
//! A control element holds the middle surface by [`Grip`]s: in each cell those of the places of its nodes that lie farthest out in
//! eight directions, which mark the edge of the held region, and the one in the middle. Fibres are held as far as the nodes spread
//! across the plate: a face or a band holds them, nodes of one of its two faces alone do not.

use super::middle::Middle;
use super::point::{Grip, Hold, Point};
use nalgebra::{Matrix2, Vector2, Vector3};

/// A node on the middle surface.
struct Place {
    nodes: [u32; 9],
    value: [f32; 9],
    slope: [[f32; 2]; 9],
    /// α and z.
    beside: [f32; 2],
    height: f32,
    /// The inverse of the metric at rest: 11, 22, 12.
    metric: [f32; 3],
}

/// A node of a control element, and y from its origin.
struct Held {
    node: usize,
    control: usize,
    arm: Vector3<f64>,
}

pub struct Skin {
    rest: Vec<[f32; 3]>,
    places: Vec<Place>,
    held: Vec<Held>,
    /// ν/(1 - ν).
    contraction: f32,
    control_points: Vec<Vector3<f32>>,
    field: Vec<[f32; 3]>,
}

impl Skin {
    /// `held`: the surface nodes of each control element; `poisson`: ν.
    pub fn new(
        middle: &Middle,
        origins: &[Vector3<f64>],
        rest: &[[f32; 3]],
        held: &[Vec<u32>],
        poisson: f64,
    ) -> Skin {
        let held = held.iter().enumerate().flat_map(|(control, nodes)| {
            nodes.iter().filter_map(move |&node| {
                let x = Vector3::from(*rest.get(node as usize)?).cast::<f64>();
                Some(Held { node: node as usize, control, arm: x - origins.get(control)? })
            })
        });
        Skin {
            places: rest.iter().map(|x| Place::nearest(middle, &Vector3::from(*x).cast())).collect(),
            held: held.collect(),
            contraction: (poisson / (1.0 - poisson)) as f32,
            control_points: middle.rest.iter().map(|q| q.cast()).collect(),
            field: vec![[0.0; 3]; rest.len()],
            rest: rest.to_vec(),
        }
    }

    pub fn field(&self) -> &[[f32; 3]] {
        &self.field
    }

    /// Displacements for these control points, of a body that warmth lengthens by `strain` where it is free.
    pub fn update(&mut self, q: &[Vector3<f64>], holds: &[Hold], strain: f64) {
        let warm = strain as f32;
        for (own, q) in self.control_points.iter_mut().zip(q) {
            *own = q.cast();
        }
        for ((place, rest), field) in self.places.iter().zip(&self.rest).zip(&mut self.field) {
            let (mut r, mut x, mut y) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
            for k in 0..9 {
                let q = &self.control_points[place.nodes[k] as usize];
                r += q * place.value[k];
                x += q * place.slope[k][0];
                y += q * place.slope[k][1];
            }
            let cross = x.cross(&y);
            let size = cross.norm();
            let normal = if size > 0.0 { cross / size } else { cross };
            let [xx, yy, xy] = place.metric;
            let strain = 0.5 * (x.norm_squared() * xx + y.norm_squared() * yy + 2.0 * x.dot(&y) * xy - 2.0);
            let height = place.height * (1.0 + warm - self.contraction * (strain - 2.0 * warm));
            let moved = r + x * place.beside[0] + y * place.beside[1] + normal * height;
            *field = (moved - Vector3::from(*rest)).into();
        }
        for Held { node, control, arm } in &self.held {
            let Some(hold) = holds.get(*control) else { continue };
            let moved = hold.place + hold.matrix * arm - Vector3::from(self.rest[*node]).cast();
            self.field[*node] = moved.cast::<f32>().into();
        }
    }
}

/// Shares of a force at x that act on the control points: r + α_1 r,1 + α_2 r,2.
pub fn shares(middle: &Middle, x: &Vector3<f64>) -> Vec<(usize, f64)> {
    let shape = middle.grid.at(middle.place_of(x));
    let [by_x, by_y] = shape.tangents(&middle.rest);
    let off = x - shape.point(&middle.rest);
    let metric = Matrix2::new(by_x.norm_squared(), by_x.dot(&by_y), by_x.dot(&by_y), by_y.norm_squared());
    let inverse = metric.try_inverse().unwrap_or_else(Matrix2::zeros);
    let beside = inverse * Vector2::new(by_x.dot(&off), by_y.dot(&off));
    let share = |k: usize| shape.value[k] + shape.slope[k][0] * beside.x + shape.slope[k][1] * beside.y;
    (0..9).map(|k| (shape.nodes[k], share(k))).collect()
}

impl Place {
    fn nearest(middle: &Middle, x: &Vector3<f64>) -> Place {
        let place = middle.place_of(x);
        let shape = middle.grid.at(place);
        let [by_x, by_y] = shape.tangents(&middle.rest);
        let off = x - shape.point(&middle.rest);
        let metric = Matrix2::new(by_x.norm_squared(), by_x.dot(&by_y), by_x.dot(&by_y), by_y.norm_squared());
        let inverse = metric.try_inverse().unwrap_or_else(Matrix2::zeros);
        let beside = inverse * Vector2::new(by_x.dot(&off), by_y.dot(&off));
        Place {
            nodes: shape.nodes.map(|node| node as u32),
            value: shape.value.map(|x| x as f32),
            slope: shape.slope.map(|slope| slope.map(|x| x as f32)),
            beside: [beside.x as f32, beside.y as f32],
            height: off.dot(&middle.normal(place)) as f32,
            metric: [inverse[(0, 0)] as f32, inverse[(1, 1)] as f32, inverse[(0, 1)] as f32],
        }
    }
}

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
