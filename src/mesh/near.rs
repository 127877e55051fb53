//! The nearest nodes of two sets, by a k-d tree (Bentley, Communications of the ACM 18, 1975, 509-517).

use nalgebra::Vector3;

/// Two nodes, and how far they are apart, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearPair {
    pub nodes: [u32; 2],
    pub distance: f64,
}

/// The nearest pair of a node of `a` and one of `b`; `None` where one of them is empty.
pub fn nearest_pair(nodes: &[Vector3<f64>], a: &[u32], b: &[u32]) -> Option<NearPair> {
    let mut tree = b.to_vec();
    sort(nodes, &mut tree, 0);
    let mut best = NearPair { nodes: [*a.first()?, *b.first()?], distance: f64::INFINITY };
    for &node in a {
        search(nodes, &tree, 0, node, &mut best);
    }
    Some(best)
}

/// Sorts `range` into a k-d tree: its middle node divides it along `axis`, and each half is divided along the next
/// axis.
fn sort(nodes: &[Vector3<f64>], range: &mut [u32], axis: usize) {
    if range.len() < 2 {
        return;
    }
    let at = |node: u32| nodes[node as usize][axis];
    let middle = range.len() / 2;
    range.select_nth_unstable_by(middle, |&i, &j| at(i).total_cmp(&at(j)).then(i.cmp(&j)));
    let (below, above) = range.split_at_mut(middle);
    sort(nodes, below, (axis + 1) % 3);
    sort(nodes, &mut above[1..], (axis + 1) % 3);
}

fn search(nodes: &[Vector3<f64>], range: &[u32], axis: usize, from: u32, best: &mut NearPair) {
    let Some(&node) = range.get(range.len() / 2) else { return };
    let away = nodes[from as usize] - nodes[node as usize];
    if away.norm() < best.distance {
        *best = NearPair { nodes: [from, node], distance: away.norm() };
    }
    let (below, above) = (&range[..range.len() / 2], &range[range.len() / 2 + 1..]);
    let (near, far) = if away[axis] < 0.0 { (below, above) } else { (above, below) };
    search(nodes, near, (axis + 1) % 3, from, best);
    if away[axis].abs() < best.distance {
        search(nodes, far, (axis + 1) % 3, from, best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_pair_is_that_of_all_pairs() {
        let nodes: Vec<Vector3<f64>> = (0..400)
            .map(|i| {
                let x = f64::from(i);
                Vector3::new((1.3 * x).sin(), (2.7 * x).cos(), if i % 2 == 0 { x.sin() } else { 1.1 })
            })
            .collect();
        for share in [2, 5, 200] {
            let (a, b): (Vec<u32>, Vec<u32>) = (0..400).partition(|i| i % share == 0);
            let found = nearest_pair(&nodes, &a, &b).unwrap();
            let apart = |i: u32, j: u32| (nodes[i as usize] - nodes[j as usize]).norm();
            let least = a.iter().flat_map(|&i| b.iter().map(move |&j| apart(i, j))).fold(9.0, f64::min);
            assert_eq!(found.distance, least);
            assert_eq!(apart(found.nodes[0], found.nodes[1]), least);
            assert!(a.contains(&found.nodes[0]) && b.contains(&found.nodes[1]));
        }
        assert_eq!(nearest_pair(&nodes, &[1], &[]), None);
    }
}
