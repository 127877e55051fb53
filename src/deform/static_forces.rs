//! Forces on a body that is solved anew, as plain data.
//!
//! In: the loads of a frame or of a pose, and the nodes of its mesh. Out: a coefficient for each column of the loads, and forces at
//! single nodes.

use super::loads::applied::{AppliedLoads, Pull};
use crate::field::numbers::Numbers;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

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
    pub fn of(loads: &AppliedLoads, node_of: impl Fn(u32) -> Option<u32>) -> Option<StaticForces> {
        let mut at_nodes = Vec::new();
        for point in &loads.points {
            let Pull::Force(force) = point.pull else { return None };
            for (node, weight) in point.nodes.into_iter().zip(point.weights).filter(|(_, w)| *w != 0.0) {
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
