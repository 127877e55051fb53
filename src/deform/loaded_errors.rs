//! What errors to expect of a body that its loads alone deform.
//!
//! In: the errors under the loads that the scene has, all control elements at rest. Out: those under a part of these loads;
//! nothing under others, which were not measured.

use super::expected::ErrorsAt;
use super::loads::AppliedLoads;
use crate::green::LoadMeta;
use nalgebra::DVectorView;
use serde::{Deserialize, Serialize};

/// Of the model against static equilibrium on the same mesh, where all control elements rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadedErrors {
    /// A coefficient for each column of the loads.
    pub loads: Vec<f64>,
    pub at: ErrorsAt,
}

/// Loads that differ by less than this part are the same.
const SAME: f64 = 0.01;

impl LoadedErrors {
    /// The errors under what acts now; `None` where that is no part of what was measured. `begin_at_zero`: they grow from nothing,
    /// at rest, as the loads do.
    pub fn under(&self, acting: &AppliedLoads, metas: &[LoadMeta], begin_at_zero: bool) -> Option<ErrorsAt> {
        let share = self.share(acting, metas)?;
        Some(if begin_at_zero { self.at.begun_by(share) } else { self.at })
    }

    /// The part of the measured loads that acts: the same of each of them, in its direction, and no more than all.
    fn share(&self, acting: &AppliedLoads, metas: &[LoadMeta]) -> Option<f64> {
        if !acting.points.is_empty() {
            return None;
        }
        let mut shares: Vec<f64> = Vec::new();
        let mut first = 0;
        for meta in metas {
            let of = |all: &'_ [f64]| {
                let own = all.get(first..first + meta.columns)?;
                Some(DVectorView::from_slice(own, meta.columns).into_owned())
            };
            let (measured, now) = (of(&self.loads)?, of(&acting.coefficients)?);
            first += meta.columns;
            let size = measured.norm();
            if size == 0.0 {
                (now.norm() == 0.0).then_some(())?;
                continue;
            }
            let share = measured.dot(&now) / (size * size);
            ((&now - &measured * share).norm() <= SAME * size).then_some(())?;
            shares.push(share);
        }
        let most = shares.iter().copied().reduce(f64::max)?;
        let least = shares.iter().copied().fold(most, f64::min);
        (least >= 0.0 && most - least <= SAME && most <= 1.0 + SAME).then_some(most.min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{PointLoad, Pull};
    use crate::green::Turning;
    use nalgebra::Vector3;

    #[test]
    fn parts_of_the_measured_loads_alone_have_errors() {
        let meta = |name: &str, columns: usize| LoadMeta {
            name: name.into(),
            columns,
            turning: Turning::Fixed,
            unit: "N".into(),
        };
        let metas = [meta("gravity", 3), meta("press", 1), meta("idle", 1)];
        let at = ErrorsAt {
            angle: 0.0,
            turn: 0.1,
            stretch: 0.01,
            off: 0.0,
            force: Some(0.04),
            torque: Some(0.02),
            shape: 0.01,
        };
        let errors = LoadedErrors { loads: vec![0.0, -9.81, 0.0, 1e5, 0.0], at };
        let shape = |coefficients: &[f64], points: Vec<PointLoad>, begin_at_zero: bool| {
            let acting = AppliedLoads { coefficients: coefficients.to_vec(), points };
            errors.under(&acting, &metas, begin_at_zero).map(|at| at.shape)
        };
        let of = |coefficients: &[f64]| shape(coefficients, Vec::new(), true);
        assert_eq!(of(&[0.0, -9.81, 0.0, 1e5, 0.0]), Some(0.01));
        assert_eq!(of(&[0.0, -4.905, 0.0, 5e4, 0.0]), Some(0.005), "half of all");
        assert_eq!(of(&[1e-3, -9.81, 0.0, 1e5, 0.0]), Some(0.01), "turned by nothing");
        assert_eq!(shape(&[0.0, -4.905, 0.0, 5e4, 0.0], Vec::new(), false), Some(0.01));
        for (other, what) in [
            ([9.81, 0.0, 0.0, 1e5, 0.0], "turned"),
            ([0.0, -9.81, 0.0, 0.0, 0.0], "one without the other"),
            ([0.0, -19.62, 0.0, 2e5, 0.0], "more"),
            ([0.0, 9.81, 0.0, -1e5, 0.0], "the other way round"),
            ([0.0, -9.81, 0.0, 1e5, 1.0], "one that was not there"),
        ] {
            assert_eq!(of(&other), None, "{what}");
        }
        let pull = Pull::Force(Vector3::x());
        let point = PointLoad { nodes: [0, 1, 2], weights: [1.0, 0.0, 0.0], pull };
        assert_eq!(shape(&errors.loads, vec![point], true), None, "a force at a point");
    }
}
