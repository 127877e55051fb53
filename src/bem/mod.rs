//! Boundary elements: the columns of a homogeneous body from its closed surface alone, without a node inside.
//!
//! ```text
//! triangles → V, K (tractions) → Yᵀ Y = (½ + K)ᵀ V⁻¹ (½ + K)      D (bending of the surface)
//! S = D + Yᵀ Y, the stiffness of all surface nodes → S_ff u_f = -S_fc b → columns, handle stiffness
//! ```
//!
//! In: the surface, its material, which nodes are held, and the fields prescribed there. Out: the displacements of all nodes with
//! the rest free of forces, and the work W = Uᵀ S U. It is the symmetric method of Galerkin (Sirtori, Meccanica 14, 1979; Costabel,
//! in: Boundary Elements IX, 1987; Steinbach, Numerical Approximation Methods for Elliptic Boundary Value Problems, 2008,
//! sections 6.6.3 and 8.5; the paper's reference 3 collocates):
//! displacements are linear on each triangle, and tractions constant on those that a control element holds, and 0 on all others.

mod assembly;
mod operators;
mod pairs;
mod potentials;
mod rules;
mod strip;
mod touching;
mod triangle;

use crate::base::disjoint::DisjointSets;
use crate::base::machine::{self, TooLarge};
use crate::base::progress::Progress;
use crate::fem::{Lame, NodeFields};
use crate::solve::{DenseSystem, Elimination, SolveError, SolveStats};
use assembly::Mesh;
use nalgebra::{DMatrix, SVD, Vector3};
use std::time::Instant;
use triangle::Triangle;

/// A closed surface whose triangles are counter-clockwise as seen from outside, inward around a cavity.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    pub nodes: &'a [Vector3<f64>],
    pub triangles: &'a [[u32; 3]],
}

/// The solution.
pub struct Solved {
    /// Displacements of all nodes.
    pub fields: NodeFields,
    /// W = Uᵀ S U, symmetric: the work of one field on another by S, N·m per units of both.
    pub work: DMatrix<f64>,
    /// max |W - Wᵀ| over max |W| as it was solved.
    pub asymmetry: f64,
    /// W as the tractions' work on the prescribed fields: far from it where triangles are large, because tractions are constant
    /// on each.
    pub traction_work: DMatrix<f64>,
    /// max |S r| over max |S| for the rigid motions r, before they were taken out: the error of the integrals.
    pub integration_error: f64,
    /// Numbers in the matrices.
    pub entries: usize,
    pub assembly_s: f64,
    pub stats: SolveStats,
}

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(
        "triangle {triangle} of the surface near {place} has no area: remove it, or mesh this place anew"
    )]
    Flat { triangle: usize, place: String },
    #[error(
        "{source}; about {fits} nodes would fit. Take a coarser surface, or fill the body with \
         tetrahedra (leave method out)"
    )]
    Memory { source: TooLarge, fits: usize },
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// Bytes that `nodes` nodes take with tractions on `held` triangles.
fn memory(nodes: usize, held: usize) -> f64 {
    let (nodes, held) = (3.0 * nodes as f64, 3.0 * held as f64);
    8.0 * (nodes * nodes + held * (held + nodes) + assembly::working() * nodes)
}

/// Bytes of the matrices for a surface of `nodes` nodes of which `held` triangles carry tractions. Errors where they do not fit.
pub fn fits(nodes: usize, held: usize) -> Result<f64, Error> {
    let need = memory(nodes, held);
    let what = |nodes: usize| format!("boundary elements on {nodes} nodes of the surface");
    let Err(source) = machine::expect(what(nodes), need) else { return Ok(need) };
    let scaled = |part: f64| [nodes, held].map(|count| (part * count as f64) as usize);
    let (mut least, mut most) = (0.0, 1.0);
    for _ in 0..20 {
        let part = 0.5 * (least + most);
        let [nodes, held] = scaled(part);
        match machine::fits(what(nodes), memory(nodes, held), 0.0) {
            Ok(()) => least = part,
            Err(_) => most = part,
        }
    }
    Err(Error::Memory { source, fits: scaled(least)[0] })
}

/// The triangles that carry tractions, where `is_held` states for each node whether it is prescribed: those with three held
/// corners, around a held node without such a triangle all, and all around a cavity that nothing holds. There they come out as
/// about zero; without them the place of the cavity's wall would be undetermined, for a rigid motion of a wall alone is felt
/// nowhere else.
pub fn loaded_triangles(Surface { nodes, triangles }: Surface<'_>, is_held: &[bool]) -> Vec<u32> {
    let held = |node: &u32| is_held[*node as usize];
    let mut is_covered = vec![false; is_held.len()];
    for triangle in triangles.iter().filter(|triangle| triangle.iter().all(held)) {
        triangle.iter().for_each(|&node| is_covered[node as usize] = true);
    }
    let is_cavity = free_cavities(nodes, triangles, is_held);
    let is_loaded = |triangle: &[u32; 3]| {
        triangle.iter().all(held)
            || is_cavity[triangle[0] as usize]
            || triangle.iter().any(|node| held(node) && !is_covered[*node as usize])
    };
    (0u32..).zip(triangles).filter(|(_, triangle)| is_loaded(triangle)).map(|(t, _)| t).collect()
}

/// Whether each node lies on a shell around a cavity of which no node is held.
fn free_cavities(nodes: &[Vector3<f64>], triangles: &[[u32; 3]], is_held: &[bool]) -> Vec<bool> {
    let mut sets = DisjointSets::new(nodes.len());
    for [a, b, c] in triangles {
        sets.join(*a, *b);
        sets.join(*b, *c);
    }
    let shell: Vec<u32> = (0..nodes.len() as u32).map(|node| sets.root(node)).collect();
    let (mut volume, mut is_free) = (vec![0.0; nodes.len()], vec![true; nodes.len()]);
    for triangle in triangles {
        let root = shell[triangle[0] as usize] as usize;
        let [a, b, c] = triangle.map(|node| nodes[node as usize] - nodes[root]);
        volume[root] += a.dot(&b.cross(&c));
    }
    shell
        .iter()
        .zip(is_held)
        .filter(|(_, held)| **held)
        .for_each(|(root, _)| is_free[*root as usize] = false);
    shell.iter().map(|&root| volume[root as usize] < 0.0 && is_free[root as usize]).collect()
}

/// Solves for `prescribed`, over all nodes, of which the rows of the nodes that are not held are ignored.
pub fn solve(
    surface: Surface<'_>,
    lame: Lame,
    is_held: &[bool],
    prescribed: &NodeFields,
    progress: &dyn Progress,
) -> Result<Solved, Error> {
    let started = Instant::now();
    let count = surface.nodes.len();
    let loaded = loaded_triangles(surface, is_held);
    fits(count, loaded.len())?;
    // Free nodes first.
    let mut order: Vec<u32> = (0..count as u32).collect();
    order.sort_by_key(|&node| is_held[node as usize]);
    let free = is_held.iter().filter(|held| !**held).count();
    let mut place_of = vec![0u32; count];
    (0..).zip(&order).for_each(|(place, &node)| place_of[node as usize] = place);
    let mesh = mesh(surface, &place_of, lame)?;

    let tractions = mesh.tractions(&loaded, progress);
    let entries = tractions.len() + 9 * count * count;
    progress.begin("elimination of the tractions", 0);
    let tractions = Elimination::from_numbers(tractions, 3 * loaded.len(), 3 * count)?;
    let mut matrix = tractions.taken();
    progress.end();
    mesh.add_hypersingular(&mut matrix, progress);
    let rigid = rigid_motions(surface.nodes, &order);
    let integration_error = take_out(&mut matrix, &rigid);
    let assembly_s = started.elapsed().as_secs_f64();

    let system = DenseSystem::new(matrix, 3 * count, 3 * free, progress)?;
    let (ordered, stats) = system.solve_and_judge(prescribed.at(&order), progress)?;
    let columns = ordered.columns;
    let force = system.multiply(&ordered);
    drop(system);
    let as_matrix = |fields: &NodeFields| DMatrix::from_row_slice(3 * count, columns, &fields.data);
    let displacement = as_matrix(&ordered);
    let work = displacement.tr_mul(&as_matrix(&force));
    let traction_work = traction_work(&mesh, &tractions, &loaded, &ordered);
    let asymmetry = relative(&(&work - work.transpose()), &work);
    Ok(Solved {
        fields: ordered.at(&place_of),
        work: (&work + work.transpose()) / 2.0,
        asymmetry,
        traction_work,
        integration_error,
        entries,
        assembly_s,
        stats,
    })
}

/// max |a| over max |b|; 0 where a is.
pub fn relative(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    let (a, b) = (a.amax(), b.amax());
    if a == 0.0 { 0.0 } else { a / b }
}

fn mesh(surface: Surface<'_>, place_of: &[u32], lame: Lame) -> Result<Mesh, Error> {
    let corners = |triangle: &[u32; 3]| triangle.map(|node| surface.nodes[node as usize]);
    let made = surface.triangles.iter().enumerate().map(|(t, triangle)| {
        let corners = corners(triangle);
        let flat = || {
            let [x, y, z]: [f64; 3] = corners[0].into();
            Error::Flat { triangle: t, place: format!("({x:.6}, {y:.6}, {z:.6})") }
        };
        Triangle::new(corners).ok_or_else(flat)
    });
    Ok(Mesh {
        triangles: made.collect::<Result<_, _>>()?,
        places: surface.triangles.iter().map(|t| t.map(|node| place_of[node as usize])).collect(),
        nodes: surface.nodes.len(),
        material: lame.into(),
    })
}

/// The work of the tractions of each field on each other: field i on the triangles of field j's tractions at (i, j).
fn traction_work(mesh: &Mesh, tractions: &Elimination, loaded: &[u32], fields: &NodeFields) -> DMatrix<f64> {
    let columns = fields.columns;
    let mut t = tractions.carried(&fields.data, columns);
    tractions.backward(&mut t, columns);
    let mut means = DMatrix::<f64>::zeros(3 * loaded.len(), columns);
    for (row, &triangle) in loaded.iter().enumerate() {
        let part = mesh.triangles[triangle as usize].area / 3.0;
        for place in mesh.places[triangle as usize] {
            for (axis, column) in (0..3 * columns).map(|k| (k / columns, k % columns)) {
                means[(3 * row + axis, column)] += part * fields.row(3 * place as usize + axis)[column];
            }
        }
    }
    means.tr_mul(&DMatrix::from_row_slice(3 * loaded.len(), columns, &t))
}

/// An orthonormal basis of the rigid motions of all nodes, in their order: six columns, fewer of nodes on a line.
fn rigid_motions(nodes: &[Vector3<f64>], order: &[u32]) -> DMatrix<f64> {
    let centre = nodes.iter().sum::<Vector3<f64>>() / nodes.len().max(1) as f64;
    let size = nodes.iter().map(|x| (x - centre).norm()).fold(f64::MIN_POSITIVE, f64::max);
    let mut motions = DMatrix::zeros(3 * nodes.len(), 6);
    for (row, &node) in order.iter().enumerate() {
        let x = (nodes[node as usize] - centre) / size;
        for axis in 0..3 {
            let unit = Vector3::ith(axis, 1.0);
            motions[(3 * row + axis, axis)] = 1.0;
            motions.fixed_view_mut::<3, 1>(3 * row, 3 + axis).copy_from(&unit.cross(&x));
        }
    }
    let SVD { u, singular_values, .. } = SVD::new(motions, true, false);
    let kept = singular_values.iter().filter(|value| **value > 1e-9 * singular_values.max()).count();
    u.map_or_else(|| DMatrix::zeros(3 * nodes.len(), 0), |u| u.columns(0, kept).into_owned())
}

/// Makes the symmetric matrix, given by its lower half, exactly 0 on the rigid motions; max |S r| before over max |S|.
fn take_out(matrix: &mut [f64], rigid: &DMatrix<f64>) -> f64 {
    let size = rigid.nrows();
    let kept = rigid.ncols();
    // S R, from the lower half alone.
    let mut image = DMatrix::<f64>::zeros(size, kept);
    let mut largest: f64 = 0.0;
    for (j, column) in matrix.chunks_exact(size.max(1)).enumerate() {
        largest = largest.max(column[j].abs());
        for k in 0..kept {
            let own = rigid[(j, k)];
            let mut sum = column[j] * own;
            let (image, rigid) = (&mut image.column_mut(k), rigid.column(k));
            for i in j + 1..size {
                image[i] += column[i] * own;
                sum += column[i] * rigid[i];
            }
            image[j] += sum;
        }
    }
    // (I - R Rᵀ) S (I - R Rᵀ) = S - R Zᵀ - Z Rᵀ with Z = S R - R (Rᵀ S R) / 2.
    let z = &image - rigid * (rigid.tr_mul(&image) / 2.0);
    let (r, z) = (rigid.transpose(), z.transpose());
    for (j, column) in matrix.chunks_exact_mut(size.max(1)).enumerate() {
        for i in j..size {
            column[i] -= r.column(i).dot(&z.column(j)) + z.column(i).dot(&r.column(j));
        }
    }
    // Unit displacements, not unit columns.
    let scale = (size as f64 / 3.0).sqrt();
    if largest == 0.0 { 0.0 } else { scale * image.amax() / largest }
}

#[cfg(test)]
mod tests;
