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
//! 35(2), 2016), in which the copies stand in place of changed entries of K. A longer cut leaves most copies as they are: their columns of
//! X are kept.

use super::solves::Solves;
use crate::fem::tet4::{Geometry, geometry, stiffness_block};
use crate::fem::{Element, Lame, NodeFields, Partition};
use crate::green::{ControlElement, FIELDS, NewSurface, Volume};
use crate::mesh::quality;
use crate::mesh::split::{CutEdges, Split, Splitter};
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A pivot of the scaled H - G X below which it holds no digits.
const SINGULAR: f64 = 1e-11;

/// A body that can be cut.
pub struct Cuttable {
    pub splitter: Splitter,
    lame: Vec<Lame>,
    pub held: Vec<bool>,
    /// Node of the mesh of each node of the surface, and the other way round.
    surface: Vec<u32>,
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
    /// X of copies, by what they depend on.
    known: BTreeMap<CopyKey, Arc<NodeFields>>,
}

/// A copy's node, and the pieces that move with it: their tetrahedra, and the bits of their shares.
type CopyKey = (u32, Vec<(u32, u64)>);

/// A row of G: blocks of the nodes of the mesh.
type Row = BTreeMap<u32, Matrix3<f64>>;

/// The cut body.
pub struct Opened {
    pub split: Split,
    pub surface: NewSurface,
    /// U' over all nodes of the mesh.
    pub fields: NodeFields,
    /// Part of its largest number by which (H - G X) W misses -G U.
    pub missed: f64,
    /// Part of its largest number by which S' misses its transpose.
    pub asymmetry: f64,
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
        let mut held = vec![true; count];
        let mut free_at = vec![None; count];
        for (at, node) in (0..).zip(&partition.free) {
            held[*node as usize] = false;
            free_at[*node as usize] = Some(at);
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
            known: BTreeMap::new(),
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
        self.whole.as_ref().ok_or_else(String::new)
    }

    /// [`Cuttable::whole`] once it is known.
    pub fn whole_now(&self) -> Option<&NodeFields> {
        self.whole.as_ref()
    }

    /// The body after these cuts, which do not let it fall apart.
    pub fn open(&mut self, cut: &CutEdges) -> Result<Opened, String> {
        self.whole()?;
        let split = self.splitter.split(cut, &self.held);
        let (rows, h, keys) = self.couplings(&split);
        self.solve_copies(&rows, &keys)?;
        let Some(whole) = &self.whole else { return Err(String::new()) };
        let (columns, n) = (whole.columns, rows.len());
        let x: Vec<&NodeFields> = keys.iter().filter_map(|key| self.known.get(key).map(|x| &**x)).collect();
        let mut system = DMatrix::zeros(3 * n, 3 * n);
        let mut gu = DMatrix::zeros(3 * n, columns);
        for (i, row) in rows.iter().enumerate() {
            for (node, block) in row {
                let mut own = gu.rows_mut(3 * i, 3);
                own += block * block_of(whole, *node);
                let Some(free) = self.free_at[*node as usize] else { continue };
                for (j, x) in x.iter().enumerate() {
                    let mut own = system.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                    own -= block * block_of(x, free);
                }
            }
        }
        for ((i, j), block) in &h {
            let mut own = system.fixed_view_mut::<3, 3>(3 * i, 3 * j);
            own += block;
        }
        let (w, missed) = solved(&system, &gu)?;
        let mut fields = whole.clone();
        for (free, node) in self.partition.free.iter().enumerate() {
            for (j, x) in x.iter().enumerate() {
                let moved = block_of(x, free as u32) * w.rows(3 * j, 3);
                for axis in 0..3 {
                    let row = fields.row_mut(3 * *node as usize + axis);
                    row.iter_mut().zip(moved.row(axis).iter()).for_each(|(to, by)| *to -= by);
                }
            }
        }
        let stiffness = &self.stiffness + w.tr_mul(&gu);
        let asymmetry = (&stiffness - stiffness.transpose()).amax() / stiffness.amax();
        let stiffness = (&stiffness + stiffness.transpose()) * 0.5;
        let surface = self.surface_of(&split, &fields, &w, stiffness)?;
        Ok(Opened { split, surface, fields, missed, asymmetry })
    }

    fn geometry(&self, tet: u32) -> Option<Geometry> {
        geometry(self.splitter.mesh.corners(tet as usize))
    }

    /// G row by row, the blocks of H, and what each copy's X depends on.
    fn couplings(&self, split: &Split) -> (Vec<Row>, BTreeMap<(usize, usize), Matrix3<f64>>, Vec<CopyKey>) {
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
        (rows, h, keys)
    }

    /// Finds X of the copies whose is not known, and forgets those of copies that are no more.
    fn solve_copies(&mut self, rows: &[Row], keys: &[CopyKey]) -> Result<(), String> {
        let missing: Vec<usize> = (0..keys.len()).filter(|i| !self.known.contains_key(&keys[*i])).collect();
        if !missing.is_empty() {
            let mut b = NodeFields::zeros(self.partition.free.len(), 3 * missing.len());
            for (k, i) in missing.iter().enumerate() {
                for (node, block) in &rows[*i] {
                    let Some(free) = self.free_at[*node as usize] else { continue };
                    for axis in 0..3 {
                        for other in 0..3 {
                            b.row_mut(3 * free as usize + axis)[3 * k + other] = block[(other, axis)];
                        }
                    }
                }
            }
            let x = self.solves.solve(b)?;
            for (k, i) in missing.iter().enumerate() {
                let mut own = NodeFields::zeros(x.nodes, 3);
                let rows = own.data.chunks_exact_mut(3).zip(x.data.chunks_exact(x.columns));
                rows.for_each(|(to, from)| to.copy_from_slice(&from[3 * k..3 * k + 3]));
                self.known.insert(keys[*i].clone(), Arc::new(own));
            }
        }
        let used: std::collections::BTreeSet<&CopyKey> = keys.iter().collect();
        self.known.retain(|key, _| used.contains(key));
        Ok(())
    }

    /// The surface of the cut body with its columns.
    fn surface_of(
        &self,
        split: &Split,
        fields: &NodeFields,
        w: &DMatrix<f64>,
        stiffness: DMatrix<f64>,
    ) -> Result<NewSurface, String> {
        let count = self.splitter.mesh.nodes.len();
        let value = |node: u32| match (node as usize).checked_sub(count) {
            None => block_of(fields, node),
            Some(copy) => block_of(fields, split.copies[copy]) + w.rows(3 * copy, 3),
        };
        let old = self.surface.len();
        let mut columns = DMatrix::zeros(3 * (old + split.points.len()), fields.columns);
        for (at, node) in self.surface.iter().enumerate() {
            columns.rows_mut(3 * at, 3).copy_from(&value(*node));
        }
        let mut points = Vec::new();
        for (at, point) in split.points.iter().enumerate() {
            let [a, b] = point.nodes.map(value);
            columns.rows_mut(3 * (old + at), 3).copy_from(&(a * (1.0 - point.share) + b * point.share));
            let [a, b] = point.nodes.map(|node| self.splitter.place(split, node));
            points.push((a.lerp(&b, point.share) - self.centre).cast::<f32>().into());
        }
        let number = |node: u32| match (node as usize).checked_sub(count) {
            None => self.surface_of[node as usize],
            Some(point) => Some((old + point) as u32),
        };
        let triangle = |nodes: &[u32; 3]| Some([number(nodes[0])?, number(nodes[1])?, number(nodes[2])?]);
        let triangles: Option<Vec<_>> = split.triangles.iter().map(triangle).collect();
        let triangles = triangles.ok_or("a node of the cut surface is none of the surface")?;
        Ok(NewSurface { points, triangles, columns, stiffness })
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
    pub fn places(&self, fields: &NodeFields, coefficients: &[f64]) -> Vec<Vector3<f64>> {
        let axis = |row: usize| fields.row(row).iter().zip(coefficients).map(|(u, c)| u * c).sum::<f64>();
        let place = |(node, x): (usize, &Vector3<f64>)| {
            x - self.centre + Vector3::new(axis(3 * node), axis(3 * node + 1), axis(3 * node + 2))
        };
        self.splitter.mesh.nodes.iter().enumerate().map(place).collect()
    }
}

/// The rows of a node, 3 × columns.
fn block_of(fields: &NodeFields, node: u32) -> DMatrix<f64> {
    let first = 3 * node as usize * fields.columns;
    DMatrix::from_row_slice(3, fields.columns, &fields.data[first..first + 3 * fields.columns])
}

/// W with (H - G X) W = -G U, and by how much it misses that. The error says that the cut body moves freely somewhere.
fn solved(system: &DMatrix<f64>, gu: &DMatrix<f64>) -> Result<(DMatrix<f64>, f64), String> {
    if system.is_empty() {
        return Ok((gu.clone(), 0.0));
    }
    let loose = || "the cut body holds together too little to be solved for".to_owned();
    let scale = system.diagonal().map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 0.0 });
    let scaled = DMatrix::from_fn(system.nrows(), system.ncols(), |i, j| {
        0.5 * (system[(i, j)] + system[(j, i)]) * scale[i] * scale[j]
    });
    let factor = scaled.clone().cholesky().ok_or_else(loose)?;
    if factor.l_dirty().diagonal().iter().any(|pivot| pivot.powi(2) < SINGULAR) {
        return Err(loose());
    }
    let b = DMatrix::from_fn(gu.nrows(), gu.ncols(), |i, j| -gu[(i, j)] * scale[i]);
    let found = factor.solve(&b);
    let missed = (&scaled * &found - &b).amax() / b.amax().max(f64::MIN_POSITIVE);
    Ok((DMatrix::from_fn(found.nrows(), found.ncols(), |i, j| found[(i, j)] * scale[i]), missed))
}
