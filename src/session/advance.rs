//! A session: a world, the input that moves it, the effects that take part in it, and the file into which it is recorded.

use super::input::{InputSource, Leader, ScriptChange};
use super::keys;
use super::presses::ScriptPresses;
use super::recording::{Origin, Recorder, Replay};
use super::sound_file::SoundFile;
use crate::base::failure::Failure;
use crate::base::output;
use crate::effect::{self, Resolved};
use crate::green::GreenFile;
use crate::interact::Action;
use crate::render::window::Key;
use crate::track::{Mouse, MouseInput, Script};
use crate::world::assets::PATIENCE;
use crate::world::{Input, World};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A world, and all that moves or records it.
pub struct Session {
    /// Dropped first, so that force devices stop before we wait for trackers.
    pub world: World,
    pub input: InputSource,
    pub recorder: Option<Recorder>,
    /// The scene's .green file; a stage alone has none.
    pub file: Option<Arc<GreenFile>>,
    /// The scene that is shown now, with its stage; `None` for a stage alone.
    pub scene: Option<Resolved>,
    /// Whether the bodies shown are those of a saved or built-in scene.
    pub is_saved: bool,
    /// Commands and warnings for the next frame.
    actions: Vec<Action>,
    warnings: Vec<String>,
    pub(super) presses: ScriptPresses,
    /// The file for the recorded curve.
    pub(super) curve: Option<PathBuf>,
    /// The file for what is heard.
    pub(super) sound: Option<SoundFile>,
    /// Whether a curve was cleared by its key.
    is_cleared: bool,
}

/// Whether a session goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionProgress {
    Running,
    /// The recording has no more frames.
    Ended,
}

impl Session {
    /// A world moved by a script, or by nobody.
    pub fn new(world: World, script: Option<Script>) -> Session {
        let mut input = InputSource::default();
        input.script = script;
        input.script.iter_mut().for_each(|script| script.filled = Some(world.filled()));
        Session {
            world,
            input,
            recorder: None,
            file: None,
            scene: None,
            is_saved: true,
            actions: Vec::new(),
            warnings: Vec::new(),
            presses: ScriptPresses::default(),
            curve: None,
            sound: None,
            is_cleared: false,
        }
    }

    /// Lets mouse and keyboard move whatever neither tracker nor script moves.
    pub fn attach_mouse(&mut self) {
        self.input.mouse = Some(Mouse::new(self.world.assets.stage.clone()));
    }

    /// Starts what the effects of the scene's bodies run beside the frames, such as the loops of force devices.
    pub fn start_effects(&mut self, scene: &Resolved) -> Result<(), Failure> {
        if let Some(file) = &self.file {
            let started = effect::start(scene, file, &self.world)?;
            self.world.join(started)?;
        }
        Ok(())
    }

    /// Starts the trackers of the world's stage.
    pub fn start_trackers(&mut self) -> Result<(), Failure> {
        self.input.trackers = super::trackers::start(&self.world.assets.stage, &mut self.world.effects)?;
        Ok(())
    }

    /// Moves the world on to `time_s` since the start: through all frames of a recording up to then, or by one frame of
    /// the input that leads.
    pub fn advance(&mut self, time_s: f64) -> Result<SessionProgress, Failure> {
        if self.input.leader() == Leader::Recording {
            return self.replay_until(time_s);
        }
        let (mut trackers, changes) = self.input.state(&self.world.assets.stage, time_s);
        for change in changes {
            self.apply(change);
        }
        self.set_loads(time_s);
        self.world.effects.iter_mut().for_each(|effect| effect.input(&mut trackers));
        let (actions, warnings) = (std::mem::take(&mut self.actions), std::mem::take(&mut self.warnings));
        let input = Input { clock_s: time_s, actions, arrivals: self.world.arrivals(), warnings, trackers };
        self.world.step(&input);
        self.hear()?;
        if self.input.leader() == Leader::Script {
            self.warnings.extend(self.presses.watch(&self.world, &input.trackers));
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.frame(&mut self.world, input)?;
        }
        if let Some(mouse) = &mut self.input.mouse {
            mouse.hit_distance_m = self.world.hit_distance_m();
        }
        Ok(SessionProgress::Running)
    }

    /// Turns the script's loads, in the units of pose files, into commands, so that recordings contain them.
    fn set_loads(&mut self, time_s: f64) {
        for (name, value) in self.input.loads(time_s) {
            let Some((body, column)) = self.world.load_named(&name) else {
                self.warnings.push(format!("the script sets the load {name}, which no body has"));
                continue;
            };
            let of_body = self.world.bodies[body].deformer.body.as_str();
            let own = name.strip_prefix(&format!("{of_body}.")).unwrap_or(&name);
            let settings = self.scene.as_ref().map(|scene| &scene.body[of_body]);
            let entry = settings.and_then(|body| body.loads().into_iter().find(|load| load.name == own));
            if entry.as_ref().is_some_and(|load| load.source.columns() > 1) {
                self.warnings.push(format!(
                    "the load {name} has three numbers, and the script sets one: it stays as it is"
                ));
                continue;
            }
            let coefficients =
                entry.zip(settings).map(|(load, body)| body.load_coefficients(&load, &[value]));
            match coefficients {
                Some(Err(why)) => self.warnings.push(format!("the script sets the load {name}: {why}")),
                Some(Ok(coefficients)) if self.world.load(body, column) != Some(coefficients[0]) => {
                    self.act(Action::SetLoad { body, column, value: coefficients[0] });
                }
                _ => {}
            }
        }
    }

    /// Records the session from here on, even while something is held, until [`Session::stop_recording`].
    ///
    /// # Errors
    /// Where nothing could replay it, or the file cannot be written.
    pub fn record(&mut self, path: &Path) -> Result<(), Failure> {
        let refused = |why: &str| Err(Failure::wrong(format!("not recorded: {why}")));
        let (Some(scene), Some(file)) = (&self.scene, &self.file) else {
            return refused("there is no scene yet");
        };
        if self.input.replay.is_some() {
            return refused("a replay cannot be recorded");
        }
        if self.recorder.is_some() {
            return refused("this session is being recorded already");
        }
        if !self.is_saved {
            return refused("the bodies differ from the scene's file; save the scene first (Tab)");
        }
        let origin = Origin { scene, file, stage: &scene.stage_from_here() };
        self.recorder = Some(Recorder::create(path, &origin, &mut self.world)?);
        Ok(())
    }

    /// Ends the recording and returns a sentence about it, or an empty one. Frames then stop waiting for the background.
    pub fn stop_recording(&mut self) -> Result<String, Failure> {
        let Some(recorder) = self.recorder.take() else { return Ok(String::new()) };
        self.world.bodies.iter_mut().for_each(|body| body.deformer.be_patient(PATIENCE));
        recorder.end()
    }

    /// Carries out a command at the start of the next frame.
    pub fn act(&mut self, action: Action) {
        self.actions.push(action);
    }

    fn apply(&mut self, change: ScriptChange) {
        self.act(match change {
            ScriptChange::LetGo => Action::LetGo,
            ScriptChange::Reset => Action::Reset,
        });
    }

    /// Plays all frames of the recording up to `time_s` after its first.
    fn replay_until(&mut self, time_s: f64) -> Result<SessionProgress, Failure> {
        while let Some(replay) = &mut self.input.replay
            && let Some(frame_s) = replay.next_time_s()?
        {
            if frame_s > time_s {
                return Ok(SessionProgress::Running);
            }
            self.play_frame()?;
        }
        Ok(SessionProgress::Ended)
    }

    /// Plays the next frame of the recording; false at its end.
    pub fn play_frame(&mut self) -> Result<bool, Failure> {
        let Some(replay) = &mut self.input.replay else { return Ok(false) };
        let is_played = replay.play_next(&mut self.world)?;
        if is_played {
            self.hear()?;
        }
        Ok(is_played)
    }

    /// Adds the sound of the last frame to its file, if there is one.
    fn hear(&mut self) -> Result<(), Failure> {
        self.sound.as_mut().map_or(Ok(()), |file| file.hear(&mut self.world))
    }

    /// Takes what a person does with the mouse. A press takes over from a script.
    pub fn mouse(&mut self, input: MouseInput<'_>) {
        if let MouseInput::Button { pressed: true, .. } = input {
            self.take_over();
        }
        let Some(mouse) = &mut self.input.mouse else { return };
        match input {
            MouseInput::Wheel { notches } if mouse.control && !mouse.is_grabbing() => {
                self.act(keys::scale(notches));
            }
            input => mouse.handle(input),
        }
    }

    /// Takes a key that is pressed or released. It may take over from a script ([`keys::takes_over`]).
    pub fn key(&mut self, key: Key, pressed: bool) {
        if key == keys::NEXT_FIELD {
            if pressed {
                self.act(Action::NextField);
            }
            return;
        }
        if pressed && keys::takes_over(key) {
            self.take_over();
        }
        let Some(control) = self.input.mouse.as_ref().map(|mouse| mouse.control) else { return };
        if pressed && !control && key == keys::CLEAR {
            self.is_cleared |= self.world.effects.iter().any(|effect| effect.table().is_some());
            self.act(Action::Clear);
        }
        if let Some(action) = keys::action(key, control, &self.world).filter(|_| pressed) {
            self.act(action);
        }
        let mut typed = [0; 4];
        if let Some((name, mouse)) = keys::name(key, &mut typed).zip(self.input.mouse.as_mut()) {
            mouse.handle(MouseInput::Key { name, pressed });
        }
    }

    /// Lets a person take over from the script, if one leads; the hands let go of what it held.
    pub fn take_over(&mut self) {
        if let Some(change) = self.input.take_over() {
            self.apply(change);
        }
    }

    /// Writes the table of the first effect that has one, if a file for it was asked for.
    fn write_curve(&mut self) -> Result<String, Failure> {
        let Some(path) = self.curve.take() else { return Ok(String::new()) };
        let Some((kind, table)) = self.world.effects.iter().find_map(|effect| effect.table()) else {
            let why = match self.is_cleared {
                true => "C cleared the force curve, and nothing was held since",
                false => "nothing was held",
            };
            return Ok(format!("note: {why}: {} is not written\n", path.display()));
        };
        output::write(&path, kind, |file| file.write_all(table.as_bytes()))?;
        Ok(format!("force curve {}\n", path.display()))
    }

    /// The closing lines of all effects.
    pub fn summary(&mut self) -> String {
        self.world.effects.iter_mut().map(|effect| effect.summary()).collect()
    }

    /// Reports on the replay and the recording. Fails if the replay's states differ from the recorded ones.
    pub fn report(&mut self) -> Result<String, Failure> {
        let recorded = self.stop_recording()?;
        let replayed = self.input.replay.as_ref().map_or(Ok(String::new()), Replay::report)?;
        let curve = self.write_curve()?;
        let sound = self.sound.take().map_or(Ok(String::new()), SoundFile::end)?;
        Ok(format!("{replayed}{recorded}{curve}{sound}"))
    }
}
