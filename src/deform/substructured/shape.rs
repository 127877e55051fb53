//! The surface of a body in parts: what each part's coordinates and place make of its nodes.
//!
//! In: the stored displacements, y and the frames of each part's ends. Out, for each surface node,
//!
//! ```text
//! u = Σ_p w_p (x_p + R_p (X - c_p + Σ_k y_k u_k + ½ Σ_ij y_i y_j w_ij) - X)
//! ```
//!
//! with the place x_p and rotation R_p of the frame midway between the part's two ends (of more or fewer, at the first), and c_p
//! where it rests. Allocates nothing.

use super::link::{EndFrame, screw};
use super::linked_part::{LinkedPart, Places};
use crate::base::columns::ColumnGroup;
use crate::deform::superposition::Superposition;
use crate::green::substructure::StoredPart;
use nalgebra::Vector3;

/// Displacements below this part of the body's size are left out; products of small coefficients would be subnormal
/// numbers, with which processors are slow.
const UNSEEN: f64 = 1e-10;

/// The share of one part in the surface.
pub struct PartShape {
    nodes: Vec<u32>,
    shares: Vec<f32>,
    /// X, and X - c_p.
    rest: Vec<[f32; 3]>,
    from_centre: Vec<[f32; 3]>,
    /// Columns one after the other, 3 numbers a node.
    columns: Vec<f32>,
    /// Pairs i ≤ j of the columns of second order.
    pairs: Vec<(usize, usize)>,
    coefficients: Vec<f64>,
    /// Coefficients below these count as zero: what they move is far below single precision.
    least: Vec<f64>,
    sum: Superposition,
    u: Vec<[f32; 3]>,
}

impl PartShape {
    /// The shape of a stored part, by the origins of its ends, the surface at rest and the body's size.
    pub fn new(stored: &StoredPart, origins: &[Vector3<f64>], rest: &[[f32; 3]], size: f64) -> PartShape {
        let centre = match origins {
            [a, b] => (a + b) * 0.5,
            [a, ..] => *a,
            [] => Vector3::zeros(),
        };
        let screws = 6 * stored.ends.len().saturating_sub(1);
        let columns: Vec<f32> = stored.fields.iter().map(|value| *value as f32).collect();
        let own: Vec<[f32; 3]> = stored.nodes.iter().map(|&node| rest[node as usize]).collect();
        let from_centre =
            |x: &[f32; 3]| <[f32; 3]>::from((Vector3::from(*x).cast::<f64>() - centre).cast::<f32>());
        PartShape {
            from_centre: own.iter().map(from_centre).collect(),
            rest: own,
            shares: stored.shares.iter().map(|share| *share as f32).collect(),
            pairs: (0..screws).flat_map(|i| (i..screws).map(move |j| (i, j))).collect(),
            coefficients: vec![0.0; stored.fields.ncols()],
            least: stored.fields.column_iter().map(|column| UNSEEN * size / column.amax()).collect(),
            sum: Superposition::new(&[ColumnGroup::F32(&columns)], stored.nodes.len()),
            u: vec![[0.0; 3]; stored.nodes.len()],
            nodes: stored.nodes.clone(),
            columns,
        }
    }

    /// Adds the part's share to the displacements of all surface nodes.
    pub fn add(&mut self, part: &LinkedPart, places: &Places, field: &mut [[f32; 3]]) {
        let frame = middle(part, places);
        let m = part.y.len();
        self.coefficients[..m].copy_from_slice(&part.y);
        for (c, &(i, j)) in self.coefficients[m..].iter_mut().zip(&self.pairs) {
            *c = part.y[i] * part.y[j] * if i == j { 0.5 } else { 1.0 };
        }
        for (c, least) in self.coefficients.iter_mut().zip(&self.least) {
            if c.abs() < *least {
                *c = 0.0;
            }
        }
        let group = [ColumnGroup::F32(&self.columns)];
        self.sum.update(&group, &self.coefficients, &mut self.u);
        let rotation = frame.turn.to_rotation_matrix().into_inner().cast::<f32>();
        let place = frame.place.cast::<f32>();
        let nodes = self.nodes.iter().zip(&self.shares).zip(&self.rest).zip(&self.from_centre).zip(&self.u);
        let longer = 1.0 + part.strain as f32;
        for ((((&node, share), rest), from_centre), u) in nodes {
            let y = [0, 1, 2].map(|axis| longer * from_centre[axis] + u[axis]);
            let to = &mut field[node as usize];
            for axis in 0..3 {
                let row = rotation.row(axis);
                let x = place[axis] + row[0] * y[0] + row[1] * y[1] + row[2] * y[2];
                to[axis] += share * (x - rest[axis]);
            }
        }
    }
}

/// The frame that a part's displacements are seen from.
fn middle(part: &LinkedPart, places: &Places) -> EndFrame {
    let frame = |i: usize| places.frame(part.ends[i]);
    match part.ends.len() {
        2 => frame(0).moved(&(screw(frame(0), frame(1)) * 0.5)),
        _ => *frame(0),
    }
}
