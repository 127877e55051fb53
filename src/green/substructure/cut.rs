//! A body cut into parts: every tetrahedron belongs to one, and parts meet in interfaces.
//!
//! In: a mesh, control elements, the scene's [`Parts`]. Out: the part of each tetrahedron, and the interfaces: sets of nodes
//! whose faces lie between two parts. `along` cuts at levels of the harmonic field that is 0 on the first control element
//! and 1 on the others, so that branches come apart at their forks; `pieces` bisects
//! across the longest axis of inertia, again and again (Simon, Comput. Syst. Eng. 2, 1991, 135-148).

use super::super::control::ControlElement;
use crate::base::disjoint::DisjointSets;
use crate::fem::{NodeFields, Partition, StiffnessMatrix, tet4};
use crate::mesh::geodesic::edges;
use crate::mesh::{FACES, TetMesh};
use crate::scene::Parts;
use crate::solve::{Progress, SolveError, Solver};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;

/// Parts of a body.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Part of every tetrahedron.
    pub part: Vec<usize>,
    pub parts: usize,
    pub interfaces: Vec<Interface>,
}

/// The nodes in which two parts meet.
#[derive(Clone, Debug, PartialEq)]
pub struct Interface {
    pub parts: [usize; 2],
    /// Ascending, without those that a control element holds.
    pub nodes: Vec<u32>,
}

/// Pieces smaller than this part of the mean part go to a neighbour.
const CRUMB: f64 = 0.05;
/// Levels tried around each that is asked for, in this part of the distance between two: that of the smallest interface is
/// taken, which in a layered mesh is flat; one at the whole distance counts as larger by a tenth.
const TRIED: usize = 41;
const AROUND: f64 = 0.4;
const OFFSET: f64 = 0.1;

/// Two tetrahedra, and the face that they share.
type Neighbours = ([usize; 2], [u32; 3]);

/// Cuts a body.
pub fn cut(
    mesh: &TetMesh,
    controls: &[ControlElement],
    parts: Parts,
    solver: &Solver,
    progress: &dyn Progress,
) -> Result<Cut, SolveError> {
    let pairs = neighbours(mesh);
    let labels = match parts {
        Parts::Regions(_) => mesh.regions.iter().map(|region| *region as usize).collect(),
        Parts::Pieces(count) => bisected(mesh, count as usize),
        Parts::Along(count) if count > 1 && controls.len() > 1 => {
            let field = harmonic(mesh, controls, solver, progress)?;
            by_levels(mesh, &pairs, &field, count as usize)
        }
        Parts::Along(_) => vec![0; mesh.tets.len()],
    };
    let (mut part, mut count) = components(&labels, &pairs);
    merge_crumbs(mesh, &pairs, &mut part, &mut count);
    let interfaces = interfaces(mesh, controls, &pairs, &part);
    Ok(Cut { part, parts: count, interfaces })
}

/// Tetrahedra that share a face, with its nodes.
fn neighbours(mesh: &TetMesh) -> Vec<Neighbours> {
    let mut faces: Vec<([u32; 3], usize)> = Vec::with_capacity(4 * mesh.tets.len());
    for (tet, corners) in mesh.tets.iter().enumerate() {
        for face in FACES {
            let mut nodes = face.map(|corner| corners[corner]);
            nodes.sort_unstable();
            faces.push((nodes, tet));
        }
    }
    faces.sort_unstable();
    let shared = faces.windows(2).filter(|pair| pair[0].0 == pair[1].0);
    shared.map(|pair| ([pair[0].1, pair[1].1], pair[0].0)).collect()
}

/// The field with ∫ ∇a·∇b = 0 that is 0 on the first control element and 1 on the others.
fn harmonic(
    mesh: &TetMesh,
    controls: &[ControlElement],
    solver: &Solver,
    progress: &dyn Progress,
) -> Result<Vec<f64>, SolveError> {
    let n = mesh.nodes.len();
    let mut laplacian = StiffnessMatrix::zeros(n, edges(mesh));
    for tet in 0..mesh.tets.len() {
        let Some(element) = tet4::geometry(mesh.corners(tet)) else { continue };
        let nodes = mesh.tets[tet];
        for a in 0..4 {
            for b in 0..4 {
                let [i, j] = [nodes[a], nodes[b]];
                // One unknown a node: the solvers' blocks have it three times.
                let block = Matrix3::from_diagonal_element(
                    element.gradients[a].dot(&element.gradients[b]) * element.volume,
                );
                if i == j {
                    laplacian.diagonal[i as usize] += block;
                } else if i < j
                    && let Ok(edge) = laplacian.edges.binary_search(&[i, j])
                {
                    laplacian.blocks[edge] += block;
                }
            }
        }
    }
    let mut field = NodeFields::zeros(n, 1);
    for control in &controls[1..] {
        control.nodes.iter().for_each(|&node| field.row_mut(3 * node as usize)[0] = 1.0);
    }
    let partition = Partition::new(n, controls.iter().flat_map(|control| control.nodes.iter().copied()));
    if !partition.free.is_empty() {
        let a = partition.a(&laplacian);
        let linear = solver.analyse(&a, progress)?;
        let (free, _) =
            linear.factor(&a, progress)?.solve(&partition.minus_b_times(&laplacian, &field), progress)?;
        partition.insert_free(&free, &mut field);
    }
    Ok((0..n).map(|node| field.row(3 * node)[0]).collect())
}

/// Between which of `count - 1` levels the mean of a tetrahedron's corners lies.
fn by_levels(mesh: &TetMesh, pairs: &[Neighbours], field: &[f64], count: usize) -> Vec<usize> {
    let of_tet = |tet: &[u32; 4]| tet.iter().map(|&node| field[node as usize]).sum::<f64>() / 4.0;
    let levels: Vec<f64> = mesh.tets.iter().map(of_tet).collect();
    let area = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|node| mesh.nodes[node as usize]);
        (b - a).cross(&(c - a)).norm() * 0.5
    };
    let faces: Vec<([f64; 2], f64)> =
        pairs.iter().map(|(tets, face)| (tets.map(|tet| levels[tet]), area(face))).collect();
    let cut_area = |level: f64| -> f64 {
        let is_between = |([a, b], _): &&([f64; 2], f64)| (*a < level) != (*b < level);
        faces.iter().filter(is_between).map(|(_, area)| area).sum()
    };
    let cuts: Vec<f64> = (1..count)
        .map(|cut| {
            let tried = (0..TRIED).map(|tried| {
                let offset = AROUND * (2.0 * tried as f64 / (TRIED - 1) as f64 - 1.0);
                ((cut as f64 + offset) / count as f64, offset.abs())
            });
            let cost = |(level, offset): &(f64, f64)| cut_area(*level) * (1.0 + OFFSET * offset);
            let best = tried.min_by(|a, b| cost(a).total_cmp(&cost(b)));
            best.map_or(cut as f64 / count as f64, |(level, _)| level)
        })
        .collect();
    levels.iter().map(|level| cuts.iter().filter(|cut| **cut <= *level).count()).collect()
}

/// Divides by volume across the longest axis of inertia, and again, until there are `count`.
fn bisected(mesh: &TetMesh, count: usize) -> Vec<usize> {
    let volumes = volumes(mesh);
    let centre = |tet: usize| mesh.corners(tet).iter().sum::<Vector3<f64>>() * 0.25;
    let mut labels = vec![0; mesh.tets.len()];
    // A label, and in how many it is to be divided.
    let mut open = vec![(0, count)];
    let mut next = 1;
    while let Some((label, share)) = open.pop() {
        let mut own: Vec<usize> = (0..labels.len()).filter(|&tet| labels[tet] == label).collect();
        let total: f64 = own.iter().map(|&tet| volumes[tet]).sum();
        if share < 2 || own.len() < 2 {
            continue;
        }
        let mean = own.iter().map(|&tet| centre(tet) * volumes[tet]).sum::<Vector3<f64>>() / total;
        let spread = |&tet: &usize| (centre(tet) - mean) * (centre(tet) - mean).transpose() * volumes[tet];
        let eigen = own.iter().map(spread).sum::<Matrix3<f64>>().symmetric_eigen();
        let axis = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        own.sort_by(|&a, &b| axis.dot(&centre(a)).total_cmp(&axis.dot(&centre(b))).then(a.cmp(&b)));
        let (low, mut sum) = (share / 2, 0.0);
        for tet in own {
            sum += volumes[tet];
            if sum > total * low as f64 / share as f64 {
                labels[tet] = next;
            }
        }
        open.extend([(label, low), (next, share - low)]);
        next += 1;
    }
    labels
}

fn volumes(mesh: &TetMesh) -> Vec<f64> {
    let volume = |tet: usize| tet4::geometry(mesh.corners(tet)).map_or(0.0, |element| element.volume);
    (0..mesh.tets.len()).map(volume).collect()
}

/// The tetrahedra of one label that are joined by faces, numbered in the order of labels, then of their first tetrahedron.
fn components(labels: &[usize], pairs: &[Neighbours]) -> (Vec<usize>, usize) {
    let mut sets = DisjointSets::new(labels.len());
    for &([a, b], _) in pairs {
        if labels[a] == labels[b] {
            sets.join(a as u32, b as u32);
        }
    }
    let roots: Vec<(usize, u32)> = (0..).zip(labels).map(|(tet, label)| (*label, sets.root(tet))).collect();
    let mut numbers: BTreeMap<(usize, u32), usize> = roots.iter().map(|root| (*root, 0)).collect();
    numbers.values_mut().enumerate().for_each(|(number, of)| *of = number);
    let part = roots.iter().map(|root| numbers[root]).collect();
    (part, numbers.len())
}

/// Gives each crumb to the neighbour with which it shares most faces, the smallest first.
fn merge_crumbs(mesh: &TetMesh, pairs: &[Neighbours], part: &mut [usize], count: &mut usize) {
    let of_tet = volumes(mesh);
    let total: f64 = of_tet.iter().sum();
    loop {
        let mut volumes = vec![0.0; *count];
        part.iter().zip(&of_tet).for_each(|(&part, volume)| volumes[part] += volume);
        let limit = CRUMB * total / *count as f64;
        let crumbs = (0..*count).filter(|&part| volumes[part] < limit);
        let Some(crumb) = crumbs.min_by(|&a, &b| volumes[a].total_cmp(&volumes[b])) else { return };
        let mut faces = vec![0usize; *count];
        for &([a, b], _) in pairs {
            match (part[a] == crumb, part[b] == crumb) {
                (true, false) => faces[part[b]] += 1,
                (false, true) => faces[part[a]] += 1,
                _ => {}
            }
        }
        let most = (0..*count).rev().max_by_key(|&part| faces[part]).filter(|&part| faces[part] > 0);
        let Some(host) = most else { return };
        for own in part.iter_mut() {
            if *own == crumb {
                *own = host;
            }
            if *own > crumb {
                *own -= 1;
            }
        }
        *count -= 1;
    }
}

/// The nodes of faces between two parts, each set of joined faces apart.
fn interfaces(
    mesh: &TetMesh,
    controls: &[ControlElement],
    pairs: &[Neighbours],
    part: &[usize],
) -> Vec<Interface> {
    let mut is_held = vec![false; mesh.nodes.len()];
    controls.iter().flat_map(|control| &control.nodes).for_each(|&node| is_held[node as usize] = true);
    let mut between: BTreeMap<[usize; 2], Vec<[u32; 3]>> = BTreeMap::new();
    for &([a, b], face) in pairs {
        let [p, q] = [part[a].min(part[b]), part[a].max(part[b])];
        if p != q {
            between.entry([p, q]).or_default().push(face);
        }
    }
    let mut found = Vec::new();
    for (parts, faces) in between {
        let mut sets = DisjointSets::new(mesh.nodes.len());
        for [a, b, c] in &faces {
            sets.join(*a, *b);
            sets.join(*a, *c);
        }
        let mut by_root: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for &node in faces.iter().flatten() {
            by_root.entry(sets.root(node)).or_default().push(node);
        }
        for (_, mut nodes) in by_root {
            nodes.sort_unstable();
            nodes.dedup();
            nodes.retain(|&node| !is_held[node as usize]);
            found.push(Interface { parts, nodes });
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};
    use crate::solve::Silent;

    /// A beam along x with 12 layers, held at both ends; of two regions that alternate by thirds.
    fn beam() -> (TetMesh, Vec<ControlElement>) {
        let mut mesh = block(&Block { size: [1.2, 0.3, 0.2], cells: [12, 3, 2] }).unwrap();
        let low = mesh.nodes.iter().map(|x| x.x).fold(f64::INFINITY, f64::min);
        let middle = |tet: usize| mesh.corners(tet).iter().map(|x| x.x - low).sum::<f64>() / 4.0;
        mesh.regions = (0..mesh.tets.len()).map(|tet| (middle(tet) / 0.4) as u32 % 2).collect();
        let control = |name: &str| ControlElement::new(name, mesh.groups[name].clone(), &mesh, 1.0);
        let controls = ["xmin", "xmax"].map(control).to_vec();
        (mesh, controls)
    }

    fn found(parts: Parts) -> (TetMesh, Cut) {
        let (mesh, controls) = beam();
        let cut = cut(&mesh, &controls, parts, &Solver::default(), &Silent).unwrap();
        (mesh, cut)
    }

    /// Along the beam and by pieces the cuts lie between layers: as many nodes as a section has.
    #[test]
    fn interfaces_are_sections_of_a_layered_beam() {
        for (parts, count) in
            [(Parts::Along(4), 4), (Parts::Along(5), 5), (Parts::Pieces(4), 4), (Parts::Regions(true), 3)]
        {
            let (mesh, cut) = found(parts);
            assert_eq!((cut.parts, cut.interfaces.len()), (count, count - 1), "{parts:?}");
            for interface in &cut.interfaces {
                assert_eq!(interface.nodes.len(), 4 * 3, "{parts:?}");
                let x = mesh.nodes[interface.nodes[0] as usize].x;
                let is_flat = |node: &u32| (mesh.nodes[*node as usize].x - x).abs() < 1e-12;
                assert!(interface.nodes.iter().all(is_flat), "{parts:?}");
            }
        }
    }

    #[test]
    fn every_tetrahedron_has_a_part_and_parts_meet_in_interfaces_alone() {
        for parts in [Parts::Along(3), Parts::Along(7), Parts::Pieces(5), Parts::Regions(true)] {
            let (mesh, cut) = found(parts);
            let between: Vec<u32> = cut.interfaces.iter().flat_map(|i| i.nodes.iter().copied()).collect();
            let mut of_node = vec![Vec::new(); mesh.nodes.len()];
            for (tet, part) in cut.part.iter().enumerate() {
                assert!(*part < cut.parts);
                mesh.tets[tet].iter().for_each(|&node| of_node[node as usize].push(*part));
            }
            for (node, parts) in of_node.iter().enumerate() {
                let is_shared = parts.iter().any(|part| *part != parts[0]);
                assert_eq!(is_shared, between.contains(&(node as u32)), "node {node}");
            }
        }
    }

    #[test]
    fn one_control_element_or_one_level_is_one_part() {
        let (mesh, controls) = beam();
        for (controls, count) in [(&controls[..1], 8), (&controls[..], 1)] {
            let cut = cut(&mesh, controls, Parts::Along(count), &Solver::default(), &Silent).unwrap();
            assert_eq!((cut.parts, cut.interfaces.len()), (1, 0));
        }
    }
}
