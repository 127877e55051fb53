//! Decides which groups a new node joins that is inserted between two old ones.
//!
//! In: a mesh with new nodes in the middles of its edges. Out: its groups, extended by the new nodes that belong to
//! them. A group is a set of nodes, and no file says whether it means a volume, a part of the surface or a line, so its
//! nodes decide:
//!
//! 1. each is a corner of a tetrahedron that lies in the group with all corners: a volume; the edges of those
//!    tetrahedra belong to it;
//! 2. else, all on the surface: a part of it; edges of the surface between two of its nodes belong to it, but no edge
//!    that runs through the body, so that a wall does not grow inward;
//! 3. else every edge between two of its nodes belongs to it.

use super::surface::surface_edges;
use super::tet_mesh::{TetMesh, edges_of};

/// Adds node `first` + i, which stands on the edge `ends[i]` (ascending) of a linear mesh, to the groups of `mesh` that
/// it belongs to.
pub(super) fn join(mesh: &mut TetMesh, first: usize, ends: &[[u32; 2]]) {
    let outer = surface_edges(mesh);
    let mut is_outer = vec![false; mesh.nodes.len()];
    outer.iter().flatten().for_each(|&node| is_outer[node as usize] = true);
    let tets = ByLeast::new(mesh.tets.iter().map(|tet| tet.iter().copied().min().unwrap_or(0)));
    let edges = ByLeast::new(ends.iter().map(|[a, _]| *a));

    for group in mesh.groups.values_mut() {
        let mut joining = Vec::new();
        let holds = |node: &u32| group.binary_search(node).is_ok();
        let (mut solid, mut covered) = (Vec::new(), Vec::new());
        for tet in group.iter().flat_map(|&node| tets.of(node)).map(|tet| mesh.tets[tet as usize]) {
            if tet.iter().all(holds) {
                solid.extend(edges_of(&tet));
                covered.extend(tet);
            }
        }
        solid.sort_unstable();
        covered.sort_unstable();
        covered.dedup();
        let is_volume = covered.len() == group.len();
        let is_surface = group.iter().all(|node| is_outer[*node as usize]);
        for i in group.iter().flat_map(|&node| edges.of(node)) {
            let edge = ends[i as usize];
            let belongs = match (is_volume, is_surface) {
                (true, _) => solid.binary_search(&edge).is_ok(),
                (false, true) => outer.binary_search(&edge).is_ok(),
                (false, false) => true,
            };
            if belongs && holds(&edge[1]) {
                joining.push(first as u32 + i);
            }
        }
        group.append(&mut joining);
        group.sort_unstable();
    }
}

/// Looks up tetrahedra or edges by the least of their nodes.
struct ByLeast {
    /// (least node, number of the thing), sorted.
    sorted: Vec<(u32, u32)>,
}

impl ByLeast {
    fn new(least: impl Iterator<Item = u32>) -> ByLeast {
        let mut sorted: Vec<(u32, u32)> = least.zip(0..).collect();
        sorted.sort_unstable();
        ByLeast { sorted }
    }

    fn of(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.sorted.partition_point(|(least, _)| *least < node);
        self.sorted[first..].iter().take_while(move |(least, _)| *least == node).map(|(_, thing)| *thing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::generate::RING;
    use crate::mesh::{Block, block, quadratic, tube};
    use nalgebra::Vector3;

    /// The group's nodes are those for which `lies_in` holds.
    #[track_caller]
    fn assert_group(mesh: &TetMesh, name: &str, lies_in: impl Fn(&Vector3<f64>) -> bool) {
        let there: Vec<u32> =
            (0..mesh.nodes.len() as u32).filter(|&node| lies_in(&mesh.nodes[node as usize])).collect();
        assert_eq!(mesh.groups[name], there, "{name}");
    }

    #[test]
    fn faces_take_what_lies_on_them_and_no_more() {
        for cells in [[1, 1, 1], [3, 2, 1]] {
            let mesh = quadratic(block(&Block { size: [1.0; 3], cells }).unwrap(), &quadratic::straight);
            assert_group(&mesh, "xmin", |x| x.x < -0.5 + 1e-12);
            assert_group(&mesh, "zmax", |x| x.z > 0.5 - 1e-12);
        }
    }

    /// A wall of one layer: all its nodes are on the surface, whether a group means its skin or its thickness.
    #[test]
    fn skin_and_thickness_of_a_thin_wall_are_told_apart() {
        let mesh = quadratic(tube(&RING).unwrap(), &|a, b| RING.curve(a, b));
        assert_group(&mesh, "left", |x| x.x < -0.25 + 1e-12);
        assert_group(&mesh, "inner", |x| x.yz().norm() < 0.5 + 1e-12);
        assert_group(&mesh, "outer", |x| x.yz().norm() > 1.0 - 1e-12);
    }

    /// Inside the body: a layer of nodes that is neither a volume nor on the surface; a skin, which holds no whole cell.
    #[test]
    fn inner_layers_and_whole_skins_stay_what_they_are() {
        let mut mesh = block(&Block { size: [1.0; 3], cells: [4; 3] }).unwrap();
        let chosen = |inside: &dyn Fn(&Vector3<f64>) -> bool| -> Vec<u32> {
            (0..mesh.nodes.len() as u32).filter(|&node| inside(&mesh.nodes[node as usize])).collect()
        };
        let skin = |x: &Vector3<f64>| x.amax() > 0.5 - 1e-12;
        let (layer, outside) = (chosen(&|x| x.z.abs() < 1e-12), chosen(&skin));
        let (core, one) = (chosen(&|x| x.amax() < 0.26), chosen(&|x| x.amin() > 0.49 && x.min() > 0.0));
        mesh.groups = [("layer", layer), ("skin", outside), ("core", core), ("one", one.clone())]
            .map(|(name, nodes)| (name.to_owned(), nodes))
            .into();
        let mesh = quadratic(mesh, &quadratic::straight);
        assert_group(&mesh, "layer", |x| x.z.abs() < 1e-12);
        assert_group(&mesh, "skin", skin);
        assert_group(&mesh, "core", |x| x.amax() < 0.26);
        assert_eq!((one.len(), &mesh.groups["one"]), (1, &one));
    }
}
