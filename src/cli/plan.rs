//! A scene whose bodies ask for an accuracy or a budget, made one that names its knobs: measured once, kept in the
//! .green file, chosen anew when the demand changes.

use super::accuracy::scripted_or_random;
use super::failure::Failure;
use super::progress::Bars;
use super::session;
use crate::base::notice::notice;
use crate::deform::ControlPose;
use crate::fem::nearest_turn;
use crate::green::{self, GreenError, GreenFile};
use crate::report::measure::{machine, settings};
use crate::report::plan::{Choice, choose};
use crate::report::{Limits, Request, Row, Setting};
use crate::scene::{Demand, Element, Method, Scene, SceneError, Solver, Storage};
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

/// What is kept of the measuring.
#[derive(Serialize, Deserialize)]
struct Table {
    /// Fingerprint of the body without its demand, and the largest solve: another body needs another table.
    key: String,
    /// Whose times the rows have.
    machine: String,
    /// Largest turn of one control element against another in the measured poses, rad.
    range: f64,
    rows: Vec<Row>,
    /// Poses that nothing was measured in, and why.
    left_out: Vec<String>,
}

/// Unknowns of the largest solve while a table is measured, unless the scene says otherwise.
const LARGEST: f64 = 200_000.0;

/// The scene with the knobs of its demanding bodies set; says on standard error what was chosen, and why. A demand that
/// no setting meets is an error, and so is a damaged .green file, unless it is made anew by `force`.
pub fn settled(scene: Scene, quiet: bool, force: bool) -> Result<Scene, Failure> {
    let source: Source<'_> = &|plain, name, key, demand| {
        let kept = kept(plain, name, &key, demand).or_else(|error| if force { Ok(None) } else { Err(error) });
        let table = match kept? {
            Some(table) => table,
            None => measure(plain, name, key, demand, quiet)?,
        };
        table.left_out.iter().for_each(|pose| notice!("body.{name}: left out: {pose}"));
        let choice = choose(&table.rows, demand);
        for sentence in choice.iter().filter(|choice| choice.miss <= 1.0).flat_map(Choice::sentences) {
            notice!("body.{name}: {sentence}");
        }
        Ok(Some(table))
    };
    choose_all(scene, source, &|reason| Err(Failure::work(reason)))
}

/// The same from what is kept in the .green file alone, in silence; a body without a table, or with a demand that
/// nothing in it meets, stays as it is.
pub fn known(scene: Scene) -> Result<Scene, Failure> {
    choose_all(scene, &|plain, name, key, demand| kept(plain, name, &key, demand), &|_| Ok(()))
}

/// Where the rows for a body of the scene without its demands come from: its name, the key that they must have, and
/// what is asked.
type Source<'a> = &'a dyn Fn(&Scene, &str, String, &Demand) -> Result<Option<Table>, Failure>;

/// Sets the knobs from the rows of `source`. A demand that none of them meets goes to `missed`, and its body stays as it
/// is where that is no failure.
fn choose_all(
    mut scene: Scene,
    source: Source<'_>,
    missed: &dyn Fn(SceneError) -> Result<(), Failure>,
) -> Result<Scene, Failure> {
    let demands: Vec<(String, Demand)> =
        scene.body.iter().filter_map(|(name, body)| Some((name.clone(), body.demand()?))).collect();
    let mut plain = scene.clone();
    for (name, _) in &demands {
        (plain.body[name].accuracy, plain.body[name].budget) = (None, None);
    }
    for (name, demand) in demands {
        let needs = session::needs(&plain, &name, &plain.body[&name])?;
        let largest = demand.largest().unwrap_or(LARGEST);
        let key = format!("{}, {largest} unknowns", green::fingerprint(&plain, &name, &needs)?);
        let Some(table) = source(&plain, &name, key, &demand)? else { continue };
        let choice = choose(&table.rows, &demand).ok_or_else(|| {
            Failure::work(scene.invalid(&format!("body.{name}"), "nothing could be measured"))
        })?;
        if let Some(reason) = choice.missed(&demand) {
            missed(scene.invalid(&format!("body.{name}.{}", demand.key()), reason))?;
            continue;
        }
        set(&mut scene, &name, &choice);
        scene.body[&name].plan = Some(serde_json::to_value(&table).map_err(Failure::work)?);
    }
    Ok(scene)
}

/// The table in the scene's .green file, shipped or unpacked, where it is of this body, and for a demand in seconds of
/// this machine.
fn kept(scene: &Scene, name: &str, key: &str, demand: &Demand) -> Result<Option<Table>, Failure> {
    let path = session::green_path(scene);
    session::unpack_shipped(&path)?;
    let file = match GreenFile::open(&path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            return Ok(None);
        }
        file => file?,
    };
    let plan = file.meta.bodies.get(name).and_then(|body| body.plan.clone());
    // A table of another version is measured again.
    let table: Option<Table> = plan.and_then(|plan| serde_json::from_value(plan).ok());
    let is_own = |table: &Table| table.key == key && (!demand.is_timed() || table.machine == machine());
    Ok(table.filter(is_own))
}

fn measure(scene: &Scene, name: &str, key: String, demand: &Demand, quiet: bool) -> Result<Table, Failure> {
    notice!("body.{name}: measuring what accuracy costs on this body, to choose from; once");
    let (poses, pose_source) = scripted_or_random(scene, name, None, true)?;
    let scratch = tempfile::tempdir().map_err(Failure::work)?;
    let request = Request {
        scene,
        body: name,
        poses: &poses,
        pose_source,
        limits: Limits { largest: demand.largest().unwrap_or(LARGEST), refinements: 1, rounds: 60 },
        largest_key: format!("body.{name}.{}.largest", demand.key()),
        quick: true,
        needs_of: &|scene| session::needs(scene, name, &scene.body[name]).unwrap_or_default(),
        command: String::new(),
        scratch: scratch.path(),
    };
    let measured = settings(&request, &Bars::new(name, quiet)).map_err(Failure::work)?;
    let range = measured.poses.iter().map(|(_, poses)| largest_turn(poses)).fold(0.0, f64::max);
    Ok(Table { key, machine: machine(), range, rows: measured.rows, left_out: measured.left_out })
}

/// The largest angle between the rotations of two control elements, rad.
pub fn largest_turn(poses: &[ControlPose]) -> f64 {
    let rotations: Vec<UnitQuaternion<f64>> = poses.iter().map(|pose| nearest_turn(&pose.matrix)).collect();
    let pairs =
        rotations.iter().enumerate().flat_map(|(i, a)| rotations[..i].iter().map(move |b| a.angle_to(b)));
    pairs.fold(0.0, f64::max)
}

/// The turn up to which the error of a planned body was measured, with a tenth to spare; nothing of other bodies.
pub fn range(file: &GreenFile, body: &str) -> Option<f64> {
    file.meta.bodies.get(body)?.plan.as_ref()?.get("range")?.as_f64().map(|range| 1.1 * range)
}

fn set(scene: &mut Scene, name: &str, choice: &Choice<'_>) {
    let Setting { refine, element, storage, model, .. } = &choice.row.setting;
    let body = &mut scene.body[name];
    body.refine = *refine;
    body.model = model.clone();
    if let Some(known) = Element::ALL.into_iter().find(|known| known.name() == element) {
        body.element = known;
    }
    if let Some(known) = Storage::ALL.into_iter().find(|known| known.name() == storage) {
        body.storage = known;
    }
    if let Some(tolerance) = choice.row.setting.tolerance() {
        body.solver = Solver { method: Method::Pcg, tolerance, ..Solver::default() };
    }
}
