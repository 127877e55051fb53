//! Nested dissection of the node graph by METIS (Karypis and Kumar, SIAM J. Sci. Comput. 20, 1998).

use super::error::SolveError;
use crate::base::machine;
use crate::fem::StiffnessMatrix;
use std::sync::{Mutex, PoisonError};

/// METIS uses the C library's global random sequence, so that only one ordering may run at a time.
static METIS: Mutex<()> = Mutex::new(());

/// A fill-reducing permutation of nodes: node i of the permuted matrix is node `forward[i]` of the original;
/// `inverse[forward[i]] = i`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ordering {
    pub forward: Vec<u32>,
    pub inverse: Vec<u32>,
}

/// Bytes that ordering and finding the factor's pattern take: 200 for each pair of coupled nodes (A's pattern, a permuted
/// copy of it, METIS' graphs) and 1000 for each node.
pub fn ordering_memory(matrix: &StiffnessMatrix) -> f64 {
    200.0 * matrix.edges.len() as f64 + 1000.0 * matrix.nodes() as f64
}

/// Orders the graph of nodes, whose three unknowns stay together.
///
/// METIS' seed is fixed: the same matrix gives the same ordering on every run.
pub fn nested_dissection(matrix: &StiffnessMatrix) -> Result<Ordering, SolveError> {
    let nodes = matrix.nodes();
    let failed = |reason: String| SolveError::Ordering { nodes, reason };
    let mut start = vec![0i32];
    let mut neighbours: Vec<i32> = Vec::with_capacity(2 * matrix.edges.len());
    for node in 0..nodes {
        neighbours.extend(matrix.neighbours(node).map(|(other, _, _)| other as i32));
        start.push(i32::try_from(neighbours.len()).map_err(|error| failed(error.to_string()))?);
    }
    let mut count = i32::try_from(nodes).map_err(|error| failed(error.to_string()))?;
    let mut permutation = vec![0i32; nodes];
    let mut inverse = vec![0i32; nodes];
    if !neighbours.is_empty() {
        let mut options = [-1i32; metis_sys::METIS_NOPTIONS as usize];
        options[metis_sys::moptions_et_METIS_OPTION_NUMBERING as usize] = 0;
        options[metis_sys::moptions_et_METIS_OPTION_SEED as usize] = 1;
        let _alone = METIS.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: the graph is a symmetric adjacency without self-loops in METIS' format (`start` has nodes + 1
        // entries, `neighbours` start[nodes]), both outputs hold `nodes` entries, weights may be null, and METIS
        // keeps no pointer.
        let status = unsafe {
            metis_sys::METIS_NodeND(
                &mut count,
                start.as_mut_ptr(),
                neighbours.as_mut_ptr(),
                std::ptr::null_mut(),
                options.as_mut_ptr(),
                permutation.as_mut_ptr(),
                inverse.as_mut_ptr(),
            )
        };
        if status == metis_sys::rstatus_et_METIS_ERROR_MEMORY {
            let refusal = machine::refused(format!("ordering {nodes} nodes"), ordering_memory(matrix));
            return Err(SolveError::FactorMemory(refusal));
        }
        if status != metis_sys::rstatus_et_METIS_OK {
            return Err(failed(format!("METIS returned status {status}")));
        }
    } else {
        permutation.iter_mut().zip(0..).for_each(|(p, i)| *p = i);
    }
    let forward: Vec<u32> = permutation.iter().map(|&node| node as u32).collect();
    let mut inverse = vec![0; nodes];
    forward.iter().zip(0..).for_each(|(&old, new)| inverse[old as usize] = new);
    Ok(Ordering { forward, inverse })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordering_of_a_chain_is_a_permutation_and_repeats() {
        let matrix = StiffnessMatrix::zeros(50, (0..49).map(|i| [i, i + 1]).collect());
        let ordering = nested_dissection(&matrix).unwrap();
        let mut sorted = ordering.forward.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..50).collect::<Vec<_>>());
        assert!((0..50).all(|new| ordering.inverse[ordering.forward[new] as usize] == new as u32));
        assert_eq!(ordering, nested_dissection(&matrix).unwrap());
    }

    #[test]
    fn orderings_made_at_once_are_the_same() {
        let side = 12;
        let at = |x: u32, y: u32| x * side + y;
        let mut edges: Vec<[u32; 2]> = (0..side)
            .flat_map(|x| (0..side).map(move |y| (x, y)))
            .flat_map(|(x, y)| [[at(x, y), at(x + 1, y)], [at(x, y), at(x, y + 1)]])
            .filter(|[_, b]| *b < side * side)
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let matrix = StiffnessMatrix::zeros((side * side) as usize, edges);
        let alone = nested_dissection(&matrix).unwrap();
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8)
                .map(|_| scope.spawn(|| (0..50).all(|_| nested_dissection(&matrix).unwrap() == alone)))
                .collect();
            assert!(threads.into_iter().all(|thread| thread.join().unwrap()));
        });
    }

    #[test]
    fn single_node_needs_no_metis() {
        let ordering = nested_dissection(&StiffnessMatrix::zeros(1, vec![])).unwrap();
        assert_eq!(ordering.forward, [0]);
    }
}
