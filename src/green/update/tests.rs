//! A change of a body on several threads.

use super::*;
use crate::base::random::Random;

/// Products with one column are summed in another order on two threads than on one: here the field of the only load.
#[test]
fn the_bits_of_a_change_do_not_depend_on_the_number_of_threads() {
    let (nodes, surface) = (210, 300);
    let mut random = Random::default();
    let mut table = |rows, columns| DMatrix::from_fn(rows, columns, |_, _| random.draw());
    let (own, known) = (3 * nodes, 2 * FIELDS + 1);
    let updates = Updates {
        ports: Ports {
            nodes: (0..nodes as u32).collect(),
            released: (0..nodes).map(|port| [1, port]).collect(),
            ..Ports::default()
        },
        affine: 2 * FIELDS,
        loads: 1,
        values: table(own, known + own),
        reactions: table(own, known + own),
        columns: table(3 * surface, own + 1),
        torques: table(3 * own, 1),
        work: table(1, 0),
    };
    let hessian = table(known, known);
    let change = Change { released: vec![0, 1], factors: Vec::new() };
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
