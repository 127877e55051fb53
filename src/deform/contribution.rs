//! Contributions of effects to a body in one frame, beside its model, and the state of a deformer with them.
//!
//! The shape is x_i = Σ_p w_ip (R_p (X_i + Σ_k c_k u_i⁽ᵏ⁾) + t_p), where k runs over the columns of effects too. The energy is
//! V(P) + V'(P) with the poses P of the control elements; effects supply V' and its derivatives.

use super::loads::{AppliedLoads, PointLoad};
use super::memory::ModelMemory;
use super::model::{BodyState, Response};
use super::path::BodyPath;
use super::pose::follow::FollowedTurn;
use super::pose::frame::{ControlPose, ControlPoses, PoseSlope, flat};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::sync::Arc;

/// Derivatives with respect to the twelve numbers of a pose: T, then M row by row.
pub type PoseCurvature = SMatrix<f64, 12, 12>;

/// The contribution of all effects to one body in one frame; effects add to it one after the other.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contribution {
    /// c_k of the columns of effects.
    #[serde(with = "crate::field::numbers::flat")]
    pub coefficients: Vec<f64>,
    /// V', J.
    #[serde(with = "crate::field::numbers")]
    pub energy: f64,
    /// ∂V'/∂P of each control element: the force that the hand must apply; what the hand feels is its negative.
    pub slopes: Vec<PoseSlope>,
    /// ∂²V'/∂P² of each control element, the others held: the stiffness with which a force loop extrapolates between two frames.
    #[serde(with = "crate::field::numbers::list")]
    pub curvatures: Vec<PoseCurvature>,
    /// Forces at points of the surface, which act like loads: on the shape, on the energy and on the control elements.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointLoad>,
    /// The triangles of the surface, if an effect replaces those of the .green file: nodes of the surface, counter-clockwise seen
    /// from outside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub triangles: Option<Topology>,
}

/// The triangles of a surface, shared by all who look at it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topology(pub Arc<Vec<[u32; 3]>>);

impl Serialize for Topology {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.as_slice().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Topology {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Topology, D::Error> {
        Ok(Topology(Arc::new(Vec::deserialize(deserializer)?)))
    }
}

impl Contribution {
    /// No contribution, with `columns` columns of effects and `controls` control elements.
    pub fn none(columns: usize, controls: usize) -> Contribution {
        Contribution {
            coefficients: vec![0.0; columns],
            energy: 0.0,
            slopes: vec![PoseSlope::default(); controls],
            curvatures: vec![PoseCurvature::zeros(); controls],
            points: Vec::new(),
            triangles: None,
        }
    }

    pub fn is_finite(&self) -> bool {
        let slopes = self.slopes.iter().flat_map(|slope| slope.translation.iter().chain(slope.matrix.iter()));
        let curvatures = self.curvatures.iter().flatten();
        self.energy.is_finite()
            && self.coefficients.iter().chain(slopes).chain(curvatures).all(|x| x.is_finite())
            && self.points.iter().all(PointLoad::is_finite)
    }

    /// Whether effects change the forces on control elements. Changing the shape alone, without energy, exerts none. Curvatures
    /// are ignored here, unlike in [`Contribution::of_element`].
    pub fn exerts_forces(&self) -> bool {
        !self.points.is_empty() || self.slopes.iter().any(|slope| *slope != PoseSlope::default())
    }

    /// Whether the lengths of its lists fit the body.
    pub fn suits(&self, columns: usize, controls: usize, nodes: usize) -> bool {
        let of_triangles = self.triangles.iter().flat_map(|triangles| triangles.0.as_flattened());
        let mut corners = of_triangles.chain(self.points.iter().flat_map(|point| &point.nodes));
        (self.coefficients.len(), self.slopes.len(), self.curvatures.len()) == (columns, controls, controls)
            && corners.all(|node| (*node as usize) < nodes)
    }

    /// The part of control element `e` alone, about its pose `at`; `None` if there is none.
    pub fn of_element(&self, e: usize, at: &ControlPose) -> Option<ElementPotential> {
        let (slope, curvature) = (self.slopes.get(e)?, self.curvatures.get(e)?);
        let is_none = *slope == PoseSlope::default() && *curvature == PoseCurvature::zeros();
        (!is_none).then_some(ElementPotential {
            at: *at,
            energy: self.energy,
            slope: *slope,
            curvature: *curvature,
        })
    }
}

/// V' near a pose P₀ of one control element: V'₀ + g·(P - P₀) + ½ (P - P₀)·H (P - P₀).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementPotential {
    pub at: ControlPose,
    pub energy: f64,
    pub slope: PoseSlope,
    pub curvature: PoseCurvature,
}

impl ElementPotential {
    /// Energy and slope at another pose.
    pub fn respond(&self, pose: &ControlPose) -> (f64, PoseSlope) {
        let moved = flat(&(pose.translation - self.at.translation), &(pose.matrix - self.at.matrix));
        let (moved, slope) = (SVector::from(moved), SVector::from(self.slope.numbers()));
        let grown = self.curvature * moved;
        let energy = self.energy + slope.dot(&moved) + 0.5 * moved.dot(&grown);
        let sum = slope + grown;
        (energy, PoseSlope::of_numbers(sum.as_slice()))
    }
}

/// State from which [`Deformer::restore`](super::Deformer::restore) makes the same surface, and all later frames with the same
/// bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeformerState {
    pub poses: ControlPoses,
    pub turns: Vec<FollowedTurn>,
    pub path: BodyPath,
    pub loads: AppliedLoads,
    pub loads_changed: bool,
    pub contribution: Contribution,
    /// The model's state for the poses, and the one for which the surface was last summed.
    pub state: BodyState,
    pub summed: BodyState,
    /// The energy of the poses and its slopes, where the model has them.
    pub response: Option<Response>,
    pub slopes: Vec<PoseSlope>,
    pub evaluated: bool,
    pub memory: ModelMemory,
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn a_potential_is_a_quadratic_form_about_its_pose() {
        let at = ControlPose { translation: Vector3::new(0.1, 0.2, 0.3), matrix: Matrix3::identity() * 1.1 };
        let half = PoseCurvature::from_fn(|i, j| ((3 * i + 5 * j) % 7) as f64 - 2.0);
        let contribution = Contribution {
            energy: 0.7,
            slopes: vec![PoseSlope {
                translation: Vector3::new(1.0, -2.0, 0.5),
                matrix: Matrix3::new_scaling(0.3),
            }],
            curvatures: vec![half + half.transpose()],
            ..Contribution::none(0, 1)
        };
        let potential = contribution.of_element(0, &at).unwrap();
        assert_eq!(potential.respond(&at), (0.7, contribution.slopes[0]));
        let pose = ControlPose {
            translation: at.translation + Vector3::new(0.02, -0.01, 0.03),
            matrix: at.matrix + Matrix3::new(0.1, 0.2, -0.1, 0.0, 0.05, 0.3, -0.2, 0.1, 0.15),
        };
        let (_, slope) = potential.respond(&pose);
        for i in 0..12 {
            let energy = |step: f64| {
                let mut moved = pose;
                match i {
                    0..3 => moved.translation[i] += step,
                    _ => moved.matrix[((i - 3) / 3, (i - 3) % 3)] += step,
                }
                potential.respond(&moved).0
            };
            let expected = (energy(1e-4) - energy(-1e-4)) / 2e-4;
            let found = slope.numbers()[i];
            assert!((found - expected).abs() < 1e-9, "{i}: {found}, expected {expected}");
        }
        assert_eq!(Contribution::none(0, 1).of_element(0, &at), None);
    }
}
