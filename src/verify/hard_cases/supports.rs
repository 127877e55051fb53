//! Cases 17 to 20: control elements of few nodes, on a line, in a plane, with shared nodes, of all nodes and none.

use super::case::{Asked, CaseRows, Must, base, refused, residual, solved, verdict};
use crate::green::{FIELDS, GreenError};

/// A control element called c.
fn control(nodes: &str) -> String {
    format!("\n[body.b.control.c]\nnodes = {nodes}\ngrab = \"fixed\"\n")
}

pub(super) fn rows() -> CaseRows {
    let only = |nodes: &str| -> Result<Asked, GreenError> {
        Ok(Asked { controls: control(nodes), ..Asked::new(base()?) })
    };
    let small = Must::solve("residual", 1e-12);
    let corner = "{ box = { min = [-0.6, -0.6, -1.1], max = [-0.4, -0.4, -0.9] } }";
    let edge = "{ box = { min = [-0.6, -0.6, -1.1], max = [-0.4, 0.6, -0.9] } }";
    let around_corner = "{ sphere = { centre = [-0.5, -0.5, -1.0], radius = 0.21 } }";
    let all = "{ box = { min = [-9.0, -9.0, -9.0], max = [9.0, 9.0, 9.0] } }";
    let overlapping =
        super::case::ENDS.to_owned() + &control("{ box = { min = [-1, -1, 0.5], max = [1, 1, 1] } }");
    let unheld = Asked { controls: String::new(), ..Asked::new(base()?) };
    Ok(vec![
        refused(17, "held at one node", "single node", &only(corner)?),
        refused(17, "held at nodes on a line", "6 nodes on one line", &only(edge)?),
        solved(17, "held at four nodes of a corner", small, &only(around_corner)?, residual)?,
        solved(
            18,
            "planar control elements",
            Must {
                words: "planar: 9 of 12 fields are independent",
                ..Must::solve("fields that vanish", 0.0)
            },
            &Asked::new(base()?),
            |solution| {
                let vanishing =
                    |column: &usize| solution.controls[column / FIELDS].vanishing[column % FIELDS];
                let zero: Vec<usize> = (0..solution.fields.columns).filter(vanishing).collect();
                let rows = 0..3 * solution.mesh.nodes.len();
                let largest =
                    rows.flat_map(|row| zero.iter().map(move |&c| solution.fields.row(row)[c].abs()));
                Ok(if zero.len() == 6 { super::case::largest(largest) } else { f64::NAN })
            },
        )?,
        refused(
            19,
            "control elements that share nodes",
            "36 nodes belong to both",
            &Asked { controls: overlapping, ..Asked::new(base()?) },
        ),
        solved(
            20,
            "all nodes held",
            Must::solve("field against what is prescribed", 0.0),
            &only(all)?,
            |solution| {
                let nodes = 0..solution.mesh.nodes.len();
                Ok(super::case::largest(nodes.map(|node| (solution.fields.row(3 * node)[0] - 1.0).abs())))
            },
        )?,
        verdict(
            20,
            "no node held",
            "missing field `control`",
            unheld.scene().err().map(|error| error.to_string()),
        ),
    ])
}
