//! Stiff parts that float in softer material: their own motion is lost in rounding.
//!
//! In: a mesh with a stiffness per tetrahedron, and the nodes that control elements hold. Out: every connected part, of
//! whatever regions, that is stiffer than all that touches it and is not held.

use super::pieces::how_it_turns;
use crate::base::disjoint::DisjointSets;
use crate::fem::Lame;
use crate::mesh::{TetMesh, quality};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};

/// A connected part of which the softest tetrahedron is stiffer than every other one that touches it.
#[derive(Clone, Debug, PartialEq)]
pub struct Floating {
    /// Least shear modulus inside over the largest of what touches it.
    pub ratio: f64,
    /// The regions, each with whether all of it belongs to the part.
    pub regions: Vec<(u32, bool)>,
    pub tetrahedra: usize,
    pub centre: Vector3<f64>,
    /// "is held by no control element", or at too few nodes.
    pub how: String,
}

/// All parts that float and are more than `least` times as stiff as what touches them, the stiffest first.
///
/// Tetrahedra are joined from the stiffest down, over the nodes they share; each time that all of one shear modulus have
/// been joined, the parts that grew are those that are stiffer than their surroundings.
pub fn floating(mesh: &TetMesh, lame: &[Lame], controlled: &[bool], least: f64) -> Vec<Floating> {
    let mut order: Vec<usize> = (0..mesh.tets.len()).collect();
    order.sort_by(|&a, &b| lame[b].mu.total_cmp(&lame[a].mu).then(a.cmp(&b)));
    let softest = order.last().map_or(0.0, |&tet| lame[tet].mu);
    let mut sets = DisjointSets::new(mesh.nodes.len());
    let mut found = Vec::new();
    let mut done = 0;
    for level in order.chunk_by(|&a, &b| lame[a].mu == lame[b].mu) {
        let mu = lame[level[0]].mu;
        // What follows is softer still, and cannot stand out.
        if mu <= least * softest {
            break;
        }
        done += level.len();
        for &tet in level {
            let mut nodes = nodes_of(mesh, tet);
            let first = nodes.next().unwrap_or_default();
            nodes.for_each(|node| sets.join(first, node));
        }
        let mut around: BTreeMap<u32, f64> = BTreeMap::new();
        for &tet in &order[done..] {
            for node in nodes_of(mesh, tet) {
                let stiffest = around.entry(sets.root(node)).or_insert(0.0);
                *stiffest = stiffest.max(lame[tet].mu);
            }
        }
        let grown: BTreeSet<u32> = level.iter().map(|&tet| sets.root(mesh.tets[tet][0])).collect();
        for root in grown {
            let ratio = around.get(&root).map_or(0.0, |around| mu / around);
            if ratio > least {
                found.extend(part(mesh, &order[..done], controlled, &mut sets, root, ratio));
            }
        }
    }
    found
}

fn nodes_of(mesh: &TetMesh, tet: usize) -> impl Iterator<Item = u32> + '_ {
    mesh.tets[tet].into_iter().chain(mesh.mids.get(tet).into_iter().flatten().copied())
}

/// The part of `root` among the tetrahedra `stiff`, unless it is held.
fn part(
    mesh: &TetMesh,
    stiff: &[usize],
    controlled: &[bool],
    sets: &mut DisjointSets,
    root: u32,
    ratio: f64,
) -> Option<Floating> {
    let inside: Vec<usize> =
        stiff.iter().copied().filter(|&tet| sets.root(mesh.tets[tet][0]) == root).collect();
    let nodes: BTreeSet<u32> = inside.iter().flat_map(|&tet| nodes_of(mesh, tet)).collect();
    let nodes: Vec<u32> = nodes.into_iter().collect();
    let held: Vec<u32> = nodes.iter().copied().filter(|&node| controlled[node as usize]).collect();
    let how = how_it_turns(mesh, &nodes, &held)?;
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    for &tet in &inside {
        *counts.entry(mesh.regions[tet]).or_default() += 1;
    }
    let whole = |region: u32, count: usize| mesh.regions.iter().filter(|r| **r == region).count() == count;
    Some(Floating {
        ratio,
        regions: counts.into_iter().map(|(region, count)| (region, whole(region, count))).collect(),
        tetrahedra: inside.len(),
        centre: quality::centroid(mesh, &nodes).unwrap_or_default(),
        how,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Block, block};

    /// A bar of eight cells along x, with a region and a shear modulus for each cell, held at x = 0.
    fn bar(cells: [(u32, f64); 8]) -> (TetMesh, Vec<Lame>, Vec<bool>) {
        let mut mesh = block(&Block { size: [8.0, 1.0, 1.0], cells: [8, 1, 1] }).unwrap();
        let cell = |tet: usize| {
            let x = mesh.corners(tet).iter().map(|x| x.x).sum::<f64>() / 4.0;
            cells[((x + 4.0) as usize).min(7)]
        };
        let of: Vec<(u32, f64)> = (0..mesh.tets.len()).map(cell).collect();
        mesh.regions = of.iter().map(|(region, _)| *region).collect();
        let lame = of.iter().map(|(_, mu)| Lame { lambda: *mu, mu: *mu }).collect();
        let held = mesh.nodes.iter().map(|x| x.x < -3.9).collect();
        (mesh, lame, held)
    }

    fn found(cells: [(u32, f64); 8]) -> Vec<(f64, Vec<(u32, bool)>)> {
        let (mesh, lame, held) = bar(cells);
        floating(&mesh, &lame, &held, 1e8).into_iter().map(|part| (part.ratio, part.regions)).collect()
    }

    const SOFT: (u32, f64) = (1, 1.0);

    #[test]
    fn a_floating_part_of_two_regions_is_one_part() {
        let (a, b) = ((2, 1e15), (3, 1e15));
        let both = found([SOFT, SOFT, SOFT, a, b, SOFT, SOFT, SOFT]);
        assert_eq!(both, [(1e15, vec![(2, true), (3, true)])]);
        // A hundred times stiffer inside: the outer one still floats, by less.
        let (a, b) = ((2, 1e15), (3, 1e13));
        let both = found([SOFT, SOFT, SOFT, a, b, SOFT, SOFT, SOFT]);
        assert_eq!(both, [(1e13, vec![(2, true), (3, true)])]);
        // Both stand out by themselves.
        let (a, b) = ((2, 1e30), (3, 1e15));
        let both = found([SOFT, SOFT, SOFT, a, b, SOFT, SOFT, SOFT]);
        assert_eq!(both, [(1e15, vec![(2, true)]), (1e15, vec![(2, true), (3, true)])]);
    }

    #[test]
    fn the_floating_half_of_a_region_that_is_also_held_is_found() {
        let stiff = (2, 1e13);
        assert_eq!(found([stiff, stiff, SOFT, SOFT, stiff, SOFT, SOFT, SOFT]), [(1e13, vec![(2, false)])]);
        assert_eq!(found([stiff, stiff, SOFT, SOFT, SOFT, SOFT, SOFT, SOFT]), []);
        assert_eq!(found([stiff, (3, 1e14), SOFT, SOFT, SOFT, SOFT, SOFT, SOFT]), []);
        assert_eq!(found([SOFT, SOFT, SOFT, SOFT, (2, 1e7), SOFT, SOFT, SOFT]), []);
    }

    #[test]
    fn a_stiff_part_held_at_one_node_turns_about_it() {
        let stiff = (2, 1e13);
        let (mesh, lame, _) = bar([stiff, stiff, SOFT, SOFT, SOFT, SOFT, SOFT, SOFT]);
        let mut held = vec![false; mesh.nodes.len()];
        held[0] = true;
        let part = floating(&mesh, &lame, &held, 1e8);
        assert!(part.len() == 1 && part[0].how.contains("a single node"), "{part:?}");
    }
}
