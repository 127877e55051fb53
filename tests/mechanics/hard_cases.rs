//! Hard cases: bodies, materials, units, supports, poses and files on which a solver can go wrong in silence. Each is
//! solved to the stated accuracy, solved with a warning, or refused with the entity and the remedy. The table:
//! `greenstage verify hard-cases`.

use crate::common::block_scene;
use greenstage::fem::{Lame, NodeFields};
use greenstage::green::{self, Requirements, STIFFNESS};
use greenstage::solve::Silent;
use greenstage::verify::hard_cases::{CaseRow, Outcome, run};
use std::collections::BTreeSet;
use std::sync::LazyLock;

/// The rows of the table, which is made once for all tests.
static ROWS: LazyLock<Vec<CaseRow>> = LazyLock::new(|| run().unwrap());

#[test]
fn every_case_is_what_it_must_be() {
    let rows = &*ROWS;
    let missed: Vec<&CaseRow> = rows.iter().filter(|row| !row.holds()).collect();
    assert!(missed.is_empty(), "{missed:#?}");
    let numbers: BTreeSet<u32> = rows.iter().map(|row| row.number).collect();
    assert_eq!(numbers, (1..=30).collect());
    assert!(rows.is_sorted_by_key(|row| row.number));
    for row in rows {
        assert!(row.required != Outcome::Refused || !row.words.is_empty(), "{row:?} asks for no words");
        assert_eq!(row.required == Outcome::Refused, row.bound.is_none(), "{row:?}");
    }
}

/// A row must not pass by what was not measured, not said, or not done.
#[test]
fn rows_that_prove_nothing_do_not_hold() {
    let row = ROWS.iter().find(|row| row.number == 2).unwrap().clone();
    assert!(row.holds());
    assert!(!CaseRow { error: Some(f64::NAN), ..row.clone() }.holds());
    assert!(!CaseRow { error: None, ..row.clone() }.holds());
    assert!(!CaseRow { error: row.bound.map(|bound| 1.1 * bound), ..row.clone() }.holds());
    assert!(!CaseRow { outcome: Outcome::Solved, ..row.clone() }.holds());
    assert!(!CaseRow { said: String::new(), ..row.clone() }.holds());
}

/// The factor is right only if the answer is in equilibrium: no force on any free node, whatever the material.
#[test]
fn free_nodes_are_in_equilibrium() {
    let solution =
        green::solve(&block_scene([5, 5, 5], ""), "block", &Requirements::new(&[STIFFNESS]), &Silent)
            .unwrap();
    let lame = Lame::from_young_poisson(1e3, 0.3);
    let k = solution.element.assemble(&solution.mesh, &vec![lame; solution.mesh.tets.len()]).unwrap();
    let mut force = NodeFields::zeros(solution.mesh.nodes.len(), solution.fields.columns);
    k.multiply(&solution.fields, &mut force);
    let largest = force.data.iter().fold(0.0f64, |m, f| m.max(f.abs()));
    for (node, x) in solution.mesh.nodes.iter().enumerate().filter(|(_, x)| x.x.abs() < 0.5 - 1e-9) {
        for axis in 0..3 {
            let worst = force.row(3 * node + axis).iter().fold(0.0f64, |m, f| m.max(f.abs()));
            assert!(worst < 1e-13 * largest, "node at {x:?}: {worst:e} of {largest:e}");
        }
    }
}
