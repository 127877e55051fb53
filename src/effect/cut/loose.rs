//! Parts of a cut body that nothing holds: they bear nothing, weigh nothing on the rest, and stay where they are until they fall.
//!
//! In: the loose parts of a [`Split`]. Out: the masses that the body has lost, and the motions that H - G X lets free. A rigid motion R of a
//! part is no strain, so that H - G X maps
//!
//! ```text
//! w_R = R at the part's copies, -R at copies that others have of what the part moves, 0 elsewhere
//! ```
//!
//! to 0. The forces on the rest are orthogonal to all w_R once the part weighs nothing: the equations have a solution, and all of them
//! move the rest of the body in the same way, as if the part were not there.

use super::descent::Descent;
use super::matter::Matter;
use crate::mesh::split::{LoosePart, Split, TetCorner};
use nalgebra::{DMatrix, DVector, Vector3};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Masses by nodes of a base, kg.
pub type Masses = BTreeMap<u32, f64>;

/// Mass of the loose parts that have not fallen off the base by its nodes, kg: ∫ N ρ dV. Empty where nothing is heavy.
pub fn lost(of: &Matter, split: &Split, base: &Split, descent: &Descent) -> Masses {
    let parts = split.loose.iter().zip(&descent.is_gone).filter(|(_, is_gone)| !**is_gone);
    masses(of, split, parts.map(|(part, _)| part), base)
}

/// Mass of parts by the nodes of a base, kg.
pub fn masses<'a>(
    of: &Matter,
    split: &'a Split,
    parts: impl Iterator<Item = &'a LoosePart>,
    base: &Split,
) -> Masses {
    let mut lost = Masses::new();
    for (corner, shares) in parts.flat_map(|part| shares(split, part)) {
        let (tet, mass) = (corner.0, of.mass(corner.0));
        let nodes = base.nodes_at(corner, of.splitter.mesh.tets[tet as usize]);
        for (node, share) in nodes.iter().zip(shares) {
            *lost.entry(*node).or_insert(0.0) += mass * share;
        }
    }
    lost.retain(|_, mass| *mass != 0.0);
    lost
}

/// Forces and moments of gravity along each axis on a mass at a place: 12 × 3.
pub fn moments_of(mass: f64, x: &V3) -> DMatrix<f64> {
    let mut moments = DMatrix::zeros(12, 3);
    for axis in 0..3 {
        moments[(axis, axis)] = mass;
        (0..3).for_each(|k| moments[(3 + 3 * axis + k, axis)] = mass * x[k]);
    }
    moments
}

/// A corner of each tetrahedron and piece of a part, and the shares of its nodes in it.
pub fn shares<'a>(split: &'a Split, part: &'a LoosePart) -> impl Iterator<Item = (TetCorner, [f64; 4])> + 'a {
    let whole = part.tets.iter().map(|tet| ((*tet, 0), [0.25; 4]));
    whole.chain(part.pieces.iter().map(|number| {
        let piece = &split.pieces[*number];
        (piece.corner(), piece.shares)
    }))
}

/// w_R of six rigid motions of each loose part that has not fallen off the base.
pub fn rigid_motions(of: &Matter, split: &Split, descent: &Descent) -> Vec<DVector<f64>> {
    let parts = split.loose.iter().zip(&descent.is_gone).filter(|(_, is_gone)| !**is_gone);
    parts.flat_map(|(part, _)| motions_of(of, split, descent, part)).collect()
}

fn motions_of(of: &Matter, split: &Split, descent: &Descent, part: &LoosePart) -> [DVector<f64>; 6] {
    let has = |node: u32| f64::from(u8::from(part.nodes.binary_search(&node).is_ok()));
    // Sign of each copy, where it takes part, and its place.
    let signed: Vec<(usize, f64, V3)> = descent
        .copies
        .iter()
        .enumerate()
        .map(|(i, (copy, leads))| (i, has(*copy) - has(*leads), of.splitter.place(split, *copy)))
        .filter(|(_, sign, _)| *sign != 0.0)
        .collect();
    let centre = signed.iter().map(|(_, _, x)| x).sum::<V3>() / signed.len().max(1) as f64;
    std::array::from_fn(|k| {
        let mut motion = DVector::zeros(3 * descent.copies.len());
        for (copy, sign, x) in &signed {
            let way = if k < 3 { V3::ith(k, 1.0) } else { V3::ith(k - 3, 1.0).cross(&(x - centre)) };
            motion.fixed_rows_mut::<3>(3 * copy).copy_from(&(way * *sign));
        }
        motion
    })
}
