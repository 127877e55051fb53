//! A surface summed at a few of its nodes: all that picking needs where the graphics device deforms the whole.

use super::superposition::{SumStats, Superposition};
use crate::base::columns::ColumnGroup;

/// The columns of some nodes, read once, and their sum.
pub(super) struct PartialSum {
    pub(super) nodes: Vec<u32>,
    /// The columns of these nodes, group by group.
    columns: Vec<Vec<f32>>,
    sum: Superposition,
    u: Vec<[f32; 3]>,
}

impl PartialSum {
    /// A sum at `nodes` of a surface of `all` nodes.
    pub(super) fn new(nodes: Vec<u32>, groups: &[ColumnGroup<'_>], all: usize) -> PartialSum {
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
    pub(super) fn update(
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
