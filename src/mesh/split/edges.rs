//! Edges of a mesh that are cut, and where.

use std::collections::BTreeMap;

/// Edges that are cut: both nodes, the smaller first, and where, as a part of the way from the first to the second.
pub type CutEdges = BTreeMap<[u32; 2], f64>;

/// An edge as it stands in [`CutEdges`].
pub fn edge([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Place of the cut of an edge, as a part of the way from its first node; a half where it is not.
pub(super) fn share(cut: &CutEdges, [a, b]: [u32; 2]) -> f64 {
    let share = cut.get(&edge([a, b])).copied().unwrap_or(0.5);
    if a < b { share } else { 1.0 - share }
}
