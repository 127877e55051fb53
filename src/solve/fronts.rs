//! The pattern of L in A = P L Lᵀ Pᵀ, found on the graph of nodes: supernodes, their rows, and their elimination tree.
//!
//! In: A's graph and a fill-reducing order of its nodes. Out: the order in which the nodes are eliminated, a postorder of
//! the tree, so that every subtree is a range of supernodes; and what the numeric step will take, to the byte.
//!
//! Literature: Liu, SIAM J. Matrix Anal. Appl. 11 (1990), 134-172 (elimination trees); Duff and Reid, ACM Trans. Math.
//! Softw. 9 (1983), 302-325 (fronts); Ashcraft and Grimes, ibid. 15 (1989), 291-309 (relaxed supernodes).

use super::supernodes::{NONE, Supernodes};
use crate::fem::StiffnessMatrix;
use std::cmp::Reverse;
use std::ops::{Deref, Range};

/// Nodes and share of zeros up to which a supernode joins its parent: both have at most this number of nodes, and at most this
/// share of their numbers would be zeros. Small fronts waste time between the products, zeros waste it in them.
const RELAXED: [(usize, f64); 4] = [(4, 0.8), (16, 0.3), (48, 0.1), (usize::MAX, 0.05)];

/// The [`Supernodes`] of L, and what its making needs of them.
pub(super) struct Fronts {
    supernodes: Supernodes,
    /// Node `forward[p]` of A is the p-th to be eliminated; `inverse[forward[p]] = p`.
    pub(super) forward: Vec<u32>,
    children: Vec<u32>,
    child_start: Vec<usize>,
    /// The first supernode of its subtree, which is `first[s]..=s`.
    first: Vec<u32>,
    /// Multiplications in its subtree.
    work: Vec<f64>,
}

impl Deref for Fronts {
    type Target = Supernodes;

    fn deref(&self) -> &Supernodes {
        &self.supernodes
    }
}

/// The distribution of the fronts over threads: whole subtrees, one thread each, then the fronts above them, one after the other,
/// by all threads together.
pub(super) struct Plan {
    /// Roots of the subtrees, those with the most work first.
    pub(super) subtrees: Vec<u32>,
    /// Ascending.
    pub(super) top: Vec<u32>,
}

impl Fronts {
    /// `order[p]` is the node of A that is eliminated p-th, but for what the tree leaves free.
    pub(super) fn new(a: &StiffnessMatrix, order: &[u32]) -> Fronts {
        let (order, parent) = postordered(a, order);
        let groups = joined(&parent, &column_counts(a, &order, &parent));
        Fronts::of_groups(a, &order, &groups)
    }

    /// Numbers the nodes anew, group by group, and finds the rows of each.
    fn of_groups(a: &StiffnessMatrix, order: &[u32], groups: &Groups) -> Fronts {
        let count = groups.nodes.len();
        let forward: Vec<u32> = groups.nodes.iter().flatten().map(|&p| order[p as usize]).collect();
        let inverse = inverted(&forward);
        let mut begin = vec![0];
        groups.nodes.iter().enumerate().for_each(|(s, nodes)| begin.push(begin[s] + nodes.len() as u32));
        let (children, child_start) = lists(&groups.parent);
        let (mut rows, mut row_start, mut sizes) = (Vec::new(), vec![0], Vec::with_capacity(count));
        let mut first: Vec<u32> = (0..count as u32).collect();
        let mut work = vec![0.0; count];
        let mut seen = vec![NONE; forward.len()];
        for s in 0..count {
            let own = begin[s]..begin[s + 1];
            let from = rows.len();
            let mut add = |row: u32, rows: &mut Vec<u32>| {
                if row >= own.end && seen[row as usize] != s as u32 {
                    seen[row as usize] = s as u32;
                    rows.push(row);
                }
            };
            for p in own.clone() {
                for (node, _, _) in a.neighbours(forward[p as usize] as usize) {
                    add(inverse[node], &mut rows);
                }
            }
            for &child in &children[child_start[s]..child_start[s + 1]] {
                let child = child as usize;
                first[s] = first[s].min(first[child]);
                work[s] += work[child];
                for k in row_start[child]..row_start[child + 1] {
                    add(rows[k], &mut rows);
                }
            }
            rows[from..].sort_unstable();
            let (n, m) = (own.len(), rows.len() - from);
            work[s] += front_work(3 * n, 3 * m);
            row_start.push(rows.len());
            sizes.push([n as u32, m as u32]);
        }
        let supernodes = Supernodes::laid_out(inverse, &sizes, rows, groups.parent.clone());
        Fronts { supernodes, forward, children, child_start, first, work }
    }

    /// Multiplications that make L.
    pub(super) fn work(&self) -> f64 {
        self.roots().map(|s| self.work[s as usize]).sum()
    }

    pub(super) fn children(&self, s: usize) -> &[u32] {
        &self.children[self.child_start[s]..self.child_start[s + 1]]
    }

    pub(super) fn subtree(&self, root: usize) -> Range<usize> {
        self.first[root] as usize..root + 1
    }

    /// Numbers in what a front hands up: a square over the unknowns below it, of which the lower half counts.
    pub(super) fn update(&self, s: usize) -> usize {
        9 * self.below(s).len().pow(2)
    }

    fn roots(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.count() as u32).filter(|&s| self.parent(s as usize) == NONE)
    }

    /// Subtrees for `threads` threads. The largest is cut until they can be dealt out evenly.
    pub(super) fn plan(&self, threads: usize) -> Plan {
        /// The fullest thread may have this many times its share; subtrees of a smaller share of the whole are not cut.
        const UNEVEN: f64 = 1.08;
        const SMALL: f64 = 0.01;
        let work = |s: u32| self.work[s as usize];
        let sorted = |subtrees: &mut Vec<u32>| {
            subtrees.sort_by(|&s, &t| work(t).total_cmp(&work(s)).then(s.cmp(&t)));
        };
        let mut subtrees: Vec<u32> = self.roots().collect();
        sorted(&mut subtrees);
        let mut top = Vec::new();
        let total: f64 = subtrees.iter().map(|&s| work(s)).sum();
        while threads > 1 && subtrees.first().is_some_and(|&s| work(s) > SMALL * total) {
            let mut load = vec![0.0; threads];
            for &s in &subtrees {
                let least = (0..threads).min_by(|&i, &j| f64::total_cmp(&load[i], &load[j])).unwrap_or(0);
                load[least] += work(s);
            }
            let fullest = load.iter().copied().fold(0.0, f64::max);
            if fullest * threads as f64 <= UNEVEN * load.iter().sum::<f64>() {
                break;
            }
            let cut = subtrees.remove(0);
            top.push(cut);
            subtrees.extend(self.children(cut as usize));
            sorted(&mut subtrees);
        }
        top.sort_unstable();
        Plan { subtrees, top }
    }

    /// Subtrees of about equal work for `threads` threads, as ranges of supernodes, ascending.
    pub(super) fn branches(&self, threads: usize) -> Vec<Range<usize>> {
        let mut subtrees = self.plan(threads).subtrees;
        subtrees.sort_unstable();
        subtrees.into_iter().map(|root| self.subtree(root as usize)).collect()
    }

    /// The numbers that the updates in a subtree take at once, on two stacks in turn: a front's update goes to the one that
    /// those of its children are not on, and these are on top of theirs.
    pub(super) fn stacks(&self, root: usize) -> [usize; 2] {
        let (mut now, mut most) = ([0; 2], [0; 2]);
        self.walk(root, |s, stack| {
            now[stack] += self.update(s);
            most[stack] = most[stack].max(now[stack]);
            now[1 - stack] -= self.children(s).iter().map(|&c| self.update(c as usize)).sum::<usize>();
        });
        most
    }

    /// Visits a subtree, children first, each with its stack; the root's is the first.
    pub(super) fn walk(&self, root: usize, mut visit: impl FnMut(usize, usize)) {
        let subtree = self.subtree(root);
        let mut stack = vec![0; subtree.len()];
        for s in subtree.clone().rev().skip(1) {
            stack[s - subtree.start] = 1 - stack[self.parent(s) as usize - subtree.start];
        }
        subtree.clone().for_each(|s| visit(s, stack[s - subtree.start]));
    }

    /// The most numbers that the updates take at once, besides L.
    pub(super) fn update_numbers(&self, threads: usize) -> usize {
        let plan = self.plan(threads);
        let mut stacks: Vec<usize> =
            plan.subtrees.iter().map(|&s| self.stacks(s as usize).iter().sum()).collect();
        stacks.sort_unstable_by_key(|&size| Reverse(size));
        let at_once: usize = stacks.iter().take(threads).sum();
        let mut left: usize = plan.subtrees.iter().map(|&s| self.update(s as usize)).sum();
        let mut most = left + at_once;
        for &s in &plan.top {
            let s = s as usize;
            left += self.update(s);
            most = most.max(left);
            left -= self.children(s).iter().map(|&c| self.update(c as usize)).sum::<usize>();
        }
        most
    }
}

/// Number of multiplications in a front with n unknowns of its own and m below them.
pub(super) fn front_work(n: usize, m: usize) -> f64 {
    let (n, m) = (n as f64, m as f64);
    n * (n * n / 6.0 + n * m / 2.0 + m * m / 2.0)
}

fn inverted(forward: &[u32]) -> Vec<u32> {
    let mut inverse = vec![0; forward.len()];
    forward.iter().zip(0..).for_each(|(&node, p)| inverse[node as usize] = p);
    inverse
}

/// The children of every parent, ascending, and where each list begins.
fn lists(parent: &[u32]) -> (Vec<u32>, Vec<usize>) {
    let known = || parent.iter().zip(0..).filter(|(parent, _)| **parent != NONE);
    let mut start = vec![0; parent.len() + 1];
    known().for_each(|(&parent, _)| start[parent as usize + 1] += 1);
    (0..parent.len()).for_each(|i| start[i + 1] += start[i]);
    let mut next = start.clone();
    let mut children = vec![0; start[parent.len()]];
    for (&parent, child) in known() {
        children[next[parent as usize]] = child;
        next[parent as usize] += 1;
    }
    (children, start)
}

/// A tree's vertices, children before parents, each subtree a range.
fn postorder(parent: &[u32]) -> Vec<u32> {
    let (children, start) = lists(parent);
    let mut order = Vec::with_capacity(parent.len());
    let mut waiting: Vec<u32> = (0..parent.len() as u32).filter(|&s| parent[s as usize] == NONE).collect();
    while let Some(s) = waiting.pop() {
        order.push(s);
        waiting.extend(&children[start[s as usize]..start[s as usize + 1]]);
    }
    order.reverse();
    order
}

/// The order as a postorder of its elimination tree, and the tree in it.
fn postordered(a: &StiffnessMatrix, order: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let inverse = inverted(order);
    let mut parent = vec![NONE; order.len()];
    // The highest known ancestor of each, so that no path is walked twice.
    let mut ancestor = vec![NONE; order.len()];
    for p in 0..order.len() as u32 {
        for (node, _, _) in a.neighbours(order[p as usize] as usize) {
            let mut q = inverse[node];
            while q < p {
                let next = std::mem::replace(&mut ancestor[q as usize], p);
                if next == NONE {
                    parent[q as usize] = p;
                }
                q = next;
            }
        }
    }
    let post = postorder(&parent);
    let place = inverted(&post);
    let new_parent = post.iter().map(|&p| parent[p as usize]);
    let new_parent =
        new_parent.map(|parent| if parent == NONE { NONE } else { place[parent as usize] }).collect();
    (post.iter().map(|&p| order[p as usize]).collect(), new_parent)
}

/// Nodes below the diagonal in every column of L: row p of L is the part of the tree between p and its neighbours in A.
fn column_counts(a: &StiffnessMatrix, order: &[u32], parent: &[u32]) -> Vec<usize> {
    let inverse = inverted(order);
    let mut counts = vec![0; order.len()];
    let mut seen = vec![NONE; order.len()];
    for p in 0..order.len() as u32 {
        seen[p as usize] = p;
        for (node, _, _) in a.neighbours(order[p as usize] as usize) {
            let mut q = inverse[node];
            while q < p && seen[q as usize] != p {
                seen[q as usize] = p;
                counts[q as usize] += 1;
                q = parent[q as usize];
            }
        }
    }
    counts
}

/// Supernodes and their tree, children before parents.
struct Groups {
    nodes: Vec<Vec<u32>>,
    parent: Vec<u32>,
}

/// A supernode that may join its parent.
struct Group {
    nodes: Vec<u32>,
    below: usize,
    zeros: usize,
    parent: u32,
}

/// Supernodes of columns with the same rows, joined with their parents as [`RELAXED`] says.
fn joined(parent: &[u32], counts: &[usize]) -> Groups {
    let mut groups: Vec<Group> = Vec::new();
    let mut of = Vec::with_capacity(parent.len());
    for p in 0..parent.len() {
        match groups.last_mut() {
            Some(group) if parent[p - 1] == p as u32 && counts[p - 1] == counts[p] + 1 => {
                group.nodes.push(p as u32);
                group.below = counts[p];
            }
            _ => groups.push(Group { nodes: vec![p as u32], below: counts[p], zeros: 0, parent: NONE }),
        }
        of.push(groups.len() as u32 - 1);
    }
    for s in 0..groups.len() {
        let last = groups[s].nodes[groups[s].nodes.len() - 1];
        let above = parent[last as usize];
        groups[s].parent = if above == NONE { NONE } else { of[above as usize] };
    }
    // Children stand before their parents, and join before these are asked.
    let (children, start) = lists(&groups.iter().map(|group| group.parent).collect::<Vec<_>>());
    let mut into: Vec<u32> = (0..groups.len() as u32).collect();
    for s in 0..groups.len() {
        let mut of_s: Vec<u32> = children[start[s]..start[s + 1]].to_vec();
        // Those first that bring the fewest zeros.
        of_s.sort_by_key(|&c| (Reverse(groups[c as usize].below), c));
        for c in of_s {
            let (child, group) = (&groups[c as usize], &groups[s]);
            let n = child.nodes.len() + group.nodes.len();
            let rows = group.nodes.len() + group.below;
            let zeros = child.zeros + group.zeros + child.nodes.len() * (rows - child.below);
            let all = n * (n + 1) / 2 + n * group.below;
            let share = RELAXED.iter().find(|(most, _)| n <= *most).map_or(0.0, |(_, share)| *share);
            if zeros as f64 <= share * all as f64 {
                let mut nodes = std::mem::take(&mut groups[c as usize].nodes);
                nodes.append(&mut groups[s].nodes);
                (groups[s].nodes, groups[s].zeros) = (nodes, zeros);
                into[c as usize] = s as u32;
            }
        }
    }
    for s in (0..groups.len()).rev() {
        into[s] = if into[s] == s as u32 { s as u32 } else { into[into[s] as usize] };
    }
    let left: Vec<u32> = (0..groups.len() as u32).filter(|&s| into[s as usize] == s).collect();
    let mut place = vec![NONE; groups.len()];
    left.iter().zip(0..).for_each(|(&s, i)| place[s as usize] = i);
    let up = |s: u32| match groups[s as usize].parent {
        NONE => NONE,
        above => place[into[above as usize] as usize],
    };
    let parent: Vec<u32> = left.iter().map(|&s| up(s)).collect();
    let post = postorder(&parent);
    let new_place = inverted(&post);
    let new_parent = post.iter().map(|&i| match parent[i as usize] {
        NONE => NONE,
        above => new_place[above as usize],
    });
    Groups {
        parent: new_parent.collect(),
        nodes: post.iter().map(|&i| std::mem::take(&mut groups[left[i as usize] as usize].nodes)).collect(),
    }
}
