//! The linear tetrahedron with average nodal pressure: four nodes, and no locking near ν = 1/2.
//!
//! Every element keeps its own strain for the shear part 2μ ε:ε of the energy, but the volumetric part λ tr(ε)² is
//! taken from the mean dilatation of the patch around each node, to which every tetrahedron gives a quarter of its
//! volume (Bonet and Burton, Commun. Numer. Meth. Engng. 14, 1998, 437-449; for small strains the same as Dohrmann,
//! Heinstein, Jung, Key and Witkowski, Int. J. Numer. Meth. Engng. 47, 2000, 1549-1568, on λ alone):
//!
//! ```text
//! V_p = Σ V_e/4      θ_p = Σ (V_e/4) tr ε_e / V_p      W = Σ_e V_e μ ε_e:ε_e + Σ_p V_p λ θ_p²/2
//! ```
//!
//! W is never negative: the mean's square is at most the squares' mean, so patches take no more from it than elements
//! would. There are about six times as many tetrahedra as nodes: three unknowns per node cannot meet one constraint per
//! tetrahedron, but one per node. A patch ends where the material does. K couples each node with its neighbours'
//! neighbours, so it has about four times as many blocks as with [`tet4`].

use super::assembly::{ElementSet, Elements};
use super::element::{Dilatation, Element};
use super::energy::{StrainRows, Strains};
use super::lame::Lame;
use super::products::add_dyad;
use super::stiffness::NodeFields;
use super::tet4;
use crate::mesh::TetMesh;
use nalgebra::{Matrix3, Vector3};

/// The linear tetrahedron with average nodal pressure. A node meets its neighbours' neighbours too: about 4.6 times as
/// many as with [`tet4`], which makes the rows of K three times as dear to solve.
pub const TET4_ANP: Element = Element {
    name: "tet4_anp",
    order: 1,
    dilatation: Dilatation::Nodal,
    locks: false,
    pairs: [4.6, 0.0, 0.0],
    unknown_cost: 3.0,
    sets: |mesh, lame| {
        // The elements' own part, and the patches around the nodes.
        let own: Vec<Lame> = lame.iter().map(|lame| Lame { lambda: 0.0, mu: lame.mu }).collect();
        let tetrahedra = tet4::Tetrahedra::new(mesh, &own)?;
        let patches = Patches::new(&tetrahedra, lame);
        Ok(vec![Box::new(tetrahedra), Box::new(patches)])
    },
    points: |mesh, lame| {
        let tetrahedra = tet4::Tetrahedra::new(mesh, lame)?;
        let mut points = tetrahedra.points(true);
        for_each_patch(&tetrahedra, lame, |stiffness, terms| points.push_mean(stiffness, terms));
        Ok(points)
    },
};

/// The nodes' patches: element p adds λ V g_a ⊗ g_b, where θ_p = Σ_a g_a · u_a.
pub struct Patches {
    /// λ V_p, N m.
    stiffness: Vec<f64>,
    start: Vec<usize>,
    nodes: Vec<u32>,
    gradients: Vec<Vector3<f64>>,
}

impl Patches {
    fn new(own: &tet4::Tetrahedra<'_>, lame: &[Lame]) -> Patches {
        let mut patches =
            Patches { stiffness: Vec::new(), start: vec![0], nodes: Vec::new(), gradients: Vec::new() };
        for_each_patch(own, lame, |stiffness, shares| patches.push(own, stiffness, shares));
        patches
    }

    fn push(&mut self, own: &tet4::Tetrahedra<'_>, stiffness: f64, shares: &[(u32, f64)]) {
        let mut terms: Vec<(u32, Vector3<f64>)> = Vec::with_capacity(4 * shares.len());
        for &(tet, share) in shares {
            let geometry = &own.geometry[tet as usize];
            let corners = own.mesh.tets[tet as usize];
            terms.extend((0..4).map(|a| (corners[a], geometry.gradients[a] * share)));
        }
        terms.sort_by_key(|(node, _)| *node);
        for same in terms.chunk_by(|a, b| a.0 == b.0) {
            self.nodes.push(same[0].0);
            self.gradients.push(same.iter().map(|(_, gradient)| gradient).sum());
        }
        self.start.push(self.nodes.len());
        self.stiffness.push(stiffness);
    }
}

/// Gives each patch to `take`: λ V_p, and the share of V_p that each of its tetrahedra has.
fn for_each_patch(own: &tet4::Tetrahedra<'_>, lame: &[Lame], mut take: impl FnMut(f64, &[(u32, f64)])) {
    for mut tets in tetrahedra_of_nodes(own.mesh) {
        // Materials apart, each in the order of the tetrahedra.
        tets.sort_by(|&a, &b| {
            let key = |tet: u32| lame[tet as usize];
            key(a).lambda.total_cmp(&key(b).lambda).then(key(a).mu.total_cmp(&key(b).mu)).then(a.cmp(&b))
        });
        let quarter = |tet: u32| own.geometry[tet as usize].volume / 4.0;
        for same in tets.chunk_by(|&a, &b| lame[a as usize] == lame[b as usize]) {
            let volume: f64 = same.iter().map(|&tet| quarter(tet)).sum();
            let shares: Vec<(u32, f64)> = same.iter().map(|&tet| (tet, quarter(tet) / volume)).collect();
            take(lame[same[0] as usize].lambda * volume, &shares);
        }
    }
}

fn tetrahedra_of_nodes(mesh: &TetMesh) -> Vec<Vec<u32>> {
    let mut of_node = vec![Vec::new(); mesh.nodes.len()];
    for (tet, corners) in (0u32..).zip(&mesh.tets) {
        corners.iter().for_each(|&corner| of_node[corner as usize].push(tet));
    }
    of_node
}

impl ElementSet for Patches {}

impl Elements for Patches {
    fn count(&self) -> usize {
        self.stiffness.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.nodes[self.start[element]..self.start[element + 1]]
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        let gradients = &self.gradients[self.start[element]..self.start[element + 1]];
        let own = gradients[a] * self.stiffness[element];
        for (block, gradient) in out.iter_mut().zip(gradients) {
            *block = Matrix3::zeros();
            add_dyad(block, &own, gradient);
        }
    }
}

impl Strains for Patches {
    fn elements(&self) -> usize {
        self.stiffness.len()
    }

    fn strains(&self, element: usize, fields: &NodeFields, out: &mut StrainRows) {
        let own = self.start[element]..self.start[element + 1];
        out.push(self.stiffness[element], &self.nodes[own.clone()], &self.gradients[own], fields);
    }
}
