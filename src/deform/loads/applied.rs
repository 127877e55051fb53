//! Loads that are applied to a body beside its control elements, and forces at single points of a surface, by the columns of its
//! compliance.
//!
//! In: points with a force, or with a place to which each is drawn, and the columns of the body there. Out: the force at each
//! point, where it ends up, and what all of them do to the whole surface. A point that is held gets the force that brings it to
//! its place, by the compliance of all held points together.
//!
//! For a body that is solved anew ([`StaticForces`]) the loads of a frame or of a pose become a coefficient for each column of the
//! loads, and forces at single nodes.

use crate::base::columns::ColumnGroup;
use crate::base::diagnostic::notice;
use crate::field::numbers::Numbers;
use crate::green::{GreenError, GreenFile, Yield};
use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

type V3 = Vector3<f64>;

/// All loads of a body as they are now, in the body's frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppliedLoads {
    /// One for each column of the family `loads`; what is left out is 0.
    pub coefficients: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointLoad>,
}

/// A force at one point of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLoad {
    /// The point is the mean of these nodes of the surface with these weights.
    pub nodes: [u32; 3],
    pub weights: [f64; 3],
    pub pull: Pull,
}

impl PointLoad {
    /// Nodes that have a share in it, with that share.
    pub fn corners(&self) -> impl Iterator<Item = (u32, f64)> + use<> {
        self.nodes.into_iter().zip(self.weights).filter(|(_, w)| *w != 0.0)
    }

    pub fn is_finite(&self) -> bool {
        let pull = match self.pull {
            Pull::Force(force) => force.iter().all(|x| x.is_finite()),
            Pull::Towards { place, spring } => place.iter().chain(spring.iter()).all(|x: &f64| x.is_finite()),
        };
        pull && self.weights.iter().all(|w| w.is_finite())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Pull {
    /// N, along the body's axes.
    Force(#[serde(with = "crate::field::numbers")] V3),
    /// A pull towards `place`, m about the body's centre, by a spring, N/m; without one the point is there.
    Towards {
        #[serde(with = "crate::field::numbers")]
        place: V3,
        spring: Option<f64>,
    },
}

/// Loads that a body's models share: set by frames, read by force loops.
pub type SharedLoads = Arc<Mutex<AppliedLoads>>;

/// Sets what is applied; false where it is as it was.
pub fn set(shared: &SharedLoads, loads: &AppliedLoads) -> bool {
    let mut applied = shared.lock().unwrap_or_else(PoisonError::into_inner);
    let differs = *applied != *loads;
    if differs {
        applied.clone_from(loads);
    }
    differs
}

/// A part of the largest compliance that is added to that of each held point, so that two hands may hold the same one.
const RIDGE: f64 = 1e-9;

/// One point in the frame of the columns.
pub struct Point {
    load: PointLoad,
    /// Place at rest, and with the displacements of all columns.
    pub rest: V3,
    pub now: V3,
    /// The affine columns' and the loads' displacements there: 3 × 12 E and 3 × K.
    pub affine: DMatrix<f64>,
    pub loads: DMatrix<f64>,
}

/// The surface of a body that takes forces.
pub struct PointForces {
    file: Arc<GreenFile>,
    body: String,
    /// Columns of the file before those of loads.
    before: usize,
    /// Places of the columns of all nodes that take forces; the columns of nodes that are touched.
    places: BTreeMap<u32, usize>,
    touched: BTreeMap<u32, Arc<Yield>>,
    /// Places of those whose columns are on their way, and how long a state waits for them.
    awaited: Vec<usize>,
    patience: Duration,
    /// Displacements of the whole surface by the forces, where it takes any; the forces at nodes to which these belong.
    field: Option<Vec<[f32; 3]>>,
    field_of: Vec<(u32, V3)>,
    /// Columns came since then.
    is_new: bool,
}

impl PointForces {
    /// Point forces on a body whose loads have `loads` columns.
    pub fn new(file: &Arc<GreenFile>, body: &str, loads: usize) -> PointForces {
        let nodes = file.rest(body).len();
        let columns: usize = file.groups(body).iter().map(|group| group.columns(nodes).unwrap_or(0)).sum();
        let places = file.compliance(body).map(|compliance| compliance.places());
        PointForces {
            field: places.is_some().then(|| vec![[0.0; 3]; nodes]),
            before: columns - loads,
            places: places.unwrap_or_default(),
            touched: BTreeMap::new(),
            awaited: Vec::new(),
            patience: Duration::MAX,
            field_of: Vec::new(),
            is_new: false,
            body: body.to_owned(),
            file: file.clone(),
        }
    }

    /// Columns of the file before those of loads.
    pub fn before(&self) -> usize {
        self.before
    }

    /// Displacements of the whole surface by the forces, m.
    pub fn field(&self) -> Option<&[[f32; 3]]> {
        self.field.as_deref()
    }

    /// Limits the time that a state waits for columns to `patience`.
    pub fn be_patient(&mut self, patience: Duration) {
        self.patience = patience;
    }

    /// Whether columns that were not there in time are there now.
    pub fn has_news(&self) -> bool {
        let found = || self.file.columns(&self.body, &self.awaited, Duration::ZERO);
        !self.awaited.is_empty() && !matches!(found(), Ok(None))
    }

    /// Finds the columns of nodes that are touched now, and drops those of others.
    pub fn touch(&mut self, points: &[PointLoad]) {
        let now: BTreeSet<u32> = points.iter().flat_map(PointLoad::corners).map(|(node, _)| node).collect();
        self.touched.retain(|node, _| now.contains(node));
        self.awaited.clear();
        let missing = now.into_iter().filter(|node| !self.touched.contains_key(node));
        let missing: Vec<(u32, usize)> =
            missing.filter_map(|node| Some((node, *self.places.get(&node)?))).collect();
        // All together; one by one where one of them fails.
        if missing.is_empty() || self.find(&missing).is_ok() {
            return;
        }
        for (node, place) in missing {
            if let Err(error) = self.find(&[(node, place)]) {
                notice!("{error}; node {node} of the surface takes no force");
                self.places.remove(&node);
            }
        }
    }

    /// Takes the columns of these nodes at their places, or notes that they are awaited.
    fn find(&mut self, nodes: &[(u32, usize)]) -> Result<(), GreenError> {
        let places: Vec<usize> = nodes.iter().map(|(_, place)| *place).collect();
        match self.file.columns(&self.body, &places, self.patience)? {
            Some(columns) => {
                self.touched.extend(nodes.iter().map(|(node, _)| *node).zip(columns));
                self.is_new = true;
            }
            None => self.awaited.extend(places),
        }
        Ok(())
    }

    /// A point with the columns there.
    pub fn point(&self, point: &PointLoad, c: &DVector<f64>, lambda: &DVector<f64>) -> Point {
        let (file, body) = (&self.file, &self.body);
        let (rest, nodes) = (file.rest(body), file.rest(body).len());
        let groups = file.groups(body);
        let place: V3 =
            point.corners().map(|(node, w)| Vector3::from(rest[node as usize]).cast::<f64>() * w).sum();
        // The affine groups stand first, those of loads behind all that models have.
        let width = |group: &ColumnGroup<'_>| group.columns(nodes).unwrap_or(0);
        let starts =
            groups.iter().scan(0, |start, group| Some(std::mem::replace(start, *start + width(group))));
        let (mut affine, mut loads) = (DMatrix::zeros(3, c.len()), DMatrix::zeros(3, lambda.len()));
        for (group, start) in groups.iter().zip(starts.collect::<Vec<_>>()) {
            let target = match start {
                start if start < c.len() => Some((&mut affine, start)),
                start if start >= self.before => Some((&mut loads, start - self.before)),
                _ => None,
            };
            let Some((matrix, first)) = target else { continue };
            for k in 0..width(group) {
                for (node, w) in point.corners() {
                    for axis in 0..3 {
                        let value = group.value(nodes, k, 3 * node as usize + axis);
                        matrix[(axis, first + k)] += w * f64::from(value);
                    }
                }
            }
        }
        let moved = &affine * c + &loads * lambda;
        Point { load: *point, rest: place, now: place + V3::new(moved[0], moved[1], moved[2]), affine, loads }
    }

    /// C_ab: what a force at point `b` does at point `a`.
    fn between(&self, a: &Point, b: &Point) -> Matrix3<f64> {
        let mut all = Matrix3::zeros();
        for (from, w) in b.load.corners() {
            let Some(column) = self.touched.get(&from) else { continue };
            for (to, v) in a.load.corners() {
                let block = &column[to as usize];
                all += Matrix3::from_fn(|axis, force| f64::from(block[axis][force])) * (v * w);
            }
        }
        all
    }

    /// The force at each point: as it is given, or what brings the point to its place.
    pub fn forces(
        &self,
        applied: &[PointLoad],
        points: &[Point],
        rotation: &Rotation3<f64>,
        shift: &V3,
    ) -> Vec<V3> {
        let inverse = rotation.inverse();
        let mut forces = vec![V3::zeros(); points.len()];
        let mut held = Vec::new();
        for (i, point) in applied.iter().enumerate() {
            match point.pull {
                Pull::Force(force) => forces[i] = inverse * force,
                Pull::Towards { place, spring } => held.push((i, inverse * (place - shift), spring)),
            }
        }
        if held.is_empty() {
            return forces;
        }
        let size = 3 * held.len();
        let (mut matrix, mut missing) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for (row, (i, place, spring)) in held.iter().enumerate() {
            let given = (0..points.len()).filter(|j| held.iter().all(|(held, ..)| held != j));
            let by_forces: V3 = given.map(|j| self.between(&points[*i], &points[j]) * forces[j]).sum();
            missing.rows_mut(3 * row, 3).copy_from(&(place - points[*i].now - by_forces));
            for (column, (j, ..)) in held.iter().enumerate() {
                let block = self.between(&points[*i], &points[*j]);
                matrix.view_mut((3 * row, 3 * column), (3, 3)).copy_from(&block);
            }
            let softness = spring.map_or(0.0, |spring| 1.0 / spring);
            (0..3).for_each(|axis| matrix[(3 * row + axis, 3 * row + axis)] += softness);
        }
        let ridge = RIDGE * matrix.diagonal().amax();
        (0..size).for_each(|i| matrix[(i, i)] += ridge);
        if let Some(found) = matrix.lu().solve(&missing).filter(|found| found.iter().all(|f| f.is_finite())) {
            for (row, (i, ..)) in held.iter().enumerate() {
                forces[*i] = V3::new(found[3 * row], found[3 * row + 1], found[3 * row + 2]);
            }
        }
        forces
    }

    /// Places of all points under these forces, in the frame of the columns.
    pub fn ends(&self, points: &[Point], forces: &[V3]) -> Vec<V3> {
        let at_nodes = gathered(points, forces);
        let mut nodes: Vec<u32> =
            points.iter().flat_map(|point| point.load.corners()).map(|(node, _)| node).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let mut moved = vec![V3::zeros(); nodes.len()];
        // Column by column, as they stand in memory.
        for (from, force) in &at_nodes {
            let Some(column) = self.touched.get(from) else { continue };
            for (sum, node) in moved.iter_mut().zip(&nodes) {
                *sum += product(&column[*node as usize], force);
            }
        }
        let by = |node: u32| nodes.binary_search(&node).map_or_else(|_none| V3::zeros(), |at| moved[at]);
        let of = |a: &Point| a.now + a.load.corners().map(|(node, w)| by(node) * w).sum::<V3>();
        points.iter().map(of).collect()
    }

    /// Brings the displacements that point forces cause up to date.
    pub fn spread(&mut self, points: &[Point], forces: &[V3]) {
        let Some(field) = &mut self.field else { return };
        let at_nodes = gathered(points, forces);
        if at_nodes == self.field_of && !self.is_new {
            return;
        }
        self.is_new = false;
        field.fill([0.0; 3]);
        for (node, force) in &at_nodes {
            let (Some(column), f) = (self.touched.get(node), force.cast::<f32>()) else { continue };
            for (u, block) in field.iter_mut().zip(column.iter()) {
                for (u, row) in u.iter_mut().zip(block) {
                    *u += row[0] * f.x + row[1] * f.y + row[2] * f.z;
                }
            }
        }
        self.field_of = at_nodes;
    }
}

/// Forces at single nodes, in their order, for forces at points.
fn gathered(points: &[Point], forces: &[V3]) -> Vec<(u32, V3)> {
    let mut at_nodes: BTreeMap<u32, V3> = BTreeMap::new();
    for (point, force) in points.iter().zip(forces) {
        for (node, w) in point.load.corners() {
            *at_nodes.entry(node).or_default() += force * w;
        }
    }
    at_nodes.into_iter().collect()
}

/// Displacement of a node by a force, for its block of the compliance.
fn product(block: &[[f32; 3]; 3], force: &V3) -> V3 {
    let row = |row: &[f32; 3]| {
        f64::from(row[0]) * force.x + f64::from(row[1]) * force.y + f64::from(row[2]) * force.z
    };
    V3::new(row(&block[0]), row(&block[1]), row(&block[2]))
}

/// Loads and forces on a body beside its control elements.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StaticForces {
    /// One for each column of the body's loads, as in [`AppliedLoads`].
    #[serde(with = "crate::field::numbers::flat")]
    pub coefficients: Vec<f64>,
    /// Forces at nodes of the mesh, N, along the body's axes.
    #[serde(with = "crate::field::numbers::list")]
    pub at_nodes: Vec<(u32, V3)>,
}

impl StaticForces {
    /// Forces by loads whose points have forces; `node_of` maps nodes of the surface to those of the mesh.
    pub fn from_loads(loads: &AppliedLoads, node_of: impl Fn(u32) -> Option<u32>) -> Option<StaticForces> {
        let mut at_nodes = Vec::new();
        for point in &loads.points {
            let Pull::Force(force) = point.pull else { return None };
            for (node, weight) in point.corners() {
                at_nodes.push((node_of(node)?, force * weight));
            }
        }
        Some(StaticForces { coefficients: loads.coefficients.clone(), at_nodes })
    }

    /// A part of the way from these to others.
    pub fn towards(&self, other: &StaticForces, share: f64) -> StaticForces {
        if share == 1.0 || self == other {
            return other.clone();
        }
        let columns = self.coefficients.len().max(other.coefficients.len());
        let of = |all: &[f64], k: usize| all.get(k).copied().unwrap_or(0.0);
        let between = |k: usize| {
            let [from, to] = [self, other].map(|loads| of(&loads.coefficients, k));
            from + share * (to - from)
        };
        let mut at_nodes: BTreeMap<u32, V3> = BTreeMap::new();
        for (loads, part) in [(self, 1.0 - share), (other, share)] {
            for (node, force) in &loads.at_nodes {
                *at_nodes.entry(*node).or_default() += force * part;
            }
        }
        StaticForces {
            coefficients: (0..columns).map(between).collect(),
            at_nodes: at_nodes.into_iter().collect(),
        }
    }
}

/// The node, then the force.
impl Numbers for (u32, V3) {
    const COUNT: usize = 4;

    fn list(&self) -> Vec<f64> {
        let (node, force) = self;
        vec![f64::from(*node), force.x, force.y, force.z]
    }

    fn made(numbers: &[f64]) -> (u32, V3) {
        (numbers[0] as u32, V3::from_column_slice(&numbers[1..4]))
    }
}
