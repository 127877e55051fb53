//! The stencils of isosurface stuffing: the part of one lattice tetrahedron that lies inside.
//!
//! In: four lattice vertices with their signs and the cut points of its edges. Out: one to three tetrahedra. The
//! quadrilaterals of cut faces are split by rules that depend on the face alone, so that neighbours conform:
//! a cut point on a long edge takes the diagonal; where both cut points lie on short edges, the parity rule decides
//! (Labelle and Shewchuk 2007, section 3).

/// A lattice vertex of a tetrahedron: its number, its coordinates in half cells, its sign (1 inside, 0 on the surface,
/// -1 outside).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    pub vertex: usize,
    pub coordinates: [i64; 3],
    pub sign: i8,
}

/// Numbers of nodes: `cut(inside, outside)` is the cut point's, a lattice vertex keeps its own.
pub fn fill(corners: &[Corner; 4], cut: impl Fn(usize, usize) -> usize, mut emit: impl FnMut([usize; 4])) {
    let pick = |sign: i8| corners.iter().filter(move |corner| corner.sign == sign);
    let inside: Vec<&Corner> = pick(1).collect();
    let outside: Vec<&Corner> = pick(-1).collect();
    let mut on = pick(0).map(|corner| corner.vertex);
    let cut = |i: &Corner, o: &Corner| cut(i.vertex, o.vertex);
    match (inside.as_slice(), outside.as_slice()) {
        // Also four vertices on the surface: such a tetrahedron is left out.
        ([], _) => {}
        (_, []) => emit(corners.map(|corner| corner.vertex)),
        ([a], _) => {
            let mut nodes = vec![a.vertex];
            nodes.extend(on);
            nodes.extend(outside.iter().map(|o| cut(a, o)));
            if let Ok(tet) = nodes.try_into() {
                emit(tet);
            }
        }
        ([a, b], [o]) => {
            let Some(z) = on.next() else { return };
            let (ca, cb) = (cut(a, o), cut(b, o));
            let far = if from_first(a, b, o) { cb } else { ca };
            emit([z, a.vertex, b.vertex, far]);
            emit([z, if far == cb { a.vertex } else { b.vertex }, ca, cb]);
        }
        ([a, b], [o, p]) => {
            let bottom = [a.vertex, cut(a, o), cut(a, p)];
            let top = [b.vertex, cut(b, o), cut(b, p)];
            // Between o and p the quadrilateral is the surface's: whatever closes the prism.
            prism(bottom, top, [Some(from_first(a, b, o)), None, Some(!from_first(a, b, p))], emit);
        }
        ([a, b, c], [o]) => {
            let bottom = [a, b, c].map(|corner| corner.vertex);
            let top = [a, b, c].map(|corner| cut(corner, o));
            let diagonals = [(a, b), (b, c), (c, a)].map(|(i, j)| Some(from_first(i, j, o)));
            prism(bottom, top, diagonals, emit);
        }
        _ => {}
    }
}

/// On the face of `i` and `j` inside and `o` outside: whether the diagonal runs from i to the cut point of j, or else
/// from j to the cut point of i.
fn from_first(i: &Corner, j: &Corner, o: &Corner) -> bool {
    let is_long = |p: &Corner, q: &Corner| (p.coordinates[0] - q.coordinates[0]) % 2 == 0;
    if is_long(i, o) {
        false
    } else if is_long(j, o) {
        true
    } else {
        // Of the two ends of a long edge exactly one exceeds o in an even number of coordinates.
        (0..3).filter(|&axis| i.coordinates[axis] > o.coordinates[axis]).count() % 2 == 0
    }
}

/// Three tetrahedra of the prism over triangle `bottom`. Side k lies between corners k and k + 1; its diagonal runs
/// from bottom k to top k + 1 (true) or from bottom k + 1 to top k; `None`: either.
fn prism(
    bottom: [usize; 3],
    top: [usize; 3],
    diagonals: [Option<bool>; 3],
    mut emit: impl FnMut([usize; 4]),
) {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let runs = |from: usize, to: usize| {
        let (side, forward) = if (from + 1) % 3 == to { (from, true) } else { (to, false) };
        diagonals[side].is_none_or(|way| way == forward)
    };
    // Diagonals that run round in a circle have no such order; the rules above never make them.
    if let Some([x, y, z]) = ORDERS.into_iter().find(|&[x, y, z]| runs(x, y) && runs(x, z) && runs(y, z)) {
        emit([bottom[x], bottom[y], bottom[z], top[z]]);
        emit([bottom[x], bottom[y], top[y], top[z]]);
        emit([bottom[x], top[x], top[y], top[z]]);
    }
}
