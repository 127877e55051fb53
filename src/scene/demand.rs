//! What a scene may ask of a body instead of naming its knobs: an accuracy, or a budget.

use super::{Body, Storage};
use crate::fem::Element;
use crate::solve::Solver;
use serde::{Deserialize, Serialize};

/// Largest relative errors over the measured poses.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    /// Of the displacement, relative L2 over the body.
    pub displacement: Option<f64>,
    /// Of forces and torques on control elements, against the largest wrench of the pose.
    pub force: Option<f64>,
    /// Unknowns of the largest solve while it is measured.
    pub largest: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// 99th percentile of one evaluation.
    pub frame_ms: Option<f64>,
    pub file_mb: Option<f64>,
    pub offline_s: Option<f64>,
    /// Unknowns of the largest solve while it is measured.
    pub largest: Option<f64>,
}

/// What is asked of a body whose knobs are not named but chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Demand {
    Accuracy(Accuracy),
    Budget(Budget),
}

impl Demand {
    /// Its key in the scene file.
    pub fn key(&self) -> &'static str {
        match self {
            Demand::Accuracy(_) => "accuracy",
            Demand::Budget(_) => "budget",
        }
    }

    pub fn largest(&self) -> Option<f64> {
        match self {
            Demand::Accuracy(accuracy) => accuracy.largest,
            Demand::Budget(budget) => budget.largest,
        }
    }

    /// Whether it asks for times, which are those of one machine.
    pub fn is_timed(&self) -> bool {
        matches!(self, Demand::Budget(budget) if budget.frame_ms.is_some() || budget.offline_s.is_some())
    }
}

impl Body {
    /// What is asked, where the knobs are to be chosen.
    pub fn demand(&self) -> Option<Demand> {
        self.accuracy.map(Demand::Accuracy).or(self.budget.map(Demand::Budget))
    }
}

/// Errors name the key below the body and what is wrong with it.
pub(super) fn check(body: &Body) -> Result<(), (&'static str, &'static str)> {
    let demand = body.demand();
    let (key, asked) = match demand {
        None => return Ok(()),
        Some(_) if body.accuracy.is_some() && body.budget.is_some() => {
            return Err(("", "name either accuracy or budget, one of the two"));
        }
        Some(Demand::Accuracy(Accuracy { displacement, force, .. })) => {
            (".accuracy", [displacement, force, None])
        }
        Some(Demand::Budget(Budget { frame_ms, file_mb, offline_s, .. })) => {
            (".budget", [frame_ms, file_mb, offline_s])
        }
    };
    let largest = demand.and_then(|demand| demand.largest());
    let mut numbers = asked.into_iter().flatten().peekable();
    if numbers.peek().is_none() || !numbers.chain(largest).all(|value| value > 0.0 && value.is_finite()) {
        return Err((key, "one positive number or more is needed"));
    }
    let is_free = body.element == <&Element>::default()
        && body.storage == Storage::default()
        && body.solver == Solver::default()
        && body.model == super::linear()
        && body.refine == 0;
    if is_free {
        Ok(())
    } else {
        Err((key, "element, refine, storage, solver and model are chosen by it: leave them out"))
    }
}
