//! A body that is touched: its shape without contact, and how its surface yields.

use super::response::Response;
use crate::deform::{Contribution, Deformer, DeformerState, PointLoad, Pull};
use crate::green::Yield;
use crate::mesh::surface_files::TriangleSurface;
use crate::mesh::walls::wall_thickness;
use crate::world::dissipation::Dissipation;
use nalgebra::{Matrix3, Point3, Rotation3, Similarity3, Vector3};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Cosine of the angle between two triangles beyond which the edge between them is a crease.
const CREASE: f64 = 0.8;
/// Share of a surface's area under which a body may be thinner than its thickness says.
const THINNEST: f64 = 0.02;

pub struct TouchedBody {
    /// Index in the world.
    pub b: usize,
    /// Coefficient of friction.
    pub friction: f64,
    /// Whether each tool touches it.
    pub tools: Vec<bool>,
    /// Whether a force device feels it.
    pub is_felt: bool,
    /// Whether it is heard.
    pub is_heard: bool,
    /// Work of friction on it in the frame, if it is heard.
    pub rubbed: Dissipation,
    /// The body without what the columns of its contacts show, with everything else that acts on it.
    pub free: Deformer,
    /// Whether a node takes forces in this frame: it has a column, or belongs to a control element that moves by inertia.
    pub takes: Vec<bool>,
    /// Whether it has a column.
    yields: Vec<bool>,
    /// Contribution of other effects, without inertia.
    pub others: Contribution,
    /// Response of a body with inertia in a step; `None` of one that has none, or for which time stands.
    pub inertial: Option<Response>,
    /// Whether it had inertia in the last frame.
    pub has_lived: bool,
    pub triangles: Vec<[u32; 3]>,
    /// Numbers of the triangles around each node.
    pub around: Vec<Vec<u32>>,
    /// Longest edge at rest, in the body's metres.
    longest: f64,
    /// Thickness of its walls at rest, in the body's metres; 0 unless it meets surfaces.
    pub wall: f64,
    /// Outward normals at rest around its nodes, in its own axes; none unless it meets surfaces.
    pub outward_at_rest: Vec<V3>,
    /// Place in this frame.
    pub room_from_body: Similarity3<f64>,
    columns: Columns,
    moved: RefCell<Moved>,
    /// Nodes whose columns the background was asked for last.
    prepared: Vec<u32>,
}

/// Columns of nodes, and the compliance between each two of these nodes.
#[derive(Default)]
struct Columns {
    /// Place of each node of the body in the lists.
    slots: Vec<Option<u32>>,
    nodes: Vec<u32>,
    columns: Vec<Arc<Yield>>,
    /// Blocks of each node with those up to it, one row after the other, m/N.
    blocks: Vec<Matrix3<f32>>,
}

/// Displacements along the axes of the columns, in the body's metres, by the forces for which they were asked last, of each node of which
/// they were.
#[derive(Default)]
struct Moved {
    forces: Vec<(u32, V3)>,
    /// Whether all columns of these nodes were there that there are.
    is_whole: bool,
    by: Vec<Option<V3>>,
}

/// Columns that nothing needs are dropped when they are one of so many.
const LOOSE: usize = 4;

impl Columns {
    fn slot(&self, node: u32) -> Option<usize> {
        self.slots.get(node as usize)?.map(|slot| slot as usize)
    }

    fn get(&self, node: u32) -> Option<&Arc<Yield>> {
        Some(&self.columns[self.slot(node)?])
    }

    fn add(&mut self, node: u32, column: Arc<Yield>) {
        self.slots[node as usize] = Some(self.nodes.len() as u32);
        self.nodes.push(node);
        self.columns.push(column);
        // The compliance is symmetric but for rounding.
        let block = |at: u32, from: &Arc<Yield>| Matrix3::from(from[at as usize]).transpose();
        let own = self.columns.last();
        let row = self.nodes.iter().zip(&self.columns).filter_map(|(other, column)| {
            Some((block(node, column) + block(*other, own?).transpose()) * 0.5)
        });
        self.blocks.extend(row);
    }

    /// Displacement of one node by a force at another.
    fn block(&self, at: u32, from: u32) -> Matrix3<f64> {
        self.slot(at).zip(self.slot(from)).map_or_else(Matrix3::zeros, |(at, from)| self.at(at, from))
    }

    /// [`Columns::block`] of nodes by their places in the lists.
    fn at(&self, at: usize, from: usize) -> Matrix3<f64> {
        match at >= from {
            true => self.blocks[at * (at + 1) / 2 + from].cast(),
            false => self.blocks[from * (from + 1) / 2 + at].transpose().cast(),
        }
    }

    fn keep(&mut self, nodes: &dyn Fn(u32) -> bool) {
        let stays: Vec<bool> = self.nodes.iter().map(|node| nodes(*node)).collect();
        let gone = stays.iter().filter(|stays| !**stays).count();
        if gone * LOOSE <= stays.len() {
            return;
        }
        for (node, stays) in self.nodes.iter().zip(&stays) {
            if !stays {
                self.slots[*node as usize] = None;
            }
        }
        let pairs = (0..stays.len()).flat_map(|i| (0..=i).map(move |j| (i, j)));
        let of_pairs: Vec<bool> = pairs.map(|(i, j)| stays[i] && stays[j]).collect();
        retain(&mut self.blocks, &of_pairs);
        retain(&mut self.columns, &stays);
        retain(&mut self.nodes, &stays);
        for (slot, node) in (0..).zip(&self.nodes) {
            self.slots[*node as usize] = Some(slot);
        }
    }
}

/// Keeps the entries that stay.
fn retain<T>(list: &mut Vec<T>, stays: &[bool]) {
    let mut stays = stays.iter();
    list.retain(|_| stays.next().is_none_or(|stays| *stays));
}

/// A point of a surface: the mean of nodes with weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSpot {
    pub nodes: [u32; 3],
    pub weights: [f64; 3],
}

impl SurfaceSpot {
    pub fn node(node: u32) -> SurfaceSpot {
        SurfaceSpot { nodes: [node; 3], weights: [1.0, 0.0, 0.0] }
    }

    /// Nodes that have a share in it, with that share.
    pub fn corners(&self) -> impl Iterator<Item = (u32, f64)> + use<> {
        self.nodes.into_iter().zip(self.weights).filter(|(_, w)| *w != 0.0)
    }
}

impl TouchedBody {
    /// The error says why the body cannot be deformed a second time.
    pub fn new(
        b: usize,
        body: &Deformer,
        (friction, is_felt): (f64, bool),
        tools: Vec<bool>,
    ) -> Result<TouchedBody, String> {
        let free = body.another()?;
        let mut yields = vec![false; free.node_count()];
        free.takes_forces().iter().for_each(|node| yields[*node as usize] = true);
        let mut around = vec![Vec::new(); free.node_count()];
        let mut longest = 0.0_f64;
        let triangles = free.triangles().to_vec();
        for (number, triangle) in (0..).zip(&triangles) {
            triangle.iter().for_each(|node| around[*node as usize].push(number));
            let [a, b, c] = triangle.map(|node| V3::from(free.rest()[node as usize].map(f64::from)));
            longest = longest.max((a - b).norm()).max((b - c).norm()).max((c - a).norm());
        }
        let room_from_body = Similarity3::identity();
        Ok(TouchedBody {
            b,
            friction,
            tools,
            is_felt,
            is_heard: false,
            rubbed: Dissipation::default(),
            takes: yields.clone(),
            yields,
            others: free.no_contribution(),
            inertial: None,
            has_lived: false,
            free,
            triangles,
            around,
            longest,
            wall: 0.0,
            outward_at_rest: Vec::new(),
            room_from_body,
            columns: Columns::default(),
            moved: RefCell::default(),
            prepared: Vec::new(),
        })
    }

    /// Goes on with the deformer of the same body that has been remade, whose nodes beyond the first `kept` are others. The error says why it
    /// cannot be deformed a second time.
    pub fn reshape(&mut self, body: &Deformer, kept: usize) -> Result<(), String> {
        self.prepare(Vec::new())?;
        let free = self.free.remade(body.file().clone(), kept)?;
        let last = std::mem::take(&mut self.tools);
        let fresh = TouchedBody::new(self.b, body, (self.friction, self.is_felt), last)?;
        let (is_heard, has_lived, room_from_body) = (self.is_heard, self.has_lived, self.room_from_body);
        let others = std::mem::take(&mut self.others);
        let is_walled = !self.outward_at_rest.is_empty();
        *self = TouchedBody { free, is_heard, has_lived, room_from_body, others, ..fresh };
        if is_walled {
            self.measure_walls();
        }
        Ok(())
    }

    /// Longest edge in the room, m.
    pub fn longest(&self) -> f64 {
        self.longest * self.room_from_body.scaling()
    }

    /// Longest edge in the body's own metres.
    pub fn longest_at_rest(&self) -> f64 {
        self.longest
    }

    /// Whether a node has no column: it belongs to a control element, or surface_compliance leaves it out.
    pub fn has_no_column(&self, node: u32) -> bool {
        self.yields.get(node as usize) != Some(&true)
    }

    /// Whether all nodes of a spot have columns.
    pub fn has_columns(&self, spot: &SurfaceSpot) -> bool {
        spot.corners().all(|(node, _)| !self.has_no_column(node))
    }

    /// The control element to which a node belongs.
    pub fn element_of(&self, node: u32) -> Option<usize> {
        (0..self.free.controls.len()).find(|e| self.free.control_nodes(*e).contains(&node))
    }

    /// Whether forces can act on a spot in this frame.
    pub fn takes(&self, spot: &SurfaceSpot) -> bool {
        spot.corners().all(|(node, _)| self.takes[node as usize])
    }

    /// Whether forces can act on a spot, in this frame or in another.
    pub fn bears(&self, spot: &SurfaceSpot) -> bool {
        let takes = |node: &u32| {
            (*node as usize) < self.takes.len()
                && (!self.has_no_column(*node) || self.element_of(*node).is_some())
        };
        let sum: f64 = spot.weights.iter().sum();
        spot.nodes.iter().all(takes) && spot.weights.iter().all(|w| *w >= 0.0) && (sum - 1.0).abs() < 1e-6
    }

    /// Prepares it to meet surfaces.
    pub fn measure_walls(&mut self) {
        let vertices = self.free.rest().iter().map(|x| V3::from(x.map(f64::from))).collect();
        let surface = TriangleSurface { vertices, triangles: self.triangles.clone() };
        self.wall = wall_thickness(&surface, THINNEST).unwrap_or(self.longest);
        let rest = |node: u32| V3::from(self.free.rest()[node as usize].map(f64::from));
        self.outward_at_rest = (0..self.takes.len() as u32).map(|node| self.outward(node, &rest)).collect();
    }

    /// Thickness of its walls in the room, m.
    pub fn thickness(&self) -> f64 {
        self.wall * self.room_from_body.scaling()
    }

    /// Turn from the axes of the columns to those of the room.
    pub fn turn(&self) -> Rotation3<f64> {
        let in_body = self.free.state.body_from_surface().rotation;
        (self.room_from_body.isometry.rotation * in_body).to_rotation_matrix()
    }

    /// Places in the room of all nodes of a deformer of this body, as they were summed last.
    pub fn summed_places(&self, deformer: &Deformer) -> Vec<V3> {
        let motion = self.room_from_body * deformer.body_from_surface();
        let place = |x: &[f32; 3]| (motion * Point3::from(V3::from(x.map(f64::from)))).coords;
        deformer.positions().iter().map(place).collect()
    }

    /// Makes sure that the columns of these nodes are there. The error says why one cannot be read.
    pub fn fetch(&mut self, nodes: impl Iterator<Item = u32>) -> Result<(), String> {
        let is_missing = |node: &u32| !self.has_no_column(*node) && self.columns.slot(*node).is_none();
        let mut missing: Vec<u32> = nodes.filter(is_missing).collect();
        missing.sort_unstable();
        missing.dedup();
        if missing.is_empty() {
            return Ok(());
        }
        let columns = self.free.columns_at(&missing).map_err(|error| error.to_string())?;
        if columns.len() != missing.len() {
            return Err(format!(
                "{} of {} nodes have no columns",
                missing.len() - columns.len(),
                missing.len()
            ));
        }
        self.columns.slots.resize(self.takes.len(), None);
        missing.into_iter().zip(columns).for_each(|(node, column)| self.columns.add(node, column));
        Ok(())
    }

    /// Has the columns of these nodes solved for in the background, the first ones first.
    pub fn prepare(&mut self, nodes: Vec<u32>) -> Result<(), String> {
        let is_missing = |node: &u32| !self.has_no_column(*node) && self.columns.slot(*node).is_none();
        let missing: Vec<u32> = nodes.into_iter().filter(is_missing).collect();
        if missing == self.prepared {
            return Ok(());
        }
        let prepared = self.free.prepare_columns(missing.iter().copied());
        self.prepared = missing;
        prepared.map_err(|error| error.to_string())
    }

    /// Drops the columns of other nodes.
    pub fn keep(&mut self, nodes: &dyn Fn(u32) -> bool) {
        self.columns.keep(nodes);
    }

    /// Compliance between two spots, in the axes of the columns, m/N in the room.
    pub fn between(&self, at: &SurfaceSpot, from: &SurfaceSpot) -> Matrix3<f64> {
        let mut all = Matrix3::zeros();
        for (source, w) in from.corners() {
            for (target, v) in at.corners() {
                all += self.columns.block(target, source) * (v * w);
            }
        }
        all * self.room_from_body.scaling()
    }

    /// Places of a spot's nodes among the columns that are there, with their shares.
    pub fn slots(&self, spot: &SurfaceSpot) -> impl Iterator<Item = (usize, f64)> {
        spot.corners().filter_map(|(node, w)| Some((self.columns.slot(node)?, w)))
    }

    /// Compliance between two such nodes, in the axes of the columns, m/N in the body's metres.
    pub fn block(&self, at: usize, from: usize) -> Matrix3<f64> {
        self.columns.at(at, from)
    }

    /// Displacements of nodes in the room by forces at nodes along the axes of the columns.
    pub fn moved(&self, forces: &[(u32, V3)], nodes: impl Iterator<Item = u32> + Clone) -> Vec<V3> {
        let mut last = self.moved.borrow_mut();
        if !last.is_whole || last.forces != forces {
            let is_there =
                |(node, _): &(u32, V3)| self.has_no_column(*node) || self.columns.get(*node).is_some();
            *last = Moved { forces: forces.to_vec(), is_whole: forces.iter().all(is_there), by: Vec::new() };
        }
        last.by.resize(self.takes.len(), None);
        let unknown: Vec<u32> = nodes.clone().filter(|node| last.by[*node as usize].is_none()).collect();
        let mut sums = vec![V3::zeros(); unknown.len()];
        for (from, force) in forces {
            let Some(column) = self.columns.get(*from) else { continue };
            for (sum, node) in sums.iter_mut().zip(&unknown) {
                for (sum, row) in sum.iter_mut().zip(&column[*node as usize]) {
                    *sum += f64::from(row[0]) * force.x
                        + f64::from(row[1]) * force.y
                        + f64::from(row[2]) * force.z;
                }
            }
        }
        unknown.into_iter().zip(sums).for_each(|(node, sum)| last.by[node as usize] = Some(sum));
        let (turn, scale) = (self.turn(), self.room_from_body.scaling());
        nodes.map(|node| last.by[node as usize].map_or_else(V3::zeros, |sum| turn * sum * scale)).collect()
    }

    /// The corners of the triangles around a node.
    pub fn with_neighbours(&self, node: u32) -> impl Iterator<Item = u32> {
        self.around[node as usize].iter().flat_map(|number| self.triangles[*number as usize])
    }

    /// Outward normal around a node.
    pub fn outward(&self, node: u32, place: &dyn Fn(u32) -> V3) -> V3 {
        let normal = |number: &u32| across(self.triangles[*number as usize].map(place));
        self.around[node as usize].iter().map(normal).sum::<V3>().try_normalize(0.0).unwrap_or_else(V3::zeros)
    }

    /// Outward normal at a spot of one triangle, smooth across edges that are not creases.
    pub fn normal(&self, spot: &SurfaceSpot, place: &dyn Fn(u32) -> V3) -> V3 {
        let flat = across(spot.nodes.map(place)).try_normalize(0.0).unwrap_or_else(V3::zeros);
        let smooth = |(node, w): (u32, f64)| {
            let all = self.around[node as usize]
                .iter()
                .map(|number| across(self.triangles[*number as usize].map(place)));
            let near = all.filter(|normal| normal.dot(&flat) >= CREASE * normal.norm());
            near.sum::<V3>().try_normalize(0.0).unwrap_or(flat) * w
        };
        spot.corners().map(smooth).sum::<V3>().try_normalize(0.0).unwrap_or(flat)
    }

    /// Adds a force at a spot, along the axes of the columns, to what effects add: at nodes as a load, on control elements as a slope.
    pub fn press(&self, spot: &SurfaceSpot, force: V3, to: &mut Contribution) {
        let force = self.free.state.body_from_surface().rotation * force;
        if self.has_columns(spot) {
            let SurfaceSpot { nodes, weights } = *spot;
            to.points.push(PointLoad { nodes, weights, pull: Pull::Force(force) });
            return;
        }
        for (node, w) in spot.corners() {
            let force = force * w;
            match self.element_of(node) {
                Some(e) => {
                    let arm = V3::from(self.free.rest()[node as usize].map(f64::from))
                        - self.free.controls[e].origin;
                    to.slopes[e].translation -= force;
                    to.slopes[e].matrix -= force * arm.transpose();
                }
                None => {
                    let SurfaceSpot { nodes, weights } = SurfaceSpot::node(node);
                    to.points.push(PointLoad { nodes, weights, pull: Pull::Force(force) });
                }
            }
        }
    }

    pub fn state(&self) -> DeformerState {
        self.free.snapshot()
    }
}

/// Normal of a triangle, as long as twice its area.
fn across([a, b, c]: [V3; 3]) -> V3 {
    (b - a).cross(&(c - a))
}
