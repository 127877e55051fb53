//! The outer surface of a tetrahedral mesh.

use super::tet_mesh::{EDGES, FACES, TetMesh};
use nalgebra::Vector3;

/// The outer surface of a [`TetMesh`]: the faces that belong to one tetrahedron only, as outward triangles over the surface
/// nodes, in the order of their tetrahedra; a face of a quadratic mesh as four triangles. Faces between two regions belong
/// to two tetrahedra and are therefore not among them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// Corners as indices into `nodes`.
    pub triangles: Vec<[u32; 3]>,
    /// Mesh node of each surface node, ascending.
    pub nodes: Vec<u32>,
}

/// All faces, sorted: their nodes in ascending order, and 4·tetrahedron + face. Equal faces are neighbours.
///
/// They are put into a bucket for each node, the lowest of the face, and sorted there: of 476,100 tetrahedra in 0.07 s
/// instead of 0.25 s by one sort, and in 0.15 s instead of 0.22 s where the numbers of the nodes are without any order.
pub(super) fn sorted_faces(mesh: &TetMesh) -> Vec<([u32; 3], usize)> {
    let of_tet = |tet: &[u32; 4]| {
        FACES.map(|corners| {
            let mut face = corners.map(|corner| tet[corner]);
            face.sort_unstable();
            face
        })
    };
    let nodes = mesh.tets.iter().flatten().max().map_or(0, |most| *most as usize + 1);
    let mut start = vec![0; nodes + 1];
    mesh.tets.iter().flat_map(of_tet).for_each(|[lowest, ..]| start[lowest as usize + 1] += 1);
    for node in 0..nodes {
        start[node + 1] += start[node];
    }
    let mut next = start.clone();
    let mut faces = vec![([0; 3], 0); 4 * mesh.tets.len()];
    for (face, id) in mesh.tets.iter().flat_map(of_tet).zip(0..) {
        let place = &mut next[face[0] as usize];
        faces[*place] = (face, id);
        *place += 1;
    }
    for bucket in start.windows(2) {
        faces[bucket[0]..bucket[1]].sort_unstable();
    }
    faces
}

/// The edges of the outer faces between corners, once each, the smaller node first, sorted.
pub(super) fn surface_edges(mesh: &TetMesh) -> Vec<[u32; 2]> {
    let faces = sorted_faces(mesh);
    let single = faces.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1);
    let edges_of = |[a, b, c]: [u32; 3]| [[a, b], [b, c], [a, c]];
    let mut edges: Vec<[u32; 2]> = single.flat_map(|same| edges_of(same[0].0)).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// The four triangles of a quadratic face, given by its number and its corners.
fn quarters(mesh: &TetMesh, id: usize, [a, b, c]: [u32; 3]) -> [[u32; 3]; 4] {
    let (tet, mids) = (mesh.tets[id / 4], mesh.mids[id / 4]);
    let between = |p: u32, q: u32| {
        let on = |edge: &[usize; 2]| edge.iter().all(|&corner| tet[corner] == p || tet[corner] == q);
        EDGES.iter().position(on).map_or(p, |edge| mids[edge])
    };
    let (ab, bc, ca) = (between(a, b), between(b, c), between(c, a));
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// The outer faces as elements have them, outward: three corners, and of a quadratic mesh the nodes between the first and
/// the second, the second and the third, the third and the first.
pub fn outer_faces(mesh: &TetMesh) -> Vec<Vec<u32>> {
    let faces = sorted_faces(mesh);
    let single = faces.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1);
    let mut boundary: Vec<usize> = single.map(|same| same[0].1).collect();
    boundary.sort_unstable();
    let nodes = |&id: &usize| {
        let corners = FACES[id % 4].map(|corner| mesh.tets[id / 4][corner]);
        let mut nodes = corners.to_vec();
        if !mesh.mids.is_empty() {
            nodes.extend(quarters(mesh, id, corners)[3]);
        }
        nodes
    };
    boundary.iter().map(nodes).collect()
}

impl Surface {
    pub fn from_mesh(mesh: &TetMesh) -> Surface {
        if !mesh.triangles.is_empty() {
            return Surface {
                triangles: mesh.triangles.clone(),
                nodes: (0..mesh.nodes.len() as u32).collect(),
            };
        }
        let faces = sorted_faces(mesh);
        let single = faces.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1);
        let mut boundary: Vec<usize> = single.map(|same| same[0].1).collect();
        boundary.sort_unstable();
        let mut triangles: Vec<[u32; 3]> =
            boundary.iter().map(|id| FACES[id % 4].map(|corner| mesh.tets[id / 4][corner])).collect();
        if !mesh.mids.is_empty() {
            triangles =
                boundary.iter().zip(triangles).flat_map(|(id, face)| quarters(mesh, *id, face)).collect();
        }

        let mut index = vec![u32::MAX; mesh.nodes.len()];
        triangles.iter().flatten().for_each(|&node| index[node as usize] = 0);
        let mut nodes = Vec::new();
        for (node, index) in (0u32..).zip(&mut index).filter(|(_, index)| **index == 0) {
            *index = nodes.len() as u32;
            nodes.push(node);
        }
        triangles.iter_mut().flatten().for_each(|node| *node = index[*node as usize]);
        Surface { triangles, nodes }
    }

    /// The tetrahedron behind each triangle of [`Surface::from_mesh`] this mesh.
    pub fn tets_behind(mesh: &TetMesh) -> Vec<u32> {
        let faces = sorted_faces(mesh);
        let single = faces.chunk_by(|a, b| a.0 == b.0).filter(|same| same.len() == 1);
        let mut boundary: Vec<usize> = single.map(|same| same[0].1).collect();
        boundary.sort_unstable();
        let triangles = if mesh.mids.is_empty() { 1 } else { 4 };
        boundary.iter().flat_map(|id| std::iter::repeat_n((id / 4) as u32, triangles)).collect()
    }

    /// Corner positions of each triangle of this surface of `mesh`.
    fn corners<'a>(&'a self, mesh: &'a TetMesh) -> impl Iterator<Item = [Vector3<f64>; 3]> + 'a {
        let position = |corner: u32| mesh.nodes[self.nodes[corner as usize] as usize];
        self.triangles.iter().map(move |triangle| triangle.map(position))
    }

    /// Area of this surface of `mesh`, in m².
    pub fn area(&self, mesh: &TetMesh) -> f64 {
        self.corners(mesh).map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum()
    }

    /// Volume inside this surface of `mesh`, in m³: ∮ x·n dA / 3, with x from the surface's first node so that
    /// a body far from the origin loses no digits.
    pub fn volume(&self, mesh: &TetMesh) -> f64 {
        let Some(&first) = self.nodes.first() else { return 0.0 };
        let origin = mesh.nodes[first as usize];
        self.corners(mesh).map(|[a, b, c]| (a - origin).dot(&(b - origin).cross(&(c - origin))) / 6.0).sum()
    }
}
