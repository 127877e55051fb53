//! Changes of scene and stage while a session runs: computed in the background, then put in the place of what was shown.
//!
//! In: a running [`Session`] and the scene that is to be shown instead. Out: a [`ChangeResult`] world, from the .green files that
//! are known where they fit and else from a new one; [`Session::take`] puts it in place, with the poses of the control
//! elements that are the same. A change that fails leaves the session as it was.

use super::advance::Session;
use crate::base::failure::{self, Failure};
use crate::base::progress::Progress;
use crate::deform::Deformer;
use crate::effect;
use crate::green::GreenFile;
use crate::prepare::{self, Resolved};
use crate::stage::Stage;
use crate::stage::tracking::TrackerSource;
use crate::track::Mouse;
use crate::world::World;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A change that is being computed.
pub struct Change {
    pub steps: Arc<Steps>,
    thread: JoinHandle<Result<ChangeResult, Failure>>,
}

/// The result of a change.
pub struct ChangeResult {
    pub scene: Resolved,
    pub file: Arc<GreenFile>,
    deformers: Vec<Deformer>,
    pub stage: Stage,
    /// Whether windows have to be opened anew.
    pub is_other_stage: bool,
}

/// Progress of the computation of a change.
#[derive(Debug, Default)]
pub struct Steps(Mutex<Step>);

/// A step of the computation: its name, units of work, and how many of them are done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Step {
    pub name: String,
    pub units: u64,
    pub done: u64,
}

impl Steps {
    pub fn now(&self) -> Step {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Progress for Steps {
    fn begin(&self, step: &str, units: u64) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) =
            Step { name: step.to_owned(), units, done: 0 };
    }

    fn advance(&self, units: u64) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).done += units;
    }

    fn end(&self) {}
}

impl Change {
    /// Begins to compute `scene` on `stage`. A new .green file goes to `path`; `known` are those that may hold some of it.
    ///
    /// # Errors
    /// Fails while a session is recorded or replayed, because a recording cannot contain the change.
    pub fn begin(
        session: &Session,
        scene: Resolved,
        stage: Stage,
        path: PathBuf,
        known: Vec<Arc<GreenFile>>,
    ) -> Result<Change, Failure> {
        session.may_change()?;
        let is_other_stage = stage != session.world.assets.stage;
        let steps = Arc::new(Steps::default());
        let told = steps.clone();
        let compute = move || {
            let file = prepare::changed_file(&scene, &path, &known, &*told)?;
            told.begin("model", 0);
            let deformers = World::deformers(&scene, &scene.models(), &file)?;
            Ok(ChangeResult { scene, file, deformers, stage, is_other_stage })
        };
        let thread =
            std::thread::Builder::new().name("change".into()).spawn(compute).map_err(Failure::work)?;
        Ok(Change { steps, thread })
    }

    pub fn is_done(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits for the result.
    pub fn finish(self) -> Result<ChangeResult, Failure> {
        failure::join(self.thread, "the computation")
    }
}

impl Session {
    /// Refuses a change that a recording cannot contain.
    pub fn may_change(&self) -> Result<(), Failure> {
        let why = match (&self.recorder, &self.input.replay) {
            (Some(_), _) => {
                "this session is being recorded, and a recording has one scene: end the recording first (F8)"
            }
            (_, Some(_)) => "this session is a replay, which shows what was recorded",
            _ => return Ok(()),
        };
        Err(Failure::wrong(why.to_owned()))
    }

    /// Shows the result of a change instead of what was shown. Devices and trackers of the scene are started anew.
    ///
    /// # Errors
    /// Where it is recorded or replayed, or an effect cannot join the new world, the session stays as it was; where a device or a
    /// tracker cannot be started, all else is changed.
    pub fn take(&mut self, changed: ChangeResult) -> Result<(), Failure> {
        self.may_change()?;
        let ChangeResult { scene, file, deformers, stage, is_other_stage } = changed;
        let mut world = World::of_bodies(&scene, &file, deformers, stage)?;
        let effects = effect::attach(effect::EFFECTS, &scene, &file, &mut world)?;
        world.join(effects)?;
        world.carry_over(&mut self.world);
        // Devices are let go of before others are opened.
        let was_live = self.input.mouse.is_some();
        // A force device speaks through its loop, which ends with the effects.
        let is_tracked_anew = is_other_stage || has_force_device(&self.world.assets.stage);
        if is_tracked_anew {
            self.input.trackers = None;
        }
        self.world.effects.clear();
        (self.world, self.file) = (world, Some(file));
        self.is_saved &= self.scene.as_ref().is_some_and(|shown| shown.body == scene.body);
        self.scene = Some(scene);
        if is_other_stage {
            self.input.script = None;
            if was_live {
                self.input.mouse = Some(Mouse::new(self.world.assets.stage.clone()));
            }
        }
        if let (Some(scene), true) = (self.scene.clone(), was_live) {
            self.start_effects(&scene)?;
            if is_tracked_anew {
                self.start_trackers()?;
            }
        }
        Ok(())
    }
}

fn has_force_device(stage: &Stage) -> bool {
    stage.tracking.trackers.values().any(|tracker| matches!(tracker.source, TrackerSource::Haptic(_)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::ControlPose;
    use crate::scene::{Grab, Scene};
    use crate::session::Request;
    use crate::track::device::{DeviceState, Link};
    use crate::track::vrpn::Server;
    use nalgebra::{Isometry3, Vector3};
    use std::path::Path;

    const SCENE: &str = "[body.a]\n\
        generate = { block = { size = [1.0, 0.2, 0.2], cells = [5, 1, 1] } }\n\
        material = { young = 1.0e6, poisson = 0.3 }\n\
        [body.a.control]\n\
        low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n\
        [body.b]\n\
        generate = { block = { size = [1.0, 0.2, 0.2], cells = [4, 1, 1] } }\n\
        material = { young = 1.0e6, poisson = 0.3 }\n\
        [body.b.control]\n\
        low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
        high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";

    fn session(folder: &Path) -> Session {
        let scene = Resolved::parse(SCENE, &folder.join("scene.toml")).unwrap();
        let mut session = Session::open(&Request::new(&scene)).unwrap();
        let pose = ControlPose { translation: Vector3::new(0.1, 0.02, 0.0), ..ControlPose::REST };
        let field = session.world.fields.bodies[0].poses[1];
        session.world.graph.restore(field, pose);
        session.advance(0.0).unwrap();
        assert_eq!(session.world.bodies[0].deformer.poses[1], pose);
        session
    }

    fn change(
        session: &mut Session,
        folder: &Path,
        edit: impl FnOnce(&mut Scene),
    ) -> Result<Arc<GreenFile>, Failure> {
        let mut scene = Scene::clone(session.scene.as_ref().unwrap());
        edit(&mut scene);
        let (stage, known) = (session.world.assets.stage.clone(), session.file.iter().cloned().collect());
        let scene = Resolved::new(scene)?;
        let changed = Change::begin(session, scene, stage, folder.join("new.green"), known)?.finish()?;
        let file = changed.file.clone();
        session.take(changed)?;
        session.advance(0.1)?;
        Ok(file)
    }

    #[test]
    fn another_model_of_the_same_columns_computes_nothing_and_keeps_the_pose() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(folder.path());
        let (before, pose) = (session.file.clone().unwrap(), session.world.bodies[0].deformer.poses[1]);
        let file =
            change(&mut session, folder.path(), |scene| scene.body["a"].model = "rotation".into()).unwrap();
        assert!(Arc::ptr_eq(&file, &before) && !folder.path().join("new.green").exists());
        let body = &session.world.bodies[0];
        assert_eq!((body.assets.model.name, body.deformer.poses[1]), ("rotation", pose));
        assert_eq!(session.scene.as_ref().unwrap().body["a"].model, "rotation");
    }

    #[test]
    fn a_grab_before_a_change_of_the_model_can_be_undone_after_it() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(folder.path());
        let pose = session.world.bodies[0].deformer.poses[1];
        session.act(crate::interact::Action::SnapBack);
        for time_s in [0.1, 0.2, 1.0] {
            session.advance(time_s).unwrap();
        }
        let seen =
            |session: &Session| (session.world.bodies[0].deformer.poses[1], session.world.undo_depth());
        assert_eq!(seen(&session), (ControlPose::REST, [1, 0]));
        change(&mut session, folder.path(), |scene| scene.body["a"].model = "rotation".into()).unwrap();
        session.act(crate::interact::Action::Undo);
        session.advance(1.2).unwrap();
        assert_eq!(seen(&session), (pose, [0, 1]));
    }

    #[test]
    fn only_the_body_that_changed_is_computed_anew() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(folder.path());
        let before = session.file.clone().unwrap();
        let file =
            change(&mut session, folder.path(), |scene| scene.body["b"].material.poisson = 0.1).unwrap();
        let of = |file: &GreenFile, body: &str| file.meta.bodies[body].fingerprint.clone();
        assert_eq!(of(&file, "a"), of(&before, "a"));
        assert_ne!(of(&file, "b"), of(&before, "b"));
        assert_eq!(file.meta.bodies["a"], before.meta.bodies["a"]);
        for (name, hash) in before.meta.blake3.iter().filter(|(name, _)| name.starts_with("a/")) {
            assert_eq!(file.meta.blake3.get(name), Some(hash), "{name}");
        }
        assert_eq!(session.world.bodies[0].deformer.poses[1].translation.x, 0.1);
    }

    /// Loads went back to those of the scene, so forces were others, and V's field to the first one.
    #[test]
    fn a_remade_body_bears_the_same_loads_and_shows_the_same_field() {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = Scene::parse(SCENE, &folder.path().join("scene.toml")).unwrap();
        let body = &mut scene.body["a"];
        body.effects = vec!["haptics".into(), "stress".into()];
        body.material.density = Some(1000.0);
        body.gravity = Some(crate::scene::Gravity::Earth(true));
        let scene = Resolved::new(scene).unwrap();
        let mut session = Session::open(&Request::new(&scene)).unwrap();
        let pose = ControlPose { translation: Vector3::new(0.1, 0.02, 0.0), ..ControlPose::REST };
        let field = session.world.fields.bodies[0].poses[1];
        session.world.graph.restore(field, pose);
        let heavier = Vector3::new(1.0, -30.0, 2.0);
        for (column, value) in heavier.iter().enumerate() {
            session.act(crate::interact::Action::SetLoad { body: 0, column, value: *value });
        }
        session.world.field_changes = 2;
        session.advance(0.0).unwrap();
        let seen = |session: &Session| {
            let (world, body) = (&session.world, &session.world.bodies[0]);
            let loads: Vec<Option<f64>> = (0..3).map(|column| world.load(0, column)).collect();
            (
                body.deformer.wrenches().unwrap(),
                world.frame.bodies[0].colours.clone().unwrap(),
                loads,
                world.field_changes,
            )
        };
        let before = seen(&session);
        assert_eq!(before.2, heavier.iter().map(|value| Some(*value)).collect::<Vec<_>>());
        change(&mut session, folder.path(), |scene| scene.body["b"].model = "rotation".into()).unwrap();
        assert_eq!(seen(&session), before, "the world is another one, this body is not");
        change(&mut session, folder.path(), |scene| scene.body["a"].model = "rotation".into()).unwrap();
        let after = seen(&session);
        assert!(after.0 != before.0 && (&after.2, after.3) == (&before.2, before.3));
    }

    /// The stylus kept the last pose of the loop that had ended.
    #[test]
    fn a_force_device_moves_its_stylus_after_a_change_as_well() {
        let folder = tempfile::tempdir().unwrap();
        let mut server = Server::bind(([127, 0, 0, 1], 0).into(), ["Pen"]).unwrap();
        let device = format!("[haptic.pen]\ndevice = \"vrpn://{}/Pen\"\nmax_force = 5\n", server.place);
        let stage = folder.path().join("bench.toml");
        std::fs::write(&stage, format!("{}{device}", crate::stage::BUILT_IN[0].1)).unwrap();
        let text = SCENE.replacen("[body.a]", "[body.a]\neffects = [\"haptics\"]", 1);
        let scene = Resolved::parse(&text, &folder.path().join("scene.toml")).unwrap();
        let stage = stage.display().to_string();
        let mut session = Session::open(&Request { stage: Some(&stage), ..Request::new(&scene) }).unwrap();
        session.attach_mouse();
        session.start_effects(&scene).unwrap();
        session.start_trackers().unwrap();
        let mut state = DeviceState { link: Link::Up, ..DeviceState::default() };
        let mut is_followed = |session: &mut Session, x: f64| {
            let begun = std::time::Instant::now();
            loop {
                state.take_pose(0, Isometry3::translation(x, 0.0, 0.0), None, 1.0);
                server.publish(0, &state);
                server.tick();
                let reports = session.input.tracker_reports();
                let raw = reports.iter().flat_map(|report| &report.sensors).find_map(|sensor| sensor.raw);
                match raw.is_some_and(|raw| (raw.translation.x - x).abs() < 1e-6) {
                    true => return true,
                    false if begun.elapsed().as_secs() > 60 => return false,
                    false => std::thread::sleep(std::time::Duration::from_millis(5)),
                }
            }
        };
        assert!(is_followed(&mut session, 0.1));
        change(&mut session, folder.path(), |scene| scene.body["a"].model = "rotation".into()).unwrap();
        assert!(is_followed(&mut session, 0.2));
    }

    #[test]
    fn what_cannot_be_leaves_the_session_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(folder.path());
        let before = session.file.clone().unwrap();
        let no_group = |scene: &mut Scene| {
            scene.body["a"].control["low"].nodes = crate::scene::Nodes::Group("nowhere".into());
        };
        let error = change(&mut session, folder.path(), no_group).unwrap_err().to_string();
        assert!(error.contains("nowhere"), "{error}");
        assert!(Arc::ptr_eq(session.file.as_ref().unwrap(), &before));
        assert_eq!(session.world.bodies[0].deformer.poses[1].translation.x, 0.1);
    }

    #[test]
    fn an_element_of_other_nodes_begins_at_rest() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(folder.path());
        let other = |scene: &mut Scene| {
            let high = &mut scene.body["a"].control["high"];
            high.nodes = crate::scene::Nodes::Group("ymax".into());
            scene.body["a"].control["low"].nodes = crate::scene::Nodes::Group("ymin".into());
            assert_eq!(scene.body["a"].control["high"].grab, Grab::Dragger);
        };
        change(&mut session, folder.path(), other).unwrap();
        assert_eq!(session.world.bodies[0].deformer.poses[1], ControlPose::REST);
    }

    #[test]
    fn a_session_that_is_recorded_is_not_changed() {
        let folder = tempfile::tempdir().unwrap();
        let scene = Resolved::parse(SCENE, &folder.path().join("scene.toml")).unwrap();
        let path = folder.path().join("all.jsonl");
        let mut session = Session::open(&Request { record: Some(&path), ..Request::new(&scene) }).unwrap();
        let error = change(&mut session, folder.path(), |_| {}).unwrap_err().to_string();
        assert!(error.contains("being recorded"), "{error}");
        session.stop_recording().unwrap();
        change(&mut session, folder.path(), |scene| scene.stage = "desktop".into()).unwrap();
        session.record(&folder.path().join("again.jsonl")).unwrap();
    }

    /// A replay opens the scene's file, and would be refused.
    #[test]
    fn bodies_that_no_file_holds_are_not_recorded() {
        let folder = tempfile::tempdir().unwrap();
        let mut session = session(folder.path());
        change(&mut session, folder.path(), |scene| scene.body["a"].model = "rotation".into()).unwrap();
        let path = folder.path().join("all.jsonl");
        let error = session.record(&path).unwrap_err().to_string();
        assert!(error.contains("save the scene first") && !path.exists(), "{error}");
    }
}
