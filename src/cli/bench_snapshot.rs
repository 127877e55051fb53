//! The table "snapshot" of `greenstage bench`: what it takes to copy all that changes in a session, and to go back to it.
//!
//! In: a session in the middle of its script. Out: medians of `World::state` and `World::set_state`, s.

use crate::base::failure::Failure;
use crate::base::statistics::quantile;
use crate::base::table::{Table, count, seconds};
use crate::session::{Playback, Session};
use std::hint::black_box;
use std::time::Instant;

const TIMES: usize = 200;

#[derive(serde::Serialize)]
pub struct Row {
    bodies: usize,
    surface_nodes: usize,
    take_p50_s: f64,
    take_p99_s: f64,
    restore_p50_s: f64,
    restore_p99_s: f64,
}

pub fn measure(session: &mut Session) -> Result<Row, Failure> {
    // Of three frames the second is in the middle.
    let mut playback = Playback::new(session, 3)?;
    for frame in 0..2 {
        playback.step_to(session, frame)?;
    }
    let world = &mut session.world;
    let (mut takes, mut restores) = (Vec::new(), Vec::new());
    for _ in 0..TIMES {
        let started = Instant::now();
        let state = black_box(world.state()).map_err(Failure::work)?;
        takes.push(started.elapsed().as_secs_f64());
        let started = Instant::now();
        world.set_state(black_box(&state)).map_err(Failure::wrong)?;
        restores.push(started.elapsed().as_secs_f64());
    }
    let of = |times: &[f64], share| quantile(times.iter().copied(), share);
    Ok(Row {
        bodies: world.bodies.len(),
        surface_nodes: world.bodies.iter().map(|body| body.deformer.node_count()).sum(),
        take_p50_s: of(&takes, 0.5),
        take_p99_s: of(&takes, 0.99),
        restore_p50_s: of(&restores, 0.5),
        restore_p99_s: of(&restores, 0.99),
    })
}

pub fn table(row: &Row) -> (String, Table) {
    let nodes = count(row.surface_nodes, "surface node");
    let title = format!("Snapshot of the session's state, {} of {nodes}", bodies(row.bodies));
    let mut table = Table::new(&["", "p50", "p99"]);
    table.row(&["take", &seconds(row.take_p50_s), &seconds(row.take_p99_s)]);
    table.row(&["restore", &seconds(row.restore_p50_s), &seconds(row.restore_p99_s)]);
    (title, table)
}

fn bodies(count: usize) -> String {
    if count == 1 { "one body".to_owned() } else { format!("{count} bodies") }
}
