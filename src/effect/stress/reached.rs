//! The largest stress and strain that a body has reached, and the part of its surface where a limit is passed.

use super::stressed_body::StressedBody;
use crate::base::quantity::quantity;
use crate::deform::{Deformer, NodeStress, Strain};
use crate::scene::{Limit, Quantity};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Part of the peak at an edge above which the largest stress elsewhere is not reported separately.
const ALIKE: f64 = 0.9;

/// The loads on a surface beside control elements.
#[derive(Clone, Copy, Debug, Default)]
pub struct SurfaceLoads<'a> {
    /// Coefficients of all load columns of the body, in the frame of its displacements.
    pub coefficients: &'a [f64],
    /// Nodes of the surface that bear forces of their own.
    pub points: &'a [u32],
}

/// Peaks of one body in one shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reached {
    /// The largest values at nodes, and the nodes that have them: Pa, and a ratio.
    pub von_mises: (f64, usize),
    pub strain: (f64, usize),
    /// The largest part of a limit, with that limit; `None` without limits.
    pub limit: Option<(f64, Limit)>,
    /// Part of the surface, control elements left out, in which a limit is passed.
    pub passed: f64,
    /// `von_mises` and `limit` away from the edges of control elements ([`StressedBody::is_edge`]).
    pub inside: Inside,
}

/// Peaks away from the edges of control elements, where stress is a peak of the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Inside {
    /// Pa.
    pub von_mises: f64,
    /// The largest part of a limit, with that limit; `None` without limits.
    pub limit: Option<(f64, Limit)>,
}

/// The part of its limit that a node has reached, by the limits of all materials.
fn part(at: &NodeStress, limits: &[Option<Limit>]) -> Option<(f64, Limit)> {
    let limit = limits.get(usize::from(at.material)).copied().flatten()?;
    let value = match limit {
        Limit::Stress(_) => at.von_mises,
        Limit::Strain(_) => at.strain,
    };
    Some((value / limit.value(), limit))
}

/// The part of its limit that a node has reached; 0 without one.
pub fn share(at: &NodeStress, limits: &[Option<Limit>]) -> f64 {
    part(at, limits).map_or(0.0, |(part, _)| part)
}

impl StressedBody {
    /// Stress at every node of the surface, for its displacements `u` where warmth lengthens what is free by `stretch`, under
    /// loads; `None` inside control elements, and at nodes that bear a force of their own, whose stress has no bound.
    pub fn at_nodes(
        &self,
        u: &[Vector3<f64>],
        stretch: f64,
        of: Strain,
        loads: &SurfaceLoads<'_>,
    ) -> Vec<Option<NodeStress>> {
        // Where no limit tells, the larger stress does.
        let order = |at: &NodeStress| part(at, &self.limits).map_or(at.von_mises * 1e-100, |(part, _)| part);
        let faces = self.loads.at(loads.coefficients);
        let mut found = self.surface.at_nodes(u, stretch, of, &faces, order);
        for &node in loads.points {
            found.get_mut(node as usize).into_iter().for_each(|at| *at = None);
        }
        found
    }

    /// Stress at every node of the surface of a deformed body.
    pub fn of(&self, body: &Deformer) -> Vec<Option<NodeStress>> {
        let u: Vec<Vector3<f64>> = (0..body.node_count()).map(|i| body.straining_part(i)).collect();
        let of = match self.is_of_small_strain && body.part_weights().is_none() {
            true => Strain::Small,
            false => Strain::Finite,
        };
        let points = body.loaded_nodes();
        let loads = SurfaceLoads { coefficients: &body.load_coefficients(), points: &points };
        self.at_nodes(&u, body.free_stretch(), of, &loads)
    }

    pub fn reached(&self, nodes: &[Option<NodeStress>]) -> Reached {
        let mut reached = Reached::default();
        let (mut passed, mut whole) = (0.0, 0.0);
        let larger = |of: Option<(f64, Limit)>, than: Option<(f64, Limit)>| {
            of.is_some_and(|(part, _)| than.is_none_or(|(most, _)| part > most))
        };
        for ((i, at), area) in nodes.iter().enumerate().zip(&self.surface.areas) {
            let Some(at) = at else { continue };
            if at.von_mises > reached.von_mises.0 {
                reached.von_mises = (at.von_mises, i);
            }
            if at.strain > reached.strain.0 {
                reached.strain = (at.strain, i);
            }
            let of_limit = part(at, &self.limits);
            if larger(of_limit, reached.limit) {
                reached.limit = of_limit;
            }
            if !self.is_edge[i] {
                let inside = &mut reached.inside;
                inside.von_mises = inside.von_mises.max(at.von_mises);
                if larger(of_limit, inside.limit) {
                    inside.limit = of_limit;
                }
            }
            whole += area;
            passed += if of_limit.is_some_and(|(part, _)| part > 1.0) { *area } else { 0.0 };
        }
        // Of a body without any other node, what there is.
        if reached.inside.von_mises == 0.0 {
            reached.inside = Inside { von_mises: reached.von_mises.0, limit: reached.limit };
        }
        reached.passed = if whole > 0.0 { passed / whole } else { 0.0 };
        reached
    }
}

impl Reached {
    pub fn is_beyond(&self) -> bool {
        self.limit.is_some_and(|(part, _)| part > 1.0)
    }

    /// `von Mises stress at most 412 MPa, largest strain 0.2 %`, and how it stands with the limit.
    pub fn sentence(&self) -> String {
        let stress = quantity(self.von_mises.0, Quantity::VonMises.unit());
        let strain = quantity(self.strain.0, Quantity::Strain.unit());
        let most = format!("von Mises stress at most {stress}{}, largest strain {strain}", self.peak());
        match self.limit {
            Some((part, limit)) if part > 1.0 => format!("{most}; {}", self.passing(limit)),
            Some((part, limit)) => {
                format!("{most}, {} of its limit of {}", quantity(part, ""), written(limit))
            }
            None => most,
        }
    }

    /// Words about the peak elsewhere, if the largest stress is at the edge of a control element.
    fn peak(&self) -> String {
        if self.inside.von_mises >= ALIKE * self.von_mises.0 {
            return String::new();
        }
        let elsewhere = quantity(self.inside.von_mises, Quantity::VonMises.unit());
        format!(
            " at the edge of a control element, where it may grow with a finer mesh, and {elsewhere} elsewhere"
        )
    }

    /// The largest value against this limit, and the part of the surface in which the limit is passed.
    fn value_and_passed(&self, limit: Limit) -> [String; 2] {
        let value = self.limit.map_or(0.0, |(part, _)| part) * limit.value();
        let passed = match self.passed {
            passed if passed < 1e-3 => "less than 0.1 %".to_owned(),
            passed => quantity(passed, ""),
        };
        [quantity(value, limit.quantity().unit()), passed]
    }

    /// Short words for a legend: `412 MPa, limit 250 MPa PASSED in 3 % of the surface`.
    pub fn brief(&self, limit: Limit) -> String {
        let [value, passed] = self.value_and_passed(limit);
        format!("{value}, limit {} PASSED in {passed} of the surface", written(limit))
    }

    /// `above its 250 MPa limit on 3 % of the surface (peak 412 MPa)`.
    pub fn passing(&self, limit: Limit) -> String {
        let [value, passed] = self.value_and_passed(limit);
        format!("above its {} limit on {passed} of the surface (peak {value})", written(limit))
    }
}

/// A limit with its unit.
pub fn written(limit: Limit) -> String {
    quantity(limit.value(), limit.quantity().unit())
}
