//! The groups into which the four nodes of a tetrahedron fall.
//!
//! In: for each node the lowest of its group. Out: which are alone, and the two pairs.

/// The nodes of the edges of a tetrahedron.
pub(super) const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];

/// Whether no other node of a tetrahedron is in the group of this one.
pub(super) fn is_single(group: &[usize; 4], node: usize) -> bool {
    (0..4).all(|other| other == node || group[other] != group[node])
}

/// The two pairs of a tetrahedron, that with the lowest node first, where it falls into two.
pub(super) fn pairs(group: &[usize; 4]) -> Option<[usize; 4]> {
    let of_first: Vec<usize> = (0..4).filter(|node| group[*node] == group[0]).collect();
    let others: Vec<usize> = (0..4).filter(|node| group[*node] != group[0]).collect();
    let ([a, b], [c, d]) = (of_first.as_slice(), others.as_slice()) else { return None };
    (group[*c] == group[*d]).then(|| seen_from_outside([*a, *b, *c, *d]))
}

/// The corners of a tetrahedron in this order, or with the last two swapped, so that the last three are seen counter-clockwise from
/// outside.
pub(super) fn seen_from_outside(order: [usize; 4]) -> [usize; 4] {
    let swaps = PAIRS.iter().filter(|(i, j)| order[*i] > order[*j]).count();
    let [a, b, c, d] = order;
    if swaps % 2 == 0 { order } else { [a, b, d, c] }
}
