//! The columns of a cut body, from the factor of the whole one.
//!
//! In: a body with its affine columns U, factor A and handle stiffness S, and a [`Split`]. Out: the columns and the stiffness of the cut
//! body. With w the displacement of each copy beyond that of its node, a piece p of tetrahedron e, with its share φ of the volume, moves by
//! u + J w, and the energy of the cut body is
//!
//! ```text
//! ½ uᵀK u + wᵀG u + ½ wᵀH w        G = Σ_p φ Jᵀ K_e        H = Σ_p φ Jᵀ K_e J
//! ```
//!
//! since the shares of a tetrahedron add up to 1. From 0 = G u + H w and 0 = K u + Gᵀ w at the free nodes follow, with X = A⁻¹ Gᵀ,
//!
//! ```text
//! (H - G X) W = -G U        U' = U - X W        S' = S + Wᵀ G U
//! ```
//!
//! with a column of W for each of U. This is the augmented system of Y.-H. Yeung, J. Crouch and A. Pothen (ACM Transactions on Graphics
//! 35(2), 2016), in which the copies stand in place of changed entries of K. A longer cut leaves most copies as they are: their X and G X
//! are kept. G X is f64; X, of which only what is shown follows, is f32.

use super::solves::Solves;
use crate::base::machine;
use crate::fem::tet4::{Geometry, geometry, stiffness_block};
use crate::fem::{Element, Lame, NodeFields, Partition};
use crate::green::{ControlElement, FIELDS, NewSurface, Volume};
use crate::mesh::quality;
use crate::mesh::split::{CutEdges, CutPoint, CutSurface, Split, Splitter};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::cholesky::llt::solve::{solve_in_place, solve_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par, Spec};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A pivot of the scaled H - G X below which it holds no digits.
const SINGULAR: f64 = 1e-11;

/// The message where the columns of the whole body are asked for before they were solved.
const UNKNOWN: &str = "the columns of the whole body are not known yet";

/// A cut body is refused whose equations are missed by a larger part than this.
const INEXACT: f64 = 1e-7;

/// A body that can be cut.
pub struct Cuttable {
    pub splitter: Splitter,
    lame: Vec<Lame>,
    /// Control element that holds each node.
    pub held: Vec<Option<usize>>,
    /// Node of the mesh of each node of the surface.
    surface: Vec<u32>,
    /// Node of the surface of each node of the mesh.
    surface_of: Vec<Option<u32>>,
    /// Mesh coordinates of the origin of the .green file's lengths, m.
    centre: Vector3<f64>,
    partition: Partition,
    /// Place of each node among the free ones.
    free_at: Vec<Option<u32>>,
    solves: Solves,
    /// U over all nodes; `None` until it is needed first.
    whole: Option<NodeFields>,
    /// Right-hand sides of U.
    loads: NodeFields,
    prescribed: NodeFields,
    stiffness: DMatrix<f64>,
    known: Known,
}

/// A copy's node, and the pieces that move with it: their tetrahedra, and the bits of their shares.
type CopyKey = (u32, Vec<(u32, u64)>);

/// Data on the copies of the last cut.
#[derive(Default)]
struct Known {
    /// Number of each copy among `x` and in `gx`.
    places: BTreeMap<CopyKey, usize>,
    /// X of each, 3 free nodes × 3.
    x: Vec<Arc<DMatrix<f32>>>,
    /// G X, 3 n × 3 n.
    gx: DMatrix<f64>,
}

/// A row of G: blocks of the nodes of the mesh.
type Row = BTreeMap<u32, Matrix3<f64>>;

/// The copies of a split, and how they hang together with the body.
struct Couplings {
    /// G, a row for each copy.
    rows: Vec<Row>,
    /// Blocks of H.
    h: BTreeMap<(usize, usize), Matrix3<f64>>,
    /// Dependence of X of each copy.
    keys: Vec<CopyKey>,
}

/// The cut body.
pub struct Opened {
    /// The points of its surface beyond the nodes that the whole body has there.
    pub points: Vec<CutPoint>,
    pub surface: NewSurface,
    pub moved: Moved,
    /// Part of its largest number by which (H - G X) W misses -G U, or by which S' misses its transpose.
    pub error: f64,
}

/// The part of U' that the cut has made: -X W.
#[derive(Default)]
pub struct Moved {
    x: Vec<Arc<DMatrix<f32>>>,
    w: DMatrix<f64>,
}

impl Cuttable {
    /// A body with these control elements' names; starts the thread that factorises it. The error says why it cannot be cut.
    pub fn new(
        volume: Volume,
        names: &[&str],
        centre: Vector3<f64>,
        stiffness: DMatrix<f64>,
    ) -> Result<Cuttable, String> {
        let Volume { element, mesh, lame, held: of_controls, surface, .. } = volume;
        let k = Element::assemble(element, &mesh, &lame).map_err(|error| error.to_string())?;
        let count = mesh.nodes.len();
        let (low, high) = quality::bounding_box(&mesh.nodes);
        let mut prescribed = NodeFields::zeros(count, FIELDS * of_controls.len());
        for (e, (name, nodes)) in names.iter().zip(&of_controls).enumerate() {
            let control = ControlElement::new(name, nodes.clone(), &mesh, (high - low).norm());
            control.prescribe(&mesh.nodes, FIELDS * e, &mut prescribed);
        }
        let partition = Partition::new(count, of_controls.iter().flatten().copied());
        let mut free_at = vec![None; count];
        (0..).zip(&partition.free).for_each(|(at, node)| free_at[*node as usize] = Some(at));
        let mut held = vec![None; count];
        for (e, nodes) in of_controls.iter().enumerate() {
            nodes.iter().for_each(|node| held[*node as usize] = Some(e));
        }
        let mut surface_of = vec![None; count];
        (0..).zip(&surface).for_each(|(at, node)| surface_of[*node as usize] = Some(at));
        Ok(Cuttable {
            solves: Solves::start(partition.a(&k)),
            loads: partition.minus_b_times(&k, &prescribed),
            splitter: Splitter::new(Arc::new(mesh)),
            lame,
            held,
            surface,
            surface_of,
            centre,
            partition,
            free_at,
            whole: None,
            prescribed,
            stiffness,
            known: Known::default(),
        })
    }

    /// Handle stiffness of the whole body.
    #[cfg(test)]
    pub fn stiffness(&self) -> &DMatrix<f64> {
        &self.stiffness
    }

    /// U of the whole body over all nodes.
    pub fn whole(&mut self) -> Result<&NodeFields, String> {
        if self.whole.is_none() {
            let free = self.solves.solve(self.loads.clone())?;
            let mut fields = self.prescribed.clone();
            self.partition.insert_free(&free, &mut fields);
            self.whole = Some(fields);
        }
        self.whole.as_ref().ok_or_else(|| UNKNOWN.to_owned())
    }

    /// The mesh after these cuts.
    pub fn split(&self, cut: &CutEdges) -> Split {
        self.splitter.split(cut, &self.held)
    }

    /// The body after cuts by which its mesh has fallen into these pieces. The error says why there is none.
    pub fn open(&mut self, cut: &CutEdges, split: &Split) -> Result<Opened, String> {
        self.whole()?;
        let Couplings { rows, h, keys } = self.couplings(split);
        let known = self.solve_copies(&rows, keys)?;
        let Some(whole) = &self.whole else { return Err(UNKNOWN.to_owned()) };
        let mut gu = DMatrix::zeros(3 * rows.len(), whole.columns);
        for (i, row) in rows.iter().enumerate() {
            for (node, block) in row {
                for axis in 0..3 {
                    let u = whole.row(3 * *node as usize + axis);
                    for (k, u) in u.iter().enumerate() {
                        (0..3).for_each(|r| gu[(3 * i + r, k)] += block[(r, axis)] * u);
                    }
                }
            }
        }
        let mut system = -&known.gx;
        for ((i, j), block) in &h {
            let mut own = system.fixed_view_mut::<3, 3>(3 * i, 3 * j);
            own += block;
        }
        let (w, missed) = solved(&system, &gu)?;
        let stiffness = &self.stiffness + w.tr_mul(&gu);
        let asymmetry = (&stiffness - stiffness.transpose()).amax() / stiffness.amax();
        let error = missed.max(asymmetry);
        if error.is_nan() || error > INEXACT {
            return Err(format!(
                "the forces of the cut body could be wrong by a part of {error:.0e}, above {INEXACT:.0e}"
            ));
        }
        let stiffness = (&stiffness + stiffness.transpose()) * 0.5;
        let moved = Moved { x: known.x.clone(), w };
        let opened = self.splitter.surface(split, cut);
        let surface = self.surface_of((split, &opened), (whole, &moved), stiffness)?;
        self.known = known;
        Ok(Opened { points: opened.points, surface, moved, error })
    }

    fn geometry(&self, tet: u32) -> Option<Geometry> {
        geometry(self.splitter.mesh.corners(tet as usize))
    }

    fn couplings(&self, split: &Split) -> Couplings {
        let mesh = &self.splitter.mesh;
        let copy_of = |node: u32| (node as usize).checked_sub(mesh.nodes.len());
        let mut rows = vec![Row::new(); split.copies.len()];
        let mut h: BTreeMap<(usize, usize), Matrix3<f64>> = BTreeMap::new();
        let mut keys: Vec<CopyKey> = split.copies.iter().map(|node| (*node, Vec::new())).collect();
        for piece in &split.pieces {
            let Some(geometry) = self.geometry(piece.tet) else { continue };
            let (lame, own) = (self.lame[piece.tet as usize], mesh.tets[piece.tet as usize]);
            for a in 0..4 {
                let Some(copy) = copy_of(piece.nodes[a]) else { continue };
                keys[copy].1.push((piece.tet, piece.volume.to_bits()));
                for b in 0..4 {
                    let block = stiffness_block(&geometry, lame, a, b) * piece.volume;
                    *rows[copy].entry(own[b]).or_insert_with(Matrix3::zeros) += block;
                    if let Some(other) = copy_of(piece.nodes[b]) {
                        *h.entry((copy, other)).or_insert_with(Matrix3::zeros) += block;
                    }
                }
            }
        }
        Couplings { rows, h, keys }
    }

    /// Takes one more step on the way to a cut, without its surface: the copies are known then as if the body had been opened there.
    pub fn follow(&mut self, split: &Split) -> Result<(), String> {
        let Couplings { rows, keys, .. } = self.couplings(split);
        self.known = self.solve_copies(&rows, keys)?;
        Ok(())
    }

    /// Forgets all copies.
    pub fn close(&mut self) {
        self.known = Known::default();
    }

    /// X and G X of these copies, solved where they are not known.
    fn solve_copies(&self, rows: &[Row], keys: Vec<CopyKey>) -> Result<Known, String> {
        let before: Vec<Option<usize>> = keys.iter().map(|key| self.known.places.get(key).copied()).collect();
        let missing: Vec<usize> = (0..keys.len()).filter(|i| before[*i].is_none()).collect();
        let (free, copies) = (self.partition.free.len() as f64, keys.len() as f64);
        let need = 72.0 * free * copies + 144.0 * missing.len() as f64 * free + 216.0 * copies * copies;
        let of = format!("A cut with {copies} copies of nodes");
        machine::fits(of, need, 0.0).map_err(|error| error.to_string())?;
        let mut b = NodeFields::zeros(self.partition.free.len(), 3 * missing.len());
        for (k, i) in missing.iter().enumerate() {
            for (free, block) in self.free_blocks(&rows[*i]) {
                for axis in 0..3 {
                    let row = &mut b.row_mut(3 * free as usize + axis)[3 * k..3 * k + 3];
                    row.iter_mut().enumerate().for_each(|(other, to)| *to = block[(other, axis)]);
                }
            }
        }
        let x = if missing.is_empty() { b } else { self.solves.solve(b)? };
        let mut gx = DMatrix::zeros(3 * keys.len(), 3 * keys.len());
        for (i, was) in before.iter().enumerate() {
            let Some(was) = was else { continue };
            for (j, other) in before.iter().enumerate() {
                let Some(other) = other else { continue };
                let block = self.known.gx.fixed_view::<3, 3>(3 * was, 3 * other);
                gx.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block);
            }
        }
        for (i, row) in rows.iter().enumerate() {
            let mut products = vec![Matrix3::<f64>::zeros(); missing.len()];
            for (free, block) in self.free_blocks(row) {
                let own: [&[f64]; 3] = std::array::from_fn(|axis| x.row(3 * free as usize + axis));
                for (k, product) in products.iter_mut().enumerate() {
                    *product += block * Matrix3::from_fn(|axis, other| own[axis][3 * k + other]);
                }
            }
            for (j, product) in missing.iter().zip(products) {
                gx.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&product);
                gx.fixed_view_mut::<3, 3>(3 * j, 3 * i).copy_from(&product.transpose());
            }
        }
        let mut columns: Vec<Option<Arc<DMatrix<f32>>>> =
            before.iter().map(|was| was.map(|was| self.known.x[was].clone())).collect();
        for (k, i) in missing.iter().enumerate() {
            let own = DMatrix::from_fn(3 * x.nodes, 3, |row, other| x.row(row)[3 * k + other] as f32);
            columns[*i] = Some(Arc::new(own));
        }
        let places = keys.into_iter().zip(0..).collect();
        Ok(Known { places, x: columns.into_iter().flatten().collect(), gx })
    }

    /// The blocks of a row of G at free nodes.
    fn free_blocks<'a>(&'a self, row: &'a Row) -> impl Iterator<Item = (u32, &'a Matrix3<f64>)> {
        row.iter().filter_map(|(node, block)| Some((self.free_at[*node as usize]?, block)))
    }

    /// The surface of the cut body with its columns.
    fn surface_of(
        &self,
        (split, opened): (&Split, &CutSurface),
        (whole, moved): (&NodeFields, &Moved),
        stiffness: DMatrix<f64>,
    ) -> Result<NewSurface, String> {
        let count = self.splitter.mesh.nodes.len();
        let copy_of = |node: u32| (node as usize).checked_sub(count);
        let node_of = |node: u32| split.original(node, count);
        let inner = opened.points.iter().flat_map(|point| point.nodes).map(node_of);
        let mut asked: Vec<u32> = inner.filter(|node| self.surface_of[*node as usize].is_none()).collect();
        asked.sort_unstable();
        asked.dedup();
        let old = self.surface.len();
        let all: Vec<u32> = self.surface.iter().chain(&asked).copied().collect();
        let mut values = self.moved_at(&all, moved);
        for (at, node) in all.iter().enumerate() {
            for axis in 0..3 {
                let u = whole.row(3 * *node as usize + axis);
                u.iter().enumerate().for_each(|(k, u)| values[(3 * at + axis, k)] += u);
            }
        }
        let place = |node: u32| match self.surface_of[node as usize] {
            Some(at) => at as usize,
            None => old + asked.partition_point(|other| *other < node),
        };
        let mut columns = DMatrix::zeros(3 * (old + opened.points.len()), whole.columns);
        columns.rows_mut(0, 3 * old).copy_from(&values.rows(0, 3 * old));
        let (mut points, mut held) = (Vec::new(), vec![Vec::new(); whole.columns / FIELDS]);
        for (at, point) in opened.points.iter().enumerate() {
            let shares = [1.0 - point.share, point.share];
            let mut own = columns.rows_mut(3 * (old + at), 3);
            for (node, share) in point.nodes.into_iter().zip(shares) {
                own += values.rows(3 * place(node_of(node)), 3) * share;
                if let Some(copy) = copy_of(node) {
                    own += moved.w.rows(3 * copy, 3) * share;
                }
            }
            // A copy is not held.
            let of = point.nodes.map(|node| self.held.get(node as usize).copied().flatten());
            if let (Some(e), true) = (of[0], of[0] == of[1]) {
                held[e].push((old + at) as u32);
            }
            let [a, b] = point.nodes.map(|node| self.splitter.place(split, node));
            points.push((a.lerp(&b, point.share) - self.centre).cast::<f32>().into());
        }
        let number = |node: u32| match copy_of(node) {
            None => self.surface_of[node as usize],
            Some(point) => Some((old + point) as u32),
        };
        let triangle = |nodes: &[u32; 3]| Some([number(nodes[0])?, number(nodes[1])?, number(nodes[2])?]);
        let triangles: Option<Vec<_>> = opened.triangles.iter().map(triangle).collect();
        let triangles = triangles.ok_or("a node of the cut surface is none of the surface")?;
        Ok(NewSurface { points, triangles, held, columns, stiffness })
    }

    /// -X W at these nodes.
    fn moved_at(&self, nodes: &[u32], Moved { x, w }: &Moved) -> DMatrix<f64> {
        let free: Vec<Option<u32>> = nodes.iter().map(|node| self.free_at[*node as usize]).collect();
        let mut gathered = Mat::<f32>::zeros(3 * nodes.len(), 3 * x.len());
        for (j, x) in x.iter().enumerate() {
            for k in 0..3 {
                let (from, to) = (x.column(k), gathered.col_as_slice_mut(3 * j + k));
                for (to, free) in to.chunks_exact_mut(3).zip(&free) {
                    let Some(free) = free else { continue };
                    to.copy_from_slice(&from.as_slice()[3 * *free as usize..][..3]);
                }
            }
        }
        let w = Mat::<f32>::from_fn(w.nrows(), w.ncols(), |i, j| w[(i, j)] as f32);
        let mut product = Mat::<f32>::zeros(3 * nodes.len(), w.ncols());
        matmul(product.as_mut(), Accum::Replace, gathered.as_ref(), w.as_ref(), -1.0, Par::Seq);
        DMatrix::from_fn(product.nrows(), product.ncols(), |i, j| f64::from(product[(i, j)]))
    }

    /// Edges of the mesh, once each.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges: Vec<[u32; 2]> =
            self.splitter.mesh.tets.iter().flat_map(crate::mesh::edges_of).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Places of all nodes with these coefficients of the columns, about the centre, m.
    pub fn places(&mut self, moved: &Moved, coefficients: &[f64]) -> Result<Vec<Vector3<f64>>, String> {
        let c = DVector::from_iterator(
            moved.w.ncols(),
            (0..moved.w.ncols()).map(|k| coefficients.get(k).copied().unwrap_or(0.0)),
        );
        let mut by_cut = DVector::<f32>::zeros(3 * self.partition.free.len());
        let apart = &moved.w * c;
        for (j, x) in moved.x.iter().enumerate() {
            let own = apart.fixed_rows::<3>(3 * j).into_owned().cast::<f32>();
            by_cut.gemv(-1.0, &**x, &own, 1.0);
        }
        let whole = self.whole()?;
        let axis = |row: usize| whole.row(row).iter().zip(coefficients).map(|(u, c)| u * c).sum::<f64>();
        let mut u: Vec<Vector3<f64>> = (0..whole.nodes)
            .map(|node| Vector3::new(axis(3 * node), axis(3 * node + 1), axis(3 * node + 2)))
            .collect();
        for (free, node) in self.partition.free.iter().enumerate() {
            u[*node as usize] += by_cut.fixed_rows::<3>(3 * free).into_owned().cast::<f64>();
        }
        Ok(self.splitter.mesh.nodes.iter().zip(u).map(|(x, u)| x - self.centre + u).collect())
    }
}

/// W with (H - G X) W = -G U, and by how much it misses that. The error says that the cut body moves freely somewhere.
fn solved(system: &DMatrix<f64>, gu: &DMatrix<f64>) -> Result<(DMatrix<f64>, f64), String> {
    if system.is_empty() {
        return Ok((gu.clone(), 0.0));
    }
    let loose = || {
        "a part of the body would hang on a single node or edge, about which it could turn freely".to_owned()
    };
    let n = system.nrows();
    let scale = system.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaled = Mat::from_fn(n, n, |i, j| 0.5 * (system[(i, j)] + system[(j, i)]) * scale[i] * scale[j]);
    let mut factor = scaled.clone();
    let scratch = cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default())
        .or(solve_in_place_scratch::<f64>(n, gu.ncols(), Par::Seq));
    let mut memory = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut memory);
    let regularisation = LltRegularization::default();
    cholesky_in_place(factor.as_mut(), regularisation, Par::Seq, stack, Spec::default())
        .map_err(|_not_definite| loose())?;
    if (0..n).any(|i| factor[(i, i)].powi(2) < SINGULAR) {
        return Err(loose());
    }
    let b = Mat::from_fn(n, gu.ncols(), |i, j| -gu[(i, j)] * scale[i]);
    let mut found = b.clone();
    solve_in_place(factor.as_ref(), found.as_mut(), Par::Seq, stack);
    let mut misses = b.clone();
    matmul(misses.as_mut(), Accum::Add, scaled.as_ref(), found.as_ref(), -1.0, Par::Seq);
    let missed = misses.norm_max() / b.norm_max().max(f64::MIN_POSITIVE);
    Ok((DMatrix::from_fn(n, gu.ncols(), |i, j| found[(i, j)] * scale[i]), missed))
}
