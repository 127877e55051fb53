//! Shares of a part's ends in a force on it, and the surface of a body in parts.
//!
//! In: where the ends rest, and a place X. Out: the shares φ of the slots x and R of each end, N = Σ f φ and the three columns of
//! Σ f ⊗ a. Between two ends a and b, d = b - a apart, X = a + t d + X⊥ goes as a beam's point does (Hermite's cubics):
//!
//! ```text
//! x = h₀₀ x_a + h₀₁ x_b + R_a (h₁₀ d + (1 - t) X⊥) + R_b (h₁₁ d + t X⊥)
//! h₀₀ = 1 - h₀₁    h₀₁ = 3t² - 2t³    h₁₀ = t - 2t² + t³    h₁₁ = t³ - t²
//! ```
//!
//! Of one end it goes rigidly with that; of more, with each in inverse proportion to the square of the distance. A common motion of
//! all ends moves X with them.
//!
//! The stored displacements, y and the frames of each part's ends make of each surface node
//!
//! ```text
//! u = Σ_p w_p (x_p + R_p (X - c_p + Σ_k y_k u_k + ½ Σ_ij y_i y_j w_ij) - X)
//! ```
//!
//! with the place x_p and rotation R_p of the frame midway between the part's two ends (of more or fewer, at the first), and c_p
//! where it rests.

use super::link::{LinkedPart, PartEnd, Places, screw};
use crate::base::columns::ColumnGroup;
use crate::deform::kernel::superposition::Superposition;
use crate::deform::loads::{Borne, SLOTS};
use crate::deform::pose::se3::exp;
use crate::green::substructure::StoredPart;
use nalgebra::{Isometry3, Vector3};

type V3 = Vector3<f64>;

/// The parts with where their ends rest, and the places of the surface by which a force finds its part.
pub struct Shares {
    parts: Vec<Vec<(usize, V3)>>,
    places: Vec<(V3, usize)>,
}

impl Shares {
    /// Slots of interfaces stand before those of control elements.
    pub fn new(parts: &[StoredPart], ends: &[Vec<PartEnd>], rest: &Places, surface: &[[f32; 3]]) -> Shares {
        let slot = |end: &PartEnd| match *end {
            PartEnd::Interface(i) => SLOTS * i,
            PartEnd::Control(e) => SLOTS * (rest.interfaces.len() + e),
        };
        let of_part = |ends: &Vec<PartEnd>| {
            ends.iter().map(|end| (slot(end), rest.frame(*end).translation.vector)).collect()
        };
        let mut owners = vec![(0.0, 0); surface.len()];
        for (p, part) in parts.iter().enumerate() {
            for (&node, &share) in part.nodes.iter().zip(&part.shares) {
                if share > owners[node as usize].0 {
                    owners[node as usize] = (share, p);
                }
            }
        }
        let place = |(x, (_, p)): (&[f32; 3], &(f64, usize))| (Vector3::from(*x).cast(), *p);
        Shares {
            parts: ends.iter().map(of_part).collect(),
            places: surface.iter().zip(&owners).map(place).collect(),
        }
    }

    /// The slots with the shares of a force at x.
    pub fn at(&self, x: &V3) -> Vec<(usize, f64)> {
        let away = |(place, _): &&(V3, usize)| (place - x).norm_squared();
        let nearest = self.places.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
        let ends = nearest.and_then(|(_, part)| self.parts.get(*part)).map_or(&[][..], Vec::as_slice);
        if let [(first, a), (last, b)] = ends {
            let d = b - a;
            let along = (x - a).dot(&d) / d.norm_squared();
            let t = along.clamp(0.0, 1.0);
            let across = x - a - d * along;
            let beyond = d * (along - t);
            let h = 3.0 * t * t - 2.0 * t * t * t;
            let [at_first, at_last] = [t - 2.0 * t * t + t * t * t, t * t * t - t * t];
            let one = Borne::shares(*first, 1.0 - h, &(d * at_first + (across + beyond) * (1.0 - t)));
            let other = Borne::shares(*last, h, &(d * at_last + (across + beyond) * t));
            return one.into_iter().chain(other).collect();
        }
        let weights: Vec<f64> =
            ends.iter().map(|(_, place)| (place - x).norm_squared().max(f64::MIN_POSITIVE).recip()).collect();
        let sum: f64 = weights.iter().sum();
        let all = ends.iter().zip(weights).map(|((slot, place), w)| (*slot, w / sum, place));
        all.flat_map(|(slot, share, place)| Borne::shares(slot, share, &((x - place) * share))).collect()
    }
}

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
        let rotation = frame.rotation.to_rotation_matrix().into_inner().cast::<f32>();
        let place = frame.translation.vector.cast::<f32>();
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
fn middle(part: &LinkedPart, places: &Places) -> Isometry3<f64> {
    let frame = |i: usize| places.frame(part.ends[i]);
    match part.ends.len() {
        2 => frame(0) * exp(&(screw(frame(0), frame(1)) * 0.5)),
        _ => *frame(0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::link::ControlState;
    use super::*;
    use nalgebra::{Rotation3, UnitQuaternion};

    /// A common motion of the ends moves every place with it, of parts with one, two and three ends; a beam bent to an arc goes along
    /// the arc to third order.
    #[test]
    fn places_go_with_their_ends() {
        let frame = |x: f64, y: f64| Isometry3::translation(x, y, 0.2);
        let rest = Places {
            interfaces: vec![frame(0.0, 0.0), frame(1.0, 0.1), frame(0.4, 1.0)],
            controls: vec![ControlState { frame: frame(-1.0, 0.0), stretch: [0.0; 6] }],
        };
        let ends = vec![
            vec![PartEnd::Control(0), PartEnd::Interface(0)],
            vec![PartEnd::Interface(0), PartEnd::Interface(1), PartEnd::Interface(2)],
            vec![PartEnd::Interface(2)],
        ];
        let surface = [[-0.5, 0.0, 0.0], [0.4, 0.3, 0.0], [0.4, 1.3, 0.0]];
        let part = |node: u32| StoredPart { nodes: vec![node], shares: vec![1.0], ..StoredPart::default() };
        let shares = Shares::new(&[part(0), part(1), part(2)], &ends, &rest, &surface);
        let motion = Isometry3::new(V3::new(0.3, -2.0, 0.7), V3::new(0.4, 1.1, -0.6));
        let came = |x: &V3, frames: &[Isometry3<f64>]| -> V3 {
            shares
                .at(x)
                .iter()
                .map(|(slot, share)| {
                    let (frame, column) = (frames[slot / SLOTS], slot % SLOTS);
                    let rotation = Rotation3::from(frame.rotation);
                    match column {
                        0 => frame.translation.vector * *share,
                        _ => rotation.matrix().column(column - 1) * *share,
                    }
                })
                .sum()
        };
        let at_rest = rest.interfaces.iter().chain(rest.controls.iter().map(|control| &control.frame));
        let frames: Vec<Isometry3<f64>> = at_rest.map(|frame| motion * frame).collect();
        for x in
            [V3::new(-0.7, 0.2, 0.1), V3::new(-1.4, 0.1, 0.0), V3::new(0.5, 0.4, 0.3), V3::new(0.4, 1.5, 0.1)]
        {
            let off = (came(&x, &frames) - (motion * nalgebra::Point3::from(x)).coords).norm();
            assert!(off < 1e-12, "{x}: {off}");
        }
        let off = |angle: f64| {
            let arc = |s: f64| {
                let place = V3::new((s * angle).sin() / angle, (1.0 - (s * angle).cos()) / angle, 0.2);
                Isometry3::from_parts(
                    (place - V3::x()).into(),
                    UnitQuaternion::from_scaled_axis(V3::z() * s * angle),
                )
            };
            let mut frames = frames.clone();
            (frames[3], frames[0]) = (arc(0.0), arc(1.0));
            (came(&V3::new(-0.7, 0.0, 0.2), &frames) - arc(0.3).translation.vector).norm()
        };
        assert!(off(0.4) < 1e-3 && off(0.4) > 7.0 * off(0.2), "{} {}", off(0.4), off(0.2));
    }
}
