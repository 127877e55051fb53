//! Targets by which a body's settings are chosen instead of being named: an accuracy, or a budget.

use serde::{Deserialize, Serialize};

/// The largest relative errors over the measured poses.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { displacement = 0.05, force = 0.2 }")]
pub struct Accuracy {
    /// Error of the displacement, relative L2 over the body.
    pub displacement: Option<f64>,
    /// Error of forces and torques on control elements, relative to the largest wrench of the pose.
    pub force: Option<f64>,
    /// Unknowns of the largest solve while it is measured.
    pub largest: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, expecting = "a table like { frame_ms = 0.5, file_mb = 10.0 }")]
pub struct Budget {
    /// Time of one evaluation with every control element moved: from poses to the surface.
    pub frame_ms: Option<f64>,
    pub file_mb: Option<f64>,
    pub offline_s: Option<f64>,
    /// Unknowns of the largest solve while it is measured.
    pub largest: Option<f64>,
}

/// The target by which element, refinement, storage, solver and model of a body are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AccuracyTarget {
    Accuracy(Accuracy),
    Budget(Budget),
}

impl std::str::FromStr for AccuracyTarget {
    type Err = String;

    /// Parses a target as in a scene, without braces: "displacement = 0.05, force = 0.1", or "frame_ms = 0.05". Numbers may be in
    /// percent.
    fn from_str(text: &str) -> Result<AccuracyTarget, String> {
        let (mut accuracy, mut budget) = ([None; 2], [None; 3]);
        for pair in text.split(',') {
            let (key, value) =
                pair.split_once('=').ok_or(format!("\"{}\" is no KEY = NUMBER", pair.trim()))?;
            let (key, value) = (key.trim(), value.trim());
            let (number, unit) = value.strip_suffix('%').map_or((value, 1.0), |percent| (percent, 0.01));
            let place = match key {
                "displacement" => &mut accuracy[0],
                "force" => &mut accuracy[1],
                "frame_ms" => &mut budget[0],
                "file_mb" => &mut budget[1],
                "offline_s" => &mut budget[2],
                _ => {
                    return Err(format!(
                        "\"{key}\" is not one of displacement, force; or of frame_ms, file_mb, offline_s"
                    ));
                }
            };
            let number: Option<f64> = number.trim().parse().ok().map(|number: f64| unit * number);
            let number = number.filter(|number| *number > 0.0 && number.is_finite());
            *place = Some(number.ok_or(format!("{key}: \"{value}\" is no positive number"))?);
        }
        let ([displacement, force], [frame_ms, file_mb, offline_s]) = (accuracy, budget);
        displacement.map_or(Ok(()), no_more_than_all)?;
        match (accuracy.iter().flatten().count(), budget.iter().flatten().count()) {
            (_, 0) => Ok(AccuracyTarget::Accuracy(Accuracy { displacement, force, largest: None })),
            (0, _) => Ok(AccuracyTarget::Budget(Budget { frame_ms, file_mb, offline_s, largest: None })),
            _ => Err(
                "ask for errors (displacement, force) or for costs (frame_ms, file_mb, offline_s), not both"
                    .into(),
            ),
        }
    }
}

/// Refuses an error of displacement of more than the displacement itself.
pub(super) fn no_more_than_all(displacement: f64) -> Result<(), String> {
    if displacement <= 1.0 {
        return Ok(());
    }
    Err(format!(
        "displacement = {displacement} is {:.0} % of the whole: write {} for {displacement} %",
        100.0 * displacement,
        displacement / 100.0
    ))
}

impl AccuracyTarget {
    /// Key of the target in the scene file.
    pub fn key(&self) -> &'static str {
        match self {
            AccuracyTarget::Accuracy(_) => "accuracy",
            AccuracyTarget::Budget(_) => "budget",
        }
    }

    /// "displacement = 0.05, force = 0.1".
    pub fn asked(&self) -> String {
        let pairs = match self {
            AccuracyTarget::Accuracy(of) => {
                [("displacement", of.displacement), ("force", of.force), ("", None)]
            }
            AccuracyTarget::Budget(of) => {
                [("frame_ms", of.frame_ms), ("file_mb", of.file_mb), ("offline_s", of.offline_s)]
            }
        };
        let said = pairs.iter().filter_map(|(key, value)| Some(format!("{key} = {}", (*value)?)));
        said.collect::<Vec<_>>().join(", ")
    }

    pub fn largest(&self) -> Option<f64> {
        match self {
            AccuracyTarget::Accuracy(accuracy) => accuracy.largest,
            AccuracyTarget::Budget(budget) => budget.largest,
        }
    }

    /// Whether it limits times, which hold for one machine only.
    pub fn is_timed(&self) -> bool {
        matches!(self, AccuracyTarget::Budget(budget) if budget.frame_ms.is_some() || budget.offline_s.is_some())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_question_is_read_as_in_a_scene() {
        let both =
            AccuracyTarget::Accuracy(Accuracy { displacement: Some(0.05), force: Some(0.1), largest: None });
        assert_eq!("displacement=0.05,force = 10 %".parse(), Ok(both));
        let budget = AccuracyTarget::Budget(Budget {
            frame_ms: Some(0.05),
            file_mb: None,
            offline_s: None,
            largest: None,
        });
        assert_eq!("frame_ms = 0.05".parse(), Ok(budget));
        let why = |text: &str| text.parse::<AccuracyTarget>().unwrap_err();
        assert!(why("").contains("no KEY = NUMBER") && why("speed = 1").contains("not one of displacement"));
        assert!(
            why("force = -1").contains("no positive number") && why("force = inf").contains("no positive")
        );
        assert!(why("force = 1, file_mb = 2").contains("not both"));
        assert_eq!(why("displacement = 5"), "displacement = 5 is 500 % of the whole: write 0.05 for 5 %");
        assert!("displacement = 100 %".parse::<AccuracyTarget>().is_ok(), "all of it may be wrong");
    }

    proptest! {
        #[test]
        fn any_question_is_answered(text in ".{0,40}") {
            let _ = text.parse::<AccuracyTarget>();
        }
    }
}
