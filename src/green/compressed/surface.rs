//! The surface that is compressed, and the frames in which a force moves the node under it by about 1.

use super::tree::{Block, Tree};
use crate::fem::NodeFields;
use crate::solve::{Factor, Progress, SolveError};
use nalgebra::{Matrix3, SymmetricEigen};

/// Columns that are solved for together.
pub const TOGETHER: usize = 48;

type M3 = Matrix3<f64>;

/// The surface that is compressed, and the factor that solves for its columns.
pub struct Surface<'a> {
    pub factor: &'a dyn Factor,
    /// The nodes of A, in the order of the tree; those in front take forces.
    pub nodes: &'a [u32],
    pub n: usize,
    pub tree: &'a Tree,
    pub blocks: &'a [Block],
}

/// A symmetric frame T, and its inverse.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub own: M3,
    pub inverse: M3,
    /// The least and the largest stretch of T².
    pub yields: [f64; 2],
}

impl Frame {
    fn of(compliance: &M3) -> Frame {
        let eigen = SymmetricEigen::new((compliance + compliance.transpose()) * 0.5);
        let largest = eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
        let values = eigen.eigenvalues.map(|value| value.max(1e-9 * largest));
        let made = |of: fn(f64) -> f64| {
            eigen.eigenvectors * M3::from_diagonal(&values.map(of)) * eigen.eigenvectors.transpose()
        };
        Frame {
            own: made(f64::sqrt),
            inverse: made(|value| 1.0 / value.sqrt()),
            yields: [values.min(), values.max()],
        }
    }
}

/// The least and the largest yield of a cluster.
pub fn spans(tree: &Tree, frames: &[Frame], cluster: usize) -> [f64; 2] {
    let nodes = &tree.clusters[cluster].nodes;
    let own = tree.leaf_of[nodes.clone()].iter().map(|&leaf| frames[leaf].yields);
    own.fold([f64::INFINITY, 0.0], |all, own| [all[0].min(own[0]), all[1].max(own[1])])
}

/// The frame of each leaf, from how a node in its middle yields.
pub fn frames(of: &Surface<'_>, progress: &dyn Progress) -> Result<Vec<Frame>, SolveError> {
    let tree = of.tree;
    let nothing = Frame { own: M3::identity(), inverse: M3::identity(), yields: [1.0; 2] };
    let mut frames = vec![nothing; tree.clusters.len()];
    let leaves: Vec<usize> = tree.leaves().collect();
    progress.begin("how the surface yields", leaves.len() as u64);
    for chunk in leaves.chunks(TOGETHER / 3) {
        let middle = |&leaf: &usize| {
            let nodes = &tree.clusters[leaf].nodes;
            of.nodes[nodes.start + nodes.len() / 2]
        };
        let nodes: Vec<u32> = chunk.iter().map(middle).collect();
        let mut unit = NodeFields::zeros(nodes.len(), 3 * nodes.len());
        (0..3 * nodes.len()).for_each(|i| unit.row_mut(i)[i] = 1.0);
        let x = of.factor.solve_at(&nodes, &unit, &nodes)?;
        for (i, &leaf) in chunk.iter().enumerate() {
            frames[leaf] = Frame::of(&M3::from_fn(|axis, force| x.row(3 * i + axis)[3 * i + force]));
        }
        progress.advance(chunk.len() as u64);
    }
    progress.end();
    for cluster in (0..tree.clusters.len()).rev() {
        if let Some([first, _]) = tree.clusters[cluster].children {
            frames[cluster] = frames[first];
        }
    }
    Ok(frames)
}

/// Displacements by unit forces at these places, at all places from `from` on.
pub fn unit_columns(of: &Surface<'_>, places: &[usize], from: usize) -> Result<NodeFields, SolveError> {
    let nodes: Vec<u32> = places.iter().map(|&place| of.nodes[place]).collect();
    let mut unit = NodeFields::zeros(nodes.len(), 3 * nodes.len());
    (0..3 * nodes.len()).for_each(|i| unit.row_mut(i)[i] = 1.0);
    of.factor.solve_at(&nodes, &unit, &of.nodes[from..])
}
