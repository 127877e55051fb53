//! Loads and forces at points of a body's surface, which act beside its control elements; and the whole state of a deformer, taken
//! and gone on from.

use super::Deformer;
use crate::deform::contribution::{Contribution, DeformerState};
use crate::deform::loads;
use crate::deform::loads::{AppliedLoads, PointLoad, Pull};
use crate::deform::model::{Bearing, BodyState, PointResult};
use crate::deform::pose::frame::{PoseSlope, Wrench};
use crate::green::{FIELDS, GreenError, LoadMeta, REACTION, Turning, Yield};
use crate::scene::GRAVITY;
use nalgebra::{DVector, UnitQuaternion, Vector3};
use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::{Arc, PoisonError};
use std::time::Duration;

type V3 = Vector3<f64>;

impl Deformer {
    /// The loads that the file has columns for.
    pub fn load_metas(&self) -> &[LoadMeta] {
        self.file.meta.bodies.get(&self.body).map_or(&[], |meta| &meta.loads)
    }

    /// Nodes of the surface that take forces.
    pub fn takes_forces(&self) -> BTreeSet<u32> {
        let compliance = self.file.compliance(&self.body);
        compliance.map_or_else(BTreeSet::new, |compliance| compliance.places().into_keys().collect())
    }

    /// Nodes of the surface at which forces of a given size and direction may act: also those of a model that needs no compliance for them.
    pub fn bears_forces(&self) -> BTreeSet<u32> {
        if !matches!(self.entry.loads, Bearing::Forces(_)) {
            return self.takes_forces();
        }
        let held: BTreeSet<u32> =
            (0..self.controls.len()).flat_map(|e| self.control_nodes(e).iter().copied()).collect();
        (0..self.node_count() as u32).filter(|node| !held.contains(node)).collect()
    }

    /// Columns of the compliance of these nodes of the surface, which take forces; waits until all are there.
    pub fn columns_at(&self, nodes: &[u32]) -> Result<Vec<Arc<Yield>>, GreenError> {
        let places = self.file.compliance(&self.body).map(|compliance| compliance.places());
        let places = nodes.iter().filter_map(|node| places.as_ref()?.get(node).copied());
        let places: Vec<usize> = places.collect();
        Ok(self.file.columns(&self.body, &places, Duration::MAX)?.unwrap_or_default())
    }

    /// Has the columns of the compliance of these nodes of the surface solved for in the background.
    pub fn prepare_columns(&self, nodes: impl Iterator<Item = u32>) -> Result<(), GreenError> {
        let Some(compliance) = self.file.compliance(&self.body) else { return Ok(()) };
        let at = compliance.places();
        let places: Vec<usize> = nodes.filter_map(|node| at.get(&node).copied()).collect();
        self.file.prepare_columns(&self.body, &places)
    }

    /// Displacement along a force of 1 N at a point of the surface, in the mean over all directions, m/N; `None` while its
    /// columns are on their way. The point's corners take forces.
    pub fn softness(&self, nodes: &[u32; 3], weights: &[f64; 3]) -> Result<Option<f64>, GreenError> {
        let places = self.file.compliance(&self.body).map(|compliance| compliance.places());
        let corners = || nodes.iter().zip(weights).filter(|(_, w)| **w != 0.0);
        let asked: Vec<usize> =
            corners().filter_map(|(node, _)| places.as_ref()?.get(node).copied()).collect();
        let Some(columns) = self.file.columns(&self.body, &asked, self.patience)? else { return Ok(None) };
        let mut sum = 0.0;
        for ((_, w), column) in corners().zip(&columns) {
            for (other, v) in corners() {
                let block = &column[*other as usize];
                sum += w * v * (0..3).map(|axis| f64::from(block[axis][axis])).sum::<f64>() / 3.0;
            }
        }
        Ok(Some(sum))
    }

    /// The next evaluation has these loads beside the points of effects; false where they are as they were, or the body has none.
    pub fn apply(&mut self, loads: &AppliedLoads) -> bool {
        let of_effects = &self.contribution.points;
        let changed = self.loads.as_ref().is_some_and(|shared| match of_effects.is_empty() {
            true => loads::set(shared, loads),
            false => {
                let points = [&loads.points[..], of_effects].concat();
                loads::set(shared, &AppliedLoads { points, ..loads.clone() })
            }
        });
        self.loads_changed |= changed;
        changed
    }

    /// An empty contribution, in the shape of those that effects make to this body.
    pub fn no_contribution(&self) -> Contribution {
        Contribution::none(self.contribution.coefficients.len(), self.controls.len())
    }

    /// Range of an effect's columns in [`Contribution::coefficients`]; empty for an effect without columns.
    pub fn coefficients_of(&self, effect: &str) -> Range<usize> {
        self.file.range_of_effect(&self.body, effect)
    }

    /// Place of the effects' columns in the state's coefficients.
    pub fn first_of_effects(&self) -> usize {
        self.state.coefficients.len() - self.contribution.coefficients.len()
    }

    /// The next evaluation has what effects add. False where that is not finite or of another body: the last one stays.
    pub fn contribute(&mut self, contribution: &Contribution) -> bool {
        let (columns, controls) = (self.contribution.coefficients.len(), self.controls.len());
        if !contribution.suits(columns, controls, self.node_count()) || !contribution.is_finite() {
            return false;
        }
        self.contribution_changed |= self.contribution != *contribution;
        if self.contribution.points != contribution.points {
            let AppliedLoads { coefficients, mut points } = self.applied();
            // Those of effects stand last.
            points.truncate(points.len().saturating_sub(self.contribution.points.len()));
            points.extend(&contribution.points);
            if let Some(shared) = &self.loads {
                loads::set(shared, &AppliedLoads { coefficients, points });
            }
        }
        let has_other_triangles = self.contribution.triangles != contribution.triangles;
        self.contribution.clone_from(contribution);
        if has_other_triangles {
            self.topology += 1;
            self.triangles_changed = true;
            self.find_creases();
        }
        true
    }

    /// Contribution of the effects.
    pub fn contribution(&self) -> &Contribution {
        &self.contribution
    }

    /// Results of the forces at single points.
    pub fn point_results(&self) -> &[PointResult] {
        self.model.point_results()
    }

    /// The loads that were applied last.
    pub fn applied(&self) -> AppliedLoads {
        let shared = self.loads.as_ref().map(|shared| shared.lock().unwrap_or_else(PoisonError::into_inner));
        shared.map_or_else(AppliedLoads::default, |applied| applied.clone())
    }

    /// The coefficients of the loads' columns as they were summed last, and what they alone do to a control element while all rest,
    /// both in the frame of the columns: its moment is about its origin.
    pub fn resting_loads(&self, element: usize) -> (Vec<f64>, Wrench) {
        let mut coefficients = self.load_coefficients();
        let nothing = Wrench { force: V3::zeros(), moment: V3::zeros() };
        let Some(reaction) = self.file.table(&self.body, REACTION) else { return (Vec::new(), nothing) };
        coefficients.resize(reaction.ncols(), 0.0);
        if reaction.nrows() < FIELDS * (element + 1) {
            return (coefficients, nothing);
        }
        let own = -reaction.rows(FIELDS * element, FIELDS) * DVector::from_column_slice(&coefficients);
        let slope = PoseSlope::of_numbers(own.as_slice());
        (coefficients, Wrench::of_small_strain(&slope))
    }

    /// All that acts on the body as it is now, springs and what holds points in their places as the forces that they have come to.
    pub fn acting(&self) -> AppliedLoads {
        let AppliedLoads { coefficients, points } = self.applied();
        if !matches!(self.entry.loads, Bearing::Columns) {
            return AppliedLoads { coefficients, points };
        }
        let found = points.into_iter().zip(self.point_results());
        let points = found.map(|(point, found)| PointLoad { pull: Pull::Force(found.force), ..point });
        AppliedLoads { points: points.collect(), coefficients }
    }

    /// Whether nothing acts on it from outside but its weight.
    pub fn bears_weight_alone(&self) -> bool {
        let AppliedLoads { coefficients, points } = self.applied();
        let mut rest = coefficients.as_slice();
        let acts = |meta: &LoadMeta| {
            let (own, others) = rest.split_at(meta.columns.min(rest.len()));
            rest = others;
            own.iter().any(|c| *c != 0.0) && meta.turning != Turning::Inner && meta.name != GRAVITY
        };
        points.is_empty() && !self.contribution.exerts_forces() && !self.load_metas().iter().any(acts)
    }

    /// The coefficients of all load columns as they were summed last, in the frame of the columns; of a model that sums none, as
    /// they are applied, in the frame of its displacements.
    pub fn load_coefficients(&self) -> Vec<f64> {
        if !matches!(self.entry.loads, Bearing::Columns) {
            return self.seen_coefficients();
        }
        let count: usize = self.load_metas().iter().map(|meta| meta.columns).sum();
        let first = FIELDS * self.controls.len();
        self.state.coefficients.get(first..first + count).unwrap_or(&[]).to_vec()
    }

    fn seen_coefficients(&self) -> Vec<f64> {
        let mut all = self.applied().coefficients;
        let turn = if self.weights.is_none() {
            self.summed.body_from_surface().rotation
        } else {
            UnitQuaternion::identity()
        };
        let mut first = 0;
        for meta in self.load_metas() {
            let own = all.get_mut(first..first + meta.columns);
            if let (Turning::Fixed, 3, Some(own)) = (meta.turning, meta.columns, own) {
                let seen = turn.inverse() * V3::from_column_slice(own);
                own.copy_from_slice(seen.as_slice());
            }
            first += meta.columns;
        }
        all
    }

    /// The nodes of the surface at which points are pulled.
    pub fn loaded_nodes(&self) -> Vec<u32> {
        let points = self.applied().points;
        let corners = points.iter().flat_map(|point| point.nodes.into_iter().zip(point.weights));
        corners.filter(|(_, weight)| *weight != 0.0).map(|(node, _)| node).collect()
    }

    /// Factor by which warmth lengthens the body where it is free.
    pub fn free_stretch(&self) -> f64 {
        let columns =
            self.load_metas().iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns));
        let AppliedLoads { coefficients, .. } = self.applied();
        let inner = columns.zip(coefficients).filter(|(turning, _)| *turning == Turning::Inner);
        1.0 + inner.map(|(_, strain)| strain).sum::<f64>()
    }
}

impl Deformer {
    pub fn snapshot(&self) -> DeformerState {
        DeformerState {
            poses: self.poses.clone(),
            turns: self.turns.clone(),
            path: self.path.clone(),
            loads: self.applied(),
            loads_changed: self.loads_changed,
            contribution: self.contribution.clone(),
            state: self.state.clone(),
            summed: self.summed.clone(),
            response: self.response,
            slopes: self.slopes.clone(),
            evaluated: self.evaluated,
            memory: self.model.memory(),
        }
    }

    /// Goes on from a snapshot of a deformer of the same body and model. The error says why it cannot.
    pub fn restore(&mut self, from: &DeformerState) -> Result<(), String> {
        let shape = |state: &BodyState| (state.coefficients.len(), state.parts.len());
        let lists = [from.poses.len(), from.turns.len(), from.slopes.len()];
        let is_there =
            |point: &PointLoad| point.nodes.iter().all(|node| (*node as usize) < self.node_count());
        if lists != [self.controls.len(); 3]
            || !from.loads.points.iter().all(is_there)
            || shape(&from.state) != shape(&self.state)
            || shape(&from.summed) != shape(&self.summed)
        {
            return Err(format!("body.{}: the stored state belongs to another body or model", self.body));
        }
        if let Some(shared) = &self.loads {
            loads::set(shared, &AppliedLoads::default());
        }
        self.contribution.points.clear();
        if !self.contribute(&from.contribution) {
            return Err(format!("body.{}: what effects add belongs to another body", self.body));
        }
        (self.contribution_changed, self.triangles_changed) = (false, false);
        if let Some(shared) = &self.loads {
            loads::set(shared, &from.loads);
        }
        self.model.set_memory(&from.memory).map_err(|message| format!("body.{}: {message}", self.body))?;
        self.poses.clone_from(&from.poses);
        self.turns.clone_from(&from.turns);
        self.path.clone_from(&from.path);
        self.loads_changed = from.loads_changed;
        self.slopes.clone_from(&from.slopes);
        (self.response, self.evaluated) = (from.response, from.evaluated);
        self.state.clone_from(&from.summed);
        self.deform();
        self.state.clone_from(&from.state);
        Ok(())
    }
}
