//! The split of the nodes that turns K into A, B, C:
//!
//! ```text
//! | A   B | | u |   |  0  |     A u = -B b,    f_b = Bᵀ u + C b
//! | Bᵀ  C | | b | = | f_b |
//! ```
//!
//! Neither B nor C is stored: B b is K applied to b extended by zero, and f_b is K applied to (u, b), both read
//! at the rows that are asked for.

use super::fields::NodeFields;
use super::stiffness::StiffnessMatrix;

/// Free nodes (displacement unknown, no external force) and controlled nodes (displacement prescribed).
#[derive(Clone, Debug, PartialEq)]
pub struct Partition {
    /// Ascending.
    pub free: Vec<u32>,
    /// Ascending.
    pub controlled: Vec<u32>,
}

impl Partition {
    /// Splits the nodes 0..`nodes`; `controlled` may come in any order.
    pub fn new(nodes: usize, controlled: impl IntoIterator<Item = u32>) -> Partition {
        let mut is_controlled = vec![false; nodes];
        for node in controlled {
            is_controlled[node as usize] = true;
        }
        let (controlled, free) = (0..nodes as u32).partition(|&node| is_controlled[node as usize]);
        Partition { free, controlled }
    }

    /// A = K restricted to the free nodes.
    pub fn a(&self, k: &StiffnessMatrix) -> StiffnessMatrix {
        k.restrict(&self.free)
    }

    /// Right-hand side -B b over the free nodes, from b given over all nodes and zero on the free ones.
    pub fn minus_b_times(&self, k: &StiffnessMatrix, prescribed: &NodeFields) -> NodeFields {
        let mut product = NodeFields::zeros(prescribed.nodes, prescribed.columns);
        k.multiply(prescribed, &mut product);
        let mut rhs = product.at(&self.free);
        rhs.data.iter_mut().for_each(|value| *value = -*value);
        rhs
    }

    /// Writes the solution over the free nodes into `fields` over all nodes.
    pub fn insert_free(&self, solution: &NodeFields, fields: &mut NodeFields) {
        for (from, &to) in self.free.iter().enumerate() {
            for axis in 0..3 {
                fields.row_mut(3 * to as usize + axis).copy_from_slice(solution.row(3 * from + axis));
            }
        }
    }

    /// f_b = Bᵀ u + C b over the controlled nodes, from the whole displacement (u, b).
    pub fn reaction(&self, k: &StiffnessMatrix, displacement: &NodeFields) -> NodeFields {
        let mut force = NodeFields::zeros(displacement.nodes, displacement.columns);
        k.multiply(displacement, &mut force);
        force.at(&self.controlled)
    }
}
