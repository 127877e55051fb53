//! How a control element is coloured for what a hand has to do with it.

/// What a hand has to do with a control element now.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Highlight {
    Idle,
    Hovered,
    Held,
}
