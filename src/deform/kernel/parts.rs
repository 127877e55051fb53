//! The rigid parts of a body: x_i = Σ_p w_ip (R_p y_i + t_p) of deformed places y_i.
//!
//! In: weights, the motion of every part and places. Out: the places moved. Bodies of one part never come here. The twin on
//! the graphics device is `shaders/parts.wgsl`.
//!
//! Where the device deforms the surface, a sum at a few nodes ([`PartialSum`]) is all that picking needs.

use super::superposition::{SumStats, Superposition};
use crate::base::columns::ColumnGroup;
use crate::base::parts::{PartMotion, PartShare, PartWeights};
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// Nodes that are worth a thread of their own.
const NODES_PER_THREAD: usize = 1 << 14;

/// Moves the places of all nodes.
pub fn move_parts(weights: &PartWeights, parts: &[Isometry3<f64>], places: &mut [[f32; 3]]) {
    let motions: Vec<PartMotion> = parts.iter().map(PartMotion::from).collect();
    places
        .par_iter_mut()
        .enumerate()
        .with_min_len(NODES_PER_THREAD)
        .for_each(|(node, place)| *place = moved(weights.at(node), &motions, *place));
}

/// One node moved, in single precision as the device does it.
pub fn moved(shares: &[PartShare], motions: &[PartMotion], place: [f32; 3]) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for share in shares {
        let at = motions[share.part as usize].apply(place);
        for axis in 0..3 {
            sum[axis] += share.weight * at[axis];
        }
    }
    sum
}

/// One node moved in double precision.
pub fn moved_exactly(shares: &[PartShare], parts: &[Isometry3<f64>], place: Vector3<f64>) -> Vector3<f64> {
    let part = |share: &PartShare| {
        let motion = &parts[share.part as usize];
        (motion.rotation * place + motion.translation.vector) * f64::from(share.weight)
    };
    shares.iter().map(part).sum()
}

/// The columns of some nodes, read once, and their sum.
pub struct PartialSum {
    pub nodes: Vec<u32>,
    /// The columns of these nodes, group by group.
    columns: Vec<Vec<f32>>,
    sum: Superposition,
    u: Vec<[f32; 3]>,
}

impl PartialSum {
    /// A sum at `nodes` of a surface of `all` nodes.
    pub fn new(nodes: Vec<u32>, groups: &[ColumnGroup<'_>], all: usize) -> PartialSum {
        let gathered = |group: &ColumnGroup<'_>| {
            let of =
                |k: usize, node: u32| [0, 1, 2].map(|axis| group.value(all, k, 3 * node as usize + axis));
            let columns = 0..group.columns(all).unwrap_or(0);
            columns.flat_map(|k| nodes.iter().flat_map(move |&node| of(k, node))).collect()
        };
        let columns: Vec<Vec<f32>> = groups.iter().map(gathered).collect();
        let sum = Superposition::new(&borrowed(&columns), nodes.len());
        let u = vec![[0.0; 3]; nodes.len()];
        PartialSum { nodes, columns, sum, u }
    }

    /// Writes the displacements of its nodes into `u` of the whole surface, and where they come to into `positions`.
    pub fn update(
        &mut self,
        c: &[f64],
        rest: &[[f32; 3]],
        u: &mut [[f32; 3]],
        positions: &mut [[f32; 3]],
    ) -> SumStats {
        let stats = self.sum.update(&borrowed(&self.columns), c, &mut self.u);
        for (&node, moved) in self.nodes.iter().zip(&self.u) {
            let node = node as usize;
            u[node] = *moved;
            positions[node] = [0, 1, 2].map(|axis| rest[node][axis] + moved[axis]);
        }
        stats
    }
}

fn borrowed(columns: &[Vec<f32>]) -> Vec<ColumnGroup<'_>> {
    columns.iter().map(|values| ColumnGroup::F32(values)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_go_with_their_parts_and_between_them() {
        let parts = [
            Isometry3::new(Vector3::new(1.0, 0.0, 0.0), Vector3::zeros()),
            Isometry3::new(Vector3::new(0.0, 2.0, 0.0), Vector3::z() * std::f64::consts::FRAC_PI_2),
        ];
        let rows = [vec![(0, 1.0)], vec![(1, 1.0)], vec![(0, 0.25), (1, 0.75)]];
        let weights = PartWeights::new(2, &rows).unwrap();
        let mut places = [[0.5, 0.0, 0.25]; 3];
        move_parts(&weights, &parts, &mut places);
        let expected = [[1.5, 0.0, 0.25], [0.0, 2.5, 0.25], [0.375, 1.875, 0.25]];
        for (node, (place, expected)) in places.iter().zip(expected).enumerate() {
            let exact = moved_exactly(weights.at(node), &parts, Vector3::new(0.5, 0.0, 0.25));
            for axis in 0..3 {
                assert!((place[axis] - expected[axis]).abs() < 1e-6, "{place:?}");
                assert!((f64::from(place[axis]) - exact[axis]).abs() < 1e-6, "{place:?} {exact}");
            }
        }
    }

    #[test]
    fn the_chosen_nodes_come_to_where_the_whole_sum_brings_them() {
        const NODES: usize = 40;
        const COLUMNS: usize = 11;
        let values = |e: i32| -> Vec<i16> {
            (0..COLUMNS as i32 * 120).map(|i| ((i * 37 + e) % 1009 - 500) as i16).collect()
        };
        let (data, scales) = ([values(1), values(2)], [1e-3; COLUMNS]);
        let groups: Vec<ColumnGroup> =
            data.iter().map(|values| ColumnGroup::Int16 { values, scales: &scales }).collect();
        let c: Vec<f64> = (0..2 * COLUMNS).map(|i| 0.1 * (i % COLUMNS + i / COLUMNS) as f64 - 0.4).collect();
        let mut whole = vec![[0.0; 3]; NODES];
        Superposition::new(&groups, NODES).update(&groups, &c, &mut whole);
        let rest = vec![[1.0; 3]; NODES];
        let (mut u, mut positions) = (vec![[0.0; 3]; NODES], rest.clone());
        let nodes = vec![0, 3, 17, 39];
        PartialSum::new(nodes.clone(), &groups, NODES).update(&c, &rest, &mut u, &mut positions);
        for node in 0..NODES {
            let chosen = nodes.contains(&(node as u32));
            for axis in 0..3 {
                let moved = if chosen { whole[node][axis] } else { 0.0 };
                assert!(
                    (u[node][axis] - moved).abs() < 1e-6
                        && (positions[node][axis] - 1.0 - moved).abs() < 1e-6
                );
            }
        }
    }
}
