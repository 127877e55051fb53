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
//! with a column of W for each of U. Under gravity f at the nodes and g at the copies, W of its columns G' = A⁻¹f has g - G G' for -G U; what
//! forces and energies need of both are entries of Wᵀ (g - G U), too. This is the augmented system of Y.-H. Yeung, J. Crouch and A. Pothen (ACM Transactions on Graphics
//! 35(2), 2016), in which the copies stand in place of changed entries of K. A longer cut leaves most copies as they are: their X and G X
//! are kept. G X is f64; X, of which only what is shown follows, is f32. What falls off is no part of the body any more ([`loose`]).

use super::couplings::{CopyKey, Couplings, Row};
use super::loose;
use super::point_fields::PointFields;
use super::solves::{Solves, TOGETHER};
use super::system::System;
use super::yielding::{Corner, Corners, Rows, Yielding, apart};
use crate::base::machine;
use crate::fem::{Element, Lame, NodeFields, Partition};
use crate::green::{ControlElement, FIELDS, NewSurface, NewWeight, SolvedCompliance, Volume};
use crate::mesh::quality;
use crate::mesh::split::{CutEdges, CutPoint, CutSurface, Split, Splitter};
use faer::Mat;
use nalgebra::{DMatrix, Matrix3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

type V3 = Vector3<f64>;

/// Frames that a step of a cut takes at least; free nodes of the mesh for which it takes one more, and edges times free nodes.
pub const LEAST_FRAMES: u32 = 2;
const NODES_A_FRAME: usize = 2000;
const EDGES_A_FRAME: usize = 60_000;
/// The most frames: where a step takes longer, the frame in which it is taken waits.
const MOST_FRAMES: usize = 20;

/// A cut body is refused whose equations are missed by a larger part than this.
const INEXACT: f64 = 1e-7;

/// The tables of a whole body.
pub struct Tables {
    /// Handle stiffness.
    pub stiffness: DMatrix<f64>,
    /// UᵀF and FᵀG of gravity, where it acts.
    pub weight: Option<[DMatrix<f64>; 2]>,
    /// Whether forces act at single nodes of the surface.
    pub takes_points: bool,
}

/// A body that can be cut.
pub struct Cuttable {
    pub splitter: Splitter,
    lame: Vec<Lame>,
    pub(super) density: Vec<f64>,
    /// Control element that holds each node.
    held: Vec<Option<usize>>,
    /// Node of the mesh of each node of the surface.
    surface: Vec<u32>,
    /// Node of the surface of each node of the mesh.
    surface_of: Vec<Option<u32>>,
    /// Mesh coordinates of the origin of the .green file's lengths, m.
    pub centre: V3,
    pub(super) partition: Partition,
    /// Place of each node among the free ones.
    pub(super) free_at: Arc<Vec<Option<u32>>>,
    pub(super) fields: Arc<PointFields>,
    /// U and the columns of gravity over all nodes, once they are needed first.
    whole: OnceLock<Arc<NodeFields>>,
    /// Their right-hand sides.
    loads: NodeFields,
    prescribed: NodeFields,
    pub(super) tables: Tables,
}

/// Data on the copies of a cut.
#[derive(Default)]
pub struct Known {
    /// Number of each copy among `x` and in `gx`.
    places: BTreeMap<CopyKey, usize>,
    /// X of each, 3 free nodes × 3.
    x: Vec<Arc<DMatrix<f32>>>,
    /// G X, 3 n × 3 n.
    gx: DMatrix<f64>,
}

/// The cut body.
pub struct Opened {
    pub surface: NewSurface,
    pub moved: Moved,
    pub known: Known,
    /// Part of its largest number by which (H - G X) W misses its right-hand side, or by which S' misses its transpose.
    pub error: f64,
}

/// The motion of all nodes beyond that of the whole body.
pub struct Moved {
    /// U and the columns of gravity over all nodes where something has fallen off, without its weight.
    whole: Option<Arc<NodeFields>>,
    /// -X W at all free nodes, row after row; empty while nothing is cut.
    beyond: Vec<f32>,
    yielding: Arc<Yielding>,
}

impl Moved {
    /// The node of the mesh on whose side a point of the surface lies.
    pub fn node_of(&self, point: u32) -> Option<u32> {
        self.yielding.node_of(point)
    }
}

/// A shape of a body: coefficients of its columns, and forces at nodes of its mesh.
pub struct Shape<'a> {
    pub coefficients: &'a [f64],
    pub forces: &'a [(u32, V3)],
}

impl Cuttable {
    /// A body with these control elements' names; starts the thread that factorises it. The error says why it cannot be cut.
    pub fn new(
        volume: Volume,
        names: &[&str],
        centre: Vector3<f64>,
        tables: Tables,
    ) -> Result<Cuttable, String> {
        let Volume { element, mesh, lame, held: of_controls, surface, forces, density } = volume;
        let k = Element::assemble(element, &mesh, &lame).map_err(|error| error.to_string())?;
        let count = mesh.nodes.len();
        let (weights, densities) = if tables.weight.is_some() { (3, mesh.tets.len()) } else { (0, 0) };
        if forces.ncols() != weights || density.len() != densities {
            return Err(
                "its file does not have what gravity does to its pieces: run `greenstage precompute --force`"
                    .to_owned(),
            );
        }
        let (low, high) = quality::bounding_box(&mesh.nodes);
        let affine = FIELDS * of_controls.len();
        let mut prescribed = NodeFields::zeros(count, affine + forces.ncols());
        for (e, (name, nodes)) in names.iter().zip(&of_controls).enumerate() {
            let control = ControlElement::new(name, nodes.clone(), &mesh, (high - low).norm());
            control.prescribe(&mesh.nodes, FIELDS * e, &mut prescribed);
        }
        let partition = Partition::new(count, of_controls.iter().flatten().copied());
        let mut loads = partition.minus_b_times(&k, &prescribed);
        let mut free_at = vec![None; count];
        for (at, node) in (0..).zip(&partition.free) {
            free_at[*node as usize] = Some(at);
            for axis in 0..3 {
                let row = &mut loads.row_mut(3 * at as usize + axis)[affine..];
                row.iter_mut().zip(forces.row(3 * *node as usize + axis).iter()).for_each(|(to, f)| *to = *f);
            }
        }
        let mut held = vec![None; count];
        for (e, nodes) in of_controls.iter().enumerate() {
            nodes.iter().for_each(|node| held[*node as usize] = Some(e));
        }
        let mut surface_of = vec![None; count];
        (0..).zip(&surface).for_each(|(at, node)| surface_of[*node as usize] = Some(at));
        let solves = Solves::start(partition.a(&k));
        Ok(Cuttable {
            fields: Arc::new(PointFields::new(solves, partition.free.len())),
            splitter: Splitter::new(Arc::new(mesh)),
            lame,
            density,
            held,
            surface,
            surface_of,
            centre,
            partition,
            free_at: Arc::new(free_at),
            whole: OnceLock::new(),
            loads,
            prescribed,
            tables,
        })
    }

    /// Handle stiffness of the whole body.
    #[cfg(test)]
    pub fn stiffness(&self) -> &DMatrix<f64> {
        &self.tables.stiffness
    }

    /// U and the columns of gravity of the whole body over all nodes.
    pub fn whole(&self) -> Result<&Arc<NodeFields>, String> {
        if let Some(whole) = self.whole.get() {
            return Ok(whole);
        }
        let free = self.fields.solve(self.loads.clone())?;
        let mut fields = self.prescribed.clone();
        self.partition.insert_free(&free, &mut fields);
        Ok(self.whole.get_or_init(|| Arc::new(fields)))
    }

    /// Frames in which a step of a cut with so many edges is worked out in the background: as many as that should take, and the same in a
    /// replay.
    pub fn frames(&self, edges: usize) -> u32 {
        let free = self.partition.free.len();
        let frames = LEAST_FRAMES as usize + free / NODES_A_FRAME + edges * free / EDGES_A_FRAME;
        frames.min(MOST_FRAMES) as u32
    }

    /// The mesh after these cuts.
    pub fn split(&self, cut: &CutEdges) -> Split {
        self.splitter.split(cut, &self.held)
    }

    /// The motion of the body while it is whole: none beyond its own.
    pub fn unmoved(&self) -> Result<Moved, String> {
        let surface = self.corners_of(&Split::default(), &CutSurface::default());
        let system = System::new(&DMatrix::zeros(0, 0), Vec::new())?;
        let yielding = self.yielding(Vec::new(), system, (surface, &Split::default()), Rows::default());
        Ok(Moved { whole: None, beyond: Vec::new(), yielding: Arc::new(yielding) })
    }

    fn yielding(
        &self,
        x: Vec<Arc<DMatrix<f32>>>,
        system: System,
        (surface, split): (Vec<Corners>, &Split),
        rows: Rows,
    ) -> Yielding {
        let moves = |corner: &Corner| corner.copy.is_some() || self.free_at[corner.node as usize].is_some();
        let number = |corner: &Corner| match corner.copy {
            None => corner.node,
            Some(copy) => (self.splitter.mesh.nodes.len() + copy) as u32,
        };
        let takes = |(_, corners): &(u32, &Corners)| {
            corners.iter().any(moves) && !corners.iter().any(|corner| split.is_loose(number(corner)))
        };
        let taking = (0..).zip(&surface).filter(takes).map(|(node, _)| node).collect();
        let (fields, free_at) = (self.fields.clone(), self.free_at.clone());
        Yielding { fields, free_at, x, system, surface, taking, rows }
    }

    /// The body after cuts by which its mesh has fallen into these pieces, with what is known of an earlier cut. The error says why there is
    /// none.
    pub fn open(&self, known: &Known, split: &Split, opened: &CutSurface) -> Result<Opened, String> {
        let lost = loose::lost(&self.splitter, split, |tet| self.mass(tet));
        let whole = &self.whole_without(&lost)?;
        let couplings = Couplings::new(&self.splitter, split, &self.lame, &self.density);
        let known = self.solve_copies(known, &couplings.rows, couplings.keys.clone())?;
        let acting = self.on_copies(&couplings, whole);
        let free = loose::rigid_motions(&self.splitter, split);
        let system = System::new(&couplings.system(&known.gx), free)?;
        let (w, missed) = system.solve(&acting);
        let work = w.tr_mul(&acting);
        let affine = self.tables.stiffness.nrows();
        let stiffness = &self.tables.stiffness - work.view((0, 0), (affine, affine));
        let asymmetry = (&stiffness - stiffness.transpose()).amax() / stiffness.amax();
        let error = missed.max(asymmetry);
        if error.is_nan() || error > INEXACT {
            return Err(format!(
                "the forces of the cut body could be wrong by a part of {error:.0e}, above {INEXACT:.0e}"
            ));
        }
        let surface = self.corners_of(split, opened);
        let beyond = apart(&known.x, &w, 3 * self.partition.free.len());
        let columns = self.columns_of(whole, &surface, &beyond, &w);
        let rows = if self.tables.takes_points { self.rows(&surface, &known.x) } else { Rows::default() };
        let yielding = Arc::new(self.yielding(known.x.clone(), system, (surface, split), rows));
        let weight = self.weight_without(&lost, [self.whole()?, whole]);
        let weight = weight.map(|[reaction, compliance, lost]| NewWeight {
            columns: columns.columns(affine, 3).into_owned(),
            reaction: reaction + work.view((0, affine), (affine, 3)),
            compliance: compliance + work.view((affine, affine), (3, 3)),
            lost,
        });
        let of_points: Option<Arc<dyn SolvedCompliance>> =
            if self.tables.takes_points { Some(yielding.clone()) } else { None };
        let surface = NewSurface {
            points: self.points_of(split, opened),
            triangles: self.triangles_of(split, opened)?,
            held: self.held_of(opened),
            columns: columns.columns(0, affine).into_owned(),
            stiffness: (&stiffness + stiffness.transpose()) * 0.5,
            weight,
            compliance: of_points,
        };
        let whole = (!lost.is_empty()).then(|| whole.clone());
        Ok(Opened { surface, moved: Moved { whole, beyond, yielding }, known, error })
    }

    /// g - G U: what acts on the copies while they move with their nodes.
    fn on_copies(&self, couplings: &Couplings, whole: &NodeFields) -> DMatrix<f64> {
        let mut acting = DMatrix::zeros(3 * couplings.rows.len(), whole.columns);
        for (i, row) in couplings.rows.iter().enumerate() {
            for (node, block) in row {
                for axis in 0..3 {
                    let u = whole.row(3 * *node as usize + axis);
                    for (k, u) in u.iter().enumerate() {
                        (0..3).for_each(|r| acting[(3 * i + r, k)] -= block[(r, axis)] * u);
                    }
                }
            }
            let affine = self.tables.stiffness.nrows();
            let weights = (0..3).zip(affine..whole.columns);
            weights.for_each(|(axis, k)| acting[(3 * i + axis, k)] += couplings.masses[i]);
        }
        acting
    }

    /// Data on the copies after one more step on the way to a cut, as if the body had been opened there.
    pub fn follow(&self, known: &Known, split: &Split) -> Result<Known, String> {
        let Couplings { rows, keys, .. } = Couplings::new(&self.splitter, split, &self.lame, &[]);
        self.solve_copies(known, &rows, keys)
    }

    /// X and G X of these copies, solved where they are not known.
    fn solve_copies(&self, known: &Known, rows: &[Row], keys: Vec<CopyKey>) -> Result<Known, String> {
        let before: Vec<Option<usize>> = keys.iter().map(|key| known.places.get(key).copied()).collect();
        let missing: Vec<usize> = (0..keys.len()).filter(|i| before[*i].is_none()).collect();
        let (free, copies) = (self.partition.free.len() as f64, keys.len() as f64);
        let need = 72.0 * free * copies + 144.0 * missing.len() as f64 * free + 216.0 * copies * copies;
        let of = format!("A cut with {copies} copies of nodes");
        machine::fits(of, need, 0.0).map_err(|error| error.to_string())?;
        let mut x = NodeFields::zeros(self.partition.free.len(), 3 * missing.len());
        for (part, some) in missing.chunks(TOGETHER).enumerate() {
            let own = self.solve_rows(some.iter().map(|i| &rows[*i]))?;
            for row in 0..3 * x.nodes {
                x.row_mut(row)[3 * TOGETHER * part..][..own.columns].copy_from_slice(own.row(row));
            }
        }
        let mut gx = DMatrix::zeros(3 * keys.len(), 3 * keys.len());
        for (i, was) in before.iter().enumerate() {
            let Some(was) = was else { continue };
            for (j, other) in before.iter().enumerate() {
                let Some(other) = other else { continue };
                let block = known.gx.fixed_view::<3, 3>(3 * was, 3 * other);
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
            before.iter().map(|was| was.map(|was| known.x[was].clone())).collect();
        for (k, i) in missing.iter().enumerate() {
            let own = DMatrix::from_fn(3 * x.nodes, 3, |row, other| x.row(row)[3 * k + other] as f32);
            columns[*i] = Some(Arc::new(own));
        }
        let places = keys.into_iter().zip(0..).collect();
        Ok(Known { places, x: columns.into_iter().flatten().collect(), gx })
    }

    /// A⁻¹ Gᵀ of these rows of G.
    fn solve_rows<'a>(
        &self,
        rows: impl ExactSizeIterator<Item = &'a Row> + Clone,
    ) -> Result<NodeFields, String> {
        let all = rows.clone().flat_map(|row| self.free_blocks(row).map(|(free, _)| free));
        let loaded: Vec<u32> = all.collect::<BTreeSet<u32>>().into_iter().collect();
        let mut b = NodeFields::zeros(loaded.len(), 3 * rows.len());
        for (k, row) in rows.enumerate() {
            for (free, block) in self.free_blocks(row) {
                let at = loaded.partition_point(|other| *other < free);
                for axis in 0..3 {
                    let row = &mut b.row_mut(3 * at + axis)[3 * k..3 * k + 3];
                    row.iter_mut().enumerate().for_each(|(other, to)| *to = block[(other, axis)]);
                }
            }
        }
        self.fields.solve_at(loaded, b)
    }

    /// The blocks of a row of G at free nodes.
    fn free_blocks<'a>(&'a self, row: &'a Row) -> impl Iterator<Item = (u32, &'a Matrix3<f64>)> {
        row.iter().filter_map(|(node, block)| Some((self.free_at[*node as usize]?, block)))
    }

    /// The nodes of which each point of the cut surface is the sum.
    fn corners_of(&self, split: &Split, opened: &CutSurface) -> Vec<Corners> {
        let count = self.splitter.mesh.nodes.len();
        let alone = |node: &u32| vec![Corner { node: *node, copy: None, share: 1.0 }];
        let mut surface: Vec<Corners> = self.surface.iter().map(alone).collect();
        surface.extend(opened.points.iter().map(|point| {
            let shares = [1.0 - point.share, point.share];
            let corner = |(node, share): (u32, f64)| Corner {
                node: split.original(node, count),
                copy: (node as usize).checked_sub(count),
                share,
            };
            point.nodes.into_iter().zip(shares).map(corner).collect()
        }));
        surface
    }

    /// X of these copies at the nodes of a surface.
    fn rows(&self, surface: &[Corners], of_copies: &[Arc<DMatrix<f32>>]) -> Rows {
        let nodes = surface.iter().flatten().map(|corner| corner.node);
        let mut nodes: Vec<u32> = nodes.filter(|node| self.free_at[*node as usize].is_some()).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut x = Mat::<f32>::zeros(3 * nodes.len(), 3 * of_copies.len());
        for (j, own) in of_copies.iter().enumerate() {
            for k in 0..3 {
                let (from, to) = (own.column(k), x.col_as_slice_mut(3 * j + k));
                for (to, node) in to.chunks_exact_mut(3).zip(&nodes) {
                    let Some(free) = self.free_at[*node as usize] else { continue };
                    to.copy_from_slice(&from.as_slice()[3 * free as usize..][..3]);
                }
            }
        }
        Rows { of: nodes.into_iter().zip(0..).collect(), x }
    }

    /// U - X W at the points of a surface, with W at the copies.
    fn columns_of(
        &self,
        whole: &NodeFields,
        surface: &[Corners],
        beyond: &[f32],
        w: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let mut columns = DMatrix::zeros(3 * surface.len(), whole.columns);
        for (at, corners) in surface.iter().enumerate() {
            for Corner { node, copy, share } in corners {
                let free = self.free_at[*node as usize].map(|free| 3 * free as usize);
                for axis in 0..3 {
                    let u = whole.row(3 * *node as usize + axis);
                    for (k, u) in u.iter().enumerate() {
                        let own = free.map_or(0.0, |row| f64::from(beyond[(row + axis) * whole.columns + k]));
                        let apart = copy.map_or(0.0, |copy| w[(3 * copy + axis, k)]);
                        columns[(3 * at + axis, k)] += share * (u + own + apart);
                    }
                }
            }
        }
        columns
    }

    /// Places at rest of the points beyond the nodes, about the centre.
    fn points_of(&self, split: &Split, opened: &CutSurface) -> Vec<[f32; 3]> {
        let place = |point: &CutPoint| {
            let [a, b] = point.nodes.map(|node| self.splitter.place(split, node));
            (a.lerp(&b, point.share) - self.centre).cast::<f32>().into()
        };
        opened.points.iter().map(place).collect()
    }

    /// The points that belong to each control element: those between two of its nodes. A copy is not held.
    fn held_of(&self, opened: &CutSurface) -> Vec<Vec<u32>> {
        let mut held = vec![Vec::new(); self.tables.stiffness.nrows() / FIELDS];
        for (at, point) in (self.surface.len() as u32..).zip(&opened.points) {
            let [a, b] = point.nodes.map(|node| self.held.get(node as usize).copied().flatten());
            if let (Some(e), true) = (a, a == b) {
                held[e].push(at);
            }
        }
        held
    }

    fn triangles_of(&self, split: &Split, opened: &CutSurface) -> Result<Vec<[u32; 3]>, String> {
        let count = self.splitter.mesh.nodes.len();
        let old = self.surface.len();
        let number = |node: u32| match (node as usize).checked_sub(count) {
            None => self.surface_of[node as usize],
            Some(point) => Some((old + point) as u32),
        };
        let triangle = |nodes: &[u32; 3]| Some([number(nodes[0])?, number(nodes[1])?, number(nodes[2])?]);
        let is_held = |nodes: &&[u32; 3]| !split.is_loose(opened.corner(nodes[0], count));
        let triangles: Option<Vec<_>> = opened.triangles.iter().filter(is_held).map(triangle).collect();
        triangles.ok_or_else(|| {
            format!("a node of the surface cut with {} copies is none of the surface", split.copies.len())
        })
    }

    /// Edges of the mesh, once each.
    pub fn edges(&self) -> Vec<[u32; 2]> {
        let mut edges: Vec<[u32; 2]> =
            self.splitter.mesh.tets.iter().flat_map(crate::mesh::edges_of).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Places of all nodes of a shape, about the centre, m.
    pub fn places(&self, moved: &Moved, shape: &Shape<'_>) -> Result<Vec<V3>, String> {
        let c = shape.coefficients;
        let pressed = moved.yielding.field(shape.forces)?;
        let whole = moved.whole.as_ref().map_or_else(|| self.whole(), Ok)?;
        let width = whole.columns;
        let beyond = |row: usize| {
            let motion = moved.beyond.get(row * width..).unwrap_or_default().iter().zip(c).take(width);
            let by_motion: f64 = motion.map(|(u, c)| f64::from(*u) * c).sum();
            by_motion + pressed.get(row).copied().map_or(0.0, f64::from)
        };
        let axis = |row: usize| whole.row(row).iter().zip(c).map(|(u, c)| u * c).sum::<f64>();
        let place = |(node, x): (usize, &V3)| {
            let u = V3::from_fn(|k, _| axis(3 * node + k));
            let free = self.free_at[node].map(|free| 3 * free as usize);
            x - self.centre + u + free.map_or_else(V3::zeros, |row| V3::from_fn(|k, _| beyond(row + k)))
        };
        Ok(self.splitter.mesh.nodes.iter().enumerate().map(place).collect())
    }
}
