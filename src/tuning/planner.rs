//! Settles the settings of a scene's bodies: measures once, keeps the table in the .green file, and chooses anew from it
//! when the accuracy or the budget changes.

use super::choice::{Choice, choose};
use crate::base::failure::Failure;
use crate::base::machine;
use crate::deform::{ControlPose, ControlPoses};
use crate::fem::{find_element, nearest_turn};
use crate::green::{self, GreenError, GreenFile, Requirements};
use crate::report::measure::settings;
use crate::report::{Limits, MeasureError, Measurement, Request, Setting};
use crate::scene::{AccuracyTarget, Scene, SceneError, Storage};
use crate::solve::Progress;
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

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
    /// Poses in which nothing was measured, and why.
    left_out: Vec<String>,
}

/// Unknowns of the largest solve while a table is measured, unless the scene says otherwise.
const LARGEST: f64 = 200_000.0;

#[derive(Debug, thiserror::Error)]
pub enum TuningError {
    /// No setting that was measured is as accurate or as cheap as asked.
    #[error(transparent)]
    Unmet(SceneError),
    #[error(transparent)]
    Measure(#[from] MeasureError),
    #[error("no folder for temporary files: {0}")]
    Scratch(std::io::Error),
    #[error("what was measured cannot be kept: {0}")]
    Table(#[from] serde_json::Error),
}

/// Poses with their names, and one sentence on where they come from.
pub type NamedPoses = (Vec<(String, ControlPoses)>, String);

/// What the planner asks of the program around it; `E` is the program's own error.
pub struct Planner<'a, E> {
    /// What the model and the effects of a body need.
    pub requirements: &'a dyn Fn(&Scene, &str) -> Result<Requirements, E>,
    /// The scene's .green file, where it has one.
    pub file: &'a dyn Fn(&Scene) -> Result<Option<GreenFile>, E>,
    /// The poses that a body is measured in.
    pub poses: &'a dyn Fn(&Scene, &str) -> Result<NamedPoses, E>,
    pub progress: &'a dyn Fn(&str) -> Box<dyn Progress>,
    /// Takes sentences on what is measured, left out and chosen.
    pub notify: &'a dyn Fn(String),
}

/// Where a body's table comes from: the scene without what it asks for, the body's name, the key that the table must
/// have, and what is asked for.
type TableSource<'a, E> =
    &'a dyn Fn(&Scene, &str, String, &AccuracyTarget) -> Result<Option<MeasuredTable>, E>;

impl<E: From<TuningError> + From<GreenError>> Planner<'_, E> {
    /// The scene with the settings chosen for every body that asks for an accuracy or a budget. Measures a body that has
    /// no table yet. Errors where no setting reaches what is asked for; a damaged .green file is an error too, unless
    /// `force` says that it will be made anew.
    pub fn choose(&self, scene: Scene, force: bool) -> Result<Scene, E> {
        let source: TableSource<'_, E> = &|plain, name, key, demand| {
            let kept = self
                .kept(plain, name, &key, demand)
                .or_else(|error| if force { Ok(None) } else { Err(error) });
            let table = match kept? {
                Some(table) => table,
                None => self.measure(plain, name, key, demand)?,
            };
            table.left_out.iter().for_each(|pose| (self.notify)(format!("body.{name}: left out: {pose}")));
            let choice = choose(&table.rows, demand).filter(|choice| choice.miss <= 1.0);
            for sentence in choice.iter().flat_map(Choice::sentences) {
                (self.notify)(format!("body.{name}: {sentence}"));
            }
            Ok(Some(table))
        };
        self.choose_from(scene, source, &|unmet| Err(TuningError::Unmet(unmet).into()))
    }

    /// The same from the tables in the .green file alone, without a word. A body that has no table, or asks for what
    /// nothing in its table reaches, stays as it is.
    pub fn choose_from_file(&self, scene: Scene) -> Result<Scene, E> {
        let source: TableSource<'_, E> = &|plain, name, key, demand| self.kept(plain, name, &key, demand);
        self.choose_from(scene, source, &|_| Ok(()))
    }

    /// Chooses from the tables of `source`. What none of them reaches goes to `unmet`, and its body stays as it is where
    /// that is no error.
    fn choose_from(
        &self,
        mut scene: Scene,
        source: TableSource<'_, E>,
        unmet: &dyn Fn(SceneError) -> Result<(), E>,
    ) -> Result<Scene, E> {
        let demands: Vec<(String, AccuracyTarget)> = scene
            .body
            .iter()
            .filter_map(|(name, body)| Some((name.clone(), body.accuracy_target()?)))
            .collect();
        let mut plain = scene.clone();
        for (name, _) in &demands {
            (plain.body[name].accuracy, plain.body[name].budget) = (None, None);
        }
        for (name, demand) in demands {
            let requirements = (self.requirements)(&plain, &name)?;
            let largest = demand.largest().unwrap_or(LARGEST);
            let key = format!("{}, {largest} unknowns", green::fingerprint(&plain, &name, &requirements)?);
            let Some(table) = source(&plain, &name, key, &demand)? else { continue };
            let choice = choose(&table.rows, &demand).ok_or_else(|| {
                TuningError::Unmet(scene.invalid(&format!("body.{name}"), "nothing could be measured"))
            })?;
            if let Some(reason) = choice.missed(&demand) {
                unmet(scene.invalid(&format!("body.{name}.{}", demand.key()), reason))?;
                continue;
            }
            set(&mut scene, &name, &choice.row.setting);
            scene.body[&name].plan = Some(serde_json::to_value(&table).map_err(TuningError::from)?);
        }
        Ok(scene)
    }

    /// The table in the scene's .green file where it is of this body and, for what is asked in seconds, of this machine.
    fn kept(
        &self,
        scene: &Scene,
        name: &str,
        key: &str,
        demand: &AccuracyTarget,
    ) -> Result<Option<MeasuredTable>, E> {
        let Some(file) = (self.file)(scene)? else { return Ok(None) };
        let plan = file.meta.bodies.get(name).and_then(|body| body.plan.clone());
        // A table of another version is measured again.
        let table: Option<MeasuredTable> = plan.and_then(|plan| serde_json::from_value(plan).ok());
        let is_own = |table: &MeasuredTable| {
            table.key == key && (!demand.is_timed() || table.machine == machine::description())
        };
        Ok(table.filter(is_own))
    }

    fn measure(
        &self,
        scene: &Scene,
        name: &str,
        key: String,
        demand: &AccuracyTarget,
    ) -> Result<MeasuredTable, E> {
        (self.notify)(format!(
            "body.{name}: measuring what accuracy costs on this body, to choose from; once"
        ));
        let (poses, pose_source) = (self.poses)(scene, name)?;
        let scratch = tempfile::tempdir().map_err(TuningError::Scratch)?;
        let request = Request {
            scene,
            body: name,
            poses: &poses,
            pose_source,
            limits: Limits { largest: demand.largest().unwrap_or(LARGEST), refinements: 1, rounds: 60 },
            largest_key: format!("body.{name}.{}.largest", demand.key()),
            quick: true,
            requirements_of: &|scene| (self.requirements)(scene, name).unwrap_or_default(),
            command: String::new(),
            scratch: scratch.path(),
        };
        let measured = settings(&request, &*(self.progress)(name)).map_err(TuningError::from)?;
        let range = measured.poses.iter().map(|(_, poses)| largest_turn(poses)).fold(0.0, f64::max);
        let machine = machine::description();
        Ok(MeasuredTable { key, machine, range, rows: measured.rows, left_out: measured.left_out })
    }
}

/// The largest angle between the rotations of two control elements, rad.
fn largest_turn(poses: &[ControlPose]) -> f64 {
    let rotations: Vec<UnitQuaternion<f64>> = poses.iter().map(|pose| nearest_turn(&pose.matrix)).collect();
    let pairs =
        rotations.iter().enumerate().flat_map(|(i, a)| rotations[..i].iter().map(move |b| a.angle_to(b)));
    pairs.fold(0.0, f64::max)
}

/// Sets the parameters of a scene's body.
fn set(scene: &mut Scene, name: &str, setting: &Setting) {
    let body = &mut scene.body[name];
    body.refine = setting.refine;
    body.model.clone_from(&setting.model);
    if let Ok(known) = find_element(&setting.element) {
        body.element = known;
    }
    if let Some(known) = Storage::ALL.into_iter().find(|known| known.name() == setting.storage) {
        body.storage = known;
    }
    body.solver = setting.solver;
}

impl From<TuningError> for Failure {
    fn from(error: TuningError) -> Failure {
        Failure::work(error)
    }
}
