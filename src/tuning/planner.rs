//! Settles the settings of a scene's bodies: measures once, keeps the table in the .green file, and chooses anew from it
//! when the accuracy or the budget changes.

use super::choice::{Choice, choose, choose_among, name as title};
use super::poses::{further, scripted_or_random};
use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::machine;
use crate::base::progress::Bars;
use crate::deform::ControlPoses;
use crate::fem::find_element;
use crate::green::{self, GreenError, GreenFile};
use crate::measure::poses::largest_turn;
use crate::measure::{
    FOLDER, Limits, Measurement, Request, SCHEMA, Setting, online, remove, settings, verify,
};
use crate::prepare::{self, Resolved};
use crate::scene::{AccuracyTarget, Body, Scene, SceneError, Storage};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The result of measuring one body, as its .green file keeps it.
#[derive(Serialize, Deserialize)]
struct MeasuredTable {
    /// Fingerprint of the body without what it asks for, and the largest solve: another body needs another table.
    key: String,
    /// The machine that the times were measured on.
    machine: String,
    /// Largest turn of one control element against another in the measured poses, rad.
    range: f64,
    rows: Vec<Measurement>,
    /// The models that there were to be measured.
    models: Vec<String>,
    /// Poses in which nothing was measured, and why.
    left_out: Vec<String>,
    /// Settings that were measured themselves after they were chosen; their rows have the errors that were found.
    verified: Vec<Setting>,
}

impl MeasuredTable {
    /// The choice from it: if nothing reaches what is asked, the nearest of the settings that were verified by measuring.
    fn choice(&self, demand: &AccuracyTarget) -> Option<Choice<'_>> {
        let choice = choose(&self.rows, demand).filter(|choice| choice.miss <= 1.0);
        let is_verified = |row: &Measurement| self.verified.contains(&row.setting);
        choice
            .or_else(|| choose_among(&self.rows, demand, is_verified))
            .or_else(|| choose(&self.rows, demand))
    }
}

/// Number of further poses in which a chosen setting is measured.
const FURTHER: usize = 3;
/// Number of settings that are verified by measuring to find the nearest, if none reaches what is asked.
const NEAREST: usize = 4;

/// Unknowns of the largest solve while a table is measured, unless the scene says otherwise.
const LARGEST: f64 = 200_000.0;

/// The source of a body's table: from the scene without its demand, the body's name, the key that the table must have, and the
/// demand.
type TableSource<'a> =
    &'a dyn Fn(&Resolved, &str, String, &AccuracyTarget) -> Result<Option<MeasuredTable>, Failure>;

/// The scene with the settings chosen for every body that asks for an accuracy or a budget. Measures a body that has
/// no table yet. Errors where no setting reaches what is asked for; a damaged .green file is an error too, unless
/// `force` says that it will be made anew.
pub fn settle(scene: Resolved, quiet: bool, force: bool) -> Result<Resolved, Failure> {
    let source: TableSource<'_> = &|plain, name, key, demand| {
        let kept = kept(plain, name, &key, demand).or_else(|error| if force { Ok(None) } else { Err(error) });
        let mut table = match kept? {
            Some(table) => {
                remove(&steps(plain, name));
                table
            }
            None => measure(plain, name, key, demand, quiet)?,
        };
        for pose in &table.left_out {
            notice!("body.{name}: the accuracy is unknown in a pose that was left out: {pose}");
        }
        verify_choice(plain, name, &mut table, demand, &|told| notice!("{told}"))?;
        let choice = table.choice(demand).filter(|choice| choice.miss <= 1.0);
        for sentence in choice.iter().flat_map(Choice::sentences) {
            notice!("body.{name}: {sentence}");
        }
        Ok(Some(table))
    };
    choose_from(scene, source, &|unmet| Err(Failure::work(unmet)))
}

/// Measures the setting that is chosen itself, and again the next where it misses what is asked; where nothing reaches
/// that, those that seem the nearest.
fn verify_choice(
    plain: &Resolved,
    name: &str,
    table: &mut MeasuredTable,
    demand: &AccuracyTarget,
    tell: &dyn Fn(String),
) -> Result<(), Failure> {
    let (mut poses, mut missed) = (None, 0);
    loop {
        let Some(choice) = choose(&table.rows, demand) else { return Ok(()) };
        let is_budget = matches!(demand, AccuracyTarget::Budget(_));
        missed += usize::from(choice.miss > 1.0);
        if is_budget && missed > 0 {
            return Ok(());
        }
        if missed > NEAREST || table.verified.contains(&choice.row.setting) {
            return Ok(());
        }
        let (row, setting) = (choice.row.clone(), choice.row.setting.clone());
        let poses = match &mut poses {
            Some(poses) => poses,
            none => none.insert(further_poses(plain, name)?),
        };
        let chosen = with_setting(plain, name, &setting)?;
        table.verified.push(setting.clone());
        let Some(found) = verify(&chosen, name, &row, poses)? else {
            tell(format!(
                "body.{name}: {} could not be verified: its element or the poses have no equilibrium",
                title(&setting)
            ));
            continue;
        };
        let held = found
            .held
            .map_or("no forces".into(), |held| format!("force and torque to {:.2} %", 100.0 * held));
        tell(format!(
            "body.{name}: {} itself, in {} further poses against {}: displacement to {:.2} %, {held}",
            title(&setting),
            found.count,
            found.against,
            100.0 * found.shape
        ));
        if is_budget {
            // More accurate is nothing within the budget that was asked for; what it is worth is told.
            return Ok(());
        }
        // Storage and solver are the least part of what was found.
        let is_alike = |other: &Setting| {
            (other.refine, &other.element, other.model) == (setting.refine, &setting.element, setting.model)
        };
        for row in table.rows.iter_mut().filter(|row| is_alike(&row.setting)) {
            let error = &mut row.error;
            error.uncancelled.worst = error.uncancelled.worst.max(found.shape);
            error.uncancelled_held.worst = error.uncancelled_held.worst.max(found.held.unwrap_or(0.0));
        }
    }
}

/// The answer to a demand from the rows of a table of a body that asks for nothing itself: the row that is chosen or comes nearest,
/// with the errors that are printed of it once it was measured itself, and the scene with it. `None` where nothing can be chosen.
pub fn answered(
    plain: &Resolved,
    name: &str,
    rows: Vec<Measurement>,
    demand: &AccuracyTarget,
) -> Result<Option<(Resolved, Measurement)>, Failure> {
    let (key, machine, models) = (String::new(), String::new(), models());
    let (left_out, verified) = (Vec::new(), Vec::new());
    let mut table = MeasuredTable { key, machine, range: 0.0, rows, models, left_out, verified };
    verify_choice(plain, name, &mut table, demand, &|_| {})?;
    let Some(choice) = table.choice(demand) else { return Ok(None) };
    Ok(Some((with_setting(plain, name, &choice.row.setting)?, choice.row.clone())))
}

fn with_setting(plain: &Scene, name: &str, setting: &Setting) -> Result<Resolved, Failure> {
    let mut chosen = plain.clone();
    set(&mut chosen.body[name], setting).map_err(|why| Failure::work(anyhow::anyhow!(why)))?;
    Resolved::new(chosen)
}

/// Poses by which nothing was chosen: those that turn and move the furthest among more moments of the script, or other random
/// ones.
fn further_poses(scene: &Resolved, name: &str) -> Result<Vec<(String, ControlPoses)>, Failure> {
    let mut poses = further(scene, name)?;
    let way = |pose: &ControlPoses| pose.iter().map(|pose| pose.translation.norm()).fold(0.0, f64::max);
    poses.sort_by(|a, b| {
        largest_turn(&b.1).total_cmp(&largest_turn(&a.1)).then(way(&b.1).total_cmp(&way(&a.1)))
    });
    poses.truncate(FURTHER);
    Ok(poses)
}

/// Settles all bodies from the tables in the .green file alone, without notes. A body that has no table, or asks for what nothing
/// in its table reaches, stays as it is.
pub fn settle_from_file(scene: Resolved) -> Result<Resolved, Failure> {
    let source: TableSource<'_> = &|plain, name, key, demand| kept(plain, name, &key, demand);
    choose_from(scene, source, &|_| Ok(()))
}

/// Chooses from the tables of `source`. A demand that none of them reaches goes to `unmet`, and its body stays as it is where
/// that is no error.
fn choose_from(
    scene: Resolved,
    source: TableSource<'_>,
    unmet: &dyn Fn(SceneError) -> Result<(), Failure>,
) -> Result<Resolved, Failure> {
    let demands: Vec<(String, AccuracyTarget)> =
        scene.body.iter().filter_map(|(name, body)| Some((name.clone(), body.accuracy_target()?))).collect();
    let (mut plain, mut settled) = (Scene::clone(&scene), Scene::clone(&scene));
    for (name, _) in &demands {
        (plain.body[name].accuracy, plain.body[name].budget) = (None, None);
    }
    let plain = Resolved::new(plain)?;
    for (name, demand) in demands {
        let requirements = plain.measured_requirements(&name)?;
        let largest = demand.largest().unwrap_or(LARGEST);
        let body = green::fingerprint(&plain, &name, &requirements)?;
        let key = format!("{body}, {largest} unknowns, schema {SCHEMA}");
        let Some(table) = source(&plain, &name, key, &demand)? else { continue };
        let choice = table.choice(&demand).ok_or_else(|| {
            Failure::work(scene.invalid(&format!("body.{name}"), "nothing could be measured"))
        })?;
        if let Some(reason) = choice.missed(&demand) {
            unmet(scene.invalid(&format!("body.{name}.{}", demand.key()), reason))?;
            continue;
        }
        set(&mut settled.body[&name], &choice.row.setting).map_err(|message| {
            Failure::work(anyhow::anyhow!("body.{name}: the measured setting cannot be used: {message}"))
        })?;
        settled.body[&name].plan = Some(serde_json::to_value(&table).map_err(Failure::work)?);
    }
    Resolved::new(settled)
}

/// The table in the scene's .green file where it is of this body and, for what is asked in seconds, of this machine.
fn kept(
    scene: &Scene,
    name: &str,
    key: &str,
    demand: &AccuracyTarget,
) -> Result<Option<MeasuredTable>, Failure> {
    let Some(file) = green_file(scene)? else { return Ok(None) };
    let plan = file.meta.bodies.get(name).and_then(|body| body.plan.clone());
    // A table of another version is measured again.
    let table: Option<MeasuredTable> = plan.and_then(|plan| serde_json::from_value(plan).ok());
    let is_own = |table: &MeasuredTable| {
        table.key == key
            && table.models == models()
            && (!demand.is_timed() || table.machine == machine::description())
    };
    Ok(table.filter(is_own))
}

fn measure(
    scene: &Resolved,
    name: &str,
    key: String,
    demand: &AccuracyTarget,
    quiet: bool,
) -> Result<MeasuredTable, Failure> {
    notice!("body.{name}: measuring what accuracy costs on this body, once, to choose a setting");
    let (poses, pose_source) = scripted_or_random(scene, name, None, true)?;
    let scratch = tempfile::tempdir().map_err(Failure::work)?;
    let largest = demand.largest().unwrap_or(LARGEST);
    let request = Request {
        scene,
        body: name,
        poses: &poses,
        pose_source,
        limits: Limits {
            largest,
            largest_of_models: Limits::MODELS_SHARE * largest,
            refinements: 1,
            rounds: 60,
        },
        largest_key: format!("body.{name}.{}.largest", demand.key()),
        quick: true,
        packs: false,
        requirements_of: &|scene| {
            let unloaded = scene.body[name].unloaded();
            scene.bodies[name].requirements(scene, name, &unloaded).unwrap_or_default()
        },
        command: String::new(),
        scratch: scratch.path(),
        keep: Some(&steps(scene, name)),
        limit: None,
    };
    let measured = settings(&request, &Bars::new(name, quiet)).map_err(Failure::work)?;
    let range = measured.poses.iter().map(|(_, poses)| largest_turn(poses)).fold(0.0, f64::max);
    let machine = machine::description();
    measured.timing.warning().iter().for_each(|warning| notice!("body.{name}: {warning}"));
    measured.models_left_out.iter().for_each(|model| notice!("body.{name}: left out: {model}"));
    let (rows, left_out, models) = (measured.rows, measured.not_compared, models());
    Ok(MeasuredTable { key, machine, range, rows, models, left_out, verified: Vec::new() })
}

/// The folder in which the steps of measuring a body wait until its table is in the .green file: after Ctrl-C, and if nothing
/// reached what was asked, measuring goes on from there.
fn steps(scene: &Scene, name: &str) -> PathBuf {
    let plain = name.replace(|c: char| !c.is_alphanumeric(), "_");
    prepare::green_path(scene).with_extension(format!("{plain}.{FOLDER}"))
}

/// Removes these steps, which the tables in the .green file replace.
pub fn forget_steps(scene: &Scene) {
    scene.body.keys().for_each(|name| remove(&steps(scene, name)));
}

/// The models of this program that are evaluated in every frame: a table without one of them is measured again.
fn models() -> Vec<String> {
    online().map(|model| model.name.to_owned()).collect()
}

/// The scene's .green file, shipped or unpacked, where there is one.
fn green_file(scene: &Scene) -> Result<Option<GreenFile>, Failure> {
    let path = prepare::green_path(scene);
    prepare::unpack_shipped(&path)?;
    match GreenFile::open(&path) {
        Err(GreenError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
        file => Ok(Some(file?)),
    }
}

/// Sets the parameters of a body; errors name an element or a storage that is not known.
fn set(body: &mut Body, setting: &Setting) -> Result<(), String> {
    body.refine = setting.refine;
    setting.model.name.clone_into(&mut body.model);
    body.element = find_element(&setting.element)?;
    body.storage =
        Storage::named(&setting.storage).ok_or_else(|| format!("unknown storage \"{}\"", setting.storage))?;
    body.solver = setting.solver;
    Ok(())
}
