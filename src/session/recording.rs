//! A session as a file: for every frame what came from outside, and the hash of the resulting state.
//!
//! Lines of JSON: a header (scene, stage, program), the [`State`] at the start, which may be in the middle of anything, then a line a
//! frame. It grows under its own name ([`output::stream`]), and a thread hands each line to the system at
//! once, so that a crash costs the last few at most; a file that ends in the middle of a line is read up to there.

use crate::base::diagnostic::notice;
use crate::base::failure::Failure;
use crate::base::input;
use crate::base::output::{self, Kind};
use crate::field::{LONGEST_LINE, StreamError, read_line};
use crate::green::GreenFile;
use crate::scene::{Color, Scene, Tool, ToolShape};
use crate::session::lines::Lines;
use crate::world::{Input, State, World};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{BufRead, BufReader, Take};
use std::path::{Component, Path, PathBuf};

const VERSION: u32 = 8;

/// A state of more bytes is refused.
const LARGEST_STATE: usize = 1 << 28;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    greenstage: String,
    version: u32,
    program: String,
    /// The name of a built-in stage, or the path of a stage file from the recording's own folder.
    stage: String,
    /// blake3 over everything of the scene, and of the stage (workspace and viewer), that the state depends on.
    scene_hash: String,
    stage_hash: String,
}

/// One frame of a session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Counted from 0.
    pub frame: u64,
    pub input: Input,
    /// [`World::state_hash`] after it.
    pub hash: String,
}

/// The scene, stage and program for which a recording was made.
pub struct Origin<'a> {
    pub scene: &'a Scene,
    pub file: &'a GreenFile,
    /// A built-in stage, or the path of a stage file from where the program runs.
    pub stage: &'a str,
}

impl Origin<'_> {
    fn header(&self, world: &World, recording: &Path) -> Header {
        let mut scene = blake3::Hasher::new();
        let acting: Vec<&str> =
            world.effects.iter().filter(|effect| effect.acts()).map(|effect| effect.name()).collect();
        for ((name, body), fields) in self.scene.body.iter().zip(&world.fields.bodies) {
            let basis = self.file.meta.bodies.get(name).map_or("", |meta| meta.fingerprint.as_str());
            let grabs: Vec<_> = body.control.iter().map(|(name, control)| (name, control.grab)).collect();
            let is_listed = |name: &&&str| body.effects.iter().any(|listed| listed == **name);
            let listed: Vec<_> = acting.iter().filter(is_listed).collect();
            let settings: Vec<_> =
                listed.iter().filter_map(|name| body.effect.get_key_value(**name)).collect();
            let spring = body.surface_compliance.as_ref().map(|compliance| compliance.spring);
            let own =
                (name, basis, &body.model, &body.place, grabs, listed, settings, spring, &fields.starting);
            scene.update(format!("{own:?}").as_bytes());
        }
        for (name, tool) in self.scene.tool.iter().filter(|_| !acting.is_empty()) {
            scene.update(format!("{:?}", (name, Tool { color: Color([0; 3]), ..tool.clone() })).as_bytes());
            if let ToolShape::Mesh { file, .. } = &tool.shape {
                scene.update(&input::read(&self.scene.resolve(file)).unwrap_or_default());
            }
        }
        let stage = format!("{:?}", (world.assets.stage.workspace, world.assets.stage.viewer.room_from_head));
        Header {
            greenstage: "recording".into(),
            version: VERSION,
            program: env!("CARGO_PKG_VERSION").into(),
            stage: stage_from(recording, self.stage),
            scene_hash: scene.finalize().to_hex().to_string(),
            stage_hash: blake3::hash(stage.as_bytes()).to_hex().to_string(),
        }
    }
}

const KIND: Kind =
    Kind { name: "a recording", recognizes: |head| head.starts_with(b"{\"greenstage\":\"recording\"") };

/// Whether a session can be written to `path`, before anything is solved.
pub fn try_path(path: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
    Ok(output::try_path(path, &KIND, inputs)?)
}

/// Writes a session into a recording.
pub struct Recorder {
    pub path: PathBuf,
    lines: Lines,
    frames: u64,
}

impl Recorder {
    /// Starts a new file from the world's state; an older recording is replaced once the new one's start is written. From here on
    /// the CPU sums all vertices, and every frame waits for the background. The world goes on from the state as it was written,
    /// as a replay will: background work under way is forgotten.
    pub fn create(path: &Path, origin: &Origin<'_>, world: &mut World) -> Result<Recorder, Failure> {
        let mut text = line(&origin.header(world, path))?;
        let state = world.state().map_err(Failure::work)?;
        text.extend(line(&state)?);
        let file = output::stream(path, &KIND, &text)?;
        let lines = Lines::write(Vec::new(), file).map_err(Failure::work)?;
        world.bodies.iter_mut().for_each(|body| body.deformer.sum_everywhere());
        world.wait_for_background();
        world.set_state(&state).map_err(|error| Failure::work(anyhow::anyhow!(error)))?;
        Ok(Recorder { path: path.to_owned(), lines, frames: 0 })
    }

    /// The frame that `world` has just made of `input`.
    pub fn frame(&mut self, world: &mut World, input: Input) -> Result<(), Failure> {
        let frame = Frame { frame: self.frames, input, hash: world.state_hash() };
        self.frames += 1;
        let queued = self.lines.queue(line(&frame)?);
        queued.map_err(|error| self.failed(&error))
    }

    /// Ends the recording; once everything is written, returns the sentence for the user.
    pub fn end(mut self) -> Result<String, Failure> {
        self.lines.finish().map_err(|error| self.failed(&error))?;
        Ok(format!("{} frames recorded in {}\n", self.frames, self.path.display()))
    }

    fn failed(&self, error: &std::io::Error) -> Failure {
        Failure::work(anyhow::anyhow!("cannot write the recording {}: {error}", self.path.display()))
    }
}

/// Whatever ends in `.toml` is a path, as in [`Stage::find`](crate::stage::Stage::find).
fn is_file(stage: &str) -> bool {
    stage.ends_with(".toml")
}

fn folder_of(recording: &Path) -> &Path {
    recording.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A stage as a recording names it: a file by its path from the recording's folder, so that both may be moved together and
/// replayed from anywhere. Where one of the two is not there, the path as it is.
fn stage_from(recording: &Path, stage: &str) -> String {
    if !is_file(stage) {
        return stage.to_owned();
    }
    let places = std::fs::canonicalize(folder_of(recording)).ok().zip(std::fs::canonicalize(stage).ok());
    let from = |(folder, file): (PathBuf, PathBuf)| {
        let shared = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
        let up = folder.components().skip(shared).map(|_| Component::ParentDir);
        up.chain(file.components().skip(shared)).collect::<PathBuf>()
    };
    places.map(from).unwrap_or_else(|| PathBuf::from(stage)).display().to_string()
}

fn line(value: &impl Serialize) -> Result<Vec<u8>, Failure> {
    let mut text = serde_json::to_vec(value).map_err(Failure::work)?;
    text.push(b'\n');
    Ok(text)
}

/// Replays a session, and compares its states with those that were recorded.
pub struct Replay {
    path: PathBuf,
    input: BufReader<Take<File>>,
    line: u64,
    header: Header,
    /// Frames played so far.
    frames: u64,
    played: u64,
    /// A frame that was read and is not yet played.
    next: Option<Frame>,
    /// Time of the first frame, s.
    first_s: Option<f64>,
    /// The first frame with another state, and how many there are.
    pub first_difference: Option<Frame>,
    pub differences: u64,
}

impl Replay {
    pub fn open(path: &Path) -> Result<Replay, Failure> {
        let refused = |error: String| Failure::wrong(format!("{}: {error}", path.display()));
        let file = input::open(path).map_err(|error| refused(error.to_string()))?;
        let mut input = BufReader::new(file);
        let text = read_line(&mut input, 1, LONGEST_LINE)
            .map_err(|error| refused(error.to_string()))?
            .unwrap_or_default();
        let header: Header = serde_json::from_slice(&text).map_err(|error| {
            refused(format!("line 1: not a recording of `greenstage view --record`: {error}"))
        })?;
        if header.greenstage != "recording" || header.version != VERSION {
            let (kind, version) = (&header.greenstage, header.version);
            return Err(refused(format!(
                "line 1: not a recording of version {VERSION}, but {kind} of version {version}"
            )));
        }
        let path = path.to_owned();
        Ok(Replay {
            path,
            input,
            line: 1,
            header,
            frames: 0,
            played: 0,
            next: None,
            first_s: None,
            first_difference: None,
            differences: 0,
        })
    }

    /// The stage on which it was recorded: the name of a built-in one, or the path of a file that is there.
    pub fn stage(&self) -> Result<String, Failure> {
        let stage = &self.header.stage;
        if !is_file(stage) {
            return Ok(stage.clone());
        }
        let path = folder_of(&self.path).join(stage);
        if path.is_file() {
            return Ok(path.display().to_string());
        }
        Err(self.wrong(&format!(
            "the stage file that it was recorded on is not at {}: move it there, or name it by --stage",
            path.display()
        )))
    }

    /// Brings a new world to the start of the session; refuses one of another scene, stage or program.
    pub fn start(&mut self, origin: &Origin<'_>, world: &mut World) -> Result<(), Failure> {
        let (then, now) = (&self.header, origin.header(world, &self.path));
        let fault = if then.program != now.program {
            format!("it was recorded by greenstage {}, this is {}", then.program, now.program)
        } else if then.scene_hash != now.scene_hash {
            let scene = origin.scene.path.display();
            format!(
                "it was recorded with another scene than {scene}, or that has changed since: record it anew"
            )
        } else if then.stage_hash != now.stage_hash && then.stage == now.stage {
            format!("the stage {} has changed since it was recorded: record it anew", now.stage)
        } else if then.stage_hash != now.stage_hash {
            format!("it was recorded on the stage {}, not on {}: leave out --stage", then.stage, now.stage)
        } else {
            return self.start_from_state(world);
        };
        Err(self.wrong(&fault))
    }

    fn start_from_state(&mut self, world: &mut World) -> Result<(), Failure> {
        self.line += 1;
        let text = read_line(&mut self.input, self.line, LARGEST_STATE);
        let text = text.map_err(|error| self.wrong(&error.to_string()))?.unwrap_or_default();
        let wrong =
            |error: String| self.wrong(&format!("line {}: not the state of this scene: {error}", self.line));
        let state: State = serde_json::from_slice(&text).map_err(|error| wrong(error.to_string()))?;
        world.wait_for_background();
        world.set_state(&state).map_err(wrong)
    }

    /// Number of whole frames from here to the end; a note warns if the last one was cut off.
    pub fn length(&self) -> Result<u64, Failure> {
        let (frames, is_cut) = self.left()?;
        if is_cut {
            self.tell_cut(self.frames + frames);
        }
        Ok(frames)
    }

    /// Number of whole frames that follow, and whether one that was cut off comes after them.
    fn left(&self) -> Result<(u64, bool), Failure> {
        let refused = |error: std::io::Error| self.wrong(&error.to_string());
        let mut file = BufReader::new(input::open(&self.path).map_err(refused)?);
        let (mut lines, mut last) = (0, b'\n');
        loop {
            let part = file.fill_buf().map_err(refused)?;
            let length = part.len();
            let Some(&end) = part.last() else { break };
            lines += part.iter().filter(|byte| **byte == b'\n').count() as u64;
            last = end;
            file.consume(length);
        }
        Ok((lines.saturating_sub(self.line), last != b'\n'))
    }

    fn tell_cut(&self, frame: u64) {
        let path = self.path.display();
        notice!(
            "note: {path}: it ends in the middle of frame {frame}, which is left out, because the program was stopped"
        );
    }

    /// The next frame; `None` at the end. A frame that was cut off in the middle is the end, and a note warns of it.
    fn next_frame(&mut self) -> Result<Option<Frame>, Failure> {
        self.line += 1;
        let text = match read_line(&mut self.input, self.line, LONGEST_LINE) {
            Ok(Some(text)) => text,
            Ok(None) => return Ok(None),
            Err(StreamError::Truncated { .. }) => {
                self.tell_cut(self.frames);
                return Ok(None);
            }
            Err(error) => return Err(self.wrong(&error.to_string())),
        };
        let frame: Frame = serde_json::from_slice(&text)
            .map_err(|error| self.wrong(&format!("line {}: not a frame: {error}", self.line)))?;
        if frame.frame != self.frames {
            let (line, expected, found) = (self.line, self.frames, frame.frame);
            return Err(self.wrong(&format!("line {line}: frame {found} stands where {expected} should")));
        }
        self.frames += 1;
        Ok(Some(frame))
    }

    /// When the next frame is, s after the first; `None` at the end.
    pub fn next_time_s(&mut self) -> Result<Option<f64>, Failure> {
        if self.next.is_none() {
            self.next = self.next_frame()?;
        }
        let first_s = &mut self.first_s;
        Ok(self.next.as_ref().map(|frame| frame.input.clock_s - *first_s.get_or_insert(frame.input.clock_s)))
    }

    /// Plays the next frame in `world`, and compares its state with the recorded one; false at the end.
    pub fn play_next(&mut self, world: &mut World) -> Result<bool, Failure> {
        self.next_time_s()?;
        let Some(frame) = self.next.take() else { return Ok(false) };
        world.step(&frame.input);
        self.played += 1;
        if world.state_hash() != frame.hash {
            self.differences += 1;
            self.first_difference.get_or_insert(frame);
        }
        Ok(true)
    }

    fn wrong(&self, fault: &str) -> Failure {
        Failure::wrong(format!("{}: {fault}", self.path.display()))
    }

    /// The result for the user; a failure if a state differed or no frame was played.
    pub fn report(&self) -> Result<String, Failure> {
        let path = self.path.display();
        let total = self.frames + self.left()?.0;
        let part = if self.played < total { format!(" of {total}") } else { String::new() };
        match &self.first_difference {
            None if self.played == 0 => {
                Err(Failure::work(anyhow::anyhow!("{path}: none of its {total} frames was played")))
            }
            None => Ok(format!("{path}: {}{part} frames, every one in the recorded state\n", self.played)),
            Some(first) => Err(Failure::work(anyhow::anyhow!(
                "{path}: {} of {} frames are in another state than was recorded, the first of them frame {} at {:.3} s",
                self.differences,
                self.played,
                first.frame,
                first.input.clock_s
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::prepare::Resolved;
    use crate::session::{Request, Session};

    /// A warning of the session is an input, as commands are: a replay was without it.
    #[test]
    fn a_replay_warns_as_the_session_did() {
        let folder = tempfile::tempdir().unwrap();
        let [scene, script, recording] =
            ["scene.toml", "script.toml", "all.jsonl"].map(|name| folder.path().join(name));
        let text = "[body.a]\ngenerate = { block = { size = [1.0, 0.2, 0.2], cells = [5, 1, 1] } }\n\
                    material = { young = 1.0e6, poisson = 0.3 }\n\
                    control.low = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                    control.high = { nodes = { group = \"xmax\" }, grab = \"dragger\" }\n";
        let keys = "frame = \"room\"\n[[key]]\ntime = 0.0\nload = { weight = 1.0 }\n\
                    stylus.pen = { position = [0, 9, 0], direction = [0, 1, 0] }\n\
                    [[key]]\ntime = 0.2\nstylus.pen = { pressed = true }\n[[key]]\ntime = 1.0\n";
        std::fs::write(&scene, text).unwrap();
        std::fs::write(&script, keys).unwrap();
        let scene = Resolved::load(&scene).unwrap();
        let request = Request { script: Some(&script), record: Some(&recording), ..Request::new(&scene) };
        let mut session = Session::open(&request).unwrap();
        (0..30).for_each(|frame| {
            session.advance(f64::from(frame) / 60.0).unwrap();
        });
        session.stop_recording().unwrap();
        let expected = session.world.warnings.clone();
        let has = |part: &str| expected.iter().any(|(_, warning)| warning.contains(part));
        assert!(has("sets the load weight, which no body has") && has("grabs nothing"), "{expected:?}");
        let request = Request { replay: Some(&recording), ..Request::new(&scene) };
        let mut replay = Session::open(&request).unwrap();
        replay.advance(10.0).unwrap();
        assert_eq!(replay.world.warnings, expected);
    }
}
