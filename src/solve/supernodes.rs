//! The supernodes of L with their rows and their tree: all of the pattern that a solve needs.
//!
//! In: how many nodes each supernode has, in the order of elimination, and the rows below them. Out: where each stands, and
//! those that a solve from or to some nodes passes.

use std::ops::Range;

pub(super) const NONE: u32 = u32::MAX;

/// The pattern of a factor by supernodes, in nodes of three unknowns.
#[derive(Debug, PartialEq)]
pub(super) struct Supernodes {
    /// The positions in the order of elimination of the nodes that are asked for: of a whole factor, of all.
    pub(super) inverse: Vec<u32>,
    /// Nodes of supernode s, in this order: `begin[s]..begin[s + 1]`.
    begin: Vec<u32>,
    /// Rows below the nodes of supernode s, ascending: `rows[row_start[s]..row_start[s + 1]]`.
    rows: Vec<u32>,
    row_start: Vec<usize>,
    /// Numbers of supernode s in L, (n + m) × n, column after column: `value_start[s]..value_start[s + 1]`.
    value_start: Vec<usize>,
    parent: Vec<u32>,
    /// The supernode of each node of the order.
    of_node: Vec<u32>,
}

impl Supernodes {
    /// Makes the pattern from the nodes of each supernode and the rows below each. The error says why they are no pattern of a
    /// factor.
    pub(super) fn new(inverse: Vec<u32>, sizes: &[[u32; 2]], rows: Vec<u32>) -> Result<Supernodes, String> {
        let wrong = |what: &str| Err(format!("its supernodes are no pattern of a factor: {what}"));
        let nodes: u64 = sizes.iter().map(|[n, _]| u64::from(*n)).sum();
        let below: u64 = sizes.iter().map(|[_, m]| u64::from(*m)).sum();
        let numbers: u128 = sizes.iter().map(|&[n, m]| u128::from(n) * (u128::from(n) + u128::from(m))).sum();
        if nodes >= u64::from(NONE) || below != rows.len() as u64 || numbers > 1 << 50 {
            return wrong("their sizes do not add up");
        }
        if inverse.iter().any(|&position| u64::from(position) >= nodes) {
            return wrong("a node is not among them");
        }
        let mut all = Supernodes::laid_out(inverse, sizes, rows, Vec::new());
        for s in 0..sizes.len() {
            let (own, below) = (all.own(s), all.below(s));
            let is_behind = below.first().is_none_or(|&first| first as usize >= own.end);
            let is_within = below.last().is_none_or(|&last| u64::from(last) < nodes);
            if own.is_empty() || !is_behind || !is_within || !below.is_sorted_by(|a, b| a < b) {
                return wrong("a row stands where none can be");
            }
            let parent = below.first().map_or(NONE, |&first| all.of_node[first as usize]);
            all.parent.push(parent);
        }
        // Every row stands on the way to the root.
        for s in 0..sizes.len() {
            let Some(above) = Some(all.parent[s]).filter(|&above| above != NONE) else { continue };
            let (end, rows) = (all.own(above as usize).end, all.below(above as usize));
            let mut rows = rows.iter();
            let mut further = all.below(s).iter().filter(|&&row| row as usize >= end);
            if !further.all(|row| rows.any(|of_above| of_above == row)) {
                return wrong("a row is not among those of the supernode above");
            }
        }
        Ok(all)
    }

    /// Makes the pattern from parts and a tree that are known to be right.
    pub(super) fn laid_out(
        inverse: Vec<u32>,
        sizes: &[[u32; 2]],
        rows: Vec<u32>,
        parent: Vec<u32>,
    ) -> Supernodes {
        let (mut begin, mut row_start, mut value_start) = (vec![0], vec![0], vec![0]);
        let mut of_node = Vec::new();
        for (s, &[n, m]) in sizes.iter().enumerate() {
            begin.push(begin[s] + n);
            of_node.resize(begin[s + 1] as usize, s as u32);
            row_start.push(row_start[s] + m as usize);
            value_start.push(value_start[s] + 9 * n as usize * (n as usize + m as usize));
        }
        Supernodes { inverse, begin, rows, row_start, value_start, parent, of_node }
    }

    pub(super) fn count(&self) -> usize {
        self.begin.len() - 1
    }

    pub(super) fn nodes(&self) -> usize {
        self.of_node.len()
    }

    /// Numbers in L, with the zeros of its supernodes.
    pub(super) fn entries(&self) -> usize {
        self.value_start[self.count()]
    }

    /// The nodes of a supernode.
    pub(super) fn own(&self, s: usize) -> Range<usize> {
        self.begin[s] as usize..self.begin[s + 1] as usize
    }

    /// The rows of L below them.
    pub(super) fn below(&self, s: usize) -> &[u32] {
        &self.rows[self.row_start[s]..self.row_start[s + 1]]
    }

    /// Range of its numbers in L.
    pub(super) fn values(&self, s: usize) -> Range<usize> {
        self.value_start[s]..self.value_start[s + 1]
    }

    /// The parent of a supernode; [`NONE`] of a root.
    pub(super) fn parent(&self, s: usize) -> u32 {
        self.parent[s]
    }

    pub(super) fn of_node(&self, position: usize) -> usize {
        self.of_node[position] as usize
    }

    /// The most nodes below a supernode.
    pub(super) fn widest(&self) -> usize {
        (0..self.count()).map(|s| self.below(s).len()).max().unwrap_or(0)
    }

    /// The supernodes of these nodes and all above them, ascending.
    pub(super) fn with_ancestors(&self, nodes: &[u32]) -> Vec<usize> {
        let mut taken = vec![false; self.count()];
        for &node in nodes {
            let mut s = self.of_node[self.inverse[node as usize] as usize];
            while s != NONE && !std::mem::replace(&mut taken[s as usize], true) {
                s = self.parent[s as usize];
            }
        }
        (0..self.count()).filter(|&s| taken[s]).collect()
    }

    /// The part that solves between these nodes: the nodes of each supernode and the rows below it, all rows, and the
    /// position of each of the nodes; and which supernodes these are.
    pub(super) fn part(&self, nodes: &[u32]) -> (Vec<usize>, Vec<[u32; 2]>, Vec<u32>, Vec<u32>) {
        let taken = self.with_ancestors(nodes);
        let mut moved = vec![NONE; self.nodes()];
        let mut next = 0;
        for &s in &taken {
            for position in self.own(s) {
                moved[position] = next;
                next += 1;
            }
        }
        let sizes = taken.iter().map(|&s| [self.own(s).len() as u32, self.below(s).len() as u32]).collect();
        let rows = taken.iter().flat_map(|&s| self.below(s)).map(|&row| moved[row as usize]).collect();
        let places = nodes.iter().map(|&node| moved[self.inverse[node as usize] as usize]).collect();
        (taken, sizes, rows, places)
    }
}
