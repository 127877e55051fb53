//! A change of a body on several threads.

use super::*;
use crate::base::random::Random;

/// faer took all threads, and other sums with each number of them.
#[test]
fn the_bits_of_a_change_do_not_depend_on_the_number_of_threads() {
    let (nodes, surface) = (150, 300);
    let mut random = Random::default();
    let mut table = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.draw());
    let own = 3 * nodes;
    let updates = Updates {
        ports: Ports {
            nodes: (0..nodes as u32).collect(),
            released: (0..nodes).map(|port| [1, port]).collect(),
            ..Ports::default()
        },
        affine: 2 * FIELDS,
        known: 2 * FIELDS,
        values: table(own, 2 * FIELDS + own),
        reactions: table(own, 2 * FIELDS + own),
        columns: table(3 * surface, own),
        torques: table(3 * own, 0),
    };
    let hessian = table(2 * FIELDS, 2 * FIELDS);
    let change = Change { released: vec![1], factors: Vec::new() };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let changed = updates.prepare(&change).unwrap();
            let body = changed.body(&hessian);
            let yields = changed.compliance(&(0..surface as u32).collect::<Vec<_>>());
            [body.added, body.hessian, yields, changed.added_yield().unwrap().1]
        })
    };
    let alone = on(1);
    for threads in [2, 3] {
        assert!(on(threads) == alone, "{threads} threads");
    }
}
