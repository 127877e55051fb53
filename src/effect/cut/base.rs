//! A body with its own factor: whole, or cut so far, with its copies as nodes.
//!
//! In: a body, and the pieces into which its mesh has fallen. Out: the factor of A, which a thread holds, its columns and tables. The energy
//! ½ uᵀK u + wᵀG u + ½ wᵀH w of a cut body is that of a mesh whose tetrahedra are the pieces, each with its share of the stiffness. What
//! has fallen off is left out: its nodes have no unknowns, and its weight is in [`Base::lost`].

use super::loose::{self, moments_of};
use super::matter::Matter;
use super::solves::Solves;
use crate::fem::dense_fields::{products, rows, split_columns};
use crate::fem::{Element, Lame, NodeFields, Partition, StiffnessMatrix, TET4};
use crate::mesh::TetMesh;
use crate::mesh::split::Split;
use nalgebra::DMatrix;
use std::sync::{Arc, OnceLock};

/// The tables of a body.
#[derive(Clone)]
pub struct Tables {
    /// Handle stiffness.
    pub stiffness: DMatrix<f64>,
    /// UᵀF and FᵀG of gravity, where it acts.
    pub weight: Option<[DMatrix<f64>; 2]>,
    /// Whether forces act at single nodes of the surface.
    pub takes_points: bool,
}

pub struct Base {
    pub split: Arc<Split>,
    /// Number of edges that are cut in it.
    pub edges: usize,
    pub partition: Partition,
    /// Place of each node among the free ones.
    pub free_at: Vec<Option<u32>>,
    pub solves: Solves,
    pub tables: Tables,
    /// Forces and moments of gravity on what has fallen off: 12 × 3.
    pub lost: DMatrix<f64>,
    /// U and the columns of gravity over all nodes, once they are needed first.
    whole: OnceLock<Arc<NodeFields>>,
    /// Their right-hand sides, and what is prescribed.
    loads: NodeFields,
    prescribed: NodeFields,
}

impl Base {
    /// The whole body, with K of all nodes and the forces of gravity on them.
    pub fn whole_body(of: &Matter, k: &StiffnessMatrix, forces: &DMatrix<f64>, tables: Tables) -> Base {
        let held = of.controls.iter().flat_map(|control| control.nodes.iter().copied());
        let partition = Partition::new(of.nodes(), held);
        let force = |node: usize, axis: usize| forces.row(3 * node + axis).iter().copied().collect();
        Base::new(of, (Arc::default(), 0), (k, partition), (&force, forces.ncols()), tables)
    }

    /// A cut body after so many edges have been cut, with the tables of the whole one; waits for its factor. The error says why there is
    /// none.
    pub fn cut_body(
        of: &Matter,
        (split, edges): (Arc<Split>, usize),
        of_whole: &Tables,
    ) -> Result<Base, String> {
        let (mesh, lame) = as_mesh(of, &split);
        let count = mesh.nodes.len();
        let k = Element::assemble(&TET4, &mesh, &lame).map_err(|error| error.to_string())?;
        let mut is_used = vec![false; count];
        mesh.tets.iter().flatten().for_each(|node| is_used[*node as usize] = true);
        let is_fixed = |node: &u32| {
            let held = of.held.get(*node as usize).is_some_and(Option::is_some);
            held || !is_used[*node as usize]
        };
        let partition = Partition::new(count, (0..count as u32).filter(is_fixed));
        let mut masses = vec![0.0; count];
        if of_whole.weight.is_some() {
            for (nodes, shares, tet) in members(of, &split) {
                let mass = of.mass(tet);
                nodes.iter().zip(shares).for_each(|(node, share)| masses[*node as usize] += mass * share);
            }
        }
        let force = |node: usize, axis: usize| {
            (0..3).map(|along| if along == axis { masses[node] } else { 0.0 }).collect::<Vec<f64>>()
        };
        let columns = if of_whole.weight.is_some() { 3 } else { 0 };
        let mut base = Base::new(of, (split, edges), (&k, partition), (&force, columns), of_whole.clone());
        let whole = base.whole()?.clone();
        let (affine, weights) = split_columns(&whole, of.affine());
        base.tables.stiffness = products(&k, &affine, &affine);
        if base.tables.weight.is_some() {
            let data = (0..3 * count).flat_map(|row| force(row / 3, row % 3)).collect();
            let forces = NodeFields { nodes: count, columns, data };
            let work = |fields: &NodeFields| rows(fields) * rows(&forces).transpose();
            base.tables.weight = Some([work(&affine), work(&weights)]);
        }
        let lost = loose::masses(of, &base.split, base.split.loose.iter(), &Split::default());
        let place = |node: &u32| of.splitter.mesh.nodes[*node as usize] - of.centre;
        base.lost = lost.iter().fold(base.lost, |sum, (node, mass)| sum + moments_of(*mass, &place(node)));
        Ok(base)
    }

    fn new(
        of: &Matter,
        (split, edges): (Arc<Split>, usize),
        (k, partition): (&StiffnessMatrix, Partition),
        (force, weights): (&dyn Fn(usize, usize) -> Vec<f64>, usize),
        tables: Tables,
    ) -> Base {
        let (count, affine) = (k.nodes(), of.affine());
        let prescribed = of.prescribed(count, weights);
        let mut loads = partition.minus_b_times(k, &prescribed);
        let mut free_at = vec![None; count];
        for (at, node) in (0..).zip(&partition.free) {
            free_at[*node as usize] = Some(at);
            for axis in 0..3 {
                let row = &mut loads.row_mut(3 * at as usize + axis)[affine..];
                row.copy_from_slice(&force(*node as usize, axis)[..weights]);
            }
        }
        let solves = Solves::start(partition.a(k));
        let (whole, lost) = (OnceLock::new(), DMatrix::zeros(12, 3));
        Base { split, edges, partition, free_at, solves, tables, lost, whole, loads, prescribed }
    }

    /// U and the columns of gravity over all nodes.
    pub fn whole(&self) -> Result<&Arc<NodeFields>, String> {
        if let Some(whole) = self.whole.get() {
            return Ok(whole);
        }
        let free = self.solves.solve(self.loads.clone())?;
        let mut fields = self.prescribed.clone();
        self.partition.insert_free(&free, &mut fields);
        Ok(self.whole.get_or_init(|| Arc::new(fields)))
    }
}

/// Tetrahedra and pieces that are held: the nodes of each, their shares, and the tetrahedron.
fn members<'a>(of: &'a Matter, split: &'a Split) -> impl Iterator<Item = ([u32; 4], [f64; 4], u32)> + 'a {
    let mut is_gone = vec![false; of.splitter.mesh.tets.len()];
    split.loose.iter().flat_map(|part| &part.tets).for_each(|tet| is_gone[*tet as usize] = true);
    let is_whole = move |tet: &u32| split.pieces_of(*tet).is_none() && !is_gone[*tet as usize];
    let tets = (0..of.splitter.mesh.tets.len() as u32).filter(is_whole);
    let whole = tets.map(|tet| (of.splitter.mesh.tets[tet as usize], [0.25; 4], tet));
    let held = split.pieces.iter().filter(|piece| !split.is_loose(piece.nodes[0]));
    whole.chain(held.map(|piece| (piece.nodes, piece.shares, piece.tet)))
}

/// Mesh of all that is held, each piece a tetrahedron with that share of its material's stiffness.
fn as_mesh(of: &Matter, split: &Split) -> (TetMesh, Vec<Lame>) {
    let mut mesh = TetMesh::default();
    mesh.nodes.clone_from(&of.splitter.mesh.nodes);
    mesh.nodes.extend(split.copies.iter().map(|node| of.splitter.mesh.nodes[*node as usize]));
    mesh.tags = (1..=mesh.nodes.len() as u64).collect();
    let mut lame = Vec::new();
    for (nodes, shares, tet) in members(of, split) {
        let (share, Lame { lambda, mu }) = (shares.iter().sum::<f64>(), of.lame[tet as usize]);
        mesh.tets.push(nodes);
        lame.push(Lame { lambda: lambda * share, mu: mu * share });
    }
    mesh.regions = vec![0; mesh.tets.len()];
    (mesh, lame)
}
