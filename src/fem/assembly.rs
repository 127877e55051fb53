//! Assembly of the stiffness matrix K from sets of elements, and the split of the nodes that turns K into A, B, C
//! ([`Partition`]).

use super::energy::Strains;
use super::stiffness::{NodeFields, StiffnessMatrix};
use nalgebra::Matrix3;
use rayon::prelude::*;
use std::cmp::Ordering;

#[derive(Debug, thiserror::Error)]
pub enum AssemblyError {
    #[error(
        "tetrahedron {index} (nodes with tags {tags:?}) has volume {volume:.3e} m³, relative volume \
         {relative:.1e}: remove it or move a node"
    )]
    Degenerate { index: usize, tags: [u64; 4], volume: f64, relative: f64 },
    #[error(
        "{element} is of order {needed}, the mesh of order {order}: quadratic elements need nodes \
         between the corners"
    )]
    Order { element: &'static str, needed: u32, order: u32 },
    #[error(
        "the strain energy of {element} on this mesh is no quartic, as \"reduced\" and \"perturbation\" \
         need. Write element = \"tet10\" with straight edges, or model = \"rotation\""
    )]
    NoQuartic { element: &'static str },
}

/// A set of elements of one kind, each of which adds a symmetric matrix of 3×3 blocks on its own nodes to K.
pub trait Elements: Sync {
    fn count(&self) -> usize;

    /// The mesh nodes of one element, each node once.
    fn nodes(&self, element: usize) -> &[u32];

    /// `out[b]` = K_ab of one element for its local node `a` and all its local nodes b, N/m. Not read, so it may hold
    /// anything, where mesh node b lies below mesh node a.
    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]);
}

/// A set of elements that can be assembled and whose strains are known.
pub trait ElementSet: Elements + Strains {}

/// K = Σ K_e over all sets of elements, on nodes 0..`nodes`.
pub fn assemble_elements<E: Elements + ?Sized>(nodes: usize, sets: &[Box<E>]) -> StiffnessMatrix {
    Pattern::from_sets(nodes, sets).assemble(sets)
}

/// The blocks of K, and the elements of which each row is summed: kept where K is assembled many times.
#[derive(Debug)]
pub struct Pattern {
    zero: StiffnessMatrix,
    incident: Vec<Incidence>,
}

/// Rows of K that one thread sums at a time.
const ROWS: usize = 64;

impl Pattern {
    /// The pattern of `sets` on nodes 0..`nodes`.
    pub fn from_sets<E: Elements + ?Sized>(nodes: usize, sets: &[Box<E>]) -> Pattern {
        let incident: Vec<Incidence> = sets.iter().map(|set| incidence(nodes, set.as_ref())).collect();
        Pattern { zero: StiffnessMatrix::zeros(nodes, edges(nodes, sets, &incident)), incident }
    }

    pub fn nodes(&self) -> usize {
        self.zero.nodes()
    }

    /// Assembles K of `sets`, which have the elements that the pattern was made of.
    ///
    /// Parallel over nodes: every node sums the blocks of its own row over its elements in ascending order, so the result has the
    /// same bits on every thread count.
    pub fn assemble<E: Elements + ?Sized>(&self, sets: &[Box<E>]) -> StiffnessMatrix {
        let mut matrix = self.zero.clone();
        let StiffnessMatrix { diagonal, blocks, .. } = &mut matrix;
        let mut rest = blocks.as_mut_slice();
        let mut parts = Vec::with_capacity(diagonal.len().div_ceil(ROWS));
        for (part, diagonal) in diagonal.chunks_mut(ROWS).enumerate() {
            let last = (part * ROWS + diagonal.len()).min(self.nodes());
            let width = self.zero.edge_start[last] - self.zero.edge_start[part * ROWS];
            let (own, others) = rest.split_at_mut(width);
            parts.push((part * ROWS, diagonal, own));
            rest = others;
        }
        let scratch = || (Vec::new(), vec![0; self.nodes()]);
        parts.into_par_iter().for_each_init(scratch, |(row, slots), (first, diagonal, blocks)| {
            for (node, diagonal) in (first..).zip(diagonal) {
                let span = self.zero.edge_start[node]..self.zero.edge_start[node + 1];
                let before = span.start - self.zero.edge_start[first];
                for (slot, edge) in self.zero.edges[span].iter().enumerate() {
                    slots[edge[1] as usize] = before + slot;
                }
                self.add_row(node, sets, row, &mut |other, block| match other.cmp(&node) {
                    Ordering::Less => {}
                    Ordering::Equal => *diagonal += block,
                    Ordering::Greater => blocks[slots[other]] += block,
                });
            }
        });
        matrix
    }

    /// Gives each block of a node's row to `add`, element by element.
    fn add_row<E: Elements + ?Sized>(
        &self,
        node: usize,
        sets: &[Box<E>],
        row: &mut Vec<Matrix3<f64>>,
        add: &mut dyn FnMut(usize, &Matrix3<f64>),
    ) {
        for (set, incident) in sets.iter().zip(&self.incident) {
            for &(element, a) in incident.elements_at(node) {
                let nodes = set.nodes(element as usize);
                row.resize(nodes.len(), Matrix3::zeros());
                set.row(element as usize, a as usize, row);
                for (&other, block) in nodes.iter().zip(row.iter()) {
                    add(other as usize, block);
                }
            }
        }
    }
}

/// The elements around every node, ascending, each with the node's local number in it.
#[derive(Debug)]
struct Incidence {
    start: Vec<usize>,
    elements: Vec<(u32, u32)>,
}

impl Incidence {
    fn elements_at(&self, node: usize) -> &[(u32, u32)] {
        &self.elements[self.start[node]..self.start[node + 1]]
    }
}

fn incidence<E: Elements + ?Sized>(nodes: usize, set: &E) -> Incidence {
    let mut start = vec![0; nodes + 1];
    for &node in (0..set.count()).flat_map(|element| set.nodes(element)) {
        start[node as usize + 1] += 1;
    }
    for i in 0..nodes {
        start[i + 1] += start[i];
    }
    let mut next = start.clone();
    let mut elements = vec![(0, 0); start[nodes]];
    for element in 0..set.count() {
        for (local, &node) in set.nodes(element).iter().enumerate() {
            elements[next[node as usize]] = (element as u32, local as u32);
            next[node as usize] += 1;
        }
    }
    Incidence { start, elements }
}

/// All pairs i < j of nodes with a common element, sorted.
fn edges<E: Elements + ?Sized>(nodes: usize, sets: &[Box<E>], incident: &[Incidence]) -> Vec<[u32; 2]> {
    let per_node: Vec<Vec<[u32; 2]>> = (0..nodes)
        .into_par_iter()
        .with_min_len(64)
        .map(|node| {
            let mut above: Vec<u32> = Vec::new();
            for (set, incident) in sets.iter().zip(incident) {
                let around =
                    incident.elements_at(node).iter().flat_map(|&(element, _)| set.nodes(element as usize));
                above.extend(around.filter(|&&other| other as usize > node));
            }
            above.sort_unstable();
            above.dedup();
            above.into_iter().map(|other| [node as u32, other]).collect()
        })
        .collect();
    per_node.concat()
}

/// Free nodes (displacement u unknown, no external force) and controlled nodes (displacement b prescribed):
///
/// ```text
/// | A   B | | u |   |  0  |     A u = -B b,    f_b = Bᵀ u + C b
/// | Bᵀ  C | | b | = | f_b |
/// ```
///
/// Neither B nor C is stored: B b is K applied to b extended by zero, and f_b is K applied to (u, b), both read at the rows
/// that are needed.
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
