//! The outcome of a solve: a body held in a pose, with the stability and the branch of its equilibrium, or the end of the way to it.
//!
//! In: what the solver found. Out: [`EquilibriumResult`], or [`StaticsError`] with the pose at which the equilibrium was lost and the
//! remedy. The branches are those of E. Riks (Int. J. Solids Struct. 15, 1979, 529-551): around limit points by arc length, at
//! bifurcations along the mode.

use super::critical::CriticalPose;
use super::freedom::loose;
use crate::deform::pose::frame::{ControlPose, ControlPoses, Wrench};
use crate::fem::Law;
use crate::green::GreenError;
use crate::solve::{Counts, Passed, Setback, SolveError};
use nalgebra::Vector3;

/// The branch of an equilibrium.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branch {
    /// Connected with the start by stable equilibria.
    Stable,
    /// Stable, reached around a limit point, through unstable states.
    Snapped,
    /// Stable, reached by leaving a critical state along its mode.
    Buckled,
    Unstable,
}

impl Branch {
    pub fn name(self) -> &'static str {
        match self {
            Branch::Stable => "stable",
            Branch::Snapped => "snapped",
            Branch::Buckled => "buckled",
            Branch::Unstable => "unstable",
        }
    }

    /// The branch behind a critical state.
    pub(super) fn beyond(self, passed: &Passed) -> Branch {
        if passed.is_left || self == Branch::Buckled { Branch::Buckled } else { Branch::Snapped }
    }
}

/// An eigenvalue in parts of the least at rest, and its mode, displacements of all nodes.
pub type LeastMode = (f64, Vec<Vector3<f64>>);

/// The stability of a body's equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct TangentState {
    pub branch: Branch,
    /// Number of negative eigenvalues of the tangent stiffness.
    pub negative: usize,
    /// Least eigenvalue of it with the mode of length 1; `None` where it was not asked for, nothing is free to move, and on a curve by
    /// arc length.
    pub least: Option<LeastMode>,
    /// The critical poses behind it.
    pub passed: Vec<CriticalPose>,
}

/// A body held in a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct EquilibriumResult {
    /// The poses of the control elements, those that were found too.
    pub poses: ControlPoses,
    pub stability: TangentState,
    /// Displacement of every node of the mesh, m.
    pub displacement: Vec<Vector3<f64>>,
    /// Wrench on every control element, about where its origin rested, with the lever arms of the deformed body.
    pub wrenches: Vec<Wrench>,
    /// Strain energy of the body less the work of its loads, J.
    pub energy: f64,
    /// Least det F at the points of integration, and the tetrahedron that has it.
    pub least_det: (f64, usize),
    /// Tetrahedra turned inside out, det F ≤ 0 at a point.
    pub inverted: Vec<usize>,
    /// ‖f‖₂ at the free nodes over that at the controlled ones.
    pub residual: f64,
    pub counts: Counts,
}

impl EquilibriumResult {
    /// The wrenches, with the moments about where the elements are in these poses.
    pub fn balance(&self, poses: &[ControlPose]) -> Vec<Wrench> {
        self.wrenches.iter().zip(poses).map(|(wrench, pose)| wrench.about_the_place(pose)).collect()
    }
}

#[derive(Debug, thiserror::Error)]
pub enum StaticsError {
    #[error(transparent)]
    Green(#[from] GreenError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error("{}", loose(*element, component))]
    Loose { element: usize, component: &'static str },
    #[error(
        "the loads turn with what is pushed, and after {searches} searches they still differ by {part:.1e} of the largest from \
         those that fit where it stands: push it less far, or hold its turn"
    )]
    StillTurning { searches: usize, part: f64 },
    #[error(
        "no equilibrium beyond {:.1} % of the way from {from} to this pose: {}. {}",
        100.0 * share, explain(*why, critical), remedy(*why, critical, law, settled.least_det.0)
    )]
    Stopped {
        /// The last state that was found.
        settled: Box<EquilibriumResult>,
        share: f64,
        from: String,
        why: Setback,
        /// The pose in which the body gives way; `None` where it could not be found.
        critical: Option<Box<CriticalPose>>,
        law: &'static Law,
        /// Tags of the corners of the tetrahedron with the least det F.
        tags: [u64; 4],
        tets: usize,
    },
}

fn explain(why: Setback, critical: &Option<Box<CriticalPose>>) -> String {
    if let Some(critical) = critical {
        return critical.to_string();
    }
    match why {
        Setback::Unstable => "the tangent stiffness is no longer positive definite",
        Setback::NoDescent => "no step lowers the energy any more",
        Setback::Slow => "Newton's iteration does not converge",
    }
    .to_owned()
}

impl StaticsError {
    /// Figures of the end: the least eigenvalue and its mode, the least det F, tetrahedra turned inside out.
    pub fn details(&self) -> Option<String> {
        let StaticsError::Stopped { settled, critical, tags, tets, .. } = self else { return None };
        let (least, inverted) = (settled.least_det.0, settled.inverted.len());
        let mode = critical.as_ref().map_or_else(String::new, |critical| format!("{}. ", critical.details()));
        Some(format!(
            "{mode}Least det F: {least:.3} (nodes {tags:?}); {inverted} of {tets} tetrahedra are inverted"
        ))
    }
}

/// Least det F below which a body gives way because it is pressed together.
const PRESSED: f64 = 0.8;

fn remedy(why: Setback, critical: &Option<Box<CriticalPose>>, law: &Law, least_det: f64) -> &'static str {
    match critical {
        Some(critical) if critical.is_critical && least_det > PRESSED => {
            "Move or load it less, make it thicker, or lead it round this pose (`after`)"
        }
        None if why == Setback::Slow => {
            "Look for slivers and large contrasts of stiffness (`greenstage check`)"
        }
        Some(critical) if why == Setback::Slow && !critical.is_critical => {
            "Look for slivers and large contrasts of stiffness (`greenstage check`)"
        }
        _ => law.remedy,
    }
}
