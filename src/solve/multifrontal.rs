//! The numeric factorization A = P L Lᵀ Pᵀ, front by front.
//!
//! In: the numbers of A and its [`Fronts`]. Out: the numbers of L, in f64 or f32. A front is a dense matrix over a
//! supernode and the rows below it: A's numbers there and the updates of its children. Its first columns become those of
//! L, and what they take from the rest is the update for its parent. Subtrees are shared among threads, and so are the
//! large fronts above them; what a front computes depends on neither.
//!
//! Literature: Duff and Reid, ACM Trans. Math. Softw. 9 (1983), 302-325; Liu, SIAM Review 34 (1992), 82-109.

use super::dense::{self, Real, each};
use super::fronts::{Fronts, front_work};
use crate::fem::StiffnessMatrix;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Multiplications in a front from which on threads share it.
const SHARED_WORK: f64 = 2e7;
/// Columns of an assembled front that are one piece of work.
const ASSEMBLED: usize = 96;

#[derive(Debug)]
pub(super) enum Failure {
    /// The position in the order of the node whose pivot is not positive.
    NotPositive {
        position: usize,
    },
    NoMemory,
}

/// The update of a parent by its child: the lower half of a square over the unknowns below the child's front.
struct Update<'a, T> {
    numbers: &'a [T],
    /// Unknowns of the square.
    size: usize,
    /// Runs of the child's rows that stand together in the parent's front as well, with their places there.
    runs: Vec<Run>,
}

/// Unknowns `from`..`from + length` of an update, which are to..to + length of the parent's front.
#[derive(Clone, Copy)]
struct Run {
    from: usize,
    to: usize,
    length: usize,
}

/// Fills `values`, as long as [`Supernodes::entries`](super::supernodes::Supernodes::entries) and zero, with the numbers of L.
pub(super) fn factorize<T: Real>(
    fronts: &Fronts,
    a: &StiffnessMatrix,
    values: &mut [T],
) -> Result<(), Failure> {
    let plan = fronts.plan(rayon::current_num_threads());
    let mut parts: Vec<(usize, bool)> = plan.subtrees.iter().map(|&s| (s as usize, true)).collect();
    parts.extend(plan.top.iter().map(|&s| (s as usize, false)));
    parts.sort_unstable();
    let (mut subtrees, mut top, mut rest) = (Vec::new(), Vec::new(), values);
    for (s, is_subtree) in parts {
        let first = if is_subtree { fronts.subtree(s).start } else { s };
        let (own, after) = rest.split_at_mut(fronts.values(s).end - fronts.values(first).start);
        rest = after;
        if is_subtree { subtrees.push((s, own)) } else { top.push((s, own)) }
    }
    let place = |s: usize| plan.subtrees.iter().position(|&t| t as usize == s);
    subtrees.sort_by_key(|(s, _)| place(*s));

    let updates: Vec<Mutex<Vec<T>>> = (0..fronts.count()).map(|_| Mutex::default()).collect();
    let keep = |s: usize, numbers: Vec<T>| {
        *updates[s].lock().unwrap_or_else(PoisonError::into_inner) = numbers;
    };
    let solve = |(root, own): (usize, &mut [T])| {
        subtree(fronts, a, root, own).map(|numbers| keep(root, numbers)).err()
    };
    let failures: Vec<Failure> = if subtrees.len() > 1 && rayon::current_num_threads() > 1 {
        subtrees.into_iter().par_bridge().filter_map(solve).collect()
    } else {
        subtrees.into_iter().filter_map(solve).collect()
    };
    let first = failures.into_iter().min_by_key(|failure| match failure {
        Failure::NotPositive { position } => *position,
        Failure::NoMemory => usize::MAX,
    });
    first.map_or(Ok(()), Err)?;

    for (s, own) in top {
        let children: Vec<Vec<T>> = fronts
            .children(s)
            .iter()
            .map(|&child| {
                std::mem::take(&mut *updates[child as usize].lock().unwrap_or_else(PoisonError::into_inner))
            })
            .collect();
        let children: Vec<Update<'_, T>> = fronts
            .children(s)
            .iter()
            .zip(&children)
            .map(|(&child, numbers)| Update::new(fronts, child as usize, s, numbers))
            .collect();
        let mut numbers = zeros(fronts.update(s))?;
        front(fronts, a, s, own, &children, &mut numbers, true)?;
        drop(children);
        keep(s, numbers);
    }
    Ok(())
}

/// Allocates `count` zeros, if there is memory for them: pages that the system has zeroed.
pub(super) fn zeros<T: Real>(count: usize) -> Result<Vec<T>, Failure> {
    bytemuck::allocation::try_zeroed_vec(count).map_err(|()| Failure::NoMemory)
}

/// Factorizes a subtree on this thread, its numbers of L in `own`, and returns its root's update.
fn subtree<T: Real>(
    fronts: &Fronts,
    a: &StiffnessMatrix,
    root: usize,
    own: &mut [T],
) -> Result<Vec<T>, Failure> {
    let sizes = fronts.stacks(root);
    let mut stacks: [Vec<T>; 2] = [zeros(sizes[0])?, zeros(sizes[1])?];
    let mut ends = [0; 2];
    let (mut rest, mut result) = (own, Ok(()));
    fronts.walk(root, |s, stack| {
        if result.is_err() {
            return;
        }
        let (own, after) = std::mem::take(&mut rest).split_at_mut(fronts.values(s).len());
        rest = after;
        let [even, odd] = &mut stacks;
        let (mine, theirs) = if stack == 0 { (even, odd) } else { (odd, even) };
        let numbers = &mut mine[ends[stack]..][..fronts.update(s)];
        let taken: usize = fronts.children(s).iter().map(|&c| fronts.update(c as usize)).sum();
        let mut at = ends[1 - stack] - taken;
        let child = |&child: &u32| {
            let size = fronts.update(child as usize);
            at += size;
            Update::new(fronts, child as usize, s, &theirs[at - size..at])
        };
        let children: Vec<Update<'_, T>> = fronts.children(s).iter().map(child).collect();
        result = front(fronts, a, s, own, &children, numbers, false);
        ends[stack] += fronts.update(s);
        ends[1 - stack] -= taken;
    });
    result?;
    let [mut numbers, _] = stacks;
    numbers.truncate(fronts.update(root));
    numbers.shrink_to_fit();
    Ok(numbers)
}

/// One front: assembles it, factorizes its columns, and leaves what it hands up in `numbers`.
fn front<T: Real>(
    fronts: &Fronts,
    a: &StiffnessMatrix,
    s: usize,
    own: &mut [T],
    children: &[Update<'_, T>],
    numbers: &mut [T],
    threads: bool,
) -> Result<(), Failure> {
    let (n, m) = (3 * fronts.own(s).len(), 3 * fronts.below(s).len());
    let shared = threads && front_work(n, m) >= SHARED_WORK;
    let columns = |numbers: usize, rows: usize| {
        let width = if shared { ASSEMBLED } else { (numbers / rows.max(1)).max(1) };
        (width, (width * rows).max(1))
    };
    let (width, chunk) = columns(own.len(), n + m);
    let pieces: Vec<(usize, &mut [T])> = own.chunks_mut(chunk).enumerate().collect();
    each(shared, pieces, |(i, piece)| {
        let nodes = i * width / 3..(i * width + piece.len() / (n + m)) / 3;
        gather(a, fronts, s, nodes, piece);
        add(children, i * width, 0, n + m, piece);
    });
    dense::factorize(own, n, m, shared)
        .map_err(|column| Failure::NotPositive { position: fronts.own(s).start + column / 3 })?;
    if m > 0 {
        dense::update(own, n, m, numbers, shared);
        let (width, chunk) = columns(numbers.len(), m);
        let pieces: Vec<(usize, &mut [T])> = numbers.chunks_mut(chunk).enumerate().collect();
        each(shared, pieces, |(i, piece)| add(children, n + i * width, n, m, piece));
    }
    Ok(())
}

/// A's numbers in some of a supernode's own columns; all of its rows stand in `piece`, column after column.
fn gather<T: Real>(a: &StiffnessMatrix, fronts: &Fronts, s: usize, columns: Range<usize>, piece: &mut [T]) {
    let (own, below) = (fronts.own(s), fronts.below(s));
    let rows = 3 * (own.len() + below.len());
    for (j, numbers) in columns.zip(piece.chunks_exact_mut(3 * rows)) {
        let p = own.start + j;
        let node = fronts.forward[p] as usize;
        for axis in 0..3 {
            for row in axis..3 {
                numbers[axis * rows + 3 * j + row] = T::from_f64(a.diagonal[node][(row, axis)]);
            }
        }
        for (other, edge, transposed) in a.neighbours(node) {
            let q = fronts.inverse[other] as usize;
            if q < p {
                continue;
            }
            // A row that is not found does not exist: all neighbours above stand in the front.
            let place = if q < own.end {
                q - own.start
            } else {
                own.len() + below.partition_point(|&row| (row as usize) < q)
            };
            // The block is K_(node, other) or its transpose; the column takes K_(other, node).
            let block = &a.blocks[edge];
            for axis in 0..3 {
                let three = &mut numbers[axis * rows + 3 * place..][..3];
                for row in 0..3 {
                    three[row] =
                        T::from_f64(if transposed { block[(row, axis)] } else { block[(axis, row)] });
                }
            }
        }
    }
}

impl<'a, T> Update<'a, T> {
    fn new(fronts: &Fronts, child: usize, parent: usize, numbers: &'a [T]) -> Update<'a, T> {
        let (own, below) = (fronts.own(parent), fronts.below(parent));
        let rows = fronts.below(child);
        let mut runs: Vec<Run> = Vec::new();
        let mut next = 0;
        for (i, &row) in rows.iter().enumerate() {
            let place = if (row as usize) < own.end {
                row as usize - own.start
            } else {
                while below[next] < row {
                    next += 1;
                }
                own.len() + next
            };
            match runs.last_mut() {
                // A run does not reach over the end of the supernode's own rows.
                Some(run) if run.to + run.length == 3 * place && place != own.len() => run.length += 3,
                _ => runs.push(Run { from: 3 * i, to: 3 * place, length: 3 }),
            }
        }
        Update { numbers, size: 3 * rows.len(), runs }
    }
}

/// Adds the children's updates to some columns of a front, from column `first` of it on. The columns have `rows` rows, of
/// which the first is row `cut` of the front.
fn add<T: Real>(children: &[Update<'_, T>], first: usize, cut: usize, rows: usize, piece: &mut [T]) {
    let last = first + piece.len() / rows.max(1);
    for child in children {
        let begin = child.runs.partition_point(|run| run.to + run.length <= first);
        for (k, run) in child.runs.iter().enumerate().skip(begin) {
            if run.to >= last {
                break;
            }
            let skipped = first.saturating_sub(run.to);
            for i in skipped..run.length.min(last - run.to) {
                let column = &child.numbers[(run.from + i) * child.size..][..child.size];
                let out = &mut piece[(run.to + i - first) * rows..][..rows];
                // Its own run from the diagonal on, then all later ones.
                let own = Run { from: run.from + i, to: run.to + i, length: run.length - i };
                for part in std::iter::once(&own).chain(&child.runs[k + 1..]) {
                    let from = &column[part.from..][..part.length];
                    let to = &mut out[part.to - cut..][..part.length];
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += *from);
                }
            }
        }
    }
}
