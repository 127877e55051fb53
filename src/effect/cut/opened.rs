//! The columns of a cut body, from the factor of a base: the whole body, or it as it was cut before.
//!
//! In: a base with its affine columns U, factor A and handle stiffness S, and a [`Split`]. Out: the columns and the stiffness of the cut
//! body. With w the displacement of each copy beyond that of its node of the base, a piece p of tetrahedron e, with its share φ of the
//! volume, moves by u + J w, and the energy of the cut body is
//!
//! ```text
//! ½ uᵀK u + wᵀG u + ½ wᵀH w        G = Σ_p φ Jᵀ K_e        H = Σ_p φ Jᵀ K_e J
//! ```
//!
//! since the shares of all that becomes of a piece of the base add up to its own. From 0 = G u + H w and 0 = K u + Gᵀ w at the free nodes
//! follow, with X = A⁻¹ Gᵀ,
//!
//! ```text
//! (H - G X) W = -G U        U' = U - A⁻¹ (Gᵀ W)        S' = S + Wᵀ G U
//! ```
//!
//! with a column of W for each of U. Under gravity f at the nodes and g at the copies, W of its columns G' = A⁻¹f has g - G G' for -G U; what
//! forces and energies need of both are entries of Wᵀ (g - G U), too. This is the augmented system of Y.-H. Yeung, J. Crouch and A. Pothen (ACM Transactions on Graphics
//! 35(2), 2016), in which the copies stand in place of changed entries of K. A longer cut leaves most copies as they are: their G X is
//! kept. When they are too many, the cut body gets a factor of its own and is the next base. What falls off is no part of the body any
//! more ([`loose`]).

use super::base::{Base, Tables};
use super::couplings::{CopyKey, Couplings, FreeRows};
use super::descent::Descent;
use super::loose;
use super::matter::Matter;
use super::point_fields::PointFields;
use super::system::System;
use super::yielding::{Corner, Corners, Yielding};
use crate::base::extent::bounding_box;
use crate::base::machine;
use crate::fem::{Element, NodeFields};
use crate::green::{ControlElement, FIELDS, NewSurface, NewWeight, SolvedCompliance, Volume};
use crate::mesh::split::{CutEdges, CutPoint, CutSurface, Split, Splitter};
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Copies that are solved for together.
const TOGETHER: usize = 8;

/// A cut body is refused whose equations are missed by a larger part than this.
const INEXACT: f64 = 1e-7;

/// A body that can be cut.
pub struct Cuttable {
    pub matter: Matter,
    /// The body as it is whole.
    pub base: Arc<Base>,
    /// Node of the mesh of each node of the surface.
    surface: Vec<u32>,
    /// Node of the surface of each node of the mesh.
    surface_of: Vec<Option<u32>>,
}

/// Data on the copies of a cut.
#[derive(Default)]
pub struct Known {
    /// Number of each copy in `gx`.
    places: BTreeMap<CopyKey, usize>,
    /// G X, 3 n × 3 n.
    gx: DMatrix<f64>,
}

impl Known {
    /// Number of copies.
    pub fn count(&self) -> usize {
        self.places.len()
    }
}

/// The cut body.
pub struct Opened {
    pub surface: NewSurface,
    pub moved: Moved,
    pub known: Known,
    /// Part of its largest number by which (H - G X) W misses its right-hand side, or by which S' misses its transpose.
    pub error: f64,
}

/// The motion of all nodes of a base.
pub struct Moved {
    /// U' and the columns of gravity over them; `None` of the whole body.
    fields: Option<NodeFields>,
    yielding: Arc<Yielding>,
}

impl Moved {
    pub fn base(&self) -> &Arc<Base> {
        &self.yielding.base
    }

    /// Drops what was found for forces at single nodes.
    pub fn forget(&self) {
        self.yielding.fields.forget();
    }

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
        let Volume { element, mesh, lame, held, surface, forces, density } = volume;
        let k = Element::assemble(element, &mesh, &lame).map_err(|error| error.to_string())?;
        let (weights, densities) = if tables.weight.is_some() { (3, mesh.tets.len()) } else { (0, 0) };
        if forces.ncols() != weights || density.len() != densities {
            return Err(
                "its file does not have what gravity does to its pieces: run `greenstage precompute --force`"
                    .to_owned(),
            );
        }
        let (low, high) = bounding_box(&mesh.nodes);
        let control =
            |(name, nodes): (&&str, Vec<u32>)| ControlElement::new(name, nodes, &mesh, (high - low).norm());
        let controls = names.iter().zip(held).map(control).collect();
        let mut surface_of = vec![None; mesh.nodes.len()];
        (0..).zip(&surface).for_each(|(at, node)| surface_of[*node as usize] = Some(at));
        let matter = Matter::new(Splitter::new(Arc::new(mesh)), lame, density, controls, centre);
        let base = Arc::new(Base::whole_body(&matter, &k, &forces, tables));
        Ok(Cuttable { matter, base, surface, surface_of })
    }

    /// The cut body as a base; waits for its factor.
    pub fn cut_base(&self, split: Arc<Split>, edges: usize) -> Result<Arc<Base>, String> {
        Base::cut_body(&self.matter, (split, edges), &self.base.tables).map(Arc::new)
    }

    /// The motion of the body while it is whole: none beyond its own.
    pub fn unmoved(&self) -> Result<Moved, String> {
        let (split, opened) = (Split::default(), CutSurface::default());
        let descent = Descent::new(&self.matter, &split, &split);
        let surface = self.corners_of(&opened, &descent);
        let system = System::new(&DMatrix::zeros(0, 0), Vec::new())?;
        let yielding = self.yielding((&self.base, system, FreeRows::default()), surface, (&split, &opened));
        Ok(Moved { fields: None, yielding: Arc::new(yielding) })
    }

    fn yielding(
        &self,
        (base, system, rows): (&Arc<Base>, System, FreeRows),
        surface: Vec<Corners>,
        (split, opened): (&Split, &CutSurface),
    ) -> Yielding {
        let moves = |corner: &Corner| corner.copy.is_some() || base.free_at[corner.node as usize].is_some();
        let ends = self.surface.iter().map(|node| [*node; 2]);
        let ends: Vec<[u32; 2]> = ends.chain(opened.points.iter().map(|point| point.nodes)).collect();
        let takes = |(_, (ends, corners)): &(u32, (&[u32; 2], &Corners))| {
            corners.iter().any(moves) && !ends.iter().any(|node| split.is_loose(*node))
        };
        let taking = (0..).zip(ends.iter().zip(&surface)).filter(takes).map(|(point, _)| point).collect();
        let side = |ends: &[u32; 2]| {
            let own = ends.iter().find(|node| (**node as usize) < self.matter.nodes());
            split.original(*own.unwrap_or(&ends[0]), self.matter.nodes())
        };
        let sides = ends.iter().map(side).collect();
        Yielding { base: base.clone(), system, rows, surface, sides, taking, fields: PointFields::default() }
    }

    /// The body after cuts by which its mesh has fallen into these pieces, from a base with what is known of an earlier cut. The error says
    /// why there is none.
    pub fn open(
        &self,
        base: &Arc<Base>,
        known: &Known,
        (split, opened): (&Split, &CutSurface),
    ) -> Result<Opened, String> {
        let descent = Descent::new(&self.matter, split, &base.split);
        let lost = loose::lost(&self.matter, split, &base.split, &descent);
        let whole = &*base.whole_without(&lost)?;
        let couplings = Couplings::new(&self.matter, split, &descent);
        let rows = FreeRows::new(couplings.rows.iter(), &base.free_at);
        let known = solve_copies(base, known, &couplings, &rows)?;
        let affine = self.matter.affine();
        let acting = couplings.acting(whole, affine);
        let free = loose::rigid_motions(&self.matter, split, &descent);
        let system = System::new(&couplings.system(&known.gx), free)?;
        let (w, missed) = system.solve(&acting);
        let work = w.tr_mul(&acting);
        let stiffness = &base.tables.stiffness - work.view((0, 0), (affine, affine));
        let asymmetry = (&stiffness - stiffness.transpose()).amax() / stiffness.amax();
        let error = missed.max(asymmetry);
        if error.is_nan() || error > INEXACT {
            return Err(format!(
                "the forces of the cut body could be wrong by a part of {error:.0e}, above {INEXACT:.0e}"
            ));
        }
        let surface = self.corners_of(opened, &descent);
        let fields = opened_fields(base, whole, &rows, &w)?;
        let columns = columns_of(&fields, &surface, &w);
        let yielding = Arc::new(self.yielding((base, system, rows), surface, (split, opened)));
        let nodes = &base.split.copies;
        let place = |node: u32| {
            let node = (node as usize).checked_sub(self.matter.nodes()).map_or(node, |copy| nodes[copy]);
            self.matter.splitter.mesh.nodes[node as usize] - self.matter.centre
        };
        let weight = base.weight_without(&lost, place, [base.whole()?, whole]);
        let weight = weight.map(|[reaction, compliance, lost]| NewWeight {
            columns: columns.columns(affine, 3).into_owned(),
            reaction: reaction + work.view((0, affine), (affine, 3)),
            compliance: compliance + work.view((affine, affine), (3, 3)),
            lost,
        });
        let of_points: Option<Arc<dyn SolvedCompliance>> =
            if base.tables.takes_points { Some(yielding.clone()) } else { None };
        let surface = NewSurface {
            points: self.points_of(split, opened),
            triangles: self.triangles_of(split, opened)?,
            held: self.held_of(opened),
            columns: columns.columns(0, affine).into_owned(),
            stiffness: (&stiffness + stiffness.transpose()) * 0.5,
            weight,
            compliance: of_points,
        };
        Ok(Opened { surface, moved: Moved { fields: Some(fields), yielding }, known, error })
    }

    /// Data on the copies after one more step on the way to a cut, as if the body had been opened there.
    pub fn follow(&self, base: &Base, known: &Known, split: &Split) -> Result<Known, String> {
        let couplings = Couplings::new(&self.matter, split, &Descent::new(&self.matter, split, &base.split));
        solve_copies(base, known, &couplings, &FreeRows::new(couplings.rows.iter(), &base.free_at))
    }

    /// The nodes of which each point of the cut surface is the sum.
    fn corners_of(&self, opened: &CutSurface, descent: &Descent) -> Vec<Corners> {
        let count = self.matter.nodes();
        let alone = |node: &u32| vec![Corner::of(*node)];
        let mut surface: Vec<Corners> = self.surface.iter().map(alone).collect();
        surface.extend(opened.points.iter().map(|point| {
            let shares = [1.0 - point.share, point.share];
            let corner = |(node, share): (u32, f64)| match (node as usize).checked_sub(count) {
                None => Some(Corner { node, copy: None, share }),
                Some(copy) => Some(Corner { node: descent.base[copy]?, copy: descent.beyond[copy], share }),
            };
            point.nodes.into_iter().zip(shares).filter_map(corner).collect()
        }));
        surface
    }

    /// Places at rest of the points beyond the nodes, about the centre.
    fn points_of(&self, split: &Split, opened: &CutSurface) -> Vec<[f32; 3]> {
        let place = |point: &CutPoint| {
            let [a, b] = point.nodes.map(|node| self.matter.splitter.place(split, node));
            (a.lerp(&b, point.share) - self.matter.centre).cast::<f32>().into()
        };
        opened.points.iter().map(place).collect()
    }

    /// The points that belong to each control element: those between two of its nodes. A copy is not held.
    fn held_of(&self, opened: &CutSurface) -> Vec<Vec<u32>> {
        let mut held = vec![Vec::new(); self.matter.affine() / FIELDS];
        for (at, point) in (self.surface.len() as u32..).zip(&opened.points) {
            let [a, b] = point.nodes.map(|node| self.matter.held.get(node as usize).copied().flatten());
            if let (Some(e), true) = (a, a == b) {
                held[e].push(at);
            }
        }
        held
    }

    fn triangles_of(&self, split: &Split, opened: &CutSurface) -> Result<Vec<[u32; 3]>, String> {
        let count = self.matter.nodes();
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
        let tets = &self.matter.splitter.mesh.tets;
        let mut edges: Vec<[u32; 2]> = tets.iter().flat_map(crate::mesh::edges_of).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// The mesh after these cuts, which go on from those of a base.
    pub fn split(&self, cut: &CutEdges, base: &Base) -> Split {
        self.matter.split(cut, &base.split)
    }

    /// Places of all nodes of the mesh in a shape, about the centre, m.
    pub fn places(&self, moved: &Moved, shape: &Shape<'_>) -> Result<Vec<V3>, String> {
        let (c, base) = (shape.coefficients, &moved.yielding.base);
        let pressed = moved.yielding.field(shape.forces)?;
        let fields = match &moved.fields {
            Some(fields) => fields,
            None => base.whole()?,
        };
        let axis = |row: usize| fields.row(row).iter().zip(c).map(|(u, c)| u * c).sum::<f64>();
        let place = |(node, x): (usize, &V3)| {
            let u = V3::from_fn(|k, _| axis(3 * node + k));
            let free = base.free_at[node].map(|free| 3 * free as usize);
            let free = free.and_then(|row| pressed.get(row..row + 3));
            x - self.matter.centre + u + free.map_or_else(V3::zeros, |own| V3::from_fn(|k, _| own[k]))
        };
        Ok(self.matter.splitter.mesh.nodes.iter().enumerate().map(place).collect())
    }
}

/// G X of these copies, solved where it is not known.
fn solve_copies(base: &Base, known: &Known, couplings: &Couplings, all: &FreeRows) -> Result<Known, String> {
    let Couplings { rows, keys, .. } = couplings;
    let before: Vec<Option<usize>> = keys.iter().map(|key| known.places.get(key).copied()).collect();
    let missing: Vec<usize> = (0..keys.len()).filter(|i| before[*i].is_none()).collect();
    let (free, copies) = (base.partition.free.len() as f64, keys.len() as f64);
    let columns = (3 * TOGETHER + 4 * (base.tables.stiffness.nrows() + 3)) as f64;
    let need = 24.0 * free * columns + 432.0 * copies * copies;
    let of = format!("A cut with {copies} copies of nodes beyond those of its factor");
    machine::fits(of, need, 0.0).map_err(|error| error.to_string())?;
    let mut gx = DMatrix::zeros(3 * keys.len(), 3 * keys.len());
    for (i, was) in before.iter().enumerate() {
        let Some(was) = was else { continue };
        for (j, other) in before.iter().enumerate() {
            let Some(other) = other else { continue };
            let block = known.gx.fixed_view::<3, 3>(3 * was, 3 * other);
            gx.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block);
        }
    }
    for some in missing.chunks(TOGETHER) {
        let own = FreeRows::new(some.iter().map(|i| &rows[*i]), &base.free_at);
        let unit = -DMatrix::<f64>::identity(3 * some.len(), 3 * some.len());
        let b = own.minus_transposed(&unit, 3 * some.len());
        let product = all.times(&base.solves.solve_at(own.at, b, Some(all.at.clone()))?);
        for (k, j) in some.iter().enumerate() {
            for i in 0..keys.len() {
                let block = product.fixed_view::<3, 3>(3 * i, 3 * k);
                gx.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block);
                gx.fixed_view_mut::<3, 3>(3 * j, 3 * i).copy_from(&block.transpose());
            }
        }
    }
    Ok(Known { places: keys.iter().cloned().zip(0..).collect(), gx })
}

/// U - A⁻¹ (Gᵀ W) over all nodes of a base.
fn opened_fields(
    base: &Base,
    whole: &NodeFields,
    rows: &FreeRows,
    w: &DMatrix<f64>,
) -> Result<NodeFields, String> {
    let mut fields = whole.clone();
    if rows.count() == 0 {
        return Ok(fields);
    }
    let beyond = base.solves.solve_at(rows.at.clone(), rows.minus_transposed(w, w.ncols()), None)?;
    for (free, node) in base.partition.free.iter().enumerate() {
        for axis in 0..3 {
            let own = fields.row_mut(3 * *node as usize + axis);
            own.iter_mut().zip(beyond.row(3 * free + axis)).for_each(|(own, beyond)| *own += beyond);
        }
    }
    Ok(fields)
}

/// The columns at the points of a surface, with W at the copies.
fn columns_of(fields: &NodeFields, surface: &[Corners], w: &DMatrix<f64>) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(3 * surface.len(), fields.columns);
    for (at, corners) in surface.iter().enumerate() {
        for Corner { node, copy, share } in corners {
            for axis in 0..3 {
                for (k, u) in fields.row(3 * *node as usize + axis).iter().enumerate() {
                    let apart = copy.map_or(0.0, |copy| w[(3 * copy + axis, k)]);
                    columns[(3 * at + axis, k)] += share * (u + apart);
                }
            }
        }
    }
    columns
}
