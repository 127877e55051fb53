//! The surface of a body in patches, so that an eye is not given triangles that it cannot see.
//!
//! In: triangles, rest surface and columns once, coefficients in every frame. Out: the triangles in an order in which each
//! patch is one piece, and a box around every patch however the body is bent, without a look at any vertex: for the nodes
//! of a patch, each component of u = Σ cₖ u⁽ᵏ⁾ lies in Σ cₖ [min u⁽ᵏ⁾, max u⁽ᵏ⁾] by interval arithmetic. Where the
//! columns vary little over a patch the box is little larger than the patch. Of a body of several parts the box is around
//! what each part makes of it.

use super::columns::extent;
use super::parts::moved_bounds;
use super::view::Bounds;
use crate::base::columns::ColumnGroup;
use crate::base::parts::{PartMotion, PartWeights};
use nalgebra::Vector3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;

/// A body is halved so often, if it has the triangles.
const HALVINGS: usize = 6;
/// Fewer triangles are not worth a draw of their own.
const LEAST_TRIANGLES: usize = 128;

/// A part of a body that is drawn or left out as a whole.
pub(super) struct Patch {
    /// Range in the body's index buffer.
    pub(super) indices: Range<u32>,
    /// Around it as it is now, in the body's frame.
    pub(super) bounds: Bounds,
}

/// Patch by patch the triangles, in their old order within each, and the length of each patch: halves, again and again,
/// on both sides of the median along the longest side.
pub(super) fn split(triangles: &[[u32; 3]], rest: &[[f32; 3]]) -> (Vec<[u32; 3]>, Vec<usize>) {
    let middle = |triangle: &[u32; 3]| -> [f32; 3] {
        let corners = triangle.map(|node| rest[node as usize]);
        [0, 1, 2].map(|axis| corners.iter().map(|corner| corner[axis]).sum())
    };
    let middles: Vec<[f32; 3]> = triangles.iter().map(middle).collect();
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut pieces: Vec<&mut [u32]> = vec![&mut order];
    for _ in 0..HALVINGS {
        pieces = pieces.into_iter().flat_map(|piece| halved(piece, &middles)).collect();
    }
    let lengths = pieces.iter().map(|piece| piece.len()).collect();
    pieces.into_iter().for_each(<[u32]>::sort_unstable);
    (order.iter().map(|&k| triangles[k as usize]).collect(), lengths)
}

/// A piece on both sides of its median, or whole where it is small.
fn halved<'a>(piece: &'a mut [u32], middles: &[[f32; 3]]) -> Vec<&'a mut [u32]> {
    if piece.len() < 2 * LEAST_TRIANGLES {
        return vec![piece];
    }
    let places: Vec<[f32; 3]> = piece.iter().map(|&k| middles[k as usize]).collect();
    let longest = Bounds::around(&places).half.imax();
    let along = |k: &u32| middles[*k as usize][longest];
    let half = piece.len() / 2;
    piece.select_nth_unstable_by(half, |a, b| along(a).total_cmp(&along(b)));
    let (low, high) = piece.split_at_mut(half);
    vec![low, high]
}

/// Least and largest value along each axis.
type Extent = [Vector3<f32>; 2];

/// The extent to which a patch can move.
pub(super) struct Reach {
    rest: Extent,
    /// Extent of each column, m per unit of its coefficient.
    columns: Vec<Extent>,
    /// The parts that move its nodes; empty if the body is one part.
    parts: Vec<u32>,
}

/// One for each patch of `lengths` triangles.
pub(super) fn reaches(
    triangles: &[[u32; 3]],
    lengths: &[usize],
    rest: &[[f32; 3]],
    groups: &[ColumnGroup<'_>],
    weights: Option<&PartWeights>,
) -> Vec<Reach> {
    let mut left = triangles;
    let patches: Vec<&[[u32; 3]]> = lengths
        .iter()
        .map(|&length| {
            let (patch, after) = left.split_at(length);
            left = after;
            patch
        })
        .collect();
    patches.into_par_iter().map(|patch| Reach::new(patch, rest, groups, weights)).collect()
}

impl Reach {
    fn new(
        patch: &[[u32; 3]],
        rest: &[[f32; 3]],
        groups: &[ColumnGroup<'_>],
        weights: Option<&PartWeights>,
    ) -> Reach {
        let mut nodes = patch.as_flattened().to_vec();
        nodes.sort_unstable();
        nodes.dedup();
        let of_group = |group: &ColumnGroup<'_>| -> Vec<Extent> {
            let columns = group.numbers() / (3 * rest.len());
            (0..columns).map(|column| extent(group, column, &nodes, rest.len()).map(Vector3::from)).collect()
        };
        let at_rest = extent(&ColumnGroup::F32(rest.as_flattened()), 0, &nodes, rest.len());
        let shares = |weights: &PartWeights| -> BTreeSet<u32> {
            let moving = nodes.iter().flat_map(|&node| weights.at(node as usize));
            moving.filter(|share| share.weight > 0.0).map(|share| share.part).collect()
        };
        Reach {
            rest: at_rest.map(Vector3::from),
            columns: groups.iter().flat_map(of_group).collect(),
            parts: weights.map(shares).unwrap_or_default().into_iter().collect(),
        }
    }

    /// A box around the patch for a coefficient per column and the motions of the parts. It is wider by what rounding may do: n products added up in
    /// f32 are off by no more than (n + 3) ε/2 of the sum of their sizes, on the device as here.
    pub(super) fn bounds(&self, coefficients: &[f32], motions: &[PartMotion]) -> Bounds {
        let [mut low, mut high] = self.rest;
        let mut size = low.abs().sup(&high.abs());
        let mut terms = 0;
        for ([least, largest], &c) in self.columns.iter().zip(coefficients).filter(|(_, c)| **c != 0.0) {
            let (a, b) = (least * c, largest * c);
            low += a.inf(&b);
            high += a.sup(&b);
            size += a.abs().sup(&b.abs());
            terms += 1;
        }
        let slack = size * ((terms + 4) as f32 * f32::EPSILON);
        let bounds = Bounds { centre: (low + high) / 2.0, half: (high - low) / 2.0 + slack };
        if self.parts.is_empty() { bounds } else { moved_bounds(&bounds, &self.parts, motions) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::TAU;

    /// A closed strip of triangles around a tube, `along` × `around` nodes.
    fn tube(around: usize, along: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let place = |i: usize| {
            let (sin, cos) = (TAU * (i % around) as f32 / around as f32).sin_cos();
            [(i / around) as f32 / (along - 1) as f32 - 0.5, 0.1 * cos, 0.1 * sin]
        };
        let cell = |i: usize| {
            let next = i / around * around + (i + 1) % around;
            [[i, i + around, next], [next, i + around, next + around]].map(|t| t.map(|node| node as u32))
        };
        let rest = (0..around * along).map(place).collect();
        (rest, (0..around * (along - 1)).flat_map(cell).collect())
    }

    /// Twelve columns of a unit affine motion for each of two ends, the share falling off along the tube.
    fn columns(rest: &[[f32; 3]]) -> [Vec<f32>; 2] {
        let number = |e: usize, k: usize, x: &[f32; 3], axis: usize| {
            let share = if e == 0 { 0.5 - x[0] } else { 0.5 + x[0] };
            let value = if k < 3 { 1.0 } else { x[(k - 3) % 3] };
            if axis == if k < 3 { k } else { (k - 3) / 3 } { share * value } else { 0.0 }
        };
        [0, 1].map(|e| {
            let of = |k: usize| rest.iter().flat_map(move |x| [0, 1, 2].map(|axis| number(e, k, x, axis)));
            (0..12).flat_map(of).collect()
        })
    }

    /// A small generator of equally distributed numbers in -1 to 1, the same on every run.
    fn random(state: &mut u64) -> f32 {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    }

    fn moved(rest: &[[f32; 3]], columns: &[Vec<f32>], c: &[f32]) -> Vec<[f32; 3]> {
        let nodes = rest.len();
        let term = |k: usize, i: usize| f64::from(c[k]) * f64::from(columns[k / 12][k % 12 * 3 * nodes + i]);
        let at = |i: usize| rest.as_flattened()[i] + (0..c.len()).map(|k| term(k, i)).sum::<f64>() as f32;
        (0..nodes).map(|node| [0, 1, 2].map(|axis| at(3 * node + axis))).collect()
    }

    #[test]
    fn patches_hold_every_triangle_once_in_pieces_of_a_size() {
        let (rest, triangles) = tube(60, 100);
        let (ordered, lengths) = split(&triangles, &rest);
        assert_eq!(lengths.len(), 64);
        assert_eq!(lengths.iter().sum::<usize>(), triangles.len());
        assert!(lengths.iter().all(|length| (185..=186).contains(length)), "{lengths:?}");
        let sorted = |mut all: Vec<[u32; 3]>| {
            all.sort_unstable();
            all
        };
        assert_eq!(sorted(ordered.clone()), sorted(triangles.clone()));
        assert_eq!(ordered, split(&triangles, &rest).0, "the same on every run");
        let (few, one) = split(&triangles[..200], &rest);
        assert_eq!((few.as_slice(), one.as_slice()), (&triangles[..200], &[200][..]), "too few to be split");
    }

    /// However the body is bent, every vertex of a patch is in its box; and the boxes are not much larger than they must
    /// be: their sides are compared with those of the smallest boxes, and with those of the one box that held the rest
    /// surface grown by Σ |cₖ| max |u⁽ᵏ⁾|.
    #[test]
    fn boxes_hold_their_patches_however_the_body_is_bent() {
        let (rest, triangles) = tube(40, 160);
        let data = columns(&rest);
        let (ordered, lengths) = split(&triangles, &rest);
        let mut state = 11;
        for storage in 0..3 {
            let halves = data
                .each_ref()
                .map(|column| column.iter().map(|x| half::f16::from_f32(*x).to_bits()).collect::<Vec<_>>());
            let integers = data
                .each_ref()
                .map(|column| column.iter().map(|x| (x * 3e4).round() as i16).collect::<Vec<_>>());
            let scales = [1.0 / 3e4; 12];
            let ones = [1.0; 12];
            let groups: Vec<ColumnGroup<'_>> = (0..2)
                .map(|e| match storage {
                    0 => ColumnGroup::F32(&data[e]),
                    1 => ColumnGroup::F16 { bits: &halves[e], scales: &ones },
                    _ => ColumnGroup::Int16 { values: &integers[e], scales: &scales },
                })
                .collect();
            let stored = [0, 1].map(|e| match storage {
                0 => data[e].clone(),
                1 => halves[e].iter().map(|bits| half::f16::from_bits(*bits).to_f32()).collect(),
                _ => integers[e].iter().map(|x| f32::from(*x) * (1.0 / 3e4)).collect(),
            });
            let reaches = reaches(&ordered, &lengths, &rest, &groups, None);
            let (mut ours, mut least) = (0.0, 0.0);
            for round in 0..40 {
                // A whole turn and a shift of both ends together, and something of each end's own.
                let both: [f32; 12] = std::array::from_fn(|_| random(&mut state));
                let own = 0.3 * (round % 4) as f32;
                let c: Vec<f32> = (0..24).map(|k| both[k % 12] + own * random(&mut state)).collect();
                let at = moved(&rest, &stored, &c);
                let mut first = 0;
                for (reach, &length) in reaches.iter().zip(&lengths) {
                    let bounds = reach.bounds(&c, &[]);
                    let corners = ordered[first..first + length].as_flattened();
                    let points: Vec<[f32; 3]> = corners.iter().map(|&node| at[node as usize]).collect();
                    for point in &points {
                        let away = (Vector3::from(*point) - bounds.centre).abs() - bounds.half;
                        assert!(away.max() <= 0.0, "{point:?} is {away} outside of {bounds:?}");
                    }
                    ours += bounds.half.sum();
                    least += Bounds::around(&points).half.sum();
                    first += length;
                }
            }
            println!("storage {storage}: {:.2} times the smallest boxes", ours / least);
            assert!(ours < 3.0 * least, "{ours} against {least}");
        }
    }
}
