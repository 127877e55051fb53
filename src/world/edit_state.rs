//! What lasts from one grab to the next: undo history, navigation, bodies set aside, and the way back to rest.

use super::ruler::Ruler;
use crate::deform::{ControlPose, FollowedTurn};
use crate::interact::{Aside, Ease, History, Navigation};
use crate::stage::Workspace;
use std::collections::BTreeSet;

/// Undo history, navigation, bodies set aside, and the way back to rest.
pub struct EditState {
    pub navigation: Navigation,
    pub asides: Vec<Aside>,
    pub(super) history: History<Vec<Change>>,
    /// Control elements on their way back to rest, and whence.
    pub(super) easing: Option<(Ease, Vec<(usize, Posed)>)>,
    /// Every target as it was when it was last not held.
    pub(super) before: Vec<Posed>,
    pub(super) held: BTreeSet<usize>,
    pub ruler: Ruler,
}

/// A control element's pose, and the turn that led to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Posed {
    pub pose: ControlPose,
    pub turn: FollowedTurn,
}

pub(super) const REST: Posed = Posed { pose: ControlPose::REST, turn: FollowedTurn::REST };

/// One target, before and after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Change {
    pub target: usize,
    pub before: Posed,
    pub after: Posed,
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
    /// Names something that is not at rest, and that a stream of the graph's fields would therefore lose.
    pub(super) fn is_unsaved(&self) -> Option<&'static str> {
        match self {
            EditState { navigation, .. } if !navigation.is_at_rest() => {
                Some("the scene is moved (Home puts it back)")
            }
            EditState { asides, .. } if !asides.iter().all(Aside::is_at_home) => Some("a body is set aside"),
            EditState { easing: Some(_), .. } => Some("bodies are on their way back to rest"),
            EditState { ruler, .. } if *ruler != Ruler::default() => {
                Some("a ruler is laid (M takes it away)")
            }
            EditState { history, .. } if *history != History::default() => Some("there is something to undo"),
            _ => None,
        }
    }
}
