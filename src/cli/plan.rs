//! A scene whose bodies ask for an accuracy or a budget, made one that names its knobs: measured once, kept in the
//! .green file, chosen anew when the demand changes.

use super::accuracy::scripted_or_random;
use super::failure::Failure;
use super::progress::Bars;
use super::session;
use crate::green::{self, GreenFile};
use crate::report::measure::RANK;
use crate::report::plan::{Choice, choose};
use crate::report::{self, Limits, Request, Row, Setting};
use crate::scene::{Demand, Method, Scene, Solver, Storage};
use serde::{Deserialize, Serialize};

/// What is kept of the measuring.
#[derive(Serialize, Deserialize)]
struct Table {
    /// Fingerprint of the body without its demand: another body needs another table.
    key: String,
    rows: Vec<Row>,
}

/// Unknowns of the largest solve while a table is measured.
const LARGEST: f64 = 200_000.0;

/// The scene with the knobs of its demanding bodies set; says on standard error what was chosen, and why.
pub fn settled(mut scene: Scene, quiet: bool) -> Result<Scene, Failure> {
    let demands: Vec<(String, Demand)> =
        scene.body.iter().filter_map(|(name, body)| Some((name.clone(), body.demand()?))).collect();
    if demands.is_empty() {
        return Ok(scene);
    }
    let mut plain = scene.clone();
    for (name, _) in &demands {
        (plain.body[name].accuracy, plain.body[name].budget) = (None, None);
    }
    for (name, demand) in demands {
        let needs = session::needs(&plain, &name, &plain.body[&name])?;
        let key = green::fingerprint(&plain, &name, needs)?;
        let table = match kept(&plain, &name, &key) {
            Some(table) => table,
            None => Table { key, rows: measure(&plain, &name, quiet)? },
        };
        let choice = choose(&table.rows, &demand).ok_or_else(|| {
            Failure::work(scene.invalid(&format!("body.{name}"), "nothing could be measured"))
        })?;
        for sentence in choice.sentences(&demand) {
            eprintln!("body.{name}: {sentence}");
        }
        set(&mut scene, &name, &choice);
        scene.body[&name].plan = Some(serde_json::to_value(&table).map_err(Failure::work)?);
    }
    Ok(scene)
}

/// The table in the scene's .green file, where it is of this body.
fn kept(scene: &Scene, name: &str, key: &str) -> Option<Table> {
    let file = GreenFile::open(&session::green_path(scene)).ok()?;
    let table: Table = serde_json::from_value(file.meta.bodies.get(name)?.plan.clone()?).ok()?;
    (table.key == key).then_some(table)
}

fn measure(scene: &Scene, name: &str, quiet: bool) -> Result<Vec<Row>, Failure> {
    eprintln!("body.{name}: measuring what accuracy costs on this body, to choose from; once");
    let (poses, pose_source) = scripted_or_random(scene, name, None, true)?;
    let scratch = tempfile::tempdir().map_err(Failure::work)?;
    let request = Request {
        scene,
        body: name,
        poses: &poses,
        pose_source,
        limits: Limits { largest: LARGEST, refinements: 1, rounds: 60 },
        quick: true,
        needs_of: &|scene| session::needs(scene, name, &scene.body[name]).unwrap_or_default(),
        command: String::new(),
        scratch: scratch.path(),
    };
    Ok(report::measure(&request, &Bars::new(name, quiet)).map_err(Failure::work)?.rows)
}

fn set(scene: &mut Scene, name: &str, choice: &Choice<'_>) {
    let Setting { refine, element, solver, storage, model } = &choice.row.setting;
    let body = &mut scene.body[name];
    body.refine = *refine;
    body.model = model.clone();
    if let Some((known, _)) = RANK.into_iter().find(|(known, _)| known.name() == element) {
        body.element = known;
    }
    if let Some(known) = Storage::ALL.into_iter().find(|known| known.name() == storage) {
        body.storage = known;
    }
    if let Some(tolerance) = solver.strip_prefix("pcg ").and_then(|tolerance| tolerance.parse().ok()) {
        body.solver = Solver { method: Method::Pcg, tolerance, ..Solver::default() };
    }
}
