//! `greenstage verify forces`: forces, energies and shapes of the models at large rotations, against static equilibrium.

use super::marks;
use super::print::print;
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::table::{Table, seconds};
use crate::verify::large_rotation::{self, HeldPose, ModelAtPose};
use serde_json::json;
use std::path::Path;

/// Asks for the models' forces at large rotations instead of problems.
pub const NAME: &str = "forces";

/// Prints what large rotations make of each model's forces and shapes, a table for each body and quantity.
pub fn run(json: bool, readme: Option<&Path>) -> Result<(), Failure> {
    let rows = large_rotation::run(&mut |left_out| notice!("note: {left_out}"))?;
    if json {
        print(&format!("{:#}\n", json!(rows)))?;
    }
    let (mut text, mut markdown) = (String::new(), String::new());
    for rows in rows.chunk_by(|a, b| a.body == b.body) {
        for (title, write) in FORCE_TABLES {
            let table = force_table(rows, *write);
            text.push_str(&format!("{}: {title}\n\n{}\n", rows[0].body, table.text()));
            markdown.push_str(&format!("{}, {title}:\n\n{}\n", rows[0].body, table.markdown()));
        }
    }
    if !json {
        print(&text)?;
    }
    match readme {
        Some(path) => marks::write_between(path, NAME, &markdown),
        None => Ok(()),
    }
}

type WriteModel = fn(&ModelAtPose) -> String;

/// Titles of the tables of forces, and the function that writes the cells of each.
const FORCE_TABLES: &[(&str, WriteModel)] = &[
    ("errors of force and torque in parts of the largest wrench of the equilibrium, %", |at| {
        match (at.deviation.force, at.deviation.torque) {
            (Some(force), Some(torque)) => format!("{} / {}", rounded(force), rounded(torque)),
            _ => "none".into(),
        }
    }),
    ("strain energy over that of the equilibrium", |at| {
        at.deviation.energy.map_or("none".into(), |ratio| format!("{ratio:.3}"))
    }),
    ("error of the shape, root mean square over length, %", |at| {
        format!("{:.3}", 100.0 * at.deviation.shape)
    }),
    ("time of a frame: state, forces, surface, normals", |at| seconds(at.frame_s)),
];

fn rounded(part: f64) -> String {
    let value = 100.0 * part;
    if value < 9.95 { format!("{value:.1}") } else { format!("{value:.0}") }
}

fn force_table(rows: &[HeldPose], write: WriteModel) -> Table {
    let models: Vec<&str> = rows[0].models.iter().map(|at| at.model).collect();
    let mut table = Table::new(&[&["pose", "force", "torque"], &models[..]].concat());
    for row in rows {
        let held = [row.pose.clone(), format!("{:.2} N", row.force_n), format!("{:.2} N·m", row.torque_nm)];
        let of_models = models
            .iter()
            .map(|model| row.models.iter().find(|at| at.model == *model).map_or(String::new(), write));
        let cells: Vec<String> = held.into_iter().chain(of_models).collect();
        table.row(&cells.iter().map(String::as_str).collect::<Vec<_>>());
    }
    table
}
