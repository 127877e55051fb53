//! Whether a hand points at a control element, holds it, or neither.

/// Decides the colour of a control element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Highlight {
    Idle,
    Hovered,
    Held,
}
