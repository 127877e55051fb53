//! Lattice vertices on the wrong side of a surface that passes through itself.
//!
//! In: depths at the vertices of a lattice. Out: the same with consistent signs. The distance of a vertex is
//! always right, but its sign comes from one triangle, which may face the wrong way in a fold. Where the distances
//! of two neighbours together exceed their edge, no surface lies between them: they are on one side.

use super::lattice::{Lattice, STEPS};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Part of the vertices on one side that may have the wrong sign; the others outvote them.
const MINORITY: f64 = 0.05;

/// Turns signs that the neighbours outvote, with a notice; refuses where too many contradict.
pub fn agree(lattice: &Lattice, depth: &mut [f64]) -> Result<Option<String>, String> {
    let found = contradictions(lattice, depth);
    let Some(at) = found.first() else { return Ok(None) };
    let place = format!("{} places, the first near ({:.6}, {:.6}, {:.6})", found.len(), at.x, at.y, at.z);
    let side = sides(lattice, depth);
    let mut votes = vec![[0u32; 2]; depth.len()];
    for (&side, &d) in side.iter().zip(depth.iter()) {
        votes[side as usize][usize::from(d > 0.0)] += 1;
    }
    for [outside, inside] in &votes {
        if f64::from(*outside.min(inside)) > MINORITY * f64::from(outside + inside) {
            return Err(format!(
                "the surface overlaps itself at {place}: bodies that overlap, or a surface that passes \
                 through itself by more than a cell. Join the bodies where they were made, or let a mesher that \
                 repairs do both: `greenstage manual meshes` shows the command"
            ));
        }
    }
    let mut turned = 0;
    for (&side, d) in side.iter().zip(depth.iter_mut()) {
        let [outside, inside] = votes[side as usize];
        if (*d > 0.0) != (inside > outside) {
            *d = -*d;
            turned += 1;
        }
    }
    Ok(Some(format!(
        "the surface passes through itself at {place}: {turned} \
         lattice vertices were outvoted by their neighbours"
    )))
}

/// Whether no surface lies on an edge of this length. parry's choice of the nearest triangle is good to f32.
fn is_clear(lattice: &Lattice, a: f64, b: f64, step: usize) -> bool {
    let length = if step < 6 { lattice.cell } else { 0.75f64.sqrt() * lattice.cell };
    let slack = 1e-5 * lattice.cell * lattice.cubes.iter().copied().max().unwrap_or(1) as f64;
    a.abs() + b.abs() > length + slack
}

fn neighbours(lattice: &Lattice, vertex: usize) -> impl Iterator<Item = (usize, usize)> {
    let from = lattice.coordinates(vertex);
    let steps = STEPS.iter().enumerate();
    steps.filter_map(move |(step, by)| {
        Some((step, lattice.vertex([from[0] + by[0], from[1] + by[1], from[2] + by[2]])?))
    })
}

/// Vertices inside with a clear edge to one outside.
fn contradictions(lattice: &Lattice, depth: &[f64]) -> Vec<Vector3<f64>> {
    (0..lattice.vertices())
        .into_par_iter()
        .filter(|&vertex| {
            depth[vertex] > 0.0
                && neighbours(lattice, vertex).any(|(step, other)| {
                    depth[other] < 0.0 && is_clear(lattice, depth[vertex], depth[other], step)
                })
        })
        .map(|vertex| lattice.position(lattice.coordinates(vertex)))
        .collect()
}

/// The least vertex of the side of each vertex; edges that the surface cannot cut join a side.
fn sides(lattice: &Lattice, depth: &[f64]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..depth.len() as u32).collect();
    fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
        while parent[vertex as usize] != vertex {
            parent[vertex as usize] = parent[parent[vertex as usize] as usize];
            vertex = parent[vertex as usize];
        }
        vertex
    }
    for vertex in 0..depth.len() {
        for (step, other) in neighbours(lattice, vertex) {
            if other < vertex && is_clear(lattice, depth[vertex], depth[other], step) {
                let (a, b) = (root(&mut parent, vertex as u32), root(&mut parent, other as u32));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    (0..depth.len() as u32).map(|vertex| root(&mut parent, vertex)).collect()
}
