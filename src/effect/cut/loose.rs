//! Parts of a cut body that nothing holds: they bear nothing, weigh nothing on the rest, and stay where they are until they fall.
//!
//! In: the loose parts of a [`Split`]. Out: the masses that the body has lost, and the motions that H - G X lets free. A rigid motion R of a
//! part is no strain, so that H - G X maps
//!
//! ```text
//! w_R = R at the part's copies, -R at copies of its nodes that others have, 0 elsewhere
//! ```
//!
//! to 0. The forces on the rest are orthogonal to all w_R once the part weighs nothing: the equations have a solution, and all of them
//! move the rest of the body in the same way, as if the part were not there.

use crate::mesh::split::{LoosePart, Split, Splitter};
use nalgebra::{DVector, Vector3};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Mass of the loose parts by nodes of the mesh, kg: ∫ N ρ dV. Empty where nothing is heavy.
pub fn lost(splitter: &Splitter, split: &Split, mass: impl Fn(u32) -> f64) -> BTreeMap<u32, f64> {
    let mut lost = BTreeMap::new();
    for part in &split.loose {
        for (tet, shares) in shares(split, part) {
            let mass = mass(tet);
            for (node, share) in splitter.mesh.tets[tet as usize].iter().zip(shares) {
                *lost.entry(*node).or_insert(0.0) += mass * share;
            }
        }
    }
    lost.retain(|_, mass| *mass != 0.0);
    lost
}

/// The tetrahedra of a part, and the shares of their nodes in it.
pub fn shares<'a>(split: &'a Split, part: &'a LoosePart) -> impl Iterator<Item = (u32, [f64; 4])> + 'a {
    let whole = part.tets.iter().map(|tet| (*tet, [0.25; 4]));
    whole.chain(part.pieces.iter().map(|piece| (split.pieces[*piece].tet, split.pieces[*piece].shares)))
}

/// w_R of six rigid motions of each part.
pub fn rigid_motions(splitter: &Splitter, split: &Split) -> Vec<DVector<f64>> {
    split.loose.iter().flat_map(|part| motions_of(splitter, split, part)).collect()
}

fn motions_of(splitter: &Splitter, split: &Split, part: &LoosePart) -> [DVector<f64>; 6] {
    let count = splitter.mesh.nodes.len();
    let has = |node: u32| part.nodes.binary_search(&node).is_ok();
    // Sign of each copy, where it takes part, and its place.
    let signed: Vec<(usize, f64, V3)> = (count as u32..)
        .zip(&split.copies)
        .enumerate()
        .map(|(copy, (number, node))| {
            let sign = f64::from(u8::from(has(number))) - f64::from(u8::from(has(*node)));
            (copy, sign, splitter.mesh.nodes[*node as usize])
        })
        .filter(|(_, sign, _)| *sign != 0.0)
        .collect();
    let centre = signed.iter().map(|(_, _, x)| x).sum::<V3>() / signed.len().max(1) as f64;
    std::array::from_fn(|k| {
        let mut motion = DVector::zeros(3 * split.copies.len());
        for (copy, sign, x) in &signed {
            let way = if k < 3 { V3::ith(k, 1.0) } else { V3::ith(k - 3, 1.0).cross(&(x - centre)) };
            motion.fixed_rows_mut::<3>(3 * copy).copy_from(&(way * *sign));
        }
        motion
    })
}
