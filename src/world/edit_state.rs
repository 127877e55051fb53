//! State that lasts from one grab to the next: undo history, navigation, bodies set aside, and the way back to rest.

use super::ruler::Ruler;
use crate::deform::{ControlPose, FollowedTurn};
use crate::interact::{Aside, Ease, History, Navigation};
use crate::stage::Workspace;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Undo history, navigation, bodies set aside, and the way back to rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EditState {
    pub navigation: Navigation,
    pub asides: Vec<Aside>,
    pub(super) history: History<Step>,
    /// Control elements on their way back to rest, with their poses at its beginning.
    pub(super) easing: Option<(Ease, Vec<(usize, ElementPose)>)>,
    /// Every target as it was when it was last not held.
    pub(super) before: Vec<ElementPose>,
    pub(super) held: BTreeSet<usize>,
    pub ruler: Ruler,
}

/// A control element's pose, and the turn that led to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ElementPose {
    pub pose: ControlPose,
    pub turn: FollowedTurn,
}

pub(super) const REST: ElementPose = ElementPose { pose: ControlPose::REST, turn: FollowedTurn::REST };

/// One entry of the history: poses of control elements, or a change by the effect of this name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Step {
    Poses(Vec<Change>),
    Effect(String),
}

impl Step {
    /// The targets that it moved.
    pub fn changes(&self) -> &[Change] {
        match self {
            Step::Poses(changes) => changes,
            Step::Effect(_) => &[],
        }
    }
}

/// One target, before and after.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Change {
    pub target: usize,
    pub before: ElementPose,
    pub after: ElementPose,
}

impl EditState {
    pub fn new(workspace: &Workspace, bodies: usize, targets: usize) -> EditState {
        EditState {
            navigation: Navigation::new(workspace.centre, workspace.radius_m),
            asides: vec![Aside::default(); bodies],
            history: History::default(),
            easing: None,
            before: vec![REST; targets],
            held: BTreeSet::new(),
            ruler: Ruler::default(),
        }
    }

    /// The error names what is of another scene: one with other bodies or control elements than these.
    pub(super) fn suits(&self, bodies: usize, targets: usize) -> Result<(), String> {
        let counts = [
            ("bodies that can be set aside", self.asides.len(), bodies),
            ("control elements that can be taken", self.before.len(), targets),
        ];
        if let Some((what, found, expected)) = counts.iter().find(|(_, found, expected)| found != expected) {
            return Err(format!("it has {found} {what}, the scene has {expected}"));
        }
        let changed = self.history.entries().flat_map(Step::changes).map(|change| change.target);
        let eased = self.easing.iter().flat_map(|(_, from)| from.iter().map(|(target, _)| *target));
        match changed.chain(eased).chain(self.held.iter().copied()).find(|target| *target >= targets) {
            Some(target) => Err(format!("it names control element {target} of {targets}")),
            None => Ok(()),
        }
    }
}
