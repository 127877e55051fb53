//! Smoothed aggregation algebraic multigrid with rigid-body modes: a preconditioner of conjugate gradients whose
//! iterations hardly grow with the mesh (Vaněk, Mandel and Brezina, Computing 56, 1996, 179-196).
//!
//! In: A and the places of its nodes. Out: [`Multigrid::apply`], about A⁻¹ r for several columns at once.
//!
//! ```text
//! rows → Clusters → Aggregates → Prolongator P → Pᵀ A P → …  until few unknowns are left → Dense
//! apply: smooth, residual, Pᵀ, the next level, P, smooth
//! ```
//!
//! Levels are built in f64 and applied in f32, which halves their memory and time: what the finest level cannot hold of the
//! softest motions is held by the coarse matrices, and conjugate gradients in f64 correct the rest.
mod cluster;
mod coarsest;
mod galerkin;
mod prolong;
mod rows;
mod smooth;
#[cfg(test)]
mod tests;
mod transfer;

use crate::fem::StiffnessMatrix;
use cluster::{Aggregates, Clusters};
use coarsest::Dense;
use prolong::{MODES, Prolongator, RigidModes, Smoothed};
use rayon::prelude::*;
use rows::{Rows, Scaled};
use smooth::{Smoother, THICK, THIN, Vectors};

/// Coupling of two nodes, in parts of their diagonal blocks, below which they are not gathered; on every coarser level half of
/// it (Vaněk, Mandel and Brezina), but of thin bodies twice as much: plates and shells took up to twice the iterations with
/// halves, a box of a million nodes twice as many with doubles.
const THRESHOLD: f64 = 0.02;
const COARSER: f64 = 0.5;
const COARSER_IF_THIN: f64 = 2.0;
/// Largest number of unknowns of a level that is solved by a dense factor.
const DENSE: usize = 600;
/// Levels that are smaller than the last by less than this are of no use.
const SHRINK: f64 = 0.7;
/// Lanczos' iteration sees the largest eigenvalue from below.
const MARGIN: f64 = 1.1;

/// One level: the matrix that is smoothed with, and the way to the next.
struct Level<const B: usize> {
    matrix: Smoothed<B>,
    largest: f64,
    down: Option<Prolongator<B>>,
}

pub struct Multigrid {
    fine: Level<3>,
    /// The order of the nodes, if clusters have changed it: A's node at each place, and the place of each node.
    places: Option<[Vec<u32>; 2]>,
    coarse: Vec<Level<6>>,
    /// The last level; where levels stop shrinking, it is smoothed alone.
    last: Option<Dense>,
    /// Whether the body is thin: its coarse levels are small, and bending is lost on the way down, so they are visited twice
    /// (W-cycle).
    is_thin: bool,
    /// A is held in parts of 1/`scale`.
    scale: f64,
}

/// The vectors of all levels for several columns.
pub struct Workspace {
    pub fine: Vectors,
    coarse: Vec<Vectors>,
}

/// A level's diagonal block at this node is not positive definite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotDefinite {
    pub node: usize,
}

impl Multigrid {
    /// Builds all levels.
    pub fn new(a: &StiffnessMatrix) -> Result<Multigrid, NotDefinite> {
        let mut rows = Scaled::new(a);
        let (clusters, order) = Clusters::new(&rows, &rows.inverses().map_err(|node| NotDefinite { node })?);
        rows.reorder(order);
        let modes = fine_modes(a, &rows.order);
        let (fine, mut below) = level(&rows, &clusters, &modes, THRESHOLD)
            .map_err(|place| NotDefinite { node: rows.order[place] as usize })?;
        drop((modes, clusters));
        let mut coarse = Vec::new();
        let mut last = None;
        let mut threshold = THRESHOLD;
        let is_thin = below.as_ref().is_some_and(|(rows, _)| rows.numbers() < fine.matrix.numbers());
        while let Some((rows, modes)) = below {
            if MODES * rows.nodes() <= DENSE
                && let Some(dense) = Dense::new(&rows)
            {
                last = Some(dense);
                break;
            }
            threshold *= if is_thin { COARSER_IF_THIN } else { COARSER };
            let (level, next) = level(&rows, &Clusters::alone(rows.nodes()), &modes, threshold)
                .map_err(|_coarse_node| NotDefinite { node: 0 })?;
            coarse.push(level);
            below = next;
        }
        let scale = rows.scale;
        Ok(Multigrid { fine, places: rows.into_places(), coarse, last, is_thin, scale })
    }

    /// Bytes of all levels of `a` while they are built, and afterwards: 40 for each block of rows in f32, 450 for each node's
    /// way to the next level and its cluster, and 32,000 for each aggregate, as which a node with its neighbours is counted, for a coarse
    /// matrix of a body that is not thin (measured: blocks of tet4 and tet10, a tube). Making them takes 1.4 times as much.
    pub fn memory(a: &StiffnessMatrix) -> [f64; 2] {
        let (nodes, pairs) = (a.nodes() as f64, 2.0 * a.edges.len() as f64);
        let aggregates = nodes * nodes / (nodes + pairs).max(1.0);
        let levels = 40.0 * (pairs + nodes) + 450.0 * nodes + 32_000.0 * aggregates;
        [1.4 * levels, levels]
    }

    pub fn workspace(&self, columns: usize) -> Workspace {
        let mut coarse: Vec<Vectors> =
            self.coarse.iter().map(|level| Vectors::new(MODES * level.matrix.nodes(), columns)).collect();
        if self.last.is_some() {
            let above =
                self.coarse.last().map_or(self.fine.down.as_ref().map(Prolongator::aggregates), |level| {
                    level.down.as_ref().map(Prolongator::aggregates)
                });
            coarse.push(Vectors::new(MODES * above.unwrap_or(0), columns));
        }
        Workspace { fine: Vectors::new(3 * self.fine.matrix.nodes(), columns), coarse }
    }

    /// One cycle: `fine.x` ≈ A⁻¹ `fine.b` / [`Multigrid::scale`].
    pub fn apply(&self, v: &mut Workspace) {
        if let Some([order, _]) = &self.places {
            gather(order, v.fine.columns, &v.fine.b, &mut v.fine.y);
            std::mem::swap(&mut v.fine.b, &mut v.fine.y);
        }
        self.fine.cycle(self.smoother(), true, &mut v.fine, |residual, columns, down, x| {
            self.below(0, residual, columns, down, x, &mut v.coarse);
        });
        if let Some([_, places]) = &self.places {
            gather(places, v.fine.columns, &v.fine.x, &mut v.fine.y);
            std::mem::swap(&mut v.fine.x, &mut v.fine.y);
        }
    }

    /// The factor by which the result of [`Multigrid::apply`] is to be multiplied.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    fn smoother(&self) -> &'static Smoother {
        if self.is_thin { &THIN } else { &THICK }
    }

    /// x += P (about A_c⁻¹) Pᵀ residual.
    fn below<const B: usize>(
        &self,
        level: usize,
        residual: &[f32],
        columns: usize,
        down: &Prolongator<B>,
        x: &mut [f32],
        vectors: &mut [Vectors],
    ) {
        let Some((own, rest)) = vectors.split_first_mut() else { return };
        down.restrict(columns, residual, &mut own.b);
        match (self.coarse.get(level), &self.last) {
            (Some(coarse), _) => {
                for visit in 0..1 + usize::from(self.is_thin) {
                    coarse.cycle(self.smoother(), visit == 0, own, |residual, columns, down, x| {
                        self.below(level + 1, residual, columns, down, x, rest);
                    });
                }
            }
            (None, Some(last)) => last.solve(own),
            (None, None) => return,
        }
        down.add(columns, &own.x, x);
    }
}

impl<const B: usize> Level<B> {
    /// Improves x; `is_zero`: whether x is zero, whatever stands there.
    fn cycle(
        &self,
        smoother: &Smoother,
        is_zero: bool,
        v: &mut Vectors,
        below: impl FnOnce(&[f32], usize, &Prolongator<B>, &mut [f32]),
    ) {
        self.matrix.smooth(smoother, self.largest, is_zero, v);
        if let Some(down) = &self.down {
            self.matrix.residual(v);
            below(&v.d, v.columns, down, &mut v.x);
        }
        self.matrix.smooth(smoother, self.largest, false, v);
    }
}

impl<const B: usize> Prolongator<B> {
    fn aggregates(&self) -> usize {
        self.down_start.len() - 1
    }
}

/// Node i of `to` is node `places[i]` of `from`.
fn gather(places: &[u32], columns: usize, from: &[f32], to: &mut [f32]) {
    let size = 3 * columns;
    to.par_chunks_exact_mut(size).zip(places).with_min_len(1024).for_each(|(to, &place)| {
        to.copy_from_slice(&from[place as usize * size..][..size]);
    });
}

/// The rows and rigid motions of the level below.
type Below = Option<(rows::CoarseRows, RigidModes<MODES>)>;

/// Errors with a node of a cluster whose block is not positive definite.
fn level<const B: usize>(
    rows: &impl Rows<B>,
    clusters: &Clusters,
    modes: &RigidModes<B>,
    threshold: f64,
) -> Result<(Level<B>, Below), usize> {
    let matrix = Smoothed::new(rows, clusters)?;
    let largest = MARGIN * matrix.largest_eigenvalue();
    let aggregates = Aggregates::new(rows, clusters, threshold);
    let unknowns = B * rows.nodes();
    if aggregates.count == 0 || MODES as f64 * aggregates.count as f64 > 2.0 * SHRINK * unknowns as f64 {
        return Ok((Level { matrix, largest, down: None }, None));
    }
    let (prolongator, coarse_modes) = Prolongator::new(rows, clusters, &aggregates, modes, largest);
    let coarse = galerkin::coarse(rows, &prolongator);
    Ok((Level { matrix, largest, down: Some(prolongator) }, Some((coarse, coarse_modes))))
}

/// Each node moves with a shift, and a turn about its own place does not move it; without places, no turns are known.
fn fine_modes(a: &StiffnessMatrix, order: &[u32]) -> RigidModes<3> {
    let shift = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { 1.0 } else { 0.0 }));
    let place = |&node: &u32| a.places.get(node as usize).copied().unwrap_or_default();
    RigidModes { place: order.iter().map(place).collect(), modes: vec![shift; a.nodes()] }
}
