//! `greenstage verify`: the fitted rates are those of theory, and misses are reported.

use crate::common::{self, folder};
use greenstage::measure::exact::Level;
use greenstage::verify::{Bound, ConvergenceRow, Effort, PROBLEMS, run};
use std::sync::OnceLock;

fn solve(name: &str, effort: Effort) -> Vec<ConvergenceRow> {
    run(PROBLEMS.iter().find(|problem| problem.name == name).unwrap(), effort).unwrap()
}

/// Every problem on two meshes, solved when a test first asks for it.
fn coarse(name: &str) -> &'static [ConvergenceRow] {
    static SOLVED: [OnceLock<Vec<ConvergenceRow>>; PROBLEMS.len()] =
        [const { OnceLock::new() }; PROBLEMS.len()];
    let which = PROBLEMS.iter().position(|problem| problem.name == name).unwrap();
    SOLVED[which].get_or_init(|| solve(name, Effort::Coarse))
}

fn row<'a>(rows: &'a [ConvergenceRow], quantity: &str, element: &str) -> &'a ConvergenceRow {
    rows.iter().find(|row| row.quantity == quantity && row.element == element).unwrap()
}

fn finest(row: &ConvergenceRow) -> f64 {
    row.levels.last().unwrap().error
}

/// Every row of every problem, on two meshes.
#[test]
fn nothing_misses_its_bound() {
    for problem in PROBLEMS {
        let rows = coarse(problem.name);
        // NAFEMS's 2 % are required of finer meshes.
        let is_bound = problem.name == "le10" || rows.iter().any(|row| row.bound != Bound::NONE);
        assert!(is_bound, "{} requires nothing", problem.name);
        for row in rows {
            assert!(row.levels.len() == 2 || row.quantity.starts_with("errors beside"), "{row:?}");
            assert!(row.holds(), "{row:?}");
        }
    }
}

/// Rates fitted to three meshes.
#[test]
fn smooth_fields_converge_at_the_orders_of_theory() {
    for problem in ["kelvin", "cylinder"] {
        let rows = solve(problem, Effort::Smooth);
        for (element, order) in [("tet4", 1.0), ("tet4_anp", 1.0), ("tet10", 2.0)] {
            let rate = |quantity: &str| row(&rows, quantity, element).rate.unwrap();
            let (l2, energy) = (rate("L2, ν 0.3"), rate("energy, ν 0.3"));
            println!("{problem} {element}: {l2:.3} {energy:.3}");
            assert!((l2 - order - 1.0).abs() < 0.1, "{problem} {element}: {l2}");
            assert!((energy - order).abs() < 0.1, "{problem} {element}: {energy}");
        }
    }
    let torsion = solve("torsion", Effort::Usual);
    for (element, expected) in [("tet4", 2.0), ("tet4_anp", 2.0), ("tet10", 3.6)] {
        let rate = row(&torsion, "J/a⁴", element).rate.unwrap();
        println!("torsion {element}: {rate:.3}");
        assert!((rate - expected).abs() < 0.1, "{element}: {rate}");
    }
}

/// Stress on curved elements with their own dilatation: on the second mesh to 2.3 %.
#[test]
fn stress_comes_near_to_nafems() {
    let rows = coarse("le10");
    let error = |element: &str| finest(row(rows, "σ_yy(D)", element));
    assert!(error("tet10") < 0.025 && error("tet4") < 0.075, "{} {}", error("tet10"), error("tet4"));
}

/// Near ν = 1/2 linear tetrahedra hardly move, those with mean pressures and quadratic ones do.
#[test]
fn locking_is_seen() {
    let rows = coarse("cylinder");
    let error = |element: &str| finest(row(rows, "u_r(a), ν 0.4999", element));
    assert!(error("tet4") > 0.8 && error("tet4_anp") < 0.02 && error("tet10") < 0.01);
    let rows = coarse("cook-plane-strain");
    let error = |element: &str| finest(row(rows, "v(48, 60)", element));
    assert!(error("tet4") > 0.5 && error("tet4_anp") < 0.04 && error("tet10") < 0.02);
}

/// Errors of the plain elements are scikit-fem's on the same meshes, integrated to degree 9 there and to 7 here.
#[test]
fn errors_are_required_to_be_those_of_another_program() {
    let rows = coarse("kelvin");
    for (quantity, element, most) in [
        ("errors beside scikit-fem's, 8³ cells", "tet4", 2e-5),
        ("errors beside scikit-fem's, 4³ cells", "tet10", 2e-4),
    ] {
        let row = row(rows, quantity, element);
        assert_eq!(row.bound, Bound::error(most));
        assert!(row.holds(), "{row:?}");
    }
}

#[test]
fn a_bound_is_missed_by_too_much_too_slow_and_no_number() {
    let level = Level { h: 0.5, nodes: 8, value: 1.1, error: 0.1, seconds: 0.0 };
    let row = |bound: Bound, rate: Option<f64>, error: f64| ConvergenceRow {
        problem: String::new(),
        quantity: String::new(),
        element: String::new(),
        reference: 1.0,
        levels: vec![Level { error, ..level }],
        known_to: 0.0,
        rate,
        bound,
    };
    assert!(row(Bound::NONE, None, 9.0).holds());
    assert!(row(Bound::error(0.1), None, 0.1).holds());
    assert!(!row(Bound::error(0.1), None, 0.11).holds());
    assert!(!row(Bound::error(0.1), None, f64::NAN).holds());
    assert!(row(Bound::rate(1.8), Some(1.9), 9.0).holds());
    assert!(!row(Bound::rate(1.8), Some(1.7), 0.0).holds());
    assert!(!row(Bound::rate(1.8), None, 0.0).holds());
}

#[test]
fn the_command_prints_tables_and_json() {
    let folder = folder("verify");
    let said = |arguments: &[&str]| {
        let output = common::greenstage(&folder, arguments);
        String::from_utf8(output.stdout).unwrap()
    };
    let text = said(&["verify", "torsion", "twisted-beam", "--coarse"]);
    for expected in
        ["torsion: square bar", "J/a⁴", "tet4_anp", "rate ≥ 3.4", "twisted-beam: cant", "error ≤ 0.500 %"]
    {
        assert!(text.contains(expected), "{expected} in\n{text}");
    }
    assert!(!text.contains("MISSED") && !text.contains("cook"), "{text}");
    let rows: Vec<serde_json::Value> =
        serde_json::from_str(&said(&["verify", "torsion", "--coarse", "--json"])).unwrap();
    let tet10 = rows.iter().find(|row| row["element"] == "tet10").unwrap();
    assert_eq!(tet10["holds"], true);
    assert!((tet10["reference"].as_f64().unwrap() - 0.140_577_014_955_154).abs() < 1e-14);
    assert!((tet10["levels"][1]["value"].as_f64().unwrap() - 0.1406).abs() < 1e-4);

    let wrong = common::attempt(&folder, &["verify", "torsoin"]);
    assert_eq!(wrong.status.code(), Some(2));
    let error = String::from_utf8(wrong.stderr).unwrap();
    assert!(error.contains("did you mean \"torsion\"?"), "{error}");
}
